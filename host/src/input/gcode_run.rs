//! G-code with tilts -> a run of waypoints: the tip's positions with tool axes and headings.
//!
//! In: a [`GcodeProgram`] that contains A or B (mm, degrees, the head at R_x(A) R_y(B) R_z(C)). Out:
//! [`WaypointRun`] with the file's passes. Long legs are divided, so that the spline through the
//! waypoints stays on them. Not covered: widths, speeds, volumes, travel, heaters and fans: such a run
//! uses the machine's, which is reported.

use super::waypoints::{PassAsked, Waypoint, WaypointRun};
use crate::gcode::{GcodeProgram, Place};
use nalgebra::{Point3, UnitVector3};
use std::f64::consts::TAU;

/// Longest distance of waypoints, mm.
pub(super) const SPACING_MM: f64 = 0.5;
/// Most waypoints that a leg is divided by: of long straight moves.
pub(super) const DIVISIONS_MAX: f64 = 2000.0;

/// The run of a program's passes.
pub fn waypoint_run(program: GcodeProgram) -> WaypointRun {
    let mut points: Vec<Waypoint> = Vec::new();
    let mut heading_rad: Option<f64> = None;
    let mut push = |place: &Place, line: usize, begins: bool| {
        let (axis, heading): (UnitVector3<f64>, f64) = place.axis_and_heading();
        let near = heading_rad.unwrap_or(heading);
        let heading = heading + TAU * ((near - heading) / TAU).round();
        heading_rad = Some(heading);
        points.push(Waypoint {
            line,
            tip_mm: Point3::from(place.tip_mm),
            axis,
            heading_rad: Some(heading),
            width_mm: None,
            height_mm: None,
            section_mm2: None,
            speed_mm_s: None,
            cone_rad: None,
            begins,
            asked: PassAsked::default(),
        });
    };
    for pass in &program.passes {
        let pairs = pass.points.windows(2).zip(&pass.legs);
        for (number, (pair, leg)) in pairs.enumerate() {
            if number == 0 {
                push(&pair[0], leg.line, true);
            }
            let length_mm = pair[1].distance_mm(&pair[0]);
            let count = (length_mm / SPACING_MM).ceil().clamp(1.0, DIVISIONS_MAX) as usize;
            for k in 1..=count {
                let share = k as f64 / count as f64;
                let between = |from: [f64; 3], to: [f64; 3]| -> [f64; 3] {
                    std::array::from_fn(|i| from[i] + share * (to[i] - from[i]))
                };
                let place = Place {
                    tip_mm: between(pair[0].tip_mm, pair[1].tip_mm),
                    turn_deg: between(pair[0].turn_deg, pair[1].turn_deg),
                };
                push(&place, leg.line, false);
            }
        }
    }
    let mut notes = program.notes;
    notes.extend(heat_note(program.heat.len()));
    notes.push(
        "A or B tilts the tool: the path is followed as waypoints, at the machine's speed, with the \
         beads that the nozzle lays at these headings; the file's speeds and volumes are not kept"
            .to_string(),
    );
    WaypointRun {
        name: program.name,
        points,
        notes,
        has_feeds: false,
    }
}

/// That orders of heaters and fans are not kept.
pub(super) fn heat_note(orders: usize) -> Option<String> {
    (orders > 0).then(|| {
        format!(
            "{orders} heater and fan commands are not kept on a path with tilts: set [material] in the machine file"
        )
    })
}
