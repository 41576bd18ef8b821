//! Curved layers for a head that does not tilt: planned in the plane, zone by zone, and lifted.
//!
//! In: a curved layer with its number in the job. Out: [`Laid`], one for each zone of the layer ([`super::level_zones`]).
//! Where headings are free, the planner of the plane plans a zone as a flat layer. Where the nozzle keeps one heading, the plane
//! is stretched across its long axis until the ellipse is a circle of radius a: the plan for a round nozzle there, carried back,
//! covers as much of the ground, lays as little of it twice, and stays inside the walls as well. Volumes are those of
//! the layer's own thickness.
//!
//! The bead is left by the rear edge of the nozzle, so it is that edge, not its middle, which lies on the layer's top: uphill
//! the tip is lower than the top by what the slope rises over half the nozzle, downhill higher. Beads that run up and down a
//! slope with the long axis across it then lie on the slope, although the nozzle is level.

use super::laid_layer::{Context, Ground, Laid, flat, solid};
use super::layer_shape::{Below, LevelSurface, PartLayer};
use super::level_zones::{HANG_SHARE, zones};
use crate::geometry::aperture::Aperture;
use crate::geometry::chart::{Chart, ChartJet, Plane};
use crate::geometry::place_scale::ScaleField;
use crate::geometry::polygon::{Box2, Region};
use crate::geometry::{Point2, Vector2};
use crate::job::MotionState;
use crate::pipeline::PlanError;
use crate::plan::layers::layer_groups::LayerGroup;
use crate::plan::layers::region_plan::RegionPlan;
use crate::plan::outline::contour::{Contour, SIMPLIFY_MM};
use crate::plan::outline::unreachable::UnreachableRun;
use crate::plan::route::moves::{PathCurve, Route, RouteMove};
use crate::plan::route::surface::{LaidOn, on_surface};
use crate::settings::Settings;
use headway_protocol::units::{CHANNEL_HEADING, CHANNEL_X, CHANNEL_Y, CHANNEL_Z, CHANNELS};
use nalgebra::Vector3;

/// Points of the nozzle's edge that are held against the layer's top.
const EDGE_POINTS: usize = 96;
/// How far from the ends of a pass the rear edge begins to follow the top, of the nozzle's half length, and how often its
/// height is averaged with its neighbours', so that it does not jump where the path turns.
const ENDS: f64 = 2.0;
const AVERAGINGS: usize = 2;
/// What the rear edge may be in the layer, of the bound for slopes, and places of a span at which that is looked at.
const DEEPEST: f64 = 1.1;
const PLACES: usize = 4;

/// Where the edge of a nozzle is deepest below the top of the layer that it prints: the rear half of it, seen along the
/// travel. Before it nothing of the layer is printed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EdgeDepth {
    /// How deep.
    pub depth_mm: f64,
    /// The tip there.
    pub at_mm: [f64; 3],
}

impl EdgeDepth {
    /// The deeper of two.
    pub fn deeper(one: Option<EdgeDepth>, other: Option<EdgeDepth>) -> Option<EdgeDepth> {
        match (one, other) {
            (Some(one), Some(other)) if other.depth_mm > one.depth_mm => Some(other),
            (None, other) => other,
            (one, _) => one,
        }
    }
}

