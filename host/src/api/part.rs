//! The part to print: an outline, a mesh, a path, a slicer's file, a surface.
//!
//! In: rings in mm, or the bytes of a file. Out: a checked [`Part`].

use super::Error;
use crate::geometry::polygon::Region;
use crate::input::space_outline::SpaceOutline;
use crate::input::{self, Format, Input, ReadOptions, Units};
use crate::mesh::layers::HeightRange;
use crate::mesh::{self, Mesh, MeshOptions, SurfaceRegion};

/// How a file is read.
///
/// Made by [`Reading::default`] and changed field by field.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Reading {
    /// Unit of the coordinates; overrides the file's.
    pub units: Option<Units>,
    /// Factor on all coordinates, after the unit.
    pub scale: f64,
    /// Curves become polygons this close.
    pub flatten_mm: f64,
    /// Repair crossings, overlaps and open contours by the fill rule, and report the changes.
    pub repair: bool,
    /// Contours of a drawing are the middles of beads, and not filled.
    pub centre_lines: bool,
    /// The part of a surface that is meant: `group:NAME`, `colour:#RRGGBB` or `normal:DEG`, as the command's
    /// `--surface-region`; all of it if there is none.
    pub surface_region: Option<String>,
}

impl Default for Reading {
    fn default() -> Reading {
        let read = ReadOptions::default();
        Reading {
            units: read.units,
            scale: read.scale,
            flatten_mm: read.flatten_mm,
            repair: read.repair,
            centre_lines: read.centre_lines,
            surface_region: None,
        }
    }
}

/// The part to print, checked, in its own coordinates.
#[derive(Clone, Debug)]
pub struct Part {
    pub(crate) what: What,
    pub(crate) keep_out: Vec<Region>,
    /// Origins on the machine, of each of several parts its own.
    pub(crate) at_mm: Vec<[f64; 3]>,
    /// The surface of an outline.
    pub(crate) surface: Option<Mesh>,
    /// Layers of a mesh with their own heights.
    pub(crate) height_ranges: Vec<HeightRange>,
}

/// What is printed.
#[derive(Clone, Debug)]
pub(crate) enum What {
    Input(Input),
    /// A complete surface, or the outline that is drawn on it.
    Patch {
        name: String,
        mesh: Mesh,
        drawn: Option<SpaceOutline>,
    },
}

impl Part {
    /// Polygons, each a list of rings in mm: its exterior, then its holes. A first point that is repeated
    /// at the end is dropped; rings may have either orientation.
    ///
    /// # Errors
    /// [`Error::Part`] if it is not a valid outline, with the place.
    pub fn from_polygons(name: &str, polygons: &[Vec<Vec<[f64; 2]>>]) -> Result<Part, Error> {
        if let Some(empty) = polygons.iter().position(Vec::is_empty) {
            return Err(Error::Part(format!(
                "polygon {empty} has no rings: give its exterior first, then its holes"
            )));
        }
        let read = input::read_rings(polygons, name, &ReadOptions::default());
        let read = read.map_err(part_error)?;
        Ok(Part::of(What::Input(Input::Outline(read))))
    }

    /// A file's bytes: polygon JSON, GeoJSON, SVG, DXF, a mesh, waypoints, NURBS or G-code, by its ending (`json`,
    /// `geojson`, `svg`, `dxf`, `stl`, `3mf`, `obj`, `wpt`, `nurbs`, `gcode`). The name is used if the file has none.
    ///
    /// # Errors
    /// [`Error::Part`], with the place.
    pub fn from_bytes(
        name: &str,
        ending: &str,
        bytes: &[u8],
        reading: &Reading,
    ) -> Result<Part, Error> {
        let format = format_of(ending, bytes)?;
        let options = ReadOptions {
            units: reading.units,
            scale: reading.scale,
            flatten_mm: checked_flatten_mm(reading.flatten_mm)?,
            repair: reading.repair,
            centre_lines: reading.centre_lines,
            ..ReadOptions::default()
        };
        let read = input::read_any(bytes, name, format, &options).map_err(part_error)?;
        Ok(Part::of(What::Input(read)))
    }

