//! Patterns that are read like a vernier: lines in two halves, the second shifted a little more from line to
//! line; where the halves are in line, the shift is the machine's error.
//!
//! With the nozzle off its axis by e (tool axes) the bead's middle at heading phi is R(phi) e from the
//! commanded position: at headings half a turn apart the two halves differ by 2 e. With a pivot length L
//! instead of the true L', the tip of a head that is tilted by theta is off by (L - L') sin(theta), towards the
//! side of the tilt; the halves are printed with opposite tilts, so that they differ by twice that.

use super::error::machine;
use super::line::{Line, length_mm, longer_mm, pitch_mm};
use super::{Asked, CalibrationError, Drawn, one_digit, values};
use crate::settings::Settings;
use headway_firmware::configuration::Kinematics;
use nalgebra::Vector3;

/// Usual length of a line, mm.
const LENGTH_MM: f64 = 50.0;
/// Usual lines of a row.
const LINES: u32 = 11;
/// Usual tilt of the pivot's lines, degrees: a shift of half the error, and the nozzle's edge still
/// clear of the bed.
const TILT_DEG: f64 = 15.0;

/// One row of lines in halves.
struct Row<'a> {
    settings: &'a Settings,
    /// Where its first line begins, mm.
    origin_mm: [f64; 2],
    /// Along y in place of x.
    along_y: bool,
    length_mm: f64,
    /// Heading of each half, degrees.
    headings_deg: [f64; 2],
    /// Tool axis of each half.
    axes: [Vector3<f64>; 2],
    what: &'a str,
}

impl Row<'_> {
    /// The halves of line `number` of `count`, the second shifted.
    fn halves(&self, number: usize, count: usize, value: f64, shift_mm: f64) -> [Line; 2] {
        let settings = self.settings;
        let beside_mm = number as f64 * pitch_mm(settings);
        let middle_mm = 0.5 * self.length_mm;
        // The ends reach half the widest bead further: the halves do not touch.
        let apart_mm = 1.25 * settings.aperture.major_mm();
        let end_mm = match 2 * number + 1 == count {
            true => self.length_mm + longer_mm(settings),
            false => self.length_mm,
        };
        let place = |along_mm: f64, across_mm: f64| {
            let [x, y] = self.origin_mm;
            match self.along_y {
                false => [x + along_mm, y + across_mm],
                true => [x + across_mm, y + along_mm],
            }
        };
        let half = |side: usize, from_mm: f64, to_mm: f64, across_mm: f64| {
            let ends = [place(from_mm, across_mm), place(to_mm, across_mm)];
            let heading_deg = self.headings_deg[side];
            let what = format!("{}, half {} at {heading_deg}°", self.what, side + 1);
            Line::straight(what, ends, heading_deg, settings)
                .leaning(self.axes[side])
                .of_value(value)
        };
        [
            half(0, 0.0, middle_mm - apart_mm, beside_mm),
            half(1, middle_mm + apart_mm, end_mm, beside_mm + shift_mm),
        ]
    }
}

/// Start of a row next to another one, mm.
fn beside_mm(length_mm: f64, settings: &Settings) -> f64 {
    length_mm + longer_mm(settings) + 2.0 * pitch_mm(settings)
}

/// Nozzle off its axis: halves half a turn apart, along and across the nozzle.
pub(super) fn nozzle(asked: &Asked, settings: &Settings) -> Result<Drawn, CalibrationError> {
    let widest_mm = settings.aperture.major_mm();
    let most_mm = 5.0 * one_digit(0.1 * widest_mm);
    let room_mm = 0.4 * pitch_mm(settings);
    let values = values(asked, [-most_mm, most_mm], LINES, [-room_mm, room_mm])?;
    let length_mm = length_mm(asked.length_mm, LENGTH_MM, settings);
    let next_mm = beside_mm(length_mm, settings);
    let rows = [
        ([0.0, 180.0], "row 1", 0.0),
        ([90.0, -90.0], "row 2", next_mm),
    ];
    let mut lines = Vec::new();
    for (headings_deg, what, x_mm) in rows {
        let row = Row {
            settings,
            origin_mm: [x_mm, 0.0],
            along_y: false,
            length_mm,
            headings_deg,
            axes: [Vector3::z(); 2],
            what,
        };
        for (number, &value) in values.iter().enumerate() {
            lines.extend(row.halves(number, values.len(), value, 2.0 * value));
        }
    }
    Ok(Drawn {
        unit: "mm",
        lines,
        machines: Vec::new(),
        reading: vec![
            "In each row, front to back, find the line whose right half continues its left half; the longer \
             line is the middle one."
                .to_string(),
            "Row 1: its value is how far the opening's middle is off the turning axis along tool Y (across \
             the long side of the opening)."
                .to_string(),
            "Row 2: the same along tool X (along the long side).".to_string(),
        ],
        change: "No key: the planner takes the opening to turn about its middle. Centre the nozzle in its \
                 seat until both rows read 0 (an arm: `tool_mm`)."
            .to_string(),
    })
}

