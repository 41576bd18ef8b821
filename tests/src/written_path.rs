//! A stream against the moves that were written of it: the checker of G-code for other controllers.
//!
//! In: a stream and places in order, tip in mm, tilt and heading in rad. Out: how far any tick's pose lies beside
//! the moves between them, against [`TIP_MM`] and [`TURN_RAD`].

use headway::gcode::Place;
use headway::job::SegmentStream;
use headway::report::pose_table::{StreamSample, samples};
use headway_firmware::kinematics::pose::{Pose, tilt_of_axis};
use std::f64::consts::PI;

/// What is asked of the tip.
pub const TIP_MM: f64 = 0.005;
/// What is asked of tilt and heading.
pub const TURN_RAD: f64 = 0.05 * PI / 180.0;
/// Moves ahead of the last one that a pose is looked for on: arcs come in chords.
const AHEAD: usize = 24;

/// Tip, tilt and heading as the stream has them.
pub fn channels(place: &Place) -> [f64; 6] {
    let (axis, heading_rad) = place.axis_and_heading();
    let tilt = tilt_of_axis(&axis.into_inner());
    let [x, y, z] = place.tip_mm;
    [x, y, z, tilt.x, tilt.y, heading_rad]
}

/// How far a sample is from a move, against what is asked; headings are known up to turns.
fn beside(sample: &StreamSample, from: &[f64; 6], to: &[f64; 6]) -> f64 {
    let unit = |c: usize| if c < 3 { TIP_MM } else { TURN_RAD };
    let pose = Pose::from_channels(&sample.position);
    let tilt = tilt_of_axis(&pose.tool_axis());
    let p = sample.position;
    let own = [p[0], p[1], p[2], tilt.x, tilt.y, p[5]];
    let mut off: [f64; 6] = std::array::from_fn(|c| (own[c] - from[c]) / unit(c));
    let turn = 2.0 * PI / TURN_RAD;
    let mut way: [f64; 6] = std::array::from_fn(|c| (to[c] - from[c]) / unit(c));
    way[5] -= turn * (way[5] / turn).round();
    off[5] -= turn * (off[5] / turn).round();
    let dot = |a: &[f64; 6], b: &[f64; 6]| -> f64 { (0..6).map(|c| a[c] * b[c]).sum() };
    let share = (dot(&off, &way) / dot(&way, &way).max(1e-12)).clamp(0.0, 1.0);
    let left: [f64; 6] = std::array::from_fn(|c| off[c] - share * way[c]);
    let tip = (left[0].powi(2) + left[1].powi(2) + left[2].powi(2)).sqrt();
    left[3..].iter().fold(tip, |most, c| most.max(c.abs()))
}

/// Every third tick of a stream against moves in order, which end where it does; the worst place
/// against what is asked.
///
/// # Panics
/// Where the stream ends long before the moves do.
pub fn beside_moves(stream: &SegmentStream, servo_hz: f64, places: &[[f64; 6]]) -> f64 {
    let (mut at, mut worst) = (0, 0.0f64);
    for sample in samples(stream, servo_hz, 3.0) {
        let ahead = at..(at + AHEAD).min(places.len() - 1);
        let of = |i: usize| beside(&sample, &places[i], &places[i + 1]);
        // A path that turns back lies on itself: the first move that is near enough and nearer than the next one.
        let is_near = |i: &usize| {
            let own = of(*i);
            own <= 1.0 && (i + 1 >= ahead.end || own <= of(i + 1))
        };
        let nearest = || ahead.clone().min_by(|i, k| of(*i).total_cmp(&of(*k)));
        let best = ahead
            .clone()
            .find(is_near)
            .or_else(nearest)
            .expect("a move");
        at = best;
        worst = worst.max(of(best));
    }
    assert!(
        at + 2 * AHEAD > places.len(),
        "the path ends at {at} of {}",
        places.len()
    );
    worst
}
