//! `[kinds]` of a machine file: what each kind of bead asks for.

use crate::settings::kinds::{KindSettings, Kinds};
use serde::Deserialize;
use std::fmt::Write;

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct FileKinds {
    walls: FileKind,
    solid: FileKind,
    sparse: FileKind,
    bridge: FileKind,
    skirt: FileKind,
    first_layer: FileKind,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct FileKind {
    speed_mm_s: Option<f64>,
    acceleration_mm_s2: Option<f64>,
    flow_factor: Option<f64>,
}

impl FileKind {
    fn settings(&self) -> KindSettings {
        KindSettings {
            speed_mm_s: self.speed_mm_s,
            acceleration_mm_s2: self.acceleration_mm_s2,
            flow_factor: self.flow_factor,
        }
    }
}

impl FileKinds {
    pub(super) fn kinds(&self) -> Kinds {
        Kinds {
            walls: self.walls.settings(),
            solid: self.solid.settings(),
            sparse: self.sparse.settings(),
            bridge: self.bridge.settings(),
            skirt: self.skirt.settings(),
            first_layer: self.first_layer.settings(),
        }
    }
}

/// Writes the kinds that ask for something.
pub(super) fn write_kinds(text: &mut String, kinds: &Kinds) -> std::fmt::Result {
    for (name, kind) in kinds.named() {
        let keys = [
            ("speed_mm_s", kind.speed_mm_s),
            ("acceleration_mm_s2", kind.acceleration_mm_s2),
            ("flow_factor", kind.flow_factor),
        ];
        let mut known = keys
            .into_iter()
            .filter_map(|(key, value)| Some((key, value?)));
        let Some(first) = known.next() else {
            continue;
        };
        writeln!(text, "\n[kinds.{name}]")?;
        for (key, value) in std::iter::once(first).chain(known) {
            // A whole number is none without its point.
            writeln!(text, "{key} = {value:?}")?;
        }
    }
    Ok(())
}
