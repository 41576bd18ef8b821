//! 3MF: the objects that the build names, each where its transforms put it.
//!
//! The crate `threemf` reads the package; this file bounds what is unpacked and resolves items and
//! components. Slicers keep objects in model files of their own beside the one that has the build: an
//! object that its own model does not have is looked for in the others.

use super::read::{RawMesh, TRIANGLES_MAX, syntax};
use super::{Mesh, MeshError, Point3};
use std::io::{Cursor, Read};
use threemf::model::{Model, Object, Unit};

const FORMAT: &str = "3MF";
/// Most bytes of all model files once unpacked: the text of three million triangles.
const UNPACKED_MAX: u64 = 1 << 28;
/// Components within components.
const DEPTH_MAX: usize = 16;
/// Objects and components that are placed, each as often as it is: components repeat what is packed once, so that a
/// few lines may name any number of them.
const PARTS_MAX: usize = 100_000;

/// Reads what the build places.
pub(super) fn read(bytes: &[u8]) -> Result<RawMesh, MeshError> {
    check_unpacked(bytes)?;
    let models = threemf::read(Cursor::new(bytes)).map_err(|error| problem(&error.to_string()))?;
    let builds: Vec<&Model> = models.iter().filter(|m| !m.build.item.is_empty()).collect();
    let Some(root) = builds.first() else {
        return Err(MeshError::NothingBuilt);
    };
    let mut package = Package {
        models: &models,
        mesh: Mesh::default(),
        only_counts: true,
        triangles: 0,
        parts: 0,
    };
    // Counted before anything is made of it.
    for only_counts in [true, false] {
        package.only_counts = only_counts;
        for item in &root.build.item {
            package.add(item.objectid, root, item.transform.unwrap_or(UNMOVED), 0)?;
        }
    }
    let mut notes = Vec::new();
    if root.build.item.len() > 1 {
        notes.push(format!("{} build items", root.build.item.len()));
    }
    let named = root.resources.object.iter().find_map(|o| o.name.clone());
    Ok(RawMesh {
        mesh: package.mesh,
        name: named.filter(|_| root.build.item.len() == 1),
        unit_mm: match root.unit {
            Unit::Micron => 0.001,
            Unit::Millimeter => 1.0,
            Unit::Centimeter => 10.0,
            Unit::Inch => 25.4,
            Unit::Foot => 304.8,
            Unit::Meter => 1000.0,
        },
        notes,
    })
}

fn problem(what: &str) -> MeshError {
    syntax(FORMAT, format!("{what}; export it again"))
}

/// Unpacks to nowhere: what a package states of its sizes need not be true.
fn check_unpacked(bytes: &[u8]) -> Result<(), MeshError> {
    let mut package =
        zip::ZipArchive::new(Cursor::new(bytes)).map_err(|error| problem(&error.to_string()))?;
    let mut left = UNPACKED_MAX;
    for number in 0..package.len() {
        let file = package.by_index(number);
        let file = file.map_err(|error| problem(&error.to_string()))?;
        let is_model = file.name().ends_with(".model");
        if !is_model {
            continue;
        }
        let unpacked = std::io::copy(&mut file.take(left + 1), &mut std::io::sink());
        let unpacked = unpacked.map_err(|error| problem(&error.to_string()))?;
        if unpacked > left {
            let what = format!("its models unpack to more than {UNPACKED_MAX} bytes");
            return Err(syntax(FORMAT, what + "; export with a coarser tolerance"));
        }
        left -= unpacked;
    }
    Ok(())
}

/// Rows of a transform as the format has them: a point is a row in front of the matrix.
type Transform = [f64; 12];
const UNMOVED: Transform = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0];

fn moved(p: Point3, m: &Transform) -> Point3 {
    let along = |i: usize| p.x * m[i] + p.y * m[3 + i] + p.z * m[6 + i] + m[9 + i];
    Point3::new(along(0), along(1), along(2))
}

