//! A place of a plan -> the place on the surface: tip, normal, and how lengths and areas stretch there.
//!
//! In: a smooth surface, a place of the plan and the height above the surface, mm. Out: a
//! [`SurfaceFrame`]. Layers lie on parallel surfaces: the point S + t n for the layer whose top is t above
//! the surface S with normal n, so that every layer is as thick along the normal.

use crate::geometry::Vector2;
use crate::geometry::spline_surface::SplineSurface;
use nalgebra::Vector3;

/// Where a place of the plan lies on the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceFrame {
    /// The tip, mm.
    pub tip_mm: Vector3<f64>,
    /// Unit normal, upwards.
    pub normal: Vector3<f64>,
    /// Where a step of 1 mm along the plan's x and y leads.
    along: [Vector3<f64>; 2],
}

impl SurfaceFrame {
    /// At a place of the plan, so far above the surface along its normal.
    pub fn at(surface: &SplineSurface, x_mm: f64, y_mm: f64, above_mm: f64) -> SurfaceFrame {
        let jet = surface.jet(x_mm, y_mm);
        let [zx, zy] = jet.slope;
        let [zxx, zxy, zyy] = jet.bend;
        let upward = Vector3::new(-zx, -zy, 1.0);
        let length = upward.norm();
        let normal = upward / length;
        // The normal's derivative: that of the upward vector without its part along the normal.
        let turned = |bend: [f64; 2]| {
            let by = Vector3::new(-bend[0], -bend[1], 0.0) / length;
            by - normal * by.dot(&normal)
        };
        SurfaceFrame {
            tip_mm: Vector3::new(x_mm, y_mm, jet.z_mm) + above_mm * normal,
            normal,
            along: [
                Vector3::new(1.0, 0.0, zx) + above_mm * turned([zxx, zxy]),
                Vector3::new(0.0, 1.0, zy) + above_mm * turned([zxy, zyy]),
            ],
        }
    }

    /// Area on the surface for one of the plan; 0 and less where the layer would fold in a hollow.
    pub fn area_factor(&self) -> f64 {
        self.along[0].cross(&self.along[1]).dot(&self.normal)
    }

    /// Where a step in the plan leads.
    pub fn mapped(&self, step: Vector2) -> Vector3<f64> {
        step.x * self.along[0] + step.y * self.along[1]
    }

    /// How much wider than in the plan a bead has to be that is laid in this direction of the plan.
    pub fn width_factor(&self, direction: Vector2) -> f64 {
        self.area_factor() * direction.norm() / self.mapped(direction).norm()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Point2;
    use crate::geometry::polygon::Box2;

    /// Goal: the frame's tangents are those of the parallel surface. Method: central differences on a bowl.
    #[test]
    fn tangents_are_those_of_the_layer() {
        let z = |x: f64, y: f64| 0.02 * x * x + 0.01 * x * y + 0.03 * y * y;
        let points: Vec<[f64; 3]> = (0..900)
            .map(|i| {
                let (x, y) = (f64::from(i % 30) - 15.0, f64::from(i / 30) - 15.0);
                [x, y, z(x, y)]
            })
            .collect();
        let bounds = Box2::of(&[Point2::new(-15.0, -15.0), Point2::new(14.0, 14.0)]);
        let fitted = SplineSurface::through(&points, bounds, 0.01, 2.0).unwrap();
        let at = |x: f64, y: f64| SurfaceFrame::at(&fitted.surface, x, y, 0.8);
        let (frame, h) = (at(4.0, -3.0), 1e-4);
        let steps = [
            (at(4.0 + h, -3.0).tip_mm - at(4.0 - h, -3.0).tip_mm) / (2.0 * h),
            (at(4.0, -3.0 + h).tip_mm - at(4.0, -3.0 - h).tip_mm) / (2.0 * h),
        ];
        for (along, step) in frame.along.iter().zip(&steps) {
            assert!((along - step).norm() < 1e-6, "{along} {step}");
            assert!(along.dot(&frame.normal).abs() < 1e-9);
        }
        // Up the steepest way a bead lies as wide as in the plan, along it on the level wider.
        let slope = Vector2::new(
            fitted.surface.jet(4.0, -3.0).slope[0],
            fitted.surface.jet(4.0, -3.0).slope[1],
        );
        let level = Vector2::new(-slope.y, slope.x);
        let ground = SurfaceFrame::at(&fitted.surface, 4.0, -3.0, 0.0);
        assert!((ground.width_factor(slope) - 1.0).abs() < 1e-9);
        let steep = (1.0 + slope.norm_squared()).sqrt();
        assert!((ground.width_factor(level) - steep).abs() < 1e-9);
    }
}
