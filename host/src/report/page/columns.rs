//! Columns of numbers as text that the page's script reads.
//!
//! In: samples. Out: base64. [`Column`]: numbers of 16 bits over their range, low byte first (a 65,535th of it is
//! their resolution). [`Steps`]: what each whole number of units adds to the one before, zigzag, seven bits a byte,
//! low bits first, the top bit where more follow (LEB128): a point of a path is one or two bytes a coordinate.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde::Serialize;

/// Numbers over their range.
#[derive(Serialize)]
pub struct Column {
    min: f32,
    max: f32,
    b64: String,
}

/// Whole numbers of a unit by their differences.
#[derive(Debug, PartialEq, Serialize)]
pub struct Steps {
    unit: f64,
    b64: String,
}

impl Column {
    /// Of values.
    pub fn of(values: &[f32]) -> Column {
        let min = values.iter().copied().fold(f32::INFINITY, f32::min);
        let max = values.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        let (min, max) = if min <= max { (min, max) } else { (0.0, 0.0) };
        let scale = f64::from(u16::MAX) / f64::from(max - min).max(1e-30);
        let number = |value: &f32| (f64::from(value - min) * scale).round() as u16;
        let bytes: Vec<u8> = values
            .iter()
            .flat_map(|v| number(v).to_le_bytes())
            .collect();
        Column {
            min,
            max,
            b64: STANDARD.encode(bytes),
        }
    }
}

impl Steps {
    /// Of values in so fine a unit.
    pub fn of(values: impl Iterator<Item = f64>, unit: f64) -> Steps {
        let mut before = 0i64;
        let mut bytes = Vec::new();
        for value in values {
            let number = (value / unit).round() as i64;
            push(number.wrapping_sub(before), &mut bytes);
            before = number;
        }
        Steps {
            unit,
            b64: STANDARD.encode(bytes),
        }
    }
}

fn push(step: i64, bytes: &mut Vec<u8>) {
    let mut left = ((step << 1) ^ (step >> 63)) as u64;
    while left > 0x7f {
        bytes.push((left & 0x7f) as u8 | 0x80);
        left >>= 7;
    }
    bytes.push(left as u8);
}

#[cfg(test)]
mod tests {
    //! Goal: steps are what the head of this file says. Method: bytes by hand.
    use super::*;

    #[test]
    fn steps_are_zigzag_and_seven_bits_a_byte() {
        let steps = Steps::of([0.003, 0.002, -0.062, 0.237].into_iter(), 0.001);
        // 3, -1, -64, 299: 6, 1, 127, 598 = 0b100_1010110.
        assert_eq!(steps.b64, STANDARD.encode([6, 1, 127, 0xd6, 4]));
        assert_eq!(Steps::of(std::iter::empty(), 1.0).b64, "");
    }
}
