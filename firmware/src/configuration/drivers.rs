//! Settings of each motor's driver: currents, microsteps, chopper.
//!
//! In: numbers of the machine file, mA rms, mΩ. Out: a checked configuration. The current of a scale is the
//! data sheet's (chapter 9): I = (CS + 1) / 32 V / (R + 20 mΩ) / √2, V = 325 mV, or 180 mV with the finer
//! range. Not covered: the motor's rating, and microsteps of a stand-alone driver, which its pins set.

use crate::configuration::MOTORS_MAX;
use heapless::Vec;
use serde::{Deserialize, Serialize};

/// Maximum current of a TMC2209, mA rms.
pub const CURRENT_MAX_MA: u16 = 2000;
/// Range of the sense resistor between driver and ground on boards and modules, mΩ.
pub const SENSE_RANGE_MOHM: core::ops::RangeInclusive<u16> = 50..=500;
/// Node addresses, set by two pins.
pub const ADDRESS_MAX: u8 = 3;
/// Steps of the scale.
const SCALES: u64 = 32;
/// The scale counts in 32nds of √2.
const SCALES_SQRT_2_MILLI: u64 = 45_255;
/// Full scale of the sense resistor, mV: coarse and fine.
const FULL_SCALE_MV: [u64; 2] = [325, 180];
/// Of the chip's own wires, mΩ.
const INSIDE_MOHM: u64 = 20;

/// How the coils are driven.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Chopper {
    /// Silent, by voltage: StealthChop2.
    Stealth,
    /// By current, cycle by cycle: stiffer at speed.
    Spread,
}

/// One motor's driver.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DriverConfiguration {
    /// Node address.
    pub address: u8,
    /// Sense resistor, mΩ.
    pub sense_mohm: u16,
    /// Current while it turns, mA rms.
    pub run_ma: u16,
    /// Current at standstill, mA rms.
    pub hold_ma: u16,
    /// Microsteps of a full step: a power of two up to 256.
    pub microsteps: u16,
    /// The driver interpolates them to 256.
    pub interpolates: bool,
    /// Full steps per mm, rad or mm³.
    pub full_steps_per_unit: f64,
    /// How the coils are driven.
    pub chopper: Chopper,
    /// SpreadCycle replaces StealthChop while a microstep of 1/256 takes fewer clocks of 12 MHz; 0: never.
    pub spread_below_clocks: u32,
}

/// Drivers in the motors' order; `None` for a stand-alone one.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct DriversConfiguration {
    /// At most one for each motor.
    pub drivers: Vec<Option<DriverConfiguration>, MOTORS_MAX>,
}

/// What of a driver cannot be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DriverItem {
    /// Node address above 3.
    Address,
    /// Sense resistor out of [`SENSE_RANGE_MOHM`].
    Sense,
    /// Run current 0, or above the range of driver and resistor.
    Run,
    /// Hold current above the run current.
    Hold,
    /// No power of two from 1 to 256.
    Microsteps,
    /// Full steps times microsteps are not the machine's steps.
    Steps,
    /// Beyond 20 bits.
    Threshold,
    /// A driver for a motor that is not there.
    Motor,
}

impl DriverItem {
    /// Its place among the items of a refusal, from 1.
    pub const fn number(self) -> u8 {
        match self {
            Self::Address => 1,
            Self::Sense => 2,
            Self::Run => 3,
            Self::Hold => 4,
            Self::Microsteps => 5,
            Self::Steps => 6,
            Self::Threshold => 7,
            Self::Motor => 8,
        }
    }
}

/// A number of a motor's driver that cannot be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WrongDriver {
    /// Motor, joints first, then the extruder.
    pub motor: usize,
    /// Which number.
    pub item: DriverItem,
    /// Its value.
    pub value: f64,
}

/// A current as the chip has it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CurrentScale {
    /// The finer range (`vsense`).
    pub fine: bool,
    /// `IRUN`, 0 to 31.
    pub run: u8,
    /// `IHOLD`, 0 to 31.
    pub hold: u8,
}

/// Scale + 1 of a current, rounded down: a motor never gets more than it was given.
fn scale_of(current_ma: u16, sense_mohm: u16, full_scale_mv: u64) -> u64 {
    let resistance_mohm = u64::from(sense_mohm) + INSIDE_MOHM;
    let whole = full_scale_mv * 1_000_000;
    (u64::from(current_ma) * SCALES_SQRT_2_MILLI * resistance_mohm)
        .checked_div(whole)
        .unwrap_or(0)
}

/// Current of this many steps of the scale, mA rms, rounded down.
fn current_of(steps: u64, sense_mohm: u16, full_scale_mv: u64) -> u16 {
    let resistance_mohm = u64::from(sense_mohm) + INSIDE_MOHM;
    let whole = SCALES_SQRT_2_MILLI * resistance_mohm;
    let current = (steps * full_scale_mv * 1_000_000)
        .checked_div(whole)
        .unwrap_or(0);
    current.min(u16::MAX.into()) as u16
}

/// Current of a scale, mA rms.
pub fn current_ma(scale: u8, fine: bool, sense_mohm: u16) -> u16 {
    let [coarse_mv, fine_mv] = FULL_SCALE_MV;
    let full_scale_mv = if fine { fine_mv } else { coarse_mv };
    current_of(u64::from(scale) + 1, sense_mohm, full_scale_mv)
}

/// Least and most run current with this sense resistor, mA rms.
pub fn run_range_ma(sense_mohm: u16) -> [u16; 2] {
    let [coarse_mv, fine_mv] = FULL_SCALE_MV;
    // The lowest step is rounded up: below it the scale would be 0.
    let least = current_of(1, sense_mohm, fine_mv).saturating_add(1);
    let most = current_of(SCALES, sense_mohm, coarse_mv);
    [least, most.min(CURRENT_MAX_MA)]
}

impl DriverConfiguration {
    /// The scales, in the finer range if it suffices; `None` if no range does, or the current is
    /// below the lowest scale.
    pub fn current_scale(&self) -> Option<CurrentScale> {
        let [coarse_mv, fine_mv] = FULL_SCALE_MV;
        let fits = |mv| {
            let full_ma = current_of(SCALES, self.sense_mohm, mv);
            scale_of(self.run_ma, self.sense_mohm, mv) >= 1 && self.run_ma <= full_ma
        };
        let fine = fits(fine_mv);
        let full_scale_mv = if fine { fine_mv } else { coarse_mv };
        if !fits(full_scale_mv) {
            return None;
        }
        let scale = |ma| scale_of(ma, self.sense_mohm, full_scale_mv).clamp(1, SCALES) as u8 - 1;
        Some(CurrentScale {
            fine,
            run: scale(self.run_ma),
            hold: scale(self.hold_ma),
        })
    }
}

impl DriversConfiguration {
    /// No driver for any motor.
    pub const fn none() -> Self {
        Self {
            drivers: Vec::new(),
        }
    }

    /// Whether there is nothing to set up.
    pub fn is_none(&self) -> bool {
        self.drivers.iter().all(Option::is_none)
    }
}
