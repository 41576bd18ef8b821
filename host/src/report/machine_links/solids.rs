//! Convex solids by their corners: boxes, and round bars of one or two radii.
//!
//! In and out: mm, a link's frame. A round solid is two rings of [`RING_POINTS`] corners.

use super::{Solid, across};
use nalgebra::{Unit, Vector3};

/// Corners of a ring: round enough at the size of a page.
const RING_POINTS: usize = 24;

/// A box from its least to its greatest corner.
pub fn block(least_mm: [f64; 3], most_mm: [f64; 3]) -> Solid {
    let corner = |number: usize| {
        std::array::from_fn(|k| match number >> k & 1 {
            0 => rounded(least_mm[k]),
            _ => rounded(most_mm[k]),
        })
    };
    (0..8).map(corner).collect()
}

/// A bar between two places with a radius at each; nothing where they are the same.
pub fn bar(ends_mm: [[f64; 3]; 2], radii_mm: [f64; 2]) -> Vec<Solid> {
    let ends = ends_mm.map(Vector3::from);
    let Some(axis) = Unit::try_new(ends[1] - ends[0], 1e-6) else {
        return Vec::new();
    };
    let [x, y] = across(&axis);
    let corner = |number: usize| {
        let (end, number) = (number / RING_POINTS, number % RING_POINTS);
        let angle = std::f64::consts::TAU * number as f64 / RING_POINTS as f64;
        let place = ends[end] + radii_mm[end] * (angle.cos() * x + angle.sin() * y);
        std::array::from_fn(|k| rounded(place[k]))
    };
    vec![(0..2 * RING_POINTS).map(corner).collect()]
}

/// To a µm, which keeps the page small; plus zero for minus zero.
fn rounded(mm: f64) -> f64 {
    (mm * 1e3).round() / 1e3 + 0.0
}
