//! F(p) for slots, rectangles and convex polygons: exact intervals of the heading angle.
//!
//! While the aperture touches the wall at p with one corner of its core, turning it is a rotation
//! of the core about a fixed point: the corner is at p + R N, whatever the angle. For each wall
//! near p the angles at which core and wall come exactly R apart have closed forms (a corner of the
//! core against the wall's line or end, a side of the core against the wall's end); between two of
//! them the answer cannot change, so one evaluation at the middle decides each interval. F(p) is
//! the intersection over all walls. Where a side is flat on the wall the aperture may also slide
//! along it: there the free positions are found instead, again in closed form.
//!
//! In: the shape, the edges near p in the frame of the normal (x along N, y along the tangent).
//! Out: intervals of alpha (the angle from N to tool X), and the flats. Exact but for rounding and
//! [`SLACK_MM`]; an interval below 1e-12 rad is dropped. Source: docs/design/heading-law.md; the method is ours.

use crate::geometry::Vector2;
use crate::geometry::aperture::wrapped_rad;
use crate::geometry::rounded_polygon::RoundedPolygon;
use crate::plan::feasible::LocalEdge;
use std::f64::consts::TAU;

/// A cut this deep is contact: rounding, on parts of metres.
const SLACK_MM: f64 = 1e-9;
/// Angles closer than this are one, rad.
const SAME_RAD: f64 = 1e-12;

/// Edges checked first, by their distance relative to the reach of the core.
const NEAR_SHARE: f64 = 0.1;
/// Edges between two tests for remaining free angles.
const EDGES_BETWEEN: usize = 16;

/// A side that may be flat on the wall.
#[derive(Clone, Debug, PartialEq)]
pub struct Flat {
    /// The heading angle.
    pub alpha_rad: f64,
    /// The centre, in the frame of the normal from p, with the side's first corner above p.
    center: Vector2,
    /// How far the aperture may be moved along the tangent, in [0, length of the side].
    slides_mm: Vec<[f64; 2]>,
    length_mm: f64,
}

impl Flat {
    /// The centre from p, in the frame of the normal, the side's middle as near to p as is free.
    pub fn center_from_contact(&self) -> Vector2 {
        let wanted = self.length_mm / 2.0;
        let near = |s: &[f64; 2]| wanted.clamp(s[0], s[1]);
        let off = |slide: &f64| (slide - wanted).abs();
        let slides = self.slides_mm.iter().map(near);
        let slide = slides.min_by(|a, b| off(a).total_cmp(&off(b)));
        self.center + Vector2::new(0.0, slide.unwrap_or(wanted))
    }
}

fn turned(v: Vector2, angle_rad: f64) -> Vector2 {
    let (sin, cos) = angle_rad.sin_cos();
    Vector2::new(v.x * cos - v.y * sin, v.x * sin + v.y * cos)
}

/// Feasible intervals in [-period/2, period/2], ascending and joined, and the flats among them.
pub fn polygon_angles(
    shape: &RoundedPolygon,
    period_rad: f64,
    edges: &[LocalEdge],
) -> (Vec<[f64; 2]>, Vec<Flat>) {
    let pivot = Vector2::new(shape.radius_mm(), 0.0);
    let about_pivot: Vec<LocalEdge> = edges.iter().map(|e| e.map(|q| q - pivot)).collect();
    let sides: Vec<Vector2> = shape.sides().map(|(normal, _)| normal).collect();
    let count = sides.len();
    let used = if shape.is_symmetric() {
        count / 2
    } else {
        count
    };
    let (mut runs, mut flats) = (Vec::new(), Vec::new());
    for corner in 0..used {
        // The wall is towards -N: side i lies on it at pi minus its normal's angle, and its first
        // corner is the contact from there on, until the side before comes to lie.
        let (here, before) = (sides[corner], sides[(corner + count - 1) % count]);
        let low = wrapped_rad(std::f64::consts::PI - here.y.atan2(here.x), TAU);
        let turn = before.perp(&here).atan2(before.dot(&here)).abs();
        let blocked = blocked_angles(shape, corner, [low, low + turn], &about_pivot);
        runs.extend(left_free([low, low + turn], blocked, SAME_RAD));
        if let Some(flat) = flat(shape, corner, low, &about_pivot) {
            runs.push([low, low]);
            flats.push(flat);
        }
    }
    (joined(runs, period_rad), flats)
}

