//! A job, whether planned just now or read from a file: what `plan` and `simulate` work on.

use super::args::{InputArgs, PlaceArgs, SettingsArgs};
use super::console::Console;
use super::job::{self, Job};
use super::planned_job::PlannedJob;
use super::run_notes::run_notes;
use super::use_figures::{short_layers_note, stacked_figures, use_figures};
use super::warnings::settings_warnings;
use super::{CliError, load, load_run, planned_gcode, planned_part};
use crate::drive::time_by_limit::{SlowPlace, TimeByLimit};
use crate::geometry::Point2;
use crate::geometry::polygon::Region;
use crate::input::waypoints::WaypointRun;
use crate::input::{Input, Loaded, Target};
use crate::job::SegmentStream;
use crate::layer_uses::layer_uses;
use crate::open_ground::{self, OpenGround, open_ground};
use crate::part_piece::unreachable_boundary;
use crate::part_transform::PartTransform;
use crate::plan::layers::layer_groups::LayerGroup;
use crate::plan::outline::unreachable::UnreachableRun;
use crate::report::Place;
use crate::report::figures::{Figures, Inside, KindFigures, SlowPlaceFigures};
use crate::settings::Settings;
use crate::stacked_ground::open_cells;
use crate::surface_plan::plan_on_surface;
use crate::{Plan, plan_target_around, plan_waypoints_with_progress};
use std::path::Path;
use std::time::Instant;

/// Places of unreachable boundary that are told one by one.
const PLACES_TOLD: usize = 3;
/// Places of either kind that the report's page lists.
const PLACES_SHOWN: usize = 20;
/// Places of unreachable boundary that the figures list.
const PLACES_LISTED: usize = 1000;

/// A job and what belongs to it.
pub(super) struct Planned {
    pub name: String,
    pub outline: Vec<Region>,
    pub settings: Settings,
    pub transform: PartTransform,
    pub stream: SegmentStream,
    pub figures: Figures,
    /// Notes of reading and planning.
    pub notes: Vec<String>,
    /// The planner's intermediates; `None` for a job from a file.
    pub plan: Option<Box<Plan>>,
    /// Boundary that cannot be touched, input coordinates.
    pub unreachable: Vec<UnreachableRun>,
    /// Ground and boundary that is not printed, the largest of each first; empty for a job from a
    /// file.
    pub left_out: Vec<Place>,
}

/// An input that is planned in one piece.
enum Flat {
    Outline(Loaded),
    Path(WaypointRun),
}

impl Flat {
    /// Its name, its regions where it has any, and the notes of reading.
    fn named(self) -> (Target, Vec<String>) {
        match self {
            Flat::Outline(loaded) => (loaded.target, loaded.notes),
            Flat::Path(run) => {
                let regions = Vec::new();
                let name = run.name;
                (Target { name, regions }, run.notes)
            }
        }
    }
}

/// Reads an input and plans it. The stream of a mesh goes to `job` where there is one, piece by piece,
/// and is then none of the result.
pub(super) fn from_input(
    path: &Path,
    reading: &InputArgs,
    place: &PlaceArgs,
    settings_args: &SettingsArgs,
    job: Option<&mut PlannedJob>,
    console: &Console,
) -> Result<Planned, CliError> {
    let mut settings = placed_settings(place, settings_args)?;
    let turn_rad = load_run::turn_rad(place.turn)?;
    let flatten_mm = settings.tolerances.flatten_mm;
    let input = load::input(path, reading, flatten_mm, console)?;
    check_options(&input, place, settings_args)?;
    let surface = load_run::surface(place.surface.as_deref(), reading)?;
    let keep_out = load::keep_out(place.keep_out.as_deref(), reading, flatten_mm, console)?;
    let input = match input {
        Input::Mesh(loaded) => {
            return planned_part::from_mesh(path, loaded, place, &keep_out, settings, job, console);
        }
        Input::Gcode(program) => {
            let speed = settings_args.speed;
            return planned_gcode::from_gcode(path, program, speed, settings, console);
        }
        Input::Outline(loaded) => Flat::Outline(loaded),
        Input::Path(run) => {
            let run = load_run::with_more(run, reading, place, flatten_mm, console)?;
            Flat::Path(run.turned(turn_rad))
        }
    };
    let (bar, begun) = (console.planning(), Instant::now());
    let planned = match (&input, &surface) {
        (Flat::Outline(Loaded { target, .. }), Some(mesh)) => {
            plan_on_surface(target, mesh, &keep_out, &settings, &bar)
        }
        (Flat::Outline(Loaded { target, .. }), None) => {
            plan_target_around(target, &keep_out, &settings, &bar)
        }
        (Flat::Path(run), _) => plan_waypoints_with_progress(run, &settings, &bar),
    };
    let plan_s = begun.elapsed().as_secs_f64();
    bar.clear();
    let plan = planned.map_err(|error| CliError::Job(format!("{}: {error}", path.display())))?;
    let unreachable = match &plan.on_surface {
        Some(laid) => laid.unreachable.clone(),
        None => unreachable_boundary(plan.regions()),
    };
    settings.machine = plan.stream.machine(&settings.machine);
    let (Target { name, regions }, mut notes) = input.named();
    let mut warnings = warnings(&plan, &unreachable, &settings);
    let open = open_ground(&plan);
    warnings.extend(open_ground::note(&open, &settings));
    warnings.extend(settings_warnings(&settings));
    console.notes(&warnings);
    notes.extend(warnings);
    Ok(Planned {
        figures: Figures {
            open_largest_mm2: largest_mm2(&plan, &open),
            ..all_figures(&plan, &unreachable, plan_s, &settings)
        },
        name,
        outline: regions,
        settings,
        transform: plan.transform,
        stream: plan.stream.clone(),
        notes,
        plan: Some(Box::new(plan)),
        left_out: left_out(&open, &unreachable),
        unreachable,
    })
}

