//! Klipper's extended commands: a name, then `KEY=value`.
//!
//! In: the command of a line. Out: orders of heaters and fans, lengths of G10 and G11. `extruder` is the hot end,
//! `extruder1` the second, `heater_bed` the bed, a fan whose name says "part" (or is `fan`) the part fan; what
//! other sections are called is carried with its line. Source: Klipper's G-Codes.md.

use super::Interpreter;
use super::heat::{HOT_END_2, checked, most_c};
use crate::gcode::error;
use crate::gcode::words::shortened;
use crate::job::heat::{BED, HOT_END, HeatOrder};
use crate::text::refusal::Refusal;

/// Longest length of G10 that is taken, mm.
const RETRACT_MAX_MM: f64 = 1e3;

/// Words by which macros of the start get their temperatures, as the slicers' guides and the usual sets of
/// macros call them.
const BED_KEYS: [&str; 6] = [
    "BED_TEMP",
    "BED",
    "BED_TEMPERATURE",
    "T_BED",
    "BEDTEMP",
    "FIRST_LAYER_BED_TEMP",
];
const HOT_END_KEYS: [&str; 13] = [
    "EXTRUDER_TEMP",
    "EXTRUDER",
    "HOTEND",
    "HOTEND_TEMP",
    "NOZZLE",
    "NOZZLE_TEMP",
    "TOOL_TEMP",
    "EXTRUDER_TEMPERATURE",
    "HOTEND_TEMPERATURE",
    "NOZZLE_TEMPERATURE",
    "T_EXTRUDER",
    "TEMP",
    "TEMPERATURE",
];

/// Heaters by the names of their sections.
fn heater_of(section: &str) -> Option<u8> {
    match section.to_ascii_lowercase().as_str() {
        "extruder" => Some(HOT_END),
        "extruder1" => Some(HOT_END_2),
        "heater_bed" => Some(BED),
        _ => None,
    }
}

/// The value of a key, quotes left out.
pub(super) fn text_of<'a>(command: &'a str, key: &str) -> Option<&'a str> {
    let mut rest = command;
    while let Some((before, after)) = rest.split_once('=') {
        let name = before.trim_end().rsplit(char::is_whitespace).next();
        let (value, left) = match after.trim_start().strip_prefix('"') {
            Some(quoted) => quoted.split_once('"').unwrap_or((quoted, "")),
            None => {
                let after = after.trim_start();
                after.split_at(after.find(char::is_whitespace).unwrap_or(after.len()))
            }
        };
        if name.is_some_and(|name| name.eq_ignore_ascii_case(key)) {
            return Some(value);
        }
        rest = left;
    }
    None
}

/// The number of a key.
pub(super) fn number_of(command: &str, key: &str, line: usize) -> Result<Option<f64>, Refusal> {
    let Some(text) = text_of(command, key) else {
        return Ok(None);
    };
    let number = text.parse().ok().filter(|number: &f64| number.is_finite());
    number
        .map(Some)
        .ok_or_else(|| error::parameter(line, key, &shortened(text)))
}

/// Names of macros, no codes with a text.
fn is_name(name: &str) -> bool {
    name.bytes()
        .take(2)
        .all(|byte| byte.is_ascii_alphabetic() || byte == b'_')
}

impl Interpreter {
    /// An extended command that is read; false for all others.
    pub(super) fn extended(
        &mut self,
        name: &str,
        command: &str,
        line: usize,
    ) -> Result<bool, Refusal> {
        let is_done = match name.to_ascii_uppercase().as_str() {
            "SET_RETRACTION" => {
                self.set_retraction(command, line)?;
                true
            }
            "SET_HEATER_TEMPERATURE" => self.set_heater(command, line)?,
            "TEMPERATURE_WAIT" => self.temperature_wait(command, line)?,
            "SET_FAN_SPEED" => self.set_fan(command, line)?,
            "SAVE_GCODE_STATE" => {
                self.save_named(command, line)?;
                true
            }
            "RESTORE_GCODE_STATE" => {
                self.restore_named(command, line)?;
                true
            }
            "MANUAL_STEPPER" => return self.manual_stepper(command, line),
            "ACTIVATE_EXTRUDER" => {
                let section = text_of(command, "EXTRUDER").unwrap_or_default();
                let number = section.to_ascii_lowercase();
                let number = number.strip_prefix("extruder").unwrap_or(section);
                match number {
                    "" => self.use_tool(0, line),
                    _ => number
                        .parse()
                        .into_iter()
                        .for_each(|n| self.use_tool(n, line)),
                }
                true
            }
            "TURN_OFF_HEATERS" => {
                for heater in [HOT_END, BED, HOT_END_2] {
                    if self.target_c(heater).is_some_and(|celsius| celsius > 0.0) {
                        self.order(HeatOrder::target(heater, 0.0), line);
                    }
                }
                true
            }
            _ => return Ok(false),
        };
        if !is_done {
            self.found.carried.push(format!("line {line} {command}"));
        }
        Ok(true)
    }

