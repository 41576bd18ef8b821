//! Headings that a file gives -> those that the nozzle turns to.
//!
//! In: the headings of a path in order (rad), the aperture's period. Out: the same where they change by up to a quarter
//! turn from one to the next. A larger change on the way, as where the direction of a line is given modulo half a turn, is
//! met by the nearest heading that prints the same; where only a whole turn does, it stays, and is counted
//! ([`HeadingJumps`]). Turns on the spot are the file's. Not covered: bounds of the heading.

use crate::gcode::Place;
use crate::input::waypoints::{SAME_PLACE_MM, Waypoint, WaypointRun};
use crate::plan::route::waypoint_curve::divided;
use crate::settings::Settings;
use std::f64::consts::{FRAC_PI_2, TAU};

/// What rounding of a file may add to a quarter turn, rad.
const ROUNDING_RAD: f64 = 1e-6;
/// A line is as straight as this, of its length: what a leg of a file was divided by.
const STRAIGHT_SHARE: f64 = 1e-6;

/// Changes of heading beyond a quarter turn from one place of a file to the next.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct HeadingJumps {
    /// Those that are met by another heading that prints the same, and those that are turned through.
    pub counts: [usize; 2],
    /// Line of the first one that is turned through, its turn (rad) and way (mm).
    pub first: Option<(usize, f64, f64)>,
    /// Places within passes at which the nozzle turns back between its stops.
    pub turned_back: usize,
}

impl HeadingJumps {
    /// What is added to headings from a step on: it turns by so much, at a line, over a way. Its own turn then is the rest.
    fn shift_rad(&mut self, turn_rad: f64, line: usize, way_mm: f64, period_rad: f64) -> f64 {
        if turn_rad.abs() <= FRAC_PI_2 + ROUNDING_RAD || way_mm <= SAME_PLACE_MM {
            return 0.0;
        }
        let shift_rad = -period_rad * (turn_rad / period_rad).round();
        let left_rad = turn_rad + shift_rad;
        let is_met = left_rad.abs() <= FRAC_PI_2 + ROUNDING_RAD;
        self.counts[usize::from(!is_met)] += 1;
        if !is_met {
            self.first.get_or_insert((line, left_rad, way_mm));
        }
        shift_rad
    }

    /// Adds those of another part of the file behind it.
    pub fn add(&mut self, other: &HeadingJumps) {
        self.counts = [0, 1].map(|k| self.counts[k] + other.counts[k]);
        self.first = self.first.or(other.first);
        self.turned_back += other.turned_back;
    }

    /// One line each.
    pub fn notes(&self) -> Vec<String> {
        let [met, turned] = self.counts;
        let mut notes = Vec::new();
        if self.turned_back > 0 {
            notes.push(format!(
                "the nozzle reaches a stop within passes, {} in all: each is cut there, and goes on once it has turned back",
                match self.turned_back {
                    1 => "once".to_string(),
                    times => format!("{times} times"),
                }
            ));
        }
        if met > 0 {
            notes.push(format!(
                "{met} headings of the file are more than a quarter turn from the ones before: the nozzle, which is the same \
                 after half a turn, turns to the nearest that print the same"
            ));
        }
        if let Some((line, turn_rad, way_mm)) = self.first {
            notes.push(format!(
                "line {line}: the heading turns by {:.1}° within {way_mm:.3} mm ({turned} such places): this nozzle is not \
                 the same after half a turn, and the bead is not as meant there; give headings that change by less",
                turn_rad.to_degrees()
            ));
        }
        notes
    }
}

/// The run with the headings that the nozzle turns to. Passes that keep theirs are left alone.
pub fn followed_run(run: &WaypointRun, settings: &Settings) -> (WaypointRun, HeadingJumps) {
    let mut jumps = HeadingJumps::default();
    let period_rad = settings.aperture.period_rad();
    let mut points = Vec::with_capacity(run.points.len());
    for pass in divided(run, settings) {
        let Some((first, rest)) = pass.split_first() else {
            continue;
        };
        let keeps = first.asked.keeps_heading;
        points.push(*first);
        let (mut before, mut shift_rad) = (*first, 0.0);
        // A leg of G-code is several waypoints of one line.
        for leg in rest.chunk_by(|a, b| a.line == b.line) {
            let last = leg[leg.len() - 1];
            let chord_mm = (last.tip_mm - before.tip_mm).norm();
            let own_rad = match (before.heading_rad, last.heading_rad) {
                (Some(from), Some(to)) if !keeps && is_straight(&before, leg) => {
                    jumps.shift_rad(to - from, last.line, chord_mm, period_rad)
                }
                _ => 0.0,
            };
            points.extend(leg.iter().map(|point| {
                let along_mm = (point.tip_mm - before.tip_mm).norm();
                let share = if own_rad == 0.0 {
                    0.0
                } else {
                    along_mm / chord_mm
                };
                let turned = |heading| heading + shift_rad + share * own_rad;
                let heading_rad = point.heading_rad.map(turned);
                Waypoint {
                    heading_rad,
                    ..*point
                }
            }));
            shift_rad += own_rad;
            before = last;
        }
    }
    let run = WaypointRun {
        points,
        ..run.clone()
    };
    (run, jumps)
}

