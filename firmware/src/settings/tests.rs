//! Goal: settings are received completely or refused with the place, and after a power failure at any byte
//! of storing them the old or the new ones are valid. Method: records with one thing wrong; a flash model
//! that fails after a given number of bytes erased or written, for every such number, and is read by a new
//! store; frames through the whole controller.

use super::store::{SLOT_BYTES_MIN, SettingsStore, StoreError};
use super::*;
use crate::board::built_in::{built_in_planar, emulated_planar};
use crate::configuration::board_name::BoardName;
use crate::configuration::drivers::{Chopper, DriverConfiguration, DriverKind};
use crate::configuration::shaping::ShaperKind;
use crate::machine::Machine;
use embedded_storage::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};
use headway_protocol::frame::{FRAME_BYTES_MAX, FrameDecoder, encode_frame};
use headway_protocol::message::{
    Control, DeviceMessage, Hello, HostMessage, PROTOCOL_VERSION, RefusalReason, SCHEMA_HASH,
    SETTINGS_PART_BYTES,
};
use std::vec;
use std::vec::Vec as StdVec;

const ERASE_BYTES: usize = 4096;
const BOARD: BoardLimits = BoardLimits {
    motors_max: 5,
    servo_hz: 2000,
    step_hz: 200_000,
    inputs: BoardInputs {
        count: 9,
        emergency: 8,
        emergency_mask: 0x1ff,
    },
    names: &[BoardName::Octopus10, BoardName::Octopus11],
};

/// Two sectors of NOR flash: erasing sets bits, a word is programmed once, and the power may fail.
#[derive(Clone)]
struct FlashModel {
    bytes: StdVec<u8>,
    /// Bytes that may still be erased or programmed before the power is cut.
    left: usize,
}

#[derive(Debug)]
struct PowerCut;

impl NorFlashError for PowerCut {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

impl ErrorType for FlashModel {
    type Error = PowerCut;
}

impl ReadNorFlash for FlashModel {
    const READ_SIZE: usize = 1;
    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), PowerCut> {
        let offset = offset as usize;
        bytes.copy_from_slice(&self.bytes[offset..offset + bytes.len()]);
        Ok(())
    }
    fn capacity(&self) -> usize {
        self.bytes.len()
    }
}

impl NorFlash for FlashModel {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = ERASE_BYTES;
    fn erase(&mut self, from: u32, to: u32) -> Result<(), PowerCut> {
        for byte in &mut self.bytes[from as usize..to as usize] {
            self.left = self.left.checked_sub(1).ok_or(PowerCut)?;
            *byte = 0xff;
        }
        Ok(())
    }
    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), PowerCut> {
        let place = offset as usize;
        for (cell, byte) in self.bytes[place..].iter_mut().zip(bytes) {
            self.left = self.left.checked_sub(1).ok_or(PowerCut)?;
            assert_eq!(*cell, 0xff, "a word is programmed once");
            *cell = *byte;
        }
        Ok(())
    }
}

fn flash() -> FlashModel {
    FlashModel {
        // As it comes out of another use.
        bytes: vec![0x5a; 2 * ERASE_BYTES],
        left: usize::MAX,
    }
}

fn settings(machine: MachineConfiguration) -> BoardSettings {
    BoardSettings {
        switches: HomingConfiguration::standard(&machine),
        machine,
        heaters: Some(HeatConfiguration::standard()),
        drivers: DriversConfiguration::none(),
        wiring: Wiring::STANDARD,
        board: None,
    }
}

