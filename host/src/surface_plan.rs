//! A planar plan laid on a surface: an outline with its layers and a mesh -> a job for a head that tilts.
//!
//! ```text
//! Mesh --samples, fit--> SplineSurface (mm, input coordinates)
//! Target --route_stack--> Route in the plan's plane --on_surface--> [RouteMove] --complete_route--> Route
//! (mm)                    (mm, rad, height above the surface)      (mm, rad, tool axis, mm³)
//! ```
//! The outline is the target as seen from above, in the mesh's coordinates. It is planned with an aperture
//! that is narrower by the steepest slope ([`narrowed`]), so that beads which lie farther apart on the slope
//! can be made as wide as that by turning the nozzle. Refused with the place is what does not fit: no surface under
//! a part of the plan, steps that a smooth surface cannot follow, a head that does not tilt or would touch the surface.

use crate::geometry::aperture::Aperture;
use crate::geometry::polygon::{Box2, Region};
use crate::geometry::spline_surface::{FittedSurface, SplineSurface};
use crate::geometry::{Point2, Vector2};
use crate::input::Target;
use crate::layer_stack::{Stack, route_stack};
use crate::mesh::Mesh;
use crate::mesh::height_map::HeightMap;
use crate::part_transform::PartTransform;
use crate::plan::judge::measure::measure;
use crate::plan::judge::touches::{HeadPart, Obstacle, touches_on};
use crate::plan::layers::layer_groups;
use crate::plan::layers::skirt::skirt_reach_mm;
use crate::plan::motion::segments::lay_segments_with_progress;
use crate::plan::outline::unreachable::UnreachableRun;
use crate::plan::progress::Progress;
use crate::plan::route::keep_out::cleared;
use crate::plan::route::moves::{PathCurve, Route, RouteMove};
use crate::plan::route::surface::{LayerFoldsError, on_surface};
use crate::plan::route::waypoint_curve::rounding::RoundedCorners;
use crate::plan::route::waypoint_route::{complete_route, has_motion};
use crate::settings::Settings;
use crate::{PlacedPasses, Plan, PlanError, placed_passes, start_pose};
use headway_firmware::configuration::Kinematics;
use headway_protocol::units::{CHANNEL_X, CHANNEL_Y, CHANNEL_Z, CHANNELS};
use nalgebra::Vector3;

/// How far the smooth surface may be off the mesh, as a share of the layer height: aimed at, and at most.
const NEAR_SHARE: f64 = 0.1;
const OFF_SHARE_MAX: f64 = 0.5;
/// Step between samples of the mesh, mm, as long as there are no more than this along an axis.
const SAMPLE_MM: f64 = 0.25;
const SAMPLES_MAX: f64 = 256.0;
/// Step along the outline and over the ground, mm, at which the surface is looked for and its slope taken.
const LOOK_MM: f64 = 0.5;
/// Surface beyond the plan that is fitted too, so that travel keeps above it, mm.
const MARGIN_MM: f64 = 3.0;
/// Points of the surface that the head is held against.
const HELD_AGAINST: f64 = 4000.0;
/// Tilt that a machine without tilting axes can ignore, rad.
const UPRIGHT_RAD: f64 = 1e-6;

