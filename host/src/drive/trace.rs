//! Recorded steps -> joint positions -> forward kinematics -> poses, compared with the plan.
//!
//! [`SegmentStream`] and [`MotionRecord`] -> [`TraceFigures`]. Poses are compared just before and just
//! after every step and at every servo tick. The constant delay between a pose's evaluation and its steps
//! ([`headway_firmware::steps::delay::motion_delay_s`]) is removed. Step times are compared with the
//! exact crossing of the planned joint position through n + 1/2; where a joint hardly moves the crossing
//! time is not defined to microseconds, so they are compared from [`STEP_TIME_SPEED_MIN_STEPS_S`] on. Not
//! covered: the extruder's step times; its final position is checked by volume and count.

use crate::drive::extruder_losses::ExtruderLosses;
use crate::drive::joint_track::JointTrack;
use crate::drive::plan_curve::{PlanCursor, stream_ticks};
use crate::drive::record::{MotionRecord, Step};
use crate::drive::servo_walk::{Interval, ServoWalk};
use crate::job::SegmentStream;
use headway_firmware::configuration::{JOINTS_MAX, MOTORS_MAX, MachineConfiguration};
use headway_firmware::design::STEP_THRESHOLD_BIAS;
use headway_firmware::kinematics::forward;
use headway_firmware::kinematics::pose::Pose;
use headway_firmware::steps::STEP;
use headway_protocol::segment::FlowAction;
use headway_protocol::units::{CHANNEL_VOLUME, CHANNELS};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Joint speed from which step times are compared: at 1000 steps/s, 10⁻³ step of f32 rounding is 1
/// us.
pub const STEP_TIME_SPEED_MIN_STEPS_S: f64 = 1000.0;
/// Of the deposit, where the motor makes up for losses.
const LOSSES_ERROR_MAX_PCT: f64 = 0.1;
/// Servo ticks between two samples of the joints, to count their turns: 32 ms.
const TURNS_EVERY_TICKS: usize = 64;
/// Servo ticks between two evaluations of the effect of half a step.
const HALF_STEP_EVERY_TICKS: i64 = 64;

/// How far the steps are from the plan.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TraceFigures {
    /// Largest distance of the tip, at any step.
    pub tip_error_um_max: f64,
    /// The same, root mean square over the servo ticks.
    pub tip_error_um_rms: f64,
    /// Largest angle between the tool axes.
    pub axis_error_mrad_max: f64,
    /// Largest difference of heading.
    pub heading_error_mrad_max: f64,
    /// Deposited volume against the plan's, at the end.
    pub volume_error_pct: f64,
    /// Largest distance of a step from the exact crossing.
    pub step_time_error_us_max: f64,
    /// The same, root mean square.
    pub step_time_error_us_rms: f64,
    /// Largest effect of half a step of every joint at the tip.
    pub half_step_um_max: f64,
    /// Largest effect of half a step of every joint on the heading.
    pub half_step_mrad_max: f64,
    /// Largest distance of the shaped path from the planned one, where joints are shaped; all the errors
    /// above are then those from the shaped plan.
    #[serde(default)]
    pub shaping_error_um_max: f64,
    /// Counts of the last pose: joints, then the extruder, with what it loses.
    pub expected_counts: Vec<i64>,
    /// Steps of the extruder by which its losses are made up for.
    #[serde(default)]
    pub lost_steps: i64,
    /// Counts reached by the steps.
    pub final_counts: Vec<i64>,
}

impl TraceFigures {
    /// The last pose is reached: exactly, but for an extruder's losses, which follow the rate of every moment, here and
    /// on the board with roundings of their own.
    pub fn is_at_the_end(&self) -> bool {
        let joints = |counts: &[i64]| counts.split_last().map(|(_, joints)| joints.to_vec());
        match self.lost_steps {
            0 => self.final_counts == self.expected_counts,
            _ => {
                joints(&self.final_counts) == joints(&self.expected_counts)
                    && self.volume_error_pct <= LOSSES_ERROR_MAX_PCT
            }
        }
    }
}

