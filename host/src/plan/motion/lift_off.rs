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
//! In: passes (mm, rad, machine coordinates). Out: the cut passes, and the curve and part of it that each of
//! their curves comes from. A curve is divided into finer spans before it is cut (`DOUBLINGS`), which does not
//! change it; its ends at the cut differ from it by a 96th of the sagitta over such a span. A pass that begins
//! or ends at the pole is not cut. Not covered: arms, whose wrist is singular in another direction at each
//! position.

use crate::plan::motion::singular::Passes;
use crate::plan::route::moves::{PathCurve, tilt};
use headway_protocol::units::{CHANNEL_TILT_X, CHANNEL_TILT_Y, CHANNELS};

/// A path this near to the pole goes through it, rad. No more than this is dropped of its tilt.
const NEAR_RAD: f64 = 2e-4;
/// The direction of the tilt is measured this far from the pole, rad.
const STRAIGHT_RAD: f64 = 5e-3;
/// No nearer to the pole, rad: the wire's resolution still gives a direction, and the axis is off by less
/// than the half milliradian that a pass may be.
const BESIDE_RAD: f64 = 3e-4;
/// How often the spans of a curve that is cut are halved.
const DOUBLINGS: u32 = 2;

type Point = [f64; CHANNELS];

/// Which part of the curves before the cuts a curve is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CurvePart {
    /// Number of the curve over all passes.
    pub curve: usize,
    /// Its path parameter is so many times that one's,
    pub finer: f64,
    /// less this.
    pub begin: f64,
}

/// Passes that were cut.
#[derive(Clone, Debug, Default)]
pub struct CutPasses {
    /// The passes.
    pub passes: Passes,
    /// Where.
    pub cuts: Cuts,
}

/// Where passes were cut.
#[derive(Clone, Debug, Default)]
pub struct Cuts {
    /// What the curves are, over all passes after the cuts.
    pub parts: Vec<CurvePart>,
    /// The passes after the cuts that continue the previous one.
    pub goes_on: Vec<usize>,
}

impl Cuts {
    /// The requested speeds along the curves, from those along the curves before the cuts.
    pub fn speeds(&self, speeds_mm_s: &[Vec<[f64; 2]>]) -> Vec<Vec<[f64; 2]>> {
        let of_part = |part: &CurvePart| {
            let speeds = speeds_mm_s.get(part.curve).into_iter().flatten();
            let speeds = speeds.map(|[at, speed]| [at * part.finer - part.begin, *speed]);
            speeds.collect()
        };
        self.parts.iter().map(of_part).collect()
    }

    /// Data of each pass, from those of the passes before the cuts.
    pub fn of_passes<T: Copy>(&self, all: &[T]) -> Vec<T> {
        let mut own = Vec::new();
        for item in all {
            own.push(*item);
            while self.goes_on.contains(&own.len()) {
                own.push(*item);
            }
        }
        own
    }
}

/// The passes cut at the pole.
pub fn cut_at_the_pole(passes: &Passes) -> CutPasses {
    let mut cut = CutPasses::default();
    let mut curve_number = 0;
    for pass in passes {
        cut.passes.push(Vec::new());
        for (index, curve) in pass.iter().enumerate() {
            let ends = [index == 0, index + 1 == pass.len()];
            cut.add(curve, curve_number, ends);
            curve_number += 1;
        }
    }
    cut
}

impl CutPasses {
    /// A curve, which is the first or the last of its pass.
    fn add(&mut self, curve: &PathCurve, number: usize, [is_first, is_last]: [bool; 2]) {
        let places = near_the_pole(&curve.control);
        let last = curve.control.len().saturating_sub(1);
        if places.is_empty() {
            return self.push(curve.control.clone(), number, 1.0, 0);
        }
        let finer = 1 << DOUBLINGS;
        let mut control = curve.control.clone();
        for _ in 0..DOUBLINGS {
            control = halved_spans(&control);
        }
        let ends_there = places.last() == Some(&last);
        let mut begin = 0;
        for place in places {
            let at = place * finer;
            let (at_start, at_end) = (place == 0, place == last);
            if at_start && !is_first {
                self.begin_pass();
            }
            if !at_start && !at_end {
                let mut piece = control[begin..=at].to_vec();
                let end = on_curve(&control, at);
                piece[at - begin] = end;
                self.push(straightened(piece), number, finer as f64, begin);
                self.begin_pass();
                begin = at;
                control[at] = end;
            }
        }
        let piece = control.split_off(begin);
        self.push(straightened(piece), number, finer as f64, begin);
        if ends_there && !is_last {
            self.begin_pass();
        }
    }

    fn push(&mut self, control: Vec<Point>, curve: usize, finer: f64, begin: usize) {
        self.cuts.parts.push(CurvePart {
            curve,
            finer,
            begin: begin as f64,
        });
        if let Some(pass) = self.passes.last_mut() {
            pass.push(PathCurve { control });
        }
    }

    fn begin_pass(&mut self) {
        if self.passes.last().is_some_and(|pass| !pass.is_empty()) {
            self.cuts.goes_on.push(self.passes.len());
            self.passes.push(Vec::new());
        }
    }
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

/// The same curve in spans half as long: the uniform cubic B-spline's subdivision (Lane and Riesenfeld,
/// 1980), natural ends kept.
fn halved_spans(control: &[Point]) -> Vec<Point> {
    let mut finer = Vec::with_capacity(2 * control.len());
    for (index, point) in control.iter().enumerate() {
        let (before, next) = (index.checked_sub(1), control.get(index + 1));
        finer.push(match (before.map(|before| &control[before]), next) {
            (Some(before), Some(next)) => {
                std::array::from_fn(|c| (before[c] + 6.0 * point[c] + next[c]) / 8.0)
            }
            _ => *point,
        });
        if let Some(next) = next {
            finer.push(std::array::from_fn(|c| 0.5 * (point[c] + next[c])));
        }
    }
    finer
}

/// The curve at a control point within it.
fn on_curve(control: &[Point], at: usize) -> Point {
    std::array::from_fn(|c| (control[at - 1][c] + 4.0 * control[at][c] + control[at + 1][c]) / 6.0)
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
