//! Singular directions, where two rotary axes line up: the path leads past them, or is slowed.
//!
//! In a singular direction of the tool (straight up on a turning table, along the forearm of an arm,
//! along X on a gantry) one joint is free, and near it that joint turns far for a small change. Passing
//! it at a distance only costs time: the time law slows the path. Passing through it requires a jump, and
//! the joint is undefined at an end in that direction. In: the passes of a run (mm, rad, machine
//! coordinates), and the permitted deviation of the tool axis (`--axis-tolerance`). Out: the passes led
//! past it, and their joint solution.
//!
//! ```text
//! tool axis about the singular direction (rad):   path through        led past it
//!                                               ─────────x─────────   ──────╮_╭──────
//! ```
//! Near the singular direction a vector of the tolerance's length is added to the tilt relative to it; it
//! begins along the tilt where the path enters and turns to the tilt where it leaves, so that the sum
//! never vanishes. It grows and turns by quintic steps over `RAMP_MM` on either side: the curve stays C²
//! and needs no finer spans. If neither slowing nor leading past is enough, and the caller permits more
//! passes, the head lifts off there ([`super::lift_off`]).

use crate::plan::motion::joint_turns::{fastest, follow};
use crate::plan::motion::lift_off::cut_at_the_pole;
use crate::plan::motion::motion_error::MotionError;
use crate::plan::route::curve_cuts::Cuts;
use crate::plan::route::moves::{PathCurve, Route, RouteMove, tilt};
use crate::plan::route::waypoint_route::waypoint_way;
use crate::settings::Settings;
use headway_firmware::configuration::Kinematics;
use headway_firmware::kinematics::pose::{Pose, tilt_of_axis, tool_axis};
use headway_firmware::kinematics::{forward, inverse};
use headway_protocol::units::{CHANNEL_TILT_X, CHANNEL_TILT_Y, CHANNELS};
use nalgebra::{Rotation3, Vector2, Vector3};
use std::f64::consts::{PI, TAU};

/// Path length over which the axis is moved off the path and back, mm: several spans of a waypoint
/// curve.
const RAMP_MM: f64 = 3.0;
/// A turn in place counts as this distance, mm per radian.
const LEVER_MM: f64 = 20.0;
/// What leading past must save before it is done where slowing alone is enough, s.
const WORTH_S: f64 = 0.5;
/// A direction near the singular one, rad: there an arm's first joints are determined.
const BESIDE_RAD: f64 = 0.01;
/// Joint 5 of an arm: straight, it lines up joints 4 and 6.
const WRIST: usize = 4;

type Point = [f64; CHANNELS];

/// The passes of a run, each as moves from rest to rest.
pub type Passes = Vec<Vec<PathCurve>>;

/// How a run passes its singular places.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SingularPlaces {
    /// Number of singular places within the tolerance of the path.
    pub places: usize,
    /// By how much the tool axis is led off the path at most, rad; 0 where the path is only slowed.
    pub led_by_rad: f64,
    /// Additional time of slowing over avoiding the place, s; `None` if slowing alone is not
    /// enough.
    pub slowing_s: Option<f64>,
    /// Number of lift-offs, and their total cost, s.
    pub lifts: usize,
    /// See `lifts`.
    pub lifting_s: f64,
}

/// A run's passes in the fastest variant that the joints can follow.
#[derive(Clone, Debug)]
pub struct PassedPlaces {
    /// The passes.
    pub passes: Passes,
    /// Where they were cut.
    pub cuts: Option<Cuts>,
    /// Their least time by the speeds of joints and tip, s.
    pub seconds: f64,
    /// Their singular places.
    pub singular: SingularPlaces,
}

