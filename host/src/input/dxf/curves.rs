//! Entities of a drawing -> chords in mm.
//!
//! Lines, circles, arcs, polylines with bulges, ellipses and splines; no chord is further from its curve
//! than the tolerance. In: the file's unit, degrees for arcs, radians for ellipses. Out: mm before
//! `--scale`. Sources: AutoCAD DXF reference (group codes and their defaults; bulge = tangent of a quarter
//! of the arc's angle; extrusion direction); de Boor's triangle for splines. Not covered: entities outside the drawing's plane.

use super::records::Entity;
use super::syntax;
use crate::geometry::{Point2, Vector2};
use crate::input::POINTS_MAX;
use crate::input::error;
use crate::input::error::At;
use crate::input::nurbs::{DEGREE_MAX, Nurbs};
use crate::input::outline::{FAR_MAX_MM, RawRing};
use crate::text::refusal::Refusal;
use nalgebra::Vector4;
use std::f64::consts::TAU;

/// Most chords of one curve, against absurd sizes.
const CHORDS_MAX: f64 = 200_000.0;
/// Most halvings of a part of a spline.
const HALVINGS_MAX: u32 = 20;
/// A normal this near the z axis is the z axis.
const UPRIGHT: f64 = 1e-6;
/// A gap this small in a full turn is rounding, rad.
const WHOLE_RAD: f64 = 1e-9;

/// How long the units are, and how close the chords.
pub(super) struct Flattener {
    pub unit_mm: f64,
    pub tolerance_mm: f64,
    /// Points that were made.
    pub points: usize,
}

impl Flattener {
    /// The chords of an entity.
    pub fn piece(&mut self, entity: &Entity) -> Result<RawRing, Refusal> {
        let what = &entity.what;
        let (mut points, closed) = match entity.kind {
            "LINE" => (vec![self.mm(entity, 10), self.mm(entity, 11)], false),
            "CIRCLE" | "ARC" => self.arc(entity)?,
            "LWPOLYLINE" | "POLYLINE" => {
                let closed = entity.one(70, 0.0) as i32 & 1 != 0;
                let corners = self.points(entity).zip(entity.bulges());
                (self.bulged(&corners.collect::<Vec<_>>(), closed)?, closed)
            }
            "ELLIPSE" => self.ellipse(entity)?,
            "SPLINE" => (self.spline(entity)?, false),
            _ => return Err(syntax(format!("the {what} could not be read"))),
        };
        // Points of an entity's own plane: seen from below, x is reversed. An ellipse is in the drawing's.
        if entity.kind != "ELLIPSE" && upright(entity)? < 0.0 {
            points.iter_mut().for_each(|point| point.x = -point.x);
        }
        self.check(what, &points)?;
        Ok(RawRing {
            what: what.to_string(),
            points,
            closed,
        })
    }

    /// Counts the points, and refuses coordinates that are not finite.
    fn check(&mut self, what: &str, points: &[Point2]) -> Result<(), Refusal> {
        self.points += points.len();
        if self.points > POINTS_MAX {
            return Err(error::too_many_points(self.points));
        }
        if points.is_empty() {
            return Err(syntax(format!("the {what} has no points")));
        }
        for (number, point) in points.iter().enumerate() {
            if !(point.x.is_finite() && point.y.is_finite()) {
                return Err(error::bad_point(
                    &format!("the {what}"),
                    number,
                    &format!("[{}, {}] mm", point.x, point.y),
                ));
            }
            if point.x.abs().max(point.y.abs()) > FAR_MAX_MM {
                return Err(error::too_far(At(*point), FAR_MAX_MM));
            }
        }
        Ok(())
    }

    fn place(&self, x: f64, y: f64) -> Point2 {
        Point2::new(x * self.unit_mm, y * self.unit_mm)
    }

    /// The point whose x is in this group; its y has a code that is 10 higher.
    fn mm(&self, entity: &Entity, code: i32) -> Point2 {
        self.place(entity.one(code, 0.0), entity.one(code + 10, 0.0))
    }

    /// Corners or control points: each x and the y of the same number.
    fn points(&self, entity: &Entity) -> impl Iterator<Item = Point2> {
        let each = entity.all(10).zip(entity.all(20));
        each.map(|(x, y)| self.place(x, y))
    }

