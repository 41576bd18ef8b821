//! G-code read and written, against slicers' files and other interpreters.

mod awkward;
mod axes_round_trip;
mod controllers;
mod export;
mod following;
mod foreign_axes;
mod heat_orders;
mod orca;
mod plain_turns;
mod reading;
mod short_beads;
