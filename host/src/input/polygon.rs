//! Polygon JSON: `{"name","units","exterior":[[x,y],...],"holes":[[[x,y],...],...]}`.
//!
//! The first point is not repeated at a ring's end (a repeated one is dropped). Other keys are for
//! the writer's own use and are ignored, and so is `valid`: validity is checked here. A key that is
//! nearly one of these, or that holds points, is refused, because its contents would be lost.

use super::names::shortened;
use super::outline::{Drawing, RawRing, Rule, Shape};
use super::{ReadOptions, Units};
use crate::geometry::Point2;
use crate::input::error;
use crate::text::near_name::near_name;
use crate::text::refusal::{Refusal, refusal};
use nalgebra::Vector3;
use serde::Deserialize;
use serde_json::Value;
use std::collections::BTreeMap;

/// Keys that are read.
const KEYS: [&str; 4] = ["name", "units", "exterior", "holes"];

#[derive(Deserialize)]
struct File {
    name: Option<String>,
    units: Option<String>,
    exterior: Vec<Vec<f64>>,
    #[serde(default)]
    holes: Vec<Vec<Vec<f64>>>,
    #[serde(flatten)]
    others: BTreeMap<String, Value>,
}

/// Reads polygon JSON; one shape, its first ring the exterior.
pub(super) fn read(bytes: &[u8], options: &ReadOptions) -> Result<Drawing, Refusal> {
    let file: File = serde_json::from_slice(bytes).map_err(|error| {
        error::syntax(
            "polygon JSON",
            &match error.is_eof() {
                true => format!("{error}: it is cut off; copy or export it again"),
                false => error.to_string(),
            },
        )
    })?;
    check_keys(&file.others)?;
    let unit_mm = units(options, file.units.as_deref())?.mm();
    let mut rings = vec![ring("exterior".into(), &file.exterior, unit_mm)?];
    for (number, points) in file.holes.iter().enumerate() {
        rings.push(ring(format!("hole {number}"), points, unit_mm)?);
    }
    Ok(Drawing {
        name: file.name,
        shapes: vec![Shape {
            what: "the polygon".into(),
            rings,
            rule: Rule::ExteriorFirst,
            colour: None,
        }],
        notes: Vec::new(),
    })
}

/// The rings of an outline in space, mm.
pub(super) struct SpacePoints {
    /// The file's name for it.
    pub own_name: Option<String>,
    /// Exterior first.
    pub rings: Vec<Vec<Vector3<f64>>>,
}

/// The rings, if all points have three coordinates; `None` if the first has not.
pub(super) fn space_points(
    bytes: &[u8],
    options: &ReadOptions,
) -> Result<Option<SpacePoints>, Refusal> {
    let Ok(file) = serde_json::from_slice::<File>(bytes) else {
        // What is wrong is found where outlines of the plane are read.
        return Ok(None);
    };
    if file.exterior.first().is_none_or(|point| point.len() != 3) {
        return Ok(None);
    }
    check_keys(&file.others)?;
    let unit_mm = units(options, file.units.as_deref())?.mm();
    let in_space = |(number, points): (usize, &Vec<Vec<f64>>)| {
        let points = points.iter().enumerate().map(|(point, coordinates)| {
            let &[x, y, z] = coordinates.as_slice() else {
                return Err(error::bad_point(
                    &match number {
                        0 => "exterior".into(),
                        hole => format!("hole {}", hole - 1),
                    },
                    point,
                    &format!("{} numbers", coordinates.len()),
                ));
            };
            Ok(unit_mm * Vector3::new(x, y, z))
        });
        points.collect::<Result<Vec<Vector3<f64>>, Refusal>>()
    };
    let rings = std::iter::once(&file.exterior).chain(&file.holes);
    let rings = rings.enumerate().map(in_space);
    Ok(Some(SpacePoints {
        own_name: file.name,
        rings: rings.collect::<Result<_, _>>()?,
    }))
}

/// Refuses keys that look like known ones, or hold points.
fn check_keys(others: &BTreeMap<String, Value>) -> Result<(), Refusal> {
    for (key, value) in others {
        if let Some(near) = near_name(key, &KEYS) {
            let key = shortened(key);
            return Err(error::misspelt(&key, near));
        }
        if holds_points(value) {
            let key = shortened(key);
            return Err(refusal!(
                "the key '{key}' holds points and is not known: the outline is 'exterior', what \
                 is cut out of it 'holes', a list of outlines; rename it, or take it out"
            ));
        }
    }
    Ok(())
}

/// A list of points, or a list of such lists.
fn holds_points(value: &Value) -> bool {
    let first = |value: &Value| value.as_array().and_then(|list| list.first()).cloned();
    let is_point = |value: &Value| {
        let numbers = value.as_array();
        numbers.is_some_and(|list| list.len() >= 2 && list.iter().all(Value::is_number))
    };
    let inner = first(value);
    let innermost = inner.as_ref().and_then(first);
    [inner, innermost].iter().flatten().any(is_point)
}

/// The option's unit, else the file's; none is refused.
fn units(options: &ReadOptions, given: Option<&str>) -> Result<Units, Refusal> {
    match (options.units, given) {
        (Some(units), _) => Ok(units),
        (None, Some(text)) => Units::parse(text)
            .ok_or_else(|| error::unknown_units(&text.chars().take(40).collect::<String>())),
        (None, None) => Err(refusal!(
            "the file says no units: add \"units\": \"mm\" (or cm, m, um, in) or give --units"
        )),
    }
}

fn ring(what: String, points: &[Vec<f64>], unit_mm: f64) -> Result<RawRing, Refusal> {
    let mut converted = Vec::with_capacity(points.len());
    for (number, point) in points.iter().enumerate() {
        let &[x, y] = point.as_slice() else {
            return Err(error::bad_point(
                &what,
                number,
                &format!("{} numbers", point.len()),
            ));
        };
        converted.push(Point2::new(x * unit_mm, y * unit_mm));
    }
    Ok(RawRing {
        what,
        points: converted,
        closed: true,
    })
}