/// Plans a curved layer.
///
/// # Errors
/// [`PlanError`]; a region that cannot be planned is left out instead.
pub fn upright(
    number: u32,
    layer: &PartLayer,
    on: (&LevelSurface, &Below),
    context: &Context,
) -> Result<Vec<Laid>, PlanError> {
    let settings = context.settings;
    let zones = zones(
        on.0,
        &layer.regions,
        &settings.aperture,
        settings.layer_height_mm,
    );
    let solid = solid(settings);
    let is_first = context.is_first && zones.len() == 1;
    let (mut all, mut start) = (Vec::new(), context.start);
    for zone in zones {
        let context = Context {
            settings: &solid,
            start,
            is_first,
            ..*context
        };
        let of_zone = PartLayer {
            rank_mm: 0.0,
            regions: zone.regions,
            ..layer.clone()
        };
        let laid = match zone.heading_rad {
            Some(heading_rad) => stretched(number, &of_zone, heading_rad, &context)?,
            None => (
                flat(number..number + 1, std::slice::from_ref(&of_zone), &context)?,
                1.0,
            ),
        };
        let laid = lifted(laid, &of_zone.regions, on, &solid)?;
        let last = laid.moves.last().and_then(|last| last.curve.control.last());
        start = last.copied().unwrap_or(start);
        all.push(laid);
    }
    Ok(all)
}

/// The plane stretched across a direction.
#[derive(Clone, Copy, Debug)]
struct Stretch {
    across: Vector2,
    ratio: f64,
}

impl Stretch {
    fn of(heading_rad: f64, aperture: &Aperture) -> Stretch {
        let (sin, cos) = heading_rad.sin_cos();
        Stretch {
            across: Vector2::new(-sin, cos),
            ratio: aperture.major_mm() / aperture.minor_mm(),
        }
    }

    fn of_vector(&self, v: Vector2) -> Vector2 {
        v + (self.ratio - 1.0) * self.across.dot(&v) * self.across
    }

    fn stretched(&self, p: Point2) -> Point2 {
        Point2::from(self.of_vector(p.coords))
    }

    fn back(&self, p: Point2) -> Point2 {
        p + (1.0 / self.ratio - 1.0) * self.across.dot(&p.coords) * self.across
    }
}

fn mapped(region: &Region, to: impl Fn(Point2) -> Point2) -> Region {
    let mut region = region.clone();
    for point in region.rings_mut().flat_map(|ring| &mut ring.points) {
        *point = to(*point);
    }
    region
}

/// Plans a zone with one heading, and what its volume is of that in the stretched plane.
fn stretched(
    number: u32,
    layer: &PartLayer,
    heading_rad: f64,
    context: &Context,
) -> Result<(Laid, f64), PlanError> {
    let stretch = Stretch::of(heading_rad, &context.settings.aperture);
    let major_mm = context.settings.aperture.major_mm();
    let mut settings = Settings {
        aperture: Aperture::Ellipse {
            major_mm,
            minor_mm: major_mm,
        },
        ..context.settings.clone()
    };
    if let Some(infill) = &mut settings.infill {
        let (sin, cos) = infill.angle_rad.sin_cos();
        let along = stretch.of_vector(Vector2::new(cos, sin));
        infill.angle_rad = along.y.atan2(along.x);
    }
    let mut start = context.start;
    let from = stretch.stretched(Point2::new(start[CHANNEL_X], start[CHANNEL_Y]));
    (start[CHANNEL_X], start[CHANNEL_Y]) = (from.x, from.y);
    let regions = layer.regions.iter();
    let layer = PartLayer {
        regions: regions
            .map(|region| mapped(region, |p| stretch.stretched(p)))
            .collect(),
        ..layer.clone()
    };
    let context = Context {
        settings: &settings,
        start,
        ..*context
    };
    let mut laid = flat(number..number + 1, &[layer], &context)?;
    for point in laid.moves.iter_mut().flat_map(|m| &mut m.curve.control) {
        let at = stretch.back(Point2::new(point[CHANNEL_X], point[CHANNEL_Y]));
        (point[CHANNEL_X], point[CHANNEL_Y]) = (at.x, at.y);
        point[CHANNEL_HEADING] = heading_rad;
    }
    for pass in &mut laid.curves {
        let control = pass.control.iter().map(|[x, y, _]| {
            let at = stretch.back(Point2::new(*x, *y));
            [at.x, at.y, heading_rad]
        });
        pass.control = control.collect();
    }
    for left_out in &mut laid.left_out {
        left_out.at = stretch.back(left_out.at);
        left_out.area_mm2 /= stretch.ratio;
    }
    if let Ground::Plane { kinds, .. } = &mut laid.on {
        for region in kinds
            .iter_mut()
            .flat_map(|kind: &mut LayerGroup| &mut kind.regions)
        {
            carried_back(region, &stretch)?;
        }
    }
    Ok((laid, 1.0 / stretch.ratio))
}

