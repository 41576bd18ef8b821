//! Planar geometry for the planner: shapes, apertures, distances. Contains no planning.
#![forbid(unsafe_code)]

pub mod apart;
pub mod aperture;
pub mod as_numbers;
pub mod banded;
pub mod boolean;
pub mod cell_grid;
pub mod chart;
pub mod clearance;
pub mod conformal;
pub mod coverage;
pub mod edge_index;
pub mod edge_meeting;
pub mod envelope;
pub mod frame;
pub mod hermite;
pub mod place_scale;
pub mod plane_curve;
pub mod point_grid;
pub mod polygon;
pub mod predicates;
pub mod repair;
pub mod rounded_polygon;
pub mod spline_surface;
pub mod tangent_disk;
pub mod tangle;
#[doc(hidden)]
pub mod test_shapes;
pub mod touching_rings;
pub mod union_find;
pub mod validity;

/// A point in the layer plane, mm.
pub type Point2 = nalgebra::Point2<f64>;
/// A vector in the layer plane, mm.
pub type Vector2 = nalgebra::Vector2<f64>;

/// The example of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
