//! Triangle meshes of CAD programs -> regions by layer.
//!
//! ```text
//! bytes --stl|threemf|obj--> Mesh --clean, close_gaps, orient--> Mesh --slice--> [Region] by plane
//!         (file's unit)    (mm, closed, counter-clockwise outside)    (mm, input coordinates)
//!    --layers--> SlicedPart (regions and heights, mm)
//! ```
//! Volumes that a project subtracts from an object are separate meshes ([`Carved`]), subtracted from the
//! object's sections.
//!
//! Input: the file's bytes, its [`MeshFormat`] and [`MeshOptions`]. Output: a closed, upright
//! [`Mesh`] in mm, and one note for each repair. A mesh with gaps above [`close_gaps::GAP_MAX_MM`]
//! is refused with the place. Not covered: colours, materials and textures, which do not affect the
//! shape.

mod clean;
pub mod close_gaps;
mod half_edges;
pub mod height_map;
pub mod layers;
mod obj;
mod orient;
pub mod patch;
mod raw_mesh;
mod read;
pub mod slice;
pub mod split;
mod stl;
mod surface_region;
mod threemf;

#[cfg(test)]
mod test_meshes;
#[cfg(test)]
mod tests;

pub use read::{LoadedMesh, MeshFormat, MeshOptions, TRIANGLES_MAX, read, read_surface};
pub use surface_region::SurfaceRegion;

/// A point in space, mm.
pub type Point3 = nalgebra::Point3<f64>;
/// A vector in space, mm.
pub type Vector3 = nalgebra::Vector3<f64>;

/// Triangles over shared vertices.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Where the corners are, mm.
    pub vertices: Vec<Point3>,
    /// Three vertices each, counter-clockwise as seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

/// A closed mesh, and the volumes that are subtracted only from it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Carved {
    /// Material, closed, mm.
    pub solid: Mesh,
    /// No material, closed, mm.
    pub cut: Mesh,
}

impl Mesh {
    /// Takes over the triangles of another mesh, with vertices of their own.
    fn append(&mut self, other: &Mesh) {
        let first = self.vertices.len() as u32;
        self.vertices.extend_from_slice(&other.vertices);
        let triangles = other.triangles.iter();
        self.triangles
            .extend(triangles.map(|triangle| triangle.map(|vertex| first + vertex)));
    }

    /// The corners of a triangle, mm.
    pub fn corners(&self, triangle: usize) -> [Point3; 3] {
        self.triangles[triangle].map(|vertex| self.vertices[vertex as usize])
    }

    /// Least and largest coordinates, mm; infinite where there is no vertex.
    pub fn bounds_mm(&self) -> [Point3; 2] {
        let none = [f64::INFINITY, f64::NEG_INFINITY].map(|x| Point3::new(x, x, x));
        self.vertices
            .iter()
            .fold(none, |[low, high], p| [low.inf(p), high.sup(p)])
    }

    /// Enclosed volume, mm³; negative if the triangles face inwards.
    pub fn volume_mm3(&self) -> f64 {
        volume_mm3(self, 0..self.triangles.len())
    }
}

/// Volume under some triangles, mm³, summed about the first one's corner so that no digits are lost.
fn volume_mm3(mesh: &Mesh, triangles: impl IntoIterator<Item = usize>) -> f64 {
    let mut triangles = triangles.into_iter().peekable();
    let Some(origin) = triangles.peek().map(|&first| mesh.corners(first)[0]) else {
        return 0.0;
    };
    let volume_mm3 = |triangle| {
        let [a, b, c] = mesh.corners(triangle).map(|p| p - origin);
        a.dot(&b.cross(&c)) / 6.0
    };
    triangles.map(volume_mm3).sum()
}

/// A place for messages.
fn place(at: Point3) -> String {
    format!("({:.3}, {:.3}, {:.3}) mm", at.x, at.y, at.z)
}
