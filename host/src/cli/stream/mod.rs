//! `headway stream`: a job to a board, with progress, pause and abort on the path, and a log.

pub(crate) mod heat;
mod leave;
pub(crate) mod problems;
pub(crate) mod resume_from;
mod sensor;

use crate::cli::args::board::{PortArgs, StreamArgs};
use crate::cli::board::heat::{heaters_json, heaters_text, hot_text};
use crate::cli::board::operator::{Operator, Wish};
use crate::cli::board::port::{no_answer, open};
use crate::cli::board::probe::over_bed;
use crate::cli::board::talk::Talk;
use crate::cli::error::CliError;
use crate::cli::live::{Snapshot, live_page};
use crate::cli::reading::job;
use crate::cli::reading::job::Job;
use crate::cli::stream::heat::{StreamHeat, pause_heat_max_min};
use crate::cli::stream::leave::leave;
use crate::cli::stream::problems::{Problems, log_file};
use crate::cli::stream::resume_from::Resumed;
use crate::cli::stream::sensor::Sensor;
use crate::cli::terminal::console::Console;
use crate::cli::terminal::output_file::OutputFile;
use crate::cli::terminal::result_kind::LOG;
use crate::drive::patience::{Patience, Wait};
use crate::drive::pause_heat::{PauseHeat, PauseNews};
use crate::drive::pump::{LineEvent, Pump, host_session};
use crate::drive::sender::Sender;
use crate::drive::sender_state::{SenderError, SenderEvent, SenderSetup, SenderState};
use crate::drive::stream_progress::{Progress, Timeline};
use headway_protocol::message::{Control, DeviceState, RefusalReason, Status};
use indicatif::ProgressBar;
use serde_json::{Value, json};
use std::time::Instant;

/// How often the board tells where it is if heaters or fans change on the path, ms: 3 mm at 60 mm/s.
const HEAT_STATUS_MS: u16 = 50;
/// Steps of the progress bar.
const BAR_STEPS: f64 = 1000.0;

pub(crate) fn run(args: &StreamArgs, console: &Console) -> Result<(), CliError> {
    let log = args.log.as_ref().map(|path| path.file(LOG, console));
    let log = log.transpose()?;
    let whole = over_bed(job::read(&args.job)?, args.mesh.as_deref())?;
    let resumed = args.resume_from.as_ref();
    let resumed = resumed
        .map(|place| Resumed::of(place, args, &whole))
        .transpose()?;
    let job = resumed.as_ref().map_or(&whole, |rest| &rest.job);
    let heat = StreamHeat::of(args, job)?;
    let live = args
        .view
        .then(|| live_page::open(job.clone(), args.view_port, args.no_open, console))
        .transpose()?;
    let operator = Operator::of_stream(&args.port, console, live);
    let printed = print(args, job, heat, resumed.as_ref(), log.as_ref(), &operator);
    let is_done = printed.as_ref().is_ok_and(|printed| printed.result.is_ok());
    if is_done && args.end_heat.leave_hot {
        operator.hand_over_heaters();
    }
    // The line may be lost: then the board switches off by itself.
    let off = operator.switch_off();
    let Printed {
        result,
        snapshot,
        figures,
    } = printed.unwrap_or_else(Printed::not_begun);
    if let (Err(_), Err(error)) = (&result, &off) {
        console.say(&format!("heaters could not be switched off: {error}"));
    }
    operator.tell_the_end(&result, snapshot);
    if let (true, Some(figures)) = (args.json, figures) {
        console.result(&format!("{figures:#}\n"))?;
    } else if result.is_ok() {
        console.say(&format!("{}: done", job.name));
    }
    result.and(off)
}

/// How a print went.
struct Printed {
    result: Result<(), CliError>,
    /// What a page shows last.
    snapshot: Snapshot,
    /// `None` if it never streamed.
    figures: Option<Value>,
}

impl Printed {
    fn not_begun(error: CliError) -> Printed {
        Printed {
            result: Err(error),
            snapshot: Snapshot::default(),
            figures: None,
        }
    }
}

