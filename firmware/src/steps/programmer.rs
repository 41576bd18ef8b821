//! Targets of successive servo ticks -> one parabola per motor and interval.
//!
//! All code of a tick uses 32 bits: displacements in 2^-22 steps, and the end of the last program in 2^-31
//! steps modulo two, which is the engine's phase. The 64-bit position is assembled on request. Targets are
//! those of joints; where the motors are not the joints, they are mixed last, and requested positions are
//! converted back to joints.

use super::interval::Interval;
use super::track::{MotorTrack, Turns, WAY_FRACTION_BITS, WAY_SHIFT};
use super::{FINE_BIAS, StepBank, Stopped, Target};
use crate::configuration::MOTORS_MAX;
use crate::steps::delay::Delays;
use crate::steps::motor_mix::MotorMix;
use crate::steps::waiting_targets::{Line, Places, Row, WaitingTargets};
use core::sync::atomic::{Ordering, compiler_fence};

/// A motor would need more than one step a tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StepRateExceeded {
    /// Which motor.
    pub motor: u8,
    /// Steps that it would need in a servo interval, at its fastest.
    pub steps_per_interval: u32,
}

/// Largest change of a target in a tick, whole steps: beyond it the 32 bits of a displacement would
/// wrap.
const JUMP_STEPS_MAX: u32 = 255;
/// The same of a motor that two joints move, 2^-22 steps.
const MIXED_WAY_MAX: u32 = (JUMP_STEPS_MAX + 1) << WAY_FRACTION_BITS;

/// Targets -> programs, with the exact position of every motor.
#[derive(Clone, Debug)]
pub struct StepProgrammer {
    tracks: [MotorTrack; MOTORS_MAX],
    motors: usize,
    interval: Interval,
    /// Number of the newest program.
    serial: u32,
    /// What the engine will have on its pins when the newest program ends.
    directions: u8,
    line: Line,
    mix: MotorMix,
}

/// Where the joints' targets of a servo tick go.
#[derive(Debug)]
pub struct NewTargets<'a> {
    tracks: &'a mut [MotorTrack; MOTORS_MAX],
    row: &'a mut Row,
}

impl NewTargets<'_> {
    /// Puts a new target into its place ([`Target::replace`]).
    #[inline(always)]
    pub fn put(&mut self, motor: usize, new: Target) -> u32 {
        let motor = motor % MOTORS_MAX;
        self.row[motor] = new.fine;
        self.tracks[motor].target.replace(new)
    }
}

impl StepProgrammer {
    /// All motors at position 0, at rest. `interval_ticks` is limited to 65..=256.
    pub fn new(motors: usize, interval_ticks: u32) -> Self {
        let interval = Interval::new(interval_ticks);
        Self {
            tracks: core::array::from_fn(|motor| MotorTrack::at_rest(0, motor, u8::MAX, interval)),
            motors: motors.min(MOTORS_MAX),
            interval,
            serial: 0,
            directions: u8::MAX,
            line: Line::default(),
            mix: MotorMix::NONE,
        }
    }

    /// The same where motors are not the joints.
    #[must_use]
    pub fn with_mix(mut self, mix: MotorMix) -> Self {
        self.mix = mix;
        self
    }

    /// From now on targets wait in the line for so long before they are followed, shaped where they are
    /// to be; a motor's advance does not. Only at rest.
    pub fn wait(&mut self, waiting: &mut WaitingTargets, advanced: usize, delays: &Delays) {
        waiting.rest(self.row());
        self.line = Line::new(advanced, delays, waiting.shapes());
    }

    /// Servo ticks after which a target has completely left the delay line.
    pub fn settle_ticks(&self) -> u32 {
        self.line.settle_ticks()
    }

    /// Declares positions of the joints without a step, and clears the delay line. Only at rest.
    pub fn set_positions(&mut self, positions: &[i64; MOTORS_MAX]) {
        self.set_motors(&self.mix.motors_of(*positions));
    }

