//! Joint angles of a six-axis arm at a pose whose joint solution is named as RAPID or KRL names it.
//!
//! In: the arm's lengths, a pose of the tip, a [`Configuration`] and the axes' ranges. Out: the six angles in degrees.
//! Arms have an ortho-parallel base and a spherical wrist, with the lengths and angles of Brandstötter, Angerer and
//! Hofbaur, "An analytical solution of the inverse kinematics problem of industrial serial manipulators with an
//! ortho-parallel basis and a spherical wrist" (2014); the eight solutions are derived here from the arm's plane. cf1,
//! cf4, cf6, cfx are those of confdata after ABB's "RAPID Instructions, Functions and Data types" (3HAC050917), S and T
//! those of "KUKA System Software 8.3, Operating and Programming Instructions for System Integrators" and of STAT in
//! Siemens' "SINUMERIK ONE, NC programming", which has the same bits; ABB's and KUKA's not held against the manuals'
//! own text. Not covered: arms whose axis 3 is coupled to axis 2, a wrist whose axes 4 and 6 are in line (refused).

use super::Configuration;

/// This near to the border of a quadrant or to a change of sign both sides count, degrees.
const BORDER_DEG: f64 = 0.01;
/// The same for the wrist centre over axis 1, mm.
const BORDER_MM: f64 = 1e-3;
/// Angles closer than this are the same, degrees.
const SAME_DEG: f64 = 1e-6;
/// Bits of S: three that name the solution, and bit 4, which says how the point was taught.
const STATUS_BITS: u32 = 0b1_0111;
/// Sine of axis 5 below which axes 4 and 6 are in line.
const IN_LINE: f64 = 1e-9;

/// An arm, its tool and where its programs' frame is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ArmGeometry {
    /// From axis 1 forward to axis 2, mm.
    pub a1_mm: f64,
    /// From axis 3 forward to axis 4 with the arm upright, mm.
    pub a2_mm: f64,
    /// From axis 1 sideways (to its left) to the plane of the arm, mm.
    pub b_mm: f64,
    /// Height of axis 2, mm.
    pub c1_mm: f64,
    /// From axis 2 to axis 3, mm.
    pub c2_mm: f64,
    /// From axis 3 to the wrist centre along axis 4, mm.
    pub c3_mm: f64,
    /// From the wrist centre to the flange, mm.
    pub c4_mm: f64,
    /// Added to the angles of the model, where all is upright at 0; degrees.
    pub offsets_deg: [f64; 6],
    /// Axes that count the other way round (after the offset).
    pub reversed: [bool; 6],
    /// The tool in the flange's axes.
    pub tool: Frame,
    /// The work object or base of the program in the arm's root axes.
    pub base: Frame,
}

/// The joint angles, degrees, at which the tip is at a pose of the program's frame, in the solution that is named.
///
/// Refused when no angles within the ranges match, or more than one set does.
pub fn joints_of(
    arm: &ArmGeometry,
    tip_mm: [f64; 3],
    rotation: [[f64; 3]; 3],
    configuration: &Configuration,
    ranges_deg: &[[f64; 2]; 6],
) -> Result<[f64; 6], String> {
    let tip = Frame {
        rotation,
        origin_mm: tip_mm,
    };
    let flange = chain(&chain(&arm.base, &tip), &inverse(&arm.tool));
    let (solutions, singular) = solutions(arm, &flange);
    let mut found: Vec<[f64; 6]> = Vec::new();
    for solution in &solutions {
        for joints in with_turns(&joints_of_model(arm, solution), ranges_deg) {
            let same = |other: &[f64; 6]| (0..6).all(|i| (other[i] - joints[i]).abs() < SAME_DEG);
            let known = found.iter().any(same);
            if !known && is_named(arm, &joints, configuration) {
                found.push(joints);
            }
        }
    }
    match found.as_slice() {
        [joints] => Ok(*joints),
        [] if singular => Err("axes 4 and 6 are in line".into()),
        [] if solutions.is_empty() => Err("the pose is out of reach".into()),
        all => Err(format!(
            "{} sets of joint angles match {configuration:?}",
            all.len()
        )),
    }
}

/// Where the tip is at joint angles (degrees), in the program's frame.
pub fn tip_of(arm: &ArmGeometry, joints_deg: &[f64; 6]) -> Frame {
    let [t1, t2, t3, t4, t5, t6] = model_of_joints(arm, joints_deg);
    let steps = [
        shift([0.0, 0.0, arm.c1_mm]),
        turn_z(t1),
        shift([arm.a1_mm, arm.b_mm, 0.0]),
        turn_y(t2),
        shift([0.0, 0.0, arm.c2_mm]),
        turn_y(t3),
        shift([arm.a2_mm, 0.0, arm.c3_mm]),
        turn_z(t4),
        turn_y(t5),
        turn_z(t6),
        shift([0.0, 0.0, arm.c4_mm]),
        arm.tool,
    ];
    let start = inverse(&arm.base);
    steps.iter().fold(start, |frame, step| chain(&frame, step))
}

