//! `axes`: linear X Y Z and one or two rotary axes, each in the head or under the part, about any line, and the
//! nozzle's own rotation H about an axis that may have a fixed tilt.
//!
//! R_k is the rotation about the k-th axis, o_k a point on it with all joints at 0 (under the part in machine
//! coordinates, in the head relative to the nozzle's tip), axes of a side in order from the base outwards. With
//! T the product of the table's rotations, H of the head's and t the nozzle's axis with all joints at 0, a pose
//! with the tool axis n requires T n = H t. For every combination of axes that is R(u_1, a) R(u_2, b) v = w:
//!
//! | sides | u_1, a | u_2, b | v | w |
//! | --- | --- | --- | --- | --- |
//! | head, head | first | second | t | n |
//! | table, table | first | second | n | t |
//! | one of each | table's, its angle negated | head's | t | n |
//!
//! The vector z = R(u_2, b) v = R(u_1, -a) w has known components along u_1 and u_2 and two signs of its component
//! along u_1 x u_2: the two joint solutions (B. Paden, 1986, second subproblem; R. Murray, Z. Li and S. Sastry, A
//! Mathematical Introduction to Robotic Manipulation, 1994, 3.3.2). Each angle is then that between two vectors
//! about an axis. Tip: X Y Z = T_1(T_2(p)) - H_1(H_2(0)), each rotation about its own line. The nozzle makes the
//! rest of R_min R_z(heading). Gantry and trunnion are members of this family; they have equations of their own,
//! which are faster.
//!
//! Where z is along u_1 or u_2 an axis is free; with n along it (within a microradian) its angle is 0. A single
//! axis in the head reaches the cone of tool axes around it, which poses may leave by `CONE_SLACK`. A polar table
//! has no Y: its rotation brings the tip over the X axis, on either side of the centre. Not covered: more than
//! two rotary axes, parallel axes, nozzles that do not turn.

use super::KinematicsError;
use crate::configuration::JOINTS_MAX;
use crate::configuration::axis_family::{AxisFamily, RotaryAxis, UPRIGHT_MIN};
use crate::kinematics::pose::{Pose, TILT_REACH_RAD, tilt_of_axis, tool_axis};
use crate::numbers::real::Real;
use headway_protocol::units::{CHANNEL_HEADING, CHANNEL_X, CHANNEL_Y, CHANNEL_Z};
use nalgebra::{Vector2, Vector3};

/// Both axes in the head: X Y Z follow the tip except for the tilt's contribution.
pub const TWO_IN_HEAD: [Option<usize>; 6] = super::gantry::JOINT_CHANNELS;
/// An axis under the part: X Y Z follow the complete pose.
pub const TWO_WITH_TABLE: [Option<usize>; 6] =
    [None, None, None, None, None, Some(CHANNEL_HEADING)];
/// A single axis in the head.
pub const ONE_IN_HEAD: [Option<usize>; 5] = [
    Some(CHANNEL_X),
    Some(CHANNEL_Y),
    Some(CHANNEL_Z),
    None,
    Some(CHANNEL_HEADING),
];
/// A polar table: X C Z H, C in the place of Y.
pub const POLAR: [Option<usize>; 4] = [None, None, Some(CHANNEL_Z), Some(CHANNEL_HEADING)];

impl AxisFamily {
    /// See [`super::joint_channels`].
    pub const fn joint_channels(&self) -> &'static [Option<usize>] {
        if self.polar {
            &POLAR
        } else if self.second.is_none() {
            &ONE_IN_HEAD
        } else if self.is_in_head() {
            &TWO_IN_HEAD
        } else {
            &TWO_WITH_TABLE
        }
    }
}

/// Joints that count turns: both rotary ones and H,
pub const TWO_WIND: u8 = 0b11_1000;
/// the single one and H,
pub const ONE_WINDS: u8 = 0b1_1000;
/// C and H.
pub const POLAR_WINDS: u8 = 0b1010;

/// How far the tool axis may be off the cone of a single axis, as the cosine's difference: what a fit within
/// 0.1 mrad and the rounding of files leave.
const CONE_SLACK: f64 = 1e-3;
/// Square of the tool axis's component across the axis that turns with it, below which it counts as parallel: a
/// microradian, a unit of the wire, where that axis is Z and single precision has all digits there;
const ALONG_SQUARE: f64 = 1e-12;
/// within 1.8° elsewhere, where the pose is refused, as a gantry's is.
const BESIDE_SQUARE_MIN: f64 = 1e-3;

/// One rotary axis' numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Axis<R> {
    on_table: bool,
    along: Vector3<R>,
    offset_mm: Vector3<R>,
}

/// Axes with sine and cosine of their turns.
type Turned<R> = [Option<(Axis<R>, (R, R))>; 2];

