//! Keeping the aperture inside the walls: signed distance of each pose to each edge near it.
//!
//! In: knots and walls. Out: value, gradient and curvature of a penalty on what comes nearer to a wall than a margin.
//! The distance is exact where the wall touches the aperture and of first order elsewhere. Edges near a span are
//! kept until it has moved.

use super::band::{PoseTerm, System};
use super::cells::Segment;
use super::curve::{Basis, Knot, PassKnots, Units, blend};
use super::terms::Terms;
use crate::geometry::edge_index::EdgeIndex;
use crate::geometry::polygon::Box2;

/// How far a span may move before the edges near it are sought again, in a, and the share of that at which they are.
const REACH: f64 = 0.25;
const REACH_USED: f64 = 0.9;
/// Squared scaled distance beyond which an edge cannot cost anything.
const NEAR2: f64 = 1.1;
/// The margin must stay below what [`NEAR2`] spares; and slack across the aperture for the sharper end of it.
const ACROSS: f64 = 1.5;

/// Distance of a wall beyond the aperture, in a, and its derivative by x, y and heading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clearance {
    /// Negative where the wall cuts.
    pub distance: f64,
    /// By the pose.
    pub by_pose: [f64; 3],
}

/// A pose with cosine and sine of its heading.
#[derive(Clone, Copy, Debug)]
pub struct Placed {
    center: [f64; 2],
    cos: f64,
    sin: f64,
}

impl Placed {
    /// At these values of the spline.
    pub fn at(knot: &Knot) -> Placed {
        let (sin, cos) = knot[2].sin_cos();
        Placed {
            center: [knot[0], knot[1]],
            cos,
            sin,
        }
    }

    /// A point in the frame in which the ellipse with these semi-axes is the unit circle.
    #[inline]
    fn scaled(&self, [a, b]: [f64; 2], point: &[f64; 2]) -> [f64; 2] {
        let (x, y) = (point[0] - self.center[0], point[1] - self.center[1]);
        [
            (self.cos * x + self.sin * y) / a,
            (self.cos * y - self.sin * x) / b,
        ]
    }

    /// The point of a segment nearest to the centre in the scaled frame, and its squared distance.
    #[inline]
    fn nearest(&self, axes: [f64; 2], segment: &Segment) -> ([f64; 2], f64) {
        let [x0, y0] = self.scaled(axes, &segment[0]);
        let [x1, y1] = self.scaled(axes, &segment[1]);
        let (dx, dy) = (x1 - x0, y1 - y0);
        let t = (-(x0 * dx + y0 * dy) / (dx * dx + dy * dy + 1e-30)).clamp(0.0, 1.0);
        let (x, y) = (x0 + t * dx, y0 + t * dy);
        ([x, y], x * x + y * y)
    }

    /// Clearance of the ellipse with semi-axes 1 and `minor` from a segment; `None` where it is far.
    #[inline]
    pub fn clearance(&self, minor: f64, segment: &Segment) -> Option<Clearance> {
        let ([x, y], distance2) = self.nearest([1.0, minor], segment);
        if distance2.is_nan() || distance2 > NEAR2 {
            return None;
        }
        let scaled = distance2.sqrt().max(1e-3);
        let by_x = (self.cos * x - self.sin * y / minor) / scaled;
        let by_y = (self.sin * x + self.cos * y / minor) / scaled;
        let by_heading = -x * y * (minor - 1.0 / minor) / scaled;
        let rate = (by_x * by_x + by_y * by_y).sqrt();
        Some(Clearance {
            distance: (scaled - 1.0) / rate,
            by_pose: [-by_x / rate, -by_y / rate, -by_heading / rate],
        })
    }
}

/// Edges near one span, and where its knots were when they were sought.
#[derive(Clone, Debug, Default)]
struct Near {
    edges: Vec<u32>,
    sought_at: [[f64; 3]; 4],
}

/// The terms of containment.
#[derive(Clone, Debug)]
pub struct Containment<'a> {
    walls: &'a EdgeIndex,
    segments: Vec<Segment>,
    units: Units,
    minor: f64,
    places: Vec<Basis>,
    near: Vec<Near>,
    /// The search at which each edge was last met.
    met: Vec<u32>,
    search: u32,
}

