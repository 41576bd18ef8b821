//! What is to be printed: an outline or a path.
//!
//! In: rings in mm, or the bytes of a file. Out: a checked [`Part`]. Leaves out meshes and G-code, which are
//! planned layer by layer by the command.

use super::Error;
use crate::geometry::polygon::Region;
use crate::input::waypoints::WaypointRun;
use crate::input::{self, Format, Input, Loaded, ReadOptions, Units};

/// How a file is read.
///
/// Made by [`Reading::default`] and changed field by field.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Reading {
    /// Unit of the coordinates, over what the file says.
    pub units: Option<Units>,
    /// Factor on all coordinates, after the unit.
    pub scale: f64,
    /// Curves become polygons this close.
    pub flatten_mm: f64,
    /// Mend crossings, overlaps and open contours by the fill rule, and say what was changed.
    pub repair: bool,
}

impl Default for Reading {
    fn default() -> Reading {
        let ReadOptions {
            units,
            scale,
            flatten_mm,
            repair,
            ..
        } = ReadOptions::default();
        Reading {
            units,
            scale,
            flatten_mm,
            repair,
        }
    }
}

/// What is to be printed, checked, in its own coordinates.
#[derive(Clone, Debug)]
pub struct Part {
    pub(super) what: What,
    pub(super) keep_out: Vec<Region>,
    pub(super) at_mm: Option<[f64; 3]>,
}

#[derive(Clone, Debug)]
pub(super) enum What {
    Outline(Loaded),
    Path(WaypointRun),
}

impl Part {
    /// Polygons, each a list of rings in mm: its exterior, then its holes. A first point that is repeated
    /// at the end is dropped; rings may turn either way.
    ///
    /// # Errors
    /// [`Error::Part`] where it is no valid outline, with the place.
    pub fn from_polygons(name: &str, polygons: &[Vec<Vec<[f64; 2]>>]) -> Result<Part, Error> {
        if let Some(empty) = polygons.iter().position(Vec::is_empty) {
            return Err(Error::Part(format!(
                "polygon {empty} has no rings: give its exterior first, then its holes"
            )));
        }
        let read = input::read_rings(polygons, name, &ReadOptions::default());
        Ok(Part::of(What::Outline(read.map_err(part_error)?)))
    }

    /// A file's bytes: polygon JSON, GeoJSON, SVG, DXF, waypoints or NURBS, by its ending (`json`,
    /// `geojson`, `svg`, `dxf`, `wpt`, `nurbs`). The name is used where the file has none of its own.
    ///
    /// # Errors
    /// [`Error::Part`], with the place.
    pub fn from_bytes(
        name: &str,
        ending: &str,
        bytes: &[u8],
        reading: &Reading,
    ) -> Result<Part, Error> {
        let of_command = "is planned by the command: headway plan FILE -o JOB.hwj";
        let format = Format::parse(&ending.to_ascii_lowercase()).ok_or_else(|| {
            let ending: String = ending.chars().take(40).collect();
            Error::Part(format!(
                "{ending} is no known format: give json, geojson, svg, dxf, wpt or nurbs"
            ))
        })?;
        match format {
            Format::Mesh(_) => return Err(Error::Part(format!("a mesh {of_command}"))),
            Format::Gcode => return Err(Error::Part(format!("G-code {of_command}"))),
            _ => {}
        }
        if bytes.len() as u64 > format.bytes_max() {
            let (bytes, bytes_max) = (bytes.len() as u64, format.bytes_max());
            return Err(part_error(input::InputError::FileTooLarge {
                bytes,
                bytes_max,
            }));
        }
        let options = ReadOptions {
            units: reading.units,
            scale: reading.scale,
            flatten_mm: checked_flatten_mm(reading.flatten_mm)?,
            repair: reading.repair,
            ..ReadOptions::default()
        };
        match input::read_any(bytes, name, format, &options).map_err(part_error)? {
            Input::Outline(loaded) => Ok(Part::of(What::Outline(loaded))),
            Input::Path(run) => Ok(Part::of(What::Path(run))),
            Input::Mesh(_) => Err(Error::Part(format!("a mesh {of_command}"))),
            Input::Gcode(_) => Err(Error::Part(format!("G-code {of_command}"))),
        }
    }

    /// The same part around what neither aperture nor nozzle body may enter, in the part's coordinates.
    ///
    /// # Errors
    /// [`Error::Part`] where either is a path: it is followed as it is.
    pub fn keeping_out(mut self, keep_out: &Part) -> Result<Part, Error> {
        match (&self.what, &keep_out.what) {
            (What::Outline(_), What::Outline(out)) => {
                self.keep_out.extend(out.target.regions.iter().cloned());
                Ok(self)
            }
            _ => Err(Error::Part(
                "a path is followed as it is and kept out of nothing: give outlines".to_string(),
            )),
        }
    }

    /// The same part with its origin at a place of the machine, mm, in place of its box centred over the
    /// work area.
    ///
    /// # Errors
    /// [`Error::Part`] where a number is not finite.
    pub fn placed_at(mut self, at_mm: [f64; 3]) -> Result<Part, Error> {
        if at_mm.iter().any(|number| !number.is_finite()) {
            return Err(Error::Part(format!(
                "the place {at_mm:?} is none: give three finite numbers in mm"
            )));
        }
        self.at_mm = Some(at_mm);
        Ok(self)
    }

    /// Its name.
    pub fn name(&self) -> &str {
        match &self.what {
            What::Outline(loaded) => &loaded.target.name,
            What::Path(run) => &run.name,
        }
    }

    /// What there is to know of how it was read, one line each.
    pub fn notes(&self) -> &[String] {
        match &self.what {
            What::Outline(loaded) => &loaded.notes,
            What::Path(run) => &run.notes,
        }
    }

    fn of(what: What) -> Part {
        Part {
            what,
            keep_out: Vec::new(),
            at_mm: None,
        }
    }
}

/// Finest and coarsest flattening, mm.
const FLATTEN_MM: [f64; 2] = [1e-6, 10.0];

fn checked_flatten_mm(flatten_mm: f64) -> Result<f64, Error> {
    if (FLATTEN_MM[0]..=FLATTEN_MM[1]).contains(&flatten_mm) {
        return Ok(flatten_mm);
    }
    Err(Error::Part(format!(
        "flatten_mm is {flatten_mm}: give {} to {} mm",
        FLATTEN_MM[0], FLATTEN_MM[1]
    )))
}

fn part_error(error: impl std::fmt::Display) -> Error {
    Error::Part(error.to_string())
}
