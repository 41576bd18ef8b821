//! Keeping the aperture inside the walls: signed distance of each pose to each edge near it.
//!
//! In: knots and walls. Out: value, gradient and curvature of a penalty on poses nearer to a wall than a margin. The
//! distance is exact where the wall touches the aperture and of first order elsewhere. Edges near a span are kept
//! until it has moved.

use super::Site;
use super::band::{PoseTerm, System};
use super::curve::{At, Basis, Knot, Units, all_stay, blend};
use super::pose_lanes::{LANES, Lanes};
use super::sweep::Segment;
use super::terms::Terms;
use super::tool_scale::{ToolScale, Tooled};
use headway_geometry::aperture::{Aperture, Turn};
use headway_geometry::edge_index::{Edge, EdgeIndex};
use headway_geometry::polygon::Box2;
use headway_geometry::rounded_polygon::RoundedPolygon;
use headway_geometry::{Point2, Vector2};
use std::ops::Range;

/// How far a span may move before the edges near it are sought again, in a, and the share of that at which they are.
const REACH: f64 = 0.25;
const REACH_USED: f64 = 0.9;
/// Squared scaled distance beyond which an edge cannot cost anything.
const NEAR2: f64 = 1.1;
/// Gap beyond which an edge cannot cost anything to a polygon, in a.
const NEAR: f64 = 0.05;
/// A wall that rises by less than this share of its length is across a direction.
const LEVEL: f64 = 1e-6;
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
    /// The tool there.
    pub tool: Tooled,
    /// Of the heading.
    pub cos: f64,
    /// See `cos`.
    pub sin: f64,
}

impl Placed {
    /// At these values of the spline.
    pub fn at(knot: &Knot, scale: &ToolScale) -> Placed {
        let (sin, cos) = knot[2].sin_cos();
        Placed {
            tool: scale.at(knot),
            cos,
            sin,
        }
    }

    /// What the tool reaches farther towards a direction of its frame than its scaled, shifted shape that touches
    /// there with the point `support`, both of its own size in a; in a of the plane.
    fn beyond(&self, support: [f64; 2], outward: [f64; 2], length_mm: f64) -> f64 {
        let Some((here, shift_mm)) = &self.tool.place else {
            return 0.0;
        };
        let out = |[x, y]: [f64; 2]| {
            Vector2::new(self.cos * x - self.sin * y, self.sin * x + self.cos * y)
        };
        let support_mm = self.tool.size * length_mm * out(support);
        here.beyond_mm(*shift_mm, support_mm, out(outward)) / length_mm
    }

