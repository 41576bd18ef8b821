//! Where a route is looked at: poses along it, and the points that it has laid up to each of them.
//!
//! In: a route (mm, rad, machine coordinates). Out: stations and points, in order.

use crate::job::MotionState;
use crate::plan::route::lean::{LayerNormals, PassNormals};
use crate::plan::route::moves::{Route, tilt, tip};
use crate::plan::route::waypoint_curve::half_width_mm;
use crate::settings::Settings;
use headway_firmware::pose::tool_axis;
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
    /// Points that are laid before.
    pub before: usize,
    /// True on moves that print.
    pub lays: bool,
    /// Path to the next one, mm.
    pub step_mm: f64,
}

/// All stations of a route, in order.
#[derive(Clone, Debug)]
pub struct Stations<'a> {
    route: &'a Route,
    /// In order.
    pub stations: Vec<Station>,
    /// What is laid, in order.
    pub points: Vec<Point>,
}

impl<'a> Stations<'a> {
    /// Stations no farther from each other than half the bead's width where it prints: points that lie so close
    /// stand for the whole bead. As many as the path is long.
    pub fn of(
        route: &'a Route,
        normals: Option<&LayerNormals>,
        settings: &Settings,
    ) -> Stations<'a> {
        let mut found = Stations {
            route,
            stations: Vec::new(),
            points: Vec::new(),
        };
        for (moving, route_move) in route.moves.iter().enumerate() {
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
                    found.add(moving, at, lays.then_some(half_width_mm), &mut normals);
                }
            }
            found.add(
                moving,
                control.len().saturating_sub(1) as f64,
                None,
                &mut None,
            );
        }
        for index in 1..found.stations.len() {
            let [from, to] = [index - 1, index].map(|index| found.stations[index].pose.tip_mm);
            found.stations[index - 1].step_mm = (to - from).norm();
        }
        found
    }

    fn add(
        &mut self,
        moving: usize,
        at: f64,
        laid_half_width_mm: Option<f64>,
        normals: &mut Option<PassNormals>,
    ) {
        if self.route.moves[moving].curve.control.is_empty() {
            return;
        }
        let pose = self.pose(moving, at);
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

    /// The pose at a place of a move.
    pub fn pose(&self, moving: usize, at: f64) -> Pose {
        let pose = self.route.moves[moving].curve.evaluate(at).value;
        Pose {
            tip_mm: tip(&pose),
            axis: tool_axis(tilt(&pose)),
        }
    }
}
