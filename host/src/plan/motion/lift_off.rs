//! Cuts passes that go through the pole of a tilting table: lift, turn the table, continue.
//!
//! At a vertical axis the table's angle is free; a path through that direction would require it to jump by
//! as much as the tilt changes its direction. If neither slowing nor a tilt within the tolerance avoids
//! that ([`super::singular`]), the pass ends there and another begins at the same position. Both keep the
//! direction of their tilt up to that point, no nearer to the pole than `BESIDE_RAD`, so that nothing turns
//! while the tip approaches; between them the head is lifted and the table turns.
//!
//! ```text
//! tilt (rad):      ... ──●──●──●▸ lift, turn ◂●──●──●── ...    within NEAR_RAD of the pole: cut
//! ```
//! In: passes (mm, rad, machine coordinates). Out: the cut passes ([`CutPasses`]). A pass that begins or ends at the
//! pole is not cut. Not covered: arms, whose wrist is singular in another direction at each position.

use crate::plan::motion::singular::Passes;
use crate::plan::route::curve_cuts::CutPasses;
use crate::plan::route::moves::tilt;
use headway_protocol::units::{CHANNEL_TILT_X, CHANNEL_TILT_Y, CHANNELS};

/// A path this near to the pole goes through it, rad. No more than this is dropped of its tilt.
const NEAR_RAD: f64 = 2e-4;
/// The direction of the tilt is measured this far from the pole, rad.
const STRAIGHT_RAD: f64 = 5e-3;
/// No nearer to the pole, rad: the wire's resolution still gives a direction, and the axis is off by less
/// than the half milliradian that a pass may be.
const BESIDE_RAD: f64 = 3e-4;
type Point = [f64; CHANNELS];

/// The passes cut at the pole.
pub fn cut_at_the_pole(passes: &Passes) -> CutPasses {
    let mut cut = CutPasses::default();
    let mut curve_number = 0;
    for pass in passes {
        cut.passes.push(Vec::new());
        for (index, curve) in pass.iter().enumerate() {
            let ends = [index == 0, index + 1 == pass.len()];
            let places = near_the_pole(&curve.control);
            cut.add(curve, curve_number, ends, &places, straightened);
            curve_number += 1;
        }
    }
    cut
}

/// The control points nearest to the pole, one each time that a curve comes near it. One that stays there
/// never requires a turn, and is unchanged.
fn near_the_pole(control: &[Point]) -> Vec<usize> {
    let mut places: Vec<usize> = Vec::new();
    let mut is_near = false;
    for (index, leg) in control.windows(2).enumerate() {
        let (from, to) = (tilt(&leg[0]), tilt(&leg[1]));
        let step = to - from;
        let share = (-from.dot(&step) / step.norm_squared().max(1e-30)).clamp(0.0, 1.0);
        let comes_near = (from + share * step).norm() < NEAR_RAD;
        if comes_near {
            let nearer = if from.norm() <= to.norm() {
                index
            } else {
                index + 1
            };
            match places.last_mut() {
                Some(place) if is_near => {
                    if tilt(&control[nearer]).norm() < tilt(&control[*place]).norm() {
                        *place = nearer;
                    }
                }
                _ => places.push(nearer),
            }
        }
        is_near = comes_near;
    }
    let leaves = control
        .iter()
        .any(|point| tilt(point).norm() > STRAIGHT_RAD);
    if leaves { places } else { Vec::new() }
}

/// Ends at the pole keep the direction in which they approach it.
fn straightened(mut piece: Vec<Point>) -> Vec<Point> {
    for _ in 0..2 {
        let is_far = |point: &Point| tilt(point).norm() > STRAIGHT_RAD;
        let at_pole = piece
            .first()
            .is_some_and(|first| tilt(first).norm() < STRAIGHT_RAD);
        if at_pole && let Some(far) = piece.iter().position(is_far) {
            let direction = tilt(&piece[far]).normalize();
            for point in &mut piece[..far] {
                let straight = tilt(point).dot(&direction).max(BESIDE_RAD) * direction;
                (point[CHANNEL_TILT_X], point[CHANNEL_TILT_Y]) = (straight.x, straight.y);
            }
        }
        piece.reverse();
    }
    piece
}

#[cfg(test)]
mod tests {
    //! Goal: a curve that is cut is the same curve, its ends straight towards the pole. Method: curves that
    //! go through the pole, begin at it, stay beside it, evaluated before and after.
    use super::*;
    use crate::plan::route::moves::PathCurve;

    /// A bow of 10 mm radius in spans of 0.3 mm, tilting by `rate` rad a span from `from` on, `beside` off
    /// the pole.
    fn bow(count: usize, from: f64, rate: f64, beside: f64) -> PathCurve {
        let control = (0..count).map(|i| {
            let (sin, cos) = (0.03 * i as f64).sin_cos();
            let tilt = from + rate * i as f64;
            [
                10.0 * sin,
                10.0 * cos,
                0.0,
                beside,
                tilt,
                0.1 * i as f64,
                0.0,
            ]
        });
        PathCurve {
            control: control.collect(),
        }
    }

    #[test]
    fn a_curve_through_the_pole_is_cut_there_and_stays_the_same() {
        let curve = bow(41, -0.2, 0.01, 1e-5);
        let cut = cut_at_the_pole(&vec![vec![curve.clone()]]);
        assert_eq!(
            (cut.passes.len(), cut.cuts.goes_on.as_slice()),
            (2, &[1][..])
        );
        for (pass, part) in cut.passes.iter().zip(&cut.cuts.parts) {
            let piece = &pass[0];
            for step in 0..=10 * piece.span_count() {
                let at = step as f64 / 10.0;
                let (own, whole) = (
                    piece.evaluate(at).value,
                    curve.evaluate((at + part.begin) / part.finer).value,
                );
                for channel in 0..3 {
                    assert!(
                        (own[channel] - whole[channel]).abs() < 1e-4,
                        "{own:?} {whole:?}"
                    );
                }
                assert!(
                    (tilt(&own) - tilt(&whole)).norm() < 5e-4,
                    "{own:?} {whole:?}"
                );
            }
        }
        let end = cut.passes[0][0].control.last().unwrap();
        let begin = cut.passes[1][0].control[0];
        assert_eq!(end[..3], begin[..3]);
        assert!(
            (tilt(end) + tilt(&begin)).norm() < 1e-5,
            "{end:?} {begin:?}"
        );
        assert!((tilt(end).norm() - BESIDE_RAD).abs() < 1e-9);
        let asked = [vec![[0.0, 10.0], [20.0, 30.0], [40.0, 20.0]]];
        let speeds = cut.cuts.speeds(&asked);
        assert_eq!(speeds[0][1], [80.0, 30.0]);
        assert_eq!(speeds[1][1], [0.0, 30.0]);
        assert_eq!(cut.cuts.of_passes(&['a', 'b']), ['a', 'a', 'b']);
    }

    #[test]
    fn what_begins_at_the_pole_or_keeps_off_it_is_not_cut() {
        let begins = cut_at_the_pole(&vec![vec![bow(30, 0.0, 0.01, 0.0)]]);
        assert_eq!(begins.passes.len(), 1);
        assert!(tilt(&begins.passes[0][0].control[0]).norm() >= BESIDE_RAD);
        let passes = vec![vec![bow(41, -0.2, 0.01, 1e-3)]];
        assert_eq!(cut_at_the_pole(&passes).passes, passes);
        let upright = vec![vec![bow(41, 0.0, 0.0, 0.0)]];
        assert_eq!(cut_at_the_pole(&upright).passes, upright);
    }
}
