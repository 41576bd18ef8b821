//! The findings of a plan: its figures, notes for the user, uncovered places.
//!
//! In: a [`Plan`] and the settings in its joint solution. Out: [`Findings`] in input coordinates (mm,
//! s, mm³). The command and library users get the same ones, so that both write the same job. Not
//! covered: figures of the finished stream (limits and bytes), which [`crate::pipeline::packing`]
//! adds.

pub mod gcode;
pub(crate) mod idle_options;
pub mod laid;
pub mod left_out;
pub mod objections;
pub(crate) mod part;
mod run_notes;
pub mod settings_warnings;
pub mod settled_verdict;
pub mod simulated;
pub mod unwinding;
pub mod use_figures;
pub(crate) mod wide_beads;

use crate::drive::evenness::{Uneven, UnevenPlaces};
use crate::drive::time_by_limit::{SlowPlace, TimeByLimit};
use crate::geometry::Point2;
use crate::job::transform::PartTransform;
use crate::pipeline::Plan;
use crate::pipeline::layer_uses::{LayerUse, layer_uses, pass_uses};
use crate::pipeline::open_ground::{self, OpenGround, open_ground, told_mm2};
use crate::pipeline::piece::unreachable_boundary;
use crate::pipeline::stacked_ground::open_cells;
use crate::pipeline::surface::curved_layers::CurvedFigures;
use crate::pipeline::two_bead_walls::TwoBeadWalls;
use crate::plan::judge::figures::PlanFigures;
use crate::plan::judge::touches::Touches;
use crate::plan::layers::layer_groups::LayerGroup;
use crate::plan::outline::unreachable::UnreachableRun;
use crate::plan::pass::{LayerPass, PassKind};
use crate::report::Place;
use crate::report::figures::{
    CurvedLayerFigures, Figures, Inside, KindFigures, LayerPlace, SlowPlaceFigures, UnevenFigures,
};
use crate::settings::Settings;
use left_out::{left_out, longest_first, of_figures};
use objections::Objection;
use run_notes::{corner_figures, run_notes};
use settings_warnings::{high_layers, settings_warnings};
use use_figures::{short_layers_note, stacked_figures, use_figures};
use wide_beads::{Laid, LateLayers};

/// Places of unreachable boundary that are reported one by one.
const PLACES_TOLD: usize = 3;
/// Places of unreachable boundary that the figures list.
const PLACES_LISTED: usize = 1000;

/// Findings of a plan.
#[derive(Clone, Debug)]
pub struct Findings {
    /// Its figures.
    pub figures: Figures,
    /// What keeps it from being good.
    pub objections: Vec<Objection>,
    /// Warnings to check before printing, one line each.
    pub warnings: Vec<String>,
    /// Boundary that cannot be touched.
    pub unreachable: Vec<UnreachableRun>,
    /// Ground and boundary that is not printed, the largest of each first.
    pub left_out: Vec<Place>,
}

/// Findings of a plan that took `plan_s` seconds.
pub fn findings(plan: &Plan, plan_s: f64, settings: &Settings) -> Findings {
    let unreachable = match (&plan.on_surface, &plan.curved_layers, &plan.pieces) {
        (Some(laid), ..) => laid.unreachable.clone(),
        (_, Some(curved), _) => curved.unreachable.clone(),
        (.., Some(pieces)) => pieces.unreachable.clone(),
        _ => unreachable_boundary(plan.regions()),
    };
    let mut warnings = warnings(plan, &unreachable, settings);
    let open = match (&plan.on_surface, &plan.curved_layers, &plan.pieces) {
        (Some(laid), ..) => laid.open_ground(),
        (.., Some(pieces)) => pieces.open.clone(),
        (_, Some(curved), _) => {
            let mut open = curved.open_ground();
            open.extend(open_ground(plan, settings));
            open.sort_by(|a, b| b.area_mm2.total_cmp(&a.area_mm2));
            open
        }
        _ => open_ground(plan, settings),
    };
    let all_mm2 = told_mm2(&open, settings);
    warnings.extend(open_ground::note(&open, all_mm2, |_| None, settings));
    warnings.extend(unwinding::note(&plan.route, &plan.transform, settings));
    warnings.extend(settings_warnings(settings));
    let laid = Laid::NOTHING.with(&plan.stream, settings);
    warnings.extend(laid.rests_note(settings));
    let servo_hz = f64::from(settings.machine.servo_hz);
    let uses = layer_uses(plan, &pass_uses(plan), servo_hz);
    let late = LateLayers::of(&uses, settings);
    let transform = &plan.transform;
    let wide = laid.figures(&late, plan.figures.volume_mm3, transform, settings);
    let mut objections = objections::of_plan(plan);
    objections.extend(laid.objections(&late, transform, settings));
    objections.extend(high_layers(settings.layer_height_mm, settings));
    let mut left_out = left_out(&open, &unreachable, &[]);
    left_out.extend(laid.place(transform));
    let figures = Figures {
        open_largest_mm2: largest_mm2(plan, &open),
        ..all_figures(plan, &unreachable, &uses, plan_s, settings)
    };
    left_out.extend(of_figures(&figures, false));
    Findings {
        figures: figures.merged_with(&wide),
        objections,
        warnings,
        left_out,
        unreachable,
    }
}

