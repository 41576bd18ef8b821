//! Marks on a plan's passes for papers: their direction, their order, colours by a value.
//!
//! In: passes as placements (mm, rad) with speeds (mm/s). Out: paths and labels on the canvas. The colours are those
//! of the report's page, in a few steps that a legend names. Not covered: the rest of the sheet (`plan_picture`).

use super::canvas::{Canvas, INK, Swatch};
use super::plan_picture::{PicturePass, PlanPicture};
use crate::geometry::{Point2, Vector2};
use std::fmt::Write;
use svg::node::element::Path;

/// Most arrows of a sheet.
const ARROWS_MAX: f64 = 400.0;
/// Nearest distance of two arrows along a pass, px.
const ARROW_EVERY_PX: f64 = 70.0;
/// Length of an arrow, px.
const ARROW_PX: f64 = 9.0;
/// Passes whose numbers are written; more would only blacken the sheet.
const NUMBERS_MAX: usize = 300;

/// Rising in lightness (viridis).
const RISING: &[&str] = &[
    "#440154", "#46327f", "#365c8d", "#277f8e", "#1fa187", "#4ac26d", "#9fda3a", "#fde725",
];
/// Ending where it begins, for headings.
const ROUND: &[&str] = &[
    "#c9b8c9", "#708cbe", "#55338c", "#2f1436", "#8c2850", "#be7864",
];

/// What the lines of passes are coloured by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "command", derive(clap::ValueEnum))]
pub enum Colouring {
    /// The rule that each pass follows; a job from a file has one colour.
    #[default]
    Zone,
    /// When it is printed.
    Order,
    /// Speed of the tip.
    Speed,
    /// Width of the bead.
    Width,
    /// Heading.
    Heading,
}

impl Colouring {
    /// Text of the legend, and the unit.
    fn name(self) -> [&'static str; 2] {
        match self {
            Colouring::Zone => ["", ""],
            Colouring::Order => ["order", "% of the layer"],
            Colouring::Speed => ["speed", "mm/s"],
            Colouring::Width => ["bead width", "mm"],
            Colouring::Heading => ["heading", "°"],
        }
    }

    fn colours(self) -> &'static [&'static str] {
        match self {
            Colouring::Heading => ROUND,
            _ => RISING,
        }
    }
}

/// Centre lines coloured by a value, and the legend's rows for it; nothing by zone.
pub(super) fn draw_values(canvas: &mut Canvas, picture: &PlanPicture) {
    let colouring = picture.colouring;
    if colouring == Colouring::Zone {
        return;
    }
    let values = values(picture);
    let [low, high] = range(picture, &values);
    let colours = colouring.colours();
    let bin_of = |value: f64| {
        let share = (value - low) / (high - low).max(1e-9);
        ((share * colours.len() as f64) as usize).min(colours.len() - 1)
    };
    let mut data = vec![String::new(); colours.len()];
    for (pass, values) in picture.passes.iter().zip(&values) {
        let bins: Vec<usize> = values.iter().map(|&value| bin_of(value)).collect();
        let mut first = 0;
        for run in bins.chunk_by(|a, b| a == b) {
            // A run extends to the start of the next one.
            let end = (first + run.len() + 1).min(pass.placements.len());
            let points = pass.placements[first..end].iter();
            let points: Vec<Point2> = points.map(|(at, _)| at.center).collect();
            canvas.line_data(&mut data[run[0]], &points, false);
            first += run.len();
        }
    }
    for (data, colour) in data.into_iter().zip(colours) {
        canvas.add(
            Path::new()
                .set("d", data)
                .set("fill", "none")
                .set("stroke", *colour)
                .set("stroke-width", 3),
        );
    }
}

/// The legend's rows for a value.
pub(super) fn value_legend(canvas: &mut Canvas, picture: &PlanPicture) {
    let colouring = picture.colouring;
    if colouring == Colouring::Zone {
        return;
    }
    let [low, high] = range(picture, &values(picture));
    let [name, unit] = colouring.name();
    let colours = colouring.colours();
    let step = (high - low) / colours.len() as f64;
    for (number, colour) in colours.iter().enumerate() {
        let from = low + step * number as f64;
        let digits = if high - low < 10.0 { 2 } else { 0 };
        let words = format!("{name} {from:.digits$} to {:.digits$} {unit}", from + step);
        canvas.legend(Swatch::Line(colour, 3.0, false), &words);
    }
}

