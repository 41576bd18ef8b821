//! A finished plan before the oracle: what its stream leaves on the layer, by
//! [`crate::layer_oracle`], against what is reachable.

use crate::layer_oracle::{LayerFindings, Rings, print_poses, sweep};
use headway::Plan;
use headway::geometry::polygon::Region;
use headway::settings::Settings;

/// Poses are this close, mm.
const STEP_MM: f64 = 0.03;
/// The same where a tenth of a per cent counts: 0.03 mm leaves scallops of up to 1.7 um along walls
/// that the ellipse's tip touches (b²/a = 0.07 mm), which is 0.1 % of a thin part.
const STEP_FINE_MM: f64 = 0.005;

/// What the oracle says of a plan.
#[derive(Clone, Copy, Debug)]
pub struct Judged {
    /// Coverage, overlap and outside depth.
    pub found: LayerFindings,
    /// Share of what some placement covers.
    pub covered_of_reachable_pct: f64,
}

/// Judges the plan of an elliptical nozzle, one layer.
pub fn judge(plan: &Plan, regions: &[Region], settings: &Settings) -> Judged {
    judge_at(plan, regions, settings, STEP_MM)
}

/// The same with poses so close that what lies between them counts for nothing.
pub fn judge_finely(plan: &Plan, regions: &[Region], settings: &Settings) -> Judged {
    judge_at(plan, regions, settings, STEP_FINE_MM)
}

fn judge_at(plan: &Plan, regions: &[Region], settings: &Settings, step_mm: f64) -> Judged {
    let offset_mm = [plan.transform.offset_mm[0], plan.transform.offset_mm[1]];
    let poses = print_poses(&plan.stream, offset_mm, step_mm);
    let axes_mm = [settings.aperture.major_mm(), settings.aperture.minor_mm()];
    // Fine enough that the border of a small part counts for little.
    let cell_mm = (plan.figures.area_mm2 / 2e6).sqrt().clamp(0.01, 0.04);
    let found = sweep(&rings(regions), &poses, axes_mm, cell_mm);
    Judged {
        found,
        covered_of_reachable_pct: 100.0 * found.covered_pct / plan.figures.reachable_pct,
    }
}

fn rings(regions: &[Region]) -> Rings {
    regions
        .iter()
        .flat_map(|r| r.rings())
        .map(|ring| ring.points.iter().map(|p| [p.x, p.y]).collect())
        .collect()
}

/// Seconds from the first prime to the end of the last retract: what the head needs to come from where the
/// machine rests hangs on where a part begins, not on how it is printed.
///
/// # Panics
/// Where nothing is printed.
pub fn print_without_approach_s(
    plan: &headway::Plan,
    settings: &headway::settings::Settings,
) -> f64 {
    let off = [
        headway::job::MotionState::Travel,
        headway::job::MotionState::Hold,
    ];
    let mut at_work = plan
        .stream
        .marks
        .iter()
        .filter(|mark| !off.contains(&mark.state));
    let first = at_work.next().expect("a pass");
    let last = at_work.next_back().unwrap_or(first);
    (last.end_tick - first.start_tick) as f64 / f64::from(settings.machine.servo_hz)
}
