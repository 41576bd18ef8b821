//! Codes of heaters and fans -> orders at their place among the steps.
//!
//! In: M104, M109, M140, M190, M116, M106, M107 (°C, 0 to 255 or a fraction with its point), G10 and M568 of
//! RepRapFirmware (P the tool, S its temperature), and what Headway writes for machine tools: M67 and M68 with E
//! for the output, M66 for the wait. Out: [`HeatStep`]s. What no job has (chambers, other fans, standby, tools
//! beyond the second) is carried as a text with its line.

use super::{Interpreter, code_name, tenths, value};
use crate::gcode::comments::Slicer;
use crate::gcode::words::{Line, Word};
use crate::job::heat::{BED, HOT_END, HeatOrder};
use crate::text::refusal::{Refusal, refusal};
use crate::text::short_number::Short;
use headway_protocol::message::DECIDEGREES_MAX;

/// The second hot end among the heaters.
pub(super) const HOT_END_2: u8 = 2;
/// Full speed of a fan in M106.
const FAN_FULL: f64 = 255.0;
/// Analog outputs of machine tools, as Headway writes them, and digital inputs that tell a heater is there.
const OUTPUTS: [(u8, Option<u8>); 4] = [
    (0, Some(HOT_END)),
    (1, Some(BED)),
    (2, None),
    (3, Some(HOT_END_2)),
];

/// What each heater was asked for last, °C.
pub(super) type Targets = [Option<f64>; 3];

/// An order among the steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeatStep<T = HeatOrder> {
    /// Line from 1.
    pub line: usize,
    /// Steps before it.
    pub step: usize,
    /// What.
    pub order: T,
}

impl Interpreter {
    /// A code of heaters and fans; false for all others.
    pub(super) fn heat_code(
        &mut self,
        word: &Word,
        line: &Line,
        number: usize,
    ) -> Result<bool, Refusal> {
        let is_ours = self.found.comments.slicer == Slicer::Headway;
        match tenths(word) {
            code @ (1040 | 1090) => match value(line, b'T', number)? {
                None | Some(0.0) => self.target(HOT_END, code == 1090, line, number)?,
                Some(1.0) => self.target(HOT_END_2, code == 1090, line, number)?,
                Some(_) => self.carried(line, number),
            },
            code @ (1400 | 1900) => self.target(BED, code == 1900, line, number)?,
            1160 => {
                for heater in [BED, HOT_END, HOT_END_2] {
                    self.wait(heater, number);
                }
            }
            1060 if value(line, b'P', number)?.is_some_and(|fan| fan != 0.0) => {
                self.carried(line, number);
            }
            1060 => {
                let speed = checked(value(line, b'S', number)?, number, FAN_FULL)?;
                let fan_pct = match speed.unwrap_or(FAN_FULL) {
                    share if share < 1.0 => 100.0 * share,
                    speed => 100.0 * speed / FAN_FULL,
                };
                self.order(HeatOrder::Fan { fan_pct }, number);
            }
            1070 => self.order(HeatOrder::Fan { fan_pct: 0.0 }, number),
            1410 | 1910 => self.carried(line, number),
            5680 => self.tool_temperature(line, number)?,
            670 | 680 if is_ours => self.output(line, number)?,
            660 if is_ours => {
                let input = value(line, b'P', number)?;
                if let Some(heater) = output(input).and_then(|(_, heater)| heater) {
                    self.wait(heater, number);
                }
            }
            _ => return Ok(false),
        }
        Ok(true)
    }

    /// S, or R, which waits for cooling too.
    fn target(
        &mut self,
        heater: u8,
        waits: bool,
        line: &Line,
        number: usize,
    ) -> Result<(), Refusal> {
        let given = match value(line, b'S', number)? {
            None => value(line, b'R', number)?,
            given => given,
        };
        let celsius = checked_c(given, number)?;
        match (celsius, waits) {
            (Some(celsius), false) => self.order(HeatOrder::target(heater, celsius), number),
            (Some(celsius), true) => self.order(HeatOrder::wait_for(heater, celsius), number),
            (None, true) if self.wait(heater, number) => {}
            (None, _) => self.carried(line, number),
        }
        Ok(())
    }

