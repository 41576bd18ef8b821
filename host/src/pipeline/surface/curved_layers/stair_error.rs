//! How far layers stand off the top of their part: the volume between the printed top and the part's.
//!
//! In: layers with their regions and the part's top over a grid (mm). Out: mm³, and how thick and steep curved layers are. The
//! printed top at a place is that of the highest layer that has it. Leaves out what beads do within a layer.

use super::layer_shape::{PartLayer, Shape};
use super::top_grid::TopGrid;
use crate::geometry::edge_index::{Edge, EdgeIndex};
use crate::geometry::polygon::Region;
use rayon::prelude::*;

/// Side of the buckets that edges are sorted into, and from one cell that is looked at for thickness to the next, in cells.
const BUCKET: f64 = 4.0;
const EVERY: usize = 2;

/// The volume between the top that flat layers have and the part's, mm³.
pub fn of_flat_layers(grid: &TopGrid, layer_mm: f64) -> f64 {
    let heights = grid.z_mm.iter().filter(|z_mm| !z_mm.is_nan());
    let off = heights.map(|z_mm| ((z_mm / layer_mm + 0.5).floor() * layer_mm - z_mm).abs());
    off.sum::<f64>() * grid.cell_mm2()
}

fn walls(regions: &[Region], grid: &TopGrid) -> Option<EdgeIndex> {
    let edges = regions.iter().flat_map(Region::edges);
    let edges: Vec<Edge> = edges.map(|(a, b)| Edge { a, b }).collect();
    (!edges.is_empty()).then(|| EdgeIndex::new(edges, BUCKET * grid.step_mm))
}

/// The volume between the top of layers, in the order that they are printed in, and the part's, mm³.
pub fn of_layers(grid: &TopGrid, layers: &[PartLayer]) -> f64 {
    let mut open: Vec<usize> = (0..grid.z_mm.len())
        .filter(|&cell| !grid.z_mm[cell].is_nan())
        .collect();
    let mut off_mm = 0.0;
    for layer in layers.iter().rev() {
        let Some(walls) = walls(&layer.regions, grid) else {
            continue;
        };
        let is_in: Vec<bool> = open
            .par_iter()
            .map(|&cell| walls.contains(grid.place(cell)))
            .collect();
        let mut left = Vec::with_capacity(open.len());
        for (&cell, is_in) in open.iter().zip(is_in) {
            match is_in {
                true => off_mm += (layer.top_mm(grid.place(cell)) - grid.z_mm[cell]).abs(),
                false => left.push(cell),
            }
        }
        open = left;
    }
    off_mm += open.iter().map(|&cell| grid.z_mm[cell]).sum::<f64>();
    off_mm * grid.cell_mm2()
}

/// What curved layers come to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Least and greatest thickness, of the nominal one.
    pub thickness: [f64; 2],
    /// Steepest slope, its tangent.
    pub slope: f64,
}

/// Thickness and slope over the regions of curved layers.
pub fn bounds(grid: &TopGrid, layers: &[PartLayer], layer_mm: f64) -> Bounds {
    let of_layers = layers.par_iter().map(|layer| {
        let mut found = Bounds::NONE;
        let Shape::Curved { top, below } = &layer.shape else {
            return found;
        };
        let Some(walls) = walls(&layer.regions, grid) else {
            return found;
        };
        for j in (0..grid.count[1]).step_by(EVERY) {
            for i in (0..grid.count[0]).step_by(EVERY) {
                let at = grid.place(j * grid.count[0] + i);
                if walls.contains(at) {
                    let jet = top.jet(at);
                    let share = (jet.z_mm - below.z_mm(at)) / layer_mm;
                    found = found.with(&Bounds {
                        thickness: [share; 2],
                        slope: jet.slope[0].hypot(jet.slope[1]),
                    });
                }
            }
        }
        found
    });
    let of_layers: Vec<Bounds> = of_layers.collect();
    of_layers.iter().fold(Bounds::NONE, Bounds::with)
}

impl Bounds {
    const NONE: Bounds = Bounds {
        thickness: [f64::INFINITY, 0.0],
        slope: 0.0,
    };

    fn with(self, other: &Bounds) -> Bounds {
        let ([least, most], [other_least, other_most]) = (self.thickness, other.thickness);
        Bounds {
            thickness: [least.min(other_least), most.max(other_most)],
            slope: self.slope.max(other.slope),
        }
    }
}
