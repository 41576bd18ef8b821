//! The servo side: queued spans and flow events -> one step program per servo tick.
//!
//! ```text
//! queue -> interpolator -> joint targets -> step programmer -> program for the step engine
//!             ^   |            + extruder target (flow, events, hold)
//!        time warp (override, pause, starving)
//! ```
//! In: knots and flow events, commands, levels of the inputs, the panels of heaters and drivers. Out: a [`StepBank`]
//! per servo tick; state, counts and faults for reports. Not covered: bytes (`line`).
//!
//! Everything here is called by the servo interrupt, except the commands, which a board calls
//! under a short lock. Deadline of [`Motion::tick`] on a board: one servo period.

mod commands;
pub mod driver_panel;
mod faults;
pub mod heat_panel;
mod heated;
pub mod homing;
pub mod inputs;
mod jog;
pub mod joint_move;
mod probe;
pub mod probe_pin;
mod rate;
mod state;
mod status;
pub mod time_warp;

use crate::configuration::MachineConfiguration;
use crate::configuration::homing::HomingConfiguration;
use crate::design::{
    CEILINGS_AT_ONCE, HOLD_RETRACT_DELAY_MS, MOTORS_IDLE_S, QUIET_START_MS, START_QUEUED_MS,
    START_ROOM_KNOTS, ticks_of_ms,
};
use crate::flow::event_queue::EventQueue;
use crate::flow::extruder_limits::ExtruderGuard;
use crate::flow::hold::Hold;
use crate::flow::{Flow, FlowWindow};
use crate::motion::driver_panel::DriverPanel;
use crate::motion::heat_panel::HeatPanel;
use crate::motion::inputs::{Inputs, SwitchGuard};
use crate::motion::probe_pin::ProbePin;
use crate::motion::time_warp::TimeWarp;
use crate::path::interpolator::{Interpolator, TICK_Q16};
use crate::path::joint_channels::JointChannels;
use crate::path::joints::JointTargets;
use crate::path::queue::KnotQueue;
use crate::steps::delay::Delays;
use crate::steps::motor_mix::MotorMix;
use crate::steps::{StepBank, StepProgrammer, WaitingTargets};
pub use faults::EMERGENCY;
use faults::step_rate_fault;
use headway_protocol::message::{ColdHeater, Fault, FaultCause, ProbeResult};
use jog::Jog;
use state::{Standing, State, Stream};

/// The known positions of the motors.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Reference {
    /// Joints declared or homed, and followed since: a mask.
    known: u8,
    /// Joints stopped at full speed by a fault, or not found by homing: they must be declared or
    /// homed. The next stream's start declares joints that are neither known nor lost.
    lost: u8,
}

impl Reference {
    fn learn(&mut self, joints: u8) {
        self.known |= joints;
        self.lost &= !joints;
    }

    fn lose(&mut self, joints: u8) {
        self.known &= !joints;
        self.lost |= joints;
    }
}

/// Why a command cannot be followed now.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CommandError {
    /// Moving, or a stream is open.
    Busy,
    /// A fault is latched.
    Faulted,
    /// The position is invalid for the machine, or not its current one.
    Invalid,
    /// Melt would move while this hot end is too cold for it.
    Cold(ColdHeater),
}

