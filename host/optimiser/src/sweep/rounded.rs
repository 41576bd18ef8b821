//! A convex polygon with rounded corners as a swept shape: slot, rectangle, polygon.
//!
//! In: a [`RoundedPolygon`], mm, and a rim. Out: the queries of [`super::shape`], in a, tool frame. Its outline
//! consists of arcs about corners (of length 0 at a sharp corner: the normal turns, the point stays) and sides
//! (the point moves, the normal stays); the normal speed is linear along either, so contacts are exact.

use super::dot;
use super::shape::{CONTACTS_MAX, OutlinePoint, Touch};
use headway_geometry::Vector2;
use headway_geometry::rounded_polygon::{RoundedPolygon, row_range};
use std::f32::consts::{PI, TAU};

/// Largest turn of the normal between two points of an arc, rad, and largest distance between two points of a
/// side, in a.
const ARC_STEP: f32 = TAU / 24.0;
const SIDE_STEP: f32 = 0.3;

/// A point of the outline and what leads to the next one.
#[derive(Clone, Copy, Debug)]
struct Element {
    at: OutlinePoint,
    /// The corner that the arc to the next point is about; `None` for a part of a side.
    about: Option<[f32; 2]>,
}

/// A side: n·p = offset.
#[derive(Clone, Copy, Debug)]
struct Side {
    normal: [f32; 2],
    offset: f32,
    from: [f32; 2],
    way: [f32; 2],
}

/// The shape.
#[derive(Clone, Debug)]
pub struct Rounded {
    elements: Vec<Element>,
    sides: Vec<Side>,
    radius: f32,
    minor: f32,
    /// Corners of the inside, and its radius.
    inside: Vec<Vector2>,
    inside_radius: f64,
    rim: f32,
    sharpest_rad: f32,
}

/// Rows of the rotated interior.
#[derive(Clone, Debug)]
pub struct RoundedRows {
    corners: Vec<Vector2>,
    radius: f64,
}

impl Rounded {
    /// The shape in units of `major_mm` with this rim around its inside.
    pub fn new(shape: &RoundedPolygon, major_mm: f64, rim: f32) -> Rounded {
        let small = |v: &Vector2| [(v.x / major_mm) as f32, (v.y / major_mm) as f32];
        let corners: Vec<[f32; 2]> = shape.corners().iter().map(small).collect();
        let side = |(normal, i): (Vector2, usize)| {
            let normal = [normal.x as f32, normal.y as f32];
            let (from, to) = (corners[i], corners[(i + 1) % corners.len()]);
            Side {
                normal,
                offset: dot(normal, from),
                from,
                way: [to[0] - from[0], to[1] - from[1]],
            }
        };
        let sides: Vec<Side> = shape.sides().map(side).collect();
        let radius = (shape.radius_mm() / major_mm) as f32;
        let mut rounded = Rounded {
            elements: Vec::new(),
            radius,
            minor: (shape.narrowest_mm() / (2.0 * major_mm)) as f32,
            inside: eroded(shape, major_mm, f64::from(rim - radius).max(0.0)),
            inside_radius: f64::from(radius - rim).max(0.0),
            rim,
            sharpest_rad: PI,
            sides,
        };
        for i in 0..rounded.sides.len() {
            rounded.add_corner(i);
            rounded.add_side(i);
        }
        rounded
    }

    /// Points of the arc about the corner at the start of side `i`.
    fn add_corner(&mut self, i: usize) {
        let count = self.sides.len();
        let (before, own) = (&self.sides[(i + count - 1) % count], &self.sides[i]);
        let sine = before.normal[0] * own.normal[1] - before.normal[1] * own.normal[0];
        // The ends of a slot turn by 180°, whose sign is lost to rounding.
        let turn = sine.atan2(dot(before.normal, own.normal)).abs();
        self.sharpest_rad = self.sharpest_rad.min(PI - turn);
        let pieces = (turn / ARC_STEP).ceil().max(1.0) as usize;
        for k in 0..=pieces {
            let (sin, cos) = (turn * k as f32 / pieces as f32).sin_cos();
            let [x, y] = before.normal;
            let normal = [x * cos - y * sin, x * sin + y * cos];
            self.elements.push(Element {
                at: OutlinePoint {
                    point: [
                        own.from[0] + self.radius * normal[0],
                        own.from[1] + self.radius * normal[1],
                    ],
                    normal,
                },
                about: (k < pieces).then_some(own.from),
            });
        }
    }

