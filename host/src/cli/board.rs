//! `headway board`: questions and commands to a board, a board without hardware, replay of logs.

use super::args_board::{BoardArgs, BoardCommand, BoardMachineArgs, PinName, PortArgs};
use super::configure::configure;
use super::console::Console;
use super::drivers::{drivers_json, drivers_text};
use super::heat::{heat, heaters_json, heaters_text, is_there};
use super::jog::{extrude, jog, joint_number, set_joint};
use super::probe::{mesh, over_bed, probe};
use super::simulated_board::simulate;
use super::stream::{ANSWER_PATIENCE, no_answer, open};
use super::tune::tune;
use super::{CliError, load};
use crate::drive::link_log::{read_log, replay};
use crate::drive::pump::Pump;
use crate::drive::pump::host_session;
use crate::drive::sender::Sender;
use crate::drive::sender_state::{SenderEvent, SenderState};
use crate::settings::Settings;
use headway_firmware::configuration::MachineConfiguration;
use headway_protocol::message::{
    Control, DeviceState, Fault, JointOrder, NO_JOB, PROBE_BIT, PinPosition, Status, Welcome,
};
use serde_json::json;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use std::time::{Duration, Instant};

pub(super) fn run(args: &BoardArgs, console: &Console) -> Result<(), CliError> {
    match &args.command {
        BoardCommand::Info { port, json } => info(port, *json, console),
        BoardCommand::Status { port, json } => {
            let mut talk = Talk::open(port)?;
            let status = talk.status()?;
            console.result(&status_text(&status, *json))
        }
        BoardCommand::Home {
            joints,
            machine,
            port,
        } => home(joints, machine, port, console),
        BoardCommand::Jog {
            joint,
            distance,
            speed,
            machine,
            port,
        } => {
            let settings = settings(machine)?;
            let command = jog(&settings.machine, joint, *distance, *speed)?;
            move_joint(&[command], &settings.machine, port, console)
        }
        BoardCommand::SetJoint {
            joint,
            position,
            machine,
            port,
        } => {
            let settings = settings(machine)?;
            let command = set_joint(&settings.machine, joint, *position)?;
            move_joint(&[command], &settings.machine, port, console)
        }
        BoardCommand::Extrude {
            volume,
            speed,
            no_heat,
            machine,
            port,
        } => {
            let settings = settings(machine)?;
            let command = extrude(&settings.machine, *volume, *speed)?;
            let cold = no_heat.then_some(Control::ExtrudeCold(true));
            let commands: Vec<Control> = cold.into_iter().chain([command]).collect();
            move_joint(&commands, &settings.machine, port, console)
        }
        BoardCommand::Go { job, mesh, port } => go(job, mesh.as_deref(), port, console),
        BoardCommand::Probe(args) => probe(args, console),
        BoardCommand::Mesh(args) => mesh(args, console),
        BoardCommand::Heat {
            heater,
            celsius,
            no_wait,
            port,
        } => heat_up(heat(heater, *celsius, !no_wait)?, port, console),
        BoardCommand::Tune {
            heater,
            celsius,
            machine,
            port,
        } => tune(heater, *celsius, machine, port, console),
        BoardCommand::Simulate(asked) => simulate(asked, console),
        BoardCommand::Configure { machine, port } => configure(machine, port, console),
        BoardCommand::Replay { log, machine, json } => {
            run_replay(log, machine.as_deref(), *json, console)
        }
        simple => match order(simple) {
            Some((port, control)) => Talk::open(port)?.order(control),
            None => Ok(()),
        },
    }
}

/// To where a job begins.
fn go(job: &Path, mesh: Option<&Path>, port: &PortArgs, console: &Console) -> Result<(), CliError> {
    let job = over_bed(super::job::read(job)?, mesh)?;
    let mut talk = Talk::open(port)?;
    talk.check_machine(&job.file.header.machine)?;
    talk.order(Control::GoTo(*job.file.frames.start()))?;
    let status = talk.wait_for_rest()?;
    console.result(&status_text(&status, false))
}

