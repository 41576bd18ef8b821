//! Texts for people: numbers without needless digits, known names close to a misspelt one; and texts of people's
//! files, however they were saved; refusals.

pub mod near_name;
pub mod plain;
pub mod refusal;
pub mod short_number;
