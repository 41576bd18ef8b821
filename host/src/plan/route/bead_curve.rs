//! A bead's centre line in G-code -> a C² curve with headings and volume.
//!
//! In: a [`GcodePass`] (mm, input coordinates), the program that wrote it, the nozzle. Out:
//! [`BeadCurve`]: control points of a uniform cubic B-spline (mm, rad, mm³ from 0), cut where the
//! speed changes.
//!
//! There is a control point on every vertex. At one where the path turns from d1 to d2 the curve
//! passes at a distance of h |d1 - d2| / 6, with h the distance of its neighbours: that gives h.
//! From there the distances grow evenly to `SPACING_MAX`; on straight legs the curve is the leg.
//!
//! At its heading the nozzle's bead is nearly as wide as the file's (`bead_headings`). Headings in the file are
//! kept. Not covered: flow onto covered area: volumes are the file's.

pub mod parts;
mod speeds;

use crate::gcode::comments::Slicer;
use crate::gcode::{GcodePass, Leg, Place};
use crate::geometry::Vector2;
use crate::geometry::aperture::Aperture;
use crate::plan::route::bead_headings::{BeadLines, HeadingTrack, WidthOff};
use crate::plan::route::told_headings::{HeadingJumps, followed_headings};
use crate::plan::route::waypoint_curve::CORNER_RAD;
use crate::settings::Settings;
use headway_protocol::units::{
    CHANNEL_HEADING, CHANNEL_VOLUME, CHANNEL_X, CHANNEL_Y, CHANNEL_Z, CHANNELS,
};

/// Largest distance of the curve from a vertex, of the aperture's unit: a corner, and a vertex of a polygon that
/// represents a curve; less what the fit of the segments takes, and what the steps grow by before a corner.
pub(super) const CORNER: f64 = 0.036;
const JOINT: f64 = 0.014;
/// Shortest and longest distance of control points, of the unit.
const SPACING_MIN: f64 = 0.02;
const SPACING_MAX: f64 = 1.0;
/// Growth of distances along the path.
pub(super) const SPACING_GROWTH: f64 = 0.3;
/// Changes of the heading's slope over a above this want control points closer than a third of a.
const HEADING_STEP_RAD: f64 = 0.02;
/// Places closer than this are one, of the unit.
const SAME: f64 = 0.002;
/// Beads wider or narrower than the nozzle's by this share are reported.
const WIDTH_SHARE: f64 = 0.02;

/// A pass in channel space.
#[derive(Clone, Debug, PartialEq)]
pub struct BeadCurve {
    /// From rest to rest.
    pub moves: Vec<BeadMove>,
    /// Length with a bead wider than the nozzle can print, and narrower, mm.
    pub beyond_mm: [f64; 2],
    /// Length printed wider or narrower than in the file.
    pub off: WidthOff,
    /// How headings of the file change.
    pub jumps: HeadingJumps,
}

/// A part of a pass from rest to rest.
#[derive(Clone, Debug, PartialEq)]
pub struct BeadMove {
    /// Control points.
    pub control: Vec<[f64; CHANNELS]>,
    /// Tip speed, the fastest, mm/s.
    pub speed_mm_s: f64,
    /// Tip speeds by the path's parameter, rising, where they are several.
    pub speeds_mm_s: Vec<[f64; 2]>,
}

/// A pass without legs of length 0, by legs.
struct Way {
    points: Vec<Place>,
    legs: Vec<Leg>,
    length_mm: Vec<f64>,
}

/// A pass whose headings are to be chosen, or are given.
pub struct Bead {
    way: Way,
    widths_mm: Vec<f64>,
    headings: Headings,
    jumps: HeadingJumps,
    is_told: bool,
}

