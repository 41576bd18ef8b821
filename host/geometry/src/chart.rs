//! Charts of curved surfaces: the plane of a plan -> points in space, with the stretch of lengths there.
//!
//! In: a point of the chart and a height above the surface along its normal, mm. Out: a [`SurfaceFrame`]. A [`Chart`]
//! is the plane itself, heights over a plane ([`SplineSurface`]), or a patch that was flattened without shear
//! ([`PatchChart`], by [`crate::conformal`]), where lengths stretch by one factor at each point. Layers are on
//! parallel surfaces: the point S + t n for the layer whose top is t above the surface S with normal n, so that every
//! layer has the same thickness along the normal.

use super::polygon::Box2;
use super::spline_surface::{PatchSplines, SplineSurface};
use super::{Point2, Vector2};
use nalgebra::{Matrix2, Vector3};

/// Steps of Newton's method to the place of a point, and the step at which it has it, mm.
const STEPS_MAX: usize = 20;
const SETTLED_MM: f64 = 1e-9;
/// Longest step of them, mm, and how often one is halved that leads away.
const STEP_MAX_MM: f64 = 5.0;
const HALVINGS_MAX: usize = 8;

/// A point on the surface with its derivatives by the chart's coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChartJet {
    /// Where, mm.
    pub at_mm: Vector3<f64>,
    /// By u and v.
    pub along: [Vector3<f64>; 2],
    /// By uu, uv and vv, 1/mm.
    pub bend: [Vector3<f64>; 3],
}

impl ChartJet {
    /// Distance of a point from the surface along the normal, mm: a lateral deviation only moves it in the chart.
    pub fn off_mm(&self, point: Vector3<f64>) -> f64 {
        let normal = self.along[0].cross(&self.along[1]).normalize();
        (point - self.at_mm).dot(&normal).abs()
    }
}

/// The plane of a plan, mapped onto a surface.
pub trait Chart: Sync {
    /// Position and derivatives of the surface.
    fn jet(&self, at: Point2) -> ChartJet;

    /// The frame at a height above the surface.
    fn frame(&self, at: Point2, above_mm: f64) -> SurfaceFrame {
        SurfaceFrame::of(&self.jet(at), above_mm)
    }

    /// The place over which a point is this far above the surface, from a place near it: where the point
    /// is nearest to that layer.
    fn place_of(&self, point: Vector3<f64>, near: Point2, above_mm: f64) -> Point2 {
        let mut at = near;
        let mut frame = self.frame(at, above_mm);
        for _ in 0..STEPS_MAX {
            let off = point - frame.tip_mm;
            let [u, v] = frame.along;
            let mixed = u.dot(&v);
            let metric = Matrix2::new(u.norm_squared(), mixed, mixed, v.norm_squared());
            let right = Vector2::new(off.dot(&u), off.dot(&v));
            let Some(inverse) = metric.try_inverse() else {
                break;
            };
            let mut step = (inverse * right).cap_magnitude(STEP_MAX_MM);
            // Where the surface bends strongly a full step may diverge.
            let mut next = self.frame(at + step, above_mm);
            for _ in 0..HALVINGS_MAX {
                if (point - next.tip_mm).norm_squared() <= off.norm_squared() {
                    break;
                }
                step *= 0.5;
                next = self.frame(at + step, above_mm);
            }
            (at, frame) = (at + step, next);
            if step.norm() < SETTLED_MM {
                break;
            }
        }
        at
    }
}

/// The plane itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane;

impl Chart for Plane {
    fn jet(&self, at: Point2) -> ChartJet {
        ChartJet {
            at_mm: Vector3::new(at.x, at.y, 0.0),
            along: [Vector3::x(), Vector3::y()],
            bend: [Vector3::zeros(); 3],
        }
    }
}

impl Chart for SplineSurface {
    fn jet(&self, at: Point2) -> ChartJet {
        let jet = SplineSurface::jet(self, at.x, at.y);
        ChartJet {
            at_mm: Vector3::new(at.x, at.y, jet.z_mm),
            along: [
                Vector3::new(1.0, 0.0, jet.slope[0]),
                Vector3::new(0.0, 1.0, jet.slope[1]),
            ],
            bend: jet.bend.map(|bend| Vector3::new(0.0, 0.0, bend)),
        }
    }
}

