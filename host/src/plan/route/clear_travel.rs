//! Travel between two tilted passes, no farther away than the print requires.
//!
//! The head retreats along its axis, moves straight across while the axis turns, and descends along the
//! new axis. Retreat distances are tried from the lift on, doubling each time, until nozzle and head
//! stay clear of everything printed so far and of the table while they cross.
//!
//! In: the shape of nozzle and head, the passes printed so far (mm, rad, machine coordinates), the poses at
//! both ends, and a fallback travel. Out: the control points of the shortest clear travel; the fallback if
//! none is found in `LOOKS_MAX` checks. The print is the path of the tip with flow up to then. The legs
//! along the axes are as clear as the poses at their ends; the judge reports collisions there, and on a
//! travel that is not clear.

use crate::plan::route::moves::{PathCurve, tilt, tip};
use crate::settings::Settings;
use headway_firmware::kinematics::pose::tool_axis;
use headway_protocol::units::{CHANNEL_TILT_X, CHANNEL_TILT_Y, CHANNEL_X, CHANNELS};
use headway_reach::Pose;
use headway_reach::profile::HeadProfile;
use nalgebra::{Rotation2, Vector2, Vector3};

/// Most checks of a route's travels: about ten seconds of a processor with the largest number of
/// points.
const LOOKS_MAX: usize = 200_000;
/// Distance and turn between two checks.
const LOOK_MM: f64 = 0.5;
const LOOK_RAD: f64 = 0.05;
/// Most points of the print: with more, they are twice as far apart.
const POINTS_MAX: usize = 100_000;
/// Distance of the points at first.
const SPACING_MM: f64 = 0.5;
/// Points that are treated as one if they are far away.
const CHUNK: usize = 32;
/// Clearance during the move across, relative to the lift.
const MARGIN_SHARE: f64 = 0.5;
/// Longest turn between two control points of a travel, rad.
const TRAVEL_STEP_RAD: f64 = 0.1;
/// Tilt below which a tool is upright, rad.
pub const UPRIGHT_RAD: f64 = 1e-6;

type Point = [f64; CHANNELS];

/// A pose with its tip elsewhere.
pub fn moved_to(pose: &Point, tip_mm: Vector3<f64>) -> Point {
    let mut moved = *pose;
    moved[CHANNEL_X..CHANNEL_X + 3].copy_from_slice(tip_mm.as_slice());
    moved
}

/// Change of the direction of the tilt by the shorter turn, signed.
pub fn polar_turn_rad(from: Vector2<f64>, to: Vector2<f64>) -> f64 {
    if from.norm() < UPRIGHT_RAD || to.norm() < UPRIGHT_RAD {
        return 0.0;
    }
    from.perp(&to).atan2(from.dot(&to))
}

/// A tilt between two others that keeps away from the upright, where tables that turn have no place of
/// their own: its size and its direction both change evenly.
fn polar_between(from: Vector2<f64>, to: Vector2<f64>, share: f64) -> Vector2<f64> {
    let size = from.norm() + share * (to.norm() - from.norm());
    let base = if from.norm() < UPRIGHT_RAD { to } else { from };
    let Some(base) = base.try_normalize(0.0) else {
        return Vector2::zeros();
    };
    size * (Rotation2::new(share * polar_turn_rad(from, to)) * base)
}

/// Control points between two poses: all channels change linearly except the tilt, and the tip is at the
/// positions of `at`; `turn_rad` is the turn of the tip's path.
pub fn crossing(
    from: &Point,
    to: &Point,
    turn_rad: f64,
    at: impl Fn(f64) -> Vector3<f64>,
) -> Vec<Point> {
    let turn_rad = turn_rad.max(polar_turn_rad(tilt(from), tilt(to)).abs());
    let steps = (turn_rad / TRAVEL_STEP_RAD).ceil().max(1.0) as usize;
    let control = (0..=steps).map(|step| match step {
        0 => *from,
        last if last == steps => *to,
        step => {
            let share = step as f64 / steps as f64;
            let mut pose: Point = std::array::from_fn(|c| from[c] + share * (to[c] - from[c]));
            let tilt = polar_between(tilt(from), tilt(to), share);
            pose[CHANNEL_TILT_X] = tilt.x;
            pose[CHANNEL_TILT_Y] = tilt.y;
            moved_to(&pose, at(share))
        }
    });
    control.collect()
}

/// A travel: back, across, down.
pub type Legs = [Vec<Point>; 3];

fn way_mm(legs: &Legs) -> f64 {
    let steps = legs.iter().flat_map(|control| control.windows(2));
    steps
        .map(|step| (tip(&step[1]) - tip(&step[0])).norm())
        .sum()
}

/// The print so far, and the shape that must not touch it.
pub struct PrintedSoFar {
    head: HeadProfile,
    table_mm: f64,
    lift_mm: f64,
    /// Permitted depth in table and print.
    slack_mm: f64,
    spacing_mm: f64,
    points: Vec<Vector3<f64>>,
    /// Balls that hold the points, [`CHUNK`] each: centre and radius.
    balls: Vec<(Vector3<f64>, f64)>,
    looks_left: usize,
}