    /// A surface by itself: a complete mesh that is not closed, up to its rims, one bead's height thick.
    ///
    /// # Errors
    /// [`Error::Part`], with the place.
    pub fn from_surface(
        name: &str,
        ending: &str,
        bytes: &[u8],
        reading: &Reading,
    ) -> Result<Part, Error> {
        let surface = read_surface(ending, bytes, reading)?;
        Ok(Part::of(What::Patch {
            name: name.to_string(),
            mesh: surface,
            drawn: None,
        }))
    }

    /// The same outline, seen from above, projected onto a surface: a mesh's bytes.
    ///
    /// # Errors
    /// [`Error::Part`] if it is not an outline, or the mesh cannot be read.
    pub fn on_surface(
        mut self,
        ending: &str,
        bytes: &[u8],
        reading: &Reading,
    ) -> Result<Part, Error> {
        if !matches!(self.what, What::Input(Input::Outline(_))) {
            return Err(Error::Part(
                "only an outline is projected onto a surface: give an outline".to_string(),
            ));
        }
        self.surface = Some(read_surface(ending, bytes, reading)?);
        Ok(self)
    }

    /// The same part with keep-outs that neither aperture nor nozzle body may enter, in the part's
    /// coordinates.
    ///
    /// # Errors
    /// [`Error::Part`] if the part is a path, which is followed unchanged, or the keep-out is not an
    /// outline.
    pub fn keeping_out(mut self, keep_out: &Part) -> Result<Part, Error> {
        match (&self.what, &keep_out.what) {
            (
                What::Input(Input::Outline(_) | Input::Mesh(_)),
                What::Input(Input::Outline(out)),
            ) => {
                self.keep_out.extend(out.target.regions.iter().cloned());
                Ok(self)
            }
            _ => Err(Error::Part(
                "a path is followed as it is and kept out of nothing: give an outline or a mesh, and an outline to \
                 keep out of"
                    .to_string(),
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
        self.at_mm = vec![at_mm];
        Ok(self)
    }

    /// Its name.
    pub fn name(&self) -> &str {
        match &self.what {
            What::Input(input) => input.name(),
            What::Patch { name, .. } => name,
        }
    }

    /// What there is to know of how it was read, one line each.
    pub fn notes(&self) -> &[String] {
        match &self.what {
            What::Input(input) => input.notes(),
            What::Patch { .. } => &[],
        }
    }

    pub(crate) fn of(what: What) -> Part {
        Part {
            what,
            keep_out: Vec::new(),
            at_mm: Vec::new(),
            surface: None,
            height_ranges: Vec::new(),
        }
    }
}

/// The format of an ending, for a file that is not too large for it.
fn format_of(ending: &str, bytes: &[u8]) -> Result<Format, Error> {
    let format = Format::parse(&ending.to_ascii_lowercase()).ok_or_else(|| {
        let ending: String = ending.chars().take(40).collect();
        Error::Part(format!(
            "{ending} is no known format: give json, geojson, svg, dxf, stl, 3mf, obj, wpt, nurbs or gcode"
        ))
    })?;
    let (bytes, bytes_max) = (bytes.len() as u64, format.bytes_max());
    match bytes > bytes_max {
        true => Err(part_error(input::error::file_too_large(bytes, bytes_max))),
        false => Ok(format),
    }
}

pub(crate) fn read_surface(ending: &str, bytes: &[u8], reading: &Reading) -> Result<Mesh, Error> {
    let Format::Mesh(format) = format_of(ending, bytes)? else {
        return Err(Error::Part(
            "a surface is a mesh: give stl, 3mf or obj".to_string(),
        ));
    };
    let options = MeshOptions {
        unit_mm: reading.units.map(Units::mm),
        scale: reading.scale,
        rotate_rad: [0.0; 3],
    };
    let region = reading.surface_region.as_deref();
    let region = region.map(|text| {
        SurfaceRegion::parse(text).ok_or_else(|| {
            Error::Options(format!(
                "--surface-region {text}: write group:NAME, colour:#RRGGBB or normal:DEG, as in normal:60"
            ))
        })
    });
    let region = region.transpose()?;
    mesh::read_surface(bytes, format, &options, region.as_ref()).map_err(part_error)
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

pub(super) fn part_error(error: impl std::fmt::Display) -> Error {
    Error::Part(error.to_string())
}
