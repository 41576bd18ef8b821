//! Why a route cannot be turned into motion, with a remedy.
//!
//! In: the result of a check, with the place. Out: [`MotionError`], whose text names both.

use crate::plan::progress::Stopped;
use crate::text::refusal::{Refusal, refusal};
use crate::text::short_number::told_apart;
use headway_firmware::kinematics::KinematicsError;

/// Why a route cannot be turned into motion.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MotionError {
    /// The caller has stopped planning.
    #[error(transparent)]
    Stopped(#[from] Stopped),
    /// Nothing that another head, place or turn is tried for.
    #[error(transparent)]
    Refused(#[from] Refusal),
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
}

/// The machine cannot take this pose.
pub fn no_pose(error: KinematicsError, at_mm: [f64; 3]) -> MotionError {
    let remedy = match error {
        KinematicsError::OutOfReach => "move the part (--at, --place best) or use a larger machine",
        _ => "tilt the tool less, or move the part with --at",
    };
    refusal!("{error} with the tip at {at_mm:.3?} mm (machine coordinates); {remedy}").into()
}

/// A limit is zero, negative or not finite.
pub fn bad_limit(name: &'static str) -> MotionError {
    refusal!("the limit {name} must be a positive number").into()
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
