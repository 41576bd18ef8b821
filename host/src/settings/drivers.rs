//! Drivers that the board sets up: the `[drivers]` groups of a machine file, checked.

use super::check::joint_names;
use crate::text::refusal::{Refusal, refusal};
use crate::text::short_number::Short;
use headway_firmware::configuration::drivers::{
    DriverItem, DriverKind, DriversConfiguration, run_range_ma,
};
use headway_firmware::configuration::{JOINTS_MAX, MachineConfiguration};
use headway_protocol::message::SettingsProblem;
use headway_protocol::settings::items;

/// The motor behind the joints.
pub const EXTRUDER: &str = "extruder";

/// Names of the motors, as machine files have them.
pub fn motor_names(machine: &MachineConfiguration) -> Vec<&'static str> {
    let joints = joint_names(&machine.kinematics).iter().copied();
    let names = joint_names(&machine.kinematics);
    let mut numbers = [1; JOINTS_MAX];
    let copies = machine.motors.copies.iter().map(|joint| {
        let joint = usize::from(*joint).min(JOINTS_MAX - 1);
        numbers[joint] += 1;
        let name = names.get(joint).copied();
        name.and_then(|name| copy_name(name, numbers[joint]))
            .unwrap_or("?")
    });
    joints.chain([EXTRUDER]).chain(copies).collect()
}

/// Name of the second or a later motor on a joint; none where joints are not along a line.
pub(super) fn copy_name(joint: &str, number: usize) -> Option<&'static str> {
    let names = match joint {
        "x" => ["x2", "x3", "x4"],
        "y" => ["y2", "y3", "y4"],
        "z" => ["z2", "z3", "z4"],
        _ => return None,
    };
    names.get(number.checked_sub(2)?).copied()
}

/// What would fit.
fn remedy(item: DriverItem, kind: DriverKind, sense: u16) -> String {
    let (_, _, [least, most, usual], _) = kind.numbers();
    let is_reference = kind == DriverKind::Tmc2240;
    let unit = if is_reference { "Ω" } else { "mΩ" };
    match item {
        DriverItem::Address => "a node address is 0 to 3, and 0 where each driver has a wire",
        DriverItem::Sense => return format!("{least} to {most} {unit}, usually {usual}"),
        DriverItem::Run => {
            let [least, most] = run_range_ma(kind, sense);
            return format!("a resistor of {sense} {unit} gives {least} to {most}");
        }
        DriverItem::Hold => "at most run_ma",
        DriverItem::Microsteps => "a power of two from 1 to 256",
        DriverItem::Steps => "it must be the machine's own number of steps, within 0.1 %",
        DriverItem::Threshold => "spread_above_full_steps_s is too low",
        DriverItem::Motor => "the machine has no such motor",
    }
    .to_string()
}

/// Every driver, against the machine's steps.
pub(super) fn check_drivers(
    drivers: &DriversConfiguration,
    machine: &MachineConfiguration,
) -> Result<(), Refusal> {
    drivers.check(machine).map_err(|wrong| {
        let names = motor_names(machine);
        let driver = drivers.drivers.get(wrong.motor).copied().flatten();
        let (kind, sense) =
            driver.map_or_else(Default::default, |driver| (driver.kind, driver.sense_mohm));
        let place = usize::from(wrong.item.number()).saturating_sub(1);
        refusal!(
            "drivers.{}: {} is {}; {}",
            names.get(wrong.motor).unwrap_or(&"?"),
            items(SettingsProblem::Driver).get(place).unwrap_or(&"?"),
            Short(wrong.value),
            remedy(wrong.item, kind, sense)
        )
    })
}
