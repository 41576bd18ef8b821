//! Stations for the collision check: poses along a route, and the points printed up to each of
//! them.
//!
//! In: a route, or one after another (mm, rad, machine coordinates). Out: stations and points, in order.

use crate::job::MotionState;
use crate::plan::route::lean::{LayerNormals, PassNormals};
use crate::plan::route::moves::{Route, RouteMove, tilt, tip};
use crate::plan::route::waypoint_curve::half_width_mm;
use crate::settings::Settings;
use headway_firmware::kinematics::pose::tool_axis;
use headway_reach::Pose;
use headway_reach::standing::Point;

/// Turn between two stations.
const TURN_RAD: f64 = 0.05;

/// A pose of the route.
#[derive(Clone, Copy, Debug)]
pub struct Station {
    /// Where the head is.
    pub pose: Pose,
    /// Number of its move, and the curve's parameter there.
    pub moving: usize,
    /// See `moving`.
    pub at: f64,
    /// Points that are printed before.
    pub before: usize,
    /// True on moves that print.
    pub lays: bool,
    /// Path to the next one, mm.
    pub step_mm: f64,
}

/// All stations of a route, in order.
#[derive(Clone, Debug, Default)]
pub struct Stations<'a> {
    /// The route, where it is kept: poses between two stations are those of its curves.
    route: Option<&'a Route>,
    /// Moves so far.
    moves: usize,
    /// In order.
    pub stations: Vec<Station>,
    /// The print, in order.
    pub points: Vec<Point>,
}

impl<'a> Stations<'a> {
    /// Stations no farther from each other than half the bead's width where it prints: points at this distance
    /// represent the complete bead. Their number is proportional to the path's length.
    pub fn of(
        route: &'a Route,
        normals: Option<&LayerNormals>,
        settings: &Settings,
    ) -> Stations<'a> {
        let mut found = Stations {
            route: Some(route),
            ..Stations::default()
        };
        found.append(route, normals, settings);
        found
    }

    /// Appends a route, which is not stored.
    pub fn append(&mut self, route: &Route, normals: Option<&LayerNormals>, settings: &Settings) {
        let first = self.stations.len();
        for route_move in &route.moves {
            let moving = self.moves;
            self.moves += 1;
            let mut add = |at: f64, laid, normals: &mut Option<PassNormals>| {
                if !route_move.curve.control.is_empty() {
                    self.add((moving, at), pose_of(route_move, at), laid, normals);
                }
            };
            let lays = route_move.state == MotionState::Print;
            let mut normals = normals.map(|normals| normals.along(route_move.pass));
            let control = &route_move.curve.control;
            for (span, leg) in control.windows(2).enumerate() {
                let half_width_mm = half_width_mm(&leg[0], &leg[1], &settings.aperture);
                let spacing_mm = match lays {
                    true => half_width_mm,
                    false => settings.aperture.reach_mm(),
                };
                let way_mm = (tip(&leg[1]) - tip(&leg[0])).norm();
                let turn_rad = (tilt(&leg[1]) - tilt(&leg[0])).norm();
                let count = (way_mm / spacing_mm)
                    .max(turn_rad / TURN_RAD)
                    .ceil()
                    .max(1.0);
                for step in 0..count as usize {
                    let at = span as f64 + step as f64 / count;
                    add(at, lays.then_some(half_width_mm), &mut normals);
                }
            }
            add(control.len().saturating_sub(1) as f64, None, &mut None);
        }
        for index in first.max(1)..self.stations.len() {
            let [from, to] = [index - 1, index].map(|index| self.stations[index].pose.tip_mm);
            self.stations[index - 1].step_mm = (to - from).norm();
        }
    }

    fn add(
        &mut self,
        (moving, at): (usize, f64),
        pose: Pose,
        laid_half_width_mm: Option<f64>,
        normals: &mut Option<PassNormals>,
    ) {
        self.stations.push(Station {
            pose,
            moving,
            at,
            before: self.points.len(),
            lays: laid_half_width_mm.is_some(),
            step_mm: 0.0,
        });
        if let Some(half_width_mm) = laid_half_width_mm {
            self.points.push(Point {
                at_mm: pose.tip_mm,
                half_width_mm,
                normal: normals
                    .as_mut()
                    .and_then(|normals| normals.next(&pose.tip_mm))
                    .unwrap_or(pose.axis),
            });
        }
    }

    /// The middle between two points of a move: that of the curve if it is stored, of the chord otherwise.
    pub fn middle(&self, moving: usize, ends: [(f64, Pose); 2]) -> (f64, Pose) {
        let [(from, start), (to, end)] = ends;
        let at = 0.5 * (from + to);
        if let Some(route_move) = self.route.and_then(|route| route.moves.get(moving)) {
            return (at, pose_of(route_move, at));
        }
        (at, start.middle(&end).unwrap_or(start))
    }
}

/// The pose at a place of a move.
fn pose_of(route_move: &RouteMove, at: f64) -> Pose {
    let pose = route_move.curve.evaluate(at).value;
    Pose {
        tip_mm: tip(&pose),
        axis: tool_axis(tilt(&pose)),
    }
}
