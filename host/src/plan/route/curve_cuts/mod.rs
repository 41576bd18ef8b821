//! Cuts curves of passes into passes that continue each other, at control points.
//!
//! In: passes (mm, rad, machine coordinates), the control points where each ends and another begins. Out: the cut
//! passes, and the curve and part of it that each of their curves comes from. A curve is divided into finer spans before
//! it is cut (`DOUBLINGS`), which does not change it; its ends at the cut differ from it by a 96th of the sagitta over
//! such a span.

pub mod turning_back;

use crate::plan::route::moves::PathCurve;
use headway_protocol::units::CHANNELS;

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
    pub passes: Vec<Vec<PathCurve>>,
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

impl CutPasses {
    /// Adds a curve, which is the first or the last of its pass, cut at some of its control points; its parts are
    /// `finished`.
    pub fn add(
        &mut self,
        curve: &PathCurve,
        number: usize,
        [is_first, is_last]: [bool; 2],
        places: &[usize],
        finished: impl Fn(Vec<Point>) -> Vec<Point>,
    ) {
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
        for &place in places {
            let at = place * finer;
            let (at_start, at_end) = (place == 0, place == last);
            if at_start && !is_first {
                self.begin_pass();
            }
            if !at_start && !at_end {
                let mut piece = control[begin..=at].to_vec();
                let end = on_curve(&control, at);
                piece[at - begin] = end;
                self.push(finished(piece), number, finer as f64, begin);
                self.begin_pass();
                begin = at;
                control[at] = end;
            }
        }
        let piece = control.split_off(begin);
        self.push(finished(piece), number, finer as f64, begin);
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