impl<R: Real> Axis<R> {
    fn new(axis: &RotaryAxis) -> Self {
        Self {
            on_table: axis.on_table,
            along: vector(&axis.axis),
            offset_mm: vector(&axis.offset_mm),
        }
    }

    /// A vector turned by an angle: Rodrigues' formula.
    #[inline(never)]
    fn turn(&self, vector: Vector3<R>, (sine, cosine): (R, R)) -> Vector3<R> {
        let along = self.along;
        let share = dot(&along, &vector) * (R::of(1.0) - cosine);
        add(
            &add(
                &scaled(&vector, cosine),
                &scaled(&cross(&along, &vector), sine),
            ),
            &scaled(&along, share),
        )
    }

    /// A point turned about the axis' own line.
    fn turn_point(&self, point: Vector3<R>, turn: (R, R)) -> Vector3<R> {
        let from = subtract(&point, &self.offset_mm);
        add(&self.turn(from, turn), &self.offset_mm)
    }
}

/// The machine's numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axes<R> {
    first: Axis<R>,
    second: Option<Axis<R>>,
    /// The nozzle's axis with all joints at 0: is tilted from Z towards X.
    tool: Vector3<R>,
    polar: bool,
    /// The sign of z's share of u_1 x u_2 is negative; a polar table has the tip beyond its centre.
    other_side: bool,
}

fn vector<R: Real>(values: &[f64; 3]) -> Vector3<R> {
    Vector3::new(R::of(values[0]), R::of(values[1]), R::of(values[2]))
}

#[cfg_attr(target_os = "none", inline(never))]
fn dot<R: Real>(a: &Vector3<R>, b: &Vector3<R>) -> R {
    a.x * b.x + a.y * b.y + a.z * b.z
}

#[cfg_attr(target_os = "none", inline(never))]
fn cross<R: Real>(a: &Vector3<R>, b: &Vector3<R>) -> Vector3<R> {
    Vector3::new(
        a.y * b.z - a.z * b.y,
        a.z * b.x - a.x * b.z,
        a.x * b.y - a.y * b.x,
    )
}

#[cfg_attr(target_os = "none", inline(never))]
fn add<R: Real>(a: &Vector3<R>, b: &Vector3<R>) -> Vector3<R> {
    Vector3::new(a.x + b.x, a.y + b.y, a.z + b.z)
}

#[cfg_attr(target_os = "none", inline(never))]
fn subtract<R: Real>(a: &Vector3<R>, b: &Vector3<R>) -> Vector3<R> {
    Vector3::new(a.x - b.x, a.y - b.y, a.z - b.z)
}

#[cfg_attr(target_os = "none", inline(never))]
fn scaled<R: Real>(a: &Vector3<R>, by: R) -> Vector3<R> {
    Vector3::new(a.x * by, a.y * by, a.z * by)
}

/// What of a vector is across a unit axis.
#[inline(never)]
fn across<R: Real>(vector: &Vector3<R>, axis: &Vector3<R>) -> Vector3<R> {
    subtract(vector, &scaled(axis, dot(vector, axis)))
}

/// The angle about a unit axis from one vector to another; their parts along it do not matter.
#[inline(never)]
fn angle_about<R: Real>(axis: &Vector3<R>, from: &Vector3<R>, to: &Vector3<R>) -> R {
    let (from, to) = (across(from, axis), across(to, axis));
    dot(axis, &cross(&from, &to)).angle_from_x(dot(&from, &to))
}

impl<R: Real> Axes<R> {
    /// Of a machine; solution 0 has a positive share of u_1 x u_2, or X beyond the centre of a polar table.
    pub fn new(family: &AxisFamily, solution: u8) -> Self {
        Self {
            first: Axis::new(&family.first),
            second: family.second.as_ref().map(Axis::new),
            tool: vector(&family.tool_axis),
            polar: family.polar,
            other_side: solution & 1 != 0,
        }
    }

    /// What each joint adds to its joint channel, mm and rad.
    ///
    /// # Errors
    /// [`KinematicsError::TiltOutOfReach`] beyond 150° and where the axes do not reach,
    /// [`KinematicsError::Singular`] where both solutions meet, or on the centre of a polar table.
    #[inline(never)]
    pub fn remainder(&self, pose: &Pose<R>) -> Result<[R; JOINTS_MAX], KinematicsError> {
        let tilt = pose.tilt_rad;
        let square = tilt.x * tilt.x + tilt.y * tilt.y;
        // The comparison is written so that a NaN is refused too.
        let in_reach = square <= R::of(TILT_REACH_RAD * TILT_REACH_RAD);
        if !in_reach {
            return Err(KinematicsError::TiltOutOfReach);
        }
        if self.polar {
            return self.polar_remainder(pose);
        }
        let n = tool_axis(tilt);
        let angles = self.angles(&n)?;
        let turns = angles.map(Real::sine_cosine);
        let mut place = self.head_mm(turns);
        if !self.is_in_head() {
            place = subtract(&self.on_machine(pose.tip_mm, turns), &place);
        } else {
            place = scaled(&place, R::of(-1.0));
        }
        let nozzle_rad = self.nozzle_rad(&n, turns);
        let zero = R::of(0.0);
        Ok(match self.second {
            Some(_) => [
                place.x, place.y, place.z, angles[0], angles[1], nozzle_rad, zero,
            ],
            None => [place.x, place.y, place.z, angles[0], nozzle_rad, zero, zero],
        })
    }

