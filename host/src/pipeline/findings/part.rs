//! Findings of a planned part, combined from its blocks of layers.
//!
//! In: the layers of a part, its plan. Out: figures, notes for the user, uncovered places.

use super::Findings;
use super::left_out::{left_out, of_figures};
use super::objections::{Objection, ObjectionKind};
use super::run_notes::{found_place, not_printed};
use super::settings_warnings::{high_layers, settings_warnings};
use super::use_figures::{short_layers_note, stacked_figures, use_figures};
use super::wide_beads::{Laid, LateLayers};
use super::{doubled_note, places_of, shared_figures, unreachable_note};
use crate::geometry::Point2;
use crate::geometry::polygon::Region;
use crate::mesh::layers::SlicedPart;
use crate::pipeline::mesh::{PLACES_MAX, PartPlan};
use crate::pipeline::open_ground;
use crate::pipeline::stack::LeftOut;
use crate::plan::layers::shells::Overhang;
use crate::report::figures::{Figures, LayerPlace};
use crate::settings::Settings;

/// Places of each kind that are reported one by one.
const PLACES_TOLD: usize = 3;

/// Checks a plan that took `plan_s` seconds; `laid` has the findings of its blocks.
pub(crate) fn part_findings(
    part: &SlicedPart,
    planned: &PartPlan,
    laid: &Laid,
    keep_out: &[Region],
    plan_s: f64,
    settings: &Settings,
) -> Findings {
    let late = LateLayers::of(&planned.printed.uses, settings);
    let transform = &planned.transform;
    let wide = laid.figures(
        &late,
        planned.printed.figures.volume_mm3,
        transform,
        settings,
    );
    let figures = Figures {
        plan_s: Some(plan_s),
        ..all_figures(part, planned, keep_out, settings)
    };
    let (open, unreachable) = (&planned.printed.open, &planned.printed.unreachable);
    let mut left_out = left_out(open, unreachable, &planned.printed.unreachable_layers);
    left_out.extend(of_figures(&figures, false));
    left_out.extend(laid.place(transform));
    let mut objections = laid.objections(&late, transform, settings);
    objections.extend(floating(part, planned));
    let heights_mm = part.wanted_layers().iter().map(|layer| layer.height_mm);
    objections.extend(high_layers(heights_mm.fold(0.0, f64::max), settings));
    let mut warnings = warnings(part, planned, settings);
    warnings.extend(laid.rests_note(settings));
    warnings.extend(found_place(planned.found_place, transform));
    Findings {
        figures: figures.merged_with(&wide),
        objections,
        warnings,
        unreachable: planned.printed.unreachable.clone(),
        left_out,
    }
}

/// Overhangs of the layers that are printed.
fn overhangs<'a>(
    part: &'a SlicedPart,
    planned: &'a PartPlan,
) -> impl Iterator<Item = (u32, &'a Overhang)> {
    let all = (0u32..).zip(&planned.overhangs);
    all.filter(|(layer, overhang)| part.wanted.contains(layer) && overhang.area_mm2 > 0.0)
}

/// Areas that no bead below holds, layers without any between others among their causes. The lowest layer that is printed
/// lies on the bed.
fn floating(part: &SlicedPart, planned: &PartPlan) -> Option<Objection> {
    let above = part.wanted.start + 1..part.wanted.end;
    let found = (0u32..).zip(&planned.overhangs);
    let found = found.filter(|(layer, _)| above.contains(layer));
    let found: Vec<(u32, f64, Point2)> = found
        .filter_map(|(layer, overhang)| overhang.floating.map(|(mm2, at)| (layer, mm2, at)))
        .collect();
    let &(layer, mm2, at) = found.iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
    let layers = match found.len() {
        1 => format!("on layer {}", layer + 1),
        count => format!("on {count} layers, the most on layer {}", layer + 1),
    };
    let below = &part.layers[..layer as usize];
    let empty = below
        .iter()
        .rev()
        .take_while(|layer| layer.regions.is_empty());
    let empty = match empty.count() {
        0 => String::new(),
        1 => format!("; layer {layer} is empty"),
        count => format!("; layers {} to {layer} are empty", layer + 1 - count as u32),
    };
    Some(Objection {
        kind: ObjectionKind::Floating,
        text: format!(
            "FLOATS: {mm2:.2} mm² near ({:.2}, {:.2}, {:.2}) {layers} lie on nothing{empty}: turn the part (--rotate), or print \
             supports with it",
            at.x, at.y, part.layers[layer as usize].top_mm
        ),
    })
}

fn all_figures(
    part: &SlicedPart,
    planned: &PartPlan,
    keep_out: &[Region],
    settings: &Settings,
) -> Figures {
    let place_mm = |layer: u32| {
        let layer = &part.layers[layer as usize];
        [layer.top_mm, layer.height_mm]
    };
    let of_uses = use_figures(
        &planned.printed.uses,
        planned.printed.slowed,
        place_mm,
        settings,
    );
    part_figures(part, planned, keep_out)
        .merged_with(&of_uses)
        .merged_with(&stacked_figures(&planned.printed.open_cells))
}

