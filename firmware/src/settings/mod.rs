//! Settings of a board that are not built in: the machine, its switches, its heaters.
//!
//! ```text
//! version u8 | section: tag u8, length u16 LE, postcard body | section | ... | CRC-32 u32 LE of all before it
//! ```
//! Why here: host and board check a record with the same code. In: bytes, at most [`SETTINGS_BYTES_MAX`].
//! Out: [`BoardSettings`] that can be run, or a [`SettingsRefusal`] with the place. A missing section
//! keeps the board's own, and only the machine is mandatory; an unknown one is refused, unless its tag
//! marks it as optional. `store` keeps a record in flash, `inbox` collects one from the line. Not covered:
//! the pin of an input, which the board defines.

pub mod inbox;
pub mod store;
#[cfg(test)]
mod tests;

use crate::configuration::MOTORS_MAX;
use crate::configuration::board_name::BoardName;
use crate::configuration::drivers::{DriverKind, DriversConfiguration};
use crate::configuration::flow_curves::FlowCurves;
use crate::configuration::heat::{EXTRUDE_MIN_C, HEATERS_MAX, HeatConfiguration};
use crate::configuration::homing::HomingConfiguration;
use crate::configuration::motors::MotorMatrix;
use crate::configuration::shaping::Shaper;
use crate::configuration::wiring::{BoardInputs, Wiring, WrongWiring};
use crate::configuration::{ConfigurationError, MachineConfiguration, WrongNumber};
use headway_protocol::frame::checksum;
use headway_protocol::message::RefusedNumber;
pub use headway_protocol::message::{SETTINGS_BYTES_MAX, SettingsProblem, SettingsRefusal};
use heapless::Vec;
use serde::{Deserialize, Serialize};

/// Layout of the record.
pub const SETTINGS_VERSION: u8 = 1;
/// [`MachineConfiguration`].
const MACHINE: u8 = 1;
/// [`HomingConfiguration`].
const SWITCHES: u8 = 2;
/// [`HeatConfiguration`].
const HEATERS: u8 = 3;
/// [`DriversConfiguration`].
const DRIVERS: u8 = 4;
/// [`Wiring`].
const WIRING: u8 = 5;
/// [`BoardName`].
const BOARD: u8 = 6;
/// [`MotorMatrix`], where motors are not the joints.
const MOTORS: u8 = 8;
/// `HomingConfiguration::marks`, where there are any.
const MARKS: u8 = 9;
/// `HomingConfiguration::hold`, where there is any: not to be skipped, an axis would fall.
const HOLD: u8 = 10;
/// [`FlowCurves`], where there are any: without them too little would be laid.
const CURVES: u8 = 11;
/// Types of the drivers, where one is no TMC2209: another chip has another meaning for the same registers.
const KINDS: u8 = 12;
/// Lowest temperatures at which melt may move: a board without this guard reads the rest.
const MELT: u8 = MAY_BE_SKIPPED | 7;
/// A section with this bit may be left alone by a board that does not know it.
const MAY_BE_SKIPPED: u8 = 0x80;
/// Tag and length.
const HEAD_BYTES: usize = 3;
const CRC_BYTES: usize = 4;

/// A record of settings.
pub type Record = Vec<u8, SETTINGS_BYTES_MAX>;

/// Limits of a board for all settings: with others it could not start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BoardLimits {
    /// Drivers that it has.
    pub motors_max: usize,
    /// Rates of its interrupts.
    pub servo_hz: u32,
    /// As above.
    pub step_hz: u32,
    /// Its inputs.
    pub inputs: BoardInputs,
    /// Names that settings for it may have.
    pub names: &'static [BoardName],
}

/// Settings that a board accepts without building its firmware.
#[derive(Clone, Debug, PartialEq)]
pub struct BoardSettings {
    /// Kinematics, joints, extruder, rates.
    pub machine: MachineConfiguration,
    /// Switches to home to.
    pub switches: HomingConfiguration,
    /// Heaters; `None` leaves the board's own.
    pub heaters: Option<HeatConfiguration>,
    /// Drivers that the board speaks with.
    pub drivers: DriversConfiguration,
    /// Roles of inputs, senses of motors.
    pub wiring: Wiring,
    /// The board that they are for; `None` if not given.
    pub board: Option<BoardName>,
}

