//! `headway board simulate`: a board without hardware, and the file that represents its flash.
//!
//! In: a machine file, or the settings stored in the flash. Out: the firmware library on a socket.

use crate::cli::args::board::SimulateArgs;
use crate::cli::board::configure::board_settings;
use crate::cli::board::probe::read_mesh;
use crate::cli::board::settings;
use crate::cli::error::CliError;
use crate::cli::terminal::console::Console;
use crate::cli::terminal::result_kind::FLASH;
use crate::cli::terminal::signals::catch;
use crate::drive::pump::host_session;
use crate::drive::transport::{Listener, Port};
use crate::drive::virtual_board::{BoardSetup, SettingsWriter, VirtualBed, VirtualBoard};
use crate::drive::virtual_drivers::VirtualDrivers;
use crate::settings::{Settings, linear_joint_number};
use embedded_storage::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};
use headway_firmware::configuration::heat::HeatConfiguration;
use headway_firmware::configuration::homing::{HomingConfiguration, JointHoming};
use headway_firmware::configuration::wiring::Wiring;
use headway_firmware::settings::BoardSettings;
use headway_firmware::settings::store::SettingsStore;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

pub(crate) fn simulate(asked: &SimulateArgs, console: &Console) -> Result<(), CliError> {
    let (listen, speed) = (&asked.listen, asked.speed);
    let port: Port = listen
        .parse()
        .map_err(|error| CliError::Usage(format!("--listen: {error}")))?;
    if !(0.01..=1000.0).contains(&speed) {
        return Err(CliError::Usage(format!(
            "--speed {speed}: a number from 0.01 to 1000"
        )));
    }
    let settings = settings(&asked.machine)?;
    let mut bed = bed(asked, &settings)?;
    let flash = asked.settings.as_ref();
    let flash = flash.map(|path| path.file(FLASH, console)).transpose()?;
    let flash = flash.map(|file| FlashFile::open(file.path())).transpose()?;
    let kept = flash.as_ref().and_then(FlashFile::settings);
    let listener =
        Listener::bind(&port).map_err(|problem| CliError::Job(format!("{port}: {problem}")))?;
    let place = |problem: std::io::Error| CliError::Job(format!("{port}: {problem}"));
    let name = match kept {
        Some(_) => "its settings".to_string(),
        None => settings.machine_name.clone(),
    };
    let hash = kept.as_ref().map_or(0, BoardSettings::hash);
    let kept = kept.unwrap_or_else(|| board_settings(settings));
    let (machine, switches) = (kept.machine, kept.switches);
    let switches = if asked.no_switches {
        HomingConfiguration::none()
    } else {
        switches
    };
    bed.pin = kept.wiring.pin();
    let listening = listener.port().map_err(place)?;
    let setup = BoardSetup {
        machine,
        switches,
        session: host_session(),
        speed,
        heat: kept.heaters.unwrap_or_else(HeatConfiguration::none),
        bed,
    };
    let mut board = VirtualBoard::new(setup, listener)
        .map_err(|error| CliError::Job(format!("the firmware cannot run this machine: {error}")))?;
    let signals = catch();
    warn_of_network(&listening, console);
    console.say(&format!(
        "a board of machine {name} listens on {listening}; Ctrl-C ends it"
    ));
    if kept.wiring != Wiring::STANDARD {
        console.say(
            "its [wiring] is ignored: a simulated board has no pins; no motor is reversed, and switch m is joint m's",
        );
    }
    board.settings_in_force(hash);
    if !kept.drivers.is_none() {
        board.drive_with(&kept.drivers, VirtualDrivers::of(&kept.drivers));
    }
    if let Some(flash) = flash {
        board.keep_settings(flash.into_writer());
    }
    let stop = AtomicBool::new(false);
    let figures = board
        .serve(&stop, |_| {
            let ends = signals.interrupts() > 0 || signals.is_to_end();
            stop.store(ends, Ordering::Relaxed);
        })
        .map_err(place)?;
    console.say(&format!(
        "{} steps, counts {:?}, {} underruns, {} hosts",
        figures.steps, figures.counts, figures.underruns, figures.hosts
    ));
    Ok(())
}

/// Says who else reaches the board.
fn warn_of_network(listening: &Port, console: &Console) {
    if listening.is_beyond_this_computer() {
        console.say(&format!(
            "anybody in the network who reaches {listening} can move and heat this board: for this computer alone, \
             listen at 127.0.0.1"
        ));
    }
}

