//! G-code read and written, against slicers' files and other interpreters.

mod awkward;
mod controllers;
mod export;
mod following;
mod heat_orders;
mod orca;
mod planned_again;
mod reading;
mod short_beads;
