//! F(p): the headings at which an aperture that touches the boundary at p stays inside the region.
//!
//! The aperture's contact at p with inward normal N fixes its centre for every heading angle alpha
//! (the angle from N to the major axis), so F(p) is a set of intervals of alpha, modulo 180°.
//!
//! For each edge, F is the factor by which the aperture, scaled about the contact p, would just
//! touch it: the edge is harmless where F >= 1. In the frame that makes the aperture a unit disk it
//! is the radius of a disk touching p and the edge, a closed form. ln F changes with alpha by at
//! most 3/2 (a/b - b/a) per radian, so one evaluation at its middle decides a complete interval
//! unless some edge is near contact there; only those are halved, down to [`RESOLUTION_RAD`].
//!
//! Accuracy: interval ends to `RESOLUTION_RAD`; a gap or an interval narrower than that may be
//! missed; an aperture that fits but for [`SLACK`] counts. No grid, no tolerance beyond these.
//! Source: docs/design/heading-law.md; the bound on ln F is ours (see `decide`).
//! Slots, rectangles and polygons have closed forms of their own: `feasible_polygon`.
//!
//! Why there are two engines for feasible headings: here the aperture touches the boundary at p exactly,
//! as the reachable area and the user's table of headings require. Only the outermost beads touch a wall,
//! and they may keep a distance where that costs less than turning; so `headings::profile` slides each
//! heading off the walls and prices the slide.
//!
//! In: aperture, an index of edges (mm), a boundary point and its inward unit normal. Out:
//! intervals of alpha, rad.

mod polygon;

use crate::geometry::aperture::{Aperture, wrapped_rad};
use crate::geometry::clearance::Configuration;
use crate::geometry::edge_index::EdgeIndex;
use crate::geometry::polygon::Box2;
use crate::geometry::tangent_disk::touching_radius;
use crate::geometry::{Point2, Vector2};
use crate::plan::feasible::polygon::{Flat, polygon_angles};
use std::f64::consts::{FRAC_PI_2, PI};

/// Accuracy of interval ends, rad.
pub const RESOLUTION_RAD: f64 = 1e-7;
/// An aperture that fits when scaled down by this share fits: rounding, under a nanometre.
pub const SLACK: f64 = 1e-9;
/// Edges that rise less than this above the tangent at p cannot be cut by more, mm.
const RISE_MIN_MM: f64 = 1e-9;
/// Pieces that the half turn is first divided into: coarse, since most are decided at once.
const PIECES: usize = 16;
/// Bound on the second derivative of 1 - 1/F near contact, in (a/b)²: four terms of at most that.
const BEND: f64 = 4.0;
/// Least slope that a stretch is tried with; below, halving continues first.
const BEND_MAX: f64 = 2.0;
/// Steps of the search for a place of contact: 60 halvings would do, few are needed.
const ROOT_STEPS_MAX: usize = 60;
/// An angle this close to that of a flat side has it on the wall, rad.
const ON_FLAT_RAD: f64 = 1e-9;
/// Most tests per query before the remaining intervals are decided by their middles: only an
/// aperture in contact over a whole range (a passage of exactly its width) comes near this number.
const LOOKS_MAX: usize = 50_000;

/// The feasible heading angles at a boundary point.
#[derive(Clone, Debug, PartialEq)]
pub struct FeasibleAngles {
    intervals: Vec<[f64; 2]>,
    /// Turn that brings the aperture onto itself.
    period_rad: f64,
    /// Angles at which a flat side is on the wall, with its free positions.
    flats: Vec<Flat>,
}

/// An edge near p: ends along (x) and across (y) the normal, from p.
pub type LocalEdge = [Vector2; 2];