/// A flattened patch: its vertices, and a smooth surface through them.
#[derive(Clone, Debug, PartialEq)]
pub struct PatchChart {
    splines: PatchSplines,
    /// Vertices on the surface, mm, and their positions in the chart.
    vertices: Vec<(Vector3<f64>, Point2)>,
    /// The largest distance of the surface from the vertices, mm, and its place.
    pub off_mm: f64,
    /// That vertex.
    pub off_at_mm: Vector3<f64>,
}

impl PatchChart {
    /// A smooth surface through the vertices of a flattened patch and more points of its triangles, on the coarsest
    /// grid that is within `near_mm` of all of them, or of pitch `pitch_min_mm`. `None` without vertices.
    pub fn through(
        vertices: &[(Vector3<f64>, Point2)],
        inner: &[(Vector3<f64>, Point2)],
        near_mm: f64,
        pitch_min_mm: f64,
    ) -> Option<PatchChart> {
        let places: Vec<Point2> = vertices.iter().map(|(_, place)| *place).collect();
        if places.is_empty() {
            return None;
        }
        let mut points = vertices.to_vec();
        points.extend_from_slice(inner);
        let splines = PatchSplines::through(&points, Box2::of(&places), near_mm, pitch_min_mm);
        let mut chart = PatchChart {
            splines,
            vertices: vertices.to_vec(),
            off_mm: 0.0,
            off_at_mm: vertices[0].0,
        };
        for (point, place) in &points {
            let off_mm = chart.jet(*place).off_mm(*point);
            if off_mm > chart.off_mm {
                (chart.off_mm, chart.off_at_mm) = (off_mm, *point);
            }
        }
        Some(chart)
    }

    /// The same surface, with the chart scaled by `factor`.
    pub fn scaled(mut self, factor: f64) -> PatchChart {
        self.splines = self.splines.scaled(factor);
        for (_, place) in &mut self.vertices {
            *place *= factor;
        }
        self
    }

    /// The box of the vertices in the chart.
    pub fn bounds(&self) -> Box2 {
        let places: Vec<Point2> = self.vertices.iter().map(|(_, place)| *place).collect();
        Box2::of(&places)
    }

    /// The chart's place of the vertex nearest to a point.
    pub fn near(&self, point: Vector3<f64>) -> Point2 {
        let away = |vertex: &&(Vector3<f64>, Point2)| (vertex.0 - point).norm_squared();
        let nearest = self
            .vertices
            .iter()
            .min_by(|a, b| away(a).total_cmp(&away(b)));
        nearest.map_or(Point2::origin(), |(_, place)| *place)
    }

    /// The point of the chart below a given point.
    pub fn place(&self, point: Vector3<f64>) -> Point2 {
        self.place_of(point, self.near(point), 0.0)
    }
}

impl Chart for PatchChart {
    fn jet(&self, at: Point2) -> ChartJet {
        self.splines.jet(at)
    }
}

/// A point of a chart in space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceFrame {
    /// The tip, mm.
    pub tip_mm: Vector3<f64>,
    /// Unit normal, out of the surface.
    pub normal: Vector3<f64>,
    /// The images of a step of 1 mm along each of the chart's axes.
    pub along: [Vector3<f64>; 2],
}

impl SurfaceFrame {
    /// The point at a height above the surface along its normal.
    pub fn of(jet: &ChartJet, above_mm: f64) -> SurfaceFrame {
        let [u, v] = jet.along;
        let [uu, uv, vv] = jet.bend;
        let square = u.cross(&v);
        let length = square.norm();
        let normal = square / length;
        // The normal's derivative: that of the square without its part along the normal.
        let turned = |by_u: Vector3<f64>, by_v: Vector3<f64>| {
            let by = (by_u.cross(&v) + u.cross(&by_v)) / length;
            by - normal * by.dot(&normal)
        };
        SurfaceFrame {
            tip_mm: jet.at_mm + above_mm * normal,
            normal,
            along: [u + above_mm * turned(uu, uv), v + above_mm * turned(uv, vv)],
        }
    }

