//! Rows of the tables of figures: a name, and a value with its unit where it is known.

use super::figures::{Figures, KindFigures, SlowPlaceFigures};
use std::collections::BTreeMap;

/// Layers that are listed in text, the longest ones.
const LAYERS_TOLD: usize = 3;
/// Limits that are listed in text.
const LIMITS_TOLD: usize = 4;
/// The tables.
pub(super) const GROUPS: [&str; 5] = [
    "Coverage",
    "Layers",
    "Motion",
    "Limits and stream",
    "Simulated steps",
];
/// Rows of layers and kinds follow those of figures in the table of layers.
const LAYER_ROWS: u16 = 299;

/// A line of a table.
pub(super) struct Row {
    /// Its table in hundreds, and its place there.
    pub place: u16,
    /// What is shown.
    pub what: String,
    /// The value, with its unit.
    pub text: String,
}

/// The row of a figure that is known.
pub(super) fn row<T>(
    place: u16,
    what: &str,
    value: &Option<T>,
    text: impl Fn(&T) -> String,
) -> Option<Row> {
    let text = text(value.as_ref()?);
    (!text.is_empty()).then(|| Row {
        place,
        what: what.to_string(),
        text,
    })
}

pub(super) fn number(digits: usize, unit: &str) -> impl Fn(&f64) -> String {
    move |value| format!("{value:.digits$} {unit}").trim_end().to_string()
}

/// The limits that take most of the time.
pub(super) fn time_shares(shares: &BTreeMap<String, f64>) -> String {
    let mut shares: Vec<_> = shares.iter().collect();
    shares.sort_by(|a, b| b.1.total_cmp(a.1));
    let told = shares.iter().take(LIMITS_TOLD);
    let told = told.map(|(limit, share)| format!("{limit} {:.0} %", 100.0 * **share));
    told.collect::<Vec<_>>().join(", ")
}

/// The first place; empty if there is none.
pub(super) fn slowest_place(places: &[SlowPlaceFigures]) -> String {
    places.first().map_or_else(String::new, |place| {
        format!(
            "{:.2} s a millimetre at ({:.2}, {:.2}), by {}",
            place.seconds, place.x_mm, place.y_mm, place.limit
        )
    })
}

impl Figures {
    /// Rows of groups of layers, of kinds of bead, and of the longest layers.
    pub(super) fn layer_rows(&self) -> impl Iterator<Item = Row> {
        let kinds = self.layer_kinds.iter().flatten();
        let used = self.by_kind.iter().flatten().map(|(name, used)| {
            let share_pct = 100.0 * used.seconds / self.print_s.unwrap_or(f64::INFINITY);
            let value = format!(
                "{:.1} s ({share_pct:.1} %), {:.1} mm³",
                used.seconds, used.volume_mm3
            );
            (format!("time, volume: {name}"), value)
        });
        let longest = self
            .by_layer
            .iter()
            .flatten()
            .take(LAYERS_TOLD)
            .map(|layer| {
                let value = format!("{:.1} s, {:.1} mm³", layer.seconds, layer.volume_mm3);
                let what = format!("long layer {}, z {:.2}", layer.layer + 1, layer.z_mm);
                (what, value)
            });
        let rows = kinds.map(KindFigures::row).chain(used).chain(longest);
        rows.map(|(what, text)| Row {
            place: LAYER_ROWS,
            what,
            text,
        })
    }
}
