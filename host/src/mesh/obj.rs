//! Wavefront OBJ: all faces of all objects as one mesh, polygons as triangles, without units.
//!
//! In: statements `v` (with a colour or without), `f` with any kind of corners, `o` and `g`; a backslash at a
//! line's end continues it. Elements of points and lines, and free-form ones, are counted in a note, other
//! statements (normals, materials) change nothing of the shape. Out: a mesh over the vertices that faces use.
//! Source: the specification of the Alias/Wavefront "Object Files" (B1), 3.0.

use super::read::{RawMesh, syntax};
use super::{Mesh, Point3};
use crate::text::plain::plain;
use crate::text::refusal::Refusal;
use std::collections::BTreeMap;

/// Most corners of a face that is not convex and is divided by its shape: each costs a look at all others.
const CORNERS_MAX: usize = 5000;

/// What the statements have said so far.
#[derive(Default)]
struct Reader {
    vertices: Vec<Point3>,
    /// Of those vertices that have one.
    colours: BTreeMap<usize, [u8; 3]>,
    /// Corners of faces, as numbers of vertices from 0, and the line.
    faces: Vec<(Vec<usize>, usize)>,
    /// Names, each with the first face that it holds for.
    names: Vec<(String, usize)>,
    /// Elements that are no faces.
    left_out: BTreeMap<&'static str, usize>,
}

/// Reads all faces.
pub(super) fn read(bytes: &[u8]) -> Result<RawMesh, Refusal> {
    let text = plain(bytes);
    let text = String::from_utf8_lossy(&text);
    let mut reader = Reader::default();
    let mut lines = text.lines().zip(1..);
    while let Some((line, number)) = lines.next() {
        let mut statement = line.trim_end().to_string();
        while statement.ends_with('\\') {
            statement.pop();
            let Some((next, _)) = lines.next() else {
                break;
            };
            statement.push(' ');
            statement.push_str(next.trim_end());
        }
        let read = reader.statement(&statement, number);
        read.map_err(|what| problem(number, &what))?;
    }
    reader.mesh()
}

fn problem(line: usize, what: &str) -> Refusal {
    syntax("OBJ", format!("line {line}: {what}; export it again"))
}

impl Reader {
    fn statement(&mut self, statement: &str, line: usize) -> Result<(), String> {
        let content = statement.split('#').next().unwrap_or_default();
        let mut words = content.split_ascii_whitespace();
        match words.next().unwrap_or_default() {
            "v" => self.vertex(words)?,
            "f" | "fo" => {
                let corners = words.map(|word| self.corner(word));
                match corners.collect::<Result<Vec<usize>, String>>()? {
                    corners if corners.len() < 3 => self.leave_out("faces of two corners"),
                    corners => self.faces.push((corners, line)),
                }
            }
            "o" | "g" => {
                let name = words.collect::<Vec<_>>().join(" ");
                self.names.push((name, self.faces.len()));
            }
            "l" => self.leave_out("lines"),
            "p" => self.leave_out("points"),
            "curv" | "curv2" => self.leave_out("curves"),
            "surf" => self.leave_out("free-form surfaces"),
            _ => {}
        }
        Ok(())
    }

    fn leave_out(&mut self, what: &'static str) {
        *self.left_out.entry(what).or_default() += 1;
    }

