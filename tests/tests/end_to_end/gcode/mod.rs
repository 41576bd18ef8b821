mod awkward;
mod export;
mod heat_orders;
mod orca;
mod reading;
mod short_beads;
