//! Checks the two motors of a pair against their own limits.
//!
//! In: the joints' first to third derivatives, mm and s. Out: the sampler's figures. Motors are sum and difference of
//! two joints.

use super::{Limit, Sampler, note};
use headway_firmware::configuration::JOINTS_MAX;

impl Sampler<'_> {
    /// Samples the motors of a pair, if there is one.
    pub(super) fn pair(
        &mut self,
        [velocity, acceleration, jerk]: [[f64; JOINTS_MAX]; 3],
        time_s: f64,
    ) {
        let share = self.settings.plan_share;
        let Some(pair) = &self.settings.machine.motors.pair else {
            return;
        };
        let [speed, bend, jerk] = [velocity, acceleration, jerk].map(|of| pair.motors_of(&of));
        for (place, joint) in pair.joints.into_iter().enumerate() {
            let what = Limit::Motor(joint.into());
            let figures = &mut self.figures;
            for (peak, value, limit) in [
                (&mut figures.velocity, speed[place], pair.speed_max),
                (
                    &mut figures.acceleration,
                    bend[place],
                    pair.acceleration_max,
                ),
                (&mut figures.jerk, jerk[place], pair.jerk_max),
            ] {
                note(peak, value / (limit * share), what, time_s);
            }
        }
    }
}
