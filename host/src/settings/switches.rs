//! Switches of a machine: those of its file, or the usual ones.

use super::Settings;
use super::check::joint_names;
use crate::text::refusal::{Refusal, refusal};
use crate::text::short_number::Short;
use headway_firmware::configuration::homing::HomingConfiguration;
use headway_firmware::configuration::wiring::WrongWiring;
use headway_protocol::message::SettingsProblem;
use headway_protocol::settings::items;

impl Settings {
    /// Switches that the board homes to, in that order.
    pub fn homing(&self) -> HomingConfiguration {
        let usual = || HomingConfiguration::standard(&self.machine);
        HomingConfiguration {
            hold: self.hold,
            ..self.switches.clone().unwrap_or_else(usual)
        }
    }

    /// Every input, whatever board.
    pub(super) fn check_wiring(&self) -> Result<(), Refusal> {
        let wiring = &self.wiring;
        let names = joint_names(&self.machine.kinematics);
        wiring.check(&self.machine).map_err(|wrong| {
            let (key, name, input) = match wrong {
                WrongWiring::Switch(joint) => {
                    let input = wiring.switch_inputs.get(joint).copied();
                    let name = names.get(joint).copied();
                    ("switch_inputs.", name.unwrap_or("?"), input)
                }
                WrongWiring::Emergency => ("emergency_input", "", wiring.emergency_input),
                WrongWiring::Probe => ("probe_input", "", wiring.probe_input),
            };
            refusal!(
                "wiring.{key}{name} is {}: inputs are numbered from 0 to 15 as the board has them, and the emergency \
                 input is no switch",
                input.unwrap_or(0)
            )
        })
    }

    /// Every number of those that are given.
    pub(super) fn check_switches(&self) -> Result<(), Refusal> {
        let names = joint_names(&self.machine.kinematics);
        for homing in self.switches.iter().flat_map(|given| &given.joints) {
            let number = usize::from(homing.joint);
            let limits = self.machine.joints.get(number);
            let wrong = limits.and_then(|limits| homing.wrong(limits));
            let Some((item, value)) = wrong else { continue };
            let place = usize::from(item).saturating_sub(1);
            return Err(refusal!(
                "switches.{}: {} is {}; speeds are above 0 and at most the joint's speed_max, ways above 0, and \
                 the position is a place: the end of the joint's range, unless it is given",
                names.get(number).unwrap_or(&"?"),
                items(SettingsProblem::Switch).get(place).unwrap_or(&"?"),
                Short(value)
            ));
        }
        Ok(())
    }
}
