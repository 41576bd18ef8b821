//! Patches planned by themselves -> one sequence of moves over the surface.
//!
//! In: the moves of each patch, from its first prime to its last retract (mm, rad, mm³, the surface's coordinates). Out:
//! one sequence, layer by layer and in each layer patch by patch, with travel that follows the surface: away from it by the
//! lift, along the shortest path of the mesh's edges, smoothed, and down again.

use crate::job::MotionState;
use crate::mesh::patch::way_along;
use crate::mesh::{Mesh, Point3};
use crate::pipeline::surface::error::SurfaceError;
use crate::plan::headings::stops::nearest_heading;
use crate::plan::route::clear_travel::moved_to;
use crate::plan::route::moves::{RouteMove, tilt, tip};
use crate::plan::route::waypoint_curve::chord_spline::through_samples;
use crate::settings::Settings;
use headway_firmware::kinematics::pose::{tilt_of_axis, tool_axis};
use headway_protocol::units::{
    CHANNEL_HEADING, CHANNEL_TILT_X, CHANNEL_TILT_Y, CHANNEL_VOLUME, CHANNELS,
};
use nalgebra::Vector3;

/// Step between places of a travel over the surface, of the nozzle's unit, and rounds of smoothing.
const TRAVEL_STEP: f64 = 1.5;
const SMOOTHINGS: usize = 4;

type Point = [f64; CHANNELS];
/// A place over the surface, with the tool axis there.
type Place = (Vector3<f64>, Vector3<f64>);

/// What is joined.
pub struct Join<'a> {
    mesh: &'a Mesh,
    normals: Vec<Vector3<f64>>,
    settings: &'a Settings,
    /// The moves so far.
    pub moves: Vec<RouteMove>,
    /// For each pass the patch that it belongs to.
    pub patch_of_pass: Vec<usize>,
    volume_mm3: f64,
}

impl<'a> Join<'a> {
    /// Nothing yet.
    pub fn over(mesh: &'a Mesh, normals: Vec<Vector3<f64>>, settings: &'a Settings) -> Join<'a> {
        Join {
            mesh,
            normals,
            settings,
            moves: Vec::new(),
            patch_of_pass: Vec::new(),
            volume_mm3: 0.0,
        }
    }

    /// Adds one layer of a patch behind what there is.
    ///
    /// # Errors
    /// [`SurfaceError`].
    pub fn add(
        &mut self,
        patch: usize,
        moves: &[RouteMove],
        layer: u32,
    ) -> Result<(), SurfaceError> {
        let of_layer: Vec<&RouteMove> = moves.iter().filter(|own| own.layer == layer).collect();
        let is_travel = |own: &&&RouteMove| own.state == MotionState::Travel;
        let begins = of_layer.iter().take_while(is_travel).count();
        let ends = of_layer.iter().rev().take_while(is_travel).count();
        let of_layer = of_layer.get(begins..of_layer.len() - ends);
        let mut of_layer: Vec<RouteMove> = (of_layer.unwrap_or_default().iter())
            .map(|own| (*own).clone())
            .collect();
        let Some(&begin) = of_layer.first().and_then(|own| own.curve.control.first()) else {
            return Ok(());
        };
        let end = self
            .moves
            .last()
            .and_then(|last| last.curve.control.last())
            .copied();
        let heading_rad = begin[CHANNEL_HEADING];
        let turn_rad = end.map_or(0.0, |end| {
            let period_rad = self.settings.aperture.period_rad();
            nearest_heading(heading_rad, end[CHANNEL_HEADING], period_rad) - heading_rad
        });
        let more_mm3 = self.volume_mm3 - begin[CHANNEL_VOLUME];
        let mut pass_before = None;
        for own in &mut of_layer {
            for point in &mut own.curve.control {
                point[CHANNEL_HEADING] += turn_rad;
                point[CHANNEL_VOLUME] += more_mm3;
            }
            if own.pass.is_some() && own.pass != pass_before {
                pass_before = own.pass;
                self.patch_of_pass.push(patch);
            }
            let last = self.patch_of_pass.len().saturating_sub(1) as u32;
            own.pass = own.pass.map(|_| last);
        }
        if let Some(end) = end {
            let begin = of_layer[0].curve.control[0];
            self.travel([end, begin], layer)?;
        }
        self.moves.append(&mut of_layer);
        let last = self.moves.last().and_then(|last| last.curve.control.last());
        self.volume_mm3 = last.map_or(self.volume_mm3, |last| last[CHANNEL_VOLUME]);
        Ok(())
    }

    /// Away from the surface, over it, and back.
    fn travel(&mut self, [from, to]: [Point; 2], layer: u32) -> Result<(), SurfaceError> {
        let lift_mm = self.settings.lift_mm;
        let [off, over] =
            [from, to].map(|pose| moved_to(&pose, tip(&pose) + lift_mm * tool_axis(tilt(&pose))));
        let mut places = vec![(tip(&off), tool_axis(tilt(&off)))];
        places.extend(self.between([&off, &over], layer)?);
        places.push((tip(&over), tool_axis(tilt(&over))));
        for _ in 0..SMOOTHINGS {
            let before = places.clone();
            for (at, beside) in before.windows(3).enumerate() {
                let [p, q, r] = [beside[0], beside[1], beside[2]];
                let axis = (p.1 + 2.0 * q.1 + r.1).try_normalize(1e-9).unwrap_or(q.1);
                places[at + 1] = (0.25 * (p.0 + 2.0 * q.0 + r.0), axis);
            }
        }
        let last = places.len() - 1;
        let samples = places
            .iter()
            .enumerate()
            .map(|(number, (at, axis))| match number {
                0 => off,
                number if number == last => over,
                number => {
                    let share = number as f64 / last as f64;
                    let mut pose: Point =
                        std::array::from_fn(|c| off[c] + share * (over[c] - off[c]));
                    let lean = tilt_of_axis(axis);
                    (pose[CHANNEL_TILT_X], pose[CHANNEL_TILT_Y]) = (lean.x, lean.y);
                    moved_to(&pose, *at)
                }
            });
        let samples: Vec<Point> = samples.collect();
        let across = match samples.len() {
            0..=2 => samples,
            _ => through_samples(&samples),
        };
        for control in [vec![from, off], across, vec![over, to]] {
            if control.first() != control.last() {
                let travel = RouteMove::new(MotionState::Travel, layer, control);
                self.moves.push(travel);
            }
        }
        Ok(())
    }

    /// Places over the surface between two poses, with the axis there.
    fn between(&self, [from, to]: [&Point; 2], layer: u32) -> Result<Vec<Place>, SurfaceError> {
        let ends = [from, to].map(|pose| Point3::from(tip(pose)));
        let Some(way) = way_along(self.mesh, ends)? else {
            return Ok(Vec::new());
        };
        let Settings {
            layer_height_mm,
            lift_mm,
            ..
        } = self.settings;
        let above_mm = layer_height_mm * f64::from(layer + 1) + lift_mm;
        let step_mm = TRAVEL_STEP * self.settings.aperture.unit_mm();
        let over = |vertex: &u32| {
            let (at, normal) = (
                self.mesh.vertices[*vertex as usize],
                self.normals[*vertex as usize],
            );
            (at.coords + above_mm * normal, normal)
        };
        let mut places: Vec<Place> = Vec::new();
        let mut before = tip(from);
        for place in way.iter().map(over) {
            if (place.0 - before).norm() >= step_mm && (place.0 - tip(to)).norm() >= step_mm {
                before = place.0;
                places.push(place);
            }
        }
        Ok(places)
    }
}
