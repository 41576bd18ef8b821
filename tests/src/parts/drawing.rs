//! What parts are drawn with: rings of points, joined and cut.

use headway::geometry::Point2;
use headway::geometry::boolean::{difference, filled};
use headway::geometry::polygon::{Region, Ring};
use headway::geometry::repair::FillRule;
use std::f64::consts::{PI, TAU};

pub(super) type Pair = [f64; 2];
pub(super) type Outline = Vec<Pair>;

/// How far a chord of a drawn arc leaves it, mm: what CAD programs export with.
const SAG_MM: f64 = 0.01;

/// The ground of all outlines together, less that of all cuts.
pub(super) fn cut(outlines: &[Outline], cuts: &[Outline]) -> Vec<Region> {
    difference(&joined(outlines), &joined(cuts))
}

/// The ground of all outlines together.
pub(super) fn joined(outlines: &[Outline]) -> Vec<Region> {
    let rings: Vec<Ring> = outlines.iter().map(ring).collect();
    filled(rings.iter(), FillRule::NonZero)
}

fn ring(outline: &Outline) -> Ring {
    let points = outline.iter().map(|p| Point2::from(*p)).collect();
    let mut ring = Ring { points };
    if ring.signed_area_mm2() < 0.0 {
        ring.points.reverse();
    }
    ring
}

/// At a distance and an angle from a point.
pub(super) fn polar(center: Pair, radius: f64, angle: f64) -> Pair {
    [
        center[0] + radius * angle.cos(),
        center[1] + radius * angle.sin(),
    ]
}

/// Points of an arc, both ends included.
pub(super) fn arc(center: Pair, radius: f64, from: f64, to: f64) -> Outline {
    let step = 2.0 * (1.0 - SAG_MM / radius.max(2.0 * SAG_MM)).acos();
    let count = ((to - from).abs() / step).ceil().max(2.0) as usize;
    let angle = |i: usize| from + (to - from) * i as f64 / count as f64;
    (0..=count)
        .map(|i| polar(center, radius, angle(i)))
        .collect()
}

/// A full circle.
pub(super) fn circle(center: Pair, radius: f64) -> Outline {
    let mut points = arc(center, radius, 0.0, TAU);
    points.pop();
    points
}

/// Corners all round, the first at `turn`.
pub(super) fn regular(center: Pair, radius: f64, count: usize, turn: f64) -> Outline {
    (0..count)
        .map(|i| polar(center, radius, turn + TAU * i as f64 / count as f64))
        .collect()
}

/// A rectangle between two opposite corners.
pub(super) fn rectangle(low: Pair, high: Pair) -> Outline {
    vec![low, [high[0], low[1]], high, [low[0], high[1]]]
}

/// A rectangle with rounded corners.
pub(super) fn rounded_rectangle(low: Pair, high: Pair, radius: f64) -> Outline {
    let (l, h, r) = (low, high, radius);
    let corners = [
        ([h[0] - r, h[1] - r], 0.0),
        ([l[0] + r, h[1] - r], 0.5 * PI),
        ([l[0] + r, l[1] + r], PI),
        ([h[0] - r, l[1] + r], 1.5 * PI),
    ];
    let arcs = corners.map(|(center, from)| arc(center, r, from, from + 0.5 * PI));
    arcs.concat()
}

/// A bar with square ends along a line.
pub(super) fn bar(p: Pair, q: Pair, width: f64) -> Outline {
    wedge(p, q, width, width)
}

/// A bar whose ends are not equally wide.
pub(super) fn wedge(p: Pair, q: Pair, width_p: f64, width_q: f64) -> Outline {
    let length = (q[0] - p[0]).hypot(q[1] - p[1]);
    let across = [-(q[1] - p[1]) / length, (q[0] - p[0]) / length];
    let side = |at: Pair, by: f64| [at[0] + by * across[0], at[1] + by * across[1]];
    vec![
        side(p, -0.5 * width_p),
        side(q, -0.5 * width_q),
        side(q, 0.5 * width_q),
        side(p, 0.5 * width_p),
    ]
}

/// A bar with round ends.
pub(super) fn slot(p: Pair, q: Pair, width: f64) -> Outline {
    let along = (q[1] - p[1]).atan2(q[0] - p[0]);
    let mut points = arc(q, 0.5 * width, along - 0.5 * PI, along + 0.5 * PI);
    points.extend(arc(p, 0.5 * width, along + 0.5 * PI, along + 1.5 * PI));
    points
}

/// Slots along a run of points.
pub(super) fn stroke(points: &[Pair], width: f64) -> Vec<Outline> {
    let pieces = points.windows(2);
    pieces.map(|w| slot(w[0], w[1], width)).collect()
}

/// A closed band between two runs of points that go the same way.
pub(super) fn band(left: Outline, right: Outline) -> Outline {
    let mut points = left;
    points.extend(right.into_iter().rev());
    points
}