/// Commands that are given and no more.
fn order(command: &BoardCommand) -> Option<(&PortArgs, Control)> {
    Some(match command {
        BoardCommand::Pause { port } => (port, Control::Pause),
        BoardCommand::Resume { port } => (port, Control::Resume),
        BoardCommand::Override { percent, port } => (port, Control::Override(*percent)),
        BoardCommand::Flow { percent, port } => (port, Control::FlowOverride(*percent)),
        BoardCommand::Fan { percent, port } => (port, Control::Fan(percent * 10)),
        BoardCommand::MotorsOff { port } => (port, Control::MotorsOff),
        BoardCommand::ProbePin { position, port } => (port, Control::ProbePin(pin(*position))),
        BoardCommand::Abort { port } => (port, Control::Abort),
        BoardCommand::Stop { port } => (port, Control::EmergencyStop),
        BoardCommand::Reset { port } => (port, Control::ClearFault),
        _ => return None,
    })
}

fn pin(name: PinName) -> PinPosition {
    match name {
        PinName::Stow => PinPosition::Stow,
        PinName::Deploy => PinPosition::Deploy,
        PinName::SelfTest => PinPosition::SelfTest,
        PinName::Reset => PinPosition::Reset,
    }
}

/// A conversation without a stream.
pub(super) struct Talk {
    port: String,
    pump: Pump,
    sender: Sender,
    welcome: Option<Welcome>,
    /// What the board has reported with its greeting.
    fault: Option<Fault>,
}

impl Talk {
    /// Connects and greets.
    pub(super) fn open(port: &PortArgs) -> Result<Talk, CliError> {
        let mut talk = Talk {
            port: port.port.clone(),
            pump: open(port, None)?,
            sender: Sender::talking(host_session()),
            welcome: None,
            fault: None,
        };
        talk.until(|_, event| matches!(event, SenderEvent::Connected(_)).then_some(()))?;
        Ok(talk)
    }

    /// Goes on until `wanted` finds what it waits for.
    fn until<T>(
        &mut self,
        mut wanted: impl FnMut(&mut Sender, &SenderEvent) -> Option<T>,
    ) -> Result<T, CliError> {
        // One answer is waited for: whatever else the board says takes no longer than that.
        let begun = Instant::now();
        loop {
            self.pump.turn(&mut self.sender);
            while let Some(event) = self.sender.poll_event() {
                if let SenderEvent::Connected(welcome) = &event {
                    self.welcome = Some(*welcome);
                }
                if let SenderEvent::Fault(fault) = &event {
                    self.fault = Some(*fault);
                }
                if let Some(found) = wanted(&mut self.sender, &event) {
                    return Ok(found);
                }
            }
            if let SenderState::Failed(error) = self.sender.state() {
                return Err(CliError::Job(error.to_string()));
            }
            if begun.elapsed() > ANSWER_PATIENCE {
                return Err(no_answer(&self.port, &self.sender.said_last()));
            }
        }
    }

    /// Joint names and units are the machine's: it must be the board's.
    pub(super) fn check_machine(&self, machine: &MachineConfiguration) -> Result<(), CliError> {
        let ours = machine.hash();
        match &self.welcome {
            Some(welcome) if welcome.machine_hash != ours => Err(CliError::Job(format!(
                "the board is configured for machine {:08x}, the machine file says {ours:08x}; give \
                 the board's own (--machine)",
                welcome.machine_hash
            ))),
            _ => Ok(()),
        }
    }

    /// Gives a command and waits until it is taken or refused.
    pub(super) fn order(&mut self, control: Control) -> Result<(), CliError> {
        self.sender.command(control);
        self.until(|_, event| match event {
            SenderEvent::Taken(taken) if *taken == control => Some(Ok(())),
            SenderEvent::Refused(refusal) => Some(Err(CliError::Job(format!(
                "the board refuses: {}",
                refusal.reason
            )))),
            _ => None,
        })?
    }

    pub(super) fn status(&mut self) -> Result<Status, CliError> {
        self.sender.command(Control::StatusRequest);
        self.until(|_, event| match event {
            SenderEvent::Status(status) => Some(status.clone()),
            _ => None,
        })
    }

