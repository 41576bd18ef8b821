//! A box that an upright tool works in -> the joint solution that reaches all of it, and the wrist's stops as headings.
//!
//! Outlines, meshes and a slicer's beads are planned before their headings are known, so an arm is asked before: at places
//! of an even grid in the box, each at all headings. A wrist that turns the nozzle about its axis stands at its angle d for
//! the heading 0, which the place decides, plus or minus the heading: with d between two bounds all over the box, the
//! wrist's range is one of headings. In: the box (mm, machine coordinates), the pose in which the job begins. Out: the
//! settings with the solution, and what the joints turn on the way through the box. Not covered: tilted tools; what lies
//! between the places, which the check of the route's joints refuses.

use crate::job::MotionState;
use crate::plan::motion::joint_limits::{MotionLimits, check_range, tip_mm};
use crate::plan::motion::motion_error::{MotionError, bad_limit, no_pose};
use crate::settings::{Settings, WristStops};
use headway_firmware::configuration::JOINTS_MAX;
use headway_firmware::kinematics::inverse;
use headway_firmware::kinematics::pose::Pose;
use headway_firmware::kinematics::winding::Winding;
use headway_protocol::units::{CHANNEL_HEADING, CHANNELS};
use std::f64::consts::TAU;

/// Places along x, y and z.
const PLACES: [usize; 3] = [7, 7, 2];
/// Headings of a turn at each place.
const HEADINGS: usize = 8;
/// By how much the wrist may differ from a whole turn after a turn of the nozzle, rad.
const TURN_RAD: f64 = 1e-3;
/// Solutions whose wrists turn as far but for this are equal, rad.
const SAME_RAD: f64 = 0.2;
/// Steps from a place to the next, and from heading to heading.
const STEPS: usize = 4;

/// What an arm does in a box.
#[derive(Clone, Debug)]
pub struct BoxReach {
    /// The settings in the best joint solution, with the wrist's stops.
    pub settings: Settings,
    /// Time of its joints on the way through the places, s.
    pub seconds: f64,
    /// How far the nozzle may turn, rad.
    pub turn_rad: f64,
}

/// The best joint solution for a box, from a pose at rest on.
///
/// # Errors
/// [`MotionError`] of the solution that reaches most places.
pub fn box_reach(
    box_mm: [[f64; 3]; 2],
    start: &[f64; CHANNELS],
    settings: &Settings,
) -> Result<BoxReach, MotionError> {
    let kinematics = settings.machine.kinematics;
    let mut best: Option<BoxReach> = None;
    let mut furthest: Option<(usize, MotionError)> = None;
    for solution in 0..kinematics.solutions() {
        let mut with_it = settings.clone();
        with_it.machine.kinematics = kinematics.with_solution(solution);
        match in_solution(box_mm, start, with_it) {
            Ok(reach) => {
                let is_better = best.as_ref().is_none_or(|best| {
                    let gained_rad = reach.turn_rad - best.turn_rad;
                    gained_rad > SAME_RAD || gained_rad > -SAME_RAD && reach.seconds < best.seconds
                });
                if is_better {
                    best = Some(reach);
                }
            }
            Err((places, error)) => {
                if furthest.as_ref().is_none_or(|(most, _)| places > *most) {
                    furthest = Some((places, error));
                }
            }
        }
    }
    match (best, furthest) {
        (Some(best), _) => Ok(best),
        (None, Some((_, error))) => Err(error),
        (None, None) => Err(bad_limit("number of joint solutions")),
    }
}

/// In the settings' solution; the error with the number of places before it.
fn in_solution(
    box_mm: [[f64; 3]; 2],
    start: &[f64; CHANNELS],
    settings: Settings,
) -> Result<BoxReach, (usize, MotionError)> {
    let at = |number: usize| move |error| (number, error);
    let mut walk = Walk::from(start, &settings).map_err(at(0))?;
    if let Some(number) = settings.wrist_number() {
        walk.find_sense(number).map_err(at(0))?;
    }
    let mut seconds = 0.0;
    for (number, tip) in places(box_mm).enumerate() {
        let mut pose = *start;
        pose[..tip.len()].copy_from_slice(&tip);
        let before = walk.position;
        walk.to(&pose).map_err(at(number))?;
        if number > 0 {
            seconds += walk.seconds_from(&before);
        }
        if walk.wrist.is_some() {
            // There and back, so that the next place is entered at the job's first heading again.
            for heading in (1..=HEADINGS).chain((0..HEADINGS).rev()) {
                let turn_rad = TAU * heading as f64 / HEADINGS as f64;
                pose[CHANNEL_HEADING] = start[CHANNEL_HEADING] + turn_rad;
                walk.to(&pose).map_err(at(number))?;
            }
        }
    }
    let stops = walk.stops();
    let turn_rad = stops.map_or(f64::INFINITY, |[low, high]| high - low);
    let wrist = stops.map(|headings_rad| WristStops { headings_rad });
    Ok(BoxReach {
        settings: Settings {
            wrist: wrist.filter(|_| turn_rad > settings.aperture.period_rad()),
            ..settings
        },
        seconds,
        turn_rad,
    })
}

