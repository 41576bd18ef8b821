//! A part with changing layers -> one job, planned a few layers at a time.
//!
//! What planning makes of a few layers (walls, passes, curves, rasters) is shown to the caller and
//! dropped before the next ones: beside the outlines only the finished segments grow with the
//! part. The streams of the pieces, each from rest to rest, follow one another ([`SegmentStream::append`]).
//! Layers of a piece are planned side by side; a piece is the same whatever the number of threads.

use crate::geometry::Point2;
use crate::geometry::polygon::{Box2, Region};
use crate::job::SegmentStream;
use crate::layer_stack::{LeftOut, Stack, plan_stack};
use crate::mesh::layers::{SlicedPart, TargetLayer};
use crate::part_transform::PartTransform;
use crate::plan::judge::figures::{PlanFigures, Swept};
use crate::plan::layers::layer_groups::{LayerKind, StackLayer};
use crate::plan::layers::shells::{Overhang, ShellLayers, overhangs, solid_ground};
use crate::plan::layers::skirt::skirt_reach_mm;
use crate::plan::motion::segments::MotionReport;
use crate::plan::progress::Progress;
use crate::plan::route::keep_out::cleared;
use crate::settings::{BOTTOM_LAYERS, Settings, TOP_LAYERS};
use crate::{Plan, PlanError};
use headway_firmware::kinematics::winds;
use headway_protocol::units::CHANNELS;

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
#[derive(Clone, Debug)]
pub struct PartPlan {
    /// Where the part lies on the machine.
    pub transform: PartTransform,
    /// The stream for the controller.
    pub stream: SegmentStream,
    /// What the stream reaches of the limits.
    pub motion: MotionReport,
    /// What the plan is judged on, over all regions and layers.
    pub figures: PlanFigures,
    /// Regions that are not printed.
    pub left_out: Vec<LeftOut>,
    /// Ground given up to keep-outs, all layers together.
    pub kept_out_mm2: f64,
    /// A skirt or brim was printed.
    pub has_skirt: bool,
    /// Travels between passes that leave the regions on their way.
    pub outline_crossings: usize,
    /// What hangs over nothing, by layer of the whole part.
    pub overhangs: Vec<Overhang>,
}

/// Plans the wanted layers of a part around keep-outs (input coordinates). `seen` is shown every
/// piece before it is dropped.
///
/// # Errors
/// [`PlanError`]; a region that cannot be planned is left out instead.
pub fn plan_part(
    part: &SlicedPart,
    keep_out: &[Region],
    first: FirstLayer,
    settings: &Settings,
    progress: &dyn Progress,
    seen: &mut dyn FnMut(&Plan),
) -> Result<PartPlan, PlanError> {
    settings.check()?;
    let is_like_others = |layer: &TargetLayer| {
        let same_height = (layer.height_mm - settings.layer_height_mm).abs() < 1e-9;
        same_height && first.speed_mm_s.is_none()
    };
    if !may_divide(settings) && !part.layers.iter().all(is_like_others) {
        return Err(PlanError::FirstLayerWinds);
    }
    let transform = place(part, settings)?;
    let outlines: Vec<&[Region]> = part.layers.iter().map(|l| l.regions.as_slice()).collect();
    let solid = solid_of(&outlines, settings);
    let mut planned = PartPlan {
        transform,
        stream: SegmentStream::default(),
        motion: MotionReport::default(),
        figures: PlanFigures::default(),
        left_out: Vec::new(),
        kept_out_mm2: 0.0,
        has_skirt: false,
        outline_crossings: 0,
        overhangs: overhangs(&outlines, settings.aperture.major_mm()),
    };
    let mut done = Done {
        at: crate::start_pose(settings),
        ..Done::default()
    };
    let wanted = part.wanted_layers();
    let mut rest = wanted;
    while let Some(lowest) = rest.first() {
        let is_first = lowest.number == wanted[0].number;
        let own = settings_of(lowest, first, settings);
        let (stack, used) = gather(rest, &solid, keep_out, &own, transform, done.at);
        rest = &rest[used..];
        let stack = Stack {
            skirt_around: Some(lowest.regions.as_slice())
                .filter(|regions| is_first && !regions.is_empty()),
            is_last: rest.is_empty(),
            ..stack
        };
        let kept_out_mm2 = stack.kept_out_mm2;
        let plan = plan_stack(stack, &own, progress)?;
        planned.kept_out_mm2 += kept_out_mm2;
        seen(&plan);
        planned.add(plan, &mut done)?;
    }
    if planned.stream.knots.is_empty() {
        return Err(PlanError::NoLayerPrintable {
            left_out: planned.left_out.len(),
        });
    }
    let layers: Vec<u32> = done.swept.iter().map(|(layer, _)| *layer).collect();
    let swept: Vec<Swept> = done.swept.into_iter().map(|(_, swept)| swept).collect();
    planned.figures.set_shares(&layers, &swept);
    Ok(planned)
}

