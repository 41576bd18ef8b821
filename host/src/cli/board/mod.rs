//! `headway board`: queries and commands to a board, a board without hardware, replay of logs.

pub(crate) mod configure;
pub(crate) mod drivers;
pub(crate) mod heat;
pub(crate) mod jog;
pub(crate) mod measure;
pub(crate) mod operator;
pub(crate) mod port;
pub(crate) mod probe;
pub(crate) mod simulated_board;
pub(crate) mod talk;
pub(crate) mod tune;

use crate::cli::args::board::{BoardArgs, BoardCommand, BoardMachineArgs, PinName, PortArgs};
use crate::cli::board::configure::configure;
use crate::cli::board::drivers::{drivers_json, drivers_text};
use crate::cli::board::heat::{heat, heaters_json, heaters_text};
use crate::cli::board::jog::{extrude, jog, joint_number, set_joint};
use crate::cli::board::measure::measure;
use crate::cli::board::operator::Operator;
use crate::cli::board::port::no_answer;
use crate::cli::board::probe::{mesh, over_bed, probe};
use crate::cli::board::simulated_board::simulate;
use crate::cli::board::talk::{HEAT_PATIENCE, Talk, never_ends};
use crate::cli::board::tune::tune;
use crate::cli::error::CliError;
use crate::cli::reading::load;
use crate::cli::terminal::console::Console;
use crate::drive::link_log::{read_log, replay};
use crate::settings::Settings;
use headway_firmware::configuration::MachineConfiguration;
use headway_protocol::message::{Control, JointOrder, NO_JOB, PROBE_BIT, PinPosition, Status};
use serde_json::json;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

pub(crate) fn run(args: &BoardArgs, console: &Console) -> Result<(), CliError> {
    match &args.command {
        BoardCommand::Info { port, json } => info(port, *json, console),
        BoardCommand::Status { port, json } => {
            let mut talk = Talk::open(port)?;
            let status = talk.status()?;
            console.result(&status_text(&status, *json))
        }
        BoardCommand::Measure(args) => measure(args, console),
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
            in_place,
            machine,
            port,
        } => tune(heater, *celsius, *in_place, machine, port, console),
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
    let job = over_bed(crate::cli::reading::job::read(job)?, mesh)?;
    let mut talk = Talk::open(port)?;
    talk.check_machine(&job.file.header.machine)?;
    let frames = &job.file.frames;
    talk.order(Control::GoTo(frames.units().to_base(frames.start())))?;
    let status = talk.wait_for_rest()?;
    console.result(&status_text(&status, false))
}

/// Commands that are sent without further steps.
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

fn info(port: &PortArgs, as_json: bool, console: &Console) -> Result<(), CliError> {
    let talk = Talk::open(port)?;
    let Some(welcome) = talk.welcome else {
        return Err(no_answer(&port.port, &talk.said_last()));
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
            "crash": talk.crash.map(|crash| crash.to_string()),
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
    let crash = talk.crash.map_or(String::new(), |crash| {
        format!("the run before crashed: {crash}\n")
    });
    console.result(&format!(
        "firmware {major}.{minor}.{patch}, protocol {}, schema {:08x}\nmachine {:08x}, {settings}, servo {} Hz, \
         steps {} Hz\nqueue of {} knots and {} flow events; {stream}\n{fault}{crash}",
        welcome.protocol_version,
        welcome.schema_hash,
        welcome.machine_hash,
        welcome.servo_hz,
        welcome.step_hz,
        welcome.queue_knots,
        welcome.queue_events,
    ))
}

/// A status as a user reads it.
pub(crate) fn status_text(status: &Status, as_json: bool) -> String {
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

pub(crate) fn settings(args: &BoardMachineArgs) -> Result<Settings, CliError> {
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

/// Heats, and waits until the target is reached if requested. If that fails the heater is switched off
/// again; if it succeeds, the next command has to arrive within the board's 30 s.
fn heat_up(command: Control, port: &PortArgs, console: &Console) -> Result<(), CliError> {
    let operator = Operator::new(port, console);
    let mut talk = Talk::open_for(port, Some(&operator))?;
    talk.order(command)?;
    let (status, there) = talk.wait_for_heat(&[command])?;
    if !there {
        return Err(never_ends(&status, HEAT_PATIENCE));
    }
    operator.hand_over();
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
