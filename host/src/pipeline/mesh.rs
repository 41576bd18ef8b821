//! A part with changing layers -> one job, planned a few layers at a time.
//!
//! The planning data of a few layers (walls, passes, curves, rasters) are reduced to a [`Piece`] (a block
//! of layers) and dropped before the next ones; the blocks' streams, each from rest to rest, are handed
//! on as they come. Layers of a block are planned in parallel; a block does not depend on the number of
//! threads, and may come from a cache.
//!
//! In: sliced layers (mm), settings, a cache. Out: streams in order, and the data for the figures. Not
//! covered: files, and the clock.

use super::PlanError;
use crate::geometry::Point2;
use crate::geometry::polygon::{Box2, Region};
use crate::job::SegmentStream;
use crate::job::transform::PartTransform;
use crate::mesh::layers::{SlicedPart, TargetLayer};
use crate::pipeline::open_ground;
use crate::pipeline::part_body::{PartBodies, Share, shares};
pub use crate::pipeline::piece::PLACES_MAX;
use crate::pipeline::piece::{Piece, PieceCache, key_of};
use crate::pipeline::roofs::Roofs;
use crate::pipeline::stack::{Stack, plan_stack};
use crate::plan::judge::figures::Swept;
use crate::plan::layers::layer_groups::{LayerKind, StackLayer};
use crate::plan::layers::shells::{Overhang, overhangs};
use crate::plan::layers::skirt::skirt_reach_mm;
use crate::plan::progress::Progress;
use crate::plan::route::keep_out::cleared;
use crate::plan::route::keep_out::shadows::with_shadows;
use crate::settings::Settings;
use headway_firmware::kinematics::winds;
use headway_protocol::units::CHANNELS;
use std::ops::Range;

/// Most kinds of layer that are planned at a time: what they need is the memory that planning takes.
const KINDS_AT_A_TIME: usize = 8;
/// Most layers at a time, of however few kinds: their routes are written out.
const LAYERS_AT_A_TIME: usize = 64;

/// How the first layer of a part differs from the others.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FirstLayer {
    /// Tip speed while it is printed, mm/s; `None` for that of the others.
    pub speed_mm_s: Option<f64>,
}

/// A planned part.
#[derive(Clone, Debug, Default)]
pub struct PartPlan {
    /// Position of the part on the machine.
    pub transform: PartTransform,
    /// The sum of its pieces, with at most [`PLACES_MAX`] places of each kind; the stream is empty if they were
    /// handed on.
    pub printed: Piece,
    /// The joint solution that it is run in.
    pub solution: u8,
    /// Knots of the stream.
    pub segments: u64,
    /// Overhangs, by layer of the complete part.
    pub overhangs: Vec<Overhang>,
    /// Bridges that span much.
    pub roofs: Roofs,
    /// Objects whose settings cannot be followed.
    pub unfollowed: Option<String>,
    /// Uncovered area without tiny parts, over all layers.
    pub open_mm2: f64,
}

/// Inputs and outputs of planning a part.
pub struct PartContext<'a> {
    /// Receiver of progress.
    pub progress: &'a dyn Progress,
    /// Pieces that were planned before.
    pub cache: &'a mut dyn PieceCache,
    /// The planning program: blocks of another one are not used.
    pub program: &'a str,
    /// Receives the stream in parts, each with the number of its first pass. An error from it ends
    /// planning.
    pub take: &'a mut dyn FnMut(SegmentStream, u32) -> Result<(), String>,
}

