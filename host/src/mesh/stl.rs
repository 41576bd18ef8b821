//! STL, binary or ASCII: triangles without units, by convention in mm.
//!
//! The stored normals are ignored: the order of the corners gives the orientation, and in files
//! that contradict it the normals are wrong.
//!
//! ASCII files are read here and not by `stl_io`: some are in capitals, have normals that are not numbers, or
//! several solids, of which that crate reads the first; and messages give the line.

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
    // Some programs begin binary files with `solid` as well: the length decides.
    let is_binary = binary_triangles(bytes) == Some(bytes.len());
    let mesh = match is_text(bytes) && !is_binary {
        true => ascii(&String::from_utf8_lossy(bytes))?,
        false => binary(bytes)?,
    };
    Ok(RawMesh {
        mesh,
        unit_mm: 1.0,
        ..RawMesh::default()
    })
}

impl Mesh {
    /// A triangle of three corners of its own.
    fn push_triangle(&mut self, corners: [[f32; 3]; 3]) {
        let first = self.vertices.len() as u32;
        let places = corners.map(|corner| corner.map(f64::from));
        let vertices = places.map(|[x, y, z]| Point3::new(x, y, z));
        self.vertices.extend(vertices);
        self.triangles.push([first, first + 1, first + 2]);
    }
}

fn binary(bytes: &[u8]) -> Result<Mesh, MeshError> {
    let mut head = Vec::new();
    let mut rest = Cursor::new(bytes);
    if bytes.starts_with(b"solid") {
        head.extend_from_slice(bytes);
        head[..5].fill(b' ');
        rest = Cursor::new(&head);
    }
    let triangles = stl_io::create_stl_reader(&mut rest).map_err(|error| problem(&error))?;
    let mut mesh = Mesh::default();
    for triangle in triangles {
        let triangle = triangle.map_err(|error| problem(&error))?;
        mesh.push_triangle(triangle.vertices.map(|vertex| vertex.0));
    }
    Ok(mesh)
}

/// All solids of a text; names and normals are ignored.
fn ascii(text: &str) -> Result<Mesh, MeshError> {
    let mut mesh = Mesh::default();
    let mut corners: Vec<[f32; 3]> = Vec::new();
    let mut is_open = false;
    let mut last_line = 0;
    // Old programs end lines with a CR alone.
    let line_end = if text.contains('\n') { '\n' } else { '\r' };
    for (number, line) in (1..).zip(text.split(line_end)) {
        let at = |what: &str| syntax(FORMAT, format!("line {number}: {what}; export it again"));
        let mut words = line.split_ascii_whitespace();
        while let Some(word) = words.next() {
            last_line = number;
            match word.to_ascii_lowercase().as_str() {
                // What follows is a name.
                "solid" | "endsolid" => {
                    is_open = word.len() == "solid".len();
                    break;
                }
                "normal" => words.by_ref().take(3).for_each(drop),
                "vertex" => {
                    let mut coordinate = || words.next()?.parse::<f32>().ok();
                    let place = (coordinate(), coordinate(), coordinate());
                    let (Some(x), Some(y), Some(z)) = place else {
                        return Err(at("a vertex has no three numbers"));
                    };
                    corners.push([x, y, z]);
                }
                "endfacet" => {
                    let triangle = <[[f32; 3]; 3]>::try_from(corners.as_slice());
                    mesh.push_triangle(triangle.map_err(|_| at("a facet has not three corners"))?);
                    corners.clear();
                }
                "facet" | "outer" | "loop" | "endloop" => {}
                _ => return Err(at("it has a word that no STL file has")),
            }
        }
    }
    match is_open || !corners.is_empty() {
        true => Err(syntax(
            FORMAT,
            format!("it ends at line {last_line} inside a solid; copy or export it again"),
        )),
        false => Ok(mesh),
    }
}

/// True for bytes that begin like a text.
fn is_text(bytes: &[u8]) -> bool {
    let begins = bytes.trim_ascii_start().get(..5);
    begins.is_some_and(|word| word.eq_ignore_ascii_case(b"solid"))
        && bytes.iter().take(512).all(u8::is_ascii)
}

/// Bytes that a binary file of its stated count has.
fn binary_triangles(bytes: &[u8]) -> Option<usize> {
    let count = bytes.get(80..84)?;
    let count = u32::from_le_bytes(count.try_into().ok()?);
    Some(BINARY_HEAD + BINARY_TRIANGLE * count as usize)
}

/// Tells of a binary file that is cut.
fn check_length(bytes: &[u8]) -> Result<(), MeshError> {
    let stated = binary_triangles(bytes);
    match stated {
        _ if is_text(bytes) => Ok(()),
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
