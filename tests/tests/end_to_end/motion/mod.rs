//! Motion: limits, steps, a bed that is not flat.

mod bed_mesh;
mod limits;
mod scale;
mod steps;
