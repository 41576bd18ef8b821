//! Time that a controller needs for motion blocks: a model, not a maker's planner.
//!
//! In: motions in their order and the limits of the robot. Out: seconds. The tip goes straight from pose to pose and
//! turns evenly on the way; the corner at a blended pose is an arc that touches both blocks. Speeds change with
//! constant acceleration, and the look-ahead sees all blocks (a forward and a backward pass). Source: the trapezoid and
//! the tangent arc of plane geometry. Not covered: jerk, joint limits of straight blocks, torque, the jump of the
//! turning speed from block to block, waits between motions, and the way to the first pose, whose start is unknown.
//! Poses of different frames are taken as if the frames were one.

use super::joints::{dot, product, transposed};
use super::{Motion, Target, Way};

/// Limits of a robot. All are positive; accelerations can be infinite.
#[derive(Clone, Debug, PartialEq)]
pub struct BlockLimits {
    /// Greatest speed of the tip, mm/s.
    pub tip_speed_mm_s: f64,
    /// Greatest acceleration of the tip along its way, and towards the centre of a blend, mm/s².
    pub tip_acceleration_mm_s2: f64,
    /// Greatest turning speed of the tool, degrees/s.
    pub turn_speed_deg_s: f64,
    /// Greatest turning acceleration of the tool, degrees/s².
    pub turn_acceleration_deg_s2: f64,
    /// Greatest speed of each joint, degrees/s.
    pub joint_speed_deg_s: Vec<f64>,
    /// Greatest acceleration of the joints, degrees/s².
    pub joint_acceleration_deg_s2: f64,
}

const LENGTH_MIN_MM: f64 = 1e-9;
const TURN_MIN_DEG: f64 = 1e-7;
/// A rotary axis turns the tool where its way and the tool's turn differ by less than this, degrees.
const AXIS_TOLERANCE_DEG: f64 = 1e-3;
/// Sharper corners are a way back, those blunter than the second angle go straight on, rad.
const WAY_BACK_RAD: f64 = 3.0;
const STRAIGHT_ON_RAD: f64 = 1e-6;

/// Time of the motions, s, from rest at the first target to rest at the last. A blend is cut to half of the shorter of
/// its blocks; the control points of a spline are rounded by that much, which is near to the spline of degree 2.
///
/// A motion of joints goes from rest to rest. Where the joint angles of both ends are known, each joint goes at most at
/// `share` of its greatest speed and at the motion's turning speed; where only the poses are known, the block is taken
/// as a straight one at `share` of the limits.
pub fn seconds(motions: &[Motion], limits: &BlockLimits) -> f64 {
    motion_seconds(motions, limits).iter().sum()
}

/// The same, of each motion; a blend belongs to both of its blocks by halves.
pub fn motion_seconds(motions: &[Motion], limits: &BlockLimits) -> Vec<f64> {
    let first = motions.first();
    let mut all_s = vec![0.0; motions.len()];
    if let Some(own_s) = all_s.first_mut() {
        *own_s = first.and_then(|motion| motion.seconds).unwrap_or(0.0);
    }
    let mut run: Vec<Block> = Vec::new();
    let mut places: Vec<usize> = Vec::new();
    let flush = |run: &mut Vec<Block>, places: &mut Vec<usize>, all_s: &mut [f64]| {
        let times_s = run_seconds(&std::mem::take(run), limits);
        for (place, own_s) in std::mem::take(places).into_iter().zip(times_s) {
            all_s[place] = own_s;
        }
    };
    for (index, pair) in motions.windows(2).enumerate() {
        let next_way = motions.get(index + 2).map(|next| next.way);
        let least_s = pair[1].seconds.unwrap_or(0.0);
        let stops_before = run.last().is_none_or(|block| block.blend_mm == 0.0);
        match Block::between(&pair[0], &pair[1], next_way, limits) {
            Some(block) if block.length_mm > 0.0 && pair[1].way != Way::Joints => {
                if stops_before {
                    flush(&mut run, &mut places, &mut all_s);
                }
                run.push(block);
                places.push(index + 1);
            }
            // A pose that is there twice does not stop a motion that goes through it.
            Some(block) if block.is_nothing() && pair[1].blend_mm > 0.0 => {}
            other => {
                flush(&mut run, &mut places, &mut all_s);
                let alone_s = match &other {
                    Some(block) => block.alone_seconds(limits),
                    None => joint_seconds(&pair[0], &pair[1], limits),
                };
                all_s[index + 1] = alone_s.max(least_s);
            }
        }
    }
    flush(&mut run, &mut places, &mut all_s);
    all_s
}

struct Block {
    direction: [f64; 3],
    length_mm: f64,
    turn_deg: f64,
    tip_speed_mm_s: f64,
    turn_speed_deg_s: f64,
    blend_mm: f64,
    least_s: f64,
}

