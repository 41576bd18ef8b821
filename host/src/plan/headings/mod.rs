//! headings

pub mod contacts;
pub mod heading_law;
pub mod headings_table;
pub mod profile;
pub mod runs;