/// What its probe trips at: with Z homed at the bed and no input of its own it is Z's switch.
fn bed(asked: &SimulateArgs, settings: &Settings) -> Result<VirtualBed, CliError> {
    let z = linear_joint_number(&settings.machine.kinematics, 2);
    let is_z = |switch: &JointHoming| z == Some(usize::from(switch.joint));
    let z_down = |switch: &JointHoming| is_z(switch) && !switch.towards_max;
    let z_at_bed = settings.homing().joints.iter().any(z_down);
    Ok(VirtualBed {
        mesh: asked.bed.as_deref().map(read_mesh).transpose()?,
        probe: settings.probe.unwrap_or_default(),
        is_switch_of_z: settings.probe.is_some()
            && settings.wiring.probe_input.is_none()
            && z_at_bed,
        pin: settings.wiring.pin(),
    })
}

/// Sector of the flash that a file represents.
const SECTOR_BYTES: usize = 4096;
const FLASH_BYTES: usize = 2 * SECTOR_BYTES;

/// The flash of a board without hardware.
#[derive(Debug)]
struct FlashFile {
    file: File,
    kept: Option<BoardSettings>,
}

impl FlashFile {
    /// Opens it, or makes an empty one.
    ///
    /// # Errors
    /// What the file system says; a file of another size is not a flash, and is not changed.
    fn open(path: &Path) -> Result<FlashFile, CliError> {
        let problem = |problem| CliError::File {
            path: path.display().to_string(),
            problem,
        };
        let mut options = File::options();
        options.read(true).write(true).create(true).truncate(false);
        let mut file = options.open(path).map_err(problem)?;
        let bytes = file.metadata().map_err(problem)?.len();
        if bytes == 0 {
            file.write_all(&[0xff; FLASH_BYTES]).map_err(problem)?;
        } else if bytes != FLASH_BYTES as u64 {
            return Err(CliError::Job(format!(
                "{}: not the flash of a simulated board ({FLASH_BYTES} bytes)",
                path.display()
            )));
        }
        let flash = FileSectors(file.try_clone().map_err(problem)?);
        let record = SettingsStore::new(flash)
            .ok()
            .and_then(|mut store| store.take());
        let kept = record.map(|record| BoardSettings::decode(&record));
        let kept = kept.transpose().map_err(|refusal| {
            CliError::Job(format!("{}: {refusal}; remove the file", path.display()))
        })?;
        Ok(FlashFile { file, kept })
    }

    /// The stored settings.
    fn settings(&self) -> Option<BoardSettings> {
        self.kept.clone()
    }

    /// What writes to it from here on.
    fn into_writer(self) -> SettingsWriter {
        let mut store = SettingsStore::new(FileSectors(self.file)).ok();
        Box::new(move |record| {
            store
                .as_mut()
                .is_some_and(|store| store.put(record).is_ok())
        })
    }
}

/// A file as NOR flash.
#[derive(Debug)]
struct FileSectors(File);

#[derive(Debug)]
struct FileProblem;

impl NorFlashError for FileProblem {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

impl ErrorType for FileSectors {
    type Error = FileProblem;
}

impl FileSectors {
    fn at(&mut self, offset: u32) -> Result<&mut File, FileProblem> {
        let place = SeekFrom::Start(offset.into());
        self.0.seek(place).map_err(|_| FileProblem)?;
        Ok(&mut self.0)
    }
}

impl ReadNorFlash for FileSectors {
    const READ_SIZE: usize = 1;
    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FileProblem> {
        self.at(offset)?.read_exact(bytes).map_err(|_| FileProblem)
    }
    fn capacity(&self) -> usize {
        FLASH_BYTES
    }
}

impl NorFlash for FileSectors {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = SECTOR_BYTES;
    fn erase(&mut self, from: u32, to: u32) -> Result<(), FileProblem> {
        let erased = vec![0xff; to.saturating_sub(from) as usize];
        self.write(from, &erased)
    }
    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FileProblem> {
        let file = self.at(offset)?;
        file.write_all(bytes).map_err(|_| FileProblem)?;
        // In order, whatever becomes of the computer.
        file.sync_data().map_err(|_| FileProblem)
    }
}
