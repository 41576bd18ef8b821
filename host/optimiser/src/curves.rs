//! Curves that are too tight for a wide bead: the ratio of material outside to inside would be too
//! large.
//!
//! In: knots of the pose, the aperture, the bound of width by radius. Out: value, slope and Gauss-Newton curvature of
//! the excess. With the path's curvature k and the bead's width w across the path, |k| w is bounded: the path is
//! rounded, or the nozzle turns its narrow side to the curve. Not covered: the speed, which does not affect this
//! ratio.

use super::OptimisedPass;
use super::curve::{Basis, CHANNELS, Knot, PassKnots, Units, blend, knots_of, set_phantoms};
use super::motion::{SpanSums, places};
use super::terms::Terms;
use crate::band::System;
use headway_geometry::aperture::Aperture;
use headway_geometry::{Point2, Vector2};

/// Length of a span below which its direction is undefined, a. With a larger value a corner in which the head almost
/// stops has no curvature, and the optimiser exploits it.
const STANDING: f64 = 0.0002;
/// Excess from which the cost grows no faster: at a corner it has no bound.
const EXCESS_LINEAR: f64 = 2.0;
/// Difference by which the width's slope is found, rad.
const TURN: f64 = 1e-4;

/// Share of the bound that is used where a path is rounded before it is optimised: within it the optimiser does not
/// reach a corner in which the head stops, where the spline has no curvature (trials).
const ROUNDED_SHARE: f64 = 0.85;
/// Rounds in which knots are moved between their neighbours, and the share of the distance: a radius of some widths
/// takes the square of as many steps.
const ROUNDS: usize = 4000;
const ROUND_STEP: f64 = 0.5;

/// The bound of one aperture.
#[derive(Clone, Debug)]
pub struct Curves {
    aperture: Aperture,
    length_mm: f64,
    /// Of curvature times width.
    bound: f64,
}

/// Path of the passes on which a bead's width across it is more than `bound` of its radius, mm.
pub fn tight_mm(passes: &[OptimisedPass], aperture: &Aperture, bound: f64) -> f64 {
    let length_mm = aperture.major_mm();
    let Some(units) = Units::of(passes, length_mm, Point2::origin()) else {
        return 0.0;
    };
    let (knots, ranges) = knots_of(passes, &units);
    let curves = Curves::new(aperture, length_mm, bound);
    let places = places();
    let starts = ranges.iter().flat_map(PassKnots::span_starts);
    let bends = starts.flat_map(|knot| places.iter().map(move |basis| (knot, basis)));
    let tight = bends.filter_map(|(knot, basis)| {
        let bend = curves.bend(basis, &knots[knot..]);
        let is_tight = bend.curvature.abs() * bend.width > bound;
        is_tight.then(|| bend.first[0].hypot(bend.first[1]))
    });
    tight.sum::<f64>() * length_mm / places.len() as f64
}

/// A place of the path: derivatives by the spline's parameter, and what follows of them.
struct Bend<'a> {
    basis: &'a Basis,
    first: Knot,
    second: Knot,
    /// |q'|² with the square of [`STANDING`].
    way2: f64,
    /// Signed curvature.
    curvature: f64,
    /// Width across the path, in a, and its change by the direction's angle.
    width: f64,
    widening: f64,
}

impl Curves {
    /// Width by radius at most `bound`.
    pub fn new(aperture: &Aperture, length_mm: f64, bound: f64) -> Curves {
        Curves {
            aperture: *aperture,
            length_mm,
            bound,
        }
    }

    /// Rounds the paths of passes that may move until their knots keep within the bound, or for [`ROUNDS`]: knots where the
    /// path turns too much over its length go towards the middle of their neighbours.
    pub fn round(&self, knots: &mut [Knot], passes: &[PassKnots]) {
        for pass in passes.iter().filter(|pass| pass.free) {
            let inner = pass.first + 2..pass.end() - 2;
            for _ in 0..ROUNDS {
                let mut is_done = true;
                for knot in inner.clone() {
                    let [before, own, after] = [knot - 1, knot, knot + 1].map(|k| knots[k]);
                    if self.turns_too_much(&before, &own, &after) {
                        is_done = false;
                        for axis in 0..2 {
                            let middle = 0.5 * (before[axis] + after[axis]);
                            knots[knot][axis] += ROUND_STEP * (middle - own[axis]);
                        }
                    }
                }
                if is_done {
                    break;
                }
            }
            set_phantoms(knots, pass);
        }
    }

