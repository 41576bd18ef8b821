//! Drivers: currents, addresses, microsteps compared with the machine's steps.

use crate::configuration::MachineConfiguration;
use crate::configuration::drivers::{
    ADDRESS_MAX, DriverConfiguration, DriverItem, DriversConfiguration, WrongDriver,
};

/// Steps of a machine file are measured and rounded: this share they may be off.
const STEPS_TOLERANCE: f64 = 1e-3;

impl DriverConfiguration {
    /// The first number that cannot be; `steps_per_unit` are the machine's.
    fn wrong(&self, steps_per_unit: f64) -> Option<(DriverItem, f64)> {
        let steps = self.full_steps_per_unit * f64::from(self.microsteps);
        let off = (steps - steps_per_unit).abs();
        let agrees = off <= STEPS_TOLERANCE * steps_per_unit;
        let power_of_two = self.microsteps.is_power_of_two() && self.microsteps <= 256;
        let (_, _, [least, most, _], most_ma) = self.kind.numbers();
        let senses = (least..=most).contains(&self.sense_mohm);
        let fits = if self.kind.has_spi() {
            self.spi_current().is_some()
        } else {
            self.current_scale().is_some()
        };
        let runs = fits && self.run_ma <= most_ma;
        let holds = self.hold_ma <= self.run_ma;
        let in_order = [
            (
                self.address <= ADDRESS_MAX,
                DriverItem::Address,
                f64::from(self.address),
            ),
            (senses, DriverItem::Sense, f64::from(self.sense_mohm)),
            (runs, DriverItem::Run, f64::from(self.run_ma)),
            (holds, DriverItem::Hold, f64::from(self.hold_ma)),
            (
                power_of_two,
                DriverItem::Microsteps,
                f64::from(self.microsteps),
            ),
            (agrees, DriverItem::Steps, steps),
            (
                self.spread_below_clocks < 1 << 20,
                DriverItem::Threshold,
                f64::from(self.spread_below_clocks),
            ),
        ];
        let wrong = in_order.into_iter().find(|(is_right, _, _)| !is_right);
        wrong.map(|(_, item, value)| (item, value))
    }
}

impl DriversConfiguration {
    /// Checks every number, and microsteps against the machine's steps.
    ///
    /// # Errors
    /// [`WrongDriver`], the first that is found.
    pub fn check(&self, machine: &MachineConfiguration) -> Result<(), WrongDriver> {
        let extruder = core::iter::once(machine.extruder.steps_per_mm3);
        let joints = machine.joints.iter().map(|joint| joint.steps_per_unit);
        let copies = machine.motors.copies.iter().map(|joint| {
            let joint = machine.joints.get(usize::from(*joint));
            joint.map_or(0.0, |joint| joint.steps_per_unit)
        });
        let mut steps = joints.chain(extruder).chain(copies);
        for (motor, driver) in self.drivers.iter().enumerate() {
            let steps_per_unit = steps.next();
            let Some(driver) = driver else { continue };
            let wrong = match steps_per_unit {
                Some(steps_per_unit) => driver.wrong(steps_per_unit),
                None => Some((DriverItem::Motor, motor as f64)),
            };
            if let Some((item, value)) = wrong {
                return Err(WrongDriver { motor, item, value });
            }
        }
        Ok(())
    }
}