    /// A point in the frame in which the ellipse with these semi-axes is the unit circle.
    #[inline]
    fn scaled(&self, [a, b]: [f64; 2], point: &[f64; 2]) -> [f64; 2] {
        let [own_x, own_y] = self.tool.center;
        let (x, y) = (point[0] - own_x, point[1] - own_y);
        [
            (self.cos * x + self.sin * y) / a * self.tool.inverse,
            (self.cos * y - self.sin * x) / b * self.tool.inverse,
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

    /// Clearance of the ellipse with semi-axes 1 and `minor` from a segment; `None` if it is far.
    #[inline]
    pub fn clearance(&self, minor: f64, length_mm: f64, segment: &Segment) -> Option<Clearance> {
        let ([x, y], distance2) = self.nearest([1.0, minor], segment);
        if distance2.is_nan() || distance2 > NEAR2 {
            return None;
        }
        let scaled = distance2.sqrt().max(1e-3);
        let by_x = (self.cos * x - self.sin * y / minor) / scaled;
        let by_y = (self.sin * x + self.cos * y / minor) / scaled;
        let by_heading = -x * y * (minor - 1.0 / minor) / scaled;
        let rate = (by_x * by_x + by_y * by_y).sqrt();
        let size = self.tool.size;
        let mut distance = size * ((scaled - 1.0) / rate);
        if self.tool.place.is_some() {
            // The wall's point, drawn in to the outline, is where it would touch.
            let support = [x / scaled, minor * y / scaled];
            let outward = [x / scaled / rate, y / minor / scaled / rate];
            distance -= self.beyond(support, outward, length_mm);
        }
        Some(Clearance {
            distance,
            by_pose: [-by_x / rate, -by_y / rate, size * (-by_heading / rate)],
        })
    }

    /// A point in the tool's frame, mm.
    fn local_mm(&self, point: &[f64; 2], length_mm: f64) -> Vector2 {
        let [x, y] = self.scaled([1.0, 1.0], point);
        Vector2::new(x * length_mm, y * length_mm)
    }

    /// Clearance of a polygon with rounded corners, mm, from a segment; `None` if it is far.
    fn clearance_of_polygon(
        &self,
        shape: &RoundedPolygon,
        length_mm: f64,
        segment: &Segment,
    ) -> Option<Clearance> {
        let [p, q] = segment.map(|point| self.local_mm(&point, length_mm));
        let gap = shape.gap_to(p, q, NEAR * length_mm)?;
        let (low, high) = (gap.outward.dot(&p), gap.outward.dot(&q));
        // A wall across the direction meets the farthest corner; else an end of the wall meets a side.
        let touched = if (low - high).abs() <= LEVEL * (q - p).norm() {
            shape.support_point(gap.outward)
        } else if low < high {
            p - gap.outward * gap.gap_mm
        } else {
            q - gap.outward * gap.gap_mm
        };
        let (x, y) = (gap.outward.x, gap.outward.y);
        let by_x = self.cos * x - self.sin * y;
        let by_y = self.sin * x + self.cos * y;
        let by_heading = (touched.x * y - touched.y * x) / length_mm;
        let size = self.tool.size;
        let mut distance = size * (gap.gap_mm / length_mm);
        if self.tool.place.is_some() {
            let support = [touched.x / length_mm, touched.y / length_mm];
            distance -= self.beyond(support, [x, y], length_mm);
        }
        Some(Clearance {
            distance,
            by_pose: [-by_x, -by_y, size * -by_heading],
        })
    }
}

/// The aperture and the unit of length.
#[derive(Clone, Copy, Debug)]
struct Tool<'a> {
    aperture: &'a Aperture,
    length_mm: f64,
}

impl Tool<'_> {
    /// The box of the aperture at a pose, grown by the distance that a span may move before edges are
    /// searched again, mm.
    fn area(self, pose: &Placed, heading_rad: f64, units: &Units) -> Box2 {
        let turn = Turn {
            heading_rad,
            sin: pose.sin,
            cos: pose.cos,
        };
        let reach_mm = |x: f64, y: f64| {
            let support_mm = self.aperture.support_mm(turn, Vector2::new(x, y));
            pose.tool.size * support_mm + ACROSS * REACH * self.length_mm
        };
        let [x, y] = pose.tool.center;
        let center = units.point_of(x, y);
        Box2 {
            min: center - Vector2::new(reach_mm(-1.0, 0.0), reach_mm(0.0, -1.0)),
            max: center + Vector2::new(reach_mm(1.0, 0.0), reach_mm(0.0, 1.0)),
        }
    }

    /// Whether a pose may meet a segment before the edges near it are sought again.
    fn is_near(self, pose: &Placed, segment: &Segment) -> bool {
        match self.aperture {
            Aperture::Ellipse { major_mm, minor_mm } => {
                let axes = [1.0 + REACH, minor_mm / major_mm + ACROSS * REACH];
                pose.nearest(axes, segment).1 <= 1.0
            }
            Aperture::Rounded(shape) => {
                let length_mm = self.length_mm;
                let [p, q] = segment.map(|point| pose.local_mm(&point, length_mm));
                shape.gap_to(p, q, ACROSS * REACH * length_mm).is_some()
            }
        }
    }

    /// Squared scaled distance beyond which a wall is farther than the margin from any pose, by [`Lanes::distances2`]; for a
    /// polygon all are tested one by one. A distance of 1 + d is at most d off the outline across the ellipse.
    fn reach2(self, margin: f64, is_flat: bool) -> f64 {
        match self.aperture {
            Aperture::Ellipse { major_mm, minor_mm } if is_flat => {
                NEAR2.min((1.0 + margin * major_mm / minor_mm).powi(2) * (1.0 + LEVEL))
            }
            Aperture::Ellipse { .. } => NEAR2 * (1.0 + LEVEL),
            Aperture::Rounded(_) => f64::INFINITY,
        }
    }

