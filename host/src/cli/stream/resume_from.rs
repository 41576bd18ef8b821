//! `headway stream --resume-from`: the rest of a job after a power failure, and the approach to it.
//!
//! In: the job, a log of its stream or a pass or layer given by hand. Out: the job from the start of a pass on,
//! the parts that it prints again and omits, and the moves above the print to its start. Not covered: the
//! stream itself.

use crate::cli::args::board::{Place, PortArgs, StreamArgs};
use crate::cli::board::operator::Operator;
use crate::cli::board::talk::Talk;
use crate::cli::error::CliError;
use crate::cli::reading::job::Job;
use crate::cli::stream::give;
use crate::cli::stream::heat::{StreamHeat, of_job};
use crate::cli::terminal::console::Console;
use crate::drive::log_place::{last_stream, rest_remark};
use crate::job::SegmentStream;
use crate::job::frames::WireFrames;
use crate::job::heat::{HEAT_TEXT, to_json};
use crate::job::resume::approach::Approach;
use crate::job::resume::rest::{Printed, Rest, pass_of_layer};
use crate::job::resume::{Parts, Reached, Resumption, resume};
use crate::settings::{Settings, joint_names, linear_joint_number};
use headway_firmware::configuration::MachineConfiguration;
use headway_firmware::configuration::homing::HomingConfiguration;
use headway_protocol::message::{Control, DeviceState, Status};
use serde_json::{Value, json};
use std::fs::File;
use std::io::BufReader;

/// The axis that lifts.
const Z: usize = 2;

/// A job from a pass on.
pub(crate) struct Resumed {
    /// Its stream.
    pub job: Job,
    /// For the log.
    pub remark: String,
    /// For the figures.
    pub figures: Value,
    /// For the terminal.
    pub told: Vec<String>,
    /// The flow override of the log.
    flow_percent: Option<u16>,
    way: Approach,
}

impl Resumed {
    /// Cuts a job by the options.
    pub(crate) fn of(place: &Place, args: &StreamArgs, job: &Job) -> Result<Resumed, CliError> {
        let stream = &job.stream;
        check_switches(job, args.part_clear)?;
        let (mut told, mut flow_percent) = (Vec::new(), None);
        let (pass, reached) = reached(place, job, &mut told, &mut flow_percent)?;
        let machine = &job.file.header.machine;
        let settings = job.settings.as_ref();
        let again = resume(stream, &of_job(job)?, pass, reached, settings, machine)
            .map_err(|error| of_part(job, &error))?;
        told.extend(told_of(&again, stream.layers()));
        Ok(Resumed {
            remark: rest_remark(job.file.frames.job(), pass),
            figures: figures(&again),
            told,
            flow_percent,
            way: again.way,
            job: cut(job, again.rest)?,
        })
    }

    /// Reports what is printed again, heats, and moves to the start.
    pub(crate) fn begin(
        &self,
        port: &PortArgs,
        heat: &StreamHeat,
        operator: &Operator<'_>,
    ) -> Result<(), CliError> {
        for line in &self.told {
            operator.console.say(&format!("resume: {line}"));
        }
        let machine = &self.job.file.header.machine;
        let mut talk = Talk::open_for(port, Some(operator))?;
        talk.check_machine(machine)?;
        check_ready(&talk.status()?, machine)?;
        drop(talk);
        give(port, &heat.before, operator)?;
        let mut talk = Talk::open_for(port, Some(operator))?;
        if let Some(percent) = self.flow_percent {
            talk.order(Control::FlowOverride(percent))?;
        }
        self.go(&mut talk, &heat.before, operator.console)
    }

    /// Heats, lifts, crosses above the print, goes down to where the stream begins.
    fn go(
        &self,
        talk: &mut Talk<'_>,
        before: &[Control],
        console: &Console,
    ) -> Result<(), CliError> {
        if before
            .iter()
            .any(|order| matches!(order, Control::Heat { .. }))
        {
            console.say("resume: heating before anything moves");
        }
        let (_, there) = talk.wait_for_heat(before)?;
        if !there {
            return Err(CliError::Job(
                "after an hour the heaters are not there".to_string(),
            ));
        }
        console.say(&format!(
            "resume: up, across, and down by {:.1} mm to the pass's start",
            self.way.above_mm
        ));
        for pose in [self.way.above, self.way.start] {
            talk.order(Control::GoTo(pose))?;
            talk.wait_for_rest()?;
        }
        Ok(())
    }
}

