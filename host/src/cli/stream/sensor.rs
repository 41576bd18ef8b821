//! `headway stream --sensor`: the sensor's program, beside the print.
//!
//! ```text
//! stream's loop --status (64 lines at most, else dropped)--> writer --> the program's stdin
//! stream's loop <--readings (64 at most, else it waits)----- reader <-- the program's stdout
//! ```
//! Both threads wait for the program, the loop for neither. Its stdin ends with the print, and the program shortly after.
//! Scans of layers are measured by the reader, so a slow one delays the readings after it and nothing else.
//! Not covered: what a reading does (`drive::flow_correction`).

use super::{Run, give};
use crate::cli::args::board::PortArgs;
use crate::cli::board::operator::Operator;
use crate::cli::error::CliError;
use crate::cli::reading::job::{Job, open};
use crate::drive::flow_correction::{FlowCorrection, Reading};
use crate::job::SegmentStream;
use crate::job::resume::rest::printed_top_mm;
use crate::job::transform::PartTransform;
use crate::scan::layer::Layer;
use crate::scan::{self, PictureScale, Scale};
use crate::settings::Settings;
use crate::settings::measure::Measure;
use headway_protocol::message::Control;
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, sync_channel};
use std::time::{Duration, Instant};

/// Longest line that is read.
const LINE_BYTES_MAX: u64 = 4096;
/// Lines that wait, either way.
const LINES_MAX: usize = 64;

/// A line of the program: a reading, what is wrong with a scan that it names, or neither.
type Heard = Result<Reading, Option<String>>;

/// A sensor's program.
pub(super) struct Sensor {
    child: Child,
    status: SyncSender<String>,
    heard: Receiver<Heard>,
    measure: Measure,
    layer_mm: f64,
    /// From the board's first status on.
    correction: Option<FlowCorrection>,
}

impl Sensor {
    /// Starts a program: blanks part its words, double quotes keep them together.
    pub(super) fn start(line: &str, job: &Job) -> Result<Sensor, CliError> {
        // What stands in quotes is every second part.
        let parts = line.split('"').enumerate();
        let mut words = parts.flat_map(|(number, part)| match number % 2 {
            0 => part.split_whitespace().collect(),
            _ => vec![part],
        });
        let mut command = Command::new(words.next().unwrap_or_default());
        command.args(words);
        command.stdin(Stdio::piped()).stdout(Stdio::piped());
        // Ctrl-C pauses the print, and is not for the program.
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        let mut child = command.spawn().map_err(|problem| CliError::File {
            path: format!("--sensor {line}"),
            problem,
        })?;
        let (status, lines) = sync_channel::<String>(LINES_MAX);
        let (readings, heard) = sync_channel(LINES_MAX);
        if let (Some(mut stdin), Some(stdout)) = (child.stdin.take(), child.stdout.take()) {
            let mut write = move |line: String| stdin.write_all(line.as_bytes());
            std::thread::spawn(move || lines.iter().try_for_each(&mut write));
            let scans = Scans::of(job);
            std::thread::spawn(move || listen(stdout, &scans, &readings));
        }
        let (stream, layers) = (&job.stream, job.stream.layers());
        let top_mm = |layer| printed_top_mm(stream, stream.ticks_of_layer(layer)[1]).unwrap_or(0.0);
        let rise_mm = top_mm(layers.saturating_sub(1)) - top_mm(0);
        let settings = job.settings.clone().unwrap_or_default();
        let sensor = Sensor {
            child,
            status,
            heard,
            measure: settings.measure.unwrap_or_default(),
            // In a job of one layer there is none to correct: any error is too large.
            layer_mm: (rise_mm / f64::from(layers.saturating_sub(1))).max(1e-3),
            correction: None,
        };
        sensor.say(&json!({ "headway": 1, "job": job.name, "layers": layers }));
        Ok(sensor)
    }

    /// A line to the program, unless it has enough to read.
    pub(super) fn say(&self, line: &Value) {
        let _ = self.status.try_send(format!("{line}\n"));
    }

    /// The program is told how the print ended; where it is done, the board gets the operator's own override back.
    pub(super) fn end(self, error: Option<&CliError>, port: &PortArgs, operator: &Operator<'_>) {
        let ended = error.map_or("done".to_string(), CliError::to_string);
        self.say(&json!({ "ended": ended }));
        let correction = self.correction.as_ref().filter(|_| error.is_none());
        let back = correction.map(|correction| Control::FlowOverride(correction.operator_percent));
        if let Err(error) = give(port, back.as_slice(), operator) {
            let told = format!("the board keeps the print's last flow: {error}");
            operator.console.say(&told);
        }
    }
}