/// The passes as they are, or led past singular places where that is needed or saves time, or cut there
/// as a last resort (`may_lift`).
///
/// # Errors
/// [`MotionError`] where no joint solution can follow.
pub fn passed_places(
    passes: &Passes,
    start: Point,
    settings: &Settings,
    may_lift: bool,
) -> Result<PassedPlaces, MotionError> {
    let way = |passes: &Passes| waypoint_way(passes.clone(), start, settings);
    let slowed = fastest(&way(passes), settings).map(|(_, followed)| followed.seconds);
    let best = least_led(passes, start, settings);
    let plain = |seconds: f64, places: usize, slowing_s: Option<f64>| PassedPlaces {
        passes: passes.clone(),
        cuts: None,
        seconds,
        singular: SingularPlaces {
            places,
            slowing_s,
            ..SingularPlaces::default()
        },
    };
    match (slowed, best) {
        (Ok(slowed), Some(led)) if slowed < led.seconds + WORTH_S => Ok(plain(
            slowed,
            led.singular.places,
            Some(slowed - led.seconds),
        )),
        (slowed, Some(led)) => Ok(PassedPlaces {
            singular: SingularPlaces {
                slowing_s: slowed.ok().map(|slowed| slowed - led.seconds),
                ..led.singular
            },
            ..led
        }),
        (Ok(slowed), None) => Ok(plain(slowed, 0, None)),
        (Err(error), None) if !may_lift => Err(error),
        (Err(error), None) => lifted_off(passes, start, settings).ok_or(error),
    }
}

/// The fastest of the joint solutions in which the passes come near singular places, with the passes
/// moved around these.
fn least_led(passes: &Passes, start: Point, settings: &Settings) -> Option<PassedPlaces> {
    let tolerance_rad = settings.axis_tolerance_rad;
    let mut best: Option<PassedPlaces> = None;
    for solution in 0..settings.machine.kinematics.solutions() {
        let kinematics = settings.machine.kinematics.with_solution(solution);
        let mut led = passes.clone();
        let places: usize = led
            .iter_mut()
            .map(|pass| lead_past(pass, &kinematics, tolerance_rad))
            .sum();
        if places == 0 {
            continue;
        }
        let mut with_it = settings.clone();
        with_it.machine.kinematics = kinematics;
        let followed = follow(&waypoint_way(led.clone(), start, settings), &with_it);
        if let Ok(followed) = followed
            && best
                .as_ref()
                .is_none_or(|best| followed.seconds < best.seconds)
        {
            let singular = SingularPlaces {
                places,
                led_by_rad: tolerance_rad,
                ..SingularPlaces::default()
            };
            best = Some(PassedPlaces {
                passes: led,
                cuts: None,
                seconds: followed.seconds,
                singular,
            });
        }
    }
    best
}

/// Whether two rotary axes of the machine line up where the tool is upright.
pub fn lines_up_upright(kinematics: &Kinematics) -> bool {
    match kinematics {
        Kinematics::Trunnion { .. } => true,
        Kinematics::Axes { axes, .. } => !axes.is_cone() && !axes.is_determined_upright(),
        _ => false,
    }
}

/// The passes cut at the pole of a tilting table, where the joints can follow then.
fn lifted_off(passes: &Passes, start: Point, settings: &Settings) -> Option<PassedPlaces> {
    if !lines_up_upright(&settings.machine.kinematics) {
        return None;
    }
    let cut = cut_at_the_pole(passes);
    let route = waypoint_way(cut.passes.clone(), start, settings);
    let (with_it, followed) = fastest(&route, settings).ok()?;
    // Moves between the parts of a cut pass: prime, retract and the travels.
    let mut lifting_s = 0.0;
    for pass in &cut.cuts.goes_on {
        let number = Some(*pass as u32);
        let begin = route.moves.iter().position(|m| m.pass == number)?;
        let is_print = |m: &RouteMove| m.pass.is_some();
        let before = route.moves[..begin].iter().rposition(is_print)? + 1;
        let between = Route {
            moves: route.moves[before..begin].to_vec(),
        };
        let dwells_s: f64 = between.moves.iter().map(|m| m.dwell_s).sum();
        lifting_s += dwells_s + follow(&between, &with_it).ok()?.seconds;
    }
    let singular = SingularPlaces {
        places: cut.cuts.goes_on.len(),
        lifts: cut.cuts.goes_on.len(),
        lifting_s,
        ..SingularPlaces::default()
    };
    Some(PassedPlaces {
        passes: cut.passes,
        cuts: Some(cut.cuts),
        seconds: followed.seconds,
        singular,
    })
}