/// The largest connected uncovered area; a path has none.
fn largest_mm2(plan: &Plan, open: &[OpenGround]) -> Option<f64> {
    let largest = open.first().map_or(0.0, |piece| piece.area_mm2);
    let is_laid = plan.on_surface.is_some() || plan.curved_layers.is_some();
    (!plan.prints.is_empty() || is_laid).then_some(largest)
}

fn all_figures(
    plan: &Plan,
    unreachable: &[UnreachableRun],
    uses: &[LayerUse],
    plan_s: f64,
    settings: &Settings,
) -> Figures {
    let height_mm = settings.layer_height_mm;
    let place_mm = |layer: u32| [height_mm * f64::from(layer + 1), height_mm];
    let cells = open_cells(plan, settings.aperture.minor_mm());
    let figures = Figures {
        rounded_corners: corner_figures(plan, settings),
        ..plan_figures(plan, unreachable, plan_s, settings)
    };
    figures
        .merged_with(&use_figures(uses, plan.slowed, place_mm, settings))
        .merged_with(&stacked_figures(&cells))
}

/// What a plan of any kind is measured by; a path has no area. `sparse_mm2` is the area that is open on purpose between
/// sparse lines, and what of it is covered.
pub(crate) fn shared_figures(
    f: &PlanFigures,
    has_area: bool,
    [sparse_mm2, swept_mm2]: [f64; 2],
    touches: Option<&Touches>,
) -> Figures {
    let passes = f.passes as u64;
    let of_area = |figure: f64| has_area.then_some(figure);
    let of_sparse = |figure: f64| (sparse_mm2 > 0.0).then_some(figure);
    let all_mm2 = f.area_mm2 * f64::from(f.layers);
    let rest_mm2 = (all_mm2 - sparse_mm2).max(1e-12);
    let covered_mm2 = (0.01 * f.covered_pct * all_mm2 - swept_mm2).max(0.0);
    Figures {
        area_mm2: of_area(f.area_mm2),
        reachable_pct: of_area(f.reachable_pct),
        covered_pct: of_area(f.covered_pct),
        covered_of_reachable_pct: of_area(f.covered_of_reachable_pct),
        outside_depth_mm: of_area(f.outside_depth_mm),
        overlap_pct: of_area(f.overlap_pct),
        sparse_mm2: of_sparse(sparse_mm2),
        sparse_covered_pct: of_sparse(100.0 * swept_mm2 / sparse_mm2),
        solid_covered_pct: of_sparse((100.0 * covered_mm2 / rest_mm2).min(100.0)),
        passes: Some(passes),
        flow_interruptions: Some(passes.saturating_sub(1)),
        touched_mm: touches.map(|touches| touches.touched_mm),
        tip_dip_max_mm: touches.map(|touches| touches.tip_dip_max_mm),
        print_mm: Some(f.print_mm),
        travel_mm: Some(f.travel_mm),
        print_s: Some(f.print_s),
        volume_mm3: Some(f.volume_mm3),
        heading_travel_rad: Some(f.heading_travel_rad),
        heading_rate_max_rad_s: Some(f.heading_rate_max_rad_s),
        ..Figures::default()
    }
}

/// Centre and length of every run.
fn places_of(unreachable: &[UnreachableRun]) -> impl Iterator<Item = [f64; 3]> {
    unreachable.iter().map(|run| {
        let at: Point2 = nalgebra::center(&run.from, &run.to);
        [at.x, at.y, run.length_mm()]
    })
}