/// The present length; a machine without one, or with several numbers in its place, is refused.
fn pivot_length_mm(settings: &Settings) -> Result<f64, CalibrationError> {
    let several = |kinematics: &str, key: &str| {
        Err(machine!(
            "a {kinematics} machine has no single pivot length: its {key} are several numbers that these lines \
             do not tell apart; measure them with an indicator on the tip while the axes tilt, until it stands \
             still"
        ))
    };
    match settings.machine.kinematics {
        Kinematics::Gantry { pivot_length_mm } => Ok(pivot_length_mm),
        Kinematics::Planar => Err(machine!(
            "a planar machine has no pivot: this pattern is for heads that tilt (kinematics gantry); leave it out"
        )),
        Kinematics::Trunnion { .. } => several("trunnion", "centre_mm"),
        Kinematics::Arm6 { .. } => several("arm6", "tool and arm lengths"),
        Kinematics::Axes { .. } => several("axes", "offset_mm"),
    }
}

/// Pivot length: halves that are tilted to either side.
pub(super) fn pivot(asked: &Asked, settings: &Settings) -> Result<Drawn, CalibrationError> {
    let pivot_mm = pivot_length_mm(settings)?;
    let tilt_deg = asked.tilt_deg.unwrap_or(TILT_DEG);
    let (sin, cos) = tilt_deg.to_radians().sin_cos();
    let shift_mm = |value: f64| 2.0 * (pivot_mm - value) * sin;
    let most_mm = 5.0 * one_digit(0.1 * settings.aperture.major_mm() / (2.0 * sin));
    let room_mm = 0.4 * pitch_mm(settings) / sin;
    let values = values(
        asked,
        [pivot_mm - most_mm, pivot_mm + most_mm],
        LINES,
        [(pivot_mm - room_mm).max(0.0), pivot_mm + room_mm],
    )?;
    let length_mm = length_mm(asked.length_mm, LENGTH_MM, settings);
    let next_mm = beside_mm(length_mm, settings);
    let rows = [
        (
            false,
            0.0,
            [Vector3::new(0.0, sin, cos), Vector3::new(0.0, -sin, cos)],
            "row 1",
        ),
        (
            true,
            next_mm,
            [Vector3::new(sin, 0.0, cos), Vector3::new(-sin, 0.0, cos)],
            "row 2",
        ),
    ];
    let mut lines = Vec::new();
    for (along_y, x_mm, axes, what) in rows {
        // The long side along the line: a narrow bead, and the nozzle's edge hardly dips.
        let heading_deg = if along_y { 90.0 } else { 0.0 };
        let row = Row {
            settings,
            origin_mm: [x_mm, 0.0],
            along_y,
            length_mm,
            headings_deg: [heading_deg; 2],
            axes,
            what,
        };
        for (number, &value) in values.iter().enumerate() {
            lines.extend(row.halves(number, values.len(), value, shift_mm(value)));
        }
    }
    Ok(Drawn {
        unit: "mm",
        lines,
        machines: Vec::new(),
        reading: vec![
            format!(
                "In each row find the line whose second half continues its first; the halves lean by \
                 {tilt_deg}° to either side. The longer line is the middle one, the length of now."
            ),
            "Its value is the pivot length. Row 1 (along x) reads it by tilting about X (A), row 2 (along y) \
             by tilting about Y (B): where they differ, the two axes do not cross; take the mean."
                .to_string(),
        ],
        change: "`pivot_length_mm`".to_string(),
    })
}