/// F(p) at `p` for the inward unit normal `normal` (at a reflex vertex any one between the normals
/// of its two edges), as intervals of alpha.
pub fn feasible_angles(
    aperture: &Aperture,
    index: &EdgeIndex,
    p: Point2,
    normal: Vector2,
) -> FeasibleAngles {
    let edges = edges_near(index, p, normal, 2.0 * aperture.major_mm());
    let (major_mm, minor_mm) = match aperture {
        Aperture::Ellipse { major_mm, minor_mm } => (*major_mm, *minor_mm),
        Aperture::Rounded(shape) => {
            let (runs, flats) = polygon_angles(shape, aperture.period_rad(), &edges);
            return FeasibleAngles::of_runs(runs, aperture.period_rad(), flats);
        }
    };
    let mut search = IntervalSearch::new([major_mm, minor_mm], edges, false);
    search.run(aperture.is_round());
    FeasibleAngles::of_runs(search.runs, PI, Vec::new())
}

/// Whether any heading is feasible at `p`: F(p) is evaluated only as far as necessary.
pub fn is_touchable(aperture: &Aperture, index: &EdgeIndex, p: Point2, normal: Vector2) -> bool {
    let Aperture::Ellipse { major_mm, minor_mm } = aperture else {
        return !feasible_angles(aperture, index, p, normal).is_empty();
    };
    let is_free_of = |reach_mm: f64| {
        let edges = edges_near(index, p, normal, reach_mm);
        let mut search = IntervalSearch::new([*major_mm, *minor_mm], edges, true);
        search.run(aperture.is_round());
        !search.runs.is_empty()
    };
    // Among the teeth of a fine comb those next to p shut every heading out: none of the thousands
    // behind them need be checked.
    (!is_crowded(index, p, *minor_mm) || is_free_of(*minor_mm)) && is_free_of(2.0 * major_mm)
}

/// Number of edges near a point above which some of them are checked first.
const CROWD: usize = 200;

/// True if many edges are within `reach_mm`.
fn is_crowded(index: &EdgeIndex, p: Point2, reach_mm: f64) -> bool {
    let mut edges = 0;
    let area = Box2 { min: p, max: p }.grown(reach_mm);
    index.for_edges_in(area, |_| edges += 1);
    edges > CROWD
}

/// The configuration that touches `p` with heading angle `alpha_rad`: centre p + M N / h. With a
/// flat side on the wall, one of its ends is at `p`; [`FeasibleAngles::placement`] is more exact.
pub fn configuration_at(
    aperture: &Aperture,
    p: Point2,
    normal: Vector2,
    alpha_rad: f64,
) -> Configuration {
    let heading_rad = normal.y.atan2(normal.x) + alpha_rad;
    Configuration {
        center: p - aperture.support_point(heading_rad, -normal),
        heading_rad,
    }
}

/// Edges that the aperture could meet within a reach (its length for all of them) of p, not wholly
/// behind the tangent.
fn edges_near(index: &EdgeIndex, p: Point2, normal: Vector2, reach_mm: f64) -> Vec<LocalEdge> {
    let tangent = Vector2::new(-normal.y, normal.x);
    let local = |q: Point2| Vector2::new((q - p).dot(&normal), (q - p).dot(&tangent));
    let mut numbers = Vec::new();
    let area = Box2 { min: p, max: p }.grown(reach_mm);
    index.for_edges_in(area, |number| numbers.push(number));
    numbers.sort_unstable();
    numbers.dedup();
    numbers
        .into_iter()
        .filter(|&number| (index.edges()[number].foot(p) - p).norm() <= reach_mm)
        .map(|number| [index.edges()[number].a, index.edges()[number].b].map(local))
        .filter(|ends| ends[0].x.max(ends[1].x) > RISE_MIN_MM)
        .collect()
}

struct IntervalSearch {
    axes: [f64; 2],
    edges: Vec<LocalEdge>,
    /// Numbers of the edges still open, one stretch for each level of the halving.
    open: Vec<u32>,
    looks: usize,
    /// Any feasible run is enough.
    first_only: bool,
    /// Feasible runs in ascending order, joined where they meet.
    runs: Vec<[f64; 2]>,
}

/// The frame in which the aperture at one heading angle is a unit disk.
struct DiskFrame {
    along: Vector2,
    across: Vector2,
    normal: Vector2,
}

