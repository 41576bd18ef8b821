//! `[wiring]` of a machine file: roles and senses of the board's inputs, motors that turn the other way.

use crate::settings::check::joint_names;
use crate::settings::drivers::motor_names;
use crate::text::refusal::{Refusal, refusal};
use headway_firmware::configuration::MachineConfiguration;
use headway_firmware::configuration::wiring::{INPUTS_MAX, NO_INPUT, Wiring};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::fmt::Write;

#[derive(Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FileWiring {
    #[serde(default)]
    reversed: Vec<String>,
    #[serde(default)]
    switch_inputs: BTreeMap<String, u8>,
    emergency_input: Option<u8>,
    probe_input: Option<u8>,
    #[serde(default)]
    probe_servo: bool,
    #[serde(default)]
    normally_open: Vec<u8>,
}

impl FileWiring {
    /// The probe has no input of its own: it is Z's switch.
    pub(super) fn z_is_probe(&self) -> bool {
        self.probe_input.is_none()
    }

    /// Over the board's own; refuses joints and motors that the machine has not.
    pub(super) fn wiring(&self, machine: &MachineConfiguration) -> Result<Wiring, Refusal> {
        let mut wiring = Wiring {
            emergency_input: self.emergency_input,
            probe_input: self.probe_input,
            probe_servo: self.probe_servo,
            ..Wiring::STANDARD
        };
        let motors = motor_names(machine);
        for name in &self.reversed {
            let place = place_of(name, &motors, "reversed")?;
            wiring.reversed_motors |= 1 << place;
        }
        let joints = joint_names(&machine.kinematics);
        for (name, input) in &self.switch_inputs {
            let place = place_of(name, joints, "switch_inputs")?;
            wiring.switch_inputs[place] = *input;
        }
        for input in &self.normally_open {
            if *input >= INPUTS_MAX {
                return Err(refusal!(
                    "wiring.normally_open: input {input}: they are 0 to 15"
                ));
            }
            wiring.open_inputs |= 1 << input;
        }
        // An input has one role: a joint whose own one is taken by another has no switch.
        for (name, place) in joints.iter().zip(&mut wiring.switch_inputs) {
            let own = *place;
            let is_given = self.switch_inputs.contains_key(*name);
            let others = self.switch_inputs.values().copied();
            let mut others = others.chain(self.emergency_input).chain(self.probe_input);
            if !is_given && others.any(|input| input == own) {
                *place = NO_INPUT;
            }
        }
        Ok(wiring)
    }
}

fn place_of(name: &str, known: &[&str], key: &str) -> Result<usize, Refusal> {
    known
        .iter()
        .position(|motor| *motor == name)
        .ok_or_else(|| {
            let known = known.join(", ");
            refusal!("wiring.{key}: {name}: the machine has {known}")
        })
}

/// What differs from the board's own.
pub(super) fn write_wiring(
    text: &mut String,
    wiring: &Wiring,
    machine: &MachineConfiguration,
) -> std::fmt::Result {
    if *wiring == Wiring::STANDARD {
        return Ok(());
    }
    writeln!(
        text,
        "\n# Inputs are numbered as the board has them (docs/guide/boards.md).\n[wiring]"
    )?;
    let motors = motor_names(machine);
    let reversed = motors.iter().enumerate();
    let reversed = reversed.filter(|(motor, _)| wiring.reversed_motors >> motor & 1 == 1);
    let reversed: Vec<String> = reversed.map(|(_, name)| format!("{name:?}")).collect();
    writeln!(text, "reversed = [{}]", reversed.join(", "))?;
    let joints = joint_names(&machine.kinematics);
    let inputs = joints.iter().zip(wiring.switch_inputs);
    let inputs = inputs.zip(Wiring::STANDARD.switch_inputs);
    // A joint without one is said by who has its input.
    let moved = inputs.filter(|((_, input), own)| input != own && *input != NO_INPUT);
    let moved: Vec<String> = moved
        .map(|((name, input), _)| format!("{name} = {input}"))
        .collect();
    writeln!(text, "switch_inputs = {{ {} }}", moved.join(", "))?;
    if let Some(input) = wiring.emergency_input {
        writeln!(text, "emergency_input = {input}")?;
    }
    if let Some(input) = wiring.probe_input {
        writeln!(text, "probe_input = {input}")?;
    }
    if wiring.probe_servo {
        writeln!(text, "probe_servo = true")?;
    }
    let open = (0..INPUTS_MAX).filter(|input| wiring.open_inputs >> input & 1 == 1);
    let open: Vec<String> = open.map(|input| input.to_string()).collect();
    writeln!(text, "normally_open = [{}]", open.join(", "))
}

#[cfg(test)]
mod tests {
    //! Goal: wiring is read and written back as it is, and what cannot be is refused. Method: the built-in
    //! machine's file with a group more.
    use super::super::tests::{assert_refused, planar_with as read};
    use super::super::{from_toml, to_toml};
    use crate::settings::Settings;
    use headway_firmware::configuration::wiring::{NO_INPUT, Wiring};

    const ALL: &str = "[wiring]\nreversed = [\"y\", \"extruder\"]\nswitch_inputs = { z = 8 }\n\
                       emergency_input = 3\nnormally_open = [0, 8]\n";

    #[test]
    fn wiring_reads_back() {
        let settings = read(ALL).expect("a machine");
        let wiring = settings.wiring;
        assert_eq!(wiring.reversed_motors, 0b10010);
        // The nozzle's own input is the emergency one now.
        assert_eq!(wiring.switch_inputs[..4], [0, 1, 8, NO_INPUT]);
        assert_eq!(wiring.emergency_input, Some(3));
        assert_eq!(wiring.open_inputs, 1 << 8 | 1);
        assert_eq!(from_toml(&to_toml(&settings)).expect("again"), settings);
        let apart = ALL
            .replace("z = 8", "z = 1")
            .replace("normally", "probe_input = 2\nprobe_servo = true\nnormally");
        let apart = read(&apart).expect("a machine");
        // Y's own input is Z's now, and Z's own the probe's.
        assert_eq!(apart.wiring.switch_inputs[..3], [0, NO_INPUT, 1]);
        assert_eq!(apart.wiring.probe_input, Some(2));
        assert!(apart.wiring.probe_servo && !settings.wiring.probe_servo);
        assert_eq!(from_toml(&to_toml(&apart)).expect("again"), apart);
        assert_eq!(read("").expect("a machine").wiring, Wiring::STANDARD);
        assert_eq!(settings.machine.hash(), Settings::planar().machine.hash());
    }

    #[test]
    fn wiring_that_cannot_be_is_refused() {
        let cases = [
            (
                "\"y\"",
                "\"q\"",
                "reversed: q: the machine has x, y, z, c, extruder",
            ),
            (
                "z = 8",
                "q = 8",
                "switch_inputs: q: the machine has x, y, z, c",
            ),
            ("z = 8", "z = 3", "switch_inputs.z is 3"),
            ("z = 8", "z = 16", "switch_inputs.z is 16"),
            ("_input = 3", "_input = 16", "emergency_input is 16"),
            ("[0, 8]", "[0]\nprobe_input = 16", "probe_input is 16"),
            ("[0, 8]", "[0]\nprobe_input = 3", "probe_input is 3"),
            ("[0, 8]", "[16]", "input 16"),
            ("normally_open", "open", "unknown key"),
        ];
        assert_refused(ALL, &cases);
    }
}
