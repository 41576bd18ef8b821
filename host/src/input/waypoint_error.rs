//! Why a file is not a run of waypoints, with the line and a remedy.

use super::waypoints::{
    BEAD_MAX_MM, CONE_MAX_DEG, HEADING_MAX_DEG, SPEED_RANGE_MM_S, WAYPOINTS_MAX,
};
use crate::text::short_number::{Short, told_apart};

/// Why a file is not a run, with the line.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum WaypointError {
    /// Not text.
    #[error("byte {at_byte} is not UTF-8 text: save the waypoints as plain text")]
    NotText {
        /// The first byte that is not.
        at_byte: usize,
    },
    /// A wrong number of columns.
    #[error(
        "line {line} has {columns} columns; write x y z nx ny nz, or x y z nx ny nz heading_deg; further ones \
         (width_mm, height_mm, speed_mm_s, cone_deg) are named in a head: x y z nx ny nz width_mm"
    )]
    Columns {
        /// Line from 1.
        line: usize,
        /// What was found.
        columns: usize,
    },
    /// Some lines have a heading and some have not.
    #[error(
        "line {line} has {columns} columns, the lines before it {before}: a column is given everywhere or nowhere"
    )]
    Mixed {
        /// Line from 1.
        line: usize,
        /// Its columns.
        columns: usize,
        /// Those of the first waypoint.
        before: usize,
    },
    /// An invalid cone.
    #[error(
        "line {line}: cone_deg is {given_deg}; write an angle from 0 to {CONE_MAX_DEG} degrees"
    )]
    Cone {
        /// Line from 1.
        line: usize,
        /// What was given.
        given_deg: f64,
    },
    /// Not a finite number.
    #[error("line {line}, column {column}: `{text}` is not a finite number")]
    Number {
        /// Line from 1.
        line: usize,
        /// Column from 1.
        column: usize,
        /// The text there, truncated.
        text: String,
    },
    /// Not a direction.
    #[error("line {line}: the tool axis has length {length:.6}; a direction has length 1")]
    Axis {
        /// Line from 1.
        line: usize,
        /// Its length.
        length: f64,
    },
    /// Tilted beyond the range of a pose.
    #[error(
        "line {line}: the tool axis is tilted by {}°, more than {max_deg:.0}°: turn the part over",
        told_apart(*tilt_deg, &[*max_deg], 1)
    )]
    Tilt {
        /// Line from 1.
        line: usize,
        /// Angle from Z.
        tilt_deg: f64,
        /// The largest accepted value.
        max_deg: f64,
    },
    /// Farther than digits go.
    #[error(
        "line {line} is {} mm from the origin or the first waypoint, more than {max_mm:.0} mm: check its units",
        Short(distance_mm.round())
    )]
    TooFar {
        /// Line from 1.
        line: usize,
        /// How far.
        distance_mm: f64,
        /// The largest accepted value.
        max_mm: f64,
    },
    /// A heading beyond all turns.
    #[error("line {line}: a heading of {}° is beyond {HEADING_MAX_DEG}°", Short(*heading_deg))]
    Heading {
        /// Line from 1.
        line: usize,
        /// What was given.
        heading_deg: f64,
    },
    /// The table's head names another order.
    #[error(
        "line {line}: column {column} is called `{text}`; the columns are x y z nx ny nz in this order, then \
         any of heading_deg, width_mm, height_mm, speed_mm_s, each once"
    )]
    Head {
        /// Line from 1.
        line: usize,
        /// Column from 1.
        column: usize,
        /// Its name.
        text: String,
    },
    /// No bead.
    #[error("line {line}: a bead of {} mm; write a width or height above 0, up to {BEAD_MAX_MM} mm", Short(*given_mm))]
    Bead {
        /// Line from 1.
        line: usize,
        /// What was given.
        given_mm: f64,
    },
    /// A speed that no head prints at.
    #[error(
        "line {line}: a speed of {} mm/s; write one of {} to {} mm/s",
        Short(*given_mm_s),
        SPEED_RANGE_MM_S[0],
        SPEED_RANGE_MM_S[1]
    )]
    Speed {
        /// Line from 1.
        line: usize,
        /// What was given.
        given_mm_s: f64,
    },
    /// A unit that would not be heeded.
    #[error(
        "line {line}: '{given}' is not read as units: write `# units: mm` (or cm, m, um, in) before \
         the first waypoint"
    )]
    UnitsNotRead {
        /// Line from 1.
        line: usize,
        /// What the file says.
        given: String,
    },
    /// An unknown length unit.
    #[error("line {line}: units '{given}' are not known: use mm, cm, m, um or in")]
    UnknownUnits {
        /// Line from 1.
        line: usize,
        /// What the file says.
        given: String,
    },
    /// More than can be planned.
    #[error("line {line} is waypoint {WAYPOINTS_MAX} and there are more: split the run")]
    TooMany {
        /// Line from 1.
        line: usize,
    },
    /// Nothing to run along.
    #[error("{found} different waypoints; a run needs 2 or more")]
    TooFew {
        /// How many.
        found: usize,
    },
}