/// The settings with the options of where the input lies.
fn placed_settings(place: &PlaceArgs, settings: &SettingsArgs) -> Result<Settings, CliError> {
    Ok(Settings {
        gap_mm: load_run::gap_mm(place.gap)?,
        place: load_run::place(place.place),
        axis_tolerance_rad: load_run::axis_tolerance_rad(place.axis_tolerance)?,
        at_mm: place.at.as_deref().map(load::parse_at).transpose()?,
        ..load::settings(settings)?
    })
}

/// Options that go with another kind of input.
fn check_options(
    input: &Input,
    place: &PlaceArgs,
    settings: &SettingsArgs,
) -> Result<(), CliError> {
    let of_outlines = load::outline_option(settings, place.keep_out.as_deref());
    let problem = match (input, of_outlines, load::mesh_option(place)) {
        (Input::Mesh(_), ..) if settings.layers.is_some() => {
            "--layers goes with outlines: a mesh has its own; --layer-range takes some of them"
                .to_string()
        }
        (Input::Mesh(_) | Input::Path(_) | Input::Gcode(_), ..) if place.surface.is_some() => {
            "--surface goes with outlines: only they are laid on a surface".to_string()
        }
        (Input::Path(_) | Input::Gcode(_), Some(option), _) => {
            format!("{option} goes with outlines: a path is followed as it is")
        }
        (Input::Outline(_) | Input::Mesh(_) | Input::Gcode(_), ..)
            if load::run_option(place).is_some() =>
        {
            let option = load::run_option(place).unwrap_or_default();
            format!("{option} goes with runs of waypoints: outlines have no tool axes")
        }
        (Input::Outline(_) | Input::Path(_) | Input::Gcode(_), _, Some(option)) => {
            format!("{option} goes with meshes: an outline has the same layers all the way")
        }
        _ => return Ok(()),
    };
    Err(CliError::Usage(problem))
}

/// Reads a job file. A machine that is given must be the job's.
pub(super) fn from_job(path: &Path, settings: &SettingsArgs) -> Result<Planned, CliError> {
    let job = job::read(path)?;
    if settings.machine.is_some() {
        let given = load::settings(settings)?;
        let header = &job.file.header;
        if given.machine != header.machine {
            return Err(CliError::Job(format!(
                "{}: planned for machine {}, which is not the same as {}: plan again for it",
                path.display(),
                header.machine_name,
                given.machine_name
            )));
        }
    }
    Ok(of_job(job))
}

/// What a job file knows.
pub(super) fn of_job(job: Job) -> Planned {
    let header = &job.file.header;
    let mut settings = job.settings.unwrap_or_default();
    settings.machine.clone_from(&header.machine);
    settings.machine_name.clone_from(&header.machine_name);
    Planned {
        figures: serde_json::from_str(&header.figures_json).unwrap_or_default(),
        name: job.name,
        outline: job.outline,
        settings,
        transform: job.transform,
        stream: job.stream,
        notes: Vec::new(),
        plan: None,
        unreachable: Vec::new(),
        left_out: Vec::new(),
    }
}

