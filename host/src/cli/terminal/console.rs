//! The command's output: results to stdout, everything else to stderr, progress bars on a terminal
//! only and never with `--quiet`.

use crate::cli::error::CliError;
use crate::cli::terminal::named_files::NamedFiles;
use crate::cli::terminal::output_file::OutputFile;
use crate::cli::terminal::printable::{message, printable};
use crate::plan::progress::{Progress, Stage};
use indicatif::{HumanDuration, ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::{BufWriter, ErrorKind, IsTerminal, Write};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// The terminal, or the pipe.
pub(crate) struct Console {
    bars: bool,
    /// Notes that are still shown; later ones are only counted.
    notes_left: AtomicUsize,
    notes_hidden: AtomicUsize,
    files: NamedFiles,
}

/// Notes that a terminal shows with a verdict.
const NOTES_SHOWN: usize = 2;

impl Console {
    pub(crate) fn new(quiet: bool, files: NamedFiles) -> Console {
        Console {
            bars: !quiet && std::io::stderr().is_terminal(),
            notes_left: AtomicUsize::new(usize::MAX),
            notes_hidden: AtomicUsize::new(0),
            files,
        }
    }

    /// The files that the command names.
    pub(crate) fn files(&self) -> &NamedFiles {
        &self.files
    }

    /// Shows a few notes only, where a terminal shows them: whatever reads a pipe gets them all.
    pub(crate) fn show_few_notes(&self) {
        if std::io::stderr().is_terminal() {
            self.notes_left.store(NOTES_SHOWN, Ordering::Relaxed);
        }
    }

    /// Notes that were not shown.
    pub(crate) fn notes_hidden(&self) -> usize {
        self.notes_hidden.load(Ordering::Relaxed)
    }
    /// A line for the eye.
    pub(crate) fn say(&self, line: &str) {
        // Nothing is left to say it to where stderr is closed.
        let _ = writeln!(std::io::stderr(), "{}", message(line));
    }

    /// Notes and warnings, one line each.
    pub(crate) fn notes(&self, notes: &[String]) {
        for note in notes {
            let left = self.notes_left.load(Ordering::Relaxed);
            match left.checked_sub(1) {
                Some(left) => {
                    self.notes_left.store(left, Ordering::Relaxed);
                    self.say(&format!("note: {note}"));
                }
                None => {
                    self.notes_hidden.fetch_add(1, Ordering::Relaxed);
                }
            }
        }
    }

    /// A result to stdout.
    pub(crate) fn result(&self, text: &str) -> Result<(), CliError> {
        self.write_to(None, |out| out.write_all(printable(text).as_bytes()))
    }

    /// The output of `write` to `output`, or to stdout if there is none, unbuffered.
    pub(crate) fn write_to(
        &self,
        output: Option<&OutputFile>,
        write: impl FnOnce(&mut dyn Write) -> std::io::Result<()>,
    ) -> Result<(), CliError> {
        if let Some(file) = output {
            return file.write_with(write);
        }
        let mut out = BufWriter::new(std::io::stdout().lock());
        let written = write(&mut out).and_then(|()| out.flush());
        written.map_err(|problem| match problem.kind() {
            ErrorKind::BrokenPipe => CliError::OutputClosed,
            _ => CliError::File {
                path: "stdout".into(),
                problem,
            },
        })
    }

    /// A result to `output`, or to stdout if there is none.
    pub(crate) fn result_to(
        &self,
        output: Option<&OutputFile>,
        text: &str,
    ) -> Result<(), CliError> {
        match output {
            Some(file) => file.write(text.as_bytes()),
            None => self.result(text),
        }
    }

    /// The planner's stages, one after the other, with their counts; invisible in a pipe.
    pub(crate) fn planning(&self) -> PlanningBar {
        let bar = self.stage("planning");
        if let Ok(style) = ProgressStyle::with_template("{spinner} {msg} {pos}/{len} {elapsed}") {
            bar.set_style(style);
        }
        PlanningBar {
            bar,
            layers: Mutex::new(None),
        }
    }

    /// A spinner with the stage's name; invisible in a pipe.
    pub(crate) fn stage(&self, name: &str) -> ProgressBar {
        if !self.bars {
            return ProgressBar::hidden();
        }
        let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr());
        if let Ok(style) = ProgressStyle::with_template("{spinner} {msg} {elapsed}") {
            bar.set_style(style);
        }
        bar.set_message(name.to_string());
        bar.enable_steady_tick(Duration::from_millis(80));
        bar
    }

    /// A bar over `length` steps with a changing text; invisible in a pipe.
    pub(crate) fn stream(&self, length: u64) -> ProgressBar {
        if !self.bars {
            return ProgressBar::hidden();
        }
        let bar = ProgressBar::with_draw_target(Some(length), ProgressDrawTarget::stderr());
        if let Ok(style) = ProgressStyle::with_template("{bar:24} {percent:>3} % {msg}") {
            bar.set_style(style);
        }
        bar
    }

    /// A bar over `length` steps with a name; invisible in a pipe.
    pub(crate) fn bar(&self, name: &str, length: u64) -> ProgressBar {
        if !self.bars {
            return ProgressBar::hidden();
        }
        let bar = ProgressBar::with_draw_target(Some(length), ProgressDrawTarget::stderr());
        if let Ok(style) = ProgressStyle::with_template("{msg:10} {wide_bar} {percent:>3} % {eta}")
        {
            bar.set_style(style);
        }
        bar.set_message(name.to_string());
        bar
    }
}

/// Shows the planner's progress.
pub(crate) struct PlanningBar {
    bar: ProgressBar,
    /// Of a part: since when, and how far it is.
    layers: Mutex<Option<(Instant, String)>>,
}

impl PlanningBar {
    pub(crate) fn clear(&self) {
        self.bar.finish_and_clear();
    }

    fn layers_text(&self) -> String {
        let layers = self.layers.lock().unwrap_or_else(PoisonError::into_inner);
        let text = layers.as_ref().map(|(_, text)| text.clone());
        text.unwrap_or_default()
    }
}

impl Progress for PlanningBar {
    fn at(&self, stage: Stage, done: usize, total: usize) {
        if done == 0 {
            let layers = self.layers_text();
            self.bar.set_message(format!("{layers}{}", stage.name()));
            self.bar.set_length(total as u64);
        }
        self.bar.set_position(done as u64);
    }

    fn layers(&self, done: usize, total: usize) {
        let mut layers = self.layers.lock().unwrap_or_else(PoisonError::into_inner);
        let since = layers
            .as_ref()
            .map_or_else(Instant::now, |(since, _)| *since);
        let left = match done {
            0 => String::new(),
            _ => {
                let left = since.elapsed().mul_f64((total - done) as f64 / done as f64);
                format!(", {} left", HumanDuration(left))
            }
        };
        *layers = Some((since, format!("{done} of {total} layers{left}: ")));
    }
}
