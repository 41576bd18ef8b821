//! Watches and controls a print from a page on this machine.
//!
//! ```text
//! stream's loop --Snapshot (try_lock)--> Board of the page --GET status--> page
//! stream's loop <--Control (8 at most)-- orders            <--POST order-- page
//! ```
//! Why here: only `cli` does IO. The streaming loop never waits for a page: a snapshot that cannot be stored at once
//! is dropped (the next one comes in 0.1 s), and commands wait in a queue with 8 places; when it is full the page
//! gets an error. A stop does not queue. A server that ends with any fault does not affect the stream: the loop
//! continues and reports it once. Not covered: a page on another machine.

// Without the feature nothing makes a [`LivePrint`]; the loop that would use it is the same.
#![cfg_attr(not(feature = "page"), allow(dead_code))]

#[cfg(feature = "page")]
mod access;
#[cfg(feature = "page")]
mod connections;
pub(crate) mod live_page;
pub(crate) mod orders;
#[cfg(feature = "page")]
mod server;
#[cfg(feature = "page")]
mod service;

use headway_protocol::message::Control;
use serde::Serialize;
use std::cell::RefCell;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError, TryLockError};
use std::thread::JoinHandle;
use std::time::Instant;

#[cfg(feature = "page")]
pub(crate) use server::serve;

/// Refuses: there is no server in this build.
#[cfg(not(feature = "page"))]
pub(crate) fn serve(_page: String, _port: u16) -> Result<LivePrint, crate::cli::error::CliError> {
    Err(crate::cli::error::CliError::Usage(
        "--view: this build of headway has no page; build it with its default features, or with \
         `--features page`"
            .to_string(),
    ))
}

/// Orders that wait for the stream's loop.
const ORDERS_MAX: usize = 8;

/// A page's data about the print.
#[derive(Clone, Debug, Default, Serialize)]
pub(crate) struct Snapshot {
    /// What the board does; empty before it has answered.
    pub state: String,
    /// The line is there.
    pub line_open: bool,
    /// Share of the job's time that is done, 0..=1.
    pub done: f64,
    /// Time left at the present rate; `None` while the head rests.
    pub left_s: Option<f64>,
    /// Layer from 0, and how many there are.
    pub layer: u32,
    pub layers: u32,
    /// Pass from 0.
    pub pass: Option<u32>,
    /// The tip, machine coordinates, and its speed.
    pub at_mm: [f32; 3],
    pub tip_mm_s: f64,
    pub override_percent: u16,
    /// The operator's, and what a sensor's program makes of the flow in addition, a share.
    pub flow_percent: u16,
    pub flow_correction: Option<f64>,
    /// `{celsius, target_celsius, duty}` for each heater that the board has.
    pub heaters: Vec<serde_json::Value>,
    pub fan_percent: f64,
    pub queue_knots: u16,
    /// The last message, a refusal or a fault.
    pub said: String,
    /// Why the log can no longer be written, from then on.
    pub log_problem: Option<String>,
    /// How it ended.
    pub ended: Option<String>,
}

/// Why a command is not accepted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum NotTaken {
    /// Too many wait.
    Full,
    /// The print is over.
    Over,
}

/// What the loop and the server share.
struct Shared {
    snapshot: Mutex<(Snapshot, Instant)>,
    stop: AtomicBool,
    orders: SyncSender<Control>,
}

impl Shared {
    fn snapshot(&self) -> (Snapshot, Instant) {
        let held = self.snapshot.lock();
        held.unwrap_or_else(PoisonError::into_inner).clone()
    }

    fn order(&self, control: Control) -> Result<(), NotTaken> {
        if control == Control::EmergencyStop {
            self.stop.store(true, Ordering::Relaxed);
            return Ok(());
        }
        self.orders.try_send(control).map_err(|error| match error {
            TrySendError::Full(_) => NotTaken::Full,
            TrySendError::Disconnected(_) => NotTaken::Over,
        })
    }
}

/// The loop's end of it.
pub(crate) struct LivePrint {
    shared: Arc<Shared>,
    orders: Receiver<Control>,
    /// Where the page is.
    pub url: String,
    /// The server's, until its end was reported.
    thread: RefCell<Option<JoinHandle<std::io::Result<()>>>>,
}