    /// The same of the motors.
    #[inline(never)]
    fn set_motors(&mut self, positions: &[i64; MOTORS_MAX]) {
        for (motor, (track, position)) in self.tracks.iter_mut().zip(positions).enumerate() {
            *track = MotorTrack::at_rest(*position, motor, self.directions, self.interval);
        }
        if !self.mix.is_none() {
            let joints = self.mix.joints_of(*positions);
            for (track, joint) in self.tracks.iter_mut().zip(joints) {
                track.target = Target::of_position(joint);
            }
            let due = self.mixed_row();
            for (track, due) in self.tracks.iter_mut().zip(due) {
                track.newest = due;
            }
        }
        self.line = Line::default();
    }

    /// Forgets targets that still wait: those that the newest program knows are the last ones.
    pub fn forget(&mut self, waiting: &WaitingTargets) {
        let told = self.newest_targets(waiting);
        for (track, told) in self.tracks.iter_mut().zip(told) {
            track.target = Target::of_position(told);
        }
        self.line = Line::default();
    }

    /// What the newest targets are in a line.
    fn row(&self) -> Row {
        core::array::from_fn(|motor| self.tracks[motor].target.fine)
    }

    /// The same as motors have them.
    #[inline(never)]
    fn mixed_row(&self) -> Row {
        let mut row = self.row();
        self.mix.mix(&mut row, FINE_BIAS);
        row
    }

    /// Recovers the motors' positions after [`StepEngine::stop`] and continues from there.
    ///
    /// [`StepEngine::stop`]: super::StepEngine::stop
    pub fn recover(&mut self, stopped: &Stopped, waiting: &WaitingTargets) {
        // The newest program may have been handed over late, or not at all: it is not played.
        let begun = stopped.serial == self.serial;
        let mut positions = match begun {
            true => self.motor_positions(waiting),
            false => self.present_motors(waiting),
        };
        for (position, unplayed) in positions.iter_mut().zip(stopped.unplayed) {
            *position = position.wrapping_sub(unplayed);
        }
        self.set_motors(&positions);
    }

    fn of_tracks(
        &self,
        waiting: &WaitingTargets,
        position: impl Fn(&MotorTrack, i64) -> i64,
    ) -> [i64; MOTORS_MAX] {
        let mut places = self.about(waiting);
        for (place, track) in places.iter_mut().zip(&self.tracks) {
            *place = position(track, *place);
        }
        places
    }

    /// Near the newest program's target, 2^-31 steps: motors.
    // Once for all who ask, and a loop: unrolled it would be kilobytes.
    #[inline(never)]
    fn about(&self, waiting: &WaitingTargets) -> [i64; MOTORS_MAX] {
        let mut about = [0; MOTORS_MAX];
        for (joint, (about, track)) in about.iter_mut().zip(&self.tracks).enumerate() {
            let held = self.line.held(joint, waiting);
            *about = track.target.position().wrapping_sub(held);
        }
        self.mix.motors_of(about)
    }

    /// Where the last program ends, in 2^-31 steps: joints.
    pub fn positions(&self, waiting: &WaitingTargets) -> [i64; MOTORS_MAX] {
        self.mix.joints_of(self.motor_positions(waiting))
    }

    /// The same of the motors.
    pub fn motor_positions(&self, waiting: &WaitingTargets) -> [i64; MOTORS_MAX] {
        self.of_tracks(waiting, MotorTrack::position)
    }

    /// Where the joints are at the start of this servo tick, before [`Self::advance`]: the newest
    /// program is about to be played.
    pub fn present_positions(&self, waiting: &WaitingTargets) -> [i64; MOTORS_MAX] {
        self.mix.joints_of(self.present_motors(waiting))
    }

    fn present_motors(&self, waiting: &WaitingTargets) -> [i64; MOTORS_MAX] {
        let ticks = self.interval.ticks;
        self.of_tracks(waiting, |track, about| {
            track.position(about).wrapping_sub(track.way(ticks))
        })
    }

