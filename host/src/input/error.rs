//! Why an input cannot be planned: reason, place (mm, in the input's coordinates), remedy.

use super::POINTS_MAX;
use super::waypoints::WaypointError;
use crate::gcode::GcodeError;
use crate::geometry::Point2;
use crate::geometry::validity::ValidityError;
use crate::text::refusal::Refusal;
use crate::text::short_number::Short;

/// A place for messages: `(12.345, -3.000) mm`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct At(pub Point2);

impl std::fmt::Display for At {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let beyond = |x: f64| x.abs() >= 1e12;
        match [self.0.x, self.0.y] {
            [x, y] if beyond(x) || beyond(y) => write!(f, "({}, {}) mm", Short(x), Short(y)),
            [x, y] => write!(f, "({x:.4}, {y:.4}) mm"),
        }
    }
}

/// Refusals of the input stage.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum InputError {
    /// The file is larger than anything sensible.
    #[error(
        "the file has {bytes} bytes, more than {bytes_max}: reduce the number of points, or split it"
    )]
    FileTooLarge {
        /// Its size.
        bytes: u64,
        /// The most that is read of its format.
        bytes_max: u64,
    },
    /// The file extension is unknown.
    #[error(
        "cannot tell the format of '{path}': use the ending .json, .geojson, .svg, .dxf, .wpt, .stl, \
         .3mf, .obj or .gcode, or --from polygon|geojson|svg|dxf|waypoints|stl|3mf|obj|gcode"
    )]
    UnknownFormat {
        /// The file.
        path: String,
    },
    /// A CAD program's own format.
    #[error(
        "'{path}' is a CAD model: export it as a mesh (.3mf or .stl, with a deviation of 0.01 mm or less) and plan that"
    )]
    CadFormat {
        /// The file.
        path: String,
    },
    /// Another file of this program, or a folder.
    #[error("'{path}' is {what}")]
    NoInput {
        /// The file.
        path: String,
        /// What it is, and what to do with it.
        what: &'static str,
    },
    /// The text does not follow the format.
    #[error("not a readable {format} file: {problem}")]
    Syntax {
        /// Format by name.
        format: &'static str,
        /// The parser's message, with line and column if it has them.
        problem: String,
    },
    /// A key that is similar to a known one.
    #[error(
        "the key '{key}' is not known: is '{near}' meant? (keys that are like no known one are the \
         writer's own)"
    )]
    Misspelt {
        /// What the file has.
        key: String,
        /// The known key that is similar.
        near: &'static str,
    },
    /// Points under a key that is not read.
    #[error(
        "the key '{key}' holds points and is not known: the outline is 'exterior', what is cut out \
         of it 'holes', a list of outlines; rename it, or take it out"
    )]
    UnknownPoints {
        /// What the file has.
        key: String,
    },
    /// A path where an outline is required.
    #[error("a waypoint file is a path and has no outline; give a polygon, GeoJSON or SVG file")]
    PathNotOutline,
    /// A solid where an outline is required.
    #[error("a mesh is a solid and has no outline; give a polygon, GeoJSON or SVG file")]
    MeshNotOutline,
    /// Not a closed mesh.
    #[error(transparent)]
    Mesh(#[from] Refusal),
    /// The G-code.
    #[error(transparent)]
    Gcode(#[from] GcodeError),
    /// Rotation of a flat input.
    #[error("--rotate turns meshes: an outline is in the layer's plane; rotate it in the drawing")]
    NotTurned,
    /// Not a run of waypoints.
    #[error("not a readable waypoint file: {0}")]
    Waypoints(#[from] WaypointError),
    /// An unknown length unit.
    #[error(
        "units '{given}' are not known: use mm, cm, m, um or in (--units says it over the file)"
    )]
    UnknownUnits {
        /// The file's value.
        given: String,
    },
    /// No length unit at all.
    #[error("the file says no units: add \"units\": \"mm\" (or cm, m, um, in) or give --units")]
    NoUnits,
    /// The scale is not a positive number.
    #[error("--scale {}: must be a finite number greater than 0", Short(*scale))]
    Scale {
        /// What was given.
        scale: f64,
    },
    /// A point that is not two finite numbers.
    #[error("{ring}: point {point} is {problem}; a point is [x, y] with two finite numbers")]
    BadPoint {
        /// Which ring.
        ring: String,
        /// Index from 0.
        point: usize,
        /// The problem.
        problem: String,
    },
    /// A contour that does not close.
    #[error(
        "{ring} is open: it starts at {start} and ends {gap_mm:.4} mm away at {end}; close it in the drawing, let \
         --repair join the ends, or print lines as beads with --centre-lines"
    )]
    Open {
        /// Which ring.
        ring: String,
        /// Its first point.
        start: At,
        /// Its last point.
        end: At,
        /// Distance of the two.
        gap_mm: f64,
    },
    /// Not enough distinct points for an area.
    #[error(
        "{ring} near {at} has {distinct} distinct points; an outline needs 3 or more: remove it"
    )]
    TooFewPoints {
        /// Which ring.
        ring: String,
        /// Its first point.
        at: At,
        /// How many.
        distinct: usize,
    },
    /// A ring whose points are on one line.
    #[error("{ring} near {at} encloses no area (its points are on a line): remove it")]
    NoArea {
        /// Which ring.
        ring: String,
        /// Its first point.
        at: At,
    },
    /// Nothing to print.
    #[error("there is no outline in it: {hint}")]
    Empty {
        /// The probable cause.
        hint: &'static str,
    },
    /// More points than can be planned.
    #[error(
        "{points} points, more than {POINTS_MAX}: simplify the drawing (or raise --tolerance for \
         curves)"
    )]
    TooManyPoints {
        /// How many.
        points: usize,
    },
    /// A scribble.
    #[error(
        "the contours cross themselves and each other about {crossings:.0} times: this is no outline, \
         and too much to mend; draw what is to be filled, or fewer points"
    )]
    TooTangled {
        /// About how often.
        crossings: f64,
    },
    /// Larger than any machine.
    #[error(
        "the outline is {width_mm:.6} x {height_mm:.6} mm, larger than {max_mm} mm: check its units \
         (--units) or give --scale"
    )]
    TooBig {
        /// Width.
        width_mm: f64,
        /// Height.
        height_mm: f64,
        /// The largest accepted value.
        max_mm: f64,
    },
    /// Smaller than anything printable.
    #[error(
        "the outline is {width_mm:.9} x {height_mm:.9} mm, smaller than {min_mm} mm: check its \
         units (--units) or give --scale"
    )]
    TooSmall {
        /// Width.
        width_mm: f64,
        /// Height.
        height_mm: f64,
        /// The smallest accepted value.
        min_mm: f64,
    },
    /// So far from the origin that digits are lost.
    #[error(
        "the outline lies around {at}, farther than {max_mm} mm from the origin: move it closer in \
         the drawing"
    )]
    TooFar {
        /// A point of it.
        at: At,
        /// The largest accepted distance.
        max_mm: f64,
    },
    /// A geometry that has no area.
    #[error(
        "{what} is a {kind}, which has no inside; only Polygon and MultiPolygon can be filled, and LineString and \
         MultiLineString printed as beads with --centre-lines"
    )]
    NoInside {
        /// Which feature.
        what: String,
        /// Its type.
        kind: &'static str,
    },
    /// Nothing but strokes.
    #[error(
        "{count} shapes have a stroke but no fill (the first: {first}): lines have no inside; print them as beads \
         with --centre-lines, give them a fill, or turn strokes into paths in the drawing program"
    )]
    OnlyStrokes {
        /// How many.
        count: usize,
        /// Which is the first.
        first: String,
    },
    /// No line where centre lines are read.
    #[error(
        "there is no line in it: {what} has an inside, or is a point; leave --centre-lines out to fill it, or give it a stroke"
    )]
    NoLines {
        /// Which is the first.
        what: String,
    },
    /// Lines of what is no drawing.
    #[error(
        "--centre-lines goes with drawings (SVG, DXF, GeoJSON, polygon JSON): only they have lines"
    )]
    NotDrawn,
    /// More than two curves end at a place.
    #[error(
        "more than two ends meet at {at}: a contour goes through each place once; take the extra lines \
         away, choose the outline's layers with --dxf-layer, or print lines as beads with --centre-lines"
    )]
    Branch {
        /// Where.
        at: At,
    },
    /// A layer that the drawing does not have.
    #[error("there is no layer '{given}'; the drawing has {there}")]
    UnknownLayer {
        /// The requested value.
        given: String,
        /// Those that there are.
        there: String,
    },
    /// Layers requested of an input that has none.
    #[error("--dxf-layer goes with DXF: no other format that is read has layers of a drawing")]
    NoLayers,
    /// Only contents that are not read.
    #[error("there is no filled shape in it: {left_out}")]
    NothingFilled {
        /// What there was, and what to do.
        left_out: String,
    },
    /// Not a valid outline in the sense of OGC simple features.
    #[error("{region}: {problem}")]
    Invalid {
        /// Which region.
        region: String,
        /// The fault, its place, and the remedy.
        problem: ValidityError,
    },
    /// A shape on one of another colour, as a page's background or a hole drawn in white.
    #[error(
        "{over} lies on {under} near {at}: delete the one that is no part (a background), or, where one is \
         meant as a hole, cut it out in the drawing program (Inkscape: Path, Difference)"
    )]
    TwoColours {
        /// The lower one, with its colour.
        under: String,
        /// The upper one, with its colour.
        over: String,
        /// A place where both are.
        at: At,
    },
    /// Two regions share some area.
    #[error(
        "{first} and {second} overlap near {at}; move them apart, let --repair merge them, or, where one is \
         meant as a hole, cut it out in the drawing program (Inkscape: Path, Difference)"
    )]
    Overlap {
        /// One region.
        first: String,
        /// The other.
        second: String,
        /// A place where they do.
        at: At,
    },
}
