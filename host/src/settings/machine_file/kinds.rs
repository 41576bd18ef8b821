//! `[kinds]` of a machine file: what each kind of bead asks for.

use crate::settings::kinds::Kinds;
use std::fmt::Write;

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
