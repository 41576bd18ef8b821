//! Files of all formats, as they come and broken.

mod meshes;
mod mutated_files;
mod nurbs;
mod outlines;
mod progress;