/// Plans the requested layers of a part around keep-outs (input coordinates), with the complete stream
/// in memory.
///
/// # Errors
/// [`PlanError`]; a region that cannot be planned is left out instead.
pub fn plan_part(
    part: &SlicedPart,
    keep_out: &[Region],
    first: FirstLayer,
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<PartPlan, PlanError> {
    let mut stream = SegmentStream::default();
    let mut take = |piece: SegmentStream, first_pass| {
        stream.append(piece, first_pass);
        Ok(())
    };
    let context = PartContext {
        progress,
        cache: &mut (),
        program: "",
        take: &mut take,
    };
    let mut planned = plan_part_in_pieces(part, keep_out, first, settings, context)?;
    planned.printed.stream = stream;
    Ok(planned)
}

/// The same; only the outlines in memory grow with the number of layers.
///
/// # Errors
/// [`PlanError`]; a region that cannot be planned is left out instead.
pub fn plan_part_in_pieces(
    part: &SlicedPart,
    keep_out: &[Region],
    first: FirstLayer,
    settings: &Settings,
    context: PartContext,
) -> Result<PartPlan, PlanError> {
    settings.check()?;
    let is_like_others =
        |layer: &TargetLayer| is_as_high(layer, settings) && first.speed_mm_s.is_none();
    if !may_divide(settings) && !part.layers.iter().all(is_like_others) {
        return Err(PlanError::FirstLayerWinds);
    }
    let outlines: Vec<&[Region]> = part.layers.iter().map(|l| l.regions.as_slice()).collect();
    let (shares, unfollowed) = shares(part, settings);
    let shares: Vec<(&Share, Vec<&[Region]>)> = shares
        .iter()
        .map(|share| (share, share.outlines()))
        .collect();
    let bodies = PartBodies::new(&outlines, &shares, &part.wanted, settings);
    let mut planned = PartPlan {
        transform: place(part, settings)?,
        overhangs: hanging(&outlines, &bodies, &part.wanted, settings),
        roofs: bodies.roofs(),
        unfollowed,
        ..PartPlan::default()
    };
    let keep_out = &with_shadows(keep_out, &planned.transform, settings);
    let mut at = super::start_pose(settings);
    let wanted = part.wanted_layers();
    let mut rest = wanted;
    while let Some(lowest) = rest.first() {
        let layers = wanted.len() - rest.len();
        context.progress.layers(layers, wanted.len());
        let is_first = lowest.number == wanted[0].number;
        let own = settings_of(lowest, first, settings);
        let (stack, used) = gather(rest, &bodies, keep_out, &own, planned.transform, at);
        rest = &rest[used..];
        let stack = Stack {
            skirt_around: Some(lowest.regions.as_slice())
                .filter(|regions| is_first && !regions.is_empty()),
            is_last: rest.is_empty(),
            ..stack
        };
        let key = key_of(&stack, &own, context.program);
        let piece = match context.cache.get(key) {
            Some(known) => known,
            None => {
                let piece = Piece::of(plan_stack(stack, &own, context.progress)?, &own);
                context.cache.put(key, &piece);
                piece
            }
        };
        let first_pass = planned.printed.figures.passes as u32;
        at = piece.end.unwrap_or(at);
        let stream = planned.add(piece, settings)?;
        if !stream.knots.is_empty() {
            (context.take)(stream, first_pass).map_err(PlanError::Output)?;
        }
    }
    context.progress.layers(wanted.len(), wanted.len());
    if planned.segments == 0 {
        return Err(PlanError::NoLayerPrintable {
            left_out: planned.printed.left_out.len(),
        });
    }
    let printed = &mut planned.printed;
    let (layers, swept): (Vec<u32>, Vec<Swept>) = printed.swept.iter().copied().unzip();
    printed.figures.set_shares(&layers, &swept);
    Ok(planned)
}

impl PartPlan {
    /// Adds the kept data of a piece, and passes on its stream.
    fn add(&mut self, piece: Piece, settings: &Settings) -> Result<SegmentStream, PlanError> {
        self.open_mm2 += open_ground::told_mm2(&piece.open, settings);
        let stream = self.printed.add(piece);
        if stream.knots.is_empty() {
            return Ok(stream);
        }
        if self.segments > 0 && stream.solution != self.solution {
            return Err(PlanError::AnotherSolution);
        }
        self.solution = stream.solution;
        self.segments += stream.knots.len() as u64;
        Ok(stream)
    }
}

/// True if the parts of a route can be printed one by one: joints that wind up (arms, turning
/// tables) are followed along the whole of it.
fn may_divide(settings: &Settings) -> bool {
    winds(&settings.machine.kinematics) == 0
}

fn is_as_high(layer: &TargetLayer, settings: &Settings) -> bool {
    (layer.height_mm - settings.layer_height_mm).abs() < 1e-9
}

/// Where a part goes: the box of all its layers.
fn place(part: &SlicedPart, settings: &Settings) -> Result<PartTransform, PlanError> {
    let regions = part.layers.iter().flat_map(|layer| &layer.regions);
    let corners: Vec<Point2> = regions
        .flat_map(|region| [region.bounds().min, region.bounds().max])
        .collect();
    let bounds = Box2::of(&corners).grown(skirt_reach_mm(settings));
    let bottom_mm = part.layers.first().map_or(0.0, |l| l.top_mm - l.height_mm);
    let top_mm = part.layers.last().map_or(0.0, |layer| layer.top_mm);
    let stacked = Settings {
        layers: part.layers.len() as u32,
        ..settings.clone()
    };
    Ok(PartTransform::choose_box(
        bounds,
        [bottom_mm, top_mm],
        &stacked,
    )?)
}

/// What hangs on each of the wanted layers: over nothing, and not bridged.
fn hanging(
    outlines: &[&[Region]],
    bodies: &PartBodies,
    wanted: &Range<u32>,
    settings: &Settings,
) -> Vec<Overhang> {
    let reach_mm = settings.aperture.major_mm();
    let unheld = |layer: usize| match wanted.contains(&(layer as u32)) {
        true => bodies.unheld(layer),
        false => Vec::new(),
    };
    overhangs(outlines, unheld, |layer| bodies.bridged(layer), reach_mm)
}

/// The settings of a layer's piece.
fn settings_of(layer: &TargetLayer, first: FirstLayer, settings: &Settings) -> Settings {
    let is_first = layer.number == 0;
    Settings {
        layer_height_mm: layer.height_mm,
        speed_mm_s: match first.speed_mm_s {
            Some(speed_mm_s) if is_first => speed_mm_s,
            _ => settings.speed_mm_s,
        },
        ..settings.clone()
    }
}

/// The next layers of the same settings, as many as are planned at a time, and how many they are.
fn gather<'a>(
    layers: &'a [TargetLayer],
    bodies: &PartBodies,
    keep_out: &'a [Region],
    settings: &Settings,
    transform: PartTransform,
    start: [f64; CHANNELS],
) -> (Stack<'a>, usize) {
    let mut stack = Stack {
        outlines: Vec::new(),
        kinds: Vec::new(),
        layers: Vec::new(),
        keep_out,
        kept_out_mm2: 0.0,
        skirt_around: None,
        scale: None,
        transform,
        start,
        is_last: false,
        may_leave_out: true,
    };
    // Outlines as the part has them, before anything is taken from them.
    let mut known: Vec<&[Region]> = Vec::new();
    let may_divide = may_divide(settings);
    let mut used = 0;
    // Loops that follow each other without a rest are one move.
    let may_rest = may_divide && !settings.wide_beads.continuous_z;
    let most = if may_rest {
        LAYERS_AT_A_TIME
    } else {
        usize::MAX
    };
    for layer in layers.iter().take(most) {
        // The first layer may have its own height and speed, others a height.
        let is_other = layer.number == 1 || !is_as_high(layer, settings);
        let is_full = may_rest && stack.kinds.len() >= KINDS_AT_A_TIME;
        if used > 0 && may_divide && (is_other || is_full) {
            break;
        }
        used += 1;
        if layer.regions.is_empty() {
            continue;
        }
        let own = layer.regions.as_slice();
        let outline = known.iter().position(|known| *known == own);
        let outline = outline.unwrap_or_else(|| {
            known.push(own);
            stack
                .outlines
                .push(cleared(own, keep_out, settings).regions);
            known.len() - 1
        });
        let area = |regions: &[Region]| regions.iter().map(Region::area_mm2).sum::<f64>();
        stack.kept_out_mm2 += area(own) - area(&stack.outlines[outline]);
        let (inside, objects) = bodies.inside(layer.number);
        let kind = LayerKind {
            outline,
            inside,
            objects,
        };
        let known_kind = stack.kinds.iter().position(|known| *known == kind);
        let kind_number = known_kind.unwrap_or(stack.kinds.len());
        if known_kind.is_none() {
            stack.kinds.push(kind);
        }
        stack.layers.push(StackLayer {
            number: layer.number,
            top_mm: layer.top_mm,
            kind: kind_number,
        });
    }
    (stack, used)
}
