//! `[drivers]` of a machine file: a group for each motor whose driver the board sets up.

use crate::settings::drivers::motor_names;
use crate::settings::heading_joint::heading_joint_name;
use crate::settings::{HeadingMotor, Settings};
use crate::text::refusal::{Refusal, refusal};
use headway_firmware::configuration::MachineConfiguration;
use headway_firmware::configuration::drivers::{
    Chopper, DriverConfiguration, DriverKind, DriversConfiguration,
};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::fmt::Write;

/// Microsteps of a full step in which the speed threshold counts.
const FINEST: f64 = 256.0;
/// The threshold's 20 bits.
const CLOCKS_MAX: f64 = 1_048_575.0;

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "lowercase")]
enum ChopperName {
    Stealth,
    Spread,
}

/// Clock of the chip, Hz, in which the speed threshold counts too.
fn chip_hz(kind: DriverKind) -> f64 {
    match kind {
        DriverKind::Tmc2209 | DriverKind::Tmc5160 => 12e6,
        DriverKind::Tmc2240 => 12.5e6,
    }
}

#[derive(Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FileDriver {
    driver: Option<String>,
    reference_ohm: Option<u16>,
    run_ma: Option<u16>,
    hold_ma: Option<u16>,
    sense_mohm: Option<u16>,
    address: Option<u8>,
    microsteps: Option<u16>,
    full_steps_per_mm: Option<f64>,
    full_steps_per_turn: Option<f64>,
    full_steps_per_mm3: Option<f64>,
    interpolate: Option<bool>,
    chopper: Option<ChopperName>,
    spread_above_full_steps_s: Option<f64>,
    torque_nm: Option<f64>,
    rotor_inertia_g_cm2: Option<f64>,
    load_inertia_g_cm2: Option<f64>,
    gear_ratio: Option<f64>,
    motor_speed_max_rpm: Option<f64>,
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
) -> Result<DriversConfiguration, Refusal> {
    let names = motor_names(machine);
    let mut found = vec![None; names.len()];
    for (name, driver) in given {
        let motor = names.iter().position(|motor| motor == name);
        let Some(motor) = motor else {
            let known = names.join(", ");
            return Err(refusal!(
                "drivers.{name}: the machine has the motors {known}"
            ));
        };
        if !driver.is_motor_alone() {
            found[motor] = Some(driver.driver(name, steps_key(machine, motor))?);
        }
    }
    while found.last() == Some(&None) {
        found.pop();
    }
    // As many as there are motors, which fit.
    Ok(DriversConfiguration {
        drivers: found.into_iter().collect(),
    })
}

/// What the motor of the heading joint can do; other motors have no such numbers.
pub(super) fn heading_motor(
    given: &BTreeMap<String, FileDriver>,
    machine: &MachineConfiguration,
) -> Result<Option<HeadingMotor>, Refusal> {
    let heading = heading_joint_name(&machine.kinematics);
    let mut found = None;
    for (name, driver) in given {
        let Some(motor) = driver.heading_motor(name)? else {
            continue;
        };
        match heading {
            Some(heading) if heading == name => found = Some(motor),
            heading => {
                let whose = heading.map_or("the machine has none".to_string(), |heading| {
                    format!("give it to [drivers.{heading}]")
                });
                return Err(refusal!(
                    "drivers.{name}.torque_nm goes with the joint that turns the nozzle: {whose}"
                ));
            }
        }
    }
    Ok(found)
}