/// Whether a configuration is the one of these joint angles (degrees), or the neighbour where they are on a border.
pub fn is_named(arm: &ArmGeometry, joints_deg: &[f64; 6], configuration: &Configuration) -> bool {
    let [_, t2, t3, ..] = model_of_joints(arm, joints_deg);
    // Bend of the elbow: 0 with the wrist centre on the line through axes 2 and 3, positive with it in front.
    let bend = t3 + arm.a2_mm.atan2(arm.c3_mm);
    let forearm_mm = arm.a2_mm.hypot(arm.c3_mm);
    let ahead_mm = arm.a1_mm + arm.c2_mm * t2.sin() + forearm_mm * (t2 + bend).sin();
    let bend_deg = wrapped_deg(bend.to_degrees());
    let axis_5_deg = wrapped_deg(joints_deg[4]);
    match *configuration {
        Configuration::Quadrants { cf, cfx } => {
            let mut quadrants = [0, 3, 5].into_iter().zip(cf);
            (0..8).contains(&cfx)
                && has_sign(ahead_mm, cfx & 4 != 0, BORDER_MM)
                && has_sign(bend_deg, cfx & 2 != 0, BORDER_DEG)
                && has_sign(axis_5_deg, cfx & 1 != 0, BORDER_DEG)
                && quadrants.all(|(axis, cf)| in_quadrant(joints_deg[axis], cf))
        }
        Configuration::StatusTurn { status, turn } => {
            // Bit 1 is set from the straight elbow on upwards, in the sense in which the controller counts axis 3.
            let above_deg = if arm.reversed[2] { -bend_deg } else { bend_deg };
            let negative = |axis: usize| turn >> axis & 1 == 1;
            status & !STATUS_BITS == 0
                && turn < 64
                && has_sign(ahead_mm, status & 1 != 0, BORDER_MM)
                && has_sign(above_deg, status & 2 == 0, BORDER_DEG)
                && has_sign(axis_5_deg, status & 4 != 0, BORDER_DEG)
                && (0..6).all(|axis| has_sign(joints_deg[axis], negative(axis), BORDER_DEG))
        }
    }
}

/// Whether a value is negative (or not), within a tolerance about 0.
fn has_sign(value: f64, negative: bool, border: f64) -> bool {
    value.abs() <= border || (value < 0.0) == negative
}

/// Quadrant 0 is 0 to 90 degrees, 1 to 180, -1 from 0 down to -90, and so on.
fn in_quadrant(angle_deg: f64, quadrant: i32) -> bool {
    let low_deg = 90.0 * f64::from(quadrant);
    (low_deg - BORDER_DEG..=low_deg + 90.0 + BORDER_DEG).contains(&angle_deg)
}

/// The angles of the model, radians, that bring the flange to a place, and whether some were left out at a singular
/// wrist.
fn solutions(arm: &ArmGeometry, flange: &Frame) -> (Vec<[f64; 6]>, bool) {
    let axis = flange.rotation.map(|row| row[2]);
    let wrist_mm: [f64; 3] = std::array::from_fn(|i| flange.origin_mm[i] - arm.c4_mm * axis[i]);
    let mut found = Vec::new();
    let mut singular = false;
    for [t1, t2, t3] in arm_angles(arm, wrist_mm) {
        let forearm = chain(&turn_z(t1), &turn_y(t2 + t3)).rotation;
        let m = product(&transposed(&forearm), &flange.rotation);
        let sine = m[0][2].hypot(m[1][2]);
        if sine < IN_LINE {
            singular = true;
            continue;
        }
        let t4 = m[1][2].atan2(m[0][2]);
        let t5 = sine.atan2(m[2][2]);
        let t6 = m[2][1].atan2(-m[2][0]);
        let half_turn = std::f64::consts::PI;
        found.push([t1, t2, t3, t4, t5, t6]);
        found.push([t1, t2, t3, t4 + half_turn, -t5, t6 + half_turn]);
    }
    (found, singular)
}

