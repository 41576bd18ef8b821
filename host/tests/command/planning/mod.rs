//! What the command makes of its inputs, and what it refuses.

mod api;
mod awkward;
mod copies;
mod dxf;
mod gcode;
mod meshes;
mod surfaces;
