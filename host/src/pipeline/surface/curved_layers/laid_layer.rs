//! Layers planned: flat ones in the plane, a curved one in a chart of its own.
//!
//! In: [`PartLayer`]s with the numbers that they have in the job. Out: [`Laid`], their moves from the first prime to the
//! lift behind the last pass, in the part's coordinates over the bed, volumes and passes counted from 0. A curved layer's
//! ground is the surface a layer height below its top along the normal, so that all that holds for the first layer on a
//! surface holds for it; its volume is that between its top and what it is laid on.

use super::layer_shape::{Below, LevelSurface, PartLayer};
use super::upright::EdgeDepth;
use crate::geometry::chart::Chart;
use crate::geometry::polygon::{Box2, Region};
use crate::geometry::spline_surface::{FittedSurface, SplineSurface};
use crate::geometry::{Point2, Vector2};
use crate::job::MotionState;
use crate::job::transform::PartTransform;
use crate::pipeline::PlanError;
use crate::pipeline::stack::{LeftOut, RoutedStack, Stack, route_stack};
use crate::pipeline::surface::ChartJob;
use crate::pipeline::surface::height_ground::HeightGround;
use crate::pipeline::surface::laid_ground::{OnSurface, in_chart};
use crate::plan::layers::PlanePass;
use crate::plan::layers::inside::Inside;
use crate::plan::layers::layer_groups::{LayerGroup, LayerKind, RegionPrint, StackLayer};
use crate::plan::outline::unreachable::UnreachableRun;
use crate::plan::progress::Progress;
use crate::plan::route::moves::RouteMove;
use crate::plan::route::surface::{LaidOn, on_surface};
use crate::settings::{Infill, Settings, Skirt};
use headway_protocol::units::{CHANNEL_X, CHANNEL_Y, CHANNELS};
use nalgebra::Vector3;

/// Pitch of the ground of a curved layer, of the unit.
const PITCH: f64 = 0.5;

/// What was planned of one or more layers.
pub struct Laid {
    /// Their moves.
    pub moves: Vec<RouteMove>,
    /// Their passes.
    pub curves: Vec<PlanePass>,
    /// For each pass the number of its print, or [`OFF_REGIONS`].
    pub print_of_curve: Vec<usize>,
    /// What is not printed.
    pub left_out: Vec<LeftOut>,
    /// What they lie on.
    pub on: Ground,
    /// How deep the nozzle's edge gets below the layer's top, where the head stays upright on a slope.
    pub edge_depth: Option<EdgeDepth>,
}

/// What layers lie on.
pub enum Ground {
    /// The plane.
    Plane {
        /// Kinds of layer.
        kinds: Vec<LayerGroup>,
        /// Prints of regions.
        prints: Vec<RegionPrint>,
    },
    /// A surface.
    Surface(Box<OnSurface>),
}

/// What a layer is planned with.
#[derive(Clone, Copy)]
pub struct Context<'a> {
    /// Settings of the job.
    pub settings: &'a Settings,
    /// Where the head comes from.
    pub start: [f64; CHANNELS],
    /// True for the first layers of the job, which a skirt goes around.
    pub is_first: bool,
    /// What of a flat layer is filled whatever the density, by its number.
    pub solid: &'a (dyn Fn(u32) -> Vec<Region> + 'a),
    /// Is told how far it is.
    pub progress: &'a dyn Progress,
}

/// Plans flat layers that follow each other.
///
/// # Errors
/// [`PlanError`]; a region that cannot be planned is left out instead.
pub fn flat(
    numbers: std::ops::Range<u32>,
    layers: &[PartLayer],
    context: &Context,
) -> Result<Laid, PlanError> {
    let mut stack = empty_stack(context.start);
    for (number, layer) in numbers.zip(layers) {
        let known = stack.outlines.iter().position(|own| *own == layer.regions);
        let outline = known.unwrap_or_else(|| {
            stack.outlines.push(layer.regions.clone());
            stack.outlines.len() - 1
        });
        let infill = context.settings.infill.as_ref();
        let kind = LayerKind {
            outline,
            inside: Inside {
                infill: infill.map(|infill| infill.inside(number)),
                solid: (context.solid)(number),
                ..Inside::default()
            },
        };
        let known = stack.kinds.iter().position(|own| *own == kind);
        let kind_number = known.unwrap_or_else(|| {
            stack.kinds.push(kind);
            stack.kinds.len() - 1
        });
        stack.layers.push(StackLayer {
            number,
            top_mm: layer.rank_mm,
            kind: kind_number,
        });
    }
    let around = layers.first().map(|layer| layer.regions.as_slice());
    stack.skirt_around = around.filter(|_| context.is_first);
    let routed = route_stack(&stack, context.settings, context.progress)?;
    let is_begun = |route_move: &RouteMove| route_move.state != MotionState::Travel;
    let mut moves = routed.route.moves;
    let first = moves.iter().position(is_begun).unwrap_or(moves.len());
    moves.drain(..first);
    Ok(Laid {
        moves,
        curves: routed.curves,
        print_of_curve: routed.print_of_curve,
        left_out: routed.left_out,
        on: Ground::Plane {
            kinds: routed.kinds,
            prints: routed.prints,
        },
        edge_depth: None,
    })
}

fn empty_stack<'a>(start: [f64; CHANNELS]) -> Stack<'a> {
    Stack {
        outlines: Vec::new(),
        kinds: Vec::new(),
        layers: Vec::new(),
        keep_out: &[],
        kept_out_mm2: 0.0,
        skirt_around: None,
        scale: None,
        transform: PartTransform::default(),
        start: Some(start),
        is_last: true,
        may_leave_out: true,
    }
}

