//! STL, binary or ASCII: triangles without units, by convention in mm.
//!
//! The stored normals are passed over: the order of the corners says what is outside, and files
//! whose normals say otherwise are wrong in the normals.

use super::read::{RawMesh, syntax};
use super::{Mesh, MeshError, Point3};
use std::io::{Cursor, ErrorKind};

const FORMAT: &str = "STL";
/// Header and count of a binary file, and one triangle, bytes.
const BINARY_HEAD: usize = 84;
const BINARY_TRIANGLE: usize = 50;

/// Reads all triangles, corners unshared.
pub(super) fn read(bytes: &[u8]) -> Result<RawMesh, MeshError> {
    check_length(bytes)?;
    // Some programs begin binary files with `solid` as well: the length tells.
    let mut rest = Cursor::new(bytes);
    let is_binary = binary_triangles(bytes) == Some(bytes.len());
    let mut head = Vec::new();
    if is_binary && bytes.starts_with(b"solid") {
        head.extend_from_slice(bytes);
        head[..5].fill(b' ');
        rest = Cursor::new(&head);
    }
    let triangles = stl_io::create_stl_reader(&mut rest).map_err(|error| problem(&error))?;
    let mut mesh = Mesh::default();
    for triangle in triangles {
        let triangle = triangle.map_err(|error| problem(&error))?;
        let first = mesh.vertices.len() as u32;
        mesh.vertices.extend(triangle.vertices.iter().map(|vertex| {
            let [x, y, z] = vertex.0.map(f64::from);
            Point3::new(x, y, z)
        }));
        mesh.triangles.push([first, first + 1, first + 2]);
    }
    Ok(RawMesh {
        mesh,
        name: None,
        unit_mm: 1.0,
        notes: Vec::new(),
    })
}

/// Bytes that a binary file of its stated count has.
fn binary_triangles(bytes: &[u8]) -> Option<usize> {
    let count = bytes.get(80..84)?;
    let count = u32::from_le_bytes(count.try_into().ok()?);
    Some(BINARY_HEAD + BINARY_TRIANGLE * count as usize)
}

/// Tells of a binary file that is cut.
fn check_length(bytes: &[u8]) -> Result<(), MeshError> {
    let is_text = bytes.starts_with(b"solid") && bytes.iter().take(512).all(u8::is_ascii);
    let stated = binary_triangles(bytes);
    match stated {
        _ if is_text => Ok(()),
        Some(stated) if stated <= bytes.len() => Ok(()),
        Some(stated) => Err(syntax(
            FORMAT,
            format!(
                "it states {} triangles, {stated} bytes, and ends at byte {}; copy or export it again",
                (stated - BINARY_HEAD) / BINARY_TRIANGLE,
                bytes.len()
            ),
        )),
        None => Err(syntax(
            FORMAT,
            format!(
                "it has {} bytes and no `solid` in front; export it again",
                bytes.len()
            ),
        )),
    }
}

fn problem(error: &std::io::Error) -> MeshError {
    let what = match error.kind() {
        ErrorKind::UnexpectedEof => "it ends inside a triangle".to_string(),
        _ => error.to_string(),
    };
    syntax(FORMAT, format!("{what}; export it again"))
}
