//! Walks through plan and recorded steps together, one servo interval at a time.
//!
//! Both are on one clock: servo ticks since the segment time began to run, with the constant delay
//! between a pose's evaluation and its steps removed. At tick i the controller was at segment time u_i
//! (which it reports); plan and joint positions are exact there and interpolated between ticks by the
//! cubic through four of them, which is accurate to a nanometre for jerk-limited motion. So a print
//! with holds is compared along the path like any other. Where joints are shaped, the plan is the
//! shaped one (`shaped_plan.rs`).

use crate::drive::joint_track::JointTrack;
use crate::drive::plan_curve::PlanCursor;
use crate::drive::record::{MotionRecord, Step};
use crate::drive::shaped_plan::ShapedPlan;
use crate::job::SegmentStream;
use headway_firmware::configuration::motors::MotorMatrix;
use headway_firmware::configuration::{JOINTS_MAX, MOTORS_MAX, MachineConfiguration};
use headway_firmware::steps::delay::{Delays, motion_delay_s};
use headway_protocol::units::CHANNELS;

/// Servo ticks walked past the end of the motion, so that its last steps are seen and averages over
/// several ticks reach the end.
const TAIL_TICKS: usize = 64;

/// Plan at one servo tick.
#[derive(Clone, Copy, Debug)]
pub struct PlanSample {
    /// Segment time, servo ticks.
    pub segment_ticks: f64,
    /// Channels, natural units.
    pub channels: [f64; CHANNELS],
    /// Joint positions, motor steps (not whole).
    pub joint_steps: [f64; JOINTS_MAX],
}

/// Where the controller was at each servo tick.
#[derive(Debug)]
pub(super) struct PlanSamples<'a> {
    cursor: PlanCursor<'a>,
    machine: &'a MachineConfiguration,
    track: JointTrack,
    rates_q16: &'a [u32],
    next: usize,
    segment_q16: u64,
    last_joints: [f64; JOINTS_MAX],
}

impl PlanSamples<'_> {
    pub(super) fn next(&mut self) -> PlanSample {
        let segment_ticks = self.segment_q16 as f64 / 65_536.0;
        let rate = self.rates_q16.get(self.next).copied().unwrap_or(0);
        self.next += 1;
        self.segment_q16 += u64::from(rate);
        let channels = self.cursor.position(segment_ticks);
        // A pose without joints was refused at planning; the firmware would fault there.
        if let Some(joints) = self.track.joints(&channels) {
            for (index, joint) in self.machine.joints.iter().enumerate() {
                self.last_joints[index] = joints[index] * joint.steps_per_unit;
            }
        }
        PlanSample {
            segment_ticks,
            channels,
            joint_steps: self.last_joints,
        }
    }
}

/// One servo interval: the plan around it and the steps in it.
#[derive(Debug)]
pub struct Interval<'w> {
    /// Servo ticks since the segment time began to run; the first intervals are before it.
    pub tick: i64,
    /// Plan at ticks -1, 0, 1, 2 of the interval.
    pub window: &'w [PlanSample; 4],
    /// Step counts at the interval's start.
    pub counts: [i64; MOTORS_MAX],
    /// Steps with their place in the interval, 0..1.
    pub steps: &'w [(f64, Step)],
    /// Segment time passed in it, 2^-16 ticks.
    pub rate_q16: u32,
}

impl Interval<'_> {
    /// Weights of the window for the place `x` (0..1) in the interval: cubic Lagrange.
    pub fn weights(x: f64) -> [f64; 4] {
        [
            -x * (x - 1.0) * (x - 2.0) / 6.0,
            (x + 1.0) * (x - 1.0) * (x - 2.0) / 2.0,
            -(x + 1.0) * x * (x - 2.0) / 2.0,
            (x + 1.0) * x * (x - 1.0) / 6.0,
        ]
    }

    /// Planned channels at the place `x` of the interval.
    pub fn channels(&self, x: f64) -> [f64; CHANNELS] {
        let weights = Self::weights(x);
        std::array::from_fn(|channel| {
            (0..4)
                .map(|i| weights[i] * self.window[i].channels[channel])
                .sum()
        })
    }

    /// Planned position of a joint's motor at the place `x`, steps.
    pub fn motor_steps(&self, motors: &MotorMatrix, motor: usize, x: f64) -> f64 {
        let pair = motors.pair.as_ref();
        let Some(pair) = pair.filter(|pair| pair.joints.contains(&(motor as u8))) else {
            return self.joint_steps(motor, x);
        };
        let [a, b] = pair.joints.map(usize::from);
        let sign = if motor == a { 1.0 } else { -1.0 };
        self.joint_steps(a, x) + sign * self.joint_steps(b, x)
    }

    /// Planned position of a joint at the place `x`, motor steps.
    pub fn joint_steps(&self, joint: usize, x: f64) -> f64 {
        let weights = Self::weights(x);
        (0..4)
            .map(|i| weights[i] * self.window[i].joint_steps[joint])
            .sum()
    }
}

