//! Why an input cannot be planned: reason, place (mm, in the input's coordinates), remedy.

use super::POINTS_MAX;
use crate::geometry::Point2;
use crate::geometry::validity::ValidityError;
use crate::text::refusal::{Refusal, refusal};
use crate::text::short_number::Short;

/// A place for messages: `(12.345, -3.000) mm`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct At(pub Point2);

impl std::fmt::Display for At {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let beyond = |x: f64| x.abs() >= 1e12;
        match [self.0.x, self.0.y] {
            [x, y] if beyond(x) || beyond(y) => write!(f, "({}, {}) mm", Short(x), Short(y)),
            [x, y] => write!(f, "({x:.4}, {y:.4}) mm"),
        }
    }
}

/// The file is larger than anything sensible.
pub fn file_too_large(bytes: u64, bytes_max: u64) -> Refusal {
    refusal!(
        "the file has {bytes} bytes, more than {bytes_max}: reduce the number of points, or \
         split it"
    )
}

/// The text does not follow the format.
pub fn syntax(format: &'static str, problem: &str) -> Refusal {
    refusal!("not a readable {format} file: {problem}")
}

/// A key that is similar to a known one.
pub fn misspelt(key: &str, near: &'static str) -> Refusal {
    refusal!(
        "the key '{key}' is not known: is '{near}' meant? (keys that are like no known one are \
         the writer's own)"
    )
}

/// A path where an outline is required.
pub fn path_not_outline() -> Refusal {
    refusal!("a waypoint file is a path and has no outline; give a polygon, GeoJSON or SVG file")
}

/// A solid where an outline is required.
pub fn mesh_not_outline() -> Refusal {
    refusal!("a mesh is a solid and has no outline; give a polygon, GeoJSON or SVG file")
}

/// An unknown length unit.
pub fn unknown_units(given: &str) -> Refusal {
    refusal!(
        "units '{given}' are not known: use mm, cm, m, um or in (--units says it over the file)"
    )
}

/// The scale is not a positive number.
pub fn scale(scale: f64) -> Refusal {
    refusal!(
        "--scale {}: must be a finite number greater than 0",
        Short(scale)
    )
}

/// A point that is not two finite numbers.
pub fn bad_point(ring: &str, point: usize, problem: &str) -> Refusal {
    refusal!("{ring}: point {point} is {problem}; a point is [x, y] with two finite numbers")
}

/// Not enough distinct points for an area.
pub fn too_few_points(ring: &str, at: At, distinct: usize) -> Refusal {
    refusal!(
        "{ring} near {at} has {distinct} distinct points; an outline needs 3 or more: remove it"
    )
}

/// Nothing to print.
pub fn empty(hint: &'static str) -> Refusal {
    refusal!("there is no outline in it: {hint}")
}

/// More points than can be planned.
pub fn too_many_points(points: usize) -> Refusal {
    refusal!(
        "{points} points, more than {POINTS_MAX}: simplify the drawing (or raise --tolerance \
         for curves)"
    )
}

/// So far from the origin that digits are lost.
pub fn too_far(at: At, max_mm: f64) -> Refusal {
    refusal!(
        "the outline lies around {at}, farther than {max_mm} mm from the origin: move it closer \
         in the drawing"
    )
}

/// No line where centre lines are read.
pub fn no_lines(what: &str) -> Refusal {
    refusal!(
        "there is no line in it: {what} has an inside, or is a point; leave --centre-lines out \
         to fill it, or give it a stroke"
    )
}

/// Only contents that are not read.
pub fn nothing_filled(left_out: &str) -> Refusal {
    refusal!("there is no filled shape in it: {left_out}")
}

/// Not a valid outline in the sense of OGC simple features.
pub fn invalid(region: &str, problem: ValidityError) -> Refusal {
    refusal!("{region}: {problem}")
}
