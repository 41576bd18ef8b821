//! Settings of each motor's driver: currents, microsteps, chopper.
//!
//! In: numbers of the machine file, mA rms, mΩ. Out: a checked configuration. The current of a scale is the
//! data sheet's (chapter 9): I = (CS + 1) / 32 V / (R + 20 mΩ) / √2, V = 325 mV, or 180 mV with the finer
//! range; with SPI I = GLOBALSCALER / 256 (CS + 1) / 32 F / √2, F = 325 mV / R of a TMC5160, and 11.75, 24 or 36 kV / R
//! of a TMC2240, whose R is a reference (data sheets, "Selecting sense resistors", "Setting the full-scale current
//! range"). Not covered: the motor's rating, and microsteps of a stand-alone driver, which its pins set.

use crate::configuration::MOTORS_MAX;
use heapless::Vec;
use serde::{Deserialize, Serialize};

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

/// Least and most of GLOBALSCALER.
const GLOBAL_MIN: u64 = 32;
const GLOBAL_MAX: u64 = 256;
/// √2.
const SQRT_2_MICRO: u64 = 1_414_214;

/// Type of a driver. The order is that of the record.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum DriverKind {
    /// With a one-wire UART.
    #[default]
    Tmc2209,
    /// With SPI, and transistors and sense resistors on its board.
    Tmc5160,
    /// With SPI, and a reference resistor.
    Tmc2240,
}

impl DriverKind {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Tmc2209, Self::Tmc5160, Self::Tmc2240];

    /// As a machine file has it, the version in IOIN's top byte, the range of [`DriverConfiguration::sense_mohm`] on
    /// boards and modules with the usual one behind it, and the greatest current, mA rms (of a TMC5160 its board's).
    pub const fn numbers(self) -> (&'static str, u8, [u16; 3], u16) {
        match self {
            Self::Tmc2209 => ("tmc2209", 0x21, [50, 500, 110], 2000),
            Self::Tmc5160 => ("tmc5160", 0x30, [20, 500, 75], 10_000),
            Self::Tmc2240 => ("tmc2240", 0x40, [12_000, 60_000, 12_000], 2121),
        }
    }

    /// Spoken with over SPI.
    pub const fn has_spi(self) -> bool {
        !matches!(self, Self::Tmc2209)
    }

    /// Full currents of the ranges, µA rms.
    fn full_ua(self, sense: u16) -> [u64; 3] {
        let rms_ua = |micro: u64| {
            let peak_ua = micro.checked_div(sense.into()).unwrap_or(0);
            peak_ua * 1_000_000 / SQRT_2_MICRO
        };
        match self {
            Self::Tmc2209 | Self::Tmc5160 => [rms_ua(325_000_000); 3],
            Self::Tmc2240 => [11_750_000_000, 24_000_000_000, 36_000_000_000].map(rms_ua),
        }
    }
}

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
    /// Sense resistor, mΩ; of a TMC2240 its reference resistor, Ω.
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
    /// Its type, which has a section of its own in a record.
    #[serde(skip)]
    pub kind: DriverKind,
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
    /// Sense resistor out of [`DriverKind::numbers`].
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

/// A current as a chip with SPI has it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SpiCurrent {
    /// `current_range` of a TMC2240, 0 to 2.
    pub range: u8,
    /// `GLOBALSCALER`, 32 to 256.
    pub global: u16,
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

/// Least and most run current of a driver with this sense resistor, mA rms.
pub fn run_range_ma(kind: DriverKind, sense_mohm: u16) -> [u16; 2] {
    if kind.has_spi() {
        let [finest_ua, _, full_ua] = kind.full_ua(sense_mohm);
        // The lowest step is rounded up: below it the scale would be 0.
        let least = finest_ua * GLOBAL_MIN / (GLOBAL_MAX * SCALES * 1000) + 1;
        let most = (full_ua / 1000).min(kind.numbers().3.into());
        return [least, most].map(|ma| ma as u16);
    }
    let [coarse_mv, fine_mv] = FULL_SCALE_MV;
    // The lowest step is rounded up: below it the scale would be 0.
    let least = current_of(1, sense_mohm, fine_mv).saturating_add(1);
    let most = current_of(SCALES, sense_mohm, coarse_mv);
    [least, most.min(kind.numbers().3)]
}

impl DriverConfiguration {
    /// The current of a chip with SPI, rounded down, in the finest range that suffices; `None` if none does, or the
    /// current is below the lowest. The scale is as coarse as can be, which StealthChop needs.
    pub fn spi_current(&self) -> Option<SpiCurrent> {
        let run_ua = 1000 * u64::from(self.run_ma);
        let hold_ua = 1000 * u64::from(self.hold_ma);
        let ranges = self.kind.full_ua(self.sense_mohm);
        let range = ranges.iter().position(|full_ua| run_ua <= *full_ua)?;
        let full_ua = ranges.get(range).copied()?.max(1);
        let global = (run_ua * GLOBAL_MAX / full_ua).clamp(GLOBAL_MIN, GLOBAL_MAX);
        let scale = |ua: u64| {
            let steps = (ua * GLOBAL_MAX * SCALES).checked_div(full_ua * global);
            steps.unwrap_or(0)
        };
        let run = scale(run_ua).min(SCALES).checked_sub(1)?;
        let hold = scale(hold_ua).min(SCALES).saturating_sub(1);
        Some(SpiCurrent {
            range: range as u8,
            global: global as u16,
            run: run as u8,
            hold: hold as u8,
        })
    }

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

    /// Types of the drivers, where one is no TMC2209.
    pub fn kinds(&self) -> Option<[DriverKind; MOTORS_MAX]> {
        let mut kinds = [DriverKind::default(); MOTORS_MAX];
        for (kind, driver) in kinds.iter_mut().zip(&self.drivers) {
            *kind = driver.map_or_else(DriverKind::default, |driver| driver.kind);
        }
        (kinds != [DriverKind::default(); MOTORS_MAX]).then_some(kinds)
    }

    /// Sets them; false if one is of a motor without a driver.
    pub fn set_kinds(&mut self, kinds: &[DriverKind; MOTORS_MAX]) -> bool {
        for (driver, kind) in self.drivers.iter_mut().zip(kinds) {
            if let Some(driver) = driver {
                driver.kind = *kind;
            }
        }
        self.kinds().as_ref() == Some(kinds)
    }

    /// Whether there is nothing to set up.
    pub fn is_none(&self) -> bool {
        self.drivers.iter().all(Option::is_none)
    }
}
