//! Headway's host side: plans the motion of turned nozzles, simulates it, streams it.
//!
//! ```text
//! Target --contour--> Contour --hull--> Region --medial axis--> MedialAxis --prune--> Axis
//!  (mm)               (mm, local)       (mm, local)             (mm)                  (mm)
//!    --passes--> LayerPass --order--> LayerGroup --layers--> PlanePass
//!                (mm, rad)            (mm, rad)            (mm, rad, machine coordinates)
//!    --route--> Route --time law, segments--> SegmentStream --measure--> Figures
//!               (mm, rad, mm³)                (integer units, servo ticks)
//! WaypointRun --curve--> PathCurve --route--> Route, and on as above
//! Mesh --flattened--> chart; Target in it --as above--> Route --on surface--> Route (mm, rad, tool axis), and on as above
//! GcodeProgram --route--> Route, layer by layer ([`gcode_plan`])
//! ```
//!
//! [`layer_stack`] is that pipeline, [`plan_target`] runs it for a prism, [`part_plan`] for a part with
//! changing layers a few layers at a time, [`surface_plan`] for one that lies on a surface, [`plan_waypoints`]
//! its short form; every intermediate stays in
//! [`Plan`], for pictures and tests.
//! `drive` moves the finished stream, `report` draws and tabulates, `cli` is the command.
//!
//! **Library users build on [`api`]**: semantic versioning covers that module and nothing else here.
#![forbid(unsafe_code)]

pub mod api;
pub mod bed_mesh;
pub mod calibration;
pub mod cli;
pub mod drive;
pub mod findings;
mod frame_writer;
pub mod gcode;
mod gcode_heat;
pub mod gcode_plan;
pub mod gcode_touches;
pub mod input;
pub mod job;
pub mod job_file;
pub mod job_heat;
mod job_motors;
pub mod job_packing;
pub mod job_resume;
pub mod job_spool;
mod job_units;
pub mod joint_export;
pub mod layer_stack;
pub mod layer_time;
pub mod layer_uses;
pub mod mesh;
mod near_name;
pub mod open_ground;
pub mod part_piece;
pub mod part_plan;
pub mod part_transform;
pub mod plan;
pub mod report;
pub mod settings;
mod short_number;
pub mod stacked_ground;
pub mod surface_plan;
pub mod wire_frames;

pub use headway_geometry as geometry;
pub use headway_reach as reach;

use crate::geometry::Point2;
use crate::geometry::polygon::Region;
use crate::input::Target;
use crate::input::waypoints::WaypointRun;
use crate::job::SegmentStream;
use crate::layer_stack::{LeftOut, Stack, plan_stack};
use crate::layer_time::SlowedLayers;
use crate::part_transform::{PartTransform, PlaceError};
use crate::plan::axis::medial_axis::MedialAxisError;
use crate::plan::judge::figures::{PlanFigures, Swept};
use crate::plan::judge::measure::{Measured, measure};
use crate::plan::judge::region_raster::swept_area_mm2;
use crate::plan::judge::touches::{Touches, touches};
use crate::plan::layers::PlanePass;
use crate::plan::layers::layer_groups::{self, LayerGroup, RegionPrint, TooLongError};
use crate::plan::layers::region_plan::RegionPlan;
use crate::plan::layers::skirt::{SkirtPlan, skirt_reach_mm};
use crate::plan::motion::best_place::{FoundPlace, NoPlaceError, best_place, moved};
use crate::plan::motion::joint_limits::MotionError;
use crate::plan::motion::lift_off::Cuts;
use crate::plan::motion::segments::{MotionReport, lay_segments_with_progress};
use crate::plan::motion::singular::{Passes, SingularPlaces, passed_places};
use crate::plan::outline::contour::ContourError;
use crate::plan::progress::Progress;
use crate::plan::route::keep_out::cleared;
use crate::plan::route::keep_out::shadows::with_shadows;
use crate::plan::route::lean::{self, LeanError, Leaned};
use crate::plan::route::moves::Route;
use crate::plan::route::travel::TravelError;
use crate::plan::route::waypoint_curve::rounding::RoundedCorners;
use crate::plan::route::waypoint_curve::{WaypointCurveError, WaypointPasses, waypoint_passes};
use crate::plan::route::waypoint_route::waypoint_route;
use crate::settings::{Place, Settings, SettingsError};
use crate::surface_plan::curved_layers::{CurvedFigures, CurvedLayersError};
use crate::surface_plan::{OnSurface, SurfaceError};
use headway_protocol::units::{CHANNEL_X, CHANNEL_Y, CHANNEL_Z, CHANNELS};

