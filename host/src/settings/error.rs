//! Why settings cannot be used: each with its key as the machine file spells it, and what would fit.

use super::check::{NAME_CHARS_MAX, RISE_MAX_S};
use crate::text::short_number::Short;
use headway_firmware::configuration::ConfigurationError;
use headway_firmware::steps::{INTERVAL_TICKS_MAX, INTERVAL_TICKS_MIN};

/// Settings that cannot be used, with the key as the machine file spells it.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SettingsError {
    /// A number of a heater is out of its range.
    #[error("heaters.{key}: a number is not finite, negative, or above 500 °C")]
    Heater {
        /// Key of the heater.
        key: &'static str,
    },
    /// A fan's pulses on a board without an input for them.
    #[error(
        "heaters.fan_tells_turns: the firmware of {board} counts no pulses of a fan, which would count as stalled: \
         leave the key out"
    )]
    FanTurns {
        /// The board's name.
        board: &'static str,
    },
    /// A number of a driver does not fit.
    #[error("drivers.{motor}: {item} is {}; {remedy}", Short(*value))]
    Driver {
        /// Motor by name.
        motor: &'static str,
        /// Which number.
        item: &'static str,
        /// What was given.
        value: f64,
        /// What would fit.
        remedy: String,
    },
    /// The head's profile is none.
    #[error("head.profile: {reason}; give [height_mm, radius_mm] pairs from the tip upwards")]
    HeadProfile {
        /// What is wrong.
        reason: String,
    },
    /// Inputs that cannot be.
    #[error(
        "wiring.{key} is {input}: inputs are numbered from 0 to 15 as the board has them, and the emergency input \
         is no switch"
    )]
    Wiring {
        /// Which one.
        key: String,
        /// What was given.
        input: u8,
    },
    /// A number of a switch does not fit.
    #[error(
        "switches.{joint}: {item} is {}; speeds are above 0 and at most the joint's speed_max, ways above 0, and \
         the position is a place: the end of the joint's range, unless it is given",
        Short(*value)
    )]
    Switch {
        /// Joint by name.
        joint: &'static str,
        /// Which number.
        item: &'static str,
        /// What was given.
        value: f64,
    },
    /// A number that must be finite and positive is not.
    #[error("{key} is {}, but must be finite and greater than 0", Short(*value))]
    NotPositive {
        /// Key of the machine file.
        key: String,
        /// What was given.
        value: f64,
    },
    /// A number below its range.
    #[error("{key} is {}, but must be at least {}", Short(*value), Short(*low))]
    TooSmall {
        /// Key of the machine file.
        key: String,
        /// What was given.
        value: f64,
        /// The least possible.
        low: f64,
    },
    /// A number above its range.
    #[error("{key} is {}, but must be at most {}", Short(*value), Short(*high))]
    TooLarge {
        /// Key of the machine file.
        key: String,
        /// What was given.
        value: f64,
        /// The most possible.
        high: f64,
    },
    /// Layers higher than any bead is wide.
    #[error(
        "print.layer_height_mm (--layer-height) is {}, but a bead of this aperture is at most {} mm wide: give lower layers, or \
         a wider nozzle (--aperture; sizes are full ones, in mm)",
        Short(*height_mm), Short(*widest_mm)
    )]
    HighLayers {
        /// What was given.
        height_mm: f64,
        /// The widest bead.
        widest_mm: f64,
    },
    /// Corners of waypoints rounded by more than a bead.
    #[error(
        "--corner-tolerance {} (tolerances.corner_mm): write a length in mm from 0, which leaves corners as they are, to {}, the \
         widest bead of this aperture; 0.2 is usual",
        Short(*given_mm), Short(*widest_mm)
    )]
    CornerTolerance {
        /// What was given.
        given_mm: f64,
        /// Width of the widest bead.
        widest_mm: f64,
    },
    /// A limit so low that what it changes takes for ever to reach its own limit.
    #[error(
        "{key} is so low that it takes {rise_s:.0} s to reach {of}, more than {RISE_MAX_S} s: raise \
         the one or lower the other"
    )]
    SlowRise {
        /// Key of the machine file.
        key: String,
        /// Key of what it would reach.
        of: String,
        /// How long that takes.
        rise_s: f64,
    },
    /// A machine's name that is no name.
    #[error(
        "the machine's name has {problem}: give it up to {NAME_CHARS_MAX} printable characters"
    )]
    Name {
        /// What is wrong with it.
        problem: String,
    },
    /// A layer cannot be both.
    #[error(
        "print.layer_time_max_s is {}, below print.layer_time_min_s = {}: raise the one or lower the other",
        Short(*most_s), Short(*least_s)
    )]
    LayerTimes {
        /// Least time.
        least_s: f64,
        /// Most time.
        most_s: f64,
    },
    /// A pump that does not run backwards, with primes and retracts.
    #[error(
        "flow.pump_start_mm and flow.pump_stop_mm are of pumps that start and stop slowly and do not run backwards: \
         set flow.prime_mm3 and flow.retract_mm3 to 0 beside them"
    )]
    PumpAndPrime,
    /// Low end not below the high end.
    #[error("{key}: the lower end {} must be below the upper end {}", Short(*low), Short(*high))]
    EmptyRange {
        /// Key of the machine file.
        key: String,
        /// Lower end.
        low: f64,
        /// Upper end.
        high: f64,
    },
    /// The kinematics has another number of joints.
    #[error("kinematics {kinematics} has {needed} joints, but {given} are given")]
    JointCount {
        /// Kinematics by name.
        kinematics: &'static str,
        /// Joints needed.
        needed: usize,
        /// Joints given.
        given: usize,
    },
    /// A motor steps faster than the step tick can.
    #[error(
        "{motor} makes {rate_hz:.0} steps/s at its top speed, more than 90 % of step_hz = {step_hz}: \
         lower its speed_max or its steps (microsteps), or raise step_hz"
    )]
    StepRate {
        /// Joint or extruder by name.
        motor: String,
        /// Step rate at top speed.
        rate_hz: f64,
        /// Step tick rate.
        step_hz: u32,
    },
    /// The controller cannot run it.
    #[error("the controller cannot run this machine: {0}")]
    Controller(#[from] ConfigurationError),
    /// Step and servo ticks do not fit.
    #[error(
        "step_hz = {step_hz} must be a whole multiple of servo_hz = {servo_hz}, \
         {INTERVAL_TICKS_MIN} to {INTERVAL_TICKS_MAX} times"
    )]
    TickRates {
        /// Servo rate.
        servo_hz: u32,
        /// Step rate.
        step_hz: u32,
    },
    /// A limit of the print asks more than a part of the machine gives.
    #[error("{key} is {}, more than the {} of {limit_key}", Short(*value), Short(*limit))]
    Beyond {
        /// Key of what asks.
        key: &'static str,
        /// What it asks.
        value: f64,
        /// Key of what limits.
        limit_key: &'static str,
        /// What it gives.
        limit: f64,
    },
    /// The work area leaves a joint's range.
    #[error(
        "work_area {axis} runs from {low} to {high} mm, beyond the joint's range {min} to {max} mm"
    )]
    WorkArea {
        /// Axis by name.
        axis: &'static str,
        /// Work area.
        low: f64,
        /// Work area.
        high: f64,
        /// Joint range.
        min: f64,
        /// Joint range.
        max: f64,
    },
}
