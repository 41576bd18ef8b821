//! Settings in the flash of an STM32F4 board: read at the start, stored from the main loop.
//!
//! While a sector is erased the core is stalled (up to 2 s), so before that heaters and fans are switched off
//! at their pins and in their schedule, and the watchdog's time is extended; `Receiver` has checked before that
//! nothing moves and no heater has a target. Bytes that arrive during that time are lost, and the host sends
//! them again.

use super::pins::heaters_off;
use super::{heat, start};
use crate::BOARD;
use headway_firmware::board::built_in::{built_for, kept_settings};
use headway_firmware::board::sector_flash::{FlashBus, LOOKS_MAX, SectorFlash};
use headway_firmware::line::{Conversation, Receiver};
use headway_firmware::settings::store::SettingsStore;
use headway_firmware::settings::{BoardLimits, BoardSettings};

/// The flash controller.
const CONTROLLER: usize = 0x4002_3c00;

struct Registers;

impl FlashBus for Registers {
    fn register(&mut self, register: usize) -> u32 {
        // SAFETY: a register of the flash controller; reading has no effect.
        unsafe { ((CONTROLLER + register) as *const u32).read_volatile() }
    }
    fn set_register(&mut self, register: usize, value: u32) {
        // SAFETY: the main loop alone uses the controller, and changes only sectors without code.
        unsafe { ((CONTROLLER + register) as *mut u32).write_volatile(value) }
    }
    fn word(&mut self, address: u32) -> u32 {
        // SAFETY: flash of this chip.
        unsafe { (address as *const u32).read_volatile() }
    }
    fn set_word(&mut self, address: u32, value: u32) {
        // SAFETY: in a sector that the linker keeps free of code and data; nothing refers to it.
        unsafe { (address as *mut u32).write_volatile(value) }
    }
}

/// Level of the brown-out reset, by the option bytes (RM0390, FLASH_OPTCR): 1 to 3, 0 for none.
pub fn brown_out_level() -> u8 {
    const OPTIONS: usize = 0x14;
    3 - (Registers.register(OPTIONS) >> 2 & 3) as u8
}

/// The store, and the settings that the board can run.
pub struct KeptSettings {
    store: SettingsStore<SectorFlash<Registers>>,
    limits: BoardLimits,
    hash: u32,
}

impl KeptSettings {
    /// `None` if the built-in settings are not valid.
    #[inline(never)]
    pub fn find() -> Option<Self> {
        let built_in = built_for()?.machine;
        let flash = SectorFlash::new(Registers, BOARD.settings_sectors, LOOKS_MAX);
        Some(Self {
            store: SettingsStore::new(flash).ok()?,
            limits: BoardLimits {
                motors_max: BOARD.drivers.len(),
                servo_hz: built_in.servo_hz,
                step_hz: built_in.step_hz,
                inputs: BOARD.board_inputs(),
                names: BOARD.names,
            },
            hash: 0,
        })
    }

    pub fn limits(&self) -> BoardLimits {
        self.limits
    }

    /// The stored settings, if they can be run.
    pub fn settings(&mut self) -> Option<BoardSettings> {
        let (settings, hash) = kept_settings(&mut self.store, &self.limits)?;
        self.hash = hash;
        Some(settings)
    }

    /// Hash of the active settings: 0 for built-in ones.
    pub fn hash(&self) -> u32 {
        self.hash
    }

    /// Stores received settings, if there are any.
    pub fn store(&mut self, receiver: &mut Receiver, talk: &mut Conversation) {
        receiver.store_settings(talk, |record| self.put(record));
    }

    #[inline(never)]
    fn put(&mut self, record: &[u8]) -> bool {
        // A pin that is high would stay so while the core is stalled.
        heat::cut();
        heaters_off();
        start::patient_watchdog(true);
        let stored = self.store.put_last(record).is_ok();
        start::patient_watchdog(false);
        stored
    }
}