fn plan_figures(
    plan: &Plan,
    unreachable: &[UnreachableRun],
    plan_s: f64,
    settings: &Settings,
) -> Figures {
    let f = &plan.figures;
    let left_out = plan.left_out.iter().map(|left_out| LayerPlace {
        x_mm: left_out.at.x,
        y_mm: left_out.at.y,
        z_mm: f64::from(left_out.layer + 1) * settings.layer_height_mm,
        area_mm2: left_out.area_mm2,
    });
    // A path has no area: these figures would mean nothing.
    let is_laid = plan.on_surface.is_some() || plan.curved_layers.is_some();
    let has_area = !plan.regions().is_empty() || is_laid;
    let infill = plan.infill_area_mm2(None);
    let is_stack = f.layers > 1;
    let unreachable_mm: f64 = unreachable.iter().map(UnreachableRun::length_mm).sum();
    let sparse_mm2 = plan.sparse_area_mm2(None).unwrap_or_default();
    Figures {
        layers: is_stack.then_some(u64::from(f.layers)),
        curved_layers: plan.curved_layers.as_ref().map(curved_layer_figures),
        pieces: plan.pieces.as_ref().map(|pieces| pieces.figures.clone()),
        layer_kinds: (is_stack && !plan.kinds.is_empty() && plan.pieces.is_none())
            .then(|| kind_figures(plan)),
        covered_pct_min: is_stack.then_some(f.covered_pct_min),
        overlap_pct_max: is_stack.then_some(f.overlap_pct_max),
        kept_out_mm2: (!plan.keep_out.is_empty()).then_some(plan.kept_out_mm2),
        infill_mm2: infill.map(|[ground, _]| ground),
        infill_covered_pct: infill.map(|[ground, swept]| 100.0 * swept / ground.max(1e-12)),
        // The sum of nothing is -0.
        unreachable_mm: has_area.then_some(unreachable_mm + 0.0),
        unreachable_places_mm: has_area
            .then(|| places_of(unreachable).take(PLACES_LISTED).collect()),
        left_out_places: (!plan.left_out.is_empty())
            .then(|| left_out.take(PLACES_LISTED).collect()),
        outline_crossings: (!plan.regions().is_empty()).then_some(plan.outline_crossings as u64),
        skirt_mm: plan.skirt.is_some().then_some(f.skirt_mm),
        time_bound_s: Some(plan.motion.time_bound_s),
        plan_s: Some(plan_s),
        segments: Some(plan.stream.knots.len() as u64),
        ..shared_figures(f, has_area, sparse_mm2, plan.touches.as_ref())
    }
}

fn curved_layer_figures(curved: &CurvedFigures) -> CurvedLayerFigures {
    CurvedLayerFigures {
        flat_layers: u64::from(curved.layers[0]),
        curved_layers: u64::from(curved.layers[1]),
        stair_error_flat_mm3: curved.stair_error_mm3[0],
        stair_error_mm3: curved.stair_error_mm3[1],
        thickness_min: curved.thickness[0],
        thickness_max: curved.thickness[1],
        slope_max_deg: curved.slope_max_rad.to_degrees(),
        edge_depth_mm: curved.edge_depth.map(|deepest| deepest.depth_mm),
    }
}

/// The infill inside the walls, which is not always the requested one.
fn laid_inside(kind: &LayerGroup) -> Inside {
    let solid_rad = (kind.infill.filter(|infill| infill.is_solid())).map(|infill| infill.angle_rad);
    let open = kind.regions.iter().filter(|region| !region.open.is_empty());
    let (mut lines, mut along, mut loops) = (false, false, false);
    for region in open {
        let has_lines = region.passes.iter().any(|p| p.kind.is_line());
        let solid = region.passes.iter().filter(|p| p.kind == PassKind::Infill);
        let is_along = solid_rad.is_some_and(|angle_rad| is_mostly_aslant(solid, angle_rad));
        lines |= has_lines && !is_along;
        along |= is_along;
        loops |= solid_rad.is_some() && !has_lines;
    }
    match (lines, along, loops) {
        (true, false, false) => Inside::Lines,
        (false, true, false) => Inside::LinesAlong,
        (false, false, true) => Inside::Loops,
        (false, false, false) => Inside::Nothing,
        _ => Inside::LinesAndLoops,
    }
}

/// Whether most of the passes' length is more than a third of a right angle off this direction: lines along a strip.
fn is_mostly_aslant<'a>(passes: impl Iterator<Item = &'a LayerPass>, angle_rad: f64) -> bool {
    let (sin, cos) = angle_rad.sin_cos();
    let [mut aslant_mm, mut all_mm] = [0.0; 2];
    for leg in passes.flat_map(|pass| pass.placements.windows(2)) {
        let [x, y] = {
            let way = leg[1].at.center - leg[0].at.center;
            [way.x, way.y]
        };
        let length_mm = x.hypot(y);
        all_mm += length_mm;
        if (x * sin - y * cos).abs() > 0.5 * length_mm {
            aslant_mm += length_mm;
        }
    }
    aslant_mm > 0.5 * all_mm
}

