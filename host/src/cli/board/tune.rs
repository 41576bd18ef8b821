//! `headway board tune`: switches full power on and off around a temperature until the gains are
//! known.

use crate::cli::args::board::{BoardMachineArgs, PortArgs};
use crate::cli::board::heat::{heat, heater_number};
use crate::cli::board::operator::Operator;
use crate::cli::board::talk::Talk;
use crate::cli::error::CliError;
use crate::cli::reading::{load, machine_keys};
use crate::cli::terminal::console::Console;
use crate::cli::terminal::output_file::check_file;
use crate::drive::relay_tuning::{RelayTuning, Tuned};
use crate::settings::heat::HEATER_KEYS;
use crate::settings::machine_file::write_heater;
use headway_firmware::configuration::heat::{HeatConfiguration, HeaterConfiguration, HeaterRole};
use std::path::Path;
use std::time::{Duration, Instant};

/// A target this far above gives full power: the regulator is at its end there, whatever its gains.
const FULL_POWER_K: f64 = 40.0;
/// Period of temperature queries: ten times in a hot end's shortest lag.
const LOOK: Duration = Duration::from_millis(100);
/// Longest tuning: a bed's first heating and six swings.
const TUNE_PATIENCE: Duration = Duration::from_secs(3600);

pub(crate) fn tune(
    heater: &str,
    celsius: f64,
    in_place: bool,
    machine: &BoardMachineArgs,
    port: &PortArgs,
    console: &Console,
) -> Result<(), CliError> {
    let number = heater_number(heater)?;
    let known = known_heater(machine, number)?;
    let most_c = f64::from(known.target_max_c()) - FULL_POWER_K;
    // So written that a NaN does not fit.
    let fits = celsius > 40.0 && celsius <= most_c;
    if !fits {
        return Err(CliError::Usage(format!(
            "tune {heater} {celsius}: a temperature from 40 to {most_c:.0} °C, {FULL_POWER_K} K below the \
             highest target"
        )));
    }
    let file = machine.machine.as_deref().filter(|_| in_place);
    file.map(check_file).transpose()?;
    // Off, however it ends.
    let operator = Operator::new(port, console);
    let mut talk = Talk::open_for(port, Some(&operator))?;
    let tuned = swing(&mut talk, heater, number, celsius)?;
    talk.order(heat(heater, 0.0, false)?)?;
    let power_w = f64::from(known.plant.power_w);
    let mut found = known;
    found.gains = tuned.gains;
    found.plant.loss_w_k = (tuned.loss_share_k * power_w) as f32;
    found.plant.measured = true;
    console.say(&format!(
        "swings by {:.2} K in {:.1} s; loses {:.3} W/K if it has {power_w:.0} W",
        tuned.amplitude_k, tuned.period_s, found.plant.loss_w_k
    ));
    let mut text = String::new();
    let key = HEATER_KEYS.get(usize::from(number)).copied();
    // Writing to a string cannot fail.
    let _ = write_heater(&mut text, key.unwrap_or_default(), &found);
    match file {
        Some(path) => keep(path, number, found, console),
        None => console.result(&text),
    }
}

/// The known values of a heater: those of the machine file, or those built into the board.
fn known_heater(machine: &BoardMachineArgs, number: u8) -> Result<HeaterConfiguration, CliError> {
    let settings = machine.machine.as_deref().map(load::machine).transpose()?;
    let heaters = settings.and_then(|settings| settings.heaters);
    let heaters = heaters.unwrap_or_else(HeatConfiguration::standard);
    let found = heaters.heaters.get(usize::from(number)).copied();
    found.ok_or_else(|| CliError::Usage(format!("heater {number} is not in the machine file")))
}

/// Until a board has read each of its sensors.
const FIRST_LOOK: Duration = Duration::from_secs(2);

/// Switches full power at the temperature until the gains are known.
fn swing(talk: &mut Talk<'_>, heater: &str, number: u8, celsius: f64) -> Result<Tuned, CliError> {
    let mut tuning = RelayTuning::new(celsius);
    let begun = Instant::now();
    let mut given = None;
    while begun.elapsed() < TUNE_PATIENCE {
        let status = talk.status()?;
        if let Some(fault) = status.fault {
            return Err(CliError::Job(format!("the board latched a fault: {fault}")));
        }
        let reading = status.heaters.get(usize::from(number));
        let Some(reading) = reading.filter(|reading| reading.decidegrees != i16::MIN) else {
            // A board that has just started has read none.
            if begun.elapsed() < FIRST_LOOK {
                std::thread::sleep(FIRST_LOOK / 20);
                continue;
            }
            return Err(CliError::Job(format!(
                "the board has no sensor of {heater}"
            )));
        };
        let now_s = begun.elapsed().as_secs_f64();
        let (on, tuned) = tuning.look(now_s, f64::from(reading.decidegrees) / 10.0);
        if let Some(tuned) = tuned {
            return Ok(tuned);
        }
        if given != Some(on) {
            given = Some(on);
            let target_c = if on { celsius + FULL_POWER_K } else { 0.0 };
            talk.order(heat(heater, target_c, false)?)?;
        }
        std::thread::sleep(LOOK);
    }
    Err(CliError::Job("the temperature does not swing".to_string()))
}

