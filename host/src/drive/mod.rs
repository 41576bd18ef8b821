//! Moves finished segments (sender, link, simulator) and checks the result. Never imports `plan`.

mod board_lines;
pub mod device_check;
pub mod dry_run;
pub mod evenness;
mod extruder_losses;
mod extruder_use;
pub mod flow_correction;
pub mod heat_owner;
pub mod host_clock;
pub mod joint_track;
pub mod laid_beads;
pub mod layer_control;
pub mod link;
pub mod link_log;
pub mod log_place;
mod melt;
pub mod moment;
mod motor_volume;
pub mod patience;
pub mod pause_heat;
pub mod plan_curve;
pub mod pump;
pub mod record;
pub mod relay_tuning;
pub mod round_trip;
pub mod sender;
pub mod sender_state;
pub mod servo_walk;
mod shaped_plan;
pub mod simulator;
pub mod stream_progress;
pub mod synced_file;
pub mod time_by_limit;
pub mod trace;
pub mod trace_table;
pub mod transport;
pub mod virtual_board;
pub mod virtual_drivers;
pub mod virtual_heaters;
pub mod virtual_spi_driver;

#[cfg(test)]
mod cut_tests;
#[cfg(test)]
pub(crate) mod test_streams;
