//! The built-in machines: what `headway` plans for without `-m`, and what `machine new` writes.
//!
//! Every number is a common printer's: 1.8° motors with 16 microsteps on GT2 belts (80 steps/mm),
//! a geared direct extruder on 1.75 mm filament, a hot end for 0.4 mm wide to 1.2 mm wide beads.

use super::obstacles::Obstacles;
use super::{
    AXIS_TOLERANCE_RAD, HeadingLaw, PassMode, Place, PrimeRetract, Quality, Seam, SeamPlace,
    Settings, Skirt, Tolerances,
};
use crate::geometry::aperture::Aperture;
use headway_firmware::configuration::drivers::DriversConfiguration;
use headway_firmware::configuration::flow_curves::FlowCurves;
use headway_firmware::configuration::motors::{MotorMatrix, MotorPair};
use headway_firmware::configuration::shaping::UNSHAPED;
use headway_firmware::configuration::wiring::Wiring;
use headway_firmware::configuration::{
    ExtruderConfiguration, JointConfiguration, Kinematics, MachineConfiguration,
};
use std::f64::consts::TAU;

/// Work area of both built-in machines, mm.
const WORK_AREA_MM: [[f64; 3]; 2] = [[0.0, 0.0, 0.0], [250.0, 250.0, 200.0]];
/// What the joints can move beyond the work area on either side, mm: room for the purge corner.
const MARGIN_MM: f64 = 5.0;
/// Distance from the tip to the crossing of the A and B axes of the built-in gantry, mm.
const PIVOT_LENGTH_MM: f64 = 60.0;
/// How far the head of the built-in gantry tilts, degrees.
const TILT_MAX_DEG: f64 = 60.0;

/// What a nozzle for such beads lays.
pub(super) const LAYER_HEIGHT_MM: f64 = 0.2;
/// Below what any printer shows; corners stay as they are.
pub(super) const TOLERANCES: Tolerances = Tolerances {
    outside_mm: 0.001,
    tip_mm: 0.001,
    axis_rad: 1e-4,
    heading_rad: 2e-4,
    flatten_mm: 0.001,
    corner_mm: 0.0,
};

impl Default for Settings {
    /// The built-in planar machine with a 0.6 x 0.2 mm ellipse.
    fn default() -> Settings {
        Settings::planar()
    }
}

/// 0.6 mm of 1.75 mm filament.
const PRIME_RETRACT: PrimeRetract = PrimeRetract {
    retract_mm3: 1.5,
    retract_rate_mm3_s: 30.0,
    retract_lead_s: 0.02,
    prime_mm3: 1.5,
    prime_rate_mm3_s: 30.0,
    prime_lead_s: 0.02,
};

impl Settings {
    /// X Y Z and a nozzle that turns without a stop.
    pub fn planar() -> Settings {
        // 3200 microsteps a motor turn, belt 3 : 1; 3 turns a second, as small slip rings allow.
        let nozzle = turning(9600.0, None, 1080.0, 20_000.0, 2.0e6);
        let [x, y, z] = cartesian(0.0);
        Settings::of_machine(
            "planar",
            machine(Kinematics::Planar, &[x, y, z, nozzle]),
            WORK_AREA_MM,
        )
    }

    /// The planar machine on two belts, with a second motor that lifts Z.
    pub fn core_xy() -> Settings {
        let mut settings = Settings::planar();
        settings.machine_name = "corexy".to_string();
        settings.machine.motors = MotorMatrix {
            pair: Some(MotorPair {
                joints: [0, 1],
                // At 45° a motor turns by 1.41 times what the head moves; it gives a little more than one axis asks.
                speed_max: 300.0,
                acceleration_max: 4000.0,
                jerk_max: 4.0e5,
            }),
            copies: [2].into_iter().collect(),
        };
        settings
    }

    /// X Y Z, a head that tilts about X (A) and Y (B), and a slower nozzle axis (C).
    pub fn gantry() -> Settings {
        // X, Y and Z follow the pivot, which moves by up to its length when the head tilts.
        let [x, y, z] = cartesian(PIVOT_LENGTH_MM);
        let tilt = turning(16_000.0, Some(TILT_MAX_DEG), 180.0, 3_000.0, 3.0e5);
        let nozzle = turning(9600.0, None, 540.0, 8_000.0, 8.0e5);
        let kinematics = Kinematics::Gantry {
            pivot_length_mm: PIVOT_LENGTH_MM,
        };
        Settings::of_machine(
            "gantry",
            machine(kinematics, &[x, y, z, tilt, tilt, nozzle]),
            WORK_AREA_MM,
        )
    }