impl FileDriver {
    /// All of its numbers, or none.
    fn heading_motor(&self, name: &str) -> Result<Option<HeadingMotor>, Refusal> {
        let needed = [
            ("torque_nm", self.torque_nm),
            ("rotor_inertia_g_cm2", self.rotor_inertia_g_cm2),
            ("load_inertia_g_cm2", self.load_inertia_g_cm2),
            ("gear_ratio", self.gear_ratio),
        ];
        let values = needed.map(|(_, value)| value);
        if let [
            Some(torque_nm),
            Some(rotor_inertia_g_cm2),
            Some(load_inertia_g_cm2),
            Some(gear_ratio),
        ] = values
        {
            return Ok(Some(HeadingMotor {
                torque_nm,
                rotor_inertia_g_cm2,
                load_inertia_g_cm2,
                gear_ratio,
                motor_speed_max_rpm: self.motor_speed_max_rpm,
            }));
        }
        let is_any = values.iter().any(Option::is_some) || self.motor_speed_max_rpm.is_some();
        if !is_any {
            return Ok(None);
        }
        let missing = needed.iter().filter(|(_, value)| value.is_none());
        let missing: Vec<&str> = missing.map(|(key, _)| *key).collect();
        Err(refusal!(
            "drivers.{name}: {} is missing: what the heading axis reaches follows from torque_nm, rotor_inertia_g_cm2, \
             load_inertia_g_cm2 and gear_ratio together",
            missing.join(", ")
        ))
    }

    /// True where nothing is said of the driver: the board leaves it as it is.
    fn is_motor_alone(&self) -> bool {
        let numbers = [
            self.full_steps_per_mm,
            self.full_steps_per_turn,
            self.full_steps_per_mm3,
            self.spread_above_full_steps_s,
        ];
        let of_driver = [self.run_ma, self.hold_ma, self.sense_mohm, self.microsteps]
            .iter()
            .any(Option::is_some)
            || numbers.iter().any(Option::is_some)
            || self.address.is_some()
            || self.interpolate.is_some()
            || self.chopper.is_some()
            || self.driver.is_some()
            || self.reference_ohm.is_some();
        !of_driver && self.torque_nm.is_some()
    }

    /// Its type, and its resistor.
    fn kind(&self, name: &str) -> Result<(DriverKind, u16), Refusal> {
        let text = self.driver.as_deref().unwrap_or("tmc2209");
        let kind = DriverKind::ALL
            .into_iter()
            .find(|kind| kind.numbers().0 == text);
        let Some(kind) = kind else {
            return Err(refusal!(
                "drivers.{name}.driver {text}: the board sets up tmc2209, tmc5160 and tmc2240; leave the group out for a \
                 driver that stands alone"
            ));
        };
        let (key, given, other) = match kind {
            DriverKind::Tmc2240 => ("reference_ohm", self.reference_ohm, self.sense_mohm),
            _ => ("sense_mohm", self.sense_mohm, self.reference_ohm),
        };
        if other.is_some() {
            return Err(refusal!(
                "drivers.{name}: the resistor of a {text} is {key}"
            ));
        }
        if kind.has_spi() && self.address.is_some() {
            return Err(refusal!(
                "drivers.{name}.address: a {text} is selected by a wire of its own and has no address"
            ));
        }
        let (_, _, [.., usual], _) = kind.numbers();
        Ok((kind, given.unwrap_or(usual)))
    }