fn part_figures(part: &SlicedPart, planned: &PartPlan, keep_out: &[Region]) -> Figures {
    let f = &planned.printed.figures;
    let [ground_mm2, swept_mm2] = planned.printed.infill_mm2;
    let top_mm = |layer: u32| part.layers[layer as usize].top_mm;
    let mut hanging: Vec<LayerPlace> = overhangs(part, planned)
        .map(|(layer, overhang)| LayerPlace {
            x_mm: overhang.at.x,
            y_mm: overhang.at.y,
            z_mm: top_mm(layer),
            area_mm2: overhang.area_mm2,
        })
        .collect();
    hanging.sort_by(|a, b| b.area_mm2.total_cmp(&a.area_mm2));
    let hanging_mm2: f64 = hanging.iter().map(|place| place.area_mm2).sum::<f64>() + 0.0;
    hanging.truncate(PLACES_MAX);
    let left_out = planned.printed.left_out.iter().map(|left_out| LayerPlace {
        x_mm: left_out.at.x,
        y_mm: left_out.at.y,
        z_mm: top_mm(left_out.layer),
        area_mm2: left_out.area_mm2,
    });
    let unreachable = &planned.printed.unreachable;
    let open = planned.printed.open.first();
    Figures {
        layers: Some(part.wanted_layers().len() as u64),
        covered_pct_min: Some(f.covered_pct_min),
        overlap_pct_max: Some(f.overlap_pct_max),
        kept_out_mm2: (!keep_out.is_empty()).then_some(planned.printed.kept_out_mm2),
        infill_mm2: (ground_mm2 > 0.0).then_some(ground_mm2),
        infill_covered_pct: (ground_mm2 > 0.0).then(|| 100.0 * swept_mm2 / ground_mm2),
        unreachable_mm: Some(planned.printed.unreachable_mm),
        unreachable_places_mm: Some(places_of(unreachable).collect()),
        open_largest_mm2: Some(open.map_or(0.0, |open| open.area_mm2)),
        overhang_mm2: Some(hanging_mm2),
        overhang_places: Some(hanging),
        left_out_places: Some(left_out.take(PLACES_MAX).collect()),
        outline_crossings: Some(planned.printed.outline_crossings),
        skirt_mm: planned.printed.crowded_loops.map(|_| f.skirt_mm),
        segments: Some(planned.segments),
        ..shared_figures(f, true, planned.printed.sparse_mm2, None)
    }
}

/// Points for the user to check before printing.
fn warnings(part: &SlicedPart, planned: &PartPlan, settings: &Settings) -> Vec<String> {
    let mut warnings = part_warnings(part, planned);
    let length_mm = planned.printed.unreachable_mm;
    warnings.extend(unreachable_note(&planned.printed.unreachable, length_mm));
    let top_mm = |layer: u32| Some(part.layers.get(layer as usize)?.top_mm);
    let (open, all_mm2) = (&planned.printed.open, planned.open_mm2);
    warnings.extend(open_ground::note(open, all_mm2, top_mm, settings));
    warnings.extend(planned.roofs.notes(settings));
    warnings.extend(planned.printed.two_bead_walls.note(settings));
    warnings.extend(short_layers_note(planned.printed.slowed, settings));
    warnings.extend(settings_warnings(settings));
    warnings
}

/// Overhangs, omitted regions, slowed layers.
fn part_warnings(part: &SlicedPart, planned: &PartPlan) -> Vec<String> {
    let mut warnings = Vec::new();
    let top_mm = |layer: u32| part.layers[layer as usize].top_mm;
    let mut hanging: Vec<(u32, &Overhang)> = overhangs(part, planned).collect();
    hanging.sort_by(|a, b| b.1.area_mm2.total_cmp(&a.1.area_mm2));
    if !hanging.is_empty() {
        let all_mm2: f64 = hanging.iter().map(|(_, o)| o.area_mm2).sum();
        let told = hanging.iter().take(PLACES_TOLD).map(|(layer, o)| {
            let z_mm = top_mm(*layer);
            format!(
                "{:.2} mm² near ({:.2}, {:.2}, {z_mm:.2})",
                o.area_mm2, o.at.x, o.at.y
            )
        });
        warnings.push(format!(
            "{all_mm2:.2} mm² on {} layers hang farther than half a bead over what is below, and no \
             supports are made: turn the part (--rotate) or print supports with it; the most: {}",
            hanging.len(),
            told.collect::<Vec<_>>().join(", ")
        ));
    }
    let mut left_out: Vec<&LeftOut> = planned.printed.left_out.iter().collect();
    left_out.sort_by(|a, b| b.area_mm2.total_cmp(&a.area_mm2));
    if !left_out.is_empty() {
        let all_mm2: f64 = left_out.iter().map(|l| l.area_mm2).sum();
        let told = left_out.iter().take(PLACES_TOLD).map(|l| {
            let (at, z_mm) = (l.at, top_mm(l.layer));
            format!(
                "{:.3} mm² near ({:.2}, {:.2}, {z_mm:.2}): {}",
                l.area_mm2, at.x, at.y, l.why
            )
        });
        warnings.push(format!(
            "{}; the largest: {}",
            not_printed(left_out.len(), all_mm2),
            told.collect::<Vec<_>>().join("; ")
        ));
    }
    warnings.extend(doubled_note(planned.printed.doubled_moves));
    warnings
}
