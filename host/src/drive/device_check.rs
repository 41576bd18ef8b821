//! The board's own checks of a finished job, made before the job is written.
//!
//! In: the pieces of a stream (integer units, servo ticks) in order, the machine. Out: the first fault that a board
//! would latch, with its time and place, or none. The firmware library runs the job servo tick by servo tick at the
//! planned path rate: demands of each span, ranges of the joints, rate and acceleration of the extruder with pressure
//! advance, primes and retracts together. Its step programs are not executed, so that no step is made. Not covered:
//! the line, overrides, heaters and inputs, which a plan does not contain.

use crate::job::SegmentStream;
use headway_firmware::configuration::homing::HomingConfiguration;
use headway_firmware::configuration::{ConfigurationError, MachineConfiguration};
use headway_firmware::kinematics::winding::Winding;
use headway_firmware::machine::Machine;
use headway_firmware::motion::Motion;
use headway_firmware::path::load::{LoadModel, SpanFault};
use headway_firmware::path::queue::QueuedKnot;
use headway_firmware::path::spline::SpanWindow;
use headway_firmware::steps::StepBank;
use headway_protocol::knot_block::KNOTS_PER_BLOCK_MAX;
use headway_protocol::message::{DeviceState, Fault, FaultCause};
use headway_protocol::segment::FlowEvent;
use headway_protocol::units::{CHANNEL_X, CHANNELS, Units};
use std::collections::VecDeque;

/// Longest wait for the end of a job after its last segment, s: a start waits a second at most, and the delay
/// of shapers and pressure advance is shorter.
const END_MAX_S: u64 = 10;

/// Why a board would not run a job to its end.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// The machine itself.
    #[error("no board runs this machine ({0:?}): change the machine file")]
    Machine(ConfigurationError),
    /// The pose that the job begins with.
    #[error("the job begins outside the range of a joint")]
    Start,
    /// A fault during the job.
    #[error("{0}")]
    Fault(Fault),
    /// It rests for ever.
    #[error("the job would not come to its end")]
    NoEnd,
}

/// A refusal and its place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Refused {
    /// The board's refusal.
    pub refusal: Refusal,
    /// When, s of the job.
    pub time_s: f64,
    /// Where the tip is about then, machine coordinates, mm.
    pub at_mm: [f64; 3],
}

/// The checks of a job that is given in parts.
#[derive(Debug, Default)]
pub struct DeviceCheck {
    board: Option<Board>,
    refused: Option<Refused>,
}

/// A board without a line and without motors.
#[derive(Debug)]
struct Board {
    motion: Box<Motion>,
    /// Programs go here and nowhere else.
    bank: StepBank,
    loads: LoadModel,
    units: Units,
    window: SpanWindow,
    winding: Winding<f32>,
    servo_hz: u64,
    /// Segment time sent so far.
    sent_ticks: u64,
    /// Pending spans: when each begins and where, in the stream's units.
    places: VecDeque<(u64, [i64; CHANNELS])>,
}

impl DeviceCheck {
    /// Runs the next part, which begins at the end of the last one; `machine` is that of the complete
    /// job.
    pub fn add(&mut self, piece: &SegmentStream, machine: &MachineConfiguration) {
        if self.refused.is_some() || piece.knots.is_empty() {
            return;
        }
        let run = match &mut self.board {
            Some(board) => board.run(piece),
            none => Board::new(piece, machine).and_then(|board| none.insert(board).run(piece)),
        };
        self.refused = run.err();
    }

    /// Runs the rest.
    pub fn finish(mut self) -> Option<Refused> {
        if self.refused.is_none()
            && let Some(board) = &mut self.board
        {
            self.refused = board.end().err();
        }
        self.refused
    }
}

impl Refused {
    /// Before anything moves.
    fn at_start(refusal: Refusal, piece: &SegmentStream) -> Self {
        Refused {
            refusal,
            time_s: 0.0,
            at_mm: tip_mm(&piece.start.map(i64::from), &piece.units),
        }
    }
}

impl Board {
    fn new(piece: &SegmentStream, machine: &MachineConfiguration) -> Result<Self, Refused> {
        let at_start = |refusal| Refused::at_start(refusal, piece);
        let switches = HomingConfiguration::none();
        let checked = Machine::check(machine, &switches);
        checked.map_err(|error| at_start(Refusal::Machine(error)))?;
        let mut motion = Box::new(Motion::new(machine, &switches));
        let started = motion.start_in(&piece.start, piece.solution, &piece.units);
        started.map_err(|_| at_start(Refusal::Start))?;
        let mut loads = LoadModel::new(machine);
        loads.take_solution(piece.solution);
        loads.take_units(&piece.units);
        Ok(Board {
            motion,
            bank: StepBank::default(),
            window: SpanWindow::at_rest(&piece.start),
            winding: loads.winding_at(&piece.start),
            loads,
            units: piece.units,
            servo_hz: u64::from(machine.servo_hz),
            sent_ticks: 0,
            places: VecDeque::new(),
        })
    }

