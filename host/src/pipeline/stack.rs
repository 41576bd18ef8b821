//! One stack of layers -> its plan: the stages are run once for a prism, and for a few layers at a
//! time for a part with changing layers.

use super::{Plan, PlanError};
use crate::geometry::place_scale::ScaleField;
use crate::geometry::polygon::{Box2, Region};
use crate::geometry::{Point2, Vector2};
use crate::job::transform::PartTransform;
use crate::pipeline::layer_time::lay_with_layer_times;
use crate::plan::judge::measure::{MeasuredPrint, measure};
use crate::plan::layers::PlanePass;
use crate::plan::layers::layer_groups::{self, LayerGroup, LayerKind, RegionPrint, StackLayer};
use crate::plan::layers::region_plan::RegionPlan;
use crate::plan::layers::region_plan::region_work::RegionWork;
use crate::plan::layers::skirt::{SkirtPlan, skirt_plan};
use crate::plan::outline::contour::{Contour, SIMPLIFY_MM};
use crate::plan::progress::{Progress, Stage, step_each};
use crate::plan::route::build_route::{build_route, lift_at_end};
use crate::plan::route::keep_out::taken;
use crate::plan::route::moves::Route;
use crate::plan::route::travel::{TravelWays, outline_crossings};
use crate::settings::Settings;
use headway_protocol::units::{CHANNEL_X, CHANNEL_Y, CHANNELS};
use serde::{Deserialize, Serialize};

/// A region that is not printed, and the others are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LeftOut {
    /// The first layer that has it, from 0.
    pub layer: u32,
    /// A place in it, input coordinates.
    #[serde(with = "crate::geometry::as_numbers")]
    pub at: Point2,
    /// Its area.
    pub area_mm2: f64,
    /// Why.
    pub why: String,
}

/// The regions planned together.
pub(crate) struct Stack<'a> {
    /// The different outlines without the keep-outs.
    pub outlines: Vec<Vec<Region>>,
    /// The kinds of layer, each of one of the outlines.
    pub kinds: Vec<LayerKind>,
    /// The layers, upwards, each of one of the kinds.
    pub layers: Vec<StackLayer>,
    /// The keep-outs, input coordinates.
    pub keep_out: &'a [Region],
    /// Area lost to that.
    pub kept_out_mm2: f64,
    /// The regions inside a skirt; `None` above the first layer.
    pub skirt_around: Option<&'a [Region]>,
    /// Size of the nozzle by position, if the outlines are in the chart of a curved surface.
    pub scale: Option<&'a ScaleField>,
    /// Position of the part on the machine.
    pub transform: PartTransform,
    /// The head's pose before, at rest; `None` if it begins at rest on its first pass, with no material laid: its plan
    /// then does not depend on what was printed before.
    pub start: Option<[f64; CHANNELS]>,
    /// The head lifts off at the end.
    pub is_last: bool,
    /// Regions that fail are omitted, and the stack may be empty.
    pub may_leave_out: bool,
}

impl Stack<'_> {
    /// From input coordinates to those of the machine, mm.
    pub(crate) fn shift(&self) -> Vector2 {
        let [x, y, ..] = self.transform.offset_mm;
        Vector2::new(x, y)
    }

    /// Regions in coordinates of the machine.
    pub(crate) fn on_machine(&self, regions: &[Region]) -> Vec<Region> {
        let shift = self.shift();
        regions.iter().map(|region| region.shifted(shift)).collect()
    }

    /// The regions of one of its layers.
    pub(crate) fn outline_of(&self, layer: u32) -> &[Region] {
        &self.outlines[self.outline_number(layer)]
    }

    /// The middle of the lowest layer, input coordinates: nowhere is it far from there.
    fn middle(&self) -> Point2 {
        let lowest = self
            .layers
            .first()
            .map(|layer| self.outline_of(layer.number));
        let corners: Vec<Point2> = (lowest.unwrap_or_default().iter())
            .flat_map(|region| [region.bounds().min, region.bounds().max])
            .collect();
        let bounds = Box2::of(&corners);
        bounds.min + bounds.size() / 2.0
    }

    fn outline_number(&self, layer: u32) -> usize {
        let of = self.layers.partition_point(|of| of.number < layer);
        self.kinds[self.layers[of].kind].outline
    }
}

