//! Numbers in messages, as people write them: no longer than needed.

use std::fmt;

/// Shows a number; far from 1 with an exponent instead of hundreds of digits.
pub(crate) struct Short(pub(crate) f64);

impl fmt::Display for Short {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let size = self.0.abs();
        match size == 0.0 || !size.is_finite() || (1e-6..1e15).contains(&size) {
            true => write!(f, "{}", self.0),
            false => write!(f, "{:e}", self.0),
        }
    }
}

/// A number with `digits` digits after the point, or as many more as necessary to distinguish it from
/// `others`.
pub(crate) fn told_apart(number: f64, others: &[f64], digits: usize) -> String {
    /// Beyond it doubles of the size of an angle or a machine have no more digits.
    const DIGITS_MAX: usize = 12;
    let with = |value: f64, digits: usize| format!("{value:.digits$}");
    let reads_alike = |digits: usize| {
        let number_text = with(number, digits);
        let mut unlike = others.iter().filter(|other| **other != number);
        unlike.any(|other| with(*other, digits) == number_text)
    };
    let enough = (digits..DIGITS_MAX).find(|digits| !reads_alike(*digits));
    with(number, enough.unwrap_or(DIGITS_MAX))
}

#[cfg(test)]
mod tests {
    use super::{Short, told_apart};

    /// Goal: no message says that a number is outside of itself.
    #[test]
    fn numbers_show_the_digits_that_differ() {
        assert_eq!(told_apart(-130.5, &[-120.0, 30.0], 3), "-130.500");
        assert_eq!(told_apart(-120.000_04, &[-120.0, 30.0], 3), "-120.00004");
        assert_eq!(told_apart(150.000_2, &[150.0], 1), "150.0002");
        assert_eq!(told_apart(f64::INFINITY, &[1.0], 1), "inf");
        assert_eq!(told_apart(1.0, &[1.0], 2), "1.00");
    }

    #[test]
    fn numbers_are_short() {
        for (number, text) in [
            (0.0, "0"),
            (60.0, "60"),
            (-0.05, "-0.05"),
            (1e308, "1e308"),
            (1e-300, "1e-300"),
            (f64::INFINITY, "inf"),
        ] {
            assert_eq!(Short(number).to_string(), text);
        }
    }
}
