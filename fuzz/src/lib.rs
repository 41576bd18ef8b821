//! What the fuzz targets share: machines, well-formed frames, the invariants of the controller.
//!
//! A target is a few lines; what it checks is here, so that a find can be replayed by a plain test.

pub mod attack;
pub mod board;
pub mod budget;
pub mod heat;
pub mod host;
pub mod job;
pub mod machines;
pub mod package;
pub mod sender;
pub mod settings;
pub mod target;

use headway::input::{self, Format, ReadOptions};
use headway::text::refusal::Refusal;

/// Reads `bytes` as an input. What is taken must be an outline, or a path, of finite numbers.
pub fn read_input(bytes: &[u8], format: Format) {
    let options = ReadOptions::default();
    match input::read(bytes, "fuzz", format, &options) {
        Ok(loaded) => {
            for region in &loaded.target.regions {
                let bounds = region.bounds();
                for point in [bounds.min, bounds.max] {
                    assert!(point.x.is_finite() && point.y.is_finite());
                }
            }
        }
        Err(error) => assert!(!error_text(&error).is_empty()),
    }
}

/// Messages are made of what was read: they must not fail either.
fn error_text(error: &Refusal) -> String {
    error.to_string()
}