    /// G10 and M568 of RepRapFirmware: S of tool P, which is the first without it. Its standby (R), its offsets
    /// and its state (A) are carried.
    pub(super) fn tool_temperature(&mut self, line: &Line, number: usize) -> Result<(), Refusal> {
        let tool = value(line, b'P', number)?.unwrap_or(0.0);
        let celsius = checked_c(value(line, b'S', number)?, number)?;
        let heater = match tool {
            0.0 => Some(HOT_END),
            1.0 => Some(HOT_END_2),
            _ => None,
        };
        let (Some(heater), Some(celsius)) = (heater, celsius) else {
            self.carried(line, number);
            return Ok(());
        };
        self.order(HeatOrder::target(heater, celsius), number);
        let code = line.words.first().map(code_name).unwrap_or_default();
        let beside = |word: &&Word| !matches!(word.letter, b'G' | b'M' | b'P' | b'S');
        for word in line.words.iter().filter(beside) {
            self.undone(format!("{code} {}", char::from(word.letter)), number);
        }
        Ok(())
    }

    /// What a heater was asked for last.
    pub(super) fn target_c(&self, heater: u8) -> Option<f64> {
        self.targets.get(usize::from(heater)).copied().flatten()
    }

    /// Waits for what a heater was asked for last; false where that is nothing.
    fn wait(&mut self, heater: u8, line: usize) -> bool {
        let celsius = self.target_c(heater).filter(|celsius| *celsius > 0.0);
        if let Some(celsius) = celsius {
            self.order(HeatOrder::wait_for(heater, celsius), line);
        }
        celsius.is_some()
    }

    /// M67 and M68 of our own text.
    fn output(&mut self, line: &Line, number: usize) -> Result<(), Refusal> {
        let given = checked(value(line, b'Q', number)?, number, most_c())?;
        match (output(value(line, b'E', number)?), given) {
            (Some((_, Some(heater))), Some(celsius)) => {
                self.order(HeatOrder::target(heater, celsius), number);
            }
            (Some((_, None)), Some(share)) => {
                let fan_pct = 100.0 * share.min(1.0);
                self.order(HeatOrder::Fan { fan_pct }, number);
            }
            _ => self.carried(line, number),
        }
        Ok(())
    }

    pub(super) fn order(&mut self, order: HeatOrder, line: usize) {
        if let HeatOrder::Heater {
            heater, celsius, ..
        } = order
            && let Some(target) = self.targets.get_mut(usize::from(heater))
        {
            *target = Some(celsius);
        }
        self.found.heat.push(HeatStep {
            line,
            step: self.found.steps.len(),
            order,
        });
    }

    fn carried(&mut self, line: &Line, number: usize) {
        let parameters: Vec<String> = line.words.iter().map(code_name).collect();
        let carried = format!("line {number} {}", parameters.join(" "));
        self.found.carried.push(carried);
        self.left(number);
    }
}

/// What is behind an output, or an input.
fn output(number: Option<f64>) -> Option<(u8, Option<u8>)> {
    let of = |(output, _): &&(u8, Option<u8>)| Some(f64::from(*output)) == number;
    OUTPUTS.iter().find(of).copied()
}

/// A target, °C: RepRapFirmware switches a heater off by absolute zero, which is written so or without decimals.
fn checked_c(given: Option<f64>, line: usize) -> Result<Option<f64>, Refusal> {
    let is_off = |celsius: &f64| (-273.15..=-273.0).contains(celsius);
    match given.filter(is_off) {
        Some(_) => Ok(Some(0.0)),
        None => checked(given, line, most_c()),
    }
}

/// Hottest target, °C.
pub(super) fn most_c() -> f64 {
    f64::from(DECIDEGREES_MAX) / 10.0
}

/// A number from 0 to `most`.
pub(super) fn checked(given: Option<f64>, line: usize, most: f64) -> Result<Option<f64>, Refusal> {
    match given {
        Some(value) if !(0.0..=most).contains(&value) => Err(refusal!(
            "line {line}: a target of {}: write 0 to {} (°C for heaters, M106 of 255 for \
                 fans)",
            Short(value),
            Short(most)
        )),
        given => Ok(given),
    }
}
