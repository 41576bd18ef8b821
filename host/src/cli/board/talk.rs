//! A conversation with a board without a stream: sends commands, which are accepted or refused, and waits
//! for their effect.
//!
//! In: commands, an operator's requests. Out: the board's answers, statuses, or the reason why there are none. A
//! stop takes effect in each wait. Not covered: the stream (`stream.rs`).

use crate::cli::args::board::PortArgs;
use crate::cli::board::heat::is_there;
use crate::cli::board::operator::{Operator, Wish};
use crate::cli::board::port::{no_answer, open};
use crate::cli::board::status_text;
use crate::cli::error::CliError;
use crate::drive::patience::ANSWER_US;
use crate::drive::pump::{Pump, host_session};
use crate::drive::sender::Sender;
use crate::drive::sender_state::{SenderEvent, SenderState};
use headway_firmware::configuration::MachineConfiguration;
use headway_protocol::message::{
    BoardFigures, Control, Crash, DeviceState, Fault, Status, Welcome,
};
use std::time::{Duration, Instant};

/// A conversation without a stream.
pub(crate) struct Talk<'o> {
    port: String,
    pump: Pump,
    sender: Sender,
    /// Who the board is.
    pub welcome: Option<Welcome>,
    /// The fault that it reported with its `Welcome`.
    pub fault: Option<Fault>,
    /// How its run before this one ended, if in a crash.
    pub crash: Option<Crash>,
    /// The operator, who may end it and owns the heaters that it switches on.
    operator: Option<&'o Operator<'o>>,
    /// Something moves by its command.
    moves: bool,
}

