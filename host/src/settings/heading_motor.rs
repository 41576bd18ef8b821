//! What the motor of the heading joint can do, from what a data sheet says of it.
//!
//! In: torque, inertias and gear ratio of `[drivers.c]`. Out: the greatest speed and acceleration of the nozzle's turn.
//! With i turns of the motor for one of the nozzle, the load J and the rotor M turn together: at the nozzle, the torque is
//! T i and the inertia J + M i², so that the acceleration is T i / (J + M i²), and the speed is the motor's divided by i.
//! Leaves out friction, which the torque that is given has to be reduced by, and the fall of the torque with the speed:
//! give the torque at top speed.

use super::Settings;
use super::check::in_range;
use crate::text::refusal::Refusal;

/// Torques of motors that turn nozzles, N m: from watch-sized steppers to servos.
const TORQUE_NM: [f64; 2] = [1e-4, 100.0];
/// g cm²: a rotor of 0.01 g cm² is smaller than any, a load of 10⁸ is 10 kg m².
const ROTOR_G_CM2: [f64; 2] = [0.01, 1e6];
const LOAD_G_CM2: [f64; 2] = [0.0, 1e8];
const RATIO: [f64; 2] = [0.01, 1000.0];
const SPEED_RPM: [f64; 2] = [1.0, 60_000.0];
/// Full steps of a motor for one of its own turns; 200 and 400 are usual.
const FULL_STEPS: [f64; 2] = [4.0, 2000.0];
/// A limit that was rounded in the file is not above the motor's.
const ROUNDED: f64 = 1.001;
const KG_M2_OF_G_CM2: f64 = 1e-7;
const RAD_S_OF_RPM: f64 = std::f64::consts::TAU / 60.0;

/// The motor of the joint that turns the nozzle, its gear and what hangs on it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeadingMotor {
    /// Torque that it holds up to its top speed, less friction.
    pub torque_nm: f64,
    /// Inertia of its rotor.
    pub rotor_inertia_g_cm2: f64,
    /// Inertia of all that turns with the nozzle, about the nozzle's axis.
    pub load_inertia_g_cm2: f64,
    /// Turns of the motor for one of the nozzle.
    pub gear_ratio: f64,
    /// Its top speed; `None` leaves the joint's.
    pub motor_speed_max_rpm: Option<f64>,
}

impl HeadingMotor {
    /// T i / (J + M i²).
    pub fn acceleration_max_rad_s2(&self) -> f64 {
        let ratio = self.gear_ratio;
        let inertia_g_cm2 = self.load_inertia_g_cm2 + self.rotor_inertia_g_cm2 * ratio * ratio;
        self.torque_nm * ratio / (inertia_g_cm2 * KG_M2_OF_G_CM2)
    }

    /// The motor's, divided by i.
    pub fn speed_max_rad_s(&self) -> Option<f64> {
        let motor_rpm = self.motor_speed_max_rpm?;
        Some(motor_rpm * RAD_S_OF_RPM / self.gear_ratio)
    }

    /// The ratio at which the load accelerates fastest: sqrt(J / M).
    pub fn fastest_ratio(&self) -> f64 {
        (self.load_inertia_g_cm2 / self.rotor_inertia_g_cm2).sqrt()
    }

    fn check(&self, joint: &str, full_steps_per_turn: Option<f64>) -> Result<(), Refusal> {
        let key = |name: &str| format!("drivers.{joint}.{name}");
        let within =
            |name: &str, value: f64, [low, high]: [f64; 2]| in_range(&key(name), value, low, high);
        within("torque_nm", self.torque_nm, TORQUE_NM)?;
        within("rotor_inertia_g_cm2", self.rotor_inertia_g_cm2, ROTOR_G_CM2)?;
        within("load_inertia_g_cm2", self.load_inertia_g_cm2, LOAD_G_CM2)?;
        within("gear_ratio", self.gear_ratio, RATIO)?;
        if let Some(rpm) = self.motor_speed_max_rpm {
            within("motor_speed_max_rpm", rpm, SPEED_RPM)?;
        }
        if let Some(full_steps) = full_steps_per_turn {
            let of_motor = "full_steps_per_turn divided by its gear_ratio, a turn of the motor,";
            within(of_motor, full_steps / self.gear_ratio, FULL_STEPS)?;
        }
        Ok(())
    }
}

