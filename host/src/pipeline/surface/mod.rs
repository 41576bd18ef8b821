//! A plan laid on curved ground: an outline with its layers and a mesh -> a job for a head that tilts.
//!
//! ```text
//! Mesh --smooth heights or a patch, flattened--> PatchChart, ScaleField   (mm, input coordinates)
//! Target --the chart--> regions --route_stack--> Route in the chart --on_surface--> [RouteMove] --complete_route--> Route
//! (mm)                  (mm)                     (mm, rad, height)                  (mm, rad, tool axis, mm³)
//! ```
//! The plan is made in the chart, by the planner of the plane: there the nozzle is as large as the ground's scale at the
//! place says ([`crate::geometry::place_scale`]). Refused with the place is what does not fit: no surface under
//! a part of the plan, steps and bends that a flat nozzle cannot follow, ground that cannot be flattened, a head that does
//! not tilt or would touch the surface.

pub mod curved_layers;
pub mod error;
mod height_ground;
mod laid_ground;
mod patch_ground;
mod patches;

use crate::text::refusal::refusal;
pub use error::SurfaceError;
pub use laid_ground::{OnSurface, Seams, SharpBend};

use crate::geometry::polygon::{Box2, Region};
use crate::geometry::{Point2, Vector2};
use crate::input::Target;
use crate::input::space_outline::SpaceOutline;
use crate::job::transform::PartTransform;
use crate::mesh::Mesh;
use crate::mesh::height_map::HeightMap;
use crate::pipeline::error::all_kept_out;
use crate::pipeline::placed_passes::{PlacedPasses, placed_passes};
use crate::pipeline::stack::{Stack, route_stack};
use crate::pipeline::surface::error::spot;
use crate::pipeline::{Plan, PlanError, start_pose};
use crate::plan::judge::figures::Swept;
use crate::plan::judge::ground_sweep::{CurvedGround, sweep_ground};
use crate::plan::judge::measure::measure;
use crate::plan::judge::touches::{Obstacle, Touches, touches_on};
use crate::plan::layers::layer_groups;
use crate::plan::layers::layer_groups::OFF_REGIONS;
use crate::plan::motion::best_place::FoundPlace;
use crate::plan::motion::segments::lay_segments_with_progress;
use crate::plan::motion::singular::SingularPlaces;
use crate::plan::outline::unreachable::UnreachableRun;
use crate::plan::progress::Progress;
use crate::plan::route::keep_out::cleared;
use crate::plan::route::moves::{PathCurve, Route, RouteMove};
use crate::plan::route::surface::{LaidOn, on_surface};
use crate::plan::route::waypoint_route::{complete_route, has_motion};
use crate::settings::Settings;
use headway_protocol::units::{CHANNEL_X, CHANNEL_Y, CHANNEL_Z, CHANNELS};
use height_ground::{HeightGround, under};
use laid_ground::in_chart;
use nalgebra::Vector3;
use patch_ground::PatchGround;

/// How far the smooth surface may be off the mesh, as a share of the layer height: aimed at, and at most.
const NEAR_SHARE: f64 = 0.1;
const OFF_SHARE_MAX: f64 = 0.5;
/// Surface beyond the plan that is fitted too, so that travel keeps above it, mm.
const MARGIN_MM: f64 = 3.0;
/// Points of the surface that the head is held against, and the least step between them, mm.
const HELD_AGAINST: f64 = 4000.0;
const HELD_STEP_MM: f64 = 0.5;