    /// Points within side `i`.
    fn add_side(&mut self, i: usize) {
        let side = self.sides[i];
        let pieces = (dot(side.way, side.way).sqrt() / SIDE_STEP).ceil().max(1.0) as usize;
        for k in 1..pieces {
            let share = k as f32 / pieces as f32;
            let on = |c: usize| side.from[c] + share * side.way[c] + self.radius * side.normal[c];
            self.elements.push(Element {
                at: OutlinePoint {
                    point: [on(0), on(1)],
                    normal: side.normal,
                },
                about: None,
            });
        }
    }

    /// Points around it.
    pub fn outline(&self) -> Vec<OutlinePoint> {
        self.elements.iter().map(|element| element.at).collect()
    }

    /// Motion between marks of the interior that misses no more than `scallop`: by its roundest corner, or by the
    /// sharpest.
    pub fn mark_step(&self, scallop: f32) -> f32 {
        if self.inside_radius > 0.0 {
            (8.0 * scallop * self.inside_radius as f32).sqrt()
        } else {
            2.0 * scallop * (self.sharpest_rad / 2.0).tan()
        }
    }

    /// Distance of the tip of the sharpest corner from the interior.
    pub fn tip(&self) -> f32 {
        let sharp = (self.rim - self.radius).max(0.0);
        self.rim - sharp + sharp / (self.sharpest_rad / 2.0).sin().max(1e-3)
    }

    /// 1 + 2 d / b, with d the signed distance from the outline: near it the equivalent of the squared gauge of an
    /// ellipse.
    #[inline]
    pub fn gauge2(&self, at: [f32; 2]) -> f32 {
        1.0 + 2.0 * self.signed_distance(at) / self.minor
    }

    /// Distance from the outline, in a, negative inside.
    #[inline]
    pub fn signed_distance(&self, at: [f32; 2]) -> f32 {
        let past = |side: &Side| dot(side.normal, at) - side.offset;
        let beyond = self
            .sides
            .iter()
            .map(past)
            .fold(f32::NEG_INFINITY, f32::max);
        if beyond > 0.0 && self.radius > 0.0 {
            self.distance(at) - self.radius
        } else {
            beyond - self.radius
        }
    }

    /// Distance of a point outside the core from it.
    fn distance(&self, at: [f32; 2]) -> f32 {
        let mut least2 = f32::INFINITY;
        for side in &self.sides {
            let off = [at[0] - side.from[0], at[1] - side.from[1]];
            let t = (dot(off, side.way) / dot(side.way, side.way)).clamp(0.0, 1.0);
            let rest = [off[0] - t * side.way[0], off[1] - t * side.way[1]];
            least2 = least2.min(dot(rest, rest));
        }
        least2.sqrt()
    }

    /// Touches of the envelope.
    pub fn touches(
        &self,
        velocity: [f32; 2],
        turning: f32,
        found: &mut [Touch; CONTACTS_MAX],
    ) -> usize {
        let speed = |at: &OutlinePoint| {
            let moment = at.point[0] * at.normal[1] - at.point[1] * at.normal[0];
            dot(velocity, at.normal) + turning * moment
        };
        let count = self.elements.len();
        let mut touches = 0;
        let first = speed(&self.elements[0].at);
        let mut here = first;
        for (k, element) in self.elements.iter().enumerate() {
            let other = &self.elements[(k + 1) % count].at;
            let next = if k + 1 < count { speed(other) } else { first };
            if (here >= 0.0) != (next >= 0.0) && touches < CONTACTS_MAX {
                found[touches] = Touch {
                    at: self.between(element, other, here / (here - next)),
                    number: k,
                };
                touches += 1;
            }
            here = next;
        }
        touches
    }

