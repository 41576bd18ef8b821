//! Why a board refuses new settings, with the place in them.

use serde::{Deserialize, Serialize};

/// An error of settings.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum SettingsProblem {
    /// The board has nowhere to keep settings.
    NoStore,
    /// A part is missing or out of order.
    Incomplete,
    /// The record's own CRC does not match.
    Damaged,
    /// The record has another version: `index` is the board's.
    Version,
    /// Section `index` cannot be read, is repeated, or is not known.
    Section,
    /// The number of joints (`index` are needed), or the tick rates if it is 0.
    Joints,
    /// A number of joint `index`; the extruder counts as the last one.
    Joint,
    /// A length or frame of the kinematics; with `index` 1, motors that do not fit the joints.
    Kinematics,
    /// A number of the switch of joint `index`.
    Switch,
    /// A number of heater `index`.
    Heater,
    /// The store failed: the previous settings stay active.
    NotStored,
    /// The input shaper of joint `index`.
    Shaper,
    /// This board cannot run them: it has `index` motors, and rates of its own; where `item` is 1, the settings are
    /// for another board.
    Board,
    /// A number of the driver of motor `index`.
    Driver,
    /// An input of joint `index`'s switch, or the emergency input.
    Wiring,
}

/// A refused number, rounded to f32; NaN for one that is not a number.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct RefusedNumber(pub f32);

impl PartialEq for RefusedNumber {
    fn eq(&self, other: &Self) -> bool {
        self.0.to_bits() == other.0.to_bits()
    }
}

impl Eq for RefusedNumber {}

/// A refusal of settings, with the place.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SettingsRefusal {
    /// The error.
    pub problem: SettingsProblem,
    /// Which section, joint or heater.
    pub index: u8,
    /// Index of the number, from 1 in the order of [`items`]; 0 if it is none of them.
    pub item: u8,
    /// The number that is refused; 0 where `item` is 0.
    pub value: RefusedNumber,
}

/// Names of the numbers that can be refused, as near to a machine file's as the board knows them.
pub const fn items(problem: SettingsProblem) -> &'static [&'static str] {
    match problem {
        SettingsProblem::Joint => &[
            "position_min",
            "speed_max",
            "acceleration_max",
            "jerk_max",
            "steps_per_unit",
            "pressure_advance_s",
            "pressure_advance_window_ms",
            "flow_loss",
            "advance",
        ],
        SettingsProblem::Switch => &[
            "fast speed",
            "slow speed",
            "back_off",
            "travel_max",
            "position",
        ],
        SettingsProblem::Heater => &[
            "limit_c",
            "sensor",
            "power_w",
            "loss_w_k",
            "fan_loss_w_k",
            "melt_j_mm3_k",
            "proportional",
            "integral",
            "derivative",
            "extrude_min_c",
        ],
        SettingsProblem::Shaper => &["frequency_hz", "damping"],
        SettingsProblem::Driver => &[
            "address",
            "sense_mohm",
            "run_ma",
            "hold_ma",
            "microsteps",
            "full steps times microsteps",
            "threshold",
            "motor",
        ],
        SettingsProblem::Wiring => &["switch input", "emergency input", "probe input"],
        _ => &[],
    }
}

impl SettingsRefusal {
    /// Which number is refused, by name.
    pub fn item_name(&self) -> Option<&'static str> {
        let place = usize::from(self.item).checked_sub(1)?;
        items(self.problem).get(place).copied()
    }
}

impl core::fmt::Display for SettingsRefusal {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        self.write_place(f)?;
        match self.item_name() {
            Some(name) => write!(f, ": {name} = {}", self.value.0),
            None => Ok(()),
        }
    }
}

impl SettingsRefusal {
    fn write_place(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let index = self.index;
        match self.problem {
            SettingsProblem::NoStore => f.write_str(
                "it has nowhere to keep settings; build its firmware for the machine (headway \
                 machine firmware)",
            ),
            SettingsProblem::Incomplete => {
                f.write_str("a part of the settings is missing; configure it again")
            }
            SettingsProblem::Damaged => f.write_str("the settings are damaged; configure it again"),
            SettingsProblem::Version => write!(
                f,
                "it reads settings of version {index}; use the headway of its firmware"
            ),
            SettingsProblem::Section => write!(
                f,
                "it cannot read section {index} of the settings; use the headway of its firmware"
            ),
            SettingsProblem::Joints if index == 0 => {
                f.write_str("the step rate must be a multiple of the servo rate, 65 to 256 times")
            }
            SettingsProblem::Joints => write!(f, "the kinematics need {index} joints"),
            SettingsProblem::Joint => write!(f, "a number of joint {index} is out of range"),
            SettingsProblem::Kinematics if index == 1 => f.write_str(
                "the motors do not fit the joints: a pair needs two linear joints with the same steps a mm",
            ),
            SettingsProblem::Kinematics => {
                f.write_str("a length or frame of the kinematics is out of range")
            }
            SettingsProblem::Switch => {
                write!(f, "a number of the switch of joint {index} is out of range")
            }
            SettingsProblem::Heater => write!(f, "a number of heater {index} is out of range"),
            SettingsProblem::Shaper => write!(f, "the shaper of joint {index} does not fit"),
            SettingsProblem::Board if self.item == 1 => f.write_str(
                "the machine file names another board than its firmware is for; correct `board` there",
            ),
            SettingsProblem::Board => write!(
                f,
                "it has {index} motors at most, and the step and servo rates of its own firmware"
            ),
            SettingsProblem::Wiring => write!(
                f,
                "the wiring does not fit (joint {index} where it is a switch): an input is missing on the \
                 board, taken twice, or without an interrupt"
            ),
            SettingsProblem::Driver => {
                write!(f, "a number of the driver of motor {index} does not fit")
            }
            SettingsProblem::NotStored => {
                f.write_str("its flash did not take the settings; those of before stay in force")
            }
        }
    }
}
