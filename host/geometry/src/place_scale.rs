//! The size of the nozzle in a chart: lengths on a curved surface relative to those of its flattened plan, by
//! position.
//!
//! In: a chart and the height of the layer, mm. Out: a [`ScaleField`], the length lambda on the layer per length of
//! the chart, as a smooth function of the position in a region's frame. A nozzle that is a x b on the surface is a /
//! lambda x b / lambda in the chart. Where lambda changes over the nozzle's length, its outline is not quite an
//! ellipse there: a step v on the surface becomes v - (g . v) v + |v|² g / 2 in the chart, with g the gradient of ln
//! lambda (the exponential map of a conformal metric to second order; do Carmo, "Riemannian Geometry", 3.2). Most of
//! that is a shift of the centre along the long axis, and the rest is known at a contact.

use super::aperture::Aperture;
use super::chart::Chart;
use super::clearance::{Configuration, WallContact, contact};
use super::edge_index::EdgeIndex;
use super::frame::Frame;
use super::polygon::Box2;
use super::spline_surface::SplineSurface;
use super::{Point2, Vector2};
use std::sync::Arc;

/// Step between the places at which the scale is sampled, mm, unless there are more than this along an axis. Beside a fold the
/// scale changes within a millimetre: at twice the step it is half a per cent off there, 3 um of the nozzle's half.
const STEP_MM: f64 = 0.25;
const STEPS_MAX: f64 = 256.0;
/// How far the field may be off the logarithm at them, and its least pitch in steps.
const NEAR: f64 = 1e-4;
const PITCH_STEPS: f64 = 2.0;

/// Lengths on the surface per length in the chart, by position.
#[derive(Clone, Debug)]
pub struct ScaleField {
    log_scale: Arc<SplineSurface>,
    /// From a region's frame to the chart: out of the frame, then by this.
    frame: Frame,
    offset: Vector2,
}

/// The scale at a place of the field's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlaceScale {
    /// Length on the surface per length in the chart.
    pub lambda: f64,
    /// Gradient of its logarithm, 1/mm.
    pub by_mm: Vector2,
}

impl ScaleField {
    /// For a layer at a height above the surface of a chart, at the points of the surface within these bounds. `None`
    /// if there is no layer.
    pub fn of(
        chart: &dyn Chart,
        bounds: Box2,
        is_ground: impl Fn(Point2) -> bool,
        above_mm: f64,
    ) -> Option<ScaleField> {
        let size = bounds.size();
        let step_mm = (size.x.max(size.y) / STEPS_MAX).max(STEP_MM);
        let [columns, rows] = [size.x, size.y].map(|side| (side / step_mm).ceil().max(1.0) as u32);
        let places = (0..=rows).flat_map(|row| (0..=columns).map(move |column| [column, row]));
        let points = places.filter_map(|[column, row]| {
            let at = Point2::new(
                bounds.min.x + size.x * f64::from(column) / f64::from(columns),
                bounds.min.y + size.y * f64::from(row) / f64::from(rows),
            );
            let area = is_ground(at).then(|| chart.frame(at, above_mm).area_factor());
            let area = area.filter(|area| *area > 0.0)?;
            Some([at.x, at.y, 0.5 * area.ln()])
        });
        let points: Vec<[f64; 3]> = points.collect();
        let fitted = SplineSurface::through(&points, bounds, NEAR, PITCH_STEPS * step_mm)?;
        Some(ScaleField {
            log_scale: Arc::new(fitted.surface),
            frame: Frame::IDENTITY,
            offset: Vector2::zeros(),
        })
    }

    /// The same in a region's frame: its points are transformed by `frame` to the outside and shifted by `offset`
    /// into this one.
    pub fn in_frame(&self, frame: Frame, offset: Vector2) -> ScaleField {
        ScaleField {
            log_scale: Arc::clone(&self.log_scale),
            frame,
            offset,
        }
    }