/// True where the pieces of a route can be laid one by one: joints that wind up (arms, turning
/// tables) are followed along the whole of it.
fn may_divide(settings: &Settings) -> bool {
    winds(&settings.machine.kinematics) == 0
}

/// What goes on from piece to piece.
#[derive(Default)]
struct Done {
    at: [f64; CHANNELS],
    swept: Vec<(u32, Swept)>,
}

impl PartPlan {
    /// Takes over what is kept of a piece.
    fn add(&mut self, plan: Plan, done: &mut Done) -> Result<(), PlanError> {
        done.at = plan.route.end().unwrap_or(done.at);
        let layers = plan.prints.iter().map(|print| print.layer);
        done.swept
            .extend(layers.zip(plan.measured.swept.iter().copied()));
        let first_pass = self.figures.passes as u32;
        self.figures.add_lengths(&plan.figures);
        self.left_out.extend(plan.left_out);
        self.has_skirt |= plan.skirt.is_some();
        self.outline_crossings += plan.outline_crossings;
        let motion = &plan.motion;
        self.motion.ratios = self.motion.ratios.max(motion.ratios);
        self.motion.fit_error_ratio = self.motion.fit_error_ratio.max(motion.fit_error_ratio);
        self.motion.doubled_stretches += motion.doubled_stretches;
        self.motion.duration_s += motion.duration_s;
        if plan.stream.knots.is_empty() {
            return Ok(());
        }
        if !self.stream.knots.is_empty() && plan.stream.solution != self.stream.solution {
            return Err(PlanError::AnotherSolution);
        }
        self.stream.append(plan.stream, first_pass);
        Ok(())
    }
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

/// Of each layer what is filled whatever the density.
fn solid_of(outlines: &[&[Region]], settings: &Settings) -> Vec<Vec<Region>> {
    match &settings.infill {
        Some(infill) if !infill.is_solid() => {
            let shells = ShellLayers {
                bottom: infill.bottom_layers.unwrap_or(BOTTOM_LAYERS),
                top: infill.top_layers.unwrap_or(TOP_LAYERS),
            };
            solid_ground(outlines, shells)
        }
        _ => vec![Vec::new(); outlines.len()],
    }
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
    solid: &[Vec<Region>],
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
        transform,
        start,
        is_last: false,
        may_leave_out: true,
    };
    // Outlines as the part has them, before anything is taken from them.
    let mut known: Vec<&[Region]> = Vec::new();
    let may_divide = may_divide(settings);
    let mut used = 0;
    let most = if may_divide {
        LAYERS_AT_A_TIME
    } else {
        usize::MAX
    };
    for layer in layers.iter().take(most) {
        // The first layer may have its own height and speed.
        let is_other = layer.number == 1;
        if used > 0 && may_divide && (is_other || stack.kinds.len() >= KINDS_AT_A_TIME) {
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
        let infill = settings.infill.as_ref();
        let kind = LayerKind {
            outline,
            // Between the solid ground there are no solid layers but those of the shells.
            infill: infill.map(|infill| infill.inside(layer.number)),
            solid: solid[layer.number as usize].clone(),
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
