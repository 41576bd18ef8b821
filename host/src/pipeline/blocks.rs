//! A part divided into blocks: a few layers each, which are planned together and do not depend on other blocks.
//!
//! In: sliced layers (mm), settings. Out: blocks in order, each a [`Stack`] with its settings. Not covered: the travel from
//! one block to the next, which [`super::links`] adds.

use super::PlanError;
use crate::geometry::Point2;
use crate::geometry::polygon::{Box2, Region};
use crate::job::transform::PartTransform;
use crate::mesh::layers::{SlicedPart, TargetLayer};
use crate::pipeline::part_body::PartBody;
use crate::pipeline::piece::{Piece, PieceCache, key_of};
use crate::pipeline::placed_part::{PlacedPart, placed_part};
use crate::pipeline::stack::{Stack, plan_stack};
use crate::plan::layers::layer_groups::{LayerKind, StackLayer};
use crate::plan::layers::skirt::skirt_reach_mm;
use crate::plan::motion::best_place::FoundPlace;
use crate::plan::progress::Progress;
use crate::plan::route::keep_out::cleared;
use crate::plan::route::keep_out::shadows::with_shadows;
use crate::settings::Settings;
use crate::text::refusal::refusal;
use headway_firmware::kinematics::winds;
use std::ops::Range;

/// How the first layer of a part differs from the others.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FirstLayer {
    /// Tip speed while it is printed, mm/s; `None` for that of the others.
    pub speed_mm_s: Option<f64>,
}

/// Most kinds of layer that are planned at a time: what they need is the memory that planning takes.
const KINDS_AT_A_TIME: usize = 8;
/// Most layers at a time, of however few kinds: their routes are written out.
const LAYERS_AT_A_TIME: usize = 64;

/// A part as it is divided into blocks: by its outlines and settings alone.
pub(super) struct Blocks<'a> {
    /// By layer.
    pub outlines: &'a [&'a [Region]],
    /// What is inside its walls.
    pub body: &'a PartBody<'a>,
    keep_out: Vec<Region>,
    /// Where the part goes.
    pub transform: PartTransform,
    /// That it was moved to, if that was requested.
    pub found_place: Option<FoundPlace>,
    first: FirstLayer,
    /// Number of the first of the wanted layers.
    lowest: Option<u32>,
    wanted: usize,
    /// Of the part; a block's own may differ.
    pub settings: &'a Settings,
}

/// Some layers that are planned together.
pub(super) struct Block<'a> {
    pub stack: Stack<'a>,
    pub own: Settings,
    /// Wanted layers before it.
    pub before: usize,
    /// From 0, without the end.
    pub layers: Range<u32>,
}

/// Hands a part's blocks to `planned`.
///
/// # Errors
/// [`PlanError`], also of `planned`.
pub(super) fn with_blocks<T>(
    part: &SlicedPart,
    keep_out: &[Region],
    first: FirstLayer,
    settings: &Settings,
    planned: impl FnOnce(&Blocks) -> Result<T, PlanError>,
) -> Result<T, PlanError> {
    settings.check()?;
    let is_like_others =
        |layer: &TargetLayer| is_as_high(layer, settings) && first.speed_mm_s.is_none();
    if !may_divide(settings) && !part.layers.iter().all(is_like_others) {
        return Err(refusal!(
            "this machine's joints wind up and are planned over all layers at once: leave out \
             --layer-heights, --first-layer-height and --first-layer-speed"
        )
        .into());
    }
    let placed = place(part, settings)?;
    let (transform, settings) = (placed.transform, &placed.settings);
    let outlines: Vec<&[Region]> = part.layers.iter().map(|l| l.regions.as_slice()).collect();
    let body = PartBody::new(&outlines, &part.wanted, settings);
    let wanted = part.wanted_layers();
    let blocks = Blocks {
        outlines: &outlines,
        body: &body,
        keep_out: with_shadows(keep_out, &transform, settings),
        transform,
        found_place: placed.found,
        first,
        lowest: wanted.first().map(|layer| layer.number),
        wanted: wanted.len(),
        settings,
    };
    planned(&blocks)
}

impl Blocks<'_> {
    /// The next block of the layers that are left.
    pub fn next<'b>(&'b self, rest: &mut &'b [TargetLayer]) -> Option<Block<'b>> {
        let settings = self.settings;
        let lowest = rest.first()?;
        let is_first = Some(lowest.number) == self.lowest;
        let own = settings_of(lowest, self.first, settings);
        let (stack, used) = gather(rest, self.body, &self.keep_out, &own, self.transform);
        let before = self.wanted - rest.len();
        let (block, left) = rest.split_at(used);
        *rest = left;
        let end = block.last().map_or(0, |layer| layer.number + 1);
        Some(Block {
            stack: Stack {
                skirt_around: Some(lowest.regions.as_slice())
                    .filter(|regions| is_first && !regions.is_empty()),
                start: is_first.then(|| super::start_pose(settings)),
                is_last: rest.is_empty(),
                ..stack
            },
            own,
            before,
            layers: lowest.number..end,
        })
    }
}

impl Block<'_> {
    /// Takes it from the cache, or plans it and puts it there; whether it was there. `program` is the one that plans.
    pub fn piece(
        &self,
        cache: &mut dyn PieceCache,
        program: &str,
        progress: &dyn Progress,
    ) -> Result<(Piece, bool), PlanError> {
        let key = (cache.keeps()).then(|| key_of(&self.stack, &self.own, program));
        if let Some(known) = key.and_then(|key| cache.get(key)) {
            return Ok((known, true));
        }
        let piece = Piece::of(plan_stack(&self.stack, &self.own, progress)?, &self.own);
        if let Some(key) = key {
            cache.put(key, &piece);
        }
        Ok((piece, false))
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
fn place(part: &SlicedPart, settings: &Settings) -> Result<PlacedPart, PlanError> {
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
    let mut placed = placed_part(bounds, [bottom_mm, top_mm], &stacked)?;
    placed.settings.layers = settings.layers;
    Ok(placed)
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
pub(super) fn gather<'a>(
    layers: &'a [TargetLayer],
    body: &PartBody,
    keep_out: &'a [Region],
    settings: &Settings,
    transform: PartTransform,
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
        start: None,
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
        let inside = body.inside(layer.number);
        let kind = LayerKind { outline, inside };
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