/// A planned target, with all intermediates.
#[derive(Clone, Debug, Default)]
pub struct Plan {
    /// Where the part lies on the machine.
    pub transform: PartTransform,
    /// What neither aperture nor nozzle body enters, input coordinates.
    pub keep_out: Vec<Region>,
    /// Ground of the target given up to that.
    pub kept_out_mm2: f64,
    /// Regions of a part that are not printed.
    pub left_out: Vec<LeftOut>,
    /// What is printed around the regions before them, on the first layer.
    pub skirt: Option<SkirtPlan>,
    /// The kinds of layer, in the order of their first ones.
    pub kinds: Vec<LayerGroup>,
    /// Every printing of a region, in order.
    pub prints: Vec<RegionPrint>,
    /// The curves that are printed, machine coordinates, in order.
    pub curves: Vec<PlanePass>,
    /// For each curve the number of its printing, or [`plan::layers::layer_groups::OFF_REGIONS`].
    pub print_of_curve: Vec<usize>,
    /// The place that was found for a run of waypoints, where one was looked for.
    pub found_place: Option<FoundPlace>,
    /// How the tool axis of a run of waypoints leans to keep clear, where it does.
    pub leaned: Option<Leaned>,
    /// Where two rotary axes line up on a run of waypoints, and how that is passed.
    pub singular: SingularPlaces,
    /// What became of the corners of a run of waypoints.
    pub rounded: RoundedCorners,
    /// Touches of the head with table and print on a run of waypoints, where its shape is known.
    pub touches: Option<Touches>,
    /// The surface that it lies on, where there is one.
    pub on_surface: Option<OnSurface>,
    /// What became of its curved layers, where it has some.
    pub curved_layers: Option<CurvedFigures>,
    /// Layers that were slowed to last long enough.
    pub slowed: SlowedLayers,
    /// Everything the head does.
    pub route: Route,
    /// Travels between passes that leave the regions on their way.
    pub outline_crossings: usize,
    /// The stream for the controller.
    pub stream: SegmentStream,
    /// What the stream reaches of the limits.
    pub motion: MotionReport,
    /// What was swept of each printing, and coverage rasters.
    pub measured: Measured,
    /// What the plan is judged on, over all regions and layers.
    pub figures: PlanFigures,
}

impl Plan {
    /// The regions of the first layer's kind; none for a run of waypoints.
    pub fn regions(&self) -> &[RegionPlan] {
        self.kinds.first().map_or(&[], |kind| &kind.regions)
    }

    /// The region that a printing prints.
    pub fn region_of(&self, print: &RegionPrint) -> &RegionPlan {
        &self.kinds[print.kind].regions[print.region]
    }

    /// What was swept on all layers of a kind.
    pub fn swept_of_kind(&self, kind: usize) -> Swept {
        let prints = self.prints.iter().zip(&self.measured.swept);
        Swept::sum(
            prints
                .filter(|(print, _)| print.kind == kind)
                .map(|(_, swept)| swept),
        )
    }

    /// The ground that infill lines are to cover, and what of it was swept, mm², over the layers of
    /// one kind or all; `None` where there is none.
    pub fn infill_area_mm2(&self, kind: Option<usize>) -> Option<[f64; 2]> {
        self.ground_area_mm2(kind, |region| &region.open)
    }

    /// The same of the ground that is open on purpose between the lines of a sparse infill.
    pub fn sparse_area_mm2(&self, kind: Option<usize>) -> Option<[f64; 2]> {
        self.ground_area_mm2(kind, |region| &region.sparse)
    }

