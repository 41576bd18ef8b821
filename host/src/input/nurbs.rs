//! NURBS JSON: `{"name","units","degree","control_points":[[x,y]|[x,y,z],...],"weights","knots"}` ->
//! a [`WaypointRun`].
//!
//! The curve is sampled so densely that the C² spline through the samples reproduces it: chords are no
//! further from it than [`SAG_MM`] and turn by no more than [`TURN_RAD`], which keeps the spline within
//! some ten nanometres. The tool is upright. Output: mm, input coordinates. Evaluation: C. de Boor, A
//! Practical Guide to Splines (1978), chapter 10, in homogeneous coordinates. Not covered: surfaces and
//! lists of curves.

use super::names::{name_of, shortened};
use super::waypoints::{PassAsked, WAYPOINTS_MAX, Waypoint, WaypointRun};
use super::{ReadOptions, Units};
use crate::input::error;
use crate::text::refusal::Refusal;
use nalgebra::{Point3, Unit, Vector3, Vector4};
use serde::Deserialize;

/// Largest distance of a chord from the curve, mm.
const SAG_MM: f64 = 0.002;
/// Largest turn of the curve between two samples, rad: 3°.
const TURN_RAD: f64 = 0.05;
/// Longest chord, mm.
const CHORD_MAX_MM: f64 = 1.0;
/// Most halvings of a knot span.
const HALVINGS_MAX: u32 = 24;
/// Highest degree.
pub(super) const DEGREE_MAX: usize = 9;

#[derive(Deserialize)]
struct File {
    name: Option<String>,
    units: Option<String>,
    degree: usize,
    control_points: Vec<Vec<f64>>,
    weights: Option<Vec<f64>>,
    knots: Vec<f64>,
}

/// A curve in homogeneous coordinates.
pub(super) struct Nurbs {
    pub degree: usize,
    pub control: Vec<Vector4<f64>>,
    pub knots: Vec<f64>,
}

/// True where a JSON file holds a curve, by its keys.
pub(super) fn is_nurbs(bytes: &[u8]) -> bool {
    let has = |key: &[u8]| bytes.windows(key.len()).any(|part| part == key);
    has(b"\"control_points\"") && has(b"\"knots\"")
}

/// Reads a curve. `name` is used if the file has none.
///
/// # Errors
/// [`Refusal`] with the cause.
pub(super) fn read(
    bytes: &[u8],
    name: &str,
    options: &ReadOptions,
) -> Result<WaypointRun, Refusal> {
    let file: File = serde_json::from_slice(bytes).map_err(|error| syntax(error.to_string()))?;
    let units = match (options.units, file.units.as_deref()) {
        (Some(units), _) => units,
        (None, None) => Units::Mm,
        (None, Some(text)) => Units::parse(text).ok_or_else(|| {
            let given = shortened(text);
            syntax(format!(
                "units '{given}' are not known: use mm, cm, m, um or in"
            ))
        })?,
    };
    let curve = Nurbs::of(&file, units.mm() * options.scale)?;
    let points = curve.samples()?;
    Ok(WaypointRun {
        name: name_of(file.name.as_deref(), name, "curve"),
        notes: vec![format!(
            "the curve is followed by {} waypoints",
            points.len()
        )],
        points,
        has_feeds: false,
    })
}

fn syntax(problem: String) -> Refusal {
    error::syntax("NURBS JSON", &problem)
}

impl Nurbs {
    fn of(file: &File, unit_mm: f64) -> Result<Nurbs, Refusal> {
        let (degree, count) = (file.degree, file.control_points.len());
        if !(1..=DEGREE_MAX).contains(&degree) || count <= degree {
            return Err(syntax(format!(
                "degree {degree} with {count} control points: write a degree from 1 to {DEGREE_MAX} \
                 and more points than that"
            )));
        }
        if file.knots.len() != count + degree + 1 {
            let needed = count + degree + 1;
            return Err(syntax(format!(
                "{} knots; {count} control points of degree {degree} need {needed}",
                file.knots.len()
            )));
        }
        // A NaN is in no order.
        let in_order = file.knots.windows(2).all(|pair| pair[0] <= pair[1]);
        let domain = file.knots[count] - file.knots[degree];
        let is_whole = in_order && domain.is_finite() && domain > 0.0;
        if !is_whole {
            return Err(syntax("the knots must rise".to_string()));
        }
        let weights = file.weights.clone().unwrap_or_else(|| vec![1.0; count]);
        if weights.len() != count || !weights.iter().all(|w| *w > 0.0 && w.is_finite()) {
            return Err(syntax(
                "each control point needs a weight above 0".to_string(),
            ));
        }
        let control = file.control_points.iter().zip(weights).enumerate();
        let control = control.map(|(index, (point, weight))| {
            let (x, y, z) = match point[..] {
                [x, y] => (x, y, 0.0),
                [x, y, z] => (x, y, z),
                _ => return Err(syntax(format!("control point {index} is not x, y[, z]"))),
            };
            let far_mm = super::outline::FAR_MAX_MM;
            let place = unit_mm * Vector3::new(x, y, z);
            if place.norm() > far_mm || !place.norm().is_finite() {
                let problem =
                    format!("control point {index} is beyond {far_mm} mm: check the units");
                return Err(syntax(problem));
            }
            let place = weight * place;
            Ok(Vector4::new(place.x, place.y, place.z, weight))
        });
        Ok(Nurbs {
            degree,
            control: control.collect::<Result<_, _>>()?,
            knots: file.knots.clone(),
        })
    }