/// Heats, goes to where the job begins if that is to be found, and streams.
fn print(
    args: &StreamArgs,
    job: &Job,
    heat: StreamHeat,
    resumed: Option<&Resumed>,
    log: Option<&OutputFile>,
    operator: &Operator<'_>,
) -> Result<Printed, CliError> {
    let header = &job.file.header;
    let sensor = args.sensor.as_ref();
    let sensor = sensor.map(|line| Sensor::start(line, job)).transpose()?;
    match resumed {
        Some(rest) => rest.begin(&args.port, &heat, operator)?,
        None => give(&args.port, &heat.before, operator)?,
    }
    let setup = SenderSetup::of_job(header, host_session(), args.resume);
    let frames = job.file.frames.clone();
    operator.begin();
    let log = log_file(log, &header.machine, resumed)?;
    let mut run = Run {
        timeline: Timeline::new(&job.stream, f64::from(header.machine.servo_hz)),
        operator,
        bar: operator.console.stream(BAR_STEPS as u64),
        port: args.port.port.clone(),
        sender: match args.resume {
            true => Sender::resuming(frames, setup),
            false => Sender::new(frames, setup),
        },
        pump: open(&args.port, log)?,
        status: None,
        connected: false,
        has_part: false,
        patience: Patience::new(&job.stream, header.machine.servo_hz),
        status_period_ms: args.status_period_ms,
        begun: Instant::now(),
        said: String::new(),
        pause_heat: PauseHeat::new(pause_heat_max_min(args, job)),
        problems: Problems::default(),
        heat,
        sensor,
    };
    let result = run.until_end();
    if result.is_ok() && !args.no_heat {
        run.own_heaters();
    }
    run.bar.finish_and_clear();
    let mut figures = run.figures(&result);
    if let Some(rest) = resumed {
        figures["resumed"] = rest.figures.clone();
    }
    let snapshot = run.snapshot();
    let logged = run.pump.finish();
    logged.map_err(|error| CliError::Job(format!("the log could not be written: {error}")))?;
    if let Some(sensor) = run.sensor.take() {
        sensor.end(result.as_ref().err(), &args.port, operator);
    }
    Ok(Printed {
        result,
        snapshot,
        figures: Some(figures),
    })
}

/// Sends commands in a separate conversation; without commands it opens none.
pub(crate) fn give(
    port: &PortArgs,
    commands: &[Control],
    operator: &Operator<'_>,
) -> Result<(), CliError> {
    if commands.is_empty() {
        return Ok(());
    }
    let mut talk = Talk::open_for(port, Some(operator))?;
    for command in commands {
        talk.order(*command).map_err(|error| {
            CliError::Job(format!(
                "{error} (has the board this heater, and may it be that hot? --no-heat leaves it alone)"
            ))
        })?;
    }
    Ok(())
}

struct Run<'a> {
    timeline: Timeline,
    operator: &'a Operator<'a>,
    bar: ProgressBar,
    port: String,
    sender: Sender,
    pump: Pump,
    status: Option<Status>,
    connected: bool,
    /// The board has part of this job already.
    has_part: bool,
    patience: Patience,
    status_period_ms: Option<u16>,
    begun: Instant,
    /// The board's last message for the page.
    said: String,
    problems: Problems,
    /// Heaters and fans on the path, and in a pause.
    heat: StreamHeat,
    pause_heat: PauseHeat,
    /// What corrects the flow.
    sensor: Option<Sensor>,
}