#[test]
fn a_power_cut_at_any_byte_leaves_the_old_or_the_new_record_whole() {
    let [old, new] = [built_in_planar(), emulated_planar()].map(|m| settings(m).encode().unwrap());
    let mut store = SettingsStore::new(flash()).unwrap();
    assert_eq!(store.take(), None);
    store.put(&old).unwrap();
    let before = store.into_flash();
    let (mut kept_old, mut kept_new) = (0, 0);
    for cut in 0.. {
        let mut flash = before.clone();
        flash.left = cut;
        let mut store = SettingsStore::new(flash).unwrap();
        let put = store.put(&new);
        let mut flash = store.into_flash();
        flash.left = usize::MAX;
        let mut store = SettingsStore::new(flash).unwrap();
        let found = store.take().unwrap();
        if put.is_ok() {
            assert_eq!(found, new);
            kept_new += 1;
            break;
        }
        assert!(found == old || found == new, "cut after {cut} bytes");
        kept_old += usize::from(found == old);
        // What was left half done is no hindrance.
        store.put(&new).unwrap();
        assert_eq!(store.take().unwrap(), new);
    }
    assert_eq!(kept_new, 1);
    let bytes = ERASE_BYTES + new.len();
    assert!(kept_old > bytes, "{kept_old} cuts of at least {bytes}");
}

#[test]
fn records_take_turns_and_a_flash_that_cannot_hold_one_is_told() {
    let mut store = SettingsStore::new(flash()).unwrap();
    for round in 0..5u8 {
        let record = [round; 77];
        store.put(&record).unwrap();
        assert_eq!(store.take().unwrap(), record);
    }
    assert_eq!(store.put(&[]), Err(StoreError::Unsuitable));
    assert_eq!(store.put(&[0; 2049]), Err(StoreError::Unsuitable));
    let mut small = flash();
    small.bytes.truncate(2 * SLOT_BYTES_MIN - 2);
    assert!(matches!(
        SettingsStore::new(small),
        Err(StoreError::Unsuitable)
    ));
}

#[test]
fn a_record_comes_back_and_what_is_wrong_with_one_is_told_with_its_place() {
    let right = settings(built_in_planar());
    let record = right.encode().unwrap();
    assert_eq!(BoardSettings::decode(&record).unwrap(), right);
    for place in 0..record.len() {
        let mut flipped = record.clone();
        flipped[place] ^= 0x10;
        assert!(BoardSettings::decode(&flipped).is_err(), "byte {place}");
        assert!(BoardSettings::decode(&record[..place]).is_err());
    }
    let wrong = |change: fn(&mut BoardSettings), problem, index, number: (u8, f32)| {
        let mut settings = right.clone();
        change(&mut settings);
        let refused = SettingsRefusal {
            item: number.0,
            value: RefusedNumber(number.1),
            ..refusal(problem, index)
        };
        assert_eq!(settings.encode(), Err(refused));
        // The board says the same of a record that nobody checked.
        assert_eq!(BoardSettings::decode(&unchecked(&settings)), Err(refused));
        refused
    };
    wrong(
        |s| s.machine.joints[1].speed_max = f64::NAN,
        SettingsProblem::Joint,
        1,
        (2, f32::NAN),
    );
    let told = wrong(
        |s| s.machine.joints[2].steps_per_unit = 40_000.5,
        SettingsProblem::Joint,
        2,
        (5, 40_000.5),
    );
    let text = std::format!("{told}");
    assert!(
        text.ends_with("joint 2 is out of range: steps_per_unit = 40000.5"),
        "{text}"
    );
    wrong(
        |s| s.machine.extruder.pressure_advance_s = -0.5,
        SettingsProblem::Joint,
        4,
        (6, -0.5),
    );
    let none = (0, 0.0);
    wrong(|s| s.machine.step_hz += 1, SettingsProblem::Joints, 0, none);
    wrong(
        |s| s.machine.joints.truncate(3),
        SettingsProblem::Joints,
        4,
        none,
    );
    wrong(
        |s| s.switches.joints[2].fast_natural_s = 1e9,
        SettingsProblem::Switch,
        1,
        (1, 1e9),
    );
    wrong(
        |s| {
            s.machine.shapers[0] = Shaper {
                kind: ShaperKind::Zv,
                frequency_hz: 2e6,
                damping: 0.1,
            };
        },
        SettingsProblem::Shaper,
        0,
        (1, 2e6),
    );
    let cold = |s: &mut BoardSettings| s.heaters.as_mut().unwrap().heaters[1].limit_c = -1.0;
    wrong(cold, SettingsProblem::Heater, 1, (1, -1.0));
}

