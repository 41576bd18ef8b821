//! Host, link and the real firmware library on one virtual clock.
//!
//! [`WireFrames`] -> sender -> simulated line -> [`Machine`] -> recorded steps. The clock advances by one servo
//! period at a time, in which the controller makes one round, as a board does ([`Machine::round`]): bytes that have
//! arrived, its interval, its reports; then the sender answers. Nothing waits for the wall clock, and every random
//! choice comes from the seed, so a simulation can be repeated to the step.

use crate::drive::link::{Line, LinkSpec};
use crate::drive::record::MotionRecord;
use crate::drive::sender::Sender;
use crate::drive::sender_state::{
    SenderError, SenderEvent, SenderFigures, SenderSetup, SenderState,
};
use crate::drive::trace::counts_at;
use crate::job::frames::WireFrames;
use headway_firmware::configuration::{ConfigurationError, MOTORS_MAX, MachineConfiguration};
use headway_firmware::design::ADVANCE_WINDOW_TICKS_MAX;
use headway_firmware::machine::Machine;
use headway_firmware::machine::round::Surroundings;
use headway_protocol::frame::FRAME_BYTES_MAX;
use headway_protocol::knot_block::KNOTS_PER_BLOCK_MAX;
use headway_protocol::message::{Control, DeviceState, Fault};
use serde::{Deserialize, Serialize};
use std::iter::Copied;
use std::slice::Iter;
use thiserror::Error;

/// How much the sender keeps on the line ahead: control messages wait no longer than this.
const LINE_AHEAD_US: u64 = 2_000;
/// Servo ticks run after the end, so that the last steps are made and pressure advance no longer
/// depends on the motion: with fewer, a slice whose volume was half a step above a whole one, up to a
/// part in ten thousand, and whose last spans moved it by a unit, ended a step too far.
const TAIL_TICKS: usize = 16 + ADVANCE_WINDOW_TICKS_MAX;
/// Silence after which nothing more will arrive: longer than any retry; outages of the line do not
/// count.
const STUCK_S: f64 = 60.0;

/// Setup of the simulation.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SimulatorSetup {
    /// Faults of the line.
    pub link: LinkSpec,
    /// Fixes every random choice.
    pub seed: u64,
    /// Commands to send, with their time since start-up in us, in order of time.
    pub commands: Vec<(u64, Control)>,
}

/// Why a simulation could not be run to its end.
#[derive(Debug, Error, PartialEq, Eq)]
pub enum SimulatorError {
    /// The firmware refuses the machine.
    #[error("the firmware cannot run this machine: {0:?}; change the machine file")]
    Configuration(ConfigurationError),
    /// The conversation failed.
    #[error(transparent)]
    Sender(#[from] SenderError),
    /// Nothing has moved for a minute.
    #[error("after {at_s} s the machine is {state:?} and nothing comes any more over the link")]
    Stuck {
        /// Virtual time.
        at_s: u64,
        /// What the machine does.
        state: DeviceState,
    },
}

/// Counters of a simulated run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SimulationFigures {
    /// Hash of every step: tick from the job's first segment, motor, direction; 16 hex digits.
    pub step_digest: String,
    /// Step counts at the end: joints in order, then the extruder.
    pub final_counts: Vec<i64>,
    /// Steps of all motors.
    pub steps: u64,
    /// Bytes that the host put on the line, repeats included.
    pub bytes: u64,
    /// Stream frames sent again.
    pub resent_frames: u64,
    /// How often the queue's end made the head slow down.
    pub underruns: u64,
    /// Number of times that the head came to rest in the middle of a move.
    pub holds: u64,
    /// Faults latched.
    pub faults: u64,
    /// Virtual time from the first segment to the end.
    pub motion_s: f64,
}

/// Complete result of a simulation.
#[derive(Clone, Debug)]
pub struct Simulation {
    /// Steps and progress.
    pub motion: MotionRecord,
    /// Counters.
    pub figures: SimulationFigures,
    /// The fault that ended it, if one did.
    pub fault: Option<Fault>,
}

/// The controller's ends of the two lines, for one round of its main loop: a servo period.
struct Around<'a> {
    came: Copied<Iter<'a, u8>>,
    none: Copied<Iter<'a, u8>>,
    up: &'a mut Line,
    now_us: u64,
}

impl<'a> Surroundings for Around<'a> {
    const AT_ONCE: bool = true;
    const WEIGHED_KNOTS: usize = KNOTS_PER_BLOCK_MAX;
    type Bytes = Copied<Iter<'a, u8>>;

    fn heard(&mut self, line: usize) -> &mut Self::Bytes {
        if line == 0 {
            &mut self.came
        } else {
            &mut self.none
        }
    }

    fn has_room(&mut self, _line: usize) -> bool {
        self.up.backlog_us(self.now_us) < LINE_AHEAD_US
    }