/// Compares a record with its plan.
pub fn compare(
    stream: &SegmentStream,
    machine: &MachineConfiguration,
    record: &MotionRecord,
) -> TraceFigures {
    let mut comparison = Comparison::new(machine);
    let mut losses = ExtruderLosses::new(machine);
    let mut walk = ServoWalk::new(stream, machine, record);
    while let Some(interval) = walk.next_interval() {
        comparison.take(&interval);
        losses.add(interval.window[1].channels[CHANNEL_VOLUME]);
    }
    let motors = machine.joints.len() + 1;
    let mut expected = expected_counts(stream, machine);
    let lost_steps = (losses.sum_mm3() * machine.extruder.steps_per_mm3).round() as i64;
    expected[machine.joints.len()] += lost_steps;
    let mut figures = comparison.figures();
    figures.shaping_error_um_max = walk.shaping_error_mm() * 1e3;
    let counts = record.final_counts();
    figures.volume_error_pct = volume_error_pct(stream, machine, record, &expected);
    figures.expected_counts = expected[..motors].to_vec();
    figures.lost_steps = lost_steps;
    figures.final_counts = counts[..motors].to_vec();
    figures
}

/// The whole number of steps nearest to a position, with the controller's rule for exact halves.
pub(crate) fn count_of(position_steps: f64) -> i64 {
    let bias = STEP_THRESHOLD_BIAS as f64 / STEP as f64;
    (position_steps + 0.5 + bias).floor() as i64
}

/// Step counts of the joints' motors at joint positions, mm and rad.
fn counts_of_joints(
    joints: &[f64; JOINTS_MAX],
    machine: &MachineConfiguration,
) -> [i64; MOTORS_MAX] {
    let mut steps = [0.0; JOINTS_MAX];
    for (index, joint) in machine.joints.iter().enumerate() {
        steps[index] = joints[index] * joint.steps_per_unit;
    }
    let motors = machine.motors.motor_steps(&steps);
    let mut counts = [0; MOTORS_MAX];
    for (count, steps) in counts.iter_mut().zip(motors) {
        *count = count_of(steps);
    }
    counts
}

/// Step counts at rest on a pose with its deposited volume, without primes and retracts.
pub fn counts_at(channels: &[f64; CHANNELS], machine: &MachineConfiguration) -> [i64; MOTORS_MAX] {
    let joints = JointTrack::new(machine).joints(channels);
    let mut counts = counts_of_joints(&joints.unwrap_or_default(), machine);
    let volume_steps = channels[CHANNEL_VOLUME] * machine.extruder.steps_per_mm3;
    counts[machine.joints.len()] = count_of(volume_steps);
    counts
}

/// Counts of the stream's last pose and volume, without the extruder's losses: joints in order, then the extruder.
pub fn expected_counts(
    stream: &SegmentStream,
    machine: &MachineConfiguration,
) -> [i64; MOTORS_MAX] {
    let mut cursor = PlanCursor::new(stream);
    let mut track = JointTrack::new(machine);
    let (mut end, mut joints) = ([0.0; CHANNELS], None);
    let last_tick = stream_ticks(&stream.knots);
    let ticks = (0..last_tick).step_by(TURNS_EVERY_TICKS);
    for tick in ticks.chain([last_tick]) {
        end = cursor.position(tick as f64);
        joints = track.joints(&end);
    }
    let mut counts = counts_of_joints(&joints.unwrap_or_default(), machine);
    let net_units: i64 = stream
        .events
        .iter()
        .map(|event| match event.action {
            FlowAction::Prime => i64::from(event.volume_units),
            FlowAction::Retract => -i64::from(event.volume_units),
        })
        .sum();
    let volume_mm3 =
        end[CHANNEL_VOLUME] + net_units as f64 / stream.units.per_natural(CHANNEL_VOLUME);
    counts[machine.joints.len()] = count_of(volume_mm3 * machine.extruder.steps_per_mm3);
    counts
}

