//! Weights and heading laws: from the radius r to the angle |alpha| that the aperture should have.
//!
//! Source: eq. 3.4.3 and 3.4.5 of the method for the weights; docs/design/heading-law.md for how they are read
//! (w = 1 is the major axis along the normal, w = 0 along the tangent) and for the tangent law.
//!
//! In: aperture, radius (mm). Out: a weight without unit, an angle in rad. Not covered: the walls.

use crate::geometry::aperture::Aperture;
use crate::settings::{HeadingLaw, PassMode};
use std::f64::consts::FRAC_PI_2;

/// Rounding of a radius, on parts of metres.
const ROUNDING_MM: f64 = 1e-9;

/// The weight w in [0, 1] at radius `radius_mm`. Two-pass: 1 above 2a, linear between 2b and 2a, 1
/// below 2b (where the law does not apply). One-pass: (r - b) / (a - b), clamped.
pub fn weight(aperture: &Aperture, radius_mm: f64, pass: PassMode) -> f64 {
    let (a, b) = (aperture.major_mm(), aperture.minor_mm());
    match pass {
        PassMode::Two if aperture.is_round() => 1.0,
        PassMode::Two if !two_fit(a, b, radius_mm) => 1.0,
        PassMode::Two => ((radius_mm - 2.0 * b) / (2.0 * (a - b))).clamp(0.0, 1.0),
        PassMode::One if aperture.is_round() => f64::from(u8::from(radius_mm >= b)),
        PassMode::One => ((radius_mm - b) / (a - b)).clamp(0.0, 1.0),
    }
}

/// True for 2b <= r <= 2a. The law jumps at 2b from 90° to 0, so a radius that is 2b but for
/// rounding counts as 2b.
fn two_fit(a: f64, b: f64, radius_mm: f64) -> bool {
    radius_mm >= 2.0 * b - ROUNDING_MM && radius_mm <= 2.0 * a + ROUNDING_MM
}

/// The law's angle between normal and major axis, in [0, 90°], before it is restricted to F(p).
///
/// `Linear` is (1 - w) 90°. `Tangent` is the angle at which the aperture touches the desired
/// curves: boundary and medial axis in two-pass (2e = r), both walls in one-pass (e = r); in
/// two-pass it is 0 outside [2b, 2a], in one-pass r is clamped to [b, a].
pub fn law_angle_rad(aperture: &Aperture, radius_mm: f64, pass: PassMode, law: HeadingLaw) -> f64 {
    if aperture.is_round() {
        return 0.0;
    }
    let (a, b) = (aperture.major_mm(), aperture.minor_mm());
    match (law, pass) {
        (HeadingLaw::Linear, _) => (1.0 - weight(aperture, radius_mm, pass)) * FRAC_PI_2,
        (HeadingLaw::Tangent, PassMode::Two) => {
            if two_fit(a, b, radius_mm) {
                aperture.angle_of_extent_rad(radius_mm / 2.0)
            } else {
                0.0
            }
        }
        (HeadingLaw::Tangent, PassMode::One) => aperture.angle_of_extent_rad(radius_mm.clamp(b, a)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::test_shapes::ELLIPSE;

    const ROUND: Aperture = Aperture::Ellipse {
        major_mm: 0.4,
        minor_mm: 0.4,
    };

    /// Goal: the published weights, with their jumps and ends.
    #[test]
    fn weights() {
        let two = |r: f64| weight(&ELLIPSE, r, PassMode::Two);
        assert_eq!([two(0.39), two(1.3)], [1.0, 1.0]);
        assert!(two(0.4).abs() < 1e-12 && (two(0.8) - 0.5).abs() < 1e-12);
        let one = |r: f64| weight(&ELLIPSE, r, PassMode::One);
        assert_eq!(
            [one(0.1), one(0.2), one(0.6), one(2.0)],
            [0.0, 0.0, 1.0, 1.0]
        );
        assert!((one(0.4) - 0.5).abs() < 1e-12);
        assert_eq!(weight(&ROUND, 0.8, PassMode::Two), 1.0);
    }

    /// Goal: the tangent law touches what it should; the linear one is wider in between
    /// (docs/design/heading-law.md). Method: extent at the angle against r/2 and r.
    #[test]
    fn angles_touch() {
        for k in 0..=20 {
            let r = 0.4 + 0.04 * f64::from(k);
            let alpha = law_angle_rad(&ELLIPSE, r, PassMode::Two, HeadingLaw::Tangent);
            assert!(
                (2.0 * ELLIPSE.extent_at_angle_mm(alpha) - r).abs() < 1e-7,
                "{r}"
            );
            let one = law_angle_rad(&ELLIPSE, r / 2.0, PassMode::One, HeadingLaw::Tangent);
            assert!((one - alpha).abs() < 1e-12);
        }
        assert_eq!(
            law_angle_rad(&ELLIPSE, 0.1, PassMode::Two, HeadingLaw::Tangent),
            0.0
        );
        assert_eq!(
            law_angle_rad(&ELLIPSE, 0.1, PassMode::One, HeadingLaw::Tangent),
            FRAC_PI_2
        );
        assert_eq!(
            law_angle_rad(&ROUND, 0.1, PassMode::One, HeadingLaw::Linear),
            0.0
        );
    }
}
