//! The deposited area over the outline: gaps, overlaps and area outside the outline, in colour.

use super::canvas::{Canvas, INK, Swatch};
use crate::geometry::frame::Frame;
use crate::geometry::polygon::{Box2, Region};
use crate::geometry::{Point2, Vector2};
use std::fmt::Write;
use svg::node::element::Path;

/// Most cells along a side of the picture; finer rasters are drawn in blocks.
const SIDE_MAX: usize = 2000;

/// State of a cell. Of several in one block the greatest is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Cell {
    /// Outside and empty.
    Empty,
    /// Inside, covered once.
    Once,
    /// Inside, not covered, and no aperture inside the outline could.
    Unreachable,
    /// Inside, covered more than once.
    Overlap,
    /// Inside, not covered.
    Gap,
    /// Outside, covered.
    Spill,
}

const COLOURS: [(Cell, &str, &str); 4] = [
    (Cell::Unreachable, "#a0aec0", "unreachable"),
    (Cell::Overlap, "#ed8936", "overlap"),
    (Cell::Gap, "#e53e3e", "gap"),
    (Cell::Spill, "#d53f8c", "outside the outline"),
];
const ONCE: &str = "#90cdf4";

/// The data drawn, in the input's coordinates.
#[derive(Clone, Debug)]
pub struct CoveragePicture<'a> {
    /// Title of the sheet.
    pub title: &'a str,
    /// The outline.
    pub regions: &'a [Region],
    /// Rasters, of a region each.
    pub rasters: Vec<Raster>,
}

/// Cells over a part of the sheet.
#[derive(Clone, Debug)]
pub struct Raster {
    /// The frame it is in.
    pub frame: Frame,
    /// Lower left corner of cell (0, 0) there, mm.
    pub origin: Point2,
    /// Side of a cell, mm.
    pub cell_mm: f64,
    /// Cells in a row.
    pub columns: usize,
    /// Rows from the bottom, one after the other; an incomplete last row is omitted.
    pub cells: Vec<Cell>,
}

/// Draws the sheet: the outline in the colour of "once", everything else as rectangles over it.
pub fn draw(picture: &CoveragePicture) -> String {
    let corners: Vec<Point2> = picture
        .regions
        .iter()
        .map(Region::bounds)
        .flat_map(|b| [b.min, b.max])
        .collect();
    let mut canvas = Canvas::new(Box2::of(&corners), picture.title);
    let outline = canvas.region_data(picture.regions);
    canvas.add(
        Path::new()
            .set("d", outline.clone())
            .set("fill", ONCE)
            .set("fill-rule", "evenodd"),
    );
    canvas.legend(Swatch::Fill(ONCE), "covered once");
    let blocks: Vec<Blocks> = picture.rasters.iter().map(Blocks::of).collect();
    for (state, colour, name) in COLOURS {
        let data: String = blocks
            .iter()
            .map(|b| b.rectangles(&canvas, state))
            .collect();
        // Planners without that test draw no unreachable cells: no row for them then.
        if data.is_empty() && state == Cell::Unreachable {
            continue;
        }
        if !data.is_empty() {
            canvas.add(Path::new().set("d", data).set("fill", colour));
        }
        canvas.legend(Swatch::Fill(colour), name);
    }
    canvas.add(
        Path::new()
            .set("d", outline)
            .set("fill", "none")
            .set("stroke", INK)
            .set("stroke-width", 1.0),
    );
    canvas.finish()
}

/// The raster, in blocks of cells where it is too fine for a picture.
struct Blocks {
    frame: Frame,
    origin: Point2,
    cell_mm: f64,
    columns: usize,
    cells: Vec<Cell>,
}

impl Blocks {
    fn of(picture: &Raster) -> Blocks {
        let columns = picture.columns;
        let rows = picture.cells.len().checked_div(columns).unwrap_or(0);
        let side = columns.max(rows).div_ceil(SIDE_MAX).max(1);
        let block_columns = columns.div_ceil(side);
        let mut cells = vec![Cell::Empty; block_columns * rows.div_ceil(side)];
        for row in 0..rows {
            for column in 0..columns {
                let block = &mut cells[row / side * block_columns + column / side];
                *block = (*block).max(picture.cells[row * columns + column]);
            }
        }
        Blocks {
            frame: picture.frame,
            origin: picture.origin,
            cell_mm: picture.cell_mm * side as f64,
            columns: block_columns,
            cells,
        }
    }

    /// Path data of all blocks in a state: equal runs of neighbouring rows are one rectangle.
    fn rectangles(&self, canvas: &Canvas, state: Cell) -> String {
        let mut data = String::new();
        // (first column, column after the last, first row) of the rectangles that still grow.
        let mut open: Vec<(usize, usize, usize)> = Vec::new();
        let rows = self.cells.len().checked_div(self.columns).unwrap_or(0);
        for row in 0..=rows {
            let runs = if row < rows {
                self.runs(row, state)
            } else {
                Vec::new()
            };
            let mut next = Vec::with_capacity(runs.len());
            for &(start, end) in &runs {
                let grown = open.iter().find(|&&(s, e, _)| (s, e) == (start, end));
                next.push((start, end, grown.map_or(row, |&(_, _, first)| first)));
            }
            for &(start, end, first) in &open {
                if !runs.contains(&(start, end)) {
                    self.rectangle(canvas, &mut data, start, end, first, row);
                }
            }
            open = next;
        }
        data
    }

    fn runs(&self, row: usize, state: Cell) -> Vec<(usize, usize)> {
        let cells = &self.cells[row * self.columns..(row + 1) * self.columns];
        let mut runs = Vec::new();
        let mut start = None;
        for (column, &cell) in cells.iter().enumerate() {
            match (cell == state, start) {
                (true, None) => start = Some(column),
                (false, Some(first)) => {
                    runs.push((first, column));
                    start = None;
                }
                _ => {}
            }
        }
        runs.extend(start.map(|first| (first, self.columns)));
        runs
    }

    fn rectangle(
        &self,
        canvas: &Canvas,
        data: &mut String,
        start: usize,
        end: usize,
        bottom: usize,
        top: usize,
    ) {
        let corner = |column: usize, row: usize| {
            let cells = Vector2::new(column as f64, row as f64);
            let at = self.origin + cells * self.cell_mm;
            canvas.px(self.frame.point_out(at))
        };
        let corners = [(start, bottom), (end, bottom), (end, top), (start, top)];
        let [(x1, y1), (x2, y2), (x3, y3), (x4, y4)] = corners.map(|(c, r)| corner(c, r));
        // Writing to a String cannot fail.
        let _ = write!(
            data,
            "M{x1:.2} {y1:.2}L{x2:.2} {y2:.2} {x3:.2} {y3:.2} {x4:.2} {y4:.2}Z"
        );
    }
}