impl Settings {
    /// Numbers of the heading joint's motor, against its driver's full steps.
    pub(super) fn check_heading_motor(&self) -> Result<(), Refusal> {
        let Some(motor) = &self.heading_motor else {
            return Ok(());
        };
        let number = self.heading_joint_number();
        let driver = number.and_then(|number| self.drivers.drivers.get(number).copied()?);
        let full_steps = driver.map(|driver| driver.full_steps_per_unit * std::f64::consts::TAU);
        motor.check(self.heading_joint_name().unwrap_or("c"), full_steps)
    }

    /// The lesser of the heading joint's limits and its motor's, rad/s and rad/s²; `None` where no joint follows the heading.
    pub fn heading_limits(&self) -> Option<[f64; 2]> {
        let joint = self.heading_joint()?;
        let motor = self.heading_motor.as_ref();
        let speed = motor.and_then(HeadingMotor::speed_max_rad_s);
        let acceleration = motor.map(HeadingMotor::acceleration_max_rad_s2);
        Some([
            joint.speed_max.min(speed.unwrap_or(f64::INFINITY)),
            joint
                .acceleration_max
                .min(acceleration.unwrap_or(f64::INFINITY)),
        ])
    }

    /// The motor's limits in words, and whether the joint's are above them.
    pub fn heading_motor_text(&self) -> Option<(String, bool)> {
        let (motor, joint) = (self.heading_motor.as_ref()?, self.heading_joint()?);
        let name = self.heading_joint_name()?;
        let acceleration = motor.acceleration_max_rad_s2();
        let speed = motor.speed_max_rad_s();
        let speed_text = speed.map_or(String::new(), |speed| {
            format!("{:.0}°/s and ", speed.to_degrees())
        });
        let is_above = joint.acceleration_max > ROUNDED * acceleration
            || speed.is_some_and(|speed| joint.speed_max > ROUNDED * speed);
        let text = format!(
            "the motor of {name} reaches {speed_text}{:.0}°/s² at the nozzle with a gear of {}; joints.{name} has \
             {:.0}°/s and {:.0}°/s²",
            acceleration.to_degrees(),
            motor.gear_ratio,
            joint.speed_max.to_degrees(),
            joint.acceleration_max.to_degrees(),
        );
        Some((text, is_above))
    }
}

#[cfg(test)]
mod tests {
    //! Goal: the limits are those of a motor that accelerates its load. Method: a run of small steps of time under the
    //! torque, with rotor and load as two bodies and the gear's reaction between them.
    use super::HeadingMotor;

    const MOTOR: HeadingMotor = HeadingMotor {
        torque_nm: 0.15,
        rotor_inertia_g_cm2: 20.0,
        load_inertia_g_cm2: 180.0,
        gear_ratio: 3.0,
        motor_speed_max_rpm: Some(900.0),
    };

    #[test]
    fn the_acceleration_is_that_of_two_geared_bodies() {
        for ratio in [0.5, 1.0, 3.0, 12.0] {
            let motor = HeadingMotor {
                gear_ratio: ratio,
                ..MOTOR
            };
            let (rotor, load) = (20.0 * 1e-7, 180.0 * 1e-7);
            // The gear passes the torque g to the rotor backwards and g i to the load; both turn in the ratio: by halving.
            let (mut low, mut high) = (0.0, 0.15);
            for _ in 0..200 {
                let gear = 0.5 * (low + high);
                let of_rotor = (0.15 - gear) / rotor / ratio;
                let of_load = gear * ratio / load;
                match of_load > of_rotor {
                    true => high = gear,
                    false => low = gear,
                }
            }
            let expected = low * ratio / load;
            let found = motor.acceleration_max_rad_s2();
            assert!(
                (found / expected - 1.0).abs() < 1e-9,
                "{ratio}: {found} for {expected}"
            );
        }
        // 900 turns a minute of the motor are 300 of the nozzle, 1800°/s.
        let speed = MOTOR.speed_max_rad_s().expect("a speed").to_degrees();
        assert!((speed - 1800.0).abs() < 1e-9);
        // No other ratio is faster.
        let fastest = MOTOR.fastest_ratio();
        let at = |ratio: f64| {
            HeadingMotor {
                gear_ratio: ratio,
                ..MOTOR
            }
            .acceleration_max_rad_s2()
        };
        assert!(at(fastest) > at(1.02 * fastest) && at(fastest) > at(0.98 * fastest));
    }
}
