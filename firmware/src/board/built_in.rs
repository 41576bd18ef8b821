//! Built-in settings of the boards in this repository.

use crate::configuration::drivers::DriversConfiguration;
use crate::configuration::flow_curves::FlowCurves;
use crate::configuration::homing::HomingConfiguration;
use crate::configuration::motors::MotorMatrix;
use crate::configuration::shaping::UNSHAPED;
use crate::configuration::wiring::Wiring;
use crate::configuration::{
    ExtruderConfiguration, JointConfiguration, Kinematics, MachineConfiguration,
};
use crate::settings::store::SettingsStore;
use crate::settings::{BoardLimits, BoardSettings, record_hash};
use core::f64::consts::TAU;
use embedded_storage::nor_flash::NorFlash;
use heapless::Vec;

/// Switches of the emulated board: joint, at the upper end, and its distance in steps from the
/// position at power-on. Z moves up 5 mm, X and Y back 8 and 9 mm.
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
        shapers: UNSHAPED,
        extruder: ExtruderConfiguration {
            steps_per_mm3: 400.0,
            speed_max_mm3_s: 60.0,
            acceleration_max_mm3_s2: 3000.0,
            pressure_advance_s: 0.03,
            pressure_advance_window_ms: 40.0,
        },
        servo_hz: 2000,
        step_hz: 200_000,
        motors: MotorMatrix::DIRECT,
        curves: FlowCurves::NONE,
    }
}

/// What the file that `HEADWAY_MACHINE` named holds: a record of settings.
const BUILT_FOR: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/machine.bin"));

/// The settings of a board to flash: those in the file that `HEADWAY_MACHINE` named at build time (written by
/// `headway machine firmware`), or the built-in planar machine of the `headway` command, with the switches of
/// [`HomingConfiguration::standard`] and stand-alone drivers. `None` if the file contains nothing that can be
/// run.
pub fn built_for() -> Option<BoardSettings> {
    if !BUILT_FOR.is_empty() {
        return BoardSettings::decode(BUILT_FOR).ok();
    }
    let machine = built_in_planar();
    Some(BoardSettings {
        switches: HomingConfiguration::standard(&machine),
        machine,
        heaters: None,
        drivers: DriversConfiguration::none(),
        wiring: Wiring::STANDARD,
        board: None,
    })
}

/// The settings that a board uses: those in its flash, if it can run them, otherwise the built-in ones;
/// and the hash of the stored ones.
pub fn kept_settings<F: NorFlash>(
    store: &mut SettingsStore<F>,
    limits: &BoardLimits,
) -> Option<(BoardSettings, u32)> {
    let record = store.take()?;
    let settings = BoardSettings::decode(&record).ok()?;
    settings.check_for(limits).ok()?;
    Some((settings, record_hash(&record)))
}

/// The planar machine that is the default of the `headway` command: 250 x 250 x 200 mm, the nozzle
/// turning without a stop. A test compares the two.
pub fn built_in_planar() -> MachineConfiguration {
    let belt = JointConfiguration {
        rotary: false,
        steps_per_unit: 80.0,
        position_min: -5.0,
        position_max: 255.0,
        speed_max: 250.0,
        acceleration_max: 3000.0,
        jerk_max: 3.0e5,
    };
    let screw = JointConfiguration {
        steps_per_unit: 400.0,
        position_max: 205.0,
        speed_max: 20.0,
        acceleration_max: 200.0,
        jerk_max: 2.0e4,
        ..belt
    };
    let nozzle = JointConfiguration {
        rotary: true,
        steps_per_unit: 9600.0 / TAU,
        position_min: f64::NEG_INFINITY,
        position_max: f64::INFINITY,
        speed_max: 1080f64.to_radians(),
        acceleration_max: 20_000f64.to_radians(),
        jerk_max: 2.0e6f64.to_radians(),
    };
    MachineConfiguration {
        kinematics: Kinematics::Planar,
        joints: [belt, belt, screw, nozzle].into_iter().collect(),
        shapers: UNSHAPED,
        extruder: ExtruderConfiguration {
            steps_per_mm3: 166.3,
            speed_max_mm3_s: 80.0,
            acceleration_max_mm3_s2: 8000.0,
            pressure_advance_s: 0.03,
            pressure_advance_window_ms: 40.0,
        },
        servo_hz: 2000,
        step_hz: 200_000,
        motors: MotorMatrix::DIRECT,
        curves: FlowCurves::NONE,
    }
}
