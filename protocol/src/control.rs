//! Commands that overtake the stream, and the ranges of their fields.

use crate::segment::FlowAction;
use crate::units::{ChannelPoint, Ticks};
use serde::{Deserialize, Serialize};

/// Most motors that a report lists (joints, then the extruder).
pub const REPORT_MOTORS_MAX: usize = 8;
/// Feed override, per cent of the planned rate: the time warp permits up to 2.
pub const OVERRIDE_PERCENT_MAX: u16 = 200;
/// Flow override, per cent of the planned volume, as M108 meant it.
pub const FLOW_PERCENT_RANGE: core::ops::RangeInclusive<u16> = 10..=200;
/// Range of the period of status reports, ms.
pub const REPORT_PERIOD_RANGE_MS: core::ops::RangeInclusive<u16> = 20..=60_000;
/// Largest volume of one prime or retract, in the stream's unit: 1000 mm³ in base units.
pub const EVENT_VOLUME_UNITS_MAX: u32 = 1_000_000_000;
/// Heaters that a command can name.
pub const HEATERS_MAX: usize = 3;
/// Highest target that can be requested, tenths of a degree; the board's own limits are below it.
pub const DECIDEGREES_MAX: u16 = 5000;
/// Longest prime or retract: a minute at a 2 kHz servo.
pub const EVENT_DURATION_TICKS_MAX: u32 = 120_000;

/// Longest record of settings.
pub const SETTINGS_BYTES_MAX: usize = 2048;
/// Bytes of a settings record in one message.
pub const SETTINGS_PART_BYTES: usize = 32;

/// Commands that overtake the stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Control {
    /// Come to rest on the path.
    Pause,
    /// Go on after a pause.
    Resume,
    /// Feed override in per cent of the planned rate, 1..=[`OVERRIDE_PERCENT_MAX`].
    Override(u16),
    /// Come to rest on the path, then forget the stream.
    Abort,
    /// Stop immediately and latch a fault.
    EmergencyStop,
    /// Clear a latched fault.
    ClearFault,
    /// Ask for a `Status`; also the keep-alive.
    StatusRequest,
    /// Declare the present position (at rest only), channel units.
    SetPosition(ChannelPoint),
    /// Move one joint (at rest only).
    Jog {
        /// Joint from 0 in the kinematics' order.
        joint: u8,
        /// Distance, 0.1 µm or µrad.
        distance_units: i32,
        /// Speed, 0.1 µm/s or µrad/s, above 0.
        speed_units_s: u32,
    },
    /// Home these joints, one after the other (at rest only).
    Home(JointOrder),
    /// Declare where one joint is (at rest only).
    SetJoint {
        /// Joint from 0 in the kinematics' order.
        joint: u8,
        /// Position, 0.1 µm or µrad.
        position_units: i32,
    },
    /// Send a status this often, ms, of [`REPORT_PERIOD_RANGE_MS`].
    ReportPeriod(u16),
    /// Flow override in per cent of the planned volume, of [`FLOW_PERCENT_RANGE`].
    FlowOverride(u16),
    /// Prime or retract by hand (at rest only).
    Extrude {
        /// The direction.
        action: FlowAction,
        /// Volume, 10⁻⁶ mm³.
        volume_units: u32,
        /// Duration.
        duration_ticks: Ticks,
    },
    /// Move the referenced joints to a pose (at rest only), channel units: one joint after another,
    /// Z first if it rises and last if it lowers.
    GoTo(ChannelPoint),
    /// Let the motors go (at rest only): where they are is not known afterwards.
    MotorsOff,
    /// Heat, at any time; 0 switches off.
    Heat {
        /// Heater from 0.
        heater: u8,
        /// Target, tenths of a degree Celsius, up to [`DECIDEGREES_MAX`].
        decidegrees: u16,
        /// The stream rests until it is there.
        wait: bool,
    },
    /// Part fan in thousandths of its full speed.
    Fan(u16),
    /// New settings of the board follow in parts (at rest and cold only).
    SettingsBegin {
        /// Bytes of the whole record, 1..=[`SETTINGS_BYTES_MAX`].
        length: u16,
    },
    /// The next [`SETTINGS_PART_BYTES`] of them; zeros after the record's end.
    SettingsPart {
        /// Their place in the record: the parts are sent in order.
        offset: u16,
        /// The bytes.
        bytes: [u8; SETTINGS_PART_BYTES],
    },
    /// The settings are complete: check and store them. They take effect at the board's next start.
    SettingsEnd,
    /// Find where a referenced joint triggers the probe (at rest only): fast towards it, back, slowly
    /// again, and back. [`Status::probe`](crate::message::Status) reports it; the position is not
    /// changed.
    Probe {
        /// Joint from 0 in the kinematics' order.
        joint: u8,
        /// Maximum distance and its direction, 0.1 µm or µrad; its end must be in the joint's
        /// range.
        distance_units: i32,
        /// Speed of the search, 0.1 µm/s or µrad/s, above 0.
        fast_units_s: u32,
        /// Speed of the touch that counts, above 0.
        slow_units_s: u32,
        /// Distance back before that touch and after it, above 0.
        back_off_units: u32,
    },
    /// Move the pin of a probe that has one (at rest only).
    ProbePin(PinPosition),
    /// Allow the next stream or [`Control::Extrude`] to move melt while a hot end is too cold for it, until
    /// that ends; `false` ends it now.
    ExtrudeCold(bool),
    /// Begin to measure (`true`), or end it and report (`false`); for boards with a clock of their own.
    Measure(bool),
}