/// The same settings with an inside that is solid.
pub fn solid(settings: &Settings) -> Settings {
    Settings {
        infill: settings.infill.map(|infill| Infill {
            density_pct: 100.0,
            ..infill
        }),
        ..settings.clone()
    }
}

/// Plans a curved layer.
///
/// # Errors
/// [`PlanError`], of its surface [`SurfaceError`].
pub fn curved(
    number: u32,
    regions: &[Region],
    (top, below): (&LevelSurface, &Below),
    context: &Context,
) -> Result<Laid, PlanError> {
    let skirt = match context.is_first {
        true => context.settings.skirt,
        false => Skirt::default(),
    };
    let settings = &Settings {
        layers: 1,
        skirt,
        ..solid(context.settings)
    };
    let layer_mm = settings.layer_height_mm;
    let ground = |bounds: Box2| ground_below(top, bounds, settings);
    let chart = HeightGround::of_heights(regions, ground, settings)?.chart;
    let place = |p: Point2| {
        let tip = Vector3::new(p.x, p.y, top.z_mm(p));
        chart.place_of(tip, chart.near(tip), layer_mm)
    };
    let regions: Vec<Region> = regions
        .iter()
        .map(|region| in_chart(region, place))
        .collect();
    let mut job = ChartJob {
        around: regions.clone(),
        regions,
        keep_out: Vec::new(),
        kept_out_mm2: 0.0,
    };
    let mut laid = OnSurface::on(chart, (0.0, [0.0; 3]), &mut job, settings)?;
    let routed = routed(
        number,
        &job,
        &laid,
        context.is_first,
        settings,
        context.progress,
    )?;
    let volume_factor = |at: Point2| {
        let frame = laid.chart.frame(at, layer_mm);
        let seen = Point2::from(frame.tip_mm.xy());
        let thickness_mm = top.z_mm(seen) - below.z_mm(seen);
        frame.area_factor() * frame.normal.z * thickness_mm / layer_mm
    };
    let on = LaidOn {
        chart: &*laid.chart,
        scale: &laid.scale,
        volume_factor: Some(&volume_factor),
    };
    let moves = on_surface(&routed.route, &on, settings)?;
    let left_out = routed.left_out.into_iter().map(|left_out| LeftOut {
        at: laid.seen_from_above(left_out.at),
        ..left_out
    });
    let left_out = left_out.collect();
    laid.unreachable = unreachable(&routed.kinds, &laid);
    Ok(Laid {
        moves,
        curves: routed.curves,
        print_of_curve: routed.print_of_curve,
        left_out,
        on: Ground::Surface(Box::new(laid)),
        edge_depth: None,
    })
}

/// The surface a layer height below another along its normal.
fn ground_below(top: &LevelSurface, bounds: Box2, settings: &Settings) -> FittedSurface {
    let layer_mm = settings.layer_height_mm;
    let pitch_mm = PITCH * settings.aperture.unit_mm();
    let step_mm = 0.5 * pitch_mm;
    let size = bounds.size();
    let [columns, rows] = [size.x, size.y].map(|side| (side / step_mm).ceil() as usize);
    let places = (0..=rows).flat_map(|j| (0..=columns).map(move |i| (i, j)));
    let points = places.map(|(i, j)| {
        let at = bounds.min + step_mm * Vector2::new(i as f64, j as f64);
        let jet = top.jet(at);
        let normal = Vector3::new(-jet.slope[0], -jet.slope[1], 1.0).normalize();
        let below = Vector3::new(at.x, at.y, jet.z_mm) - layer_mm * normal;
        [below.x, below.y, below.z]
    });
    let points: Vec<[f64; 3]> = points.collect();
    let fitted = SplineSurface::on_grid(&points, bounds, pitch_mm);
    FittedSurface {
        // There are points: the box has corners.
        surface: fitted.unwrap_or_else(|| SplineSurface::level(bounds, pitch_mm)),
        off_mm: 0.0,
        off_at: [0.0; 3],
    }
}

fn routed(
    number: u32,
    job: &ChartJob,
    laid: &OnSurface,
    is_first: bool,
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<RoutedStack, PlanError> {
    let corners = job.regions.iter().map(|region| region.bounds().min);
    let corner = Box2::of(&corners.collect::<Vec<_>>()).min;
    let mut start = [0.0; CHANNELS];
    (start[CHANNEL_X], start[CHANNEL_Y]) = (corner.x, corner.y);
    let infill = settings.infill.as_ref();
    let stack = Stack {
        outlines: vec![job.regions.clone()],
        kinds: vec![LayerKind {
            outline: 0,
            inside: Inside {
                infill: infill.map(|infill| infill.inside(number)),
                ..Inside::default()
            },
        }],
        layers: vec![StackLayer {
            number,
            top_mm: settings.layer_height_mm,
            kind: 0,
        }],
        skirt_around: is_first.then_some(&job.around),
        scale: Some(&laid.scale),
        ..empty_stack(start)
    };
    route_stack(&stack, settings, progress)
}

fn unreachable(kinds: &[LayerGroup], laid: &OnSurface) -> Vec<UnreachableRun> {
    let regions = kinds.iter().flat_map(|kind| &kind.regions);
    let runs = regions.flat_map(|region| {
        let offset = region.contour.offset;
        region.unreachable.iter().map(move |run| UnreachableRun {
            from: laid.seen_from_above(run.from + offset),
            to: laid.seen_from_above(run.to + offset),
        })
    });
    runs.collect()
}
