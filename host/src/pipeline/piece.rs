//! A block of layers of a part: the data that are kept of a few layers planned together.
//!
//! Input: the plan of a few layers. Output: its stream from rest to rest, and its data for the
//! figures of the complete part; as bytes with a checksum for a cache ([`PieceCache`]), and their
//! key: a hash of everything that the block depends on. Not covered: files.

use super::Plan;
use crate::geometry::polygon::Region;
use crate::job::SegmentStream;
use crate::pipeline::layer_time::SlowedLayers;
use crate::pipeline::layer_uses::{LayerUse, PassUse, layer_uses, pass_uses};
use crate::pipeline::open_ground::{self, OpenGround};
use crate::pipeline::stack::{LeftOut, Stack};
use crate::pipeline::stacked_ground::{OpenCells, open_cells};
use crate::pipeline::two_bead_walls::TwoBeadWalls;
use crate::plan::judge::figures::{PlanFigures, Swept};
use crate::plan::layers::region_plan::RegionPlan;
use crate::plan::motion::segments::check::Ratios;
use crate::plan::outline::unreachable::UnreachableRun;
use crate::settings::Settings;
use headway_protocol::frame::CRC;
use serde::{Deserialize, Serialize};
use siphasher::sip128::{Hasher128, SipHasher13};
use std::fmt::{self, Write};
use std::hash::Hasher;

/// The first bytes of a piece; the number is that of their layout.
const MAGIC: &[u8; 8] = b"HWPIECE4";

/// Most places of each kind that are kept of a part.
pub const PLACES_MAX: usize = 1000;

/// The kept data of a few layers, or of all layers of a part.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Piece {
    /// The stream; its passes are counted from 0.
    pub stream: SegmentStream,
    /// What was swept of each printing, with its layer.
    pub swept: Vec<(u32, Swept)>,
    /// Lengths, times and counts.
    pub figures: PlanFigures,
    /// What the stream reaches of the limits.
    pub ratios: Ratios,
    /// Worst error of the fit against its share of the tolerance.
    pub fit_error_ratio: f64,
    /// Moves whose complete time had to be doubled.
    pub doubled_moves: u64,
    /// Duration, s.
    pub duration_s: f64,
    /// Regions that are not printed.
    pub left_out: Vec<LeftOut>,
    /// Area lost to keep-outs.
    pub kept_out_mm2: f64,
    /// Loops of a brim without room; `None` without a skirt or brim.
    pub crowded_loops: Option<usize>,
    /// Travels between passes that leave the regions.
    pub outline_crossings: u64,
    /// Unreachable boundary, once for each layer group.
    pub unreachable: Vec<UnreachableRun>,
    /// Length of it over all layers.
    pub unreachable_mm: f64,
    /// Ground that was to be filled and stays open, the largest first.
    pub open: Vec<OpenGround>,
    /// Area that lines are to cover, and its swept part.
    pub infill_mm2: [f64; 2],
    /// The part of that which is open on purpose between sparse lines, and its swept part.
    pub sparse_mm2: [f64; 2],
    /// The lowest layer of each run of unreachable boundary.
    pub unreachable_layers: Vec<u32>,
    /// What its layers are spent on.
    pub uses: Vec<LayerUse>,
    /// What each of its passes is.
    pub pass_uses: Vec<PassUse>,
    /// Layers that were slowed.
    pub slowed: SlowedLayers,
    /// Uncovered area by cells, and the number of evaluated layers.
    pub open_cells: (OpenCells, u32),
    /// Walls that take two beads, and one of a wider nozzle.
    pub two_bead_walls: TwoBeadWalls,
}

/// Pieces that were planned before.
pub trait PieceCache {
    /// Whether pieces are kept at all: if not, nothing needs a key.
    fn keeps(&self) -> bool;
    /// The piece of this key, if it is there and whole.
    fn get(&mut self, key: u128) -> Option<Piece>;
    /// Keeps a piece.
    fn put(&mut self, key: u128, piece: &Piece);
}

/// Keeps nothing.
impl PieceCache for () {
    fn keeps(&self) -> bool {
        false
    }

