//! The reach of a part: share against tilt as bars, and two sections coloured by the least tilt that prints them.
//!
//! In: shares and cells. Out: one SVG.

use super::canvas::{FAINT, INK, white_page};
use svg::Document;
use svg::node::element::{Rectangle, Text};

const WIDTH_PX: f64 = 960.0;
const MARGIN_PX: f64 = 24.0;
const ROW_PX: f64 = 34.0;
const LABEL_PX: f64 = 60.0;
/// By level of tilt, the lowest first.
const COLOURS: [&str; 4] = ["#0f766e", "#3b82f6", "#a855f7", "#f59e0b"];
const LEFT_OUT: &str = "#dc2626";

/// What is drawn.
pub struct ReachPicture<'a> {
    /// Above the picture.
    pub title: &'a str,
    /// By level: its tilt in degrees, found and at most in per cent.
    pub levels: &'a [[f64; 3]],
    /// Cells of the grid along x, y, z.
    pub size: [usize; 3],
    /// Cells, and the first level that prints each.
    pub cells: &'a [([u16; 3], Option<usize>)],
}

fn text(x: f64, y: f64, words: &str) -> Text {
    Text::new(words)
        .set("x", format!("{x:.1}"))
        .set("y", format!("{y:.1}"))
        .set("font-size", 14)
        .set("font-family", "sans-serif")
        .set("fill", INK)
}

fn bar([x, y]: [f64; 2], [width, height]: [f64; 2], fill: &str) -> Rectangle {
    Rectangle::new()
        .set("x", format!("{x:.2}"))
        .set("y", format!("{y:.2}"))
        .set("width", format!("{width:.2}"))
        .set("height", format!("{height:.2}"))
        .set("fill", fill)
}

/// Draws it.
pub fn draw(picture: &ReachPicture) -> String {
    let sections_px = MARGIN_PX + 40.0 + ROW_PX * picture.levels.len() as f64;
    let [nx, ny, nz] = picture.size.map(|n| n as f64);
    let cell_px = (WIDTH_PX - 3.0 * MARGIN_PX) / (nx + ny).max(1.0);
    let height = sections_px + 30.0 + nz * cell_px + MARGIN_PX;
    let mut document = Document::new()
        .set("viewBox", format!("0 0 {WIDTH_PX:.0} {height:.0}"))
        .set("width", format!("{WIDTH_PX:.0}"))
        .add(white_page())
        .add(text(MARGIN_PX, MARGIN_PX + 8.0, picture.title));
    let room = WIDTH_PX - 2.0 * MARGIN_PX - LABEL_PX - 180.0;
    for (level, [tilt_deg, found_pct, bound_pct]) in picture.levels.iter().enumerate() {
        let [x, y] = [
            MARGIN_PX + LABEL_PX,
            MARGIN_PX + 24.0 + ROW_PX * level as f64,
        ];
        let words = format!("{found_pct:.1} .. {bound_pct:.1} %");
        let fill = COLOURS[level.min(COLOURS.len() - 1)];
        document = document
            .add(text(MARGIN_PX, y + 16.0, &format!("{tilt_deg:.1}°")))
            .add(bar([x, y], [room * bound_pct / 100.0, 22.0], FAINT))
            .add(bar([x, y], [room * found_pct / 100.0, 22.0], fill))
            .add(text(x + room + 8.0, y + 16.0, &words));
    }
    let words =
        "sections through the middle, across y and across x, by the least tilt; red is left out";
    document = document.add(text(MARGIN_PX, sections_px + 10.0, words));
    let bottom = sections_px + 30.0 + nz * cell_px;
    let beside = 2.0 * MARGIN_PX + nx * cell_px;
    for (across, along, left) in [(1, 0, MARGIN_PX), (0, 1, beside)] {
        let middle = (picture.size[across] / 2) as u16;
        for (cell, level) in picture
            .cells
            .iter()
            .filter(|(cell, _)| cell[across] == middle)
        {
            let x = left + f64::from(cell[along]) * cell_px;
            let y = bottom - f64::from(cell[2] + 1) * cell_px;
            let fill = level.map_or(LEFT_OUT, |level| COLOURS[level.min(COLOURS.len() - 1)]);
            document = document.add(bar([x, y], [cell_px; 2], fill));
        }
    }
    document.to_string() + "\n"
}
