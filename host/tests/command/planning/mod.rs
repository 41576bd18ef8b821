mod api;
mod awkward;
mod copies;
mod dxf;
mod gcode;
mod meshes;