    /// Temperatures that a macro before the first bead gets as words (`PRINT_START EXTRUDER_TEMP=220 BED=60`): it
    /// waits for them, as such macros do. What else it does is not known. A macro whose name does not say that it
    /// is of the start has temperatures only where the word says so.
    pub(super) fn start_macro(
        &mut self,
        name: &str,
        command: &str,
        line: usize,
    ) -> Result<(), Refusal> {
        let name = name.to_ascii_uppercase();
        if self.printing_tool.is_some() || !is_name(&name) {
            return Ok(());
        }
        let is_start = name.contains("START");
        let mut taken = Vec::new();
        for (keys, heater, what) in [
            (BED_KEYS.as_slice(), BED, "bed"),
            (HOT_END_KEYS.as_slice(), HOT_END, "hot end"),
        ] {
            for key in keys.iter().filter(|key| is_start || key.contains("_TEMP")) {
                let Some(celsius) = checked(number_of(command, key, line)?, line, most_c())? else {
                    continue;
                };
                self.order(HeatOrder::wait_for(heater, celsius), line);
                taken.push(format!("{what} {celsius} °C"));
                break;
            }
        }
        let note = match taken.as_slice() {
            [] if is_start && command.contains('=') => format!(
                "line {line}: no word of {name} is known as a temperature: order it by M104, M140, or [material]"
            ),
            [] => return Ok(()),
            taken => format!("line {line}: {} as {name} has it", taken.join(", ")),
        };
        self.found.macros.push(note);
        Ok(())
    }

    /// Lengths of G10 and G11.
    fn set_retraction(&mut self, command: &str, line: usize) -> Result<(), Refusal> {
        let mut given = [None; 2];
        for (slot, key) in ["RETRACT_LENGTH", "UNRETRACT_EXTRA_LENGTH"]
            .into_iter()
            .enumerate()
        {
            given[slot] = number_of(command, key, line)?;
            if given[slot].is_some_and(|mm| mm.abs() > RETRACT_MAX_MM) {
                return Err(error::parameter(
                    line,
                    key,
                    &text_of(command, key).map(shortened).unwrap_or_default(),
                ));
            }
        }
        self.retract_by(given[0], given[1]);
        Ok(())
    }

    /// A target, 0 where none is given.
    fn set_heater(&mut self, command: &str, line: usize) -> Result<bool, Refusal> {
        let celsius = checked(number_of(command, "TARGET", line)?, line, most_c())?;
        let heater = text_of(command, "HEATER").and_then(heater_of);
        if let Some(heater) = heater {
            self.order(HeatOrder::target(heater, celsius.unwrap_or(0.0)), line);
        }
        Ok(heater.is_some())
    }

    /// A wait, done where the heater's target lies within what is waited for: a job waits for targets.
    fn temperature_wait(&mut self, command: &str, line: usize) -> Result<bool, Refusal> {
        let least_c = number_of(command, "MINIMUM", line)?;
        let most_c = number_of(command, "MAXIMUM", line)?;
        let heater = text_of(command, "SENSOR").and_then(heater_of);
        let target = heater.and_then(|heater| Some((heater, self.target_c(heater)?)));
        let within = |celsius: f64| {
            celsius > 0.0
                && least_c.is_none_or(|least| celsius >= least)
                && most_c.is_none_or(|most| celsius <= most)
        };
        match target {
            Some((heater, celsius)) if within(celsius) => {
                self.order(HeatOrder::wait_for(heater, celsius), line);
                Ok(true)
            }
            _ => Ok(false),
        }
    }

    /// The part fan; others are carried.
    fn set_fan(&mut self, command: &str, line: usize) -> Result<bool, Refusal> {
        let speed = checked(number_of(command, "SPEED", line)?, line, 1.0)?;
        let name = text_of(command, "FAN")
            .unwrap_or_default()
            .to_ascii_lowercase();
        match speed {
            Some(share) if name == "fan" || name.contains("part") => {
                self.order(
                    HeatOrder::Fan {
                        fan_pct: 100.0 * share,
                    },
                    line,
                );
                Ok(true)
            }
            _ => Ok(false),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_of_keys_are_found() {
        let command =
            "TEMPERATURE_WAIT SENSOR=\"temperature_sensor chamber\" minimum = 40 MAXIMUM=50";
        assert_eq!(
            text_of(command, "SENSOR"),
            Some("temperature_sensor chamber")
        );
        assert_eq!(number_of(command, "MINIMUM", 1), Ok(Some(40.0)));
        assert_eq!(number_of(command, "MAXIMUM", 1), Ok(Some(50.0)));
        assert_eq!(number_of(command, "TARGET", 1), Ok(None));
        let error = number_of("SET_HEATER_TEMPERATURE TARGET=hot", "TARGET", 7);
        let error = error.expect_err("no number").to_string();
        assert!(
            error.contains("line 7") && error.contains("TARGET"),
            "{error}"
        );
        assert_eq!(text_of("X =\"", "X"), Some(""));
    }
}