impl Bead {
    /// The bead of a pass; `None` if its length is 0. Headings are kept if `headings_told`.
    pub fn of(
        pass: &GcodePass,
        slicer: Slicer,
        headings_told: bool,
        settings: &Settings,
    ) -> Option<Bead> {
        let way = Way::of(pass, settings.aperture.unit_mm())?;
        let widths_mm = way.widths_mm(slicer, settings);
        let mut jumps = HeadingJumps::default();
        let headings = match headings_told {
            true => {
                let lines = way.legs.iter().map(|leg| leg.line);
                let period_rad = settings.aperture.period_rad();
                let (headings, found) = followed_headings(&way.points, lines, period_rad);
                jumps = found;
                Headings::Told(headings)
            }
            false if settings.aperture.is_round() => Headings::Told(vec![0.0; way.points.len()]),
            false => Headings::Planned(HeadingTrack::default()),
        };
        Some(Bead {
            way,
            widths_mm,
            headings,
            jumps,
            is_told: headings_told,
        })
    }

    /// The lines whose headings are to be chosen, with the time of the travel to them; `None` if they are
    /// given.
    pub fn lines(&self, arrival_s: f64) -> Option<BeadLines> {
        match self.headings {
            Headings::Told(_) => None,
            Headings::Planned(_) => Some(self.way.lines(&self.widths_mm, arrival_s)),
        }
    }

    /// The same with chosen headings.
    pub fn with_headings(self, track: HeadingTrack) -> Bead {
        let headings = Headings::Planned(track);
        Bead { headings, ..self }
    }

    /// Its curve.
    pub fn curve(&self, settings: &Settings) -> BeadCurve {
        let (way, widths_mm, headings) = (&self.way, &self.widths_mm, &self.headings);
        let aperture = &settings.aperture;
        let volumes_mm3 = way.volumes_mm3(widths_mm, headings, settings);
        let control = way.control(headings, &volumes_mm3, aperture);
        let mut moves = Vec::new();
        for run in way.speed_runs(settings) {
            moves.extend(control.run(&run));
        }
        let mut beyond_mm = [0.0; 2];
        if !self.is_told {
            for (width_mm, length_mm) in widths_mm.iter().zip(&way.length_mm) {
                let wide = *width_mm > 2.0 * aperture.major_mm() * (1.0 + WIDTH_SHARE);
                let narrow = *width_mm < 2.0 * aperture.minor_mm() * (1.0 - WIDTH_SHARE);
                beyond_mm[0] += f64::from(u8::from(wide)) * length_mm;
                beyond_mm[1] += f64::from(u8::from(narrow)) * length_mm;
            }
        }
        let off = match headings {
            Headings::Told(_) => WidthOff::default(),
            Headings::Planned(track) => track.off,
        };
        BeadCurve {
            moves,
            beyond_mm,
            off,
            jumps: self.jumps,
        }
    }
}

fn direction(from: &Place, to: &Place) -> [f64; 3] {
    let length_mm = to.distance_mm(from).max(1e-12);
    std::array::from_fn(|i| (to.tip_mm[i] - from.tip_mm[i]) / length_mm)
}

/// |d1 - d2| of two directions.
fn turn(d1: [f64; 3], d2: [f64; 3]) -> f64 {
    (0..3).map(|i| (d2[i] - d1[i]).powi(2)).sum::<f64>().sqrt()
}

/// Control points' distance at a vertex that turns by |d1 - d2|.
fn spacing_mm(turn: f64, unit_mm: f64) -> f64 {
    let is_corner = turn > 2.0 * (0.5 * CORNER_RAD).sin();
    let beside = if is_corner { CORNER } else { JOINT };
    (6.0 * beside / turn.max(1e-9)).clamp(SPACING_MIN, SPACING_MAX) * unit_mm
}

