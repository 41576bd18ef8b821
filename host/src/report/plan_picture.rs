//! The plan in the style of the published method's figures: outline, medial axis, passes in two
//! zones, nozzle outlines at their headings, interruptions.

use super::canvas::{Canvas, FAINT, INK, Swatch};
use super::plan_marks::{Colouring, draw_marks, draw_values, mark_legend, value_legend};
use crate::geometry::aperture::Aperture;
use crate::geometry::clearance::Configuration;
use crate::geometry::polygon::{Box2, Region};
use crate::geometry::{Point2, Vector2};
use std::fmt::Write;
use svg::node::element::Path;

/// Most nozzle outlines that are drawn; more would only blacken the sheet.
const OUTLINES_MAX: f64 = 3000.0;

const TWO_PASS: &str = "#2b6cb0";
const ONE_PASS: &str = "#dd6b20";
const INFILL: &str = "#6b46c1";
const SKIRT: &str = "#38a169";
const PRINTED: &str = "#2c7a7b";
const TRAVEL: &str = "#9b2c2c";
const START: &str = "#2f855a";
const KEEP_OUT: &str = "#a0aec0";
const UNREACHABLE: &str = "#d53f8c";

/// Zone, fill of its nozzles, colour of its lines, name.
const ZONES: [(Zone, &str, &str, &str); 5] = [
    (
        Zone::TwoPass,
        "#bee3f8",
        TWO_PASS,
        "printed path, two beads or more across",
    ),
    (
        Zone::OnePass,
        "#feebc8",
        ONE_PASS,
        "printed path, one bead across",
    ),
    (Zone::Infill, "#e9d8fd", INFILL, "infill"),
    (Zone::Skirt, "#c6f6d5", SKIRT, "skirt and brim"),
    (Zone::Unknown, "#b2f5ea", PRINTED, "printed path"),
];

/// Which rule a placement follows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Zone {
    /// Between a wall and a neighbour.
    TwoPass,
    /// Between both walls.
    OnePass,
    /// A line of the infill.
    Infill,
    /// Around the part.
    Skirt,
    /// Not known: a job file does not contain it.
    Unknown,
}

/// One pass.
#[derive(Clone, Debug, PartialEq)]
pub struct PicturePass {
    /// Placements along it, with the zone of each.
    pub placements: Vec<(Configuration, Zone)>,
    /// The tip's speed at each; empty if it is not known.
    pub speeds_mm_s: Vec<f64>,
}

/// The data drawn, mm, in the input's coordinates.
#[derive(Clone, Debug)]
pub struct PlanPicture<'a> {
    /// Title of the sheet.
    pub title: &'a str,
    /// The outline.
    pub regions: &'a [Region],
    /// Keep-outs of nozzle and body.
    pub keep_out: &'a [Region],
    /// The nozzle.
    pub aperture: Aperture,
    /// Branches of the medial axis.
    pub axis: Vec<Vec<Point2>>,
    /// Passes in order.
    pub passes: Vec<PicturePass>,
    /// Travel moves between passes.
    pub travel: Vec<Vec<Point2>>,
    /// Parts of the boundary that no placement inside touches.
    pub unreachable: Vec<Vec<Point2>>,
    /// What the passes' lines are coloured by.
    pub colouring: Colouring,
}

/// Draws the sheet.
pub fn draw(picture: &PlanPicture) -> String {
    let mut canvas = Canvas::new(shown_area(picture), picture.title);
    let outline = canvas.region_data(picture.regions);
    canvas.add(
        Path::new()
            .set("d", outline.clone())
            .set("fill", "#edf2f7")
            .set("fill-rule", "evenodd"),
    );
    if !picture.keep_out.is_empty() {
        let kept_out = canvas.region_data(picture.keep_out);
        canvas.add(
            Path::new()
                .set("d", kept_out)
                .set("fill", KEEP_OUT)
                .set("fill-opacity", 0.6)
                .set("fill-rule", "evenodd"),
        );
    }
    draw_nozzles(&mut canvas, picture);
    draw_lines(&mut canvas, &picture.axis, FAINT, 0.8, "6 3");
    if picture.colouring == Colouring::Zone {
        draw_passes(&mut canvas, picture);
    }
    draw_values(&mut canvas, picture);
    draw_lines(&mut canvas, &picture.travel, TRAVEL, 1.2, "4 3");
    canvas.add(
        Path::new()
            .set("d", outline)
            .set("fill", "none")
            .set("stroke", INK)
            .set("stroke-width", 1.4),
    );
    draw_lines(&mut canvas, &picture.unreachable, UNREACHABLE, 4.0, "none");
    let ends = |last: bool| -> Vec<Point2> {
        picture
            .passes
            .iter()
            .filter_map(|pass| {
                let end = if last {
                    pass.placements.last()
                } else {
                    pass.placements.first()
                };
                end.map(|(at, _)| at.center)
            })
            .collect()
    };
    canvas.dots(&ends(true), 4.5, TRAVEL);
    canvas.dots(&ends(false), 3.5, START);
    draw_marks(&mut canvas, picture);
    draw_legend(&mut canvas, picture);
    canvas.finish()
}

/// The box of the outline, and of the print around it.
fn shown_area(picture: &PlanPicture) -> Box2 {
    let mut corners: Vec<Point2> = picture
        .regions
        .iter()
        .chain(picture.keep_out)
        .map(Region::bounds)
        .flat_map(|b| [b.min, b.max])
        .collect();
    let around = corners.is_empty();
    let placements = picture.passes.iter().flat_map(|pass| &pass.placements);
    let outside = placements.filter(|(_, zone)| around || *zone == Zone::Skirt);
    let outline_corners = corners.len();
    corners.extend(outside.map(|(at, _)| at.center));
    if corners.len() > outline_corners {
        return Box2::of(&corners).grown(picture.aperture.major_mm());
    }
    Box2::of(&corners)
}