    fn send(&mut self, _line: usize, bytes: &[u8]) -> usize {
        self.up.send(self.now_us, bytes);
        bytes.len()
    }
}

/// Host, link and controller.
#[derive(Debug)]
pub struct Simulator {
    machine: Machine,
    configuration: MachineConfiguration,
    sender: Sender,
    down: Line,
    up: Line,
    commands: std::vec::IntoIter<(u64, Control)>,
    next_command: Option<(u64, Control)>,
    record: MotionRecord,
    /// Segment time after the last servo tick, 2^-16 ticks.
    segment_q16: u64,
    servo_tick: u64,
    /// Servo tick at which something last moved or arrived.
    lively_tick: u64,
    bytes: Vec<u8>,
    out: [u8; FRAME_BYTES_MAX],
    stream_ticks: u64,
    /// The host is dead until then.
    host_dead_until_us: u64,
    /// Starts of host and controller, for session numbers.
    starts: u32,
    sent_before: SenderFigures,
}

impl Simulator {
    /// Sets the three up. `stream_ticks` is the job's segment time, for progress and bounds.
    ///
    /// # Errors
    /// [`SimulatorError::Configuration`].
    pub fn new(
        frames: WireFrames,
        stream_ticks: u64,
        configuration: &MachineConfiguration,
        setup: &SimulatorSetup,
    ) -> Result<Self, SimulatorError> {
        // Any numbers that differ do; they come from the seed to be repeatable.
        let session = 0x5e55_0000 ^ setup.seed as u32;
        let machine =
            Machine::new(configuration, session).map_err(SimulatorError::Configuration)?;
        let mut record = MotionRecord {
            start_counts: start_counts(&frames, configuration),
            ..MotionRecord::default()
        };
        record.rates_q16.reserve(stream_ticks as usize);
        let sender = Sender::new(
            frames,
            SenderSetup {
                host_session: 0x0485_7000 ^ setup.seed as u32,
                machine_hash: configuration.hash(),
                solution: configuration.kinematics.solution(),
                servo_hz: configuration.servo_hz,
                resume: false,
            },
        );
        let mut commands = setup.commands.clone().into_iter();
        let next_command = commands.next();
        Ok(Simulator {
            machine,
            configuration: configuration.clone(),
            sender,
            down: Line::new(setup.link.clone(), setup.seed.wrapping_mul(2)),
            up: Line::new(setup.link.clone(), setup.seed.wrapping_mul(2) + 1),
            commands,
            next_command,
            record,
            segment_q16: 0,
            servo_tick: 0,
            lively_tick: 0,
            bytes: Vec::new(),
            out: [0; FRAME_BYTES_MAX],
            stream_ticks,
            host_dead_until_us: 0,
            starts: 0,
            sent_before: SenderFigures::default(),
        })
    }

    /// The host dies, and after a while a new one continues the same job.
    pub fn restart_host(&mut self, dead_us: u64) {
        self.starts += 1;
        self.host_dead_until_us = self.now_us() + dead_us;
        let sent = self.sender.figures();
        self.sent_before.bytes_sent += sent.bytes_sent;
        self.sent_before.frames_sent += sent.frames_sent;
        self.sent_before.frames_resent += sent.frames_resent;
        let setup = SenderSetup {
            host_session: self.sender.setup().host_session.wrapping_add(self.starts),
            resume: true,
            ..*self.sender.setup()
        };
        self.sender = Sender::new(self.sender.frames().clone(), setup);
    }

    /// The controller dies and restarts, without memory.
    ///
    /// # Errors
    /// [`SimulatorError::Configuration`].
    pub fn restart_controller(&mut self) -> Result<(), SimulatorError> {
        self.starts += 1;
        self.machine = Machine::new(&self.configuration, 0xdead_0000 + self.starts)
            .map_err(SimulatorError::Configuration)?;
        Ok(())
    }

    /// What was recorded so far.
    pub fn record(&self) -> &MotionRecord {
        &self.record
    }

    /// Virtual time.
    pub fn now_us(&self) -> u64 {
        self.servo_tick * 1_000_000 / u64::from(self.configuration.servo_hz)
    }

    /// The host's end.
    pub fn sender(&self) -> &Sender {
        &self.sender
    }

    /// The controller.
    pub fn machine(&self) -> &Machine {
        &self.machine
    }

    /// Share of the job's segment time that has been run, 0..=1.
    pub fn progress(&self) -> f64 {
        let done = (self.segment_q16 >> 16) as f64;
        (done / self.stream_ticks.max(1) as f64).min(1.0)
    }

    /// One servo period.
    pub fn tick(&mut self) {
        let now_us = self.now_us();
        while let Some((at_us, control)) = self.next_command
            && at_us <= now_us
        {
            self.sender.command(control);
            self.next_command = self.commands.next();
        }
        self.bytes.clear();
        self.down.receive(now_us, &mut self.bytes);
        let mut around = Around {
            came: self.bytes.iter().copied(),
            none: [].iter().copied(),
            up: &mut self.up,
            now_us,
        };
        self.machine.round(&mut self.record.steps, &mut around);
        self.note_progress();
        self.servo_tick += 1;
        self.exchange(now_us);
    }

