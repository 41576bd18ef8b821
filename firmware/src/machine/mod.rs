//! The complete controller, sans-IO, driven by a board or the simulator.
//!
//! ```text
//! bytes -> receiver -> motion (queue, time warp, joints, flow) -> step player -> step pins
//! bytes <- reports  <-
//! ```
//! In: bytes, levels of the inputs, calls. Out: steps, bytes.
//!
//! Call order: [`Machine::handle_bytes`] whenever bytes arrive; every servo period [`Machine::servo_tick`],
//! then `step_hz / servo_hz` times [`Machine::step_tick`] (or [`Machine::run_servo_interval`], which is both at
//! once with the same result); [`Machine::poll_report`] until it returns 0. Time is the number of calls. A
//! board that runs servo and steps in interrupts of their own builds the parts in their own places
//! ([`Machine::check`]); servo tick ([`servo`]) and round of the main loop ([`round`]) are the same functions
//! there.

pub mod round;
pub mod servo;
pub mod watchdog;

use crate::configuration::heat::HeatConfiguration;
use crate::configuration::homing::HomingConfiguration;
use crate::configuration::{ConfigurationError, MachineConfiguration};
use crate::drivers::{DriverPort, DriverService};
use crate::heat::Outputs;
use crate::heat::service::HeatService;
use crate::line::{Conversation, Receiver};
use crate::motion::Motion;
use crate::motion::inputs::Inputs;
use crate::motion::probe_pin::ProbePin;
use crate::settings::BoardLimits;
use crate::steps::StepPlayer;
use crate::steps::output::StepOutput;
use headway_protocol::knot_block::KNOTS_PER_BLOCK_MAX;
use headway_protocol::message::Fault;
use round::{Controller, Link, Surroundings};
use servo::{Servo, stop_if_due};

/// Receiver, motion and step player.
#[derive(Clone, Debug)]
pub struct Machine {
    receiver: Receiver,
    /// The first line, which is always there.
    link: Link,
    servo: Servo,
    player: StepPlayer,
    /// Rounds of the main loop.
    rounds: u32,
}

impl Machine {
    /// At rest. `session` should differ after every start of the controller.
    ///
    /// # Errors
    /// [`ConfigurationError`] where the configuration cannot be run.
    pub fn new(
        configuration: &MachineConfiguration,
        session: u32,
    ) -> Result<Self, ConfigurationError> {
        Self::with_switches(configuration, &HomingConfiguration::none(), session)
    }

    /// The same with switches to home to.
    ///
    /// # Errors
    /// [`ConfigurationError`] where either configuration cannot be run.
    // The machine is large: built where a board needs it, it is not copied.
    #[inline(always)]
    pub fn with_switches(
        configuration: &MachineConfiguration,
        switches: &HomingConfiguration,
        session: u32,
    ) -> Result<Self, ConfigurationError> {
        Self::check(configuration, switches)?;
        Ok(Self {
            receiver: Receiver::new(configuration, session),
            link: Link::new(Conversation::new(configuration, 0)),
            servo: Servo::new(Motion::new(configuration, switches)),
            player: StepPlayer::new(configuration.interval_ticks()),
            rounds: 0,
        })
    }

    /// Whether a machine with these configurations can be run: for boards, which build its parts in
    /// the interrupts that own them.
    ///
    /// # Errors
    /// [`ConfigurationError`] where either configuration cannot be run.
    pub fn check(
        configuration: &MachineConfiguration,
        switches: &HomingConfiguration,
    ) -> Result<(), ConfigurationError> {
        configuration.check()?;
        switches.check(configuration)
    }

    /// Takes bytes from the first line.
    pub fn handle_bytes(&mut self, bytes: &[u8]) {
        hear(
            &mut self.receiver,
            &mut self.link.talk,
            &mut self.servo,
            bytes,
        );
        stop_if_due(self.servo.motion_mut(), &mut self.player);
    }

    /// Takes bytes from another line.
    pub fn handle_line(&mut self, talk: &mut Conversation, bytes: &[u8]) {
        hear(&mut self.receiver, talk, &mut self.servo, bytes);
        stop_if_due(self.servo.motion_mut(), &mut self.player);
    }

    /// The connection of another line has ended, see [`Receiver::hang_up`].
    pub fn hang_up(&mut self, talk: &Conversation) {
        self.receiver.hang_up(talk);
    }

    /// See [`Receiver::is_owner`].
    pub fn is_owner(&self, talk: &Conversation) -> bool {
        self.receiver.is_owner(talk)
    }

    /// See [`Receiver::wait_for_host`].
    pub fn wait_for_host(&mut self, silent_ms: u32) {
        self.receiver.wait_for_host(silent_ms);
    }

    /// The board has a store for settings, see [`Receiver::keep_settings`].
    pub fn keep_settings(&mut self, board: BoardLimits) {
        self.receiver.keep_settings(board);
    }

    /// Origin of the active settings, see [`Receiver::settings_in_force`].
    pub fn settings_in_force(&mut self, hash: u32) {
        self.receiver.settings_in_force(hash);
    }

    /// The probe has a pin, see [`Motion::fit_probe_pin`].
    pub fn fit_probe_pin(&mut self, pin: ProbePin) {
        self.servo.motion_mut().fit_probe_pin(pin);
    }

    /// Serves the drivers when it is their turn: to be called repeatedly.
    pub fn serve_drivers(&mut self, service: &mut DriverService, port: &mut impl DriverPort) {
        if service.is_due(self.servo.motion()) {
            service.turn(port);
            service.tell(self.servo.motion_mut());
        }
    }

