//! The motion's report of its state.

use super::Motion;
use super::state::{Demand, State, Stream};
use crate::configuration::MOTORS_MAX;
use crate::motion::driver_panel::DriverPanel;
use crate::motion::inputs::Inputs;
use crate::steps::count;
use headway_protocol::message::{DeviceState, Fault};

impl Motion {
    /// State for reports.
    pub fn state(&self) -> DeviceState {
        if self.fault.is_some() {
            return DeviceState::Faulted;
        }
        match &self.state {
            State::Filling(stream) => state_of(stream, DeviceState::Filling),
            State::Starved(stream) => state_of(stream, DeviceState::Starved),
            State::Running(stream) if self.warp.is_held() => state_of(stream, DeviceState::Starved),
            State::Running(stream) => state_of(stream, DeviceState::Running),
            State::Finished(_) => DeviceState::Finished,
            State::Jog { brakes: true } => DeviceState::Aborting,
            State::Jog { .. } if self.jog.is_probing() => DeviceState::Probing,
            State::Jog { .. } if self.jog.is_homing() => DeviceState::Homing,
            State::Jog { .. } => DeviceState::Jogging,
            State::Idle { settles: true, .. } | State::Stopping { settles: true, .. } => {
                DeviceState::Aborting
            }
            State::Idle { .. } | State::Stopping { .. } => DeviceState::Idle,
        }
    }

    /// A stream is open, also one that is being left.
    pub fn has_stream(&self) -> bool {
        self.state.stream().is_some()
    }

    /// True from an abort until the machine rests.
    pub fn is_aborting(&self) -> bool {
        self.state.is_aborting()
    }

    /// The known state of the drivers.
    pub fn drivers(&self) -> &DriverPanel {
        &self.drivers
    }

    /// The same, to write to.
    pub(crate) fn drivers_mut(&mut self) -> &mut DriverPanel {
        &mut self.drivers
    }

    /// The latched fault.
    pub fn fault(&self) -> Option<Fault> {
        self.fault
    }

    /// Path rate, 2^-16.
    pub fn rate_q16(&self) -> u32 {
        self.warp.rate_q16()
    }

    /// Present feed override, per cent.
    pub fn override_percent(&self) -> u16 {
        self.override_percent
    }

    /// Present flow override, per cent.
    pub fn flow_percent(&self) -> u16 {
        self.flow.override_percent()
    }

    /// Spans completed since the stream's start.
    pub fn spans_done(&self) -> u32 {
        self.interpolator.spans_done()
    }

    /// Segment time that the next servo tick will evaluate, 2^-16 ticks since the stream's start.
    pub fn segment_time_q16(&self) -> u64 {
        self.interpolator.segment_time_q16()
    }

    /// Servo ticks since start-up.
    pub fn now_ticks(&self) -> u64 {
        self.now_ticks
    }

    /// Servo tick (from start-up, counted from 0) that evaluated segment time 0 of the stream.
    pub fn stream_start_ticks(&self) -> Option<u64> {
        self.stream_start_ticks
    }

    /// Knots that wait.
    pub fn queued_knots(&self) -> usize {
        self.queue.len()
    }

    /// Knots that still fit.
    pub fn knot_room(&self) -> usize {
        self.queue.room()
    }

    /// Flow events that wait.
    pub fn queued_events(&self) -> usize {
        self.events.waiting()
    }

    /// Flow events that still fit.
    pub fn event_room(&self) -> usize {
        self.events.room()
    }

    /// Joints whose position is known, bit 0 = joint 0.
    pub fn referenced(&self) -> u8 {
        self.reference.known
    }

    /// Joints whose switch is pressed, as a mask, and the probe.
    pub fn switches(&self) -> u8 {
        self.inputs.switches
    }

    /// Levels of the inputs.
    pub fn inputs(&self) -> &Inputs {
        &self.inputs
    }

    /// True while any driver has to be energised.
    pub fn drivers_on(&self) -> bool {
        self.held_motors() != 0
    }

    /// Motors whose drivers have to be energised, one bit each: all from the first request to move until they are
    /// released.
    #[inline(always)]
    pub fn held_motors(&self) -> u8 {
        if self.state.holds_motors() {
            u8::MAX
        } else {
            self.kept_motors
        }
    }

    /// How often the queue's end made the head slow down.
    pub fn underruns(&self) -> u32 {
        self.underruns
    }

    /// Number of times that the head came to rest in the middle of a move.
    pub fn holds(&self) -> u32 {
        self.holds
    }

    /// Motors, the extruder last.
    pub fn motors(&self) -> usize {
        self.joints.count() + 1
    }

    /// Step counts at the end of the newest interval: the joints' motors in order, then the extruder.
    pub fn counts(&self) -> [i64; MOTORS_MAX] {
        self.programmer.motor_positions(&self.waiting).map(count)
    }

    /// Targets of the joints in the newest program, 2^-31 steps: evaluated [`Self::delay_ticks`] before.
    pub fn targets(&self) -> [i64; MOTORS_MAX] {
        self.programmer.newest_targets(&self.waiting)
    }

    /// Servo ticks that the motors wait for pressure advance and shapers.
    pub fn delay_ticks(&self) -> u32 {
        self.delays.line_ticks
    }

    /// True if no motor moves.
    pub fn is_at_rest(&self) -> bool {
        let is_drained = self.still_ticks >= self.programmer.settle_ticks();
        is_drained && self.programmer.is_at_rest()
    }
}

/// State of an open stream, by its demand.
fn state_of(stream: &Stream, moving: DeviceState) -> DeviceState {
    match stream.demand {
        Demand::Leave => DeviceState::Aborting,
        Demand::Go { pauses: true, .. } => DeviceState::Paused,
        Demand::Go { heats: true, .. } => DeviceState::Heating,
        Demand::Go { .. } => moving,
    }
}
