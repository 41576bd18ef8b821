//! Curves over time in stacked panels: thinned to the pixels' resolution without losing extremes.

use super::canvas::{FAINT, INK, round_length_mm, white_page};
use crate::job::MotionState;
use std::fmt::Write;
use svg::Document;
use svg::node::element::{Group, Line, Path, Rectangle, Text};

const PLOT_WIDTH_PX: f64 = 1000.0;
const PANEL_HEIGHT_PX: f64 = 150.0;
const GAP_PX: f64 = 46.0;
const LEFT_PX: f64 = 76.0;
const TOP_PX: f64 = 84.0;
const RIGHT_PX: f64 = 130.0;
const COLOURS: [&str; 8] = [
    "#2b6cb0", "#dd6b20", "#2f855a", "#9b2c2c", "#6b46c1", "#b7791f", "#2c7a7b", "#d53f8c",
];

/// One curve: (s, value) in order of time.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    /// Name in the legend; empty for none.
    pub name: String,
    /// Points.
    pub points: Vec<[f64; 2]>,
}

/// Curves with a common vertical axis.
#[derive(Clone, Debug, PartialEq)]
pub struct Panel {
    /// The quantity shown, with its unit.
    pub title: String,
    /// A dashed line: the limit.
    pub limit: Option<f64>,
    /// The curves.
    pub curves: Vec<Curve>,
}

/// The complete sheet.
#[derive(Clone, Debug, PartialEq)]
pub struct TimePlots {
    /// Title of the sheet.
    pub title: String,
    /// Length of the time axis.
    pub duration_s: f64,
    /// (from s, to s, state of the head), for the background.
    pub bands: Vec<(f64, f64, MotionState)>,
    /// Panels from the top.
    pub panels: Vec<Panel>,
}

/// Draws the sheet.
pub fn draw(plots: &TimePlots) -> String {
    let height = TOP_PX + plots.panels.len() as f64 * (PANEL_HEIGHT_PX + GAP_PX);
    let width = LEFT_PX + PLOT_WIDTH_PX + RIGHT_PX;
    let mut document = Document::new()
        .set("viewBox", format!("0 0 {width:.0} {height:.0}"))
        .set("width", format!("{width:.0}"))
        .set("height", format!("{height:.0}"))
        .set("font-family", "system-ui, sans-serif")
        .set("font-size", 13)
        .set("fill", INK)
        .add(white_page())
        .add(label(&plots.title, LEFT_PX, 28.0, "start").set("font-size", 20))
        .add(band_legend());
    for (number, panel) in plots.panels.iter().enumerate() {
        let top = TOP_PX + number as f64 * (PANEL_HEIGHT_PX + GAP_PX);
        document = document.add(draw_panel(plots, panel, top));
    }
    document.to_string()
}

fn band_colour(state: MotionState) -> &'static str {
    match state {
        MotionState::Print => "#ebf8ff",
        MotionState::Travel => "#ffffff",
        MotionState::Prime => "#c6f6d5",
        MotionState::Retract => "#fed7d7",
        MotionState::Hold => "#e2e8f0",
    }
}

fn band_legend() -> Group {
    let mut group = Group::new();
    let states = [
        (MotionState::Print, "print"),
        (MotionState::Travel, "travel"),
        (MotionState::Prime, "prime"),
        (MotionState::Retract, "retract"),
    ];
    for (number, (state, name)) in states.into_iter().enumerate() {
        let x = LEFT_PX + 110.0 * number as f64;
        group = group
            .add(
                Rectangle::new()
                    .set("x", x)
                    .set("y", 42)
                    .set("width", 22)
                    .set("height", 13)
                    .set("fill", band_colour(state))
                    .set("stroke", FAINT)
                    .set("stroke-width", 0.5),
            )
            .add(label(name, x + 29.0, 53.0, "start"));
    }
    group
}

/// Vertical and horizontal scales of a panel.
struct Scales {
    low: f64,
    high: f64,
    top_px: f64,
    duration_s: f64,
}

impl Scales {
    fn x_px(&self, time_s: f64) -> f64 {
        LEFT_PX + PLOT_WIDTH_PX * time_s / self.duration_s
    }

    fn y_px(&self, value: f64) -> f64 {
        self.top_px + PANEL_HEIGHT_PX * (self.high - value) / (self.high - self.low)
    }
}

fn draw_panel(plots: &TimePlots, panel: &Panel, top_px: f64) -> Group {
    let (low, high) = value_range(panel);
    let scales = Scales {
        low,
        high,
        top_px,
        duration_s: plots.duration_s.max(1e-9),
    };
    let mut group =
        Group::new().add(label(&panel.title, LEFT_PX, top_px - 8.0, "start").set("font-size", 15));
    group = group
        .add(draw_bands(plots, &scales))
        .add(draw_axes(&scales));
    if let Some(limit) = panel.limit {
        let y = scales.y_px(limit);
        group = group.add(
            line(LEFT_PX, y, LEFT_PX + PLOT_WIDTH_PX, y)
                .set("stroke", "#e53e3e")
                .set("stroke-dasharray", "6 4"),
        );
        group = group.add(label(
            "limit",
            LEFT_PX + PLOT_WIDTH_PX + 8.0,
            y + 4.0,
            "start",
        ));
    }
    for (number, curve) in panel.curves.iter().enumerate() {
        let colour = COLOURS[number % COLOURS.len()];
        group = group.add(
            Path::new()
                .set("d", curve_data(curve, &scales))
                .set("fill", "none")
                .set("stroke", colour)
                .set("stroke-width", 1.1)
                .set("stroke-linejoin", "round"),
        );
        if !curve.name.is_empty() {
            let y = top_px + 28.0 + 18.0 * number as f64;
            let name = label(&curve.name, LEFT_PX + PLOT_WIDTH_PX + 8.0, y, "start");
            group = group.add(name.set("fill", colour));
        }
    }
    group
}

