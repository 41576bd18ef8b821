//! A part made ready, and planned: one way for library users and for the command, for parts of every kind.
//!
//! ```text
//! Part + Options + Settings --checked, cut, copied--> Ready --the pipeline of its kind--> Planned (figures, notes)
//!                                                       |                       '--> its stream, block by block
//!                                                       '--a share of its blocks--> the store of a cache
//! ```
//! Leaves out files, the terminal and the clock of a user who waits; packing is `pipeline/packing.rs`.

use super::blocks::KeptBlocks;
use super::part::{What, part_error};
use super::{Error, Options, Part};
use crate::gcode::{GcodeProgram, MOVES_MAX};
use crate::geometry::Vector2;
use crate::geometry::polygon::Region;
use crate::input::centre_lines::CentreLines;
use crate::input::copies::{self, box_of};
use crate::input::declared_run::at_feeds;
use crate::input::space_outline::SpaceOutline;
use crate::input::waypoints::WaypointRun;
use crate::input::{Input, Target};
use crate::job::SegmentStream;
use crate::mesh::layers::{LayerHeights, SlicedPart, sliced_carved};
use crate::mesh::{LoadedMesh, Mesh};
use crate::pipeline::centre_lines::{along_lines, slab_note};
use crate::pipeline::findings::idle_options::idle_options;
use crate::pipeline::gcode::plan_gcode;
use crate::pipeline::mesh::{FirstLayer, PartContext, plan_part_in_pieces};
use crate::pipeline::packing::JobPacking;
use crate::pipeline::pieces::plan_pieces;
use crate::pipeline::planned::{LaidPart, Planned};
use crate::pipeline::shards::{PlannedShard, Shard, plan_shard};
use crate::pipeline::surface::curved_layers::plan_curved_layers;
use crate::pipeline::surface::{plan_on_patch, plan_on_surface};
use crate::pipeline::{PlanError, plan_target_around, plan_waypoints_with_progress};
use crate::plan::progress::Progress;
use crate::settings::Settings;
use crate::settings::curved_layers::CurvedLayers;
use crate::settings::directions::Directions;
use crate::settings::options::OF_OUTLINES;
use crate::text::short_number::Short;
use std::io::{Read, Seek, Write};
use std::time::Instant;

/// A part whose options are checked, cut and copied as they ask.
pub(crate) struct Ready {
    name: String,
    /// Notes of reading and cutting.
    pub(crate) notes: Vec<String>,
    work: Work,
    keep_out: Vec<Region>,
    /// What it is planned with.
    pub(crate) settings: Settings,
    first: FirstLayer,
    options: Options,
}

/// What is planned, each by a pipeline of its own.
enum Work {
    Outline(Vec<Region>, Option<Mesh>),
    Layers(SlicedPart),
    Curved(Mesh, CurvedLayers),
    Pieces(LoadedMesh, Directions),
    Path(WaypointRun),
    Gcode(Box<GcodeProgram>),
    Patch(Mesh, Option<SpaceOutline>),
}

