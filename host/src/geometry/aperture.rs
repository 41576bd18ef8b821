//! The nozzle's aperture A0 through its support function.
//!
//! The aperture is centred on the tool with its long axis along tool X; `heading` turns it
//! counter-clockwise in the layer plane. Everything downstream asks only for extents and support
//! points, so that further convex shapes can join (SPEC section 1).

use super::Vector2;

/// A convex aperture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Aperture {
    /// Ellipse with semi-axes `major_mm >= minor_mm`; equal axes are the round nozzle.
    Ellipse {
        /// Semi-major axis a.
        major_mm: f64,
        /// Semi-minor axis b.
        minor_mm: f64,
    },
}

impl Aperture {
    /// Semi-major axis a: half the widest bead, mm.
    pub fn major_mm(&self) -> f64 {
        match *self {
            Aperture::Ellipse { major_mm, .. } => major_mm,
        }
    }

    /// Semi-minor axis b: half the narrowest bead, mm.
    pub fn minor_mm(&self) -> f64 {
        match *self {
            Aperture::Ellipse { minor_mm, .. } => minor_mm,
        }
    }

    /// True where the heading does not matter.
    pub fn is_round(&self) -> bool {
        self.major_mm() - self.minor_mm() < 1e-9
    }

    /// Support function h(u): extent from the centre in unit direction `direction`, mm.
    pub fn extent_mm(&self, heading_rad: f64, direction: Vector2) -> f64 {
        match *self {
            Aperture::Ellipse { major_mm, minor_mm } => {
                let (sin, cos) = heading_rad.sin_cos();
                let along = direction.x * cos + direction.y * sin;
                let across = direction.y * cos - direction.x * sin;
                ((major_mm * along).powi(2) + (minor_mm * across).powi(2)).sqrt()
            }
        }
    }

    /// Support point: the point of the aperture farthest in `direction`, relative to its centre.
    /// For the ellipse M N / h with M = R diag(a², b²) Rᵀ (SPEC section 2).
    pub fn support_point(&self, heading_rad: f64, direction: Vector2) -> Vector2 {
        match *self {
            Aperture::Ellipse { major_mm, minor_mm } => {
                let (sin, cos) = heading_rad.sin_cos();
                let along = direction.x * cos + direction.y * sin;
                let across = direction.y * cos - direction.x * sin;
                let extent = ((major_mm * along).powi(2) + (minor_mm * across).powi(2)).sqrt();
                let (px, py) = (
                    major_mm * major_mm * along / extent,
                    minor_mm * minor_mm * across / extent,
                );
                Vector2::new(px * cos - py * sin, px * sin + py * cos)
            }
        }
    }

    /// Extent e(alpha) across a wall whose normal is at `alpha_rad` from the major axis.
    pub fn extent_at_angle_mm(&self, alpha_rad: f64) -> f64 {
        self.extent_mm(0.0, Vector2::new(alpha_rad.cos(), alpha_rad.sin()))
    }

    /// The angle in [0, 90°] whose extent is `extent_mm` (clamped to what the aperture can do).
    /// cos² alpha = (e² - b²) / (a² - b²) for the ellipse.
    pub fn angle_of_extent_rad(&self, extent_mm: f64) -> f64 {
        match *self {
            Aperture::Ellipse { major_mm, minor_mm } => {
                let range = major_mm * major_mm - minor_mm * minor_mm;
                if range <= 1e-12 {
                    return 0.0;
                }
                let cos2 = ((extent_mm * extent_mm - minor_mm * minor_mm) / range).clamp(0.0, 1.0);
                cos2.sqrt().acos()
            }
        }
    }

    /// Area of the aperture, mm².
    pub fn area_mm2(&self) -> f64 {
        match *self {
            Aperture::Ellipse { major_mm, minor_mm } => std::f64::consts::PI * major_mm * minor_mm,
        }
    }

    /// True where the point (relative to the centre) lies in the aperture at this heading.
    pub fn contains(&self, heading_rad: f64, offset: Vector2) -> bool {
        match *self {
            Aperture::Ellipse { major_mm, minor_mm } => {
                let (sin, cos) = heading_rad.sin_cos();
                let along = (offset.x * cos + offset.y * sin) / major_mm;
                let across = (offset.y * cos - offset.x * sin) / minor_mm;
                along * along + across * across <= 1.0
            }
        }
    }
}
