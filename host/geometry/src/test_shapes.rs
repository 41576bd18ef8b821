//! Apertures, walls and random numbers for the tests of this crate and of `plan`.

use super::aperture::Aperture;
use super::edge_index::EdgeIndex;
use super::polygon::{Region, Ring};
use super::{Point2, Vector2};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::f64::consts::TAU;

/// The aperture of the built-in machine.
pub const ELLIPSE: Aperture = Aperture::Ellipse {
    major_mm: 0.6,
    minor_mm: 0.2,
};

pub const SQUARE: &[[f64; 2]] = &[[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]];

/// A drop, blunt end first: a convex polygon without symmetry.
pub fn drop_corners() -> [Vector2; 5] {
    [
        [-0.35, -0.25],
        [0.1, -0.3],
        [0.6, 0.0],
        [0.1, 0.3],
        [-0.35, 0.25],
    ]
    .map(Vector2::from)
}

/// Numbers in [0, 1), the same for the same seed.
pub fn random_numbers(seed: u64) -> impl FnMut() -> f64 {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    move || random.random_range(0.0..1.0)
}

pub fn ring(points: &[[f64; 2]]) -> Ring {
    Ring {
        points: points.iter().map(|&p| Point2::from(p)).collect(),
    }
}

/// The exterior, then the holes.
pub fn region(rings: &[&[[f64; 2]]]) -> Region {
    Region {
        exterior: ring(rings[0]),
        holes: rings[1..].iter().map(|points| ring(points)).collect(),
    }
}

/// The edges of rings, inside on their left.
pub fn walls(rings: &[&[[f64; 2]]]) -> EdgeIndex {
    EdgeIndex::of_region(&region(rings), 0.6)
}

/// A ring about the origin, counter-clockwise, with the radius that a function gives at every
/// corner.
pub fn star(corners: usize, mut radius_mm: impl FnMut(usize) -> f64) -> Vec<[f64; 2]> {
    let corner = |i: usize| {
        let (sin, cos) = (TAU * i as f64 / corners as f64).sin_cos();
        let r = radius_mm(i);
        [r * cos, r * sin]
    };
    (0..corners).map(corner).collect()
}
