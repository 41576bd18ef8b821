//! Switches: speeds and distances of the search.

use super::first_wrong;
use crate::configuration::homing::{HomingConfiguration, JointHoming};
use crate::configuration::{
    ConfigurationError, JointConfiguration, MachineConfiguration, WrongNumber,
};

impl JointHoming {
    /// The first number that cannot be.
    pub fn wrong(&self, limits: &JointConfiguration) -> Option<WrongNumber> {
        let speed_fits = |speed: f64| speed > 0.0 && speed <= limits.speed_max;
        let way_fits = |way: f64| way > 0.0 && way.is_finite();
        let (fast, slow) = (self.fast_natural_s, self.slow_natural_s);
        let (back_off, travel) = (self.back_off_natural, self.travel_max_natural);
        let position = self.position_natural;
        first_wrong(&[
            (speed_fits(fast), 1, fast),
            (speed_fits(slow), 2, slow),
            (way_fits(back_off), 3, back_off),
            (way_fits(travel), 4, travel),
            (position.is_finite(), 5, position),
        ])
    }
}

impl HomingConfiguration {
    /// Checks every number.
    ///
    /// # Errors
    /// [`ConfigurationError::Joint`] with the first joint that is wrong.
    pub fn check(&self, machine: &MachineConfiguration) -> Result<(), ConfigurationError> {
        for homing in &self.joints {
            let joint = usize::from(homing.joint);
            let wrong = Err(ConfigurationError::Joint(joint));
            let Some(limits) = machine.joints.get(joint) else {
                return wrong;
            };
            if homing.wrong(limits).is_some() {
                return wrong;
            }
        }
        Ok(())
    }
}
