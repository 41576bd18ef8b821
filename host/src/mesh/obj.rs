//! Wavefront OBJ: all faces of all objects as one mesh, polygons as fans, without units.

use super::read::{RawMesh, syntax};
use super::{Mesh, MeshError, Point3};
use std::io::Cursor;
use tobj::{LoadError, LoadOptions};

/// Reads all faces.
pub(super) fn read(bytes: &[u8]) -> Result<RawMesh, MeshError> {
    let options = LoadOptions {
        triangulate: true,
        ignore_points: true,
        ignore_lines: true,
        ..LoadOptions::default()
    };
    // Colours change nothing of the shape.
    let no_materials = |_: &std::path::Path| Ok(Default::default());
    let (models, _) = tobj::load_obj_buf(&mut Cursor::new(bytes), &options, no_materials)
        .map_err(|error| problem(bytes, error))?;
    let mut mesh = Mesh::default();
    for model in &models {
        let first = mesh.vertices.len() as u32;
        let corners = model.mesh.positions.chunks_exact(3);
        mesh.vertices
            .extend(corners.map(|p| Point3::new(p[0], p[1], p[2])));
        let faces = model.mesh.indices.chunks_exact(3);
        mesh.triangles
            .extend(faces.map(|f| [first + f[0], first + f[1], first + f[2]]));
    }
    let name = models.first().map(|model| model.name.clone());
    Ok(RawMesh {
        mesh,
        name: name.filter(|name| !name.is_empty() && name != "unnamed_object"),
        unit_mm: 1.0,
        ..RawMesh::default()
    })
}

/// What the reader says, with the first line that alone is not read either, or names a vertex that is not there.
fn problem(bytes: &[u8], error: LoadError) -> MeshError {
    let lines = || bytes.split(|&b| b == b'\n').map(String::from_utf8_lossy);
    let is_vertex = |line: &str| line.split_ascii_whitespace().next() == Some("v");
    let vertices = lines().filter(|line| is_vertex(line)).count() as i64;
    let is_bad = |line: &str| {
        let mut words = line.split_ascii_whitespace();
        match words.next() {
            Some("v") => words.filter(|word| word.parse::<f64>().is_ok()).count() < 3,
            Some("f") => words.any(|word| {
                let corner = word.split('/').next().unwrap_or_default();
                corner.parse::<i64>().map_or(true, |k| {
                    k == 0 || k.unsigned_abs() > vertices.unsigned_abs()
                })
            }),
            _ => false,
        }
    };
    let line = lines().position(|line| is_bad(&line));
    let place = line.map_or(String::new(), |line| format!(" (line {})", line + 1));
    syntax("OBJ", format!("{error}{place}; export it again"))
}