/// Angles of axes 1 to 3 of the model, radians, for a wrist centre: towards it or away from it, elbow bent to either
/// side.
///
/// Seen along axis 2 the arm is two links in a plane that turns with axis 1, `b` beside it. The wrist centre's distance
/// from axis 1 gives where it is in that plane, the law of cosines the bend between the links, and the direction of the
/// two links together the angle of the first one.
fn arm_angles(arm: &ArmGeometry, [x, y, z]: [f64; 3]) -> Vec<[f64; 3]> {
    let ahead_squared = x * x + y * y - arm.b_mm * arm.b_mm;
    if ahead_squared < 0.0 {
        return Vec::new();
    }
    let forearm_mm = arm.a2_mm.hypot(arm.c3_mm);
    let kink = arm.a2_mm.atan2(arm.c3_mm);
    let mut angles = Vec::new();
    for ahead_mm in [ahead_squared.sqrt(), -ahead_squared.sqrt()] {
        let t1 = y.atan2(x) - arm.b_mm.atan2(ahead_mm);
        let (forward, up) = (ahead_mm - arm.a1_mm, z - arm.c1_mm);
        let squares = forward * forward + up * up - arm.c2_mm * arm.c2_mm - forearm_mm * forearm_mm;
        let cosine = squares / (2.0 * arm.c2_mm * forearm_mm);
        if cosine.abs() > 1.0 + 1e-12 {
            continue;
        }
        let bend = cosine.clamp(-1.0, 1.0).acos();
        for bend in [bend, -bend] {
            let lead = (forearm_mm * bend.sin()).atan2(arm.c2_mm + forearm_mm * bend.cos());
            angles.push([t1, forward.atan2(up) - lead, bend - kink]);
        }
    }
    angles
}

/// Joint angles (degrees) with every number of whole turns that the ranges allow.
fn with_turns(joints_deg: &[f64; 6], ranges_deg: &[[f64; 2]; 6]) -> Vec<[f64; 6]> {
    let mut sets = vec![*joints_deg];
    for (axis, &[low_deg, high_deg]) in ranges_deg.iter().enumerate() {
        let first = ((low_deg - SAME_DEG - joints_deg[axis]) / 360.0).ceil() as i32;
        let last = ((high_deg + SAME_DEG - joints_deg[axis]) / 360.0).floor() as i32;
        let turned = |set: [f64; 6]| {
            (first..=last).map(move |turns| {
                let mut set = set;
                set[axis] += 360.0 * f64::from(turns);
                set
            })
        };
        sets = sets.into_iter().flat_map(turned).collect();
    }
    sets
}

/// Angles of the controller, degrees, of the model's, radians.
fn joints_of_model(arm: &ArmGeometry, model: &[f64; 6]) -> [f64; 6] {
    let sign = |axis: usize| if arm.reversed[axis] { -1.0 } else { 1.0 };
    std::array::from_fn(|axis| sign(axis) * (model[axis].to_degrees() + arm.offsets_deg[axis]))
}

/// Angles of the model, radians, of the controller's, degrees.
fn model_of_joints(arm: &ArmGeometry, joints_deg: &[f64; 6]) -> [f64; 6] {
    let sign = |axis: usize| if arm.reversed[axis] { -1.0 } else { 1.0 };
    std::array::from_fn(|axis| (sign(axis) * joints_deg[axis] - arm.offsets_deg[axis]).to_radians())
}

/// The same direction from -180 to below 180 degrees.
fn wrapped_deg(angle_deg: f64) -> f64 {
    (angle_deg + 180.0).rem_euclid(360.0) - 180.0
}

/// A frame seen from another one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Rows of the rotation from the frame's axes to the other's.
    pub rotation: [[f64; 3]; 3],
    /// Origin in the other frame, mm.
    pub origin_mm: [f64; 3],
}

/// A frame seen through another one.
pub(super) fn chain(outer: &Frame, inner: &Frame) -> Frame {
    let moved = outer.rotation.map(|row| dot(row, inner.origin_mm));
    Frame {
        rotation: product(&outer.rotation, &inner.rotation),
        origin_mm: std::array::from_fn(|i| outer.origin_mm[i] + moved[i]),
    }
}

fn inverse(frame: &Frame) -> Frame {
    let rotation = transposed(&frame.rotation);
    Frame {
        rotation,
        origin_mm: rotation.map(|row| -dot(row, frame.origin_mm)),
    }
}

/// A frame that is only shifted.
pub(super) fn shift(origin_mm: [f64; 3]) -> Frame {
    Frame {
        rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        origin_mm,
    }
}

/// A frame that is only turned about z, radians.
pub(super) fn turn_z(angle: f64) -> Frame {
    let (sine, cosine) = angle.sin_cos();
    let rotation = [[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]];
    Frame {
        rotation,
        ..shift([0.0; 3])
    }
}

