//! The nozzle's aperture A0 through its support function.
//!
//! The aperture is centred on the tool with its long axis along tool X; `heading` turns it
//! counter-clockwise in the layer plane. Later stages use only extents, support points and the
//! methods here, so that every convex shape can be planned.
//!
//! The planner's a and b are half the greatest and half the least width over all directions: the
//! semi-axes of an ellipse, half the length and width of a slot, half the diagonal and width of a
//! rectangle.

use super::rounded_polygon::{CORNERS_MAX, RoundedPolygon, row_range};
use super::{Point2, Vector2};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// A convex aperture.
#[derive(Clone, Copy, Debug, PartialEq)]
#[expect(
    clippy::large_enum_variant,
    reason = "settings are copied a few times a plan, corners read millions of times"
)]
pub enum Aperture {
    /// Ellipse with semi-axes `major_mm >= minor_mm`; equal axes are the round nozzle.
    Ellipse {
        /// Semi-major axis a.
        major_mm: f64,
        /// Semi-minor axis b.
        minor_mm: f64,
    },
    /// Slot, rectangle or polygon.
    Rounded(RoundedPolygon),
}

/// Angle over which the contact of a flat side moves from one of its ends to the other, to each
/// side of lying on the wall, rad: less makes the centre jump where the heading wavers.
const FLAT_RAD: f64 = 0.12;
/// Pieces of the quarter turn in which an angle is sought by its extent.
const ANGLE_PIECES: usize = 90;
/// Halvings of such a piece: to 1e-14 rad.
const ANGLE_HALVINGS: usize = 44;

/// A vector of the plane in the frame of a tool at this heading.
fn to_tool(heading: impl Into<Turn>, v: Vector2) -> Vector2 {
    let Turn { sin, cos, .. } = heading.into();
    Vector2::new(v.x * cos + v.y * sin, v.y * cos - v.x * sin)
}

/// A vector of the tool's frame in the plane.
fn to_plane(heading_rad: f64, v: Vector2) -> Vector2 {
    let (sin, cos) = heading_rad.sin_cos();
    Vector2::new(v.x * cos - v.y * sin, v.x * sin + v.y * cos)
}

/// A heading with its sine and cosine, for repeated queries at one heading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turn {
    /// The heading.
    pub heading_rad: f64,
    /// Its sine.
    pub sin: f64,
    /// Its cosine.
    pub cos: f64,
}

impl From<f64> for Turn {
    #[inline]
    fn from(heading_rad: f64) -> Turn {
        let (sin, cos) = heading_rad.sin_cos();
        Turn {
            heading_rad,
            sin,
            cos,
        }
    }
}

impl Aperture {
    /// a: half the widest bead, mm.
    pub fn major_mm(&self) -> f64 {
        match self {
            Aperture::Ellipse { major_mm, .. } => *major_mm,
            Aperture::Rounded(shape) => shape.widest_mm() / 2.0,
        }
    }

    /// The same shape, all its lengths times this factor.
    pub fn scaled(&self, factor: f64) -> Aperture {
        match self {
            Aperture::Ellipse { major_mm, minor_mm } => Aperture::Ellipse {
                major_mm: factor * major_mm,
                minor_mm: factor * minor_mm,
            },
            Aperture::Rounded(shape) => Aperture::Rounded(shape.scaled(factor)),
        }
    }

    /// b: half the narrowest bead, mm.
    pub fn minor_mm(&self) -> f64 {
        match self {
            Aperture::Ellipse { minor_mm, .. } => *minor_mm,
            Aperture::Rounded(shape) => shape.narrowest_mm() / 2.0,
        }
    }

    /// The unit of lengths that depend on resolution or preference: five times b, 1 mm for the built-in nozzle. A
    /// part scaled together with its nozzle, layers and speeds gets the same plan.
    pub fn unit_mm(&self) -> f64 {
        5.0 * self.minor_mm()
    }

    /// True where the heading does not matter.
    pub fn is_round(&self) -> bool {
        match self {
            Aperture::Ellipse { major_mm, minor_mm } => major_mm - minor_mm < 1e-9,
            Aperture::Rounded(_) => false,
        }
    }

