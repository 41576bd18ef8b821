//! Commands of the link to the motion. A board calls these under a short lock.

use super::state::{Demand, State, Stream};
use super::{CommandError, Motion};
use crate::configuration::MOTORS_MAX;
use crate::design::{HOLD_RETRACT_DELAY_MS, ticks_of_ms};
use crate::flow::hold::Hold;
use crate::motion::inputs::Inputs;
use crate::path::interpolator::{RestPose, TICK_Q16};
use crate::path::load::SpanFault;
use crate::path::queue::QueuedKnot;
use crate::steps::{Stopped, count};
use headway_protocol::message::{Fault, FaultCause};
use headway_protocol::segment::FlowEvent;
use headway_protocol::units::{ChannelPoint, Units};

impl Motion {
    /// Opens a stream of base units that starts at rest on `position`, in the joint solution of the last one.
    ///
    /// # Errors
    /// As [`Self::start_in`].
    pub fn start(&mut self, position: &ChannelPoint) -> Result<(), CommandError> {
        self.start_in(position, self.joints.solution(), &Units::BASE)
    }

    /// Opens a stream of these units that starts at rest on `position`, in one of the machine's joint solutions.
    ///
    /// # Errors
    /// [`CommandError`]: a stream that is open, a latched fault, a position that is not where the
    /// machine is, a joint solution that it has not, a unit too coarse for a motor.
    pub fn start_in(
        &mut self,
        position: &ChannelPoint,
        solution: u8,
        units: &Units,
    ) -> Result<(), CommandError> {
        if self.fault.is_some() {
            return Err(CommandError::Faulted);
        }
        if !self.is_free() {
            return Err(CommandError::Busy);
        }
        if self.reference.lost != 0 {
            return Err(CommandError::Invalid);
        }
        self.place(position, units, self.reference.known, solution)?;
        self.queue.clear();
        self.events.clear();
        self.state = State::Filling(Stream::NEW);
        self.warp.let_go();
        self.melt_until_span = 0;
        self.heat.begin_melt();
        self.heat.begin_stream();
        self.note_heat();
        self.heard_ticks = self.now_ticks as u32;
        self.stream_start_ticks = None;
        Ok(())
    }

    /// Declares where the machine is. Only at rest with no stream open.
    ///
    /// # Errors
    /// [`CommandError`].
    pub fn set_position(&mut self, position: &ChannelPoint) -> Result<(), CommandError> {
        if !self.is_free() {
            return Err(CommandError::Busy);
        }
        self.place(position, &Units::BASE, 0, self.joints.solution())?;
        if let Some(standing) = self.state.standing_mut() {
            standing.on_pose = true;
        }
        Ok(())
    }

    /// Takes over a pose at rest in a joint solution, only if the `known` joints are there already.
    fn place(
        &mut self,
        position: &ChannelPoint,
        units: &Units,
        known: u8,
        solution: u8,
    ) -> Result<(), CommandError> {
        let before = self.joints.branch();
        let placed = match self.joints.take_solution(solution) {
            true => self.place_here(position, units, known),
            false => Err(CommandError::Invalid),
        };
        if placed.is_err() {
            self.joints.go_back(&before);
        }
        placed
    }

    /// The same in the present solution.
    fn place_here(
        &mut self,
        position: &ChannelPoint,
        units: &Units,
        known: u8,
    ) -> Result<(), CommandError> {
        let joint_channels = self.joint_channels.in_units(units);
        let joint_channels = joint_channels.ok_or(CommandError::Invalid)?;
        let pose = RestPose::new(&joint_channels, position);
        let targets = self.rest_targets(&pose)?;
        let here = self.programmer.positions(&self.waiting);
        let moved = targets
            .iter()
            .zip(&here)
            .take(self.joints.count())
            .enumerate()
            .any(|(joint, (target, here))| {
                let way = self.joints.way_to(joint, *target, *here);
                known >> joint & 1 == 1 && count(*target) != count(target.wrapping_sub(way))
            });
        let moved = moved || self.programmer.moves_pair(&targets, &here, known);
        if moved {
            return Err(CommandError::Invalid);
        }
        let (_, base) = pose.offset().of_motor(self.joints.count());
        self.flow.take_scale(joint_channels.extruder_scale());
        self.flow.declare(&mut self.flow_window, base);
        self.interpolator.start_at(position, &joint_channels);
        self.programmer.set_positions(&targets);
        let extruder = self.joints.count();
        self.programmer
            .wait(&mut self.waiting, extruder, &self.delays);
        self.still_ticks = self.delays.settle_ticks;
        self.hold = Hold::new(ticks_of_ms(HOLD_RETRACT_DELAY_MS, self.servo_hz));
        self.reference.learn(self.joints.all());
        Ok(())
    }

