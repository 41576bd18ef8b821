//! A 3MF package around the text of its model.

use std::io::{Cursor, Write};

/// The package; empty where it cannot be written, which memory always can.
pub fn of_model(model: &[u8]) -> Vec<u8> {
    let mut package = zip::ZipWriter::new(Cursor::new(Vec::new()));
    let options = zip::write::SimpleFileOptions::default();
    let begun = package.start_file("3D/3dmodel.model", options);
    if begun.is_err() || package.write_all(model).is_err() {
        return Vec::new();
    }
    package.finish().map(Cursor::into_inner).unwrap_or_default()
}