/// The value at each placement of each pass.
fn values(picture: &PlanPicture) -> Vec<Vec<f64>> {
    let all: usize = picture
        .passes
        .iter()
        .map(|pass| pass.placements.len())
        .sum();
    let mut before = 0;
    let of_pass = |pass: &PicturePass| {
        let values = (0..pass.placements.len()).map(|k| {
            let (at, _) = pass.placements[k];
            match picture.colouring {
                Colouring::Zone => 0.0,
                Colouring::Order => 100.0 * (before + k) as f64 / all as f64,
                Colouring::Speed => pass.speeds_mm_s.get(k).copied().unwrap_or(0.0),
                Colouring::Width => {
                    let along = direction(pass, k);
                    let across = Vector2::new(-along.y, along.x);
                    2.0 * picture.aperture.extent_mm(at.heading_rad, across)
                }
                Colouring::Heading => {
                    let period_rad = picture.aperture.period_rad();
                    at.heading_rad.rem_euclid(period_rad).to_degrees()
                }
            }
        });
        let values: Vec<f64> = values.collect();
        before += values.len();
        values
    };
    picture.passes.iter().map(of_pass).collect()
}

/// From the least value to the greatest; a turn's is its own.
fn range(picture: &PlanPicture, values: &[Vec<f64>]) -> [f64; 2] {
    match picture.colouring {
        Colouring::Heading => [0.0, picture.aperture.period_rad().to_degrees()],
        Colouring::Order => [0.0, 100.0],
        _ => {
            let values = values.iter().flatten();
            let [low, high] = values.fold([f64::INFINITY, 0.0], |[low, high]: [f64; 2], &value| {
                [low.min(value), high.max(value)]
            });
            [low.min(high), high]
        }
    }
}

/// Where a pass goes at a placement; along x if it does not move.
fn direction(pass: &PicturePass, k: usize) -> Vector2 {
    let at = |k: usize| pass.placements[k].0.center;
    let last = pass.placements.len() - 1;
    let chord = at((k + 1).min(last)) - at(k.saturating_sub(1));
    chord.try_normalize(1e-9).unwrap_or_else(Vector2::x)
}

/// Arrows along the passes, and their numbers where they begin.
pub(super) fn draw_marks(canvas: &mut Canvas, picture: &PlanPicture) {
    let length_mm = |pass: &PicturePass| -> f64 {
        let pairs = pass.placements.windows(2);
        pairs
            .map(|pair| (pair[1].0.center - pair[0].0.center).norm())
            .sum()
    };
    let all_mm: f64 = picture.passes.iter().map(length_mm).sum();
    let px_per_mm = canvas.px_per_mm();
    let every_mm = f64::max(ARROW_EVERY_PX / px_per_mm, all_mm / ARROWS_MAX);
    let mut data = String::new();
    for pass in &picture.passes {
        // Half a distance from the start: a short pass has an arrow as well.
        let mut left_mm = 0.5 * every_mm.min(length_mm(pass));
        for (k, pair) in pass.placements.windows(2).enumerate() {
            left_mm -= (pair[1].0.center - pair[0].0.center).norm();
            if left_mm <= 0.0 {
                left_mm += every_mm;
                arrow_data(canvas, &mut data, pair[1].0.center, direction(pass, k));
            }
        }
    }
    canvas.add(
        Path::new()
            .set("class", "direction")
            .set("d", data)
            .set("fill", INK),
    );
    for (number, pass) in picture.passes.iter().take(NUMBERS_MAX).enumerate() {
        if let Some((at, _)) = pass.placements.first() {
            canvas.label(at.center, &(number + 1).to_string());
        }
    }
}

/// A triangle that points along a direction.
fn arrow_data(canvas: &Canvas, data: &mut String, at: Point2, along: Vector2) {
    let (x, y) = canvas.px(at);
    // The sheet's y points down.
    let (dx, dy) = (along.x * ARROW_PX, -along.y * ARROW_PX);
    let corners = [
        (x + 0.5 * dx, y + 0.5 * dy),
        (x - 0.5 * dx - 0.4 * dy, y - 0.5 * dy + 0.4 * dx),
        (x - 0.5 * dx + 0.4 * dy, y - 0.5 * dy - 0.4 * dx),
    ];
    for (number, (x, y)) in corners.into_iter().enumerate() {
        let command = if number == 0 { 'M' } else { 'L' };
        // Writing to a String cannot fail.
        let _ = write!(data, "{command}{x:.1} {y:.1}");
    }
    data.push('Z');
}

/// Rows of the legend for arrows and numbers.
pub(super) fn mark_legend(canvas: &mut Canvas, picture: &PlanPicture) {
    let passes = picture.passes.len();
    let words = match passes {
        0 => return,
        1..=NUMBERS_MAX => "direction; numbers: order of passes".to_string(),
        _ => format!("direction; numbers: first {NUMBERS_MAX} of {passes} passes"),
    };
    canvas.legend(Swatch::Line(INK, 4.0, false), &words);
}
