//! `[drivers]` of a machine file: a group for each motor whose TMC2209 the board sets up.

use super::MachineFileError;
use crate::settings::drivers::motor_names;
use headway_firmware::configuration::MachineConfiguration;
use headway_firmware::configuration::drivers::{
    Chopper, DriverConfiguration, DriversConfiguration,
};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::fmt::Write;

/// Clock of the chip, Hz, and its microsteps of a full step: what its speed threshold counts in.
const CHIP_HZ: f64 = 12e6;
const FINEST: f64 = 256.0;
/// What modules and boards have.
const SENSE_MOHM: u16 = 110;
/// The threshold's 20 bits.
const CLOCKS_MAX: f64 = 1_048_575.0;

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "lowercase")]
enum ChopperName {
    Stealth,
    Spread,
}

#[derive(Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FileDriver {
    run_ma: u16,
    hold_ma: Option<u16>,
    sense_mohm: Option<u16>,
    address: Option<u8>,
    microsteps: u16,
    full_steps_per_mm: Option<f64>,
    full_steps_per_turn: Option<f64>,
    full_steps_per_mm3: Option<f64>,
    interpolate: Option<bool>,
    chopper: Option<ChopperName>,
    spread_above_full_steps_s: Option<f64>,
}

/// The key that a motor's full steps have.
fn steps_key(machine: &MachineConfiguration, motor: usize) -> &'static str {
    let copied = motor.checked_sub(machine.joints.len() + 1);
    let copied = copied.and_then(|copy| machine.motors.copies.get(copy));
    match machine
        .joints
        .get(copied.map_or(motor, |joint| usize::from(*joint)))
    {
        Some(joint) if joint.rotary => "full_steps_per_turn",
        Some(_) => "full_steps_per_mm",
        None => "full_steps_per_mm3",
    }
}

/// In the motors' order; refuses one for a motor that the machine has not.
pub(super) fn drivers(
    given: &BTreeMap<String, FileDriver>,
    machine: &MachineConfiguration,
) -> Result<DriversConfiguration, MachineFileError> {
    let names = motor_names(machine);
    let mut found = vec![None; names.len()];
    for (name, driver) in given {
        let motor = names.iter().position(|motor| motor == name);
        let Some(motor) = motor else {
            let known = names.join(", ");
            let problem = format!("drivers.{name}: the machine has the motors {known}");
            return Err(MachineFileError::Toml(problem));
        };
        found[motor] = Some(driver.driver(name, steps_key(machine, motor))?);
    }
    while found.last() == Some(&None) {
        found.pop();
    }
    // As many as there are motors, which fit.
    Ok(DriversConfiguration {
        drivers: found.into_iter().collect(),
    })
}

impl FileDriver {
    fn driver(&self, name: &str, key: &str) -> Result<DriverConfiguration, MachineFileError> {
        let given = [
            ("full_steps_per_mm", self.full_steps_per_mm),
            (
                "full_steps_per_turn",
                self.full_steps_per_turn.map(|v| v / TAU),
            ),
            ("full_steps_per_mm3", self.full_steps_per_mm3),
        ];
        let mut steps = given.iter().filter(|(_, value)| value.is_some());
        let full_steps_per_unit = match (steps.next(), steps.next()) {
            (Some((found, Some(value))), None) if *found == key => *value,
            _ => {
                let problem = format!(
                    "drivers.{name}: give {key}, the motor's full steps, and no other (microsteps times \
                     it are the steps)"
                );
                return Err(MachineFileError::Toml(problem));
            }
        };
        let spread_below_clocks = match self.spread_above_full_steps_s {
            None => 0,
            Some(rate) if rate > 0.0 && rate.is_finite() => {
                // Too many are refused with the other numbers.
                (CHIP_HZ / FINEST / rate)
                    .round()
                    .clamp(1.0, CLOCKS_MAX + 1.0) as u32
            }
            Some(rate) => {
                let problem = format!("drivers.{name}.spread_above_full_steps_s {rate}: above 0");
                return Err(MachineFileError::Toml(problem));
            }
        };
        Ok(DriverConfiguration {
            address: self.address.unwrap_or(0),
            sense_mohm: self.sense_mohm.unwrap_or(SENSE_MOHM),
            run_ma: self.run_ma,
            hold_ma: self.hold_ma.unwrap_or(self.run_ma / 2),
            microsteps: self.microsteps,
            interpolates: self.interpolate.unwrap_or(true),
            full_steps_per_unit,
            chopper: match self.chopper {
                Some(ChopperName::Spread) => Chopper::Spread,
                Some(ChopperName::Stealth) | None => Chopper::Stealth,
            },
            spread_below_clocks,
        })
    }
}

