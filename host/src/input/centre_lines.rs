//! Contours of a drawing as the middles of beads: walls are drawn as lines.
//!
//! In: a drawing (mm but for `--scale`). Out: lines in mm, in their order in the file, joined where exactly two ends meet
//! within 0.01 mm; closed ones without a repeated point. A line that ends on the middle of another, or where more than
//! two meet, stays by itself. Not covered: the order of printing and the beads' width, which planning chooses.

use super::ReadOptions;
use super::dxf::join::contours;
use super::names::name_of;
use super::outline::{CLOSED_MM, Drawing, RawRing, scale_and_check};
use crate::geometry::Point2;
use crate::input::error;
use crate::text::refusal::Refusal;

/// Lines and notes on how they were read.
#[derive(Clone, Debug, PartialEq)]
pub struct CentreLines {
    /// Name for headers and pictures.
    pub name: String,
    /// Lines, one or more.
    pub lines: Vec<CentreLine>,
    /// One line each.
    pub notes: Vec<String>,
}

/// One line, two points or more, no two in a row the same.
#[derive(Clone, Debug, PartialEq)]
pub struct CentreLine {
    /// Corners, mm.
    pub points: Vec<Point2>,
    /// The last point is followed by the first.
    pub closed: bool,
}

impl CentreLine {
    /// Its edges.
    pub fn edges(&self) -> impl Iterator<Item = [Point2; 2]> + '_ {
        let back = self
            .closed
            .then(|| [self.points[self.points.len() - 1], self.points[0]]);
        self.points
            .windows(2)
            .map(|pair| [pair[0], pair[1]])
            .chain(back)
    }
}

/// The lines of a drawing. `name` is used if it has none.
pub(super) fn of_drawing(
    mut drawing: Drawing,
    name: &str,
    options: &ReadOptions,
) -> Result<CentreLines, Refusal> {
    scale_and_check(&mut drawing, options.scale)?;
    let mut notes = std::mem::take(&mut drawing.notes);
    let shapes = drawing.shapes.into_iter();
    let mut drawn: Vec<RawRing> = shapes.flat_map(|shape| shape.rings).collect();
    drawn.iter_mut().for_each(|ring| ring.points.dedup());
    let mut lines = Vec::new();
    for mut ring in contours(drawn, 1.0, true, &mut notes)? {
        let first = ring.points.first().copied().unwrap_or_default();
        let meets = |end: &Point2| (end - first).norm() <= CLOSED_MM;
        let closed = ring.closed || ring.points.len() > 3 && ring.points.last().is_some_and(meets);
        ring.points.dedup();
        while closed && ring.points.len() > 1 && ring.points.last().is_some_and(meets) {
            ring.points.pop();
        }
        let points = ring.points;
        lines.extend((points.len() > 1).then_some(CentreLine { points, closed }));
    }
    if lines.is_empty() {
        let hint = "its lines have no length";
        return Err(error::empty(hint));
    }
    Ok(CentreLines {
        name: name_of(drawing.name.as_deref(), name, "part"),
        lines,
        notes,
    })
}
