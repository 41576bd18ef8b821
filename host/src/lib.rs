//! Headway's host side: plans the motion of turned nozzles, simulates it, streams it.
//!
//! ```text
//! Target --contour--> Contour --hull--> Region --medial axis--> MedialAxis --prune--> Axis
//!  (mm)               (mm, local)       (mm, local)             (mm)                  (mm)
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

use crate::geometry::edge_index::EdgeIndex;
use crate::geometry::polygon::Region;
use crate::geometry::{Point2, Vector2};
use crate::input::Target;
use crate::input::waypoints::WaypointRun;
use crate::job::SegmentStream;
use crate::part_transform::{PartTransform, PlaceError};
use crate::plan::build_route::{PlanePass, build_route};
use crate::plan::contour::{Contour, ContourError, SIMPLIFY_MM};
use crate::plan::infill::swept_area_mm2;
use crate::plan::joint_limits::MotionError;
use crate::plan::keep_out::{cleared, taken};
use crate::plan::layer_path::pass_curves;
use crate::plan::measure::{LayerFigures, OFF_REGIONS, RegionRaster, measure_layer};
use crate::plan::medial_axis::MedialAxisError;
use crate::plan::order::region_order;
use crate::plan::passes::LayerPass;
use crate::plan::progress::{Progress, Stage, Steps, step_each};
use crate::plan::region_plan::{RegionPlan, RegionWork};
use crate::plan::route::Route;
use crate::plan::segments::{MotionReport, lay_segments_telling};
use crate::plan::skirt::{SkirtPlan, skirt_plan, skirt_reach_mm};
use crate::plan::travel_ways::{TravelError, TravelWays, outline_crossings};
use crate::plan::waypoint_curve::{WaypointCurveError, waypoint_curves};
use crate::plan::waypoint_route::waypoint_route;
use crate::settings::{Settings, SettingsError};
use headway_protocol::units::{CHANNEL_X, CHANNEL_Y, CHANNEL_Z, CHANNELS};

/// A planned target, with all intermediates.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Where the part lies on the machine.
    pub transform: PartTransform,
    /// What neither aperture nor nozzle body enters, input coordinates.
    pub keep_out: Vec<Region>,
    /// Ground of the target given up to that.
    pub kept_out_mm2: f64,
    /// What is printed around the regions before them.
    pub skirt: Option<SkirtPlan>,
    /// The regions, in printing order.
    pub regions: Vec<RegionPlan>,
    /// The curves that are printed, machine coordinates, in order.
    pub curves: Vec<PlanePass>,
    /// For each curve the number of its region, or [`plan::measure::OFF_REGIONS`].
    pub region_of_curve: Vec<usize>,
    /// Everything the head does.
    pub route: Route,
    /// Travels between passes that leave the regions on their way.
    pub outline_crossings: usize,
    /// The stream for the controller.
    pub stream: SegmentStream,
    /// What the stream reaches of the limits.
    pub motion: MotionReport,
    /// Coverage raster of each region.
    pub coverage: Vec<RegionRaster>,
    /// What the plan is judged on, over all regions.
    pub figures: LayerFigures,
}

impl Plan {
    /// The ground that infill lines are to cover, and what of it was swept, mm²; `None` where
    /// there is none.
    pub fn infill_area_mm2(&self) -> Option<[f64; 2]> {
        let parts = self.regions.iter().zip(&self.coverage);
        let [ground, swept] = parts.fold([0.0; 2], |sum, (region, raster)| {
            let area = swept_area_mm2(raster, &region.open);
            [sum[0] + area[0], sum[1] + area[1]]
        });
        (ground > 0.0).then_some([ground, swept])
    }
}