/// First `inner`, then `outer`.
fn chained(inner: &Transform, outer: &Transform) -> Transform {
    let mut chained = [0.0; 12];
    for row in 0..4 {
        for column in 0..3 {
            let own = (0..3).map(|k| inner[3 * row + k] * outer[3 * k + column]);
            let shift = if row == 3 { outer[9 + column] } else { 0.0 };
            chained[3 * row + column] = own.sum::<f64>() + shift;
        }
    }
    chained
}

/// True where a transform is a mirror image: outside becomes inside.
fn mirrors(m: &Transform) -> bool {
    let rows = nalgebra::Matrix3::from_row_slice(&m[..9]);
    rows.determinant() < 0.0
}

struct Package<'a> {
    models: &'a [Model],
    mesh: Mesh,
    only_counts: bool,
    /// Counted so far.
    triangles: usize,
    parts: usize,
}

impl<'a> Package<'a> {
    fn object(&self, id: usize, model: &'a Model) -> Option<(&'a Object, &'a Model)> {
        let own = std::iter::once(model);
        let others = self.models.iter().filter(|m| !std::ptr::eq(*m, model));
        own.chain(others).find_map(|model| {
            let mut objects = model.resources.object.iter();
            Some((objects.find(|o| o.id == id)?, model))
        })
    }

    fn add(
        &mut self,
        id: usize,
        model: &'a Model,
        transform: Transform,
        depth: usize,
    ) -> Result<(), MeshError> {
        let max = DEPTH_MAX;
        if depth > max {
            return Err(MeshError::TooDeep { id, max });
        }
        // One that names itself would be found in another model.
        let Some((object, model)) = self.object(id, model) else {
            return Err(MeshError::NoSuchObject { id });
        };
        match &object.mesh {
            Some(mesh) if self.only_counts => self.count(mesh)?,
            Some(mesh) => self.add_mesh(mesh, &transform)?,
            None => {}
        }
        if self.only_counts {
            self.parts += 1;
            if self.parts > PARTS_MAX {
                return Err(MeshError::TooManyParts { max: PARTS_MAX });
            }
        }
        let components = object.components.iter().flat_map(|c| &c.component);
        for component in components {
            let own = component.transform.unwrap_or(UNMOVED);
            let transform = chained(&own, &transform);
            // A component of the same number is another model's.
            let from = match component.objectid == id {
                true => self.models.iter().find(|m| !std::ptr::eq(*m, model)),
                false => Some(model),
            };
            let id = component.objectid;
            let from = from.ok_or(MeshError::NoSuchObject { id })?;
            self.add(id, from, transform, depth + 1)?;
        }
        Ok(())
    }

    fn count(&mut self, mesh: &threemf::model::Mesh) -> Result<(), MeshError> {
        self.triangles += mesh.triangles.triangle.len();
        match self.triangles > TRIANGLES_MAX {
            true => Err(MeshError::TooMany {
                triangles: self.triangles,
            }),
            false => Ok(()),
        }
    }

    fn add_mesh(
        &mut self,
        mesh: &threemf::model::Mesh,
        transform: &Transform,
    ) -> Result<(), MeshError> {
        let (vertices, triangles) = (&mesh.vertices.vertex, &mesh.triangles.triangle);
        let first = self.mesh.vertices.len();
        let places = vertices.iter().map(|v| Point3::new(v.x, v.y, v.z));
        self.mesh
            .vertices
            .extend(places.map(|p| moved(p, transform)));
        let is_mirrored = mirrors(transform);
        for (number, t) in triangles.iter().enumerate() {
            let corners = [t.v1, t.v2, t.v3];
            if let Some(&vertex) = corners.iter().find(|&&v| v >= vertices.len()) {
                return Err(MeshError::NoSuchVertex {
                    triangle: number,
                    vertex,
                    vertices: vertices.len(),
                });
            }
            let [a, b, c] = corners.map(|v| (first + v) as u32);
            let triangle = if is_mirrored { [a, c, b] } else { [a, b, c] };
            self.mesh.triangles.push(triangle);
        }
        Ok(())
    }
}
