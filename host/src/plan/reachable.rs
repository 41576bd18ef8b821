//! Can a point be covered at all: is there a placement of the aperture inside the region that
//! contains it?
//!
//! Search: headings in equal steps; for each the aperture is put with the point at its centre and
//! at places out towards its rim, then slid off the walls; the first one that is inside and still
//! holds the point answers. A point that is only reachable by threading more than that is called
//! unreachable; the oracle in the tests says how rare that is.

use super::heading_profile::slide_inside;
use crate::geometry::aperture::Aperture;
use crate::geometry::clearance::Configuration;
use crate::geometry::edge_index::EdgeIndex;
use crate::geometry::{Point2, Vector2};

/// Headings tried over 180°.
const HEADINGS: usize = 24;
/// Where the point is put in the aperture, as shares of the semi-axes.
const PLACES: [[f64; 2]; 9] = [
    [0.0, 0.0],
    [0.9, 0.0],
    [-0.9, 0.0],
    [0.0, 0.9],
    [0.0, -0.9],
    [0.65, 0.65],
    [-0.65, 0.65],
    [0.65, -0.65],
    [-0.65, -0.65],
];
/// Slides of each try.
const SLIDES_MAX: usize = 6;
/// A placement may cut by this share of the aperture.
const CUT_SHARE_MAX: f64 = 1e-3;

/// True where some placement inside contains `point`.
pub fn is_reachable(aperture: &Aperture, point: Point2, walls: &EdgeIndex) -> bool {
    let headings = if aperture.is_round() { 1 } else { HEADINGS };
    PLACES.iter().any(|place| {
        (0..headings).any(|n| {
            let heading_rad = std::f64::consts::PI * n as f64 / headings as f64;
            let (sin, cos) = heading_rad.sin_cos();
            let (u, v) = (
                place[0] * aperture.major_mm(),
                place[1] * aperture.minor_mm(),
            );
            let center = point - Vector2::new(u * cos - v * sin, u * sin + v * cos);
            let at = Configuration {
                center,
                heading_rad,
            };
            slide_inside(at, aperture, walls, SLIDES_MAX, CUT_SHARE_MAX)
                .is_some_and(|found| aperture.contains(found.heading_rad, point - found.center))
        })
    })
}