/// What the layers of each kind came to.
fn kind_figures(plan: &Plan) -> Vec<KindFigures> {
    let kinds = plan.kinds.iter().enumerate();
    kinds
        .map(|(number, kind)| {
            let swept = plan.swept_of_kind(number);
            let infill = plan.infill_area_mm2(Some(number));
            KindFigures {
                first_layer: kind.first_layer,
                layers: kind.layers,
                infill_density_pct: kind.infill.map(|infill| infill.density_pct),
                infill_angle_deg: kind.infill.map(|infill| infill.angle_rad.to_degrees()),
                inside: kind.infill.map(|_| laid_inside(kind)),
                infill_covered_pct: infill.map(|[ground, swept]| 100.0 * swept / ground.max(1e-12)),
                covered_pct: swept.covered_pct(),
                overlap_pct: swept.overlap_pct(),
                outside_depth_mm: swept.outside_depth_mm,
            }
        })
        .collect()
}

/// Points for the user to check before printing.
fn warnings(plan: &Plan, unreachable: &[UnreachableRun], settings: &Settings) -> Vec<String> {
    let length_mm: f64 = unreachable.iter().map(UnreachableRun::length_mm).sum();
    let mut warnings: Vec<String> = unreachable_note(unreachable, length_mm)
        .into_iter()
        .collect();
    warnings.extend(doubled_note(plan.motion.doubled_moves as u64));
    let crowded = plan.skirt.as_ref().map(|skirt| skirt.crowded);
    warnings.extend(crowded_note(crowded));
    warnings.extend(plan.roofs.notes(settings));
    warnings.extend(TwoBeadWalls::of(plan, settings).note(settings));
    warnings.extend(short_layers_note(plan.slowed, settings));
    warnings.extend(run_notes(plan, settings));
    warnings
}

/// The note on moves that kept a limit only when they were slowed as a whole.
pub(crate) fn doubled_note(moves: u64) -> Option<String> {
    (moves > 0).then(|| format!("{moves} moves had to be slowed as a whole to keep the limits"))
}

/// The note on loops of a brim without room.
pub(crate) fn crowded_note(loops: Option<usize>) -> Option<String> {
    let loops = loops.filter(|loops| *loops > 0)?;
    Some(format!(
        "{loops} brim loops around parts inside a hole were left out: there is no room up to its wall"
    ))
}

/// Notes on unreachable boundary: `length_mm` of it over all layers.
pub(crate) fn unreachable_note(unreachable: &[UnreachableRun], length_mm: f64) -> Option<String> {
    let places = longest_first(unreachable).into_iter().take(PLACES_TOLD);
    let places: Vec<String> = places
        .map(|run| {
            let at = nalgebra::center(&run.from, &run.to);
            format!("{:.3} mm near ({:.3}, {:.3})", run.length_mm(), at.x, at.y)
        })
        .collect();
    (length_mm > 0.0).then(|| {
        format!(
            "{length_mm:.3} mm of the boundary cannot be reached by this aperture, in {} places; the \
             longest: {}",
            unreachable.len(),
            places.join(", ")
        )
    })
}

/// How much of the limits is used, which of them take the printing time, and where it is slowest.
pub(crate) fn time_figures(found: TimeByLimit, transform: &PartTransform) -> Figures {
    let place = |place: SlowPlace| {
        let [x_mm, y_mm, _] = transform.to_input(place.at_mm);
        SlowPlaceFigures {
            x_mm,
            y_mm,
            seconds: place.seconds,
            limit: place.limit,
            layer: Some(place.layer),
        }
    };
    let uneven = |(what, found): (Uneven, UnevenPlaces)| {
        let [x_mm, y_mm, z_mm] = transform.to_input(found.at_mm);
        UnevenFigures {
            what: what.name().to_string(),
            places: found.places,
            worst: found.worst,
            x_mm,
            y_mm,
            z_mm,
            layer: found.layer,
        }
    };
    let uneven: Vec<UnevenFigures> = found.uneven.into_iter().map(uneven).collect();
    let [velocity, acceleration, jerk] = found.ratios.map(Some);
    Figures {
        limit_ratio_velocity: velocity,
        limit_ratio_acceleration: acceleration,
        limit_ratio_jerk: jerk,
        time_share_by_limit: (!found.shares.is_empty()).then_some(found.shares),
        slow_places: Some(found.slow_places.into_iter().map(place).collect()),
        uneven_places: (!uneven.is_empty()).then_some(uneven),
        ..Figures::default()
    }
}