    /// True where mirroring about the tool's X axis brings it onto itself.
    pub fn is_mirror_image(&self) -> bool {
        match self {
            Aperture::Ellipse { .. } => true,
            Aperture::Rounded(shape) => shape.is_mirror_image(),
        }
    }

    /// The turn that brings the aperture onto itself, as far as the planner cares: 180°, or 360°
    /// for a polygon without that symmetry.
    pub fn period_rad(&self) -> f64 {
        match self {
            Aperture::Rounded(shape) if !shape.is_symmetric() => TAU,
            _ => PI,
        }
    }

    /// An angle brought into (-period/2, period/2].
    pub fn wrapped_rad(&self, angle_rad: f64) -> f64 {
        wrapped_rad(angle_rad, self.period_rad())
    }

    /// Support function h(u): extent from the centre in unit direction `direction`, mm.
    pub fn support_mm(&self, heading: impl Into<Turn>, direction: Vector2) -> f64 {
        let turn = heading.into();
        match self {
            Aperture::Ellipse { .. } => self.extent_mm(turn, direction),
            Aperture::Rounded(shape) => shape.support_mm(to_tool(turn, direction)),
        }
    }

    /// Half the width along unit direction `direction`, (h(u) + h(-u)) / 2, mm: half the bead
    /// that is swept across it. Where the shape has 180° symmetry it is h(u).
    #[inline]
    pub fn extent_mm(&self, heading: impl Into<Turn>, direction: Vector2) -> f64 {
        let turn = heading.into();
        match self {
            Aperture::Ellipse { major_mm, minor_mm } => {
                let local = to_tool(turn, direction);
                ((major_mm * local.x).powi(2) + (minor_mm * local.y).powi(2)).sqrt()
            }
            Aperture::Rounded(shape) => {
                let local = to_tool(turn, direction);
                let ahead = shape.support_mm(local);
                if shape.is_symmetric() {
                    ahead
                } else {
                    (ahead + shape.support_mm(-local)) / 2.0
                }
            }
        }
    }

    /// Support point: the point of the aperture farthest in `direction`, relative to its centre.
    /// For the ellipse M N / h with M = R diag(a², b²) Rᵀ (docs/design/heading-law.md); for a flat side one of
    /// its ends.
    #[inline]
    pub fn support_point(&self, heading: impl Into<Turn>, direction: Vector2) -> Vector2 {
        let Turn {
            heading_rad,
            sin,
            cos,
        } = heading.into();
        match self {
            Aperture::Ellipse { major_mm, minor_mm } => {
                let along = direction.x * cos + direction.y * sin;
                let across = direction.y * cos - direction.x * sin;
                let extent = ((major_mm * along).powi(2) + (minor_mm * across).powi(2)).sqrt();
                let (px, py) = (
                    major_mm * major_mm * along / extent,
                    minor_mm * minor_mm * across / extent,
                );
                Vector2::new(px * cos - py * sin, px * sin + py * cos)
            }
            Aperture::Rounded(shape) => to_plane(
                heading_rad,
                shape.support_point(to_tool(heading_rad, direction)),
            ),
        }
    }

    /// The centre of the aperture when it touches a straight wall through `p` with inward unit
    /// normal `normal`: at `p` or, for an aperture with flat sides, next to `p`, so that the centre
    /// moves continuously with the heading (the contact point is averaged over `FLAT_RAD` to both
    /// sides; h'(u) is its displacement along the wall).
    #[inline]
    pub fn center_on_wall(&self, heading: impl Into<Turn>, p: Point2, normal: Vector2) -> Point2 {
        let turn = heading.into();
        match self {
            Aperture::Ellipse { .. } => p + self.support_point(turn, normal),
            Aperture::Rounded(shape) => {
                let towards = to_tool(turn, -normal);
                let turned = |by: f64| shape.support_mm(to_plane(by, towards));
                let beside = (turned(FLAT_RAD) - turned(-FLAT_RAD)) / (2.0 * FLAT_RAD);
                // Perpendicular of `-normal`, counter-clockwise.
                let along = Vector2::new(normal.y, -normal.x);
                p + normal * shape.support_mm(towards) - along * beside
            }
        }
    }