impl DiskFrame {
    fn new([a, b]: [f64; 2], alpha_rad: f64) -> DiskFrame {
        let (sin, cos) = alpha_rad.sin_cos();
        let extent = ((a * cos).powi(2) + (b * sin).powi(2)).sqrt();
        DiskFrame {
            along: Vector2::new(cos, sin) / a,
            across: Vector2::new(-sin, cos) / b,
            normal: Vector2::new(a * cos / extent, -b * sin / extent),
        }
    }

    /// F of the edge: how far the aperture may be scaled about p until it touches.
    fn touch_factor(&self, edge: &LocalEdge) -> f64 {
        let [from, to] = edge.map(|w| Vector2::new(self.along.dot(&w), self.across.dot(&w)));
        touching_radius(from, to, self.normal) * (1.0 + SLACK)
    }

    /// 1 - 1/F: of F's sign about contact, and finite everywhere.
    fn clear_share(&self, edge: &LocalEdge) -> f64 {
        1.0 - 1.0 / self.touch_factor(edge)
    }
}

impl IntervalSearch {
    /// Keeps the edges that can matter: at any angle the aperture is in the disk of its greatest
    /// radius of curvature that touches at p (Blaschke).
    fn new(axes: [f64; 2], mut edges: Vec<LocalEdge>, first_only: bool) -> IntervalSearch {
        let [a, b] = axes;
        let rolling_mm = a * a / b * (1.0 + SLACK);
        edges.retain(|[from, to]| touching_radius(*from, *to, Vector2::x()) < rolling_mm);
        IntervalSearch {
            axes,
            open: (0..edges.len() as u32).collect(),
            edges,
            looks: 0,
            first_only,
            runs: Vec::new(),
        }
    }

    /// Decides the half turn, or as much of it as the first feasible run takes.
    fn run(&mut self, is_round: bool) {
        if is_round {
            let frame = DiskFrame::new(self.axes, 0.0);
            let feasible = self.edges.iter().all(|e| frame.touch_factor(e) >= 1.0);
            self.add(-FRAC_PI_2, FRAC_PI_2, feasible);
            return;
        }
        let step = PI / PIECES as f64;
        for k in 0..PIECES {
            let low = -FRAC_PI_2 + k as f64 * step;
            self.decide(low, low + step, 0);
        }
    }

    /// Decides [low, high] against the edges of the open stretch from `first` on.
    ///
    /// For an obstacle point w, with u = diag(1/a, 1/b) R(-alpha) w and h the extent along N,
    /// F = h |u|² / (2 N·w). There d ln|u|² <= (a/b - b/a) dalpha and d ln h <= (a/b - b/a)/2
    /// dalpha, whatever w, so the least F over an edge has the same bound.
    fn decide(&mut self, low: f64, high: f64, first: usize) {
        if self.first_only && !self.runs.is_empty() {
            return;
        }
        let middle = (low + high) / 2.0;
        let [a, b] = self.axes;
        let change = (1.5 * (a / b - b / a) * (high - low) / 2.0).exp();
        let frame = DiskFrame::new(self.axes, middle);
        let last = self.open.len();
        let mut least = f64::INFINITY;
        self.looks += last - first;
        for k in first..last {
            let factor = frame.touch_factor(&self.edges[self.open[k] as usize]);
            least = least.min(factor);
            if factor * change < 1.0 {
                // What shut this stretch out will likely shut out the next.
                self.open.truncate(last);
                self.open.swap(first, k);
                return;
            }
            if factor < change {
                self.open.push(self.open[k]);
            }
        }
        if self.open.len() == last {
            self.add(low, high, true);
        } else if let Some([from, to]) = self.decided_by_roots([low, middle, high], last) {
            self.add(from, to, from <= to);
        } else if high - low <= RESOLUTION_RAD || self.looks > LOOKS_MAX {
            self.add(low, high, least >= 1.0);
        } else {
            self.decide(low, middle, last);
            self.decide(middle, high, last);
        }
        self.open.truncate(last);
    }