    /// Clearance of the aperture at a pose from a segment; `None` if it is far.
    #[inline]
    fn clearance(self, pose: &Placed, segment: &Segment) -> Option<Clearance> {
        match self.aperture {
            Aperture::Ellipse { major_mm, minor_mm } => {
                pose.clearance(minor_mm / major_mm, self.length_mm, segment)
            }
            Aperture::Rounded(shape) => pose.clearance_of_polygon(shape, self.length_mm, segment),
        }
    }
}

/// Edges near one span, and where its knots were when they were sought.
#[derive(Clone, Debug)]
struct Near {
    edges: Vec<u32>,
    sought_at: [[f64; 3]; 4],
}

impl Near {
    /// Not sought yet.
    fn not_sought() -> Near {
        Near {
            edges: Vec::new(),
            sought_at: [[f64::INFINITY; 3]; 4],
        }
    }
}

/// The terms of containment.
#[derive(Clone, Debug)]
pub struct Containment<'a> {
    walls: &'a EdgeIndex,
    segments: Vec<Segment>,
    units: Units,
    scale: ToolScale<'a>,
    tool: Tool<'a>,
    places: Vec<Basis>,
    /// Of a pass's first pose and its last.
    ends: [Basis; 2],
    near: Vec<Near>,
    /// The search at which each edge was last met.
    met: Vec<u32>,
    search: u32,
    /// Poses nearer to a wall than the margin, of the last measurement.
    short: Vec<Short>,
    /// Poses of one span, and for each edge near it those that may meet it, a bit for each.
    poses: Vec<Placed>,
    lanes: Lanes,
    masks: Vec<u32>,
}

/// A pose nearer to a wall than the margin.
#[derive(Clone, Copy, Debug)]
struct Short {
    /// First knot of its span.
    knot: usize,
    /// Its place on the span.
    place: usize,
    term: PoseTerm,
}

/// How hard containment is.
#[derive(Clone, Copy, Debug)]
pub struct Wall {
    /// Price of the squared distance (a²) by which a pose is nearer than the margin.
    pub weight: f64,
    /// Clearance that costs nothing, in a.
    pub margin: f64,
}

/// Edges in the optimiser's units.
pub fn segments_of(edges: impl Iterator<Item = (Point2, Point2)>, units: &Units) -> Vec<Segment> {
    edges
        .map(|(from, to)| [units.point(from), units.point(to)])
        .collect()
}

