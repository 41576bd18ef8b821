//! `headway stream`: a job to a board, with progress, pause and abort on the path, and a log.

use super::args_board::{PortArgs, StreamArgs};
use super::board::Talk;
use super::console::Console;
use super::heat::{heat, heaters_json, heaters_text};
use super::live::{LivePrint, Snapshot};
use super::live_page::{self, PageClock};
use super::probe::over_bed;
use super::resume_from::Resumed;
use super::stream_heat::StreamHeat;
use super::{CliError, job};
use crate::drive::link_log::LinkLog;
use crate::drive::patience::{ANSWER_US, Patience, Wait};
use crate::drive::pump::{LineEvent, Pump, host_session};
use crate::drive::sender::Sender;
use crate::drive::sender_state::{SenderError, SenderEvent, SenderSetup, SenderState};
use crate::drive::stream_progress::{Progress, Timeline};
use crate::drive::synced_file::SyncedFile;
use crate::drive::transport::Port;
use headway_firmware::configuration::MachineConfiguration;
use headway_protocol::message::{Control, DeviceState, RefusalReason, Status};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde_json::json;
use std::io::BufRead;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Once};
use std::time::{Duration, Instant};

/// Silence at the start after which there is no board.
pub(super) const ANSWER_PATIENCE: Duration = Duration::from_micros(ANSWER_US);
/// How often the board tells where it is if heaters or fans change on the path, ms: 3 mm at 60 mm/s.
const HEAT_STATUS_MS: u16 = 50;
/// Steps of the progress bar.
const BAR_STEPS: f64 = 1000.0;

/// How often Ctrl-C was pressed since the process began.
static INTERRUPTS: AtomicUsize = AtomicUsize::new(0);

pub(super) fn run(args: &StreamArgs, console: &Console) -> Result<(), CliError> {
    let whole = over_bed(job::read(&args.job)?, args.mesh.as_deref())?;
    let resumed = args.resume_from.as_ref();
    let resumed = resumed
        .map(|place| Resumed::of(place, args, &whole))
        .transpose()?;
    let job = resumed.as_ref().map_or(&whole, |rest| &rest.job);
    let header = &job.file.header;
    let setup = SenderSetup::of_job(header, host_session(), args.resume);
    let frames = job.file.frames.clone();
    let sender = if args.resume {
        Sender::resuming(frames, setup)
    } else {
        Sender::new(frames, setup)
    };
    let live = args
        .view
        .then(|| live_page::open(job.clone(), args.view_port, args.no_open, console))
        .transpose()?;
    let heat = StreamHeat::of(args, job)?;
    match &resumed {
        Some(rest) => rest.begin(&args.port, &heat, console)?,
        None => give(&args.port, &heat.before)?,
    }
    let log = log_file(args, &header.machine, resumed.as_ref())?;
    let pump = open(&args.port, log)?;
    let mut run = Run {
        timeline: Timeline::new(&job.stream, f64::from(header.machine.servo_hz)),
        console,
        bar: bar(console),
        port: args.port.port.clone(),
        sender,
        pump,
        commands: commands(),
        interrupts: catch_interrupts(),
        handled: 0,
        status: None,
        connected: false,
        has_part: false,
        patience: Patience::new(&job.stream, header.machine.servo_hz),
        status_period_ms: args.status_period_ms,
        begun: Instant::now(),
        live,
        said: String::new(),
        heat,
    };
    let result = run.until_end();
    run.bar.finish_and_clear();
    run.tell_the_end(&result);
    let mut figures = run.figures(&result);
    if let Some(rest) = &resumed {
        figures["resumed"] = rest.figures.clone();
    }
    let Run { pump, heat, .. } = run;
    pump.finish()
        .map_err(|error| CliError::Job(format!("the log could not be written: {error}")))?;
    // The line may be gone: then the board switches off by itself.
    let off = give(&args.port, &heat.after);
    if result.is_ok() {
        off?;
    }
    if args.json {
        console.result(&format!("{figures:#}\n"))?;
    } else if result.is_ok() {
        console.say(&format!("{}: done", job.name));
    }
    result
}

/// Gives commands in a conversation of their own; none, none.
pub(super) fn give(port: &PortArgs, commands: &[Control]) -> Result<(), CliError> {
    if commands.is_empty() {
        return Ok(());
    }
    let mut talk = Talk::open(port)?;
    for command in commands {
        talk.order(*command).map_err(|error| {
            CliError::Job(format!(
                "{error} (has the board this heater, and may it be that hot? --no-heat leaves it alone)"
            ))
        })?;
    }
    Ok(())
}