impl Block {
    /// The block from one pose to the next, or none where either end is not a pose.
    fn between(
        from: &Motion,
        to: &Motion,
        next_way: Option<Way>,
        limits: &BlockLimits,
    ) -> Option<Self> {
        let (from_mm, from_turn) = pose(&from.target)?;
        let (to_mm, to_turn) = pose(&to.target)?;
        let way = [0, 1, 2].map(|k| to_mm[k] - from_mm[k]);
        let length_mm = dot(way, way).sqrt();
        let share = if to.way == Way::Joints { to.share } else { 1.0 };
        let is_spline = to.way == Way::Spline && next_way == Some(Way::Spline);
        let blends_all = is_spline && to.blend_mm > 0.0;
        Some(Self {
            direction: way.map(|part| part / length_mm.max(LENGTH_MIN_MM)),
            length_mm: Some(length_mm)
                .filter(|&mm| mm >= LENGTH_MIN_MM)
                .unwrap_or(0.0),
            turn_deg: turn_deg(from_turn, to_turn),
            tip_speed_mm_s: to.speed_mm_s.min(share * limits.tip_speed_mm_s),
            turn_speed_deg_s: to.turn_speed_deg_s.min(share * limits.turn_speed_deg_s),
            blend_mm: if blends_all {
                f64::INFINITY
            } else {
                to.blend_mm
            },
            least_s: to.seconds.unwrap_or(0.0),
        })
    }

    fn is_nothing(&self) -> bool {
        self.length_mm == 0.0 && self.turn_deg < TURN_MIN_DEG && self.least_s == 0.0
    }

    fn alone_seconds(&self, limits: &BlockLimits) -> f64 {
        if self.length_mm > 0.0 {
            return run_seconds(std::slice::from_ref(self), limits).iter().sum();
        }
        let turn_deg = Some(self.turn_deg)
            .filter(|&deg| deg >= TURN_MIN_DEG)
            .unwrap_or(0.0);
        let acceleration = limits.turn_acceleration_deg_s2;
        trapezoid_seconds(turn_deg, self.turn_speed_deg_s, acceleration, [0.0; 2])
    }

    /// A piece that is so long, with its part of the turn.
    fn piece(&self, length_mm: f64, turn_deg: f64, limits: &BlockLimits) -> Piece {
        let mut speed_mm_s = self.tip_speed_mm_s;
        let mut acceleration_mm_s2 = limits.tip_acceleration_mm_s2;
        if turn_deg > TURN_MIN_DEG && length_mm > 0.0 {
            let mm_per_deg = length_mm / turn_deg;
            speed_mm_s = speed_mm_s.min(self.turn_speed_deg_s * mm_per_deg);
            let turning_mm_s2 = limits.turn_acceleration_deg_s2 * mm_per_deg;
            acceleration_mm_s2 = acceleration_mm_s2.min(turning_mm_s2);
        }
        if self.least_s > 0.0 {
            speed_mm_s = speed_mm_s.min(self.length_mm / self.least_s);
        }
        Piece {
            length_mm,
            speed_mm_s,
            acceleration_mm_s2,
        }
    }
}

/// Times of blocks that are gone through without a stop, s, from rest to rest.
fn run_seconds(blocks: &[Block], limits: &BlockLimits) -> Vec<f64> {
    let pairs = blocks.windows(2);
    let corners: Vec<_> = pairs
        .map(|pair| corner(&pair[0], &pair[1], limits))
        .collect();
    let mut pieces: Vec<Piece> = Vec::new();
    let mut before_mm = 0.0;
    for (index, block) in blocks.iter().enumerate() {
        let after_mm = corners.get(index).map_or(0.0, |corner| corner.0);
        let length_mm = (block.length_mm - before_mm - after_mm).max(0.0);
        let turn_deg = block.turn_deg * length_mm / block.length_mm;
        pieces.push(block.piece(length_mm, turn_deg, limits));
        pieces.extend(corners.get(index).map(|corner| corner.1));
        before_mm = after_mm;
    }
    let times_s = piece_seconds(&pieces);
    let half_s = |piece: Option<usize>| {
        piece
            .and_then(|at| times_s.get(at))
            .map_or(0.0, |s| s / 2.0)
    };
    let seconds = blocks.iter().enumerate().map(|(index, block)| {
        let middle = 2 * index;
        let own_s = times_s[middle] + half_s(middle.checked_sub(1)) + half_s(Some(middle + 1));
        own_s.max(block.least_s)
    });
    seconds.collect()
}