    /// Sends a piece as fast as it is accepted.
    fn run(&mut self, piece: &SegmentStream) -> Result<(), Refused> {
        let mut events = piece.events.as_slice();
        let mut sent = 0;
        for block in piece.knots.chunks(KNOTS_PER_BLOCK_MAX) {
            let end = sent + block.len() as u32;
            let due = events.partition_point(|event| event.span < end);
            let (now, later) = events.split_at(due);
            now.iter().try_for_each(|event| self.send_event(event))?;
            while self.motion.knot_room() < block.len() {
                self.tick()?;
            }
            let mut queued = [None; KNOTS_PER_BLOCK_MAX];
            for (queued, knot) in queued.iter_mut().zip(block) {
                self.window.push(knot);
                let load = self.loads.of_span(&self.window, &mut self.winding);
                let load = load.map_err(|fault| self.refused_ahead(fault))?;
                *queued = Some(QueuedKnot::new(&self.window, knot, load));
                self.places
                    .push_back((self.sent_ticks, *self.window.base()));
                self.sent_ticks += u64::from(self.window.duration_ticks());
            }
            let queued: Vec<QueuedKnot> = queued.into_iter().flatten().collect();
            self.motion.push_knots(&queued);
            (sent, events) = (end, later);
            let ticks = self.segment_ticks();
            while self.places.get(1).is_some_and(|next| next.0 <= ticks) {
                self.places.pop_front();
            }
        }
        Ok(())
    }

    fn send_event(&mut self, event: &FlowEvent) -> Result<(), Refused> {
        let alone = self.loads.check_event(event);
        alone.map_err(|fault| self.refused_ahead(fault))?;
        while self.motion.event_room() == 0 {
            self.tick()?;
        }
        self.motion.push_event(event);
        Ok(())
    }

    /// One servo tick.
    fn tick(&mut self) -> Result<(), Refused> {
        let programmed = self.motion.tick(&mut self.bank);
        self.motion.look_ahead();
        let fault = match programmed {
            true => return Ok(()),
            false => self.motion.fault(),
        };
        Err(self.refused_here(fault.map_or(Refusal::NoEnd, Refusal::Fault)))
    }

    /// Runs what was sent to its end.
    fn end(&mut self) -> Result<(), Refused> {
        self.motion.finish();
        let most_ticks = self.motion.now_ticks() + self.sent_ticks + END_MAX_S * self.servo_hz;
        while self.motion.state() != DeviceState::Finished {
            if self.motion.now_ticks() > most_ticks {
                return Err(self.refused_here(Refusal::NoEnd));
            }
            if let Some(fault) = self.motion.fault() {
                return Err(self.refused_here(Refusal::Fault(fault)));
            }
            self.tick()?;
        }
        Ok(())
    }

    fn segment_ticks(&self) -> u64 {
        self.motion.segment_time_q16() >> 16
    }

    fn refused_at(&self, refusal: Refusal, ticks: u64, at_mm: [f64; 3]) -> Refused {
        Refused {
            refusal,
            time_s: ticks as f64 / self.servo_hz as f64,
            at_mm,
        }
    }

    /// In the servo tick that was run last.
    fn refused_here(&self, refusal: Refusal) -> Refused {
        let ticks = self.segment_ticks();
        let begun = self.places.partition_point(|(start, _)| *start <= ticks);
        let base = self.places.get(begun.saturating_sub(1));
        let at_mm = base.map_or([0.0; 3], |(_, base)| tip_mm(base, &self.units));
        self.refused_at(refusal, ticks, at_mm)
    }

    /// A fault in the last span sent, or in the events due with it.
    fn refused_ahead(&self, fault: SpanFault) -> Refused {
        let refusal = Refusal::Fault(fault_of(fault));
        self.refused_at(
            refusal,
            self.sent_ticks,
            tip_mm(self.window.base(), &self.units),
        )
    }
}

/// The tip of a point in these units, mm.
fn tip_mm(point: &[i64; CHANNELS], units: &Units) -> [f64; 3] {
    std::array::from_fn(|i| point[CHANNEL_X + i] as f64 / units.per_natural(CHANNEL_X + i))
}

/// The fault that a board makes of a span or an event that it refuses.
fn fault_of(fault: SpanFault) -> Fault {
    let (cause, index, value) = match fault {
        SpanFault::Kinematics(_) => (FaultCause::Kinematics, 0, 0),
        SpanFault::SoftLimit(joint, units) => (FaultCause::SoftLimit, joint, units),
        SpanFault::Limit(motor, permille) => (FaultCause::Limit, motor, permille),
    };
    Fault {
        cause,
        index,
        value,
    }
}