/// Opens the port, or says what to look at.
pub(super) fn open(args: &PortArgs, log: Option<LinkLog>) -> Result<Pump, CliError> {
    let port: Port = args
        .port
        .parse()
        .map_err(|error| CliError::Usage(format!("--port: {error}")))?;
    Pump::open(&port, args.baud, log).map_err(|problem| {
        CliError::Job(format!(
            "{port}: {problem}; is the board connected? A serial port has one user: a program that \
             streams takes `pause`, `abort` and `stop` at its own terminal, and Ctrl-C"
        ))
    })
}

/// The log that was asked for.
fn log_file(
    args: &StreamArgs,
    machine: &MachineConfiguration,
    resumed: Option<&Resumed>,
) -> Result<Option<LinkLog>, CliError> {
    let Some(path) = &args.log else {
        return Ok(None);
    };
    let file = SyncedFile::create(path).map_err(|problem| CliError::File {
        path: path.display().to_string(),
        problem,
    })?;
    let mut log = LinkLog::new(Box::new(file), Some(machine));
    if let Some(rest) = resumed {
        log.remark(&rest.remark);
    }
    Ok(Some(log))
}

/// From now on Ctrl-C only counts. The count at this moment is returned.
pub(super) fn catch_interrupts() -> Arc<dyn Fn() -> usize> {
    static CAUGHT: Once = Once::new();
    CAUGHT.call_once(|| {
        // Where it cannot be caught Ctrl-C ends the program, as ever; the board comes to rest.
        let _ = ctrlc::set_handler(|| {
            INTERRUPTS.fetch_add(1, Ordering::Relaxed);
        });
    });
    let before = INTERRUPTS.load(Ordering::Relaxed);
    Arc::new(move || INTERRUPTS.load(Ordering::Relaxed) - before)
}

/// Lines of stdin as they come.
fn commands() -> Receiver<String> {
    let (sender, receiver) = channel();
    std::thread::spawn(move || {
        for line in std::io::stdin().lock().lines().map_while(Result::ok) {
            if sender.send(line).is_err() {
                return;
            }
        }
    });
    receiver
}

fn bar(console: &Console) -> ProgressBar {
    if !console.has_bars() {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::with_draw_target(Some(BAR_STEPS as u64), ProgressDrawTarget::stderr());
    if let Ok(style) = ProgressStyle::with_template("{bar:24} {percent:>3} % {msg}") {
        bar.set_style(style);
    }
    bar
}

struct Run<'a> {
    timeline: Timeline,
    console: &'a Console,
    bar: ProgressBar,
    port: String,
    sender: Sender,
    pump: Pump,
    commands: Receiver<String>,
    interrupts: Arc<dyn Fn() -> usize>,
    /// Interrupts that were followed.
    handled: usize,
    status: Option<Status>,
    connected: bool,
    /// The board has part of this job already.
    has_part: bool,
    patience: Patience,
    status_period_ms: Option<u16>,
    begun: Instant,
    /// The page that watches, and the clock of its layers.
    live: Option<(LivePrint, PageClock)>,
    /// What the board said last that a page should show.
    said: String,
    /// Heaters and fans.
    heat: StreamHeat,
}