/// Difference between the extruder's displacement and the planned one, as a share of the deposited
/// volume.
fn volume_error_pct(
    stream: &SegmentStream,
    machine: &MachineConfiguration,
    record: &MotionRecord,
    expected: &[i64; MOTORS_MAX],
) -> f64 {
    let mut cursor = PlanCursor::new(stream);
    let start_mm3 = cursor.position(0.0)[CHANNEL_VOLUME];
    let end_mm3 = cursor.position(stream_ticks(&stream.knots) as f64)[CHANNEL_VOLUME];
    let deposited_mm3 = end_mm3 - start_mm3;
    let extruder = machine.joints.len();
    let steps_per_mm3 = machine.extruder.steps_per_mm3;
    let planned_steps = expected[extruder] - record.start_counts[extruder];
    let made_steps = record.steps.counts()[extruder];
    let error_mm3 = (made_steps - planned_steps).abs() as f64 / steps_per_mm3;
    // Without any flow the error is relative to one step.
    100.0 * error_mm3 / deposited_mm3.max(1.0 / steps_per_mm3)
}

/// Running comparison.
struct Comparison<'a> {
    machine: &'a MachineConfiguration,
    tip_error_max_mm: f64,
    tip_error_square_sum_mm2: f64,
    samples: u64,
    axis_error_max_rad: f64,
    heading_error_max_rad: f64,
    half_step_max_mm: f64,
    half_step_max_rad: f64,
    step_error_max_s: f64,
    step_error_square_sum_s2: f64,
    steps_judged: u64,
}

impl<'a> Comparison<'a> {
    fn new(machine: &'a MachineConfiguration) -> Self {
        Comparison {
            machine,
            tip_error_max_mm: 0.0,
            tip_error_square_sum_mm2: 0.0,
            samples: 0,
            axis_error_max_rad: 0.0,
            heading_error_max_rad: 0.0,
            half_step_max_mm: 0.0,
            half_step_max_rad: 0.0,
            step_error_max_s: 0.0,
            step_error_square_sum_s2: 0.0,
            steps_judged: 0,
        }
    }

    fn take(&mut self, interval: &Interval<'_>) {
        let mut counts = interval.counts;
        let error_mm = self.pose_error_mm(interval, 0.0, &counts);
        self.tip_error_square_sum_mm2 += error_mm * error_mm;
        self.samples += 1;
        let mut steps = interval.steps;
        while let Some(&(place, first)) = steps.first() {
            let together = steps.partition_point(|(_, step)| step.tick == first.tick);
            let (now, rest) = steps.split_at(together);
            steps = rest;
            if now
                .iter()
                .all(|(_, step)| usize::from(step.motor) >= self.machine.joints.len())
            {
                continue;
            }
            self.pose_error_mm(interval, place, &counts);
            for (_, step) in now {
                counts[usize::from(step.motor)] += if step.forward { 1 } else { -1 };
                self.judge_step_time(interval, place, step, &counts);
            }
            self.pose_error_mm(interval, place, &counts);
        }
        if interval.tick.rem_euclid(HALF_STEP_EVERY_TICKS) == 0 {
            self.look_at_half_steps(interval);
        }
    }

    /// Notes the error of the pose that the counts make and returns the tip's.
    fn pose_error_mm(
        &mut self,
        interval: &Interval<'_>,
        place: f64,
        counts: &[i64; MOTORS_MAX],
    ) -> f64 {
        let made = pose_of_counts(self.machine, counts);
        let planned = Pose::from_channels(&interval.channels(place));
        let tip_mm = (made.tip_mm - planned.tip_mm).norm();
        let axis_rad = (made.tilt_rad - planned.tilt_rad).norm();
        let heading_rad = turn_between(made.heading_rad, planned.heading_rad);
        self.tip_error_max_mm = self.tip_error_max_mm.max(tip_mm);
        self.axis_error_max_rad = self.axis_error_max_rad.max(axis_rad);
        self.heading_error_max_rad = self.heading_error_max_rad.max(heading_rad);
        tip_mm
    }

