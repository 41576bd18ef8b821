//! The machine file: TOML text <-> [`Settings`].
//!
//! A file for people: angles in degrees, steps by the turn, comments at every group. Unknown keys
//! are refused with their line, because a misspelt limit would otherwise be no limit. `name`,
//! `kinematics`, `work_area`, `joints` and `extruder` must be there; the other groups and their
//! keys default to the built-in machine's. This file is the only place where degrees become
//! radians.

use super::aperture_text::from_semi_axes;
use super::check::joint_names;
use super::groups::{
    ExtruderKeys, FlowKeys, InfillKeys, MaterialKeys, MeasureKeys, PrintKeys, ProbeKeys, PumpKeys,
    SkirtKeys, TolerancesKeys,
};
use super::heat::Material;
use super::kinds::Kinds;
use super::measure::Measure;
use super::probe::ProbeSettings;
use super::pump::PumpOutput;
use super::{Infill, Settings};
use crate::text::refusal::{Refusal, refusal};
use head::FileHead;
use headway_firmware::configuration::MachineConfiguration;
use headway_firmware::configuration::board_name::BoardName;
use headway_firmware::configuration::flow_curves::FlowCurves;
use headway_firmware::configuration::heat::HeatConfiguration;
use headway_firmware::configuration::homing::HomingConfiguration;
use serde::Deserialize;

mod axes;
mod drivers;
pub mod edit;
mod flow_loss;
mod gcode;
mod head;
mod heat;
mod joints;
mod kinds;
mod motors;
#[cfg(test)]
mod probe_tests;
mod shaper;
mod switches;
pub(super) mod toml_words;
mod wiring;
mod write;
use axes::FileKinematics;
use drivers::FileDriver;
use flow_loss::FileFlowLoss;
use gcode::FileGcode;
pub use gcode::gcode_letters;
use heat::FileHeaters;
pub use heat::{write_heater, write_heaters};
use joints::{FileArm, Joints};
use motors::FileMotors;
use shaper::FileShaper;
use std::collections::BTreeMap;
use switches::FileSwitch;
use toml_words::toml_problem;
use wiring::FileWiring;
pub use write::{to_new_toml, to_toml};

/// What a file has that gives ellipses and circles by full sizes.
const FORMAT: u32 = 2;

/// Reads and checks a machine file.
pub fn from_toml(text: &str) -> Result<Settings, Refusal> {
    let file = read(text)?;
    match file.by_semi_axes() {
        Some((given, full)) => Err(refusal!(
            "print.aperture: \"{given}\" is by semi-axes or a radius, as files without a format were; sizes are full ones now. \
             Write these two lines, the first one at the head of the file (where {given} are full sizes already, the first \
             one alone):\nformat = 2\naperture = \"{full}\""
        )),
        None => checked(file),
    }
}

/// The settings of a job, whose text is that of the version which wrote it: without a format it has semi-axes.
pub fn from_job_toml(text: &str) -> Result<Settings, Refusal> {
    let mut file = read(text)?;
    if let Some((_, full)) = file.by_semi_axes() {
        file.print.aperture = Some(full);
    }
    checked(file)
}

fn read(text: &str) -> Result<File, Refusal> {
    let file = toml::from_str(text);
    let file: File = file.map_err(|error| Refusal(toml_problem(text, &error)))?;
    match file.format {
        None | Some(FORMAT) => Ok(file),
        Some(other) => Err(refusal!(
            "format: {other} is not one that this program reads; it writes 2"
        )),
    }
}

