//! What a file holds before anything is checked.

use super::Mesh;

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
}