/// Ends of the steps of a leg, from its start, the last the leg's end: they grow from both ends.
pub(super) fn steps_mm(
    length_mm: f64,
    [first_mm, last_mm]: [f64; 2],
    longest_mm: f64,
    unit_mm: f64,
) -> Vec<f64> {
    let mut ends = Vec::new();
    let mut at = 0.0;
    while at < length_mm {
        let left = (length_mm - at).max(0.0);
        let step = (first_mm + SPACING_GROWTH * at).min(last_mm + SPACING_GROWTH * left);
        at += step.clamp(SPACING_MIN * unit_mm, longest_mm);
        ends.push(at);
    }
    let scale = length_mm / at.max(f64::MIN_POSITIVE);
    ends.iter_mut().for_each(|end| *end *= scale);
    ends
}

/// Limits each distance by its neighbours and the adjacent legs.
fn graded(spacings_mm: &mut [f64], length_mm: &[f64], unit_mm: f64) {
    let count = spacings_mm.len();
    for (i, length_mm) in length_mm.iter().enumerate() {
        for node in [i, i + 1] {
            spacings_mm[node] = spacings_mm[node].min(length_mm.max(SPACING_MIN * unit_mm));
        }
    }
    for i in 1..count {
        spacings_mm[i] = spacings_mm[i].min(spacings_mm[i - 1] + SPACING_GROWTH * length_mm[i - 1]);
    }
    for i in (1..count).rev() {
        spacings_mm[i - 1] =
            spacings_mm[i - 1].min(spacings_mm[i] + SPACING_GROWTH * length_mm[i - 1]);
    }
}

/// Control points of a path without flow through these tips: its corners are rounded like those of
/// beads. Each has its share of the path.
pub fn travel_control(tips_mm: &[[f64; 3]], unit_mm: f64) -> Vec<([f64; 3], f64)> {
    let mut points: Vec<Place> = Vec::new();
    for tip_mm in tips_mm {
        let place = Place {
            tip_mm: *tip_mm,
            turn_deg: [0.0; 3],
        };
        if points
            .last()
            .is_none_or(|last| last.distance_mm(&place) > SAME * unit_mm)
        {
            points.push(place);
        } else if points.len() > 1
            && let Some(last) = points.last_mut()
        {
            *last = place;
        }
    }
    let pairs = || points.windows(2);
    let length_mm: Vec<f64> = pairs().map(|pair| pair[1].distance_mm(&pair[0])).collect();
    let whole_mm: f64 = length_mm.iter().sum();
    let directions: Vec<[f64; 3]> = pairs().map(|pair| direction(&pair[0], &pair[1])).collect();
    // A straight path is given by its ends.
    let longest_mm = if directions.len() < 2 {
        f64::INFINITY
    } else {
        4.0 * SPACING_MAX * unit_mm
    };
    let mut spacings_mm = vec![longest_mm; points.len()];
    for (i, pair) in directions.windows(2).enumerate() {
        spacings_mm[i + 1] = spacing_mm(turn(pair[0], pair[1]), unit_mm);
    }
    graded(&mut spacings_mm, &length_mm, unit_mm);
    let mut control: Vec<([f64; 3], f64)> = points
        .first()
        .map(|point| (point.tip_mm, 0.0))
        .into_iter()
        .collect();
    let mut before_mm = 0.0;
    for (i, length_mm) in length_mm.iter().enumerate() {
        let steps = match directions.len() {
            1 => vec![*length_mm],
            _ => steps_mm(
                *length_mm,
                [spacings_mm[i], spacings_mm[i + 1]],
                longest_mm,
                unit_mm,
            ),
        };
        for (k, end) in steps.iter().enumerate() {
            let tip_mm = match k + 1 == steps.len() {
                true => points[i + 1].tip_mm,
                false => std::array::from_fn(|c| points[i].tip_mm[c] + end * directions[i][c]),
            };
            control.push((tip_mm, (before_mm + end) / whole_mm));
        }
        before_mm += length_mm;
    }
    control
}

/// Control points, and which of them are on the path's vertices.
struct Control {
    points: Vec<[f64; CHANNELS]>,
    vertices: Vec<usize>,
}