impl BoardSettings {
    /// Checks everything, as the board does before it accepts them.
    ///
    /// # Errors
    /// The first number that is wrong.
    pub fn check(&self) -> Result<(), SettingsRefusal> {
        let machine = &self.machine;
        machine
            .check()
            .map_err(|error| of_machine(error, machine))?;
        self.switches.check(machine).map_err(|error| match error {
            ConfigurationError::Joint(joint) => self.wrong_switch(joint),
            other => of_machine(other, machine),
        })?;
        if let Some(heaters) = &self.heaters {
            heaters.check().map_err(|range| {
                let heater = heaters.heaters.get(range.0);
                let wrong = heater.and_then(|heater| heater.wrong());
                with_number(refusal(SettingsProblem::Heater, range.0), wrong)
            })?;
        }
        self.drivers.check(machine).map_err(|wrong| {
            let place = refusal(SettingsProblem::Driver, wrong.motor);
            with_number(place, Some((wrong.item.number(), wrong.value)))
        })?;
        let wired = self.wiring.check(machine);
        wired.map_err(|wrong| self.of_wiring(wrong))
    }

    fn of_wiring(&self, wrong: WrongWiring) -> SettingsRefusal {
        let (joint, item, input) = match wrong {
            WrongWiring::Switch(joint) => (joint, 1, self.wiring.switch_inputs.get(joint).copied()),
            WrongWiring::Emergency => (0, 2, self.wiring.emergency_input),
            WrongWiring::Probe => (0, 3, self.wiring.probe_input),
        };
        let number = input.map(|input| (item, f64::from(input)));
        with_number(refusal(SettingsProblem::Wiring, joint), number)
    }

    /// Where the switches of a joint are wrong.
    fn wrong_switch(&self, joint: usize) -> SettingsRefusal {
        let limits = self.machine.joints.get(joint);
        let mut switches = self.switches.joints.iter();
        let switch = switches.find(|switch| usize::from(switch.joint) == joint);
        let wrong = switch.zip(limits).and_then(|(switch, l)| switch.wrong(l));
        with_number(refusal(SettingsProblem::Switch, joint), wrong)
    }

    /// Whether a board can run them.
    ///
    /// # Errors
    /// `Board`, with the motors that it can have; with item 1 where the settings name another board.
    pub fn check_for(&self, board: &BoardLimits) -> Result<(), SettingsRefusal> {
        let machine = &self.machine;
        let suits = machine.motor_count() <= board.motors_max
            && (machine.servo_hz, machine.step_hz) == (board.servo_hz, board.step_hz);
        if !suits {
            return Err(refusal(SettingsProblem::Board, board.motors_max));
        }
        if let Some(name) = self.board
            && !board.names.contains(&name)
        {
            let place = refusal(SettingsProblem::Board, board.motors_max);
            return Err(with_number(place, Some((1, f64::from(name as u8)))));
        }
        let wired = self.wiring.check_for(machine, &board.inputs);
        wired.map_err(|wrong| self.of_wiring(wrong))
    }

    /// Checks them and writes the record.
    ///
    /// # Errors
    /// As for [`Self::check`]; `Section` for one that does not fit, although the largest machine
    /// does.
    pub fn encode(&self) -> Result<Record, SettingsRefusal> {
        self.check()?;
        let mut record = Record::new();
        let too_long = |_| refusal(SettingsProblem::Section, 0);
        record.push(SETTINGS_VERSION).map_err(too_long)?;
        section(&mut record, MACHINE, &self.machine.plain())?;
        if !self.machine.motors.is_direct() {
            section(&mut record, MOTORS, &self.machine.motors)?;
        }
        if !self.machine.curves.is_none() {
            section(&mut record, CURVES, &self.machine.curves)?;
        }
        section(&mut record, SWITCHES, &self.switches)?;
        if self.switches.marks != 0 {
            section(&mut record, MARKS, &self.switches.marks)?;
        }
        if self.switches.hold != 0 {
            section(&mut record, HOLD, &self.switches.hold)?;
        }
        if let Some(heaters) = &self.heaters {
            section(&mut record, HEATERS, heaters)?;
        }
        if let Some(melt) = self.heaters.as_ref().and_then(melt_of) {
            section(&mut record, MELT, &melt)?;
        }
        if !self.drivers.is_none() {
            section(&mut record, DRIVERS, &self.drivers)?;
        }
        if let Some(kinds) = self.drivers.kinds() {
            section(&mut record, KINDS, &kinds)?;
        }
        if self.wiring != Wiring::STANDARD {
            section(&mut record, WIRING, &self.wiring)?;
        }
        if let Some(name) = &self.board {
            section(&mut record, BOARD, name)?;
        }
        let crc = checksum(&[&record]).to_le_bytes();
        let no_room = refusal(SettingsProblem::Section, 0);
        record.extend_from_slice(&crc).map_err(|_| no_room)?;
        Ok(record)
    }