fn checked(file: File) -> Result<Settings, Refusal> {
    let settings = file.into_settings()?;
    settings.check()?;
    Ok(settings)
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    format: Option<u32>,
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
    extruder: ExtruderKeys,
    #[serde(default)]
    flow_loss: Vec<FileFlowLoss>,
    head: Option<FileHead>,
    #[serde(default)]
    print: PrintKeys,
    #[serde(default)]
    flow: FlowKeys,
    infill: Option<InfillKeys>,
    #[serde(default)]
    kinds: Kinds,
    #[serde(default)]
    skirt: SkirtKeys,
    #[serde(default)]
    tolerances: TolerancesKeys,
    material: Option<MaterialKeys>,
    heaters: Option<FileHeaters>,
    #[serde(default)]
    gcode: FileGcode,
    #[serde(default)]
    drivers: BTreeMap<String, FileDriver>,
    switches: Option<BTreeMap<String, FileSwitch>>,
    #[serde(default)]
    wiring: FileWiring,
    probe: Option<ProbeKeys>,
    pump: Option<PumpKeys>,
    measure: Option<MeasureKeys>,
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

impl File {
    /// Of a file of the first format an ellipse or a circle: its text, and that by full sizes.
    fn by_semi_axes(&self) -> Option<(String, String)> {
        let given = self.print.aperture.as_ref()?;
        let full = self.format.is_none().then(|| from_semi_axes(given))?;
        Some((given.clone(), full?))
    }

    /// Where the input lies is the command line's.
    fn into_settings(self) -> Result<Settings, Refusal> {
        let default = Settings::default();
        let machine = self.machine(&default.machine)?;
        let mut settings = Settings {
            machine_name: self.name.clone(),
            drivers: drivers::drivers(&self.drivers, &machine)?,
            heading_motor: drivers::heading_motor(&self.drivers, &machine)?,
            probe: self.probe()?,
            pump: over(&self.pump, PumpKeys::set, PumpOutput::default())?,
            measure: over(&self.measure, MeasureKeys::set, Measure::default())?,
            switches: self.switches(&machine)?,
            hold: self.joints.held(joint_names(&machine.kinematics)),
            wiring: self.wiring.wiring(&machine)?,
            board: self.board()?,
            machine,
            work_area_mm: [self.work_area.min_mm, self.work_area.max_mm],
            gcode_letters: self.gcode.letters()?,
            gcode_axes: self.gcode.axes()?,
            plan_share: self.plan_share.unwrap_or(default.plan_share),
            infill: self.infill()?,
            head: self.head.as_ref().map(FileHead::shape).transpose()?,
            kinds: self.kinds,
            material: self.material()?,
            heaters: self.heaters()?,
            ..default
        };
        self.print.set(&mut settings)?;
        self.flow.set(&mut settings)?;
        self.skirt.set(&mut settings)?;
        self.tolerances.set(&mut settings)?;
        settings.space_lines();
        Ok(settings)
    }

    /// Kinematics, joints, motors, extruder, rates.
    fn machine(&self, default: &MachineConfiguration) -> Result<MachineConfiguration, Refusal> {
        let (kinematics, joints) = self.joints()?;
        let motors = self.motors.as_ref();
        let motors = motors.map(|motors| motors.matrix(joint_names(&kinematics), &joints));
        let mut machine = MachineConfiguration {
            kinematics,
            shapers: shaper::shapers(&self.shaper, &kinematics)?,
            joints: joints.into_iter().collect(),
            extruder: default.extruder,
            curves: FlowCurves::NONE,
            servo_hz: self.servo_hz.unwrap_or(default.servo_hz),
            step_hz: self.step_hz.unwrap_or(default.step_hz),
            motors: motors.transpose()?.unwrap_or_default(),
        };
        self.extruder.set(&mut machine)?;
        if !self.flow_loss.is_empty() {
            if !machine.curves.loss.is_empty() {
                return Err(refusal!(
                    "extruder.flow_loss: the curves [[flow_loss]] take its place: leave one of them out"
                ));
            }
            let hot_end_c = self.material()?.map(|material| material.hot_end_c);
            machine.curves.loss = flow_loss::at_temperature(&self.flow_loss, hot_end_c)?;
        }
        if let Some([most_s, _]) = machine.curves.advance_bounds() {
            if self.extruder.pressure_advance_s.is_some() {
                return Err(refusal!(
                    "extruder.advance: it takes the place of pressure_advance_s: leave one of them out"
                ));
            }
            machine.extruder.pressure_advance_s = most_s;
        }
        Ok(machine)
    }

    fn board(&self) -> Result<Option<BoardName>, Refusal> {
        let Some(text) = &self.board else {
            return Ok(None);
        };
        let name = BoardName::of_text(text).ok_or_else(|| {
            let known = BoardName::ALL.map(BoardName::text).join(", ");
            refusal!(
                "board: {text}: the firmware knows {known}; docs/guide/boards.md says which boards fit"
            )
        })?;
        Ok(Some(name))
    }

    fn heaters(&self) -> Result<Option<HeatConfiguration>, Refusal> {
        let given = self.heaters.as_ref();
        given.map(FileHeaters::heaters).transpose()
    }

    /// Switches that are given.
    fn switches(
        &self,
        machine: &MachineConfiguration,
    ) -> Result<Option<HomingConfiguration>, Refusal> {
        let z_mm = self.z_of_probe_mm()?;
        let given = self.switches.as_ref();
        given
            .map(|given| switches::switches(given, machine, z_mm))
            .transpose()
    }

    /// How high the nozzle is where Z is homed by the probe.
    fn z_of_probe_mm(&self) -> Result<Option<f64>, Refusal> {
        let probe = self.probe()?.filter(|_| self.wiring.z_is_probe());
        Ok(probe.map(|probe| probe.z_offset_mm))
    }

    fn probe(&self) -> Result<Option<ProbeSettings>, Refusal> {
        over(&self.probe, ProbeKeys::set, ProbeSettings::default())
    }

    fn infill(&self) -> Result<Option<Infill>, Refusal> {
        let both = |keys: &InfillKeys| keys.density_pct.is_some() && keys.spacing_mm.is_some();
        if self.infill.as_ref().is_some_and(both) {
            return Err(refusal!("infill: give density_pct or spacing_mm, not both"));
        }
        over(&self.infill, InfillKeys::set, Infill::solid(1))
    }

    fn material(&self) -> Result<Option<Material>, Refusal> {
        over(&self.material, MaterialKeys::set, Material::default())
    }
}

/// What a group that may be missing makes of the usual values.
fn over<K, T>(
    group: &Option<K>,
    set: impl Fn(&K, &mut T) -> Result<(), Refusal>,
    usual: T,
) -> Result<Option<T>, Refusal> {
    let Some(group) = group else {
        return Ok(None);
    };
    let mut settings = usual;
    set(group, &mut settings)?;
    Ok(Some(settings))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::{Seam, SeamPlace, Skirt};

    /// The built-in planar machine's file with groups more, read.
    pub(super) fn planar_with(groups: &str) -> Result<Settings, String> {
        let text = to_toml(&Settings::planar()) + groups;
        from_toml(&text).map_err(|error| error.to_string())
    }

    /// Goal: faults of a hand's edit say what to write. Method: one key each of the built-in machine's file.
    #[test]
    fn faults_of_an_edit_say_what_to_write() {
        let text = to_toml(&Settings::planar());
        for (new, part) in [
            ("speed_mm_s = \"400\"", "write a number without quotes"),
            ("speed_mm_s = 4,5", "decimals with a point"),
            ("speed_mm_s = 60 mm", "its unit is in the key's name"),
            ("layers = 2.5", "write a whole number"),
            ("layers = -3", "write a whole number of 0 or more"),
            ("pass = three", "write a text in quotes"),
            (
                "pass = \"three\"",
                "`three` is not known: write \"two\" or \"one\"",
            ),
            ("spede_mm_s = 60", "is `speed_mm_s` meant?"),
            (
                "colour = 1",
                "unknown key `colour`; this group has aperture, layers,",
            ),
        ] {
            let key = new.split(" =").next().unwrap_or_default();
            let kept = text
                .lines()
                .filter(|line| !line.starts_with(&format!("{key} =")));
            let kept: Vec<&str> = kept.collect();
            let edited = kept
                .join("\n")
                .replace("[print]", &format!("[print]\n{new}"));
            let refused = from_toml(&edited).expect_err(new).to_string();
            assert!(refused.contains(part), "{refused}");
            assert!(
                refused.starts_with("line ") && refused.contains(new),
                "{refused}"
            );
        }
    }

    /// Goal: no file by semi-axes becomes half its nozzle. Method: files without a format, read as a person's and as a job's.
    #[test]
    fn a_file_by_semi_axes_is_refused_and_read_in_jobs() {
        let new = to_toml(&Settings::planar());
        for (old, full) in [
            ("ellipse:0.6x0.2", "ellipse:1.2x0.4"),
            ("circle:0.25", "circle:0.5"),
        ] {
            let text = new.replace("ellipse:1.2x0.4", full);
            let by_half = text.replace("format = 2\n", "").replace(full, old);
            assert_ne!(by_half, text);
            let refused = from_toml(&by_half).expect_err(old).to_string();
            let lines = format!("\nformat = 2\naperture = \"{full}\"");
            assert!(refused.ends_with(&lines), "{refused}");
            assert_eq!(from_job_toml(&by_half), from_toml(&text));
            assert_eq!(from_job_toml(&text), from_toml(&text));
        }
        // A slot had its full sizes.
        let slot = new.replace("ellipse", "stadium");
        assert_eq!(
            from_toml(&slot.replace("format = 2\n", "")),
            from_toml(&slot)
        );
        let later = from_toml(&new.replace("format = 2", "format = 3"));
        let refused = later.expect_err("a later format").to_string();
        assert!(refused.starts_with("format: 3 is not one"), "{refused}");
    }

    /// Goal: a fan whose pulses nobody counts is not waited for. Method: the key with each named board, and with a board
    /// of one's own.
    #[test]
    fn a_board_that_counts_no_pulses_of_a_fan_is_not_told_to() {
        let mut settings = Settings::planar();
        let mut heaters = HeatConfiguration::standard();
        heaters.fan_tells_turns = true;
        settings.heaters = Some(heaters);
        let text = to_toml(&settings);
        assert!(text.contains("fan_tells_turns = true"), "{text}");
        assert!(from_toml(&text).is_ok());
        for name in BoardName::ALL {
            settings.board = Some(name);
            let refused = from_toml(&to_toml(&settings)).map_err(|error| error.to_string());
            let said = refused.expect_err("a fan that stalls at once");
            assert!(
                said.contains("fan_tells_turns") && said.contains(name.text()),
                "{said}"
            );
        }
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
                spacing_mm: None,
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
                "is not known",
            ),
            (
                "position_max_mm = 205",
                "position_max_mm = 100",
                "beyond the joint",
            ),
            (
                "\"ellipse:1.2x0.4\"",
                "\"ellipse:0.4x1.2\"",
                "write ellipse:1.2x0.4",
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