fn is_straight(before: &Waypoint, leg: &[Waypoint]) -> bool {
    let tips = || std::iter::once(before).chain(leg).map(|point| point.tip_mm);
    let way_mm: f64 = tips()
        .zip(tips().skip(1))
        .map(|(a, b)| (b - a).norm())
        .sum();
    let chord_mm = (leg[leg.len() - 1].tip_mm - before.tip_mm).norm();
    way_mm <= chord_mm * (1.0 + STRAIGHT_SHARE)
}

/// Headings at the points of a pass of G-code, whose legs have these lines; in the shorter direction where C is wrapped.
pub fn followed_headings(
    points: &[Place],
    lines: impl Iterator<Item = usize>,
    period_rad: f64,
) -> (Vec<f64>, HeadingJumps) {
    let mut jumps = HeadingJumps::default();
    let own = |point: &Place| point.axis_and_heading().1;
    let mut headings: Vec<f64> = points.first().map(own).into_iter().collect();
    let mut heading_rad = headings.first().copied().unwrap_or_default();
    for (pair, line) in points.windows(2).zip(lines) {
        let turn_rad = own(&pair[1]) - own(&pair[0]);
        let turn_rad = turn_rad - TAU * (turn_rad / TAU).round();
        let way_mm = pair[1].distance_mm(&pair[0]);
        heading_rad += turn_rad + jumps.shift_rad(turn_rad, line, way_mm, period_rad);
        headings.push(heading_rad);
    }
    (headings, jumps)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Vector2;
    use crate::geometry::aperture::Aperture;
    use crate::geometry::rounded_polygon::RoundedPolygon;
    use crate::input::ReadOptions;
    use crate::input::waypoints::read;

    /// Degrees of a run of waypoints 1 mm apart, and what is told.
    fn followed(headings_deg: &[f64], settings: &Settings) -> (Vec<f64>, Vec<String>) {
        let line = |(k, deg): (usize, &f64)| format!("{k} 0 0 0 0 1 {deg}\n");
        let text: String = headings_deg.iter().enumerate().map(line).collect();
        let run = read(text.as_bytes(), "run", &ReadOptions::default()).expect("a run");
        let (run, jumps) = followed_run(&run, settings);
        let headings = run.points.iter().filter_map(|point| point.heading_rad);
        let headings = headings.map(|rad| (rad.to_degrees() * 1e6).round() / 1e6);
        (headings.collect(), jumps.notes())
    }

    /// Goal: headings modulo half a turn, as atan gives them, are followed without a jump; a nozzle that is not the same after
    /// half a turn is told of them with the line. Method: a direction that turns through 90° and back, on an ellipse and on a
    /// triangle; a turn by exactly a quarter stays.
    #[test]
    fn headings_modulo_half_a_turn_do_not_jump() {
        let given = [80.0, 88.0, -84.0, -88.0, 86.0];
        let ellipse = Settings::default();
        let (headings, notes) = followed(&given, &ellipse);
        assert_eq!(headings, [80.0, 88.0, 96.0, 92.0, 86.0]);
        assert!(
            notes.len() == 1 && notes[0].starts_with("2 headings"),
            "{notes:?}"
        );
        let turns = [0.0, 90.0, 0.0, -90.0, -45.0];
        assert_eq!(followed(&turns, &ellipse), (turns.to_vec(), Vec::new()));
        let corners = [[0.5, 0.0], [-0.25, 0.3], [-0.25, -0.3]].map(Vector2::from);
        let shape = RoundedPolygon::polygon(&corners).expect("a triangle");
        let triangle = Settings {
            aperture: Aperture::Rounded(shape),
            ..Settings::default()
        };
        let (headings, notes) = followed(&given, &triangle);
        assert_eq!(headings, given);
        assert!(
            notes.len() == 1 && notes[0].starts_with("line 3: "),
            "{notes:?}"
        );
        assert!(notes[0].contains("2 such places"), "{notes:?}");
    }

    /// Goal: G-code's C is followed likewise, and its turns on the spot stay. Method: places of a pass.
    #[test]
    fn headings_of_gcode_do_not_jump() {
        let place = |x: f64, c: f64| Place {
            tip_mm: [x, 0.0, 0.0],
            turn_deg: [0.0, 0.0, c],
        };
        let points = [place(0.0, 85.0), place(1.0, -88.0), place(1.0, 10.0)];
        let (headings, jumps) = followed_headings(&points, 1.., std::f64::consts::PI);
        let degrees: Vec<f64> = headings
            .iter()
            .map(|rad| rad.to_degrees().round())
            .collect();
        assert_eq!((degrees, jumps.counts), (vec![85.0, 92.0, 190.0], [1, 0]));
    }
}
