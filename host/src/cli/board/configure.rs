//! `headway board configure`: a machine file for a board that keeps settings.
//!
//! In: a machine file. Out: its settings on the board, checked on both sides by the firmware's own code.
//! Not covered: how a board applies them at its next start.

use crate::cli::args::board::PortArgs;
use crate::cli::board::talk::Talk;
use crate::cli::error::CliError;
use crate::cli::reading::load;
use crate::cli::terminal::console::Console;
use crate::settings::Settings;
use headway_firmware::settings::{BoardSettings, record_hash};
use headway_protocol::message::{Control, SETTINGS_PART_BYTES};
use std::path::Path;

/// What of a machine file is the board's.
pub(crate) fn board_settings(settings: Settings) -> BoardSettings {
    BoardSettings {
        switches: settings.homing(),
        machine: settings.machine,
        heaters: settings.heaters,
        drivers: settings.drivers,
        wiring: settings.wiring,
        board: settings.board,
    }
}

pub(crate) fn configure(path: &Path, port: &PortArgs, console: &Console) -> Result<(), CliError> {
    let settings = load::machine(path)?;
    let hash = settings.machine.hash();
    let settings = board_settings(settings);
    let place = path.display();
    let record = settings
        .encode()
        .map_err(|refusal| CliError::Job(format!("{place}: the firmware refuses: {refusal}")))?;
    let mut talk = Talk::open(port)?;
    // It fits by the record's bound.
    let length = record.len() as u16;
    talk.order(Control::SettingsBegin { length })?;
    for (number, part) in record.chunks(SETTINGS_PART_BYTES).enumerate() {
        let mut bytes = [0; SETTINGS_PART_BYTES];
        bytes[..part.len()].copy_from_slice(part);
        let offset = (number * SETTINGS_PART_BYTES) as u16;
        talk.order(Control::SettingsPart { offset, bytes })?;
    }
    talk.order(Control::SettingsEnd)?;
    console.result(&format!(
        "{place}: stored, {length} bytes; the board is machine {hash:08x} with settings {:08x} from its \
         next start: switch it off and on\n",
        record_hash(&record),
    ))
}
