//! Goal: the driver makes the accesses to the flash controller that ST's manual requires, in that order, and
//! reports the controller's errors. Method: a model of the controller by RM0390 section 3, which locks up at
//! a wrong key, sets the manual's error flags at a wrong sequence, stays busy for a while, and has a data
//! cache that keeps read values; the settings' store runs on it, and its power is cut.

use super::*;
use crate::board::octopus::SETTINGS_SECTORS;
use crate::settings::store::SettingsStore;
use std::collections::BTreeMap;
use std::vec;
use std::vec::Vec;

/// The Octopus's sectors.
const SECTOR_BYTES: [usize; 2] = [16 * 1024, 128 * 1024];
const SEQUENCE_ERROR: u32 = 1 << 7;
const PARALLELISM_ERROR: u32 = 1 << 6;
const WRITE_PROTECTION_ERROR: u32 = 1 << 4;

/// The controller with the sectors that it may change.
#[derive(Clone)]
struct Controller {
    memory: [Vec<u8>; 2],
    cached: BTreeMap<u32, u32>,
    access: u32,
    control: u32,
    state: u32,
    keys_taken: usize,
    /// Locked until a reset.
    is_dead: bool,
    /// Looks until it is no longer busy, and how many each operation takes.
    busy_looks: u32,
    looks: u32,
    /// Operations until the power fails.
    operations_left: usize,
    write_protected: bool,
    erased: Vec<u32>,
}

impl Controller {
    fn new() -> Self {
        Self {
            memory: SECTOR_BYTES.map(|bytes| vec![0x5a; bytes]),
            cached: BTreeMap::new(),
            access: DATA_CACHE | 5,
            control: LOCK,
            // Left by whoever was before.
            state: SEQUENCE_ERROR | 1,
            keys_taken: 0,
            is_dead: false,
            busy_looks: 0,
            looks: 3,
            operations_left: usize::MAX,
            write_protected: false,
            erased: vec![],
        }
    }

    fn place(&mut self, address: u32) -> &mut [u8] {
        let sectors = SETTINGS_SECTORS.iter().zip(&mut self.memory);
        for (sector, memory) in sectors {
            let offset = address.wrapping_sub(sector.address) as usize;
            if let Some(word) = memory.get_mut(offset..offset.wrapping_add(4)) {
                return word;
            }
        }
        panic!("{address:#x} is none of ours")
    }

    /// Begins an operation; false where the power has failed.
    fn begin(&mut self) -> bool {
        assert_eq!(self.state & BUSY, 0, "BSY before anything is begun");
        self.state |= BUSY;
        self.busy_looks = self.looks;
        let left = self.operations_left.checked_sub(1);
        self.operations_left = left.unwrap_or(0);
        left.is_some()
    }

    fn begin_erase(&mut self) {
        let number = self.control >> SECTOR_SHIFT & 0xf;
        if self.control & WORDS == 0 {
            self.state |= PARALLELISM_ERROR;
        } else if self.write_protected {
            self.state |= WRITE_PROTECTION_ERROR;
        } else if self.begin() {
            let which = SETTINGS_SECTORS
                .iter()
                .position(|sector| sector.number == number);
            self.memory[which.expect("a sector of ours")].fill(0xff);
            self.erased.push(number);
        }
    }
}

impl FlashBus for &mut Controller {
    fn register(&mut self, register: usize) -> u32 {
        match register {
            ACCESS => self.access,
            STATE => {
                let state = self.state;
                if state & BUSY != 0 {
                    self.busy_looks = self.busy_looks.saturating_sub(1);
                    if self.busy_looks == 0 {
                        self.state &= !BUSY;
                    }
                }
                state
            }
            CONTROL => self.control,
            other => panic!("register {other:#x} is not read"),
        }
    }

    fn set_register(&mut self, register: usize, value: u32) {
        match register {
            ACCESS => {
                if value & EMPTY_DATA_CACHE != 0 {
                    assert_eq!(value & DATA_CACHE, 0, "DCRST only while DCEN is off");
                    self.cached.clear();
                }
                self.access = value;
            }
            KEY => {
                let is_right = KEYS.get(self.keys_taken) == Some(&value);
                self.is_dead |= !is_right;
                self.keys_taken += 1;
                if self.keys_taken == KEYS.len() && !self.is_dead {
                    self.control &= !LOCK;
                }
            }
            STATE => self.state &= !(value & FLAGS),
            CONTROL => {
                assert_eq!(self.state & BUSY, 0, "CR cannot be written while BSY");
                if self.control & LOCK != 0 {
                    return;
                }
                self.control = value & !START;
                if value & LOCK != 0 {
                    self.keys_taken = 0;
                    self.control = LOCK;
                } else if value & START != 0 {
                    assert_ne!(value & ERASE, 0, "STRT is for erasing");
                    self.begin_erase();
                }
            }
            other => panic!("register {other:#x} is not written"),
        }
    }

    fn word(&mut self, address: u32) -> u32 {
        let now = u32::from_le_bytes(self.place(address).try_into().unwrap());
        if self.access & DATA_CACHE == 0 {
            return now;
        }
        *self.cached.entry(address).or_insert(now)
    }

