//! Notes on a path in space: its surface, its placement, singular points, collisions.

use crate::job::transform::PartTransform;
use crate::pipeline::Plan;
use crate::plan::judge::touches::{HeadPart, Touches};
use crate::plan::motion::best_place::FoundPlace;
use crate::plan::motion::singular::SingularPlaces;
use crate::report::figures::{CornerFigures, PieceFigures};
use crate::settings::Settings;

/// Slowing that is worth a note, s.
const SLOWING_TOLD_S: f64 = 0.1;

/// One line each.
pub(super) fn run_notes(plan: &Plan, settings: &Settings) -> Vec<String> {
    let notes = [
        on_surface(plan),
        seams(plan),
        sharp_bend(plan),
        curved_layers(plan),
        edge_depth(plan, settings),
        hangs(plan),
        pieces(plan),
        left_out(plan),
        found_place(plan.found_place, &plan.transform),
        leans(plan),
        singular_places(&plan.singular),
        rounded_corners(plan, settings),
        head_unknown(plan, settings),
    ];
    let notes = notes.into_iter().flatten();
    notes.chain(plan.jumps.notes()).collect()
}

/// How the surface was used.
fn on_surface(plan: &Plan) -> Option<String> {
    let laid = plan.on_surface.as_ref()?;
    let (off_mm, [x, y, z]) = (laid.off_mm, laid.off_at_mm);
    let [least, most] = laid.scales;
    Some(format!(
        "the surface is smoothed, at most {off_mm:.3} mm off the mesh, near ({x:.2}, {y:.2}, {z:.2}); the tool axis \
         leans by up to {:.1}° under the plan, and lengths range by {:.1} % in the plane that it is made in",
        laid.tilt_max_rad.to_degrees(),
        100.0 * (most / least - 1.0),
    ))
}

/// How a surface was cut into patches.
fn seams(plan: &Plan) -> Option<String> {
    let seams = plan.on_surface.as_ref()?.seams?;
    Some(format!(
        "the surface cannot be flattened whole: it is printed in {} patches, joined along {:.1} mm of seams, where {:.3} mm² \
         stay open",
        seams.patches, seams.length_mm, seams.open_mm2
    ))
}

/// Where a flat nozzle does not fit the surface.
fn sharp_bend(plan: &Plan) -> Option<String> {
    let bend = plan.on_surface.as_ref()?.sharp_bend?;
    let [x, y, z] = bend.at_mm;
    Some(format!(
        "the surface bends with a radius of {:.2} mm near ({x:.2}, {y:.2}, {z:.2}): the ends of the flat nozzle are up \
         to {:.3} mm off it there, more than a tenth of a layer",
        bend.radius_mm, bend.off_mm
    ))
}

/// What curved layers leave of the stairs.
fn curved_layers(plan: &Plan) -> Option<String> {
    let curved = plan.curved_layers.as_ref()?;
    let ([flat, own], [flat_mm3, own_mm3]) = (curved.layers, curved.stair_error_mm3);
    Some(format!(
        "{own} curved layers and {flat} flat ones leave {own_mm3:.2} mm³ between the printed top and the part's, flat layers \
         alone {flat_mm3:.2}; they are {:.2} to {:.2} times as thick as nominal and slope by up to {:.1}°",
        curved.thickness[0],
        curved.thickness[1],
        curved.slope_max_rad.to_degrees()
    ))
}

/// How deep a nozzle that stays upright goes into its layer.
fn edge_depth(plan: &Plan, settings: &Settings) -> Option<String> {
    let deepest = plan.curved_layers.as_ref()?.edge_depth?;
    let [x, y, z] = deepest.at_mm;
    Some(format!(
        "the nozzle stays upright: its edge is up to {:.3} mm ({:.2} layers) below the top of the layer that it prints, near \
         ({x:.2}, {y:.2}, {z:.2})",
        deepest.depth_mm,
        deepest.depth_mm / settings.layer_height_mm
    ))
}

/// What of a part in curved layers hangs.
fn hangs(plan: &Plan) -> Option<String> {
    let (area_mm2, [x, y, z]) = plan.curved_layers.as_ref()?.hanging?;
    Some(format!(
        "{area_mm2:.2} mm² hang farther than half a bead over what is below, the most near ({x:.2}, {y:.2}, {z:.2}), and neither \
         supports nor bridges are made with curved layers: turn the part (--rotate) or print supports with it"
    ))
}