/// Z that is homed downwards may have hit the part.
fn check_switches(job: &Job, part_clear: bool) -> Result<(), CliError> {
    let machine = &job.file.header.machine;
    let usual = || HomingConfiguration::standard(machine);
    let homing = job.settings.as_ref().map_or_else(usual, Settings::homing);
    let z = linear_joint_number(&machine.kinematics, Z);
    let switch = z.and_then(|z| homing.of(z as u8));
    let downwards = switch.is_some_and(|switch| !switch.towards_max);
    if !downwards || part_clear {
        return Ok(());
    }
    Err(CliError::Job(
        "this machine homes Z downwards, onto what lies below the head: a part that is there would be hit. Home X \
         and Y, bring the head beside the part by `headway board jog`, home Z there (or measure it: `headway board \
         set-joint z`), and say --part-clear"
            .to_string(),
    ))
}

fn of_part(job: &Job, error: &impl std::fmt::Display) -> CliError {
    CliError::Job(format!("{}: {error}", job.name))
}

/// The pass to begin with, and the progress of the print if there is a log.
fn reached(
    place: &Place,
    job: &Job,
    told: &mut Vec<String>,
    flow_percent: &mut Option<u16>,
) -> Result<(u32, Option<Reached>), CliError> {
    let stream = &job.stream;
    let path = match place {
        Place::Pass(pass) => return Ok((*pass, None)),
        Place::Layer(layer) => {
            let pass = pass_of_layer(stream, *layer).map_err(|error| of_part(job, &error))?;
            return Ok((pass, None));
        }
        Place::Log(path) => path,
    };
    let file = File::open(path).map_err(|problem| CliError::File {
        path: path.display().to_string(),
        problem,
    })?;
    let of_log = |problem: String| CliError::Job(format!("{}: {problem}", path.display()));
    let logged = last_stream(&mut BufReader::new(file)).map_err(|error| {
        of_log(format!(
            "{error}; if you know where it was, say that instead: --resume-from pass:N or layer:N"
        ))
    })?;
    let reached = Reached::of(&logged, stream, &job.file.frames);
    let reached = reached.map_err(|error| of_log(error.to_string()))?;
    let pass = reached.pass(stream).map_err(|error| of_part(job, &error))?;
    let place = place_text(pass, stream);
    if logged.went_on {
        return Err(of_log(format!(
            "it could not be written to the end (a full disk?), and the print went on: the last place it knows is \
             {place}. Look how far the part has come, and say it: --resume-from pass:N, from {pass} on, or layer:N"
        )));
    }
    if logged.is_torn {
        told.push(format!(
            "the log ends within a line, as a power cut leaves it, in {place}; if the print has come further (a \
             disk that was taken away?), say where instead: --resume-from pass:N or layer:N"
        ));
    }
    *flow_percent = logged.flow_percent.filter(|percent| *percent != 100);
    told.extend(flow_percent.map(|percent| {
        format!("the flow is {percent} % of the plan's, as the log has it; `flow PCT` changes it")
    }));
    Ok((pass, Some(reached)))
}

/// A pass and its layer, as the progress names them.
fn place_text(pass: u32, stream: &SegmentStream) -> String {
    let mark = stream.marks.iter().find(|mark| mark.pass == Some(pass));
    match mark {
        Some(mark) => format!(
            "pass {pass}, layer {} of {}",
            mark.layer + 1,
            stream.layers()
        ),
        None => format!("pass {pass}"),
    }
}