    /// Waits until a move by hand has ended.
    pub(super) fn wait_for_rest(&mut self) -> Result<Status, CliError> {
        let begun = Instant::now();
        let mut moved = (Vec::new(), begun);
        loop {
            let status = self.status()?;
            if moved.0 != status.counts_steps.as_slice() {
                moved = (status.counts_steps.to_vec(), Instant::now());
            } else if moved.1.elapsed() > STANDSTILL_PATIENCE {
                return Err(never_ends(&status, STANDSTILL_PATIENCE));
            }
            if begun.elapsed() > MOVE_PATIENCE {
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
    pub(super) fn wait_for_heat(&mut self, orders: &[Control]) -> Result<(Status, bool), CliError> {
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

/// How often a heater is looked at, and longest heating.
const HEAT_LOOK: Duration = Duration::from_millis(200);
const HEAT_PATIENCE: Duration = Duration::from_secs(3600);
/// A move by hand that makes no step: the longest prime takes a minute and may be of one step.
const STANDSTILL_PATIENCE: Duration = Duration::from_secs(90);
/// Longest move by hand: the slowest jog over the longest axis.
const MOVE_PATIENCE: Duration = Duration::from_secs(3600);

fn never_ends(status: &Status, waited: Duration) -> CliError {
    CliError::Job(format!(
        "the move does not end ({} s); the board said last: {}",
        waited.as_secs(),
        status_text(status, false).trim()
    ))
}

fn info(port: &PortArgs, as_json: bool, console: &Console) -> Result<(), CliError> {
    let talk = Talk::open(port)?;
    let Some(welcome) = talk.welcome else {
        return Err(no_answer(&port.port, &talk.sender.said_last()));
    };
    let stream = welcome.stream.filter(|stream| stream.job != NO_JOB);
    let [major, minor, patch] = welcome.firmware_version;
    if as_json {
        let stream = stream.map(|stream| {
            json!({
                "job": format!("{:08x}", stream.job),
                "knots_taken": stream.knots_taken,
                "spans_done": stream.spans_done,
            })
        });
        let value = json!({
            "protocol_version": welcome.protocol_version,
            "schema": format!("{:08x}", welcome.schema_hash),
            "firmware_version": format!("{major}.{minor}.{patch}"),
            "machine_hash": format!("{:08x}", welcome.machine_hash),
            "queue_knots": welcome.queue_knots,
            "queue_events": welcome.queue_events,
            "servo_hz": welcome.servo_hz,
            "step_hz": welcome.step_hz,
            "session": format!("{:08x}", welcome.session),
            "stream": stream,
            "settings_hash": format!("{:08x}", welcome.settings_hash),
            "fault": talk.fault.map(|fault| fault.to_string()),
        });
        return console.result(&format!("{value:#}\n"));
    }
    let stream = stream.map_or("no stream".to_string(), |stream| {
        format!("job {:08x}, {} knots taken", stream.job, stream.knots_taken)
    });
    let settings = match welcome.settings_hash {
        0 => "settings built in".to_string(),
        hash => format!("settings {hash:08x}"),
    };
    let fault = talk
        .fault
        .map_or(String::new(), |fault| format!("stopped: {fault}\n"));
    console.result(&format!(
        "firmware {major}.{minor}.{patch}, protocol {}, schema {:08x}\nmachine {:08x}, {settings}, servo {} Hz, \
         steps {} Hz\nqueue of {} knots and {} flow events; {stream}\n{fault}",
        welcome.protocol_version,
        welcome.schema_hash,
        welcome.machine_hash,
        welcome.servo_hz,
        welcome.step_hz,
        welcome.queue_knots,
        welcome.queue_events,
    ))
}

fn status_text(status: &Status, as_json: bool) -> String {
    let fault = status.fault.map(|fault| fault.to_string());
    let state = format!("{:?}", status.state).to_lowercase();
    if as_json {
        let value = json!({
            "state": state,
            "rate": f64::from(status.sigma_permille) / 1000.0,
            "override_percent": status.override_percent,
            "flow_percent": status.flow_percent,
            "spans_done": status.spans_done,
            "queue_knots": status.queue_knots,
            "queue_events": status.queue_events,
            "referenced": bits(status.referenced),
            "switches": bits(switches_of(status)),
            "probe_pressed": is_probe_pressed(status),
            "counts": status.counts_steps.to_vec(),
            "heaters": heaters_json(status),
            "fan": f64::from(status.fan_permille) / 1000.0,
            "drivers": drivers_json(status),
            "fault": fault,
        });
        return format!("{value:#}\n");
    }
    let fault = fault.map_or(String::new(), |fault| format!("; fault: {fault}"));
    format!(
        "{state} at {:.0} % of the planned rate, {} knots queued{fault}\ncounts {:?}, known joints \
         {:?}, pressed switches {:?}{}\n{}{}",
        f64::from(status.sigma_permille) / 10.0,
        status.queue_knots,
        status.counts_steps.as_slice(),
        bits(status.referenced),
        bits(switches_of(status)),
        if is_probe_pressed(status) {
            ", and the probe"
        } else {
            ""
        },
        heaters_text(status),
        drivers_text(status),
    )
}

/// Without the probe.
fn switches_of(status: &Status) -> u8 {
    status.switches & !(1 << PROBE_BIT)
}

fn is_probe_pressed(status: &Status) -> bool {
    status.switches >> PROBE_BIT & 1 == 1
}

/// Joints of a mask.
fn bits(mask: u8) -> Vec<u8> {
    (0..8).filter(|bit| mask >> bit & 1 == 1).collect()
}

pub(super) fn settings(args: &BoardMachineArgs) -> Result<Settings, CliError> {
    args.machine
        .as_deref()
        .map_or_else(|| Ok(Settings::default()), load::machine)
}

fn home(
    joints: &[String],
    machine: &BoardMachineArgs,
    port: &PortArgs,
    console: &Console,
) -> Result<(), CliError> {
    let settings = settings(machine)?;
    let numbers: Vec<u8> = joints
        .iter()
        .map(|joint| joint_number(&settings.machine, joint))
        .collect::<Result<_, _>>()?;
    let order = JointOrder::of(&numbers)
        .ok_or_else(|| CliError::Usage("a joint is homed once: name it once".to_string()))?;
    let mut talk = Talk::open(port)?;
    if !joints.is_empty() {
        talk.check_machine(&settings.machine)?;
    }
    talk.order(Control::Home(order))?;
    let status = talk.wait_for_rest()?;
    console.result(&status_text(&status, false))
}

/// Heats, and waits until it is there where that was asked: a board that hears nobody switches off.
fn heat_up(command: Control, port: &PortArgs, console: &Console) -> Result<(), CliError> {
    let mut talk = Talk::open(port)?;
    talk.order(command)?;
    let (status, there) = talk.wait_for_heat(&[command])?;
    if !there {
        return Err(never_ends(&status, HEAT_PATIENCE));
    }
    console.result(&status_text(&status, false))
}

/// Gives a command that names a motor, and waits for its end.
fn move_joint(
    commands: &[Control],
    machine: &MachineConfiguration,
    port: &PortArgs,
    console: &Console,
) -> Result<(), CliError> {
    let mut talk = Talk::open(port)?;
    talk.check_machine(machine)?;
    for command in commands {
        talk.order(*command)?;
    }
    let status = talk.wait_for_rest()?;
    console.result(&status_text(&status, false))
}

fn run_replay(
    path: &Path,
    machine: Option<&Path>,
    as_json: bool,
    console: &Console,
) -> Result<(), CliError> {
    let place = |problem: String| CliError::Job(format!("{}: {problem}", path.display()));
    let file = File::open(path).map_err(|problem| CliError::File {
        path: path.display().to_string(),
        problem,
    })?;
    let log = read_log(&mut BufReader::new(file)).map_err(|error| place(error.to_string()))?;
    let given = machine
        .map(load::machine)
        .transpose()?
        .map(|settings| settings.machine);
    let Some(machine) = given.or_else(|| log.machine.clone()) else {
        return Err(place(
            crate::drive::link_log::LogError::NoMachine.to_string(),
        ));
    };
    let replay = replay(&log, &machine).map_err(|error| place(error.to_string()))?;
    let fault = replay.fault.map(|fault| fault.to_string());
    if as_json {
        let value = json!({
            "messages": replay.messages,
            "damaged_frames": replay.damaged,
            "steps": replay.steps,
            "step_digest": replay.step_digest,
            "final_counts": replay.counts,
            "state": format!("{:?}", replay.state).to_lowercase(),
            "fault": fault,
            "time_s": replay.time_s,
        });
        return console.result(&format!("{value:#}\n"));
    }
    console.result(&format!(
        "{} messages ({} damaged) in {:.3} s: {} steps, digest {}, counts {:?}, {}{}\n",
        replay.messages,
        replay.damaged,
        replay.time_s,
        replay.steps,
        replay.step_digest,
        replay.counts,
        format!("{:?}", replay.state).to_lowercase(),
        fault.map_or(String::new(), |fault| format!("; fault: {fault}")),
    ))
}
