//! Headway's host side: plans the motion of turned nozzles, simulates it, streams it.
//!
//! ```text
//! Target --contour--> Contour --medial axis--> MedialAxis --prune--> Axis
//!  (mm)               (mm, local)              (mm)                  (mm)
//!    --passes--> LayerPass --order--> LayerPass --curve--> PlanePass
//!                (mm, rad)                                 (mm, rad, machine coordinates)
//!    --route--> Route --time law, segments--> SegmentStream --measure--> Figures
//!               (mm, rad, mm³)                (integer units, servo ticks)
//! WaypointRun --curve--> PathCurve --route--> Route, and on as above
//! ```
//!
//! [`plan_target`] is that pipeline, [`plan_waypoints`] its short form; every intermediate stays in
//! [`Plan`], for pictures and tests.
//! `drive` moves the finished stream, `report` draws and tabulates, `cli` is the command.
#![forbid(unsafe_code)]

pub mod cli;
pub mod drive;
pub mod geometry;
pub mod input;
pub mod job;
pub mod job_file;
pub mod part_transform;
pub mod plan;
pub mod report;
pub mod settings;
pub mod wire_frames;

use crate::geometry::coverage::Coverage;
use crate::geometry::{Point2, Vector2};
use crate::input::Target;
use crate::input::waypoints::WaypointRun;
use crate::job::SegmentStream;
use crate::part_transform::{PartTransform, PlaceError};
use crate::plan::build_route::{PlanePass, build_route};
use crate::plan::contour::{Contour, ContourError, SIMPLIFY_MM};
use crate::plan::darts::fill_gaps;
use crate::plan::joint_limits::MotionError;
use crate::plan::layer_path::pass_curves;
use crate::plan::links::linked;
use crate::plan::measure::{LayerFigures, measure_layer};
use crate::plan::medial_axis::{AxisOptions, MedialAxis, MedialAxisError};
use crate::plan::order::{ordered, region_order};
use crate::plan::passes::{LayerPass, PassSettings, passes};
use crate::plan::route::Route;
use crate::plan::segments::{MotionReport, lay_segments};
use crate::plan::skeleton::Axis;
use crate::plan::waypoint_curve::{WaypointCurveError, waypoint_curves};
use crate::plan::waypoint_route::waypoint_route;
use crate::settings::{PassMode, Settings};
use headway_protocol::units::{CHANNEL_X, CHANNEL_Y, CHANNEL_Z, CHANNELS};

/// Everything that planning one region of a layer made.
#[derive(Clone, Debug)]
pub struct RegionPlan {
    /// The cleaned outline about its local origin.
    pub contour: Contour,
    /// The whole medial axis, local.
    pub medial_axis: MedialAxis,
    /// The part of it that passes are planned on, local.
    pub axis: Axis,
    /// Passes in printing order, local.
    pub passes: Vec<LayerPass>,
}

/// A planned target, with all intermediates.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Where the part lies on the machine.
    pub transform: PartTransform,
    /// The regions, in printing order.
    pub regions: Vec<RegionPlan>,
    /// The curves that are printed, machine coordinates, in order.
    pub curves: Vec<PlanePass>,
    /// For each curve the number of its region.
    pub region_of_curve: Vec<usize>,
    /// Everything the head does.
    pub route: Route,
    /// The stream for the controller.
    pub stream: SegmentStream,
    /// What the stream reaches of the limits.
    pub motion: MotionReport,
    /// Coverage raster of each region, local coordinates.
    pub coverage: Vec<Coverage>,
    /// What the plan is judged on, over all regions.
    pub figures: LayerFigures,
}

