//! What a file holds before anything is checked, and its objects with settings of their own.
//!
//! In: boxes and volumes of objects, what they ask for. Out: [`PartObject`]s with closed volumes; those that cannot be closed
//! are left out, and noted.

use super::layers::HeightRange;
use super::object_settings::{OwnSettings, PartObject, Zone};
use super::{Mesh, MeshError, Point3};

/// What a file holds, before anything is checked.
#[derive(Default)]
pub(super) struct RawMesh {
    pub mesh: Mesh,
    /// Material, and the volumes subtracted from it.
    pub carved: Vec<(Mesh, Mesh)>,
    pub name: Option<String>,
    pub unit_mm: f64,
    pub notes: Vec<String>,
    /// Names that the file gives to runs of the mesh's triangles.
    pub groups: Vec<(String, Vec<std::ops::Range<usize>>)>,
    /// Colours of the mesh's vertices, if it has any.
    pub colours: Vec<[u8; 3]>,
    /// Colours of the mesh's triangles, if it has any.
    pub triangle_colours: Vec<Option<[u8; 3]>>,
    /// Objects with settings of their own.
    pub objects: Vec<RawObject>,
    /// Layer heights above the lowest point, mm.
    pub heights: Vec<HeightRange>,
}

/// An object with settings of its own.
pub(super) struct RawObject {
    pub name: Option<String>,
    /// Of its box.
    pub corners: Vec<Point3>,
    pub own: OwnSettings,
    pub zones: Vec<Zone>,
}

impl RawObject {
    /// All that is moved with the part.
    pub fn points(&mut self) -> impl Iterator<Item = &mut Point3> {
        let zones = self.zones.iter_mut();
        let zones = zones.flat_map(|zone| &mut zone.mesh.vertices);
        self.corners.iter_mut().chain(zones)
    }

    /// Its volumes closed.
    pub fn closed(
        self,
        mut close: impl FnMut(Mesh) -> Result<Mesh, MeshError>,
        notes: &mut Vec<String>,
    ) -> PartObject {
        let RawObject {
            name,
            corners,
            own,
            zones,
        } = self;
        let corners = Mesh {
            vertices: corners,
            triangles: Vec::new(),
        };
        let zone = |zone: Zone| match close(zone.mesh) {
            Ok(mesh) => Some(Zone { mesh, ..zone }),
            Err(error) => {
                let name = zone.name.as_deref().unwrap_or("a volume");
                notes.push(format!("settings of {name} are not followed: {error}"));
                None
            }
        };
        PartObject {
            name,
            bounds_mm: corners.bounds_mm(),
            own,
            zones: zones.into_iter().filter_map(zone).collect(),
        }
    }
}