    /// The part of a narrow stretch that the open edges from `first` on leave free, where 1 - 1/F of
    /// each is monotone over it: then there is at most one place of contact an edge, found by
    /// regula falsi. `None` where some edge may turn back: its slope, as seen over the stretch, is
    /// not above what its second derivative (below [`BEND`] (a/b)²) could undo.
    fn decided_by_roots(&self, [low, middle, high]: [f64; 3], first: usize) -> Option<[f64; 2]> {
        let [a, b] = self.axes;
        let bend = BEND * (a / b).powi(2) * (high - low);
        if bend > BEND_MAX {
            return None;
        }
        let frames = [low, middle, high].map(|alpha| DiskFrame::new(self.axes, alpha));
        let mut free = [low, high];
        for &number in &self.open[first..] {
            let edge = &self.edges[number as usize];
            let [from, at, to] = [0, 1, 2].map(|k| frames[k].clear_share(edge));
            let slopes = [(at - from), (to - at)].map(|rise| rise / (middle - low));
            if slopes[0].abs().min(slopes[1].abs()) < bend || slopes[0] * slopes[1] <= 0.0 {
                return None;
            }
            match (from >= 0.0, to >= 0.0) {
                (true, true) => {}
                (false, false) => return Some([high, low]),
                (true, false) => free[1] = free[1].min(self.root(edge, [low, high], [from, to])),
                (false, true) => free[0] = free[0].max(self.root(edge, [low, high], [from, to])),
            }
        }
        Some(free)
    }

    /// The angle at which the edge comes into contact, between angles of opposite sign: regula
    /// falsi in the Illinois form; the end returned is the feasible one.
    fn root(&self, edge: &LocalEdge, mut at: [f64; 2], mut value: [f64; 2]) -> f64 {
        let feasible = usize::from(value[1] >= 0.0);
        let mut kept = 2;
        for _ in 0..ROOT_STEPS_MAX {
            if (at[1] - at[0]).abs() <= RESOLUTION_RAD / 4.0 {
                break;
            }
            let next = (at[0] * value[1] - at[1] * value[0]) / (value[1] - value[0]);
            let found = DiskFrame::new(self.axes, next).clear_share(edge);
            let side = usize::from((found >= 0.0) == (feasible == 1));
            let step = (next - at[side]).abs();
            (at[side], value[side]) = (next, found);
            if side == kept {
                value[1 - side] /= 2.0;
            }
            kept = side;
            if side == feasible && step <= RESOLUTION_RAD / 4.0 {
                break;
            }
        }
        at[feasible]
    }

    fn add(&mut self, low: f64, high: f64, feasible: bool) {
        if !feasible {
            return;
        }
        match self.runs.last_mut() {
            Some(run) if low - run[1] <= RESOLUTION_RAD / 4.0 => run[1] = high,
            _ => self.runs.push([low, high]),
        }
    }
}

impl FeasibleAngles {
    /// Joins the run that ends at half the period with the one that begins at minus that.
    fn of_runs(mut runs: Vec<[f64; 2]>, period_rad: f64, flats: Vec<Flat>) -> FeasibleAngles {
        let (end, half) = (RESOLUTION_RAD / 4.0, period_rad / 2.0);
        if runs.len() > 1 && runs[0][0] <= -half + end && runs[runs.len() - 1][1] >= half - end {
            let first = runs.remove(0);
            if let Some(last) = runs.last_mut() {
                last[1] = first[1] + period_rad;
            }
        }
        FeasibleAngles {
            intervals: runs,
            period_rad,
            flats,
        }
    }

    /// The configuration that touches `p` with a feasible heading angle. If a flat side is on the
    /// wall, its middle is as near to `p` as the walls permit.
    pub fn placement(
        &self,
        aperture: &Aperture,
        p: Point2,
        normal: Vector2,
        alpha_rad: f64,
    ) -> Configuration {
        let near = |flat: &&Flat| {
            wrapped_rad(alpha_rad - flat.alpha_rad, self.period_rad).abs() <= ON_FLAT_RAD
        };
        match self.flats.iter().find(near) {
            Some(flat) => {
                let center = flat.center_from_contact();
                let tangent = Vector2::new(-normal.y, normal.x);
                Configuration {
                    center: p + normal * center.x + tangent * center.y,
                    heading_rad: normal.y.atan2(normal.x) + alpha_rad,
                }
            }
            None => configuration_at(aperture, p, normal, alpha_rad),
        }
    }