#[test]
fn sections_may_be_left_out_or_skipped_but_are_not_doubled_or_unknown() {
    let right = settings(built_in_planar());
    let build = |tags: &[u8]| {
        let mut record = Record::new();
        record.push(SETTINGS_VERSION).unwrap();
        for tag in tags {
            match *tag {
                SWITCHES => section(&mut record, SWITCHES, &right.switches).unwrap(),
                other => section(&mut record, other, &right.machine).unwrap(),
            }
        }
        sealed(record)
    };
    let alone = BoardSettings::decode(&build(&[MACHINE, 0x85])).unwrap();
    assert_eq!(alone.heaters, None);
    assert_eq!(alone.switches, right.switches);
    for (tags, index) in [
        (&[MACHINE, MACHINE][..], MACHINE),
        (&[MACHINE, 9], 9),
        (&[SWITCHES], MACHINE),
    ] {
        let refused = Err(refusal(SettingsProblem::Section, index.into()));
        assert_eq!(BoardSettings::decode(&build(tags)), refused, "{tags:?}");
    }
    let mut other = Record::new();
    other.push(9).unwrap();
    let refused = Err(refusal(SettingsProblem::Version, 1));
    assert_eq!(BoardSettings::decode(&sealed(other)), refused);
}

fn sealed(mut record: Record) -> Record {
    let crc = checksum(&[&record]).to_le_bytes();
    record.extend_from_slice(&crc).unwrap();
    record
}

fn unchecked(settings: &BoardSettings) -> Record {
    let mut record = Record::new();
    record.push(SETTINGS_VERSION).unwrap();
    section(&mut record, MACHINE, &settings.machine).unwrap();
    section(&mut record, SWITCHES, &settings.switches).unwrap();
    section(&mut record, HEATERS, settings.heaters.as_ref().unwrap()).unwrap();
    if !settings.drivers.is_none() {
        section(&mut record, DRIVERS, &settings.drivers).unwrap();
    }
    sealed(record)
}

/// A controller and its host.
struct Line {
    machine: Machine,
    sequence: u16,
    stored: StdVec<StdVec<u8>>,
    flash_works: bool,
}

impl Line {
    fn new(keeps: bool) -> Self {
        let mut machine = Machine::new(&built_in_planar(), 7).unwrap();
        if keeps {
            machine.keep_settings(BOARD);
        }
        let mut line = Self {
            machine,
            sequence: 0,
            stored: vec![],
            flash_works: true,
        };
        let hello = HostMessage::Hello(Hello {
            protocol_version: PROTOCOL_VERSION,
            schema_hash: SCHEMA_HASH,
            host_session: 3,
        });
        assert_eq!(line.say(&hello), None);
        line
    }

    /// Why the message is refused; every one must be answered.
    fn say(&mut self, message: &HostMessage) -> Option<RefusalReason> {
        let mut out = [0u8; FRAME_BYTES_MAX];
        let length = encode_frame(self.sequence, message, &mut out).unwrap();
        self.machine.handle_bytes(&out[..length]);
        let (stored, works) = (&mut self.stored, self.flash_works);
        self.machine.store_first_settings(|record| {
            stored.push(record.to_vec());
            works
        });
        let (mut answers, mut refused) = (0, None);
        let mut decoder = FrameDecoder::new();
        loop {
            let length = self.machine.poll_report(&mut out);
            if length == 0 {
                break;
            }
            for byte in &out[..length] {
                let Some(Ok(frame)) = decoder.push(*byte) else {
                    continue;
                };
                match DeviceMessage::decode(frame.payload).unwrap() {
                    DeviceMessage::Refused(refusal) => {
                        assert_eq!(refusal.sequence, self.sequence);
                        refused = Some(refusal.reason);
                        answers += 1;
                    }
                    DeviceMessage::Ack(_) | DeviceMessage::Welcome(_) => answers += 1,
                    _ => {}
                }
            }
        }
        assert!(answers > 0, "{message:?} is answered");
        self.sequence += 1;
        refused
    }

