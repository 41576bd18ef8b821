//! The operator who commands a board through this program, and everything that this program has
//! switched on.
//!
//! In: lines on stdin, commands from the page, signals. Out: one request after another, for the loop that
//! currently talks to the board: a stop takes effect from the first byte to the last. Everything that is switched
//! on is recorded here and switched off with the operator, however the command ends: by an error, a signal, a
//! panic. Only what [`Operator::hand_over`] hands over stays on, until the board has heard from no host for its
//! own 30 s.

use crate::cli::args::board::PortArgs;
use crate::cli::board::heat::{heat, heaters_json};
use crate::cli::board::talk::Talk;
use crate::cli::error::CliError;
use crate::cli::live::orders::{order, percent};
use crate::cli::live::{LivePrint, Snapshot, live_page};
use crate::cli::terminal::console::Console;
use crate::cli::terminal::signals::{Signals, catch};
use crate::drive::heat_owner::HeatOwner;
use headway_protocol::message::{Control, Status};
use std::cell::{Cell, RefCell};
use std::io::BufRead;
use std::sync::mpsc::{Receiver, channel};

/// A request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Wish {
    /// Immediate stop.
    Stop,
    /// A command for the board.
    Control(Control),
    /// Ctrl-C, with its count.
    Interrupt(usize),
    /// The program is to end.
    End,
    /// A line that is no command.
    Unknown,
}

/// The people at the terminal and at the page, and what was switched on for them.
pub(crate) struct Operator<'a> {
    port: &'a PortArgs,
    /// The console for messages.
    pub console: &'a Console,
    lines: Option<Receiver<String>>,
    live: Option<LivePrint>,
    signals: Signals,
    /// Interrupts that were followed.
    interrupts: Cell<usize>,
    owner: RefCell<HeatOwner>,
    /// What brings a path that waits for heat to rest before it is off.
    rest: Cell<Option<Control>>,
}

impl<'a> Operator<'a> {
    /// For a command that heats: signals alone are heard.
    pub(crate) fn new(port: &'a PortArgs, console: &'a Console) -> Operator<'a> {
        Operator {
            port,
            console,
            lines: None,
            live: None,
            signals: catch(),
            interrupts: Cell::new(0),
            owner: RefCell::default(),
            rest: Cell::default(),
        }
    }

    /// For a command that streams: lines on stdin are heard too, and a page if there is one.
    pub(crate) fn of_stream(
        port: &'a PortArgs,
        console: &'a Console,
        live: Option<LivePrint>,
    ) -> Operator<'a> {
        let mut operator = Operator::new(port, console);
        operator.lines = Some(lines());
        operator.live = live;
        operator
    }

    /// The next request; commands of a page only once the last one is done (`is_free`), so that they do
    /// not pile up.
    pub(crate) fn next(&self, is_free: bool) -> Option<Wish> {
        if self.live.as_ref().is_some_and(LivePrint::stop) {
            return Some(Wish::Stop);
        }
        if self.signals.is_to_end() {
            return Some(Wish::End);
        }
        if self.signals.interrupts() > self.interrupts.get() {
            self.interrupts.set(self.interrupts.get() + 1);
            return Some(Wish::Interrupt(self.interrupts.get()));
        }
        let lines = self.lines.as_ref();
        while let Some(line) = lines.and_then(|lines| lines.try_recv().ok()) {
            match command(&line) {
                Some(Control::EmergencyStop) => return Some(Wish::Stop),
                Some(control) => return Some(Wish::Control(control)),
                None if line.trim().is_empty() => {}
                None => return Some(Wish::Unknown),
            }
        }
        let live = self.live.as_ref().filter(|_| is_free)?;
        live.order().map(Wish::Control)
    }

    /// A conversation with the board begins.
    pub(crate) fn begin(&self) {
        self.owner.borrow_mut().begin();
    }

    /// A command is about to be given; what was owned before it.
    pub(crate) fn note(&self, control: &Control) -> HeatOwner {
        let before = self.owner.borrow().clone();
        self.owner.borrow_mut().note(control);
        before
    }

    /// The command after which this was noted was refused: it has switched nothing on.
    pub(crate) fn refused(&self, before: HeatOwner) {
        *self.owner.borrow_mut() = before;
    }

    /// The board has accepted a command.
    pub(crate) fn taken(&self, control: &Control) {
        self.owner.borrow_mut().taken(control);
    }

    /// The present ownership.
    pub(crate) fn owner(&self) -> HeatOwner {
        self.owner.borrow().clone()
    }

    /// Heaters that were switched on stay on: the board switches them off if no next command arrives within
    /// its 30 s.
    pub(crate) fn hand_over(&self) {
        self.owner.take();
    }

    /// Heaters stay on in the same way; what else was switched on goes off.
    pub(crate) fn hand_over_heaters(&self) {
        self.owner.borrow_mut().hand_over_heaters();
    }

    /// A command before everything is switched off, lest the path goes on cold.
    pub(crate) fn rest_before_off(&self, command: Option<Control>) {
        self.rest.set(command);
    }

    /// Switches off all that is owned, in a conversation of its own; nothing, where that is nothing.
    pub(crate) fn switch_off(&self) -> Result<(), CliError> {
        let all_off = self.owner.take().all_off();
        if all_off.is_empty() {
            return Ok(());
        }
        let mut talk = Talk::open(self.port)?;
        // Each of them, whatever becomes of the others; the first problem is the one to report.
        let mut ended = Ok(());
        for off in self.rest.take().into_iter().chain(all_off) {
            let taken = talk.order(off);
            ended = ended.and(taken);
        }
        ended
    }

    /// The page, where there is one.
    pub(crate) fn page(&self) -> Option<&LivePrint> {
        self.live.as_ref()
    }

    /// Leaves a snapshot for the page.
    pub(crate) fn publish(&self, snapshot: &Snapshot) {
        if let Some(live) = &self.live {
            live.publish(snapshot);
        }
    }

    /// What a page shows before the job streams.
    pub(crate) fn publish_beginning(&self, status: &Status) {
        self.publish(&Snapshot {
            state: format!("{:?}", status.state).to_lowercase(),
            line_open: true,
            heaters: heaters_json(status),
            ..Snapshot::default()
        });
    }

    /// Pages that query once more get the result.
    pub(crate) fn tell_the_end(&self, result: &Result<(), CliError>, snapshot: Snapshot) {
        let Some(live) = &self.live else {
            return;
        };
        let ended = match result {
            Ok(()) => "done".to_string(),
            Err(error) => error.to_string(),
        };
        live.publish_last(&Snapshot {
            ended: Some(ended),
            ..snapshot
        });
        std::thread::sleep(live_page::LAST_LOOK);
    }
}

