//! Joint targets at the servo rate -> steps at the step rate, in fixed point.
//!
//! Positions are i64 in 2^-31 steps. Every servo tick a [`StepProgrammer`] turns the targets of
//! four successive servo ticks into a [`StepProgram`]: one parabola per motor for the interval
//! between the middle two,
//! p(t) = q1 + (q2 - q1) t + A/2 t (t - 1), A = the mean of the second differences at both ends,
//! so that speed is nearly continuous and the ends are hit. The [`StepEngine`] plays it with two
//! additions per motor and step tick: `phase += v; v += a`, a step where bit 31 toggles. A step is
//! due when the position crosses n + 1/2 and comes in the last tick before that, half a tick early
//! on average; that half tick belongs to the constant delay (`design::motion_delay_s`).
//!
//! No counter runs in the step tick: the programmer knows the exact count by formula, and aims
//! every interval from where the last one really ended, so rounding never adds up.
//!
//! Source: the parabola is the quadratic through the averaged second difference (Catmull-Rom
//! slopes give the same to second order); phase accumulators as in direct digital synthesis.

use crate::configuration::MOTORS_MAX;
use crate::design::{STEP_RATE_SHARE_MAX, STEP_THRESHOLD_BIAS};
use crate::output::StepOutput;

/// Fraction bits of a position in steps.
pub const POSITION_FRACTION_BITS: u32 = 31;
/// One step.
pub const STEP: i64 = 1 << POSITION_FRACTION_BITS;
/// Most step ticks of a servo interval: the products below stay within 64 bits.
pub const INTERVAL_TICKS_MAX: u32 = 1000;
/// Fewest: the reciprocals fit 32 bits.
pub const INTERVAL_TICKS_MIN: u32 = 4;
/// Largest speed in 2^-31 steps per step tick.
const SPEED_MAX: i64 = (STEP as f64 * STEP_RATE_SHARE_MAX) as i64;

/// Converts channel units to positions in 2^-31 steps.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepScale {
    /// Steps per channel unit, 60 fraction bits.
    per_unit_q60: i64,
    /// The same for offsets.
    per_unit: f32,
}

impl StepScale {
    /// `steps_per_unit`: motor steps per channel unit (0.1 µm, µrad, 10⁻⁶ mm³), below 4.
    pub fn new(steps_per_unit: f64) -> Self {
        const ONE_Q60: f64 = (1u64 << 60) as f64;
        let scaled = steps_per_unit * ONE_Q60;
        let half = if scaled < 0.0 { -0.5 } else { 0.5 };
        Self {
            per_unit_q60: (scaled + half) as i64,
            per_unit: steps_per_unit as f32,
        }
    }

    /// Exact position of an integer number of units, to the last of its 31 fraction bits.
    pub fn position(&self, units: i64) -> i64 {
        let product = i128::from(units) * i128::from(self.per_unit_q60);
        (product >> (60 - POSITION_FRACTION_BITS)) as i64
    }

    /// Position of a small offset in units.
    #[inline]
    pub fn offset(&self, units: f32) -> i64 {
        steps_to_position(units * self.per_unit)
    }
}

/// A number of steps as a position. Whole and fraction go separately, because the conversion to
/// 64 bits is slow software on a Cortex-M4F.
#[inline]
pub fn steps_to_position(steps: f32) -> i64 {
    let whole = steps as i32;
    let fraction = steps - whole as f32;
    (i64::from(whole) << POSITION_FRACTION_BITS) + i64::from((fraction * STEP as f32) as i32)
}

/// The whole number of steps at a position: rounded to nearest, halves up.
pub fn count(position: i64) -> i64 {
    (position + STEP / 2 + STEP_THRESHOLD_BIAS) >> POSITION_FRACTION_BITS
}

/// The engine's phase at a position: bit 31 is the parity of the count.
fn phase(position: i64) -> u32 {
    (position + STEP / 2 + STEP_THRESHOLD_BIAS) as u32
}

/// A motor would need more than one step a tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StepRateExceeded {
    /// Which motor.
    pub motor: u8,
    /// Its speed in thousandths of a step per step tick.
    pub speed_permille: i32,
}

/// One servo interval for all motors, in 2^-31 steps and step ticks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StepProgram {
    velocity: [i32; MOTORS_MAX],
    acceleration: [i32; MOTORS_MAX],
    /// Direction bits at the interval's start.
    directions: u8,
    /// Motors whose direction changes within the interval.
    reversing: u8,
    /// Motors that take steps or reverse.
    active: u8,
    /// Phases to take over at the start: the position was declared anew, at rest.
    phases: Option<[u32; MOTORS_MAX]>,
    /// Number of the program, to find it again after a stop.
    serial: u32,
}