/// The tool axis, from the tip, in which two rotary axes of the machine line up near this pose.
fn singular_axis(kinematics: &Kinematics, pose: &Point) -> Option<Vector3<f64>> {
    let axis = tool_axis(tilt(pose));
    match kinematics {
        Kinematics::Planar => None,
        Kinematics::Gantry { .. } => Some(Vector3::x() * axis.x.signum()),
        Kinematics::Trunnion { .. } => Some(Vector3::z()),
        Kinematics::Axes { axes, .. } => {
            let singular = Vector3::from(axes.singular_axis()?);
            Some(singular * singular.dot(&axis).signum())
        }
        Kinematics::Arm6 { arm, .. } => {
            let mut beside = *pose;
            beside[CHANNEL_TILT_X] += BESIDE_RAD;
            let mut joints = [pose, &beside].into_iter().find_map(|pose| {
                let joints = inverse(kinematics, &Pose::from_channels(pose)).ok()?;
                Some(joints.position)
            })?;
            let reversed = arm.reversed >> WRIST & 1 != 0;
            let straight_rad = arm.offset_rad[WRIST];
            joints[WRIST] = if reversed {
                -straight_rad
            } else {
                straight_rad
            };
            Some(forward(kinematics, &joints).tool_axis())
        }
    }
}

/// A control point of a pass.
struct Place {
    /// Path length from the pass's beginning, mm.
    way_mm: f64,
    /// From the singular direction's frame.
    to_machine: Rotation3<f64>,
    /// Tilt in that frame, rad.
    tilt: Vector2<f64>,
}

/// Leads a pass past the singular places within the tolerance; returns how many there are.
fn lead_past(pass: &mut [PathCurve], kinematics: &Kinematics, tolerance_rad: f64) -> usize {
    if tolerance_rad <= 0.0 {
        return 0;
    }
    let Some(places) = places(pass, kinematics) else {
        return 0;
    };
    let near = near_stretches(&places, tolerance_rad);
    if near.is_empty() {
        return 0;
    }
    let leads: Vec<Lead> = near
        .iter()
        .filter_map(|near| Lead::of(near, &places))
        .collect();
    let points = pass.iter_mut().flat_map(|curve| &mut curve.control);
    for (point, place) in points.zip(&places) {
        let by: Vector2<f64> = leads.iter().map(|lead| lead.at(place.way_mm)).sum();
        if by != Vector2::zeros() {
            let led = place.to_machine * tool_axis(place.tilt + tolerance_rad * by);
            let led = tilt_of_axis(&led);
            (point[CHANNEL_TILT_X], point[CHANNEL_TILT_Y]) = (led.x, led.y);
        }
    }
    leads.len()
}

/// The pass's control points about the singular direction; `None` if there is none.
fn places(pass: &[PathCurve], kinematics: &Kinematics) -> Option<Vec<Place>> {
    let mut places: Vec<Place> = Vec::new();
    let mut before: Option<Point> = None;
    for point in pass.iter().flat_map(|curve| &curve.control) {
        let step_mm = before.map_or(0.0, |before: Point| {
            let tip_mm = Vector3::from_fn(|i, _| point[i] - before[i]).norm();
            tip_mm + LEVER_MM * (tilt(point) - tilt(&before)).norm()
        });
        before = Some(*point);
        let singular = singular_axis(kinematics, point)?;
        // Tools point up: the opposite of Z is no direction of theirs.
        let to_machine = Rotation3::rotation_between(&Vector3::z(), &singular)?;
        places.push(Place {
            way_mm: places.last().map_or(0.0, |last| last.way_mm) + step_mm,
            tilt: tilt_of_axis(&(to_machine.inverse() * tool_axis(tilt(point)))),
            to_machine,
        });
    }
    Some(places)
}

