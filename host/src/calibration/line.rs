//! Lines of a pattern: their geometry and their waypoints.
//!
//! In: ends and headings, mm and degrees, pattern coordinates. Out: [`Line`]s, and runs of waypoints in which
//! every line is a pass. Not covered: which lines make a pattern.

use crate::input::waypoints::{PassAsked, Waypoint, WaypointRun};
use crate::settings::{PrimeRetract, Settings};
use nalgebra::{Point3, Unit, Vector3};

/// One line.
#[derive(Clone, Debug, PartialEq)]
pub struct Line {
    /// Its description, in a few words.
    pub what: String,
    /// Its value, in the pattern's unit; `None` for a mark.
    pub value: Option<f64>,
    /// The pattern's job that prints it.
    pub job: usize,
    /// Its waypoints, pattern coordinates.
    pub points: Vec<Waypoint>,
}

impl Line {
    /// A straight line on the first layer, at a heading that is meant as it is.
    pub(super) fn straight(
        what: impl Into<String>,
        [from, to]: [[f64; 2]; 2],
        heading_deg: f64,
        settings: &Settings,
    ) -> Line {
        let z_mm = settings.layer_height_mm;
        let ends = [from, to].map(|[x, y]| point([x, y, z_mm], Some(heading_deg)));
        Line {
            what: what.into(),
            value: None,
            job: 0,
            points: ends.to_vec(),
        }
    }

    /// Through places in space at one heading.
    pub(super) fn through(
        what: impl Into<String>,
        places: impl Iterator<Item = [f64; 3]>,
        heading_deg: f64,
    ) -> Line {
        let points = places.map(|place| point(place, Some(heading_deg)));
        Line {
            what: what.into(),
            value: None,
            job: 0,
            points: points.collect(),
        }
    }

    /// Assigns a value to the line.
    pub(super) fn of_value(mut self, value: f64) -> Line {
        self.value = Some(value);
        self
    }

    /// With the material of a bead of this width, whatever the heading.
    pub(super) fn with_width(mut self, width_mm: f64) -> Line {
        self.points
            .iter_mut()
            .for_each(|point| point.width_mm = Some(width_mm));
        self
    }

    /// With the tool leaning.
    pub(super) fn leaning(mut self, axis: Vector3<f64>) -> Line {
        let axis = Unit::new_normalize(axis);
        self.points.iter_mut().for_each(|point| point.axis = axis);
        self
    }

    /// With its own prime and retract.
    pub(super) fn primed(mut self, prime_retract: PrimeRetract) -> Line {
        if let Some(first) = self.points.first_mut() {
            first.asked.prime_retract = Some(prime_retract);
        }
        self
    }

    /// First and last place, mm.
    pub fn ends_mm(&self) -> [[f64; 3]; 2] {
        let end = |point: Option<&Waypoint>| point.map_or([0.0; 3], |point| point.tip_mm.into());
        [end(self.points.first()), end(self.points.last())]
    }

    /// Its heading, if it has only one.
    pub fn heading_deg(&self) -> Option<f64> {
        self.points.first()?.heading_rad.map(f64::to_degrees)
    }
}

fn point(place_mm: [f64; 3], heading_deg: Option<f64>) -> Waypoint {
    Waypoint {
        line: 1,
        tip_mm: Point3::from(place_mm),
        axis: Vector3::z_axis(),
        heading_rad: heading_deg.map(f64::to_radians),
        width_mm: None,
        height_mm: None,
        section_mm2: None,
        speed_mm_s: None,
        cone_rad: None,
        begins: false,
        asked: PassAsked::default(),
    }
}

/// One run of all lines, each a pass of its own that keeps its headings.
pub(super) fn run_of<'a>(name: &str, lines: impl Iterator<Item = &'a Line>) -> WaypointRun {
    let mut points = Vec::new();
    for line in lines {
        let first = points.len();
        points.extend(line.points.iter().copied());
        if let Some(first) = points.get_mut(first) {
            first.begins = true;
            first.asked.keeps_heading = true;
        }
    }
    for (number, point) in points.iter_mut().enumerate() {
        point.line = number + 1;
    }
    WaypointRun {
        name: name.to_string(),
        points,
        notes: Vec::new(),
        has_feeds: false,
    }
}

/// Distance of neighbouring lines, mm: they do not touch, and can be distinguished with a finger.
pub(super) fn pitch_mm(settings: &Settings) -> f64 {
    (6.0 * settings.aperture.major_mm()).max(5.0)
}

/// Length of the lines, mm: the requested one, or at most half the bed.
pub(super) fn length_mm(asked: Option<f64>, usual_mm: f64, settings: &Settings) -> f64 {
    let [low, high] = settings.work_area_mm;
    let half_mm = 0.5 * f64::min(high[0] - low[0], high[1] - low[1]);
    asked.unwrap_or_else(|| f64::min(usual_mm, half_mm).floor().max(1.0))
}

/// How much longer the middle line is, mm, so that the others can be counted from it.
pub(super) fn longer_mm(settings: &Settings) -> f64 {
    pitch_mm(settings)
}
