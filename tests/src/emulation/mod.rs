//! Images of the boards as they are flashed, in an emulator with a model of their chip behind it.
//!
//! [`board_image`] builds them, [`board_flash`] puts settings beside them, [`emulated_chip`] runs one in QEMU by its
//! [`debugger`] and answers each access that `thumb_access` finds by the [`register_model`].

pub mod board_flash;
pub mod board_image;
pub mod debugger;
pub mod emulated_chip;
pub mod register_model;
mod thumb_access;