    fn order(&mut self, control: Control) -> Option<RefusalReason> {
        self.say(&HostMessage::Control(control))
    }

    /// Uploads a record up to its end.
    fn upload(&mut self, record: &[u8]) -> Option<RefusalReason> {
        let length = record.len() as u16;
        let begun = self.order(Control::SettingsBegin { length });
        if begun.is_some() {
            return begun;
        }
        for (number, part) in record.chunks(SETTINGS_PART_BYTES).enumerate() {
            let mut bytes = [0; SETTINGS_PART_BYTES];
            bytes[..part.len()].copy_from_slice(part);
            let offset = (number * SETTINGS_PART_BYTES) as u16;
            assert_eq!(self.order(Control::SettingsPart { offset, bytes }), None);
        }
        self.order(Control::SettingsEnd)
    }
}

fn because(problem: SettingsProblem, index: usize) -> Option<RefusalReason> {
    Some(RefusalReason::Settings(refusal(problem, index)))
}

#[test]
fn an_upload_is_stored_once_or_refused_with_its_reason() {
    let right = settings(emulated_planar());
    let record = right.encode().unwrap();
    let mut line = Line::new(true);
    assert_eq!(line.upload(&record), None);
    assert_eq!(line.stored, [record.to_vec()]);
    let incomplete = because(SettingsProblem::Incomplete, 0);
    assert_eq!(line.order(Control::SettingsEnd), incomplete, "it is gone");
    line.order(Control::SettingsBegin { length: 100 });
    let bytes = [0; SETTINGS_PART_BYTES];
    assert_eq!(
        line.order(Control::SettingsPart { offset: 32, bytes }),
        incomplete
    );
    assert_eq!(line.order(Control::SettingsPart { offset: 0, bytes }), None);
    assert_eq!(line.order(Control::SettingsEnd), incomplete);
    let mut wrong = right.clone();
    wrong.machine.joints[2].steps_per_unit = -1.0;
    let refused = SettingsRefusal {
        item: 5,
        value: RefusedNumber(-1.0),
        ..refusal(SettingsProblem::Joint, 2)
    };
    assert_eq!(
        line.upload(&unchecked(&wrong)),
        Some(RefusalReason::Settings(refused))
    );
    // One motor more than the board has, and steps too fast for it, right as they are.
    let beyond = because(SettingsProblem::Board, 5);
    let mut wide = right.clone();
    wide.machine.kinematics = crate::configuration::Kinematics::Gantry {
        pivot_length_mm: 50.0,
    };
    let rotary = wide.machine.joints[3];
    wide.machine.joints.extend([rotary; 2]);
    assert_eq!(line.upload(&wide.encode().unwrap()), beyond);
    let mut fast = right.clone();
    fast.machine.step_hz = 400_000;
    assert_eq!(line.upload(&fast.encode().unwrap()), beyond);
    let damaged = because(SettingsProblem::Damaged, 0);
    assert_eq!(line.upload(&record[1..]), damaged);
    assert_eq!(line.stored.len(), 1, "nothing of these was stored");
    line.flash_works = false;
    assert_eq!(line.upload(&record), because(SettingsProblem::NotStored, 0));
    let mut without = Line::new(false);
    assert_eq!(
        without.upload(&record),
        because(SettingsProblem::NoStore, 0)
    );
    assert!(without.stored.is_empty());
}

#[test]
fn a_machine_that_moves_takes_no_settings() {
    let record = settings(emulated_planar()).encode().unwrap();
    let mut line = Line::new(true);
    let jog = Control::Jog {
        joint: 0,
        distance_units: 100_000,
        speed_units_s: 100_000,
    };
    assert_eq!(line.order(jog), None);
    assert_eq!(line.upload(&record), Some(RefusalReason::Busy));
    assert!(line.stored.is_empty());
}

