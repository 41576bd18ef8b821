//! Number type of the pose mathematics, with the trigonometry that the hot path may use.
//!
//! The same generic code runs in f32 on the controller (kernels below: a few dozen instructions, no
//! f64, no fused multiply-add, so host and device agree to the bit) and in f64 on the host (libm).
//! Kernels after S. Moshier, Cephes single-precision library (1989): sinf.c, atanf.c. Not covered:
//! functions that poses do not need (no exp, no log).

use core::fmt::Debug;
use core::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

/// A real number with the kernels of the pose mathematics: f32, f64, or a Taylor series of one
/// ([`crate::numbers::jet::Jet`]), which gives derivatives from the same source.
pub trait Real:
    Copy
    + Debug
    + PartialEq
    + PartialOrd
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
    + MulAssign
    + 'static
{
    /// Rounds a constant or setting to this type.
    fn of(value: f64) -> Self;
    /// An integer, rounded to this type without a detour through f64.
    fn of_integer(value: i32) -> Self;
    /// The larger of two numbers. A comparison, because `max` is a call on a Cortex-M4F.
    fn larger(self, other: Self) -> Self {
        if self > other { self } else { other }
    }
    /// The absolute value.
    fn magnitude(self) -> Self {
        if self < Self::of(0.0) { -self } else { self }
    }
    /// False for infinities and values that are not numbers.
    fn is_number(self) -> bool;
    /// Widens for reports and tests.
    fn as_double(self) -> f64;
    /// (sin, cos) of an angle in rad. f32: absolute error below 1.5e-7 for |angle| <= 1000 rad.
    fn sine_cosine(self) -> (Self, Self);
    /// Angle of the point (x, self) in rad, in [-pi, pi]; 0 at the origin. f32: absolute error
    /// below 4e-7 rad.
    fn angle_from_x(self, x: Self) -> Self;
    /// Square root; 0 for a negative argument. f32: relative error below 2.5e-7 from 1e-30 up, 0
    /// or nearly so below.
    fn root(self) -> Self;
    /// (cos theta, sin(theta) / theta) from theta², theta <= 150° (smooth at 0, no division).
    /// f32: absolute error below 8e-7 (cosine) and 3e-7 (sine quotient).
    fn cosine_and_sinc_of_square(self) -> (Self, Self);
}

impl Real for f64 {
    fn of(value: f64) -> Self {
        value
    }
    fn of_integer(value: i32) -> Self {
        f64::from(value)
    }
    fn as_double(self) -> f64 {
        self
    }
    fn magnitude(self) -> Self {
        self.abs()
    }
    fn is_number(self) -> bool {
        self.is_finite()
    }
    fn sine_cosine(self) -> (Self, Self) {
        libm::sincos(self)
    }
    fn angle_from_x(self, x: Self) -> Self {
        libm::atan2(self, x)
    }
    fn root(self) -> Self {
        if self > 0.0 { libm::sqrt(self) } else { 0.0 }
    }
    fn cosine_and_sinc_of_square(self) -> (Self, Self) {
        // Below theta = 0.01 the next term of the series is under 1e-17.
        if self < 1e-4 {
            let cosine = 1.0 - self * (0.5 - self * (1.0 / 24.0 - self / 720.0));
            let sinc = 1.0 - self * (1.0 / 6.0 - self * (1.0 / 120.0 - self / 5040.0));
            return (cosine, sinc);
        }
        let theta_rad = libm::sqrt(self);
        let (sine, cosine) = libm::sincos(theta_rad);
        (cosine, sine / theta_rad)
    }
}

impl Real for f32 {
    fn of(value: f64) -> Self {
        value as f32
    }
    fn of_integer(value: i32) -> Self {
        value as f32
    }
    fn as_double(self) -> f64 {
        f64::from(self)
    }
    fn magnitude(self) -> Self {
        self.abs()
    }
    fn is_number(self) -> bool {
        self.is_finite()
    }
    fn sine_cosine(self) -> (Self, Self) {
        sine_cosine_f32(self)
    }
    fn angle_from_x(self, x: Self) -> Self {
        angle_f32(self, x)
    }
    fn root(self) -> Self {
        root_f32(self)
    }
    fn cosine_and_sinc_of_square(self) -> (Self, Self) {
        (
            horner(self, &COSINE_OF_SQUARE),
            horner(self, &SINC_OF_SQUARE),
        )
    }
}

