//! The machine: joints, extruder, rates, motors, shapers.

use super::{first_wrong, is_positive};
use crate::configuration::flow_curves::CurvePoints;
use crate::configuration::motors::MotorMatrix;
use crate::configuration::shaping::Shaper;
use crate::configuration::{
    ConfigurationError, ExtruderConfiguration, JointConfiguration, Kinematics, MOTORS_MAX,
    MachineConfiguration, WrongNumber,
};
use crate::steps::delay::Delays;
use crate::steps::shaping::{DAMPING_MAX, Shape, shapes};

/// Most steps per mm, rad or mm³: the fixed-point scale holds it, and no driver needs it.
const STEPS_PER_UNIT_MAX: f64 = 30_000.0;
/// Of a slope, by points in single precision.
const ROUNDING: f64 = 1e-6;

impl MachineConfiguration {
    /// Checks everything that the firmware relies on.
    ///
    /// # Errors
    /// [`ConfigurationError`], the first that is found.
    pub fn check(&self) -> Result<(), ConfigurationError> {
        let needed = crate::kinematics::joint_count(&self.kinematics);
        let given = self.joints.len();
        if needed != given {
            return Err(ConfigurationError::JointCount { needed, given });
        }
        let kinematics_are_right = match &self.kinematics {
            Kinematics::Planar => true,
            Kinematics::Gantry { pivot_length_mm } => pivot_length_mm.is_finite(),
            Kinematics::Trunnion { centre_mm, .. } => centre_mm.iter().all(|v| v.is_finite()),
            Kinematics::Arm6 { arm, .. } => arm.is_right(),
            Kinematics::Axes { axes, .. } => axes.is_right(),
        };
        if !kinematics_are_right || self.kinematics.solution() >= self.kinematics.solutions() {
            return Err(ConfigurationError::Kinematics);
        }
        let ticks = self.interval_ticks();
        let range = crate::steps::INTERVAL_TICKS_MIN..=crate::steps::INTERVAL_TICKS_MAX;
        if !range.contains(&ticks) || ticks.checked_mul(self.servo_hz) != Some(self.step_hz) {
            return Err(ConfigurationError::TickRates);
        }
        if let Some(joint) = self.joints.iter().position(|joint| joint.wrong().is_some()) {
            return Err(ConfigurationError::Joint(joint));
        }
        if self.wrong_extruder().is_some() {
            return Err(ConfigurationError::Joint(given));
        }
        if !self.motors.is_right(&self.joints) {
            return Err(ConfigurationError::Motors);
        }
        wrong_shaper(self).map_or(Ok(()), |joint| Err(ConfigurationError::Shaper(joint)))
    }
}

impl MachineConfiguration {
    /// The first number of the extruder or of its curves that cannot be; of a point, its flow.
    pub fn wrong_extruder(&self) -> Option<WrongNumber> {
        let curves = &self.curves;
        let [loss, advance] = curves.wrong();
        let flow = |points: &CurvePoints, at: usize| {
            points.get(at).map_or(0.0, |[flow, _]| f64::from(*flow))
        };
        let bounded = curves.advance_bounds().is_none_or(|[most_s, _]| {
            most_s <= self.extruder.pressure_advance_s * (1.0 + ROUNDING)
        });
        let of_extruder = self.extruder.wrong();
        of_extruder
            .or_else(|| loss.map(|at| (8, flow(&curves.loss, at))))
            .or_else(|| advance.map(|at| (9, flow(&curves.advance, at))))
            .or_else(|| (!bounded).then_some((6, self.extruder.pressure_advance_s)))
    }
}

impl JointConfiguration {
    /// The first number that cannot be.
    pub fn wrong(&self) -> Option<WrongNumber> {
        let positive = |item, value: f64| (is_positive(&value), item, value);
        first_wrong(&[
            (self.position_min < self.position_max, 1, self.position_min),
            positive(2, self.speed_max),
            positive(3, self.acceleration_max),
            positive(4, self.jerk_max),
            positive(5, self.steps_per_unit),
            (fits(self.steps_per_unit), 5, self.steps_per_unit),
        ])
    }
}

impl ExtruderConfiguration {
    /// The first number that cannot be.
    pub fn wrong(&self) -> Option<WrongNumber> {
        let positive = |item, value: f64| (is_positive(&value), item, value);
        let (advance_s, window_ms) = (self.pressure_advance_s, self.pressure_advance_window_ms);
        let advances = advance_s >= 0.0 && advance_s.is_finite();
        first_wrong(&[
            positive(2, self.speed_max_mm3_s),
            positive(3, self.acceleration_max_mm3_s2),
            positive(5, self.steps_per_mm3),
            (fits(self.steps_per_mm3), 5, self.steps_per_mm3),
            (advances, 6, advance_s),
            (window_ms >= 0.0, 7, window_ms),
        ])
    }
}

impl MotorMatrix {
    /// Whether it fits the joints.
    pub fn is_right(&self, joints: &[JointConfiguration]) -> bool {
        let motors = joints.len() + 1 + self.copies.len();
        let pair_is_right = self.pair.as_ref().is_none_or(|pair| {
            let [a, b] = pair.joints.map(|joint| joints.get(usize::from(joint)));
            let fits = a.zip(b).is_some_and(|(a, b)| {
                !a.rotary && !b.rotary && a.steps_per_unit == b.steps_per_unit
            });
            let limits = [pair.speed_max, pair.acceleration_max, pair.jerk_max];
            // One axis alone moves a motor as fast as the axis.
            let are_right = |joint: &JointConfiguration| {
                let of_joint = [joint.speed_max, joint.acceleration_max, joint.jerk_max];
                let mut both = limits.iter().zip(of_joint);
                both.all(|(limit, least)| *limit >= least && limit.is_finite())
            };
            let are_right = a.is_some_and(are_right) && b.is_some_and(are_right);
            fits && are_right && pair.joints[0] != pair.joints[1]
        });
        let is_joint = |motor: &u8| usize::from(*motor) < joints.len();
        pair_is_right && motors <= MOTORS_MAX && self.copies.iter().all(is_joint)
    }
}

/// The first joint whose shaper cannot be run.
pub(crate) fn wrong_shaper(configuration: &MachineConfiguration) -> Option<usize> {
    let servo_hz = configuration.servo_hz;
    let mut shapers = configuration.shapers.iter();
    let wrong = shapers.position(|shaper| !shaper.is_right(servo_hz));
    wrong.or_else(|| {
        if Delays::of(configuration).is_some() {
            return None;
        }
        // The longest is the one to blame.
        let length = |shape: &Option<Shape>| shape.as_ref().map_or(0.0, Shape::length_ticks);
        let mut longest = (0, 0.0);
        for (joint, shape) in shapes(configuration).iter().enumerate() {
            if length(shape) > longest.1 {
                longest = (joint, length(shape));
            }
        }
        Some(longest.0)
    })
}

impl Shaper {
    /// The number to blame where it does not fit, with its place among the items of a refusal.
    pub(crate) fn wrong_number(&self) -> (u8, f64) {
        if (0.0..=DAMPING_MAX).contains(&self.damping) {
            (1, self.frequency_hz)
        } else {
            (2, self.damping)
        }
    }
}

fn fits(steps_per_unit: f64) -> bool {
    steps_per_unit <= STEPS_PER_UNIT_MAX
}
