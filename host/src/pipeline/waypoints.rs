//! Run of waypoints -> plan: its curve in space, followed unchanged.

use super::placed_passes::{PlacedPasses, placed_passes};
use super::{Plan, PlanError, start_pose};
use crate::geometry::Point2;
use crate::geometry::polygon::Box2;
use crate::input::waypoints::WaypointRun;
use crate::job::transform::PartTransform;
use crate::plan::judge::measure::measure;
use crate::plan::judge::touches::touches;
use crate::plan::motion::segments::lay_segments_with_progress;
use crate::plan::progress::Progress;
use crate::plan::route::lean;
use crate::plan::route::told_headings::followed_run;
use crate::plan::route::waypoint_curve::{WaypointPasses, waypoint_passes};
use crate::plan::route::waypoint_route::waypoint_route;
use crate::settings::Settings;

/// Plans a run of waypoints: curve, route, segments, figures. Regions, curves and rasters stay
/// empty. The lowest waypoint is placed one layer height above the bed.
///
/// # Errors
/// [`PlanError`].
pub fn plan_waypoints(run: &WaypointRun, settings: &Settings) -> Result<Plan, PlanError> {
    plan_waypoints_with_progress(run, settings, &())
}

/// The same, with progress: segments and figures.
///
/// # Errors
/// [`PlanError`].
pub fn plan_waypoints_with_progress(
    run: &WaypointRun,
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<Plan, PlanError> {
    settings.check()?;
    let (run, jumps) = &followed_run(run, settings);
    let tips = || run.points.iter().map(|point| point.tip_mm);
    let corners: Vec<Point2> = tips().map(|tip| tip.xy()).collect();
    let low_mm = tips().map(|tip| tip.z).fold(f64::INFINITY, f64::min) - settings.layer_height_mm;
    let high_mm = tips().map(|tip| tip.z).fold(f64::NEG_INFINITY, f64::max);
    let bounds = Box2::of(&corners);
    let transform = PartTransform::choose_box(bounds, [low_mm, high_mm], settings)?;
    let leaned = settings
        .tilt_max_rad
        .map(|tilt_max_rad| lean::leaned(run, transform.offset_mm, tilt_max_rad, settings));
    let leaned = leaned.transpose()?.flatten();
    let run = leaned.as_ref().map_or(run, |leaned| &leaned.run);
    let asked = waypoint_passes(run, transform.offset_mm, settings)?;
    let WaypointPasses {
        passes,
        speeds_mm_s,
        asked,
        rounded,
    } = asked;
    let start = start_pose(settings);
    let PlacedPasses {
        passes,
        cuts,
        transform,
        found_place,
        singular,
    } = placed_passes(passes, transform, bounds, &rounded.left_of(settings), true)?;
    let pass_count = passes.len();
    let (speeds_mm_s, asked) = match &cuts {
        Some(cuts) => (cuts.speeds(&speeds_mm_s), cuts.of_passes(&asked)),
        None => (speeds_mm_s, asked),
    };
    // Passes that were cut are counted anew.
    let mut route = waypoint_route(passes, &asked, start, settings);
    let moves = route.moves.iter_mut();
    let printed = moves.filter(|route_move| route_move.pass.is_some());
    for (route_move, speeds_mm_s) in printed.zip(speeds_mm_s) {
        route_move.speeds_mm_s = speeds_mm_s;
    }
    let (stream, motion) = lay_segments_with_progress(&route, settings, progress)?;
    let (mut figures, measured) = measure(&stream, &[], &[], &transform, settings, progress);
    figures.passes = pass_count;
    // Passes that were cut are counted anew.
    let normals = leaned.as_ref().filter(|_| cuts.is_none());
    let touches = touches(&route, normals.map(|leaned| &leaned.normals), settings);
    Ok(Plan {
        transform,
        found_place,
        leaned,
        singular,
        rounded,
        jumps: *jumps,
        touches,
        route,
        stream,
        motion,
        measured,
        figures,
        ..Plan::default()
    })
}
