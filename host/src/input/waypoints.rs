//! Waypoint files: one run of the tip, `x y z nx ny nz [heading_deg]` on each line ->
//! [`WaypointRun`].
//!
//! A header line may name further columns after the first six, in any order: `heading_deg`, `width_mm` and
//! `height_mm` of the bead, `speed_mm_s` of the tip, `cone_deg` by which the tool axis may tilt (`--tilt-max`).
//! Without a header a seventh column is the heading.
//!
//! Numbers are separated by blanks, tabs, commas or semicolons; text after `#` is ignored, and so is one line of
//! column names before the first waypoint. `# units: cm` (or mm, m, um, in), before the first waypoint, and
//! `# name: ...` are read; without a unit the file is in mm. The tool axis points from the tip into the head and is
//! normalised; one whose length is clearly not 1 is refused. Headings are degrees about it and change to the next
//! one in the shorter direction.
//!
//! Output: mm, input coordinates, headings unwrapped, rad. Not covered: the curve, which the
//! planner makes (`plan::waypoint_curve`).

use super::names::{name_of, part_name};
use super::near_waypoints::{self, usual_gap_mm};
use super::outline::{FAR_MAX_MM, SIZE_MAX_MM};
use super::waypoint_columns::{COLUMNS, FURTHER, further_columns, shortened};
use super::{ReadOptions, Units};
use crate::gcode::error::too_tilted;
use crate::settings::PrimeRetract;
use crate::text::near_name::near_name;
use crate::text::refusal::{Refusal, refusal};
use crate::text::short_number::Short;
use headway_firmware::kinematics::pose::{TILT_MAX_RAD, TILT_ROUNDING_RAD};
use nalgebra::{Point3, Rotation3, Unit, Vector3};
use std::f64::consts::TAU;

/// Most waypoints of a run: a kilometre at 5 mm, or 20 m at 0.1 mm.
pub const WAYPOINTS_MAX: usize = 200_000;
/// Largest heading, degrees: a thousand turns. A larger value is an error, and would lose digits.
pub(super) const HEADING_MAX_DEG: f64 = 360_000.0;
/// Widest and highest bead, mm.
pub(super) const BEAD_MAX_MM: f64 = 100.0;
/// Slowest and fastest requested speed, mm/s.
pub(super) const SPEED_RANGE_MM_S: [f64; 2] = [0.1, 10_000.0];
/// Widest cone of a waypoint's axis, degrees.
pub(super) const CONE_MAX_DEG: f64 = 90.0;
/// How far an axis may be from unit length and still be meant as one: what four digits leave.
const AXIS_LENGTH_SLACK: f64 = 1e-3;
/// Largest difference of the axes before and after an invalid one for their mean to replace it: less
/// than a corner of the path.
const AGREEING_RAD: f64 = 20.0 * std::f64::consts::PI / 180.0;
/// Waypoints closer than this are at the same position, mm: below the resolution of a step.
pub const SAME_PLACE_MM: f64 = 1e-6;

/// One waypoint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Waypoint {
    /// Its line in the file, from 1.
    pub line: usize,
    /// Tip, mm.
    pub tip_mm: Point3<f64>,
    /// Tool axis, from the tip into the head.
    pub axis: Unit<Vector3<f64>>,
    /// Heading about the tool axis, unwrapped, rad; `None` turns the major axis across the travel.
    pub heading_rad: Option<f64>,
    /// Width of the bead, mm; `None` is the nozzle's own.
    pub width_mm: Option<f64>,
    /// Height of the bead, mm; `None` for the layer height.
    pub height_mm: Option<f64>,
    /// Section of the bead, mm², overrides width and height: the volume per mm of the tip's path.
    pub section_mm2: Option<f64>,
    /// Speed of the tip, mm/s, changing evenly from one to the next; `None` for the print speed.
    pub speed_mm_s: Option<f64>,
    /// Largest tilt of the tool axis from its own, rad, if that is less than `--tilt-max`.
    pub cone_rad: Option<f64>,
    /// A pass begins here, whatever the distance from the previous waypoint.
    pub begins: bool,
    /// Requests of the pass that begins here.
    pub asked: PassAsked,
}

/// Requests of a pass that override the settings; not from a file.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PassAsked {
    /// Its prime and its retract; `None` for those of the settings.
    pub prime_retract: Option<PrimeRetract>,
    /// Its prime and retract, mm³, at the rates of the settings; overrides `prime_retract`.
    pub pushes_mm3: [Option<f64>; 2],
    /// Its waypoints have sections: they give the deposited volume, whatever the nozzle's own
    /// section.
    pub has_sections: bool,
    /// Its headings are used unchanged: not shifted by half turns that give the same bead.
    pub keeps_heading: bool,
}