    fn judge_step_time(
        &mut self,
        interval: &Interval<'_>,
        place: f64,
        step: &Step,
        counts: &[i64; MOTORS_MAX],
    ) {
        let motor = usize::from(step.motor);
        if motor >= self.machine.joints.len() {
            return;
        }
        let servo_hz = f64::from(self.machine.servo_hz);
        let threshold = counts[motor] as f64 + if step.forward { -0.5 } else { 0.5 };
        // Slope over a tenth of the interval, then one Newton step to the crossing.
        let motors = &self.machine.motors;
        let ahead = interval.motor_steps(motors, motor, place + 0.05);
        let behind = interval.motor_steps(motors, motor, place - 0.05);
        let slope = (ahead - behind) / 0.1;
        if slope.abs() * servo_hz < STEP_TIME_SPEED_MIN_STEPS_S {
            return;
        }
        let error_ticks = (interval.motor_steps(motors, motor, place) - threshold) / slope;
        let error_s = error_ticks.abs() / servo_hz;
        self.step_error_max_s = self.step_error_max_s.max(error_s);
        self.step_error_square_sum_s2 += error_s * error_s;
        self.steps_judged += 1;
    }

    /// All combinations of half a step more or less of every joint's motor.
    fn look_at_half_steps(&mut self, interval: &Interval<'_>) {
        let steps = &self
            .machine
            .motors
            .motor_steps(&interval.window[1].joint_steps);
        let here = pose_of_steps(self.machine, steps);
        for signs in 0..1u32 << self.machine.joints.len() {
            let moved =
                std::array::from_fn(|joint| steps[joint] + f64::from(signs >> joint & 1) - 0.5);
            let pose = pose_of_steps(self.machine, &moved);
            let tip_mm = (pose.tip_mm - here.tip_mm).norm();
            let heading_rad = turn_between(pose.heading_rad, here.heading_rad);
            self.half_step_max_mm = self.half_step_max_mm.max(tip_mm);
            self.half_step_max_rad = self.half_step_max_rad.max(heading_rad);
        }
    }

    fn figures(&self) -> TraceFigures {
        let mean = |sum: f64, count: u64| (sum / count.max(1) as f64).sqrt();
        TraceFigures {
            tip_error_um_max: self.tip_error_max_mm * 1e3,
            tip_error_um_rms: mean(self.tip_error_square_sum_mm2, self.samples) * 1e3,
            axis_error_mrad_max: self.axis_error_max_rad * 1e3,
            heading_error_mrad_max: self.heading_error_max_rad * 1e3,
            step_time_error_us_max: self.step_error_max_s * 1e6,
            step_time_error_us_rms: mean(self.step_error_square_sum_s2, self.steps_judged) * 1e6,
            half_step_um_max: self.half_step_max_mm * 1e3,
            half_step_mrad_max: self.half_step_max_rad * 1e3,
            ..TraceFigures::default()
        }
    }
}

/// Angle between two headings; whole turns do not count.
fn turn_between(one_rad: f64, other_rad: f64) -> f64 {
    let turns = (one_rad - other_rad) / TAU;
    TAU * (turns - turns.round()).abs()
}

/// Pose of integer step counts.
pub fn pose_of_counts(machine: &MachineConfiguration, counts: &[i64; MOTORS_MAX]) -> Pose<f64> {
    pose_of_steps(machine, &std::array::from_fn(|joint| counts[joint] as f64))
}

/// Pose of the joints' motors in steps.
fn pose_of_steps(machine: &MachineConfiguration, steps: &[f64; JOINTS_MAX]) -> Pose<f64> {
    let steps = machine.motors.joint_steps(steps);
    let mut positions = [0.0; JOINTS_MAX];
    for (index, joint) in machine.joints.iter().enumerate() {
        positions[index] = steps[index] / joint.steps_per_unit;
    }
    forward(&machine.kinematics, &positions)
}

#[cfg(test)]
#[path = "trace_tests.rs"]
mod tests;
