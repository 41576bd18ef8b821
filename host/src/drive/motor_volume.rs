//! The extruder's steps as a volume over time.
//!
//! In: recorded steps, the machine. Out: what the motor pushes in each servo tick from the job's first segment on, mm³, and its
//! rate there, mm³/s, with the constant delay of all motors removed. A step is made where the volume passes a half: between two
//! it is a straight line, none between a forward and a backward one. Before the first and after the last it rests.

use crate::drive::record::MotionRecord;
use headway_firmware::configuration::MachineConfiguration;
use headway_firmware::steps::delay::motion_delay_s;
use std::collections::VecDeque;

/// The rate of a moment is the mean over this time before and after it, s: some steps of any extruder that prints, and less
/// than any change of flow that it can follow.
const RATE_MEAN_S: f64 = 2e-3;

/// The walk over the steps.
pub(super) struct MotorVolume<'a> {
    /// Servo tick and mm³ of each step.
    steps: Box<dyn Iterator<Item = [f64; 2]> + 'a>,
    last: [f64; 2],
    next: Option<[f64; 2]>,
    /// At the servo ticks around the one that is due.
    around_mm3: VecDeque<f64>,
    newest_tick: i64,
    tick_s: f64,
}

impl<'a> MotorVolume<'a> {
    /// Of the extruder, before the first servo tick.
    pub(super) fn new(machine: &MachineConfiguration, record: &'a MotionRecord) -> Self {
        let extruder = machine.joints.len();
        let servo_hz = f64::from(machine.servo_hz);
        let ticks_per_servo_tick = f64::from(machine.step_hz) / servo_hz;
        let begins = motion_delay_s(machine) * servo_hz + record.first_servo_tick as f64;
        let step_mm3 = 1.0 / machine.extruder.steps_per_mm3;
        let mut count = 0i64;
        let own = record.steps.iter();
        let own = own.filter(move |step| usize::from(step.motor) == extruder);
        let mut steps = own.map(move |step| {
            let before = count;
            count += if step.forward { 1 } else { -1 };
            let half = (before + count) as f64 / 2.0;
            [
                step.tick as f64 / ticks_per_servo_tick - begins,
                half * step_mm3,
            ]
        });
        let next = steps.next();
        let around = (RATE_MEAN_S * servo_hz).round().max(1.0) as i64;
        let mut volume = Self {
            steps: Box::new(steps),
            last: next.map_or([0.0; 2], |[tick, mm3]| [tick - 1.0, mm3]),
            next,
            around_mm3: VecDeque::new(),
            newest_tick: -around - 1,
            tick_s: 1.0 / servo_hz,
        };
        (-around..=around).for_each(|_| volume.look_ahead());
        volume
    }

    /// The volume at the next servo tick.
    fn look_ahead(&mut self) {
        self.newest_tick += 1;
        let tick = self.newest_tick as f64;
        while let Some(next) = self.next
            && next[0] <= tick
        {
            self.last = next;
            self.next = self.steps.next();
        }
        let [from, mm3] = self.last;
        let [to, next_mm3] = self.next.unwrap_or([f64::INFINITY, mm3]);
        let way_mm3 = (next_mm3 - mm3) * (tick - from) / (to - from);
        self.around_mm3.push_back(mm3 + way_mm3);
    }

    /// What is pushed in the next tick, from tick 0 on, and at which rate.
    pub(super) fn next_mm3_and_rate(&mut self) -> [f64; 2] {
        self.look_ahead();
        let last = self.around_mm3.len() - 1;
        let gained = |from: usize, to: usize| self.around_mm3[to] - self.around_mm3[from];
        let mm3 = gained((last - 1) / 2, last.div_ceil(2));
        let mm3_s = gained(0, last) / (last as f64 * self.tick_s);
        self.around_mm3.pop_front();
        [mm3, mm3_s]
    }
}
