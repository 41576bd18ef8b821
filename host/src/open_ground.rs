//! Ground of the outline that a plan leaves open: how much, and where.
//!
//! A wing thinner than the narrowest bead vanishes from the print: the figures show it as a share
//! of the area, here it is found as a place. Input: the coverage rasters of a plan. Output: connected
//! pieces of uncovered ground, input coordinates, the largest first, and a note of those that are no
//! specks. Leaves out layers whose infill is open on purpose.

use crate::Plan;
use crate::geometry::Point2;
use crate::geometry::coverage::{Cell, Coverage};
use crate::settings::Settings;
use serde::{Deserialize, Serialize};

/// Places that are told one by one.
const PLACES_TOLD: usize = 3;

/// A piece of ground that nothing covers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct OpenGround {
    /// Its area.
    pub area_mm2: f64,
    /// A place in it, near its middle.
    #[serde(with = "crate::geometry::as_numbers")]
    pub at: Point2,
}

/// All pieces of the layers that were to be filled, the largest first.
pub fn open_ground(plan: &Plan) -> Vec<OpenGround> {
    let mut found = Vec::new();
    for (print, raster) in plan.prints.iter().zip(&plan.measured.rasters) {
        let infill = plan.kinds[print.kind].infill;
        let is_filled = infill.is_none_or(|infill| infill.is_solid());
        let (true, Some(raster)) = (is_filled, raster) else {
            continue;
        };
        let contour = &plan.region_of(print).contour;
        for (area_mm2, middle) in pieces(&raster.swept) {
            let at = contour.to_input(raster.frame.point_out(middle));
            found.push(OpenGround { area_mm2, at });
        }
    }
    found.sort_by(|a, b| b.area_mm2.total_cmp(&a.area_mm2));
    found
}

/// What the user is told of it: pieces as large as the narrowest bead is wide, or larger.
pub fn note(open: &[OpenGround], settings: &Settings) -> Option<String> {
    let least_mm2 = (2.0 * settings.aperture.minor_mm()).powi(2);
    let open = &open[..open.partition_point(|piece| piece.area_mm2 >= least_mm2)];
    let all_mm2: f64 = open.iter().map(|piece| piece.area_mm2).sum();
    let largest = open.iter().take(PLACES_TOLD);
    let largest: Vec<String> = largest
        .map(|piece| {
            let OpenGround { area_mm2, at } = piece;
            format!("{area_mm2:.2} mm² near ({:.3}, {:.3})", at.x, at.y)
        })
        .collect();
    (!open.is_empty()).then(|| {
        format!(
            "{all_mm2:.2} mm² of the outline stay open, in {} places where this aperture does not fit \
             or no bead does; the largest: {}",
            open.len(),
            largest.join(", ")
        )
    })
}

/// Connected gaps of a raster: area, and the cell nearest to the middle, in the
/// raster's frame.
fn pieces(swept: &Coverage) -> Vec<(f64, Point2)> {
    let (columns, cell_mm) = (swept.columns, swept.cell_mm);
    let mut is_seen = vec![false; swept.cells.len()];
    let (mut cells, mut found) = (Vec::new(), Vec::new());
    for first in 0..swept.cells.len() {
        if is_seen[first] || swept.cells[first] != Cell::Gap {
            continue;
        }
        cells.clear();
        cells.push(first);
        is_seen[first] = true;
        let mut next = 0;
        while let Some(&cell) = cells.get(next) {
            next += 1;
            let column = cell % columns;
            let beside = [
                (column > 0).then(|| cell - 1),
                (column + 1 < columns).then_some(cell + 1),
                cell.checked_sub(columns),
                Some(cell + columns).filter(|&below| below < swept.cells.len()),
            ];
            for other in beside.into_iter().flatten() {
                if !is_seen[other] && swept.cells[other] == Cell::Gap {
                    is_seen[other] = true;
                    cells.push(other);
                }
            }
        }
        let area_mm2 = cells.len() as f64 * cell_mm * cell_mm;
        found.push((area_mm2, nearest_to_middle(&cells, swept)));
    }
    found
}

/// Centre of the cell that lies nearest to the middle of all.
fn nearest_to_middle(cells: &[usize], swept: &Coverage) -> Point2 {
    let place = |cell: usize| {
        let (column, row) = (cell % swept.columns, cell / swept.columns);
        let corner = nalgebra::Vector2::new(column as f64 + 0.5, row as f64 + 0.5);
        swept.origin + corner * swept.cell_mm
    };
    let sum = cells.iter().map(|&cell| place(cell).coords);
    let middle = Point2::from(sum.sum::<nalgebra::Vector2<f64>>() / cells.len() as f64);
    let away = |cell: &usize| (place(*cell) - middle).norm_squared();
    let nearest = cells.iter().min_by(|a, b| away(a).total_cmp(&away(b)));
    nearest.map_or(middle, |&cell| place(cell))
}
