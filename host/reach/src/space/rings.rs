//! Directions to try: rings about Z.

use crate::Vector3;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Widest step between rings.
const STEP_MAX_RAD: f64 = PI / 12.0;
/// Most directions in a quarter of a ring, and of the one at the free tilt: with six there, all are one too many for a mask.
const QUARTER_MAX: [f64; 2] = [6.0, 5.0];
/// A ring at the free tilt adds nothing closer than this to another one.
const SAME_RAD: f64 = PI / 180.0;

/// Directions in rings about Z up to a tilt (at most 90°): at 0, half and all of it, between them, and at the head's free
/// tilt. Quarter turns and mirrors along x and y map each ring onto itself.
pub fn directions(tilt_max_rad: f64, free_tilt_rad: f64) -> Vec<Vector3> {
    let top_rad = tilt_max_rad.clamp(0.0, FRAC_PI_2);
    let pairs = (top_rad / (2.0 * STEP_MAX_RAD) - 1e-9).ceil().max(1.0);
    let count = if top_rad > 0.0 { 2 * pairs as u32 } else { 0 };
    let tilt_rad = |ring: u32| top_rad * f64::from(ring) / f64::from(count.max(1));
    let rings = (0..=count).map(|ring| (tilt_rad(ring), QUARTER_MAX[0]));
    let mut rings: Vec<(f64, f64)> = rings.collect();
    let is_known = |ring: &(f64, f64)| (ring.0 - free_tilt_rad).abs() < SAME_RAD;
    if (0.0..top_rad).contains(&free_tilt_rad) && !rings.iter().any(is_known) {
        rings.push((free_tilt_rad, QUARTER_MAX[1]));
        rings.sort_by(|a, b| a.0.total_cmp(&b.0));
    }
    rings.into_iter().flat_map(ring).collect()
}

fn ring((tilt_rad, quarter_max): (f64, f64)) -> impl Iterator<Item = Vector3> {
    let out = tilt_rad.sin();
    let count = match tilt_rad > 0.0 {
        true => 4 * (6.0 * out).round().clamp(1.0, quarter_max) as u32,
        false => 1,
    };
    (0..count).map(move |index| {
        let (sin, cos) = (TAU * f64::from(index) / f64::from(count)).sin_cos();
        Vector3::new(out * cos, out * sin, tilt_rad.cos())
    })
}
