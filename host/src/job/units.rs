//! The units of a stream in the header of its job.
//!
//! In: units. Out: a text of the header, and back. Headers of streams in base units have none, and equal those of
//! older versions.

use crate::job::file::JobHeader;
use headway_protocol::units::Units;
use std::collections::BTreeMap;

impl JobHeader {
    /// Units of the stream.
    pub fn units(&self) -> Units {
        units_of_texts(&self.texts).unwrap_or_default()
    }
}

/// Name of the text.
const UNITS_TEXT: &str = "units";

/// The three exponents in decimal digits.
pub(crate) fn units_text(units: &Units) -> Option<(String, String)> {
    let exponents = [
        units.length_exponent,
        units.angle_exponent,
        units.volume_exponent,
    ];
    let [length, angle, volume] = exponents;
    (*units != Units::BASE).then(|| (UNITS_TEXT.to_string(), format!("{length} {angle} {volume}")))
}

/// The units that a header's texts name; `None` if the text is invalid.
pub(crate) fn units_of_texts(texts: &BTreeMap<String, String>) -> Option<Units> {
    let Some(text) = texts.get(UNITS_TEXT) else {
        return Some(Units::BASE);
    };
    let exponents: Result<Vec<u8>, _> = text.split(' ').map(str::parse).collect();
    let [length_exponent, angle_exponent, volume_exponent] = exponents.ok()?.try_into().ok()?;
    let units = Units {
        length_exponent,
        angle_exponent,
        volume_exponent,
    };
    units.is_valid().then_some(units)
}

#[cfg(test)]
mod tests {
    //! Goal: units go into a header's text and come back, and a text that is none is refused.
    use super::*;

    #[test]
    fn units_come_back_from_their_text() {
        let units = Units {
            length_exponent: 5,
            angle_exponent: 0,
            volume_exponent: 17,
        };
        let texts: BTreeMap<_, _> = units_text(&units).into_iter().collect();
        assert_eq!(texts[UNITS_TEXT], "5 0 17");
        assert_eq!(units_of_texts(&texts), Some(units));
        assert_eq!(units_text(&Units::BASE), None);
        assert_eq!(units_of_texts(&BTreeMap::new()), Some(Units::BASE));
        for wrong in [
            "", "5 0", "5 0 17 1", "5 0 -1", "25 0 0", "5  0 17", "a b c",
        ] {
            let texts = BTreeMap::from([(UNITS_TEXT.to_string(), wrong.to_string())]);
            assert_eq!(units_of_texts(&texts), None, "{wrong}");
        }
    }
}