/// Taylor coefficients 1/(2k)! with signs: the first omitted term is 5e-9 at 150°.
const COSINE_OF_SQUARE: [f32; 9] = [
    1.0,
    -0.5,
    4.166_666_7e-2,
    -1.388_888_9e-3,
    2.480_158_7e-5,
    -2.755_732e-7,
    2.087_675_7e-9,
    -1.147_074_6e-11,
    4.779_477_3e-14,
];
/// Taylor coefficients 1/(2k+1)! with signs: the first omitted term is 1.4e-8 at 150°.
const SINC_OF_SQUARE: [f32; 8] = [
    1.0,
    -1.666_666_7e-1,
    8.333_333e-3,
    -1.984_127e-4,
    2.755_731_9e-6,
    -2.505_210_8e-8,
    1.605_904_4e-10,
    -7.647_164e-13,
];

#[inline]
fn horner<const N: usize>(x: f32, coefficients: &[f32; N]) -> f32 {
    let mut sum = 0.0;
    for coefficient in coefficients.iter().rev() {
        sum = sum * x + coefficient;
    }
    sum
}

/// pi/2 in three parts whose leading ones have few bits, so that quadrant * part is exact.
const HALF_PI_PARTS: [f32; 3] = [1.570_312_5, 4.837_513e-4, 7.549_79e-8];

fn sine_cosine_f32(angle_rad: f32) -> (f32, f32) {
    let turns = angle_rad * core::f32::consts::FRAC_2_PI;
    // The cast saturates, so absurd angles give a wrong but finite answer, never a fault.
    let quadrant = if turns >= 0.0 {
        turns + 0.5
    } else {
        turns - 0.5
    } as i32;
    let count = quadrant as f32;
    let x = ((angle_rad - count * HALF_PI_PARTS[0]) - count * HALF_PI_PARTS[1])
        - count * HALF_PI_PARTS[2];
    let z = x * x;
    let sine = ((-1.951_529_6e-4 * z + 8.332_161e-3) * z - 1.666_665_5e-1) * z * x + x;
    let cosine =
        ((2.443_315_7e-5 * z - 1.388_731_6e-3) * z + 4.166_664_6e-2) * z * z - 0.5 * z + 1.0;
    match quadrant & 3 {
        0 => (sine, cosine),
        1 => (cosine, -sine),
        2 => (-sine, -cosine),
        _ => (-cosine, sine),
    }
}

/// tan(pi/8): above it the argument is turned back by pi/4.
const TANGENT_OF_EIGHTH: f32 = 0.414_213_57;

/// Arctangent up to tan(pi/8).
#[inline(always)]
fn small_angle_f32(t: f32) -> f32 {
    let z = t * t;
    let series = ((8.053_744_6e-2 * z - 1.387_768_6e-1) * z + 1.997_771e-1) * z - 3.333_295e-1;
    series * z * t + t
}

fn angle_f32(y: f32, x: f32) -> f32 {
    use core::f32::consts::{FRAC_PI_2, FRAC_PI_4, PI};
    // Heads are mostly tilted by less: a way out at a third of the instructions, with the same result.
    if x > 0.0 && y.abs() <= TANGENT_OF_EIGHTH * x {
        return small_angle_f32(y / x);
    }
    let (across, along) = (y.abs(), x.abs());
    let (small, large) = if across <= along {
        (across, along)
    } else {
        (along, across)
    };
    if large == 0.0 {
        return 0.0;
    }
    let (t, offset_rad) = if small > TANGENT_OF_EIGHTH * large {
        ((small - large) / (small + large), FRAC_PI_4)
    } else {
        (small / large, 0.0)
    };
    let mut angle_rad = offset_rad + small_angle_f32(t);
    if across > along {
        angle_rad = FRAC_PI_2 - angle_rad;
    }
    if x < 0.0 {
        angle_rad = PI - angle_rad;
    }
    if y < 0.0 { -angle_rad } else { angle_rad }
}

