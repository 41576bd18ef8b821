//! A mesh -> its job: layers cut, planned piece by piece, what each piece showed put together.

use crate::cli::args::PlaceArgs;
use crate::cli::error::CliError;
use crate::cli::plan::pass_facts::PassFacts;
use crate::cli::plan::piece_cache::{CacheFolder, program};
use crate::cli::plan::planned::{Planned, plan_error};
use crate::cli::reading::layer_options::{check_bead_height, layer_heights};
use crate::cli::reading::{copies, load};
use crate::cli::terminal::console::Console;
use crate::cli::terminal::output_file::end_whole_on_interrupt;
use crate::geometry::polygon::Region;
use crate::job::SegmentStream;
use crate::mesh::LoadedMesh;
use crate::mesh::layers::{LayerHeights, SlicedPart, sliced_carved};
use crate::pipeline::PlanError;
use crate::pipeline::findings::left_out::left_out;
use crate::pipeline::findings::objections::Objection;
use crate::pipeline::findings::settings_warnings::settings_warnings;
use crate::pipeline::findings::sparse_figures;
use crate::pipeline::findings::unreachable_note;
use crate::pipeline::findings::use_figures::{short_layers_note, stacked_figures, use_figures};
use crate::pipeline::findings::wide_beads::{Laid, LateLayers};
use crate::pipeline::mesh::{FirstLayer, PLACES_MAX, PartContext, PartPlan, plan_part_in_pieces};
use crate::pipeline::open_ground;
use crate::pipeline::packing::JobPacking;
use crate::pipeline::stack::LeftOut;
use crate::plan::layers::shells::Overhang;
use crate::plan::outline::unreachable::UnreachableRun;
use crate::report::Place;
use crate::report::figures::{Figures, LayerPlace};
use crate::report::job_texts::LayerOutlines;
use crate::settings::Settings;
use std::fs::File;
use std::path::Path;
use std::time::Instant;

/// Places of each kind that are told one by one.
const PLACES_TOLD: usize = 3;

/// Cuts a mesh into layers and plans them.
pub(crate) fn from_mesh(
    path: &Path,
    loaded: LoadedMesh,
    place: &PlaceArgs,
    keep_out: &[Region],
    settings: Settings,
    mut job: Option<&mut JobPacking<File>>,
    console: &Console,
) -> Result<Planned, CliError> {
    let heights = layer_heights(&place.layers, settings.layer_height_mm)?;
    check_bead_height(&heights, &settings)?;
    let first = FirstLayer {
        speed_mm_s: load::first_layer_speed(place, &settings)?,
    };
    let part = cut(path, &loaded, &heights, place, &settings, console)?;
    console.notes(&part.notes);
    let LoadedMesh {
        name, mut notes, ..
    } = loaded;
    console.notes(&part.notes);
    notes.extend(part.notes.iter().cloned());
    let begun = Instant::now();
    let mut cache = CacheFolder::open(place.cache.as_deref())?;
    end_whole_on_interrupt(interrupted(place.cache.as_deref()));
    let mut stream = SegmentStream::default();
    let mut laid = Laid::NOTHING;
    let mut take = |piece: SegmentStream, first_pass| {
        laid = laid.with(&piece, &settings);
        match &mut job {
            Some(job) => {
                let taken = job.take(&piece, first_pass, &settings);
                taken.map_err(|error| error.to_string())
            }
            None => {
                stream.append(piece, first_pass);
                Ok(())
            }
        }
    };
    let planned = planned_pieces(
        &part, keep_out, first, &settings, &mut cache, &mut take, console,
    );
    let plan_s = begun.elapsed().as_secs_f64();
    console.notes(&cache.notes);
    notes.append(&mut cache.notes);
    let planned = planned.map_err(|error| plan_error(path, &error))?;
    let warnings = warnings(&part, &planned, &settings);
    console.notes(&warnings);
    notes.extend(warnings);
    let figures = Figures {
        plan_s: Some(plan_s),
        ..all_figures(&part, &planned, keep_out, &settings)
    };
    let (figures, objections) = with_wide_beads(figures, &laid, &planned, &settings);
    let (outline, layer_outlines) = outlines(&part);
    let mut left_out = not_printed(&planned);
    left_out.extend(laid.place(&planned.transform));
    Ok(Planned {
        figures,
        name,
        outline,
        layer_outlines,
        settings: in_solution(planned.solution, settings),
        transform: planned.transform,
        stream,
        heat: Vec::new(),
        notes,
        objections,
        own_joints: None,
        pass_facts: PassFacts::Kinds(planned.pass_uses),
        plan: None,
        left_out,
        unreachable: planned.unreachable,
    })
}

/// Ground and boundary that is not printed.
fn not_printed(planned: &PartPlan) -> Vec<Place> {
    let (open, unreachable) = (&planned.open, &planned.unreachable);
    left_out(open, unreachable, &planned.unreachable_layers)
}

