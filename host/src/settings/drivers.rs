//! Drivers that the board sets up: the `[drivers]` groups of a machine file, checked.

use super::check::{SettingsError, joint_names};
use headway_firmware::configuration::MachineConfiguration;
use headway_firmware::drivers::DriversConfiguration;
use headway_firmware::drivers::configuration::DriverItem;
use headway_protocol::message::SettingsProblem;
use headway_protocol::settings::items;

/// The motor behind the joints.
pub const EXTRUDER: &str = "extruder";

/// Names of the motors, as machine files have them.
pub fn motor_names(machine: &MachineConfiguration) -> Vec<&'static str> {
    let joints = joint_names(&machine.kinematics).iter().copied();
    joints.chain([EXTRUDER]).collect()
}

/// What would fit.
const fn remedy(item: DriverItem) -> &'static str {
    match item {
        DriverItem::Address => "a node address is 0 to 3, and 0 where each driver has a wire",
        DriverItem::Sense => "sense resistors have 50 to 500 mΩ, usually 110",
        DriverItem::Run => {
            "it must be above the lowest step of the scale, within what the sense resistor gives (325 mV / \
             (R + 20 mΩ) / 1.414), and 2000 at most"
        }
        DriverItem::Hold => "at most run_ma",
        DriverItem::Microsteps => "a power of two from 1 to 256",
        DriverItem::Steps => "it must be the machine's own number of steps, within 0.1 %",
        DriverItem::Threshold => "spread_above_full_steps_s is too low",
        DriverItem::Motor => "the machine has no such motor",
    }
}

/// Every driver, against the machine's steps.
pub(super) fn check_drivers(
    drivers: &DriversConfiguration,
    machine: &MachineConfiguration,
) -> Result<(), SettingsError> {
    drivers.check(machine).map_err(|wrong| {
        let names = motor_names(machine);
        let place = usize::from(wrong.item.number()).saturating_sub(1);
        SettingsError::Driver {
            motor: names.get(wrong.motor).copied().unwrap_or("?"),
            item: items(SettingsProblem::Driver)
                .get(place)
                .copied()
                .unwrap_or("?"),
            value: wrong.value,
            remedy: remedy(wrong.item),
        }
    })
}
