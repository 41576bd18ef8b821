//! Directions to try: rings about Z.

use crate::Vector3;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Widest step between rings. Support is tried along each direction, and a step above this loses slopes.
const STEP_MAX_RAD: f64 = PI / 12.0;
/// A ring at the free tilt adds nothing closer than this to another one.
const SAME_RAD: f64 = PI / 180.0;

/// Directions in rings about Z up to a tilt (at most 90°): at least at 0, half and all of it, and at the head's free tilt. Each ring
/// maps onto itself by quarter turns and by mirrors along x and y.
pub fn directions(tilt_max_rad: f64, free_tilt_rad: f64) -> Vec<Vector3> {
    let top_rad = if tilt_max_rad.is_finite() {
        tilt_max_rad.clamp(0.0, FRAC_PI_2)
    } else {
        0.0
    };
    let pairs = (top_rad / (2.0 * STEP_MAX_RAD) - 1e-9).ceil().max(1.0) as u32;
    let mut rings: Vec<f64> = (0..=2 * pairs)
        .map(|ring| top_rad * f64::from(ring) / f64::from(2 * pairs))
        .collect();
    if top_rad == 0.0 {
        rings.truncate(1);
    }
    let is_known = |ring: &f64| (ring - free_tilt_rad).abs() < SAME_RAD;
    if free_tilt_rad > 0.0 && free_tilt_rad < top_rad && !rings.iter().any(is_known) {
        rings.push(free_tilt_rad);
        rings.sort_by(f64::total_cmp);
    }
    rings.into_iter().flat_map(ring).collect()
}

fn ring(tilt_rad: f64) -> impl Iterator<Item = Vector3> {
    let quarter = (6.0 * tilt_rad.sin()).round().max(1.0) as u32;
    let count = if tilt_rad > 0.0 { 4 * quarter } else { 1 };
    (0..count).map(move |index| {
        let azimuth_rad = TAU * f64::from(index) / f64::from(count);
        let out = tilt_rad.sin();
        Vector3::new(
            out * azimuth_rad.cos(),
            out * azimuth_rad.sin(),
            tilt_rad.cos(),
        )
    })
}