impl LivePrint {
    /// Leaves a snapshot for the pages, or leaves it out.
    pub(crate) fn publish(&self, snapshot: &Snapshot) {
        let mut held = match self.shared.snapshot.try_lock() {
            Ok(held) => held,
            Err(TryLockError::Poisoned(poisoned)) => poisoned.into_inner(),
            Err(TryLockError::WouldBlock) => return,
        };
        *held = (snapshot.clone(), Instant::now());
    }

    /// The last snapshot: nothing waits for this one any more.
    pub(crate) fn publish_last(&self, snapshot: &Snapshot) {
        let held = self.shared.snapshot.lock();
        *held.unwrap_or_else(PoisonError::into_inner) = (snapshot.clone(), Instant::now());
    }

    /// A stop that a page requested, once.
    pub(crate) fn stop(&self) -> bool {
        self.shared.stop.swap(false, Ordering::Relaxed)
    }

    /// Why the server has ended, once: pages can no longer watch or command.
    pub(crate) fn server_problem(&self) -> Option<String> {
        let thread = self
            .thread
            .borrow_mut()
            .take_if(|thread| thread.is_finished())?;
        Some(match thread.join() {
            Ok(Ok(())) => "it ended".to_string(),
            Ok(Err(error)) => error.to_string(),
            Err(_) => "a fault of its own".to_string(),
        })
    }

    /// The next order.
    pub(crate) fn order(&self) -> Option<Control> {
        self.orders.try_recv().ok()
    }
}

fn shared() -> (Arc<Shared>, Receiver<Control>) {
    let (sender, orders) = sync_channel(ORDERS_MAX);
    let shared = Shared {
        snapshot: Mutex::new((Snapshot::default(), Instant::now())),
        stop: AtomicBool::new(false),
        orders: sender,
    };
    (Arc::new(shared), orders)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Goal: a page can never hold the loop up or fill memory. Method: a thread holds the lock, orders
    /// come without anybody taking them.
    #[test]
    fn a_held_lock_and_a_full_channel_hold_nothing_up() {
        let (shared, orders) = shared();
        let print = LivePrint {
            shared: shared.clone(),
            orders,
            url: String::new(),
            thread: RefCell::default(),
        };
        let held = shared.snapshot.lock().unwrap();
        print.publish(&Snapshot {
            layer: 7,
            ..Snapshot::default()
        });
        drop(held);
        assert_eq!(shared.snapshot().0.layer, 0);
        for _ in 0..ORDERS_MAX {
            assert_eq!(shared.order(Control::Pause), Ok(()));
        }
        assert_eq!(shared.order(Control::Pause), Err(NotTaken::Full));
        // A stop goes by all that wait.
        assert_eq!(shared.order(Control::EmergencyStop), Ok(()));
        assert!(print.stop() && !print.stop());
        assert_eq!(std::iter::from_fn(|| print.order()).count(), ORDERS_MAX);
        drop(print);
        assert_eq!(shared.order(Control::Pause), Err(NotTaken::Over));
    }
    /// Goal: a server that panics ends alone, and its end is reported once. Method: its thread panics while it
    /// holds what it shares with the loop, which then goes on with all that it does.
    #[test]
    fn a_server_that_panics_ends_alone_and_is_reported_once() {
        let (shared, orders) = shared();
        shared.order(Control::Pause).unwrap();
        shared.order(Control::EmergencyStop).unwrap();
        let at_server = shared.clone();
        let thread = std::thread::spawn(move || {
            let _held = at_server.snapshot.lock().unwrap();
            panic!("on purpose");
        });
        while !thread.is_finished() {
            std::thread::yield_now();
        }
        let print = LivePrint {
            shared: shared.clone(),
            orders,
            url: String::new(),
            thread: RefCell::new(Some(thread)),
        };
        assert!(print.server_problem().is_some());
        assert_eq!(print.server_problem(), None);
        let snapshot = Snapshot {
            layer: 7,
            ..Snapshot::default()
        };
        print.publish(&snapshot);
        assert_eq!(shared.snapshot().0.layer, 7);
        assert!(print.stop());
        assert_eq!(print.order(), Some(Control::Pause));
        print.publish_last(&snapshot);
    }
}
