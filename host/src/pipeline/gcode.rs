//! A slicer's path -> its job: the file's centre lines with a turned nozzle, layer by layer.
//!
//! ```text
//! GcodeProgram --gcode_route--> Route --time law, segments--> SegmentStream --measure--> PlanFigures
//! (mm, mm³, mm/s)               (mm, rad, mm³)                (integer units, servo ticks)
//! ```
//! Layers are planned one by one and their streams put together, so that beside the file's path only
//! finished segments grow, and poses where the head might touch what stands. Machines whose joints wind up
//! are planned in one piece, and so are lines that were drawn, whose layers may go on into each other. Leaves out what is
//! the slicer's: which ground is printed, in which order, how densely.

use super::{PlanError, start_pose};
use crate::gcode::comments::Slicer;
use crate::gcode::error::own_export;
use crate::gcode::{GcodePass, GcodeProgram, check_days};
use crate::geometry::Point2;
use crate::geometry::polygon::Box2;
use crate::job::SegmentStream;
use crate::job::heat::{HeatEvent, HeatOrder};
use crate::job::transform::PartTransform;
use crate::pipeline::error::another_solution;
use crate::pipeline::gcode_heat::{LaidPasses, events_behind, events_of};
use crate::pipeline::gcode_touches::{Collector, Descent, descent};
use crate::pipeline::layer_time::lay_with_layer_times;
use crate::pipeline::placed_part::{PlacedPart, placed_part};
use crate::pipeline::stop_room::with_stop_room;
use crate::plan::judge::figures::PlanFigures;
use crate::plan::judge::measure::measure;
use crate::plan::judge::touches::Touches;
use crate::plan::motion::segments::{MotionReport, lay_segments_with_progress};
use crate::plan::progress::Progress;
use crate::plan::route::bead_headings::WidthOff;
use crate::plan::route::build_route::lift_at_end;
use crate::plan::route::gcode_route::{GcodeRoute, GcodeWay, gcode_route};
use crate::plan::route::told_headings::HeadingJumps;
use crate::settings::Settings;
use headway_firmware::kinematics::winds;
use headway_protocol::units::CHANNELS;

/// A planned file.
#[derive(Clone, Debug)]
pub struct GcodePlan {
    /// Where the file's origin lies on the machine.
    pub transform: PartTransform,
    /// The settings with the file's speeds.
    pub settings: Settings,
    /// The stream for the controller.
    pub stream: SegmentStream,
    /// What it reaches of the limits.
    pub motion: MotionReport,
    /// Lengths, times, volume; no shares of any area.
    pub figures: PlanFigures,
    /// Length of beads that are wider, and narrower, than the nozzle lays, mm.
    pub beyond_mm: [f64; 2],
    /// Length of beads that are laid at another width than the file's.
    pub off: WidthOff,
    /// How headings of the file change.
    pub jumps: HeadingJumps,
    /// The file's orders of heaters and fans.
    pub heat: Vec<HeatEvent>,
    /// Numbers of the file's lines that say what the job does not, by servo ticks.
    pub lines: Vec<(u64, usize)>,
    /// Where a bead is lower than one before it.
    pub descent: Option<Descent>,
    /// What the head touches, where that is possible and its shape is known.
    pub touches: Option<Touches>,
    /// For each pass of the stream the number of the file's.
    pub file_passes: Vec<usize>,
}

/// Some passes of a file that are planned together, and where the head is before them.
#[derive(Clone, Copy, Debug)]
pub(super) struct GcodePiece<'a> {
    /// Number of the first of them in the file.
    pub first: usize,
    /// They.
    pub passes: &'a [GcodePass],
    /// Number of the next pass of the job.
    pub first_pass: u32,
    /// Pose at rest before them.
    pub at: [f64; CHANNELS],
    /// The job ends behind them.
    pub is_last: bool,
    /// How the file is read.
    pub way: &'a GcodeWay<'a>,
}

/// The route of a piece, its stream and what that reaches.
pub(super) type LaidPiece = (GcodeRoute, (SegmentStream, MotionReport));