/// What is said of a region later on, carried back from the stretched plane.
fn carried_back(region: &mut RegionPlan, stretch: &Stretch) -> Result<(), PlanError> {
    let offset = region.contour.offset;
    let outline = mapped(&region.contour.region, |p| stretch.back(p + offset));
    let contour = Contour::of_region(&outline, SIMPLIFY_MM)?;
    let back = |p: Point2| stretch.back(p + offset) - contour.offset;
    for run in &mut region.unreachable {
        *run = UnreachableRun {
            from: back(run.from),
            to: back(run.to),
        };
    }
    region.contour = contour;
    Ok(())
}

/// Heights over the plane, for a tool that stays upright: seen from above nothing is changed.
struct Upright<'a>(&'a LevelSurface);

impl Chart for Upright<'_> {
    fn jet(&self, at: Point2) -> ChartJet {
        ChartJet {
            at_mm: Vector3::new(at.x, at.y, self.0.z_mm(at)),
            along: [Vector3::x(), Vector3::y()],
            bend: [Vector3::zeros(); 3],
        }
    }
}

/// A zone on the layer's top, its volumes times `share` of those planned and the layer's thickness over the nominal one.
fn lifted(
    (mut laid, share): (Laid, f64),
    regions: &[Region],
    (top, below): (&LevelSurface, &Below),
    settings: &Settings,
) -> Result<Laid, PlanError> {
    let corners = regions.iter().map(Region::bounds);
    let corners: Vec<Point2> = corners.flat_map(|b| [b.min, b.max]).collect();
    let Some(scale) = ScaleField::of(&Plane, Box2::of(&corners), |_| true, 0.0) else {
        return Ok(laid);
    };
    let layer_mm = settings.layer_height_mm;
    let volume_factor = |at: Point2| share * (top.z_mm(at) - below.z_mm(at)) / layer_mm;
    let on = LaidOn {
        chart: &Upright(top),
        scale: &scale,
        volume_factor: Some(&volume_factor),
    };
    let route = Route { moves: laid.moves };
    laid.moves = on_surface(&route, &on, settings)?;
    let prints = laid.moves.iter_mut();
    for print in prints.filter(|route_move| route_move.state == MotionState::Print) {
        let deepest_mm = DEEPEST * HANG_SHARE * layer_mm;
        follow_rear_edge(&mut print.curve, top, &settings.aperture, deepest_mm);
    }
    laid.edge_depth = edge_depth(&laid.moves, top, &settings.aperture);
    Ok(laid)
}

/// Poses and directions of travel at so many places of each span of a curve.
fn travel(curve: &PathCurve, places: usize) -> Vec<([f64; CHANNELS], Vector2)> {
    let mut direction = Vector2::x();
    let knots = (0..=curve.span_count() * places).map(|place| {
        let knot = place as f64 / places as f64;
        let tangent = curve.tangent(knot);
        let step = Vector2::new(tangent[CHANNEL_X], tangent[CHANNEL_Y]);
        direction = step.try_normalize(1e-9).unwrap_or(direction);
        (curve.value(knot), direction)
    });
    knots.collect()
}

fn place(pose: &[f64; CHANNELS]) -> Point2 {
    Point2::new(pose[CHANNEL_X], pose[CHANNEL_Y])
}

