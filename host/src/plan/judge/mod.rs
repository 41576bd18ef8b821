//! Judge: the quality of a plan, measured on the finished segments.
//!
//! ```text
//! SegmentStream, Contour --measure--> Swept, RegionRaster --figures--> PlanFigures
//! (integers, ticks)                   (mm², cells)                    (%, mm, s)
//! SegmentStream, chart --ground sweep--> Swept of each layer of curved ground, and on as above
//! ```

pub mod curve_ratio;
pub mod figures;
mod ground_raster;
pub mod ground_sweep;
pub mod measure;
pub mod region_raster;
pub mod touches;
