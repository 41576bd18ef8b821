//! Findings of a simulation: its figures, and whether it succeeded.
//!
//! In: a [`DryRun`] with its stream. Out: figures in addition to those of the plan; a line about the
//! failure, if any.

use super::time_figures;
use crate::drive::dry_run::DryRun;
use crate::drive::time_by_limit::time_by_limit;
use crate::job::SegmentStream;
use crate::job::transform::PartTransform;
use crate::report::figures::Figures;
use crate::settings::Settings;

/// The figures that only a run shows.
pub fn simulation_figures(
    dry_run: &DryRun,
    stream: &SegmentStream,
    transform: &PartTransform,
    settings: &Settings,
) -> Figures {
    let (s, t) = (&dry_run.simulation.figures, &dry_run.trace);
    let times = time_by_limit(stream, settings);
    Figures {
        bytes: Some(s.bytes),
        bytes_per_s: Some(dry_run.bytes_per_s),
        heading_travel_rad: Some(times.heading_travel_rad),
        heading_rate_max_rad_s: Some(times.heading_rate_max_rad_s),
        tip_error_um_max: Some(t.tip_error_um_max),
        tip_error_um_rms: Some(t.tip_error_um_rms),
        heading_error_mrad_max: Some(t.heading_error_mrad_max),
        half_step_um_max: Some(t.half_step_um_max),
        half_step_mrad_max: Some(t.half_step_mrad_max),
        // 0 exactly where nothing is shaped.
        shaping_error_um_max: (t.shaping_error_um_max > 0.0).then_some(t.shaping_error_um_max),
        volume_error_pct: Some(t.volume_error_pct),
        step_time_error_us_max: Some(t.step_time_error_us_max),
        step_time_error_us_rms: Some(t.step_time_error_us_rms),
        steps: Some(s.steps),
        step_digest: Some(s.step_digest.clone()),
        final_counts: Some(s.final_counts.clone()),
        resent_frames: Some(s.resent_frames),
        underruns: Some(s.underruns),
        holds: Some(s.holds),
        faults: Some(s.faults),
        realtime_factor: Some(dry_run.realtime_factor),
        ..time_figures(times, transform)
    }
}

/// A fault, or steps that do not reach the plan's end, are a failure.
///
/// # Errors
/// The reason.
pub fn outcome(dry_run: &DryRun) -> Result<(), String> {
    if let Some(fault) = &dry_run.simulation.fault {
        return Err(format!("the controller stopped with a fault: {fault}"));
    }
    let trace = &dry_run.trace;
    if !trace.is_at_the_end() {
        return Err(format!(
            "the steps end at {:?}, the plan's last pose requires {:?}",
            trace.final_counts, trace.expected_counts
        ));
    }
    Ok(())
}