impl Run<'_> {
    fn snapshot(&self) -> Snapshot {
        let mut snapshot = Snapshot {
            line_open: self.pump.is_open(),
            layers: self.timeline.layers(),
            said: self.said.clone(),
            log_problem: self.problems.log.clone(),
            ..Snapshot::default()
        };
        if let Some(status) = &self.status {
            let at = self.timeline.at(status);
            snapshot.state = format!("{:?}", status.state).to_lowercase();
            snapshot.done = at.done;
            snapshot.left_s = at.left_s;
            snapshot.layer = at.layer;
            snapshot.pass = at.pass;
            snapshot.tip_mm_s = at.tip_mm_s;
            snapshot.override_percent = status.override_percent;
            snapshot.at_mm = at.at_mm;
            snapshot.flow_percent = status.flow_percent;
            if let Some(correction) = self.correction() {
                snapshot.flow_percent = correction.operator_percent;
                snapshot.flow_correction = Some(correction.figures.correction);
            }
            snapshot.heaters = heaters_json(status);
            snapshot.fan_percent = f64::from(status.fan_permille) / 10.0;
            snapshot.queue_knots = status.queue_knots;
        }
        snapshot
    }

    fn publish(&self) {
        let snapshot = self.snapshot();
        self.operator.publish(&snapshot);
        if let Some(sensor) = &self.sensor {
            sensor.say(&json!(snapshot));
        }
    }

    fn say(&self, line: &str) {
        self.bar.suspend(|| self.operator.console.say(line));
    }

    /// To the terminal and to the page.
    fn tell(&mut self, what: String) {
        self.say(&what);
        self.said = what;
    }

    fn report_problems(&mut self) {
        for problem in self.problems.look(self.operator.page(), &self.pump) {
            self.tell(problem);
            self.publish();
        }
    }

    fn until_end(&mut self) -> Result<(), CliError> {
        loop {
            if let Some(event) = self.pump.turn(&mut self.sender) {
                match event {
                    LineEvent::Lost(error) => self.say(&format!(
                        "{}: the line is lost ({error}); the board comes to rest on the path. \
                         Waiting for it to come back",
                        self.port
                    )),
                    LineEvent::Opened => self.say(&format!("{}: the line is back", self.port)),
                }
                self.publish();
            }
            while let Some(event) = self.sender.poll_event() {
                self.note(event);
            }
            self.follow_operator()?;
            self.follow_sensor();
            self.report_problems();
            if let Some(result) = self.ended() {
                return result;
            }
            let (now_us, is_open) = (self.pump.now_us(), self.pump.is_open());
            if let Some(overdue) = self.patience.look(now_us, &self.sender, is_open) {
                return Err(match overdue.wait {
                    Wait::Welcome => no_answer(&self.port, &overdue.said),
                    _ => CliError::Job(overdue.to_string()),
                });
            }
        }
    }

    fn note(&mut self, event: SenderEvent) {
        match event {
            SenderEvent::Connected(welcome) => {
                self.connected = true;
                let job = self.sender.frames().job();
                self.has_part = welcome.stream.is_some_and(|stream| stream.job == job);
                let often = self.heat.changes().then_some(HEAT_STATUS_MS);
                if let Some(period_ms) = self.status_period_ms.or(often) {
                    self.sender.command(Control::ReportPeriod(period_ms));
                }
            }
            SenderEvent::Status(status) => {
                self.order_heat(&status);
                self.look_at_pause(&status);
                self.show(&self.timeline.at(&status), &status);
                self.status = Some(status);
                self.publish();
            }
            // What ends the stream is reported at its end.
            SenderEvent::Refused(_) | SenderEvent::Fault(_)
                if matches!(self.sender.state(), SenderState::Failed(_)) => {}
            SenderEvent::Refused(refusal) => self.tell(format!("refused: {}", refusal.reason)),
            SenderEvent::Fault(fault) => self.tell(format!("fault: {fault}")),
            SenderEvent::Crash(crash) => self.tell(format!("the run before crashed: {crash}")),
            SenderEvent::Measured(_) => {}
            SenderEvent::Taken(control) => {
                self.operator.taken(&control);
                if control == Control::Pause {
                    self.say("pausing; `resume` goes on");
                }
            }
        }
    }

    /// Sends the commands for heaters and fans whose place on the path is done.
    fn order_heat(&mut self, status: &Status) {
        let streams = matches!(
            self.sender.state(),
            SenderState::Streaming | SenderState::Finishing
        );
        let done_tick = self.timeline.done_tick(status);
        while streams && let Some(control) = self.heat.due(done_tick) {
            self.give(control);
        }
    }

    fn show(&self, at: &Progress, status: &Status) {
        let left = at.left_s.map_or("resting".to_string(), |left_s| {
            format!("{}:{:02} left", left_s as u64 / 60, left_s as u64 % 60)
        });
        let pass = at.pass.map_or("-".to_string(), |pass| pass.to_string());
        self.bar.set_position((at.done * BAR_STEPS) as u64);
        self.bar.set_message(format!(
            "{left}  layer {}/{} pass {pass}  {:.0} mm/s  queue {}  {:?}  {}",
            at.layer + 1,
            self.timeline.layers(),
            at.tip_mm_s,
            status.queue_knots,
            status.state,
            heaters_text(status).trim_end()
        ));
    }

    fn follow_operator(&mut self) -> Result<(), CliError> {
        loop {
            let Some(wish) = self.operator.next(!self.sender.has_command()) else {
                return Ok(());
            };
            match wish {
                Wish::Stop => self.give(Control::EmergencyStop),
                Wish::Control(Control::Resume) => {
                    for heat in self.pause_heat.take_resume() {
                        self.give(heat);
                    }
                    self.give(Control::Resume);
                }
                Wish::Control(control) if self.is_for_sensor(control) => {}
                Wish::Control(control) => self.give(control),
                Wish::Interrupt(time) => self.interrupt(time)?,
                Wish::End => return Err(self.left()),
                Wish::Unknown => self.say(
                    "commands: pause, resume, override PCT (1 to 200), flow PCT (10 to 200), fan PCT, heat \
                     HEATER C, abort, stop",
                ),
            }
        }
    }

    /// Sends a command to the board; from then on the operator owns the heaters that it switches
    /// on.
    fn give(&mut self, control: Control) {
        self.operator.note(&control);
        self.pause_heat.note(self.pump.real_us(), &control);
        self.sender.command(control);
    }

    /// What is still hot at a print's end, whoever switched it on, goes off with it.
    fn own_heaters(&self) {
        let heaters = self
            .status
            .iter()
            .flat_map(|status| (0..).zip(&status.heaters));
        for (heater, of) in heaters {
            self.operator.note(&Control::Heat {
                heater,
                decidegrees: of.target_decidegrees,
                wait: false,
            });
        }
    }

    /// A pause that keeps heating is reported, and does not heat for ever.
    fn look_at_pause(&mut self, status: &Status) {
        let (now_us, owner) = (self.pump.real_us(), self.operator.owner());
        let most_min = self.pause_heat.most_min();
        match self.pause_heat.look(now_us, status, &owner) {
            None => {}
            Some(PauseNews::Keeps(hot)) => self.tell(format!(
                "the pause keeps {} hot, for {most_min:.0} min at most; `resume` goes on",
                hot_text(&hot)
            )),
            Some(PauseNews::Ends(off)) => {
                self.tell(format!(
                    "paused for {most_min:.0} min: the heaters are off, the pause stays; `resume` heats again, and \
                     goes on once that is done"
                ));
                for control in off {
                    self.operator.note(&control);
                    self.sender.command(control);
                }
            }
            Some(PauseNews::Again(again)) => self.heat_again("resumed by another program", again),
            Some(PauseNews::Returns(again)) => {
                self.heat_again("the board had not heard this program for long", again);
            }
        }
    }

    fn heat_again(&mut self, why: &str, orders: Vec<Control>) {
        self.tell(format!("{why}: heating again"));
        for control in orders {
            self.give(control);
        }
    }

    fn interrupt(&mut self, time: usize) -> Result<(), CliError> {
        match time {
            1 if self.connected => {
                self.say("pausing on the path; Ctrl-C again aborts, `resume` goes on");
                self.give(Control::Pause);
                Ok(())
            }
            2 if self.pump.is_open() => {
                self.say("aborting on the path; Ctrl-C again leaves the board alone");
                self.give(Control::Abort);
                Ok(())
            }
            _ => Err(self.left()),
        }
    }

    fn left(&self) -> CliError {
        let status = self.status.as_ref();
        let board = status.map(|status| (status.state, status.spans_done));
        let (first, words) = leave(self.sender.state(), board);
        self.operator.rest_before_off(first);
        CliError::Job(words.to_string())
    }

    fn ended(&self) -> Option<Result<(), CliError>> {
        let rests =
            |status: &Status| matches!(status.state, DeviceState::Idle | DeviceState::Faulted);
        match self.sender.state() {
            SenderState::Done => Some(Ok(())),
            SenderState::Failed(SenderError::Refused(RefusalReason::Busy)) if self.has_part => {
                Some(Err(CliError::Job(
                    "the board has part of this job already: go on with --resume, or end it with \
                     `headway board abort`"
                        .to_string(),
                )))
            }
            SenderState::Failed(SenderError::Refused(RefusalReason::Invalid)) => {
                Some(Err(CliError::Job(
                    "the machine is not where the job begins: bring it there with `headway board \
                     go JOB` (home it first)"
                        .to_string(),
                )))
            }
            SenderState::Failed(error) => Some(Err(CliError::Job(error.to_string()))),
            SenderState::Aborted if self.status.as_ref().is_some_and(rests) => {
                Some(Err(CliError::Job("the job was aborted".to_string())))
            }
            _ => None,
        }
    }

    fn figures(&self, result: &Result<(), CliError>) -> Value {
        let sent = self.sender.figures();
        let (frames, of) = self.sender.progress_frames();
        json!({
            "done": result.is_ok(),
            "frames_taken": frames,
            "frames": of,
            "bytes": sent.bytes_sent,
            "resent_frames": sent.frames_resent,
            "reconnects": self.pump.times_opened() - 1,
            "round_trip_us": self.sender.round_trip_us(),
            "job_s": self.timeline.duration_s(),
            "took_s": self.begun.elapsed().as_secs_f64(),
            "final_counts": self.status.as_ref().map(|status| status.counts_steps.to_vec()),
            "sensor": self.correction().map(|correction| correction.figures),
        })
    }
}