    /// True where the point is unreachable.
    pub fn is_empty(&self) -> bool {
        self.intervals.is_empty()
    }

    /// The intervals, rad: starts ascending in [-period/2, period/2), an end beyond wraps round;
    /// the period is 180°, or 360° for a polygon without that symmetry.
    pub fn intervals(&self) -> &[[f64; 2]] {
        &self.intervals
    }

    /// The feasible angle nearest to `alpha_rad` modulo the period, in (-period/2, period/2]; `None`
    /// if empty. Ties go to the first interval.
    pub fn nearest_rad(&self, alpha_rad: f64) -> Option<f64> {
        let mut best: Option<(f64, f64)> = None;
        let period_rad = self.period_rad;
        for &[low, high] in &self.intervals {
            // The image of alpha in the period that starts at the interval's start.
            let image = low + (alpha_rad - low).rem_euclid(period_rad);
            let (found, off) = if image <= high {
                (alpha_rad, 0.0)
            } else if image - high <= low + period_rad - image {
                (high, image - high)
            } else {
                (low, low + period_rad - image)
            };
            if best.is_none_or(|(_, least)| off < least) {
                best = Some((found, off));
            }
        }
        best.map(|(found, _)| wrapped_rad(found, period_rad))
    }

    /// The smallest |alpha|; `None` if empty.
    pub fn min_abs_rad(&self) -> Option<f64> {
        self.nearest_rad(0.0).map(f64::abs)
    }