/// The servo side of the machine.
#[derive(Clone, Debug)]
// Fields that every tick uses are first, within the reach of one instruction; the queue is last.
#[repr(C)]
pub struct Motion {
    programmer: StepProgrammer,
    state: State,
    now_ticks: u64,
    /// Servo tick at which a host was last heard of the stream, wrapping.
    heard_ticks: u32,
    /// Servo tick at which the path rate was last not that of the plan, wrapping.
    off_plan_ticks: u32,
    servo_hz: u32,
    /// Servo ticks that the path and the flow have rested, as long as nothing was to move.
    still_ticks: u32,
    override_percent: u16,
    /// The same as a path rate.
    override_q16: u32,
    inputs: Inputs,
    switch_guard: SwitchGuard,
    /// Servo ticks at rest without a stream.
    idle_ticks: u32,
    /// Motors that idleness does not let go, and those that are held although the others were let go: masks.
    hold_motors: u8,
    kept_motors: u8,
    reference: Reference,
    fault: Option<Fault>,
    extruder_guard: ExtruderGuard,
    joints: JointTargets,
    warp: TimeWarp,
    hold: Hold,
    stream_start_ticks: Option<u64>,
    underruns: u32,
    holds: u32,
    flow: Flow,
    events: EventQueue,
    interpolator: Interpolator,
    /// In base units, those of commands; the interpolator has those of the stream.
    joint_channels: JointChannels,
    /// Servo ticks that motors wait for pressure advance and shapers.
    delays: Delays,
    jog: Jog,
    probe: ProbeResult,
    pin: ProbePin,
    heat: HeatPanel,
    /// Span of the open stream before which melt still moves.
    melt_until_span: u32,
    drivers: DriverPanel,
    flow_window: FlowWindow,
    /// See [`Self::work_in_pieces`].
    in_pieces: bool,
    waiting: WaitingTargets,
    queue: KnotQueue,
}

impl Motion {
    /// At rest, nothing declared.
    pub fn new(configuration: &MachineConfiguration, switches: &HomingConfiguration) -> Self {
        let servo_hz = configuration.servo_hz.max(1);
        let joint_channels = JointChannels::new(configuration);
        let joints = JointTargets::new(configuration);
        let mix = MotorMix::new(&configuration.motors, joints.count());
        let motors = mix.motors(joints.count());
        let hold = configuration
            .motors
            .motors_of(switches.hold, joints.count());
        let delays = Delays::of(configuration).unwrap_or_default();
        Self {
            joints,
            extruder_guard: ExtruderGuard::new(configuration),
            interpolator: Interpolator::new(&joint_channels),
            joint_channels,
            flow_window: FlowWindow::NONE,
            waiting: WaitingTargets::new(configuration, &delays),
            queue: KnotQueue::new(),
            events: EventQueue::default(),
            warp: TimeWarp::default(),
            flow: Flow::new(configuration, servo_hz, delays.advance_ticks),
            hold: Hold::new(ticks_of_ms(HOLD_RETRACT_DELAY_MS, servo_hz)),
            programmer: StepProgrammer::new(motors, configuration.interval_ticks()).with_mix(mix),
            state: State::NEW,
            reference: Reference::default(),
            jog: Jog::new(configuration, switches),
            probe: ProbeResult::None,
            pin: ProbePin::default(),
            heat: HeatPanel::default(),
            melt_until_span: 0,
            in_pieces: false,
            drivers: DriverPanel::default(),
            inputs: Inputs::default(),
            switch_guard: SwitchGuard::default(),
            idle_ticks: 0,
            hold_motors: hold,
            kept_motors: 0,
            override_percent: 100,
            override_q16: TICK_Q16,
            fault: None,
            heard_ticks: 0,
            off_plan_ticks: 0,
            underruns: 0,
            holds: 0,
            now_ticks: 0,
            stream_start_ticks: None,
            servo_hz,
            still_ticks: 0,
            delays,
        }
    }

    /// One servo tick: evaluates the pose of now, programs the interval that follows the one that
    /// the engine has, into `bank`, and moves segment time on.
    ///
    /// False after a fault: the bank is not to be played, and the engine is to be stopped
    /// ([`Self::take_stop`]).
    pub fn tick(&mut self, bank: &mut StepBank) -> bool {
        self.now_ticks += 1;
        if let Some(fault) = self.input_fault() {
            self.stop_at_once(fault);
            return false;
        }
        let programmed = if let State::Jog { brakes } = self.state {
            let targets = self.tick_jog(brakes);
            let advanced = self.programmer.advance(&targets, bank);
            advanced.map_err(|exceeded| step_rate_fault(exceeded, self.servo_hz))
        } else {
            self.follow_path(bank)
        };
        if let Err(fault) = programmed {
            self.stop_at_once(fault);
            return false;
        }
        true
    }