/// Angles within `range` at which some edge cuts the core while it turns on its corner.
fn blocked_angles(
    shape: &RoundedPolygon,
    corner: usize,
    range: [f64; 2],
    edges: &[LocalEdge],
) -> Vec<[f64; 2]> {
    let at = shape.corners()[corner];
    let far = shape.corners().iter().map(|c| (c - at).norm());
    let reach = far.fold(0.0, f64::max) + shape.radius_mm();
    let mut blocked = Vec::new();
    let mut critical = Vec::new();
    let nearest_mm = |[a, b]: &LocalEdge| foot_from_origin(*a, *b).norm();
    let (near, far): (Vec<LocalEdge>, Vec<LocalEdge>) = edges
        .iter()
        .filter(|edge| nearest_mm(edge) <= reach)
        .partition(|edge| nearest_mm(edge) <= NEAR_SHARE * reach);
    for (number, [a, b]) in near.into_iter().chain(far).enumerate() {
        // In a notch of a noisy wall its own edges leave nothing free: the others need not be
        // checked.
        if number % EDGES_BETWEEN == EDGES_BETWEEN - 1
            && left_free(range, blocked.clone(), SAME_RAD).is_empty()
        {
            break;
        }
        critical.clear();
        critical_angles(shape, at, a, b, |angle| {
            let image = range[0] + (angle - range[0]).rem_euclid(TAU);
            if image < range[1] {
                critical.push(image);
            }
        });
        critical.extend(range);
        critical.sort_by(f64::total_cmp);
        for pair in critical.windows(2) {
            if pair[1] - pair[0] < SAME_RAD {
                continue;
            }
            let middle = (pair[0] + pair[1]) / 2.0;
            let [a, b] = [a, b].map(|q| turned(q, -middle) + at);
            if shape
                .gap_to(a, b, 0.0)
                .is_some_and(|g| g.gap_mm < -SLACK_MM)
            {
                blocked.push([pair[0], pair[1]]);
            }
        }
    }
    blocked
}

/// Every angle at which the distance of core (turning about `at`, which is the origin of the edge's
/// frame) and edge a-b is exactly the radius.
fn critical_angles(
    shape: &RoundedPolygon,
    at: Vector2,
    a: Vector2,
    b: Vector2,
    mut found: impl FnMut(f64),
) {
    let radius = shape.radius_mm();
    let angle_of = |v: Vector2| v.y.atan2(v.x);
    // cos(angle - middle) = share
    let mut around = |middle: f64, share: f64| {
        if share.abs() <= 1.0 {
            let half = share.acos();
            found(middle - half);
            found(middle + half);
        }
    };
    let along = b - a;
    let across = Vector2::new(-along.y, along.x).try_normalize(1e-300);
    let rounded = radius > 0.0;
    for &corner in shape.corners() {
        let arm = corner - at;
        let arm_mm = arm.norm();
        if arm_mm <= 0.0 {
            continue;
        }
        let arm_angle = angle_of(arm);
        if let Some(across) = across {
            let (middle, offset) = (angle_of(across) - arm_angle, across.dot(&a));
            around(middle, (offset + radius) / arm_mm);
            if rounded {
                around(middle, (offset - radius) / arm_mm);
            }
        }
        if rounded {
            for end in [a, b] {
                let end_mm = end.norm();
                let cosine = (arm_mm * arm_mm + end_mm * end_mm - radius * radius)
                    / (2.0 * arm_mm * end_mm.max(1e-300));
                around(angle_of(end) - arm_angle, cosine);
            }
        }
    }
    for (normal, corner) in shape.sides() {
        let offset = normal.dot(&(shape.corners()[corner] - at)) + radius;
        for end in [a, b] {
            around(
                angle_of(end) - angle_of(normal),
                offset / end.norm().max(1e-300),
            );
        }
    }
}

