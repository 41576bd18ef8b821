//! Why a route cannot be turned into motion, with a remedy.
//!
//! In: the result of a check, with the place. Out: [`MotionError`], whose text names both.

use crate::plan::progress::Stopped;
use crate::text::short_number::told_apart;
use headway_firmware::kinematics::KinematicsError;

/// Why a route cannot be turned into motion.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MotionError {
    /// The caller has stopped planning.
    #[error(transparent)]
    Stopped(#[from] Stopped),
    /// A joint would have to leave its range.
    #[error(
        "joint {name} would go to {}, with the tip at {at_mm:.3?} mm (machine coordinates); {}",
        place_in_range(*rotary, [*position, *minimum, *maximum]),
        range_hint(name, *rotary, maximum - minimum)
    )]
    OutsideJointRange {
        /// Joint number from 0.
        joint: usize,
        /// Its name in the machine file.
        name: &'static str,
        /// True where it turns.
        rotary: bool,
        /// Where it would be, mm or rad.
        position: f64,
        /// Lower end of its range.
        minimum: f64,
        /// Upper end of its range.
        maximum: f64,
        /// Tip position, machine coordinates.
        at_mm: [f64; 3],
    },
    /// The machine cannot take this pose.
    #[error(
        "{error} with the tip at {at_mm:.3?} mm (machine coordinates); {}",
        pose_hint(*error)
    )]
    Kinematics {
        /// The error of the pose.
        error: KinematicsError,
        /// Tip position, machine coordinates.
        at_mm: [f64; 3],
    },
    /// The joints cannot follow the path through a place where two axes line up.
    #[error(
        "joint {name} would have to turn by {:.0}° at once with the tip at {at_mm:.3?} mm (machine \
         coordinates), where two rotary axes line up; move or turn the part, or let the \
         tool axis be led past this direction (--axis-tolerance)", turn_rad.to_degrees()
    )]
    JointJump {
        /// Its name in the machine file.
        name: &'static str,
        /// How far, rad.
        turn_rad: f64,
        /// Tip position, machine coordinates.
        at_mm: [f64; 3],
    },
    /// A control point is not finite, or a move has none.
    #[error("move {route_move} of the route has no finite path; this is a fault of the planner")]
    NotFinite {
        /// Index in the route.
        route_move: usize,
    },
    /// A move does not begin where the one before it ended.
    #[error(
        "move {route_move} of the route begins {gap:.6} away from the end of the one before it"
    )]
    Gap {
        /// Index in the route.
        route_move: usize,
        /// Largest difference of a channel, mm, rad or mm³.
        gap: f64,
    },
    /// A limit is zero, negative or not finite.
    #[error("the limit {name} must be a positive number")]
    BadLimit {
        /// Which one.
        name: &'static str,
    },
    /// A move would take for ever.
    #[error(
        "the path that begins with the tip at {from_mm:.3?} mm (machine coordinates) would take \
         {duration_s:.0} s ({at_speed_s:.0} s at its speed), more than the {most_s:.0} s that can be \
         planned: {}",
        slow_hint(*at_speed_s, *most_s)
    )]
    TooSlow {
        /// How long it would take.
        duration_s: f64,
        /// The same if nothing but the tip's speed bound it.
        at_speed_s: f64,
        /// How long it may take.
        most_s: f64,
        /// Where it begins, machine coordinates.
        from_mm: [f64; 3],
    },
    /// A prime or retract is more than a message carries.
    #[error(
        "a prime or retract of {volume_mm3} mm³ is more than the {most_mm3} mm³ that one may have with this nozzle; \
         ask for less at a time"
    )]
    EventBeyondWire {
        /// Volume, mm³.
        volume_mm3: f64,
        /// The most, mm³.
        most_mm3: f64,
    },
    /// A prime or retract is beyond the extruder's limits by itself.
    #[error(
        "a prime or retract of {volume_mm3} mm³ in {duration_s} s asks {ratio:.2} times of what the \
         extruder may do; lower its rate or raise the extruder's limits"
    )]
    EventBeyondExtruder {
        /// Volume, mm³.
        volume_mm3: f64,
        /// Duration, s.
        duration_s: f64,
        /// Rate or acceleration against the planned share of the limit.
        ratio: f64,
    },
}

/// What to do about a pose without joints.
fn pose_hint(error: KinematicsError) -> &'static str {
    match error {
        KinematicsError::OutOfReach => "move the part (--at, --place best) or use a larger machine",
        _ => "tilt the tool less, or move the part with --at",
    }
}

/// What to do about a path that takes too long.
fn slow_hint(at_speed_s: f64, most_s: f64) -> &'static str {
    if at_speed_s > most_s {
        "raise the speed"
    } else {
        "raise the limit that is close to zero (a joint's or the flow's)"
    }
}

/// Where a joint would be, and its range, in the units of the machine file.
fn place_in_range(rotary: bool, values: [f64; 3]) -> String {
    let (unit, scale) = match rotary {
        true => ("°", 180.0 / std::f64::consts::PI),
        false => (" mm", 1.0),
    };
    let [position, minimum, maximum] = values.map(|value| value * scale);
    let position = told_apart(position, &[minimum, maximum], 3);
    format!("{position}{unit}, outside its range {minimum:.3}{unit} to {maximum:.3}{unit}")
}

/// Range in which every heading can be met, of a nozzle that is the same after half a turn, with room to turn back, rad.
const HEADING_ROOM_RAD: f64 = 200.0 * std::f64::consts::PI / 180.0;

/// What the user can do.
fn range_hint(joint_name: &str, rotary: bool, range: f64) -> &'static str {
    match (joint_name, rotary) {
        ("c", _) if range < HEADING_ROOM_RAD => {
            "passes are cut where the nozzle has to turn back, but for every heading it needs half a \
             turn and some 20° more: give it that range in the machine file"
        }
        ("c", _) => {
            "passes are cut where the nozzle has to turn back, but not where a file fixes a heading that no other \
             equals: change the headings there, or use a nozzle that is the same after half a turn"
        }
        (_, true) => "tilt the tool less there, turn the part, or move it (--at, --place best)",
        (_, false) => "move the part with --at or use a larger machine",
    }
}
