//! A recording of a simulated controller: every step, and its position on the path at every servo
//! tick.
//!
//! Steps are packed into two bytes each, so ten million take 20 MB. Ticks are step ticks since the
//! controller's start-up; [`MotionRecord`] knows at which of them the job began.

use headway_firmware::configuration::MOTORS_MAX;
use headway_firmware::steps::output::StepOutput;

/// Step ticks of one chunk: the offsets within it take [`OFFSET_BITS`] bits of a packed step.
const CHUNK_TICKS: u64 = 1 << OFFSET_BITS;
const OFFSET_BITS: u32 = 12;
const MOTOR_BITS: u32 = 3;
const _: () = assert!(MOTORS_MAX == 1 << MOTOR_BITS);

/// One step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Step {
    /// Step tick since start-up.
    pub tick: u64,
    /// Motor: the joints in order, then the extruder.
    pub motor: u8,
    /// True towards larger positions.
    pub forward: bool,
}

/// Every step in order of time; steps of one tick in order of motors.
#[derive(Clone, Debug, Default)]
pub struct StepLog {
    /// Index of the first step of each chunk.
    chunk_starts: Vec<u64>,
    packed: Vec<u16>,
    directions: u8,
    /// Steps forward less steps back, since the log began.
    counts: [i64; MOTORS_MAX],
}

impl StepLog {
    /// Number of steps.
    pub fn len(&self) -> usize {
        self.packed.len()
    }

    /// True if nothing has moved.
    pub fn is_empty(&self) -> bool {
        self.packed.is_empty()
    }

    /// Steps forward less steps back of each motor.
    pub fn counts(&self) -> &[i64; MOTORS_MAX] {
        &self.counts
    }

    /// The steps in order.
    pub fn iter(&self) -> impl Iterator<Item = Step> + '_ {
        let mut chunk = 0;
        self.packed.iter().enumerate().map(move |(index, &packed)| {
            while self
                .chunk_starts
                .get(chunk + 1)
                .is_some_and(|&start| start <= index as u64)
            {
                chunk += 1;
            }
            unpack(chunk as u64, packed)
        })
    }

    /// A hash of every step: tick counted from `origin_tick`, motor, direction.
    pub fn digest(&self, origin_tick: u64) -> u64 {
        let mut digest = StepDigest::default();
        for step in self.iter() {
            let tick = step.tick.wrapping_sub(origin_tick);
            digest.add(&Step { tick, ..step });
        }
        digest.0
    }
}

/// A hash of steps, one after the other. Multiply and fold, with the 64-bit FNV offset and the golden
/// ratio: not cryptographic, any changed step changes it with near certainty.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StepDigest(pub u64);

impl Default for StepDigest {
    fn default() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }
}

impl StepDigest {
    /// The next step.
    pub fn add(&mut self, step: &Step) {
        let word = step.tick << 4 | u64::from(step.motor) << 1 | u64::from(step.forward);
        let mixed = (self.0 ^ word).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        self.0 = mixed ^ mixed >> 29;
    }
}

fn unpack(chunk: u64, packed: u16) -> Step {
    Step {
        tick: chunk * CHUNK_TICKS + u64::from(packed >> (16 - OFFSET_BITS)),
        motor: (packed >> 1) as u8 & (MOTORS_MAX as u8 - 1),
        forward: packed & 1 == 1,
    }
}

impl StepOutput for StepLog {
    fn set_directions(&mut self, directions: u8) {
        self.directions = directions;
    }

    fn step(&mut self, tick: u64, motors: u8) {
        let chunk = (tick / CHUNK_TICKS) as usize;
        while self.chunk_starts.len() <= chunk {
            self.chunk_starts.push(self.packed.len() as u64);
        }
        let offset = (tick % CHUNK_TICKS) as u16;
        let mut left = motors;
        while left != 0 {
            let motor = left.trailing_zeros() as u16;
            left &= left - 1;
            let forward = u16::from(self.directions >> motor & 1);
            self.packed
                .push(offset << (16 - OFFSET_BITS) | motor << 1 | forward);
            self.counts[usize::from(motor)] += if forward == 1 { 1 } else { -1 };
        }
    }
}

/// Steps and progress of one job on a simulated controller.
#[derive(Clone, Debug, Default)]
pub struct MotionRecord {
    /// Every step.
    pub steps: StepLog,
    /// Step counts when the log began.
    pub start_counts: [i64; MOTORS_MAX],
    /// Servo tick (since start-up) at which the segment time began to run, with the value 0.
    pub first_servo_tick: u64,
    /// Segment time passed in each servo tick since then, in 2^-16 ticks: 65536 at the planned
    /// rate.
    pub rates_q16: Vec<u32>,
}

impl MotionRecord {
    /// Step counts at the end.
    pub fn final_counts(&self) -> [i64; MOTORS_MAX] {
        std::array::from_fn(|motor| self.start_counts[motor] + self.steps.counts()[motor])
    }

    /// The step digest, with ticks counted from the job's first segment.
    pub fn digest(&self, step_ticks_per_servo_tick: u32) -> u64 {
        let origin = self.first_servo_tick * u64::from(step_ticks_per_servo_tick);
        self.steps.digest(origin)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_come_back_as_they_were_logged() {
        let mut log = StepLog::default();
        let mut expected = Vec::new();
        let mut counts = [0i64; MOTORS_MAX];
        for i in 0..5000u64 {
            let tick = i * i / 7;
            let directions = (i % 251) as u8;
            let motors = (i * 37 % 255 + 1) as u8;
            log.set_directions(directions);
            if expected.last().is_some_and(|step: &Step| step.tick == tick) {
                continue;
            }
            log.step(tick, motors);
            for motor in (0..8).filter(|motor| motors >> motor & 1 == 1) {
                let forward = directions >> motor & 1 == 1;
                counts[usize::from(motor)] += if forward { 1 } else { -1 };
                expected.push(Step {
                    tick,
                    motor,
                    forward,
                });
            }
        }
        assert!(expected.len() > 10_000);
        assert_eq!(log.iter().collect::<Vec<Step>>(), expected);
        assert_eq!(log.counts(), &counts);
    }

    #[test]
    fn the_digest_sees_every_part_of_a_step_but_not_the_start() {
        let log = |tick: u64, motors: u8, directions: u8| {
            let mut log = StepLog::default();
            log.set_directions(directions);
            log.step(1000 + tick, motors);
            log.step(2000, 1);
            log.digest(1000)
        };
        let base = log(5, 2, 0);
        assert_ne!(base, log(6, 2, 0));
        assert_ne!(base, log(5, 4, 0));
        assert_ne!(base, log(5, 2, 2));
        let mut late = StepLog::default();
        late.step(90_005, 2);
        late.step(91_000, 1);
        assert_eq!(base, late.digest(90_000));
    }
}
