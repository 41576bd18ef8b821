//! The route of a planar plan -> the same on a surface: its moves from the first prime to the last lift.
//!
//! ```text
//! Route (x, y, height above the surface, heading) --frame--> tip, tool axis, move of lengths
//!   --headings--> headings in the tangent plane --> [RouteMove] (mm, rad, mm³)
//! ```
//! In: the route of the plan, in whose z the surface is 0, the aperture that it was planned with and the
//! surface. Out: moves in the same order, in the surface's coordinates. The tool axis is the normal;
//! heights become ways along it, so that lifts draw back along the tool and travel follows the surface. The
//! heading is mapped without a twist (section "poses" of the design: the smallest rotation from Z), then
//! turned for the width that the slope asks. The deposited volume grows as the ground does: by the area of the
//! layer's middle over that of the plan. Leaves out the way to the first pass and from the last one
//! ([`crate::plan::route::waypoint_route`]).

pub mod frame;
pub mod headings;

use crate::geometry::Vector2;
use crate::geometry::aperture::Aperture;
use crate::geometry::spline_surface::SplineSurface;
use crate::job::MotionState;
use crate::plan::headings::profile::turn_weight_mm4;
use crate::plan::pose_limits::pose_limits;
use crate::plan::route::moves::{PathCurve, Route, RouteMove};
use crate::plan::route::waypoint_curve::chord_spline::through_samples;
use crate::plan::route::waypoint_curve::upright;
use crate::settings::Settings;
use frame::SurfaceFrame;
use headings::Bead;
use headway_firmware::pose::tilt_of_axis;
use headway_protocol::units::{
    CHANNEL_HEADING, CHANNEL_TILT_X, CHANNEL_TILT_Y, CHANNEL_VOLUME, CHANNEL_X, CHANNEL_Y,
    CHANNEL_Z, CHANNELS,
};

/// Longest step between two places that are mapped over, of the aperture's unit.
const SAMPLE: f64 = 0.25;
/// Least area on a layer for one of the plan: below, the layer nearly folds.
const AREA_FACTOR_MIN: f64 = 0.1;

type Point = [f64; CHANNELS];

/// A layer above a hollow of the surface would fold.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "{above_mm:.2} mm above the surface the layer would fold near ({:.2}, {:.2}) mm, where the surface is \
     hollow: print fewer layers, or smooth the surface there",
    at_mm[0], at_mm[1]
)]
pub struct LayerFoldsError {
    /// The layer's top.
    pub above_mm: f64,
    /// Place in the plan.
    pub at_mm: [f64; 2],
}

/// Carries a route over. The moves before the first prime or print are left out.
///
/// # Errors
/// [`LayerFoldsError`].
pub fn on_surface(
    route: &Route,
    planned: &Aperture,
    surface: &SplineSurface,
    settings: &Settings,
) -> Result<Vec<RouteMove>, LayerFoldsError> {
    let is_begun = |route_move: &RouteMove| route_move.state != MotionState::Travel;
    let first = route.moves.iter().position(is_begun);
    let moves = &route.moves[first.unwrap_or(route.moves.len())..];
    let surface_map = SurfaceMap {
        planned,
        surface,
        settings,
        turn_weight_mm4: turn_weight_mm4(&pose_limits(settings), &settings.aperture),
    };
    let of_passes = moves.iter().map(|route_move| match route_move.state {
        MotionState::Print => surface_map.turns(&route_move.curve).map(Some),
        _ => Ok(None),
    });
    let of_passes = of_passes.collect::<Result<Vec<_>, _>>()?;
    let turns = between(moves, of_passes);
    let mut volume_mm3 = 0.0;
    let mapped = moves
        .iter()
        .zip(&turns)
        .map(|(route_move, turns)| RouteMove {
            curve: surface_map.mapped(&route_move.curve, turns, &mut volume_mm3),
            ..route_move.clone()
        });
    Ok(mapped.collect())
}

/// Fills in the turns off the passes: even along the way from one pass to the next.
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

struct SurfaceMap<'a> {
    planned: &'a Aperture,
    surface: &'a SplineSurface,
    settings: &'a Settings,
    turn_weight_mm4: f64,
}

impl SurfaceMap<'_> {
    fn frame(&self, pose: &Point) -> SurfaceFrame {
        let [x, y, z] = [CHANNEL_X, CHANNEL_Y, CHANNEL_Z].map(|channel| pose[channel]);
        SurfaceFrame::at(self.surface, x, y, z)
    }

    /// The area that the middle of the layer has for one of the plan.
    fn area_factor(&self, pose: &Point) -> f64 {
        let mut middle = *pose;
        middle[CHANNEL_Z] -= 0.5 * self.settings.layer_height_mm;
        self.frame(&middle).area_factor()
    }

    /// A pose of the plan on the surface, its heading as it is.
    fn pose(&self, planned: &Point) -> Point {
        let frame = self.frame(planned);
        let tilt = tilt_of_axis(&frame.normal);
        let mut pose = *planned;
        pose[CHANNEL_X..=CHANNEL_Z].copy_from_slice(frame.tip_mm.as_slice());
        (pose[CHANNEL_TILT_X], pose[CHANNEL_TILT_Y]) = (tilt.x, tilt.y);
        pose
    }

    /// By how much the heading is turned at the control points of a pass.
    fn turns(&self, curve: &PathCurve) -> Result<Vec<f64>, LayerFoldsError> {
        let mut beads: Vec<Bead> = Vec::with_capacity(curve.control.len());
        let mut direction = Vector2::x();
        let mut before: Option<Point> = None;
        for i in 0..curve.control.len() {
            let planned = curve.value(i as f64);
            let frame = self.frame(&planned);
            if frame.area_factor() < AREA_FACTOR_MIN {
                return Err(LayerFoldsError {
                    above_mm: planned[CHANNEL_Z],
                    at_mm: [planned[CHANNEL_X], planned[CHANNEL_Y]],
                });
            }
            let tangent = curve.tangent(i as f64);
            let step = Vector2::new(tangent[CHANNEL_X], tangent[CHANNEL_Y]);
            direction = step.try_normalize(1e-9).unwrap_or(direction);
            let heading_rad = planned[CHANNEL_HEADING];
            let across = Vector2::new(-direction.y, direction.x);
            let extent_mm = self.planned.extent_mm(heading_rad, across);
            let seen = upright(&self.pose(&planned)) * frame.mapped(direction);
            beads.push(Bead {
                heading_rad,
                travel_rad: seen.y.atan2(seen.x),
                extent_mm: extent_mm * frame.width_factor(direction),
                step_mm: before.map_or(0.0, |before| way_mm(&before, &planned)),
            });
            before = Some(planned);
        }
        Ok(headings::turns_rad(
            &beads,
            &self.settings.aperture,
            self.turn_weight_mm4,
        ))
    }

    /// A curve mapped over, with these turns at its control points; `volume_mm3` goes on from the curve
    /// before.
    fn mapped(&self, curve: &PathCurve, turns: &[f64], volume_mm3: &mut f64) -> PathCurve {
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
        let samples: Vec<Point> = planned.iter().map(|planned| self.pose(planned)).collect();
        let mut control = match samples.len() {
            0..=2 => samples,
            _ => through_samples(&samples),
        };
        for (index, point) in control.iter_mut().enumerate() {
            if index > 0 {
                *volume_mm3 += self.grown_mm3(&turned, &planned, pieces, index);
            }
            point[CHANNEL_VOLUME] = *volume_mm3;
        }
        PathCurve { control }
    }

    /// What is laid up to a sample from the one before.
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
        grown_mm3 * self.area_factor(&middle)
    }
}
