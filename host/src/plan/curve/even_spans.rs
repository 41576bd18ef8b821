//! A pass as control points at even steps of its own path, with a rough speed: the start of an optimiser.
//!
//! The spacing of placements is arbitrary: dense in corners, sparse on straight beads. Spans of equal length,
//! with a turn of the heading counted as the path of a point beside the aperture, neither freeze a turn (as
//! spans of equal time do) nor lose a turn in place. Corners are rounded over a fraction of a, because a kink
//! adds jerk without information about the bead's position.
//!
//! In: control points of a curve (mm, rad), the aperture, limits. Out: control points at even steps, the
//! logarithm of each span's time (s), and for each point the control point it came from.

use crate::geometry::aperture::Aperture;
use crate::geometry::plane_curve::{PlaneControl, curve_at};
use crate::plan::pose_limits::PoseLimits;

/// Length of a span, against a: 0.24 mm for 0.6 mm. Half of it doubles the work and gains less than 1 %.
const SPAN_SHARE: f64 = 0.4;
/// What a turn by a radian counts as, against a.
const TURN_SHARE: f64 = 4.0 / 3.0;
/// Standard deviation of the rounding of corners, against a.
const ROUNDING_SHARE: f64 = 1.0 / 6.0;
/// Boxes that make the bell of the rounding; the standard deviation of n boxes of width w is w sqrt(n / 12).
const BOXES: usize = 3;
/// Steps of a span in which the path is rounded and timed.
const STEPS: usize = 8;
/// Least spans of a pass: fewer leave nothing to move between two ends that stay.
const SPANS_MIN: usize = 8;
/// Poses of a span of the given curve.
const FINE: usize = 8;
/// A step below this is ignored, mm.
const LEG_MIN_MM: f64 = 1e-12;
/// What of the limits of speed a path in corners reaches on the whole: tip, heading.
const PACE_SHARES: [f64; 2] = [0.45, 0.33];

/// A pass with even spans.
pub struct EvenSpans {
    /// Control points.
    pub control: Vec<PlaneControl>,
    /// Logarithm of the time of a span, s.
    pub log_pace: Vec<f64>,
    /// The nearest control point of the curve that was given.
    pub numbers: Vec<usize>,
}

/// The curve of `control`, at least two points, in even spans. Its ends do not move.
pub fn even_spans(control: &[PlaneControl], aperture: &Aperture, limits: &PoseLimits) -> EvenSpans {
    let span_mm = SPAN_SHARE * aperture.major_mm();
    let way = Way::of(control, FINE, TURN_SHARE * aperture.major_mm());
    let spans = ((way.whole_mm() / span_mm).round() as usize).max(SPANS_MIN);
    let steps = spans * STEPS;
    let (mut poses, numbers) = way.even_steps(steps);
    let step_mm = way.whole_mm() / steps as f64;
    let width_mm = ROUNDING_SHARE * aperture.major_mm() * (12.0 / BOXES as f64).sqrt();
    let half = (0.5 * width_mm / step_mm.max(f64::MIN_POSITIVE)).min(0.5 * steps as f64);
    for _ in 0..BOXES {
        poses = averaged(&poses, half.round() as usize);
    }
    let log_pace = log_pace(&poses, limits);
    EvenSpans {
        control: poses.into_iter().step_by(STEPS).collect(),
        log_pace,
        numbers: numbers.into_iter().step_by(STEPS).collect(),
    }
}

/// A curve as closely spaced poses, with the distance along it to each.
pub struct Way {
    poses: Vec<PlaneControl>,
    /// Path length to each, a turn counted as a length, mm.
    way_mm: Vec<f64>,
    /// Poses of a span of the curve.
    of_span: usize,
}

impl Way {
    /// Along the curve of `control`, at least two points, with a number of poses per span; a turn by a radian counts
    /// as `turn_mm`.
    pub fn of(control: &[PlaneControl], of_span: usize, turn_mm: f64) -> Way {
        let spans = control.len() - 1;
        let poses = (0..=spans * of_span).map(|k| {
            let span = (k / of_span).min(spans - 1);
            curve_at(control, span, k as f64 / of_span as f64 - span as f64)
        });
        let poses: Vec<PlaneControl> = poses.collect();
        let mut way_mm = Vec::with_capacity(poses.len());
        let mut whole_mm = 0.0;
        way_mm.push(whole_mm);
        for pair in poses.windows(2) {
            let [x, y, turn]: PlaneControl = std::array::from_fn(|c| pair[1][c] - pair[0][c]);
            whole_mm += x.hypot(y).hypot(turn_mm * turn);
            way_mm.push(whole_mm);
        }
        Way {
            poses,
            way_mm,
            of_span,
        }
    }

    /// The total distance, mm.
    pub fn whole_mm(&self) -> f64 {
        self.way_mm.last().copied().unwrap_or(0.0)
    }

    /// Poses at even steps of it, including both ends, and the number of the control point nearest to each.
    pub fn even_steps(&self, steps: usize) -> (Vec<PlaneControl>, Vec<usize>) {
        let (fine, way_mm, whole_mm) = (&self.poses, &self.way_mm, self.whole_mm());
        let (mut poses, mut numbers) =
            (Vec::with_capacity(steps + 1), Vec::with_capacity(steps + 1));
        let mut i = 0;
        for step in 0..=steps {
            let at_mm = whole_mm * step as f64 / steps as f64;
            while i + 2 < way_mm.len() && way_mm[i + 1] < at_mm {
                i += 1;
            }
            let leg_mm = (way_mm[i + 1] - way_mm[i]).max(LEG_MIN_MM);
            let t = ((at_mm - way_mm[i]) / leg_mm).clamp(0.0, 1.0);
            poses.push(std::array::from_fn(|c| {
                fine[i][c] + t * (fine[i + 1][c] - fine[i][c])
            }));
            numbers.push(((i as f64 + t) / self.of_span as f64).round() as usize);
        }
        (poses, numbers)
    }
}

