//! The ellipse with semi-axes 1 and b as a swept shape.
//!
//! In: b and a rim, in a. Out: the queries of [`super::shape`], in the tool frame.

use super::shape::{CONTACTS_MAX, OutlinePoint, Touch};
use std::f32::consts::TAU;

/// Points of the outline, by even parameter.
pub const POINTS: usize = 32;
/// Newton's steps from a change of sign to a contact, and the most that one may turn, rad.
const NEWTON_STEPS: usize = 3;
const NEWTON_TURN_MAX: f32 = 0.15;

/// The ellipse.
#[derive(Clone, Debug)]
pub struct Ellipse {
    /// Cosine and sine of the parameter of each point.
    cosines: [f32; POINTS],
    sines: [f32; POINTS],
    minor: f32,
    inverse_minor: f32,
    rim: f32,
}

impl Ellipse {
    /// With this b and this rim around its inside.
    pub fn new(minor: f32, rim: f32) -> Ellipse {
        let angles: [[f32; 2]; POINTS] = std::array::from_fn(|k| {
            let (sin, cos) = (TAU * k as f32 / POINTS as f32).sin_cos();
            [cos, sin]
        });
        Ellipse {
            cosines: angles.map(|[cos, _]| cos),
            sines: angles.map(|[_, sin]| sin),
            minor,
            inverse_minor: 1.0 / minor,
            rim,
        }
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

    /// Points around it.
    pub fn outline(&self) -> Vec<OutlinePoint> {
        let angles = self.cosines.iter().zip(&self.sines);
        angles.map(|(&cos, &sin)| self.at([cos, sin])).collect()
    }

    /// Motion between marks of the interior that misses no more than `scallop`: the sharp end of the interior has
    /// the curvature a'/b'².
    pub fn mark_step(&self, scallop: f32) -> f32 {
        let (a, b) = (1.0 - self.rim, self.minor - self.rim);
        2.0 * b * (2.0 * scallop / a).sqrt()
    }

    /// The square of the gauge function.
    #[inline]
    pub fn gauge2(&self, [x, y]: [f32; 2]) -> f32 {
        let across = y * self.inverse_minor;
        x * x + across * across
    }

    /// Touches of the envelope.
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
        let mut forwards = 0u32;
        let mut speeds = [0.0f32; POINTS];
        let angles = self.cosines.iter().zip(&self.sines);
        for (speed, (cos, sin)) in speeds.iter_mut().zip(angles) {
            *speed = a * cos + b * sin + both * cos * sin;
        }
        for (k, &speed) in speeds.iter().enumerate() {
            forwards |= u32::from(speed >= 0.0) << k;
        }
        let mut changes = forwards ^ forwards.rotate_right(1);
        let mut count = 0;
        while changes != 0 && count < CONTACTS_MAX {
            let k = changes.trailing_zeros() as usize;
            changes &= changes - 1;
            let (here, next) = (speeds[k], speeds[(k + 1) % POINTS]);
            let root = self.root([a, b, both], k, here / (here - next));
            found[count] = Touch {
                at: self.at(root),
                number: k,
            };
            count += 1;
        }
        count
    }

    /// The squared gauge of each outline point, shifted by `shift` and rotated by a cosine and sine.
    pub fn outline_gauges(
        &self,
        shift: [f32; 2],
        [cos, sin]: [f32; 2],
        gauges: &mut [f32; POINTS],
    ) {
        let points = self.cosines.iter().zip(&self.sines);
        for (gauge, (x, sine)) in gauges.iter_mut().zip(points) {
            let y = self.minor * sine;
            let there = [shift[0] + cos * x - sin * y, shift[1] + sin * x + cos * y];
            *gauge = self.gauge2(there);
        }
    }

    /// Cosine and sine at the root of the normal speed, from `share` of the arc after point `k`.
    fn root(&self, [a, b, both]: [f32; 3], k: usize, share: f32) -> [f32; 2] {
        let (mut cos, mut sin) = (self.cosines[k], self.sines[k]);
        let mut turn = TAU / POINTS as f32 * share;
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

    /// Rows of the inside at this cosine and sine of the heading.
    pub fn rows(&self, [cos, sin]: [f32; 2]) -> EllipseRows {
        let (a, b) = (1.0 - self.rim, self.minor - self.rim);
        let (a2, b2) = (1.0 / (a * a), 1.0 / (b * b));
        EllipseRows {
            height: (a * a * sin * sin + b * b * cos * cos).sqrt(),
            square: cos * cos * a2 + sin * sin * b2,
            mixed: cos * sin * (a2 - b2),
            determinant: a2 * b2,
        }
    }

    /// The inside's chord through its centre along a unit direction.
    pub fn chord(&self, [x, y]: [f32; 2]) -> f32 {
        let (along, across) = (x / (1.0 - self.rim), y / (self.minor - self.rim));
        2.0 / (along * along + across * across + 1e-9).sqrt()
    }
}

/// Rows of a rotated ellipse about its centre: square x² + 2 mixed x y + ... = 1.
#[derive(Clone, Copy, Debug)]
pub struct EllipseRows {
    /// Half its height.
    pub height: f32,
    square: f32,
    mixed: f32,
    determinant: f32,
}

impl EllipseRows {
    /// Least x, then greatest x in the rows at `ys`; empty where it misses.
    #[inline]
    pub fn rows<const N: usize>(&self, ys: &[f32; N]) -> [[f32; N]; 2] {
        let inverse = 1.0 / self.square;
        let (mut low, mut high) = ([0.0; N], [0.0; N]);
        for (k, &y) in ys.iter().enumerate() {
            let under_root = self.square - self.determinant * y * y;
            let (middle, half) = (-self.mixed * y * inverse, under_root.sqrt() * inverse);
            let misses = under_root <= 0.0;
            low[k] = if misses { 1.0 } else { middle - half };
            high[k] = if misses { -1.0 } else { middle + half };
        }
        [low, high]
    }
}