/// The walk over a complete record.
pub struct ServoWalk<'a, I: Iterator<Item = Step>> {
    samples: ShapedPlan<'a>,
    window: [PlanSample; 4],
    rates_q16: &'a [u32],
    steps: std::iter::Peekable<I>,
    pending: Vec<(f64, Step)>,
    counts: [i64; MOTORS_MAX],
    tick: i64,
    end_tick: i64,
    ticks_per_servo_tick: f64,
    delay_ticks: f64,
    first_servo_tick: f64,
}

impl<'a> ServoWalk<'a, Box<dyn Iterator<Item = Step> + 'a>> {
    /// Begins two ticks before the motion.
    pub fn new(
        stream: &'a SegmentStream,
        machine: &'a MachineConfiguration,
        record: &'a MotionRecord,
    ) -> Self {
        let plan = PlanSamples {
            cursor: PlanCursor::new(stream),
            machine,
            track: JointTrack::new(machine),
            rates_q16: &record.rates_q16,
            next: 0,
            segment_q16: 0,
            last_joints: [0.0; JOINTS_MAX],
        };
        let mut samples = ShapedPlan::new(plan, machine);
        let first = samples.next();
        let settle_ticks = Delays::of(machine).unwrap_or_default().settle_ticks as usize;
        ServoWalk {
            samples,
            window: [first; 4],
            steps: (Box::new(record.steps.iter()) as Box<dyn Iterator<Item = Step>>).peekable(),
            pending: Vec::new(),
            counts: record.start_counts,
            tick: -3,
            rates_q16: &record.rates_q16,
            end_tick: (record.rates_q16.len() + TAIL_TICKS + settle_ticks) as i64,
            ticks_per_servo_tick: f64::from(machine.step_hz) / f64::from(machine.servo_hz),
            delay_ticks: motion_delay_s(machine) * f64::from(machine.servo_hz),
            first_servo_tick: record.first_servo_tick as f64,
        }
    }

    /// Largest distance so far of the shaped tip from the planned path, mm; 0 where no joint is shaped.
    pub fn shaping_error_mm(&self) -> f64 {
        self.samples.off_path_mm()
    }

    /// The next interval, `None` after the end of the motion.
    pub fn next_interval(&mut self) -> Option<Interval<'_>> {
        for (_, step) in self.pending.drain(..) {
            self.counts[usize::from(step.motor)] += if step.forward { 1 } else { -1 };
        }
        self.tick += 1;
        if self.tick > self.end_tick {
            return None;
        }
        // Before tick 0 the window is filled with the start, which is at rest.
        let next = if self.tick < -1 {
            self.window[3]
        } else {
            self.samples.next()
        };
        self.window = [self.window[1], self.window[2], self.window[3], next];
        while let Some(step) = self.steps.peek() {
            let time = step.tick as f64 / self.ticks_per_servo_tick
                - self.delay_ticks
                - self.first_servo_tick;
            let place = time - self.tick as f64;
            if place >= 1.0 {
                break;
            }
            self.pending.push((place.max(0.0), *step));
            self.steps.next();
        }
        let rate = usize::try_from(self.tick)
            .ok()
            .and_then(|tick| self.rates_q16.get(tick));
        Some(Interval {
            tick: self.tick,
            window: &self.window,
            counts: self.counts,
            steps: &self.pending,
            rate_q16: rate.copied().unwrap_or(0),
        })
    }
}