    /// Some ground of the regions, and what of it was swept.
    fn ground_area_mm2(
        &self,
        kind: Option<usize>,
        ground: impl Fn(&RegionPlan) -> &[Region],
    ) -> Option<[f64; 2]> {
        let rasters = self.prints.iter().zip(&self.measured.rasters);
        let areas: Vec<[f64; 2]> = rasters
            .map(|(print, raster)| {
                let open = ground(self.region_of(print));
                let is_asked = kind.is_none_or(|kind| print.kind == kind);
                let raster = raster.as_ref().filter(|_| is_asked);
                raster.map_or([0.0; 2], |raster| swept_area_mm2(raster, open))
            })
            .collect();
        let prints = self.prints.iter();
        let prints = prints.filter(|print| kind.is_none_or(|kind| print.kind == kind));
        let [ground, swept] = prints.fold([0.0; 2], |sum, print| {
            let area = areas[print.like];
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
    /// A line of G-code that no machine could run in its lifetime.
    #[error(transparent)]
    Gcode(#[from] gcode::GcodeError),
    /// The part does not fit on the machine.
    #[error(transparent)]
    Place(#[from] PlaceError),
    /// No place on the table from which the whole run is reached.
    #[error(transparent)]
    NoPlace(#[from] NoPlaceError),
    /// The motion breaks a limit that slowing cannot mend.
    #[error(transparent)]
    Motion(#[from] MotionError),
    /// The waypoints have no curve that can be planned.
    #[error(transparent)]
    Waypoints(#[from] WaypointCurveError),
    /// The tool axis cannot lean as it would have to.
    #[error(transparent)]
    Lean(#[from] LeanError),
    /// The plan does not go onto its surface.
    #[error(transparent)]
    Surface(#[from] SurfaceError),
    /// The part is not printed in curved layers.
    #[error(transparent)]
    CurvedLayers(#[from] CurvedLayersError),
    /// Travel around the keep-outs.
    #[error(transparent)]
    Travel(#[from] TravelError),
    /// More path than a job has.
    #[error(transparent)]
    TooLong(#[from] TooLongError),
    /// Nothing of the target is left.
    #[error("the keep-outs, grown for the nozzle's body, leave no ground to print on: move them")]
    AllKeptOut,
    /// Nothing of a part is left.
    #[error(
        "nothing can be printed: in none of its {left_out} regions does the aperture fit with room \
         to move; use a smaller --aperture or a larger --scale"
    )]
    NoLayerPrintable {
        /// Regions that were left out.
        left_out: usize,
    },
    /// Layers of several heights or speeds, where the route cannot be divided between them.
    #[error(
        "this machine's joints wind up and are planned over all layers at once: leave out \
         --layer-heights, --first-layer-height and --first-layer-speed"
    )]
    FirstLayerWinds,
    /// Pieces of a part that want different solutions.
    #[error(
        "the joints cannot stay in one solution over all layers: print them in parts (--layer-range)"
    )]
    AnotherSolution,
    /// What was planned cannot be handed on.
    #[error("{0}")]
    Output(String),
    /// No placement of the aperture lies inside, or it has no room to move.
    #[error(
        "nothing can be printed: the widest place, near ({:.3}, {:.3}) mm, is {width_mm:.3} mm \
         wide; nowhere does the aperture of {length_mm:.3} x {needed_mm:.3} mm fit with room to \
         move; use a smaller --aperture or a larger --scale",
        at_mm[0], at_mm[1]
    )]
    NothingPrintable {
        /// Centre of the largest disk.
        at_mm: [f64; 2],
        /// Its diameter.
        width_mm: f64,
        /// The aperture's narrowest width.
        needed_mm: f64,
        /// Its widest one.
        length_mm: f64,
    },
}

/// Plans a target with nothing in the way; see [`plan_target_around`].
///
/// # Errors
/// [`PlanError`].
pub fn plan_target(target: &Target, settings: &Settings) -> Result<Plan, PlanError> {
    plan_target_around(target, &[], settings, &())
}

/// Plans a target around keep-outs (input coordinates): the whole pipeline, one line for each
/// stage. `progress` is told how far it is (`()` tells nobody).
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
    let height_mm = settings.layer_height_mm * f64::from(settings.layers);
    let transform = PartTransform::choose(bounds, height_mm, settings)?;
    let keep_out = &with_shadows(keep_out, &transform, settings);
    let cleared = cleared(&target.regions, keep_out, settings);
    if cleared.regions.is_empty() {
        return Err(PlanError::AllKeptOut);
    }
    let (kinds, layers) = layer_groups::prism_layers(settings);
    let stack = Stack {
        outlines: vec![cleared.regions],
        kinds,
        layers,
        keep_out,
        kept_out_mm2: cleared.lost_mm2,
        skirt_around: Some(&target.regions),
        scale: None,
        transform,
        start: start_pose(settings),
        is_last: true,
        may_leave_out: false,
    };
    plan_stack(stack, settings, progress)
}

/// Plans a run of waypoints: curve, route, segments, figures. Regions, curves and rasters stay
/// empty. The lowest waypoint comes to lie one layer height above the bed.
///
/// # Errors
/// [`PlanError`].
pub fn plan_waypoints(run: &WaypointRun, settings: &Settings) -> Result<Plan, PlanError> {
    plan_waypoints_with_progress(run, settings, &())
}

/// The same, with progress: segments and figures.
///
/// # Errors
/// [`PlanError`].
pub fn plan_waypoints_with_progress(
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
    let leaned = settings
        .tilt_max_rad
        .map(|tilt_max_rad| lean::leaned(run, transform.offset_mm, tilt_max_rad, settings));
    let leaned = leaned.transpose()?.flatten();
    let run = leaned.as_ref().map_or(run, |leaned| &leaned.run);
    let asked = waypoint_passes(run, transform.offset_mm, settings)?;
    let WaypointPasses {
        passes,
        speeds_mm_s,
        asked,
        rounded,
    } = asked;
    let start = start_pose(settings);
    let PlacedPasses {
        passes,
        cuts,
        transform,
        found_place,
        singular,
    } = placed_passes(passes, transform, bounds, &rounded.left_of(settings), true)?;
    let pass_count = passes.len();
    let (speeds_mm_s, asked) = match &cuts {
        Some(cuts) => (cuts.speeds(&speeds_mm_s), cuts.of_passes(&asked)),
        None => (speeds_mm_s, asked),
    };
    // Passes that were cut are counted anew.
    let mut route = waypoint_route(passes, &asked, start, settings);
    let moves = route.moves.iter_mut();
    let printed = moves.filter(|route_move| route_move.pass.is_some());
    for (route_move, speeds_mm_s) in printed.zip(speeds_mm_s) {
        route_move.speeds_mm_s = speeds_mm_s;
    }
    let (stream, motion) = lay_segments_with_progress(&route, settings, progress)?;
    let (mut figures, measured) = measure(&stream, &[], &[], &transform, settings, progress);
    figures.passes = pass_count;
    // Passes that were cut are counted anew.
    let normals = leaned.as_ref().filter(|_| cuts.is_none());
    let touches = touches(&route, normals.map(|leaned| &leaned.normals), settings);
    Ok(Plan {
        transform,
        found_place,
        leaned,
        singular,
        rounded,
        touches,
        route,
        stream,
        motion,
        measured,
        figures,
        ..Plan::default()
    })
}

/// Passes where they lie on the machine, led past what is singular there.
pub(crate) struct PlacedPasses {
    pub passes: Passes,
    /// Where they were cut.
    pub cuts: Option<Cuts>,
    pub transform: PartTransform,
    pub found_place: Option<FoundPlace>,
    pub singular: SingularPlaces,
}

/// Looks for the best place, where that is asked for, and leads the tool axis past singular places, or
/// cuts passes there where they `may_lift`.
pub(crate) fn placed_passes(
    mut passes: Passes,
    mut transform: PartTransform,
    bounds: geometry::polygon::Box2,
    settings: &Settings,
    may_lift: bool,
) -> Result<PlacedPasses, PlanError> {
    let start = start_pose(settings);
    let mut found_place = None;
    if settings.place == Place::Best && settings.at_mm.is_none() {
        let room_mm = transform.room_mm(bounds, settings);
        let found = best_place(&passes, room_mm, start, settings, may_lift)?;
        passes = moved(&passes, found.shift_mm, 0.0);
        transform.offset_mm[0] += found.shift_mm[0];
        transform.offset_mm[1] += found.shift_mm[1];
        found_place = Some(found);
    }
    let led = passed_places(&passes, start, settings, may_lift)?;
    Ok(PlacedPasses {
        passes: led.passes,
        cuts: led.cuts,
        transform,
        found_place,
        singular: led.singular,
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

fn nothing_printable(widest: Option<(Point2, f64)>, settings: &Settings) -> PlanError {
    let (at, radius_mm) = widest.unwrap_or((Point2::origin(), 0.0));
    PlanError::NothingPrintable {
        at_mm: [at.x, at.y],
        width_mm: 2.0 * radius_mm,
        needed_mm: 2.0 * settings.aperture.minor_mm(),
        length_mm: 2.0 * settings.aperture.major_mm(),
    }
}