    fn driver(&self, name: &str, key: &str) -> Result<DriverConfiguration, Refusal> {
        let (Some(run_ma), Some(microsteps)) = (self.run_ma, self.microsteps) else {
            return Err(refusal!(
                "drivers.{name}: run_ma and microsteps are needed for a driver that the board sets up"
            ));
        };
        let (kind, sense_mohm) = self.kind(name)?;
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
                return Err(refusal!(
                    "drivers.{name}: give {key}, the motor's full steps, and no other (microsteps times \
                     it are the steps)"
                ));
            }
        };
        let spread_below_clocks = match self.spread_above_full_steps_s {
            None => 0,
            Some(rate) if rate > 0.0 && rate.is_finite() => {
                // Too many are refused with the other numbers.
                (chip_hz(kind) / FINEST / rate)
                    .round()
                    .clamp(1.0, CLOCKS_MAX + 1.0) as u32
            }
            Some(rate) => {
                return Err(refusal!(
                    "drivers.{name}.spread_above_full_steps_s {rate}: above 0"
                ));
            }
        };
        Ok(DriverConfiguration {
            address: self.address.unwrap_or(0),
            sense_mohm,
            kind,
            run_ma,
            hold_ma: self.hold_ma.unwrap_or(run_ma / 2),
            microsteps,
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
pub(super) fn write_drivers(text: &mut String, settings: &Settings) -> std::fmt::Result {
    let machine = &settings.machine;
    let names = motor_names(machine);
    let mut heading = settings.heading_joint_name();
    let drivers = names.iter().zip(&settings.drivers.drivers);
    for (motor, (name, driver)) in drivers.enumerate() {
        let Some(driver) = driver else { continue };
        writeln!(
            text,
            "\n# Set up by the board; currents are rms, by the resistor.\n[drivers.{name}]"
        )?;
        writeln!(text, "driver = \"{}\"", driver.kind.numbers().0)?;
        if !driver.kind.has_spi() {
            writeln!(text, "address = {}", driver.address)?;
        }
        let resistor = match driver.kind {
            DriverKind::Tmc2240 => "reference_ohm",
            _ => "sense_mohm",
        };
        writeln!(text, "{resistor} = {}", driver.sense_mohm)?;
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
            let rate = chip_hz(driver.kind) / FINEST / f64::from(driver.spread_below_clocks);
            writeln!(text, "spread_above_full_steps_s = {rate}")?;
        }
        if heading == Some(*name) {
            write_heading_motor(text, settings.heading_motor.as_ref())?;
            heading = None;
        }
    }
    if let Some(name) = heading.filter(|_| settings.heading_motor.is_some()) {
        writeln!(text, "\n# Its driver stands alone.\n[drivers.{name}]")?;
        write_heading_motor(text, settings.heading_motor.as_ref())?;
    }
    Ok(())
}

fn write_heading_motor(text: &mut String, motor: Option<&HeadingMotor>) -> std::fmt::Result {
    let Some(motor) = motor else { return Ok(()) };
    writeln!(
        text,
        "# Its motor, from the data sheet; the load is all that turns with the nozzle."
    )?;
    let numbers = [
        ("torque_nm", Some(motor.torque_nm)),
        ("rotor_inertia_g_cm2", Some(motor.rotor_inertia_g_cm2)),
        ("load_inertia_g_cm2", Some(motor.load_inertia_g_cm2)),
        ("gear_ratio", Some(motor.gear_ratio)),
        ("motor_speed_max_rpm", motor.motor_speed_max_rpm),
    ];
    for (key, value) in numbers {
        if let Some(value) = value {
            writeln!(text, "{key} = {}", super::write::number(value))?;
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

    const MOTOR: &str = "torque_nm = 0.15\nrotor_inertia_g_cm2 = 20\nload_inertia_g_cm2 = 180\n\
                         gear_ratio = 3\nmotor_speed_max_rpm = 900\n";
    const X: &str = "[drivers.x]\nrun_ma = 800\nmicrosteps = 16\nfull_steps_per_mm = 5\n";

    #[test]
    fn drivers_read_back() {
        let group = format!(
            "{X}[drivers.c]\nrun_ma = 500\nhold_ma = 300\nmicrosteps = 16\nfull_steps_per_turn = 600\n\
             chopper = \"spread\"\nspread_above_full_steps_s = 333.3\n{MOTOR}\
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
        let motor = settings.heading_motor.expect("a motor");
        assert_eq!((motor.gear_ratio, motor.torque_nm), (3.0, 0.15));
        // Of a driver that stands alone the motor is known all the same.
        let alone = read(&format!("[drivers.c]\n{MOTOR}")).expect("a machine");
        assert_eq!(
            (alone.drivers.is_none(), alone.heading_motor),
            (true, Some(motor))
        );
        assert_eq!(from_toml(&to_toml(&alone)).expect("again"), alone);
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
            ("run_ma = 800", "", "run_ma and microsteps are needed"),
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
            ("run_ma = 800", "run_ma = 800\nloud = true", "unknown key"),
        ];
        assert_refused(X, &cases);
    }

    /// Goal: the heading joint's motor is refused where its numbers are none, not all there, or another joint's. Method:
    /// one wrong number at a time.
    #[test]
    fn heading_motors_that_cannot_be_are_refused() {
        let group = format!(
            "[drivers.c]\nrun_ma = 500\nmicrosteps = 16\nfull_steps_per_turn = 600\n{MOTOR}"
        );
        let cases = [
            ("torque_nm = 0.15", "torque_nm = 0", "torque_nm"),
            ("torque_nm = 0.15\n", "", "torque_nm is missing"),
            ("gear_ratio = 3", "gear_ratio = 0.001", "gear_ratio"),
            ("gear_ratio = 3", "gear_ratio = 200", "a turn of the motor"),
            (
                "load_inertia_g_cm2 = 180",
                "load_inertia_g_cm2 = nan",
                "load_inertia",
            ),
            (
                "rotor_inertia_g_cm2 = 20",
                "rotor_inertia_g_cm2 = -1",
                "rotor_inertia",
            ),
            (
                "motor_speed_max_rpm = 900",
                "motor_speed_max_rpm = 1e9",
                "motor_speed_max_rpm",
            ),
        ];
        assert_refused(&group, &cases);
        // A driver's keys without its current are not taken for those of a motor that stands alone.
        for key in [
            "full_steps_per_turn = 600",
            "address = 1",
            "interpolate = false",
        ] {
            let half = read(&format!("[drivers.c]\n{key}\n{MOTOR}")).expect_err(key);
            assert!(half.contains("run_ma and microsteps are needed"), "{half}");
        }
        let of_x = X.to_string() + MOTOR;
        let cases = [("gear_ratio = 3", "gear_ratio = 2", "give it to [drivers.c]")];
        assert_refused(&of_x, &cases);
    }

    #[test]
    fn drivers_with_spi_read_back_and_what_they_have_not_is_refused() {
        const SPI: &str = "[drivers.x]\ndriver = \"tmc2240\"\nrun_ma = 1200\nmicrosteps = 16\nfull_steps_per_mm = 5\n\
                           [drivers.y]\ndriver = \"tmc5160\"\nrun_ma = 2500\nmicrosteps = 16\nfull_steps_per_mm = 5\n\
                           spread_above_full_steps_s = 333.3\n";
        let settings = read(SPI).expect("a machine");
        let [x, y, ..] = &settings.drivers.drivers[..] else {
            panic!("two drivers");
        };
        let (x, y) = (x.expect("x"), y.expect("y"));
        assert_eq!((x.kind.numbers().0, x.sense_mohm), ("tmc2240", 12_000));
        assert_eq!((y.kind.numbers().0, y.sense_mohm), ("tmc5160", 75));
        assert_eq!(y.spread_below_clocks, 141);
        assert_eq!(from_toml(&to_toml(&settings)).expect("again"), settings);
        assert_refused(
            SPI,
            &[
                (
                    "tmc2240",
                    "tmc2130",
                    "the board sets up tmc2209, tmc5160 and tmc2240",
                ),
                (
                    "run_ma = 1200",
                    "run_ma = 1200\nsense_mohm = 110",
                    "is reference_ohm",
                ),
                (
                    "run_ma = 2500",
                    "run_ma = 2500\nreference_ohm = 12000",
                    "is sense_mohm",
                ),
                (
                    "run_ma = 2500",
                    "run_ma = 2500\naddress = 1",
                    "has no address",
                ),
                (
                    "run_ma = 2500",
                    "run_ma = 3100",
                    "a resistor of 75 mΩ gives 12 to 3064",
                ),
                (
                    "run_ma = 1200",
                    "run_ma = 2200",
                    "a resistor of 12000 Ω gives 3 to 2121",
                ),
                (
                    "run_ma = 1200",
                    "run_ma = 12\nreference_ohm = 110",
                    "12000 to 60000 Ω, usually 12000",
                ),
                (
                    "run_ma = 2500",
                    "run_ma = 12\nsense_mohm = 10",
                    "20 to 500 mΩ, usually 75",
                ),
            ],
        );
    }
}
