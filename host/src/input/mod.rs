//! The user's input -> a [`Target`] in mm.
//!
//! ```text
//! bytes --polygon|geojson|svg|dxf--> Shape (rings as drawn, file's unit)
//!       --outline--> Region (mm, exterior counter-clockwise, holes clockwise, valid) --> Target
//!       '--centre_lines--> CentreLines (mm)
//! bytes --waypoints|nurbs--> WaypointRun (mm, rad)
//! bytes --mesh--> LoadedMesh (mm, closed)
//! bytes --gcode--> GcodeProgram (mm, mm³), with tilts WaypointRun
//! ```
//! Input: the file's bytes, its [`Format`] and [`ReadOptions`]. Output: regions in the file's own
//! coordinates (for SVG: mm from the page's lower left corner, y up), and notes for the user.
//! Nothing is repaired silently: an invalid outline is refused with the place and a remedy. Not
//! covered: files and threads; the command reads the bytes.

pub mod centre_lines;
pub mod copies;
pub mod declared_run;
mod dxf;
pub mod error;
mod gcode_run;
mod geojson;
pub mod names;
pub mod near_waypoints;
mod nurbs;
pub mod outline;
mod polygon;
mod settle;
pub mod space_outline;
mod svg;
mod waypoint_columns;
pub mod waypoints;

use crate::text::refusal::{Refusal, refusal};
use centre_lines::CentreLines;
use waypoints::WaypointRun;

use crate::gcode::axes::FileAxes;
use crate::gcode::{self, GCODE_BYTES_MAX, GcodeOptions, GcodeProgram};
use crate::geometry::polygon::Region;
use crate::mesh::{self, LoadedMesh, MeshFormat, MeshOptions};
use crate::text::plain::plain;
use std::borrow::Cow;
use std::path::Path;
use std::sync::Arc;

/// Most points that an input may have, all rings together. A million edges is minutes of planning;
/// beyond that the drawing was flattened too finely, or it is a map.
pub const POINTS_MAX: usize = 1_000_000;
/// Largest file that is read, bytes: [`POINTS_MAX`] points with 60 characters each.
pub const BYTES_MAX: u64 = 64 * 1024 * 1024;
/// The same for a mesh, bytes: binary STL of the maximum number of triangles, 50 bytes each.
pub const MESH_BYTES_MAX: u64 = 50 * mesh::TRIANGLES_MAX as u64;

/// One layer's outline, mm, in the input's own coordinates.
#[derive(Clone, Debug, PartialEq)]
pub struct Target {
    /// Name for headers and pictures.
    pub name: String,
    /// Valid, disjoint regions.
    pub regions: Vec<Region>,
}

/// File formats that can be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// `{"name","units","exterior","holes"}`.
    Polygon,
    /// RFC 7946 geometry, feature or collection.
    GeoJson,
    /// Filled shapes of an SVG page.
    Svg,
    /// Contours of an ASCII DXF drawing.
    Dxf,
    /// A run of the tip, `x y z nx ny nz [heading_deg]` on each line.
    Waypoints,
    /// A rational B-spline curve, `{"degree","control_points","weights","knots"}`.
    Nurbs,
    /// Triangles of a solid.
    Mesh(MeshFormat),
    /// What a slicer or a post-processor wrote.
    Gcode,
}

/// Length units of files and options.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Units {
    /// Millimetres.
    Mm,
    /// Centimetres.
    Cm,
    /// Metres.
    M,
    /// Micrometres.
    Um,
    /// Inches.
    In,
}

/// How to read.
#[derive(Clone, Debug, PartialEq)]
pub struct ReadOptions {
    /// Unit of the coordinates; overrides the file's.
    pub units: Option<Units>,
    /// Factor on all coordinates, after the unit.
    pub scale: f64,
    /// Curves become polygons this close, mm.
    pub flatten_mm: f64,
    /// Mend crossings, overlaps and open contours by the fill rule.
    pub repair: bool,
    /// Turns about the file's x, then y, then z axis; of meshes only.
    pub rotate_rad: [f64; 3],
    /// Diameter of the filament of G-code; overrides the file's.
    pub filament_mm: Option<f64>,
    /// Axes of the machine that G-code was written for, where they are declared.
    pub gcode_axes: Option<Arc<FileAxes>>,
    /// Letters of the tilts about X and Y and of the heading in G-code of a head that tilts about its tip.
    pub head_letters: Option<[u8; 3]>,
    /// Layers of a DXF drawing that are read; without any, all that are seen.
    pub dxf_layers: Vec<String>,
    /// Contours of a drawing are the middles of beads, and not filled.
    pub centre_lines: bool,
}

