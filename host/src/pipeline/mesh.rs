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
use crate::geometry::polygon::Region;
use crate::job::SegmentStream;
use crate::job::transform::PartTransform;
use crate::mesh::layers::SlicedPart;
pub use crate::pipeline::blocks::FirstLayer;
use crate::pipeline::blocks::{Block, Blocks, with_blocks};
use crate::pipeline::error::{another_solution, no_region_printable};
use crate::pipeline::links::Chain;
use crate::pipeline::open_ground;
pub use crate::pipeline::piece::PLACES_MAX;
use crate::pipeline::piece::{Piece, PieceCache};
use crate::pipeline::roofs::Roofs;
use crate::plan::judge::figures::Swept;
use crate::plan::layers::shells::{Overhang, overhangs};
use crate::plan::motion::best_place::FoundPlace;
use crate::plan::progress::Progress;
use crate::settings::Settings;
use std::ops::Range;

/// A planned part.
#[derive(Clone, Debug, Default)]
pub struct PartPlan {
    /// Position of the part on the machine.
    pub transform: PartTransform,
    /// The place that was found for it, if one was requested.
    pub found_place: Option<FoundPlace>,
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
    with_blocks(part, keep_out, first, settings, |blocks| {
        planned_in_blocks(part, blocks, context)
    })
}

/// Plans the blocks of a part one after the other, joins them and hands their streams on.
fn planned_in_blocks(
    part: &SlicedPart,
    blocks: &Blocks,
    context: PartContext,
) -> Result<PartPlan, PlanError> {
    let settings = blocks.settings;
    let mut planned = PartPlan {
        transform: blocks.transform,
        found_place: blocks.found_place,
        overhangs: hanging(blocks, &part.wanted),
        roofs: blocks.body.roofs.clone(),
        ..PartPlan::default()
    };
    let mut chain = Chain::default();
    let wanted = part.wanted_layers();
    let mut rest = wanted;
    while let Some(block) = blocks.next(&mut rest) {
        let Block { stack, own, .. } = &block;
        context.progress.layers(block.before, wanted.len());
        let (mut piece, _) = block.piece(context.cache, context.program, context.progress)?;
        let link = chain.link(&mut piece, stack, own, context.progress)?;
        for piece in link.into_iter().chain([piece]) {
            let first_pass = planned.printed.figures.passes as u32;
            let stream = planned.add(piece, settings)?;
            if !stream.knots.is_empty() {
                (context.take)(stream, first_pass).map_err(PlanError::Output)?;
            }
        }
    }
    context.progress.layers(wanted.len(), wanted.len());
    if planned.segments == 0 {
        return Err(no_region_printable(planned.printed.left_out.len()));
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
            return Err(another_solution());
        }
        self.solution = stream.solution;
        self.segments += stream.knots.len() as u64;
        Ok(stream)
    }
}

/// What hangs on each of the wanted layers: over nothing, and not bridged.
fn hanging(blocks: &Blocks, wanted: &Range<u32>) -> Vec<Overhang> {
    let (body, reach_mm) = (blocks.body, blocks.settings.aperture.major_mm());
    let unheld = |layer: usize| match wanted.contains(&(layer as u32)) {
        true => body.unheld(layer),
        false => Vec::new(),
    };
    overhangs(
        blocks.outlines,
        unheld,
        |layer| body.bridged(layer),
        reach_mm,
    )
}
