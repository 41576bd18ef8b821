//! Exact orientation of three points.
//!
//! Rounding gives wrong answers exactly where they matter (is this vertex on that edge?), so the
//! sign is exact: the `robust` crate's adaptive predicate.
//! Source: J. R. Shewchuk, "Adaptive precision floating-point arithmetic", 1997.
//! Exact for coordinates whose products neither overflow nor underflow (1e-140 to 1e140).

use super::Point2;
use robust::{Coord, orient2d};
use std::cmp::Ordering;

/// The side of the line a-b on which point c is: `Greater` left, `Less` right, `Equal` on it.
pub fn orientation(a: Point2, b: Point2, c: Point2) -> Ordering {
    let [a, b, c] = [a, b, c].map(|point| Coord {
        x: point.x,
        y: point.y,
    });
    let determinant = orient2d(a, b, c);
    // No total order here: it distinguishes -0 from 0.
    determinant.partial_cmp(&0.0).unwrap_or(Ordering::Equal)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Goal: right where plain arithmetic is wrong. Method: points on a line whose differences are
    /// exact in integers, moved by one unit in the last place.
    #[test]
    fn last_bits_decide() {
        let (a, b) = (Point2::new(12.0, 12.0), Point2::new(24.0, 24.0));
        let mut wrong_plainly = 0;
        for i in 0..256i32 {
            for j in 0..256i32 {
                let ulp = f64::EPSILON / 2.0;
                let c = Point2::new(0.5 + f64::from(i) * ulp, 0.5 + f64::from(j) * ulp);
                assert_eq!(orientation(a, b, c), j.cmp(&i), "{i} {j}");
                let plain = (a.x - c.x) * (b.y - c.y) - (a.y - c.y) * (b.x - c.x);
                wrong_plainly += usize::from(plain.partial_cmp(&0.0) != Some(j.cmp(&i)));
            }
        }
        assert!(
            wrong_plainly > 1000,
            "the case must be hard: {wrong_plainly}"
        );
    }
}