fn draw_bands(plots: &TimePlots, scales: &Scales) -> Group {
    let mut group = Group::new();
    for &(from_s, to_s, state) in &plots.bands {
        let x = scales.x_px(from_s);
        group = group.add(
            Rectangle::new()
                .set("x", format!("{x:.2}"))
                .set("y", scales.top_px)
                .set("width", format!("{:.2}", (scales.x_px(to_s) - x).max(0.0)))
                .set("height", PANEL_HEIGHT_PX)
                .set("fill", band_colour(state)),
        );
    }
    group
}

fn draw_axes(scales: &Scales) -> Group {
    let bottom = scales.top_px + PANEL_HEIGHT_PX;
    let right = LEFT_PX + PLOT_WIDTH_PX;
    let mut group = Group::new().set("stroke-width", 0.6);
    for value in ticks(scales.low, scales.high, 5.0) {
        let y = scales.y_px(value);
        group = group
            .add(line(LEFT_PX, y, right, y).set("stroke", "#cbd5e0"))
            .add(label(&tick_text(value), LEFT_PX - 8.0, y + 4.0, "end"));
    }
    for time_s in ticks(0.0, scales.duration_s, 10.0) {
        let x = scales.x_px(time_s);
        group = group
            .add(line(x, bottom, x, bottom + 5.0).set("stroke", INK))
            .add(label(
                &format!("{} s", tick_text(time_s)),
                x,
                bottom + 18.0,
                "middle",
            ));
    }
    group.add(
        Rectangle::new()
            .set("x", LEFT_PX)
            .set("y", scales.top_px)
            .set("width", PLOT_WIDTH_PX)
            .set("height", PANEL_HEIGHT_PX)
            .set("fill", "none")
            .set("stroke", INK),
    )
}

/// Range of the curves, the limit where it is near, and zero; never empty.
fn value_range(panel: &Panel) -> (f64, f64) {
    let values = panel.curves.iter().flat_map(|c| &c.points).map(|p| p[1]);
    let (mut low, mut high) = values
        .filter(|v| v.is_finite())
        .fold((0.0f64, 0.0f64), |(low, high), v| (low.min(v), high.max(v)));
    if let Some(limit) = panel.limit {
        high = high.max(limit);
    }
    if high - low < 1e-9 {
        high = low + 1.0;
    }
    let room = 0.06 * (high - low);
    if low < 0.0 {
        low -= room;
    }
    (low, high + room)
}

fn ticks(low: f64, high: f64, wanted: f64) -> Vec<f64> {
    let step = round_length_mm((high - low) / wanted * 1.6);
    let first = (low / step).ceil() as i64;
    (first..)
        .map(|k| k as f64 * step)
        .take_while(|&v| v <= high)
        .take(50)
        .collect()
}

fn tick_text(value: f64) -> String {
    let text = format!("{value:.3}");
    text.trim_end_matches('0').trim_end_matches('.').to_string()
}

/// Path data with at most four points a pixel: first, least, greatest, last.
fn curve_data(curve: &Curve, scales: &Scales) -> String {
    let mut data = String::new();
    let mut write_point = |point: &[f64; 2]| {
        let command = if data.is_empty() { 'M' } else { 'L' };
        let (x, y) = (scales.x_px(point[0]), scales.y_px(point[1]));
        // Writing to a String cannot fail.
        let _ = write!(data, "{command}{x:.1} {y:.1}");
    };
    let column = |point: &[f64; 2]| scales.x_px(point[0]).floor() as i64;
    for group in curve.points.chunk_by(|a, b| column(a) == column(b)) {
        let by_value = |a: &&[f64; 2], b: &&[f64; 2]| a[1].total_cmp(&b[1]);
        let mut kept: Vec<&[f64; 2]> = [group.first(), group.last()]
            .into_iter()
            .chain([group.iter().min_by(by_value), group.iter().max_by(by_value)])
            .flatten()
            .collect();
        kept.sort_by(|a, b| a[0].total_cmp(&b[0]));
        kept.dedup();
        kept.into_iter().for_each(&mut write_point);
    }
    data
}

fn line(x1: f64, y1: f64, x2: f64, y2: f64) -> Line {
    Line::new()
        .set("x1", format!("{x1:.2}"))
        .set("y1", format!("{y1:.2}"))
        .set("x2", format!("{x2:.2}"))
        .set("y2", format!("{y2:.2}"))
}

fn label(text: &str, x: f64, y: f64, anchor: &str) -> Text {
    Text::new(text)
        .set("x", format!("{x:.1}"))
        .set("y", format!("{y:.1}"))
        .set("text-anchor", anchor)
}