impl<'o> Talk<'o> {
    /// Connects and greets; nothing but the board's answers ends it.
    pub(crate) fn open(port: &PortArgs) -> Result<Talk<'o>, CliError> {
        Talk::open_for(port, None)
    }

    /// The same for an operator, whose requests are followed while it waits.
    pub(crate) fn open_for(
        port: &PortArgs,
        operator: Option<&'o Operator<'o>>,
    ) -> Result<Talk<'o>, CliError> {
        if let Some(operator) = operator {
            operator.begin();
        }
        let mut talk = Talk {
            port: port.port.clone(),
            pump: open(port, None)?,
            sender: Sender::talking(host_session()),
            welcome: None,
            fault: None,
            crash: None,
            operator,
            moves: false,
        };
        talk.until(|_, event| matches!(event, SenderEvent::Connected(_)).then_some(()))?;
        Ok(talk)
    }

    /// Continues until `wanted` returns a value.
    fn until<T>(
        &mut self,
        mut wanted: impl FnMut(&mut Sender, &SenderEvent) -> Option<T>,
    ) -> Result<T, CliError> {
        // One answer is waited for: other reports of the board do not extend that.
        let begun_us = self.pump.now_us();
        loop {
            self.follow_operator()?;
            self.pump.turn(&mut self.sender);
            while let Some(event) = self.sender.poll_event() {
                if let SenderEvent::Connected(welcome) = &event {
                    self.welcome = Some(*welcome);
                }
                if let SenderEvent::Fault(fault) = &event {
                    self.fault = Some(*fault);
                }
                if let SenderEvent::Crash(crash) = &event {
                    self.crash = Some(*crash);
                }
                if let Some(found) = wanted(&mut self.sender, &event) {
                    return Ok(found);
                }
            }
            if let SenderState::Failed(error) = self.sender.state() {
                return Err(CliError::Job(error.to_string()));
            }
            if self.pump.now_us() - begun_us > ANSWER_US {
                return Err(no_answer(&self.port, &self.sender.said_last()));
            }
        }
    }

    /// Ends the conversation if the operator requests that: a present motion comes to rest before.
    fn follow_operator(&mut self) -> Result<(), CliError> {
        while let Some(wish) = self.operator.and_then(|operator| operator.next(true)) {
            let (control, words) = match wish {
                Wish::Stop => (Some(Control::EmergencyStop), STOPPED),
                Wish::Interrupt(_) | Wish::End | Wish::Control(Control::Abort) => {
                    (self.moves.then_some(Control::Abort), ENDED)
                }
                Wish::Control(_) | Wish::Unknown => {
                    if let Some(operator) = self.operator {
                        operator.console.say(NOTHING_PRINTS);
                    }
                    continue;
                }
            };
            // This one is not ended by an operator.
            self.operator = None;
            if let Some(control) = control {
                self.order(control)?;
            }
            return Err(CliError::Job(words.to_string()));
        }
        Ok(())
    }

    /// Joint names and units are the machine's: it must be the board's.
    pub(crate) fn check_machine(&self, machine: &MachineConfiguration) -> Result<(), CliError> {
        let ours = machine.hash();
        match &self.welcome {
            Some(welcome) if welcome.machine_hash != ours => Err(CliError::Job(format!(
                "the board is configured for machine {:08x}, the machine file says {ours:08x}; give \
                 the board's own (--machine), or switch it off and on if it was configured with this one since its start",
                welcome.machine_hash
            ))),
            _ => Ok(()),
        }
    }

    /// The board's last report, as text.
    pub(crate) fn said_last(&self) -> String {
        self.sender.said_last()
    }

    /// Sends a command and waits until it is accepted or refused.
    pub(crate) fn order(&mut self, control: Control) -> Result<(), CliError> {
        let before = self.operator.map(|operator| operator.note(&control));
        self.moves |= control.is_at_rest_only();
        self.sender.command(control);
        let done = self.until(|_, event| match event {
            SenderEvent::Taken(taken) if *taken == control => Some(Ok(())),
            SenderEvent::Refused(refusal) => Some(Err(CliError::Job(format!(
                "the board refuses: {}",
                refusal.reason
            )))),
            _ => None,
        })?;
        if let (Some(operator), Some(before)) = (self.operator, before) {
            match done {
                Ok(()) => operator.taken(&control),
                Err(_) => operator.refused(before),
            }
        }
        done
    }

    pub(crate) fn status(&mut self) -> Result<Status, CliError> {
        self.sender.command(Control::StatusRequest);
        let status = self.until(|_, event| match event {
            SenderEvent::Status(status) => Some(status.clone()),
            _ => None,
        })?;
        if let Some(operator) = self.operator {
            operator.publish_beginning(&status);
        }
        Ok(status)
    }

    /// Lets the board measure itself for so long.
    pub(crate) fn measure(&mut self, lasts: Duration) -> Result<BoardFigures, CliError> {
        self.order(Control::Measure(true))?;
        let begun = Instant::now();
        while begun.elapsed() < lasts {
            self.status()?;
            std::thread::sleep(MEASURE_LOOK.min(lasts));
        }
        self.sender.command(Control::Measure(false));
        self.until(|_, event| match event {
            SenderEvent::Measured(figures) => Some(*figures),
            _ => None,
        })
    }

    /// Waits until a move by hand has ended.
    pub(crate) fn wait_for_rest(&mut self) -> Result<Status, CliError> {
        let begun_us = self.pump.now_us();
        let mut moved = (Vec::new(), begun_us);
        loop {
            let status = self.status()?;
            let now_us = self.pump.now_us();
            let waited = |since_us| Duration::from_micros(now_us - since_us);
            if moved.0 != status.counts_steps.as_slice() {
                moved = (status.counts_steps.to_vec(), now_us);
            } else if waited(moved.1) > STANDSTILL_PATIENCE {
                return Err(never_ends(&status, STANDSTILL_PATIENCE));
            }
            if waited(begun_us) > MOVE_PATIENCE {
                return Err(never_ends(&status, MOVE_PATIENCE));
            }
            if let Some(fault) = status.fault {
                return Err(CliError::Job(format!("the board latched a fault: {fault}")));
            }
            if !matches!(
                status.state,
                DeviceState::Jogging | DeviceState::Homing | DeviceState::Probing
            ) {
                return Ok(status);
            }
        }
    }

    /// Waits until every heater that these orders wait for is there, for as long as [`HEAT_PATIENCE`]; with
    /// the last status, and whether they are.
    pub(crate) fn wait_for_heat(&mut self, orders: &[Control]) -> Result<(Status, bool), CliError> {
        let begun = Instant::now();
        loop {
            let status = self.status()?;
            if let Some(fault) = status.fault {
                return Err(CliError::Job(format!("the board latched a fault: {fault}")));
            }
            let there = orders.iter().all(|order| match *order {
                Control::Heat {
                    heater,
                    decidegrees,
                    wait: true,
                } => is_there(&status, heater, decidegrees),
                _ => true,
            });
            if there || begun.elapsed() > HEAT_PATIENCE {
                return Ok((status, there));
            }
            std::thread::sleep(HEAT_LOOK);
        }
    }
}

/// Why a conversation ends that an operator ended.
const STOPPED: &str = "stopped: motors and heaters are off, the position is lost; `headway board reset` clears the \
                       fault, then home it";
pub(crate) const ENDED: &str =
    "ended before it was done: nothing moves, and what was switched on goes off";
const NOTHING_PRINTS: &str =
    "nothing prints yet: `abort`, `stop` and Ctrl-C are heard now, the others once it does";
/// Period of checks of a heater, and longest heating.
const HEAT_LOOK: Duration = Duration::from_millis(200);
/// Period of questions while a board measures.
const MEASURE_LOOK: Duration = Duration::from_millis(100);
pub(crate) const HEAT_PATIENCE: Duration = Duration::from_secs(3600);
/// A move by hand that makes no step: the longest prime takes a minute and may be of one step.
const STANDSTILL_PATIENCE: Duration = Duration::from_secs(90);
/// Longest move by hand: the slowest jog over the longest axis.
const MOVE_PATIENCE: Duration = Duration::from_secs(3600);

/// A wait that was too long, and the board's last report.
pub(crate) fn never_ends(status: &Status, waited: Duration) -> CliError {
    CliError::Job(format!(
        "the move does not end ({} s); the board said last: {}",
        waited.as_secs(),
        status_text(status, false).trim()
    ))
}
