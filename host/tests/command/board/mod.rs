//! Boards by the command: streamed to, asked, commanded, calibrated, watched; images in the emulator.

mod analyser;
mod board_crash;
mod board_pins;
mod board_stop;
mod calibrate;
mod full_disk;
mod heat_ends;
mod hosts_of_a_board;
mod live;
mod orders;
mod page_attack;
mod probe;
mod registers;
mod resume;
mod sensor;
mod stream;
