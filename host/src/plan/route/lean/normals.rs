//! Normals of a run's print: the given axes, whatever the tilt of the tool.
//!
//! In: a run and its position. Out: for a point of a pass the axis of the nearest waypoint, machine coordinates.

use super::laid::Laid;
use crate::input::waypoints::WaypointRun;
use headway_reach::Vector3;

/// Waypoints of each pass: tip and normal.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LayerNormals {
    passes: Vec<Vec<[Vector3; 2]>>,
}

/// The normals along one pass, from its beginning on.
pub struct PassNormals<'a> {
    waypoints: &'a [[Vector3; 2]],
}

impl LayerNormals {
    pub(super) fn of(run: &WaypointRun, laid: &Laid) -> LayerNormals {
        let of_pass = |pass: &super::PassPlaces| {
            let points = run.points[pass.waypoints.clone()].iter();
            let placed = points.map(|point| {
                [
                    point.tip_mm.coords + laid.offset_mm,
                    point.axis.into_inner(),
                ]
            });
            placed.collect()
        };
        LayerNormals {
            passes: laid.passes.iter().map(of_pass).collect(),
        }
    }

    /// Along a pass, or along none.
    pub fn along(&self, pass: Option<u32>) -> PassNormals<'_> {
        let waypoints = pass.and_then(|pass| self.passes.get(pass as usize));
        PassNormals {
            waypoints: waypoints.map_or(&[], Vec::as_slice),
        }
    }
}

impl PassNormals<'_> {
    /// The normal at the next point; `None` if the pass is unknown.
    pub fn next(&mut self, tip_mm: &Vector3) -> Option<Vector3> {
        let away = |waypoint: &[Vector3; 2]| (waypoint[0] - tip_mm).norm_squared();
        while let [here, next, ..] = self.waypoints {
            if away(next) > away(here) {
                break;
            }
            self.waypoints = &self.waypoints[1..];
        }
        self.waypoints.first().map(|waypoint| waypoint[1])
    }
}
