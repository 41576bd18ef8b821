//! GeoJSON (RFC 7946): Polygon and MultiPolygon, alone, in features or in collections.
//!
//! Coordinates are read as plain lengths, not as degrees: mm unless `--units` or a foreign member
//! `units` at the top gives another unit. A third coordinate is ignored with a note, and so are lines
//! and points among polygons, which have no interior.

use super::names::shortened;
use super::outline::{Drawing, RawRing, Rule, Shape};
use super::{ReadOptions, Units};
use crate::geometry::Point2;
use crate::input::error;
use crate::text::near_name::near_name;
use crate::text::refusal::{Refusal, refusal};
use ::geojson::{Feature, GeoJson, Geometry, GeometryValue, JsonObject, PolygonType, Position};

/// Collections may nest; RFC 7946 advises against it, and nobody needs more than this.
const DEPTH_MAX: usize = 16;

/// Members that mean something, at the top or in a feature.
const KEYS: [&str; 11] = [
    "type",
    "units",
    "name",
    "features",
    "geometry",
    "geometries",
    "coordinates",
    "properties",
    "bbox",
    "id",
    "crs",
];

struct Reader {
    unit_mm: f64,
    /// Lines are read.
    centre_lines: bool,
    shapes: Vec<Shape>,
    heights: usize,
    /// What has no inside: place and type.
    left_out: Vec<(String, &'static str)>,
    name: Option<String>,
}

/// Reads GeoJSON; one shape for each polygon.
pub(super) fn read(bytes: &[u8], options: &ReadOptions) -> Result<Drawing, Refusal> {
    let syntax = |problem: String| error::syntax("GeoJSON", &problem);
    let text = std::str::from_utf8(bytes).map_err(|error| syntax(error.to_string()))?;
    let file: GeoJson = text
        .parse()
        .map_err(|error: ::geojson::Error| syntax(error.to_string()))?;
    let foreign = match &file {
        GeoJson::Geometry(geometry) => geometry.foreign_members.as_ref(),
        GeoJson::Feature(feature) => feature.foreign_members.as_ref(),
        GeoJson::FeatureCollection(collection) => collection.foreign_members.as_ref(),
    };
    check_keys(foreign)?;
    let said = foreign.and_then(|members| members.get("units")?.as_str());
    let mut notes = Vec::new();
    let units = match (options.units, said) {
        (Some(units), _) => units,
        (None, Some(text)) => Units::parse(text)
            .ok_or_else(|| error::unknown_units(&text.chars().take(40).collect::<String>()))?,
        (None, None) => {
            notes.push("the GeoJSON says no units: taken as mm (see --units)".to_string());
            Units::Mm
        }
    };
    let mut reader = Reader {
        unit_mm: units.mm(),
        centre_lines: options.centre_lines,
        shapes: Vec::new(),
        heights: 0,
        left_out: Vec::new(),
        name: foreign.and_then(|members| string(members, "name")),
    };
    match &file {
        GeoJson::Geometry(geometry) => reader.geometry(geometry, "the geometry", 0)?,
        GeoJson::Feature(feature) => reader.feature(feature, "the feature")?,
        GeoJson::FeatureCollection(collection) => {
            for (number, feature) in collection.features.iter().enumerate() {
                reader.feature(feature, &format!("feature {number}"))?;
            }
        }
    }
    if reader.heights > 0 {
        notes.push(format!(
            "{} points have a third coordinate, which was ignored",
            reader.heights
        ));
    }
    notes.extend(reader.told_of_left_out()?);
    Ok(Drawing {
        name: reader.name,
        shapes: reader.shapes,
        notes,
    })
}

impl Reader {
    /// Geometries without an interior are reported if there is something else, and refused if there
    /// is not.
    fn told_of_left_out(&self) -> Result<Option<String>, Refusal> {
        let Some((what, kind)) = self.left_out.first() else {
            return Ok(None);
        };
        if self.shapes.is_empty() {
            let what = what.clone();
            return Err(match self.centre_lines {
                true => error::no_lines(&what),
                false => refusal!(
                    "{what} is a {kind}, which has no inside; only Polygon and MultiPolygon can \
                     be filled, and LineString and MultiLineString printed as beads with \
                     --centre-lines"
                ),
            });
        }
        let count = self.left_out.len();
        Ok(Some(format!(
            "{count} geometries were left out (the first: {what}, a {kind}): only Polygon and \
             MultiPolygon have an inside"
        )))
    }