    fn vertex<'a>(&mut self, words: impl Iterator<Item = &'a str>) -> Result<(), String> {
        let numbers: Option<Vec<f64>> = words.map(|word| word.parse().ok()).collect();
        let numbers = numbers.unwrap_or_default();
        let [x, y, z, rest @ ..] = numbers.as_slice() else {
            return Err("a vertex has no three numbers".to_string());
        };
        // With a weight in front of it, or without.
        if let [r, g, b] | [_, r, g, b] = rest {
            let colour = [r, g, b].map(|part| (255.0 * part).round() as u8);
            self.colours.insert(self.vertices.len(), colour);
        }
        self.vertices.push(Point3::new(*x, *y, *z));
        Ok(())
    }

    /// The vertex of a corner `v`, `v/vt`, `v//vn` or `v/vt/vn`; negative numbers count from the last one.
    fn corner(&self, word: &str) -> Result<usize, String> {
        let vertex = word.split('/').next().unwrap_or_default();
        let number = match vertex.parse::<i64>() {
            Ok(number) if number > 0 => number - 1,
            Ok(number) if number < 0 => self.vertices.len() as i64 + number,
            _ => return Err(format!("a face has a corner '{word}'")),
        };
        usize::try_from(number).map_err(|_| format!("the corner '{word}' is out of bounds"))
    }

    fn mesh(self) -> Result<RawMesh, Refusal> {
        let mut mesh = Mesh::default();
        let mut number_of = vec![u32::MAX; self.vertices.len()];
        let mut colours = Vec::new();
        // The first triangle of each face.
        let mut first = Vec::with_capacity(self.faces.len() + 1);
        for (corners, line) in &self.faces {
            first.push(mesh.triangles.len());
            for &vertex in corners {
                let Some(number) = number_of.get_mut(vertex) else {
                    let given = self.vertices.len();
                    let what = format!("vertex {} of {given} is out of bounds", vertex + 1);
                    return Err(problem(*line, &what));
                };
                if *number == u32::MAX {
                    *number = mesh.vertices.len() as u32;
                    mesh.vertices.push(self.vertices[vertex]);
                    colours.extend(self.colours.get(&vertex));
                }
            }
            let places: Vec<Point3> = corners.iter().map(|&k| self.vertices[k]).collect();
            let triangles = triangles(&places).into_iter();
            let number = |corner: usize| number_of[corners[corner]];
            mesh.triangles.extend(triangles.map(|t| t.map(number)));
        }
        first.push(mesh.triangles.len());
        let left_out = self.left_out.iter();
        let left_out: Vec<String> = left_out.map(|(what, n)| format!("{n} {what}")).collect();
        let note = (!left_out.is_empty())
            .then(|| format!("{} of the OBJ were left out: no solid", left_out.join(", ")));
        let runs = self.names.iter().enumerate();
        let runs = runs.map(|(k, (name, from))| {
            let next = self.names.get(k + 1);
            let to = next.map_or(self.faces.len(), |(_, next)| *next);
            let faces = first[*from]..first[to];
            (name.clone(), Vec::from([faces]))
        });
        let is_named = |(name, _): &&(String, usize)| !name.is_empty();
        Ok(RawMesh {
            name: self
                .names
                .iter()
                .find(is_named)
                .map(|(name, _)| name.clone()),
            unit_mm: 1.0,
            notes: note.into_iter().collect(),
            groups: runs.filter(|(_, run)| !run[0].is_empty()).collect(),
            // Of some vertices alone they tell nothing of the others.
            colours: match colours.len() == mesh.vertices.len() {
                true => colours,
                false => Vec::new(),
            },
            mesh,
            ..RawMesh::default()
        })
    }
}

/// A face as triangles of its corners: a fan where it is convex, else ears cut off one by one, as seen along
/// its normal.
fn triangles(places: &[Point3]) -> Vec<[usize; 3]> {
    let count = places.len();
    let fan = |(a, b)| [0, a, b];
    let fan = || (1..).zip(2..count).map(fan).collect();
    let around = (0..count).map(|k| (places[k] - places[0], places[(k + 1) % count] - places[0]));
    let normal = around.fold(super::Vector3::zeros(), |sum, (a, b)| sum + a.cross(&b));
    // Left of the line from one corner to another, as seen against the normal.
    let side = |a: usize, b: usize, p: usize| {
        let cross = (places[b] - places[a]).cross(&(places[p] - places[a]));
        cross.dot(&normal)
    };
    let mut left: Vec<usize> = (0..count).collect();
    let is_convex = (0..count).all(|k| side(k, (k + 1) % count, (k + 2) % count) >= 0.0);
    if is_convex || !(4..=CORNERS_MAX).contains(&count) {
        return fan();
    }
    let mut triangles = Vec::with_capacity(count - 2);
    let mut at = 0;
    // Turns without an ear: a face that crosses itself has none, and is divided somehow.
    let mut misses = 0;
    while left.len() > 3 {
        let corner = |offset: usize| left[(at + offset) % left.len()];
        let ear = [corner(0), corner(1), corner(2)];
        let [a, b, c] = ear;
        let is_corner = |p: usize| ear.iter().any(|&own| places[own] == places[p]);
        let is_in = |p: usize| side(a, b, p) >= 0.0 && side(b, c, p) >= 0.0 && side(c, a, p) >= 0.0;
        let is_ear = side(a, b, c) > 0.0 && !left.iter().any(|&p| !is_corner(p) && is_in(p));
        if is_ear || misses > left.len() {
            triangles.push(ear);
            left.remove((at + 1) % left.len());
            misses = 0;
        } else {
            misses += 1;
        }
        at = (at + 1) % left.len();
    }
    triangles.push([left[0], left[1], left[2]]);
    triangles
}