/// The reciprocal root by halving the exponent, then three of Newton's steps. libm's sqrtf works
/// bit by bit, at three times the instructions; the core's own instruction is not to be had
/// without unsafe code.
fn root_f32(square: f32) -> f32 {
    if square < 1e-30 {
        return 0.0;
    }
    let mut reciprocal = f32::from_bits(0x5f37_59df - (square.to_bits() >> 1));
    let half = 0.5 * square;
    for _ in 0..3 {
        reciprocal *= 1.5 - half * reciprocal * reciprocal;
    }
    square * reciprocal
}

/// A comparison, because `min` is a call on a Cortex-M4F.
#[inline]
pub(crate) fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[cfg(test)]
mod tests {
    //! Goal: the bounds stated above. Method: dense sweeps over the whole range against libm in
    //! f64, evaluated at the very f32 argument.
    use super::*;

    #[test]
    fn sine_and_cosine_keep_their_bound_over_a_thousand_radians() {
        let mut worst = 0.0f64;
        for i in -1_000_000i32..=1_000_000 {
            let angle = i as f32 * 1e-3;
            let (sine, cosine) = angle.sine_cosine();
            let (s, c) = libm::sincos(f64::from(angle));
            worst = worst.max((f64::from(sine) - s).abs());
            worst = worst.max((f64::from(cosine) - c).abs());
        }
        assert!(worst > 1e-9 && worst < 1.5e-7, "{worst:e}");
    }

    #[test]
    fn angle_keeps_its_bound_in_all_quadrants() {
        let mut worst = 0.0f64;
        for i in 0..1_000_000 {
            let direction = f64::from(i) * core::f64::consts::TAU / 1e6;
            let (s, c) = libm::sincos(direction);
            let radius = if i % 3 == 0 { 1e-6 } else { 350.0 };
            let (y, x) = ((s * radius) as f32, (c * radius) as f32);
            let exact = libm::atan2(f64::from(y), f64::from(x));
            worst = worst.max((f64::from(y.angle_from_x(x)) - exact).abs());
        }
        assert!(worst > 1e-9 && worst < 4e-7, "{worst:e}");
        assert_eq!(0.0f32.angle_from_x(0.0), 0.0);
    }

    #[test]
    fn root_keeps_its_bound_over_all_magnitudes() {
        let mut worst = 0.0f64;
        for bits in (0..0x7f00_0000u32).step_by(1009) {
            let square = f32::from_bits(bits);
            if square < 1e-30 {
                assert_eq!(square.root(), 0.0);
                continue;
            }
            let exact = libm::sqrt(f64::from(square));
            worst = worst.max((f64::from(square.root()) / exact - 1.0).abs());
        }
        assert!(worst > 1e-9 && worst < 2.5e-7, "{worst:e}");
        assert_eq!((-1.0f32).root(), 0.0);
    }

    #[test]
    fn tilt_series_keeps_its_bound_up_to_150_degrees() {
        let (mut worst_cosine, mut worst_sinc) = (0.0f64, 0.0f64);
        let most = (150.0f64).to_radians();
        for i in 0..=200_000 {
            let theta = most * f64::from(i) / 200_000.0;
            let square = (theta * theta) as f32;
            let (cosine, sinc) = square.cosine_and_sinc_of_square();
            let (c, s) = f64::from(square).cosine_and_sinc_of_square();
            worst_cosine = worst_cosine.max((f64::from(cosine) - c).abs());
            worst_sinc = worst_sinc.max((f64::from(sinc) - s).abs());
        }
        assert!(worst_cosine < 8e-7, "{worst_cosine:e}");
        assert!(worst_sinc < 3e-7, "{worst_sinc:e}");
    }

    #[test]
    fn double_series_is_smooth_where_it_changes_form() {
        for square in [9.9e-5f64, 1.01e-4, 1e-9, 0.0] {
            let (cosine, sinc) = square.cosine_and_sinc_of_square();
            let theta = square.sqrt();
            let exact = if theta > 0.0 {
                theta.sin() / theta
            } else {
                1.0
            };
            assert!((cosine - theta.cos()).abs() < 1e-15, "{square}");
            assert!((sinc - exact).abs() < 1e-15, "{square}");
        }
    }
}