impl Way {
    fn of(pass: &GcodePass, unit_mm: f64) -> Option<Way> {
        let mut points = vec![*pass.points.first()?];
        let mut legs: Vec<Leg> = Vec::new();
        let mut carried_mm3 = 0.0;
        for (point, leg) in pass.points.iter().skip(1).zip(&pass.legs) {
            let mut leg = *leg;
            leg.volume_mm3 = leg.volume_mm3.map(|mm3| mm3 + carried_mm3);
            let last = points.last()?;
            if point.distance_mm(last) > SAME * unit_mm {
                points.push(*point);
                legs.push(leg);
                carried_mm3 = 0.0;
            } else {
                carried_mm3 = leg.volume_mm3.unwrap_or(0.0);
            }
        }
        if let Some(volume_mm3) = legs.last_mut()?.volume_mm3.as_mut() {
            *volume_mm3 += carried_mm3;
        }
        let pairs = points.windows(2);
        let length_mm = pairs.map(|pair| pair[1].distance_mm(&pair[0])).collect();
        Some(Way {
            points,
            legs,
            length_mm,
        })
    }

    /// Widths of the beads: as given, or from the deposited volume.
    fn widths_mm(&self, slicer: Slicer, settings: &Settings) -> Vec<f64> {
        let legs = self.legs.iter().zip(&self.length_mm);
        let widest_mm = 2.0 * settings.aperture.major_mm();
        legs.map(|(leg, length_mm)| {
            let height_mm = leg.height_mm.unwrap_or(settings.layer_height_mm);
            let width_mm = leg.bead_mm(*length_mm, height_mm, slicer);
            width_mm.unwrap_or(widest_mm)
        })
        .collect()
    }

    /// What its headings are chosen for.
    fn lines(&self, widths_mm: &[f64], arrival_s: f64) -> BeadLines {
        let mut travel_rad = 0.0;
        let directions = self.points.windows(2).map(|pair| {
            let [dx, dy, _] = direction(&pair[0], &pair[1]);
            // Straight up there is no direction: as before.
            if dx.hypot(dy) > 1e-6 {
                travel_rad = f64::atan2(dy, dx);
            }
            travel_rad
        });
        BeadLines {
            travel_rad: directions.collect(),
            length_mm: self.length_mm.clone(),
            widths_mm: widths_mm.to_vec(),
            speeds_mm_s: self.legs.iter().map(|leg| leg.speed_mm_s).collect(),
            is_inside: self.legs.iter().map(|leg| leg.is_inside).collect(),
            arrival_s,
        }
    }

    /// Volume at each vertex: the file's, or that of the beads of the turned nozzle.
    fn volumes_mm3(&self, widths_mm: &[f64], headings: &Headings, settings: &Settings) -> Vec<f64> {
        let aperture = &settings.aperture;
        let mut volume_mm3 = 0.0;
        let mut volumes = vec![volume_mm3];
        for (i, leg) in self.legs.iter().enumerate() {
            let height_mm = leg.height_mm.unwrap_or(settings.layer_height_mm);
            let laid = || {
                let width_mm = match headings {
                    Headings::Told(headings) => {
                        let [dx, dy, _] = direction(&self.points[i], &self.points[i + 1]);
                        let heading_rad = 0.5 * (headings[i] + headings[i + 1]);
                        2.0 * aperture.extent_mm(heading_rad, Vector2::new(-dy, dx))
                    }
                    Headings::Planned(_) => {
                        let half_mm = 0.5 * widths_mm[i];
                        2.0 * half_mm.clamp(aperture.minor_mm(), aperture.major_mm())
                    }
                };
                width_mm * height_mm * self.length_mm[i]
            };
            volume_mm3 += leg.volume_mm3.unwrap_or_else(laid) * settings.flow_factor;
            volumes.push(volume_mm3);
        }
        volumes
    }

