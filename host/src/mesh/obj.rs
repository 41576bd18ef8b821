//! Wavefront OBJ: all faces of all objects as one mesh, polygons as triangle fans, without units.

use super::read::{RawMesh, syntax};
use super::{Mesh, MeshError, Point3};
use std::borrow::Cow;
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
    let bytes = &lenient(bytes);
    // Colours change nothing of the shape.
    let no_materials = |_: &std::path::Path| Ok(Default::default());
    let (models, _) = tobj::load_obj_buf(&mut Cursor::new(bytes), &options, no_materials)
        .map_err(|error| problem(bytes, error))?;
    let mut mesh = Mesh::default();
    let (mut groups, mut colours) = (Vec::new(), Vec::new());
    for model in &models {
        let first = mesh.vertices.len() as u32;
        let own = model.mesh.vertex_color.chunks_exact(3);
        colours.extend(own.map(|colour| [0, 1, 2].map(|k| (255.0 * colour[k]).round() as u8)));
        let triangles = mesh.triangles.len();
        let faces = model.mesh.indices.len() / 3;
        let run = triangles..triangles + faces;
        groups.push((model.name.clone(), vec![run]));
        let corners = model.mesh.positions.chunks_exact(3);
        mesh.vertices
            .extend(corners.map(|p| Point3::new(p[0], p[1], p[2])));
        let faces = model.mesh.indices.chunks_exact(3);
        mesh.triangles
            .extend(faces.map(|f| [first + f[0], first + f[1], first + f[2]]));
    }
    let name = models.first().map(|model| model.name.clone());
    Ok(RawMesh {
        name: name.filter(|name| !name.is_empty() && name != "unnamed_object"),
        unit_mm: 1.0,
        groups,
        // Of some objects alone they belong to no vertex for sure.
        colours: match colours.len() == mesh.vertices.len() {
            true => colours,
            false => Vec::new(),
        },
        mesh,
        ..RawMesh::default()
    })
}

/// The text as the reader takes it, line for line: a CR alone ends a line as well, and a material without
/// a name is ignored.
fn lenient(bytes: &[u8]) -> Cow<'_, [u8]> {
    let mut text = Cow::Borrowed(bytes);
    if !text.contains(&b'\n') && text.contains(&b'\r') {
        for end in text.to_mut().iter_mut().filter(|byte| **byte == b'\r') {
            *end = b'\n';
        }
    }
    let word = b"usemtl";
    let starts = text.windows(word.len()).enumerate();
    let starts = starts.filter(|(_, window)| window == word);
    let nameless = starts.filter(|(start, _)| {
        let rest = text[start + word.len()..].split(|&byte| byte == b'\n');
        let begins_line = *start == 0 || text[start - 1].is_ascii_whitespace();
        let is_blank = |line: &[u8]| line.iter().all(u8::is_ascii_whitespace);
        begins_line && rest.into_iter().next().is_some_and(is_blank)
    });
    let nameless: Vec<usize> = nameless.map(|(start, _)| start).collect();
    for start in nameless {
        // A comment.
        text.to_mut()[start] = b'#';
    }
    text
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
