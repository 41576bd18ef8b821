//! STL, binary or ASCII: triangles without units, by convention in mm.
//!
//! The stored normals are ignored: the order of the corners gives the orientation, and in files
//! that contradict it the normals are wrong.
//!
//! Read here and not by a crate: some texts are in capitals, have normals that are not numbers, or several
//! solids, some binary files begin with `solid` or state no count; and messages give the line.

use super::read::{RawMesh, syntax};
use super::{Mesh, Point3};
use crate::text::plain::plain;
use crate::text::refusal::Refusal;

const FORMAT: &str = "STL";
/// Header and count of a binary file, and one triangle, bytes.
const BINARY_HEAD: usize = 84;
const BINARY_TRIANGLE: usize = 50;

/// Reads all triangles, corners unshared.
pub(super) fn read(bytes: &[u8]) -> Result<RawMesh, Refusal> {
    // Some programs begin binary files with `solid` as well: the length decides.
    let is_whole = binary_bytes(bytes) == Some(bytes.len());
    let text = plain(bytes);
    let (mesh, note) = match is_text(&text) && !is_whole {
        true => (ascii(&String::from_utf8_lossy(&text))?, None),
        false => binary(bytes)?,
    };
    Ok(RawMesh {
        mesh,
        unit_mm: 1.0,
        notes: note.into_iter().collect(),
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

/// All triangles of a binary file, and a note where its count is not theirs: some programs never go back to write it.
fn binary(bytes: &[u8]) -> Result<(Mesh, Option<String>), Refusal> {
    let stated = check_length(bytes)?;
    let (whole, rest) = bytes[BINARY_HEAD..].as_chunks::<BINARY_TRIANGLE>();
    let numbers = |triangle: &[u8; BINARY_TRIANGLE]| -> [[f32; 3]; 3] {
        let number = |at: usize| {
            let bytes = [0, 1, 2, 3].map(|k| triangle[at + k]);
            f32::from_le_bytes(bytes)
        };
        // The normal is first.
        [12, 24, 36].map(|corner| [0, 4, 8].map(|axis| number(corner + axis)))
    };
    let is_finite = |triangle| {
        numbers(triangle)
            .as_flattened()
            .iter()
            .all(|x| x.is_finite())
    };
    // What follows the stated ones and is no number is no triangle.
    let is_more = rest.is_empty() && whole[stated..].iter().all(is_finite);
    let count = if is_more { whole.len() } else { stated };
    let mut mesh = Mesh::default();
    let triangles = whole[..count].iter();
    triangles.for_each(|triangle| mesh.push_triangle(numbers(triangle)));
    let left = bytes.len() - BINARY_HEAD - BINARY_TRIANGLE * count;
    let note = match left {
        0 if count == stated => None,
        0 => Some(format!(
            "the STL states {stated} triangles and has {count}: all of them were read"
        )),
        _ => Some(format!(
            "{left} bytes behind the {stated} triangles of the STL were left out"
        )),
    };
    Ok((mesh, note))
}

/// All solids of a text; names and normals are ignored.
fn ascii(text: &str) -> Result<Mesh, Refusal> {
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

/// True for bytes that begin like a text: a binary file has zeros in its count, at the least.
fn is_text(bytes: &[u8]) -> bool {
    let begins = bytes.trim_ascii_start().get(..5);
    begins.is_some_and(|word| word.eq_ignore_ascii_case(b"solid"))
        && !bytes.iter().take(512).any(|byte| *byte == 0)
}

/// Bytes that a binary file of its stated count has.
fn binary_bytes(bytes: &[u8]) -> Option<usize> {
    let count = bytes.get(80..84)?;
    let count = u32::from_le_bytes(count.try_into().ok()?);
    Some(BINARY_HEAD + BINARY_TRIANGLE * count as usize)
}

/// The stated number of triangles; tells of a binary file that is cut.
fn check_length(bytes: &[u8]) -> Result<usize, Refusal> {
    let ends = bytes.len();
    let Some(stated) = binary_bytes(bytes) else {
        let problem = format!("it has {ends} bytes and no `solid` in front; export it again");
        return Err(syntax(FORMAT, problem));
    };
    let triangles = (stated - BINARY_HEAD) / BINARY_TRIANGLE;
    match stated <= ends {
        true => Ok(triangles),
        false => Err(syntax(
            FORMAT,
            format!(
                "it states {triangles} triangles, {stated} bytes, and ends at byte {ends}; copy or export it again"
            ),
        )),
    }
}