impl Ready {
    /// A part with the options over these settings; `is_cached` if its blocks are kept.
    ///
    /// # Errors
    /// [`Error::Options`] for options of other kinds of parts; [`Error::Part`] where it cannot be cut or copied.
    pub(crate) fn of(
        part: Part,
        options: &Options,
        mut settings: Settings,
        is_cached: bool,
    ) -> Result<Ready, Error> {
        check_options(&part, options, is_cached)?;
        settings.at_mm = part.at_mm.first().copied().or(settings.at_mm);
        let (name, mut notes) = (part.name().to_string(), part.notes().to_vec());
        let at_mm = &part.at_mm;
        let work = match part.what {
            What::Patch { mesh, drawn, .. } => Work::Patch(mesh, drawn),
            What::Input(Input::Gcode(program)) => Work::Gcode(Box::new(program)),
            What::Input(Input::Lines(lines)) => {
                let program = with_beads(lines, options, &settings)?;
                notes.clone_from(&program.notes);
                Work::Gcode(Box::new(program))
            }
            What::Input(Input::Path(run)) => {
                let mut run = run.turned(options.turn_deg.unwrap_or(0.0).to_radians());
                settings = at_feeds(&mut run, options.speed_mm_s, &settings);
                Work::Path(run)
            }
            What::Input(Input::Outline(loaded)) => {
                let mut regions = loaded.target.regions;
                notes.extend(slab_note(&regions, &settings).filter(|_| loaded.may_be_lines));
                notes.extend(copied(&mut [&mut regions], at_mm, options, &settings)?);
                Work::Outline(regions, part.surface)
            }
            What::Input(Input::Mesh(loaded)) => {
                match (options.curved_layers, &options.directions) {
                    (Some(asked), _) => Work::Curved(loaded.mesh, asked),
                    (_, Some(directions)) => Work::Pieces(loaded, directions.clone()),
                    (None, None) => {
                        let range = options.layer_range;
                        let own_mm = settings.first_layer_height_mm;
                        let first_mm = options.first_layer_height_mm.or(own_mm);
                        let heights = LayerHeights::of(
                            settings.layer_height_mm,
                            first_mm,
                            part.height_ranges,
                            range,
                        );
                        let heights = heights.map_err(|error| Error::Options(error.to_string()))?;
                        let mut layers = cut(&loaded, &heights, &settings)?;
                        let own = layers.layers.iter_mut().map(|layer| &mut layer.regions);
                        let told = copied(&mut own.collect::<Vec<_>>(), at_mm, options, &settings)?;
                        notes.extend(layers.notes.iter().cloned().chain(told));
                        Work::Layers(layers)
                    }
                }
            }
        };
        Ok(Ready {
            name,
            notes,
            work,
            keep_out: part.keep_out,
            settings,
            first: FirstLayer {
                speed_mm_s: options.first_layer_speed_mm_s,
            },
            options: options.clone(),
        })
    }

    /// It is planned in blocks of layers.
    #[cfg(feature = "command")]
    pub(crate) fn has_blocks(&self) -> bool {
        matches!(self.work, Work::Layers(_))
    }

    /// Its plan, with notes on the options that change nothing. The stream of blocks goes to `packing` if there is one, and is
    /// then not part of the result.
    ///
    /// # Errors
    /// [`PlanError`].
    pub(crate) fn planned<F: Read + Write + Seek>(
        self,
        blocks: &mut KeptBlocks,
        packing: Option<&mut JobPacking<F>>,
        progress: &dyn Progress,
    ) -> Result<Planned, PlanError> {
        let options = self.options.clone();
        let mut planned = self.laid(blocks, packing, progress)?;
        planned.notes.extend(idle_options(&options, &planned));
        Ok(planned)
    }

    fn laid<F: Read + Write + Seek>(
        self,
        blocks: &mut KeptBlocks,
        mut packing: Option<&mut JobPacking<F>>,
        progress: &dyn Progress,
    ) -> Result<Planned, PlanError> {
        let begun = Instant::now();
        let plan_s = || begun.elapsed().as_secs_f64();
        let (keep_out, settings, mut notes) = (&self.keep_out, self.settings, self.notes);
        let mut target = Target {
            name: self.name,
            regions: Vec::new(),
        };
        let plan = match self.work {
            Work::Layers(layers) => {
                let mut laid = LaidPart::default();
                let mut take = |piece: SegmentStream, first_pass| {
                    laid.look_at(&piece, &settings);
                    let Some(packing) = &mut packing else {
                        laid.stream.append(piece, first_pass);
                        return Ok(());
                    };
                    let taken = packing.take(&piece, first_pass, &settings);
                    taken.map_err(|error| error.to_string())
                };
                let context = PartContext {
                    progress,
                    program: blocks.program,
                    cache: blocks,
                    take: &mut take,
                };
                let planned =
                    plan_part_in_pieces(&layers, keep_out, self.first, &settings, context)?;
                notes.append(&mut blocks.notes);
                let named = (target.name, notes);
                return Ok(Planned::of_part(
                    named,
                    &layers,
                    planned,
                    laid,
                    keep_out,
                    plan_s(),
                    settings,
                ));
            }
            Work::Gcode(program) => {
                let planned = plan_gcode(&program, self.options.speed_mm_s, &settings, progress)?;
                return Ok(Planned::of_gcode(*program, planned, plan_s(), &settings));
            }
            Work::Outline(regions, surface) => {
                target.regions = regions;
                match surface {
                    Some(mesh) => plan_on_surface(&target, &mesh, keep_out, &settings, progress),
                    None => plan_target_around(&target, keep_out, &settings, progress),
                }
            }
            Work::Curved(mesh, asked) => plan_curved_layers(&mesh, asked, &settings, progress),
            Work::Pieces(mesh, directions) => plan_pieces(&mesh, &directions, &settings, progress),
            Work::Path(run) => plan_waypoints_with_progress(&run, &settings, progress),
            Work::Patch(mesh, drawn) => plan_on_patch(drawn.as_ref(), &mesh, &settings, progress),
        }?;
        Ok(Planned::of_plan(plan, plan_s(), target, notes, settings))
    }

