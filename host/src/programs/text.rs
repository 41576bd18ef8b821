//! Numbers and names as programs have them.

use super::ProgramOptions;
pub(super) use crate::gcode::write::short;
use crate::text::refusal::{Refusal, refusal};
use std::ops::RangeInclusive;

/// Longest name of a program: with the endings of layers RAPID's 32 and KRL's 24 characters.
const NAME_MAX: usize = 16;
/// What every file has in a comment, by which it is known again.
pub const WRITTEN_BY: &str = "written by headway";

/// Digits after the point for lengths in mm: a rounding of at most a tenth of the tolerance.
pub(super) fn digits(options: &ProgramOptions) -> usize {
    let places = (5.0 / options.tolerance_mm).log10().ceil();
    (places.max(2.0) as usize).min(4)
}

/// A number with so many digits that count, rounded down.
pub(super) fn rounded_down(value: f64, digits: i32) -> f64 {
    if value <= 0.0 {
        return 0.0;
    }
    let unit = 10f64.powi(value.log10().floor() as i32 + 1 - digits);
    (value / unit).floor() * unit
}

/// The program's name, where it is one in all four languages.
pub(super) fn program_name(options: &ProgramOptions) -> Result<&str, Refusal> {
    let given = Some(&options.name);
    let rule = "a program's name has letters, digits and underscores, a letter first, at most 16";
    checked_name(given, "", "--output", NAME_MAX, rule)
}

/// A name that was given, where it is an identifier of at most `most` characters.
pub(super) fn checked_name<'a>(
    given: Option<&'a String>,
    usual: &'a str,
    option: &'static str,
    most: usize,
    rule: &'static str,
) -> Result<&'a str, Refusal> {
    let Some(name) = given else { return Ok(usual) };
    let is_plain = name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
    let begins = name.starts_with(|c: char| c.is_ascii_alphabetic());
    match is_plain && begins && name.len() <= most {
        true => Ok(name),
        false => Err(refusal!(
            "{option} {given}: {rule}",
            given = name.chars().take(40).collect::<String>()
        )),
    }
}

/// A number that was given, where it is one of those that are `known`.
pub(super) fn checked_number(
    given: &Option<String>,
    usual: u32,
    option: &'static str,
    known: RangeInclusive<u32>,
    rule: &'static str,
) -> Result<u32, Refusal> {
    let Some(text) = given else { return Ok(usual) };
    let number = text.parse().ok().filter(|number| known.contains(number));
    number.ok_or_else(|| {
        refusal!(
            "{option} {given}: {rule}",
            given = text.chars().take(40).collect::<String>()
        )
    })
}
