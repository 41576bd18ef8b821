//! The line between host and controller, and what goes wrong on it.

mod flow_loop;
mod hostile;
mod properties;
mod streams;
mod two_hosts;
