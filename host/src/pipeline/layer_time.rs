//! Prints short layers slower, so that each has time to cool.
//!
//! In: a route at full speed; the minimum time of a layer (s) and the minimum speed (mm/s). Out: the
//! stream with the passes of short layers slowed, and the number of these layers. Only the speed is
//! reduced: there are no waits, since a waiting nozzle oozes. Not covered: fans.

use crate::job::{MotionState, SegmentStream};
use crate::plan::motion::motion_error::MotionError;
use crate::plan::motion::segments::{MotionReport, lay_segments_with_progress};
use crate::plan::progress::Progress;
use crate::plan::route::moves::{Route, way_mm};
use crate::plan::route::wide_beads::continuous::joined;
use crate::plan::route::wide_beads::pump::stop_passes;
use crate::settings::Settings;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Layers that were slowed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SlowedLayers {
    /// How many.
    pub layers: u32,
    /// Those of them that are over too soon even at the least speed.
    pub still_short: u32,
}

/// Segments of a route whose layers have the requested minimum time.
///
/// # Errors
/// [`MotionError`].
pub(crate) fn lay_with_layer_times(
    route: &mut Route,
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<(SegmentStream, MotionReport, SlowedLayers), MotionError> {
    let (stream, report) = lay(route, settings, progress)?;
    let slowed = slow_short_layers(route, &stream, settings);
    if slowed == SlowedLayers::default() {
        return Ok((stream, report, slowed));
    }
    let (stream, report) = lay(route, settings, progress)?;
    Ok((stream, report, slowed))
}

/// Segments of a route: with consecutive loops joined, and passes ended by a pump that runs on, if requested.
fn lay(
    route: &Route,
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<(SegmentStream, MotionReport), MotionError> {
    let wide = &settings.wide_beads;
    let joined = wide.continuous_z.then(|| joined(route, settings)).flatten();
    if wide.pump_stop_mm <= 0.0 {
        let route = joined.as_ref().unwrap_or(route);
        return lay_segments_with_progress(route, settings, progress);
    }
    let mut route = joined.unwrap_or_else(|| route.clone());
    stop_passes(&mut route, settings);
    lay_segments_with_progress(&route, settings, progress)
}

/// Slows the passes of short layers: at this speed all along they take the time that is wanted, and
/// where they are slower anyway a little more.
fn slow_short_layers(
    route: &mut Route,
    stream: &SegmentStream,
    settings: &Settings,
) -> SlowedLayers {
    let mut slowed = SlowedLayers::default();
    let least_s = settings.layer_time_min_s;
    if least_s <= 0.0 {
        return slowed;
    }
    let servo_hz = f64::from(settings.machine.servo_hz);
    // For each layer its total time, that of its passes, and their length.
    let mut layers: BTreeMap<u32, [f64; 3]> = BTreeMap::new();
    for mark in &stream.marks {
        let seconds = (mark.end_tick - mark.start_tick) as f64 / servo_hz;
        let of_layer = layers.entry(mark.layer).or_default();
        of_layer[0] += seconds;
        if mark.state == MotionState::Print {
            of_layer[1] += seconds;
        }
    }
    let printed = route.moves.iter();
    for route_move in printed.filter(|route_move| route_move.state == MotionState::Print) {
        layers.entry(route_move.layer).or_default()[2] += way_mm(&route_move.curve.control);
    }
    let mut speeds: BTreeMap<u32, f64> = BTreeMap::new();
    for (layer, [all_s, print_s, way_mm]) in layers {
        if all_s >= least_s || print_s <= 0.0 {
            continue;
        }
        let wanted_mm_s = way_mm / (print_s + least_s - all_s);
        let slowest_mm_s = settings.slow_speed_min_mm_s;
        slowed.layers += 1;
        slowed.still_short += u32::from(wanted_mm_s < slowest_mm_s);
        speeds.insert(layer, wanted_mm_s.max(slowest_mm_s));
    }
    for route_move in &mut route.moves {
        let is_print = route_move.state == MotionState::Print;
        if let (true, Some(&speed_mm_s)) = (is_print, speeds.get(&route_move.layer)) {
            let own_mm_s = route_move.speed_mm_s.unwrap_or(f64::INFINITY);
            route_move.speed_mm_s = Some(own_mm_s.min(speed_mm_s));
        }
    }
    slowed
}