    /// Pose of the joints.
    pub fn forward(&self, joints: &[R; JOINTS_MAX]) -> Pose<R> {
        if self.polar {
            return self.polar_forward(joints);
        }
        let [x, y, z, a, b, ..] = *joints;
        let (angles, nozzle_rad) = match self.second {
            Some(_) => ([a, b], joints[5]),
            None => ([a, R::of(0.0)], b),
        };
        let turns = angles.map(Real::sine_cosine);
        let back = angles.map(|angle| (-angle).sine_cosine());
        let tip = add(&Vector3::new(x, y, z), &self.head_mm(turns));
        let mut tip_mm = tip;
        let mut n = self.in_head(self.tool, turns);
        for (axis, back) in self.turned(back).into_iter().flatten() {
            if axis.on_table {
                tip_mm = axis.turn_point(tip_mm, back);
                n = axis.turn(n, back);
            }
        }
        Pose {
            tip_mm,
            tilt_rad: tilt_of_axis(&n),
            heading_rad: nozzle_rad - self.nozzle_rad(&n, turns),
        }
    }

    /// The axes from the base outwards, each with its turn's sine and cosine.
    fn turned(&self, turns: [(R, R); 2]) -> Turned<R> {
        let second = self.second.map(|second| (second, turns[1]));
        [Some((self.first, turns[0])), second]
    }

    fn is_in_head(&self) -> bool {
        !self.first.on_table && self.second.is_none_or(|second| !second.on_table)
    }

    /// Angles of the rotary axes.
    fn angles(&self, n: &Vector3<R>) -> Result<[R; 2], KinematicsError> {
        let Some(second) = self.second else {
            return self.single(n);
        };
        let (first, tool) = (self.first, self.tool);
        if first.on_table && second.on_table {
            return self.two_angles([first.along, second.along], n, &tool, true);
        }
        if first.on_table == second.on_table {
            return self.two_angles([first.along, second.along], &tool, n, false);
        }
        let [table, head] = if first.on_table {
            [first.along, second.along]
        } else {
            [second.along, first.along]
        };
        let [of_table, of_head] = self.two_angles([table, head], &tool, n, false)?;
        Ok(if first.on_table {
            [-of_table, of_head]
        } else {
            [of_head, -of_table]
        })
    }

    /// R(u_1, a) R(u_2, b) v = w. `moves_v`: the tool axis is v, otherwise w; its angle to its axis is taken from
    /// the part across it, which has all its digits near the axis.
    fn two_angles(
        &self,
        [first, second]: [Vector3<R>; 2],
        v: &Vector3<R>,
        w: &Vector3<R>,
        moves_v: bool,
    ) -> Result<[R; 2], KinematicsError> {
        let (k, p, q) = (dot(&first, &second), dot(&first, w), dot(&second, v));
        let normal = cross(&first, &second);
        let sine_square = dot(&normal, &normal);
        let (beside, off) = if moves_v {
            (across(v, &second), p - k * q)
        } else {
            (across(w, &first), q - k * p)
        };
        let beside_square = dot(&beside, &beside);
        let zero = R::of(0.0);
        let along_z = if moves_v { second.z } else { first.z };
        if along_z.magnitude() < R::of(UPRIGHT_MIN) {
            // Written so that a NaN is refused too.
            let clear = beside_square >= R::of(BESIDE_SQUARE_MIN);
            if !clear {
                return Err(KinematicsError::Singular);
            }
        } else if beside_square <= R::of(ALONG_SQUARE) {
            // The tool axis is along the axis that turns with it: this one stays at 0.
            if off.magnitude() > R::of(CONE_SLACK) {
                return Err(KinematicsError::TiltOutOfReach);
            }
            return Ok(if moves_v {
                [angle_about(&first, v, w), zero]
            } else {
                [zero, angle_about(&second, v, w)]
            });
        }
        let room = beside_square * sine_square - off * off;
        // Written so that a NaN is refused too.
        let reaches = room > R::of(1e-6) * beside_square;
        if !reaches {
            let beyond = room < R::of(-1e-6);
            return Err(if beyond {
                KinematicsError::TiltOutOfReach
            } else {
                KinematicsError::Singular
            });
        }
        let mut share = room.root() / sine_square;
        if self.other_side {
            share = -share;
        }
        let along_first = (p - k * q) / sine_square;
        let along_second = (q - k * p) / sine_square;
        let z = add(
            &add(&scaled(&first, along_first), &scaled(&second, along_second)),
            &scaled(&normal, share),
        );
        Ok([angle_about(&first, &z, w), angle_about(&second, v, &z)])
    }