    /// Where the motors are at rest on a pose.
    pub(super) fn rest_targets(
        &mut self,
        pose: &RestPose,
    ) -> Result<[i64; MOTORS_MAX], CommandError> {
        let before = self.joints.branch();
        let targets = self.joints.targets(pose);
        targets.map_err(|_| {
            self.joints.go_back(&before);
            CommandError::Invalid
        })
    }

    /// True while frames of a stream are expected: it is open and has no end yet. After a fault
    /// further frames are accepted and dropped.
    pub fn takes_stream(&self) -> bool {
        let stream = self.state.stream();
        self.fault.is_some() || stream.is_some_and(|stream| !stream.is_complete)
    }

    /// Queues knots in order; false if they do not fit.
    pub fn push_knots(&mut self, knots: &[QueuedKnot]) -> bool {
        if self.fault.is_some() || self.state.is_aborting() {
            return true;
        }
        self.heard_ticks = self.now_ticks as u32;
        let fits = knots.len() <= self.queue.room();
        for knot in knots {
            self.queue.push(*knot);
        }
        if self.in_pieces {
            self.queue.begin_pass(knots.len());
        } else {
            self.queue.update_ceilings(knots.len());
            self.interpolator.look_at_ceilings(&self.queue);
        }
        fits
    }

    /// Processes the effect of arriving knots on the queue in small parts, in [`Self::look_ahead`], which is
    /// called repeatedly: for a board, which masks the servo during that work.
    pub fn work_in_pieces(&mut self) {
        self.in_pieces = true;
    }

    /// Queues a flow event; false if it does not fit.
    pub fn push_event(&mut self, event: &FlowEvent) -> bool {
        self.fault.is_some() || self.state.is_aborting() || self.events.push(event)
    }

    /// The stream is complete.
    pub fn finish(&mut self) {
        if let Some(stream) = self.state.stream_mut() {
            stream.is_complete = true;
        }
    }

    /// An invalid span has arrived: the head comes to rest before it.
    pub fn refuse_span(&mut self, fault: SpanFault, knot: u32) {
        let (cause, index, value) = match fault {
            SpanFault::Kinematics(_) => (FaultCause::Kinematics, 0, knot as i32),
            SpanFault::SoftLimit(joint, units) => (FaultCause::SoftLimit, joint, units),
            SpanFault::Limit(motor, permille) => (FaultCause::Limit, motor, permille),
        };
        self.fail_softly(Fault {
            cause,
            index,
            value,
        });
    }

    /// Latches a fault; the head comes to rest on the path, then the stream is dropped.
    pub fn fail_softly(&mut self, fault: Fault) {
        self.fault.get_or_insert(fault);
    }

    /// Latches a fault and stops as soon as the engine gets it ([`Self::take_stop`]).
    pub fn fail_at_once(&mut self, fault: Fault) {
        self.stop_at_once(fault);
    }

    /// Comes to rest on the path.
    pub fn pause(&mut self) {
        self.ask_pause(true);
    }

    #[inline(never)]
    fn ask_pause(&mut self, asked: bool) {
        if let Some(stream) = self.state.stream_mut()
            && let Demand::Go { pauses, .. } = &mut stream.demand
        {
            *pauses = asked;
        }
    }

    /// Continues after a pause.
    pub fn resume(&mut self) {
        self.ask_pause(false);
    }

    /// Takes over the levels of the inputs; to be called before [`Self::tick`].
    #[inline]
    pub fn set_inputs(&mut self, inputs: Inputs) {
        self.inputs = inputs;
    }

    /// Comes to rest on the path, then forgets the stream.
    pub fn abort(&mut self) {
        self.state.abort();
    }

    /// Feed override in per cent.
    pub fn set_override(&mut self, percent: u16) {
        let percent = percent.clamp(1, 200);
        self.override_percent = percent;
        self.override_q16 = (u32::from(percent) * TICK_Q16 + 50) / 100;
    }

    /// Flow override in per cent of the planned volume.
    pub fn set_flow_override(&mut self, percent: u16) {
        self.flow.set_override(percent.clamp(10, 200));
    }

    /// Clears the latched fault once the machine rests; false if it still moves, or if the firmware
    /// is for another board. A persisting fault of a driver returns at once, and so does that of a heater whose supply
    /// was cut.
    pub fn clear_fault(&mut self) -> bool {
        let other_board = |fault: Fault| fault.cause == FaultCause::Board;
        let rests = matches!(self.state, State::Idle { .. })
            && !self.inputs.emergency
            && !self.fault.is_some_and(other_board);
        if rests {
            self.fault = self.drivers.fault().or(self.heat.stuck());
        }
        rests
    }

    /// True once after a fault with an immediate stop: the board or [`crate::machine::Machine`]
    /// stops the engine and reports with [`Self::engine_stopped`].
    pub fn take_stop(&mut self) -> bool {
        self.state.take_stop()
    }

    /// Continues from the place where the engine was stopped.
    pub fn engine_stopped(&mut self, stopped: &Stopped) {
        self.programmer.recover(stopped, &self.waiting);
    }
}
