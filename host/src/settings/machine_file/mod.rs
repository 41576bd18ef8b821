//! The machine file: TOML text <-> [`Settings`].
//!
//! A file for people: angles in degrees, steps by the turn, comments at every group. Unknown keys
//! are refused with their line, because a misspelt limit would otherwise be no limit. `name`,
//! `kinematics`, `work_area`, `joints` and `extruder` must be there; the other groups and their
//! keys default to the built-in machine's. This file is the only place where degrees become
//! radians.

use super::aperture_text::{ApertureTextError, parse_aperture};
use super::check::joint_names;
use super::error::SettingsError;
use super::{
    HeadingLaw, Infill, PassMode, PrimeRetract, Quality, Seam, SeamPlace, Settings, Skirt,
    Tolerances,
};
use crate::settings::axes_words::AxesError;
use head::FileHead;
use headway_firmware::configuration::board_name::BoardName;
use headway_firmware::configuration::heat::HeatConfiguration;
use headway_firmware::configuration::homing::HomingConfiguration;
use headway_firmware::configuration::{ExtruderConfiguration, MachineConfiguration};
use serde::Deserialize;

mod axes;
mod drivers;
mod gcode;
mod head;
mod heat;
mod joints;
mod kinds;
mod motors;
mod probe;
mod shaper;
mod switches;
mod wide_beads;
mod wiring;
mod write;
use axes::FileKinematics;
use drivers::FileDriver;
use gcode::FileGcode;
pub use gcode::gcode_letters;
use heat::{FileHeaters, FileMaterial};
pub use heat::{write_heater, write_heaters};
use joints::{FileArm, Joints};
use kinds::FileKinds;
use motors::FileMotors;
use probe::FileProbe;
use shaper::FileShaper;
use std::collections::BTreeMap;
use switches::FileSwitch;
use wiring::FileWiring;
pub use write::{to_new_toml, to_toml};