impl Run<'_> {
    /// What the page's people asked for; one order at a time, so that none piles up.
    fn follow_page(&mut self) {
        let Some((live, _)) = &self.live else {
            return;
        };
        if live.stop() {
            self.sender.command(Control::EmergencyStop);
        } else if !self.sender.has_command()
            && let Some(control) = live.order()
        {
            self.sender.command(control);
        }
    }

    fn snapshot(&self, clock: &PageClock) -> Snapshot {
        let mut snapshot = Snapshot {
            line_open: self.pump.is_open(),
            layers: self.timeline.layers(),
            said: self.said.clone(),
            ..Snapshot::default()
        };
        if let Some(status) = &self.status {
            let at = self.timeline.at(status);
            (snapshot.page_layer, snapshot.page_time_s) =
                clock.at(at.layer, at.done * self.timeline.duration_s());
            snapshot.state = format!("{:?}", status.state).to_lowercase();
            snapshot.done = at.done;
            snapshot.left_s = at.left_s;
            snapshot.layer = at.layer;
            snapshot.pass = at.pass;
            snapshot.tip_mm_s = at.tip_mm_s;
            snapshot.override_percent = status.override_percent;
            snapshot.flow_percent = status.flow_percent;
            snapshot.heaters = heaters_json(status);
            snapshot.fan_percent = f64::from(status.fan_permille) / 10.0;
            snapshot.queue_knots = status.queue_knots;
        }
        snapshot
    }

    fn publish(&self) {
        if let Some((live, clock)) = &self.live {
            live.publish(&self.snapshot(clock));
        }
    }

    /// Pages that ask once more hear how it ended.
    fn tell_the_end(&self, result: &Result<(), CliError>) {
        if let Some((live, clock)) = &self.live {
            let ended = match result {
                Ok(()) => "done".to_string(),
                Err(error) => error.to_string(),
            };
            live.publish_last(&Snapshot {
                ended: Some(ended),
                ..self.snapshot(clock)
            });
            std::thread::sleep(live_page::LAST_LOOK);
        }
    }

    fn say(&self, line: &str) {
        self.bar.suspend(|| self.console.say(line));
    }

    /// To the terminal and to the page.
    fn tell(&mut self, what: String) {
        self.say(&what);
        self.said = what;
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
            self.follow_commands();
            self.follow_page();
            self.follow_interrupts()?;
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
                self.show(&self.timeline.at(&status), &status);
                self.status = Some(status);
                self.publish();
            }
            SenderEvent::Refused(refusal) => self.tell(format!("refused: {}", refusal.reason)),
            SenderEvent::Fault(fault) => self.tell(format!("fault: {fault}")),
            SenderEvent::Taken(Control::Pause) => self.say("pausing; `resume` goes on"),
            SenderEvent::Taken(_) => {}
        }
    }

    /// Heaters and fans whose place on the path is done.
    fn order_heat(&mut self, status: &Status) {
        let streams = matches!(
            self.sender.state(),
            SenderState::Streaming | SenderState::Finishing
        );
        let done_tick = self.timeline.done_tick(status);
        while streams && let Some(control) = self.heat.due(done_tick) {
            self.sender.command(control);
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

    fn follow_commands(&mut self) {
        while let Ok(line) = self.commands.try_recv() {
            match command(&line) {
                Some(control) => self.sender.command(control),
                None if line.trim().is_empty() => {}
                None => self.say(
                    "commands: pause, resume, override PCT (1 to 200), flow PCT (10 to 200), fan PCT, heat \
                     HEATER C, abort, stop",
                ),
            }
        }
    }

    fn follow_interrupts(&mut self) -> Result<(), CliError> {
        let pressed = (self.interrupts)();
        if pressed == self.handled {
            return Ok(());
        }
        self.handled += 1;
        match self.handled {
            1 if self.connected => {
                self.say("pausing on the path; Ctrl-C again aborts, `resume` goes on");
                self.sender.command(Control::Pause);
                Ok(())
            }
            2 if self.pump.is_open() => {
                self.say("aborting on the path; Ctrl-C again leaves the board alone");
                self.sender.command(Control::Abort);
                Ok(())
            }
            _ => Err(CliError::Job(
                "left: the board comes to rest on the path when its queue is empty; go on with \
                 --resume"
                    .to_string(),
            )),
        }
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

    fn figures(&self, result: &Result<(), CliError>) -> serde_json::Value {
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
        })
    }
}

/// Nobody speaks our language on that port.
pub(super) fn no_answer(port: &str, said: &str) -> CliError {
    CliError::Job(format!(
        "{port}: no answer in {} s; is it the right port and rate (--baud), and is the firmware \
         flashed? It said last: {said}",
        ANSWER_PATIENCE.as_secs()
    ))
}

/// What a page may order: nothing that heats.
pub(super) fn page_order(line: &str) -> Option<Control> {
    command(line).filter(|control| !matches!(control, Control::Heat { .. } | Control::Fan(_)))
}

/// A line of stdin as a command.
fn command(line: &str) -> Option<Control> {
    let words: Vec<&str> = line.split_whitespace().collect();
    let percent = |text: &str, range: std::ops::RangeInclusive<u16>| {
        text.parse().ok().filter(|percent| range.contains(percent))
    };
    match words[..] {
        ["pause"] => Some(Control::Pause),
        ["resume"] => Some(Control::Resume),
        ["abort"] => Some(Control::Abort),
        ["stop"] => Some(Control::EmergencyStop),
        ["override", text] => percent(text, 1..=200).map(Control::Override),
        ["fan", text] => percent(text, 0..=100).map(|percent| Control::Fan(10 * percent)),
        ["heat", heater, text] => text
            .parse()
            .ok()
            .and_then(|celsius| heat(heater, celsius, false).ok()),
        ["flow", text] => percent(text, 10..=200).map(Control::FlowOverride),
        _ => None,
    }
}
