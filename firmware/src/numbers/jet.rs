//! Truncated Taylor series as numbers: they give derivatives of the kinematics from the same source
//! code.
//!
//! A [`Jet`] of N coefficients holds f(t), f'(t), f''(t)/2, ... of a number that changes with time; a
//! value computed with jets includes its derivatives, exact except for rounding. The controller needs
//! three coefficients (f32) for a span, the planner four (f64). Rules of the operations: A. Griewank
//! and A. Walther, Evaluating Derivatives (2008), table 13.2. On a controller every operation is a
//! call: inlined copies in every equation would take a quarter of its flash, and this code runs a
//! hundred times per second for spans, not in every servo tick. Not covered: derivatives where the
//! function has none (a root or an angle at 0): they are 0.

use crate::numbers::real::Real;
use core::cmp::Ordering;
use core::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

/// A number and its Taylor coefficients by time; compared by its value.
#[derive(Clone, Copy, Debug)]
pub struct Jet<R, const N: usize>(pub [R; N]);

impl<R: Real, const N: usize> Jet<R, N> {
    /// A number that does not change.
    pub fn constant(value: R) -> Self {
        let mut jet = [R::of(0.0); N];
        if let Some(first) = jet.first_mut() {
            *first = value;
        }
        Self(jet)
    }

    /// The value itself.
    pub fn value(&self) -> R {
        self.0.first().copied().unwrap_or(R::of(0.0))
    }
}

/// The order of a coefficient as a number.
fn order<R: Real>(k: usize) -> R {
    R::of_integer(k as i32)
}

impl<R: Real, const N: usize> PartialEq for Jet<R, N> {
    fn eq(&self, other: &Self) -> bool {
        self.value() == other.value()
    }
}

impl<R: Real, const N: usize> PartialOrd for Jet<R, N> {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        self.value().partial_cmp(&other.value())
    }
}

impl<R: Real, const N: usize> Add for Jet<R, N> {
    type Output = Self;
    #[cfg_attr(target_os = "none", inline(never))]
    fn add(mut self, other: Self) -> Self {
        self += other;
        self
    }
}

impl<R: Real, const N: usize> Sub for Jet<R, N> {
    type Output = Self;
    #[cfg_attr(target_os = "none", inline(never))]
    fn sub(mut self, other: Self) -> Self {
        self -= other;
        self
    }
}

impl<R: Real, const N: usize> Mul for Jet<R, N> {
    type Output = Self;
    #[cfg_attr(target_os = "none", inline(never))]
    fn mul(self, other: Self) -> Self {
        let mut product = [R::of(0.0); N];
        for (k, sum) in product.iter_mut().enumerate() {
            for j in 0..=k {
                *sum += self.0[j] * other.0[k - j];
            }
        }
        Self(product)
    }
}

impl<R: Real, const N: usize> Div for Jet<R, N> {
    type Output = Self;
    #[cfg_attr(target_os = "none", inline(never))]
    fn div(self, other: Self) -> Self {
        let mut quotient = [R::of(0.0); N];
        for k in 0..N {
            let mut rest = self.0[k];
            for j in 1..=k {
                rest -= other.0[j] * quotient[k - j];
            }
            quotient[k] = rest / other.0[0];
        }
        Self(quotient)
    }
}

impl<R: Real, const N: usize> Neg for Jet<R, N> {
    type Output = Self;
    fn neg(self) -> Self {
        Self(self.0.map(|coefficient| -coefficient))
    }
}

impl<R: Real, const N: usize> AddAssign for Jet<R, N> {
    fn add_assign(&mut self, other: Self) {
        for (mine, theirs) in self.0.iter_mut().zip(other.0) {
            *mine += theirs;
        }
    }
}

impl<R: Real, const N: usize> SubAssign for Jet<R, N> {
    fn sub_assign(&mut self, other: Self) {
        for (mine, theirs) in self.0.iter_mut().zip(other.0) {
            *mine -= theirs;
        }
    }
}

impl<R: Real, const N: usize> MulAssign for Jet<R, N> {
    fn mul_assign(&mut self, other: Self) {
        *self = *self * other;
    }
}

/// 1 / (m (m + 1)) of the nested series of cosine (odd m) and sine quotient (even m): with 17 terms
/// each the first omitted one is below 1e-17 at 150°.
const NESTED_TERMS: i32 = 17;

impl<R: Real, const N: usize> Real for Jet<R, N> {
    fn of(value: f64) -> Self {
        Self::constant(R::of(value))
    }

    fn of_integer(value: i32) -> Self {
        Self::constant(R::of_integer(value))
    }

    fn as_double(self) -> f64 {
        self.value().as_double()
    }

    fn is_number(self) -> bool {
        self.value().is_number()
    }

    #[cfg_attr(target_os = "none", inline(never))]
    fn sine_cosine(self) -> (Self, Self) {
        let (mut sine, mut cosine) = ([R::of(0.0); N], [R::of(0.0); N]);
        (sine[0], cosine[0]) = self.0[0].sine_cosine();
        for k in 1..N {
            let (mut s, mut c) = (R::of(0.0), R::of(0.0));
            for j in 1..=k {
                let slope = order::<R>(j) * self.0[j];
                s += slope * cosine[k - j];
                c -= slope * sine[k - j];
            }
            sine[k] = s / order(k);
            cosine[k] = c / order(k);
        }
        (Self(sine), Self(cosine))
    }

