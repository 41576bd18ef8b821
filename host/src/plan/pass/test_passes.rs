//! Passes for the tests of this module.

use crate::geometry::clearance::Configuration;
use crate::geometry::{Point2, Vector2};
use crate::plan::pass::{Contact, LayerPass, PassKind, Placement};
use std::f64::consts::{FRAC_PI_2, TAU};

/// An aperture of 0.6 mm that touches its wall with the end of its major axis.
pub fn placement(center: Point2, heading_rad: f64) -> Placement {
    let (sin, cos) = heading_rad.sin_cos();
    let outward = Vector2::new(cos, sin);
    Placement {
        at: Configuration {
            center,
            heading_rad,
        },
        feasible: true,
        contact: Contact {
            point: center + outward * 0.6,
            normal: -outward,
            length_mm: 0.1,
            extent_mm: 0.6,
            on_axis: false,
        },
    }
}

/// A pass along centres with their headings.
pub fn pass(places: impl IntoIterator<Item = (Point2, f64)>, closed: bool) -> LayerPass {
    let places = places.into_iter();
    LayerPass {
        kind: PassKind::TwoPass,
        channel: 1,
        closed,
        placements: places.map(|(at, heading)| placement(at, heading)).collect(),
        then: Vec::new(),
    }
}

/// A straight run with a placement every 0.1 mm, the major axis across it, its wall on the right.
pub fn run(from: [f64; 2], to: [f64; 2]) -> LayerPass {
    let (from, way) = (Point2::from(from), Point2::from(to) - Point2::from(from));
    let heading_rad = way.y.atan2(way.x) - FRAC_PI_2;
    let steps = (way.norm() / 0.1).round() as usize;
    let center = |i: usize| from + way * (i as f64 / steps as f64);
    pass((0..=steps).map(|i| (center(i), heading_rad)), false)
}

/// Part of a loop about `center` with its wall outside, a placement every 0.1 mm or less, the major
/// axis across it; closed if it is a full circle.
pub fn arc(center: Point2, radius_mm: f64, from_rad: f64, lap_rad: f64) -> LayerPass {
    let count = (lap_rad.abs() * radius_mm / 0.1).ceil() as usize;
    let place = |i: usize| {
        let angle = from_rad + lap_rad * i as f64 / count as f64;
        let out = Vector2::new(angle.cos(), angle.sin());
        (center + out * radius_mm, angle)
    };
    pass((0..count).map(place), lap_rad.abs() == TAU)
}