/// A run of waypoints, two or more, no two in a row the same.
#[derive(Clone, Debug, PartialEq)]
pub struct WaypointRun {
    /// Name for headers and pictures.
    pub name: String,
    /// The waypoints in order.
    pub points: Vec<Waypoint>,
    /// One line each: repeated waypoints, axes made unit vectors.
    pub notes: Vec<String>,
    /// Speeds are feeds of a file: limited by the print speed if that is given, and otherwise its source.
    pub has_feeds: bool,
}

impl WaypointRun {
    /// This run and then another one, as passes of their own. Jumps within each end its passes by its own usual
    /// spacing, unless the jump that does is given.
    #[must_use]
    pub fn then(mut self, mut next: WaypointRun, gap_mm: Option<f64>) -> WaypointRun {
        if gap_mm.is_none() {
            self.divide();
            next.divide();
        }
        if let Some(first) = next.points.first_mut() {
            first.begins = true;
        }
        self.points.extend(next.points);
        self.notes.extend(next.notes);
        self.has_feeds |= next.has_feeds;
        self
    }

    /// Ends passes at jumps, if the file does not define their ends.
    fn divide(&mut self) {
        if self.points.iter().any(|point| point.begins) {
            return;
        }
        let gap_mm = usual_gap_mm(&self.points);
        for index in 1..self.points.len() {
            let chord = self.points[index].tip_mm - self.points[index - 1].tip_mm;
            self.points[index].begins = chord.norm() > gap_mm;
        }
    }

    /// The run rotated about Z through the origin.
    #[must_use]
    pub fn turned(mut self, turn_rad: f64) -> WaypointRun {
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), turn_rad);
        for point in &mut self.points {
            point.tip_mm = turn * point.tip_mm;
            point.axis = turn * point.axis;
            point.heading_rad = point.heading_rad.map(|heading| heading + turn_rad);
        }
        self
    }
}

/// What the lines before are remembered for.
struct Reader {
    unit_mm: f64,
    units_said: bool,
    scale: f64,
    columns: Option<usize>,
    /// The columns after the first six, of [`FURTHER`].
    further: Vec<usize>,
    name: Option<String>,
    points: Vec<Waypoint>,
    repeated: usize,
    stretched: usize,
    /// The last waypoint's axis is invalid: its line, and the length that was given.
    doubtful: Option<(usize, f64)>,
    replaced: Vec<usize>,
}

/// Reads a run. `name` is used if the file has none.
///
/// # Errors
/// The first [`Refusal`].
pub fn read(bytes: &[u8], name: &str, options: &ReadOptions) -> Result<WaypointRun, Refusal> {
    let text = std::str::from_utf8(bytes).map_err(|error| {
        refusal!(
            "byte {at_byte} is not UTF-8 text: save the waypoints as plain text",
            at_byte = error.valid_up_to()
        )
    })?;
    let mut reader = Reader {
        unit_mm: options.units.unwrap_or(Units::Mm).mm(),
        units_said: options.units.is_some(),
        scale: options.scale,
        columns: None,
        further: vec![0],
        name: None,
        points: Vec::new(),
        repeated: 0,
        stretched: 0,
        doubtful: None,
        replaced: Vec::new(),
    };
    for (index, line) in text.trim_start_matches('\u{feff}').lines().enumerate() {
        let (data, comment) = line.split_once('#').unwrap_or((line, ""));
        reader.comment(index + 1, comment)?;
        reader.data(index + 1, data)?;
    }
    if let Some((line, length)) = reader.doubtful {
        return Err(no_direction(line, length));
    }
    let found = reader.points.len();
    if found < 2 {
        return Err(refusal!(
            "{found} different waypoints; a run needs 2 or more"
        ));
    }
    let mut notes = reader.notes();
    let (points, joined, near_mm) = near_waypoints::joined(reader.points);
    if joined > 0 {
        notes.push(format!(
            "{joined} waypoints lie closer than {near_mm:.3} mm to the one before and were made one \
             with it"
        ));
    }
    Ok(WaypointRun {
        name: name_of(reader.name.as_deref(), name, "run"),
        points,
        notes,
        has_feeds: false,
    })
}