/// The blend at a pose: from the corner to where the arc begins, mm, and the arc of radius d / tan(angle / 2), on which
/// the acceleration towards its centre stays within the limit of the tip.
fn corner(block: &Block, next: &Block, limits: &BlockLimits) -> (f64, Piece) {
    let [a, b] = [block.direction, next.direction];
    let cross = [(1, 2), (2, 0), (0, 1)].map(|(i, j)| a[i] * b[j] - a[j] * b[i]);
    let angle_rad = dot(cross, cross).sqrt().atan2(dot(a, b));
    let half_mm = block.length_mm.min(next.length_mm) / 2.0;
    // The way back is no blend: the tip goes to the corner and stops.
    let is_way_back = angle_rad > WAY_BACK_RAD;
    let distance_mm = if is_way_back {
        0.0
    } else {
        block.blend_mm.min(half_mm)
    };
    // Without an angle the radius is infinite, or not a number where there is no blend either.
    let radius_mm = distance_mm / (angle_rad / 2.0).tan();
    let (mut length_mm, mut arc_mm_s) = (2.0 * distance_mm, f64::INFINITY);
    if angle_rad > STRAIGHT_ON_RAD {
        length_mm = radius_mm * angle_rad;
        arc_mm_s = (limits.tip_acceleration_mm_s2 * radius_mm).sqrt();
    }
    let turns = [block, next].map(|block| block.turn_deg / block.length_mm);
    let turn_deg = distance_mm * (turns[0] + turns[1]);
    let mut piece = block.piece(length_mm, turn_deg, limits);
    let second_mm_s = next.piece(length_mm, turn_deg, limits).speed_mm_s;
    piece.speed_mm_s = piece.speed_mm_s.min(second_mm_s).min(arc_mm_s);
    (distance_mm, piece)
}

/// Time of a motion of joints from rest to rest, s, or 0 where its start is not known.
fn joint_seconds(from: &Motion, to: &Motion, limits: &BlockLimits) -> f64 {
    let (Target::Joints { degrees: from, .. }, Target::Joints { degrees, .. }) =
        (&from.target, &to.target)
    else {
        return 0.0;
    };
    let acceleration = limits.joint_acceleration_deg_s2;
    let joints = from.iter().zip(degrees).zip(&limits.joint_speed_deg_s);
    let seconds = joints.map(|((from, to_deg), speed)| {
        let speed = (to.share * speed).min(to.turn_speed_deg_s);
        trapezoid_seconds((to_deg - from).abs(), speed, acceleration, [0.0; 2])
    });
    seconds.fold(0.0, f64::max)
}

type Turn<'a> = (&'a [[f64; 3]; 3], &'a [f64]);

/// Tip, mm, and turn of a target that is a pose.
fn pose(target: &Target) -> Option<([f64; 3], Turn<'_>)> {
    match target {
        Target::Pose {
            tip_mm,
            rotation,
            external,
            ..
        } => Some((*tip_mm, (rotation, external))),
        Target::Joints { .. } => None,
    }
}

/// Turn from one rotation to another, degrees. Where the one external axis turns the tool, which is where both turns
/// are the same up to whole turns, it is the turn of that axis.
fn turn_deg((from, from_axes): Turn, (to, to_axes): Turn) -> f64 {
    // Of from^T * to: twice the cosine and, by the part that is not symmetric, twice the sine.
    let turn = product(&transposed(from), to);
    let cosine_2 = turn[0][0] + turn[1][1] + turn[2][2] - 1.0;
    let axis = [(2, 1), (0, 2), (1, 0)].map(|(i, j)| turn[i][j] - turn[j][i]);
    let turn_deg = dot(axis, axis).sqrt().atan2(cosine_2).to_degrees();
    let ([from], [to]) = (from_axes, to_axes) else {
        return turn_deg;
    };
    let axis_deg = (to - from).abs();
    let rest = axis_deg.rem_euclid(360.0);
    let is_turning_axis = (rest.min(360.0 - rest) - turn_deg).abs() < AXIS_TOLERANCE_DEG;
    if is_turning_axis { axis_deg } else { turn_deg }
}

/// A straight or an arc of the way, with its greatest speed and acceleration.
#[derive(Clone, Copy, Debug)]
struct Piece {
    length_mm: f64,
    speed_mm_s: f64,
    acceleration_mm_s2: f64,
}

/// Times of the pieces, s: the speed at each joint is the greatest from which the way on can be braked, and that the
/// way so far can reach.
fn piece_seconds(pieces: &[Piece]) -> Vec<f64> {
    let mut joints_mm_s = vec![0.0; pieces.len() + 1];
    for at in 1..pieces.len() {
        let before = pieces[at - 1];
        let reached = reachable(joints_mm_s[at - 1], &before);
        joints_mm_s[at] = reached.min(before.speed_mm_s).min(pieces[at].speed_mm_s);
    }
    for at in (1..pieces.len()).rev() {
        joints_mm_s[at] = f64::min(joints_mm_s[at], reachable(joints_mm_s[at + 1], &pieces[at]));
    }
    let ends = joints_mm_s.windows(2).map(|pair| [pair[0], pair[1]]);
    pieces
        .iter()
        .zip(ends)
        .map(|(piece, ends)| {
            trapezoid_seconds(
                piece.length_mm,
                piece.speed_mm_s,
                piece.acceleration_mm_s2,
                ends,
            )
        })
        .collect()
}