    fn feature(&mut self, feature: &Feature, what: &str) -> Result<(), Refusal> {
        check_keys(feature.foreign_members.as_ref())?;
        let name = feature
            .properties
            .as_ref()
            .and_then(|members| string(members, "name"));
        let what = match &name {
            Some(name) => format!("{what} ('{}')", shortened(name)),
            None => what.to_string(),
        };
        if self.name.is_none() {
            self.name = name;
        }
        match &feature.geometry {
            Some(geometry) => self.geometry(geometry, &what, 0),
            None => Ok(()),
        }
    }

    fn geometry(&mut self, of: &Geometry, what: &str, depth: usize) -> Result<(), Refusal> {
        match &of.value {
            GeometryValue::Polygon { coordinates } => self.polygon(coordinates, what),
            GeometryValue::MultiPolygon { coordinates } => {
                coordinates.iter().enumerate().try_for_each(|(k, polygon)| {
                    self.polygon(polygon, &format!("{what}, polygon {k}"))
                })
            }
            GeometryValue::LineString { coordinates } if self.centre_lines => {
                self.rings([(what.to_string(), coordinates)], what)
            }
            GeometryValue::MultiLineString { coordinates } if self.centre_lines => {
                let lines = coordinates.iter().enumerate();
                self.rings(
                    lines.map(|(k, line)| (format!("{what}, line {k}"), line)),
                    what,
                )
            }
            GeometryValue::GeometryCollection { geometries } if depth < DEPTH_MAX => geometries
                .iter()
                .try_for_each(|geometry| self.geometry(geometry, what, depth + 1)),
            GeometryValue::GeometryCollection { .. } => Err(error::syntax(
                "GeoJSON",
                &format!("collections are nested more than {DEPTH_MAX} deep"),
            )),
            other => {
                self.left_out.push((what.to_string(), other.type_name()));
                Ok(())
            }
        }
    }

    fn polygon(&mut self, polygon: &PolygonType, what: &str) -> Result<(), Refusal> {
        let name = |number: usize| match number {
            0 => format!("{what}, exterior"),
            _ => format!("{what}, hole {}", number - 1),
        };
        let rings = polygon.iter().enumerate();
        self.rings(rings.map(|(number, ring)| (name(number), ring)), what)
    }

    /// The named rings or lines of one geometry.
    fn rings<'a>(
        &mut self,
        named: impl IntoIterator<Item = (String, &'a Vec<Position>)>,
        what: &str,
    ) -> Result<(), Refusal> {
        let mut rings = Vec::new();
        for (name, positions) in named {
            let mut points = Vec::with_capacity(positions.len());
            for (k, position) in positions.iter().enumerate() {
                let &[x, y, ref rest @ ..] = position.as_slice() else {
                    return Err(error::bad_point(
                        &name,
                        k,
                        &format!("{} numbers", position.len()),
                    ));
                };
                self.heights += usize::from(!rest.is_empty());
                points.push(Point2::new(x * self.unit_mm, y * self.unit_mm));
            }
            rings.push(RawRing {
                what: name,
                points,
                closed: false,
            });
        }
        if !rings.is_empty() {
            self.shapes.push(Shape {
                what: what.to_string(),
                rings,
                rule: Rule::ExteriorFirst,
                colour: None,
            });
        }
        Ok(())
    }
}

/// Refuses members that are similar to known ones; others are foreign and ignored.
fn check_keys(foreign: Option<&JsonObject>) -> Result<(), Refusal> {
    let near = foreign.into_iter().flatten().find_map(|(key, _)| {
        let near = near_name(key, &KEYS)?;
        let key = shortened(key);
        Some(error::misspelt(&key, near))
    });
    near.map_or(Ok(()), Err)
}

fn string(members: &JsonObject, key: &str) -> Option<String> {
    members.get(key)?.as_str().map(str::to_string)
}