/// A frame that is only turned about y, radians.
fn turn_y(angle: f64) -> Frame {
    let (sine, cosine) = angle.sin_cos();
    let rotation = [[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]];
    Frame {
        rotation,
        ..shift([0.0; 3])
    }
}

/// Scalar product.
pub(super) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Product of two rotations.
pub(super) fn product(left: &[[f64; 3]; 3], right: &[[f64; 3]; 3]) -> [[f64; 3]; 3] {
    let columns = transposed(right);
    left.map(|row| columns.map(|column| dot(row, column)))
}

/// Rows and columns exchanged.
pub(super) fn transposed(rows: &[[f64; 3]; 3]) -> [[f64; 3]; 3] {
    std::array::from_fn(|i| std::array::from_fn(|j| rows[j][i]))
}

#[cfg(test)]
mod tests {
    use super::*;

    const FULL_DEG: [[f64; 2]; 6] = [[-180.0, 179.9999]; 6];

    /// KUKA KR 6 R900 (a1 25 mm, elbow offset 35 mm): axes 1, 4, 6 reversed, axis 2 upright at -90 degrees; with a
    /// tilted tool and a shifted, turned base.
    fn kr_6_r900() -> ArmGeometry {
        ArmGeometry {
            a1_mm: 25.0,
            a2_mm: -35.0,
            b_mm: 0.0,
            c1_mm: 400.0,
            c2_mm: 455.0,
            c3_mm: 420.0,
            c4_mm: 80.0,
            offsets_deg: [0.0, -90.0, 0.0, 0.0, 0.0, 0.0],
            reversed: [true, false, false, true, false, true],
            tool: chain(&shift([10.0, -20.0, 150.0]), &turn_y(0.4)),
            base: chain(&shift([900.0, -100.0, 300.0]), &turn_z(0.3)),
        }
    }

    fn sample_joints() -> impl Iterator<Item = [f64; 6]> {
        (0..4000).map(|number: i32| {
            let mut seed = f64::from(number) * 0.754_877_666_2 + 0.1;
            std::array::from_fn(|_| {
                seed = (seed * 97.0 + 0.317).fract();
                (seed * 358.0 - 179.0) * 0.999
            })
        })
    }

    /// The quadrants and solution number of joint angles, and their status and turn.
    fn names(arm: &ArmGeometry, joints_deg: &[f64; 6]) -> [Configuration; 2] {
        let cf = [0, 3, 5].map(|axis: usize| (joints_deg[axis] / 90.0).floor() as i32);
        let signs = (0..6).map(|axis| u32::from(joints_deg[axis] < 0.0) << axis);
        let turn = signs.sum();
        let one = |mut all: Vec<Configuration>| {
            all.retain(|named| is_named(arm, joints_deg, named));
            all[0]
        };
        let quadrants = (0..8).map(|cfx| Configuration::Quadrants { cf, cfx });
        let status = (0..8).map(|status| Configuration::StatusTurn { status, turn });
        [one(quadrants.collect()), one(status.collect())]
    }

    /// Goal: the inverse gives back the angles that the forward product started from. Method: 4000 sets of angles on an
    /// arm, each named both ways; sets near a border, where more than one may fit, are left out.
    #[test]
    fn angles_come_back() {
        let arm = kr_6_r900();
        let mut count = 0;
        for joints in sample_joints().filter(|joints| joints.iter().all(|deg| deg.abs() > 0.1)) {
            let tip = tip_of(&arm, &joints);
            for named in names(&arm, &joints) {
                let back = joints_of(&arm, tip.origin_mm, tip.rotation, &named, &FULL_DEG);
                if let Ok(back) = back {
                    let near = back.iter().zip(joints).all(|(a, b)| (a - b).abs() < 1e-4);
                    assert!(near, "{joints:?} {back:?}");
                    count += 1;
                }
            }
        }
        assert!(count > 7_500, "{count}");
    }

    /// Goal: S and T mean what KUKA's manual says. Method: its example S 6, T 27 has axes 1, 2, 4, 5 negative and axis
    /// 3 above its straight value; the mastered home position is in the basic area with the elbow bent down (S 2).
    #[test]
    fn status_and_turn_of_kuka() {
        for (joints, status, turn) in [
            ([-10.0, -70.0, 80.0, -20.0, -30.0, 40.0], 6, 27),
            ([0.0, -90.0, 90.0, 0.0, 30.0, 0.0], 2, 2),
            ([0.0, -140.0, 10.0, 0.0, 30.0, 0.0], 3, 2),
        ] {
            let [_, named] = names(&kr_6_r900(), &joints);
            assert_eq!(named, Configuration::StatusTurn { status, turn });
        }
    }
}
