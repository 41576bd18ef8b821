//! The size of the tool at a pose, in the optimiser's units.
//!
//! In: a pose in a and rad, and the scale by position if the plane is the chart of a curved surface. Out: size of the
//! tool relative to that in the plane, and the offset of its middle from the pose's, in a. On a flat surface the size
//! is exactly 1 and the offset exactly 0, so that nothing changes there.

use super::curve::{Knot, Units};
use headway_geometry::Vector2;
use headway_geometry::place_scale::{PlaceScale, ScaleField};

/// The tool at a pose.
#[derive(Clone, Copy, Debug)]
pub struct Tooled {
    /// Its size against that of the plane, and one over that.
    pub size: f64,
    /// See `size`.
    pub inverse: f64,
    /// Its middle, in a.
    pub center: [f64; 2],
    /// The scale there, and the shift of the middle in mm; `None` on a flat surface.
    pub place: Option<(PlaceScale, Vector2)>,
}

/// The scale by place.
#[derive(Clone, Copy, Debug)]
pub struct ToolScale<'a> {
    field: Option<&'a ScaleField>,
    units: Units,
}

impl<'a> ToolScale<'a> {
    /// In these units, of which the length is half that of the tool.
    pub fn new(field: Option<&'a ScaleField>, units: Units) -> ToolScale<'a> {
        ToolScale { field, units }
    }

    /// At a pose.
    #[inline]
    pub fn at(&self, pose: &Knot) -> Tooled {
        let center = [pose[0], pose[1]];
        match self.field {
            None => Tooled {
                size: 1.0,
                inverse: 1.0,
                center,
                place: None,
            },
            Some(field) => {
                let length_mm = self.units.length_mm;
                let here = field.at(self.units.point_of(center[0], center[1]));
                let shift_mm = here.shift_mm(length_mm, pose[2]);
                Tooled {
                    size: 1.0 / here.lambda,
                    inverse: here.lambda,
                    center: [
                        center[0] + shift_mm.x / length_mm,
                        center[1] + shift_mm.y / length_mm,
                    ],
                    place: Some((here, shift_mm)),
                }
            }
        }
    }
}
