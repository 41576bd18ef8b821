//! A cubic between two values with given slopes.

/// The cubic (Hermite) at `t` from 0 to 1: from one value to another, `slopes` by t at both ends.
#[inline]
pub fn hermite(t: f64, [from, to]: [f64; 2], [out, into]: [f64; 2]) -> f64 {
    let (s, u) = (t * t * (3.0 - 2.0 * t), 1.0 - t);
    from + (to - from) * s + t * u * (out * u - into * t)
}

#[cfg(test)]
mod tests {
    use super::hermite;

    /// Goal: any cubic is its own. Method: x³ - 2 x² + 3 x + 1 by its values and slopes at 0 and 1.
    #[test]
    fn a_cubic_is_itself() {
        let cubic = |x: f64| ((x - 2.0) * x + 3.0) * x + 1.0;
        for k in 0..=10 {
            let t = 0.1 * f64::from(k);
            let found = hermite(t, [1.0, 3.0], [3.0, 2.0]);
            assert!((found - cubic(t)).abs() < 1e-14, "{t}: {found}");
        }
    }
}