    /// The place at a parameter in the knot span after `knot`, by de Boor's triangle.
    pub fn place(&self, knot: usize, u: f64) -> Vector3<f64> {
        let p = self.degree;
        let mut triangle: Vec<Vector4<f64>> = self.control[knot - p..=knot].to_vec();
        for level in 1..=p {
            for index in (level..=p).rev() {
                let at = knot - p + index;
                let (low, high) = (self.knots[at], self.knots[at + p + 1 - level]);
                let share = if high > low {
                    (u - low) / (high - low)
                } else {
                    0.0
                };
                triangle[index] = triangle[index - 1].lerp(&triangle[index], share);
            }
        }
        triangle[p].xyz() / triangle[p].w
    }

    fn samples(&self) -> Result<Vec<Waypoint>, Refusal> {
        let mut places = Vec::new();
        for knot in self.degree..self.control.len() {
            let (from, to) = (self.knots[knot], self.knots[knot + 1]);
            if to <= from {
                continue;
            }
            let begin = self.place(knot, from);
            if places.is_empty() {
                places.push(begin);
            }
            // Halved once at least: a chord between two bends in opposite directions is on neither.
            let middle = 0.5 * (from + to);
            let half = self.place(knot, middle);
            self.bisect(knot, [(from, begin), (middle, half)], 1, &mut places)?;
            self.bisect(
                knot,
                [(middle, half), (to, self.place(knot, to))],
                1,
                &mut places,
            )?;
        }
        let places = places.into_iter().enumerate();
        Ok(places
            .map(|(index, place)| Waypoint {
                line: index + 1,
                tip_mm: Point3::from(place),
                axis: Unit::new_unchecked(Vector3::z()),
                heading_rad: None,
                width_mm: None,
                height_mm: None,
                section_mm2: None,
                speed_mm_s: None,
                cone_rad: None,
                begins: false,
                asked: PassAsked::default(),
            })
            .collect())
    }

    /// Adds the samples after the first end, up to the second.
    fn bisect(
        &self,
        knot: usize,
        [(from, begin), (to, end)]: [(f64, Vector3<f64>); 2],
        halvings: u32,
        places: &mut Vec<Vector3<f64>>,
    ) -> Result<(), Refusal> {
        let middle = 0.5 * (from + to);
        let half = self.place(knot, middle);
        let chord = end - begin;
        let (first, second) = (half - begin, end - half);
        let sag_mm = (half - 0.5 * (begin + end)).norm();
        let turn_rad = first.angle(&second);
        let is_fine = sag_mm <= SAG_MM && turn_rad <= TURN_RAD && chord.norm() <= CHORD_MAX_MM;
        if is_fine || halvings >= HALVINGS_MAX {
            if chord.norm() > super::waypoints::SAME_PLACE_MM {
                places.push(end);
            }
            if places.len() > WAYPOINTS_MAX {
                return Err(syntax(format!(
                    "the curve needs more than {WAYPOINTS_MAX} waypoints: check its units, or split it"
                )));
            }
            return Ok(());
        }
        self.bisect(knot, [(from, begin), (middle, half)], halvings + 1, places)?;
        self.bisect(knot, [(middle, half), (to, end)], halvings + 1, places)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(text: &str) -> Result<WaypointRun, Refusal> {
        read(text.as_bytes(), "curve", &ReadOptions::default())
    }

    /// A quarter of a circle as a rational parabola: every sample lies on it.
    #[test]
    fn a_circle_is_a_circle() {
        let text = r#"{"degree": 2, "units": "cm", "control_points": [[1, 0], [1, 1], [0, 1]],
            "weights": [1, 0.7071067811865476, 1], "knots": [0, 0, 0, 1, 1, 1]}"#;
        assert!(is_nurbs(text.as_bytes()));
        let run = run(text).unwrap();
        assert!(run.points.len() > 25, "{}", run.points.len());
        for point in &run.points {
            assert!(
                (point.tip_mm.coords.norm() - 10.0).abs() < 1e-12,
                "{point:?}"
            );
        }
        for pair in run.points.windows(2) {
            let chord_mm = (pair[1].tip_mm - pair[0].tip_mm).norm();
            assert!(chord_mm < 0.6 && chord_mm > 0.1, "{chord_mm}");
        }
        let last = run.points.last().unwrap();
        assert!((last.tip_mm - Point3::new(0.0, 10.0, 0.0)).norm() < 1e-12);
    }

    #[test]
    fn what_is_no_curve_is_refused() {
        for (text, problem) in [
            (
                r#"{"degree": 2, "control_points": [[0, 0], [1, 1]], "knots": []}"#,
                "more points",
            ),
            (
                r#"{"degree": 1, "control_points": [[0, 0], [1, 1]], "knots": [0, 1]}"#,
                "need 4",
            ),
            (
                r#"{"degree": 1, "control_points": [[0, 0], [1, 1]], "knots": [0, 1, 0, 1]}"#,
                "must rise",
            ),
            (
                r#"{"degree": 1, "control_points": [[0, 0], [1]], "knots": [0, 0, 1, 1]}"#,
                "control point 1",
            ),
            (
                r#"{"degree": 1, "control_points": [[0, 0], [1, 1]], "knots": [0, 0, 1, 1],
                    "weights": [1, 0]}"#,
                "weight above 0",
            ),
        ] {
            let error = run(text).unwrap_err().to_string();
            assert!(error.contains(problem), "{error}");
        }
    }
}