    fn set_word(&mut self, address: u32, value: u32) {
        if self.control & PROGRAM == 0 || self.control & (ERASE | LOCK) != 0 {
            self.state |= SEQUENCE_ERROR;
        } else if self.control & (3 << 8) != WORDS {
            self.state |= PARALLELISM_ERROR;
        } else if self.state & ERRORS == 0 && self.begin() {
            for (cell, byte) in self.place(address).iter_mut().zip(value.to_le_bytes()) {
                // Programming only ever clears bits.
                *cell &= byte;
            }
        }
    }
}

fn store(controller: &mut Controller) -> SettingsStore<SectorFlash<&mut Controller>> {
    SettingsStore::new(SectorFlash::new(controller, SETTINGS_SECTORS, 100)).unwrap()
}

#[test]
fn settings_are_kept_in_both_sectors_and_end_in_the_last_one() {
    let mut controller = Controller::new();
    assert_eq!(store(&mut controller).take(), None);
    for round in 1..4u8 {
        let record = [round; 300];
        // A fresh store each time, as after a restart: the cache still has what was read before.
        store(&mut controller).put_last(&record).unwrap();
        assert_eq!(store(&mut controller).take().unwrap(), record);
        assert_eq!(controller.control, LOCK, "it is locked again");
        assert_eq!(controller.access, DATA_CACHE | 5, "the caches are on again");
        assert!(!controller.is_dead);
    }
    assert_eq!(controller.erased, [3, 7, 3, 7, 3, 7]);
    // A new image takes the first sector away: nothing is lost.
    controller.memory[0].fill(0);
    controller.cached.clear();
    assert_eq!(store(&mut controller).take().unwrap(), [3; 300]);
    // From there it goes on as before.
    store(&mut controller).put_last(&[9; 40]).unwrap();
    controller.memory[0].fill(0);
    controller.cached.clear();
    assert_eq!(store(&mut controller).take().unwrap(), [9; 40]);
}

#[test]
fn a_power_cut_between_any_two_words_leaves_the_old_or_the_new_settings() {
    let (old, new) = ([1u8; 200], [2u8; 220]);
    let mut before = Controller::new();
    store(&mut before).put_last(&old).unwrap();
    let mut kept = [0, 0];
    for cut in 0.. {
        let mut controller = before.clone();
        controller.operations_left = cut;
        let put = store(&mut controller).put_last(&new);
        // Switched on again.
        let mut again = Controller {
            memory: controller.memory,
            ..Controller::new()
        };
        let found = store(&mut again).take().unwrap();
        assert!(found == old || found == new, "after {cut} operations");
        kept[usize::from(found == new)] += 1;
        if put.is_ok() {
            assert_eq!(found, new);
            break;
        }
    }
    // Two erasures, and the words of two heads and two records.
    let operations = 2 * (1 + 4 + 220usize.div_ceil(16) * 4);
    assert_eq!(kept[0] + kept[1], operations + 1);
    assert!(kept[0] > 50 && kept[1] > 50, "{kept:?}");
}

#[test]
fn what_the_controller_refuses_is_told_and_nothing_is_written() {
    let protected = &mut Controller::new();
    protected.write_protected = true;
    let mut flash = SectorFlash::new(protected, SETTINGS_SECTORS, 100);
    let refused = Err(FlashError::Refused(WRITE_PROTECTION_ERROR));
    assert_eq!(flash.erase(0, BLOCK_BYTES as u32), refused);
    assert_eq!(flash.into_bus().memory[0][0], 0x5a);
    // One wrong key, by whoever was before, locks it until a reset.
    let dead = &mut Controller::new();
    let mut bus: &mut Controller = dead;
    bus.set_register(KEY, 1);
    let mut flash = SectorFlash::new(dead, SETTINGS_SECTORS, 100);
    assert_eq!(flash.erase(0, BLOCK_BYTES as u32), Err(FlashError::Locked));
    assert_eq!(flash.write(0, &[0; 4]), Err(FlashError::Locked));
    let slow = &mut Controller::new();
    slow.looks = 101;
    let mut flash = SectorFlash::new(&mut *slow, SETTINGS_SECTORS, 100);
    assert_eq!(flash.erase(0, BLOCK_BYTES as u32), Err(FlashError::Busy));
    let mut flash = SectorFlash::new(&mut *slow, SETTINGS_SECTORS, 100);
    let end = 2 * BLOCK_BYTES as u32;
    for (offset, bytes) in [(2, 4), (0, 3), (end - 4, 8), (end, 4)] {
        let wrong = Err(FlashError::Range);
        assert_eq!(flash.write(offset, &vec![0; bytes]), wrong);
        assert_eq!(flash.read(offset, &mut vec![0; bytes]), wrong);
    }
    for (from, to) in [(0, 4), (4, 16_388), (end, end + 16_384), (16_384, 0)] {
        assert_eq!(flash.erase(from, to), Err(FlashError::Range));
    }
}