    /// Plans a share of its blocks into the store; a part without blocks has none.
    ///
    /// # Errors
    /// [`PlanError`].
    pub(crate) fn shard(
        &self,
        shard: Shard,
        blocks: &mut KeptBlocks,
        progress: &dyn Progress,
    ) -> Result<PlannedShard, PlanError> {
        let Work::Layers(layers) = &self.work else {
            return Ok(PlannedShard::default());
        };
        let (keep_out, settings, program) = (&self.keep_out, &self.settings, blocks.program);
        let cache = (blocks as _, program);
        plan_shard(
            layers, keep_out, self.first, settings, shard, cache, progress,
        )
    }
}

/// Centre lines with beads of a width that the nozzle lays, as many as a path may have.
fn with_beads(
    lines: CentreLines,
    options: &Options,
    settings: &Settings,
) -> Result<GcodeProgram, Error> {
    let points: usize = lines.lines.iter().map(|line| line.points.len()).sum();
    if points.saturating_mul(settings.layers as usize) > MOVES_MAX {
        return Err(Error::Options(format!(
            "--layers {} of lines with {points} points are more than {MOVES_MAX} moves: give fewer layers, or a coarser \
             --tolerance for curves",
            settings.layers
        )));
    }
    let aperture = &settings.aperture;
    let [least_mm, most_mm] = [aperture.minor_mm(), aperture.major_mm()].map(|half| 2.0 * half);
    let [across_mm, _] = aperture.sizes_mm();
    let width_mm = options.bead_width_mm.unwrap_or(across_mm);
    match (least_mm..=most_mm).contains(&width_mm) {
        true => Ok(along_lines(lines, width_mm, settings)),
        false => Err(Error::Options(format!(
            "--bead-width {width_mm}: this nozzle lays beads of {} to {} mm: write one of them",
            Short(least_mm),
            Short(most_mm)
        ))),
    }
}

/// The layers of a mesh, of heights that the nozzle can print: no bead is higher than the widest one is wide.
fn cut(
    loaded: &LoadedMesh,
    heights: &LayerHeights,
    settings: &Settings,
) -> Result<SlicedPart, Error> {
    let most_mm = 2.0 * settings.aperture.major_mm();
    if heights.first_mm > most_mm {
        return Err(Error::Options(format!(
            "--first-layer-height {}: this aperture's widest bead is {most_mm:.3} mm wide: give a lower height",
            heights.first_mm
        )));
    }
    if let Some(range) = heights.ranges.iter().find(|of| of.layer_mm > most_mm) {
        return Err(Error::Options(format!(
            "--layer-heights: layers of {} mm from {} to {} mm, and this aperture's widest bead is {most_mm:.3} \
             mm wide: give a lower height",
            range.layer_mm, range.from_mm, range.to_mm
        )));
    }
    sliced_carved(&loaded.mesh, &loaded.carved, heights).map_err(part_error)
}

