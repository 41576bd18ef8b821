//! The controller: its drivers and heaters, its checks, its figures, an emulated core.

mod device_check;
mod drivers;
mod emulated;
mod figures;
mod measured;
mod spi_drivers;
mod thermal;
