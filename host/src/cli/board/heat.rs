//! `headway board heat`, and the heaters of a status as text.

use crate::cli::error::CliError;
use headway_protocol::message::{Control, DECIDEGREES_MAX, HEATERS_MAX, HeaterStatus, Status};
use serde_json::{Value, json};
use std::fmt::Write;

/// Heaters in the order of their numbers.
const NAMES: [&str; HEATERS_MAX] = ["hot-end", "bed", "hot-end-2"];
/// Closer than this the target is reached, tenths of a degree: as the board judges it.
const READY_DECIDEGREES: i32 = 20;

/// The heater with this name or number.
pub(crate) fn heater_number(text: &str) -> Result<u8, CliError> {
    let by_name = NAMES
        .iter()
        .position(|name| name.eq_ignore_ascii_case(text));
    let by_number = text.parse().ok().filter(|number| *number < HEATERS_MAX);
    by_name
        .or(by_number)
        .map(|heater| heater as u8)
        .ok_or_else(|| CliError::Usage(format!("heater `{text}`: {}", NAMES.join(", "))))
}

/// Name and target in °C -> the command.
pub(crate) fn heat(heater: &str, celsius: f64, wait: bool) -> Result<Control, CliError> {
    let heater = heater_number(heater)?;
    let decidegrees = (celsius * 10.0).round();
    if !(0.0..=f64::from(DECIDEGREES_MAX)).contains(&decidegrees) {
        return Err(CliError::Usage(format!(
            "heat {celsius}: a target from 0 (off) to {} °C",
            DECIDEGREES_MAX / 10
        )));
    }
    Ok(Control::Heat {
        heater,
        decidegrees: decidegrees as u16,
        wait,
    })
}

/// True once a heater has reached its target, or is switched off.
pub(crate) fn is_there(status: &Status, heater: u8, decidegrees: u16) -> bool {
    status
        .heaters
        .get(usize::from(heater))
        .is_none_or(|heater| {
            let away = i32::from(heater.decidegrees) - i32::from(decidegrees);
            decidegrees == 0 || away.abs() <= READY_DECIDEGREES
        })
}

fn celsius(heater: &HeaterStatus) -> Option<f64> {
    (heater.decidegrees != i16::MIN).then(|| f64::from(heater.decidegrees) / 10.0)
}

/// Heaters as JSON.
pub(crate) fn heaters_json(status: &Status) -> Vec<Value> {
    let one = |heater: &HeaterStatus| {
        json!({
            "celsius": celsius(heater),
            "target_celsius": f64::from(heater.target_decidegrees) / 10.0,
            "duty": f64::from(heater.duty_permille) / 1000.0,
        })
    };
    status.heaters.iter().map(one).collect()
}

/// Heaters and targets, tenths of a degree, as words.
pub(crate) fn hot_text(hot: &[(usize, u16)]) -> String {
    let one = |(heater, target): &(usize, u16)| {
        let name = NAMES.get(*heater).copied().unwrap_or("?");
        format!("{name} ({:.0} °C)", f64::from(*target) / 10.0)
    };
    hot.iter().map(one).collect::<Vec<_>>().join(" and ")
}

/// Heaters as a line, empty if there are none.
pub(crate) fn heaters_text(status: &Status) -> String {
    let mut text = String::new();
    for (name, heater) in NAMES.iter().zip(&status.heaters) {
        let now = celsius(heater).map_or("no sensor".to_owned(), |c| format!("{c:.1} °C"));
        let separator = if text.is_empty() { "" } else { ", " };
        // Writing to a string cannot fail.
        let _ = write!(text, "{separator}{name} {now}");
        if heater.target_decidegrees > 0 {
            let target = f64::from(heater.target_decidegrees) / 10.0;
            let percent = f64::from(heater.duty_permille) / 10.0;
            let _ = write!(text, " of {target:.0} at {percent:.0} %");
        }
    }
    if !text.is_empty() {
        let percent = f64::from(status.fan_permille) / 10.0;
        let _ = writeln!(text, ", fan {percent:.0} %");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heaters_go_by_name_and_targets_are_checked() {
        for (name, heater) in [("hot-end", 0), ("BED", 1), ("2", 2)] {
            let command = heat(name, 60.04, true).unwrap();
            let expected = Control::Heat {
                heater,
                decidegrees: 600,
                wait: true,
            };
            assert_eq!(command, expected);
        }
        for (name, celsius) in [
            ("nozzle", 60.0),
            ("3", 60.0),
            ("bed", -1.0),
            ("bed", f64::NAN),
        ] {
            assert!(heat(name, celsius, false).is_err(), "{name} {celsius}");
        }
    }
}