    /// One servo tick along the stream, or at rest.
    fn follow_path(&mut self, bank: &mut StepBank) -> Result<(), Fault> {
        self.gate();
        self.program(bank)?;
        self.begin_due_events();
        self.move_on();
        Ok(())
    }

    /// Work for coming spans that need not be done in a servo tick, one span at most: to be called
    /// repeatedly by a board's main loop, or once after every tick. True if there was any.
    pub fn look_ahead(&mut self) -> bool {
        if self.queue.go_on_with_pass(CEILINGS_AT_ONCE) {
            self.interpolator.look_at_ceilings(&self.queue);
            return true;
        }
        self.interpolator.prepare_next(&self.queue)
    }

    /// A fault that the inputs demand now.
    #[inline]
    fn input_fault(&mut self) -> Option<Fault> {
        if self.inputs == Inputs::default() {
            self.switch_guard = SwitchGuard::default();
            return None;
        }
        // Whatever was latched before: its soft stop may still be moving.
        if self.inputs.emergency && (self.fault.is_none() || !self.is_at_rest()) {
            return Some(EMERGENCY);
        }
        let pressed = self.inputs.switches & self.guarded_switches();
        let joint = usize::from(self.switch_guard.tick(pressed)?);
        let position = self.programmer.present_positions(&self.waiting);
        let position = position.get(joint).copied().unwrap_or_default();
        let cause = FaultCause::LimitSwitch;
        Some(self.joints.limit_fault(joint, position, cause))
    }

    /// Continues a resting stream once enough is queued and the melt is ready.
    fn gate(&mut self) {
        // The next span is prepared meanwhile.
        let prepared = self.interpolator.is_prepared();
        if let Some(&stream) = self.state.waiting()
            && self.may_move(&stream)
            && self.has_enough(&stream)
            && prepared
        {
            let (ready, prime) = self.hold.ready(self.flow.is_active());
            if let Some(prime) = prime {
                self.flow.begin(&prime);
            }
            if ready {
                self.still_ticks = 0;
                self.state = State::Running(stream);
            }
        }
        if self.state.runs() && self.interpolator.begin_next(&mut self.queue) {
            self.stream_start_ticks.get_or_insert(self.now_ticks - 1);
        }
    }

    /// Starts the flow events whose place segment time has reached.
    fn begin_due_events(&mut self) {
        // At most one a tick: two at the same place start half a millisecond apart.
        let (spans_begun, local_ticks) = self.interpolator.spans_and_ticks();
        if let Some(event) = self.events.due(spans_begun, local_ticks)
            && self.flow.begin_after_target(event)
        {
            self.hold.note(event);
            self.events.pop();
        }
    }

    /// Programs the motors for the pose of now.
    fn program(&mut self, bank: &mut StepBank) -> Result<(), Fault> {
        let mut outside = 0;
        let advanced = if self.state.follows_path() {
            let (joints, offset) = (&mut self.joints, self.interpolator.offset());
            let programmer = &mut self.programmer;
            let places = programmer.begin();
            let mut new = programmer.new_targets(&mut self.waiting, places);
            let reach = match joints.set_targets(&offset, |joint, target| new.put(joint, target)) {
                Ok(reach) => reach,
                Err(fault) => {
                    programmer.take_back_begin();
                    return Err(fault);
                }
            };
            let motor = joints.count();
            let (extruder, advance) = self
                .flow
                .target(&mut self.flow_window, offset.target_of_motor(motor));
            let (jump, ways) =
                programmer.put_extruder((&mut self.waiting, places), motor, extruder, advance);
            // At rest, as in the tick in which a stream starts, there is nothing to look at.
            if ways != [0, 0] && !self.extruder_guard.is_kept(ways) {
                self.check_extruder(ways)?;
            }
            outside = reach.outside;
            let waiting = &mut self.waiting;
            let jumps = reach.jumps | jump;
            self.programmer
                .advance_to_targets(jumps, waiting, places, bank)
        } else {
            self.programmer.advance_at_rest(bank)
        };
        advanced.map_err(|exceeded| step_rate_fault(exceeded, self.servo_hz))?;
        if outside != 0 {
            // After all motors have their programs, which are then taken back as a whole.
            let programmer = &self.programmer;
            let target = |joint| programmer.target(joint);
            self.joints.check_limits(outside, target)?;
        }
        Ok(())
    }

