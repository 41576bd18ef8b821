//! A region of a sliced file -> its route, planned as a region of our own layers, where that pays.
//!
//! In: a [`Ground`] (mm, mm³), the place of the file on the machine. Out: [`Anew`]: a route that begins at rest on its first
//! pass, with what it covers and lays; or why the region is followed along its lines. Limits: the speeds of the file's outer
//! walls where they were, those of its other beads elsewhere. Leaves out where it goes in the job.

use super::kept::joined_runs;
use super::regions::{Ground, LEVEL_MM};
use crate::geometry::Point2;
use crate::geometry::apart::apart_mm;
use crate::geometry::edge_index::EdgeIndex;
use crate::job::MotionState;
use crate::job::transform::PartTransform;
use crate::pipeline::PlanError;
use crate::pipeline::stack::{Stack, printings, route_stack};
use crate::plan::judge::figures::Swept;
use crate::plan::judge::measure::measure;
use crate::plan::layers::inside::Inside;
use crate::plan::layers::layer_groups::{LayerKind, StackLayer};
use crate::plan::motion::segments::lay_segments;
use crate::plan::progress::Stopped;
use crate::plan::route::gcode_route::{GcodeWay, gcode_route};
use crate::plan::route::moves::{Route, RouteMove};
use crate::settings::{Settings, Skirt};
use headway_protocol::units::{CHANNEL_VOLUME, CHANNEL_X, CHANNEL_Y, CHANNEL_Z, CHANNELS};

/// How much less than the slicer's beads it may cover, per cent of its area.
const COVERED_LESS_PCT: f64 = 0.3;
/// Speeds that differ by less are one.
const SPEED_SHARE: f64 = 0.05;
/// Largest distance of outlines that have one plan, in widths of an outer wall: slicers round places and volumes.
const ALIKE_WIDTHS: f64 = 0.02;
/// Speeds of alike regions differ by at most this, mm/s.
const SPEED_STEP_MM_S: f64 = 0.5;

/// A region planned anew.
#[derive(Clone, Debug)]
pub struct Anew {
    /// What the head does, from rest on the first pass, with nothing laid before.
    pub route: Route,
    /// Passes in it.
    pub passes: u32,
    /// Height of the tip, file coordinates.
    pub z_mm: f64,
    /// What it lays.
    pub volume_mm3: f64,
    /// What was swept of it.
    pub swept: Swept,
}

/// True for regions that may have one plan: the outlines of a slicer's layers differ by its rounding.
pub(super) fn is_alike(one: (&Ground, u32), other: (&Ground, u32)) -> bool {
    let [(one, layer), (other, other_layer)] = [one, other];
    let most_mm = ALIKE_WIDTHS * one.wall_mm;
    let is_near = |a: f64, b: f64, most: f64| (a - b).abs() <= most;
    let speeds = one.speeds_mm_s.iter().zip(other.speeds_mm_s);
    let ends = |ground: &Ground| [ground.bounds.min, ground.bounds.max];
    let ends = ends(one).into_iter().zip(ends(other));
    (layer == 0) == (other_layer == 0)
        && is_near(one.height_mm, other.height_mm, LEVEL_MM)
        && { speeds }.all(|(a, b)| is_near(*a, b, SPEED_STEP_MM_S))
        && { ends }.all(|(a, b)| is_near(a.x, b.x, most_mm) && is_near(a.y, b.y, most_mm))
        && apart_mm(
            std::slice::from_ref(&one.region),
            std::slice::from_ref(&other.region),
            most_mm,
        )
        .is_some()
}

/// Plans a region anew and along its lines, and takes the faster one unless it covers less.
///
/// # Errors
/// [`Stopped`]; all else is a reason to follow its lines.
pub(super) fn anew(
    ground: &Ground,
    layer: u32,
    transform: &PartTransform,
    way: &GcodeWay,
) -> Result<Result<Anew, &'static str>, Stopped> {
    let (anew, anew_s) = match planned(ground, layer, transform, way.settings) {
        Ok(Some(planned)) => planned,
        Ok(None) => return Ok(Err("the nozzle cannot lay it otherwise")),
        Err(PlanError::Stopped(stopped)) => return Err(stopped),
        Err(_) => return Ok(Err("it cannot be planned otherwise")),
    };
    let covered_pct = anew.swept.covered_pct();
    if covered_pct < ground.covered_pct - COVERED_LESS_PCT {
        return Ok(Err("they cover more"));
    }
    match followed_s(ground, way) {
        Some(followed_s) if followed_s < anew_s => Ok(Err("they are faster")),
        _ => Ok(Ok(anew)),
    }
}

