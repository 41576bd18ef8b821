//! judge

pub mod figures;
pub mod measure;
pub mod region_raster;