/// Where the engine was stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stopped {
    /// Ticks of the interval that were played.
    pub ticks_played: u32,
    /// Program that was being played.
    serial: u32,
}

/// Targets -> programs, with the exact position of every motor.
#[derive(Clone, Debug)]
pub struct StepProgrammer {
    motors: usize,
    interval_ticks: u32,
    /// ceil(log2(interval_ticks)).
    shift: u32,
    /// 2^(30 + shift) / interval_ticks.
    reciprocal: i32,
    /// 2^(32 + shift) / interval_ticks².
    reciprocal_squared: i32,
    /// N (N - 1) / 2.
    triangle: i32,
    /// Targets of the last three servo ticks, oldest first.
    history: [[i64; 3]; MOTORS_MAX],
    /// Where the last program ends.
    end: [i64; MOTORS_MAX],
    directions: u8,
    phases_due: bool,
    serial: u32,
    /// The last two programs with the positions at their starts, newest first.
    recent: [([i64; MOTORS_MAX], StepProgram); 2],
}

impl StepProgrammer {
    /// All motors at position 0, at rest. `interval_ticks` is limited to 4..=1000.
    pub fn new(motors: usize, interval_ticks: u32) -> Self {
        let interval_ticks = interval_ticks.clamp(INTERVAL_TICKS_MIN, INTERVAL_TICKS_MAX);
        let shift = u32::BITS - (interval_ticks - 1).leading_zeros();
        let ticks = u64::from(interval_ticks);
        Self {
            motors: motors.min(MOTORS_MAX),
            interval_ticks,
            shift,
            reciprocal: (((1u64 << (30 + shift)) + ticks / 2) / ticks) as i32,
            reciprocal_squared: (((1u64 << (32 + shift)) + ticks * ticks / 2) / (ticks * ticks))
                as i32,
            triangle: (interval_ticks * (interval_ticks - 1) / 2) as i32,
            history: [[0; 3]; MOTORS_MAX],
            end: [0; MOTORS_MAX],
            directions: 0,
            phases_due: true,
            serial: 0,
            recent: [([0; MOTORS_MAX], StepProgram::default()); 2],
        }
    }

    /// Declares positions without a step. Only at rest.
    pub fn set_positions(&mut self, positions: &[i64; MOTORS_MAX]) {
        self.resume_from(positions);
        self.phases_due = true;
    }

    /// Goes on from where the motors really are, after the engine was stopped.
    fn resume_from(&mut self, positions: &[i64; MOTORS_MAX]) {
        self.end = *positions;
        self.history = positions.map(|position| [position; 3]);
    }

    /// Finds the motors after [`StepEngine::stop`] and goes on from there. False if the engine was
    /// not playing one of the last two programs, so the position is lost.
    pub fn recover(&mut self, stopped: &Stopped) -> bool {
        let recent = self
            .recent
            .iter()
            .find(|(_, program)| program.serial == stopped.serial);
        let Some((start, program)) = recent else {
            return false;
        };
        let ticks = i64::from(stopped.ticks_played);
        let positions = core::array::from_fn(|motor| {
            start[motor]
                + i64::from(program.velocity[motor]) * ticks
                + i64::from(program.acceleration[motor]) * (ticks * (ticks - 1) / 2)
        });
        self.resume_from(&positions);
        true
    }

    /// Where the last program ends, in 2^-31 steps.
    pub fn positions(&self) -> &[i64; MOTORS_MAX] {
        &self.end
    }

    /// The target that the last call of [`Self::program`] was given.
    pub fn newest_targets(&self) -> [i64; MOTORS_MAX] {
        self.history.map(|[_, _, newest]| newest)
    }

    /// True if the motors rest: the last targets are equal and were reached.
    pub fn is_at_rest(&self) -> bool {
        self.history
            .iter()
            .zip(&self.end)
            .all(|(history, end)| history.iter().all(|q| count(*q) == count(*end)))
            && self.history.iter().all(|[a, b, c]| a == b && b == c)
    }