/// The job with this stream in place of its own.
fn cut(job: &Job, rest: Rest) -> Result<Job, CliError> {
    let mut job = job.clone();
    let frames =
        WireFrames::encode(&rest.stream).map_err(|error| CliError::Job(error.to_string()))?;
    let header = &mut job.file.header;
    header.start = rest.stream.start;
    header.job = frames.job();
    header.frames = frames.len() as u32;
    header.knots = rest.stream.knots.len() as u32;
    header.events = rest.stream.events.len() as u32;
    header.marks.clone_from(&rest.stream.marks);
    let heat = to_json(&rest.heat);
    header.texts.insert(HEAT_TEXT.to_string(), heat);
    job.file.frames = frames;
    job.stream = rest.stream;
    Ok(job)
}

/// Nothing moves before the board is there and knows its joints.
fn check_ready(status: &Status, machine: &MachineConfiguration) -> Result<(), CliError> {
    if !matches!(status.state, DeviceState::Idle | DeviceState::Finished) {
        return Err(CliError::Job(format!(
            "the board is {}: where it still has its stream, go on with --resume; else `headway board abort`, `headway \
             board reset`, and home it",
            format!("{:?}", status.state).to_lowercase()
        )));
    }
    let names = joint_names(&machine.kinematics);
    let unknown: Vec<&str> = (0..machine.joints.len())
        .filter(|joint| status.referenced >> joint & 1 == 0)
        .map(|joint| names.get(joint).copied().unwrap_or("?"))
        .collect();
    if unknown.is_empty() {
        return Ok(());
    }
    Err(CliError::Job(format!(
        "the board does not know where {} is: home it (`headway board home`); a joint without a switch is brought to \
         a mark by hand and declared (`headway board set-joint c 0`)",
        unknown.join(", ")
    )))
}

fn figures(again: &Resumption) -> Value {
    let Parts {
        left_out,
        again: twice,
        perhaps_again,
        to_come,
    } = again.parts;
    json!({
        "pass": again.rest.pass,
        "layer": again.rest.layer,
        "left_out_mm": left_out.length_mm,
        "left_out_s": left_out.time_s,
        "again_mm": twice.length_mm,
        "again_s": twice.time_s,
        "perhaps_again_mm": perhaps_again.length_mm,
        "perhaps_again_s": perhaps_again.time_s,
        "to_come_mm": to_come.length_mm,
        "to_come_s": to_come.time_s,
        "crossing_mm": again.way.above_mm,
        "primed": again.rest.primed,
    })
}

fn told_of(again: &Resumption, layers: u32) -> Vec<String> {
    let text = |part: &Printed| format!("{:.1} mm ({:.1} s)", part.length_mm, part.time_s);
    let (rest, parts) = (&again.rest, &again.parts);
    let mut told = vec![
        format!(
            "begins again with the whole of pass {}, layer {} of {layers}: what of it was printed is printed again, so \
             that nothing is missing",
            rest.pass,
            rest.layer + 1
        ),
        format!(
            "left out as printed: {}; printed again for certain: {}; to come in all: {}",
            text(&parts.left_out),
            text(&parts.again),
            text(&parts.to_come)
        ),
    ];
    if parts.perhaps_again.time_s > 0.0 {
        told.push(format!(
            "sent beyond what the board has said to be done: {}, printed again as far as it was printed",
            text(&parts.perhaps_again)
        ));
    }
    if rest.primed {
        told.push("this pass has no prime of its own: it gets one".to_string());
    }
    told.push(
        "a part that has gone cold may be loose, and what is laid on it sticks less: do not go on if it has moved"
            .to_string(),
    );
    told
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::args::board::parse_place;
    use std::path::PathBuf;

    #[test]
    fn a_place_is_a_log_a_pass_or_a_layer() {
        assert_eq!(parse_place("pass:17"), Ok(Place::Pass(17)));
        assert_eq!(parse_place("layer:3"), Ok(Place::Layer(3)));
        assert_eq!(
            parse_place("print.log"),
            Ok(Place::Log(PathBuf::from("print.log")))
        );
        let windows = parse_place(r"C:\print.log");
        assert_eq!(windows, Ok(Place::Log(PathBuf::from(r"C:\print.log"))));
        assert!(parse_place("pass:-1").is_err());
        assert!(parse_place("layer:two").is_err());
    }
}
