//! Centre lines of a drawing -> passes to follow: a bead along each line on every layer.
//!
//! ```text
//! CentreLines --sampled, nozzle across--> LayerPass --seam, order--> passes of a layer --> GcodeProgram
//! (mm)                                    (mm, rad)                                        (mm, mm/s)
//! ```
//! In: lines (mm), the bead's width, layers, speed and nozzle of the settings. Out: a program that the pipeline of
//! slicers' files follows, which turns the nozzle so that its bead has this width. Lines are opened at their seams, ordered
//! and turned as passes of an outline are; a pass that begins right above the end of the last one goes on without a retract.
//! Not covered: what beads of lines that meet or cross lay twice.

use crate::gcode::comments::Slicer;
use crate::gcode::{BeadKind, GcodePass, GcodeProgram, Leg, Place, Push};
use crate::geometry::aperture::Aperture;
use crate::geometry::clearance::Configuration;
use crate::geometry::polygon::Region;
use crate::geometry::{Point2, Vector2};
use crate::input::centre_lines::{CentreLine, CentreLines};
use crate::plan::headings::stops::nearest_heading;
use crate::plan::joining::order::ordered;
use crate::plan::joining::seam::with_seam;
use crate::plan::pass::{Contact, LayerPass, PassKind, Placement};
use crate::plan::route::hop::is_right_above;
use crate::settings::Settings;
use crate::text::short_number::Short;
use std::f64::consts::FRAC_PI_2;

/// Places along a closed line at which it may begin, to the aperture's half length.
const PLACES: f64 = 4.0;
const PLACES_MAX: f64 = 20_000.0;
/// Points closer than this to the line between their neighbours are left out again, mm.
const STRAIGHT_MM: f64 = 1e-6;
/// Twice the area by the length of a contour that may be a wall's middle: to the widest bead, and at least mm (slabs have less).
const SLAB_BEADS: f64 = 4.0;
const SLAB_MM: f64 = 50.0;

/// The passes along lines, of a width that the nozzle lays.
pub fn along_lines(drawn: CentreLines, width_mm: f64, settings: &Settings) -> GcodeProgram {
    let aperture = &settings.aperture;
    let leg = Leg {
        line: 0,
        speed_mm_s: settings.speed_mm_s * settings.plan_share,
        width_mm: Some(width_mm),
        height_mm: Some(settings.layer_height_mm),
        volume_mm3: None,
        is_inside: false,
        kind: BeadKind::Wall,
    };
    let lines = (1..).zip(&drawn.lines);
    let of_layer: Vec<LayerPass> = lines
        .map(|(number, line)| with_seam(pass_of(number, line, aperture), &settings.seam, aperture))
        .collect();
    let mut passes: Vec<GcodePass> = Vec::new();
    let first = of_layer.first().and_then(|pass| pass.placements.first());
    let mut from = first.map_or(Point2::origin(), |first| first.at.center);
    for layer in 0..settings.layers {
        let z_mm = f64::from(layer + 1) * settings.layer_height_mm;
        for pass in ordered(of_layer.clone(), from, aperture) {
            let corners = corners(&pass);
            from = *corners.last().unwrap_or(&from);
            let next = GcodePass {
                layer,
                travel: Vec::new(),
                travel_legs: Vec::new(),
                legs: vec![
                    Leg {
                        line: pass.channel as usize,
                        ..leg
                    };
                    corners.len() - 1
                ],
                points: corners.iter().map(|at| place(*at, z_mm)).collect(),
                prime: Some(Push::default()),
                retract: Some(Push::default()),
            };
            passes.push(next);
            arrive(&mut passes, settings);
        }
    }
    let mut notes = drawn.notes;
    notes.push(format!(
        "the lines of the drawing ({}) are printed as beads {} mm wide, each in the middle of its own",
        drawn.lines.len(),
        Short(width_mm)
    ));
    GcodeProgram {
        name: drawn.name,
        slicer: Slicer::Drawing,
        passes,
        heat: Vec::new(),
        left: Vec::new(),
        filament_mm: 1.75,
        estimate_s: None,
        layer_time_min_s: 0.0,
        layers_within: 0,
        has_headings: false,
        has_tilts: false,
        is_declared: false,
        notes,
    }
}