/// A driver that makes the built-in machine's X steps.
fn driver() -> DriverConfiguration {
    DriverConfiguration {
        address: 0,
        sense_mohm: 110,
        run_ma: 800,
        hold_ma: 400,
        microsteps: 16,
        interpolates: true,
        full_steps_per_unit: 5.0,
        chopper: Chopper::Stealth,
        spread_below_clocks: 0,
        kind: DriverKind::Tmc2209,
    }
}

#[test]
fn drivers_come_back_and_their_wrong_numbers_are_told() {
    let mut right = settings(built_in_planar());
    let bare = right.encode().unwrap();
    right.drivers.drivers.push(Some(driver())).unwrap();
    right.drivers.drivers.push(None).unwrap();
    let record = right.encode().unwrap();
    assert_eq!(BoardSettings::decode(&record).unwrap(), right);
    assert_ne!(bare, record);
    let with = |change: fn(&mut DriverConfiguration), item, value: f32| {
        let mut settings = right.clone();
        change(settings.drivers.drivers[0].as_mut().unwrap());
        let refused = SettingsRefusal {
            item,
            value: RefusedNumber(value),
            ..refusal(SettingsProblem::Driver, 0)
        };
        assert_eq!(settings.encode(), Err(refused));
        assert_eq!(BoardSettings::decode(&unchecked(&settings)), Err(refused));
    };
    with(|d| d.address = 4, 1, 4.0);
    with(|d| d.sense_mohm = 11, 2, 11.0);
    // The data sheet's table: 0.11 ohm give 1.77 A at most.
    with(|d| d.run_ma = 1800, 3, 1800.0);
    with(|d| d.run_ma = 0, 3, 0.0);
    with(|d| d.hold_ma = 801, 4, 801.0);
    with(|d| d.microsteps = 24, 5, 24.0);
    with(|d| d.microsteps = 0, 5, 0.0);
    with(|d| d.microsteps = 32, 6, 160.0);
    with(|d| d.full_steps_per_unit = f64::NAN, 6, f32::NAN);
    with(|d| d.spread_below_clocks = 1 << 20, 7, 1_048_576.0);
    for _ in 0..3 {
        right.drivers.drivers.push(None).unwrap();
    }
    right.drivers.drivers.push(Some(driver())).unwrap();
    let refused = SettingsRefusal {
        item: 8,
        value: RefusedNumber(5.0),
        ..refusal(SettingsProblem::Driver, 5)
    };
    assert_eq!(right.encode(), Err(refused), "the machine has five motors");
}

#[test]
fn types_of_drivers_come_back_and_are_no_part_of_records_without_one() {
    let mut right = settings(built_in_planar());
    right.drivers.drivers.push(None).unwrap();
    right.drivers.drivers.push(Some(driver())).unwrap();
    let section_of = |record: &[u8]| record.windows(3).any(|head| head == [KINDS, 8, 0]);
    assert!(
        !section_of(&right.encode().unwrap()),
        "an older board reads it"
    );
    for (kind, run_ma, sense_mohm) in [
        (DriverKind::Tmc5160, 3000, 75),
        (DriverKind::Tmc2240, 2100, 12_000),
    ] {
        let other = right.drivers.drivers[1].as_mut().unwrap();
        (other.kind, other.run_ma, other.sense_mohm) = (kind, run_ma, sense_mohm);
        let record = right.encode().unwrap();
        assert!(section_of(&record));
        assert_eq!(BoardSettings::decode(&record).unwrap(), right);
        let mut wrong = right.clone();
        wrong.drivers.drivers[1].as_mut().unwrap().sense_mohm = 19;
        let refused = wrong.encode().map_err(|error| (error.index, error.item));
        assert_eq!(refused, Err((1, 2)), "{kind:?}");
        let mut wrong = right.clone();
        wrong.drivers.drivers[1].as_mut().unwrap().run_ma = 3100;
        let refused = wrong.encode().map_err(|error| (error.index, error.item));
        assert_eq!(refused, Err((1, 3)), "{kind:?}");
    }
    // A type for a motor without a driver.
    let mut kinds = DriversConfiguration::none();
    kinds.drivers.push(None).unwrap();
    assert!(!kinds.set_kinds(&[DriverKind::Tmc2240; MOTORS_MAX]));
}

