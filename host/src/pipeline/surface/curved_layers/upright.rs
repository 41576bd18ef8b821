//! Curved layers for a head that does not tilt: planned in the plane, zone by zone, and lifted.
//!
//! In: a curved layer with its number in the job. Out: [`Laid`], one for each zone of the layer ([`super::level_zones`]).
//! Where headings are free, the planner of the plane plans a zone as a flat layer. Where the nozzle keeps one heading, the plane
//! is stretched across its long axis until the ellipse is a circle of radius a: the plan for a round nozzle there, carried back,
//! covers as much of the ground, lays as little of it twice, and stays inside the walls as well. Volumes are those of
//! the layer's own thickness.

use super::laid_layer::{Context, Ground, Laid, flat, solid};
use super::layer_shape::{Below, LevelSurface, PartLayer};
use super::level_zones::zones;
use crate::geometry::aperture::Aperture;
use crate::geometry::chart::{Chart, ChartJet, Plane};
use crate::geometry::place_scale::ScaleField;
use crate::geometry::polygon::{Box2, Region};
use crate::geometry::{Point2, Vector2};
use crate::job::MotionState;
use crate::pipeline::PlanError;
use crate::pipeline::surface::SurfaceError;
use crate::plan::layers::layer_groups::LayerGroup;
use crate::plan::layers::region_plan::RegionPlan;
use crate::plan::outline::contour::{Contour, SIMPLIFY_MM};
use crate::plan::outline::unreachable::UnreachableRun;
use crate::plan::route::moves::{Route, RouteMove};
use crate::plan::route::surface::{LaidOn, on_surface};
use crate::settings::Settings;
use headway_protocol::units::{CHANNEL_HEADING, CHANNEL_X, CHANNEL_Y, CHANNEL_Z, CHANNELS};
use nalgebra::Vector3;

/// Points of the nozzle's edge that are held against the layer's top.
const EDGE_POINTS: usize = 48;

/// Where the edge of a nozzle is deepest below the top of the layer that it prints.
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
            None => (flat(number..number + 1, &[of_zone.clone()], &context)?, 1.0),
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
    laid.moves = on_surface(&route, &on, settings).map_err(SurfaceError::from)?;
    laid.edge_depth = edge_depth(&laid.moves, top, &settings.aperture);
    Ok(laid)
}

/// How deep the nozzle's edge gets below the top of the layer.
fn edge_depth(moves: &[RouteMove], top: &LevelSurface, aperture: &Aperture) -> Option<EdgeDepth> {
    let prints = moves.iter().filter(|m| m.state == MotionState::Print);
    let poses = prints.flat_map(|m| &m.curve.control);
    let depths = poses.map(|pose: &[f64; CHANNELS]| {
        let at = Point2::new(pose[CHANNEL_X], pose[CHANNEL_Y]);
        let edge = aperture.outline(pose[CHANNEL_HEADING], EDGE_POINTS);
        let highest_mm = edge.iter().map(|to| top.z_mm(at + to));
        EdgeDepth {
            depth_mm: highest_mm.fold(pose[CHANNEL_Z], f64::max) - pose[CHANNEL_Z],
            at_mm: [at.x, at.y, pose[CHANNEL_Z]],
        }
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
