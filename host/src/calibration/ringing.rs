//! Walls on which the ringing of a frame is visible: waves after a corner, spaced by the distance that the head
//! travels in a period.
//!
//! In: the requested pattern, the settings. Out: two walls of some layers, each an angle of two legs: after the
//! corner the joint that has just stopped rings across the leg that is printed next. Not covered: the sweep for an
//! accelerometer (`sweep`).

use super::error::check_linear_joints;
use super::line::{Line, length_mm, pitch_mm};
use super::{Asked, CalibrationError, Drawn};
use crate::settings::Settings;
use headway_firmware::configuration::shaping::ShaperKind;

/// Usual length of a leg, mm: thirty waves of 40 Hz at 80 mm/s.
const LEG_MM: f64 = 60.0;
/// Height of the walls, mm: a light from the side shows the waves.
const WALL_MM: f64 = 3.0;
/// Most layers.
const LAYERS_MAX: f64 = 60.0;
/// Both legs are printed with the same width.
const HEADING_DEG: f64 = 45.0;

/// Walls with a corner, in either order of their legs.
pub(super) fn ringing(asked: &Asked, settings: &Settings) -> Result<Drawn, CalibrationError> {
    check_linear_joints(settings)?;
    let leg_mm = length_mm(asked.length_mm, LEG_MM, settings);
    let inside_mm = 2.0 * pitch_mm(settings);
    let height_mm = settings.layer_height_mm;
    let layers = (WALL_MM / height_mm).round().clamp(1.0, LAYERS_MAX) as u32;
    let mut lines = Vec::new();
    for layer in 1..=layers {
        let z_mm = height_mm * f64::from(layer);
        // The last leg is the one to be read.
        let walls = [
            ("y", [[0.0, leg_mm], [0.0, 0.0], [leg_mm, 0.0]], 0.0),
            ("x", [[leg_mm, 0.0], [0.0, 0.0], [0.0, leg_mm]], inside_mm),
        ];
        for (joint, places, off_mm) in walls {
            let places = places.into_iter();
            let places = places.map(|[x_mm, y_mm]| [x_mm + off_mm, y_mm + off_mm, z_mm]);
            let mut line = Line::through(
                format!("wall for {joint}, layer {layer}"),
                places,
                HEADING_DEG,
            );
            for point in &mut line.points {
                point.height_mm = Some(height_mm);
            }
            lines.push(line);
        }
    }
    let speed_mm_s = settings.speed_mm_s * settings.plan_share;
    let mut reading = vec![
        format!(
            "Outer wall, the leg along X: its waves behind the corner are the ringing of Y. Inner wall, the leg along \
             Y: that of X. The head goes {speed_mm_s:.1} mm/s there: count waves from the second one on, and measure how \
             long they are together. Frequency = {speed_mm_s:.1} times waves, by their length in mm; waves {:.2} mm \
             apart are 40 Hz.",
            speed_mm_s / 40.0
        ),
        "Damping: by how much a wave is lower than the one before it, as a ratio r below 1: -ln(r) / 6.28. Where that \
         cannot be seen, leave `damping` out."
            .to_string(),
    ];
    reading.extend(shaped_note(settings));
    Ok(Drawn {
        unit: "-",
        lines,
        machines: Vec::new(),
        reading,
        change: CHANGE.to_string(),
    })
}

/// What to change by either pattern.
pub(super) const CHANGE: &str = "`[shaper.x]` and `[shaper.y]`: `kind = \"mzv\"`, `frequency_hz` and `damping` as read; \
     `headway machine check` tells what it does to corners";

/// On a machine with a shaper, the pattern shows the remaining ringing.
pub(super) fn shaped_note(settings: &Settings) -> Option<String> {
    let shapers = settings.machine.shapers.iter();
    let is_shaped = shapers
        .into_iter()
        .any(|shaper| shaper.kind != ShaperKind::None);
    is_shaped.then(|| {
        "This machine is shaped already: what is seen is what the shapers leave. To find the frequency itself take the \
         `[shaper]` groups out of the machine file and tell the board."
            .to_string()
    })
}
