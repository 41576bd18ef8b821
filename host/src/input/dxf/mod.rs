//! DXF: the contours of a drawing, curves flattened.
//!
//! ```text
//! bytes --records--> whole entities of chosen layers --curves--> chords (mm)
//!       --join--> contours --outline--> regions
//! ```
//! Nesting follows the even-odd rule: a contour in another one is a hole, one in a hole an island. In:
//! ASCII DXF, unit by `$INSUNITS` (mm where it gives none) or `--units`. Out: contours, mm before
//! `--scale`, and notes. Not covered: blocks, hatches, texts, dimensions, solids, and binary DXF.

mod curves;
pub(super) mod join;
mod records;

use super::outline::{Drawing, RawRing, Rule, Shape};
use super::{ReadOptions, Units};
use crate::input::error;
use crate::text::refusal::Refusal;
use curves::Flattener;

fn syntax(problem: String) -> Refusal {
    error::syntax("DXF", &problem)
}

/// Reads the contours of a drawing.
pub(super) fn read(bytes: &[u8], options: &ReadOptions) -> Result<Drawing, Refusal> {
    let text = text(bytes)?;
    let mut found = records::read(&text, &options.dxf_layers)?;
    if found.entities.is_empty() {
        let left_out = match found.notes.is_empty() {
            true => "it has no lines, arcs, circles, polylines, ellipses or splines".to_string(),
            false => found.notes.join("; "),
        };
        return Err(error::nothing_filled(&left_out));
    }
    let mut notes = std::mem::take(&mut found.notes);
    let unit = match options.units {
        Some(units) => units,
        None => unit(found.units, &mut notes)?,
    };
    let mut flattener = Flattener {
        unit_mm: unit.mm(),
        tolerance_mm: options.flatten_mm / options.scale,
        points: 0,
    };
    let each = found.entities.iter().map(|entity| flattener.piece(entity));
    let pieces: Vec<RawRing> = each.collect::<Result<_, _>>()?;
    let rings = match options.centre_lines {
        true => pieces,
        false => join::contours(pieces, options.scale, false, &mut notes)?,
    };
    let what = "the drawing".to_string();
    let rule = Rule::EvenOdd;
    Ok(Drawing {
        name: None,
        shapes: vec![Shape {
            what,
            rings,
            rule,
            colour: None,
        }],
        notes,
    })
}

/// The text; bytes of another code page than UTF-8 only occur in names.
fn text(bytes: &[u8]) -> Result<String, Refusal> {
    let problem = if bytes.starts_with(b"AutoCAD Binary DXF") || bytes.starts_with(b"AutoCAD DXB") {
        "it is binary; save it as ASCII DXF"
    } else if bytes.starts_with(b"AC10") {
        "it is a DWG file; save it as ASCII DXF"
    } else {
        return Ok(match std::str::from_utf8(bytes) {
            Ok(text) => text.to_string(),
            Err(_) => bytes.iter().map(|&byte| char::from(byte)).collect(),
        });
    };
    Err(syntax(problem.to_string()))
}

/// The drawing's unit, as `$INSUNITS` counts them.
fn unit(number: Option<i32>, notes: &mut Vec<String>) -> Result<Units, Refusal> {
    Ok(match number {
        None | Some(0) => {
            notes.push("the drawing says no units; mm were taken (see --units)".to_string());
            Units::Mm
        }
        Some(1) => Units::In,
        Some(4) => Units::Mm,
        Some(5) => Units::Cm,
        Some(6) => Units::M,
        Some(13) => Units::Um,
        Some(other) => {
            let name = match other {
                2 => "feet, ",
                8 => "microinches, ",
                9 => "mils, ",
                10 => "yards, ",
                14 => "decimetres, ",
                _ => "",
            };
            let given = format!("{name}$INSUNITS {other}");
            return Err(error::unknown_units(&given));
        }
    })
}

#[cfg(test)]
mod tests;