/// Why a machine file cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MachineFileError {
    /// Not TOML, an unknown or missing key, or a value of the wrong type.
    #[error("{0}")]
    Toml(String),
    /// A joint that the kinematics has is not given, or one that it has not is.
    #[error("kinematics \"{kinematics}\" needs {needed}; {problem}")]
    Joints {
        /// Kinematics by name.
        kinematics: &'static str,
        /// What it needs.
        needed: &'static str,
        /// What is wrong with what is given.
        problem: String,
    },
    /// A shaper for a joint that the kinematics have not.
    #[error("shaper.{joint}: kinematics \"{kinematics}\" have no such joint; take the group out")]
    Shaper {
        /// The joint.
        joint: String,
        /// Kinematics by name.
        kinematics: &'static str,
    },
    /// Letters of axes that are none.
    #[error(
        "gcode.letters: \"{0}\": write three different letters of A, B, C, U, V, W, H, J, as in \"A,B,C\""
    )]
    Letters(String),
    /// Axes of the files that are read.
    #[error("gcode.axes: {0}")]
    Axes(#[from] AxesError),
    /// The aperture cannot be read.
    #[error("print.aperture: {0}")]
    Aperture(#[from] ApertureTextError),
    /// Values out of range or at odds.
    #[error("{0}")]
    Settings(#[from] SettingsError),
}

/// Longest line of a machine file that is shown with its fault: a file that is none may have one line of megabytes.
const LINE_SHOWN_CHARS_MAX: usize = 200;

/// What the parser says, with the line; without it where that is no line to read.
fn toml_problem(text: &str, error: &toml::de::Error) -> String {
    let whole = error.to_string().trim_end().to_string();
    let longest = whole.lines().map(|line| line.chars().count()).max();
    if longest.is_none_or(|chars| chars <= LINE_SHOWN_CHARS_MAX) {
        return whole;
    }
    let before = error.span().and_then(|span| text.get(..span.start));
    let line = before.unwrap_or_default().matches('\n').count() + 1;
    format!(
        "line {line} is no line of a machine file: {}; `headway machine new` writes one",
        error.message()
    )
}

/// Reads and checks a machine file.
pub fn from_toml(text: &str) -> Result<Settings, MachineFileError> {
    let file: File =
        toml::from_str(text).map_err(|error| MachineFileError::Toml(toml_problem(text, &error)))?;
    let settings = file.into_settings()?;
    settings.check()?;
    Ok(settings)
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    name: String,
    board: Option<String>,
    kinematics: FileKinematics,
    pivot_length_mm: Option<f64>,
    table_centre_mm: Option<[f64; 3]>,
    arm: Option<FileArm>,
    joint_solution: Option<u8>,
    servo_hz: Option<u32>,
    step_hz: Option<u32>,
    plan_share: Option<f64>,
    work_area: WorkArea,
    joints: Joints,
    motors: Option<FileMotors>,
    #[serde(default)]
    shaper: BTreeMap<String, FileShaper>,
    extruder: Extruder,
    head: Option<FileHead>,
    #[serde(default)]
    print: Print,
    #[serde(default)]
    flow: Flow,
    infill: Option<FileInfill>,
    #[serde(default)]
    kinds: FileKinds,
    #[serde(default)]
    skirt: FileSkirt,
    #[serde(default)]
    tolerances: FileTolerances,
    material: Option<FileMaterial>,
    heaters: Option<FileHeaters>,
    #[serde(default)]
    gcode: FileGcode,
    #[serde(default)]
    drivers: BTreeMap<String, FileDriver>,
    switches: Option<BTreeMap<String, FileSwitch>>,
    #[serde(default)]
    wiring: FileWiring,
    probe: Option<FileProbe>,
}

#[derive(Clone, Copy, Deserialize, PartialEq)]
#[serde(rename_all = "lowercase")]
enum KinematicsName {
    Planar,
    Gantry,
    Trunnion,
    Arm6,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WorkArea {
    min_mm: [f64; 3],
    max_mm: [f64; 3],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Extruder {
    steps_per_mm3: f64,
    speed_max_mm3_s: f64,
    acceleration_max_mm3_s2: f64,
    pressure_advance_s: Option<f64>,
    pressure_advance_window_ms: Option<f64>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Print {
    aperture: Option<String>,
    layers: Option<u32>,
    layer_height_mm: Option<f64>,
    speed_mm_s: Option<f64>,
    travel_speed_mm_s: Option<f64>,
    tip_acceleration_mm_s2: Option<f64>,
    lift_mm: Option<f64>,
    overlap_pct: Option<f64>,
    nozzle_body_radius_mm: Option<f64>,
    avoid_crossing: Option<bool>,
    seam: Option<SeamPlace>,
    seam_direction_deg: Option<f64>,
    pass: Option<PassMode>,
    law: Option<HeadingLaw>,
    quality: Option<Quality>,
    layer_time_min_s: Option<f64>,
    slow_speed_min_mm_s: Option<f64>,
    outer_inner_ratio_max: Option<f64>,
    layer_time_max_s: Option<f64>,
    continuous_z: Option<bool>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Flow {
    factor: Option<f64>,
    flow_max_mm3_s: Option<f64>,
    rate_of_change_max_mm3_s2: Option<f64>,
    retract_mm3: Option<f64>,
    retract_rate_mm3_s: Option<f64>,
    retract_lead_s: Option<f64>,
    prime_mm3: Option<f64>,
    prime_rate_mm3_s: Option<f64>,
    prime_lead_s: Option<f64>,
    pump_start_mm: Option<f64>,
    pump_stop_mm: Option<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct FileInfill {
    walls: u32,
    density_pct: Option<f64>,
    angle_deg: Option<f64>,
    bottom_layers: Option<u32>,
    top_layers: Option<u32>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct FileSkirt {
    loops: Option<u32>,
    brim_loops: Option<u32>,
    distance_mm: Option<f64>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct FileTolerances {
    outside_mm: Option<f64>,
    tip_mm: Option<f64>,
    axis_mrad: Option<f64>,
    heading_mrad: Option<f64>,
    flatten_mm: Option<f64>,
    corner_mm: Option<f64>,
}

impl File {
    fn into_settings(self) -> Result<Settings, MachineFileError> {
        let default = Settings::default();
        let machine = self.machine(&default.machine)?;
        let (print, flow) = (&self.print, &self.flow);
        let aperture = match &print.aperture {
            Some(text) => parse_aperture(text)?,
            None => default.aperture,
        };
        Ok(Settings {
            machine_name: self.name.clone(),
            drivers: drivers::drivers(&self.drivers, &machine)?,
            heading_motor: drivers::heading_motor(&self.drivers, &machine)?,
            switches: self.switches(&machine)?,
            wiring: self.wiring.wiring(&machine)?,
            board: self.board()?,
            probe: self.probe.as_ref().map(FileProbe::probe),
            machine,
            work_area_mm: [self.work_area.min_mm, self.work_area.max_mm],
            aperture,
            layers: print.layers.unwrap_or(default.layers),
            layer_height_mm: print.layer_height_mm.unwrap_or(default.layer_height_mm),
            speed_mm_s: print.speed_mm_s.unwrap_or(default.speed_mm_s),
            travel_speed_mm_s: print.travel_speed_mm_s.unwrap_or(default.travel_speed_mm_s),
            tip_acceleration_mm_s2: print
                .tip_acceleration_mm_s2
                .unwrap_or(default.tip_acceleration_mm_s2),
            lift_mm: print.lift_mm.unwrap_or(default.lift_mm),
            gcode_letters: self.gcode.letters()?,
            gcode_axes: self.gcode.axes()?,
            flow_factor: flow.factor.unwrap_or(default.flow_factor),
            flow_max_mm3_s: flow.flow_max_mm3_s.unwrap_or(default.flow_max_mm3_s),
            flow_rate_of_change_max_mm3_s2: flow
                .rate_of_change_max_mm3_s2
                .unwrap_or(default.flow_rate_of_change_max_mm3_s2),
            prime_retract: flow.prime_retract(&default.prime_retract),
            plan_share: self.plan_share.unwrap_or(default.plan_share),
            overlap_pct: print.overlap_pct.unwrap_or(default.overlap_pct),
            pass_mode: print.pass.unwrap_or(default.pass_mode),
            heading_law: print.law.unwrap_or(default.heading_law),
            quality: print.quality.unwrap_or(default.quality),
            infill: self.infill.as_ref().map(FileInfill::infill),
            skirt: self.skirt.over(&default.skirt),
            nozzle_body_radius_mm: print
                .nozzle_body_radius_mm
                .unwrap_or(default.nozzle_body_radius_mm),
            head: self.head.as_ref().map(FileHead::shape).transpose()?,
            obstacles: default.obstacles.clone(),
            avoid_crossing: print.avoid_crossing.unwrap_or(default.avoid_crossing),
            seam: print.seam_over(&default.seam),
            tolerances: self.tolerances.over(&default.tolerances),
            material: self.material.as_ref().map(FileMaterial::material),
            heaters: self.heaters()?,
            // Where the input lies is the command line's.
            ..self.of_layers(default)
        })
    }

    /// Kinematics, joints, motors, extruder, rates.
    fn machine(
        &self,
        default: &MachineConfiguration,
    ) -> Result<MachineConfiguration, MachineFileError> {
        let (kinematics, joints) = self.joints()?;
        let motors = self.motors.as_ref();
        let motors = motors.map(|motors| motors.matrix(joint_names(&kinematics), &joints));
        Ok(MachineConfiguration {
            kinematics,
            shapers: shaper::shapers(&self.shaper, &kinematics)?,
            joints: joints.into_iter().collect(),
            extruder: self.extruder.over(&default.extruder),
            servo_hz: self.servo_hz.unwrap_or(default.servo_hz),
            step_hz: self.step_hz.unwrap_or(default.step_hz),
            motors: motors.transpose()?.unwrap_or_default(),
        })
    }

    fn board(&self) -> Result<Option<BoardName>, MachineFileError> {
        let Some(text) = &self.board else {
            return Ok(None);
        };
        let name = BoardName::of_text(text).ok_or_else(|| {
            let known = BoardName::ALL.map(BoardName::text).join(", ");
            MachineFileError::Toml(format!(
                "board: {text}: the firmware knows {known}; docs/guide/boards.md says which boards fit"
            ))
        })?;
        Ok(Some(name))
    }

    fn heaters(&self) -> Result<Option<HeatConfiguration>, MachineFileError> {
        let given = self.heaters.as_ref();
        given.map(FileHeaters::heaters).transpose()
    }

    /// Switches that are given.
    fn switches(
        &self,
        machine: &MachineConfiguration,
    ) -> Result<Option<HomingConfiguration>, MachineFileError> {
        let given = self.switches.as_ref();
        given
            .map(|given| switches::switches(given, machine, self.z_of_probe_mm()))
            .transpose()
    }

    /// How high the nozzle is where Z is homed by the probe.
    fn z_of_probe_mm(&self) -> Option<f64> {
        let probe = self.probe.filter(|_| self.wiring.z_is_probe())?;
        Some(probe.probe().z_offset_mm)
    }

    /// What differs from kind to kind and from layer to layer.
    fn of_layers(&self, default: Settings) -> Settings {
        let print = &self.print;
        let least_mm_s = default.slow_speed_min_mm_s;
        Settings {
            kinds: self.kinds.kinds(),
            layer_time_min_s: print.layer_time_min_s.unwrap_or(default.layer_time_min_s),
            slow_speed_min_mm_s: print.slow_speed_min_mm_s.unwrap_or(least_mm_s),
            wide_beads: self.wide_beads(&default.wide_beads),
            ..default
        }
    }
}

impl Extruder {
    fn over(&self, default: &ExtruderConfiguration) -> ExtruderConfiguration {
        ExtruderConfiguration {
            steps_per_mm3: self.steps_per_mm3,
            speed_max_mm3_s: self.speed_max_mm3_s,
            acceleration_max_mm3_s2: self.acceleration_max_mm3_s2,
            pressure_advance_s: self
                .pressure_advance_s
                .unwrap_or(default.pressure_advance_s),
            pressure_advance_window_ms: self
                .pressure_advance_window_ms
                .unwrap_or(default.pressure_advance_window_ms),
        }
    }
}

impl Flow {
    fn prime_retract(&self, default: &PrimeRetract) -> PrimeRetract {
        PrimeRetract {
            retract_mm3: self.retract_mm3.unwrap_or(default.retract_mm3),
            retract_rate_mm3_s: self
                .retract_rate_mm3_s
                .unwrap_or(default.retract_rate_mm3_s),
            retract_lead_s: self.retract_lead_s.unwrap_or(default.retract_lead_s),
            prime_mm3: self.prime_mm3.unwrap_or(default.prime_mm3),
            prime_rate_mm3_s: self.prime_rate_mm3_s.unwrap_or(default.prime_rate_mm3_s),
            prime_lead_s: self.prime_lead_s.unwrap_or(default.prime_lead_s),
        }
    }
}

impl FileInfill {
    fn infill(&self) -> Infill {
        let solid = Infill::solid(self.walls);
        Infill {
            density_pct: self.density_pct.unwrap_or(solid.density_pct),
            angle_rad: self.angle_deg.map_or(solid.angle_rad, f64::to_radians),
            bottom_layers: self.bottom_layers,
            top_layers: self.top_layers,
            ..solid
        }
    }
}

impl Print {
    fn seam_over(&self, default: &Seam) -> Seam {
        Seam {
            place: self.seam.unwrap_or(default.place),
            direction_rad: self
                .seam_direction_deg
                .map_or(default.direction_rad, f64::to_radians),
        }
    }
}

impl FileSkirt {
    fn over(&self, default: &Skirt) -> Skirt {
        Skirt {
            loops: self.loops.unwrap_or(default.loops),
            brim_loops: self.brim_loops.unwrap_or(default.brim_loops),
            distance_mm: self.distance_mm.unwrap_or(default.distance_mm),
        }
    }
}

impl FileTolerances {
    fn over(&self, default: &Tolerances) -> Tolerances {
        let rad = |mrad: Option<f64>, default_rad: f64| mrad.map_or(default_rad, |v| v / 1e3);
        Tolerances {
            outside_mm: self.outside_mm.unwrap_or(default.outside_mm),
            tip_mm: self.tip_mm.unwrap_or(default.tip_mm),
            axis_rad: rad(self.axis_mrad, default.axis_rad),
            heading_rad: rad(self.heading_mrad, default.heading_rad),
            flatten_mm: self.flatten_mm.unwrap_or(default.flatten_mm),
            corner_mm: self.corner_mm.unwrap_or(default.corner_mm),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The built-in planar machine's file with groups more, read.
    pub(super) fn planar_with(groups: &str) -> Result<Settings, String> {
        let text = to_toml(&Settings::planar()) + groups;
        from_toml(&text).map_err(|error| error.to_string())
    }

    #[test]
    fn a_board_is_named_as_it_is_written_and_no_other_is() {
        let mut settings = Settings::planar();
        assert_eq!(
            from_toml(&to_toml(&settings)).map(|read| read.board),
            Ok(None)
        );
        for name in BoardName::ALL {
            settings.board = Some(name);
            let text = to_toml(&settings);
            assert_eq!(from_toml(&text).map(|read| read.board), Ok(Some(name)));
            // Jobs for the machine are the same whatever board drives it.
            assert_eq!(settings.machine.hash(), Settings::planar().machine.hash());
            let pro = text.replace(name.text(), "octopus-pro-1.1");
            let refused = from_toml(&pro).map_err(|error| error.to_string());
            assert!(
                refused.is_err_and(|text| text.contains("octopus-pro-1.1: the firmware knows"))
            );
        }
    }

    /// What a file with these groups, one text in them replaced by another, is refused with has the part.
    pub(super) fn assert_refused(groups: &str, cases: &[(&str, &str, &str)]) {
        for (from, to, part) in cases {
            assert!(groups.contains(from), "{from} is not in the groups");
            let error = planar_with(&groups.replace(from, to)).expect_err(to);
            assert!(error.contains(part), "{to}: {error}");
        }
    }

    #[test]
    fn built_in_machines_are_valid_and_read_back_exactly() {
        let lines = Settings {
            infill: Some(Infill {
                walls: 3,
                density_pct: 12.5,
                angle_rad: 0.3,
                bottom_layers: Some(0),
                top_layers: Some(7),
            }),
            layers: 120,
            skirt: Skirt {
                loops: 2,
                brim_loops: 5,
                distance_mm: 1.75,
            },
            nozzle_body_radius_mm: 4.5,
            avoid_crossing: true,
            seam: Seam {
                place: SeamPlace::Aligned,
                direction_rad: -0.7,
            },
            ..Settings::planar()
        };
        for settings in [Settings::planar(), Settings::gantry(), lines] {
            settings.check().expect("built-in machine");
            let text = to_toml(&settings);
            let read = from_toml(&text).expect(&text);
            assert_eq!(read, settings, "{text}");
            let text = to_new_toml(&settings);
            assert_eq!(from_toml(&text).expect(&text), settings);
            assert!(text.contains("layers = ") && text.contains("bottom_layers = "));
        }
    }

    /// Found by fuzzing: such files were taken, and only the simulation refused them.
    #[test]
    fn what_the_controller_cannot_run_is_refused_when_the_file_is_read() {
        let text = to_toml(&Settings::planar());
        let slow = text.replace("servo_hz = 2000", "servo_hz = 4000");
        assert_ne!(slow, text);
        let error = from_toml(&slow).unwrap_err().to_string();
        assert!(error.contains("65 to 256 times"), "{error}");
        let mut settings = Settings::planar();
        settings.machine.extruder.steps_per_mm3 = 40_000.0;
        settings.machine.extruder.speed_max_mm3_s = 1.0;
        // Everything else keeps to that extruder.
        settings.prime_retract.prime_rate_mm3_s = 0.5;
        settings.prime_retract.retract_rate_mm3_s = 0.5;
        settings.flow_max_mm3_s = 0.5;
        let error = from_toml(&to_toml(&settings)).unwrap_err().to_string();
        assert!(error.contains("controller cannot run"), "{error}");
    }

    /// Degrees and turns are rounded once, when a file is read; from there on nothing moves.
    #[test]
    fn any_settings_from_a_file_read_back_exactly() {
        for seed in 0..200 {
            let vary = |k: usize| 0.5 + 0.737 * ((seed * 7 + k * 13) % 101) as f64 / 3.0;
            let mut settings = Settings::gantry();
            for (k, joint) in settings.machine.joints.iter_mut().enumerate().skip(3) {
                joint.speed_max = vary(k);
                joint.steps_per_unit = 101.3 * vary(k + 3);
                joint.position_min = -vary(k + 5);
                joint.position_max = vary(k + 7);
            }
            settings.tolerances.heading_rad = vary(1) / 1e3;
            let read = from_toml(&to_toml(&settings)).expect("first file");
            assert_eq!(from_toml(&to_toml(&read)).expect("second file"), read);
        }
    }

    #[test]
    fn unknown_keys_are_refused_with_their_line() {
        let text = to_toml(&Settings::planar()).replace("speed_mm_s = 60", "sped_mm_s = 60");
        let line = 1 + text
            .lines()
            .position(|l| l.starts_with("sped"))
            .expect("line");
        let message = from_toml(&text).expect_err("unknown key").to_string();
        assert!(message.contains(&format!("line {line}")), "{message}");
        assert!(message.contains("sped_mm_s"), "{message}");
    }

    #[test]
    fn impossible_machines_are_refused() {
        for (from, to, part) in [
            ("steps_per_mm = 80", "steps_per_mm = 800", "90 % of step_hz"),
            ("servo_hz = 2000", "servo_hz = 2001", "whole multiple"),
            (
                "speed_max_mm_s = 250",
                "speed_max_mm_s = -250",
                "greater than 0",
            ),
            (
                "speed_max_mm_s = 250",
                "speed_max_mm_s = nan",
                "greater than 0",
            ),
            (
                "kinematics = \"planar\"",
                "kinematics = \"gantry\"",
                "joints.a",
            ),
            (
                "kinematics = \"planar\"",
                "kinematics = \"delta\"",
                "unknown variant",
            ),
            (
                "position_max_mm = 205",
                "position_max_mm = 100",
                "beyond the joint",
            ),
            (
                "\"ellipse:0.6x0.2\"",
                "\"ellipse:0.2x0.6\"",
                "write ellipse:0.6x0.2",
            ),
            (
                "prime_rate_mm3_s = 30",
                "prime_rate_mm3_s = 90",
                "extruder.speed_max",
            ),
        ] {
            let text = to_toml(&Settings::planar());
            assert!(text.contains(from), "{from} is not in the file");
            let message = from_toml(&text.replace(from, to))
                .expect_err(to)
                .to_string();
            assert!(message.contains(part), "{to}: {message}");
        }
    }
}