/// Writes the heater into the machine file: where it has no heaters, at its end.
fn keep(
    path: &Path,
    number: u8,
    found: HeaterConfiguration,
    console: &Console,
) -> Result<(), CliError> {
    let file = |problem| CliError::File {
        path: path.display().to_string(),
        problem,
    };
    let old = std::fs::read_to_string(path).map_err(file)?;
    let settings = load::machine(path)?;
    let has_heaters = settings.heaters.is_some();
    let mut heaters = settings.heaters.unwrap_or_else(HeatConfiguration::standard);
    if let Some(place) = heaters.heaters.get_mut(usize::from(number)) {
        *place = found;
    }
    let role = match found.role {
        HeaterRole::HotEnd => "hot end",
        HeaterRole::Bed => "bed",
    };
    let text = with_heaters(&old, &heaters);
    let kept = machine_keys::replace(path, [&old, &text], ".bak")?;
    let verb = if has_heaters { "changed" } else { "added" };
    console.result(&format!(
        "{}: {verb} the {role}, the old text is in {}; rebuild the firmware for it (headway machine firmware)\n",
        path.display(),
        kept.display()
    ))
}

/// The machine file with these heaters instead of its own; all else, comments too, stays.
fn with_heaters(text: &str, heaters: &HeatConfiguration) -> String {
    let mut kept = String::new();
    let mut skips = false;
    for line in text.lines() {
        if line.trim_start().starts_with('[') {
            skips = line.trim_start().starts_with("[heaters");
        }
        if !skips {
            kept.push_str(line);
            kept.push('\n');
        }
    }
    let mut kept = kept.trim_end().to_string() + "\n";
    let _ = crate::settings::machine_file::write_heaters(&mut kept, heaters);
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::terminal::named_files::NamedFiles;
    use crate::settings::{Settings, machine_file};

    #[test]
    fn tuned_heaters_replace_those_of_the_file_and_nothing_else() {
        let text = machine_file::to_new_toml(&Settings::default());
        let mut heaters = HeatConfiguration::standard();
        for proportional in [0.11, 0.12] {
            heaters.heaters[0].gains.proportional = proportional;
            let first = with_heaters(&text, &heaters);
            assert!(first.starts_with(text.trim_end()));
            let again = with_heaters(&first, &heaters);
            assert_eq!(first, again);
            let read = machine_file::from_toml(&again).unwrap();
            assert_eq!(read.heaters.as_ref(), Some(&heaters));
            let written = machine_file::to_toml(&read);
            assert_eq!(machine_file::from_toml(&written).unwrap(), read);
        }
    }

    /// Goal: no edit costs the old text. Method: a file that is written to twice; the file and what is kept of it.
    #[test]
    fn the_old_text_of_an_edited_file_is_kept() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("printer.toml");
        let console = Console::new(true, NamedFiles::default());
        let read = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap();
        let old = machine_file::to_new_toml(&Settings::default());
        std::fs::write(&path, &old).unwrap();
        let found = HeatConfiguration::standard().heaters[0];
        keep(&path, 0, found, &console).unwrap();
        let first = read("printer.toml");
        assert!(first != old && machine_file::from_toml(&first).is_ok());
        keep(&path, 0, found, &console).unwrap();
        assert_eq!(
            [read("printer.toml.bak"), read("printer.toml.bak2")],
            [old, first]
        );
    }

    #[test]
    fn gains_from_an_oscillation_hold_a_plant_that_lags() {
        // 300 W into 1000 J/K by a sensor that lags 12 s: integrator and lag, as a bed.
        let (mut block_c, mut sensor_c, mut now_s) = (25.0, 25.0, 0.0);
        let mut tuning = RelayTuning::new(60.0);
        let tuned = loop {
            let (on, tuned) = tuning.look(now_s, sensor_c);
            if let Some(tuned) = tuned {
                break tuned;
            }
            let watts = if on { 300.0 } else { 0.0 };
            block_c += (watts - 1.8 * (block_c - 25.0)) / 1000.0 * 0.1;
            sensor_c += (block_c - sensor_c) / 12.0 * 0.1;
            now_s += 0.1;
            assert!(now_s < 3000.0);
        };
        let loss_w_k = tuned.loss_share_k * 300.0;
        assert!((loss_w_k - 1.8).abs() < 0.1, "{tuned:?}");
        // Between a tenth and ten times what was chosen by hand.
        let by_hand = HeaterConfiguration::BED.gains;
        for (found, chosen) in [
            (tuned.gains.proportional, by_hand.proportional),
            (tuned.gains.integral, by_hand.integral),
            (tuned.gains.derivative, by_hand.derivative),
        ] {
            assert!((0.1..10.0).contains(&(found / chosen)), "{tuned:?}");
        }
    }
}