/// Puts the requested number of parts into the layers; says where, if parts were requested.
fn copied(
    layers: &mut [&mut Vec<Region>],
    at_mm: &[[f64; 3]],
    options: &Options,
    settings: &Settings,
) -> Result<Option<String>, Error> {
    let wrong = |text: String| Err(Error::Options(text));
    let offsets = match (at_mm, options.copies, options.copy_gap_mm) {
        ([first, _, ..], None, None) => {
            if let Some([x, y, z]) = at_mm.iter().find(|at| at[2] != first[2]) {
                return wrong(format!(
                    "--at {x},{y},{z}: parts of one bed have the same Z, here {}",
                    first[2]
                ));
            }
            let offset = |at: &[f64; 3]| Vector2::new(at[0] - first[0], at[1] - first[1]);
            at_mm.iter().map(offset).collect()
        }
        ([_, _, ..], ..) => {
            return wrong(
                "several --at give the position of each part: omit --copies and --copy-gap"
                    .to_string(),
            );
        }
        (_, None, None) => return Ok(None),
        (_, None, Some(_)) => return wrong("--copy-gap goes with --copies".to_string()),
        (_, Some(count), gap_mm) => {
            let gap_mm = copies::checked_gap_mm(gap_mm);
            let gap_mm = gap_mm.map_err(|error| Error::Options(error.to_string()))?;
            let [low, high] = settings.work_area_mm;
            let area_mm = [high[0] - low[0], high[1] - low[1]];
            copies::in_rows(count, box_of(layers), gap_mm, area_mm).map_err(part_error)?
        }
    };
    copies::spread(layers, &offsets)
        .map(Some)
        .map_err(part_error)
}

use Kind::{Curved, Flat, Gcode, Laid, Lines, Outline, Patch, Path, Pieces};

/// Kinds of parts that differ in their options.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Outline,
    /// An outline projected onto a surface.
    Laid,
    Patch,
    /// A mesh in flat layers.
    Flat,
    Curved,
    /// A mesh in pieces with directions of their own.
    Pieces,
    Path,
    Gcode,
    /// Middles of beads.
    Lines,
}

impl Kind {
    fn of(part: &Part, options: &Options) -> Kind {
        match &part.what {
            What::Patch { .. } => Kind::Patch,
            What::Input(Input::Outline(_)) if part.surface.is_some() => Kind::Laid,
            What::Input(Input::Outline(_)) => Kind::Outline,
            What::Input(Input::Mesh(_)) if options.curved_layers.is_some() => Kind::Curved,
            What::Input(Input::Mesh(_)) if options.directions.is_some() => Kind::Pieces,
            What::Input(Input::Mesh(_)) => Kind::Flat,
            What::Input(Input::Path(_)) => Kind::Path,
            What::Input(Input::Gcode(_)) => Kind::Gcode,
            What::Input(Input::Lines(_)) => Kind::Lines,
        }
    }
}

/// Rows of options, the kinds of parts that they do not go with, and why.
macro_rules! rows {
    ($($names:expr => [$($kind:ident)+] $why:expr;)+) => { &[$(($names, &[$($kind),+], $why)),+] };
}

