//! Registers of a TMC2209: numbers, and the bits of configuration and status.
//!
//! Source: data sheet, chapter 5. Fields without a setting have the values that Klipper documents for this
//! chip (`toff` 3, `hstrt` 5, `hend` 0, `tbl` 2, the chip's own PWMCONF), which drive usual motors.

use crate::configuration::drivers::{Chopper, DriverConfiguration};

/// General configuration.
pub const GCONF: u8 = 0x00;
/// What has happened; a one clears.
pub const GSTAT: u8 = 0x01;
/// Counts accepted writes.
pub const IFCNT: u8 = 0x02;
/// Delay of replies.
pub const NODECONF: u8 = 0x03;
/// Pins, and the chip's version.
pub const IOIN: u8 = 0x06;
/// Currents.
pub const IHOLD_IRUN: u8 = 0x10;
/// Time until the hold current.
pub const TPOWERDOWN: u8 = 0x11;
/// Speed above which StealthChop is off.
pub const TPWMTHRS: u8 = 0x13;
/// Chopper.
pub const CHOPCONF: u8 = 0x6c;
/// The present fault.
pub const DRV_STATUS: u8 = 0x6f;
/// StealthChop.
pub const PWMCONF: u8 = 0x70;

/// GSTAT: it has restarted, so that its settings are lost,
pub const WAS_RESET: u32 = 1;
/// it switched off for heat or a short,
pub const DRIVER_ERROR: u32 = 1 << 1;
/// its charge pump has too little.
pub const LOW_SUPPLY: u32 = 1 << 2;
/// DRV_STATUS: warm,
pub const WARM: u32 = 1;
/// off for heat,
pub const HOT: u32 = 1 << 1;
/// shorts to ground and to the supply,
pub const SHORTS: u32 = 0b1111 << 2;
/// a coil that no current flows through,
pub const OPEN_LOADS: u32 = 0b11 << 6;
/// its motor stands still.
pub const STANDS: u32 = 1 << 31;

/// UART alone: the pin that is the wire does not switch it off, microsteps come from the register, and their
/// filter is on.
const BY_UART: u32 = 1 << 6 | 1 << 7 | 1 << 8;
const SPREAD: u32 = 1 << 2;
const TOFF_3_HSTRT_5_TBL_2: u32 = 3 | 5 << 4 | 2 << 15;
const FINE: u32 = 1 << 17;
const INTERPOLATES: u32 = 1 << 28;
/// As the chip has it after its start: amplitude and slope find themselves.
const PWM_DEFAULT: u32 = 0xc10d_0024;
/// From run to hold in steps of 8 x 2^18 clocks each, after 0.44 s.
pub(super) const HOLD_DELAY: u32 = 8 << 16;
pub(super) const POWER_DOWN: u32 = 20;
/// Replies begin 8 bit times after the request, longer than a pin takes to change direction.
const REPLY_DELAY: u32 = 2 << 8;

/// A write, and whether the chip lets it be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Setting {
    /// Register.
    pub register: u8,
    /// Its value.
    pub value: u32,
    /// Can be read back.
    pub is_readable: bool,
}

/// Settings of a driver.
pub const SETTINGS: usize = 7;

/// The writes, in order; `None` if no current range suffices.
pub fn settings(driver: &DriverConfiguration) -> Option<[Setting; SETTINGS]> {
    let scale = driver.current_scale()?;
    let spread = match driver.chopper {
        Chopper::Stealth => 0,
        Chopper::Spread => SPREAD,
    };
    // 256 microsteps are 0, 128 are 1, a full step is 8.
    let resolution = 8u32.checked_sub(driver.microsteps.checked_ilog2()?)?;
    let fine = if scale.fine { FINE } else { 0 };
    let interpolates = if driver.interpolates { INTERPOLATES } else { 0 };
    let chopper = TOFF_3_HSTRT_5_TBL_2 | fine | resolution << 24 | interpolates;
    let currents = u32::from(scale.hold) | u32::from(scale.run) << 8 | HOLD_DELAY;
    let write = |register, value, is_readable| Setting {
        register,
        value,
        is_readable,
    };
    Some([
        write(NODECONF, REPLY_DELAY, false),
        write(GCONF, BY_UART | spread, true),
        write(CHOPCONF, chopper, true),
        write(IHOLD_IRUN, currents, false),
        write(TPOWERDOWN, POWER_DOWN, false),
        write(TPWMTHRS, driver.spread_below_clocks, false),
        write(PWMCONF, PWM_DEFAULT, true),
    ])
}