    /// The centre of the aperture when the bead across `direction` is to be centred on `p`: `p`
    /// itself where the shape has 180° symmetry.
    pub fn center_on_axis(&self, heading_rad: f64, p: Point2, direction: Vector2) -> Point2 {
        match self {
            Aperture::Rounded(shape) if !shape.is_symmetric() => {
                let local = to_tool(heading_rad, direction);
                p - direction * ((shape.support_mm(local) - shape.support_mm(-local)) / 2.0)
            }
            _ => p,
        }
    }

    /// Extent e(alpha) across a wall whose normal is at `alpha_rad` from the major axis.
    pub fn extent_at_angle_mm(&self, alpha_rad: f64) -> f64 {
        // Seen from the tool the normal is at -alpha; the ellipse is the same in either case.
        let direction = match self {
            Aperture::Ellipse { .. } => Vector2::new(alpha_rad.cos(), alpha_rad.sin()),
            Aperture::Rounded(_) => Vector2::new(alpha_rad.cos(), -alpha_rad.sin()),
        };
        self.extent_mm(0.0, direction)
    }

    /// The angle in [0, 90°] whose extent is `extent_mm` (clamped to the range of the aperture);
    /// the greatest of several. cos² alpha = (e² - b²) / (a² - b²) for the ellipse.
    pub fn angle_of_extent_rad(&self, extent_mm: f64) -> f64 {
        let Aperture::Ellipse { major_mm, minor_mm } = self else {
            return self.angle_found_rad(extent_mm);
        };
        let range = major_mm * major_mm - minor_mm * minor_mm;
        if range <= 1e-12 {
            return 0.0;
        }
        let cos2 = ((extent_mm * extent_mm - minor_mm * minor_mm) / range).clamp(0.0, 1.0);
        cos2.sqrt().acos()
    }

    /// The same by bisection, from 90° down; where no angle has the extent, the one nearest to it.
    fn angle_found_rad(&self, extent_mm: f64) -> f64 {
        let at = |k: usize| FRAC_PI_2 * (1.0 - k as f64 / ANGLE_PIECES as f64);
        let off = |alpha: f64| self.extent_at_angle_mm(alpha) - extent_mm;
        let mut best = (f64::INFINITY, FRAC_PI_2);
        let mut before = off(FRAC_PI_2);
        for k in 0..=ANGLE_PIECES {
            let here = off(at(k));
            if here.abs() < best.0 {
                best = (here.abs(), at(k));
            }
            if here == 0.0 {
                break;
            }
            if k > 0 && (before > 0.0) != (here > 0.0) {
                let (mut high, mut low) = (at(k - 1), at(k));
                for _ in 0..ANGLE_HALVINGS {
                    let middle = (low + high) / 2.0;
                    if (off(middle) > 0.0) == (before > 0.0) {
                        high = middle;
                    } else {
                        low = middle;
                    }
                }
                return (low + high) / 2.0;
            }
            before = here;
        }
        best.1
    }

    /// Area of the aperture, mm².
    pub fn area_mm2(&self) -> f64 {
        match self {
            Aperture::Ellipse { major_mm, minor_mm } => PI * major_mm * minor_mm,
            Aperture::Rounded(shape) => shape.area_mm2(),
        }
    }