    /// The targets of the newest program: those of the last call of [`Self::advance`], or of an earlier
    /// one by the delay.
    pub fn newest_targets(&self, waiting: &WaitingTargets) -> [i64; MOTORS_MAX] {
        self.mix
            .joints_of(self.of_tracks(waiting, MotorTrack::told))
    }

    /// True where a motor that two joints move has another count for these positions of known joints.
    pub fn moves_pair(&self, to: &[i64; MOTORS_MAX], from: &[i64; MOTORS_MAX], known: u8) -> bool {
        if self.mix.is_none() {
            return false;
        }
        let [to, from] = [to, from].map(|joints| self.mix.motors_of(*joints));
        self.mix.pair_is_known(known)
            && to.iter().zip(&from).enumerate().any(|(motor, (to, from))| {
                self.mix.is_of_pair(motor) && super::count(*to) != super::count(*from)
            })
    }

    /// True if the motors are at rest: the last output targets are equal and were reached.
    pub fn is_at_rest(&self) -> bool {
        self.tracks.iter().all(|track| {
            // Bit 31 is the parity of the count.
            let newest = (track.newest << WAY_SHIFT) as u32;
            let counts_differ = (newest ^ track.end) >> 31 != 0;
            track.last_way == 0 && track.way_before == 0 && !counts_differ
        })
    }

    /// Takes the next servo tick's targets (2^-31 steps) and programs the interval that ends one
    /// tick before them, into `bank`.
    ///
    /// # Errors
    /// [`StepRateExceeded`] where a motor would need more than one step a tick.
    #[inline(never)]
    pub fn advance(
        &mut self,
        targets: &[i64; MOTORS_MAX],
        bank: &mut StepBank,
    ) -> Result<(), StepRateExceeded> {
        let before = self.row();
        let mut jumps = 0;
        for (track, given) in self.tracks.iter_mut().zip(targets) {
            jumps |= track.target.replace(Target::of_position(*given));
        }
        if jumps > JUMP_STEPS_MAX {
            return Err(self.take_back_to(&before));
        }
        self.advance_to(&self.mixed_row(), bank)
    }

    /// The same with the targets as they are.
    ///
    /// # Errors
    /// As [`Self::advance`].
    pub fn advance_at_rest(&mut self, bank: &mut StepBank) -> Result<(), StepRateExceeded> {
        self.advance_to(&self.mixed_row(), bank)
    }

    /// Begins a servo tick: returns its rows of the line.
    #[inline(always)]
    pub fn begin(&mut self) -> Places {
        self.line.begin()
    }

    /// Undoes the beginning of a servo tick, before a target was entered.
    pub fn take_back_begin(&mut self) {
        self.line.take_back();
    }

