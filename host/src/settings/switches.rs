//! Switches of a machine: those of its file, or the usual ones.

use super::Settings;
use super::check::joint_names;
use super::error::SettingsError;
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
    pub(super) fn check_wiring(&self) -> Result<(), SettingsError> {
        let wiring = &self.wiring;
        wiring.check(&self.machine).map_err(|wrong| match wrong {
            WrongWiring::Switch(joint) => {
                let names = joint_names(&self.machine.kinematics);
                SettingsError::Wiring {
                    key: format!("switch_inputs.{}", names.get(joint).unwrap_or(&"?")),
                    input: wiring.switch_inputs.get(joint).copied().unwrap_or(0),
                }
            }
            WrongWiring::Emergency => SettingsError::Wiring {
                key: "emergency_input".to_string(),
                input: wiring.emergency_input.unwrap_or(0),
            },
            WrongWiring::Probe => SettingsError::Wiring {
                key: "probe_input".to_string(),
                input: wiring.probe_input.unwrap_or(0),
            },
        })
    }

    /// Every number of those that are given.
    pub(super) fn check_switches(&self) -> Result<(), SettingsError> {
        let names = joint_names(&self.machine.kinematics);
        for homing in self.switches.iter().flat_map(|given| &given.joints) {
            let number = usize::from(homing.joint);
            let limits = self.machine.joints.get(number);
            let wrong = limits.and_then(|limits| homing.wrong(limits));
            let Some((item, value)) = wrong else { continue };
            let place = usize::from(item).saturating_sub(1);
            return Err(SettingsError::Switch {
                joint: names.get(number).copied().unwrap_or("?"),
                item: items(SettingsProblem::Switch)
                    .get(place)
                    .copied()
                    .unwrap_or("?"),
                value,
            });
        }
        Ok(())
    }
}