impl Drop for Sensor {
    fn drop(&mut self) {
        // The writer has no more to write once this end of its channel is gone.
        self.status = sync_channel(0).0;
        let until = Instant::now() + Duration::from_millis(500);
        while matches!(self.child.try_wait(), Ok(None)) && Instant::now() < until {
            std::thread::sleep(Duration::from_millis(5));
        }
        // One that has ended cannot be killed.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Run<'_> {
    /// The correction, once there is one.
    pub(super) fn correction(&self) -> Option<&FlowCorrection> {
        self.sensor.as_ref()?.correction.as_ref()
    }

    /// The operator's override goes into the sensor's, where there is one.
    pub(super) fn is_for_sensor(&mut self, control: Control) -> bool {
        let sensor = self.sensor.as_mut();
        let correction = sensor.and_then(|sensor| sensor.correction.as_mut());
        let (Control::FlowOverride(percent), Some(correction)) = (control, correction) else {
            return false;
        };
        correction.operator_percent = percent;
        true
    }

    /// Readings become overrides, once the board has told where it is.
    pub(super) fn follow_sensor(&mut self) {
        let now_s = self.pump.now_us() as f64 / 1e6;
        let (Some(sensor), Some(status)) = (&mut self.sensor, &self.status) else {
            return;
        };
        let (layer, percent) = (self.timeline.at(status).layer, status.flow_percent);
        let (measure, layer_mm) = (&sensor.measure, sensor.layer_mm);
        let new = || FlowCorrection::new(measure.clone(), layer_mm, layer, percent);
        let correction = sensor.correction.get_or_insert_with(new);
        let mut refused = Vec::new();
        for _ in 0..LINES_MAX {
            match sensor.heard.try_recv() {
                Ok(line) => {
                    correction.hear(line.as_ref().ok());
                    refused.extend(line.err().flatten());
                }
                Err(TryRecvError::Empty) => break,
                Err(TryRecvError::Disconnected) => correction.has_ended = true,
            }
        }
        let percent = correction.follow(now_s, layer, status);
        let news = std::mem::take(&mut correction.news);
        for what in refused
            .into_iter()
            .chain(news.into_iter().map(String::from))
        {
            self.tell(what);
        }
        let is_free = self.pump.is_open() && !self.sender.has_command();
        if let Some(percent) = percent.filter(|_| is_free) {
            self.give(Control::FlowOverride(percent));
        }
    }
}

/// What measures scans of the job's layers.
struct Scans {
    stream: SegmentStream,
    servo_hz: f64,
    transform: PartTransform,
    settings: Settings,
}

impl Scans {
    fn of(job: &Job) -> Scans {
        Scans {
            stream: job.stream.clone(),
            servo_hz: f64::from(job.file.header.machine.servo_hz),
            transform: job.transform,
            settings: job.settings.clone().unwrap_or_default(),
        }
    }

    /// A reading that names a scan has the scan's height error. Its volume tells nothing here: the layers below are as high
    /// as they came out.
    fn measured(&self, mut reading: Reading) -> Result<Reading, String> {
        let (Some(path), Some(number)) = (reading.scan.take(), reading.layer) else {
            return Ok(reading);
        };
        let picture = reading.pixel_mm.zip(reading.level_mm);
        let scale = Scale {
            picture: picture.map(|(pixel_mm, level_mm)| PictureScale { pixel_mm, level_mm }),
            ..Scale::MM
        };
        let layer = Layer::of(
            &self.stream,
            self.servo_hz,
            &self.transform,
            &self.settings.aperture,
            number,
        );
        let place = |problem: String| format!("the scan of layer {number}, {path}: {problem}");
        let layer = layer.map_err(|error| place(error.to_string()))?;
        let scan = open(Path::new(&path)).map_err(|error| error.to_string())?;
        let measured = scan::read(scan, &scale, &layer, &self.settings);
        let measured = measured.map_err(|error| place(error.to_string()))?;
        reading.height_error_mm = Some(measured.height_error_mm);
        Ok(reading)
    }
}

/// Lines of the program, until it has no more or nobody listens. Of scans that are refused in a row the first is told.
fn listen(stdout: impl Read, scans: &Scans, heard: &SyncSender<Heard>) {
    let mut was_refused = false;
    let mut stdout = BufReader::new(stdout);
    let (mut line, mut is_within) = (Vec::new(), false);
    while let Ok(1..) = (&mut stdout)
        .take(LINE_BYTES_MAX)
        .read_until(b'\n', &mut line)
    {
        // Pieces of a line that is too long count each, so that an endless one waits for the loop too.
        let is_whole = line.ends_with(b"\n");
        let reading = (is_whole && !is_within).then(|| serde_json::from_slice(&line).ok());
        is_within = !is_whole;
        line.clear();
        let line = match reading
            .flatten()
            .map(|reading: Reading| scans.measured(reading))
        {
            Some(Ok(reading)) => {
                was_refused = false;
                Ok(reading)
            }
            Some(Err(told)) => Err((!std::mem::replace(&mut was_refused, true)).then_some(told)),
            None => Err(None),
        };
        if heard.send(line).is_err() {
            return;
        }
    }
}
