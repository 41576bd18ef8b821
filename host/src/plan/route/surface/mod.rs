//! The route of a plan in a chart -> the route on the surface: its moves from the first prime to the last
//! lift.
//!
//! ```text
//! Route (u, v, height above the ground, heading) --chart--> tip, tool axis, direction of the heading
//!   --headings--> headings in the tangent plane --> [RouteMove] (mm, rad, mm³)
//! ```
//! In: the route of the plan, in which the surface has z = 0, the chart and the nozzle's scale by position that it
//! was planned with. Out: moves in the same order, in the surface's coordinates. The tool axis is the normal; heights
//! become distances along it, so that lifts retreat along the tool and travel follows the surface. The chart maps the
//! direction of the heading, which is seen by a tool turned upright by the smallest rotation (section "poses" of the
//! design). A chart is conformal on one layer; where others are stretched anisotropically, headings are turned for
//! the width that each bead needs. The deposited volume scales with the surface: by the area of the layer's middle
//! over that of the plan. Not covered: the moves to the first pass and from the last one
//! ([`crate::plan::route::waypoint_route`]).

pub mod headings;

use crate::geometry::aperture::Aperture;
use crate::geometry::chart::{Chart, SurfaceFrame};
use crate::geometry::place_scale::ScaleField;
use crate::geometry::{Point2, Vector2};
use crate::job::MotionState;
use crate::plan::headings::profile::turn_weight_mm4;
use crate::plan::pose_limits::pose_limits;
use crate::plan::route::moves::{PathCurve, Route, RouteMove};
use crate::plan::route::waypoint_curve::chord_spline::through_samples;
use crate::plan::route::waypoint_curve::upright;
use crate::settings::Settings;
use crate::text::refusal::{Refusal, refusal};
use headings::Bead;
use headway_firmware::kinematics::pose::tilt_of_axis;
use headway_protocol::units::{
    CHANNEL_HEADING, CHANNEL_TILT_X, CHANNEL_TILT_Y, CHANNEL_VOLUME, CHANNEL_X, CHANNEL_Y,
    CHANNEL_Z, CHANNELS,
};
use std::f64::consts::TAU;

/// Longest step between two places that are mapped over, of the aperture's unit.
const SAMPLE: f64 = 0.25;
/// Least area on a layer for one of the plan: below, the layer nearly folds.
const AREA_FACTOR_MIN: f64 = 0.1;
/// A layer that is stretched by this share more than the nozzle's scale, in any direction, has its headings turned:
/// beads are that much too narrow or too wide.
const STRETCHED: f64 = 0.02;

type Point = [f64; CHANNELS];

/// Why a layer above a hollow of the surface cannot be: its top, a point on the surface, mm.
pub fn layer_folds(above_mm: f64, at_mm: [f64; 3]) -> Refusal {
    refusal!(
        "{above_mm:.2} mm above the surface the layer would fold near ({:.2}, {:.2}, {:.2}) mm, where \
         the surface is hollow: print fewer layers, or smooth the surface there",
        at_mm[0],
        at_mm[1],
        at_mm[2]
    )
}

/// The surface of a plan.
pub struct LaidOn<'a> {
    /// From the plan's plane to the surface.
    pub chart: &'a dyn Chart,
    /// The nozzle's scale that the plan was made with.
    pub scale: &'a ScaleField,
    /// Volume over a place of the plan for one of the plan's, where layers are not as thick everywhere.
    pub volume_factor: Option<&'a (dyn Fn(Point2) -> f64 + Sync)>,
}

/// Carries a route over. The moves before the first prime or print are omitted.
///
/// # Errors
/// [`Refusal`].
pub fn on_surface(
    route: &Route,
    ground: &LaidOn,
    settings: &Settings,
) -> Result<Vec<RouteMove>, Refusal> {
    let is_begun = |route_move: &RouteMove| route_move.state != MotionState::Travel;
    let first = route.moves.iter().position(is_begun);
    let moves = &route.moves[first.unwrap_or(route.moves.len())..];
    let surface_map = SurfaceMap {
        ground,
        settings,
        turn_weight_mm4: turn_weight_mm4(&pose_limits(settings), &settings.aperture),
    };
    let of_passes = moves.iter().map(|route_move| match route_move.state {
        MotionState::Print => surface_map.turns(&route_move.curve).map(Some),
        _ => Ok(None),
    });
    let of_passes = of_passes.collect::<Result<Vec<_>, _>>()?;
    let turns = between(moves, of_passes);
    let mut so_far = SoFar::default();
    let mapped = moves
        .iter()
        .zip(&turns)
        .map(|(route_move, turns)| RouteMove {
            curve: surface_map.mapped(&route_move.curve, turns, &mut so_far),
            ..route_move.clone()
        });
    Ok(mapped.collect())
}