/// Plans a file. Speeds are the file's, at most `speed_max_mm_s`.
///
/// # Errors
/// [`PlanError`]; Headway's own exports are refused, whose motion was planned already.
pub fn plan_gcode(
    program: &GcodeProgram,
    speed_max_mm_s: Option<f64>,
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<GcodePlan, PlanError> {
    let settings = with_speeds(program, speed_max_mm_s, settings);
    plan_pieces(program, &settings, progress, |piece| {
        laid_piece(piece, progress)
    })
}

/// Plans a file with settings that have its speeds, each of its pieces by `lay`.
pub(super) fn plan_pieces(
    program: &GcodeProgram,
    settings: &Settings,
    progress: &dyn Progress,
    mut lay: impl FnMut(&GcodePiece) -> Result<LaidPiece, PlanError>,
) -> Result<GcodePlan, PlanError> {
    if program.is_export() {
        return Err(own_export().into());
    }
    settings.check()?;
    check_time(program, settings)?;
    let placed = place(program, settings)?;
    let (transform, settings) = (placed.transform, &placed.settings);
    let way = &GcodeWay {
        slicer: program.slicer,
        headings_told: program.has_headings,
        offset_mm: transform.offset_mm,
        settings,
    };
    let is_whole = program.is_drawn() || winds(&settings.machine.kinematics) != 0;
    let passes = program.passes.as_slice();
    let pieces = passes.chunk_by(|a, b| is_whole || a.layer == b.layer);
    let count = pieces.clone().count();
    let mut at = start_pose(settings);
    let mut planned = GcodePlan::empty(transform, descent(program, settings), settings);
    let mut collector = Collector::new(planned.descent, settings);
    let mut first = 0;
    for (number, piece) in pieces.enumerate() {
        let (made, (laid, report)) = lay(&GcodePiece {
            first,
            passes: piece,
            first_pass: planned.figures.passes as u32,
            at,
            is_last: number + 1 == count,
            way,
        })?;
        at = made.route.end().unwrap_or(at);
        collector.add(&made.route, settings);
        let laid_passes = LaidPasses {
            first,
            passes: piece,
            numbers: &made.numbers,
            stream: &laid,
            offset_mm: transform.offset_mm,
        };
        let heat = events_of(&program.heat, &laid_passes, planned.end_tick());
        planned.heat.extend(heat.into_iter().map(heat_event));
        let lines = events_of(&program.left, &laid_passes, planned.end_tick());
        planned.lines.extend(lines);
        for (k, numbers) in made.numbers.iter().enumerate() {
            let parts = numbers.map_or(0, |[from, to]| to - from + 1);
            planned.file_passes.extend((0..parts).map(|_| first + k));
        }
        first += piece.len();
        if !laid.knots.is_empty() {
            planned.add(laid, &report, &made, progress)?;
        }
    }
    planned.figures.layers = program.layers();
    let behind = events_behind(&program.heat, passes.len(), planned.end_tick());
    planned.heat.extend(behind.map(heat_event));
    let behind = events_behind(&program.left, passes.len(), planned.end_tick());
    planned.lines.extend(behind);
    planned.touches = collector.touches(settings);
    Ok(planned)
}

fn heat_event((tick, order): (u64, HeatOrder)) -> HeatEvent {
    HeatEvent { tick, order }
}

/// The route of a piece from a pose on, and its motion.
fn laid_piece(piece: &GcodePiece, progress: &dyn Progress) -> Result<LaidPiece, PlanError> {
    let way = piece.way;
    with_stop_room(way.settings, |stop_room_rad| {
        let mut made = gcode_route(piece.passes, piece.first_pass, piece.at, stop_room_rad, way);
        if piece.is_last {
            lift_at_end(&mut made.route, way.settings);
        }
        let laid = match made.route.moves.is_empty() {
            // None of its beads is printed; what it orders of heaters still is.
            true => Default::default(),
            false if way.slicer == Slicer::Drawing => {
                let laid = lay_with_layer_times(&mut made.route, way.settings, progress)?;
                (laid.0, laid.1)
            }
            false => lay_segments_with_progress(&made.route, way.settings, progress)?,
        };
        Ok((made, laid))
    })
}

/// Fails with the line where the job would take months, by its speeds and by what the extruder can lay: the
/// stream grows with its time.
fn check_time(program: &GcodeProgram, settings: &Settings) -> Result<(), PlanError> {
    let flow_mm3_s = settings.flow_max_mm3_s * settings.plan_share;
    let push_mm3_s = settings.machine.arriving_limits()[0] * settings.plan_share;
    let fastest_mm_s = settings.speed_mm_s * settings.plan_share;
    let mut seconds = 0.0;
    for pass in &program.passes {
        let mut line = 0;
        for (pair, leg) in pass.points.windows(2).zip(&pass.legs) {
            let way_s = pair[1].distance_mm(&pair[0]) / leg.speed_mm_s.min(fastest_mm_s);
            let lays_s = leg.volume_mm3.unwrap_or(0.0) / flow_mm3_s;
            seconds += way_s.max(lays_s);
            line = leg.line;
            check_days(seconds, line)?;
        }
        for push in [pass.prime, pass.retract].into_iter().flatten() {
            let rate_mm3_s = push.rate_mm3_s.unwrap_or(push_mm3_s).min(push_mm3_s);
            seconds += push.mm3.unwrap_or(0.0) / rate_mm3_s;
        }
        check_days(seconds, line)?;
    }
    Ok(())
}

impl GcodePlan {
    fn empty(transform: PartTransform, descent: Option<Descent>, settings: &Settings) -> GcodePlan {
        GcodePlan {
            transform,
            settings: settings.clone(),
            stream: SegmentStream::default(),
            motion: MotionReport::default(),
            figures: PlanFigures::default(),
            beyond_mm: [0.0; 2],
            off: WidthOff::default(),
            jumps: HeadingJumps::default(),
            heat: Vec::new(),
            lines: Vec::new(),
            descent,
            touches: None,
            file_passes: Vec::new(),
        }
    }

    /// Puts a piece behind the others.
    fn add(
        &mut self,
        laid: SegmentStream,
        report: &MotionReport,
        made: &GcodeRoute,
        progress: &dyn Progress,
    ) -> Result<(), PlanError> {
        if !self.stream.knots.is_empty() && laid.solution != self.stream.solution {
            return Err(another_solution());
        }
        let (mut of_piece, _) = measure(&laid, &[], &[], &self.transform, &self.settings, progress);
        of_piece.passes = made.passes as usize;
        self.figures.add_lengths(&of_piece);
        add_motion(&mut self.motion, report);
        for (sum, mm) in self.beyond_mm.iter_mut().zip(made.beyond_mm) {
            *sum += mm;
        }
        self.off.add(&made.off);
        self.jumps.add(&made.jumps);
        // Passes are counted over the whole file already.
        self.stream.append(laid, 0);
        Ok(())
    }

    fn end_tick(&self) -> u64 {
        self.stream.marks.last().map_or(0, |mark| mark.end_tick)
    }
}

fn add_motion(sum: &mut MotionReport, report: &MotionReport) {
    sum.ratios = sum.ratios.max(report.ratios);
    sum.fit_error_ratio = sum.fit_error_ratio.max(report.fit_error_ratio);
    sum.doubled_moves += report.doubled_moves;
    sum.duration_s += report.duration_s;
    sum.time_bound_s += report.time_bound_s;
}

/// Fastest that settings may say: a feed beyond it is the machine's to bound.
const SPEED_MAX_MM_S: f64 = 10_000.0;

/// The file's speeds: the plan's share of the limit is the fastest of them.
pub(super) fn with_speeds(
    program: &GcodeProgram,
    speed_max_mm_s: Option<f64>,
    settings: &Settings,
) -> Settings {
    let legs = program.passes.iter().flat_map(|pass| &pass.legs);
    let fastest_mm_s = legs.map(|leg| leg.speed_mm_s).fold(0.0, f64::max);
    let speed_mm_s = fastest_mm_s / settings.plan_share;
    let slowest = |speed: f64| speed_max_mm_s.map_or(speed, |most| speed.min(most));
    Settings {
        speed_mm_s: slowest(speed_mm_s).clamp(0.01, SPEED_MAX_MM_S),
        layers: program.layers(),
        ..settings.clone()
    }
}

/// The file's z = 0 lies on the bed; what is printed lies over the middle of the work area.
pub(super) fn place(program: &GcodeProgram, settings: &Settings) -> Result<PlacedPart, PlanError> {
    let tips = || program.passes.iter().flat_map(|pass| &pass.points);
    let corners: Vec<Point2> = tips()
        .map(|p| Point2::new(p.tip_mm[0], p.tip_mm[1]))
        .collect();
    let heights = || tips().map(|p| p.tip_mm[2]);
    let low_mm = heights().fold(f64::INFINITY, f64::min);
    let top_mm = heights().fold(f64::NEG_INFINITY, f64::max);
    // Paths drawn on z = 0 lie one layer above the bed, as waypoints do.
    let bed_mm = if low_mm > 0.0 {
        0.0
    } else {
        low_mm - settings.layer_height_mm
    };
    let bounds = Box2::of(&corners);
    Ok(placed_part(bounds, [bed_mm, top_mm], settings)?)
}