    /// Chords of an arc of this angle: with a radius r and half a chord's angle a, the chord is
    /// r (1 - cos a) = 2 r sin²(a/2) off the arc.
    fn arc_chords(&self, radius_mm: f64, sweep_rad: f64) -> usize {
        let half = (self.tolerance_mm / (2.0 * radius_mm)).sqrt().min(0.5);
        chords(sweep_rad.abs() / (4.0 * half.asin()))
    }

    /// Points of an arc, and whether it is whole, as a circle is.
    fn arc(&self, entity: &Entity) -> Result<(Vec<Point2>, bool), Refusal> {
        let what = &entity.what;
        let radius_mm = entity.one(40, 0.0) * self.unit_mm;
        let [from, to] = [(50, 0.0), (51, 360.0)].map(|(c, d)| entity.one(c, d).to_radians());
        let (sweep, is_whole) = sweep(from, to);
        if radius_mm <= 0.0 {
            return Err(syntax(format!(
                "the {what} has a radius of {radius_mm} mm: it must be above 0"
            )));
        }
        let centre = self.mm(entity, 10);
        let chords = self.arc_chords(radius_mm, sweep);
        // The last point of a whole turn is the first.
        let last = if is_whole { chords - 1 } else { chords };
        let angle = |k: usize| from + sweep * (k as f64 / chords as f64);
        let points = (0..=last).map(|k| {
            let (sin, cos) = angle(k).sin_cos();
            centre + radius_mm * Vector2::new(cos, sin)
        });
        Ok((points.collect(), is_whole))
    }

    /// Corners, each with the bulge of the edge after it.
    fn bulged(&self, corners: &[(Point2, f64)], closed: bool) -> Result<Vec<Point2>, Refusal> {
        let mut points: Vec<Point2> = Vec::with_capacity(corners.len());
        for (index, &(from, bulge)) in corners.iter().enumerate() {
            points.push(from);
            let next = match corners.get(index + 1) {
                Some(&(next, _)) => next,
                None if closed => corners[0].0,
                None => break,
            };
            let chord = next - from;
            let sag_mm = 0.5 * bulge.abs() * chord.norm();
            if sag_mm <= 0.1 * self.tolerance_mm || !sag_mm.is_finite() {
                continue;
            }
            // From the middle of the chord to the arc's centre, to the left where it turns left.
            let to_centre = Vector2::new(-chord.y, chord.x) * ((1.0 / bulge - bulge) / 4.0);
            let centre = nalgebra::center(&from, &next) + to_centre;
            let sweep = 4.0 * bulge.atan();
            let chords = self.arc_chords((from - centre).norm(), sweep);
            let arm = from - centre;
            points.extend((1..chords).map(|k| {
                let angle = sweep * (k as f64 / chords as f64);
                centre + nalgebra::Rotation2::new(angle) * arm
            }));
            if points.len() > POINTS_MAX {
                let points = points.len();
                return Err(error::too_many_points(points));
            }
        }
        Ok(points)
    }

    /// Points of an ellipse or its arc, and whether it is whole. The second derivative is at most the
    /// longer half axis: a chord of the angle d is at most that times d² / 8 off.
    fn ellipse(&self, entity: &Entity) -> Result<(Vec<Point2>, bool), Refusal> {
        let (what, side) = (&entity.what, upright(entity)?);
        let ratio = entity.one(40, 1.0);
        let major = self.mm(entity, 11).coords;
        let minor = Vector2::new(-major.y, major.x) * (ratio * side);
        let longest_mm = major.norm().max(minor.norm());
        if !(ratio > 0.0 && longest_mm > 0.0) {
            return Err(syntax(format!("the {what} has an axis without length")));
        }
        let from = entity.one(41, 0.0);
        let (sweep, is_whole) = sweep(from, entity.one(42, TAU));
        let chords = chords((sweep / (8.0 * self.tolerance_mm / longest_mm).sqrt()).max(8.0));
        let last = if is_whole { chords - 1 } else { chords };
        let centre = self.mm(entity, 10);
        let points = (0..=last).map(|k| {
            let (sin, cos) = (from + sweep * (k as f64 / chords as f64)).sin_cos();
            centre + major * cos + minor * sin
        });
        Ok((points.collect(), is_whole))
    }

