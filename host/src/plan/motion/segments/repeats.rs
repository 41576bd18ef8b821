//! Moves that repeat an earlier one at another position: the same print on another layer.
//!
//! In: the route. Out: for each move an earlier one of the same shape, offset by a constant in
//! every channel; and the earlier one's spline with that offset. Timing and fitting a move takes
//! many rounds, an offset only one check, which [`super::shaping`] makes as for any other spline.

use super::spline::{RestSpline, quantised};
use crate::job::MotionState;
use crate::plan::route::moves::{Route, RouteMove};
use headway_protocol::units::{CHANNEL_X, CHANNEL_Y, CHANNELS, Units};
use std::collections::HashMap;
use std::hash::{DefaultHasher, Hash, Hasher};

/// Differences from a constant move that rounding explains, mm, rad or mm³ in base units: far below the wire's
/// resolution. Coarser units are of larger jobs, whose numbers round by more.
const MOVE_TOLERANCE: f64 = 1e-9;

/// For each move the first one that it repeats.
pub fn earlier_ones(route: &Route, units: &Units) -> Vec<Option<usize>> {
    let mut known: HashMap<u64, usize> = HashMap::new();
    let moves = route.moves.iter().enumerate();
    moves
        .map(|(index, route_move)| {
            if route_move.state != MotionState::Print {
                return None;
            }
            let first = *known.entry(course_hash(route_move)).or_insert(index);
            (first < index && is_repeated(route, first, index, units)).then_some(first)
        })
        .collect()
}

/// Of the places in the plane.
fn course_hash(route_move: &RouteMove) -> u64 {
    let mut hasher = DefaultHasher::new();
    for point in &route_move.curve.control {
        (point[CHANNEL_X].to_bits(), point[CHANNEL_Y].to_bits()).hash(&mut hasher);
    }
    hasher.finish()
}

/// True where a move is another one moved, with the same events in it and before it.
fn is_repeated(route: &Route, first: usize, index: usize, units: &Units) -> bool {
    let before = |index: usize| {
        let before = &route.moves[index.checked_sub(1)?];
        let is_dwell = before.curve.control.len() == 1;
        Some((before.state, before.event, before.dwell_s, is_dwell))
    };
    let (own, other) = (&route.moves[index], &route.moves[first]);
    let (points, others) = (&own.curve.control, &other.curve.control);
    let moved = |channel: usize, k: usize| points[k][channel] - others[k][channel];
    let is_constant = |channel: usize| {
        let whole = moved(channel, 0);
        let rounding = MOVE_TOLERANCE * units.base_units(channel);
        (0..points.len()).all(|k| (moved(channel, k) - whole).abs() <= rounding)
    };
    points.len() == others.len()
        && (own.event, own.dwell_s) == (other.event, other.dwell_s)
        && own.speed_mm_s == other.speed_mm_s
        && own.speeds_mm_s.is_empty()
        && other.speeds_mm_s.is_empty()
        && own.acceleration_mm_s2 == other.acceleration_mm_s2
        && before(index) == before(first)
        && (0..CHANNELS).all(is_constant)
}

/// The spline of move `first` moved to the start of `own`; it ends at the end of `own`, which may
/// differ from the moved end by one unit.
pub fn moved(spline: &RestSpline, first: &RouteMove, own: &RouteMove, units: &Units) -> RestSpline {
    let mut control = spline.control.clone();
    let ends = [own.curve.control.first(), own.curve.control.last()];
    if let ([Some(start), Some(end)], Some(from)) = (ends, first.curve.control.first()) {
        let (start, from) = (quantised(start, units), quantised(from, units));
        for point in &mut control {
            let place: [f64; CHANNELS] =
                std::array::from_fn(|channel| point[channel] + (start[channel] - from[channel]));
            *point = quantised(&place, units);
        }
        let rest = control.len().saturating_sub(3);
        control[rest..].fill(quantised(end, units));
    }
    RestSpline {
        durations_ticks: spline.durations_ticks.clone(),
        control,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::motion::segments::{MotionReport, lay_segments};
    use crate::settings::Settings;
    use headway_protocol::units::{CHANNEL_HEADING, CHANNEL_VOLUME, CHANNEL_Z, to_units};

    fn route_move(state: MotionState, layer: u32, control: Vec<[f64; CHANNELS]>) -> RouteMove {
        RouteMove {
            pass: (state == MotionState::Print).then_some(layer),
            ..RouteMove::new(state, layer, control)
        }
    }

    /// The same wave on each of the layers, entered half turns apart, its volume going on; `aside_mm`
    /// moves one place of the last.
    fn route(layers: u32, aside_mm: f64) -> Route {
        let mut moves: Vec<RouteMove> = Vec::new();
        let mut volume_mm3 = 0.3;
        for layer in 0..layers {
            let mut wave: Vec<[f64; CHANNELS]> = (0..=120)
                .map(|k| {
                    let along = f64::from(k) * 0.1;
                    let mut point = [20.0 + along, 30.0 + along.sin(), 0.0, 0.0, 0.0, 0.0, 0.0];
                    point[CHANNEL_Z] = 0.2 * f64::from(layer + 1);
                    point[CHANNEL_HEADING] = along.cos() + std::f64::consts::PI * f64::from(layer);
                    point[CHANNEL_VOLUME] = volume_mm3 + 0.123_456_789 * along;
                    point
                })
                .collect();
            if layer + 1 == layers {
                wave[60][1] += aside_mm;
            }
            let start = [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, volume_mm3];
            let before = moves.last().and_then(|s| s.curve.control.last());
            let way = vec![*before.unwrap_or(&start), wave[0]];
            moves.push(route_move(MotionState::Travel, layer, way));
            volume_mm3 = wave[120][CHANNEL_VOLUME];
            moves.push(route_move(MotionState::Print, layer, wave));
        }
        Route { moves }
    }

    /// Goal: what repeats is found, and runs as the first did to a unit at its end; what is elsewhere
    /// by a hundred nanometres is not. Method: three layers of a wave; knots of each print move.
    #[test]
    fn a_print_on_another_layer_runs_as_the_first_did() {
        let settings = Settings::default();
        let same = route(3, 0.0);
        let first = Some(1);
        assert_eq!(
            earlier_ones(&same, &Units::default()),
            [None, None, None, first, None, first]
        );
        let aside = route(3, 1e-4);
        assert_eq!(
            earlier_ones(&aside, &Units::default()),
            [None, None, None, first, None, None]
        );
        let (stream, report) = lay_segments(&same, &settings).expect("segments");
        assert!(report.ratios.speed <= 1.0 && report.ratios.acceleration <= 1.0);
        assert_ne!(report, MotionReport::default());
        // Jerk takes some of the time, not most of it.
        let share = report.time_bound_s / report.duration_s;
        assert!((0.5..1.0).contains(&share), "{share}");
        let prints = stream
            .marks
            .iter()
            .filter(|m| m.state == MotionState::Print);
        let times: Vec<u64> = prints.map(|m| m.end_tick - m.start_tick).collect();
        assert_eq!(times, [times[0]; 3]);
        // A move alone is laid as the first of three.
        let (alone, _) = lay_segments(&route(1, 0.0), &settings).expect("segments");
        let count = alone.knots.len() - 6;
        assert_eq!(stream.knots[..count], alone.knots[..count]);
        // The last layer ends on its own last place.
        let last = same.moves[5].curve.control[120];
        let found = stream.knots.last().expect("knots").control;
        assert_eq!(found, to_units(&last));
    }
}