/// Why a plan does not go onto a surface.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SurfaceError {
    /// A part of the plan hangs in the air.
    #[error(
        "the surface does not lie under the whole plan: nothing of the mesh is at ({:.2}, {:.2}) mm; both are \
         taken in the same coordinates: move one of them in its file, or make the outline smaller",
        at_mm[0], at_mm[1]
    )]
    NotUnder {
        /// Place in the plan.
        at_mm: [f64; 2],
    },
    /// Steps and sharp edges.
    #[error(
        "a smooth surface is {off_mm:.3} mm off the mesh near ({:.2}, {:.2}, {:.2}) mm, more than half a layer \
         ({most_mm:.3} mm): the mesh has a step, a wall or a sharp edge there; keep the outline off it or \
         round it",
        at_mm[0], at_mm[1], at_mm[2]
    )]
    TooRough {
        /// How far it is off.
        off_mm: f64,
        /// How far it may be.
        most_mm: f64,
        /// Place on the mesh.
        at_mm: [f64; 3],
    },
    /// The machine cannot tilt its head.
    #[error(
        "the surface slopes by {slope_deg:.1}° near ({:.2}, {:.2}) mm, and this machine's head does not tilt; \
         plan for another machine (--machine)",
        at_mm[0], at_mm[1]
    )]
    CannotTilt {
        /// Angle of the slope.
        slope_deg: f64,
        /// Place in the plan.
        at_mm: [f64; 2],
    },
    /// A layer folds.
    #[error(transparent)]
    Folds(#[from] LayerFoldsError),
    /// Nozzle or head would touch the surface.
    #[error(
        "{} would be {depth_mm:.2} mm in the surface with the tip at ({:.2}, {:.2}, {:.2}) mm ([head] in the \
         machine file): a smaller head, a longer nozzle, or an outline that keeps off the hollow",
        part.name(),
        at_mm[0], at_mm[1], at_mm[2]
    )]
    HeadTouches {
        /// What touches.
        part: HeadPart,
        /// How deep.
        depth_mm: f64,
        /// The tip, input coordinates.
        at_mm: [f64; 3],
    },
    /// An aperture whose bead does not lie evenly about its path.
    #[error(
        "a polygon aperture without 180° symmetry cannot be turned for the slope: use another --aperture"
    )]
    NotSymmetric,
}

/// How a plan lies on its surface.
#[derive(Clone, Debug, PartialEq)]
pub struct OnSurface {
    /// The smooth surface, input coordinates.
    pub fitted: FittedSurface,
    /// The steepest slope under the plan, rad.
    pub slope_max_rad: f64,
    /// The aperture that the plane was planned with.
    pub planned: Aperture,
    /// Boundary of the plan that is not reached, input coordinates of the first layer.
    pub unreachable: Vec<UnreachableRun>,
}

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
    let (fitted, slope_max_rad) = surface_under(target, &map, settings)?;
    let flat = Settings {
        aperture: narrowed(&settings.aperture, slope_max_rad)?,
        ..settings.clone()
    };
    let cleared = cleared(&target.regions, keep_out, &flat);
    if cleared.regions.is_empty() {
        return Err(PlanError::AllKeptOut);
    }
    let (kinds, layers) = layer_groups::prism_layers(&flat);
    let corner = crate::target_bounds(target).min;
    let mut start = [0.0; CHANNELS];
    (start[CHANNEL_X], start[CHANNEL_Y]) = (corner.x, corner.y);
    let stack = Stack {
        outlines: vec![cleared.regions],
        kinds,
        layers,
        keep_out,
        kept_out_mm2: cleared.lost_mm2,
        skirt_around: Some(&target.regions),
        transform: PartTransform::default(),
        start,
        is_last: true,
        may_leave_out: false,
    };
    let routed = route_stack(&stack, &flat, progress)?;
    for route_move in routed.route.moves.iter().filter(|s| s.pass.is_some()) {
        for point in &route_move.curve.control {
            under(&map, Point2::new(point[CHANNEL_X], point[CHANNEL_Y]))?;
        }
    }
    let moves = on_surface(&routed.route, &flat.aperture, &fitted.surface, settings)
        .map_err(SurfaceError::from)?;
    let regions = routed.kinds.iter().take(1).flat_map(|kind| &kind.regions);
    let unreachable = regions.flat_map(|region| {
        let offset = region.contour.offset;
        region.unreachable.iter().map(move |run| UnreachableRun {
            from: run.from + offset,
            to: run.to + offset,
        })
    });
    let laid = OnSurface {
        unreachable: unreachable.collect(),
        slope_max_rad,
        planned: flat.aperture,
        fitted,
    };
    let plan = laid_out(&moves, mesh, &map, laid, settings, progress)?;
    Ok(Plan {
        keep_out: keep_out.to_vec(),
        kept_out_mm2: stack.kept_out_mm2,
        left_out: routed.left_out,
        ..plan
    })
}