/// What goes with what: the first row that applies refuses a part.
const REFUSED: &[(&str, &[Kind], &str)] = rows! {
    "--bead-width" => [Outline Laid Patch Flat Curved Pieces Path Gcode]
        "goes with --centre-lines: other beads are as wide as the nozzle lays them in their place";
    OF_FILLS => [Lines] "goes with what is filled: lines are laid once, as they are drawn; leave it out, or --centre-lines";
    "--layers" => [Flat Curved Pieces] "goes with outlines: a mesh has its own; --layer-range takes some of them";
    "--surface" => [Flat Curved Pieces Path Gcode] "goes with outlines: only they are projected onto a surface";
    "--curved-layers" => [Outline Laid Patch Path Gcode]
        "goes with meshes (STL, 3MF, OBJ): only a part has tops to follow";
    "--directions" => [Outline Laid Patch Path Gcode]
        "goes with meshes (STL, 3MF, OBJ): only a part is divided into pieces";
    "--directions" => [Curved] "does not go with --curved-layers: its layers are flat; leave one of them out";
    COPIES => [Path Gcode] "goes with outlines and meshes: a path is printed once";
    COPIES => [Laid Patch] "goes with parts on the bed: a surface carries one part";
    "--keep-out" => [Patch] "goes with outlines that are seen from above";
    "--keep-out" => [Path Gcode] A_PATH;
    OF_OUTLINES => [Path Gcode] A_PATH;
    "--gap, --turn, --corner-tolerance, --tilt-max" => [Outline Laid Patch Flat Curved Pieces Gcode Lines] NO_AXES;
    "--axis-tolerance" => [Outline Flat Curved Gcode Lines] NO_AXES;
    "--place" => [Curved Pieces Gcode Lines] "goes with outlines, meshes in flat layers and waypoints: give the place with --at";
    "--layer-range, --layer-heights, --first-layer-height, --first-layer-speed" => [Outline Laid Patch Path Gcode]
        "goes with meshes: all layers of an outline are the same";
    "--cache" => [Outline Laid Patch Curved Pieces Path Gcode]
        "goes with a mesh in flat layers: only it is planned in blocks, which are kept; leave --cache out, and the part is \
         planned anew";
    "--keep-out" => [Curved]
        "does not go with --curved-layers, whose travel goes straight above all that is printed: leave one of them out, or \
         place the part elsewhere with --at";
    "--layer-range" => [Curved]
        "does not go with --curved-layers: a curved layer lies beside and over several others, and has no number of its \
         own; cut the mesh where the print is to end, or leave one of them out";
    "--layer-heights, --first-layer-height" => [Curved]
        "does not go with --curved-layers, which choose their own thickness: give one --layer-height";
    "--first-layer-speed" => [Curved] "does not go with --curved-layers: give a lower --speed, or leave one of them out";
    COPIES => [Curved]
        "does not go with --curved-layers: put the parts beside each other in one mesh file (each has its own curved \
         layers), or print the job once for each with --at X,Y,Z";
    "--keep-out, --layer-range, --layer-heights, --first-layer-height, --first-layer-speed" => [Pieces]
        "does not go with --directions, whose pieces have layers of their own from where they are cut: leave one of them out";
    COPIES => [Pieces] "does not go with --directions: print the job once for each with --at X,Y,Z";
    CUT_AWAY => [Pieces] "the file cuts volumes away from its objects; export the part as one mesh";
    CARVED => [Curved] "the file cuts volumes away from its objects; export the part as one mesh";
};
const OF_FILLS: &str = "--walls, --wall-speed, --solid-speed, --sparse-speed, --skirt, --brim, --skirt-distance-mm, \
    --avoid-crossing, --bridge-max, --pass, --law, --quality, --overlap, --keep-out, --surface, --directions, \
    --curved-layers, --layer-range, --layer-heights, --first-layer-height, --first-layer-speed, --cache, a second --at, \
    --copies, --copy-gap";
const COPIES: &str = "a second --at, --copies, --copy-gap";
const A_PATH: &str = "goes with outlines: a path is followed as it is";
const NO_AXES: &str = "goes with runs of waypoints: outlines have no tool axes";
/// What a message on volumes of the file begins with.
const CARVED: &str = "--curved-layers:";
const CUT_AWAY: &str = "--directions:";

/// Refuses what goes with other kinds of parts.
fn check_options(part: &Part, options: &Options, is_cached: bool) -> Result<(), Error> {
    let kind = Kind::of(part, options);
    let carved = match &part.what {
        What::Input(Input::Mesh(loaded)) => !loaded.carved.is_empty(),
        _ => false,
    };
    let of_part = [
        ("--surface", part.surface.is_some()),
        ("--keep-out", !part.keep_out.is_empty()),
        ("--layer-heights", !part.height_ranges.is_empty()),
        ("--cache", is_cached),
        ("a second --at", part.at_mm.len() > 1),
        (CARVED, carved),
        (CUT_AWAY, carved),
    ];
    let mut given = options.given();
    given.extend(of_part.iter().filter(|of| of.1).map(|of| of.0));
    let mut refused = REFUSED.iter().filter(|row| row.1.contains(&kind));
    let first = refused.find_map(|(names, _, why)| {
        let name = names.split(", ").find(|name| given.contains(name))?;
        Some(Error::Options(format!("{name} {why}")))
    });
    first.map_or(Ok(()), Err)
}