    /// The record's CRC, which identifies a board's settings; 0 if there can be none.
    pub fn hash(&self) -> u32 {
        self.encode().map_or(0, |record| record_hash(&record))
    }

    /// Reads a record and checks it.
    ///
    /// # Errors
    /// The error of the record, and its place.
    pub fn decode(record: &[u8]) -> Result<Self, SettingsRefusal> {
        let damaged = refusal(SettingsProblem::Damaged, 0);
        let (body, crc) = record.split_last_chunk::<CRC_BYTES>().ok_or(damaged)?;
        if checksum(&[body]) != u32::from_le_bytes(*crc) {
            return Err(damaged);
        }
        let (version, mut rest) = body.split_first().ok_or(damaged)?;
        if *version != SETTINGS_VERSION {
            return Err(refusal(SettingsProblem::Version, SETTINGS_VERSION.into()));
        }
        let (mut machine, mut switches): (_, Option<HomingConfiguration>) = (None, None);
        let mut heaters: Option<HeatConfiguration> = None;
        let (mut wiring, mut board, mut melt) = (None, None, None);
        let mut drivers: Option<DriversConfiguration> = None;
        let mut kinds: Option<[DriverKind; MOTORS_MAX]> = None;
        let mut motors: Option<MotorMatrix> = None;
        let mut curves: Option<FlowCurves> = None;
        let (mut marks, mut hold): (Option<u8>, Option<u8>) = (None, None);
        // Each round takes at least a head off a bounded record.
        while let Some((&[tag, low, high], behind)) = rest.split_first_chunk::<HEAD_BYTES>() {
            let wrong = refusal(SettingsProblem::Section, tag.into());
            let length = usize::from(u16::from_le_bytes([low, high]));
            let (content, after) = behind.split_at_checked(length).ok_or(wrong)?;
            match tag {
                MACHINE => once(&mut machine, content, wrong)?,
                SWITCHES => once(&mut switches, content, wrong)?,
                HEATERS => once(&mut heaters, content, wrong)?,
                DRIVERS => once(&mut drivers, content, wrong)?,
                WIRING => once(&mut wiring, content, wrong)?,
                BOARD => once(&mut board, content, wrong)?,
                MOTORS => once(&mut motors, content, wrong)?,
                CURVES => once(&mut curves, content, wrong)?,
                MARKS => once(&mut marks, content, wrong)?,
                HOLD => once(&mut hold, content, wrong)?,
                KINDS => once(&mut kinds, content, wrong)?,
                MELT => once(&mut melt, content, wrong)?,
                _ if tag & MAY_BE_SKIPPED != 0 => {}
                _ => return Err(wrong),
            }
            rest = after;
        }
        if !rest.is_empty() {
            return Err(damaged);
        }
        let mut machine: MachineConfiguration =
            machine.ok_or(refusal(SettingsProblem::Section, MACHINE.into()))?;
        machine.motors = motors.unwrap_or_default();
        machine.curves = curves.unwrap_or_default();
        if let (Some(heaters), Some(melt)) = (&mut heaters, melt) {
            set_melt(heaters, &melt);
        }
        let mut drivers = drivers.unwrap_or_default();
        if let Some(kinds) = kinds
            && !drivers.set_kinds(&kinds)
        {
            return Err(refusal(SettingsProblem::Section, KINDS.into()));
        }
        let mut switches = switches.unwrap_or_else(|| HomingConfiguration::standard(&machine));
        switches.marks = marks.unwrap_or_default();
        switches.hold = hold.unwrap_or_default();
        let settings = Self {
            switches,
            machine,
            heaters,
            drivers,
            wiring: wiring.unwrap_or_default(),
            board,
        };
        settings.check()?;
        Ok(settings)
    }
}

