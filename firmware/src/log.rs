//! Logs for a developer at the board, under the feature `defmt`: faults, states, link events.
//!
//! All are written from the receiver, and so from the main loop: no interrupt waits for a log.

/// As `defmt::info!`; nothing without the feature.
macro_rules! log_event {
    ($($argument:tt)*) => {
        #[cfg(feature = "defmt")]
        defmt::info!($($argument)*)
    };
}