/// How hard containment is.
#[derive(Clone, Copy, Debug)]
pub struct Wall {
    /// Price of the squared distance (a²) that a pose is nearer than the margin.
    pub weight: f64,
    /// Clearance that costs nothing, in a.
    pub margin: f64,
}

/// The walls in the optimiser's units.
pub fn segments_of(walls: &EdgeIndex, units: &Units) -> Vec<Segment> {
    let segment =
        |edge: &crate::geometry::edge_index::Edge| [edge.a, edge.b].map(|p| units.point(p));
    walls.edges().iter().map(segment).collect()
}

impl<'a> Containment<'a> {
    /// Of the ellipse with semi-axes 1 and `minor` within the walls, at so many places of each span.
    pub fn new(
        walls: &'a EdgeIndex,
        units: Units,
        minor: f64,
        knots: usize,
        places: usize,
    ) -> Containment<'a> {
        let segments = segments_of(walls, &units);
        let nowhere = Near {
            edges: Vec::new(),
            sought_at: [[f64::INFINITY; 3]; 4],
        };
        Containment {
            walls,
            met: vec![0; segments.len()],
            segments,
            units,
            minor,
            places: (0..places)
                .map(|s| Basis::at((s as f64 + 0.5) / places as f64))
                .collect(),
            near: vec![nowhere; knots],
            search: 0,
        }
    }

    /// Adds what comes nearer to a wall than the margin.
    pub fn add(
        &mut self,
        knots: &[Knot],
        passes: &[PassKnots],
        wall: &Wall,
        terms: &mut Terms,
        system: &mut System,
    ) {
        for pass in passes.iter().filter(|pass| pass.free) {
            for knot in pass.span_starts() {
                self.seek(&knots[knot..knot + 4], knot);
                if !self.near[knot].edges.is_empty() {
                    self.add_span(&knots[knot..knot + 4], knot, wall, terms, system);
                }
            }
        }
    }

    /// Seeks the edges near a span anew where it has moved too far since.
    fn seek(&mut self, knots: &[Knot], span: usize) {
        let near = &mut self.near[span];
        let mut moved = 0.0f64;
        for (knot, was) in knots.iter().zip(&near.sought_at) {
            let way = ((knot[0] - was[0]).powi(2) + (knot[1] - was[1]).powi(2)).sqrt();
            moved = moved.max(way + (knot[2] - was[2]).abs());
        }
        if moved <= REACH_USED * REACH {
            return;
        }
        for (knot, was) in knots.iter().zip(&mut near.sought_at) {
            *was = [knot[0], knot[1], knot[2]];
        }
        near.edges.clear();
        self.search = self.search.wrapping_add(1);
        let axes = [1.0 + REACH, self.minor + ACROSS * REACH];
        for basis in &self.places {
            let pose = Placed::at(&blend(&basis.value, knots));
            let [half_x, half_y] = [
                (axes[0] * pose.cos).hypot(axes[1] * pose.sin),
                (axes[0] * pose.sin).hypot(axes[1] * pose.cos),
            ];
            let [x, y] = pose.center;
            let area = Box2 {
                min: self.units.point_of(x - half_x, y - half_y),
                max: self.units.point_of(x + half_x, y + half_y),
            };
            self.walls.for_edges_in(area, |number| {
                let is_new = self.met[number] != self.search;
                if is_new && pose.nearest(axes, &self.segments[number]).1 <= 1.0 {
                    self.met[number] = self.search;
                    near.edges.push(number as u32);
                }
            });
        }
    }

    /// Adds the poses of one span.
    fn add_span(
        &self,
        knots: &[Knot],
        span: usize,
        wall: &Wall,
        terms: &mut Terms,
        system: &mut System,
    ) {
        for basis in &self.places {
            let pose = Placed::at(&blend(&basis.value, knots));
            let mut term = PoseTerm::default();
            let mut meets = false;
            for &number in &self.near[span].edges {
                let segment = &self.segments[number as usize];
                let Some(clear) = pose.clearance(self.minor, segment) else {
                    continue;
                };
                let short = wall.margin - clear.distance;
                if short <= 0.0 {
                    continue;
                }
                meets = true;
                terms.outside += 0.5 * wall.weight * short * short;
                term.add(-wall.weight * short, wall.weight, &clear.by_pose);
            }
            if meets {
                system.add_pose(span, &basis.value, &term);
            }
        }
    }
}
