//! Uncovered area of the outline: its size and position.
//!
//! A wing thinner than the narrowest bead is missing in the print: the figures show it as a share of the area,
//! this module finds its position. Input: the coverage rasters of a plan. Output: connected uncovered areas
//! with their layers, input coordinates, the largest first, and a note on those that are not tiny. Not
//! covered: areas that are open on purpose, which are those of a sparse infill, extended by a narrowest bead
//! around it.

use super::Plan;
use crate::geometry::Point2;
use crate::geometry::boolean::{filled, grown};
use crate::geometry::coverage::{Cell, Coverage};
use crate::geometry::edge_index::{Edge, EdgeIndex};
use crate::geometry::polygon::Region;
use crate::geometry::repair::FillRule;
use crate::settings::Settings;
use serde::{Deserialize, Serialize};

/// Places that are reported one by one.
const PLACES_TOLD: usize = 3;
/// Places and areas that differ by less are the same on two layers, mm and mm².
const SAME: f64 = 1e-3;

/// A connected uncovered area.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct OpenGround {
    /// Its area.
    pub area_mm2: f64,
    /// A place in it, near its middle.
    #[serde(with = "crate::geometry::as_numbers")]
    pub at: Point2,
    /// The lowest layer that lacks it, from 0.
    pub layer: u32,
    /// How many layers lack it.
    pub layers: u32,
}

/// All uncovered areas of the layers, the largest first.
pub fn open_ground(plan: &Plan, settings: &Settings) -> Vec<OpenGround> {
    let mut found = Vec::new();
    // How many printings have the raster of each.
    let mut layers = vec![0; plan.prints.len()];
    for print in &plan.prints {
        layers[print.like] += 1;
    }
    let rasters = plan.prints.iter().zip(&plan.measured.rasters);
    for ((print, raster), layers) in rasters.zip(layers) {
        let Some(raster) = raster else {
            continue;
        };
        let region = plan.region_of(print);
        // Where sparse lines end at a wall is as open as between them.
        let around_mm = settings.aperture.minor_mm();
        let sparse = grown(&region.sparse, around_mm);
        // Disjoint, so that a cell inside any of them is after an odd number of edges.
        let sparse = filled(sparse.iter().flat_map(Region::rings), FillRule::Positive);
        let edges = sparse.iter().flat_map(|sparse| {
            let sparse = raster.frame.region_in(sparse);
            let edges = sparse.edges().map(|(a, b)| Edge { a, b });
            edges.collect::<Vec<Edge>>()
        });
        let edges: Vec<Edge> = edges.collect();
        let inside = match edges.is_empty() {
            true => Vec::new(),
            false => raster.swept.inside(&EdgeIndex::new(edges, around_mm)),
        };
        let is_meant = |cell: usize| inside.get(cell).copied().unwrap_or(false);
        for (area_mm2, middle) in pieces(&raster.swept, is_meant) {
            let at = region.contour.to_input(raster.frame.point_out(middle));
            found.push(OpenGround {
                area_mm2,
                at,
                layer: print.layer,
                layers,
            });
        }
    }
    found.sort_by(|a, b| b.area_mm2.total_cmp(&a.area_mm2));
    found
}

/// Pieces of several stacks of layers, the largest first; those that are the same become one.
pub fn merged(mut open: Vec<OpenGround>) -> Vec<OpenGround> {
    open.sort_by(|a, b| b.area_mm2.total_cmp(&a.area_mm2));
    let mut merged: Vec<OpenGround> = Vec::with_capacity(open.len());
    for piece in open {
        let alike = merged.iter_mut().rev();
        let mut alike = alike.take_while(|other| other.area_mm2 <= piece.area_mm2 + SAME);
        let known = alike.find(|other| (other.at - piece.at).norm() <= SAME);
        match known {
            Some(known) => {
                known.layers += piece.layers;
                known.layer = known.layer.min(piece.layer);
            }
            None => merged.push(piece),
        }
    }
    merged
}

/// The smallest reported area: the square of the narrowest bead's width.
pub fn least_mm2(settings: &Settings) -> f64 {
    (2.0 * settings.aperture.minor_mm()).powi(2)
}

/// Sum of the reported areas, over all layers, mm².
pub fn told_mm2(open: &[OpenGround], settings: &Settings) -> f64 {
    let least_mm2 = least_mm2(settings);
    let open = open.iter().filter(|piece| piece.area_mm2 >= least_mm2);
    open.map(|piece| piece.area_mm2 * f64::from(piece.layers))
        .sum()
}

