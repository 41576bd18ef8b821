//! Outline -> plan: a prism of layers, all of one outline.

use super::stack::{Stack, plan_stack};
use super::{Plan, PlanError, start_pose};
use crate::geometry::Point2;
use crate::geometry::polygon::{Box2, Region};
use crate::input::Target;
use crate::pipeline::error::all_kept_out;
use crate::pipeline::placed_part::placed_part;
use crate::pipeline::roofs::Roofs;
use crate::plan::layers::hollow::{Hollow, bridges_of, wide_spans};
use crate::plan::layers::layer_groups;
use crate::plan::layers::skirt::skirt_reach_mm;
use crate::plan::progress::Progress;
use crate::plan::route::keep_out::cleared;
use crate::plan::route::keep_out::shadows::with_shadows;
use crate::settings::Settings;

/// Plans a target without keep-outs; see [`plan_target_around`].
///
/// # Errors
/// [`PlanError`].
pub fn plan_target(target: &Target, settings: &Settings) -> Result<Plan, PlanError> {
    plan_target_around(target, &[], settings, &())
}

/// Plans a target around keep-outs (input coordinates): the complete pipeline, one line for each
/// stage. `progress` receives its progress (`()` ignores it).
///
/// # Errors
/// [`PlanError`].
pub fn plan_target_around(
    target: &Target,
    keep_out: &[Region],
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<Plan, PlanError> {
    settings.check()?;
    let bounds = target_bounds(target).grown(skirt_reach_mm(settings));
    let height_mm = settings.layer_height_mm * f64::from(settings.layers);
    let placed = placed_part(bounds, [0.0, height_mm], settings)?;
    let (transform, settings) = (placed.transform, &placed.settings);
    let keep_out = &with_shadows(keep_out, &transform, settings);
    let cleared = cleared(&target.regions, keep_out, settings);
    if cleared.regions.is_empty() {
        return Err(all_kept_out());
    }
    let outlines = vec![cleared.regions.as_slice(); settings.layers as usize];
    let (settings, mut roofs) = Roofs::settled(&outlines, settings);
    let settings = &settings;
    let hollow = Hollow::of(&outlines, settings);
    let (kinds, layers) = layer_groups::prism_layers(settings, |layer| {
        bridges_of(hollow.as_ref(), &outlines, layer as usize, settings)
    });
    let bridges = layers.iter().flat_map(|layer| {
        let bridges = kinds[layer.kind].inside.bridges.iter();
        bridges.map(|bridge| (layer.number, bridge))
    });
    roofs.wide = wide_spans(&outlines, bridges, settings);
    let stack = Stack {
        outlines: vec![cleared.regions],
        kinds,
        layers,
        keep_out,
        kept_out_mm2: cleared.lost_mm2,
        skirt_around: Some(&target.regions),
        scale: None,
        transform,
        start: Some(start_pose(settings)),
        is_last: true,
        may_leave_out: false,
    };
    Ok(Plan {
        roofs,
        found_place: placed.found,
        ..plan_stack(&stack, settings, progress)?
    })
}

fn target_bounds(target: &Target) -> Box2 {
    let corners: Vec<Point2> = target
        .regions
        .iter()
        .map(|r| r.bounds())
        .flat_map(|b| [b.min, b.max])
        .collect();
    Box2::of(&corners)
}
