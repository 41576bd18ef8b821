//! A mesh -> its job: cuts layers, plans them block by block, and combines the blocks' figures.

use crate::cli::args::PlaceArgs;
use crate::cli::error::CliError;
use crate::cli::plan::piece_cache::{CacheFolder, program};
use crate::cli::plan::planned::plan_error;
use crate::cli::reading::layer_options::{check_bead_height, layer_heights};
use crate::cli::reading::{copies, load};
use crate::cli::terminal::console::Console;
use crate::cli::terminal::output_file::end_whole_on_interrupt;
use crate::geometry::polygon::Region;
use crate::job::SegmentStream;
use crate::mesh::LoadedMesh;
use crate::mesh::layers::{LayerHeights, SlicedPart, sliced_carved};
use crate::pipeline::PlanError;
use crate::pipeline::mesh::{FirstLayer, PartContext, PartPlan, plan_part_in_pieces};
use crate::pipeline::packing::JobPacking;
use crate::pipeline::piece::PieceCache;
use crate::pipeline::planned::{LaidPart, Planned};
use crate::settings::Settings;
use std::fs::File;
use std::path::Path;
use std::time::Instant;

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
    let (part, first) = sliced(path, &loaded, place, &settings, console)?;
    let LoadedMesh {
        name, mut notes, ..
    } = loaded;
    notes.extend(part.notes.iter().cloned());
    let begun = Instant::now();
    let mut cache = CacheFolder::open(place.cache.as_deref())?;
    end_whole_on_interrupt(interrupted(place.cache.as_deref()));
    let mut laid = LaidPart::default();
    let mut take = |piece: SegmentStream, first_pass| {
        laid.look_at(&piece, &settings);
        match &mut job {
            Some(job) => {
                let taken = job.take(&piece, first_pass, &settings);
                taken.map_err(|error| error.to_string())
            }
            None => {
                laid.stream.append(piece, first_pass);
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
    let read = notes.len();
    let planned = Planned::of_part(
        (name, notes),
        &part,
        planned,
        laid,
        keep_out,
        plan_s,
        settings,
    );
    console.notes(&planned.notes[read..]);
    Ok(planned)
}

/// The layers of a mesh, and how the first one differs.
pub(crate) fn sliced(
    path: &Path,
    loaded: &LoadedMesh,
    place: &PlaceArgs,
    settings: &Settings,
    console: &Console,
) -> Result<(SlicedPart, FirstLayer), CliError> {
    let heights = layer_heights(&place.layers, settings.layer_height_mm)?;
    check_bead_height(&heights, settings)?;
    let first = FirstLayer {
        speed_mm_s: load::first_layer_speed(place, settings)?,
    };
    let part = cut(path, loaded, &heights, place, settings, console)?;
    console.notes(&part.notes);
    Ok((part, first))
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
    let told = copies::spread(place, layers, settings)?;
    part.notes.extend(told);
    bar.finish_and_clear();
    Ok(part)
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
    let program = match cache.keeps() {
        true => program(),
        false => String::new(),
    };
    let bar = console.planning();
    let context = PartContext {
        progress: &bar,
        cache,
        program: &program,
        take,
    };
    let planned = plan_part_in_pieces(part, keep_out, first, settings, context);
    bar.clear();
    planned
}

/// The message on Ctrl-C.
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