/// Speed at the other end of the piece, mm/s, where its acceleration is used all along.
fn reachable(speed_mm_s: f64, piece: &Piece) -> f64 {
    if piece.length_mm <= 0.0 {
        return speed_mm_s;
    }
    (speed_mm_s * speed_mm_s + 2.0 * piece.acceleration_mm_s2 * piece.length_mm).sqrt()
}

/// Time over a distance with a greatest speed and acceleration, from one speed to another. Any unit of distance will
/// do.
fn trapezoid_seconds(distance: f64, speed: f64, acceleration: f64, [start, end]: [f64; 2]) -> f64 {
    if distance <= 0.0 {
        return 0.0;
    }
    if acceleration.is_infinite() {
        return distance / speed;
    }
    let peak = ((start * start + end * end) / 2.0 + acceleration * distance).sqrt();
    let peak = peak.min(speed).max(start).max(end);
    let ramps = (2.0 * peak * peak - start * start - end * end) / (2.0 * acceleration);
    (2.0 * peak - start - end) / acceleration + (distance - ramps).max(0.0) / peak
}

#[cfg(test)]
mod tests {
    use super::super::joints::turn_z;
    use super::*;

    fn limits() -> BlockLimits {
        BlockLimits {
            tip_speed_mm_s: 1000.0,
            tip_acceleration_mm_s2: 1000.0,
            turn_speed_deg_s: 90.0,
            turn_acceleration_deg_s2: 180.0,
            joint_speed_deg_s: vec![90.0, 45.0],
            joint_acceleration_deg_s2: f64::INFINITY,
        }
    }

    /// Line to x, y at 100 mm/s, turned about z.
    fn line(x: f64, y: f64, turn_deg: f64, blend_mm: f64) -> Motion {
        let target = Target::Pose {
            tip_mm: [x, y, 0.0],
            rotation: turn_z(turn_deg.to_radians()).rotation,
            external: vec![turn_deg],
            configuration: None,
        };
        Motion {
            speed_mm_s: 100.0,
            blend_mm,
            ..Motion::new("", 0, target, Way::Line)
        }
    }

    fn assert_seconds(motions: &[Motion], expected_s: f64) {
        let read_s = seconds(motions, &limits());
        let is_near = (read_s - expected_s).abs() < 1e-9;
        assert!(is_near, "{read_s} s, not {expected_s} s");
    }

    /// Goal: an exact stop stops, and a blended corner does not. Method: two blocks of 100 mm with a corner of 90
    /// degrees. With the stop each takes 1.1 s. A blend of 10 mm has a radius of 10 mm and allows sqrt(1000 * 10) = 100
    /// mm/s: 90 + 5 pi + 90 mm at 100 mm/s and 0.1 s for the ramps. A blend of 2.5 mm allows 50 mm/s: twice 97.5 mm
    /// with ramps of 5 and 3.75 mm (0.1 and 0.05 s) and 88.75 mm at 100 mm/s, and 1.25 pi mm at 50 mm/s.
    #[test]
    fn corners() {
        let path = |blend_mm| {
            [
                line(0.0, 0.0, 0.0, 0.0),
                line(100.0, 0.0, 0.0, blend_mm),
                line(100.0, 100.0, 0.0, 0.0),
            ]
        };
        let pi = std::f64::consts::PI;
        assert_seconds(&path(0.0), 2.2);
        assert_seconds(&path(10.0), (180.0 + 5.0 * pi) / 100.0 + 0.1);
        assert_seconds(&path(2.5), 2.0 * (0.1 + 0.05 + 0.8875) + 1.25 * pi / 50.0);
    }

    /// Goal: the turn bounds a block by its speed and acceleration, also beyond half a turn. Method: 100 mm with 270
    /// degrees: 90 degrees/s with ramps of 0.5 s is 3 s and 0.5 s; the same turn without a way; and one of 9 degrees,
    /// which leaves the tip at 100 mm/s.
    #[test]
    fn turns() {
        for (x, turn_deg, expected_s) in
            [(100.0, 270.0, 3.5), (0.0, -270.0, 3.5), (100.0, 9.0, 1.1)]
        {
            let path = [line(0.0, 0.0, 0.0, 0.0), line(x, 0.0, turn_deg, 0.0)];
            assert_seconds(&path, expected_s);
        }
    }
}