    /// The interval of the line `from` + t `direction` (relative to the centre, unit direction)
    /// inside the aperture: the least and largest t, mm; `None` if it misses.
    #[inline]
    pub fn chord_mm(
        &self,
        heading: impl Into<Turn>,
        from: Vector2,
        direction: Vector2,
    ) -> Option<[f64; 2]> {
        let Turn {
            heading_rad,
            sin,
            cos,
        } = heading.into();
        match self {
            Aperture::Ellipse { major_mm, minor_mm } => {
                let scaled = |v: Vector2| {
                    Vector2::new(
                        (v.x * cos + v.y * sin) / major_mm,
                        (v.y * cos - v.x * sin) / minor_mm,
                    )
                };
                let (p, d) = (scaled(from), scaled(direction));
                let (square, half) = (d.norm_squared(), p.dot(&d));
                let rest = half * half - square * (p.norm_squared() - 1.0);
                (rest >= 0.0 && square > 0.0).then(|| {
                    let root = rest.sqrt();
                    [(-half - root) / square, (-half + root) / square]
                })
            }
            Aperture::Rounded(shape) => {
                // Turned so that the line runs along x.
                let line = direction.y.atan2(direction.x);
                let turned = |v: Vector2| to_tool(line, v);
                let mut corners = [Vector2::zeros(); CORNERS_MAX];
                let count = shape.corners().len();
                for (to, &corner) in corners.iter_mut().zip(shape.corners()) {
                    *to = turned(to_plane(heading_rad, corner));
                }
                let start = turned(from);
                row_range(&corners[..count], shape.radius_mm(), start.y)
                    .map(|[low, high]| [low - start.x, high - start.x])
            }
        }
    }

    /// True if the point (relative to the centre) is in the aperture at this heading.
    pub fn contains(&self, heading_rad: f64, offset: Vector2) -> bool {
        self.contains_in_tool(to_tool(heading_rad, offset))
    }

    /// The same of a point in the tool's frame.
    #[inline]
    pub fn contains_in_tool(&self, own: Vector2) -> bool {
        match self {
            Aperture::Ellipse { major_mm, minor_mm } => {
                let (along, across) = (own.x / major_mm, own.y / minor_mm);
                along * along + across * across <= 1.0
            }
            Aperture::Rounded(shape) => shape.signed_distance_mm(own) <= 0.0,
        }
    }

    /// A point of the outline in the tool's frame, counter-clockwise for `share` in [0, 1): by
    /// parameter angle for the ellipse, by length for the others.
    pub fn outline_at(&self, share: f64) -> Vector2 {
        match self {
            Aperture::Ellipse { major_mm, minor_mm } => {
                let (sin, cos) = (TAU * share).sin_cos();
                Vector2::new(major_mm * cos, minor_mm * sin)
            }
            Aperture::Rounded(shape) => shape.outline_at(share),
        }
    }

    /// How far [`Aperture::outline_at`] moves at most for a change of `share` by 1, mm.
    pub fn outline_rate_mm(&self) -> f64 {
        match self {
            Aperture::Ellipse { major_mm, .. } => TAU * major_mm,
            Aperture::Rounded(shape) => shape.perimeter_mm(),
        }
    }

    /// Distance of the farthest point from the centre, mm.
    pub fn reach_mm(&self) -> f64 {
        match self {
            Aperture::Ellipse { major_mm, .. } => *major_mm,
            Aperture::Rounded(shape) => shape.reach_mm(),
        }
    }

    /// A lower bound of the distance of the point `q` of the tool's frame from the aperture, mm:
    /// positive exactly if it is outside.
    pub fn beyond_mm(&self, q: Vector2) -> f64 {
        match self {
            Aperture::Ellipse { major_mm, minor_mm } => {
                ((q.x / major_mm).hypot(q.y / minor_mm) - 1.0) * minor_mm
            }
            Aperture::Rounded(shape) => shape.signed_distance_mm(q),
        }
    }

    /// The outline as a closed polygon in the plane about the centre: every corner, arcs as chords.
    pub fn outline(&self, heading_rad: f64, pieces: usize) -> Vec<Vector2> {
        let turned = |v: Vector2| to_plane(heading_rad, v);
        match self {
            Aperture::Rounded(shape) if shape.radius_mm() <= 0.0 => {
                shape.corners().iter().map(|&c| turned(c)).collect()
            }
            _ => (0..pieces)
                .map(|i| {
                    // Equal angles of the normal bunch points where the outline is sharp.
                    let angle = TAU * i as f64 / pieces as f64;
                    turned(self.support_point(0.0, Vector2::new(angle.cos(), angle.sin())))
                })
                .collect(),
        }
    }