/// Ranges of places that are within the tolerance, those closer than their ramps as one.
fn near_stretches(places: &[Place], tolerance_rad: f64) -> Vec<[usize; 2]> {
    let mut near: Vec<[usize; 2]> = Vec::new();
    for (index, pair) in places.windows(2).enumerate() {
        if least_tilt(pair[0].tilt, pair[1].tilt) >= tolerance_rad {
            continue;
        }
        match near.last_mut() {
            Some([_, end]) if places[index].way_mm - places[*end].way_mm < 2.0 * RAMP_MM => {
                *end = index + 1;
            }
            _ => near.push([index, index + 1]),
        }
    }
    near
}

/// Least distance of a straight step from the singular direction.
fn least_tilt(from: Vector2<f64>, to: Vector2<f64>) -> f64 {
    let step = to - from;
    let share = -from.dot(&step) / step.norm_squared().max(1e-30);
    (from + share.clamp(0.0, 1.0) * step).norm()
}

/// The tilt added around a stretch near a singular place, as a share of the tolerance.
struct Lead {
    /// Where it begins to increase, is complete, begins to decrease, has ended: path length, mm.
    ways_mm: [f64; 4],
    /// Direction where it begins, and by how much it turns, rad.
    from_rad: f64,
    turn_rad: f64,
}

impl Lead {
    /// `None` if the pass never leaves the singular direction: nothing turns there.
    fn of(&[first, last]: &[usize; 2], places: &[Place]) -> Option<Lead> {
        let begin = (places[first].way_mm > RAMP_MM)
            .then(|| places.partition_point(|place| place.way_mm < places[first].way_mm - RAMP_MM));
        let end_mm = places[last].way_mm + RAMP_MM;
        let end = places.partition_point(|place| place.way_mm < end_mm);
        let end = (end < places.len()).then_some(end);
        let direction = |index: usize| places[index].tilt.y.atan2(places[index].tilt.x);
        let directions = (begin.map(direction), end.map(direction));
        let (from_rad, turn_rad) = match directions {
            (None, None) => return None,
            (Some(only), None) | (None, Some(only)) => (only, 0.0),
            (Some(from), Some(to)) => (from, (to - from + PI).rem_euclid(TAU) - PI),
        };
        let (first_mm, last_mm) = (places[first].way_mm, places[last].way_mm);
        Some(Lead {
            ways_mm: [
                begin.map_or(f64::NEG_INFINITY, |begin| places[begin].way_mm),
                first_mm,
                last_mm,
                end.map_or(f64::INFINITY, |end| places[end].way_mm),
            ],
            from_rad,
            turn_rad,
        })
    }

    fn at(&self, way_mm: f64) -> Vector2<f64> {
        let [begin, whole, fade, end] = self.ways_mm;
        if way_mm <= begin || way_mm >= end {
            return Vector2::zeros();
        }
        let size = quintic_step(way_mm, begin, whole) * quintic_step(-way_mm, -end, -fade);
        let turned = match self.turn_rad {
            0.0 => 0.0,
            turn_rad => turn_rad * quintic_step(way_mm, begin, end),
        };
        let (sin, cos) = (self.from_rad + turned).sin_cos();
        size * Vector2::new(cos, sin)
    }
}

/// 0 up to `from`, 1 from `to` on, with first and second derivatives 0 at both.
fn quintic_step(at: f64, from: f64, to: f64) -> f64 {
    if from.is_infinite() || at >= to {
        return 1.0;
    }
    let s = ((at - from) / (to - from)).clamp(0.0, 1.0);
    s * s * s * (10.0 - s * (15.0 - 6.0 * s))
}