/// The groups of drivers that are set up.
pub(super) fn write_drivers(
    text: &mut String,
    drivers: &DriversConfiguration,
    machine: &MachineConfiguration,
) -> std::fmt::Result {
    let names = motor_names(machine);
    for (motor, (name, driver)) in names.iter().zip(&drivers.drivers).enumerate() {
        let Some(driver) = driver else { continue };
        writeln!(
            text,
            "\n# TMC2209 over its UART; currents are rms, by the sense resistor.\n[drivers.{name}]"
        )?;
        writeln!(text, "address = {}", driver.address)?;
        writeln!(text, "sense_mohm = {}", driver.sense_mohm)?;
        writeln!(text, "run_ma = {}", driver.run_ma)?;
        writeln!(text, "hold_ma = {}", driver.hold_ma)?;
        writeln!(text, "microsteps = {}", driver.microsteps)?;
        let (key, full) = (steps_key(machine, motor), driver.full_steps_per_unit);
        let full = if key == "full_steps_per_turn" {
            super::write::nice(full * TAU, full, |v| v / TAU)
        } else {
            super::write::number(full)
        };
        writeln!(text, "{key} = {full}")?;
        writeln!(text, "interpolate = {}", driver.interpolates)?;
        let chopper = match driver.chopper {
            Chopper::Stealth => "stealth",
            Chopper::Spread => "spread",
        };
        writeln!(text, "chopper = \"{chopper}\"")?;
        if driver.spread_below_clocks > 0 {
            let rate = CHIP_HZ / FINEST / f64::from(driver.spread_below_clocks);
            writeln!(text, "spread_above_full_steps_s = {rate}")?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    //! Goal: drivers are read and written back as they are, and what cannot be is refused with the number.
    //! Method: the built-in machines' files with groups more.
    use super::super::tests::{assert_refused, planar_with as read};
    use super::super::{from_toml, to_toml};
    use crate::settings::Settings;
    use crate::settings::drivers::{EXTRUDER, motor_names};

    const X: &str = "[drivers.x]\nrun_ma = 800\nmicrosteps = 16\nfull_steps_per_mm = 5\n";

    #[test]
    fn drivers_read_back() {
        let group = format!(
            "{X}[drivers.c]\nrun_ma = 500\nhold_ma = 300\nmicrosteps = 16\nfull_steps_per_turn = 600\n\
             chopper = \"spread\"\nspread_above_full_steps_s = 333.3\n\
             [drivers.{EXTRUDER}]\nrun_ma = 600\nmicrosteps = 16\nfull_steps_per_mm3 = 10.39\n"
        );
        let settings = read(&group).expect("a machine");
        assert_eq!(motor_names(&settings.machine).len(), 5);
        let [x, y, _, c, e] = &settings.drivers.drivers[..] else {
            panic!("five motors");
        };
        assert_eq!(x.expect("x").hold_ma, 400);
        assert_eq!((y.is_none(), e.is_some()), (true, true));
        assert_eq!(c.expect("c").spread_below_clocks, 141);
        assert_eq!(from_toml(&to_toml(&settings)).expect("again"), settings);
        // A job's machine is the same with other currents.
        assert_eq!(settings.machine.hash(), Settings::planar().machine.hash());
    }

    #[test]
    fn drivers_that_cannot_be_are_refused() {
        let cases = [
            ("drivers.x", "drivers.q", "x, y, z, c, extruder"),
            ("run_ma = 800", "run_ma = 1900", "drivers.x: run_ma is 1900"),
            (
                "run_ma = 800",
                "run_ma = 800\nhold_ma = 900",
                "hold_ma is 900",
            ),
            (
                "microsteps = 16",
                "microsteps = 32",
                "is 160; it must be the machine's own",
            ),
            (
                "microsteps = 16",
                "microsteps = 20",
                "microsteps is 20; a power of two",
            ),
            (
                "full_steps_per_mm =",
                "full_steps_per_turn =",
                "give full_steps_per_mm,",
            ),
            ("run_ma = 800", "run_ma = 800\naddress = 7", "address is 7"),
            (
                "run_ma = 800",
                "run_ma = 800\nsense_mohm = 10",
                "sense_mohm is 10",
            ),
            (
                "run_ma = 800",
                "run_ma = 800\nspread_above_full_steps_s = 0",
                "above 0",
            ),
            (
                "run_ma = 800",
                "run_ma = 800\nspread_above_full_steps_s = 0.01",
                "too low",
            ),
            ("run_ma = 800", "run_ma = 800\nloud = true", "unknown field"),
        ];
        assert_refused(X, &cases);
    }
}