/// What may be a wall's middle line, and is filled: a contour without holes that is far wider than beads, of a drawing
/// that does not say what is filled.
pub fn slab_note(regions: &[Region], settings: &Settings) -> Option<String> {
    let [widest_mm, _] = settings.aperture.sizes_mm();
    let is_slab = |region: &&Region| {
        let across_mm = 2.0 * region.area_mm2() / region.exterior.perimeter_mm();
        region.holes.is_empty() && across_mm > SLAB_MM.max(SLAB_BEADS * widest_mm)
    };
    let slabs: Vec<&Region> = regions.iter().filter(is_slab).collect();
    let area_mm2: f64 = slabs.iter().map(|region| region.area_mm2()).sum();
    (!slabs.is_empty()).then(|| {
        format!(
            "{} contours of the drawing are filled, {area_mm2:.0} mm²: where they are the middle lines of walls, \
             --centre-lines prints each as one bead ({} mm wide, or --bead-width)",
            slabs.len(),
            Short(widest_mm)
        )
    })
}

/// The travel from the pass before to the last one: lifted, unless it begins right above that one's end.
fn arrive(passes: &mut [GcodePass], settings: &Settings) {
    let [.., before, next] = passes else { return };
    let (Some(end), Some(begin)) = (before.points.last(), next.points.first()) else {
        return;
    };
    if is_right_above(begin.tip_mm, end.tip_mm, settings) {
        (before.retract, next.prime) = (None, None);
        return;
    }
    let above_mm = begin.tip_mm[2] + settings.lift_mm;
    let over = |of: &Place| place(Point2::new(of.tip_mm[0], of.tip_mm[1]), above_mm);
    next.travel = vec![over(end), over(begin)];
    next.travel_legs = vec![next.legs[0]; 3];
}

fn place(at: Point2, z_mm: f64) -> Place {
    Place {
        tip_mm: [at.x, at.y, z_mm],
        ..Place::default()
    }
}

/// The nozzle across the line at its corners, of a closed one also between them; the pass has the line's number.
fn pass_of(number: u32, line: &CentreLine, aperture: &Aperture) -> LayerPass {
    let length_mm: f64 = line.edges().map(|[from, to]| (to - from).norm()).sum();
    let step_mm = match line.closed {
        true => (aperture.major_mm() / PLACES).max(length_mm / PLACES_MAX),
        false => f64::INFINITY,
    };
    let mut placements: Vec<Placement> = Vec::new();
    let mut push = |at: Point2, way: Vector2, length_mm: f64| {
        let from_rad = placements.last().map_or(0.0, |last| last.at.heading_rad);
        let across_rad = way.y.atan2(way.x) + FRAC_PI_2;
        let heading_rad = nearest_heading(across_rad, from_rad, aperture.period_rad());
        placements.push(Placement {
            at: Configuration {
                center: at,
                heading_rad,
            },
            feasible: true,
            contact: Contact {
                point: at,
                normal: Vector2::new(-way.y, way.x).normalize(),
                length_mm,
                extent_mm: aperture.major_mm(),
                on_axis: true,
            },
        });
    };
    let mut end = None;
    for [from, to] in line.edges() {
        let way = to - from;
        let steps = (way.norm() / step_mm).ceil().max(1.0);
        for k in 0..steps as usize {
            push(from + way * (k as f64 / steps), way, way.norm() / steps);
        }
        end = Some((to, way));
    }
    if let Some((to, way)) = end.filter(|_| !line.closed) {
        push(to, way, 0.0);
    }
    LayerPass {
        kind: PassKind::OnePass,
        channel: number,
        closed: line.closed,
        placements,
        then: Vec::new(),
    }
}

/// The corners of a pass, without the places between them.
fn corners(pass: &LayerPass) -> Vec<Point2> {
    let mut corners: Vec<Point2> = Vec::new();
    let places: Vec<Point2> = pass.placements.iter().map(|of| of.at.center).collect();
    for (i, at) in places.iter().enumerate() {
        let ends = corners.last().zip(places.get(i + 1));
        let is_between = ends.is_some_and(|(from, to)| {
            let way = to - from;
            let along = (at - from).dot(&way);
            (at - from).perp(&way).abs() <= STRAIGHT_MM * way.norm()
                && along > 0.0
                && along < way.norm_squared()
        });
        if !is_between {
            corners.push(*at);
        }
    }
    corners
}