/// A target and notes on how it was read.
#[derive(Clone, Debug, PartialEq)]
pub struct Loaded {
    /// The outline.
    pub target: Target,
    /// One line each: reversed rings, ignored contents, repairs.
    pub notes: Vec<String>,
    /// Contours of a format that has lines and does not say what is filled.
    pub may_be_lines: bool,
}

impl Default for ReadOptions {
    fn default() -> ReadOptions {
        ReadOptions {
            units: None,
            scale: 1.0,
            flatten_mm: 0.001,
            repair: false,
            rotate_rad: [0.0; 3],
            filament_mm: None,
            gcode_axes: None,
            head_letters: None,
            dxf_layers: Vec::new(),
            centre_lines: false,
        }
    }
}

impl Units {
    /// Reads `mm`, `cm`, `m`, `um` or `in`.
    pub fn parse(text: &str) -> Option<Units> {
        match text {
            "mm" => Some(Units::Mm),
            "cm" => Some(Units::Cm),
            "m" => Some(Units::M),
            "um" => Some(Units::Um),
            "in" => Some(Units::In),
            _ => None,
        }
    }

    /// Millimetres in one of this unit.
    pub fn mm(self) -> f64 {
        match self {
            Units::Mm => 1.0,
            Units::Cm => 10.0,
            Units::M => 1000.0,
            Units::Um => 0.001,
            Units::In => 25.4,
        }
    }
}

impl Format {
    /// The format that the file's ending promises.
    pub fn of_ending(path: &Path) -> Option<Format> {
        let ending = path.extension()?.to_str()?.to_ascii_lowercase();
        Format::parse(&ending)
    }

    /// As messages call it.
    fn name(self) -> &'static str {
        match self {
            Format::Polygon => "polygon JSON",
            Format::GeoJson => "GeoJSON",
            Format::Svg => "SVG",
            Format::Dxf => "DXF",
            Format::Waypoints => "waypoint",
            Format::Nurbs => "NURBS JSON",
            Format::Mesh(_) => "mesh",
            Format::Gcode => "G-code",
        }
    }

    /// Largest file of this format that is read.
    pub fn bytes_max(self) -> u64 {
        match self {
            Format::Mesh(_) => MESH_BYTES_MAX,
            Format::Gcode => GCODE_BYTES_MAX,
            _ => BYTES_MAX,
        }
    }

    /// Reads `gcode`, `gco`, `g`, `nc`, `ngc`, `mpf`, `spf`, `stl`, `3mf`, `obj`,
    /// `json` or `polygon`, `geojson`, `svg`, `dxf`, `nurbs`, `waypoints` or its endings `wpt`, `txt`, `csv`.
    pub fn parse(text: &str) -> Option<Format> {
        match text {
            "json" | "polygon" => Some(Format::Polygon),
            "geojson" => Some(Format::GeoJson),
            "svg" => Some(Format::Svg),
            "dxf" => Some(Format::Dxf),
            "nurbs" => Some(Format::Nurbs),
            "waypoints" | "wpt" | "txt" | "csv" => Some(Format::Waypoints),
            "stl" => Some(Format::Mesh(MeshFormat::Stl)),
            "3mf" => Some(Format::Mesh(MeshFormat::ThreeMf)),
            "obj" => Some(Format::Mesh(MeshFormat::Obj)),
            "gcode" | "gco" | "g" | "nc" | "ngc" | "mpf" | "spf" => Some(Format::Gcode),
            _ => None,
        }
    }
}

/// Contents of an input.
#[derive(Clone, Debug, PartialEq)]
pub enum Input {
    /// Regions to be filled.
    Outline(Loaded),
    /// Middles of beads.
    Lines(CentreLines),
    /// A path to be followed.
    Path(WaypointRun),
    /// A solid, to be cut into layers.
    Mesh(LoadedMesh),
    /// A slicer's path, to be followed with a turned nozzle.
    Gcode(GcodeProgram),
}

impl Input {
    /// Its name.
    pub fn name(&self) -> &str {
        match self {
            Input::Outline(loaded) => &loaded.target.name,
            Input::Lines(lines) => &lines.name,
            Input::Path(run) => &run.name,
            Input::Mesh(loaded) => &loaded.name,
            Input::Gcode(program) => &program.name,
        }
    }

    /// Notes on how it was read, one line each.
    pub fn notes(&self) -> &[String] {
        match self {
            Input::Outline(loaded) => &loaded.notes,
            Input::Lines(lines) => &lines.notes,
            Input::Path(run) => &run.notes,
            Input::Mesh(loaded) => &loaded.notes,
            Input::Gcode(program) => &program.notes,
        }
    }
}