    /// The outline at a share of the distance between an element and the point after it.
    fn between(&self, element: &Element, next: &OutlinePoint, share: f32) -> OutlinePoint {
        let mix =
            |a: [f32; 2], b: [f32; 2]| [a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])];
        let Some(corner) = element.about else {
            return OutlinePoint {
                point: mix(element.at.point, next.point),
                normal: element.at.normal,
            };
        };
        let normal = mix(element.at.normal, next.normal);
        let length = dot(normal, normal).sqrt().max(1e-6);
        let normal = normal.map(|n| n / length);
        OutlinePoint {
            point: [
                corner[0] + self.radius * normal[0],
                corner[1] + self.radius * normal[1],
            ],
            normal,
        }
    }

    /// Rows of the interior, not rotated.
    pub fn rows(&self) -> RoundedRows {
        RoundedRows {
            corners: self.inside.clone(),
            radius: self.inside_radius,
        }
    }

    /// Rows of the inside at this cosine and sine of the heading.
    pub fn turn_rows(&self, turn: [f32; 2], rows: &mut RoundedRows) {
        let [cos, sin] = turn.map(f64::from);
        for (to, from) in rows.corners.iter_mut().zip(&self.inside) {
            *to = Vector2::new(cos * from.x - sin * from.y, sin * from.x + cos * from.y);
        }
    }

    /// A chord through the axis along a unit direction, by the sides.
    pub fn chord(&self, direction: [f32; 2]) -> f32 {
        let reach = |sign: f32| {
            let along = |side: &Side| {
                let rate = sign * dot(side.normal, direction);
                if rate > 1e-6 {
                    (side.offset + self.radius) / rate
                } else {
                    f32::INFINITY
                }
            };
            self.sides.iter().map(along).fold(f32::INFINITY, f32::min)
        };
        reach(1.0) + reach(-1.0)
    }
}

/// Corners of the core less a rim, in units of `major_mm`: clipped by each side shifted inwards.
fn eroded(shape: &RoundedPolygon, major_mm: f64, rim: f64) -> Vec<Vector2> {
    let mut kept: Vec<Vector2> = shape.corners().iter().map(|c| c / major_mm).collect();
    if rim <= 0.0 {
        return kept;
    }
    for (normal, i) in shape.sides() {
        let offset = normal.dot(&shape.corners()[i]) / major_mm - rim;
        let mut clipped = Vec::with_capacity(kept.len() + 1);
        for (k, &p) in kept.iter().enumerate() {
            let q = kept[(k + 1) % kept.len()];
            let (here, next) = (normal.dot(&p) - offset, normal.dot(&q) - offset);
            if here <= 0.0 {
                clipped.push(p);
            }
            if (here <= 0.0) != (next <= 0.0) {
                clipped.push(p + (q - p) * (here / (here - next)));
            }
        }
        kept = clipped;
    }
    kept
}

impl RoundedRows {
    /// Least and greatest y.
    pub fn heights(&self) -> [f32; 2] {
        let ys = || self.corners.iter().map(|c| c.y);
        let low = ys().fold(f64::INFINITY, f64::min) - self.radius;
        let high = ys().fold(f64::NEG_INFINITY, f64::max) + self.radius;
        [low as f32, high as f32]
    }

    /// Least x, then greatest x in the rows at `ys`; empty where it misses.
    pub fn rows<const N: usize>(&self, ys: &[f32; N]) -> [[f32; N]; 2] {
        let row = |y: f32| match row_range(&self.corners, self.radius, f64::from(y)) {
            Some([low, high]) => [low as f32, high as f32],
            None => [1.0, -1.0],
        };
        let mut ends = [[0.0; N]; 2];
        for (k, &y) in ys.iter().enumerate() {
            [ends[0][k], ends[1][k]] = row(y);
        }
        ends
    }
}
