//! A sliced file -> one job in which the regions that its beads fill are planned anew, and all else is followed.
//!
//! ```text
//! GcodeProgram --parts of layers--> regions, kept runs --anew, where that pays--> steps --layer by layer--> GcodePlan
//! (mm, mm³)                        (mm)                                          (routes)                  (servo ticks)
//! ```
//! In: a program of a slicer that says what its beads are. Out: [`Replan`]: the program with its passes as they are printed,
//! its plan, and [`Replanned`]. Regions are planned in parallel, alike ones once. Leaves out the text of the file around its
//! beads.

mod anew;
mod kept;
mod loops;
pub mod regions;
#[cfg(test)]
mod tests;

use super::PlanError;
use super::gcode::{GcodePiece, GcodePlan, place, plan_pieces, with_speeds};
use super::layer_time::{SlowedLayers, lay_with_layer_times};
use super::stop_room::with_stop_room;
use crate::gcode::comments::Slicer;
use crate::gcode::error::own_export;
use crate::gcode::{BeadKind, GcodePass, GcodeProgram, HeatPlace, Leg, PlacedOrder};
use crate::job::SegmentStream;
use crate::job::transform::PartTransform;
use crate::plan::judge::figures::Swept;
use crate::plan::motion::segments::MotionReport;
use crate::plan::progress::{Progress, Stage, Steps, Stopped};
use crate::plan::route::build_route::{build_link, lift_at_end};
use crate::plan::route::gcode_route::{GcodeRoute, GcodeWay, gcode_route};
use crate::plan::route::moves::RouteMove;
use crate::plan::route::travel::TravelWays;
use crate::settings::Settings;
use crate::text::refusal::{Refusal, refusal};
use anew::{Anew, anew, is_alike};
use headway_firmware::kinematics::winds;
use headway_protocol::units::{CHANNEL_HEADING, CHANNEL_VOLUME, CHANNEL_X, CHANNEL_Z, CHANNELS};
use kept::{follows, joined_runs};
use rayon::prelude::*;
use regions::{Ground, Parts, Run, is_level, parts, why};
use std::collections::BTreeMap;

/// How many of the last different regions another may be alike.
const ALIKE_MAX: usize = 1000;

/// A file planned anew: its program, the passes those of the job (a region is one pass of all its beads); its plan; what was
/// done with it.
pub type Replan = (GcodeProgram, GcodePlan, Replanned);

/// What was planned anew, and what was not.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Replanned {
    /// What the file lays, mm³.
    pub volume_mm3: f64,
    /// Of that the regions planned anew.
    pub anew_mm3: f64,
    /// What the job lays.
    pub laid_mm3: f64,
    /// What those regions are and cover.
    pub swept: Swept,
    /// What the file's own beads cover of them, mm².
    pub covered_before_mm2: f64,
    /// Length of beads that stay lines, by what they are and why, mm.
    pub kept_mm: BTreeMap<(&'static str, &'static str), f64>,
    /// Layers that were slowed for their least time.
    pub slowed_layers: u32,
}

/// What is printed without an interruption by another.
struct Step {
    /// Its beads; those of a region planned anew in one pass.
    run: Run,
    /// Number of the region's plan, and what its own beads lay.
    anew: Option<(usize, f64)>,
    z_mm: f64,
}