/// Reads an input of any format. `name` is used if the file has none.
pub fn read_any(
    bytes: &[u8],
    name: &str,
    format: Format,
    options: &ReadOptions,
) -> Result<Input, Refusal> {
    if options.centre_lines {
        let drawing = drawing(bytes, format, options)?;
        return centre_lines::of_drawing(drawing, name, options).map(Input::Lines);
    }
    if let Format::Mesh(format) = format {
        check_scale(options)?;
        let options = MeshOptions {
            unit_mm: options.units.map(Units::mm),
            scale: options.scale,
            rotate_rad: options.rotate_rad,
        };
        return Ok(Input::Mesh(mesh::read(bytes, name, format, &options)?));
    }
    if format == Format::Gcode {
        check_scale(options)?;
        let text = text_of(bytes, format)?;
        let options = GcodeOptions {
            scale: options.scale,
            filament_mm: options.filament_mm,
            axes: options.gcode_axes.clone(),
            head_letters: options.head_letters,
        };
        let name = names::name_of(None, name, "gcode");
        let program = gcode::read(&text, &name, &options)?;
        return Ok(match program.is_declared {
            _ if program.is_export() || !program.has_tilts => Input::Gcode(program),
            true => Input::Path(declared_run::declared_run(program)),
            false => Input::Path(gcode_run::waypoint_run(program)),
        });
    }
    if format == Format::Waypoints {
        check_scale(options)?;
        let text = text_of(bytes, format)?;
        return Ok(Input::Path(waypoints::read(&text, name, options).map_err(
            |error| refusal!("not a readable waypoint file: {error}"),
        )?));
    }
    let is_json = matches!(format, Format::Nurbs | Format::Polygon);
    if is_json && (format == Format::Nurbs || nurbs::is_nurbs(&plain(bytes))) {
        check_scale(options)?;
        let text = text_of(bytes, format)?;
        return Ok(Input::Path(nurbs::read(&text, name, options)?));
    }
    read(bytes, name, format, options).map(Input::Outline)
}

/// The text, however an editor has saved it. Fails if the first bytes are not text.
fn text_of(bytes: &[u8], format: Format) -> Result<Cow<'_, [u8]>, Refusal> {
    let known = |mark: &[u8]| bytes.starts_with(mark);
    let problem = if known(&[0x1f, 0x8b]) || known(b"PK\x03\x04") {
        "it is compressed; unpack it first"
    } else if bytes.iter().all(u8::is_ascii_whitespace) {
        "it is empty"
    } else {
        return Ok(plain(bytes));
    };
    Err(error::syntax(format.name(), problem))
}

fn check_scale(options: &ReadOptions) -> Result<(), Refusal> {
    let scale = options.scale;
    if scale.is_finite() && scale > 0.0 {
        Ok(())
    } else {
        Err(error::scale(scale))
    }
}

/// Reads an outline. `name` is used if the file has none.
pub fn read(
    bytes: &[u8],
    name: &str,
    format: Format,
    options: &ReadOptions,
) -> Result<Loaded, Refusal> {
    let loaded = outline::to_target(drawing(bytes, format, options)?, name, options)?;
    Ok(Loaded {
        may_be_lines: format == Format::Dxf,
        ..loaded
    })
}

/// What is drawn.
fn drawing(
    bytes: &[u8],
    format: Format,
    options: &ReadOptions,
) -> Result<outline::Drawing, Refusal> {
    check_scale(options)?;
    let bytes = &*text_of(bytes, format)?;
    match format {
        Format::Polygon => polygon::read(bytes, options),
        Format::GeoJson => geojson::read(bytes, options),
        Format::Svg => svg::read(bytes, options),
        Format::Dxf => dxf::read(bytes, options),
        _ if options.centre_lines => Err(refusal!(
            "--centre-lines goes with drawings (SVG, DXF, GeoJSON, polygon JSON): only they \
             have lines"
        )),
        Format::Waypoints | Format::Nurbs | Format::Gcode => Err(error::path_not_outline()),
        Format::Mesh(_) => Err(error::mesh_not_outline()),
    }
}

/// Polygons as they are, mm: each an exterior and its holes.
pub fn read_rings(
    polygons: &[Vec<Vec<[f64; 2]>>],
    name: &str,
    options: &ReadOptions,
) -> Result<Loaded, Refusal> {
    check_scale(options)?;
    outline::to_target(outline::of_polygons(polygons), name, options)
}

#[cfg(test)]
mod meant_tests;
#[cfg(test)]
mod tests;