    fn quiet_ticks(&self) -> u32 {
        (self.now_ticks as u32).wrapping_sub(self.heard_ticks)
    }

    fn has_enough(&self, stream: &Stream) -> bool {
        !self.queue.is_empty()
            && !self.queue.has_pass()
            && (stream.is_complete
                || self.queue.queued_ticks() >= ticks_of_ms(START_QUEUED_MS, self.servo_hz)
                || self.queue.room() < START_ROOM_KNOTS
                || self.events.room() == 0
                || self.quiet_ticks() >= ticks_of_ms(QUIET_START_MS, self.servo_hz))
    }

    /// After the rate was chosen: did the head come to rest, and why?
    fn note_rest(&mut self, rate_q16: u32, wanted_q16: u32) {
        let at_end = self.interpolator.remaining_q16() == 0 && self.queue.is_empty();
        if at_end && self.interpolator.ends_at_rest() {
            self.warp.stop();
            if let Some(stream) = self.state.stream() {
                self.state = State::Filling(*stream);
            }
        } else if rate_q16 == 0 && (wanted_q16 == 0 || self.warp.is_held()) {
            let is_at_rest_point = self.interpolator.is_at_rest_point();
            if let Some(stream) = self.state.stream() {
                self.state = if is_at_rest_point {
                    State::Filling(*stream)
                } else {
                    State::Starved(*stream)
                };
            }
            self.holds = self.holds.saturating_add(1);
        }
    }

    /// One tick at rest.
    #[inline(never)]
    fn rest(&mut self) {
        self.still_ticks = if self.flow.is_active() {
            0
        } else {
            self.still_ticks.saturating_add(1)
        };
        if self.state.is_aborting() || self.fault.is_some() {
            if self.pulls_back() {
                return;
            }
            self.forget_stream();
            // It settles until the shapers' delays have run out too: a `Start` is repeated so long, and not refused.
            self.state.leave(self.is_at_rest());
        }
        let Some(stream) = self.state.stream() else {
            self.count_idle();
            return;
        };
        let is_complete = stream.is_complete;
        let starved = matches!(self.state, State::Starved(_));
        self.idle_ticks = 0;
        if starved && let Some(retract) = self.hold.rested(self.flow.is_active()) {
            self.flow.begin(&retract);
        }
        if is_complete && self.queue.is_empty() {
            self.end_stream(starved);
        }
    }

    /// One tick without a stream, a fault latched or not: motors that hold nothing for long are let go, but for those
    /// of joints that would fall.
    fn count_idle(&mut self) {
        self.idle_ticks += 1;
        if self.idle_ticks >= MOTORS_IDLE_S.saturating_mul(self.servo_hz) {
            self.idle_ticks = 0;
            if self.state.holds_motors() {
                self.let_go(self.hold_motors);
            }
        }
    }

    /// All that was sent has been played: is it an end?
    fn end_stream(&mut self, starved: bool) {
        if starved {
            self.fail_softly(Fault {
                cause: FaultCause::Sequence,
                index: 0,
                value: self.interpolator.spans_done() as i32,
            });
        } else if !self.flow.is_active() && self.is_at_rest() {
            self.events.clear();
            self.state = State::Finished(Standing::ON_PATH);
        }
    }

    /// Drops all queued knots and events; the head stays where it rests.
    // Once in the image.
    #[inline(never)]
    fn forget_stream(&mut self) {
        self.queue.clear();
        self.interpolator.forget_next();
        self.events.clear();
        self.flow.cut();
        self.warp.stop();
    }

    /// Latches a fault and demands that the engine stops. The first fault stays.
    fn stop_at_once(&mut self, fault: Fault) {
        self.fault.get_or_insert(fault);
        self.programmer.forget(&self.waiting);
        self.forget_stream();
        // What was delayed is forgotten too.
        self.still_ticks = self.delays.settle_ticks;
        self.reference.lose(self.joints.all());
        self.state.stop();
    }
}
