//! Texts for people: numbers without needless digits, names that come near a misspelt one.

pub mod near_name;
pub mod short_number;