/// Lowers or lifts a pass so that the nozzle's rear edge lies on the layer's top; its ends stay.
fn follow_rear_edge(
    curve: &mut PathCurve,
    top: &LevelSurface,
    aperture: &Aperture,
    deepest_mm: f64,
) {
    let travel = travel(curve, 1);
    let steps = travel.windows(2);
    let mut along_mm = vec![0.0];
    for pair in steps {
        let step_mm = (place(&pair[1].0) - place(&pair[0].0)).norm();
        along_mm.push(along_mm[along_mm.len() - 1] + step_mm);
    }
    let whole_mm = along_mm[along_mm.len() - 1];
    let ends_mm = ENDS * aperture.major_mm();
    let knots = travel.iter().zip(&along_mm);
    let mut lifts_mm: Vec<f64> = knots
        .map(|((pose, direction), along_mm)| {
            let at = place(pose);
            let rear = aperture.support_point(pose[CHANNEL_HEADING], -direction);
            let share = (along_mm.min(whole_mm - along_mm) / ends_mm).clamp(0.0, 1.0);
            share * share * (3.0 - 2.0 * share) * (top.z_mm(at + rear) - top.z_mm(at))
        })
        .collect();
    for _ in 0..AVERAGINGS {
        let before = lifts_mm.clone();
        for (k, near) in before.windows(3).enumerate() {
            lifts_mm[k + 1] = 0.25 * (near[0] + 2.0 * near[1] + near[2]);
        }
    }
    // Where the path turns, what is averaged lags behind: no deeper than on a straight.
    for ((pose, direction), lift_mm) in travel.iter().zip(&mut lifts_mm) {
        let mut pose = *pose;
        pose[CHANNEL_Z] += *lift_mm;
        let over_mm = rear_depth_mm(&pose, direction, top, aperture) - deepest_mm;
        *lift_mm += over_mm.max(0.0);
    }
    for (point, lift_mm) in curve.control.iter_mut().zip(lifts_mm) {
        point[CHANNEL_Z] += lift_mm;
    }
}

/// How deep the rear half of the nozzle's edge is below the top of the layer.
fn rear_depth_mm(
    pose: &[f64; CHANNELS],
    direction: &Vector2,
    top: &LevelSurface,
    aperture: &Aperture,
) -> f64 {
    let at = place(pose);
    let edge = aperture.outline(pose[CHANNEL_HEADING], EDGE_POINTS);
    let rear = edge.iter().filter(|to| to.dot(direction) <= 1e-9);
    let highest_mm = rear.map(|to| top.z_mm(at + to));
    highest_mm.fold(pose[CHANNEL_Z], f64::max) - pose[CHANNEL_Z]
}

/// How deep the rear half of the nozzle's edge gets below the top of the layer.
fn edge_depth(moves: &[RouteMove], top: &LevelSurface, aperture: &Aperture) -> Option<EdgeDepth> {
    let prints = moves.iter().filter(|m| m.state == MotionState::Print);
    let poses = prints.flat_map(|m| travel(&m.curve, PLACES));
    let depths = poses.map(|(pose, direction)| EdgeDepth {
        depth_mm: rear_depth_mm(&pose, &direction, top, aperture),
        at_mm: [pose[CHANNEL_X], pose[CHANNEL_Y], pose[CHANNEL_Z]],
    });
    depths.fold(None, |deepest, own| EdgeDepth::deeper(deepest, Some(own)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::test_shapes::ELLIPSE;

    /// Goal: the stretch makes the nozzle round and goes back. Method: the outline of the ellipse at several headings.
    #[test]
    fn the_stretched_nozzle_is_round() {
        for heading_rad in [0.0, 0.4, 1.3, 2.9] {
            let stretch = Stretch::of(heading_rad, &ELLIPSE);
            for to in ELLIPSE.outline(heading_rad, 17) {
                let round = stretch.of_vector(to);
                assert!((round.norm() - ELLIPSE.major_mm()).abs() < 1e-12, "{round}");
                let at = Point2::new(3.0, -7.0) + to;
                assert!((stretch.back(stretch.stretched(at)) - at).norm() < 1e-12);
            }
        }
    }
}