    fn get(&mut self, _: u128) -> Option<Piece> {
        None
    }

    fn put(&mut self, _: u128, _: &Piece) {}
}

impl Piece {
    /// The kept data of a plan.
    pub fn of(plan: Plan, settings: &Settings) -> Piece {
        let pass_uses = pass_uses(&plan);
        let mut piece = Piece {
            uses: layer_uses(&plan, &pass_uses, f64::from(settings.machine.servo_hz)),
            pass_uses,
            slowed: plan.slowed,
            open_cells: open_cells(&plan, settings.aperture.minor_mm()),
            two_bead_walls: TwoBeadWalls::of(&plan, settings),
            open: open_ground::open_ground(&plan, settings),
            kept_out_mm2: plan.kept_out_mm2,
            crowded_loops: plan.skirt.as_ref().map(|skirt| skirt.crowded),
            outline_crossings: plan.outline_crossings as u64,
            figures: plan.figures,
            ratios: plan.motion.ratios,
            fit_error_ratio: plan.motion.fit_error_ratio,
            doubled_moves: plan.motion.doubled_moves as u64,
            duration_s: plan.motion.duration_s,
            ..Piece::default()
        };
        for (number, kind) in plan.kinds.iter().enumerate() {
            let runs = unreachable_boundary(&kind.regions);
            let length_mm: f64 = runs.iter().map(UnreachableRun::length_mm).sum();
            piece.unreachable_mm += length_mm * f64::from(kind.layers);
            let mut prints = plan.prints.iter().filter(|print| print.kind == number);
            let layer = prints.next().map_or(0, |print| print.layer);
            piece.unreachable_layers.extend(runs.iter().map(|_| layer));
            piece.unreachable.extend(runs);
            let infill_mm2 = plan.infill_area_mm2(Some(number));
            if let Some([ground, swept]) = infill_mm2 {
                piece.infill_mm2[0] += ground;
                piece.infill_mm2[1] += swept;
            }
            // Where nothing inside the walls is solid, counting it once does.
            let is_all_sparse = (kind.regions.iter()).all(|region| region.open == region.sparse);
            let sparse_mm2 = match is_all_sparse {
                true => infill_mm2,
                false => plan.sparse_area_mm2(Some(number)),
            };
            if let Some([ground, swept]) = sparse_mm2 {
                piece.sparse_mm2[0] += ground;
                piece.sparse_mm2[1] += swept;
            }
        }
        let layers = plan.prints.iter().map(|print| print.layer);
        let swept = plan.measured.swept.iter().copied();
        piece.swept = layers.zip(swept).collect();
        piece.left_out = plan.left_out;
        piece.stream = plan.stream;
        piece
    }

    /// Adds the kept data of the next piece, at most [`PLACES_MAX`] places of each kind, and passes on its stream.
    pub fn add(&mut self, piece: Piece) -> SegmentStream {
        fn add_areas(all_mm2: &mut [f64; 2], own_mm2: [f64; 2]) {
            for (all, own) in all_mm2.iter_mut().zip(own_mm2) {
                *all += own;
            }
        }
        self.swept.extend(piece.swept);
        self.figures.add_lengths(&piece.figures);
        self.left_out.extend(piece.left_out);
        self.kept_out_mm2 += piece.kept_out_mm2;
        self.crowded_loops = self.crowded_loops.max(piece.crowded_loops);
        self.outline_crossings += piece.outline_crossings;
        self.ratios = self.ratios.max(piece.ratios);
        self.fit_error_ratio = self.fit_error_ratio.max(piece.fit_error_ratio);
        self.doubled_moves += piece.doubled_moves;
        self.duration_s += piece.duration_s;
        self.unreachable_mm += piece.unreachable_mm;
        let room = PLACES_MAX - self.unreachable.len();
        self.unreachable
            .extend(piece.unreachable.into_iter().take(room));
        self.unreachable_layers
            .extend(piece.unreachable_layers.into_iter().take(room));
        self.open.extend(piece.open);
        self.open.sort_by(|a, b| b.area_mm2.total_cmp(&a.area_mm2));
        self.open.truncate(4 * PLACES_MAX);
        self.open = open_ground::merged(std::mem::take(&mut self.open));
        self.open.truncate(PLACES_MAX);
        add_areas(&mut self.infill_mm2, piece.infill_mm2);
        add_areas(&mut self.sparse_mm2, piece.sparse_mm2);
        self.uses.extend(piece.uses);
        self.pass_uses.extend(piece.pass_uses);
        self.slowed.layers += piece.slowed.layers;
        self.slowed.still_short += piece.slowed.still_short;
        for (cell, layers) in piece.open_cells.0 {
            *self.open_cells.0.entry(cell).or_default() += layers;
        }
        self.open_cells.1 += piece.open_cells.1;
        self.two_bead_walls.add(piece.two_bead_walls);
        piece.stream
    }