/// The layers of a mesh, as often as it is to be printed.
fn cut(
    path: &Path,
    loaded: &LoadedMesh,
    heights: &LayerHeights,
    place: &PlaceArgs,
    settings: &Settings,
    console: &Console,
) -> Result<SlicedPart, CliError> {
    let bar = console.stage("cutting");
    let part = sliced_carved(&loaded.mesh, &loaded.carved, heights);
    let failed = |error| CliError::Job(format!("{}: {error}", path.display()));
    let mut part = part.map_err(failed)?;
    let layers = part.layers.iter_mut().map(|layer| &mut layer.regions);
    part.notes.extend(copies::spread(place, layers, settings)?);
    bar.finish_and_clear();
    Ok(part)
}

/// The figures with those of wide beads, and what is not kept of what these ask for.
fn with_wide_beads(
    figures: Figures,
    laid: &Laid,
    planned: &PartPlan,
    settings: &Settings,
) -> (Figures, Vec<Objection>) {
    let late = LateLayers::of(&planned.uses, settings);
    let transform = &planned.transform;
    let wide = laid.figures(&late, planned.figures.volume_mm3, transform, settings);
    let objections = laid.objections(&late, transform, settings);
    (figures.merged_with(&wide), objections)
}

/// The outline of the lowest layer that has one, and those of all layers where they differ.
fn outlines(part: &SlicedPart) -> (Vec<Region>, LayerOutlines) {
    let lowest = part.wanted_layers().iter();
    let lowest = lowest.map(|layer| &layer.regions).find(|r| !r.is_empty());
    let numbered = part.wanted_layers().iter();
    let numbered = numbered.map(|layer| (layer.number, layer.regions.as_slice()));
    (
        lowest.cloned().unwrap_or_default(),
        LayerOutlines::of(numbered),
    )
}

/// The settings with the machine in a joint solution.
fn in_solution(solution: u8, mut settings: Settings) -> Settings {
    let kinematics = &mut settings.machine.kinematics;
    *kinematics = kinematics.with_solution(solution);
    settings
}

/// Plans a part under the bar; `take` takes its stream.
fn planned_pieces(
    part: &SlicedPart,
    keep_out: &[Region],
    first: FirstLayer,
    settings: &Settings,
    cache: &mut CacheFolder,
    take: &mut dyn FnMut(SegmentStream, u32) -> Result<(), String>,
    console: &Console,
) -> Result<PartPlan, PlanError> {
    let bar = console.planning();
    let context = PartContext {
        progress: &bar,
        cache,
        program: &program(),
        take,
    };
    let planned = plan_part_in_pieces(part, keep_out, first, settings, context);
    bar.clear();
    planned
}

/// What is said on Ctrl-C.
fn interrupted(cache: Option<&Path>) -> String {
    match cache {
        Some(folder) => format!(
            "stopped, no job is written; the layers planned so far are in {}: the same command goes on \
             with them",
            folder.display()
        ),
        None => {
            "stopped, no job is written; with --cache DIR the same command would go on where it was"
                .to_string()
        }
    }
}

/// Overhangs of the layers that are printed.
fn overhangs<'a>(
    part: &'a SlicedPart,
    planned: &'a PartPlan,
) -> impl Iterator<Item = (u32, &'a Overhang)> {
    let all = (0u32..).zip(&planned.overhangs);
    all.filter(|(layer, overhang)| part.wanted.contains(layer) && overhang.area_mm2 > 0.0)
}

fn all_figures(
    part: &SlicedPart,
    planned: &PartPlan,
    keep_out: &[Region],
    settings: &Settings,
) -> Figures {
    let place_mm = |layer: u32| {
        let layer = &part.layers[layer as usize];
        [layer.top_mm, layer.height_mm]
    };
    let of_uses = use_figures(&planned.uses, planned.slowed, place_mm, settings);
    part_figures(part, planned, keep_out)
        .merged_with(&of_uses)
        .merged_with(&stacked_figures(&planned.open_cells))
}