    #[cfg_attr(target_os = "none", inline(never))]
    fn angle_from_x(self, x: Self) -> Self {
        let mut angle = Self::constant(self.0[0].angle_from_x(x.0[0]));
        let square = x * x + self * self;
        let moves = square.0[0] > R::of(0.0);
        // The angle's rate: (x y' - y x') / (x² + y²), coefficient by coefficient.
        let mut rate = [R::of(0.0); N];
        for k in 1..N {
            if !moves {
                break;
            }
            let mut sum = R::of(0.0);
            for j in 0..k {
                let after = order::<R>(k - j);
                sum += after * (x.0[j] * self.0[k - j] - self.0[j] * x.0[k - j]);
            }
            for j in 1..k {
                sum -= square.0[j] * rate[k - 1 - j];
            }
            rate[k - 1] = sum / square.0[0];
            angle.0[k] = rate[k - 1] / order(k);
        }
        angle
    }

    #[cfg_attr(target_os = "none", inline(never))]
    fn root(self) -> Self {
        let mut root = Self::constant(self.0[0].root());
        let twice = root.0[0] + root.0[0];
        let moves = twice > R::of(0.0);
        for k in 1..N {
            if !moves {
                break;
            }
            let mut rest = self.0[k];
            for j in 1..k {
                rest -= root.0[j] * root.0[k - j];
            }
            root.0[k] = rest / twice;
        }
        root
    }

    #[cfg_attr(target_os = "none", inline(never))]
    fn cosine_and_sinc_of_square(self) -> (Self, Self) {
        // cos = 1 - s/(1·2) (1 - s/(3·4) (1 - ...)), sinc = 1 - s/(2·3) (1 - s/(4·5) (...)).
        let one = Self::of(1.0);
        let (mut cosine, mut sinc) = (one, one);
        for k in (0..NESTED_TERMS).rev() {
            let m = 2 * k + 1;
            let share = |m: i32| Self::constant(R::of(1.0) / R::of_integer(m * (m + 1)));
            cosine = one - self * share(m) * cosine;
            sinc = one - self * share(m + 1) * sinc;
        }
        (cosine, sinc)
    }
}

#[cfg(test)]
mod tests {
    //! Goal: coefficients are those of the functions. Method: the same expression by central
    //! differences of plain numbers, in f64; f32 against f64.
    use super::*;

    /// Something of every operation, at t.
    fn mixture<R: Real>(t: R) -> [R; 3] {
        let (sine, cosine) = (t * t).sine_cosine();
        let a = (sine + R::of(2.0)) / (cosine * t + R::of(3.0));
        let (c, s) = (t * t * R::of(0.4)).cosine_and_sinc_of_square();
        [
            (a - s * t).angle_from_x(c + R::of(2.0)),
            (a * a + c + R::of(2.0)).root(),
            -a * s,
        ]
    }

    #[test]
    fn coefficients_are_the_derivatives() {
        for i in 0..50 {
            let t = 0.05 * f64::from(i) - 1.2;
            let jets = mixture(Jet([t, 1.0, 0.0, 0.0]));
            let h = 1e-3;
            let [m2, m1, p0, p1, p2] = [-2.0, -1.0, 0.0, 1.0, 2.0].map(|k| mixture(t + k * h));
            for (which, jet) in jets.iter().enumerate() {
                let at = [m2, m1, p0, p1, p2].map(|values| values[which]);
                let first = (8.0 * (at[3] - at[1]) - (at[4] - at[0])) / (12.0 * h);
                let second = (16.0 * (at[3] + at[1]) - (at[4] + at[0]) - 30.0 * at[2]) / 12.0;
                let third = (at[4] - at[0] - 2.0 * (at[3] - at[1])) / 2.0;
                assert!((jet.0[0] - at[2]).abs() < 1e-12);
                assert!((jet.0[1] - first).abs() < 1e-8, "{t} {which}");
                assert!(
                    (2.0 * jet.0[2] - second / (h * h)).abs() < 1e-6,
                    "{t} {which}"
                );
                assert!(
                    (6.0 * jet.0[3] - third / (h * h * h)).abs() < 1e-3,
                    "{t} {which}"
                );
            }
            let single = mixture(Jet([t as f32, 1.0, 0.0]));
            for (single, double) in single.iter().zip(&jets) {
                for k in 0..3 {
                    let error = (f64::from(single.0[k]) - double.0[k]).abs();
                    assert!(error < 2e-5 * (1.0 + double.0[k].abs()), "{t} {k} {error}");
                }
            }
        }
    }

    #[test]
    fn where_there_is_no_derivative_it_is_zero() {
        let nothing = Jet([0.0f64, 1.0, 0.0]);
        let still = Jet([0.0f64, 0.0, 0.0]);
        assert_eq!(nothing.angle_from_x(still).0, [0.0; 3]);
        assert_eq!(nothing.root().0, [0.0; 3]);
    }
}
