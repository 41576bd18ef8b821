//! A sheet for pictures in part coordinates: mm, y up -> pixels, with title, legend, scale bar.

use crate::geometry::Point2;
use crate::geometry::polygon::{Box2, Region};
use std::fmt::Write;
use svg::Document;
use svg::node::element::{Circle, Group, Line, Path, Rectangle, Text};

/// Longest side of the drawing, px.
const DRAWING_PX: f64 = 1000.0;
/// White around the drawing, px.
const MARGIN_PX: f64 = 24.0;
/// Height kept for the title, px.
const TITLE_PX: f64 = 40.0;
/// Width of the legend: its longest entry at 15 px, px.
const LEGEND_PX: f64 = 330.0;
/// Least height of the drawing, so that the legend fits next to a flat part, px.
const HEIGHT_MIN_PX: f64 = 260.0;

pub(super) const INK: &str = "#1a202c";
pub(super) const FAINT: &str = "#718096";

/// How an entry of the legend is drawn.
#[derive(Clone, Copy)]
pub(super) enum Swatch {
    /// A filled box.
    Fill(&'static str),
    /// A line of a width, dashed or not.
    Line(&'static str, f64, bool),
    /// A dot.
    Dot(&'static str),
}

/// The sheet while it is drawn.
pub(super) struct Canvas {
    document: Document,
    low: Point2,
    px_per_mm: f64,
    top_px: f64,
    left_px: f64,
    drawing_width_px: f64,
    drawing_height_px: f64,
    legend_rows: usize,
}

/// The background of a sheet, which is read on dark pages as well.
pub(super) fn white_page() -> Rectangle {
    Rectangle::new()
        .set("width", "100%")
        .set("height", "100%")
        .set("fill", "white")
}

impl Canvas {
    /// An empty sheet that shows `area`.
    pub(super) fn new(area: Box2, title: &str) -> Canvas {
        let size = area.size();
        let longest = size.x.max(size.y).max(1e-6);
        let px_per_mm = DRAWING_PX / longest;
        let drawing_width_px = size.x * px_per_mm;
        let drawing_height_px = (size.y * px_per_mm).max(HEIGHT_MIN_PX);
        let width = drawing_width_px + 3.0 * MARGIN_PX + LEGEND_PX;
        let height = TITLE_PX + drawing_height_px + 2.0 * MARGIN_PX;
        let document = Document::new()
            .set("viewBox", format!("0 0 {width:.0} {height:.0}"))
            .set("width", format!("{width:.0}"))
            .set("height", format!("{height:.0}"))
            .set("font-family", "system-ui, sans-serif")
            .add(white_page())
            .add(
                Text::new(title)
                    .set("x", MARGIN_PX)
                    .set("y", 30)
                    .set("font-size", 20)
                    .set("fill", INK),
            );
        Canvas {
            document,
            low: area.min,
            px_per_mm,
            top_px: TITLE_PX + MARGIN_PX,
            left_px: MARGIN_PX,
            drawing_width_px,
            drawing_height_px,
            legend_rows: 0,
        }
    }

    pub(super) fn px_per_mm(&self) -> f64 {
        self.px_per_mm
    }

    /// Pixel coordinates of a point.
    pub(super) fn px(&self, p: Point2) -> (f64, f64) {
        (
            self.left_px + (p.x - self.low.x) * self.px_per_mm,
            self.top_px + self.drawing_height_px - (p.y - self.low.y) * self.px_per_mm,
        )
    }

    pub(super) fn add(&mut self, path: Path) {
        let document = std::mem::replace(&mut self.document, Document::new());
        self.document = document.add(path);
    }

    pub(super) fn add_group(&mut self, group: Group) {
        let document = std::mem::replace(&mut self.document, Document::new());
        self.document = document.add(group);
    }

    /// Path data of a polyline, closed or open.
    pub(super) fn line_data(&self, data: &mut String, points: &[Point2], closed: bool) {
        for (number, &point) in points.iter().enumerate() {
            let (x, y) = self.px(point);
            let command = if number == 0 { 'M' } else { 'L' };
            // Writing to a String cannot fail.
            let _ = write!(data, "{command}{x:.2} {y:.2}");
        }
        if closed && !points.is_empty() {
            data.push('Z');
        }
    }

    /// Path data of regions, holes included, for the even-odd rule.
    pub(super) fn region_data(&self, regions: &[Region]) -> String {
        let mut data = String::new();
        for ring in regions.iter().flat_map(Region::rings) {
            self.line_data(&mut data, &ring.points, true);
        }
        data
    }

    /// Dots of a pixel radius.
    pub(super) fn dots(&mut self, points: &[Point2], radius_px: f64, fill: &str) {
        let mut group = Group::new()
            .set("fill", fill)
            .set("stroke", "white")
            .set("stroke-width", 0.8);
        for &point in points {
            let (x, y) = self.px(point);
            group = group.add(
                Circle::new()
                    .set("cx", format!("{x:.2}"))
                    .set("cy", format!("{y:.2}"))
                    .set("r", radius_px),
            );
        }
        self.add_group(group);
    }

    /// A word or number next to a point, legible on lines.
    pub(super) fn label(&mut self, point: Point2, text: &str) {
        let (x, y) = self.px(point);
        let text = Text::new(text)
            .set("x", format!("{:.1}", x + 6.0))
            .set("y", format!("{:.1}", y - 6.0))
            .set("font-size", 13)
            .set("fill", INK)
            .set("stroke", "white")
            .set("stroke-width", 3)
            .set("paint-order", "stroke");
        self.add_group(Group::new().add(text));
    }

    /// One more row of the legend.
    pub(super) fn legend(&mut self, swatch: Swatch, text: &str) {
        let x = self.left_px + self.drawing_width_px + MARGIN_PX;
        let y = self.top_px + 12.0 + 24.0 * self.legend_rows as f64;
        self.legend_rows += 1;
        let mut group = Group::new();
        group = match swatch {
            Swatch::Fill(colour) => group.add(
                Rectangle::new()
                    .set("x", x)
                    .set("y", y - 7.0)
                    .set("width", 26)
                    .set("height", 14)
                    .set("fill", colour)
                    .set("stroke", FAINT)
                    .set("stroke-width", 0.5),
            ),
            Swatch::Line(colour, width, dashed) => {
                let mut line = Line::new()
                    .set("x1", x)
                    .set("x2", x + 26.0)
                    .set("y1", y)
                    .set("y2", y)
                    .set("stroke", colour)
                    .set("stroke-width", width);
                if dashed {
                    line = line.set("stroke-dasharray", "5 3");
                }
                group.add(line)
            }
            Swatch::Dot(colour) => group.add(
                Circle::new()
                    .set("cx", x + 13.0)
                    .set("cy", y)
                    .set("r", 5)
                    .set("fill", colour),
            ),
        };
        group = group.add(
            Text::new(text)
                .set("x", x + 36.0)
                .set("y", y + 5.0)
                .set("font-size", 14)
                .set("fill", INK),
        );
        self.add_group(group);
    }

    /// The finished picture, with its scale bar.
    pub(super) fn finish(mut self) -> String {
        let x = self.left_px + self.drawing_width_px + MARGIN_PX;
        let y = self.top_px + 40.0 + 24.0 * self.legend_rows as f64;
        let length_mm = round_length_mm(160.0 / self.px_per_mm);
        let length_px = length_mm * self.px_per_mm;
        let tick = |at: f64| {
            Line::new()
                .set("x1", at)
                .set("x2", at)
                .set("y1", y - 5.0)
                .set("y2", y + 5.0)
        };
        let bar = Group::new()
            .set("stroke", INK)
            .set("stroke-width", 1.5)
            .add(
                Line::new()
                    .set("x1", x)
                    .set("x2", x + length_px)
                    .set("y1", y)
                    .set("y2", y),
            )
            .add(tick(x))
            .add(tick(x + length_px));
        let text = Group::new().add(
            Text::new(format!("{length_mm} mm"))
                .set("x", x)
                .set("y", y + 22.0)
                .set("font-size", 14)
                .set("fill", INK),
        );
        self.add_group(bar);
        self.add_group(text);
        self.document.to_string()
    }
}

/// The largest of 1, 2, 5 times a power of ten that is not above `wanted_mm`.
fn round_length_mm(wanted_mm: f64) -> f64 {
    let power = 10f64.powf(wanted_mm.max(1e-9).log10().floor());
    [5.0, 2.0, 1.0]
        .into_iter()
        .map(|digit| digit * power)
        .find(|&length| length <= wanted_mm)
        .unwrap_or(power)
}
