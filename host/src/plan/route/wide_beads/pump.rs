//! A pump that runs on: the flow of a pass falls before its end, and the pump's residual flow fills the rest.
//!
//! In: curves of one pass, whose volume channel holds the bead's volume (mm³); the length of path that the residual
//! flow fills (mm). Out: the curves with correspondingly less volume. The flow falls evenly over the stop's length,
//! half of it before the point where the pump is to stop and half after it. Not covered: the start, which is a prime.

use crate::job::MotionState;
use crate::plan::route::hop::is_right_above;
use crate::plan::route::moves::{PathCurve, Route, tip, way_mm};
use crate::settings::Settings;
use headway_protocol::units::{CHANNEL_VOLUME, CHANNELS};

/// The stop of a short pass, share of its path: the flow falls over half of the stop before it and half after it.
const STOP_SHARE_MAX: f64 = 0.5;

/// Removes the volume of the last `stop_mm` from the curves of one pass, and returns it, mm³.
pub fn stopped_early(curves: &mut [PathCurve], stop_mm: f64) -> f64 {
    let length_mm: f64 = curves.iter().map(|curve| way_mm(&curve.control)).sum();
    let stop_mm = stop_mm.min(STOP_SHARE_MAX * length_mm);
    if stop_mm <= 0.0 {
        return 0.0;
    }
    let (mut left_mm, mut taken_mm3) = (length_mm, 0.0);
    for curve in curves {
        let mut before: Option<([f64; CHANNELS], f64)> = None;
        for point in &mut curve.control {
            let whole = *point;
            if let Some((last, last_left_mm)) = before {
                left_mm = last_left_mm - (tip(&whole) - tip(&last)).norm();
                let laid_mm3 = whole[CHANNEL_VOLUME] - last[CHANNEL_VOLUME];
                taken_mm3 += laid_mm3 * (1.0 - mean_share(last_left_mm, left_mm, stop_mm));
            }
            before = Some((whole, left_mm));
            point[CHANNEL_VOLUME] -= taken_mm3;
        }
    }
    taken_mm3
}

/// The same at the end of each pass of a route that the next one does not continue.
pub fn stop_passes(route: &mut Route, settings: &Settings) {
    let stop_mm = settings.wide_beads.pump_stop_mm;
    let mut taken_mm3 = 0.0;
    for index in 0..route.moves.len() {
        let (before, rest) = route.moves.split_at_mut(index + 1);
        let own = &mut before[index];
        for point in &mut own.curve.control {
            point[CHANNEL_VOLUME] -= taken_mm3;
        }
        if own.state != MotionState::Print {
            continue;
        }
        let next = rest.iter().find(|next| next.state == MotionState::Print);
        if !next.is_some_and(|next| begins_above(&own.curve, &next.curve, settings)) {
            taken_mm3 += stopped_early(std::slice::from_mut(&mut own.curve), stop_mm);
        }
    }
}

/// True where a pass begins right above the end of another.
fn begins_above(curve: &PathCurve, next: &PathCurve, settings: &Settings) -> bool {
    let (Some(end), Some(begin)) = (curve.control.last(), next.control.first()) else {
        return false;
    };
    is_right_above(tip(begin).into(), tip(end).into(), settings)
}

/// Mean share of the flow between two places, by the path left to the pass's end: 1 up to 1.5 stops, 0 from half a stop.
fn mean_share(from_mm: f64, to_mm: f64, stop_mm: f64) -> f64 {
    // The flow's share over the path left, integrated from the end on.
    let laid = |left_mm: f64| {
        let x = (left_mm / stop_mm - 0.5).max(0.0);
        stop_mm * if x < 1.0 { 0.5 * x * x } else { x - 0.5 }
    };
    let way_mm = from_mm - to_mm;
    match way_mm > 1e-9 * stop_mm {
        true => (laid(from_mm) - laid(to_mm)) / way_mm,
        false => (from_mm / stop_mm - 0.5).clamp(0.0, 1.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use headway_protocol::units::CHANNEL_X;

    fn line(from_mm: f64, to_mm: f64, spans: usize) -> PathCurve {
        let control = (0..=spans).map(|i| {
            let x = from_mm + (to_mm - from_mm) * i as f64 / spans as f64;
            let mut point = [0.0; CHANNELS];
            (point[CHANNEL_X], point[CHANNEL_VOLUME]) = (x, 480.0 * x);
            point
        });
        PathCurve {
            control: control.collect(),
        }
    }

    /// Goal: what is taken is the bead of the stop's length, the flow before it stays and the last half of a stop has none.
    /// Method: a straight bead of 480 mm² over 1 m in two curves, by hand; coarse spans take the same.
    #[test]
    fn the_volume_of_the_stop_is_left_to_the_pump() {
        for spans in [1000, 7] {
            let mut curves = [line(0.0, 700.0, spans), line(700.0, 1000.0, spans)];
            let taken_mm3 = stopped_early(&mut curves, 80.0);
            assert!((taken_mm3 - 480.0 * 80.0).abs() < 1e-6, "{taken_mm3}");
            let end = curves[1].control[spans][CHANNEL_VOLUME];
            assert!((end - 480.0 * 920.0).abs() < 1e-6);
            let volumes = curves.iter().flat_map(|curve| &curve.control);
            let volumes: Vec<[f64; 2]> =
                volumes.map(|p| [p[CHANNEL_X], p[CHANNEL_VOLUME]]).collect();
            for pair in volumes.windows(2) {
                assert!(pair[1][1] >= pair[0][1]);
            }
            for [x, volume] in volumes {
                match x {
                    x if x <= 880.0 => assert!((volume - 480.0 * x).abs() < 1e-6),
                    x if x >= 960.0 => assert!((volume - end).abs() < 1e-6, "{x} {volume}"),
                    _ => assert!(volume < 480.0 * x),
                }
            }
        }
    }

    /// Goal: a pass shorter than the stop still lays half of its bead. Method: 10 mm with a stop of 80.
    #[test]
    fn a_short_pass_keeps_half_of_its_volume() {
        let mut curves = [line(0.0, 10.0, 10)];
        let taken_mm3 = stopped_early(&mut curves, 80.0);
        assert!((taken_mm3 - 480.0 * 5.0).abs() < 1e-6, "{taken_mm3}");
    }
}
