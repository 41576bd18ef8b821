//! Which directions a machine's joints permit, and where: by inverse kinematics, at some heading and with some solution.

use crate::settings::Settings;
use headway_firmware::kinematics::pose::{Pose, tilt_of_axis};
use headway_firmware::kinematics::{inverse, winds};
use headway_reach::Vector3;
use std::f64::consts::TAU;

/// Steps in which the largest tilt is sought, and directions at each.
const TILT_STEP_DEG: usize = 5;
const AZIMUTHS: u32 = 16;

pub(in crate::pipeline) struct Joints<'a> {
    settings: &'a Settings,
    /// Corners of the part's box, machine coordinates.
    box_mm: [Vector3; 2],
    headings: u32,
}

impl Joints<'_> {
    pub(in crate::pipeline) fn new(
        settings: &Settings,
        box_mm: [Vector3; 2],
        headings: u32,
    ) -> Joints<'_> {
        Joints {
            settings,
            box_mm,
            headings,
        }
    }

    /// Whether some joint positions within their ranges have the tip there; singular poses have none.
    pub(in crate::pipeline) fn permit(&self, tip_mm: Vector3, axis: &Vector3) -> bool {
        let machine = &self.settings.machine;
        let winds = winds(&machine.kinematics);
        let solutions = 0..machine.kinematics.solutions();
        let headings = || (0..self.headings).map(|n| TAU * f64::from(n) / f64::from(self.headings));
        let mut all = solutions.flat_map(|solution| headings().map(move |rad| (solution, rad)));
        all.any(|(solution, heading_rad)| {
            let tilt_rad = tilt_of_axis(axis);
            let pose = Pose {
                tip_mm,
                tilt_rad,
                heading_rad,
            };
            let Ok(joints) = inverse(&machine.kinematics.with_solution(solution), &pose) else {
                return false;
            };
            let all = machine.joints.iter().zip(joints.position).enumerate();
            all.into_iter().all(|(index, (joint, at))| {
                let range = joint.position_min..=joint.position_max;
                let turns = if winds >> index & 1 == 1 {
                    &[0.0, TAU, -TAU][..]
                } else {
                    &[0.0]
                };
                turns.iter().any(|turn| range.contains(&(at + turn)))
            })
        })
    }

    /// The largest tilt over the middle of the part, up to 90°.
    pub(in crate::pipeline) fn tilt_max_rad(&self) -> f64 {
        let middle_mm = 0.5 * (self.box_mm[0] + self.box_mm[1]);
        let tilts = (0..=90u8).step_by(TILT_STEP_DEG);
        let tilts = tilts.map(|deg| f64::from(deg).to_radians()).rev();
        let is_permitted = |tilt_rad: &f64| {
            (0..AZIMUTHS).any(|n| {
                let (sin, cos) = (TAU * f64::from(n) / f64::from(AZIMUTHS)).sin_cos();
                let out = tilt_rad.sin();
                self.permit(
                    middle_mm,
                    &Vector3::new(out * cos, out * sin, tilt_rad.cos()),
                )
            })
        };
        tilts.into_iter().find(is_permitted).unwrap_or(0.0)
    }

    /// By direction: whether it is permitted, where that is the same at 27 places of the box; elsewhere each pose is asked.
    pub(in crate::pipeline) fn permitted(&self, axes: &[Vector3]) -> Vec<Option<bool>> {
        let [low, high] = self.box_mm;
        let size = high - low;
        let places = (0..27u8).map(|n| [n % 3, n / 3 % 3, n / 9].map(|k| 0.5 * f64::from(k)));
        let places = places.map(|share| low + size.component_mul(&Vector3::from(share)));
        let places: Vec<Vector3> = places.collect();
        let of_axis = |axis: &Vector3| {
            let count = places
                .iter()
                .filter(|place| self.permit(**place, axis))
                .count();
            [(0, false), (places.len(), true)]
                .iter()
                .find(|(all, _)| *all == count)
                .map(|(_, is)| *is)
        };
        axes.iter().map(of_axis).collect()
    }
}