    /// At a place.
    pub fn at(&self, p: Point2) -> PlaceScale {
        let place = self.frame.point_out(p) + self.offset;
        let jet = self.log_scale.jet(place.x, place.y);
        PlaceScale {
            lambda: jet.z_mm.exp(),
            by_mm: self.frame.vector_in(Vector2::from(jet.slope)),
        }
    }
}

impl ScaleField {
    /// The middle of a tool of this half length at a pose, and its size there relative to its own.
    pub fn tool_at(&self, at: Configuration, major_mm: f64) -> (Point2, f64) {
        let here = self.at(at.center);
        let shift_mm = here.shift_mm(major_mm, at.heading_rad);
        (at.center + shift_mm, 1.0 / here.lambda)
    }
}

impl PlaceScale {
    /// The aperture as large as it is here.
    pub fn aperture(&self, aperture: &Aperture) -> Aperture {
        aperture.scaled(1.0 / self.lambda)
    }

    /// Offset of the middle of the aperture's long axis from the tip in the chart, mm.
    pub fn shift_mm(&self, major_mm: f64, heading_rad: f64) -> Vector2 {
        let (sin, cos) = heading_rad.sin_cos();
        let along = Vector2::new(cos, sin);
        let major_mm = major_mm / self.lambda;
        -0.5 * major_mm * major_mm * self.by_mm.dot(&along) * along
    }

    /// Additional extent of the aperture in a direction compared with the shifted, scaled one that touches there with
    /// the point `support` from its own middle, mm.
    pub fn beyond_mm(&self, shift_mm: Vector2, support: Vector2, outward: Vector2) -> f64 {
        let bent = 0.5 * support.norm_squared() * self.by_mm - self.by_mm.dot(&support) * support;
        (bent - shift_mm).dot(&outward)
    }
}

/// The aperture and its pose as they are in the chart: as given where there is no field.
pub fn placed(
    scale: Option<&ScaleField>,
    aperture: &Aperture,
    at: Configuration,
) -> (Aperture, Configuration) {
    let Some(scale) = scale else {
        return (*aperture, at);
    };
    let here = scale.at(at.center);
    let shift_mm = here.shift_mm(aperture.major_mm(), at.heading_rad);
    let at = Configuration {
        center: at.center + shift_mm,
        ..at
    };
    (here.aperture(aperture), at)
}

/// The deepest cut of the aperture of a pose in the chart into the walls, as [`contact`] finds it in the plane;
/// the extent beyond its shifted, scaled shape is included at the contact.
pub fn contact_on_ground(
    scale: &ScaleField,
    aperture: &Aperture,
    at: Configuration,
    walls: &EdgeIndex,
) -> Option<WallContact> {
    let here = scale.at(at.center);
    let shift_mm = here.shift_mm(aperture.major_mm(), at.heading_rad);
    let aperture = here.aperture(aperture);
    let center = at.center + shift_mm;
    let found = contact(&aperture, Configuration { center, ..at }, walls, NEARLY)?;
    let support = aperture.support_point(at.heading_rad, found.outward);
    let beyond_mm = here.beyond_mm(shift_mm, support, found.outward);
    Some(WallContact {
        depth_mm: found.depth_mm + beyond_mm,
        ..found
    })
}