impl<'a> Containment<'a> {
    /// Clearances of the aperture within the walls of a site, at this many places of each span.
    pub fn new(site: &Site<'a>, units: Units, knots: usize, places: usize) -> Containment<'a> {
        let (walls, aperture) = (site.walls, site.aperture);
        let segments = segments_of(walls.edges().iter().map(Edge::ends), &units);
        Containment {
            walls,
            met: vec![0; segments.len()],
            segments,
            units,
            scale: ToolScale::new(site.scale, units),
            tool: Tool {
                aperture,
                length_mm: units.length_mm,
            },
            places: (0..places)
                .map(|s| Basis::at((s as f64 + 0.5) / places as f64))
                .collect(),
            ends: [0.0, 1.0].map(Basis::at),
            near: vec![Near::not_sought(); knots],
            search: 0,
            short: Vec::new(),
            poses: Vec::new(),
            lanes: Lanes::default(),
            masks: Vec::new(),
        }
    }

    /// Forgets the edges near spans: the knots are others now.
    pub fn forget(&mut self, knots: usize) {
        self.near = vec![Near::not_sought(); knots];
    }

    /// Adds the penalty of poses nearer to a wall than the margin, except for spans whose knots all stay.
    pub fn add(&mut self, at: &At, wall: &Wall, terms: &mut Terms, system: &mut System) {
        terms.outside += self.measure(at, wall);
        self.add_measured(system);
    }

    /// The penalty; what it adds to a system is kept for [`Containment::add_measured`].
    pub fn measure(&mut self, at: &At, wall: &Wall) -> f64 {
        self.short.clear();
        let mut outside = 0.0;
        for pass in at.passes.iter().filter(|pass| pass.free) {
            let ends = [pass.first, pass.first + pass.spans - 1];
            for knot in pass.span_starts().filter(|&knot| !all_stay(at.stays, knot)) {
                let around = &at.knots[knot..knot + 4];
                self.seek(around, knot);
                if self.near[knot].edges.is_empty() {
                    continue;
                }
                let places = self.places.len();
                for first in (0..places).step_by(LANES) {
                    let end = places.min(first + LANES);
                    outside += self.measure_places(around, knot, first..end, wall);
                }
                for (end, _) in ends.iter().enumerate().filter(|(_, at)| **at == knot) {
                    let place = places + end;
                    outside += self.measure_places(around, knot, place..place + 1, wall);
                }
            }
        }
        outside
    }

    /// Adds slopes and curvatures of the penalty measured last.
    pub fn add_measured(&self, system: &mut System) {
        for short in &self.short {
            let basis = self.basis(short.place);
            system.add_pose(short.knot, &basis.value, &short.term);
        }
    }

    /// Whether a knot's centre is within the walls.
    pub fn holds(&self, knot: &Knot) -> bool {
        self.walls.contains(self.units.point_of(knot[0], knot[1]))
    }

    /// First knots of the spans that have a pose nearer to a wall than the margin, by the last measurement.
    pub fn short_spans(&self) -> impl Iterator<Item = usize> {
        self.short.iter().map(|short| short.knot)
    }

    /// A place of a span; those of a pass's ends come last.
    fn basis(&self, place: usize) -> &Basis {
        match place.checked_sub(self.places.len()) {
            None => &self.places[place],
            Some(end) => &self.ends[end],
        }
    }

    /// Searches the edges near a span again if it has moved too far since.
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
        let mut area: Option<Box2> = None;
        self.poses.clear();
        // Of places closer than those of the iterations some are enough: the reach is more than their distance.
        let places = self
            .places
            .iter()
            .step_by((self.places.len() / LANES).max(1));
        for basis in places.chain(&self.ends) {
            let at = blend(&basis.value, knots);
            let pose = Placed::at(&at, &self.scale);
            let own = self.tool.area(&pose, at[2], &self.units);
            area = Some(area.map_or(own, |area| Box2 {
                min: area.min.inf(&own.min),
                max: area.max.sup(&own.max),
            }));
            self.poses.push(pose);
        }
        let Some(area) = area else {
            return;
        };
        self.walls.for_edges_in(area, |number| {
            if self.met[number] == self.search {
                return;
            }
            self.met[number] = self.search;
            let segment = &self.segments[number];
            if self.walls.edges()[number].may_meet(&area)
                && self
                    .poses
                    .iter()
                    .any(|pose| self.tool.is_near(pose, segment))
            {
                near.edges.push(number as u32);
            }
        });
    }

    /// The penalty of at most [`LANES`] poses of a span.
    fn measure_places(
        &mut self,
        knots: &[Knot],
        knot: usize,
        places: Range<usize>,
        wall: &Wall,
    ) -> f64 {
        let minor = self.tool.aperture.minor_mm() / self.tool.aperture.major_mm();
        self.poses.clear();
        for (k, place) in places.clone().enumerate() {
            let at = blend(&self.basis(place).value, knots);
            let pose = Placed::at(&at, &self.scale);
            self.lanes.set(k, &pose, minor);
            self.poses.push(pose);
        }
        let is_flat = self.poses.iter().all(|pose| pose.tool.place.is_none());
        let reach2 = self.tool.reach2(wall.margin, is_flat);
        let mut met = 0;
        self.masks.clear();
        for &number in &self.near[knot].edges {
            let mut distances2 = [0.0; LANES];
            self.lanes
                .distances2(&self.segments[number as usize], &mut distances2);
            let mut mask = 0u32;
            for (k, distance2) in distances2.iter().enumerate() {
                mask |= u32::from(*distance2 <= reach2) << k;
            }
            met |= mask;
            self.masks.push(mask);
        }
        let mut outside = 0.0;
        for (k, place) in places.enumerate().filter(|(k, _)| met >> k & 1 == 1) {
            let mut term = PoseTerm::default();
            let mut meets = false;
            let edges = self.near[knot].edges.iter().zip(&self.masks);
            for (&number, _) in edges.filter(|(_, mask)| *mask >> k & 1 == 1) {
                let segment = &self.segments[number as usize];
                let Some(clear) = self.tool.clearance(&self.poses[k], segment) else {
                    continue;
                };
                let short = wall.margin - clear.distance;
                if short <= 0.0 {
                    continue;
                }
                meets = true;
                outside += 0.5 * wall.weight * short * short;
                term.add(-wall.weight * short, wall.weight, &clear.by_pose);
            }
            if meets {
                self.short.push(Short { knot, place, term });
            }
        }
        outside
    }
}
