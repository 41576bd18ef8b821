//! Flash of a board with settings in it: an image as it is flashed, and a record in the sector that it is kept in.

use crate::elf::Elf;
use embedded_storage::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use headway_firmware::board::built_in::built_for;
use headway_firmware::board::octopus::SETTINGS_SECTORS;
use headway_firmware::configuration::board_name::BoardName;
use headway_firmware::settings::store::SettingsStore;
use std::convert::Infallible;

/// Bytes of the smaller sector.
const SECTOR_BYTES: usize = 16 * 1024;

/// Two erased sectors.
struct Sectors(Vec<u8>);

impl ErrorType for Sectors {
    type Error = Infallible;
}

impl ReadNorFlash for Sectors {
    const READ_SIZE: usize = 4;
    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Infallible> {
        let from = offset as usize;
        bytes.copy_from_slice(&self.0[from..from + bytes.len()]);
        Ok(())
    }
    fn capacity(&self) -> usize {
        self.0.len()
    }
}

impl NorFlash for Sectors {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = SECTOR_BYTES;
    fn erase(&mut self, from: u32, to: u32) -> Result<(), Infallible> {
        self.0[from as usize..to as usize].fill(0xff);
        Ok(())
    }
    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Infallible> {
        let from = offset as usize;
        self.0[from..from + bytes.len()].copy_from_slice(bytes);
        Ok(())
    }
}

/// A board's flash from the image's first byte on, with what is built in stored as settings that name the board.
pub fn named_flash(elf: &Elf, name: BoardName) -> (u32, Vec<u8>) {
    let (first, mut image) = elf.image();
    let settings = headway_firmware::settings::BoardSettings {
        board: Some(name),
        ..built_for().expect("settings are built in")
    };
    let record = settings.encode().expect("they are right");
    let erased = Sectors(vec![0xff; 2 * SECTOR_BYTES]);
    let mut store = SettingsStore::new(erased).expect("it fits");
    store.put(&record).expect("it is stored");
    // The first record of an empty store lies in the first sector.
    let sectors = store.into_flash().0;
    let place = (SETTINGS_SECTORS[0].address - first) as usize;
    let slot = image
        .get_mut(place..place + SECTOR_BYTES)
        .expect("code is behind it");
    assert!(slot.iter().all(|byte| *byte == 0), "no code lies there");
    slot.copy_from_slice(&sectors[..SECTOR_BYTES]);
    (first, image)
}
