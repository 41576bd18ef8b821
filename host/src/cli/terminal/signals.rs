//! Signals to a command: Ctrl-C is counted, SIGTERM and SIGHUP end it.
//!
//! Only commands that have to clean up before they end catch them, and only while that is so. A console that closes
//! sends SIGHUP; a command that was started to outlive it (`nohup`) keeps ignoring that. Not covered: a console
//! that closes on Windows, where the process ends before anything can be done.

use std::sync::Once;
use std::sync::atomic::{AtomicUsize, Ordering};

/// How often Ctrl-C was pressed since the process began.
static INTERRUPTS: AtomicUsize = AtomicUsize::new(0);

/// The signals received since it was created.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Signals {
    interrupts_before: usize,
}

/// From now on Ctrl-C is only counted, and signals that would end the process are only noted.
pub(crate) fn catch() -> Signals {
    static CAUGHT: Once = Once::new();
    // One that comes while they are being caught counts.
    let interrupts_before = INTERRUPTS.load(Ordering::Relaxed);
    CAUGHT.call_once(|| {
        // If it cannot be caught, Ctrl-C ends the program as usual; the board comes to rest.
        let _ = ctrlc::set_handler(|| {
            INTERRUPTS.fetch_add(1, Ordering::Relaxed);
        });
        endings::catch();
    });
    Signals { interrupts_before }
}

impl Signals {
    /// How often Ctrl-C was pressed.
    pub(crate) fn interrupts(&self) -> usize {
        INTERRUPTS.load(Ordering::Relaxed) - self.interrupts_before
    }

    /// The command is to end: SIGTERM or SIGHUP was received, which is sent only once.
    pub(crate) fn is_to_end(&self) -> bool {
        endings::came()
    }
}

#[cfg(unix)]
mod endings {
    use signal_hook::consts::{SIGHUP, SIGTERM};
    use signal_hook::flag::register;
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::sync::{Arc, LazyLock};

    static CAME: LazyLock<Arc<AtomicBool>> = LazyLock::new(Arc::default);

    pub(crate) fn catch() {
        for signal in [SIGTERM, SIGHUP] {
            if !is_ignored(signal) {
                // As with Ctrl-C.
                let _ = register(signal, CAME.clone());
            }
        }
    }

    pub(crate) fn came() -> bool {
        CAME.load(Ordering::Relaxed)
    }

    /// True if the parent process has made this one ignore a signal; only Linux tells.
    fn is_ignored(signal: i32) -> bool {
        let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
        let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
        let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
        mask.unwrap_or(0) >> (signal - 1) & 1 == 1
    }
}

#[cfg(not(unix))]
mod endings {
    pub(crate) fn catch() {}

    pub(crate) fn came() -> bool {
        false
    }
}
