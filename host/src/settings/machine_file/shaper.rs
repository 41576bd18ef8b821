//! The machine file's input shapers: a group for each joint that has one.

use crate::settings::check::{joint_names, kinematics_name};
use crate::text::refusal::{Refusal, refusal};
use headway_firmware::configuration::shaping::{Shaper, ShaperKind};
use headway_firmware::configuration::{JOINTS_MAX, Kinematics, MachineConfiguration};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::fmt::Write;

/// Damping ratio of a frame of which nothing is known: Klipper's.
const DAMPING: f64 = 0.1;

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "lowercase")]
enum KindName {
    Zv,
    Mzv,
    Ei,
    Smooth,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FileShaper {
    kind: KindName,
    frequency_hz: f64,
    damping: Option<f64>,
}

/// In the joints' order; refuses one for a joint that the machine has not.
pub(super) fn shapers(
    given: &BTreeMap<String, FileShaper>,
    kinematics: &Kinematics,
) -> Result<[Shaper; JOINTS_MAX], Refusal> {
    let names = joint_names(kinematics);
    let mut shapers = [Shaper::default(); JOINTS_MAX];
    for (name, shaper) in given {
        let joint = names.iter().position(|joint| joint == name);
        let place = joint.and_then(|joint| shapers.get_mut(joint));
        let place = place.ok_or_else(|| {
            let kinematics = kinematics_name(kinematics);
            refusal!(
                "shaper.{name}: kinematics \"{kinematics}\" have no such joint; take the group out"
            )
        })?;
        *place = Shaper {
            kind: match shaper.kind {
                KindName::Zv => ShaperKind::Zv,
                KindName::Mzv => ShaperKind::Mzv,
                KindName::Ei => ShaperKind::Ei,
                KindName::Smooth => ShaperKind::Smooth,
            },
            frequency_hz: shaper.frequency_hz,
            damping: shaper.damping.unwrap_or(DAMPING),
        };
    }
    Ok(shapers)
}

/// The groups of joints that are shaped.
pub(super) fn write_shapers(text: &mut String, machine: &MachineConfiguration) -> std::fmt::Result {
    let names = joint_names(&machine.kinematics);
    for (name, shaper) in names.iter().zip(&machine.shapers) {
        let kind = match shaper.kind {
            ShaperKind::None => continue,
            ShaperKind::Zv => "zv",
            ShaperKind::Mzv => "mzv",
            ShaperKind::Ei => "ei",
            ShaperKind::Smooth => "smooth",
        };
        writeln!(
            text,
            "\n# Input shaper: zv, mzv, ei or smooth, at the frequency at which this joint's frame rings."
        )?;
        writeln!(text, "[shaper.{name}]\nkind = \"{kind}\"")?;
        writeln!(
            text,
            "frequency_hz = {}",
            super::write::number(shaper.frequency_hz)
        )?;
        writeln!(text, "damping = {}", super::write::number(shaper.damping))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    //! Goal: shapers are read and written back as they are, and what cannot be run is refused with its
    //! place. Method: machine files with a group more.
    use super::super::tests::planar_with as read;
    use super::super::{from_toml, to_toml};
    use crate::settings::Settings;

    #[test]
    fn shapers_read_back() {
        let group = "[shaper.x]\nkind = \"mzv\"\nfrequency_hz = 41.3\n\
                     [shaper.y]\nkind = \"smooth\"\nfrequency_hz = 55\ndamping = 0.04\n";
        let settings = read(group).expect("a machine");
        assert_eq!(settings.machine.shapers[0].damping, 0.1);
        assert_eq!(settings.machine.shapers[1].frequency_hz, 55.0);
        assert_eq!(from_toml(&to_toml(&settings)).expect("again"), settings);
        assert_ne!(settings.machine.hash(), Settings::planar().machine.hash());
    }

    #[test]
    fn shapers_that_cannot_be_are_refused() {
        for (group, part) in [
            ("[shaper.q]\nkind = \"ei\"\nfrequency_hz = 40\n", "shaper.q"),
            ("[shaper.a]\nkind = \"ei\"\nfrequency_hz = 40\n", "shaper.a"),
            (
                "[shaper.x]\nkind = \"zvd\"\nfrequency_hz = 40\n",
                "is not known",
            ),
            (
                "[shaper.x]\nkind = \"ei\"\nfrequency_hz = 2\n",
                "joint 0 does not fit",
            ),
            (
                "[shaper.y]\nkind = \"zv\"\nfrequency_hz = 0\n",
                "joint 1 does not fit",
            ),
            (
                "[shaper.y]\nkind = \"zv\"\nfrequency_hz = nan\n",
                "joint 1 does not fit",
            ),
            (
                "[shaper.y]\nkind = \"zv\"\nfrequency_hz = 1e-300\n",
                "joint 1 does not fit",
            ),
            (
                "[shaper.y]\nkind = \"smooth\"\nfrequency_hz = 1e300\n",
                "joint 1 does not fit",
            ),
            (
                "[shaper.x]\nkind = \"zv\"\nfrequency_hz = 40\ndamping = 1\n",
                "joint 0",
            ),
        ] {
            let error = read(group).expect_err(group);
            assert!(error.contains(part), "{group}: {error}");
        }
    }
}