impl Reader {
    /// `units: cm`, `name: vase`; anything else is for people.
    fn comment(&mut self, line: usize, comment: &str) -> Result<(), Refusal> {
        let Some((key, value)) = comment.split_once([':', '=']) else {
            return Ok(());
        };
        let (key, value) = (key.trim(), value.trim());
        let is_units = key == "units";
        let is_heeded = is_units && self.points.is_empty() && comment.contains(':');
        if (is_units && !is_heeded) || near_name(key, &["units"]).is_some() {
            let given = shortened(comment.trim());
            return Err(refusal!(
                "line {line}: '{given}' is not read as units: write `# units: mm` (or cm, m, \
                 um, in) before the first waypoint"
            ));
        }
        match key {
            "units" if !self.units_said => {
                let units = Units::parse(value).ok_or_else(|| {
                    refusal!(
                        "line {line}: units '{given}' are not known: use mm, cm, m, um or in",
                        given = shortened(value)
                    )
                })?;
                self.unit_mm = units.mm();
            }
            "name" => self.name = part_name(value),
            _ => {}
        }
        Ok(())
    }

    fn data(&mut self, line: usize, data: &str) -> Result<(), Refusal> {
        let cells: Vec<&str> = data
            .split(|c: char| c.is_whitespace() || c == ',' || c == ';')
            .filter(|cell| !cell.is_empty())
            .take(COLUMNS.len() + FURTHER.len() + 2)
            .collect();
        if cells.is_empty() {
            return Ok(());
        }
        if self.is_head(&cells) {
            self.further = further_columns(line, &cells)?;
            return Ok(());
        }
        self.check_columns(line, cells.len())?;
        let mut numbers = [0.0; COLUMNS.len() + FURTHER.len()];
        for (column, (cell, number)) in cells.iter().zip(&mut numbers).enumerate() {
            *number = finite(cell).ok_or_else(|| {
                refusal!(
                    "line {line}, column {column}: `{text}` is not a finite number",
                    column = column + 1,
                    text = shortened(cell)
                )
            })?;
        }
        let (pose, behind) = numbers.split_at(COLUMNS.len());
        let mut further = [None; FURTHER.len()];
        let given = cells.len() - COLUMNS.len();
        for (&which, &number) in self.further.iter().zip(&behind[..given]) {
            further[which] = Some(number);
        }
        self.push(line, pose, further)
    }

    /// One line of column names, before any number: the table's head.
    fn is_head(&mut self, cells: &[&str]) -> bool {
        let is_head = self.columns.is_none()
            && self.points.is_empty()
            && cells
                .iter()
                .all(|cell| cell.starts_with(|c: char| c.is_ascii_alphabetic()))
            && cells.iter().all(|cell| cell.parse::<f64>().is_err());
        if is_head {
            self.columns = Some(cells.len());
        }
        is_head
    }

    fn check_columns(&mut self, line: usize, columns: usize) -> Result<(), Refusal> {
        let most = COLUMNS.len() + self.further.len();
        if !(COLUMNS.len()..=most).contains(&columns) {
            return Err(refusal!(
                "line {line} has {columns} columns; write x y z nx ny nz, or x y z nx ny nz \
                 heading_deg; further ones (width_mm, height_mm, speed_mm_s, cone_deg) are named \
                 in a head: x y z nx ny nz width_mm"
            ));
        }
        match self.columns.replace(columns) {
            Some(before) if before != columns => Err(refusal!(
                "line {line} has {columns} columns, the lines before it {before}: a column is \
                 given everywhere or nowhere"
            )),
            _ => Ok(()),
        }
    }