/// The note for the user. `all_mm2` is [`told_mm2`] of all areas, `open` may have only the largest ones, the
/// largest first; `top_mm` gives the height of a layer if that is known.
pub fn note(
    open: &[OpenGround],
    all_mm2: f64,
    top_mm: impl Fn(u32) -> Option<f64>,
    settings: &Settings,
) -> Option<String> {
    let least_mm2 = least_mm2(settings);
    let open = &open[..open.partition_point(|piece| piece.area_mm2 >= least_mm2)];
    let largest = open.iter().take(PLACES_TOLD);
    let largest: Vec<String> = largest
        .map(|piece| {
            let OpenGround {
                area_mm2,
                at,
                layer,
                layers,
            } = piece;
            let z = top_mm(*layer).map_or(String::new(), |z_mm| format!(", {z_mm:.2}"));
            let on = match layers {
                1 => String::new(),
                layers => format!(" on {layers} layers"),
            };
            format!("{area_mm2:.2} mm² near ({:.3}, {:.3}{z}){on}", at.x, at.y)
        })
        .collect();
    let layers = open.iter().map(|piece| piece.layers).max()?;
    let on = match layers {
        1 => "",
        _ => ", summed over the layers,",
    };
    Some(format!(
        "{all_mm2:.2} mm² of the outline{on} stay open, in {} places where this aperture does not fit \
         or no bead does; the largest: {}",
        open.len(),
        largest.join(", ")
    ))
}

/// Connected gaps of a raster that are not meant to be: area, and the cell nearest to the middle, in the
/// raster's frame.
fn pieces(swept: &Coverage, is_meant: impl Fn(usize) -> bool) -> Vec<(f64, Point2)> {
    let (columns, cell_mm) = (swept.columns, swept.cell_mm);
    // What is open on purpose is no gap.
    let is_gap = |cell: usize| swept.cells[cell] == Cell::Gap && !is_meant(cell);
    let mut is_seen = vec![false; swept.cells.len()];
    let (mut cells, mut found) = (Vec::new(), Vec::new());
    for first in 0..swept.cells.len() {
        if is_seen[first] || !is_gap(first) {
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
                if !is_seen[other] && is_gap(other) {
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

/// Centre of the cell nearest to the middle of all.
fn nearest_to_middle(cells: &[usize], swept: &Coverage) -> Point2 {
    let sum = cells.iter().map(|&cell| swept.center(cell).coords);
    let middle = Point2::from(sum.sum::<nalgebra::Vector2<f64>>() / cells.len() as f64);
    let away = |cell: &usize| (swept.center(*cell) - middle).norm_squared();
    let nearest = cells.iter().min_by(|a, b| away(a).total_cmp(&away(b)));
    nearest.map_or(middle, |&cell| swept.center(cell))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Goal: ground that stays open on many layers counts on each of them, and is named once. Method: the same
    /// piece of two stacks, a speck, another piece; the sum by hand.
    #[test]
    fn open_ground_counts_on_each_layer() {
        let settings = Settings::default();
        let piece = |area_mm2: f64, x: f64, layer: u32, layers: u32| OpenGround {
            area_mm2,
            at: Point2::new(x, 2.0),
            layer,
            layers,
        };
        let all = vec![
            piece(3.0, 1.0, 64, 36),
            piece(0.01, 9.0, 0, 100),
            piece(3.0, 1.0, 0, 64),
            piece(2.0, 5.0, 7, 1),
        ];
        let all_mm2 = told_mm2(&all, &settings);
        assert!((all_mm2 - 302.0).abs() < 1e-9, "{all_mm2}");
        let open = merged(all);
        assert_eq!(
            open,
            [
                piece(3.0, 1.0, 0, 100),
                piece(2.0, 5.0, 7, 1),
                piece(0.01, 9.0, 0, 100)
            ]
        );
        let top_mm = |layer: u32| Some(0.2 * f64::from(layer + 1));
        let note = note(&open, all_mm2, top_mm, &settings).expect("a note");
        assert!(
            note.starts_with(
                "302.00 mm² of the outline, summed over the layers, stay open, in 2 places"
            ) && note.contains("3.00 mm² near (1.000, 2.000, 0.20) on 100 layers")
                && note.contains("2.00 mm² near (5.000, 2.000, 1.60)"),
            "{note}"
        );
    }
}