/// The largest piece of ground that stays open; a path has none.
fn largest_mm2(plan: &Plan, open: &[OpenGround]) -> Option<f64> {
    let largest = open.first().map_or(0.0, |piece| piece.area_mm2);
    (!plan.prints.is_empty()).then_some(largest)
}

/// Open ground and unreachable boundary as places for the eye.
pub(super) fn left_out(open: &[OpenGround], unreachable: &[UnreachableRun]) -> Vec<Place> {
    let open = open.iter().map(|piece| Place {
        what: format!("{:.3} mm² of open ground", piece.area_mm2),
        x_mm: piece.at.x,
        y_mm: piece.at.y,
    });
    let mut longest: Vec<&UnreachableRun> = unreachable.iter().collect();
    longest.sort_by(|a, b| b.length_mm().total_cmp(&a.length_mm()));
    let runs = longest.into_iter().map(|run| {
        let at = nalgebra::center(&run.from, &run.to);
        Place {
            what: format!("{:.3} mm of boundary out of reach", run.length_mm()),
            x_mm: at.x,
            y_mm: at.y,
        }
    });
    told_once(open).chain(told_once(runs)).collect()
}

/// The first places, each once with how often it comes: layers that are alike lack the same.
fn told_once(places: impl Iterator<Item = Place>) -> impl Iterator<Item = Place> {
    let mut told: Vec<(Place, usize)> = Vec::new();
    for place in places {
        let known = told.iter().position(|(other, _)| *other == place);
        match known {
            Some(number) => told[number].1 += 1,
            None if told.len() < PLACES_SHOWN => told.push((place, 1)),
            None => {}
        }
    }
    told.into_iter().map(|(place, times)| match times {
        1 => place,
        times => Place {
            what: format!("{}, on {times} layers", place.what),
            ..place
        },
    })
}

fn all_figures(
    plan: &Plan,
    unreachable: &[UnreachableRun],
    plan_s: f64,
    settings: &Settings,
) -> Figures {
    let uses = layer_uses(plan, f64::from(settings.machine.servo_hz));
    let top_mm = |layer: u32| settings.layer_height_mm * f64::from(layer + 1);
    let cells = open_cells(plan, settings.aperture.minor_mm());
    plan_figures(plan, unreachable, plan_s)
        .merged_with(&use_figures(&uses, plan.slowed, top_mm, settings))
        .merged_with(&stacked_figures(&cells))
}

fn plan_figures(plan: &Plan, unreachable: &[UnreachableRun], plan_s: f64) -> Figures {
    let f = &plan.figures;
    let passes = f.passes as u64;
    // A path has no area: these figures would mean nothing.
    let has_area = !plan.regions().is_empty();
    let of_area = |figure: f64| has_area.then_some(figure);
    let infill = plan.infill_area_mm2(None);
    let place = |run: &UnreachableRun| {
        let at: Point2 = nalgebra::center(&run.from, &run.to);
        [at.x, at.y, run.length_mm()]
    };
    let is_stack = f.layers > 1;
    Figures {
        area_mm2: of_area(f.area_mm2),
        layers: is_stack.then_some(u64::from(f.layers)),
        layer_kinds: is_stack.then(|| kind_figures(plan)),
        covered_pct_min: is_stack.then_some(f.covered_pct_min),
        overlap_pct_max: is_stack.then_some(f.overlap_pct_max),
        reachable_pct: of_area(f.reachable_pct),
        covered_pct: of_area(f.covered_pct),
        covered_of_reachable_pct: of_area(f.covered_of_reachable_pct),
        outside_depth_mm: of_area(f.outside_depth_mm),
        overlap_pct: of_area(f.overlap_pct),
        kept_out_mm2: (!plan.keep_out.is_empty()).then_some(plan.kept_out_mm2),
        infill_mm2: infill.map(|[ground, _]| ground),
        infill_covered_pct: infill.map(|[ground, swept]| 100.0 * swept / ground.max(1e-12)),
        // The sum of nothing is -0.
        unreachable_mm: of_area(
            unreachable
                .iter()
                .map(UnreachableRun::length_mm)
                .sum::<f64>()
                + 0.0,
        ),
        unreachable_places_mm: has_area
            .then(|| unreachable.iter().take(PLACES_LISTED).map(place).collect()),
        passes: Some(passes),
        flow_interruptions: Some(passes.saturating_sub(1)),
        outline_crossings: has_area.then_some(plan.outline_crossings as u64),
        touched_mm: plan.touches.as_ref().map(|touches| touches.touched_mm),
        print_mm: Some(f.print_mm),
        skirt_mm: plan.skirt.is_some().then_some(f.skirt_mm),
        travel_mm: Some(f.travel_mm),
        print_s: Some(f.print_s),
        time_bound_s: Some(plan.motion.time_bound_s),
        volume_mm3: Some(f.volume_mm3),
        plan_s: Some(plan_s),
        heading_travel_rad: Some(f.heading_travel_rad),
        heading_rate_max_rad_s: Some(f.heading_rate_max_rad_s),
        segments: Some(plan.stream.knots.len() as u64),
        ..Figures::default()
    }
}

