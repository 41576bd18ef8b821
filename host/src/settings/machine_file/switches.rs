//! `[switches]` of a machine file: a group for each joint that has one, at either end.
//!
//! In: keys in mm or degrees. Out: joints in the order in which they are homed. Without `[switches]` they are the
//! usual ones; an empty `[switches]` says that there are none.

use super::write::{degrees, number};
use crate::settings::check::joint_names;
use crate::text::refusal::{Refusal, refusal};
use headway_firmware::configuration::homing::{HomingConfiguration, JointHoming};
use headway_firmware::configuration::{JointConfiguration, MachineConfiguration};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::fmt::Write;

#[derive(Clone, Copy, Deserialize, PartialEq)]
#[serde(rename_all = "lowercase")]
enum EndName {
    Min,
    Max,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FileSwitch {
    end: EndName,
    order: Option<u8>,
    guards: Option<bool>,
    mark: Option<bool>,
    position_mm: Option<f64>,
    position_deg: Option<f64>,
    fast_mm_s: Option<f64>,
    fast_deg_s: Option<f64>,
    slow_mm_s: Option<f64>,
    slow_deg_s: Option<f64>,
    back_off_mm: Option<f64>,
    back_off_deg: Option<f64>,
    travel_max_mm: Option<f64>,
    travel_max_deg: Option<f64>,
}

/// Z goes first where that leads away from the bed, and last where it leads to it; the others between.
fn usual_order(name: &str, end: EndName) -> u8 {
    match (name, end) {
        ("z", EndName::Max) => 0,
        ("z", EndName::Min) => 2,
        _ => 1,
    }
}

/// In the order of homing; refuses one for a joint that the machine has not. Z down whose switch is the probe
/// is at `z_of_probe_mm` and guards nothing, unless the file says otherwise.
pub(super) fn switches(
    given: &BTreeMap<String, FileSwitch>,
    machine: &MachineConfiguration,
    z_of_probe_mm: Option<f64>,
) -> Result<HomingConfiguration, Refusal> {
    let names = joint_names(&machine.kinematics);
    let (mut found, mut marks) = (Vec::new(), 0);
    for (name, switch) in given {
        let number = names.iter().position(|joint| joint == name);
        let number = number.filter(|number| *number < machine.joints.len());
        let Some(number) = number else {
            let known = names.join(", ");
            return Err(refusal!(
                "switches.{name}: the machine has the joints {known}"
            ));
        };
        let order = switch.order.unwrap_or(usual_order(name, switch.end));
        let mut homing = switch.homing(name, number as u8, &machine.joints[number])?;
        if switch.mark == Some(true) {
            mark(name, switch, &mut homing, &machine.joints[number])?;
            marks |= 1 << number;
        }
        if let Some(z_mm) = z_of_probe_mm
            && (name.as_str(), switch.end) == ("z", EndName::Min)
        {
            homing.position_natural = switch.position_mm.unwrap_or(z_mm);
            // A probe that is above the nozzle is pressed all through the first layers.
            homing.guards = switch.guards.unwrap_or(false);
        }
        found.push((order, number, homing));
    }
    found.sort_by_key(|(order, number, _)| (*order, *number));
    // No more than there are joints, which fit.
    Ok(HomingConfiguration {
        joints: found.into_iter().map(|(_, _, homing)| homing).collect(),
        marks,
        hold: 0,
    })
}

/// A joint passes its mark once a turn: it is searched for a turn and a little more, so that no hose is wound up in
/// vain, and stops nothing.
fn mark(
    name: &str,
    switch: &FileSwitch,
    homing: &mut JointHoming,
    limits: &JointConfiguration,
) -> Result<(), Refusal> {
    if !limits.rotary {
        return Err(refusal!(
            "switches.{name}.mark: only a joint that turns passes a mark"
        ));
    }
    if switch.travel_max_deg.is_none() {
        homing.travel_max_natural = 1.1 * TAU;
    }
    if switch.position_deg.is_none() {
        homing.position_natural = 0.0;
    }
    homing.guards = false;
    Ok(())
}

impl FileSwitch {
    fn homing(
        &self,
        name: &str,
        number: u8,
        limits: &JointConfiguration,
    ) -> Result<JointHoming, Refusal> {
        let mut homing = JointHoming::usual(number, self.end == EndName::Max, limits);
        homing.guards = self.guards.unwrap_or(homing.guards);
        for (key, linear, rotary, place) in [
            (
                "position",
                self.position_mm,
                self.position_deg,
                &mut homing.position_natural,
            ),
            (
                "fast",
                self.fast_mm_s,
                self.fast_deg_s,
                &mut homing.fast_natural_s,
            ),
            (
                "slow",
                self.slow_mm_s,
                self.slow_deg_s,
                &mut homing.slow_natural_s,
            ),
            (
                "back_off",
                self.back_off_mm,
                self.back_off_deg,
                &mut homing.back_off_natural,
            ),
            (
                "travel_max",
                self.travel_max_mm,
                self.travel_max_deg,
                &mut homing.travel_max_natural,
            ),
        ] {
            let (value, other, unit) = if limits.rotary {
                (rotary.map(f64::to_radians), linear, "deg")
            } else {
                (linear, rotary, "mm")
            };
            if other.is_some() {
                return Err(refusal!("switches.{name}.{key}: give it in {unit}"));
            }
            *place = value.unwrap_or(*place);
        }
        Ok(homing)
    }
}

/// A group for each joint with a switch.
pub(super) fn write_switches(
    text: &mut String,
    switches: &HomingConfiguration,
    machine: &MachineConfiguration,
) -> std::fmt::Result {
    let names = joint_names(&machine.kinematics);
    writeln!(
        text,
        "\n# Where joints are homed; order: which first. A guard stops motion that runs into it.\n[switches]"
    )?;
    for (order, homing) in switches.joints.iter().enumerate() {
        let number_of = usize::from(homing.joint);
        let (Some(name), Some(limits)) = (names.get(number_of), machine.joints.get(number_of))
        else {
            continue;
        };
        let (unit, shown): (&str, fn(f64) -> String) = if limits.rotary {
            ("deg", degrees)
        } else {
            ("mm", number)
        };
        let end = if homing.towards_max { "max" } else { "min" };
        writeln!(text, "[switches.{name}]\nend = \"{end}\"\norder = {order}")?;
        writeln!(text, "position_{unit} = {}", shown(homing.position_natural))?;
        writeln!(text, "fast_{unit}_s = {}", shown(homing.fast_natural_s))?;
        writeln!(text, "slow_{unit}_s = {}", shown(homing.slow_natural_s))?;
        writeln!(text, "back_off_{unit} = {}", shown(homing.back_off_natural))?;
        writeln!(
            text,
            "travel_max_{unit} = {}",
            shown(homing.travel_max_natural)
        )?;
        writeln!(text, "guards = {}", homing.guards)?;
        if switches.marks >> homing.joint & 1 == 1 {
            writeln!(text, "mark = true")?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    //! Goal: switches at either end are read and written back as they are, in the order of homing, and what
    //! cannot be is refused with its key and value. Method: the built-in machine's file with groups more.
    use super::super::tests::{assert_refused, planar_with as read};
    use super::super::{from_toml, to_toml};
    use crate::settings::Settings;
    use headway_firmware::configuration::homing::HomingConfiguration;

    const ALL: &str = "[switches.x]\nend = \"min\"\n[switches.y]\nend = \"max\"\nposition_mm = 254.5\n\
                       [switches.z]\nend = \"min\"\nfast_mm_s = 4\nslow_mm_s = 0.5\n";

    #[test]
    fn switches_read_back_in_the_order_of_homing() {
        let settings = read(ALL).expect("a machine");
        let switches = settings.switches.clone().expect("given");
        let order: Vec<(u8, bool)> = switches
            .joints
            .iter()
            .map(|s| (s.joint, s.towards_max))
            .collect();
        assert_eq!(order, [(0, false), (1, true), (2, false)], "Z down is last");
        let [x, y, z] = &switches.joints[..] else {
            panic!("three");
        };
        assert_eq!(
            *x,
            HomingConfiguration::standard(&settings.machine).joints[1]
        );
        assert_eq!(y.position_natural, 254.5);
        assert_eq!((z.fast_natural_s, z.slow_natural_s), (4.0, 0.5));
        assert_eq!(from_toml(&to_toml(&settings)).expect("again"), settings);
        // Z up is first, unless told otherwise; the nozzle's turn may be homed too.
        let group = "[switches.z]\nend = \"max\"\n[switches.c]\nend = \"max\"\nposition_deg = 90\norder = 0\n";
        let settings = read(group).expect("a machine");
        let switches = settings.switches.clone().expect("given");
        let order: Vec<u8> = switches.joints.iter().map(|s| s.joint).collect();
        assert_eq!(order, [2, 3]);
        let turn = switches.joints[1].position_natural;
        assert!((turn - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
        assert_eq!(from_toml(&to_toml(&settings)).expect("again"), settings);
        // None at all, and the usual ones.
        let none = read("[switches]\n").expect("a machine").switches;
        assert_eq!(none, Some(HomingConfiguration::none()));
        assert_eq!(read("").expect("a machine").switches, None);
        // A plan does not depend on them.
        assert_eq!(settings.machine.hash(), Settings::planar().machine.hash());
    }

    #[test]
    fn switches_that_cannot_be_are_refused() {
        let cases = [
            ("switches.x", "switches.q", "x, y, z, c"),
            ("\"min\"", "\"low\"", "is not known"),
            ("254.5", "nan", "switches.y: position is NaN"),
            (
                "fast_mm_s = 4",
                "fast_mm_s = 21",
                "switches.z: fast speed is 21",
            ),
            (
                "slow_mm_s = 0.5",
                "slow_mm_s = 0",
                "switches.z: slow speed is 0",
            ),
            (
                "slow_mm_s = 0.5",
                "back_off_mm = -1",
                "switches.z: back_off is -1",
            ),
            ("slow_mm_s", "slow_deg_s", "slow: give it in mm"),
        ];
        assert_refused(ALL, &cases);
        let endless = read("[switches.c]\nend = \"min\"\n").expect_err("where is it?");
        assert!(endless.contains("switches.c: position is"), "{endless}");
    }
}