    /// Default process settings on the given machine.
    fn of_machine(
        name: &str,
        machine: MachineConfiguration,
        work_area_mm: [[f64; 3]; 2],
    ) -> Settings {
        Settings {
            machine_name: name.to_string(),
            machine,
            work_area_mm,
            at_mm: None,
            gap_mm: None,
            place: Place::default(),
            axis_tolerance_rad: AXIS_TOLERANCE_RAD,
            tilt_max_rad: None,
            aperture: Aperture::Ellipse {
                major_mm: 0.6,
                minor_mm: 0.2,
            },
            layers: 1,
            layer_height_mm: LAYER_HEIGHT_MM,
            speed_mm_s: 60.0,
            travel_speed_mm_s: 150.0,
            tip_acceleration_mm_s2: 3000.0,
            lift_mm: 0.4,
            flow_factor: 1.0,
            // 1.2 mm x 0.2 mm at 150 mm/s is 36 mm³/s: a high-flow melt zone.
            flow_max_mm3_s: 40.0,
            // The widest bead at full tip acceleration asks for 720 mm³/s², turning for more.
            flow_rate_of_change_max_mm3_s2: 2000.0,
            prime_retract: PRIME_RETRACT,
            plan_share: 0.95,
            overlap_pct: 0.0,
            pass_mode: PassMode::Two,
            heading_law: HeadingLaw::Tangent,
            quality: Quality::default(),
            infill: None,
            skirt: Skirt {
                loops: 0,
                brim_loops: 0,
                // Two beads and more, so that the loops do not stick to the part.
                distance_mm: 3.0,
            },
            nozzle_body_radius_mm: 0.0,
            head: None,
            obstacles: Obstacles::default(),
            avoid_crossing: false,
            kinds: super::kinds::Kinds::default(),
            bridge_max_mm: None,
            first_layer_height_mm: None,
            layer_time_min_s: 0.0,
            slow_speed_min_mm_s: 10.0,
            wide_beads: Default::default(),
            seam: Seam {
                place: SeamPlace::Nearest,
                // The far side of the machine.
                direction_rad: std::f64::consts::FRAC_PI_2,
            },
            tolerances: TOLERANCES,
            gcode_letters: None,
            gcode_axes: None,
            material: None,
            heaters: None,
            drivers: DriversConfiguration::none(),
            heading_motor: None,
            wrist: None,
            switches: None,
            hold: 0,
            wiring: Wiring::STANDARD,
            board: None,
            probe: None,
            pump: None,
            measure: None,
        }
    }
}

/// X, Y and Z over the work area, with `reach_mm` more on the sides.
fn cartesian(reach_mm: f64) -> [JointConfiguration; 3] {
    let [low, high] = WORK_AREA_MM;
    let belt = |axis: usize| JointConfiguration {
        rotary: false,
        steps_per_unit: 80.0,
        position_min: low[axis] - MARGIN_MM - reach_mm,
        position_max: high[axis] + MARGIN_MM + reach_mm,
        speed_max: 250.0,
        acceleration_max: 3000.0,
        jerk_max: 3.0e5,
    };
    let screw = JointConfiguration {
        rotary: false,
        steps_per_unit: 400.0,
        position_min: low[2] - MARGIN_MM - reach_mm,
        position_max: high[2] + MARGIN_MM,
        speed_max: 20.0,
        acceleration_max: 200.0,
        jerk_max: 2.0e4,
    };
    [belt(0), belt(1), screw]
}

/// A rotary joint; `reach_deg` is how far it turns either way, `None` for no stop.
fn turning(
    steps_per_turn: f64,
    reach_deg: Option<f64>,
    speed_deg_s: f64,
    acceleration_deg_s2: f64,
    jerk_deg_s3: f64,
) -> JointConfiguration {
    let reach_rad = reach_deg.map_or(f64::INFINITY, f64::to_radians);
    JointConfiguration {
        rotary: true,
        steps_per_unit: steps_per_turn / TAU,
        position_min: -reach_rad,
        position_max: reach_rad,
        speed_max: speed_deg_s.to_radians(),
        acceleration_max: acceleration_deg_s2.to_radians(),
        jerk_max: jerk_deg_s3.to_radians(),
    }
}

fn machine(kinematics: Kinematics, joints: &[JointConfiguration]) -> MachineConfiguration {
    MachineConfiguration {
        kinematics,
        joints: joints.iter().copied().collect(),
        shapers: UNSHAPED,
        extruder: ExtruderConfiguration {
            // 400 steps per mm of 1.75 mm filament (2.405 mm²).
            steps_per_mm3: 166.3,
            // 33 mm/s of filament: flow, advance and prime together.
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