    /// As bytes; `None` if it cannot be stored.
    pub fn to_bytes(&self) -> Option<Vec<u8>> {
        let mut bytes = postcard::to_extend(self, MAGIC.to_vec()).ok()?;
        let crc = CRC.checksum(&bytes);
        bytes.extend_from_slice(&crc.to_le_bytes());
        Some(bytes)
    }

    /// From such bytes; `None` if any of them has changed.
    pub fn from_bytes(bytes: &[u8]) -> Option<Piece> {
        let (body, crc) = bytes.split_last_chunk::<4>()?;
        if CRC.checksum(body) != u32::from_le_bytes(*crc) {
            return None;
        }
        postcard::from_bytes(body.strip_prefix(MAGIC)?).ok()
    }
}

/// Unreachable boundary of regions, input coordinates.
pub fn unreachable_boundary<'a>(
    regions: impl IntoIterator<Item = &'a RegionPlan>,
) -> Vec<UnreachableRun> {
    let in_input = |region: &RegionPlan| {
        let offset = region.contour.offset;
        let shifted = move |run: &UnreachableRun| UnreachableRun {
            from: run.from + offset,
            to: run.to + offset,
        };
        region.unreachable.iter().map(shifted).collect::<Vec<_>>()
    };
    regions.into_iter().flat_map(in_input).collect()
}

/// Hashes the text written to it.
struct HashText(SipHasher13);

impl Write for HashText {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.0.write(text.as_bytes());
        Ok(())
    }
}

/// The key of a piece: all that planning is given, every number by its shortest digits that read back
/// the same, and `program`, which planned it.
pub(crate) fn key_of(stack: &Stack, settings: &Settings, program: &str) -> u128 {
    let mut text = HashText(SipHasher13::new());
    let Stack {
        outlines,
        kinds,
        layers,
        scale: _,
        keep_out,
        kept_out_mm2,
        skirt_around,
        transform,
        start,
        is_last,
        may_leave_out,
    } = stack;
    let around: Option<&[Region]> = *skirt_around;
    let written = write!(
        text,
        "{program}|{settings:?}|{outlines:?}|{kinds:?}|{layers:?}|{keep_out:?}|{kept_out_mm2:?}|\
         {around:?}|{transform:?}|{start:?}|{is_last}|{may_leave_out}"
    );
    debug_assert!(written.is_ok());
    text.0.finish128().as_u128()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drive::test_streams::spiral;
    use crate::geometry::Point2;

    /// Goal: a piece comes back bit for bit, and one that was damaged or cut anywhere does not.
    #[test]
    fn a_damaged_piece_is_none() {
        let piece = Piece {
            stream: spiral(2.0),
            swept: vec![(3, Swept::default())],
            open: vec![OpenGround {
                area_mm2: 0.25,
                at: Point2::new(1.0, 1.0 / 3.0),
                layer: 3,
                layers: 2,
            }],
            ..Piece::default()
        };
        let bytes = piece.to_bytes().expect("bytes");
        assert_eq!(Piece::from_bytes(&bytes), Some(piece));
        for place in (0..bytes.len()).step_by(7) {
            let mut damaged = bytes.clone();
            damaged[place] ^= 0x10;
            assert_eq!(Piece::from_bytes(&damaged), None, "byte {place}");
            assert_eq!(Piece::from_bytes(&bytes[..place]), None, "cut at {place}");
        }
    }
}