/// The side that begins at `corner` flat on the wall, where some position of it is free.
fn flat(
    shape: &RoundedPolygon,
    corner: usize,
    alpha_rad: f64,
    edges: &[LocalEdge],
) -> Option<Flat> {
    let corners = shape.corners();
    let at = corners[corner];
    let length_mm = (corners[(corner + 1) % corners.len()] - at).norm();
    let core: Vec<Vector2> = corners.iter().map(|c| turned(c - at, alpha_rad)).collect();
    let mut blocked = Vec::new();
    for &[a, b] in edges {
        let Some([low, high]) = sliding_range(&core, shape.radius_mm(), a, b) else {
            continue;
        };
        if high <= 0.0 || low >= length_mm {
            continue;
        }
        let middle = Vector2::new(0.0, (low + high) / 2.0);
        let [a, b] = [a, b].map(|q| turned(q - middle, -alpha_rad) + at);
        if shape
            .gap_to(a, b, 0.0)
            .is_some_and(|g| g.gap_mm < -SLACK_MM)
        {
            blocked.push([low, high]);
        }
    }
    let slides_mm = left_free([0.0, length_mm], blocked, -SLACK_MM);
    (!slides_mm.is_empty()).then(|| Flat {
        alpha_rad,
        center: Vector2::new(shape.radius_mm(), 0.0) - turned(at, alpha_rad),
        slides_mm,
        length_mm,
    })
}

/// Moves of the core along y at which it is within `radius` of the edge a-b: the y axis cut with
/// the Minkowski sum of edge, mirrored core and disk. Every part of that sum's outline is among the
/// disks and parallel lines evaluated here, and all of them are in it.
fn sliding_range(core: &[Vector2], radius: f64, a: Vector2, b: Vector2) -> Option<[f64; 2]> {
    let mut range = [f64::INFINITY, f64::NEG_INFINITY];
    let mut take = |y: f64| range = [range[0].min(y), range[1].max(y)];
    let mut line = |from: Vector2, to: Vector2| {
        let side = to - from;
        let length = side.norm();
        if length <= 0.0 {
            return;
        }
        let out = Vector2::new(side.y, -side.x) * (radius / length);
        for shift in [out, -out] {
            let (from, to) = (from + shift, to + shift);
            if (from.x <= 0.0) != (to.x <= 0.0) {
                take(from.y + (to.y - from.y) * from.x / (from.x - to.x));
            }
        }
    };
    for (i, &corner) in core.iter().enumerate() {
        let next = core[(i + 1) % core.len()];
        line(a - corner, b - corner);
        for end in [a, b] {
            line(end - corner, end - next);
        }
    }
    for corner in core {
        for end in [a, b] {
            let q = end - corner;
            let under_root = radius * radius - q.x * q.x;
            if under_root >= 0.0 {
                take(q.y - under_root.sqrt());
                take(q.y + under_root.sqrt());
            }
        }
    }
    (range[0] < range[1]).then_some(range)
}

/// What the blocked stretches leave of `range`, each longer than `least` (a negative one keeps
/// places where two blocked stretches only meet).
fn left_free(range: [f64; 2], mut blocked: Vec<[f64; 2]>, least: f64) -> Vec<[f64; 2]> {
    blocked.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let mut free = Vec::new();
    let mut from = range[0];
    for [low, high] in blocked {
        if low - from > least {
            free.push([from, low.max(from)]);
        }
        from = from.max(high);
    }
    if range[1] - from > least {
        free.push([from, range[1].max(from)]);
    }
    free
}

/// Intervals brought into [-period/2, period/2], cut there, sorted and joined.
fn joined(runs: Vec<[f64; 2]>, period_rad: f64) -> Vec<[f64; 2]> {
    let half = period_rad / 2.0;
    let mut pieces: Vec<[f64; 2]> = Vec::with_capacity(runs.len() + 1);
    for [low, high] in runs {
        let start = low - period_rad * ((low + half) / period_rad).floor();
        let end = start + (high - low);
        if end > half {
            pieces.push([start, half]);
            pieces.push([-half, end - period_rad]);
        } else {
            pieces.push([start, end]);
        }
    }
    pieces.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let mut result: Vec<[f64; 2]> = Vec::with_capacity(pieces.len());
    for [low, high] in pieces {
        match result.last_mut() {
            Some(last) if low - last[1] <= SAME_RAD => last[1] = last[1].max(high),
            _ => result.push([low, high]),
        }
    }
    result
}

/// The point of a-b nearest to the origin.
fn foot_from_origin(a: Vector2, b: Vector2) -> Vector2 {
    let along = b - a;
    let length2 = along.norm_squared();
    if length2 <= 0.0 {
        return a;
    }
    a + along * (-a.dot(&along) / length2).clamp(0.0, 1.0)
}

#[cfg(test)]
#[path = "polygon_tests.rs"]
mod tests;