    fn push(
        &mut self,
        line: usize,
        pose: &[f64],
        [heading_deg, width_mm, height_mm, speed_mm_s, cone_deg]: [Option<f64>; FURTHER.len()],
    ) -> Result<(), Refusal> {
        if self.points.len() == WAYPOINTS_MAX {
            return Err(refusal!(
                "line {line} is waypoint {WAYPOINTS_MAX} and there are more: split the run"
            ));
        }
        let tip_mm = Point3::new(pose[0], pose[1], pose[2]) * (self.unit_mm * self.scale);
        self.check_distance(line, &tip_mm)?;
        let axis = self.axis(line, Vector3::new(pose[3], pose[4], pose[5]))?;
        for given_mm in [width_mm, height_mm].into_iter().flatten() {
            if !(given_mm > 0.0 && given_mm <= BEAD_MAX_MM) {
                return Err(refusal!(
                    "line {line}: a bead of {} mm; write a width or height above 0, up to \
                     {BEAD_MAX_MM} mm",
                    Short(given_mm)
                ));
            }
        }
        let [slowest, fastest] = SPEED_RANGE_MM_S;
        if let Some(given_mm_s) = speed_mm_s.filter(|speed| !(slowest..=fastest).contains(speed)) {
            return Err(refusal!(
                "line {line}: a speed of {} mm/s; write one of {} to {} mm/s",
                Short(given_mm_s),
                SPEED_RANGE_MM_S[0],
                SPEED_RANGE_MM_S[1]
            ));
        }
        if let Some(heading_deg) = heading_deg.filter(|deg| deg.abs() > HEADING_MAX_DEG) {
            return Err(refusal!(
                "line {line}: a heading of {}° is beyond {HEADING_MAX_DEG}°",
                Short(heading_deg)
            ));
        }
        if let Some(given_deg) = cone_deg.filter(|deg| !(0.0..=CONE_MAX_DEG).contains(deg)) {
            return Err(refusal!(
                "line {line}: cone_deg is {given_deg}; write an angle from 0 to {CONE_MAX_DEG} \
                 degrees"
            ));
        }
        let before = self.points.last();
        let heading_rad = heading_deg.map(|degrees| {
            let angle = degrees.to_radians();
            let near = before
                .and_then(|before| before.heading_rad)
                .unwrap_or(angle);
            angle + TAU * ((near - angle) / TAU).round()
        });
        let waypoint = Waypoint {
            line,
            tip_mm,
            axis,
            heading_rad,
            width_mm,
            height_mm,
            section_mm2: None,
            speed_mm_s,
            cone_rad: cone_deg.map(f64::to_radians),
            begins: false,
            asked: PassAsked::default(),
        };
        if before.is_some_and(|before| is_same(before, &waypoint)) {
            self.repeated += 1;
        } else {
            self.points.push(waypoint);
        }
        Ok(())
    }

    fn check_distance(&self, line: usize, tip_mm: &Point3<f64>) -> Result<(), Refusal> {
        let first = self.points.first().map_or(*tip_mm, |first| first.tip_mm);
        let bounds = [
            (tip_mm.coords.norm(), FAR_MAX_MM),
            ((tip_mm - first).norm(), SIZE_MAX_MM),
        ];
        for (distance_mm, max_mm) in bounds {
            // What overflowed is in no range.
            if !(0.0..=max_mm).contains(&distance_mm) {
                return Err(refusal!(
                    "line {line} is {} mm from the origin or the first waypoint, more than \
                     {max_mm:.0} mm: check its units",
                    Short(distance_mm.round())
                ));
            }
        }
        Ok(())
    }

    fn axis(&mut self, line: usize, axis: Vector3<f64>) -> Result<Unit<Vector3<f64>>, Refusal> {
        let length = axis.norm();
        if !(0.5..=1.5).contains(&length) {
            return self.stand_in(line, length);
        }
        self.stretched += usize::from((length - 1.0).abs() > AXIS_LENGTH_SLACK);
        let axis = Unit::new_normalize(axis);
        let tilt_rad = axis.x.hypot(axis.y).atan2(axis.z);
        if tilt_rad > TILT_MAX_RAD + TILT_ROUNDING_RAD {
            return Err(too_tilted(line, tilt_rad));
        }
        self.settle_doubt(&axis)?;
        Ok(axis)
    }

    /// The previous waypoint's axis instead of an invalid one, until the next one is known.
    fn stand_in(&mut self, line: usize, length: f64) -> Result<Unit<Vector3<f64>>, Refusal> {
        let refused = no_direction(line, length);
        let before = self.points.last().ok_or_else(|| refused.clone())?;
        if self.doubtful.is_some() {
            return Err(refused);
        }
        self.doubtful = Some((line, length));
        Ok(before.axis)
    }

    /// If the axes on both sides of an invalid one agree, their mean replaces it.
    fn settle_doubt(&mut self, next: &Unit<Vector3<f64>>) -> Result<(), Refusal> {
        let Some((line, length)) = self.doubtful.take() else {
            return Ok(());
        };
        if let Some(last) = self.points.last_mut()
            && last.axis.angle(next) < AGREEING_RAD
        {
            last.axis = Unit::new_normalize(last.axis.into_inner() + next.into_inner());
            self.replaced.push(line);
            return Ok(());
        }
        Err(no_direction(line, length))
    }

    fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        if self.repeated > 0 {
            notes.push(format!("{} repeated waypoints ignored", self.repeated));
        }
        if self.stretched > 0 {
            notes.push(format!(
                "{} tool axes were not of length 1 and were made so",
                self.stretched
            ));
        }
        for line in &self.replaced {
            notes.push(format!(
                "line {line}: the tool axis is not a direction; the mean of its neighbours is used"
            ));
        }
        notes
    }
}

fn is_same(a: &Waypoint, b: &Waypoint) -> bool {
    // Below the resolution of the wire: 1 µrad.
    const SAME_RAD: f64 = 1e-6;
    (a.tip_mm - b.tip_mm).norm() < SAME_PLACE_MM
        && (a.axis.into_inner() - b.axis.into_inner()).norm() < SAME_RAD
        && match (a.heading_rad, b.heading_rad) {
            (Some(a), Some(b)) => (a - b).abs() < SAME_RAD,
            _ => true,
        }
        && (a.width_mm, a.height_mm, a.speed_mm_s, a.cone_rad)
            == (b.width_mm, b.height_mm, b.speed_mm_s, b.cone_rad)
}

fn finite(cell: &str) -> Option<f64> {
    cell.parse().ok().filter(|number: &f64| number.is_finite())
}

fn no_direction(line: usize, length: f64) -> Refusal {
    refusal!("line {line}: the tool axis has length {length:.6}; a direction has length 1")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Goal: further columns are read by their names, in any order, and what cannot be meant is refused.
    #[test]
    fn further_columns_go_by_their_names() {
        let run = |text: &str| read(text.as_bytes(), "run", &ReadOptions::default());
        let table = |head: &str, rest: &str| {
            run(&format!(
                "x y z nx ny nz {head}\n0 0 1 0 0 1 {rest}\n5 0 1 0 0 1 {rest}\n"
            ))
        };
        let points = table("height_mm Width_mm", "0.3 0.8").unwrap().points;
        assert_eq!(points[1].width_mm, Some(0.8));
        assert_eq!(points[1].height_mm, Some(0.3));
        assert_eq!(points[1].heading_rad, None);
        let points = table("heading_deg width_mm", "90 0.8").unwrap().points;
        assert!((points[0].heading_rad.unwrap() - TAU / 4.0).abs() < 1e-12);
        assert_eq!(points[0].height_mm, None);
        // A seventh column without a known name is the heading, as without a head.
        assert!(table("psi", "90").unwrap().points[0].heading_rad.is_some());
        for (head, rest) in [
            ("width_mm width_mm", "1 1"),
            ("width_mm breadth", "1 1"),
            ("width_mm x", "1 1"),
        ] {
            let error = table(head, rest).unwrap_err();
            let text = error.to_string();
            assert!(text.starts_with("line 1: column 8 is called `"), "{text}");
        }
        for width in ["0", "-1", "1e3"] {
            let error = table("width_mm", width).unwrap_err();
            let text = error.to_string();
            assert!(text.starts_with("line 2: a bead of "), "{text}");
        }
        let points = table("speed_mm_s", "35").unwrap().points;
        assert_eq!(points[1].speed_mm_s, Some(35.0));
        assert_eq!(points[1].heading_rad, None);
        for speed in ["0", "-5", "1e5"] {
            let error = table("speed_mm_s", speed).unwrap_err();
            let text = error.to_string();
            assert!(text.starts_with("line 2: a speed of "), "{text}");
        }
        let error = run("0 0 1 0 0 1 90 0.8\n").unwrap_err();
        assert!(error.to_string().contains("named in a head"), "{error}");
    }

    fn run(text: &str) -> Result<WaypointRun, Refusal> {
        read(text.as_bytes(), "run", &ReadOptions::default())
    }

    /// Found in published runs: one axis in thousands is far too short, all others are right.
    #[test]
    fn a_single_axis_that_is_none_is_laid_between_its_neighbours() {
        let text = "0 0 0 0 0 1\n1 0 0 0.02 0 0.01\n2 0 0 0.1 0 0.995\n";
        let run = read(text.as_bytes(), "run", &ReadOptions::default()).unwrap();
        let axis = run.points[1].axis;
        assert!((axis.x - 0.05).abs() < 1e-3 && axis.z > 0.99, "{axis:?}");
        assert!(run.notes[0].starts_with("line 2: "), "{:?}", run.notes);
        for text in [
            "0 0 0 0 0 1\n1 0 0 0.02 0 0.01\n2 0 0 0.9 0 0.436\n",
            "0 0 0 0 0 1\n1 0 0 0 0 0\n2 0 0 0 0 0\n3 0 0 0 0 1\n",
            "0 0 0 0 0 0\n1 0 0 0 0 1\n2 0 0 0 0 1\n",
        ] {
            let refused = read(text.as_bytes(), "run", &ReadOptions::default())
                .unwrap_err()
                .to_string();
            assert!(
                refused.contains("the tool axis has length"),
                "{text}: {refused}"
            );
        }
    }

    #[test]
    fn the_usual_tables_are_read() {
        for text in [
            "0 0 1 0 0 1\n10 0 1 0 0 1\n",
            "x,y,z,nx,ny,nz\n0,0,1,0,0,1\n10,0,1,0,0,1",
            "\u{feff}# made by hand\n# units: cm\n0;0;.1;0;0;1 # first\n\n1\t0 0.1 0 0 1\r\n",
        ] {
            let run = run(text).unwrap();
            assert_eq!(run.points.len(), 2, "{text}");
            assert!((run.points[1].tip_mm - Point3::new(10.0, 0.0, 1.0)).norm() < 1e-12);
            assert_eq!(run.points[1].heading_rad, None);
        }
    }

    #[test]
    fn headings_go_the_shorter_way() {
        let run = run("# name: turn\n0 0 0 0 0 1 350\n1 0 0 0 0 1 10\n2 0 0 0 0 1 -330\n").unwrap();
        let degrees: Vec<f64> = run
            .points
            .iter()
            .filter_map(|point| Some(point.heading_rad?.to_degrees().round()))
            .collect();
        assert_eq!(degrees, [350.0, 370.0, 390.0]);
        assert_eq!(run.name, "turn");
    }

    #[test]
    fn what_is_no_run_is_refused_with_the_line() {
        let two = "0 0 0 0 0 1\n";
        let number = |column, text: &str| {
            format!("line 2, column {column}: `{text}` is not a finite number")
        };
        let columns = |columns| {
            format!(
                "line 2 has {columns} columns; write x y z nx ny nz, or x y z nx ny nz heading_deg; further ones \
                 (width_mm, height_mm, speed_mm_s, cone_deg) are named in a head: x y z nx ny nz width_mm"
            )
        };
        let mixed =
            "line 2 has 7 columns, the lines before it 6: a column is given everywhere or nowhere";
        let axis = |length: f64| {
            format!("line 2: the tool axis has length {length:.6}; a direction has length 1")
        };
        let few = "1 different waypoints; a run needs 2 or more";
        for (line, error) in [
            ("1 0 NaN 0 0 1", number(3, "NaN")),
            ("1 0 0 0 inf 1", number(5, "inf")),
            ("1 0 1e999 0 0 1", number(3, "1e999")),
            ("1 0 0 0 0 one", number(6, "one")),
            ("1 0 0", columns(3)),
            ("1 0 0 0 0 1 2 3", columns(8)),
            ("1 0 0 0 0 1 2", mixed.to_string()),
            ("1 0 0 0 0 0", axis(0.0)),
            ("1 0 0 0 0 -5", axis(5.0)),
            ("0 0 0 0 0 1", few.to_string()),
        ] {
            let refused = run(&format!("{two}{line}")).unwrap_err();
            assert_eq!(refused.to_string(), error, "{line}");
        }
        for (text, begins) in [
            (
                &b"0 0 0 0 0 1\n1 0 0 0 0 -1"[..],
                "line 2: the tool axis is tilted by ",
            ),
            (
                b"0 0 0 0 0 1\n1e300 0 0 0 0 1",
                "line 2 is inf mm from the origin",
            ),
            (b"# units: ft\n", "line 1: units 'ft' are not known"),
            (b"0 0 0 \xff", "byte 6 is not UTF-8 text"),
        ] {
            let refused = read(text, "run", &ReadOptions::default()).unwrap_err();
            assert!(refused.to_string().starts_with(begins), "{refused}");
        }
    }

    #[test]
    fn repeated_waypoints_and_long_axes_are_told() {
        let run = run("0 0 0 0 0 1\n0 0 0 0 0 1\n5 0 0 0 0.5 1\n").unwrap();
        assert_eq!(run.points.len(), 2);
        assert_eq!(run.notes.len(), 2);
        assert!((run.points[1].axis.norm() - 1.0).abs() < 1e-15);
    }
}