fn draw_legend(canvas: &mut Canvas, picture: &PlanPicture) {
    canvas.legend(Swatch::Line(INK, 1.4, false), "outline");
    if !picture.axis.is_empty() {
        canvas.legend(Swatch::Line(FAINT, 0.8, true), "medial axis");
    }
    for (zone, _, colour, name) in ZONES {
        let placements = || picture.passes.iter().flat_map(|pass| &pass.placements);
        let is_shown = picture.colouring == Colouring::Zone;
        if is_shown && placements().any(|(_, its_zone)| *its_zone == zone) {
            canvas.legend(Swatch::Line(colour, 1.6, false), name);
        }
    }
    value_legend(canvas, picture);
    mark_legend(canvas, picture);
    if !picture.keep_out.is_empty() {
        canvas.legend(Swatch::Fill(KEEP_OUT), "keep-out");
    }
    let [length, width] = picture
        .aperture
        .sizes_mm()
        .map(|mm| (mm * 1e6).round() / 1e6);
    canvas.legend(
        Swatch::Fill("#bee3f8"),
        &format!("nozzle {length} x {width} mm"),
    );
    canvas.legend(Swatch::Dot(START), "pass starts (prime)");
    canvas.legend(Swatch::Dot(TRAVEL), "pass ends (retract)");
    canvas.legend(
        Swatch::Line(TRAVEL, 1.2, true),
        "flow interruption (travel)",
    );
    if !picture.unreachable.is_empty() {
        canvas.legend(
            Swatch::Line(UNREACHABLE, 4.0, false),
            "unreachable boundary",
        );
    }
}

fn draw_lines(canvas: &mut Canvas, lines: &[Vec<Point2>], colour: &str, width: f64, dash: &str) {
    let mut data = String::new();
    for line in lines {
        canvas.line_data(&mut data, line, false);
    }
    canvas.add(
        Path::new()
            .set("d", data)
            .set("fill", "none")
            .set("stroke", colour)
            .set("stroke-width", width)
            .set("stroke-linejoin", "round")
            .set("stroke-dasharray", dash),
    );
}

/// Centre lines, one path for each zone; a change of zone belongs to both.
fn draw_passes(canvas: &mut Canvas, picture: &PlanPicture) {
    for (zone, _, colour, _) in ZONES {
        let mut data = String::new();
        for pass in &picture.passes {
            for run in pass.placements.chunk_by(|one, next| one.1 == next.1) {
                if run[0].1 == zone {
                    let points: Vec<Point2> = run.iter().map(|(at, _)| at.center).collect();
                    canvas.line_data(&mut data, &points, false);
                }
            }
        }
        canvas.add(
            Path::new()
                .set("d", data)
                .set("fill", "none")
                .set("stroke", colour)
                .set("stroke-width", 1.6),
        );
    }
}

/// Nozzle outlines at even steps of travel and turning.
fn draw_nozzles(canvas: &mut Canvas, picture: &PlanPicture) {
    let major_mm = picture.aperture.major_mm();
    let step_of = |one: &Configuration, next: &Configuration| {
        (next.center - one.center).norm() + major_mm * (next.heading_rad - one.heading_rad).abs()
    };
    let total_mm: f64 = picture
        .passes
        .iter()
        .flat_map(|pass| pass.placements.windows(2))
        .map(|pair| step_of(&pair[0].0, &pair[1].0))
        .sum();
    let spacing_mm = (total_mm / OUTLINES_MAX).max(1.2 * major_mm);
    for (zone, fill, stroke, _) in ZONES {
        let mut data = String::new();
        for pass in &picture.passes {
            let mut since_mm = f64::INFINITY;
            let mut before: Option<&Configuration> = None;
            for (at, its_zone) in &pass.placements {
                since_mm += before.map_or(0.0, |previous| step_of(previous, at));
                before = Some(at);
                if since_mm >= spacing_mm {
                    since_mm = 0.0;
                    if *its_zone == zone {
                        nozzle_data(canvas, &mut data, &picture.aperture, at);
                    }
                }
            }
        }
        canvas.add(
            Path::new()
                .set("d", data)
                .set("fill", fill)
                .set("fill-opacity", 0.55)
                .set("stroke", stroke)
                .set("stroke-width", 0.7),
        );
    }
}

/// Pieces of an outline with round corners.
const OUTLINE_PIECES: usize = 48;

/// Path data of one placed aperture.
fn nozzle_data(canvas: &Canvas, data: &mut String, aperture: &Aperture, at: &Configuration) {
    match *aperture {
        Aperture::Rounded(_) => {
            let outline = aperture.outline(at.heading_rad, OUTLINE_PIECES);
            let points: Vec<Point2> = outline.into_iter().map(|q| at.center + q).collect();
            canvas.line_data(data, &points, true);
        }
        Aperture::Ellipse { major_mm, minor_mm } => {
            let along = Vector2::new(at.heading_rad.cos(), at.heading_rad.sin()) * major_mm;
            let (x1, y1) = canvas.px(at.center + along);
            let (x2, y2) = canvas.px(at.center - along);
            let rx = major_mm * canvas.px_per_mm();
            let ry = minor_mm * canvas.px_per_mm();
            // The sheet's y points down: the angle is reversed.
            let turn_deg = -at.heading_rad.to_degrees().rem_euclid(180.0);
            let arc = format!("A{rx:.2} {ry:.2} {turn_deg:.1} 0 1");
            // Writing to a String cannot fail.
            let _ = write!(
                data,
                "M{x1:.2} {y1:.2}{arc} {x2:.2} {y2:.2}{arc} {x1:.2} {y1:.2}Z"
            );
        }
    }
}