/// Command to the pin of a probe, given by the length of its pulses (BLTouch).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum PinPosition {
    /// In.
    #[default]
    Stow,
    /// Out.
    Deploy,
    /// Out and in ten times.
    SelfTest,
    /// In, and an alarm is forgotten.
    Reset,
}

/// Joints in an order, four bits each from the lowest up: joint + 1, 0 ends the list. Empty means
/// all joints that have a switch, in the machine's own order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct JointOrder(u32);

impl JointOrder {
    /// Most joints of an order.
    pub const JOINTS_MAX: usize = 8;

    /// All joints that have a switch, in the machine's own order.
    pub const ALL: Self = Self(0);

    /// These joints (from 0, each below [`REPORT_MOTORS_MAX`]), at most [`Self::JOINTS_MAX`] of
    /// them and without repetition; `None` otherwise.
    pub fn of(joints: &[u8]) -> Option<Self> {
        let mut packed = 0;
        for (place, &joint) in joints.iter().enumerate() {
            if place >= Self::JOINTS_MAX || usize::from(joint) >= REPORT_MOTORS_MAX {
                return None;
            }
            packed |= (u32::from(joint) + 1) << (4 * place);
        }
        let order = Self(packed);
        order.is_valid().then_some(order)
    }

    /// The joints, from 0, in their order.
    pub fn joints(self) -> impl Iterator<Item = u8> {
        (0..Self::JOINTS_MAX)
            .map(move |place| (self.0 >> (4 * place)) as u8 & 15)
            .take_while(|joint| *joint != 0)
            .map(|joint| joint - 1)
    }

    /// No repeated or invalid joint, nothing after the end.
    fn is_valid(self) -> bool {
        let (mut seen, mut places) = (0u16, 0);
        for joint in self.joints() {
            if usize::from(joint) >= REPORT_MOTORS_MAX || seen >> joint & 1 == 1 {
                return false;
            }
            seen |= 1 << joint;
            places += 1;
        }
        places == Self::JOINTS_MAX || self.0 >> (4 * places) == 0
    }
}

impl Control {
    /// True for commands that a machine accepts only at rest with no stream open.
    pub fn is_at_rest_only(&self) -> bool {
        matches!(
            self,
            Control::SetPosition(_)
                | Control::SetJoint { .. }
                | Control::Jog { .. }
                | Control::GoTo(_)
                | Control::Home(_)
                | Control::Extrude { .. }
                | Control::MotorsOff
                | Control::Probe { .. }
                | Control::ProbePin(_)
        ) || self.is_settings()
    }

    /// True for the messages that bring new settings.
    pub fn is_settings(&self) -> bool {
        matches!(
            self,
            Control::SettingsBegin { .. } | Control::SettingsPart { .. } | Control::SettingsEnd
        )
    }

    /// True if every field is in its range.
    pub(crate) fn is_valid(&self) -> bool {
        match *self {
            Control::Override(percent) => (1..=OVERRIDE_PERCENT_MAX).contains(&percent),
            Control::Jog {
                joint,
                speed_units_s,
                ..
            } => usize::from(joint) < REPORT_MOTORS_MAX && speed_units_s > 0,
            Control::Home(order) => order.is_valid(),
            Control::Probe {
                joint,
                fast_units_s,
                slow_units_s,
                back_off_units,
                ..
            } => {
                let speeds = fast_units_s > 0 && slow_units_s > 0;
                usize::from(joint) < REPORT_MOTORS_MAX && speeds && back_off_units > 0
            }
            Control::SetJoint { joint, .. } => usize::from(joint) < REPORT_MOTORS_MAX,
            Control::ReportPeriod(ms) => REPORT_PERIOD_RANGE_MS.contains(&ms),
            Control::Heat {
                heater,
                decidegrees,
                ..
            } => usize::from(heater) < HEATERS_MAX && decidegrees <= DECIDEGREES_MAX,
            Control::Fan(permille) => permille <= 1000,
            Control::FlowOverride(percent) => FLOW_PERCENT_RANGE.contains(&percent),
            Control::Extrude {
                volume_units,
                duration_ticks,
                ..
            } => {
                (1..=EVENT_VOLUME_UNITS_MAX).contains(&volume_units)
                    && (1..=EVENT_DURATION_TICKS_MAX).contains(&duration_ticks.0)
            }
            Control::SettingsBegin { length } => {
                (1..=SETTINGS_BYTES_MAX).contains(&usize::from(length))
            }
            Control::SettingsPart { offset, .. } => usize::from(offset) < SETTINGS_BYTES_MAX,
            Control::Pause
            | Control::SettingsEnd
            | Control::Resume
            | Control::Abort
            | Control::EmergencyStop
            | Control::ClearFault
            | Control::StatusRequest
            | Control::SetPosition(_)
            | Control::MotorsOff
            | Control::ProbePin(_)
            | Control::ExtrudeCold(_)
            | Control::Measure(_)
            | Control::GoTo(_) => true,
        }
    }
}