/// Why a target cannot be planned.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// The outline.
    #[error(transparent)]
    Contour(#[from] ContourError),
    /// The medial axis.
    #[error(transparent)]
    MedialAxis(#[from] MedialAxisError),
    /// The part does not fit on the machine.
    #[error(transparent)]
    Place(#[from] PlaceError),
    /// The motion breaks a limit that slowing cannot mend.
    #[error(transparent)]
    Motion(#[from] MotionError),
    /// The waypoints have no curve that can be planned.
    #[error(transparent)]
    Waypoints(#[from] WaypointCurveError),
    /// No placement of the aperture lies inside.
    #[error(
        "nothing can be printed: the widest place, near ({:.3}, {:.3}) mm, is {width_mm:.3} mm \
         wide and the aperture needs {needed_mm:.3} mm; use a smaller --aperture or a larger --scale",
        at_mm[0], at_mm[1]
    )]
    NothingPrintable {
        /// Centre of the largest disk.
        at_mm: [f64; 2],
        /// Its diameter.
        width_mm: f64,
        /// The aperture's narrowest width.
        needed_mm: f64,
    },
}

/// Plans a target: the whole pipeline, one line for each stage.
pub fn plan_target(target: &Target, settings: &Settings) -> Result<Plan, PlanError> {
    let bounds = target_bounds(target);
    let transform = PartTransform::choose(bounds, settings.layer_height_mm, settings)?;
    let mut regions = Vec::new();
    for region in &target.regions {
        let contour = Contour::of_region(region, SIMPLIFY_MM)?;
        let walls = contour.edge_index(settings.aperture.major_mm());
        let medial_axis = MedialAxis::of_edges(&walls, &AxisOptions::default())?;
        let axis = Axis::of_medial_axis(&medial_axis);
        let passes = passes(&contour.region, &axis, &pass_settings(settings));
        regions.push(RegionPlan {
            contour,
            medial_axis,
            axis,
            passes,
        });
    }
    let start = start_pose(settings);
    let regions = in_order(regions, &transform, start, settings);
    let (curves, region_of_curve) = plane_passes(&regions, &transform, settings);
    if curves.is_empty() {
        return Err(nothing_printable(&regions, settings));
    }
    let route = build_route(&curves, start, settings);
    let (stream, motion) = lay_segments(&route, settings)?;
    let (figures, coverage) = measure_layer(
        &stream,
        &regions_for_measure(&regions),
        &region_of_curve,
        &transform,
        settings,
    );
    Ok(Plan {
        transform,
        regions,
        curves,
        region_of_curve,
        route,
        stream,
        motion,
        coverage,
        figures,
    })
}

/// Plans a run of waypoints: curve, route, segments, figures. Regions, curves and rasters stay
/// empty. The lowest waypoint comes to lie one layer height above the bed.
///
/// # Errors
/// [`PlanError`].
pub fn plan_waypoints(run: &WaypointRun, settings: &Settings) -> Result<Plan, PlanError> {
    let tips = || run.points.iter().map(|point| point.tip_mm);
    let corners: Vec<Point2> = tips().map(|tip| tip.xy()).collect();
    let low_mm = tips().map(|tip| tip.z).fold(f64::INFINITY, f64::min) - settings.layer_height_mm;
    let high_mm = tips().map(|tip| tip.z).fold(f64::NEG_INFINITY, f64::max);
    let bounds = geometry::polygon::Box2::of(&corners);
    let transform = PartTransform::choose_box(bounds, [low_mm, high_mm], settings)?;
    let curves = waypoint_curves(run, transform.offset_mm, settings)?;
    let route = waypoint_route(curves, start_pose(settings), settings);
    let (stream, motion) = lay_segments(&route, settings)?;
    let (mut figures, _) = measure_layer(&stream, &[], &[], &transform, settings);
    figures.passes = 1;
    Ok(Plan {
        transform,
        regions: Vec::new(),
        curves: Vec::new(),
        region_of_curve: Vec::new(),
        route,
        stream,
        motion,
        coverage: Vec::new(),
        figures,
    })
}

fn target_bounds(target: &Target) -> geometry::polygon::Box2 {
    let corners: Vec<Point2> = target
        .regions
        .iter()
        .map(|r| r.bounds())
        .flat_map(|b| [b.min, b.max])
        .collect();
    geometry::polygon::Box2::of(&corners)
}

fn pass_settings(settings: &Settings) -> PassSettings {
    PassSettings {
        aperture: settings.aperture,
        overlap: settings.overlap_pct / 100.0,
        one_pass: settings.pass_mode == PassMode::One,
        law: settings.heading_law,
    }
}

/// Where the head waits before a job: the work area's corner, lifted.
fn start_pose(settings: &Settings) -> [f64; CHANNELS] {
    let [low, _] = settings.work_area_mm;
    let mut pose = [0.0; CHANNELS];
    pose[CHANNEL_X] = low[0];
    pose[CHANNEL_Y] = low[1];
    pose[CHANNEL_Z] = low[2] + settings.layer_height_mm + settings.lift_mm;
    pose
}

/// Regions nearest first, and in each its passes ordered from where the last one ended, with
/// excursions into what they leave open.
fn in_order(
    regions: Vec<RegionPlan>,
    transform: &PartTransform,
    start: [f64; CHANNELS],
    settings: &Settings,
) -> Vec<RegionPlan> {
    let shift = Vector2::new(transform.offset_mm[0], transform.offset_mm[1]);
    let mut position = Point2::new(start[CHANNEL_X], start[CHANNEL_Y]) - shift;
    let centers: Vec<Point2> = regions
        .iter()
        .map(|r| Point2::from(r.contour.offset))
        .collect();
    let mut slots: Vec<Option<RegionPlan>> = regions.into_iter().map(Some).collect();
    let mut result = Vec::with_capacity(slots.len());
    for number in region_order(&centers, position) {
        let Some(mut region) = slots[number].take() else {
            continue;
        };
        region.passes = ordered(
            std::mem::take(&mut region.passes),
            region.contour.to_local(position),
            &settings.aperture,
        );
        let walls = region.contour.edge_index(settings.aperture.major_mm());
        region.passes = linked(region.passes, &settings.aperture, &walls);
        fill_gaps(&mut region.passes, &settings.aperture, &walls);
        if let Some(last) = region.passes.last().and_then(|p| p.placements.last()) {
            position = region.contour.to_input(last.at.center);
        }
        result.push(region);
    }
    result
}

/// The curves of all passes in machine coordinates, and each one's region.
fn plane_passes(
    regions: &[RegionPlan],
    transform: &PartTransform,
    settings: &Settings,
) -> (Vec<PlanePass>, Vec<usize>) {
    let mut curves = Vec::new();
    let mut region_of_curve = Vec::new();
    for (number, region) in regions.iter().enumerate() {
        let walls = region.contour.edge_index(settings.aperture.major_mm());
        let shift =
            region.contour.offset + Vector2::new(transform.offset_mm[0], transform.offset_mm[1]);
        for pass in &region.passes {
            let tolerance_mm = PATH_SHARE * settings.tolerances.outside_mm;
            for control in pass_curves(pass, &settings.aperture, &walls, tolerance_mm) {
                let control = control
                    .iter()
                    .map(|c| [c[0] + shift.x, c[1] + shift.y, c[2]])
                    .collect();
                curves.push(PlanePass {
                    kind: pass.kind,
                    layer: 0,
                    z_mm: transform.offset_mm[2] + settings.layer_height_mm,
                    control,
                });
                region_of_curve.push(number);
            }
        }
    }
    (curves, region_of_curve)
}

/// Share of the outside tolerance that the path may use; the rest is the fit's.
const PATH_SHARE: f64 = 0.4;

fn regions_for_measure(regions: &[RegionPlan]) -> Vec<&Contour> {
    regions.iter().map(|r| &r.contour).collect()
}

fn nothing_printable(regions: &[RegionPlan], settings: &Settings) -> PlanError {
    let mut widest = (0.0, [0.0, 0.0]);
    for region in regions {
        for vertex in &region.medial_axis.vertices {
            if vertex.radius_mm > widest.0 {
                let at = region.contour.to_input(vertex.point);
                widest = (vertex.radius_mm, [at.x, at.y]);
            }
        }
    }
    PlanError::NothingPrintable {
        at_mm: widest.1,
        width_mm: 2.0 * widest.0,
        needed_mm: 2.0 * settings.aperture.minor_mm(),
    }
}
