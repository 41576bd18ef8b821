//! Run of waypoints -> plan: its curve in space, followed unchanged.

use super::placed_passes::{PlacedPasses, placed_passes};
use super::stop_room::with_stop_room;
use super::{Plan, PlanError, start_pose};
use crate::geometry::Point2;
use crate::geometry::polygon::Box2;
use crate::input::waypoints::WaypointRun;
use crate::job::SegmentStream;
use crate::job::transform::PartTransform;
use crate::plan::judge::measure::measure;
use crate::plan::judge::touches::touches;
use crate::plan::motion::segments::{MotionReport, lay_segments_with_progress};
use crate::plan::progress::Progress;
use crate::plan::route::curve_cuts::turning_back::turn_back;
use crate::plan::route::lean;
use crate::plan::route::moves::Route;
use crate::plan::route::told_headings::{HeadingJumps, followed_run};
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
    let of_run = waypoint_passes(run, transform.offset_mm, settings)?;
    let rounded = of_run.rounded;
    let followed = with_stop_room(settings, |room_rad| {
        followed(
            of_run.clone(),
            room_rad,
            &transform,
            bounds,
            settings,
            progress,
        )
    })?;
    let Followed {
        placed,
        route,
        pass_count,
        turned_back,
        laid: (stream, motion),
    } = followed;
    let jumps = HeadingJumps {
        turned_back,
        ..*jumps
    };
    let (mut figures, measured) = measure(&stream, &[], &[], &placed.transform, settings, progress);
    figures.passes = pass_count;
    // Passes that were cut are counted anew.
    let normals = leaned
        .as_ref()
        .filter(|_| placed.cuts.is_none() && turned_back == 0);
    let touches = touches(&route, normals.map(|leaned| &leaned.normals), settings);
    Ok(Plan {
        transform: placed.transform,
        found_place: placed.found_place,
        leaned,
        singular: placed.singular,
        rounded,
        jumps,
        touches,
        route,
        stream,
        motion,
        measured,
        figures,
        ..Plan::default()
    })
}

/// A run at its position on the machine, with its motion.
struct Followed {
    placed: PlacedPasses,
    route: Route,
    pass_count: usize,
    /// Places at which the nozzle turns back within passes.
    turned_back: usize,
    laid: (SegmentStream, MotionReport),
}

/// Follows a run with some room before the nozzle's stops.
fn followed(
    mut of_run: WaypointPasses,
    stop_room_rad: f64,
    transform: &PartTransform,
    bounds: Box2,
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<Followed, PlanError> {
    let turned_back = turn_back(&mut of_run, stop_room_rad, settings);
    let left = of_run.rounded.left_of(settings);
    let mut placed = placed_passes(of_run.passes, *transform, bounds, &left, true)?;
    let (mut speeds_mm_s, mut asked) = (of_run.speeds_mm_s, of_run.asked);
    if let Some(cuts) = &placed.cuts {
        (speeds_mm_s, asked) = (cuts.speeds(&speeds_mm_s), cuts.of_passes(&asked));
    }
    let passes = std::mem::take(&mut placed.passes);
    let pass_count = passes.len();
    // Passes that were cut are counted anew.
    let mut route = waypoint_route(passes, &asked, start_pose(settings), settings);
    let moves = route.moves.iter_mut();
    let printed = moves.filter(|route_move| route_move.pass.is_some());
    for (route_move, speeds_mm_s) in printed.zip(speeds_mm_s) {
        route_move.speeds_mm_s = speeds_mm_s;
    }
    let laid = lay_segments_with_progress(&route, settings, progress)?;
    Ok(Followed {
        placed,
        route,
        pass_count,
        turned_back,
        laid,
    })
}
