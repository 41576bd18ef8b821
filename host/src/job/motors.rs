//! The motors of a machine in the header of its job.
//!
//! In: a matrix. Out: a text of the header, and back. Headers of machines whose motors are their joints have none,
//! and equal those of older versions.

use crate::job::file::JobHeader;
use headway_firmware::configuration::motors::MotorMatrix;
use std::borrow::Cow;

/// Name of the text that has the machine's motors where they are not its joints: headers before it stay what they are.
pub(crate) const MOTORS_TEXT: &str = "motors";

/// A header as it is written: its machine's motors are in their text alone.
pub(crate) fn with_motors_as_text(header: &JobHeader) -> Cow<'_, JobHeader> {
    let mut header = Cow::Borrowed(header);
    if !header.machine.motors.is_direct() {
        header.to_mut().machine.motors = MotorMatrix::DIRECT;
    }
    header
}

/// Postcard in hexadecimal digits.
pub(crate) fn motors_text(motors: &MotorMatrix) -> Option<(String, String)> {
    if motors.is_direct() {
        return None;
    }
    let bytes = postcard::to_extend(motors, Vec::new()).ok()?;
    let digits = bytes.iter().map(|byte| format!("{byte:02x}"));
    Some((MOTORS_TEXT.to_string(), digits.collect()))
}

pub(crate) fn motors_of_text(text: &str) -> Option<MotorMatrix> {
    let digit = |place: usize| (*text.as_bytes().get(place)? as char).to_digit(16);
    let byte = |place| Some((digit(2 * place)? << 4 | digit(2 * place + 1)?) as u8);
    let bytes: Option<Vec<u8>> = (0..text.len().div_ceil(2)).map(byte).collect();
    postcard::from_bytes(&bytes?).ok()
}

#[cfg(test)]
mod tests {
    //! Goal: motors go into a header's text and come back, and a text that is none is refused. Method: CoreXY.
    use super::*;
    use crate::settings::Settings;

    #[test]
    fn motors_come_back_from_their_text() {
        let motors = Settings::core_xy().machine.motors;
        let (name, text) = motors_text(&motors).expect("not direct");
        assert_eq!(name, MOTORS_TEXT);
        assert_eq!(motors_of_text(&text), Some(motors));
        assert_eq!(motors_text(&MotorMatrix::DIRECT), None);
        for wrong in ["", "0", "zz", &text[..6], "µµ"] {
            assert_eq!(motors_of_text(wrong), None, "{wrong}");
        }
    }
}