/// Its plan and seconds; `None` where part of it is not printed.
fn planned(
    ground: &Ground,
    layer: u32,
    transform: &PartTransform,
    settings: &Settings,
) -> Result<Option<(Anew, f64)>, PlanError> {
    let fastest_mm_s = ground.speeds_mm_s[0].max(ground.speeds_mm_s[1]);
    let own = Settings {
        layer_height_mm: ground.height_mm,
        speed_mm_s: settings.speed_mm_s.min(fastest_mm_s / settings.plan_share),
        infill: None,
        skirt: Skirt::default(),
        ..settings.clone()
    };
    let stack = Stack {
        outlines: vec![vec![ground.region.clone()]],
        kinds: vec![LayerKind {
            outline: 0,
            inside: Inside::default(),
        }],
        layers: vec![StackLayer {
            number: layer,
            top_mm: ground.z_mm,
            kind: 0,
        }],
        keep_out: &[],
        kept_out_mm2: 0.0,
        skirt_around: None,
        scale: None,
        transform: *transform,
        start: None,
        is_last: false,
        may_leave_out: true,
    };
    let mut routed = route_stack(&stack, &own, &())?;
    if !routed.left_out.is_empty() || routed.route.moves.is_empty() {
        return Ok(None);
    }
    let mut route = std::mem::take(&mut routed.route);
    limit_speeds(&mut route, ground, transform);
    let (stream, report) = lay_segments(&route, &own)?;
    let prints = printings(&routed.kinds, &routed.prints);
    let of_curve = &routed.print_of_curve;
    let (_, measured) = measure(&stream, &prints, of_curve, transform, &own, &());
    let volume_mm3 = route.end().map_or(0.0, |end| end[CHANNEL_VOLUME]);
    let anew = Anew {
        passes: routed.curves.len() as u32,
        z_mm: ground.z_mm,
        volume_mm3,
        swept: Swept::sum(&measured.swept),
        route,
    };
    Ok(Some((anew, report.duration_s)))
}

/// Seconds along the region's lines; `None` where they cannot be followed.
fn followed_s(ground: &Ground, way: &GcodeWay) -> Option<f64> {
    let passes = joined_runs(&ground.runs, None, [false; 2], way.settings);
    let first = passes.first()?.points.first()?;
    let mut at = [0.0; CHANNELS];
    for (i, channel) in [CHANNEL_X, CHANNEL_Y, CHANNEL_Z].into_iter().enumerate() {
        at[channel] = first.tip_mm[i] + way.offset_mm[i];
    }
    let made = gcode_route(&passes, 1, at, 0.0, way);
    let (_, report) = lay_segments(&made.route, way.settings).ok()?;
    Some(report.duration_s)
}

/// Holds the passes to the speeds of the outer walls where those were, and to those of the others elsewhere.
fn limit_speeds(route: &mut Route, ground: &Ground, transform: &PartTransform) {
    let [outer, others] = ground.speeds_mm_s;
    if (outer - others).abs() <= SPEED_SHARE * outer.max(others) {
        return;
    }
    let edges = EdgeIndex::of_region(&ground.region, ground.wall_mm);
    let [dx, dy, _] = transform.offset_mm;
    let limit = |control: &[f64; CHANNELS]| {
        let at = Point2::new(control[CHANNEL_X] - dx, control[CHANNEL_Y] - dy);
        match edges.nearest_within(at, ground.wall_mm) {
            Some(_) => outer,
            None => others,
        }
    };
    let prints = route.moves.iter_mut();
    for of_move in prints.filter(|of_move| of_move.state == MotionState::Print) {
        set_speeds(of_move, &limit);
    }
}

fn set_speeds(of_move: &mut RouteMove, limit: &dyn Fn(&[f64; CHANNELS]) -> f64) {
    let limits: Vec<f64> = of_move.curve.control.iter().map(limit).collect();
    let fastest_mm_s = limits.iter().copied().fold(0.0, f64::max);
    let own_mm_s = of_move.speed_mm_s.unwrap_or(f64::INFINITY);
    of_move.speed_mm_s = Some(own_mm_s.min(fastest_mm_s));
    let limits = limits.into_iter().enumerate();
    of_move.speeds_mm_s = limits
        .map(|(k, limit)| [k as f64, limit.min(own_mm_s)])
        .collect();
}
