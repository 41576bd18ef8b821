//! The end-to-end tests, one program: a module a theme, in each a file a goal.

mod controller;
mod curved_ground;
mod curved_layers;
mod gcode;
mod headings;
mod inputs;
mod layers;
mod line;
mod measure;
mod motion;
mod six_axes;
mod slices;
mod tidy;