/// `extrude_min_c` of each heater, where one is not the usual.
fn melt_of(heaters: &HeatConfiguration) -> Option<[f32; HEATERS_MAX]> {
    let mut melt = [EXTRUDE_MIN_C; HEATERS_MAX];
    for (least_c, heater) in melt.iter_mut().zip(&heaters.heaters) {
        *least_c = heater.extrude_min_c;
    }
    (melt != [EXTRUDE_MIN_C; HEATERS_MAX]).then_some(melt)
}

fn set_melt(heaters: &mut HeatConfiguration, melt: &[f32; HEATERS_MAX]) {
    for (heater, least_c) in heaters.heaters.iter_mut().zip(melt) {
        heater.extrude_min_c = *least_c;
    }
}

/// CRC of a record that was checked.
pub fn record_hash(record: &[u8]) -> u32 {
    let crc = record.last_chunk::<CRC_BYTES>();
    crc.map_or(0, |crc| u32::from_le_bytes(*crc))
}

/// Appends a section.
fn section<T: Serialize>(record: &mut Record, tag: u8, value: &T) -> Result<(), SettingsRefusal> {
    let no_room = refusal(SettingsProblem::Section, tag.into());
    let mut content = [0u8; SETTINGS_BYTES_MAX];
    let content = postcard::to_slice(value, &mut content).map_err(|_| no_room)?;
    let [low, high] = (content.len() as u16).to_le_bytes();
    let head = record.extend_from_slice(&[tag, low, high]);
    head.and_then(|()| record.extend_from_slice(content))
        .map_err(|_| no_room)
}

/// Reads a section into its place, which must be empty yet.
fn once<'a, T: Deserialize<'a>>(
    place: &mut Option<T>,
    content: &'a [u8],
    wrong: SettingsRefusal,
) -> Result<(), SettingsRefusal> {
    let (value, rest) = postcard::take_from_bytes(content).map_err(|_| wrong)?;
    if !rest.is_empty() || place.replace(value).is_some() {
        return Err(wrong);
    }
    Ok(())
}

pub(crate) fn refusal(problem: SettingsProblem, index: usize) -> SettingsRefusal {
    SettingsRefusal {
        problem,
        index: index.min(u8::MAX.into()) as u8,
        item: 0,
        value: RefusedNumber(0.0),
    }
}

/// With the number that is refused.
fn with_number(place: SettingsRefusal, wrong: Option<WrongNumber>) -> SettingsRefusal {
    match wrong {
        Some((item, value)) => SettingsRefusal {
            item,
            value: RefusedNumber(value as f32),
            ..place
        },
        None => place,
    }
}

fn of_machine(error: ConfigurationError, machine: &MachineConfiguration) -> SettingsRefusal {
    match error {
        ConfigurationError::JointCount { needed, .. } => refusal(SettingsProblem::Joints, needed),
        ConfigurationError::TickRates => refusal(SettingsProblem::Joints, 0),
        ConfigurationError::Joint(joint) => {
            let of_joint = machine.joints.get(joint).and_then(|joint| joint.wrong());
            let wrong = of_joint.or_else(|| machine.wrong_extruder());
            with_number(refusal(SettingsProblem::Joint, joint), wrong)
        }
        ConfigurationError::Shaper(joint) => {
            let wrong = machine.shapers.get(joint).map(Shaper::wrong_number);
            with_number(refusal(SettingsProblem::Shaper, joint), wrong)
        }
        ConfigurationError::Kinematics => refusal(SettingsProblem::Kinematics, 0),
        ConfigurationError::Motors => refusal(SettingsProblem::Kinematics, 1),
    }
}
