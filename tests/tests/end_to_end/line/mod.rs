//! The line between host and controller, and what goes wrong on it.

mod hostile;
mod properties;
mod streams;
mod two_hosts;