/// Regions in progress, `[outline][region]`, the widest disk in them, and the omitted ones.
struct Begun {
    works: Vec<Vec<RegionWork>>,
    widest: Option<(Point2, f64)>,
    left_out: Vec<LeftOut>,
}

/// A stack up to its route.
pub(crate) struct RoutedStack {
    pub left_out: Vec<LeftOut>,
    pub skirt: Option<SkirtPlan>,
    pub kinds: Vec<LayerGroup>,
    pub prints: Vec<RegionPrint>,
    pub curves: Vec<PlanePass>,
    pub print_of_curve: Vec<usize>,
    pub route: Route,
    pub outline_crossings: usize,
}

/// Plans a stack: one line for each stage.
///
/// # Errors
/// [`PlanError`].
pub(crate) fn plan_stack(
    stack: &Stack,
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<Plan, PlanError> {
    let transform = stack.transform;
    let RoutedStack {
        left_out,
        skirt,
        kinds,
        prints,
        curves,
        print_of_curve,
        mut route,
        outline_crossings,
    } = route_stack(stack, settings, progress)?;
    let (stream, motion, slowed) = lay_with_layer_times(&mut route, settings, progress)?;
    let (figures, measured) = measure(
        &stream,
        &printings(&kinds, &prints),
        &print_of_curve,
        &transform,
        settings,
        progress,
    );
    Ok(Plan {
        transform,
        keep_out: stack.keep_out.to_vec(),
        kept_out_mm2: stack.kept_out_mm2,
        left_out,
        skirt,
        kinds,
        prints,
        curves,
        print_of_curve,
        outline_crossings,
        slowed,
        route,
        stream,
        motion,
        measured,
        figures,
        ..Plan::default()
    })
}

/// The stages of a stack before time.
///
/// # Errors
/// [`PlanError`].
pub(crate) fn route_stack(
    stack: &Stack,
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<RoutedStack, PlanError> {
    let transform = stack.transform;
    let from = match stack.start {
        Some(start) => Point2::new(start[CHANNEL_X], start[CHANNEL_Y]) - stack.shift(),
        None => stack.middle(),
    };
    let begun = begin(stack, settings, progress)?;
    let kinds = layer_groups::layer_groups(&begun.works, &stack.kinds, &stack.layers, progress)?;
    let mut all = kinds.iter().flat_map(|kind| &kind.regions);
    if !stack.may_leave_out && all.all(RegionPlan::is_empty) {
        return Err(super::error::nothing_printable(begun.widest, settings));
    }
    let mut left_out = begun.left_out;
    left_out.extend(too_narrow(&kinds));
    let taken = taken(stack.keep_out, settings);
    let skirt = stack.skirt_around.map(|around| {
        let skirt = skirt_plan(around, &taken, from, settings)?;
        Ok::<_, PlanError>(skirt)
    });
    let skirt = skirt.transpose()?.flatten();
    let from = skirt.as_ref().and_then(SkirtPlan::end).unwrap_or(from);
    let prints = layer_groups::region_prints(&kinds, &stack.layers, from);
    let (curves, print_of_curve) = layer_groups::plane_passes(
        skirt.as_ref(),
        &kinds,
        &prints,
        &stack.layers,
        &transform,
        settings,
    )?;
    if curves.is_empty() && !stack.may_leave_out {
        return Err(super::error::nothing_printable(begun.widest, settings));
    }
    let (route, outline_crossings) = route_of(stack, &curves, settings)?;
    Ok(RoutedStack {
        left_out,
        skirt,
        kinds,
        prints,
        curves,
        print_of_curve,
        route,
        outline_crossings,
    })
}

/// The regions of all outlines with their axes.
fn begin(stack: &Stack, settings: &Settings, progress: &dyn Progress) -> Result<Begun, PlanError> {
    let outlines = stack.outlines.iter().enumerate();
    let all: Vec<(usize, &Region)> = outlines
        .flat_map(|(number, regions)| regions.iter().map(move |region| (number, region)))
        .collect();
    let contours = step_each(progress, Stage::Contour, all, |(number, region)| {
        let contour = Contour::of_region(region, SIMPLIFY_MM).map_err(PlanError::from);
        Ok::<_, PlanError>((number, region, carried(contour, stack)?))
    })?;
    let begun = step_each(
        progress,
        Stage::Axis,
        contours,
        |(number, region, contour)| {
            let work =
                contour.and_then(|contour| Ok(RegionWork::begin(contour, stack.scale, settings)?));
            Ok::<_, PlanError>((number, region, carried(work, stack)?))
        },
    )?;
    let mut works: Vec<Vec<RegionWork>> = stack.outlines.iter().map(|_| Vec::new()).collect();
    let mut left_out = Vec::new();
    for (number, region, work) in begun {
        match work {
            Ok(work) => works[number].push(work),
            Err(error) => left_out.push(LeftOut {
                layer: first_layer(stack, |kind| kind.outline == number),
                at: nalgebra::center(&region.bounds().min, &region.bounds().max),
                area_mm2: region.area_mm2(),
                why: error.to_string(),
            }),
        }
    }
    let widest = works.iter().flatten().filter_map(RegionWork::widest_disk);
    Ok(Begun {
        widest: widest.max_by(|a, b| a.1.total_cmp(&b.1)),
        works,
        left_out,
    })
}

/// A failure that is kept while the others continue; else it ends the plan.
fn carried<T>(
    found: Result<T, PlanError>,
    stack: &Stack,
) -> Result<Result<T, PlanError>, PlanError> {
    match found {
        Err(error) if !stack.may_leave_out => Err(error),
        found => Ok(found),
    }
}

fn first_layer(stack: &Stack, of: impl Fn(&LayerKind) -> bool) -> u32 {
    let mut layers = stack.layers.iter();
    let layer = layers.find(|layer| of(&stack.kinds[layer.kind]));
    layer.map_or(0, |layer| layer.number)
}

/// Regions in which no bead fits.
fn too_narrow(kinds: &[LayerGroup]) -> Vec<LeftOut> {
    let mut found: Vec<LeftOut> = Vec::new();
    for kind in kinds {
        for region in kind.regions.iter().filter(|region| region.is_empty()) {
            found.push(LeftOut {
                layer: kind.first_layer,
                at: region.middle(),
                area_mm2: region.contour.region.area_mm2(),
                why: "too narrow for the aperture".to_string(),
            });
        }
    }
    found
}

/// The route over all layers, with travel inside each one's own area, and the number of times that
/// travel leaves it.
fn route_of(
    stack: &Stack,
    curves: &[PlanePass],
    settings: &Settings,
) -> Result<(Route, usize), PlanError> {
    let keep_out = stack.on_machine(stack.keep_out);
    let outline_of = |layer: u32| stack.outline_number(layer);
    let mut route = Route::default();
    let (mut at, mut number, mut crossings) = (stack.start, 0, 0);
    for curves in curves.chunk_by(|p, q| outline_of(p.layer) == outline_of(q.layer)) {
        let ground = stack.on_machine(stack.outline_of(curves[0].layer));
        let mut ways = TravelWays::new(&keep_out, &ground, settings)?;
        let of_outline = build_route(curves, number, at, &mut ways, stack.scale, settings);
        let of_outline = of_outline.map_err(|error| error.shifted(-stack.shift()))?;
        crossings += outline_crossings(&of_outline, &ground);
        number += curves.len() as u32;
        route.moves.extend(of_outline.moves);
        at = route.end().or(at);
    }
    if stack.is_last {
        lift_at_end(&mut route, settings);
    }
    Ok((route, crossings))
}

/// The printings of regions, as they are measured.
pub(crate) fn printings<'a>(
    kinds: &'a [LayerGroup],
    prints: &[RegionPrint],
) -> Vec<MeasuredPrint<'a>> {
    let prints = prints.iter();
    prints
        .map(|print| MeasuredPrint {
            contour: &kinds[print.kind].regions[print.region].contour,
            layer: print.layer,
            like: print.like,
        })
        .collect()
}
