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
use std::ops::Range;

/// A share of a part's blocks: every `count`th, from block `number` on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// From 1 to `count`.
    pub number: usize,
    /// Number of shares.
    pub count: usize,
}

/// What became of a block of a shard.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ShardBlock {
    /// Its number, from 0 upwards.
    pub block: usize,
    /// Its layers, from 0, without the end.
    pub layers: Range<u32>,
    /// It was in the cache before.
    pub was_known: bool,
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
) -> Result<(Vec<ShardBlock>, usize), PlanError> {
    with_blocks(part, keep_out, first, settings, |blocks| {
        let wanted = part.wanted_layers();
        let (mut rest, mut done, mut number) = (wanted, Vec::new(), 0);
        while let Some(block) = blocks.next(&mut rest) {
            let is_own = number % shard.count.max(1) + 1 == shard.number;
            if is_own {
                progress.layers(block.before, wanted.len());
                let (_, was_known) = block.piece(cache, program, progress)?;
                done.push(ShardBlock {
                    block: number,
                    layers: block.layers.clone(),
                    was_known,
                });
            }
            number += 1;
        }
        progress.layers(wanted.len(), wanted.len());
        Ok((done, number))
    })
}