    fn note_progress(&mut self) {
        let motion = self.machine.motion();
        let Some(start) = motion.stream_start_ticks() else {
            return;
        };
        self.record.first_servo_tick = start;
        let segment_q16 = motion.segment_time_q16();
        let rate = segment_q16.saturating_sub(self.segment_q16);
        self.segment_q16 = segment_q16;
        self.record.rates_q16.push(rate as u32);
        if rate > 0 {
            self.lively_tick = self.lively_tick.max(self.servo_tick);
        }
    }

    /// Reports to the host, its answers down.
    fn exchange(&mut self, now_us: u64) {
        self.bytes.clear();
        self.up.receive(now_us, &mut self.bytes);
        if now_us < self.host_dead_until_us {
            return;
        }
        self.sender.handle_bytes(now_us, &self.bytes);
        while self.down.backlog_us(now_us) < LINE_AHEAD_US {
            let Some(length) = self.sender.poll_transmit(now_us, &mut self.out) else {
                break;
            };
            self.down.send(now_us, &self.out[..length]);
        }
        while let Some(event) = self.sender.poll_event() {
            if matches!(event, SenderEvent::Connected(_)) {
                self.lively_tick = self.lively_tick.max(self.servo_tick);
            }
        }
    }

    /// True when the job has ended, well or with a fault.
    pub fn is_over(&self) -> bool {
        let faulted = self.machine.motion().fault().is_some();
        let ended = match self.sender.state() {
            SenderState::Done | SenderState::Failed(_) => true,
            _ => faulted,
        };
        ended && self.machine.motion().is_at_rest()
    }

    /// Runs to the end; `progress` is called now and then with the share done.
    ///
    /// # Errors
    /// [`SimulatorError`]; a latched fault is not one, it is in the result.
    pub fn run(self, mut progress: impl FnMut(f64)) -> Result<Simulation, SimulatorError> {
        self.run_disturbed(|simulator| {
            if simulator.servo_tick.is_multiple_of(1000) {
                progress(simulator.progress());
            }
        })
    }

    /// Runs to the end; `disturb` is called before every servo tick and may restart either side.
    ///
    /// # Errors
    /// As [`Simulator::run`].
    pub fn run_disturbed(
        mut self,
        mut disturb: impl FnMut(&mut Self),
    ) -> Result<Simulation, SimulatorError> {
        let servo_hz = u64::from(self.configuration.servo_hz);
        let stuck_ticks = (STUCK_S * servo_hz as f64) as u64;
        self.lively_tick = self.down.last_outage_end_us().saturating_mul(servo_hz) / 1_000_000;
        while !self.is_over() {
            disturb(&mut self);
            self.tick();
            if self.servo_tick > self.lively_tick + stuck_ticks {
                return Err(SimulatorError::Stuck {
                    at_s: self.now_us() / 1_000_000,
                    state: self.machine.motion().state(),
                });
            }
        }
        let fault = self.machine.motion().fault();
        if let (None, SenderState::Failed(error)) = (fault, self.sender.state()) {
            return Err(error.clone().into());
        }
        for _ in 0..TAIL_TICKS {
            self.machine.run_servo_interval(&mut self.record.steps);
        }
        Ok(self.finish(fault))
    }

    fn finish(mut self, fault: Option<Fault>) -> Simulation {
        // At rest at the end the rate is 0; what the comparison needs is the motion.
        while self.record.rates_q16.last() == Some(&0) {
            self.record.rates_q16.pop();
        }
        let configuration = &self.configuration;
        let ratio = configuration.step_hz / configuration.servo_hz;
        let motors = configuration.joints.len() + 1;
        let sent = self.sender.figures();
        let motion = self.machine.motion();
        let motion_ticks = self.record.rates_q16.len() as f64;
        let figures = SimulationFigures {
            step_digest: format!("{:016x}", self.record.digest(ratio)),
            final_counts: self.record.final_counts()[..motors].to_vec(),
            steps: self.record.steps.len() as u64,
            bytes: self.sent_before.bytes_sent + sent.bytes_sent,
            resent_frames: self.sent_before.frames_resent + sent.frames_resent,
            underruns: u64::from(motion.underruns()),
            holds: u64::from(motion.holds()),
            faults: u64::from(fault.is_some()),
            motion_s: motion_ticks / f64::from(configuration.servo_hz),
        };
        Simulation {
            motion: self.record,
            figures,
            fault,
        }
    }
}

fn start_counts(frames: &WireFrames, machine: &MachineConfiguration) -> [i64; MOTORS_MAX] {
    counts_at(&frames.units().to_natural(frames.start()), machine)
}

#[cfg(test)]
#[path = "simulator_tests.rs"]
mod tests;
