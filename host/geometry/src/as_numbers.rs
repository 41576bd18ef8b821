//! Points in files, as two numbers.
//!
//! In and out: mm; for `serde(with)`, exact to the bit if the format keeps numbers exactly.

use super::Point2;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// A point as `[x, y]`.
///
/// # Errors
/// Those of the format.
pub fn serialize<S: Serializer>(at: &Point2, to: S) -> Result<S::Ok, S::Error> {
    [at.x, at.y].serialize(to)
}

/// A point from `[x, y]`.
///
/// # Errors
/// Those of the format.
pub fn deserialize<'a, D: Deserializer<'a>>(from: D) -> Result<Point2, D::Error> {
    <[f64; 2]>::deserialize(from).map(|[x, y]| Point2::new(x, y))
}