#[test]
fn wiring_comes_back_and_what_a_board_has_not_is_told() {
    let mut right = settings(built_in_planar());
    right.wiring.reversed_motors = 0b10;
    right.wiring.emergency_input = Some(7);
    right.wiring.open_inputs = 1 << 8;
    right.wiring.switch_inputs[2] = 8;
    let record = right.encode().unwrap();
    assert_eq!(BoardSettings::decode(&record).unwrap(), right);
    assert_eq!(right.check_for(&BOARD), Ok(()));
    let refused = |item, joint, value: f32| {
        Err(SettingsRefusal {
            item,
            value: RefusedNumber(value),
            ..refusal(SettingsProblem::Wiring, joint)
        })
    };
    right.wiring.emergency_input = Some(8);
    assert_eq!(right.check(), refused(1, 2, 8.0), "Z has it");
    right.wiring.emergency_input = Some(12);
    assert_eq!(right.check(), Ok(()));
    assert_eq!(right.check_for(&BOARD), refused(2, 0, 12.0));
    right.wiring.emergency_input = Some(16);
    assert_eq!(right.check(), refused(2, 0, 16.0));
}

#[test]
fn settings_name_their_board_and_another_one_refuses_them() {
    let unnamed = settings(built_in_planar());
    for name in BoardName::ALL {
        let named = BoardSettings {
            board: Some(name),
            ..unnamed.clone()
        };
        let record = named.encode().unwrap();
        assert_eq!(BoardSettings::decode(&record).unwrap(), named);
        let fits = BOARD.names.contains(&name);
        let refused = SettingsRefusal {
            item: 1,
            value: RefusedNumber(f32::from(name as u8)),
            ..refusal(SettingsProblem::Board, BOARD.motors_max)
        };
        let expected = if fits { Ok(()) } else { Err(refused) };
        assert_eq!(named.check_for(&BOARD), expected, "{name:?}");
        assert!(std::format!("{refused}").contains("another board"));
    }
    // A record without a name is as it was before there were names.
    let record = unnamed.encode().unwrap();
    assert_eq!(BoardSettings::decode(&record).unwrap().board, None);
    assert_eq!(unnamed.check_for(&BOARD), Ok(()));
}

/// Goal: from where melt may move comes back with the heaters, and a record of a machine that does not say
/// is as it was before there was such a thing. Method: records with and without; a wrong number.
#[test]
fn where_melt_may_move_comes_back_and_is_no_part_of_records_that_do_not_say() {
    let mut asked = settings(built_in_planar());
    let usual = asked.encode().unwrap();
    if let Some(heaters) = &mut asked.heaters {
        heaters.heaters[0].extrude_min_c = 140.0;
    }
    let record = asked.encode().unwrap();
    // Tag, length, three numbers.
    assert_eq!(record.len(), usual.len() + 3 + 12);
    assert_eq!(BoardSettings::decode(&record), Ok(asked.clone()));
    assert_eq!(asked.machine.hash(), built_in_planar().hash());
    for wrong in [-1.0, 501.0, f32::NAN] {
        if let Some(heaters) = &mut asked.heaters {
            heaters.heaters[0].extrude_min_c = wrong;
        }
        let refused = asked.encode().unwrap_err();
        assert_eq!(refused.problem, SettingsProblem::Heater);
        assert_eq!(refused.item_name(), Some("extrude_min_c"), "{wrong}");
    }
}
