//! Points of a motion -> the control points of its curve.
//!
//! In: vertices and points of chords by the curve's parameter (mm, rad, mm³). Out: control points of even spans, by
//! least squares (C. de Boor, A Practical Guide to Splines, 1978, chapter 14): as many as vertices, so that the
//! file's rounding is smoothed where it would cause jerk.

use super::{Point, TURN_MM, length, way};
use crate::geometry::banded::Band;
use crate::plan::route::moves::PathCurve;
use crate::plan::route::path_curve::basis_weights;
use crate::settings::Settings;
use headway_protocol::units::CHANNELS;

/// Share of the tip's and the heading's tolerance that the curve may be off a place.
const PLACE_SHARE: f64 = 1.0;
/// The same next to a chord, from which the motion itself deviates by up to three: the target, and the accepted
/// value. A smaller target takes more control points, and for beads time as well: on the u-part 2 % for 1.5.
pub(super) const TRAVEL_SHARES: [f64; 2] = [1.5, 4.0];
pub(super) const BEAD_SHARES: [f64; 2] = [4.0, 4.0];
/// Least weight of points of chords (fitted), from which the motion deviates by ten times the rounding of places and
/// more.
const CHORD_WEIGHT: f64 = 1e-2;
/// Weight of third differences (fitted on u-part, gear and bracket): with a control point a place they even out
/// roundings, which are jerk, and nothing else.
const EVEN_WEIGHT: f64 = 1e-3;
/// Least spans, and how often they are halved.
const SPANS_MIN: usize = 4;
const HALVINGS_MAX: usize = 4;

/// What the curve passes, by the parameter: the places, and points of long chords.
pub(super) struct Passed {
    pub at: f64,
    pub point: Point,
    /// The chord's direction; `None` for a vertex.
    pub along: Option<[f64; 4]>,
    pub weight: f64,
}

/// Weight of a point of a chord whose nearest neighbours are this many times as far as places are there: its error
/// appears in the acceleration by the square of that.
pub(super) fn chord_weight(times: f64) -> f64 {
    (CHORD_WEIGHT * times * times).min(1.0)
}

/// Control points of even spans, halved until the curve is near enough; `None` if that takes too many.
pub(super) fn fitted(
    passed: &[Passed],
    places: usize,
    chord_shares: [f64; 2],
    settings: &Settings,
) -> Option<Vec<Point>> {
    let whole = passed.last()?.at;
    let mut good_enough = None;
    for halvings in 0..=HALVINGS_MAX {
        let spans = places.max(SPANS_MIN) << halvings;
        let control = least_squares(passed, spans, whole);
        let agrees = |share| agrees(&control, passed, whole, share, settings);
        if agrees(chord_shares[0]) {
            return Some(control);
        }
        if good_enough.is_none() && agrees(chord_shares[1]) {
            good_enough = Some(control);
        }
    }
    good_enough
}

fn agrees(
    control: &[Point],
    passed: &[Passed],
    whole: f64,
    chord_share: f64,
    settings: &Settings,
) -> bool {
    let curve = PathCurve {
        control: control.to_vec(),
    };
    let per_unit = curve.span_count() as f64 / whole;
    passed.iter().all(|of| {
        let off = way(&curve.value(of.at * per_unit), &of.point);
        let (share, along) = match of.along {
            None => (PLACE_SHARE, [0.0; 4]),
            Some(along) => (chord_share, along),
        };
        let dot: f64 = off.iter().zip(along).map(|(a, b)| a * b).sum();
        let [x, y, z, turned_mm]: [f64; 4] = std::array::from_fn(|i| off[i] - dot * along[i]);
        length(&[x, y, z, 0.0]) <= share * settings.tolerances.tip_mm
            && turned_mm.abs() <= share * TURN_MM * settings.tolerances.heading_rad
    })
}

/// Control points with the least squares of distances; both ends are at rest.
fn least_squares(passed: &[Passed], spans: usize, whole: f64) -> Vec<Point> {
    let ends = [passed[0].point, passed[passed.len() - 1].point];
    let unknowns = spans - 1;
    let mut band = Band {
        rows: vec![[0.0; 4]; unknowns],
    };
    let mut right = vec![[0.0; CHANNELS]; unknowns];
    // A sum of control points from `first` on, 0 being the start, that is to be `value`.
    let mut add = |first: usize, weights: &[f64], value: &Point, weight: f64| {
        let mut left = *value;
        for (k, of) in weights.iter().enumerate() {
            let end = match first + k {
                0 => ends[0],
                at if at == spans => ends[1],
                _ => continue,
            };
            left.iter_mut()
                .zip(end)
                .for_each(|(left, end)| *left -= of * end);
        }
        for (a, of_a) in weights.iter().enumerate() {
            let Some(row) = (first + a).checked_sub(1).filter(|row| *row < unknowns) else {
                continue;
            };
            for (b, of_b) in weights.iter().enumerate().skip(a) {
                if first + b < spans {
                    band.rows[row][b - a] += weight * of_a * of_b;
                }
            }
            for (right, left) in right[row].iter_mut().zip(left) {
                *right += weight * of_a * left;
            }
        }
    };
    for of in passed {
        let u = of.at / whole * spans as f64;
        let span = (u as usize).min(spans - 1);
        let [weights, ..] = basis_weights(u - span as f64);
        // Beyond the ends the control points continue evenly.
        let [before, a, b, after] = weights;
        match (span == 0, span + 1 == spans) {
            (false, false) => add(span - 1, &weights, &of.point, of.weight),
            (true, false) => add(
                0,
                &[a + 2.0 * before, b - before, after],
                &of.point,
                of.weight,
            ),
            (false, true) => {
                let own = [before, a - after, b + 2.0 * after];
                add(span - 1, &own, &of.point, of.weight);
            }
            (true, true) => {}
        }
    }
    for first in 0..spans.saturating_sub(2) {
        add(
            first,
            &[-1.0, 3.0, -3.0, 1.0],
            &[0.0; CHANNELS],
            EVEN_WEIGHT,
        );
    }
    band.factored().solve(&mut right);
    let mut control = vec![ends[0]];
    control.extend(right);
    control.push(ends[1]);
    control
}
