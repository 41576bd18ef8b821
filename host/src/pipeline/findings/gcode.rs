//! Findings of a planned G-code file.
//!
//! In: the file, its plan. Out: figures, notes for the user, objections.

use super::objections::Objection;
use super::settings_warnings::settings_warnings;
use super::wide_beads::{Laid, LateLayers};
use super::{Findings, doubled_note, shared_figures};
use crate::gcode::GcodeProgram;
use crate::job::heat::{HeatOrder, left_on};
use crate::pipeline::gcode::GcodePlan;
use crate::report::figures::Figures;
use crate::settings::Settings;

/// Difference from the file's volume that is reported, per cent.
const VOLUME_TOLD_PCT: f64 = 0.5;

/// Move of the whole path that is reported, mm.
const MOVED_TOLD_MM: f64 = 0.01;

/// Length at other widths that is reported, mm.
const OFF_TOLD_MM: f64 = 0.1;

/// Findings of a plan that took `plan_s` seconds, made with these settings.
pub fn gcode_findings(
    program: &GcodeProgram,
    planned: &GcodePlan,
    plan_s: f64,
    settings: &Settings,
) -> Findings {
    let mut warnings = warnings(program, planned);
    warnings.extend(settings_warnings(settings));
    let transform = &planned.transform;
    let may_tell = settings.at_mm.is_none() && !program.is_drawn();
    warnings.extend(moved(transform.offset_mm).filter(|_| may_tell));
    let touches = planned.touches.as_ref();
    let objections = touches.and_then(|touches| Objection::of_touches(touches, transform));
    let mut objections: Vec<Objection> = objections.into_iter().collect();
    let laid = Laid::NOTHING.with(&planned.stream, &planned.settings);
    let late = match program.is_drawn() {
        true => LateLayers::of_marks(&planned.stream, &planned.settings),
        false => LateLayers::default(),
    };
    objections.extend(laid.objections(&late, transform, &planned.settings));
    let volume_mm3 = planned.figures.volume_mm3;
    let wide = laid.figures(&late, volume_mm3, transform, &planned.settings);
    Findings {
        figures: own_figures(program, planned, plan_s).merged_with(&wide),
        objections,
        warnings,
        unreachable: Vec::new(),
        left_out: Vec::new(),
    }
}

/// What the plan by itself came to.
fn own_figures(program: &GcodeProgram, planned: &GcodePlan, plan_s: f64) -> Figures {
    let f = &planned.figures;
    Figures {
        layers: Some(u64::from(f.layers)),
        time_bound_s: Some(planned.motion.time_bound_s),
        slicer_estimate_s: program.estimate_s,
        plan_s: Some(plan_s),
        segments: Some(planned.stream.knots.len() as u64),
        ..shared_figures(f, false, [0.0; 2], planned.touches.as_ref())
    }
}

fn warnings(program: &GcodeProgram, planned: &GcodePlan) -> Vec<String> {
    let mut warnings = Vec::new();
    let f = &planned.figures;
    if let Some(estimate_s) = program.estimate_s {
        warnings.push(format!(
            "{} reckons with {estimate_s:.1} s, this job takes {:.1} s: {:+.1} %",
            program.slicer.name(),
            f.print_s,
            100.0 * (f.print_s / estimate_s - 1.0)
        ));
    }
    let aperture = &planned.settings.aperture;
    let widths_mm = [2.0 * aperture.major_mm(), 2.0 * aperture.minor_mm()];
    let sides = ["wider", "narrower"]
        .iter()
        .zip(planned.beyond_mm)
        .zip(widths_mm);
    for ((side, beyond_mm), width_mm) in sides {
        if beyond_mm > 0.0 {
            warnings.push(format!(
                "{beyond_mm:.1} mm of {:.1} mm of beads are to be {side} than the {width_mm:.3} mm that this \
                 nozzle lays: the volume is the file's, the bead as wide as it can be made; slice for \
                 widths of {:.3} to {:.3} mm",
                f.print_mm, widths_mm[1], widths_mm[0]
            ));
        }
    }
    let off = &planned.off;
    let [meant, volume] = match program.is_drawn() {
        true => ["asked for", "that of beads as asked for"],
        false => ["the file's", "the file's"],
    };
    if off.eighth_mm > OFF_TOLD_MM {
        warnings.push(format!(
            "{:.1} mm of {:.1} mm of beads are laid at corners and on links while the nozzle turns, wider or narrower \
             than {meant} by more than an eighth, {:.1} mm of them by more than a third ({:.1} mm in one piece at \
             most): the volume is {volume}",
            off.eighth_mm, f.print_mm, off.third_mm, off.longest_mm
        ));
    }
    warnings.extend(planned.jumps.notes());
    warnings.extend(head_unknown(planned));
    let left: Vec<String> = left_on(&planned.heat).iter().map(HeatOrder::text).collect();
    if !left.is_empty() {
        warnings.push(format!(
            "the file's end leaves on: {}; the job switches it off there (--leave-hot of stream and export keeps it)",
            left.join(", ")
        ));
    }
    let flow = planned.settings.flow_factor;
    if let Some(volume_mm3) = program.volume_mm3().map(|mm3| mm3 * flow) {
        let beside_pct = 100.0 * (f.volume_mm3 / volume_mm3.max(1e-9) - 1.0);
        if beside_pct.abs() > VOLUME_TOLD_PCT {
            warnings.push(format!(
                "the job deposits {beside_pct:+.2} % relative to the file"
            ));
        }
    }
    warnings.extend(doubled_note(planned.motion.doubled_moves as u64));
    warnings
}

/// A note that the file's places are others in the job.
fn moved([x, y, z]: [f64; 3]) -> Option<String> {
    (x.hypot(y).hypot(z) > MOVED_TOLD_MM).then(|| {
        format!(
            "the file's path is moved by ({x:.2}, {y:.2}, {z:.2}) mm to the middle of the work area: --at 0,0,0 keeps \
             its places"
        )
    })
}

/// A note that collisions were not checked, if the file moves down and the head has no shape.
fn head_unknown(planned: &GcodePlan) -> Option<String> {
    let descent = planned
        .descent
        .filter(|_| planned.settings.head.is_none())?;
    Some(format!(
        "line {}: the path goes down by {:.2} mm, as where objects are printed one after another; whether the head \
         touches what stands was not looked at: its shape is not in the machine file ([head])",
        descent.line, descent.down_mm
    ))
}