/// Plans a target on a surface, input coordinates both.
///
/// # Errors
/// [`PlanError`], of the surface [`SurfaceError`].
pub fn plan_on_surface(
    target: &Target,
    mesh: &Mesh,
    keep_out: &[Region],
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<Plan, PlanError> {
    settings.check()?;
    let map = HeightMap::of(mesh);
    let ground = HeightGround::under(target, &map, settings)?;
    let cleared = cleared(&target.regions, keep_out, settings);
    if cleared.regions.is_empty() {
        return Err(all_kept_out());
    }
    let to_chart = |regions: &[Region]| -> Vec<Region> {
        let place = |p: Point2| ground.place(p);
        regions
            .iter()
            .map(|region| in_chart(region, place))
            .collect()
    };
    let mut job = ChartJob {
        regions: to_chart(&cleared.regions),
        around: to_chart(&target.regions),
        keep_out: to_chart(keep_out),
        kept_out_mm2: cleared.lost_mm2,
    };
    let off = (ground.fitted.off_mm, ground.fitted.off_at);
    let laid = OnSurface::on(ground.chart, off, &mut job, settings)?;
    let planned = job.routed(&laid, settings, progress)?;
    for route_move in planned.moves.iter().filter(|s| s.pass.is_some()) {
        for point in &route_move.curve.control {
            let on_ground = laid.ground_below(point);
            under(&map, Point2::new(on_ground.x, on_ground.y))?;
        }
    }
    let held = Held::FromAbove(&map);
    let plan = laid_out(&planned, (mesh, held), laid, settings, progress)?;
    Ok(Plan {
        keep_out: keep_out.to_vec(),
        kept_out_mm2: job.kept_out_mm2,
        left_out: planned.left_out,
        ..plan
    })
}

/// Plans an outline that is drawn on a mesh, or without one the whole of it up to its rims; the mesh may hang over. Ground
/// that closes around something is cut open where it cannot be flattened otherwise, and a whole mesh is cut into patches where
/// that does not do.
///
/// # Errors
/// [`PlanError`], of the surface [`SurfaceError`].
pub fn plan_on_patch(
    outline: Option<&SpaceOutline>,
    mesh: &Mesh,
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<Plan, PlanError> {
    settings.check()?;
    let whole = laid_on_patch(outline, mesh, false, settings);
    let laid = match whole {
        Err(SurfaceError::NotFlat(_)) if PatchGround::may_be_cut(mesh) => {
            laid_on_patch(outline, mesh, true, settings)
        }
        whole => whole,
    };
    let (laid, job) = match laid {
        // The error of the whole mesh says the most where no patches are found.
        Err(error) if outline.is_none() && error.may_be_divided() => {
            let in_patches = patches::planned(mesh, settings, progress)?;
            return in_patches.ok_or(PlanError::Surface(error));
        }
        laid => laid?,
    };
    let planned = job.routed(&laid, settings, progress)?;
    let plan = laid_out(&planned, (mesh, Held::Sheet), laid, settings, progress)?;
    Ok(Plan {
        left_out: planned.left_out,
        ..plan
    })
}

fn laid_on_patch(
    outline: Option<&SpaceOutline>,
    mesh: &Mesh,
    cut: bool,
    settings: &Settings,
) -> Result<(OnSurface, ChartJob), SurfaceError> {
    let ground = PatchGround::of(mesh, outline, cut, settings)?;
    let mut job = ChartJob {
        around: ground.regions.clone(),
        regions: ground.regions,
        keep_out: Vec::new(),
        kept_out_mm2: 0.0,
    };
    let off = (ground.chart.off_mm, ground.chart.off_at_mm.into());
    let laid = OnSurface::on(ground.chart, off, &mut job, settings)?;
    Ok((laid, job))
}

/// Height of the middle one of the layers' tops above the ground, mm.
fn middle_mm(settings: &Settings) -> f64 {
    0.5 * settings.layer_height_mm * (f64::from(settings.layers) + 1.0)
}

/// What is to be planned, in the chart.
struct ChartJob {
    regions: Vec<Region>,
    /// What a skirt goes around.
    around: Vec<Region>,
    keep_out: Vec<Region>,
    kept_out_mm2: f64,
}

/// A route on the ground, before the ways there and back.
struct Routed {
    moves: Vec<RouteMove>,
    /// Passes of the regions, not around them.
    of_regions: Vec<bool>,
    unreachable: Vec<UnreachableRun>,
    left_out: Vec<crate::pipeline::stack::LeftOut>,
}

impl ChartJob {
    /// All of it so many times as large.
    fn scale(&mut self, factor: f64) {
        let parts = [&mut self.regions, &mut self.around, &mut self.keep_out];
        let rings = parts.into_iter().flatten().flat_map(Region::rings_mut);
        for point in rings.flat_map(|ring| &mut ring.points) {
            *point *= factor;
        }
    }

    fn routed(
        &self,
        laid: &OnSurface,
        settings: &Settings,
        progress: &dyn Progress,
    ) -> Result<Routed, PlanError> {
        let (kinds, layers) = layer_groups::prism_layers(settings, |_| Vec::new());
        let rings = self.regions.iter().flat_map(Region::rings);
        let corners: Vec<Point2> = rings.flat_map(|ring| ring.points.clone()).collect();
        let corner = Box2::of(&corners).min;
        let mut start = [0.0; CHANNELS];
        (start[CHANNEL_X], start[CHANNEL_Y]) = (corner.x, corner.y);
        let stack = Stack {
            outlines: vec![self.regions.clone()],
            kinds,
            layers,
            keep_out: &self.keep_out,
            kept_out_mm2: self.kept_out_mm2,
            skirt_around: Some(&self.around),
            scale: Some(&laid.scale),
            transform: PartTransform::default(),
            start: Some(start),
            is_last: true,
            may_leave_out: false,
        };
        let routed = route_stack(&stack, settings, progress)?;
        let on = LaidOn {
            chart: &*laid.chart,
            scale: &laid.scale,
            volume_factor: None,
        };
        let moves = on_surface(&routed.route, &on, settings)?;
        let regions = routed.kinds.iter().take(1).flat_map(|kind| &kind.regions);
        let unreachable = regions.flat_map(|region| {
            let offset = region.contour.offset;
            region.unreachable.iter().map(move |run| UnreachableRun {
                from: laid.seen_from_above(run.from + offset),
                to: laid.seen_from_above(run.to + offset),
            })
        });
        let is_of_regions = |print: &usize| *print != OFF_REGIONS;
        Ok(Routed {
            moves,
            of_regions: routed.print_of_curve.iter().map(is_of_regions).collect(),
            unreachable: unreachable.collect(),
            left_out: routed.left_out,
        })
    }
}

/// What nozzle and head are held against.
enum Held<'a> {
    /// The upper side of the mesh.
    FromAbove(&'a HeightMap<'a>),
    /// All of its triangles.
    Sheet,
}

/// A route on the machine.
struct PlacedRoute {
    route: Route,
    transform: PartTransform,
    found_place: Option<FoundPlace>,
    singular: SingularPlaces,
    touches: Option<Touches>,
}

/// Places what was mapped over and adds the way there and back.
fn placed(
    moves: &[RouteMove],
    (mesh, held): (&Mesh, Held),
    settings: &Settings,
) -> Result<PlacedRoute, PlanError> {
    let [low, high] = mesh.bounds_mm();
    let all = moves.iter().flat_map(|moved| &moved.curve.control);
    let corners: Vec<Point2> = all
        .clone()
        .map(|point| Point2::new(point[CHANNEL_X], point[CHANNEL_Y]))
        .chain([low.xy(), high.xy()])
        .collect();
    let top_mm = all.map(|point| point[CHANNEL_Z]).fold(low.z, f64::max);
    let bounds = Box2::of(&corners);
    let transform = PartTransform::choose_box(bounds, [low.z, top_mm], settings)?;
    let curves = moves.iter().filter(|route_move| has_motion(route_move));
    let curves: Vec<PathCurve> = curves
        .map(|route_move| shifted(&route_move.curve, transform.offset_mm))
        .collect();
    let PlacedPasses {
        passes,
        transform,
        found_place,
        singular,
        ..
    } = placed_passes(vec![curves], transform, bounds, settings, false)?;
    let start = start_pose(settings);
    let mesh_top_mm = high.z + transform.offset_mm[2];
    let route = complete_route(&[moves], passes, mesh_top_mm, start, settings);
    let points = held.points(mesh, bounds, &transform, settings);
    let touches = touches_on(&route, settings, &points);
    let mut touch = touches.iter().flat_map(|touches| &touches.deepest);
    if let Some(touch) = touch.find(|touch| touch.obstacle == Obstacle::Surface) {
        return Err(PlanError::Surface(SurfaceError::Refused(refusal!(
            "{} would be {:.2} mm in the surface with the tip at {} ([head] in the machine file): a smaller head, a longer \
             nozzle, or an outline that keeps off the hollow",
            touch.part.name(),
            touch.depth_mm,
            spot(transform.to_input(touch.tip_mm))
        ))));
    }
    Ok(PlacedRoute {
        route,
        transform,
        found_place,
        singular,
        touches,
    })
}

/// The motion of a route on the ground, and what it covers there.
fn laid_out(
    planned: &Routed,
    (mesh, held): (&Mesh, Held),
    laid: OnSurface,
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<Plan, PlanError> {
    let PlacedRoute {
        route,
        transform,
        found_place,
        singular,
        touches,
    } = placed(&planned.moves, (mesh, held), settings)?;
    let (stream, motion) = lay_segments_with_progress(&route, settings, progress)?;
    let (mut figures, measured) = measure(&stream, &[], &[], &transform, settings, progress);
    figures.passes = passes_of(&route);
    let is_of_regions = |pass: u32| planned.of_regions.get(pass as usize) != Some(&false);
    let ground = CurvedGround {
        chart: &*laid.chart,
        scale: &laid.scale,
        regions: &laid.regions,
        transform: &transform,
        lowest_layer: 0,
        joined: None,
    };
    let layers = sweep_ground(&stream, &ground, is_of_regions, settings);
    let numbers: Vec<u32> = layers.iter().map(|swept| swept.layer).collect();
    let swept: Vec<Swept> = layers.iter().map(|layer| layer.swept).collect();
    figures.set_shares(&numbers, &swept);
    Ok(Plan {
        transform,
        found_place,
        singular,
        touches,
        on_surface: Some(OnSurface {
            unreachable: planned.unreachable.clone(),
            layers,
            ..laid
        }),
        route,
        stream,
        motion,
        measured,
        figures,
        ..Plan::default()
    })
}

fn passes_of(route: &Route) -> usize {
    let passes = route.moves.iter().filter_map(|route_move| route_move.pass);
    passes.max().map_or(0, |last| last as usize + 1)
}

pub(in crate::pipeline) fn shifted(curve: &PathCurve, by_mm: [f64; 3]) -> PathCurve {
    let mut control = curve.control.clone();
    for point in &mut control {
        for (channel, by_mm) in (CHANNEL_X..=CHANNEL_Z).zip(by_mm) {
            point[channel] += by_mm;
        }
    }
    PathCurve { control }
}

impl Held<'_> {
    /// Points of the surface that nozzle and head may not enter, machine coordinates.
    fn points(
        &self,
        mesh: &Mesh,
        bounds: Box2,
        transform: &PartTransform,
        settings: &Settings,
    ) -> Vec<Vector3<f64>> {
        let Some(head) = &settings.head else {
            return Vec::new();
        };
        let samples = match self {
            Held::FromAbove(map) => {
                let (around, own) = (bounds.grown(head.reach_mm()), map.bounds());
                let within = Box2 {
                    min: around.min.sup(&own.min),
                    max: around.max.inf(&own.max),
                };
                let size: Vector2 = within.size();
                let step_mm = (size.x * size.y / HELD_AGAINST).sqrt().max(HELD_STEP_MM);
                map.samples(within, step_mm)
            }
            Held::Sheet => {
                let every = (mesh.triangles.len() as f64 / HELD_AGAINST).ceil().max(1.0) as usize;
                let middles = (0..mesh.triangles.len()).step_by(every).map(|triangle| {
                    let corners = mesh.corners(triangle).map(|corner| corner.coords);
                    (corners.iter().sum::<Vector3<f64>>() / 3.0).into()
                });
                middles.collect()
            }
        };
        let samples = samples.into_iter();
        samples
            .map(|sample| Vector3::from(transform.to_machine(sample)))
            .collect()
    }
}