/// Why a target cannot be planned.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// The settings.
    #[error(transparent)]
    Settings(#[from] SettingsError),
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
    /// Travel around the keep-outs.
    #[error(transparent)]
    Travel(#[from] TravelError),
    /// Nothing of the target is left.
    #[error("the keep-outs, grown for the nozzle's body, leave no ground to print on: move them")]
    AllKeptOut,
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

/// Plans a target with nothing in the way; see [`plan_target_around`].
///
/// # Errors
/// [`PlanError`].
pub fn plan_target(target: &Target, settings: &Settings) -> Result<Plan, PlanError> {
    plan_target_around(target, &[], settings, &())
}

/// Plans a target around keep-outs (input coordinates): the whole pipeline, one line for each stage.
/// `progress` is told how far it is (`()` tells nobody).
///
/// # Errors
/// [`PlanError`].
pub fn plan_target_around(
    target: &Target,
    keep_out: &[Region],
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<Plan, PlanError> {
    settings.check()?;
    let bounds = target_bounds(target).grown(skirt_reach_mm(settings));
    let transform = PartTransform::choose(bounds, settings.layer_height_mm, settings)?;
    let cleared = cleared(&target.regions, keep_out, settings);
    if cleared.regions.is_empty() {
        return Err(PlanError::AllKeptOut);
    }
    let outlines: Vec<&Region> = cleared.regions.iter().collect();
    let contours = step_each(progress, Stage::Contour, outlines, |region| {
        Contour::of_region(region, SIMPLIFY_MM)
    })?;
    let axes = step_each(progress, Stage::Axis, contours, |contour| {
        RegionWork::begin(contour, settings)
    })?;
    let regions = step_each(progress, Stage::Passes, axes, |region| {
        Ok::<_, PlanError>(region.with_passes())
    })?;
    let widest = regions.iter().filter_map(RegionWork::widest_disk);
    let widest = widest.max_by(|a, b| a.1.total_cmp(&b.1));
    if regions.iter().all(RegionWork::is_empty) {
        return Err(nothing_printable(widest, settings));
    }
    let start = start_pose(settings);
    let shift = Vector2::new(transform.offset_mm[0], transform.offset_mm[1]);
    let from = Point2::new(start[CHANNEL_X], start[CHANNEL_Y]) - shift;
    let skirt = skirt_plan(&target.regions, &taken(keep_out, settings), from, settings)?;
    let from = skirt.as_ref().and_then(SkirtPlan::end).unwrap_or(from);
    let regions = in_order(regions, from, progress);
    let (curves, region_of_curve) = plane_passes(skirt.as_ref(), &regions, &transform, settings);
    if curves.is_empty() {
        return Err(nothing_printable(widest, settings));
    }
    let on_machine = |regions: &[Region]| -> Vec<Region> {
        regions.iter().map(|region| region.shifted(shift)).collect()
    };
    let ground = on_machine(&cleared.regions);
    let mut ways = TravelWays::new(&on_machine(keep_out), &ground, settings)?;
    let route = build_route(&curves, start, &mut ways, settings).map_err(|e| e.shifted(-shift))?;
    let (stream, motion) = lay_segments_telling(&route, settings, progress)?;
    let contours = regions_for_measure(&regions);
    let (figures, coverage) = measure_layer(
        &stream,
        &contours,
        &region_of_curve,
        &transform,
        settings,
        progress,
    );
    Ok(Plan {
        transform,
        keep_out: keep_out.to_vec(),
        kept_out_mm2: cleared.lost_mm2,
        skirt,
        regions,
        curves,
        region_of_curve,
        outline_crossings: outline_crossings(&route, &ground),
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
    plan_waypoints_telling(run, settings, &())
}

/// The same, telling how far it is: segments and figures.
///
/// # Errors
/// [`PlanError`].
pub fn plan_waypoints_telling(
    run: &WaypointRun,
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<Plan, PlanError> {
    settings.check()?;
    let tips = || run.points.iter().map(|point| point.tip_mm);
    let corners: Vec<Point2> = tips().map(|tip| tip.xy()).collect();
    let low_mm = tips().map(|tip| tip.z).fold(f64::INFINITY, f64::min) - settings.layer_height_mm;
    let high_mm = tips().map(|tip| tip.z).fold(f64::NEG_INFINITY, f64::max);
    let bounds = geometry::polygon::Box2::of(&corners);
    let transform = PartTransform::choose_box(bounds, [low_mm, high_mm], settings)?;
    let curves = waypoint_curves(run, transform.offset_mm, settings)?;
    let route = waypoint_route(curves, start_pose(settings), settings);
    let (stream, motion) = lay_segments_telling(&route, settings, progress)?;
    let (mut figures, _) = measure_layer(&stream, &[], &[], &transform, settings, progress);
    figures.passes = 1;
    Ok(Plan {
        transform,
        keep_out: Vec::new(),
        kept_out_mm2: 0.0,
        skirt: None,
        outline_crossings: 0,
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
/// excursions into what they leave open; `from` is where the head is, input coordinates.
fn in_order(regions: Vec<RegionWork>, from: Point2, progress: &dyn Progress) -> Vec<RegionPlan> {
    let steps = Steps::begin(progress, Stage::Order, regions.len());
    let mut position = from;
    let centers: Vec<Point2> = regions.iter().map(RegionWork::middle).collect();
    let mut slots: Vec<Option<RegionWork>> = regions.into_iter().map(Some).collect();
    let mut result = Vec::with_capacity(slots.len());
    for number in region_order(&centers, position) {
        let Some(region) = slots[number].take() else {
            continue;
        };
        let region = region.in_order(position);
        if let Some(last) = region.passes.last().and_then(|p| p.placements.last()) {
            position = region.contour.to_input(last.at.center);
        }
        result.push(region);
        steps.step();
    }
    result
}

/// The curves of all passes in machine coordinates, and each one's region.
fn plane_passes(
    skirt: Option<&SkirtPlan>,
    regions: &[RegionPlan],
    transform: &PartTransform,
    settings: &Settings,
) -> (Vec<PlanePass>, Vec<usize>) {
    let (mut curves, mut region_of_curve) = (Vec::new(), Vec::new());
    let mut add = |passes: &[LayerPass], walls: &EdgeIndex, offset: Vector2, number: usize| {
        let shift = offset + Vector2::new(transform.offset_mm[0], transform.offset_mm[1]);
        let tolerance_mm = PATH_SHARE * settings.tolerances.outside_mm;
        for pass in passes {
            for control in pass_curves(pass, &settings.aperture, walls, tolerance_mm) {
                let control = control.iter();
                curves.push(PlanePass {
                    kind: pass.kind,
                    layer: 0,
                    z_mm: transform.offset_mm[2] + settings.layer_height_mm,
                    control: control
                        .map(|c| [c[0] + shift.x, c[1] + shift.y, c[2]])
                        .collect(),
                });
                region_of_curve.push(number);
            }
        }
    };
    if let Some(skirt) = skirt {
        add(&skirt.passes, &skirt.walls, skirt.offset, OFF_REGIONS);
    }
    for (number, region) in regions.iter().enumerate() {
        let walls = EdgeIndex::of_region(&region.hull, settings.aperture.major_mm());
        add(&region.passes, &walls, region.contour.offset, number);
    }
    (curves, region_of_curve)
}

/// Share of the outside tolerance that the path may use; the rest is the fit's.
const PATH_SHARE: f64 = 0.4;

fn regions_for_measure(regions: &[RegionPlan]) -> Vec<&Contour> {
    regions.iter().map(|r| &r.contour).collect()
}

fn nothing_printable(widest: Option<(Point2, f64)>, settings: &Settings) -> PlanError {
    let (at, radius_mm) = widest.unwrap_or((Point2::origin(), 0.0));
    PlanError::NothingPrintable {
        at_mm: [at.x, at.y],
        width_mm: 2.0 * radius_mm,
        needed_mm: 2.0 * settings.aperture.minor_mm(),
    }
}