    /// Takes the next servo tick's targets and gives the interval that ends one tick before them.
    ///
    /// # Errors
    /// [`StepRateExceeded`] where a motor would need more than one step a tick.
    pub fn program(
        &mut self,
        targets: &[i64; MOTORS_MAX],
    ) -> Result<StepProgram, StepRateExceeded> {
        let mut program = StepProgram::default();
        let ticks = self.interval_ticks as i32;
        self.serial = self.serial.wrapping_add(1);
        program.serial = self.serial;
        let starts = self.end;
        for (motor, &q3) in targets.iter().enumerate().take(self.motors) {
            let [q0, q1, q2] = self.history[motor];
            self.history[motor] = [q1, q2, q3];
            let twice_mean = q3.wrapping_sub(q2).wrapping_sub(q1.wrapping_sub(q0));
            let way = q2.wrapping_sub(self.end[motor]);
            if way == 0 && twice_mean == 0 {
                continue;
            }
            let acceleration = self.acceleration(twice_mean);
            let bend = i64::from(acceleration) * i64::from(self.triangle);
            let velocity = self.velocity(way.wrapping_sub(bend));
            let last = velocity + i64::from(acceleration) * i64::from(ticks - 1);
            if velocity.abs().max(last.abs()) > SPEED_MAX {
                return Err(step_rate_exceeded(motor, velocity, last));
            }
            let start = self.end[motor];
            let end = start + velocity * i64::from(ticks) + bend;
            self.end[motor] = end;
            program.velocity[motor] = velocity as i32;
            program.acceleration[motor] = acceleration;
            self.set_direction(&mut program, motor, (velocity, last), (start, end));
        }
        program.directions = self.directions;
        // What the engine will have on its pins when the interval ends.
        self.directions ^= program.reversing;
        if self.phases_due {
            self.phases_due = false;
            program.phases = Some(starts.map(phase));
        }
        self.recent = [(starts, program), self.recent[0]];
        Ok(program)
    }

    #[inline]
    fn set_direction(
        &mut self,
        program: &mut StepProgram,
        motor: usize,
        (velocity, last): (i64, i64),
        (start, end): (i64, i64),
    ) {
        let bit = 1u8 << motor;
        let reversing = (velocity < 0) != (last < 0);
        if reversing {
            program.reversing |= bit;
        }
        if reversing || count(start) != count(end) {
            program.active |= bit;
        }
        // A motor that only creeps within one count keeps its direction pin.
        if program.active & bit != 0 {
            if velocity < 0 {
                self.directions &= !bit;
            } else {
                self.directions |= bit;
            }
        }
    }

    /// A / N² from twice the mean second difference, saturating (the speed check then refuses).
    #[inline]
    fn acceleration(&self, twice_mean: i64) -> i32 {
        let coarse = saturate(twice_mean >> (self.shift + 3));
        let product = i64::from(coarse) * i64::from(self.reciprocal_squared);
        saturate((product + (1 << 29)) >> 30)
    }

    /// way / N, rounded; far out of range where it is.
    #[inline]
    fn velocity(&self, way: i64) -> i64 {
        let coarse = saturate(way >> self.shift);
        (i64::from(coarse) * i64::from(self.reciprocal) + (1 << 29)) >> 30
    }
}

#[inline]
fn saturate(value: i64) -> i32 {
    value.clamp(i64::from(i32::MIN), i64::from(i32::MAX)) as i32
}

fn step_rate_exceeded(motor: usize, first: i64, last: i64) -> StepRateExceeded {
    let fastest = if first.abs() > last.abs() {
        first
    } else {
        last
    };
    StepRateExceeded {
        motor: motor as u8,
        speed_permille: saturate(((fastest >> 10) * 1000) >> (POSITION_FRACTION_BITS - 10)),
    }
}

/// Plays programs, one step tick at a time. On a board it belongs to the step interrupt.
#[derive(Clone, Debug)]
pub struct StepEngine {
    phase: [u32; MOTORS_MAX],
    velocity: [i32; MOTORS_MAX],
    acceleration: [i32; MOTORS_MAX],
    ticks_left: u32,
    reversing: u8,
    active: u8,
    directions: u8,
    next: Option<StepProgram>,
    serial: u32,
    /// Ticks that the last program was played for, if it is not playing any more.
    stopped_at: Option<u32>,
    interval_ticks: u32,
    /// Step tick at which the interval ends.
    interval_end_tick: u64,
    overruns: u32,
}

impl StepEngine {
    /// At rest; plays one idle interval first.
    pub fn new(interval_ticks: u32) -> Self {
        let interval_ticks = interval_ticks.clamp(INTERVAL_TICKS_MIN, INTERVAL_TICKS_MAX);
        Self {
            phase: [0; MOTORS_MAX],
            velocity: [0; MOTORS_MAX],
            acceleration: [0; MOTORS_MAX],
            ticks_left: interval_ticks,
            reversing: 0,
            active: 0,
            directions: 0,
            next: None,
            serial: 0,
            stopped_at: None,
            interval_ticks,
            interval_end_tick: u64::from(interval_ticks),
            overruns: 0,
        }
    }

    /// Hands over the next interval. It starts when the one that plays now has ended.
    pub fn load(&mut self, program: StepProgram) {
        self.next = Some(program);
    }

