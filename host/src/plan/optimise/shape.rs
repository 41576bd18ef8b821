//! The aperture in the optimiser's units: points of its outline, where it touches the envelope of its sweep, rows of
//! its inside.
//!
//! In: an [`Aperture`], mm. Out: lengths in a, f32, in the tool's frame.

use crate::geometry::aperture::Aperture;
use std::f32::consts::TAU;

/// Points of an ellipse's outline.
pub const OUTLINE_POINTS: usize = 32;
/// Most contacts of one pose with the envelope.
pub const CONTACTS_MAX: usize = 8;
/// Newton's steps from a change of sign to a contact, and the most that one may turn, rad.
const NEWTON_STEPS: usize = 3;
const NEWTON_TURN_MAX: f32 = 0.15;

/// A point of the outline with its outward unit normal, tool frame.
#[derive(Clone, Copy, Debug, Default)]
pub struct OutlinePoint {
    /// Where, in a.
    pub point: [f32; 2],
    /// Outward unit normal.
    pub normal: [f32; 2],
}

/// A point of the outline that moves along the outline: there it touches the envelope of the sweep.
#[derive(Clone, Copy, Debug, Default)]
pub struct Touch {
    /// The point.
    pub at: OutlinePoint,
    /// The point of [`Shape::outline`] before it.
    pub number: usize,
}

/// The aperture, an ellipse with semi-axes 1 and b.
#[derive(Clone, Debug)]
pub struct Shape {
    outline: [OutlinePoint; OUTLINE_POINTS],
    /// Cosine and sine of the parameter of each point.
    angles: [[f32; 2]; OUTLINE_POINTS],
    minor: f32,
    inverse_minor: f32,
}

impl Shape {
    /// The aperture in units of its own a; `None` for one that the optimiser cannot do.
    pub fn of(aperture: &Aperture) -> Option<Shape> {
        let Aperture::Ellipse { major_mm, minor_mm } = aperture else {
            return None;
        };
        let minor = (minor_mm / major_mm) as f32;
        if !(minor > 0.0 && minor <= 1.0) {
            return None;
        }
        let mut shape = Shape {
            outline: [OutlinePoint::default(); OUTLINE_POINTS],
            angles: [[1.0, 0.0]; OUTLINE_POINTS],
            minor,
            inverse_minor: 1.0 / minor,
        };
        for k in 0..OUTLINE_POINTS {
            let (sin, cos) = (TAU * k as f32 / OUTLINE_POINTS as f32).sin_cos();
            shape.angles[k] = [cos, sin];
            shape.outline[k] = shape.at([cos, sin]);
        }
        Some(shape)
    }

    /// The point at a parameter, given by its cosine and sine.
    fn at(&self, [cos, sin]: [f32; 2]) -> OutlinePoint {
        let normal = [cos, sin * self.inverse_minor];
        let length = (normal[0] * normal[0] + normal[1] * normal[1]).sqrt();
        OutlinePoint {
            point: [cos, self.minor * sin],
            normal: normal.map(|n| n / length),
        }
    }

    /// Points around the outline, counter-clockwise.
    pub fn outline(&self) -> &[OutlinePoint; OUTLINE_POINTS] {
        &self.outline
    }

    /// b, in a.
    pub fn minor(&self) -> f32 {
        self.minor
    }

    /// The square of the gauge function: below 1 inside, 1 on the outline, tool frame.
    #[inline]
    pub fn gauge2(&self, [x, y]: [f32; 2]) -> f32 {
        let across = y * self.inverse_minor;
        x * x + across * across
    }

    /// Where the outline moves along itself while the tool moves with `velocity` and turns with `turning`: at most
    /// [`CONTACTS_MAX`] touches into `found`; their number.
    pub fn touches(
        &self,
        velocity: [f32; 2],
        turning: f32,
        found: &mut [Touch; CONTACTS_MAX],
    ) -> usize {
        // Normal speed at the parameter with cosine c and sine s, but for a factor: A c + B s + C c s.
        let a = velocity[0];
        let b = velocity[1] * self.inverse_minor;
        let both = turning * (self.inverse_minor - self.minor);
        let speed_at = |[cos, sin]: [f32; 2]| a * cos + b * sin + both * cos * sin;
        let speeds = self.angles.map(speed_at);
        let mut count = 0;
        for k in 0..OUTLINE_POINTS {
            let (here, next) = (speeds[k], speeds[(k + 1) % OUTLINE_POINTS]);
            if (here >= 0.0) == (next >= 0.0) || count == CONTACTS_MAX {
                continue;
            }
            let root = self.root([a, b, both], k, here / (here - next));
            found[count] = Touch {
                at: self.at(root),
                number: k,
            };
            count += 1;
        }
        count
    }

    /// Cosine and sine at the root of the normal speed, from `share` of the arc after point `k`.
    fn root(&self, [a, b, both]: [f32; 3], k: usize, share: f32) -> [f32; 2] {
        let [mut cos, mut sin] = self.angles[k];
        let mut turn = TAU / OUTLINE_POINTS as f32 * share;
        for _ in 0..NEWTON_STEPS {
            let (c, s) = (
                1.0 - turn * turn * 0.5,
                turn * (1.0 - turn * turn * (1.0 / 6.0)),
            );
            (cos, sin) = (cos * c - sin * s, sin * c + cos * s);
            let speed = a * cos + b * sin + both * cos * sin;
            let rate = -a * sin + b * cos + both * (cos * cos - sin * sin);
            if rate.abs() < 1e-12 {
                break;
            }
            turn = (-speed / rate).clamp(-NEWTON_TURN_MAX, NEWTON_TURN_MAX);
        }
        let length = (cos * cos + sin * sin).sqrt();
        [cos / length, sin / length]
    }

    /// The aperture less a rim, turned: for its rows.
    pub fn inside(&self, [cos, sin]: [f32; 2], rim: f32) -> Inside {
        let (a, b) = (1.0 - rim, self.minor - rim);
        let (a2, b2) = (1.0 / (a * a), 1.0 / (b * b));
        Inside {
            height: (a * a * sin * sin + b * b * cos * cos).sqrt(),
            square: cos * cos * a2 + sin * sin * b2,
            mixed: cos * sin * (a2 - b2),
            determinant: a2 * b2,
        }
    }

    /// How far a point of the aperture less a rim moves through it at most, along a unit direction of the plane.
    pub fn chord(&self, [cos, sin]: [f32; 2], [x, y]: [f32; 2], rim: f32) -> f32 {
        let along = (cos * x + sin * y) / (1.0 - rim);
        let across = (cos * y - sin * x) / (self.minor - rim);
        (2.0 / (along * along + across * across + 1e-9).sqrt()).min(2.0)
    }
}

/// Rows of a turned ellipse about its centre: square x² + 2 mixed x y + ... = 1.
#[derive(Clone, Copy, Debug)]
pub struct Inside {
    /// Half its height.
    pub height: f32,
    square: f32,
    mixed: f32,
    determinant: f32,
}

impl Inside {
    /// Least and greatest x in the row at `y`; empty (greatest below least) where it misses.
    #[inline]
    pub fn row(&self, y: f32) -> [f32; 2] {
        let under_root = self.square - self.determinant * y * y;
        if under_root <= 0.0 {
            return [1.0, -1.0];
        }
        let inverse = 1.0 / self.square;
        let (middle, half) = (-self.mixed * y * inverse, under_root.sqrt() * inverse);
        [middle - half, middle + half]
    }
}