    fn turns_too_much(&self, before: &Knot, own: &Knot, after: &Knot) -> bool {
        let leg = |from: &Knot, to: &Knot| Vector2::new(to[0] - from[0], to[1] - from[1]);
        let (entering, leaving) = (leg(before, own), leg(own, after));
        let along = entering + leaving;
        let turn = entering.perp(&leaving).atan2(entering.dot(&leaving)).abs();
        let length = 0.5 * (entering.norm() + leaving.norm());
        turn * self.width(along.y.atan2(along.x), own[2]) > ROUNDED_SHARE * self.bound * length
    }

    /// Adds the excess over the bound, weighted by `hardness`; slopes where there is a system.
    pub fn add(
        &self,
        knots: &[Knot],
        passes: &[PassKnots],
        hardness: f64,
        terms: &mut Terms,
        mut system: Option<&mut System>,
    ) {
        let places = places();
        for pass in passes {
            for knot in pass.span_starts() {
                let mut sums = SpanSums::default();
                let mut exceeds = false;
                for basis in &places {
                    let bend = self.bend(basis, &knots[knot..]);
                    exceeds |=
                        self.add_place(&bend, hardness / places.len() as f64, terms, &mut sums);
                }
                if let Some(system) = system.as_deref_mut().filter(|_| exceeds) {
                    sums.scatter(knot, system);
                }
            }
        }
    }

    fn bend<'a>(&self, basis: &'a Basis, knots: &[Knot]) -> Bend<'a> {
        let (first, second) = (blend(&basis.first, knots), blend(&basis.second, knots));
        let heading = blend(&basis.value, knots)[2];
        let way2 = first[0] * first[0] + first[1] * first[1] + STANDING * STANDING;
        let direction = first[1].atan2(first[0]);
        let width = |turn: f64| self.width(direction + turn, heading);
        Bend {
            basis,
            first,
            second,
            way2,
            curvature: (first[0] * second[1] - first[1] * second[0]) / (way2 * way2.sqrt()),
            width: width(0.0),
            widening: (width(TURN) - width(-TURN)) / (2.0 * TURN),
        }
    }

    /// Width across a path of this direction, in a.
    fn width(&self, direction: f64, heading: f64) -> f64 {
        let across = Vector2::new(-direction.sin(), direction.cos());
        2.0 * self.aperture.extent_mm(heading, across) / self.length_mm
    }

    /// Adds one place; whether it exceeds.
    fn add_place(&self, bend: &Bend, weight: f64, terms: &mut Terms, sums: &mut SpanSums) -> bool {
        let share = bend.curvature.abs() * bend.width / self.bound;
        let excess = share - 1.0;
        if excess <= 0.0 {
            return false;
        }
        let (value, slope, curve) = match excess < EXCESS_LINEAR {
            true => (0.5 * excess * excess, excess, 1.0),
            false => (
                EXCESS_LINEAR * (excess - 0.5 * EXCESS_LINEAR),
                EXCESS_LINEAR,
                EXCESS_LINEAR / excess,
            ),
        };
        terms.excess += weight * value;
        sums.add_rows(weight * slope, weight * curve, &self.rows(bend));
        true
    }

    /// The share's derivatives by the four knots' x, y and heading.
    fn rows(&self, bend: &Bend) -> [[f64; 4]; CHANNELS - 1] {
        let ([x1, y1, ..], [x2, y2, ..]) = (bend.first, bend.second);
        let sign = bend.curvature.signum() / self.bound;
        let inverse3 = 1.0 / (bend.way2 * bend.way2.sqrt());
        let fall = 3.0 * bend.curvature / bend.way2;
        let bent = sign * bend.width;
        let turned = sign * bend.curvature * bend.widening / bend.way2;
        let by_x1 = bent * (y2 * inverse3 - fall * x1) - turned * y1;
        let by_y1 = bent * (-x2 * inverse3 - fall * y1) + turned * x1;
        let [by_x2, by_y2] = [-bent * y1 * inverse3, bent * x1 * inverse3];
        let by_heading = -sign * bend.curvature * bend.widening;
        let b = bend.basis;
        [
            std::array::from_fn(|j| by_x1 * b.first[j] + by_x2 * b.second[j]),
            std::array::from_fn(|j| by_y1 * b.first[j] + by_y2 * b.second[j]),
            std::array::from_fn(|j| by_heading * b.value[j]),
        ]
    }
}