    /// How often an interval ended with no next one: the servo was late, or step ticks were lost.
    pub fn overruns(&self) -> u32 {
        self.overruns
    }

    /// Step ticks since start-up.
    pub fn now_tick(&self) -> u64 {
        self.interval_end_tick - u64::from(self.ticks_left)
    }

    /// Stops at once, in the middle of an interval.
    pub fn stop(&mut self) -> Stopped {
        self.velocity = [0; MOTORS_MAX];
        self.acceleration = [0; MOTORS_MAX];
        self.reversing = 0;
        self.active = 0;
        self.next = None;
        let played = self.interval_ticks - self.ticks_left;
        Stopped {
            ticks_played: *self.stopped_at.get_or_insert(played),
            serial: self.serial,
        }
    }

    /// One step tick. Deadline on a board: one step period; nothing here waits or loops further
    /// than the motors.
    #[inline]
    pub fn tick<O: StepOutput>(&mut self, output: &mut O) {
        let mut motors = 0u32;
        let mut forward = 0u32;
        for motor in 0..MOTORS_MAX {
            let old = self.phase[motor];
            let new = old.wrapping_add(self.velocity[motor] as u32);
            self.phase[motor] = new;
            self.velocity[motor] = self.velocity[motor].wrapping_add(self.acceleration[motor]);
            motors |= ((old ^ new) >> 31) << motor;
        }
        if motors != 0 {
            output.step(self.now_tick(), motors as u8);
        }
        self.ticks_left -= 1;
        if self.ticks_left == 0 {
            self.next_interval(output);
        } else if self.reversing != 0 {
            for motor in 0..MOTORS_MAX {
                forward |= (!(self.velocity[motor] as u32) >> 31) << motor;
            }
            let turned = (forward as u8 ^ self.directions) & self.reversing;
            if turned != 0 {
                self.directions ^= turned;
                output.set_directions(self.directions);
            }
        }
    }

    /// The rest of the interval at once, with the same calls as [`Self::tick`] would make: for the
    /// simulator, many times faster.
    pub fn run_interval<O: StepOutput>(&mut self, output: &mut O) {
        if self.reversing != 0 {
            for _ in 0..self.ticks_left {
                self.tick(output);
            }
            return;
        }
        let mut due = [0u8; INTERVAL_TICKS_MAX as usize];
        let ticks = self.ticks_left as usize;
        let due = due.get_mut(..ticks).unwrap_or_default();
        for motor in 0..MOTORS_MAX {
            self.play_motor(motor, due);
        }
        let first_tick = self.now_tick();
        if self.active != 0 {
            for (tick, &motors) in due.iter().enumerate() {
                if motors != 0 {
                    output.step(first_tick + tick as u64, motors);
                }
            }
        }
        self.next_interval(output);
    }

    /// All remaining ticks of one motor; sets its bit in the ticks where a step is due.
    fn play_motor(&mut self, motor: usize, due: &mut [u8]) {
        let (mut phase, mut velocity) = (self.phase[motor], self.velocity[motor]);
        let acceleration = self.acceleration[motor];
        if self.active >> motor & 1 == 0 {
            let ticks = due.len() as u32;
            let triangle = ticks.wrapping_mul(ticks.wrapping_sub(1)) / 2;
            self.phase[motor] = phase
                .wrapping_add((velocity as u32).wrapping_mul(ticks))
                .wrapping_add((acceleration as u32).wrapping_mul(triangle));
            return;
        }
        for slot in due {
            let new = phase.wrapping_add(velocity as u32);
            velocity = velocity.wrapping_add(acceleration);
            *slot |= (((phase ^ new) >> 31) as u8) << motor;
            phase = new;
        }
        self.phase[motor] = phase;
    }

    fn next_interval<O: StepOutput>(&mut self, output: &mut O) {
        self.ticks_left = self.interval_ticks;
        self.interval_end_tick += u64::from(self.interval_ticks);
        let Some(program) = self.next.take() else {
            self.stopped_at.get_or_insert(self.interval_ticks);
            self.stop();
            self.overruns = self.overruns.saturating_add(1);
            return;
        };
        self.serial = program.serial;
        self.stopped_at = None;
        if let Some(phases) = program.phases {
            self.phase = phases;
        }
        self.velocity = program.velocity;
        self.acceleration = program.acceleration;
        self.reversing = program.reversing;
        self.active = program.active;
        if self.directions != program.directions {
            self.directions = program.directions;
            output.set_directions(self.directions);
        }
    }
}

#[cfg(test)]
#[path = "steps_tests.rs"]
mod tests;