/// The mean over `half` poses to either side; beyond the ends the path continues as its point reflection, so
/// that they stay in place.
fn averaged(poses: &[PlaneControl], half: usize) -> Vec<PlaneControl> {
    let last = poses.len() as isize - 1;
    let at = |i: isize| -> PlaneControl {
        let mirrored = |end: isize, i: isize| -> PlaneControl {
            std::array::from_fn(|c| 2.0 * poses[end as usize][c] - poses[i as usize][c])
        };
        match i {
            i if i < 0 => mirrored(0, -i),
            i if i > last => mirrored(last, 2 * last - i),
            i => poses[i as usize],
        }
    };
    let half = half as isize;
    let count = (2 * half + 1) as f64;
    // Sums of differences from the pose itself: rounding does not grow along the path.
    (0..=last)
        .map(|i| {
            let own = at(i);
            let mut sum = [0.0; 3];
            for near in i - half..=i + half {
                let near = at(near);
                for (sum, (near, own)) in sum.iter_mut().zip(near.iter().zip(own)) {
                    *sum += near - own;
                }
            }
            std::array::from_fn(|c| own[c] + sum[c] / count)
        })
        .collect()
}

/// Time of a short distance, s.
fn crude_s(from: &PlaneControl, to: &PlaneControl, limits: &PoseLimits) -> f64 {
    let [of_tip, of_heading] = PACE_SHARES;
    let [x, y, turn]: PlaneControl = std::array::from_fn(|c| to[c] - from[c]);
    let tip_s = x.hypot(y) / (of_tip * limits.tip_speed_mm_s);
    let turn_s = turn.abs() / (of_heading * limits.axes[2].speed);
    tip_s.max(turn_s).max(1e-9)
}

/// The logarithm of the time of the span about every [`STEPS`]th pose.
fn log_pace(poses: &[PlaneControl], limits: &PoseLimits) -> Vec<f64> {
    let mut time_s = vec![0.0];
    for pair in poses.windows(2) {
        time_s.push(time_s[time_s.len() - 1] + crude_s(&pair[0], &pair[1], limits));
    }
    let last = poses.len() - 1;
    let about = |i: usize| {
        let [low, high] = [i.saturating_sub(STEPS), (i + STEPS).min(last)];
        let spans = (high - low) as f64 / STEPS as f64;
        ((time_s[high] - time_s[low]) / spans).ln()
    };
    (0..=last).step_by(STEPS).map(about).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::test_shapes::ELLIPSE;
    use crate::plan::pose_limits::pose_limits;
    use crate::settings::Settings;

    /// Goal: spans are even by way and turn, ends stay, and what is turned in place keeps its spans. Method: a
    /// straight bead of 6 mm with uneven control points, a turn by pi in place, a straight bead back.
    #[test]
    fn spans_are_even_by_way_and_turn() {
        let mut control: Vec<PlaneControl> = Vec::new();
        control.extend((0..=60).map(|i| [0.1 * f64::from(i), 0.0, 0.0]));
        control.extend((1..=10).map(|i| [6.0, 0.0, 0.1 * std::f64::consts::PI * f64::from(i)]));
        control.extend((1..=20).map(|i| [6.0 - 0.3 * f64::from(i), 0.0, std::f64::consts::PI]));
        let even = even_spans(&control, &ELLIPSE, &pose_limits(&Settings::default()));
        let turn_mm = TURN_SHARE * ELLIPSE.major_mm();
        let expected = (12.0 + turn_mm * std::f64::consts::PI) / (SPAN_SHARE * ELLIPSE.major_mm());
        let spans = even.control.len() - 1;
        assert!((spans as f64 - expected).abs() < 1.0, "{spans} {expected}");
        for (own, given) in [
            (even.control[0], control[0]),
            (even.control[spans], control[90]),
        ] {
            let apart = own
                .iter()
                .zip(given)
                .map(|(own, given)| (own - given).abs());
            // Rounding of a few sums.
            assert!(apart.fold(0.0, f64::max) < 1e-12, "{own:?} {given:?}");
        }
        // All but those next to the two corners, which the rounding cuts.
        let step_mm = |pair: &[PlaneControl]| {
            let [x, y, turn]: PlaneControl = std::array::from_fn(|c| pair[1][c] - pair[0][c]);
            x.hypot(y).hypot(turn_mm * turn)
        };
        let near = |mm: f64| (mm / (SPAN_SHARE * ELLIPSE.major_mm()) - 1.0).abs() < 0.05;
        let even_ones = even.control.windows(2).filter(|pair| near(step_mm(pair)));
        assert!(even_ones.count() + 8 >= spans);
        assert!(even.control.iter().any(|q| (q[2] - 1.5).abs() < 0.2));
        assert_eq!(even.log_pace.len(), even.control.len());
        assert_eq!(even.numbers.len(), even.control.len());
        assert_eq!((even.numbers[0], even.numbers[spans]), (0, 90));
    }
}
