//! Exact orientation of three points.
//!
//! Rounding decides wrongly just where it matters (does this vertex lie on that edge?), so the sign
//! is computed in floating point first and, where its error bound does not settle it, again without
//! any rounding. Source: J. R. Shewchuk, "Adaptive precision floating-point arithmetic", 1997.
//! Exact for coordinates whose products neither overflow nor underflow (1e-140 to 1e140).

use super::Point2;
use std::cmp::Ordering;

/// Relative error bound of the plain determinant: (3 + 16 eps) eps with eps = 2^-53.
const PLAIN_ERROR: f64 = 3.330_669_073_875_472e-16;

/// Which side of the line a-b point c lies on: `Greater` left, `Less` right, `Equal` on it.
pub fn orientation(a: Point2, b: Point2, c: Point2) -> Ordering {
    let left = (a.x - c.x) * (b.y - c.y);
    let right = (a.y - c.y) * (b.x - c.x);
    let determinant = left - right;
    if determinant.abs() > PLAIN_ERROR * (left.abs() + right.abs()) {
        return determinant.total_cmp(&0.0);
    }
    exact_orientation(a, b, c)
}

fn exact_orientation(a: Point2, b: Point2, c: Point2) -> Ordering {
    let (ax, by) = (two_difference(a.x, c.x), two_difference(b.y, c.y));
    let (ay, bx) = (two_difference(a.y, c.y), two_difference(b.x, c.x));
    let mut sum = Expansion::default();
    for p in ax {
        for q in by {
            two_product(p, q).into_iter().for_each(|term| sum.add(term));
        }
    }
    for p in ay {
        for q in bx {
            two_product(-p, q)
                .into_iter()
                .for_each(|term| sum.add(term));
        }
    }
    sum.sign()
}

/// a + b as rounded sum and exact remainder.
fn two_sum(a: f64, b: f64) -> [f64; 2] {
    let sum = a + b;
    let virtual_b = sum - a;
    [sum, (a - (sum - virtual_b)) + (b - virtual_b)]
}

fn two_difference(a: f64, b: f64) -> [f64; 2] {
    two_sum(a, -b)
}

/// a b as rounded product and exact remainder.
fn two_product(a: f64, b: f64) -> [f64; 2] {
    let product = a * b;
    [product, a.mul_add(b, -product)]
}

/// An exact sum: non-overlapping terms, smallest first.
#[derive(Default)]
struct Expansion {
    terms: Vec<f64>,
}

impl Expansion {
    fn add(&mut self, value: f64) {
        let mut carry = value;
        for term in &mut self.terms {
            let [sum, rest] = two_sum(carry, *term);
            *term = rest;
            carry = sum;
        }
        self.terms.push(carry);
        self.terms.retain(|&t| t != 0.0);
    }

    fn sign(&self) -> Ordering {
        self.terms
            .last()
            .map_or(Ordering::Equal, |t| t.total_cmp(&0.0))
    }
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
