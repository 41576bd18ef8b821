//! A curve in integers, for the servo tick.
//!
//! In: [`Curve`], motor steps by unit of its axes; x in 2^-16 steps. Out: y in 2^-22 steps, by a search of four
//! comparisons whatever the number of pieces. Below 0 the first one goes on.

use crate::configuration::flow_curves::{Curve, PIECES_MAX};

/// Fraction bits of x, of a slope, of y, and of a bend by an integer of x.
const X_BITS: u32 = 16;
const SLOPE_BITS: u32 = 20;
const Y_BITS: u32 = 22;
const BEND_BITS: u32 = 24;

/// Pieces by their starts; those that are not there start beyond every x.
#[derive(Clone, Debug)]
pub struct TickCurve {
    from: [i32; PIECES_MAX],
    slope: [i32; PIECES_MAX],
    bend: [i32; PIECES_MAX],
    value: [i64; PIECES_MAX],
}

impl TickCurve {
    /// One piece from the origin, of `slope` steps a step.
    pub fn straight(slope: f64) -> Self {
        let mut from = [i32::MAX; PIECES_MAX];
        from[0] = 0;
        Self {
            from,
            slope: [(slope * f64::from(1 << SLOPE_BITS) + 0.5) as i32; PIECES_MAX],
            bend: [0; PIECES_MAX],
            value: [0; PIECES_MAX],
        }
    }

    /// The curve, of which `less` times x is taken away. `steps`: motor steps by unit of x, and of y.
    pub fn of(curve: &Curve, less: f64, steps: [f64; 2]) -> Self {
        let mut integers = Self::straight(0.0);
        let [x, y] = steps;
        let in_x = x * f64::from(1 << X_BITS);
        for (k, piece) in curve.pieces.iter().enumerate().take(PIECES_MAX) {
            let (slope, value) = (piece.slope - less, piece.value - less * piece.from);
            let bend = piece.bend * y / (x * x) * f64::from(1 << (SLOPE_BITS - X_BITS));
            // Conversions saturate: what begins beyond the integers is never reached.
            integers.from[k] = (piece.from * in_x + 0.5) as i32;
            integers.slope[k] = (slope * y / x * f64::from(1 << SLOPE_BITS)) as i32;
            integers.bend[k] = (bend * f64::from(1 << BEND_BITS)) as i32;
            integers.value[k] = (value * y * f64::from(1 << Y_BITS)) as i64;
        }
        integers
    }

    /// Its value at `x`.
    #[inline]
    pub fn at(&self, x: i32) -> i64 {
        let mut piece = 0;
        if x >= self.from[PIECES_MAX - 1] {
            piece = PIECES_MAX - 1;
        } else {
            for step in [4, 2, 1] {
                if x >= self.from[(piece + step) % PIECES_MAX] {
                    piece += step;
                }
            }
        }
        let piece = piece % PIECES_MAX;
        let beyond = i64::from(x.wrapping_sub(self.from[piece]));
        let bend = (beyond * i64::from(self.bend[piece])) >> BEND_BITS;
        let slope = i64::from(self.slope[piece]) + bend;
        let rise = beyond.wrapping_mul(slope) >> (X_BITS + SLOPE_BITS - Y_BITS);
        self.value[piece].wrapping_add(rise)
    }
}

#[cfg(test)]
mod tests {
    //! Goal: the integers are the curve. Method: every piece of a curve of eight points, both units apart.
    use super::*;
    use crate::configuration::flow_curves::FlowCurves;

    #[test]
    fn every_piece_is_the_curve_itself() {
        let points = (1..=8u8).map(|k| [f32::from(k), 0.1 + 0.04 * f32::from(k * k)]);
        let curve = FlowCurves {
            advance: points.collect(),
            ..FlowCurves::NONE
        };
        let curve = curve.advance_volume();
        let integers = TickCurve::of(&curve, 0.5, [3.0, 0.25]);
        for k in 0..1000 {
            let x = f64::from(k) / 100.0;
            let steps = integers.at((x * 3.0 * 65_536.0) as i32) as f64 / 4_194_304.0;
            let wanted = (curve.at(x)[0] - 0.5 * x) * 0.25;
            assert!((steps - wanted).abs() < 1e-4, "{x}: {steps} of {wanted}");
        }
        assert_eq!(TickCurve::straight(1.5).at(-65_536), -6_291_456);
    }
}