    fn spline(&self, entity: &Entity) -> Result<Vec<Point2>, Refusal> {
        let what = &entity.what;
        let points: Vec<Point2> = self.points(entity).collect();
        let [knots, weights] = [40, 41].map(|code| entity.all(code).collect::<Vec<f64>>());
        let count = points.len();
        let degree_given = entity.one(71, 1.0);
        let degree = degree_given.max(0.0) as usize;
        let is_known = (1..=DEGREE_MAX).contains(&degree) && count > degree;
        if !is_known || knots.len() != count + degree + 1 {
            return Err(syntax(format!(
                "the {what} has degree {degree_given}, {count} control points and {} knots: the degree is from 1 \
                 to {DEGREE_MAX}, and there is a knot for each point and degree and one more",
                knots.len()
            )));
        }
        let is_rising = knots.windows(2).all(|pair| pair[0] <= pair[1]);
        if !is_rising || knots[degree] >= knots[count] {
            return Err(syntax(format!("the knots of the {what} do not rise")));
        }
        let is_weighed = weights.is_empty() || weights.len() == count;
        if !is_weighed || weights.iter().any(|weight| *weight <= 0.0) {
            return Err(syntax(format!(
                "the {what} has {} weights for {count} control points: each needs one above 0, or none has",
                weights.len()
            )));
        }
        let control = points.iter().enumerate().map(|(index, point)| {
            let weight = weights.get(index).copied().unwrap_or(1.0);
            let place = point * weight;
            Vector4::new(place.x, place.y, 0.0, weight)
        });
        let curve = Nurbs {
            degree,
            control: control.collect(),
            knots,
        };
        self.along(&curve)
    }

    /// Chords along a spline: each part between two knots in as many pieces as its degree, each
    /// halved until it is straight at a quarter, a half and three quarters.
    fn along(&self, curve: &Nurbs) -> Result<Vec<Point2>, Refusal> {
        let mut points: Vec<Point2> = Vec::new();
        for knot in curve.degree..curve.control.len() {
            let (low, high) = (curve.knots[knot], curve.knots[knot + 1]);
            if high <= low {
                continue;
            }
            let at = |u: f64| Point2::from(curve.place(knot, u).xy());
            if points.is_empty() {
                points.push(at(low));
            }
            let cut = |k: usize| low + (high - low) * (k as f64 / curve.degree as f64);
            // The first part is on top.
            let parts = (0..curve.degree).rev();
            let mut open: Vec<(f64, f64, u32)> = parts.map(|k| (cut(k), cut(k + 1), 0)).collect();
            while let Some((from, to, halvings)) = open.pop() {
                let (start, end) = (at(from), at(to));
                let is_straight = [0.25, 0.5, 0.75].iter().all(|share| {
                    let place = at(from + share * (to - from));
                    off_chord(place, start, end) <= 0.8 * self.tolerance_mm
                });
                if is_straight || halvings == HALVINGS_MAX {
                    points.push(end);
                } else {
                    let middle = 0.5 * (from + to);
                    open.push((middle, to, halvings + 1));
                    open.push((from, middle, halvings + 1));
                }
                if points.len() > POINTS_MAX {
                    let points = points.len();
                    return Err(error::too_many_points(points));
                }
            }
        }
        Ok(points)
    }
}

fn chords(count: f64) -> usize {
    count.ceil().clamp(1.0, CHORDS_MAX) as usize
}

/// The angle from one to the other, counter-clockwise, above 0 and at most a whole turn, and whether it is one.
fn sweep(from: f64, to: f64) -> (f64, bool) {
    let sweep = (to - from).rem_euclid(TAU);
    match sweep <= WHOLE_RAD || sweep >= TAU - WHOLE_RAD {
        true => (TAU, true),
        false => (sweep, false),
    }
}

fn off_chord(place: Point2, start: Point2, end: Point2) -> f64 {
    let chord = end - start;
    let share = (place - start).dot(&chord) / chord.norm_squared();
    let share = if share.is_finite() {
        share.clamp(0.0, 1.0)
    } else {
        0.0
    };
    (place - start - chord * share).norm()
}

/// 1 for an entity drawn as seen from above, -1 from below; fails for a tilted one.
fn upright(entity: &Entity) -> Result<f64, Refusal> {
    let tilt = entity.one(210, 0.0).hypot(entity.one(220, 0.0));
    let z = entity.one(230, 1.0);
    match tilt <= UPRIGHT * z.abs() && z != 0.0 {
        true => Ok(z.signum()),
        false => Err(syntax(format!(
            "the {} is tilted out of the drawing's plane: flatten the drawing first",
            entity.what
        ))),
    }
}