/// State that continues from one curve to the next.
#[derive(Default)]
struct SoFar {
    volume_mm3: f64,
    /// Excess of the heading on the surface over that in the chart, unwrapped.
    more_rad: Option<f64>,
}

/// Fills in the turns off the passes: uniform along the path from one pass to the next.
fn between(moves: &[RouteMove], of_passes: Vec<Option<Vec<f64>>>) -> Vec<Vec<f64>> {
    let ends = |turns: &Vec<f64>| Some([*turns.first()?, *turns.last()?]);
    let known: Vec<Option<[f64; 2]>> = of_passes
        .iter()
        .map(|turns| turns.as_ref().and_then(ends))
        .collect();
    let length_mm = |route_move: &RouteMove| -> f64 {
        let legs = route_move.curve.control.windows(2);
        legs.map(|leg| way_mm(&leg[0], &leg[1])).sum()
    };
    let mut turns: Vec<Vec<f64>> = Vec::with_capacity(moves.len());
    let mut index = 0;
    for group in known.chunk_by(|p, q| p.is_none() && q.is_none()) {
        let here = &moves[index..index + group.len()];
        let before = known[..index].iter().flatten().next_back();
        let after = known[index + group.len()..].iter().flatten().next();
        let from = before
            .or(after)
            .map_or(0.0, |ends| ends[usize::from(before.is_some())]);
        let to = after.map_or(from, |ends| ends[0]);
        let whole_mm: f64 = here.iter().map(length_mm).sum();
        let mut way = 0.0;
        for (route_move, of_pass) in here.iter().zip(&of_passes[index..]) {
            let step_mm = length_mm(route_move);
            turns.push(of_pass.clone().unwrap_or_else(|| {
                let spans = route_move.curve.span_count();
                let turn = |i: usize| {
                    let share = i as f64 / spans.max(1) as f64;
                    from + (to - from) * (way + share * step_mm) / whole_mm.max(1e-9)
                };
                (0..=spans).map(turn).collect()
            }));
            way += step_mm;
        }
        index += group.len();
    }
    turns
}

fn way_mm(from: &Point, to: &Point) -> f64 {
    let along = |channel: usize| (to[channel] - from[channel]).powi(2);
    (CHANNEL_X..=CHANNEL_Z).map(along).sum::<f64>().sqrt()
}

fn place(pose: &Point) -> Point2 {
    Point2::new(pose[CHANNEL_X], pose[CHANNEL_Y])
}

struct SurfaceMap<'a> {
    ground: &'a LaidOn<'a>,
    settings: &'a Settings,
    turn_weight_mm4: f64,
}