/// What of a part in pieces hangs.
fn pieces(plan: &Plan) -> Option<String> {
    let figures = &plan.pieces.as_ref()?.figures;
    let sum = |of: fn(&PieceFigures) -> f64| figures.iter().map(of).sum::<f64>();
    let [upright_mm2, left_mm2] = [sum(|of| of.overhang_upright_mm2), sum(|of| of.overhang_mm2)];
    if figures.len() == 1 {
        return Some(format!(
            "no piece with a direction of its own is worth its time: the part is printed whole, and {left_mm2:.2} mm² of it hang"
        ));
    }
    let worst = figures
        .iter()
        .zip(0..)
        .max_by(|a, b| a.0.overhang_mm2.total_cmp(&b.0.overhang_mm2))?;
    let worst = match worst {
        (worst, _) if worst.overhang_mm2 <= 0.0 => String::new(),
        (worst, 0) => format!(
            ", {:.2} of them at the rest, which is upright",
            worst.overhang_mm2
        ),
        (worst, piece) => format!(", {:.2} of them at piece {piece}", worst.overhang_mm2),
    };
    Some(format!(
        "{} pieces after the rest: {left_mm2:.2} mm² of the part hang as they are printed instead of {upright_mm2:.2}{worst}; layers are counted on from piece to piece",
        figures.len() - 1
    ))
}

/// Regions that are not printed, their number and area in words.
pub(super) fn not_printed(count: usize, area_mm2: f64) -> String {
    match count {
        1 => format!("1 region, {area_mm2:.3} mm², is not printed"),
        _ => format!("{count} regions, {area_mm2:.3} mm², are not printed"),
    }
}

/// Regions that are not printed.
fn left_out(plan: &Plan) -> Option<String> {
    let all_mm2: f64 = plan.left_out.iter().map(|own| own.area_mm2).sum();
    let largest = plan.left_out.iter();
    let largest = largest.max_by(|a, b| a.area_mm2.total_cmp(&b.area_mm2))?;
    Some(format!(
        "{}; the largest: {:.3} mm² near ({:.2}, {:.2}) on layer {}: {}",
        not_printed(plan.left_out.len(), all_mm2),
        largest.area_mm2,
        largest.at.x,
        largest.at.y,
        largest.layer + 1,
        largest.why
    ))
}

/// The position that was found.
pub(super) fn found_place(found: Option<FoundPlace>, transform: &PartTransform) -> Option<String> {
    let found = found?;
    let [x, y, z] = transform.offset_mm;
    if found.tried == 1 {
        return Some(format!(
            "--place best: at {x:.3},{y:.3},{z:.3}, in the middle: this machine reaches every place alike"
        ));
    }
    Some(format!(
        "--place best: at {x:.3},{y:.3},{z:.3}; of {} positions tried the machine reaches all of it at {}",
        found.tried, found.reached
    ))
}

/// Tilt of the tool axis.
fn leans(plan: &Plan) -> Option<String> {
    let leaned = plan.leaned.as_ref()?;
    let [passes, all] = leaned.passes;
    let lean_deg = leaned.lean_max_rad.to_degrees();
    Some(format!(
        "--tilt-max: the tool axis is tilted by up to {lean_deg:.1}° on {passes} of {all} passes to keep clear"
    ))
}

/// A note that collisions were not checked, if a tilting head has no shape.
fn head_unknown(plan: &Plan, settings: &Settings) -> Option<String> {
    let tilts = settings.tilts();
    let is_run = plan.kinds.is_empty() || plan.curved_layers.is_some();
    (plan.touches.is_none() && tilts && is_run).then(|| {
        String::from(
            "whether the head touches table or print was not looked at: its shape is not in the \
             machine file ([head])",
        )
    })
}

