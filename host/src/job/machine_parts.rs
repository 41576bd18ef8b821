//! Parts of a machine that stand in the header of its job as texts of their own: its motors, the extruder's curves.
//!
//! In: a machine. Out: texts of the header, and the machine back. Headers of machines whose motors are their joints,
//! and whose extruder has one factor, have none and equal those of older versions.

use crate::job::file::JobHeader;
use headway_firmware::configuration::MachineConfiguration;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::borrow::Cow;
use std::collections::BTreeMap;

/// Names of the texts.
const MOTORS_TEXT: &str = "motors";
const CURVES_TEXT: &str = "flow_curves";

/// A header as it is written: what has a text of its own is there alone.
pub(crate) fn with_parts_as_texts(header: &JobHeader) -> Cow<'_, JobHeader> {
    let mut header = Cow::Borrowed(header);
    if !(header.machine.motors.is_direct() && header.machine.curves.is_none()) {
        header.to_mut().machine = header.machine.plain();
    }
    header
}

/// The texts of a machine.
pub(crate) fn part_texts(machine: &MachineConfiguration) -> impl Iterator<Item = (String, String)> {
    let motors = (!machine.motors.is_direct()).then(|| digits(&machine.motors));
    let curves = (!machine.curves.is_none()).then(|| digits(&machine.curves));
    let named = |name: &str, text: Option<Option<String>>| Some((name.to_string(), text??));
    let texts = [named(MOTORS_TEXT, motors), named(CURVES_TEXT, curves)];
    texts.into_iter().flatten()
}

/// Puts back what the texts have; `None` if one cannot be read.
pub(crate) fn take_parts(
    machine: &mut MachineConfiguration,
    texts: &BTreeMap<String, String>,
) -> Option<()> {
    if let Some(text) = texts.get(MOTORS_TEXT) {
        machine.motors = of_digits(text)?;
    }
    if let Some(text) = texts.get(CURVES_TEXT) {
        machine.curves = of_digits(text)?;
    }
    Some(())
}

/// Postcard in hexadecimal digits.
fn digits<T: Serialize>(part: &T) -> Option<String> {
    let bytes = postcard::to_extend(part, Vec::new()).ok()?;
    Some(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

fn of_digits<T: DeserializeOwned>(text: &str) -> Option<T> {
    let digit = |place: usize| (*text.as_bytes().get(place)? as char).to_digit(16);
    let byte = |place| Some((digit(2 * place)? << 4 | digit(2 * place + 1)?) as u8);
    let bytes: Option<Vec<u8>> = (0..text.len().div_ceil(2)).map(byte).collect();
    postcard::from_bytes(&bytes?).ok()
}

#[cfg(test)]
mod tests {
    //! Goal: parts go into a header's texts and come back, and a text that is none is refused. Method: CoreXY with an
    //! extruder that loses.
    use super::*;
    use crate::settings::Settings;

    #[test]
    fn parts_come_back_from_their_texts() {
        let mut machine = Settings::core_xy().machine;
        machine.curves.loss.push([5.0, 0.1]).expect("room");
        let texts: BTreeMap<String, String> = part_texts(&machine).collect();
        let mut read = machine.plain();
        assert_eq!(take_parts(&mut read, &texts), Some(()));
        assert_eq!(read, machine);
        assert_eq!(part_texts(&machine.plain()).count(), 0);
        for (name, text) in &texts {
            for wrong in ["", "0", "zz", &text[..6], "µµ"] {
                let texts = BTreeMap::from([(name.clone(), wrong.to_string())]);
                assert_eq!(take_parts(&mut read, &texts), None, "{name}: {wrong}");
            }
        }
    }
}
