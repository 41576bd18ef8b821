//! Entities of the `dxf` crate -> chords in mm.
//!
//! Lines, circles, arcs, polylines with bulges, ellipses and splines; no chord is further from its curve
//! than the tolerance. In: the file's unit, degrees for arcs, radians for ellipses. Out: mm before
//! `--scale`. Sources: AutoCAD DXF reference (bulge = tangent of a quarter of the arc's angle; extrusion
//! direction); de Boor's triangle for splines. Not covered: entities outside the drawing's plane.

use super::syntax;
use crate::geometry::{Point2, Vector2};
use crate::input::error::At;
use crate::input::nurbs::{DEGREE_MAX, Nurbs};
use crate::input::outline::{FAR_MAX_MM, RawRing};
use crate::input::{InputError, POINTS_MAX};
use dxf::entities::{Ellipse, EntityType, Spline};
use dxf::{Point, Vector};
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
    pub fn piece(&mut self, what: &str, entity: &EntityType) -> Result<RawRing, InputError> {
        let mut closed = false;
        let points = match entity {
            EntityType::Line(line) => vec![self.mm(&line.p1), self.mm(&line.p2)],
            EntityType::Circle(circle) => {
                closed = true;
                let radius_mm = circle.radius * self.unit_mm;
                let all = self.arc(what, &circle.center, radius_mm, [0.0, TAU])?;
                turned(what, all, &circle.normal)?
            }
            EntityType::Arc(arc) => {
                let radius_mm = arc.radius * self.unit_mm;
                let from = arc.start_angle.to_radians();
                let sweep = sweep(from, arc.end_angle.to_radians());
                closed = sweep >= TAU;
                let all = self.arc(what, &arc.center, radius_mm, [from, sweep])?;
                turned(what, all, &arc.normal)?
            }
            EntityType::LwPolyline(line) => {
                closed = line.is_closed();
                let corners = line.vertices.iter();
                let corners = corners.map(|corner| (self.place(corner.x, corner.y), corner.bulge));
                let all = self.bulged(&corners.collect::<Vec<_>>(), closed)?;
                turned(what, all, &line.extrusion_direction)?
            }
            EntityType::Polyline(line) => {
                closed = line.flags & 1 != 0;
                // Flag 16 marks the control points of a polyline that was made a spline.
                let corners = line.vertices().filter(|corner| corner.flags & 16 == 0);
                let corners = corners.map(|corner| (self.mm(&corner.location), corner.bulge));
                let all = self.bulged(&corners.collect::<Vec<_>>(), closed)?;
                turned(what, all, &line.normal)?
            }
            EntityType::Ellipse(ellipse) => {
                let (all, is_whole) = self.ellipse(what, ellipse)?;
                closed = is_whole;
                all
            }
            EntityType::Spline(spline) => self.spline(what, spline)?,
            _ => return Err(syntax(format!("the {what} could not be read"))),
        };
        self.check(what, &points)?;
        Ok(RawRing {
            what: what.to_string(),
            points,
            closed,
        })
    }

    /// Counts the points, and refuses coordinates that are not finite.
    fn check(&mut self, what: &str, points: &[Point2]) -> Result<(), InputError> {
        self.points += points.len();
        if self.points > POINTS_MAX {
            return Err(InputError::TooManyPoints {
                points: self.points,
            });
        }
        if points.is_empty() {
            return Err(syntax(format!("the {what} has no points")));
        }
        for (number, point) in points.iter().enumerate() {
            if !(point.x.is_finite() && point.y.is_finite()) {
                return Err(InputError::BadPoint {
                    ring: format!("the {what}"),
                    point: number,
                    problem: format!("[{}, {}] mm", point.x, point.y),
                });
            }
            if point.x.abs().max(point.y.abs()) > FAR_MAX_MM {
                return Err(InputError::TooFar {
                    at: At(*point),
                    max_mm: FAR_MAX_MM,
                });
            }
        }
        Ok(())
    }

    fn place(&self, x: f64, y: f64) -> Point2 {
        Point2::new(x * self.unit_mm, y * self.unit_mm)
    }

    fn mm(&self, point: &Point) -> Point2 {
        self.place(point.x, point.y)
    }

    /// Chords of an arc of this angle: with a radius r and half a chord's angle a, the chord is
    /// r (1 - cos a) = 2 r sin²(a/2) off the arc.
    fn arc_chords(&self, radius_mm: f64, sweep_rad: f64) -> usize {
        let half = (self.tolerance_mm / (2.0 * radius_mm)).sqrt().min(0.5);
        chords(sweep_rad.abs() / (4.0 * half.asin()))
    }

    fn arc(
        &self,
        what: &str,
        centre: &Point,
        radius_mm: f64,
        [from, sweep]: [f64; 2],
    ) -> Result<Vec<Point2>, InputError> {
        if radius_mm <= 0.0 {
            return Err(syntax(format!(
                "the {what} has a radius of {radius_mm} mm: it must be above 0"
            )));
        }
        let centre = self.mm(centre);
        let chords = self.arc_chords(radius_mm, sweep);
        // The last point of a whole turn is the first.
        let last = if sweep >= TAU { chords - 1 } else { chords };
        let angle = |k: usize| from + sweep * (k as f64 / chords as f64);
        let points = (0..=last).map(|k| {
            let (sin, cos) = angle(k).sin_cos();
            centre + radius_mm * Vector2::new(cos, sin)
        });
        Ok(points.collect())
    }

    /// Corners, each with the bulge of the edge after it.
    fn bulged(&self, corners: &[(Point2, f64)], closed: bool) -> Result<Vec<Point2>, InputError> {
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
                return Err(InputError::TooManyPoints { points });
            }
        }
        Ok(points)
    }

    /// Points of an ellipse or its arc, and whether it is whole. The second derivative is at most the
    /// longer half axis: a chord of the angle d is at most that times d² / 8 off.
    fn ellipse(&self, what: &str, ellipse: &Ellipse) -> Result<(Vec<Point2>, bool), InputError> {
        let side = upright(what, &ellipse.normal)?;
        let ratio = ellipse.minor_axis_ratio;
        let major = Vector2::new(ellipse.major_axis.x, ellipse.major_axis.y) * self.unit_mm;
        let minor = Vector2::new(-major.y, major.x) * (ratio * side);
        let longest_mm = major.norm().max(minor.norm());
        if !(ratio > 0.0 && longest_mm > 0.0) {
            return Err(syntax(format!("the {what} has an axis without length")));
        }
        let from = ellipse.start_parameter;
        let sweep = sweep(from, ellipse.end_parameter);
        let is_whole = sweep >= TAU;
        let chords = chords((sweep / (8.0 * self.tolerance_mm / longest_mm).sqrt()).max(8.0));
        let last = if is_whole { chords - 1 } else { chords };
        let centre = self.mm(&ellipse.center);
        let points = (0..=last).map(|k| {
            let (sin, cos) = (from + sweep * (k as f64 / chords as f64)).sin_cos();
            centre + major * cos + minor * sin
        });
        Ok((points.collect(), is_whole))
    }

    fn spline(&self, what: &str, spline: &Spline) -> Result<Vec<Point2>, InputError> {
        let points = &spline.control_points;
        let (count, knots) = (points.len(), &spline.knot_values);
        let degree = usize::try_from(spline.degree_of_curve).unwrap_or(0);
        let is_known = (1..=DEGREE_MAX).contains(&degree) && count > degree;
        if !is_known || knots.len() != count + degree + 1 {
            return Err(syntax(format!(
                "the {what} has degree {}, {count} control points and {} knots: the degree is from 1 \
                 to {DEGREE_MAX}, and there is a knot for each point and degree and one more",
                spline.degree_of_curve,
                knots.len()
            )));
        }
        let is_rising = knots.windows(2).all(|pair| pair[0] <= pair[1]);
        if !is_rising || knots[degree] >= knots[count] {
            return Err(syntax(format!("the knots of the {what} do not rise")));
        }
        let weights = &spline.weight_values;
        let is_weighed = weights.is_empty() || weights.len() == count;
        if !is_weighed || weights.iter().any(|weight| *weight <= 0.0) {
            return Err(syntax(format!(
                "the {what} has {} weights for {count} control points: each needs one above 0, or none has",
                weights.len()
            )));
        }
        let control = points.iter().enumerate().map(|(index, point)| {
            let weight = weights.get(index).copied().unwrap_or(1.0);
            let place = self.mm(point) * weight;
            Vector4::new(place.x, place.y, 0.0, weight)
        });
        let curve = Nurbs {
            degree,
            control: control.collect(),
            knots: knots.clone(),
        };
        self.along(&curve)
    }

    /// Chords along a spline: each part between two knots in as many pieces as its degree, each
    /// halved until it is straight at a quarter, a half and three quarters.
    fn along(&self, curve: &Nurbs) -> Result<Vec<Point2>, InputError> {
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
                    return Err(InputError::TooManyPoints { points });
                }
            }
        }
        Ok(points)
    }
}

fn chords(count: f64) -> usize {
    count.ceil().clamp(1.0, CHORDS_MAX) as usize
}

/// The angle from one to the other, counter-clockwise, above 0 and at most a whole turn.
fn sweep(from: f64, to: f64) -> f64 {
    let sweep = (to - from).rem_euclid(TAU);
    match sweep <= WHOLE_RAD || sweep >= TAU - WHOLE_RAD {
        true => TAU,
        false => sweep,
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
fn upright(what: &str, normal: &Vector) -> Result<f64, InputError> {
    let tilt = normal.x.hypot(normal.y);
    match tilt <= UPRIGHT * normal.z.abs() && normal.z != 0.0 {
        true => Ok(normal.z.signum()),
        false => Err(syntax(format!(
            "the {what} is tilted out of the drawing's plane: flatten the drawing first"
        ))),
    }
}

/// Points of an entity's own plane: seen from below, x is reversed.
fn turned(what: &str, mut points: Vec<Point2>, normal: &Vector) -> Result<Vec<Point2>, InputError> {
    if upright(what, normal)? < 0.0 {
        points.iter_mut().for_each(|point| point.x = -point.x);
    }
    Ok(points)
}