    /// Area on the layer for one of the chart; 0 and less where the layer would fold in a hollow.
    pub fn area_factor(&self) -> f64 {
        self.along[0].cross(&self.along[1]).dot(&self.normal)
    }

    /// The image of a step in the chart.
    pub fn mapped(&self, step: Vector2) -> Vector3<f64> {
        step.x * self.along[0] + step.y * self.along[1]
    }

    /// The factor by which a bead in this direction of the chart must be wider than in the chart.
    pub fn width_factor(&self, direction: Vector2) -> f64 {
        self.area_factor() * direction.norm() / self.mapped(direction).norm()
    }

    /// The greatest and least length on the layer for one of the chart.
    pub fn stretches(&self) -> [f64; 2] {
        let [u, v] = self.along;
        let (middle, half) = (
            0.5 * (u.norm_squared() + v.norm_squared()),
            (0.5 * (u.norm_squared() - v.norm_squared())).hypot(u.dot(&v)),
        );
        [middle + half, (middle - half).max(0.0)].map(f64::sqrt)
    }
}

/// The largest curvature of the surface at a point, 1/mm: the greater of its two curvatures, positive where it is
/// concave.
pub fn sharpest_bend_per_mm(jet: &ChartJet) -> f64 {
    let [u, v] = jet.along;
    let normal = u.cross(&v).normalize();
    let [e, f, g] = [u.norm_squared(), u.dot(&v), v.norm_squared()];
    let [l, m, n] = jet.bend.map(|bend| bend.dot(&normal));
    let square = e * g - f * f;
    let mean = 0.5 * (e * n - 2.0 * f * m + g * l) / square;
    let root = (mean * mean - (l * n - m * m) / square).max(0.0).sqrt();
    match mean >= 0.0 {
        true => mean + root,
        false => mean - root,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::conformal::flattened;

    fn bowl(x: f64, y: f64) -> f64 {
        0.02 * x * x + 0.01 * x * y + 0.03 * y * y
    }

    /// Goal: the frame's tangents are those of the parallel surface. Method: central differences on a bowl.
    #[test]
    fn tangents_are_those_of_the_layer() {
        let points: Vec<[f64; 3]> = (0..900)
            .map(|i| {
                let (x, y) = (f64::from(i % 30) - 15.0, f64::from(i / 30) - 15.0);
                [x, y, bowl(x, y)]
            })
            .collect();
        let bounds = Box2::of(&[Point2::new(-15.0, -15.0), Point2::new(14.0, 14.0)]);
        let fitted = SplineSurface::through(&points, bounds, 0.01, 2.0).unwrap();
        let at = |x: f64, y: f64| fitted.surface.frame(Point2::new(x, y), 0.8);
        let (frame, h) = (at(4.0, -3.0), 1e-4);
        let steps = [
            (at(4.0 + h, -3.0).tip_mm - at(4.0 - h, -3.0).tip_mm) / (2.0 * h),
            (at(4.0, -3.0 + h).tip_mm - at(4.0, -3.0 - h).tip_mm) / (2.0 * h),
        ];
        for (along, step) in frame.along.iter().zip(&steps) {
            assert!((along - step).norm() < 1e-6, "{along} {step}");
            assert!(along.dot(&frame.normal).abs() < 1e-9);
        }
        // A bead up the steepest slope is as wide as in the plan, one along the level is wider.
        let jet = SplineSurface::jet(&fitted.surface, 4.0, -3.0);
        let slope = Vector2::new(jet.slope[0], jet.slope[1]);
        let level = Vector2::new(-slope.y, slope.x);
        let ground = fitted.surface.frame(Point2::new(4.0, -3.0), 0.0);
        assert!((ground.width_factor(slope) - 1.0).abs() < 1e-9);
        let steep = (1.0 + slope.norm_squared()).sqrt();
        assert!((ground.width_factor(level) - steep).abs() < 1e-9);
        assert!((ground.stretches()[0] - steep).abs() < 1e-9);
    }

    /// Goal: a chart of 3,000 vertices takes no more than 0.2 s, flattening and smoothing. Method: a saddle of 55 x 55.
    #[test]
    #[ignore = "a time, for a quiet machine"]
    fn a_chart_of_3000_vertices_takes_a_fifth_of_a_second() {
        let vertices: Vec<Vector3<f64>> = (0..55 * 55)
            .map(|k| {
                let (x, y) = (
                    0.4 * f64::from(k % 55) - 11.0,
                    0.4 * f64::from(k / 55) - 11.0,
                );
                Vector3::new(x, y, (x * x - y * y) / 40.0)
            })
            .collect();
        let mut triangles = Vec::new();
        for corner in (0..54 * 55).filter(|corner| corner % 55 != 54) {
            triangles.push([corner, corner + 1, corner + 56]);
            triangles.push([corner, corner + 56, corner + 55]);
        }
        let run = || {
            let begun = std::time::Instant::now();
            let flat = flattened(&vertices, &triangles).unwrap();
            let flattened_s = begun.elapsed().as_secs_f64();
            let both: Vec<_> = vertices.iter().copied().zip(flat).collect();
            PatchChart::through(&both, &[], 2e-3, 0.5).unwrap();
            [begun.elapsed().as_secs_f64(), flattened_s]
        };
        // The best of some: what else runs takes time as well.
        let runs = (0..9).map(|_| run());
        let [all_s, flattened_s] = runs.min_by(|a, b| a[0].total_cmp(&b[0])).unwrap();
        println!("flattened in {flattened_s:.3} s, {all_s:.3} s in all");
        assert!(all_s < 0.2, "{all_s}");
    }

    /// Goal: a patch that hangs over has a chart that is hardly sheared, leads to the sphere and back. Method: the
    /// side of a sphere of R 15 from 30° above its equator to 33° below, vertices 1 mm apart; against the sphere.
    #[test]
    fn a_sphere_s_side_has_a_chart() {
        let place = |u: f64, v: f64| {
            let (sin_u, cos_u) = (u / 15.0).sin_cos();
            let (sin_v, cos_v) = (v / 15.0).sin_cos();
            15.0 * Vector3::new(cos_v * cos_u, cos_v * sin_u, sin_v)
        };
        let (nx, ny) = (27, 20);
        let vertices: Vec<Vector3<f64>> = (0..nx * ny)
            .map(|k| place(f64::from(k % nx), f64::from(k / nx) - 10.0))
            .collect();
        let mut triangles = Vec::new();
        for j in 0..ny as u32 - 1 {
            for i in 0..nx as u32 - 1 {
                let corner = j * nx as u32 + i;
                let up = corner + nx as u32;
                triangles.push([corner, corner + 1, up + 1]);
                triangles.push([corner, up + 1, up]);
            }
        }
        let flat = flattened(&vertices, &triangles).unwrap();
        let both: Vec<_> = vertices.iter().copied().zip(flat).collect();
        let chart = PatchChart::through(&both, &[], 2e-3, 1.0).unwrap();
        // At the rim the splines' second differences pull it flat.
        assert!(chart.off_mm < 1e-2, "{}", chart.off_mm);
        for (u, v) in [(13.0, 0.0), (6.3, 4.1), (20.2, -7.7)] {
            let point = place(u, v);
            let at = chart.place(point);
            let frame = chart.frame(at, 0.0);
            assert!((frame.tip_mm - point).norm() < 3e-3, "{u} {v}");
            assert!((frame.normal - point / 15.0).norm() < 5e-3, "{u} {v}");
            let [most, least] = frame.stretches();
            // Vertices 1 mm apart: by the trials with such patches at most 1.015.
            assert!(most / least < 1.015, "{u} {v}: {most} {least}");
            let bend = sharpest_bend_per_mm(&chart.jet(at));
            assert!((bend + 1.0 / 15.0).abs() < 5e-3, "{bend}");
        }
    }
}