/// Plans a file. Speeds are the file's, at most `speed_max_mm_s`.
///
/// # Errors
/// [`PlanError`]: what is no sliced file whose beads have kinds is refused.
pub fn replan(
    mut program: GcodeProgram,
    speed_max_mm_s: Option<f64>,
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<Replan, PlanError> {
    check(&program)?;
    let mut settings = with_speeds(&program, speed_max_mm_s, settings);
    settings.layer_time_min_s = settings.layer_time_min_s.max(program.layer_time_min_s);
    let settings = &settings;
    let placed = place(&program, settings)?;
    let (transform, settings) = (placed.transform, &placed.settings);
    let mut report = Replanned {
        volume_mm3: program.volume_mm3().unwrap_or_default(),
        ..Replanned::default()
    };
    let layers = layers_of(&program);
    let (plans, plan_of) = plans_of(&layers, &transform, &program, settings, progress)?;
    let steps = steps_of(layers, &plans, &plan_of, &mut report);
    let froms: Vec<usize> = steps.iter().map(|step| step.run.number).collect();
    program.heat = replaced(&program.heat, &steps, &froms);
    program.left = replaced(&program.left, &steps, &froms);
    program.passes = steps.iter().map(|step| step.run.pass.clone()).collect();
    // While layers that are supports alone are printed, the part below cools: they are not slowed, and count for the next.
    let mut cooled_s = 0.0;
    let plan = plan_pieces(&program, settings, progress, |piece| {
        let own = &steps[piece.first..piece.first + piece.passes.len()];
        let is_beside = own.iter().all(Step::is_beside_part);
        let least_s = match is_beside {
            true => 0.0,
            false => (settings.layer_time_min_s - cooled_s).max(0.0),
        };
        let (made, (stream, motion, slowed)) = laid(&steps, &plans, piece, least_s, progress)?;
        cooled_s = match is_beside {
            true => cooled_s + motion.duration_s,
            false => 0.0,
        };
        report.slowed_layers += slowed.layers;
        Ok((made, (stream, motion)))
    })?;
    report.laid_mm3 = plan.figures.volume_mm3;
    Ok((program, plan, report))
}

/// Refuses what does not say what its beads are.
fn check(program: &GcodeProgram) -> Result<(), Refusal> {
    if program.is_export() {
        return Err(own_export());
    }
    let legs = || program.passes.iter().flat_map(|pass| &pass.legs);
    let is_told = legs().any(|leg| leg.kind != BeadKind::Unknown);
    match legs().next() {
        Some(first) if program.slicer == Slicer::Plain || !is_told => Err(refusal!(
            "line {line}: a bead, and no comment before it says of what kind, as those of \
                 PrusaSlicer, SuperSlicer, OrcaSlicer and Cura do: slice with one of them, or \
                 plan the file along its lines (headway plan)",
            line = first.line
        )),
        _ => Ok(()),
    }
}

/// The parts of every layer.
fn layers_of(program: &GcodeProgram) -> Vec<Parts> {
    let pieces = program.passes.chunk_by(|a, b| a.layer == b.layer);
    let numbered: Vec<(usize, &[GcodePass])> = pieces
        .scan(0, |next, piece| {
            *next += piece.len();
            Some((*next - piece.len(), piece))
        })
        .collect();
    let of_layer = |(first, piece): (usize, &[GcodePass])| parts(piece, first, program.slicer);
    numbered.into_par_iter().map(of_layer).collect()
}

type Plans = Vec<Result<Anew, &'static str>>;

/// The plans of the different regions, and the number of each region's, in the order of the layers.
fn plans_of(
    layers: &[Parts],
    transform: &PartTransform,
    program: &GcodeProgram,
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<(Plans, Vec<usize>), Stopped> {
    let mut different: Vec<(&Ground, u32)> = Vec::new();
    let mut plan_of = Vec::new();
    for ground in layers.iter().flat_map(|parts| &parts.grounds) {
        let layer = ground.runs.first().map_or(0, |run| run.pass.layer);
        let before = different.len().saturating_sub(ALIKE_MAX);
        let known = &different[before..];
        let found = { known }
            .iter()
            .rposition(|known| is_alike(*known, (ground, layer)));
        plan_of.push(found.map_or(different.len(), |found| before + found));
        if found.is_none() {
            different.push((ground, layer));
        }
    }
    let way = GcodeWay {
        slicer: program.slicer,
        headings_told: false,
        offset_mm: transform.offset_mm,
        settings,
    };
    let may_divide = winds(&settings.machine.kinematics) == 0;
    let steps = Steps::begin(progress, Stage::Passes, different.len());
    let plans = different.par_iter().map(|(ground, layer)| {
        steps.step(|| match may_divide {
            true => anew(ground, *layer, transform, &way),
            false => Ok(Err("the machine's joints wind up")),
        })?
    });
    Ok((plans.collect::<Result<_, _>>()?, plan_of))
}

/// What is printed, in the file's order; a region planned anew comes where its first bead was.
fn steps_of(
    layers: Vec<Parts>,
    plans: &Plans,
    plan_of: &[usize],
    report: &mut Replanned,
) -> Vec<Step> {
    let mut steps: Vec<Step> = Vec::new();
    let mut plan_of = plan_of.iter();
    for parts in layers {
        parts.kept.iter().for_each(|run| report.keep(run, None));
        let mut of_layer: Vec<Step> = parts.kept.into_iter().map(Step::kept).collect();
        for (ground, number) in parts.grounds.into_iter().zip(&mut plan_of) {
            match &plans[*number] {
                Ok(anew) => {
                    report.plan_anew(&ground, anew);
                    let runs = ground.runs.into_iter();
                    let run = runs.reduce(|mut all, run| {
                        all.append(run);
                        all
                    });
                    of_layer.push(Step {
                        anew: Some((*number, ground.volume_mm3)),
                        z_mm: ground.z_mm,
                        run: run.unwrap_or_default(),
                    });
                }
                Err(why) => {
                    ground
                        .runs
                        .iter()
                        .for_each(|run| report.keep(run, Some(why)));
                    of_layer.extend(ground.runs.into_iter().map(Step::kept));
                }
            }
        }
        // Before the kept beads of its pass.
        of_layer.sort_by_key(|step| (step.run.number, step.anew.is_none(), step.run.legs[0]));
        for step in of_layer {
            match steps.last_mut().filter(|last| last.goes_on(&step)) {
                Some(last) => last.run.append(step.run),
                None => steps.push(step),
            }
        }
    }
    steps
}

impl Step {
    fn kept(run: Run) -> Step {
        Step {
            run,
            anew: None,
            z_mm: 0.0,
        }
    }

    /// It is no part of the part.
    fn is_beside_part(&self) -> bool {
        let is_beside = |leg: &Leg| matches!(leg.kind, BeadKind::Support | BeadKind::Skirt);
        self.anew.is_none() && self.run.pass.legs.iter().all(is_beside)
    }

    /// Another one is the rest of the same pass.
    fn goes_on(&self, next: &Step) -> bool {
        let is_kept = self.anew.is_none() && next.anew.is_none();
        is_kept && self.run.number == next.run.number && self.run.legs[1] == next.run.legs[0]
    }
}

impl Replanned {
    /// Beads that stay lines: by themselves, or for a reason of their region.
    fn keep(&mut self, run: &Run, of_region: Option<&'static str>) {
        let pairs = run.pass.points.windows(2);
        for (pair, leg) in pairs.zip(&run.pass.legs) {
            let is_level = is_level(pair[0].tip_mm[2], pair[1].tip_mm[2]);
            let why = of_region.unwrap_or(why(leg.kind, is_level));
            let kept_mm = self.kept_mm.entry((leg.kind.name(), why)).or_default();
            *kept_mm += pair[1].distance_mm(&pair[0]);
        }
    }

    fn plan_anew(&mut self, ground: &Ground, anew: &Anew) {
        self.anew_mm3 += ground.volume_mm3;
        self.covered_before_mm2 += 0.01 * ground.covered_pct * ground.region.area_mm2();
        self.swept = Swept::sum([&self.swept, &anew.swept]);
    }

    /// Share of the file's volume that is planned anew, per cent.
    pub fn anew_pct(&self) -> f64 {
        100.0 * self.anew_mm3 / self.volume_mm3.max(1e-9)
    }
}

/// Orders at the steps in whose place their passes stand.
fn replaced<T: Copy>(
    orders: &[PlacedOrder<T>],
    steps: &[Step],
    froms: &[usize],
) -> Vec<PlacedOrder<T>> {
    let at = |pass: usize| froms.partition_point(|from| *from < pass);
    // Within a pass that is printed otherwise there is no such point.
    let place = |place: HeatPlace| match (place, place.of_pass(at)) {
        (HeatPlace::Point(pass, _), HeatPlace::Point(step, point)) => {
            let is_same = steps.get(step).is_some_and(|step| {
                step.anew.is_none() && step.run.number == pass && step.run.is_whole == [true; 2]
            });
            match is_same {
                true => HeatPlace::Point(step, point),
                false => HeatPlace::Start(step),
            }
        }
        (_, place) => place,
    };
    let orders = orders.iter().map(|order| PlacedOrder {
        place: place(order.place),
        ..*order
    });
    orders.collect()
}

/// A layer's stream, what it reaches, and whether it was slowed.
type LaidLayer = (SegmentStream, MotionReport, SlowedLayers);

/// The route of a layer and its motion, slowed where it is shorter than so many seconds.
fn laid(
    steps: &[Step],
    plans: &Plans,
    piece: &GcodePiece,
    layer_time_min_s: f64,
    progress: &dyn Progress,
) -> Result<(GcodeRoute, LaidLayer), PlanError> {
    let settings = &Settings {
        layer_time_min_s,
        ..piece.way.settings.clone()
    };
    with_stop_room(settings, |stop_room_rad| {
        let mut layer = LayerRoute {
            piece,
            at: piece.at,
            made: GcodeRoute::default(),
        };
        let mut first = piece.first;
        let own = &steps[first..first + piece.passes.len()];
        for of_kind in own.chunk_by(|a, b| a.anew.is_none() && b.anew.is_none()) {
            let end = first + of_kind.len();
            match of_kind[0]
                .anew
                .and_then(|(number, _)| plans[number].as_ref().ok())
            {
                Some(anew) => layer.plan_anew(&of_kind[0], anew)?,
                None => {
                    let is_next = [first, end].map(|k| is_next(steps, k));
                    layer.follow(of_kind, is_next, stop_room_rad);
                }
            }
            first = end;
        }
        let mut made = layer.made;
        if piece.is_last {
            lift_at_end(&mut made.route, settings);
        }
        let laid = match made.route.moves.is_empty() {
            true => LaidLayer::default(),
            false => lay_with_layer_times(&mut made.route, settings, progress)?,
        };
        Ok((made, laid))
    })
}

/// True where a step is the file's next pass behind that of the step before it, and nothing is between them but the way.
fn is_next(steps: &[Step], number: usize) -> bool {
    let pair = number
        .checked_sub(1)
        .and_then(|before| steps.get(before..=number));
    pair.is_some_and(|pair| {
        pair.iter().all(|of| of.anew.is_none()) && follows(&pair[0].run, &pair[1].run)
    })
}

/// The route of a layer so far.
struct LayerRoute<'a> {
    piece: &'a GcodePiece<'a>,
    at: [f64; CHANNELS],
    made: GcodeRoute,
}

impl LayerRoute<'_> {
    fn next_pass(&self) -> u32 {
        self.piece.first_pass + self.made.passes
    }

    fn push(&mut self, moves: Vec<RouteMove>) {
        self.made.route.moves.extend(moves);
        self.at = self.made.route.end().unwrap_or(self.at);
    }

    /// Along the file's lines; before and behind them may come lines that are next to them in the file.
    fn follow(&mut self, steps: &[Step], is_next: [bool; 2], stop_room_rad: f64) {
        let way = self.piece.way;
        let runs: Vec<Run> = steps.iter().map(|step| step.run.clone()).collect();
        let from = std::array::from_fn(|i| self.at[CHANNEL_X + i] - way.offset_mm[i]);
        let passes = joined_runs(&runs, Some(from), is_next, way.settings);
        let made = gcode_route(&passes, self.next_pass(), self.at, stop_room_rad, way);
        self.made.passes += made.passes;
        self.made.numbers.extend(made.numbers);
        self.made.off.add(&made.off);
        self.made.jumps.add(&made.jumps);
        for (sum, mm) in self.made.beyond_mm.iter_mut().zip(made.beyond_mm) {
            *sum += mm;
        }
        self.push(made.route.moves);
    }

    /// The way to a region that is planned anew, and its route from there: at its height, with the volume of its own beads.
    fn plan_anew(&mut self, step: &Step, anew: &Anew) -> Result<(), PlanError> {
        let settings = self.piece.way.settings;
        let layer = step.run.pass.layer;
        let up_mm = step.z_mm - anew.z_mm;
        let Some(mut to) = anew.route.moves.first().map(|of| of.curve.control[0]) else {
            return Ok(());
        };
        let planned_rad = to[CHANNEL_HEADING];
        to[CHANNEL_Z] += up_mm;
        let mut ways = TravelWays::new(&[], &[], settings)?;
        let link = build_link(self.at, to, layer, &mut ways, settings)?;
        self.push(link.moves);
        let flow = settings.flow_factor * step.anew.map_or(1.0, |(_, mm3)| mm3 / anew.volume_mm3);
        let (turned_rad, laid_mm3) = (
            self.at[CHANNEL_HEADING] - planned_rad,
            self.at[CHANNEL_VOLUME],
        );
        let first_pass = self.next_pass();
        let moves = anew.route.moves.iter().cloned().map(|mut of_move| {
            of_move.layer = layer;
            of_move.pass = of_move.pass.map(|pass| pass + first_pass);
            for point in &mut of_move.curve.control {
                point[CHANNEL_Z] += up_mm;
                point[CHANNEL_HEADING] += turned_rad;
                point[CHANNEL_VOLUME] = laid_mm3 + flow * point[CHANNEL_VOLUME];
            }
            of_move
        });
        self.push(moves.collect());
        self.made
            .numbers
            .push(Some([first_pass, first_pass + anew.passes - 1]));
        self.made.passes += anew.passes;
        Ok(())
    }
}
