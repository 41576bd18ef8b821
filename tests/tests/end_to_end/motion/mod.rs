//! Motion: limits, steps, a bed that is not flat.

mod bed_mesh;
mod core_xy;
mod limits;
mod scale;
mod steps;
mod units;
mod winding;