    /// A single axis in the head: from the nozzle's axis to the pose's.
    fn single(&self, n: &Vector3<R>) -> Result<[R; 2], KinematicsError> {
        let along = self.first.along;
        let off = dot(&along, n) - dot(&along, &self.tool);
        // Written so that a NaN is refused too.
        let on_cone = off.magnitude() <= R::of(CONE_SLACK);
        if !on_cone {
            return Err(KinematicsError::TiltOutOfReach);
        }
        Ok([angle_about(&along, &self.tool, n), R::of(0.0)])
    }

    /// Where the tip is for X Y Z at 0.
    fn head_mm(&self, turns: [(R, R); 2]) -> Vector3<R> {
        let zero = R::of(0.0);
        let mut place = Vector3::new(zero, zero, zero);
        for (axis, turn) in self.turned(turns).into_iter().rev().flatten() {
            if !axis.on_table {
                place = axis.turn_point(place, turn);
            }
        }
        place
    }

    /// A vector of the head, turned with it.
    fn in_head(&self, mut vector: Vector3<R>, turns: [(R, R); 2]) -> Vector3<R> {
        for (axis, turn) in self.turned(turns).into_iter().rev().flatten() {
            if !axis.on_table {
                vector = axis.turn(vector, turn);
            }
        }
        vector
    }

    /// A point of the part in machine coordinates.
    fn on_machine(&self, mut point: Vector3<R>, turns: [(R, R); 2]) -> Vector3<R> {
        for (axis, turn) in self.turned(turns).into_iter().rev().flatten() {
            if axis.on_table {
                point = axis.turn_point(point, turn);
            }
        }
        point
    }

    /// What the nozzle turns beyond the heading: R_min's X axis, brought to the nozzle's own.
    fn nozzle_rad(&self, n: &Vector3<R>, turns: [(R, R); 2]) -> R {
        let one = R::of(1.0);
        let per = n.x / (one + n.z);
        let mut ahead = Vector3::new(one - per * n.x, -(per * n.y), -n.x);
        let back = turns.map(|(sine, cosine)| (-sine, cosine));
        for (axis, turn) in self.turned(turns).into_iter().rev().flatten() {
            if axis.on_table {
                ahead = axis.turn(ahead, turn);
            }
        }
        for (axis, back) in self.turned(back).into_iter().flatten() {
            if !axis.on_table {
                ahead = axis.turn(ahead, back);
            }
        }
        ahead
            .y
            .angle_from_x(self.tool.z * ahead.x - self.tool.x * ahead.z)
    }

    fn polar_remainder(&self, pose: &Pose<R>) -> Result<[R; JOINTS_MAX], KinematicsError> {
        let (tilt, centre) = (pose.tilt_rad, self.first.offset_mm);
        let upright = tilt.x * tilt.x + tilt.y * tilt.y <= R::of(CONE_SLACK * CONE_SLACK);
        if !upright {
            return Err(KinematicsError::TiltOutOfReach);
        }
        let from = Vector2::new(pose.tip_mm.x - centre.x, pose.tip_mm.y - centre.y);
        let square = from.x * from.x + from.y * from.y;
        let clear = square > R::of(POLAR_LEAST_MM * POLAR_LEAST_MM);
        if !clear {
            return Err(KinematicsError::Singular);
        }
        let radius = square.root();
        let (radius, [x, y]) = if self.other_side {
            (-radius, [-from.x, -from.y])
        } else {
            (radius, [from.x, from.y])
        };
        // The table turns the tip's direction back to X.
        let c = -(y.angle_from_x(x));
        let zero = R::of(0.0);
        Ok([centre.x + radius, c, zero, c, zero, zero, zero])
    }

    fn polar_forward(&self, joints: &[R; JOINTS_MAX]) -> Pose<R> {
        let [x, c, z, h, ..] = *joints;
        let centre = self.first.offset_mm;
        let (sine, cosine) = c.sine_cosine();
        let radius = x - centre.x;
        let zero = R::of(0.0);
        Pose {
            tip_mm: Vector3::new(centre.x + radius * cosine, centre.y - radius * sine, z),
            tilt_rad: Vector2::new(zero, zero),
            heading_rad: h - c,
        }
    }
}

/// Least distance of the tip from the centre of a polar table, mm: at the centre its direction is
/// undefined.
const POLAR_LEAST_MM: f64 = 1e-3;

#[cfg(test)]
#[path = "axes_tests.rs"]
mod tests;
