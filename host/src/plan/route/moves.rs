//! The route: all moves of the head, in order, as C² curves from rest to rest.
//!
//! In and out: the types that the route and the motion stage share; mm, rad, mm³.

use crate::job::MotionState;
use headway_protocol::units::{CHANNEL_TILT_X, CHANNEL_TILT_Y, CHANNEL_X, CHANNELS};
use nalgebra::{Vector2, Vector3};

/// A path in channel space (mm, mm, mm, rad, rad, rad, mm³; heading unwrapped): the uniform cubic
/// B-spline of these control points with natural ends (phantom points P_{-1} = 2 P_0 - P_1), so it
/// starts and ends on the first and last point. Path parameter u runs from 0 to len - 1, one span
/// for each pair of control points. One point alone is a dwell.
#[derive(Clone, Debug, PartialEq)]
pub struct PathCurve {
    /// Control points.
    pub control: Vec<[f64; CHANNELS]>,
}

/// One rest-to-rest move of the route.
#[derive(Clone, Debug, PartialEq)]
pub struct RouteMove {
    /// Its kind.
    pub state: MotionState,
    /// Layer from 0.
    pub layer: u32,
    /// Pass number over the complete job, if it belongs to one.
    pub pass: Option<u32>,
    /// Its path. Prime and hold moves are dwells of `dwell_s`.
    pub curve: PathCurve,
    /// Least duration; the only duration of a dwell.
    pub dwell_s: f64,
    /// Tip speed of its own, below that of its state, mm/s.
    pub speed_mm_s: Option<f64>,
    /// Requested tip speeds along it: path parameter, increasing, and mm/s; linear in between. Empty if
    /// there are none.
    pub speeds_mm_s: Vec<[f64; 2]>,
    /// Tip acceleration of its own, below that of its state, mm/s².
    pub acceleration_mm_s2: Option<f64>,
    /// The layers of a move that prints several without a rest, upwards; empty if it prints one.
    pub parts: Vec<LayerPart>,
    /// Flow event that starts with the move (prime), or so long before its end (retract).
    pub event: Option<MoveEvent>,
}

impl RouteMove {
    /// A move of a layer through control points, as fast as its state may; one point is a dwell.
    pub fn new(state: MotionState, layer: u32, control: Vec<[f64; CHANNELS]>) -> RouteMove {
        RouteMove {
            state,
            layer,
            pass: None,
            curve: PathCurve { control },
            dwell_s: 0.0,
            speed_mm_s: None,
            speeds_mm_s: Vec::new(),
            acceleration_mm_s2: None,
            parts: Vec::new(),
            event: None,
        }
    }
}

/// A layer of a move that prints several, rising all along.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LayerPart {
    /// Layer from 0.
    pub layer: u32,
    /// Its pass.
    pub pass: Option<u32>,
    /// Tip height at which it ends, mm.
    pub end_z_mm: f64,
}

/// A prime or retract tied to a move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MoveEvent {
    /// Starts with the move (a `Prime` dwell whose `dwell_s` is the duration less the lead).
    PrimeAtStart {
        /// Volume, mm³.
        volume_mm3: f64,
        /// Duration of the push, s.
        duration_s: f64,
    },
    /// Starts `lead_s` before the move's end (a `Print` move; the retract runs on into the
    /// `Retract` dwell that follows).
    RetractBeforeEnd {
        /// Volume, mm³.
        volume_mm3: f64,
        /// Duration of the pull, s.
        duration_s: f64,
        /// How long before the end it begins, s.
        lead_s: f64,
    },
}

/// The complete route, in machine coordinates.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Route {
    /// Moves in order; each begins at the end of the previous one.
    pub moves: Vec<RouteMove>,
}

impl Route {
    /// Its end; `None` if it is empty.
    pub fn end(&self) -> Option<[f64; CHANNELS]> {
        self.moves.last()?.curve.control.last().copied()
    }
}

/// The tip of a pose in channel space, mm.
pub fn tip(pose: &[f64; CHANNELS]) -> Vector3<f64> {
    Vector3::from_fn(|i, _| pose[CHANNEL_X + i])
}

/// Path length of the tip along these points, mm.
pub fn way_mm(control: &[[f64; CHANNELS]]) -> f64 {
    let legs = control.windows(2);
    legs.map(|pair| (tip(&pair[1]) - tip(&pair[0])).norm())
        .sum()
}

/// Path length of the tip from the first of these points to each, mm.
pub fn ways_mm(control: &[[f64; CHANNELS]]) -> Vec<f64> {
    let mut ways_mm = vec![0.0; control.len()];
    for k in 1..control.len() {
        ways_mm[k] = ways_mm[k - 1] + (tip(&control[k]) - tip(&control[k - 1])).norm();
    }
    ways_mm
}

/// The tilt of a pose in channel space, rad.
pub fn tilt(pose: &[f64; CHANNELS]) -> Vector2<f64> {
    Vector2::new(pose[CHANNEL_TILT_X], pose[CHANNEL_TILT_Y])
}