    /// Sets the drivers up, before the first servo tick.
    pub fn set_up_drivers(&mut self, service: &mut DriverService, port: &mut impl DriverPort) {
        service.set_up(port);
        service.tell(self.servo.motion_mut());
    }

    /// Stores settings that have come from the first line, see [`Receiver::store_settings`].
    #[cfg(test)]
    pub fn store_first_settings(&mut self, put: impl FnOnce(&[u8]) -> bool) {
        self.receiver.store_settings(&mut self.link.talk, put);
    }

    /// Stores settings that have come from another line, see [`Receiver::store_settings`].
    pub fn store_settings(&mut self, talk: &mut Conversation, put: impl FnOnce(&[u8]) -> bool) {
        self.receiver.store_settings(talk, put);
    }

    /// The next report for another line, like [`Self::poll_report`].
    pub fn poll_line(&self, talk: &mut Conversation, out: &mut [u8]) -> usize {
        self.receiver.poll_report(talk, self.servo.motion(), out)
    }

    /// Levels of the inputs, for the next servo tick.
    pub fn set_inputs(&mut self, inputs: Inputs) {
        self.servo.motion_mut().set_inputs(inputs);
    }

    /// One servo tick: the next interval's steps.
    pub fn servo_tick(&mut self) {
        tick(&mut self.servo, &mut self.player, self.rounds);
        self.servo.motion_mut().look_ahead();
    }

    /// One round of the main loop with a servo tick and all its step ticks in it, as on a board.
    pub fn round<O: StepOutput>(&mut self, output: &mut O, around: &mut impl Surroundings) {
        let mut turns = Turns {
            servo: &mut self.servo,
            player: &mut self.player,
            rounds: &mut self.rounds,
            output,
        };
        let links = core::slice::from_mut(&mut self.link);
        round::round(&mut self.receiver, links, &mut turns, around);
    }

    /// One step tick.
    #[inline]
    pub fn step_tick<O: StepOutput>(&mut self, output: &mut O) {
        self.player.tick(output);
    }

    /// One servo tick and all its step ticks.
    pub fn run_servo_interval<O: StepOutput>(&mut self, output: &mut O) {
        self.servo_tick();
        self.player.run_interval(output);
    }

    /// All step ticks of an interval whose servo tick has been computed, at once.
    pub fn run_step_interval<O: StepOutput>(&mut self, output: &mut O) {
        self.player.run_interval(output);
    }

    /// Step ticks of a servo interval.
    pub fn interval_ticks(&self) -> u32 {
        self.player.interval_ticks()
    }

    /// Writes the next report frame into `out` (at least `FRAME_BYTES_MAX` long) and returns its
    /// length; 0 if there is nothing to report.
    pub fn poll_report(&mut self, out: &mut [u8]) -> usize {
        let motion = self.servo.motion();
        self.receiver.poll_report(&mut self.link.talk, motion, out)
    }

    /// Adds these heaters with their control, off at first.
    pub fn add_heaters(
        &mut self,
        configuration: &MachineConfiguration,
        heat: &HeatConfiguration,
    ) -> HeatService {
        HeatService::new(configuration, heat, self.servo.motion_mut())
    }

    /// New outputs of heaters and fans, once per period; `None` in between.
    pub fn serve_heat(&mut self, service: &mut HeatService, fan_turns: u8) -> Option<Outputs> {
        service.serve(self.servo.motion_mut(), fan_turns)
    }

    /// What the motion is doing.
    pub fn motion(&self) -> &Motion {
        self.servo.motion()
    }

    /// Latches a fault and stops immediately: emergency input, limit switch, watchdog.
    pub fn fail_at_once(&mut self, fault: Fault) {
        self.servo.motion_mut().fail_at_once(fault);
        stop_if_due(self.servo.motion_mut(), &mut self.player);
    }
}

/// Bytes of a line; a block of knots is handed over at once.
fn hear(receiver: &mut Receiver, talk: &mut Conversation, servo: &mut Servo, bytes: &[u8]) {
    for &byte in bytes {
        let request = receiver.receive(talk, byte);
        if receiver.is_busy() {
            receiver.work(KNOTS_PER_BLOCK_MAX);
            receiver.deliver(talk, servo.motion_mut());
        }
        if let Some(request) = request {
            receiver.apply(talk, request, servo.motion_mut());
        }
    }
}

/// Servo, steps and main loop in turns: nothing interrupts.
struct Turns<'a, O> {
    servo: &'a mut Servo,
    player: &'a mut StepPlayer,
    rounds: &'a mut u32,
    output: &'a mut O,
}

impl<O: StepOutput> Controller for Turns<'_, O> {
    fn with_motion<R>(&mut self, work: impl FnOnce(&mut Motion) -> R) -> Option<R> {
        Some(work(self.servo.motion_mut()))
    }

    fn command(&mut self, work: impl FnOnce(&mut Motion)) {
        work(self.servo.motion_mut());
        stop_if_due(self.servo.motion_mut(), self.player);
    }

    fn note_round(&mut self) {
        *self.rounds = self.rounds.wrapping_add(1);
    }

    fn interrupts(&mut self) {
        tick(self.servo, self.player, *self.rounds);
        self.player.run_interval(self.output);
    }
}

fn tick(servo: &mut Servo, player: &mut StepPlayer, rounds: u32) {
    let inputs = *servo.motion().inputs();
    servo.tick(inputs, player, rounds);
}

#[cfg(test)]
mod tests;