/// The smooth surface under a target, and its steepest slope there.
fn surface_under(
    target: &Target,
    map: &HeightMap,
    settings: &Settings,
) -> Result<(FittedSurface, f64), SurfaceError> {
    let edges = target.regions.iter().flat_map(Region::edges);
    for (p, q) in edges {
        let steps = ((q - p).norm() / LOOK_MM).ceil().max(1.0) as usize;
        for step in 0..steps {
            under(map, p + (q - p) * (step as f64 / steps as f64))?;
        }
    }
    let reach_mm = skirt_reach_mm(settings) + MARGIN_MM;
    let bounds = crate::target_bounds(target).grown(reach_mm);
    let size = bounds.size();
    let step_mm = (size.x.max(size.y) / SAMPLES_MAX).max(SAMPLE_MM);
    let near_mm = NEAR_SHARE * settings.layer_height_mm;
    // What lies beside the plan may be as rough as it likes.
    let grown = bounds.grown(-MARGIN_MM + step_mm);
    let mut points = map.samples(bounds, step_mm);
    let is_near = |p: &[f64; 3]| grown.contains(Point2::new(p[0], p[1]));
    points.retain(|p| is_near(p) || is_level(map, p, step_mm));
    let at = crate::target_bounds(target).min;
    let fitted = SplineSurface::through(&points, bounds, near_mm, 2.0 * step_mm).ok_or(
        SurfaceError::NotUnder {
            at_mm: [at.x, at.y],
        },
    )?;
    let most_mm = OFF_SHARE_MAX * settings.layer_height_mm;
    if fitted.off_mm > most_mm {
        return Err(SurfaceError::TooRough {
            off_mm: fitted.off_mm,
            most_mm,
            at_mm: fitted.off_at,
        });
    }
    let (slope, at_mm) = steepest(target, &fitted.surface);
    let tilts = settings.machine.kinematics != Kinematics::Planar;
    if slope.atan() > UPRIGHT_RAD && !tilts {
        return Err(SurfaceError::CannotTilt {
            slope_deg: slope.atan().to_degrees(),
            at_mm,
        });
    }
    Ok((fitted, slope.atan()))
}

/// True where the mesh goes on around a sample.
fn is_level(map: &HeightMap, p: &[f64; 3], step_mm: f64) -> bool {
    let beside = [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]];
    beside.iter().all(|[x, y]| {
        let at = Point2::new(p[0] + x * step_mm, p[1] + y * step_mm);
        map.top_mm(at)
            .is_some_and(|top_mm| (top_mm - p[2]).abs() < 4.0 * step_mm)
    })
}

fn under(map: &HeightMap, p: Point2) -> Result<(), SurfaceError> {
    match map.top_mm(p) {
        Some(_) => Ok(()),
        None => Err(SurfaceError::NotUnder { at_mm: [p.x, p.y] }),
    }
}

/// The greatest slope over the target's ground, mm a mm, with its place.
fn steepest(target: &Target, surface: &SplineSurface) -> (f64, [f64; 2]) {
    let mut steepest = (0.0, [0.0; 2]);
    for region in &target.regions {
        let bounds = region.bounds();
        let size = bounds.size();
        let step_mm = LOOK_MM.max(size.x.max(size.y) / SAMPLES_MAX);
        let [columns, rows] = [size.x, size.y].map(|side| (side / step_mm).ceil() as usize);
        let inner = (0..=rows).flat_map(|j| (0..=columns).map(move |i| (i, j)));
        let inner = inner.map(|(i, j)| {
            bounds.min
                + Vector2::new(
                    size.x * i as f64 / columns as f64,
                    size.y * j as f64 / rows as f64,
                )
        });
        let inner = inner.filter(|&p| region.contains(p));
        for p in inner.chain(region.edges().map(|(p, _)| p)) {
            let [x, y] = surface.jet(p.x, p.y).slope;
            if x.hypot(y) > steepest.0 {
                steepest = (x.hypot(y), [p.x, p.y]);
            }
        }
    }
    steepest
}