    fn control(&self, headings: &Headings, volumes_mm3: &[f64], aperture: &Aperture) -> Control {
        let pairs = self.points.windows(2);
        let directions: Vec<[f64; 3]> = pairs.map(|pair| direction(&pair[0], &pair[1])).collect();
        let (about_mm, unit_mm) = (aperture.major_mm(), aperture.unit_mm());
        let mut places_mm = vec![0.0];
        for length_mm in &self.length_mm {
            places_mm.push(places_mm[places_mm.len() - 1] + length_mm);
        }
        let mut spacings_mm = vec![SPACING_MAX * unit_mm; self.points.len()];
        for node in 1..directions.len() {
            spacings_mm[node] = spacing_mm(turn(directions[node - 1], directions[node]), unit_mm);
            if headings.step_rad(node, &places_mm, about_mm) > HEADING_STEP_RAD {
                spacings_mm[node] = spacings_mm[node].min(about_mm / 3.0);
            }
        }
        graded(&mut spacings_mm, &self.length_mm, unit_mm);
        let mut control = Control {
            points: Vec::new(),
            vertices: vec![0],
        };
        let mut push = |leg: usize, at_mm: f64, tip_mm: [f64; 3], volume_mm3: f64| {
            let mut point = [0.0; CHANNELS];
            point[CHANNEL_X] = tip_mm[0];
            point[CHANNEL_Y] = tip_mm[1];
            point[CHANNEL_Z] = tip_mm[2];
            point[CHANNEL_HEADING] = headings.at(leg, at_mm, &places_mm);
            point[CHANNEL_VOLUME] = volume_mm3;
            control.points.push(point);
            control.points.len() - 1
        };
        push(0, 0.0, self.points[0].tip_mm, 0.0);
        for (leg, length_mm) in self.length_mm.iter().enumerate() {
            let ends = steps_mm(
                *length_mm,
                [spacings_mm[leg], spacings_mm[leg + 1]],
                SPACING_MAX * unit_mm,
                unit_mm,
            );
            let mut vertex = 0;
            for (k, end_mm) in ends.iter().enumerate() {
                let share = end_mm / length_mm;
                let is_last = k + 1 == ends.len();
                let tip_mm = match is_last {
                    true => self.points[leg + 1].tip_mm,
                    false => std::array::from_fn(|c| {
                        self.points[leg].tip_mm[c] + end_mm * directions[leg][c]
                    }),
                };
                let [from, to] = [volumes_mm3[leg], volumes_mm3[leg + 1]];
                vertex = push(
                    leg,
                    places_mm[leg] + end_mm,
                    tip_mm,
                    from + share * (to - from),
                );
            }
            control.vertices.push(vertex);
        }
        control
    }
}

/// Headings along a path.
enum Headings {
    /// At each vertex, evenly between them.
    Told(Vec<f64>),
    /// Chosen for the nozzle.
    Planned(HeadingTrack),
}

impl Headings {
    /// By how much the turning changes at a vertex, within `about_mm` of it.
    fn step_rad(&self, node: usize, places_mm: &[f64], about_mm: f64) -> f64 {
        match self {
            Headings::Told(headings) => {
                (headings[node + 1] - 2.0 * headings[node] + headings[node - 1]).abs()
            }
            Headings::Planned(track) => {
                let [before, own, after] =
                    [-1.0, 0.0, 1.0].map(|side| track.at(places_mm[node] + side * about_mm));
                (before - 2.0 * own + after).abs()
            }
        }
    }

    /// At a place of a leg.
    fn at(&self, leg: usize, at_mm: f64, places_mm: &[f64]) -> f64 {
        match self {
            Headings::Told(headings) => {
                let share = (at_mm - places_mm[leg]) / (places_mm[leg + 1] - places_mm[leg]);
                headings[leg] + share * (headings[leg + 1] - headings[leg])
            }
            Headings::Planned(track) => track.at(at_mm),
        }
    }
}