/// What came to lie inside the walls, which is not always what was asked for.
fn laid_inside(kind: &LayerGroup) -> Inside {
    let is_solid = kind.infill.is_some_and(|infill| infill.is_solid());
    let open = kind.regions.iter().filter(|region| !region.open.is_empty());
    let (mut lines, mut loops) = (false, false);
    for region in open {
        let has_lines = region.passes.iter().any(|p| p.kind.is_line());
        lines |= has_lines;
        loops |= is_solid && !has_lines;
    }
    match (lines, loops) {
        (true, false) => Inside::Lines,
        (false, true) => Inside::Loops,
        (true, true) => Inside::LinesAndLoops,
        (false, false) => Inside::Nothing,
    }
}

/// What the layers of each kind came to.
fn kind_figures(plan: &Plan) -> Vec<KindFigures> {
    let kinds = plan.kinds.iter().enumerate();
    kinds
        .map(|(number, kind)| {
            let swept = plan.swept_of_kind(number);
            let infill = plan.infill_area_mm2(Some(number));
            KindFigures {
                first_layer: kind.first_layer,
                layers: kind.layers,
                infill_density_pct: kind.infill.map(|infill| infill.density_pct),
                infill_angle_deg: kind.infill.map(|infill| infill.angle_rad.to_degrees()),
                inside: kind.infill.map(|_| laid_inside(kind)),
                infill_covered_pct: infill.map(|[ground, swept]| 100.0 * swept / ground.max(1e-12)),
                covered_pct: swept.covered_pct(),
                overlap_pct: swept.overlap_pct(),
                outside_depth_mm: swept.outside_depth_mm,
            }
        })
        .collect()
}

/// What the user should look at before printing.
fn warnings(plan: &Plan, unreachable: &[UnreachableRun], settings: &Settings) -> Vec<String> {
    let mut warnings = Vec::new();
    let length_mm: f64 = unreachable.iter().map(UnreachableRun::length_mm).sum();
    if length_mm > 0.0 {
        let mut longest: Vec<&UnreachableRun> = unreachable.iter().collect();
        longest.sort_by(|a, b| b.length_mm().total_cmp(&a.length_mm()));
        let places: Vec<String> = longest
            .iter()
            .take(PLACES_TOLD)
            .map(|run| {
                let at = nalgebra::center(&run.from, &run.to);
                format!("{:.3} mm near ({:.3}, {:.3})", run.length_mm(), at.x, at.y)
            })
            .collect();
        warnings.push(format!(
            "{length_mm:.3} mm of the boundary cannot be reached by this aperture, in {} places; \
             the longest: {}",
            unreachable.len(),
            places.join(", ")
        ));
    }
    if plan.motion.doubled_stretches > 0 {
        warnings.push(format!(
            "{} stretches had to be slowed as a whole to keep the limits",
            plan.motion.doubled_stretches
        ));
    }
    warnings.extend(short_layers_note(plan.slowed, settings));
    warnings.extend(run_notes(plan, settings));
    warnings
}

/// Which limits take the printing time, and where it is slowest.
pub(super) fn time_figures(found: TimeByLimit, planned: &Planned) -> Figures {
    let place = |place: SlowPlace| {
        let [x_mm, y_mm, _] = planned.transform.to_input(place.at_mm);
        SlowPlaceFigures {
            x_mm,
            y_mm,
            seconds: place.seconds,
            limit: place.limit,
        }
    };
    Figures {
        time_share_by_limit: (!found.shares.is_empty()).then_some(found.shares),
        slow_places: Some(found.slow_places.into_iter().map(place).collect()),
        ..Figures::default()
    }
}
