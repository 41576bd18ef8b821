//! Judge: what a plan is worth, measured on the finished segments.
//!
//! ```text
//! SegmentStream, Contour --measure--> Swept, RegionRaster --figures--> PlanFigures
//! (integers, ticks)                   (mm², cells)                    (%, mm, s)
//! ```

pub mod axes_at;
pub mod curve_ratio;
pub mod figures;
pub mod measure;
pub mod region_raster;
pub mod touches;