fn part_figures(part: &SlicedPart, planned: &PartPlan, keep_out: &[Region]) -> Figures {
    let f = &planned.figures;
    let passes = f.passes as u64;
    let [ground_mm2, swept_mm2] = planned.infill_mm2;
    let sparse = sparse_figures(f, planned.sparse_mm2);
    let top_mm = |layer: u32| part.layers[layer as usize].top_mm;
    let mut hanging: Vec<LayerPlace> = overhangs(part, planned)
        .map(|(layer, overhang)| LayerPlace {
            x_mm: overhang.at.x,
            y_mm: overhang.at.y,
            z_mm: top_mm(layer),
            area_mm2: overhang.area_mm2,
        })
        .collect();
    hanging.sort_by(|a, b| b.area_mm2.total_cmp(&a.area_mm2));
    let hanging_mm2: f64 = hanging.iter().map(|place| place.area_mm2).sum::<f64>() + 0.0;
    hanging.truncate(PLACES_MAX);
    let left_out = planned.left_out.iter().map(|left_out| LayerPlace {
        x_mm: left_out.at.x,
        y_mm: left_out.at.y,
        z_mm: top_mm(left_out.layer),
        area_mm2: left_out.area_mm2,
    });
    let place = |run: &UnreachableRun| {
        let at = nalgebra::center(&run.from, &run.to);
        [at.x, at.y, run.length_mm()]
    };
    let runs = planned.unreachable.iter();
    Figures {
        area_mm2: Some(f.area_mm2),
        layers: Some(part.wanted_layers().len() as u64),
        covered_pct_min: Some(f.covered_pct_min),
        overlap_pct_max: Some(f.overlap_pct_max),
        reachable_pct: Some(f.reachable_pct),
        covered_pct: Some(f.covered_pct),
        covered_of_reachable_pct: Some(f.covered_of_reachable_pct),
        outside_depth_mm: Some(f.outside_depth_mm),
        overlap_pct: Some(f.overlap_pct),
        kept_out_mm2: (!keep_out.is_empty()).then_some(planned.kept_out_mm2),
        infill_mm2: (ground_mm2 > 0.0).then_some(ground_mm2),
        infill_covered_pct: (ground_mm2 > 0.0).then(|| 100.0 * swept_mm2 / ground_mm2),
        unreachable_mm: Some(planned.unreachable_mm),
        unreachable_places_mm: Some(runs.map(place).collect()),
        open_largest_mm2: Some(planned.open.first().map_or(0.0, |open| open.area_mm2)),
        overhang_mm2: Some(hanging_mm2),
        overhang_places: Some(hanging),
        left_out_places: Some(left_out.take(PLACES_MAX).collect()),
        passes: Some(passes),
        flow_interruptions: Some(passes.saturating_sub(1)),
        outline_crossings: Some(planned.outline_crossings),
        print_mm: Some(f.print_mm),
        skirt_mm: planned.has_skirt.then_some(f.skirt_mm),
        travel_mm: Some(f.travel_mm),
        print_s: Some(f.print_s),
        volume_mm3: Some(f.volume_mm3),
        heading_travel_rad: Some(f.heading_travel_rad),
        heading_rate_max_rad_s: Some(f.heading_rate_max_rad_s),
        segments: Some(planned.segments),
        ..sparse
    }
}

/// What the user should look at before printing.
fn warnings(part: &SlicedPart, planned: &PartPlan, settings: &Settings) -> Vec<String> {
    let mut warnings = part_warnings(part, planned);
    let length_mm = planned.unreachable_mm;
    warnings.extend(unreachable_note(&planned.unreachable, length_mm));
    let top_mm = |layer: u32| Some(part.layers.get(layer as usize)?.top_mm);
    let (open, all_mm2) = (&planned.open, planned.open_mm2);
    warnings.extend(open_ground::note(open, all_mm2, top_mm, settings));
    warnings.extend(short_layers_note(planned.slowed, settings));
    warnings.extend(settings_warnings(settings));
    warnings
}

/// What hangs, what is left out, what was slowed.
fn part_warnings(part: &SlicedPart, planned: &PartPlan) -> Vec<String> {
    let mut warnings = Vec::new();
    let top_mm = |layer: u32| part.layers[layer as usize].top_mm;
    let mut hanging: Vec<(u32, &Overhang)> = overhangs(part, planned).collect();
    hanging.sort_by(|a, b| b.1.area_mm2.total_cmp(&a.1.area_mm2));
    if !hanging.is_empty() {
        let all_mm2: f64 = hanging.iter().map(|(_, o)| o.area_mm2).sum();
        let told = hanging.iter().take(PLACES_TOLD).map(|(layer, o)| {
            let z_mm = top_mm(*layer);
            format!(
                "{:.2} mm² near ({:.2}, {:.2}, {z_mm:.2})",
                o.area_mm2, o.at.x, o.at.y
            )
        });
        warnings.push(format!(
            "{all_mm2:.2} mm² on {} layers hang farther than half a bead over what is below, and no \
             supports are made: turn the part (--rotate) or print supports with it; the most: {}",
            hanging.len(),
            told.collect::<Vec<_>>().join(", ")
        ));
    }
    let mut left_out: Vec<&LeftOut> = planned.left_out.iter().collect();
    left_out.sort_by(|a, b| b.area_mm2.total_cmp(&a.area_mm2));
    if !left_out.is_empty() {
        let all_mm2: f64 = left_out.iter().map(|l| l.area_mm2).sum();
        let told = left_out.iter().take(PLACES_TOLD).map(|l| {
            let (at, z_mm) = (l.at, top_mm(l.layer));
            format!(
                "{:.3} mm² near ({:.2}, {:.2}, {z_mm:.2}): {}",
                l.area_mm2, at.x, at.y, l.why
            )
        });
        warnings.push(format!(
            "{} regions, {all_mm2:.3} mm², are not printed; the largest: {}",
            left_out.len(),
            told.collect::<Vec<_>>().join("; ")
        ));
    }
    let doubled = planned.motion.doubled_moves;
    if doubled > 0 {
        warnings.push(format!(
            "{doubled} moves had to be slowed as a whole to keep the limits"
        ));
    }
    warnings
}
