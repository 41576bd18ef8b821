//! Texts for people: numbers without needless digits, known names close to a misspelt one.

pub mod near_name;
pub mod short_number;
