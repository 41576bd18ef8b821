//! Paths of files between the nozzle's stops, with as little room as they need there.

use super::PlanError;
use crate::plan::motion::motion_error::MotionError;
use crate::settings::Settings;

/// Room before the stops, rad, tried in this order: a path that just fits is not cut, and segments and corners may be off
/// by a little.
const ROOM_RAD: [f64; 3] = [0.0, 2e-3, 0.03];

/// What `planned` makes with the least room in which the nozzle keeps to its stops.
///
/// # Errors
/// Of the last attempt, or the first of another kind.
pub(super) fn with_stop_room<T>(
    settings: &Settings,
    planned: impl Fn(f64) -> Result<T, PlanError>,
) -> Result<T, PlanError> {
    let is_beyond = |error: &PlanError| match error {
        PlanError::Motion(MotionError::OutsideJointRange { name, .. }) => {
            settings.turning_joint_name() == Some(name)
        }
        _ => false,
    };
    let [least_rad, more_rad @ ..] = ROOM_RAD;
    let mut made = planned(least_rad);
    for room_rad in more_rad {
        if made.as_ref().err().is_some_and(is_beyond) {
            made = planned(room_rad);
        }
    }
    made
}
