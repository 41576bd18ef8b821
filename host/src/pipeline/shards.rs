//! Plans a share of a part's blocks into a cache, so that several machines can plan a part at the same time.
//!
//! In: sliced layers (mm), settings, the share, a cache. Out: blocks in the cache, and which they are. Not covered: the
//! job, which [`super::mesh::plan_part_in_pieces`] makes of the cached blocks.

use super::PlanError;
use crate::geometry::polygon::Region;
use crate::mesh::layers::SlicedPart;
use crate::pipeline::blocks::{FirstLayer, with_blocks};
use crate::pipeline::piece::PieceCache;
use crate::plan::progress::Progress;
use crate::settings::Settings;

/// A share of a part's blocks: every `count`th, from block `number` on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// From 1 to `count`.
    pub number: usize,
    /// Number of shares.
    pub count: usize,
}

/// A block of layers of a share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct PlannedBlock {
    /// From 1.
    pub number: usize,
    /// First and last layer, from 1.
    pub layers: [u32; 2],
    /// It was kept before.
    pub was_known: bool,
}

/// A planned share of a mesh's blocks.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct PlannedShard {
    /// The blocks of the share.
    pub own: Vec<PlannedBlock>,
    /// Number of the mesh's blocks.
    pub blocks: usize,
}

/// Plans the blocks of a shard into the cache, and no others. [`super::mesh::plan_part_in_pieces`] with the same input
/// then finds all of them there. Returns what was planned, and the number of the part's blocks.
///
/// # Errors
/// [`PlanError`]; a region that cannot be planned is left out instead.
pub fn plan_shard(
    part: &SlicedPart,
    keep_out: &[Region],
    first: FirstLayer,
    settings: &Settings,
    shard: Shard,
    (cache, program): (&mut dyn PieceCache, &str),
    progress: &dyn Progress,
) -> Result<PlannedShard, PlanError> {
    with_blocks(part, keep_out, first, settings, |blocks| {
        let wanted = part.wanted_layers();
        let (mut rest, mut planned) = (wanted, PlannedShard::default());
        while let Some(block) = blocks.next(&mut rest) {
            let is_own = planned.blocks % shard.count.max(1) + 1 == shard.number;
            planned.blocks += 1;
            if is_own {
                progress.layers(block.before, wanted.len());
                let (_, was_known) = block.piece(cache, program, progress)?;
                planned.own.push(PlannedBlock {
                    number: planned.blocks,
                    layers: [block.layers.start + 1, block.layers.end],
                    was_known,
                });
            }
        }
        progress.layers(wanted.len(), wanted.len());
        Ok(planned)
    })
}