/// Walls this near, in sizes of the aperture, may be cut by its reach beyond its shape.
const NEARLY: f64 = 1.1;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chart::{ChartJet, SurfaceFrame};
    use crate::test_shapes::ELLIPSE;
    use nalgebra::Vector3;

    /// A sphere of R 10 seen from its south pole: conformal, its scale is known.
    struct Stereographic;

    const RADIUS_MM: f64 = 10.0;

    fn on_sphere(p: Point2) -> Vector3<f64> {
        let (x, y) = (p.x / (2.0 * RADIUS_MM), p.y / (2.0 * RADIUS_MM));
        let square = x * x + y * y;
        RADIUS_MM * Vector3::new(2.0 * x, 2.0 * y, 1.0 - square) / (1.0 + square)
    }

    impl Chart for Stereographic {
        fn jet(&self, at: Point2) -> ChartJet {
            let h = 1e-3;
            let place = |i: f64, j: f64| on_sphere(at + h * Vector2::new(i, j));
            let here = place(0.0, 0.0);
            let [u, v] = [[1.0, 0.0], [0.0, 1.0]].map(|[i, j]| {
                let (before, after) = (place(-i, -j), place(i, j));
                (
                    (after - before) / (2.0 * h),
                    (after + before - 2.0 * here) / (h * h),
                )
            });
            let mixed = place(1.0, 1.0) - place(1.0, -1.0) - place(-1.0, 1.0) + place(-1.0, -1.0);
            ChartJet {
                at_mm: here,
                along: [u.0, v.0],
                bend: [u.1, mixed / (4.0 * h * h), v.1],
            }
        }
    }

    /// Where a vector of the tangent plane lies on the sphere, in the chart.
    fn in_chart(frame: &SurfaceFrame, off: Vector3<f64>) -> Point2 {
        let length = off.norm() / RADIUS_MM;
        let to = frame.tip_mm * length.cos() + off * RADIUS_MM * length.sin() / off.norm();
        Point2::new(to.x, to.y) * (2.0 * RADIUS_MM / (RADIUS_MM + to.z))
    }

    /// Goal: the nozzle in the chart is the nozzle on the ground. Method: the outline of an ellipse of 0.6 x 0.2 mm on a
    /// sphere of R 10 at 45°, point by point in the chart, against support of the scaled, shifted ellipse and what it
    /// reaches beyond; without the shift 7.5 um are missed.
    #[test]
    fn the_nozzle_is_as_large_as_on_the_ground() {
        let bounds = Box2 {
            min: Point2::new(2.0, -5.0),
            max: Point2::new(12.0, 5.0),
        };
        let field = ScaleField::of(&Stereographic, bounds, |_| true, 0.0).unwrap();
        let at = Point2::new(20.0 * (45f64.to_radians() / 2.0).tan(), 0.3);
        let here = field.at(at);
        let square = (at.coords / (2.0 * RADIUS_MM)).norm_squared();
        assert!(
            (here.lambda * (1.0 + square) - 1.0).abs() < 1e-4,
            "{here:?}"
        );
        let frame = Stereographic.frame(at, 0.0);
        for heading_rad in [0.0, 0.5, 1.1, 2.0, 2.9] {
            let axis = frame.mapped(Vector2::new(f64::cos(heading_rad), f64::sin(heading_rad)));
            let axis = axis.normalize();
            let beside = frame.normal.cross(&axis);
            let outline: Vec<Vector2> = (0..720)
                .map(|k| {
                    let (sin, cos) = f64::from(k).to_radians().mul_add(0.5, 1e-3).sin_cos();
                    in_chart(&frame, 0.6 * cos * axis + 0.2 * sin * beside) - at
                })
                .collect();
            let (aperture, shifted) = placed(
                Some(&field),
                &ELLIPSE,
                Configuration {
                    center: at,
                    heading_rad,
                },
            );
            let shift = shifted.center - at;
            let mut off_without_mm = 0.0f64;
            for k in 0..24 {
                let (sin, cos) = (f64::from(k) * 15f64.to_radians()).sin_cos();
                let outward = Vector2::new(cos, sin);
                let reach = outline.iter().map(|p| p.dot(&outward)).fold(0.0, f64::max);
                let own = aperture.support_mm(heading_rad, outward);
                let support = aperture.support_point(heading_rad, outward);
                let beyond = here.beyond_mm(shift, support, outward);
                let found = own + shift.dot(&outward) + beyond;
                // Third order: a³ over the square of R, a fifth of it.
                assert!(
                    (found - reach).abs() < 6e-4,
                    "{heading_rad} {k} {found} {reach}"
                );
                off_without_mm = off_without_mm.max((own - reach).abs());
            }
            assert!(off_without_mm > 2e-3, "{off_without_mm}");
        }
    }
}
