//! The space that a tilting head occupies, checked against obstacles and earlier print.
//!
//! ```text
//! knots (height, radius) --profile--> HeadProfile      a solid of revolution about the tool axis
//! points laid, in order  --standing--> Standing        a tree whose nodes know their earliest point
//! pose, HeadProfile, Standing --touch--> Touch         exact for points with a half width
//! tips, wish, HeadProfile, Standing --free_axes--> the nearest free axis, or that there is none
//! ```
//!
//! All lengths in mm, angles in rad; a pose is a tip and a unit vector from it into the head. Contains
//! no machines and no planning.
#![forbid(unsafe_code)]

pub mod free_axes;
pub mod profile;
pub mod space;
pub mod standing;
pub mod touch;

/// A point or a direction in space, mm.
pub type Vector3 = nalgebra::Vector3<f64>;

/// Where a head is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// The tip.
    pub tip_mm: Vector3,
    /// From the tip into the head, unit.
    pub axis: Vector3,
}

impl Pose {
    /// The pose in the middle between this and another one; `None` if their axes are opposite.
    pub fn middle(&self, to: &Pose) -> Option<Pose> {
        let sum = self.axis + to.axis;
        let axis = sum.try_normalize(1e-6)?;
        let tip_mm = 0.5 * (self.tip_mm + to.tip_mm);
        Some(Pose { tip_mm, axis })
    }

    /// Height of a point above the tip's plane, and its distance from the axis, mm.
    #[inline]
    pub fn seen(&self, point: &Vector3) -> [f64; 2] {
        let away = point - self.tip_mm;
        let height_mm = away.dot(&self.axis);
        let square = away.norm_squared() - height_mm * height_mm;
        [height_mm, square.max(0.0).sqrt()]
    }
}

/// The example of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