    /// Least radius of curvature of the outline, mm: 0 at a sharp corner.
    pub fn sharpest_radius_mm(&self) -> f64 {
        match self {
            Aperture::Ellipse { major_mm, minor_mm } => minor_mm * minor_mm / major_mm,
            Aperture::Rounded(shape) => shape.radius_mm(),
        }
    }

    /// Full sizes along and across the tool's X, mm.
    pub fn sizes_mm(&self) -> [f64; 2] {
        [Vector2::x(), Vector2::y()].map(|axis| 2.0 * self.extent_mm(0.0, axis))
    }
}

/// An angle brought into (-period/2, period/2].
pub fn wrapped_rad(angle_rad: f64, period_rad: f64) -> f64 {
    let turned = angle_rad - period_rad * (angle_rad / period_rad).round();
    if turned <= -period_rad / 2.0 {
        turned + period_rad
    } else {
        turned
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wedge() -> Aperture {
        let corners = [[-0.3, -0.2], [0.6, 0.0], [-0.3, 0.2]].map(Vector2::from);
        Aperture::Rounded(RoundedPolygon::polygon(&corners).expect("a wedge"))
    }

    /// Goal: the angle found has the extent asked for, the greatest one. Method: the closed forms
    /// of the slot and the rectangle.
    #[test]
    fn angle_of_extent() {
        let slot = Aperture::Rounded(RoundedPolygon::stadium(1.2, 0.4));
        for alpha_deg in [0.0f64, 10.0, 45.0, 89.0, 90.0] {
            let alpha = alpha_deg.to_radians();
            let extent = 0.4 * alpha.cos() + 0.2;
            assert!((slot.extent_at_angle_mm(alpha) - extent).abs() < 1e-12);
            let found = slot.angle_of_extent_rad(extent);
            assert!((found - alpha).abs() < 1e-7, "{found} {alpha}");
        }
        assert_eq!(slot.angle_of_extent_rad(9.0), 0.0);
        assert_eq!(slot.angle_of_extent_rad(0.0), FRAC_PI_2);
        let rectangle = Aperture::Rounded(RoundedPolygon::rectangle(1.2, 0.4, 0.0));
        // Both at 0 and at twice the diagonal's angle.
        let twice = 2.0 * (1.0f64 / 3.0).atan();
        assert!((rectangle.angle_of_extent_rad(0.6) - twice).abs() < 1e-9);
    }

    /// Goal: leaning on a wall touches it, and the centre moves steadily as the heading turns.
    #[test]
    fn leaning_on_a_wall() {
        for aperture in [
            Aperture::Rounded(RoundedPolygon::rectangle(1.2, 0.4, 0.05)),
            Aperture::Rounded(RoundedPolygon::stadium(1.2, 0.4)),
            wedge(),
        ] {
            let (p, up) = (Point2::new(3.0, 1.0), Vector2::y());
            let mut before: Option<Point2> = None;
            for k in 0..720 {
                let heading = f64::from(k).to_radians();
                let center = aperture.center_on_wall(heading, p, up);
                let low = center.y - aperture.support_mm(heading, -up);
                assert!((low - 1.0).abs() < 1e-12, "{low}");
                if let Some(before) = before {
                    // At most a side over twice FLAT_RAD, and the turning itself.
                    assert!((center - before).norm() < 1.3 / (2.0 * FLAT_RAD) * 0.0175 + 0.03);
                }
                before = Some(center);
            }
        }
    }

    /// Goal: a shape without symmetry has a half width and a full period of its own.
    #[test]
    fn without_symmetry() {
        let wedge = wedge();
        assert_eq!(wedge.period_rad(), TAU);
        assert!((wedge.extent_mm(0.0, Vector2::x()) - 0.45).abs() < 1e-12);
        assert!((wedge.support_mm(0.0, Vector2::x()) - 0.6).abs() < 1e-12);
        let center = wedge.center_on_axis(0.0, Point2::origin(), Vector2::x());
        assert!((center.x + 0.15).abs() < 1e-12);
        assert_eq!(wedge.wrapped_rad(1.5 * PI), -FRAC_PI_2);
        assert_eq!(wedge.wrapped_rad(-PI), PI);
    }
}
