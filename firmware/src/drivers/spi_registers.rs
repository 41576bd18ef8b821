//! Registers of a TMC5160 and a TMC2240: numbers, settings, and their state in the TMC2209's bits.
//!
//! Source: data sheets (ADI, TMC5160A rev. 1.17, chapter 6; TMC2240 rev. 3, register map). Fields without a setting have
//! the values that Klipper documents for these chips (`toff` 3, `hstrt` 5, `hend` 2, `tbl` 2, `tpfd` 4), PWMCONF the
//! chip's own. Not covered: the TMC5160's motion controller, which stays off (`SD_MODE` high on modules).

use super::registers::{
    CHOPCONF, DRIVER_ERROR, GCONF, HOLD_DELAY, IHOLD_IRUN, LOW_SUPPLY, POWER_DOWN, PWMCONF,
    Setting, TPOWERDOWN, TPWMTHRS, WAS_RESET,
};
use crate::configuration::drivers::{Chopper, DriverConfiguration, DriverKind};

/// Pins, and the chip's version.
pub const IOIN: u8 = 0x04;
/// Of a TMC2240: its current range.
pub const DRV_CONF: u8 = 0x0a;
/// Share of the full current.
pub const GLOBALSCALER: u8 = 0x0b;
/// Of a TMC2240: its temperature.
pub const ADC_TEMP: u8 = 0x51;
/// All bits of GSTAT, of both.
pub const ALL_EVENTS: u32 = 0b1_1111;

const STEALTH: u32 = 1 << 2;
const FILTERS_STEPS: u32 = 1 << 3;
const TOFF_3_HSTRT_5_HEND_2_TBL_2_TPFD_4: u32 = 3 | 5 << 4 | 2 << 7 | 2 << 15 | 4 << 20;
const INTERPOLATES: u32 = 1 << 28;
/// From hold to run in steps of 4 x 2^9 clocks each.
const RUN_DELAY: u32 = 4 << 24;
/// As the chips have it after their start: amplitude and slope find themselves.
const PWM_5160: u32 = 0xc40c_001e;
const PWM_2240: u32 = 0xc44c_001d;

/// Settings of a driver.
pub const SETTINGS: usize = 8;

/// The writes, in order; `None` if no current range suffices.
pub fn settings(driver: &DriverConfiguration) -> Option<[Setting; SETTINGS]> {
    let current = driver.spi_current()?;
    let stealth = if driver.chopper == Chopper::Stealth {
        STEALTH
    } else {
        0
    };
    // 256 microsteps are 0, 128 are 1, a full step is 8.
    let resolution = 8u32.checked_sub(driver.microsteps.checked_ilog2()?)?;
    let interpolates = if driver.interpolates { INTERPOLATES } else { 0 };
    let chopper = TOFF_3_HSTRT_5_HEND_2_TBL_2_TPFD_4 | resolution << 24 | interpolates;
    let currents = u32::from(current.hold) | u32::from(current.run) << 8 | HOLD_DELAY;
    // The TMC5160 lets the first two be read alone; its DRV_CONF is for the transistors of its board, and stays.
    let has_range = driver.kind == DriverKind::Tmc2240;
    let write = |register, value, is_readable| Setting {
        register,
        value,
        is_readable,
    };
    let first = write(GCONF, stealth | FILTERS_STEPS, true);
    let range = write(DRV_CONF, current.range.into(), true);
    let (range, run_delay, pwm) = if has_range {
        (range, RUN_DELAY, PWM_2240)
    } else {
        (first, 0, PWM_5160)
    };
    Some([
        first,
        range,
        write(CHOPCONF, chopper, true),
        // 256 is written as 0.
        write(GLOBALSCALER, u32::from(current.global) & 0xff, has_range),
        write(IHOLD_IRUN, currents | run_delay, has_range),
        write(TPOWERDOWN, POWER_DOWN, has_range),
        write(TPWMTHRS, driver.spread_below_clocks, has_range),
        write(PWMCONF, pwm, has_range),
    ])
}

/// Where bits of these chips' DRV_STATUS are in the TMC2209's: warm, hot, shorts to ground and to the supply, open
/// loads, the current scale, StealthChop, standstill.
const STATE_BITS: [(u32, u32, u32); 8] = [
    (26, 0, 1),
    (25, 1, 1),
    (27, 2, 0b11),
    (12, 4, 0b11),
    (29, 6, 0b11),
    (16, 16, 0b1_1111),
    (14, 30, 1),
    (31, 31, 1),
];

/// DRV_STATUS as a TMC2209 has it.
pub fn state_as_2209(state: u32) -> u32 {
    let moved = |(from, to, mask): (u32, u32, u32)| (state >> from & mask) << to;
    STATE_BITS
        .into_iter()
        .fold(0, |all, bits| all | moved(bits))
}

/// GSTAT as a TMC2209 has it: of a TMC2240, bit 3 says that its registers were reset, 4 that its supply was too low.
pub fn events_as_2209(events: u32) -> u32 {
    events & (WAS_RESET | DRIVER_ERROR | LOW_SUPPLY)
        | events >> 3 & WAS_RESET
        | events >> 2 & LOW_SUPPLY
}

/// ADC_TEMP in °C: 7.7 steps each, 2038 at 0 °C.
pub fn celsius(reading: u32) -> i16 {
    ((((reading & 0x1fff) as i32) - 2038) * 10 / 77) as i16
}
