//! What the boards of this repository have built in.

use crate::configuration::{
    ExtruderConfiguration, JointConfiguration, Kinematics, MachineConfiguration,
};
use heapless::Vec;

/// Switches of the emulated board: joint, at the upper end, and how many steps from where the
/// machine was switched on. Z goes up 5 mm, X and Y back 8 and 9 mm.
pub const EMULATED_SWITCHES_STEPS: [(u8, bool, i32); 3] =
    [(2, true, 2000), (0, false, -640), (1, false, -720)];

/// The machine that the emulated board pretends to drive: a planar one, XY 80 and Z 400 steps/mm,
/// the nozzle on 3200 microsteps with a 5:1 belt. Tests plan for the same numbers.
pub fn emulated_planar() -> MachineConfiguration {
    let linear = JointConfiguration {
        rotary: false,
        steps_per_unit: 80.0,
        position_min: -10.0,
        position_max: 310.0,
        speed_max: 200.0,
        acceleration_max: 3000.0,
        jerk_max: 300_000.0,
    };
    let lift = JointConfiguration {
        steps_per_unit: 400.0,
        speed_max: 20.0,
        acceleration_max: 200.0,
        jerk_max: 20_000.0,
        ..linear
    };
    let nozzle = JointConfiguration {
        rotary: true,
        steps_per_unit: 2_546.479_089_470_325,
        position_min: -1e6,
        position_max: 1e6,
        speed_max: 20.0,
        acceleration_max: 400.0,
        jerk_max: 40_000.0,
    };
    let mut joints = Vec::new();
    for joint in [linear, linear, lift, nozzle] {
        // Four joints fit by the type's bound.
        let _ = joints.push(joint);
    }
    MachineConfiguration {
        kinematics: Kinematics::Planar,
        joints,
        extruder: ExtruderConfiguration {
            steps_per_mm3: 400.0,
            speed_max_mm3_s: 60.0,
            acceleration_max_mm3_s2: 3000.0,
            pressure_advance_s: 0.03,
            pressure_advance_window_ms: 40.0,
        },
        servo_hz: 2000,
        step_hz: 200_000,
    }
}