impl Drop for Operator<'_> {
    fn drop(&mut self) {
        if self.owner().is_empty() {
            return;
        }
        match self.switch_off() {
            Ok(()) => self.console.say("what was switched on is off again"),
            Err(error) => self.console.say(&format!(
                "heaters could not be switched off ({error}): the board does it 30 s after it has heard the last \
                 program"
            )),
        }
    }
}

/// Lines of stdin as they arrive.
fn lines() -> Receiver<String> {
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

/// A line of stdin as a command: what a page may order, and what heats or cools.
fn command(line: &str) -> Option<Control> {
    let words: Vec<&str> = line.split_whitespace().collect();
    match words[..] {
        ["fan", text] => percent(text, 0..=100).map(|percent| Control::Fan(10 * percent)),
        ["heat", heater, text] => text
            .parse()
            .ok()
            .and_then(|celsius| heat(heater, celsius, false).ok()),
        _ => order(line),
    }
}

#[cfg(test)]
#[cfg(unix)]
mod tests {
    use super::*;
    use crate::drive::transport::{Listener, Port};
    use crate::drive::virtual_board::{BoardSetup, VirtualBed, VirtualBoard};
    use crate::settings::Settings;
    use headway_firmware::configuration::heat::HeatConfiguration;
    use headway_firmware::configuration::homing::HomingConfiguration;
    use std::panic::{AssertUnwindSafe, catch_unwind};
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::time::{Duration, Instant};

    /// Goal: a panic leaves nothing hot, and what a board refuses is not ours to switch off. Method: a board in a
    /// thread; a heater that it has, one that it has not, and a panic behind them.
    #[test]
    fn what_was_switched_on_goes_off_with_a_panic() {
        let folder = tempfile::tempdir().unwrap();
        let port = Port::Unix(folder.path().join("board"));
        let machine = Settings::default().machine;
        let setup = BoardSetup {
            switches: HomingConfiguration::none(),
            machine,
            session: 7,
            speed: 1.0,
            heat: HeatConfiguration::standard(),
            bed: VirtualBed::default(),
        };
        let listener = Listener::bind(&port).unwrap();
        let stop = AtomicBool::new(false);
        let is_on = AtomicBool::new(false);
        let args = PortArgs {
            port: port.to_string(),
            baud: 0,
        };
        std::thread::scope(|scope| {
            let board = scope.spawn(|| {
                let mut board = VirtualBoard::new(setup, listener).unwrap();
                let look = |board: &mut VirtualBoard| {
                    let heat = board.machine().motion().heat();
                    is_on.store(heat.is_on(), Ordering::Relaxed);
                };
                board.serve(&stop, look).unwrap();
                board.machine().motion().heat().is_on()
            });
            // A test that fails ends its board too: the scope waits for it.
            let ended = Ended(&stop);
            let console = Console::new(
                true,
                crate::cli::terminal::named_files::NamedFiles::default(),
            );
            let panicked = catch_unwind(AssertUnwindSafe(|| {
                let operator = Operator::new(&args, &console);
                let mut talk = Talk::open_for(&args, Some(&operator)).unwrap();
                talk.order(heat("bed", 60.0, false).unwrap()).unwrap();
                let before = operator.owner();
                assert!(talk.order(heat("2", 60.0, false).unwrap()).is_err());
                assert_eq!(operator.owner(), before);
                let patience = Instant::now() + Duration::from_secs(20);
                while !is_on.load(Ordering::Relaxed) {
                    assert!(Instant::now() < patience, "the bed was never on");
                    std::thread::yield_now();
                }
                panic!("what nobody expects");
            }));
            let words = panicked.unwrap_err();
            assert_eq!(words.downcast_ref(), Some(&"what nobody expects"));
            // The board's own state: it may be read later than its answer.
            drop(ended);
            assert!(!board.join().unwrap());
        });
    }

    /// Stops a board, however its test ends.
    struct Ended<'a>(&'a AtomicBool);

    impl Drop for Ended<'_> {
        fn drop(&mut self) {
            self.0.store(true, Ordering::Relaxed);
        }
    }
}