    /// True where `alpha_rad` is feasible, or within `slack_rad` of an angle that is.
    pub fn contains_rad(&self, alpha_rad: f64, slack_rad: f64) -> bool {
        self.nearest_rad(alpha_rad)
            .is_some_and(|found| wrapped_rad(found - alpha_rad, self.period_rad).abs() <= slack_rad)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::clearance::scaled_clearance;
    use crate::geometry::test_shapes::{ELLIPSE, SQUARE, random_numbers, star, walls};

    fn passage(width_mm: f64) -> EdgeIndex {
        walls(&[&[[0.0, 0.0], [30.0, 0.0], [30.0, width_mm], [0.0, width_mm]]])
    }

    /// Goal: a straight passage has a closed form: 2e(alpha) <= width. Method: interval ends.
    #[test]
    fn straight_passage() {
        let (p, up) = (Point2::new(15.0, 0.0), Vector2::new(0.0, 1.0));
        for width_mm in [0.41, 0.6, 0.9, 1.1, 1.199] {
            let angles = feasible_angles(&ELLIPSE, &passage(width_mm), p, up);
            let expected = ELLIPSE.angle_of_extent_rad(width_mm / 2.0);
            assert_eq!(angles.intervals().len(), 1, "{width_mm}");
            let [low, high] = angles.intervals()[0];
            assert!((low - expected).abs() < 1e-6, "{low} {expected}");
            assert!((high - (PI - expected)).abs() < 1e-6);
            assert!((angles.min_abs_rad().unwrap() - expected).abs() < 1e-6);
            assert!((angles.nearest_rad(-0.01 * expected).unwrap() + expected).abs() < 1e-6);
        }
        assert!(feasible_angles(&ELLIPSE, &passage(0.399), p, up).is_empty());
        let wide = feasible_angles(&ELLIPSE, &passage(1.3), p, up);
        assert_eq!(wide.min_abs_rad(), Some(0.0));
        assert_eq!(wide.nearest_rad(1.2), Some(1.2));
        // Exactly the width: all angles in contact or clear, in bounded time.
        let tight = feasible_angles(&ELLIPSE, &passage(0.4), p, up);
        assert!(tight.contains_rad(FRAC_PI_2, 1e-3), "{tight:?}");
    }

    /// Goal: near a convex corner the tilted aperture still reaches in. Method: 0.2 mm and 20 µm
    /// from the corner of a wide square.
    #[test]
    fn convex_corner() {
        let square = walls(&[SQUARE]);
        let p = Point2::new(0.2, 0.0);
        let angles = feasible_angles(&ELLIPSE, &square, p, Vector2::new(0.0, 1.0));
        let alpha = angles.min_abs_rad().unwrap();
        let found = configuration_at(&ELLIPSE, p, Vector2::new(0.0, 1.0), alpha);
        assert!((scaled_clearance(&ELLIPSE, found, &square, 2.0) - 1.0).abs() < 1e-8);
        assert!(alpha < 0.2, "{alpha}");
        // Closer in than the curve of the aperture allows, nothing reaches.
        let too_far = Point2::new(0.02, 0.0);
        assert!(feasible_angles(&ELLIPSE, &square, too_far, Vector2::new(0.0, 1.0)).is_empty());
    }

    /// Goal: the intervals say what the clearance query says. Method: random stars and normals of
    /// random edges, a fine sweep of alpha; disagreement only within 1e-6 rad of an end or by
    /// less than 1e-6 of clearance.
    #[test]
    fn agrees_with_clearance() {
        let mut random = random_numbers(5);
        let (mut inside, mut outside) = (0, 0);
        for _ in 0..12 {
            let star = walls(&[&star(40, |_| 1.5 + 2.5 * random())]);
            for edge in star.edges() {
                let p = edge.a + (edge.b - edge.a) * random();
                let angles = feasible_angles(&ELLIPSE, &star, p, edge.normal());
                let touchable = is_touchable(&ELLIPSE, &star, p, edge.normal());
                assert_eq!(touchable, !angles.is_empty());
                for k in 0..90 {
                    let alpha = -FRAC_PI_2 + (f64::from(k) + 0.5) * PI / 90.0;
                    let at = configuration_at(&ELLIPSE, p, edge.normal(), alpha);
                    let clear = scaled_clearance(&ELLIPSE, at, &star, 2.0);
                    let feasible = clear >= 1.0 - 1e-7 && star.contains(at.center);
                    if feasible == angles.contains_rad(alpha, 1e-12) {
                        inside += u32::from(feasible);
                        outside += u32::from(!feasible);
                    } else {
                        assert!((clear - 1.0).abs() < 1e-5, "{alpha} {clear} {angles:?}");
                    }
                }
            }
        }
        assert!(inside > 1000 && outside > 1000, "{inside} {outside}");
    }

    /// Goal: at a reflex vertex the normal may be any of the cone; the contact stays on the corner.
    #[test]
    fn reflex_vertex() {
        let corner = walls(&[&[
            [0.0, 0.0],
            [10.0, 0.0],
            [10.0, 10.0],
            [5.0, 10.0],
            [5.0, 5.0],
            [0.0, 5.0],
        ]]);
        let p = Point2::new(5.0, 5.0);
        for k in 0..=10 {
            let turn = -FRAC_PI_2 + FRAC_PI_2 * f64::from(k) / 10.0;
            let normal = Vector2::new(turn.cos(), turn.sin());
            let angles = feasible_angles(&ELLIPSE, &corner, p, normal);
            assert_eq!(angles.min_abs_rad(), Some(0.0));
        }
    }

    /// Goal: the same heading, whatever the outline's facets. Method: a finely sampled circle near the aperture's own
    /// curvature, the worst case (every facet close to contact).
    #[test]
    fn fine_facets_are_the_circle() {
        let circle = walls(&[&star(400, |_| 1.5)]);
        for edge in circle.edges() {
            let p = edge.a + (edge.b - edge.a) * 0.5;
            let angles = feasible_angles(&ELLIPSE, &circle, p, edge.normal());
            assert_eq!(angles.intervals().len(), 1);
            assert_eq!(angles.min_abs_rad(), Some(0.0));
        }
    }

    /// Goal: a round nozzle is one question.
    #[test]
    fn round_nozzle() {
        let round = Aperture::Ellipse {
            major_mm: 0.4,
            minor_mm: 0.4,
        };
        let (p, up) = (Point2::new(15.0, 0.0), Vector2::new(0.0, 1.0));
        assert!(feasible_angles(&round, &passage(0.79), p, up).is_empty());
        for width_mm in [0.8, 0.81] {
            let angles = feasible_angles(&round, &passage(width_mm), p, up);
            assert_eq!(angles.intervals().len(), 1);
        }
    }
}