impl SurfaceMap<'_> {
    fn frame(&self, pose: &Point) -> SurfaceFrame {
        self.ground.chart.frame(place(pose), pose[CHANNEL_Z])
    }

    /// The volume of the layer for one of the plan: where it is as thick, the area of its middle.
    fn volume_factor(&self, pose: &Point) -> f64 {
        if let Some(volume_factor) = self.ground.volume_factor {
            return volume_factor(place(pose));
        }
        let mut middle = *pose;
        middle[CHANNEL_Z] -= 0.5 * self.settings.layer_height_mm;
        self.frame(&middle).area_factor()
    }

    /// A pose of the plan on the surface; its heading is `near_rad` more than the plan's, about.
    fn pose(&self, planned: &Point, near_rad: Option<f64>) -> Point {
        let frame = self.frame(planned);
        let tilt = tilt_of_axis(&frame.normal);
        let mut pose = *planned;
        pose[CHANNEL_X..=CHANNEL_Z].copy_from_slice(frame.tip_mm.as_slice());
        (pose[CHANNEL_TILT_X], pose[CHANNEL_TILT_Y]) = (tilt.x, tilt.y);
        let heading_rad = planned[CHANNEL_HEADING];
        let (sin, cos) = heading_rad.sin_cos();
        let seen = upright(&pose) * frame.mapped(Vector2::new(cos, sin));
        let more_rad = seen.y.atan2(seen.x) - heading_rad;
        let turns = ((more_rad - near_rad.unwrap_or(0.0)) / TAU).round();
        pose[CHANNEL_HEADING] = heading_rad + more_rad - TAU * turns;
        pose
    }

    /// By how much the heading is turned at the control points of a pass, in the chart.
    fn turns(&self, curve: &PathCurve) -> Result<Vec<f64>, Refusal> {
        let aperture = &self.settings.aperture;
        let mut beads: Vec<Bead> = Vec::with_capacity(curve.control.len());
        let mut direction = Vector2::x();
        let mut is_stretched = false;
        let (mut before, mut more_rad) = (None::<Point>, None);
        for i in 0..curve.control.len() {
            let planned = curve.value(i as f64);
            let frame = self.frame(&planned);
            if frame.area_factor() < AREA_FACTOR_MIN {
                let ground = self.ground.chart.frame(place(&planned), 0.0);
                return Err(layer_folds(planned[CHANNEL_Z], ground.tip_mm.into()));
            }
            let lambda = self.ground.scale.at(place(&planned)).lambda;
            let off = |stretch: f64| (stretch / lambda - 1.0).abs() > STRETCHED;
            is_stretched |= frame.stretches().into_iter().any(off);
            let tangent = curve.tangent(i as f64);
            let step = Vector2::new(tangent[CHANNEL_X], tangent[CHANNEL_Y]);
            direction = step.try_normalize(1e-9).unwrap_or(direction);
            let heading_rad = planned[CHANNEL_HEADING];
            let across = Vector2::new(-direction.y, direction.x);
            let extent_mm = aperture.extent_mm(heading_rad, across) / lambda;
            let pose = self.pose(&planned, more_rad);
            more_rad = Some(pose[CHANNEL_HEADING] - heading_rad);
            let seen = upright(&pose) * frame.mapped(direction);
            beads.push(Bead {
                heading_rad: pose[CHANNEL_HEADING],
                travel_rad: seen.y.atan2(seen.x),
                extent_mm: extent_mm * frame.width_factor(direction),
                step_mm: before.map_or(0.0, |before| way_mm(&before, &planned)),
            });
            before = Some(planned);
        }
        if !is_stretched || has_no_turn(aperture) {
            return Ok(vec![0.0; beads.len()]);
        }
        Ok(headings::turns_rad(&beads, aperture, self.turn_weight_mm4))
    }

    /// A curve mapped over, with these turns at its control points; volume and heading continue from the
    /// previous curve.
    fn mapped(&self, curve: &PathCurve, turns: &[f64], so_far: &mut SoFar) -> PathCurve {
        let mut turned = curve.clone();
        for (point, turn) in turned.control.iter_mut().zip(turns) {
            point[CHANNEL_HEADING] += turn;
        }
        let spans = turned.span_count();
        let legs = turned.control.windows(2);
        let longest_mm = legs.map(|leg| way_mm(&leg[0], &leg[1])).fold(0.0, f64::max);
        let pieces = (longest_mm / (SAMPLE * self.settings.aperture.unit_mm()))
            .ceil()
            .max(1.0) as usize;
        let planned: Vec<Point> = (0..=spans * pieces)
            .map(|k| turned.value(k as f64 / pieces as f64))
            .collect();
        let samples = planned.iter().map(|planned| {
            let pose = self.pose(planned, so_far.more_rad);
            so_far.more_rad = Some(pose[CHANNEL_HEADING] - planned[CHANNEL_HEADING]);
            pose
        });
        let samples: Vec<Point> = samples.collect();
        let mut control = match samples.len() {
            0..=2 => samples,
            _ => through_samples(&samples),
        };
        for (index, point) in control.iter_mut().enumerate() {
            if index > 0 {
                so_far.volume_mm3 += self.grown_mm3(&turned, &planned, pieces, index);
            }
            point[CHANNEL_VOLUME] = so_far.volume_mm3;
        }
        PathCurve { control }
    }

    /// Volume deposited up to a sample from the previous one.
    fn grown_mm3(&self, curve: &PathCurve, planned: &[Point], pieces: usize, index: usize) -> f64 {
        // Volumes are control values: where all of them are kept they stay what they are.
        let volume = |index: usize| match pieces {
            1 => curve.control[index][CHANNEL_VOLUME],
            _ => planned[index][CHANNEL_VOLUME],
        };
        let grown_mm3 = volume(index) - volume(index - 1);
        if grown_mm3 == 0.0 {
            return 0.0;
        }
        let [from, to] = [&planned[index - 1], &planned[index]];
        let middle: Point = std::array::from_fn(|channel| 0.5 * (from[channel] + to[channel]));
        grown_mm3 * self.volume_factor(&middle)
    }
}

/// True where the width of a bead cannot be chosen by a turn to either side.
fn has_no_turn(aperture: &Aperture) -> bool {
    aperture.is_round() || aperture.period_rad() > std::f64::consts::PI
}