/// What nozzle and head touch.
pub(super) fn touches(touches: &Touches, transform: &PartTransform) -> Option<String> {
    let told: Vec<String> = touches
        .deepest
        .iter()
        .map(|touch| {
            let (part, obstacle) = (touch.part.name(), touch.obstacle.name());
            let [x, y, z] = transform.to_input(touch.tip_mm);
            format!(
                "{part} is {:.2} mm in {obstacle} with the tip at ({x:.3}, {y:.3}, {z:.3})",
                touch.depth_mm
            )
        })
        .collect();
    let is_tip = touches
        .deepest
        .iter()
        .any(|touch| touch.part == HeadPart::Tip);
    let slack = match is_tip {
        true => format!(
            "; the flat end may dip by {:.2} mm (tip_slack_mm in [head] of the machine file)",
            touches.tip_slack_mm
        ),
        false => String::new(),
    };
    (!told.is_empty()).then(|| {
        format!(
            "TOUCHES on {:.1} mm of the path: {}{slack}",
            touches.touched_mm,
            told.join(", ")
        )
    })
}

/// How the run gets past places where two rotary axes line up, and what that costs.
fn singular_places(singular: &SingularPlaces) -> Option<String> {
    let SingularPlaces {
        places,
        led_by_rad,
        slowing_s,
        lifts,
        lifting_s,
    } = *singular;
    let led_by_deg = led_by_rad.to_degrees();
    let places_of = if places == 1 { "place" } else { "places" };
    let lined_up = format!("two rotary axes line up at {places} {places_of} of the path");
    match slowing_s {
        _ if places == 0 => None,
        None if lifts > 0 => Some(format!(
            "{lined_up}: the joints would have to jump there, so the head lifts off {lifts} times and goes on \
             with the table turned, which costs about {lifting_s:.1} s and leaves a joint in the bead each time; \
             a larger --axis-tolerance passes without"
        )),
        None => Some(format!(
            "{lined_up}: the joints would have to jump there, and the tool axis is led past by up to \
             {led_by_deg:.2}° (--axis-tolerance)"
        )),
        Some(slowing_s) if led_by_rad > 0.0 => Some(format!(
            "{lined_up}: the tool axis is led past by up to {led_by_deg:.2}° (--axis-tolerance), which \
             saves about {slowing_s:.1} s of slowing"
        )),
        Some(slowing_s) if slowing_s >= SLOWING_TOLD_S => Some(format!(
            "{lined_up}: slowing there costs about {slowing_s:.1} s"
        )),
        Some(_) => None,
    }
}

/// The result of rounding the corners; `None` if none were to be rounded.
pub(super) fn corner_figures(plan: &Plan, settings: &Settings) -> Option<CornerFigures> {
    let is_laid = plan.on_surface.is_some() || plan.curved_layers.is_some();
    let is_run = plan.kinds.is_empty() && !is_laid;
    let told = &plan.rounded;
    (is_run && settings.tolerances.corner_mm > 0.0).then(|| CornerFigures {
        path: told.path as u64,
        path_off_mm: told.path_off_mm,
        axis: told.axis as u64,
        axis_off_deg: told.axis_off_rad.to_degrees(),
        heading_off_deg: told.heading_off_rad.to_degrees(),
        rests: told.rests as u64,
    })
}

/// The same in words.
fn rounded_corners(plan: &Plan, settings: &Settings) -> Option<String> {
    let told = corner_figures(plan, settings)?;
    let corners = |count: u64| if count == 1 { "corner" } else { "corners" };
    let mut parts = Vec::new();
    if told.path > 0 {
        parts.push(format!(
            "{} {} of the path rounded by up to {:.3} mm",
            told.path,
            corners(told.path),
            told.path_off_mm
        ));
    }
    if told.axis > 0 {
        parts.push(format!(
            "{} {} of the tool axis rounded by up to {:.3}°",
            told.axis,
            corners(told.axis),
            told.axis_off_deg
        ));
    }
    if told.heading_off_deg >= 0.01 {
        let heading_deg = told.heading_off_deg;
        parts.push(format!("headings there off by up to {heading_deg:.2}°"));
    }
    if parts.is_empty() {
        parts.push("no corner rounded".to_string());
    }
    if told.rests > 0 {
        parts.push(format!(
            "at {} {} the head rests all the same (sharp, or no room within the tolerances)",
            told.rests,
            corners(told.rests)
        ));
    }
    Some(format!("--corner-tolerance: {}", parts.join(", ")))
}
