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
        notes: Vec::new(),
    })
}

/// What the reader says, with the first line that alone is not read either.
fn problem(bytes: &[u8], error: LoadError) -> MeshError {
    let is_bad = |line: &&[u8]| {
        let words: Vec<&[u8]> = line.split(|b| b.is_ascii_whitespace()).collect();
        let is_vertex = words.first() == Some(&&b"v"[..]);
        let is_number = |word: &&&[u8]| {
            let text = std::str::from_utf8(word).unwrap_or("");
            text.parse::<f64>().is_ok()
        };
        is_vertex && words[1..].iter().filter(is_number).count() < 3
    };
    let line = bytes.split(|&b| b == b'\n').position(|l| is_bad(&l));
    let place = line.map_or(String::new(), |line| format!(" (line {})", line + 1));
    syntax("OBJ", format!("{error}{place}; export it again"))
}