/// The places of a box, each beside the one before it.
fn places([low, high]: [[f64; 3]; 2]) -> impl Iterator<Item = [f64; 3]> {
    let [nx, ny, nz] = PLACES;
    let along = move |axis: usize, number: usize| {
        low[axis] + (high[axis] - low[axis]) * number as f64 / (PLACES[axis] - 1) as f64
    };
    let there_and_back = |number: usize, count: usize| match (number / count) % 2 {
        0 => number % count,
        _ => count - 1 - number % count,
    };
    (0..nx * ny * nz).map(move |number| {
        [
            along(0, there_and_back(number, nx)),
            along(1, there_and_back(number / nx, ny)),
            along(2, number / (nx * ny)),
        ]
    })
}

/// A wrist that turns the nozzle one to one.
#[derive(Clone, Copy, Debug)]
struct Wrist {
    number: usize,
    /// 1 or -1: by it times the heading.
    sense: f64,
    /// Least and greatest angle at the heading 0, rad.
    away_rad: [f64; 2],
}

/// The joints on their way from place to place.
struct Walk {
    settings: Settings,
    limits: MotionLimits,
    winding: Winding<f64>,
    position: [f64; JOINTS_MAX],
    at: [f64; CHANNELS],
    wrist: Option<Wrist>,
}

impl Walk {
    fn from(start: &[f64; CHANNELS], settings: &Settings) -> Result<Walk, MotionError> {
        let machine = &settings.machine;
        let position = joints_at(start, settings)?;
        let mut walk = Walk {
            settings: settings.clone(),
            limits: MotionLimits::of(settings, MotionState::Travel)?,
            winding: Winding::at_rest(&machine.kinematics, &position, &machine.ranges()),
            position,
            at: *start,
            wrist: None,
        };
        let kinematics = machine.kinematics;
        walk.winding.unwound(&kinematics, &mut walk.position);
        Ok(walk)
    }

    /// Whether a joint turns as the nozzle does, and in which sense.
    fn find_sense(&mut self, number: usize) -> Result<(), MotionError> {
        let [min, max] = {
            let joint = &mut self.limits.joints[number];
            let range = [joint.position_min, joint.position_max];
            (joint.position_min, joint.position_max) = (f64::NEG_INFINITY, f64::INFINITY);
            range
        };
        let (before, start) = (self.position[number], self.at);
        for heading in 1..=HEADINGS {
            let mut pose = start;
            pose[CHANNEL_HEADING] += TAU * heading as f64 / HEADINGS as f64;
            self.to(&pose)?;
        }
        let turned_rad = self.position[number] - before;
        for heading in (0..HEADINGS).rev() {
            let mut pose = start;
            pose[CHANNEL_HEADING] += TAU * heading as f64 / HEADINGS as f64;
            self.to(&pose)?;
        }
        if (turned_rad.abs() - TAU).abs() < TURN_RAD {
            let sense = turned_rad.signum();
            let away_rad = before - sense * start[CHANNEL_HEADING];
            self.wrist = Some(Wrist {
                number,
                sense,
                away_rad: [away_rad; 2],
            });
        } else {
            let joint = &mut self.limits.joints[number];
            (joint.position_min, joint.position_max) = (min, max);
        }
        Ok(())
    }

    /// Straight to a pose, in steps.
    fn to(&mut self, pose: &[f64; CHANNELS]) -> Result<(), MotionError> {
        let from = self.at;
        for step in 1..=STEPS {
            let share = step as f64 / STEPS as f64;
            let here = std::array::from_fn(|c| from[c] + share * (pose[c] - from[c]));
            let mut position = joints_at(&here, &self.settings)?;
            let kinematics = &self.settings.machine.kinematics;
            self.winding.unwound(kinematics, &mut position);
            check_range(&self.limits, tip_mm(&here), &position)?;
            if let Some(wrist) = &mut self.wrist {
                let away = position[wrist.number] - wrist.sense * here[CHANNEL_HEADING];
                let [least, most] = wrist.away_rad;
                wrist.away_rad = [least.min(away), most.max(away)];
            }
            self.position = position;
        }
        self.at = *pose;
        Ok(())
    }

    /// Time of the joints from other positions, s.
    fn seconds_from(&self, before: &[f64; JOINTS_MAX]) -> f64 {
        let ways = self.position.iter().zip(before);
        let of_joints = ways.zip(&self.limits.joints);
        of_joints
            .map(|((to, from), limit)| (to - from).abs() / limit.speed_max)
            .fold(0.0, f64::max)
    }

    /// The wrist's range as headings, rad; `None` where it does not turn the nozzle.
    fn stops(&self) -> Option<[f64; 2]> {
        let wrist = self.wrist.as_ref()?;
        let joint = self.settings.machine.joints.get(wrist.number)?;
        let [least, most] = wrist.away_rad;
        let [low, high] = [joint.position_min - least, joint.position_max - most];
        Some(match wrist.sense > 0.0 {
            true => [low, high],
            false => [-high, -low],
        })
    }
}

fn joints_at(
    pose: &[f64; CHANNELS],
    settings: &Settings,
) -> Result<[f64; JOINTS_MAX], MotionError> {
    let joints = inverse(&settings.machine.kinematics, &Pose::from_channels(pose));
    let joints = joints.map_err(|error| no_pose(error, tip_mm(pose)))?;
    Ok(joints.position)
}