impl PrintedSoFar {
    /// Nothing yet; `None` if the head's shape is not known.
    pub fn nothing(settings: &Settings) -> Option<PrintedSoFar> {
        Some(PrintedSoFar {
            head: settings.head.as_ref()?.profile(),
            table_mm: settings.work_area_mm[0][2],
            lift_mm: settings.lift_mm,
            slack_mm: 0.5 * settings.layer_height_mm,
            spacing_mm: SPACING_MM,
            points: Vec::new(),
            balls: Vec::new(),
            looks_left: LOOKS_MAX,
        })
    }

    /// A curve that has been printed.
    pub fn add(&mut self, curve: &PathCurve) {
        let (before, mut is_thinned) = (self.points.len(), false);
        for (span, leg) in curve.control.windows(2).enumerate() {
            let way_mm = (tip(&leg[1]) - tip(&leg[0])).norm();
            let count = (way_mm / self.spacing_mm).ceil().max(1.0) as usize;
            for step in 0..count {
                let at = span as f64 + step as f64 / count as f64;
                let point = tip(&curve.evaluate(at).value);
                let is_near = self
                    .points
                    .last()
                    .is_some_and(|last| (point - last).norm() < 0.5 * self.spacing_mm);
                if !is_near {
                    self.points.push(point);
                }
            }
            if self.points.len() > POINTS_MAX {
                let every_second = self.points.iter().step_by(2).copied();
                self.points = every_second.collect();
                self.spacing_mm *= 2.0;
                is_thinned = true;
            }
        }
        // Full chunks stay as they are, unless the points were thinned.
        let kept = if is_thinned { 0 } else { before / CHUNK };
        self.balls.truncate(kept);
        let chunks = self.points[kept * CHUNK..].chunks(CHUNK);
        self.balls.extend(chunks.map(ball));
    }

    /// The travel from the end of a pass to the beginning of the next, back, across and down: `known` if
    /// that is clear and the shorter one, otherwise the shortest clear one that was tried. `extent_mm` is
    /// the extent of the job: the retreat is no farther than that plus the head itself.
    pub fn travel(&mut self, from: &Point, to: &Point, extent_mm: f64, known: Legs) -> Legs {
        let back_max_mm = extent_mm + self.head.reach_mm();
        let mut back_mm = self.lift_mm.max(1e-3 * back_max_mm);
        let mut found = None;
        while found.is_none() && back_mm < back_max_mm && self.looks_left > 0 {
            let [off, over] =
                [from, to].map(|pose| moved_to(pose, tip(pose) + back_mm * tool_axis(tilt(pose))));
            let across = crossing(&off, &over, 0.0, |share| tip(&off).lerp(&tip(&over), share));
            let legs = [vec![*from, off], across, vec![over, *to]];
            found = Some(legs).filter(|[_, across, _]| self.is_clear(across));
            back_mm *= 2.0;
        }
        match found {
            Some(near) if way_mm(&near) <= way_mm(&known) || !self.is_clear(&known[1]) => near,
            _ => known,
        }
    }

    /// True where nozzle and head keep off table and print all along a curve through control points.
    fn is_clear(&mut self, control: &[Point]) -> bool {
        let curve = &PathCurve {
            control: control.to_vec(),
        };
        for (span, leg) in curve.control.windows(2).enumerate() {
            let way_mm = (tip(&leg[1]) - tip(&leg[0])).norm();
            let turn_rad = (tilt(&leg[1]) - tilt(&leg[0])).norm();
            let looks = (way_mm / LOOK_MM).max(turn_rad / LOOK_RAD).ceil().max(1.0) as usize;
            if looks > self.looks_left {
                self.looks_left = 0;
                return false;
            }
            for look in 0..=looks {
                self.looks_left -= usize::from(look > 0);
                let at = span as f64 + look as f64 / looks as f64;
                if !self.keeps_off(&curve.evaluate(at).value) {
                    return false;
                }
            }
        }
        true
    }

    fn keeps_off(&self, pose: &Point) -> bool {
        let pose = Pose {
            tip_mm: tip(pose),
            axis: tool_axis(tilt(pose)),
        };
        if pose.tip_mm.z - self.head.below_tip_mm(&pose.axis) < self.table_mm - self.slack_mm {
            return false;
        }
        let margin_mm = MARGIN_SHARE * self.lift_mm + 0.5 * self.spacing_mm + 0.5 * LOOK_MM;
        let touches = |point: &Vector3<f64>, reach_mm: f64| {
            self.head.depth_mm(pose.seen(point)) + reach_mm > -margin_mm
        };
        let chunks = self.points.chunks(CHUNK).zip(&self.balls);
        let mut near = chunks.filter(|(_, (centre, radius_mm))| touches(centre, *radius_mm));
        !near.any(|(points, _)| points.iter().any(|point| touches(point, 0.0)))
    }
}

/// A ball that holds some points.
fn ball(points: &[Vector3<f64>]) -> (Vector3<f64>, f64) {
    let sum: Vector3<f64> = points.iter().sum();
    let centre = sum / points.len().max(1) as f64;
    let radii = points.iter().map(|point| (point - centre).norm());
    (centre, radii.fold(0.0, f64::max))
}