/// The aperture to plan with: beads of it become at most as wide as the nozzle lays, where the slope is
/// steepest.
fn narrowed(aperture: &Aperture, slope_max_rad: f64) -> Result<Aperture, SurfaceError> {
    if aperture.period_rad() > std::f64::consts::PI {
        return Err(SurfaceError::NotSymmetric);
    }
    let cos = slope_max_rad.cos();
    if cos > 1.0 - 1e-9 {
        return Ok(*aperture);
    }
    let major_mm = aperture.major_mm() * cos;
    Ok(Aperture::Ellipse {
        major_mm,
        minor_mm: aperture.minor_mm().min(major_mm),
    })
}

/// Places what was mapped over, adds the way there and back, and finds its motion.
fn laid_out(
    moves: &[RouteMove],
    mesh: &Mesh,
    map: &HeightMap,
    laid: OnSurface,
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<Plan, PlanError> {
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
    let curves = passes.into_iter().flatten().collect();
    let start = start_pose(settings);
    let mesh_top_mm = high.z + transform.offset_mm[2];
    let route = complete_route(moves, curves, mesh_top_mm, start, settings);
    let touches = touches_on(
        &route,
        settings,
        &held_against(map, bounds, &transform, settings),
    );
    let mut touch = touches.iter().flat_map(|touches| &touches.deepest);
    if let Some(touch) = touch.find(|touch| touch.obstacle == Obstacle::Surface) {
        return Err(PlanError::Surface(SurfaceError::HeadTouches {
            part: touch.part,
            depth_mm: touch.depth_mm,
            at_mm: transform.to_input(touch.tip_mm),
        }));
    }
    let (stream, motion) = lay_segments_with_progress(&route, settings, progress)?;
    let (mut figures, measured) = measure(&stream, &[], &[], &transform, settings, progress);
    figures.passes = passes_of(&route);
    Ok(Plan {
        transform,
        keep_out: Vec::new(),
        kept_out_mm2: 0.0,
        left_out: Vec::new(),
        skirt: None,
        outline_crossings: 0,
        kinds: Vec::new(),
        prints: Vec::new(),
        curves: Vec::new(),
        print_of_curve: Vec::new(),
        found_place,
        leaned: None,
        rounded: RoundedCorners::default(),
        singular,
        touches,
        on_surface: Some(laid),
        slowed: Default::default(),
        route,
        stream,
        motion,
        measured,
        figures,
    })
}

fn passes_of(route: &Route) -> usize {
    let passes = route.moves.iter().filter_map(|route_move| route_move.pass);
    passes.max().map_or(0, |last| last as usize + 1)
}

fn shifted(curve: &PathCurve, by_mm: [f64; 3]) -> PathCurve {
    let mut control = curve.control.clone();
    for point in &mut control {
        for (channel, by_mm) in (CHANNEL_X..=CHANNEL_Z).zip(by_mm) {
            point[channel] += by_mm;
        }
    }
    PathCurve { control }
}

/// Points of the surface that nozzle and head may not enter, machine coordinates.
fn held_against(
    map: &HeightMap,
    bounds: Box2,
    transform: &PartTransform,
    settings: &Settings,
) -> Vec<Vector3<f64>> {
    let Some(head) = &settings.head else {
        return Vec::new();
    };
    let around = bounds.grown(head.reach_mm());
    let own = map.bounds();
    let within = Box2 {
        min: around.min.sup(&own.min),
        max: around.max.inf(&own.max),
    };
    let size = within.size();
    let step_mm = (size.x * size.y / HELD_AGAINST).sqrt().max(LOOK_MM);
    let samples = map.samples(within, step_mm).into_iter();
    samples
        .map(|sample| Vector3::from(transform.to_machine(sample)))
        .collect()
}
