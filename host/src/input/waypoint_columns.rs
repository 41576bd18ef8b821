//! The columns of a waypoint file by its head.
//!
//! In: the cells of a head. Out: what each column after the first six means. Not covered: numbers.

use crate::text::refusal::{Refusal, refusal};

/// Columns of a table, as its head may call them: the mandatory ones, and the optional ones after
/// them.
pub(super) const COLUMNS: [&str; 6] = ["x", "y", "z", "nx", "ny", "nz"];
pub(super) const FURTHER: [&str; 5] = [
    "heading_deg",
    "width_mm",
    "height_mm",
    "speed_mm_s",
    "cone_deg",
];

/// Meaning of the columns after the first six. Refuses a head that gives a column the name of another one;
/// other names of the first seven are anybody's.
pub(super) fn further_columns(line: usize, cells: &[&str]) -> Result<Vec<usize>, Refusal> {
    let mut further: Vec<usize> = Vec::new();
    for (column, cell) in cells.iter().enumerate() {
        let name = cell.to_ascii_lowercase();
        let of = COLUMNS.iter().position(|known| *known == name);
        let behind = FURTHER.iter().position(|known| *known == name);
        let refused = || {
            refusal!(
                "line {line}: column {column} is called `{text}`; the columns are x y z nx ny nz in \
             this order, then any of heading_deg, width_mm, height_mm, speed_mm_s, each once",
                column = column + 1,
                text = shortened(cell)
            )
        };
        if of.is_some_and(|of| of != column) || (behind.is_some() && column < COLUMNS.len()) {
            return Err(refused());
        }
        if column >= COLUMNS.len() {
            // A seventh one is the heading, whatever it is called.
            let only = cells.len() == COLUMNS.len() + 1;
            let which = behind.or(only.then_some(0)).ok_or_else(refused)?;
            if further.contains(&which) {
                return Err(refused());
            }
            further.push(which);
        }
    }
    if further.is_empty() {
        further.push(0);
    }
    Ok(further)
}

/// As much of a cell as a message can hold.
pub(super) fn shortened(text: &str) -> String {
    text.chars().take(40).collect()
}