    /// The joints' targets of a servo tick: for each one is to be put in.
    #[inline(always)]
    pub fn new_targets<'a>(
        &'a mut self,
        waiting: &'a mut WaitingTargets,
        places: Places,
    ) -> NewTargets<'a> {
        NewTargets {
            tracks: &mut self.tracks,
            row: waiting.newest(places),
        }
    }

    /// The newest of a motor.
    #[inline]
    pub fn target(&self, motor: usize) -> Target {
        self.tracks[motor % MOTORS_MAX].target
    }

    /// The same as [`Self::advance`] with targets that are already in the line; `jumps` is the
    /// combined result of setting them. The output of the line is followed.
    ///
    /// # Errors
    /// As [`Self::advance`].
    #[inline(always)]
    pub fn advance_to_targets(
        &mut self,
        jumps: u32,
        waiting: &mut WaitingTargets,
        places: Places,
        bank: &mut StepBank,
    ) -> Result<(), StepRateExceeded> {
        if jumps > JUMP_STEPS_MAX {
            return Err(self.take_back(waiting));
        }
        let due = if self.line.shapes() {
            let Some(due) = waiting.shaped(places, MIXED_WAY_MAX) else {
                return Err(self.take_back(waiting));
            };
            due
        } else {
            waiting.due(places)
        };
        self.advance_to(due, bank)
    }

    // Its registers are not to be those of all the rest.
    #[inline(never)]
    fn advance_to(&mut self, due: &Row, bank: &mut StepBank) -> Result<(), StepRateExceeded> {
        let mut turns = Turns::default();
        let mut spare = 0;
        let tracks = self.tracks.get_mut(..self.motors).unwrap_or_default();
        let motors = bank.motors.get_mut(..self.motors).unwrap_or_default();
        for ((track, motor), due) in tracks.iter_mut().zip(motors).zip(due) {
            spare |= track.advance(*due, motor, &mut turns);
            // One motor after the other: for two at once the registers do not suffice.
            compiler_fence(Ordering::SeqCst);
        }
        self.serial = self.serial.wrapping_add(1);
        if spare < 0 {
            // What is not handed over is taken back as a whole.
            return Err(self.refusal());
        }
        bank.serial = self.serial;
        bank.directions = self.directions ^ turns.before;
        self.directions = bank.directions ^ turns.within;
        if turns.within == 0 {
            bank.turn_nowhere();
        } else {
            bank.plan_turns(turns.within, self.interval.ticks as u32);
        }
        Ok(())
    }

    /// Puts in the extruder's target of a tick begun; `advance` is added to the one that is followed now,
    /// 2^-22 steps. Says too how far that is from the one before and how far that was from the one before
    /// it, 2^-22 steps.
    #[inline(always)]
    pub fn put_extruder(
        &mut self,
        (waiting, places): (&mut WaitingTargets, Places),
        motor: usize,
        new: Target,
        advance: i64,
    ) -> (u32, [i32; 2]) {
        let motor = motor % MOTORS_MAX;
        let track = &mut self.tracks[motor];
        let due = self
            .line
            .exchange(waiting, places, motor, new.fine, advance);
        let way = due.wrapping_sub(track.newest);
        (track.target.replace(new), [way, track.last_way])
    }

    /// Drops targets that cannot be reached, and keeps those of the previous tick. Returns the one that
    /// jumped furthest.
    #[cold]
    pub fn take_back(&mut self, waiting: &WaitingTargets) -> StepRateExceeded {
        self.line.take_back();
        let before = *self.line.newest(waiting);
        self.take_back_to(&before)
    }

    fn take_back_to(&mut self, row: &Row) -> StepRateExceeded {
        let mut refused = StepRateExceeded {
            motor: 0,
            steps_per_interval: 0,
        };
        for ((motor, track), before) in (0..).zip(&mut self.tracks).zip(row) {
            // Known up to 1024 steps: the input is checked before, so that no target jumps so far.
            let way = track.target.fine.wrapping_sub(*before) >> WAY_FRACTION_BITS;
            let steps_per_interval = way.unsigned_abs();
            track.target.whole = track.target.whole.wrapping_sub(way);
            track.target.fine = *before;
            if steps_per_interval > refused.steps_per_interval {
                refused = StepRateExceeded {
                    motor,
                    steps_per_interval,
                };
            }
        }
        refused
    }

    /// The motor with the largest demand, and that demand.
    #[cold]
    fn refusal(&self) -> StepRateExceeded {
        let mut refused = StepRateExceeded {
            motor: 0,
            steps_per_interval: 0,
        };
        for (motor, track) in (0..).zip(&self.tracks) {
            let bend = track.last_way.wrapping_sub(track.way_before);
            let fastest = i64::from(track.last_way.unsigned_abs()) + i64::from(bend.unsigned_abs());
            let steps = (fastest >> WAY_FRACTION_BITS) as u32;
            if steps >= refused.steps_per_interval {
                refused.motor = motor;
                refused.steps_per_interval = steps;
            }
        }
        refused
    }
}
