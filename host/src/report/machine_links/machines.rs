//! The links of `gantry`, `trunnion` and `arm6`.
//!
//! In: a [`Look`] and the kinematics' lengths, mm, machine coordinates. Out: the tree, with its part directly on
//! the table. Frames are those of `headway_firmware::kinematics`: `gantry` turns A, B, C at the pivot, `trunnion`
//! A and C at the table's centre, `arm6` as in Brandstötter, Angerer and Hofbaur (2014).

use super::solids::{bar, block};
use super::{LinkJoint, MachineLinks, Solid};
use crate::settings::Settings;
use crate::settings::head_shape::HeadShape;
use headway_firmware::configuration::{Arm, Kinematics, MachineConfiguration};

const X: usize = 0;
const Y: usize = 1;
const Z: usize = 2;
/// Half the thickness of posts and rails, mm.
const POST_MM: f64 = 9.0;
/// Radius and length of a nozzle whose head has no shape, mm.
const BARE_MM: [f64; 2] = [4.0, 60.0];

/// Dimensions for the links' appearance, machine coordinates, mm.
pub struct Look {
    work_area_mm: [[f64; 3]; 2],
    head: Option<HeadShape>,
    /// Ends of the first three joints where they slide.
    ranges_mm: [[f64; 2]; 3],
}

impl Look {
    /// Of a machine.
    pub fn of(machine: &MachineConfiguration, settings: &Settings) -> Self {
        let work_area_mm = settings.work_area_mm;
        let ranges_mm = std::array::from_fn(|k| {
            let room = [work_area_mm[0][k], work_area_mm[1][k]];
            let joint = machine.joints.get(k).filter(|joint| !joint.rotary);
            let ends = joint.map(|joint| [joint.position_min, joint.position_max]);
            // Far beyond the work area a range gives no information on the machine's size.
            let far = 1.0 + 3.0 * (room[1] - room[0]);
            let near = |ends: &[f64; 2]| room[0] - ends[0] < far && ends[1] - room[1] < far;
            ends.filter(near).unwrap_or(room)
        });
        Self {
            work_area_mm,
            head: settings.head.clone(),
            ranges_mm,
        }
    }

    fn bed_mm(&self) -> f64 {
        self.work_area_mm[0][Z]
    }

    /// The bed, which does not move.
    fn bed(&self) -> Solid {
        let [[x, y, z], [x_end, y_end, _]] = self.work_area_mm;
        block([x, y, z - 4.0], [x_end, y_end, z])
    }

    /// Nozzle and head, the tip at the origin, and how high they are.
    fn head(&self) -> (Vec<Solid>, f64) {
        let Some(head) = &self.head else {
            let [radius, length] = BARE_MM;
            return (
                bar([[0.0; 3], [0.0, 0.0, length]], [0.3, radius]).to_vec(),
                length,
            );
        };
        let profile = head.profile();
        let up = |z| [0.0, 0.0, z];
        let sections = profile.knots().windows(2);
        let sections = sections.filter(|pair| pair[1][0] > pair[0][0]);
        let solids = sections.flat_map(|pair| {
            let [[low, from], [high, to]] = [pair[0], pair[1]];
            bar([up(low), up(high)], [from, to])
        });
        let (solids, top) = (solids.collect(), profile.top_mm());
        (solids, top)
    }

    /// Posts and rails, a bridge along X that slides along Y, a carriage, and a column whose lower end is
    /// `foot_mm` above the position of the joints; its link carries the rest.
    fn portal(&self, mut ground: Vec<Solid>, foot_mm: f64) -> (MachineLinks, usize) {
        let [[x, x_end], [y, y_end], [z, z_end]] = self.ranges_mm;
        let post = POST_MM;
        let height = z_end + foot_mm + 40.0;
        let sides = [x - 40.0, x_end + 40.0];
        for side in sides {
            for end in [y, y_end] {
                let foot = [side - post, end - post, self.bed_mm().min(height)];
                ground.push(block(foot, [side + post, end + post, height]));
            }
            let from = [side - post, y - post, height - post];
            ground.push(block(from, [side + post, y_end + post, height + post]));
        }
        let mut links = MachineLinks::on_ground(ground);
        let slide = |number, axis| Some(LinkJoint::new(number, true, axis));
        let beam = block(
            [sides[0], -post, height - post],
            [sides[1], post, height + post],
        );
        let bridge = links.add(0, [0.0; 3], slide(1, Y), vec![beam]);
        let box_of = |half: f64, from: f64, to: f64| block([-half, -half, from], [half, half, to]);
        let on_beam = box_of(2.2 * post, height - 2.0 * post, height + 2.0 * post);
        let carriage = links.add(bridge, [0.0; 3], slide(0, X), vec![on_beam]);
        let stem = box_of(1.3 * post, foot_mm, foot_mm + 60.0 + z_end - z);
        let column = links.add(carriage, [0.0; 3], slide(2, Z), vec![stem]);
        (links, column)
    }
}

/// Turns about an axis of its link.
fn turn(number: usize, axis: usize) -> Option<LinkJoint> {
    Some(LinkJoint::new(number, false, axis))
}

/// A bar of one radius along an axis, about the origin.
fn barrel(axis: usize, radius_mm: f64, half_mm: f64) -> Vec<Solid> {
    let end = |sign: f64| std::array::from_fn(|k| if k == axis { sign * half_mm } else { 0.0 });
    bar([end(-1.0), end(1.0)], [radius_mm; 2])
}

/// A point on both axes of the table, machine coordinates; the origin where there is no such table.
pub fn table_centre_mm(kinematics: &Kinematics) -> [f64; 3] {
    match kinematics {
        Kinematics::Trunnion { centre_mm, .. } => *centre_mm,
        _ => [0.0; 3],
    }
}

/// X Y Z, at the pivot A about X, B about Y and the nozzle C.
pub fn gantry(look: &Look, pivot_length_mm: f64) -> MachineLinks {
    let pivot = [0.0, 0.0, pivot_length_mm];
    let (mut links, column) = look.portal(vec![look.bed()], pivot_length_mm + 24.0);
    let a = links.add(column, pivot, turn(3, X), barrel(X, 20.0, 30.0));
    let b = links.add(a, [0.0; 3], turn(4, Y), barrel(Y, 15.0, 26.0));
    let (head, _) = look.head();
    // The head's corners are counted from the tip.
    let c = links.add(b, [0.0; 3], turn(5, Z), Vec::new());
    links.tool = links.add(c, [0.0, 0.0, -pivot_length_mm], None, head);
    links
}

/// X Y Z and the nozzle H, and a table that tilts (A) and turns (C).
pub fn trunnion(look: &Look, centre_mm: [f64; 3]) -> MachineLinks {
    let [low, high] = look.work_area_mm;
    let radius = 0.5 * (high[X] - low[X]).hypot(high[Y] - low[Y]);
    let top = look.bed_mm() - centre_mm[Z];
    let arm = radius + 14.0;
    let [cx, cy, cz] = centre_mm;
    let ground = [-1.0, 1.0].map(|side| {
        let x = cx + side * (arm + 30.0);
        let foot = [x - POST_MM, cy - 20.0, cz - radius - 30.0];
        block(foot, [x + POST_MM, cy + 20.0, cz + 18.0])
    });
    let (head, head_top) = look.head();
    let (mut links, column) = look.portal(ground.to_vec(), head_top);
    links.tool = links.add(column, [0.0; 3], turn(5, Z), head);
    let drop = -50.0f64.min(top - 30.0);
    let (beam_low, beam_high) = (drop.min(top - 60.0), drop.min(top - 60.0) + 18.0);
    let mut cradle = vec![block(
        [-arm - 9.0, -24.0, beam_low],
        [arm + 9.0, 24.0, beam_high],
    )];
    for side in [-1.0, 1.0] {
        let x = side * arm;
        let cheek = [x - 9.0, -24.0, beam_low];
        cradle.push(block(cheek, [x + 9.0, 24.0, 20.0]));
        cradle.extend(bar([[x, 0.0, 0.0], [x + side * 30.0, 0.0, 0.0]], [10.0; 2]));
    }
    let a = links.add(0, centre_mm, turn(3, X), cradle);
    let disk = [[0.0, 0.0, top - 8.0], [0.0, 0.0, top]];
    let hub = [[0.0, 0.0, beam_high], [0.0, 0.0, top - 8.0]];
    let mut table = bar(disk, [radius; 2]);
    table.extend(bar(hub, [22.0; 2]));
    links.part = links.add(a, [0.0; 3], turn(4, Z), table);
    links
}

/// Base, shoulder, upper arm, forearm, wrist, flange and tool.
pub fn arm6(look: &Look, arm: &Arm) -> MachineLinks {
    let mut links = MachineLinks::on_ground(vec![look.bed()]);
    let thick = 0.07 * (arm.c2_mm + arm.c3_mm);
    let joint = |number: usize, axis: usize| {
        let reversed = arm.reversed >> number & 1 != 0;
        Some(LinkJoint {
            sign: if reversed { -1.0 } else { 1.0 },
            zero: arm.offset_rad[number],
            ..LinkJoint::new(number, false, axis)
        })
    };
    let up = |z| [0.0, 0.0, z];
    let column = 0.5 * arm.c1_mm;
    let stand = bar([up(0.0), up(column)], [1.8 * thick, 1.3 * thick]);
    let base = links.add(0, arm.base.origin_mm, None, stand);
    links.links[base].rotation = arm.base.rotation;
    let at_shoulder = [arm.a1_mm, arm.b_mm, arm.c1_mm];
    let mut shoulder = bar([up(column), up(arm.c1_mm)], [1.2 * thick; 2]);
    shoulder.extend(bar([up(arm.c1_mm), at_shoulder], [thick; 2]));
    let j1 = links.add(base, [0.0; 3], joint(0, Z), shoulder);
    let mut upper = barrel(Y, 1.15 * thick, 1.2 * thick);
    upper.extend(bar([up(0.0), up(arm.c2_mm)], [0.85 * thick, 0.75 * thick]));
    let j2 = links.add(j1, at_shoulder, joint(1, Y), upper);
    let mut fore = barrel(Y, thick, thick);
    let bend = [arm.a2_mm, 0.0, 0.0];
    let half = [arm.a2_mm, 0.0, 0.5 * arm.c3_mm];
    fore.extend(bar([up(0.0), bend], [0.75 * thick; 2]));
    fore.extend(bar([bend, half], [0.75 * thick; 2]));
    let j3 = links.add(j2, up(arm.c2_mm), joint(2, Y), fore);
    let roll = bar(
        [up(-0.5 * arm.c3_mm), up(0.0)],
        [0.65 * thick, 0.55 * thick],
    );
    let at_wrist = [arm.a2_mm, 0.0, arm.c3_mm];
    let j4 = links.add(j3, at_wrist, joint(3, Z), roll);
    let j5 = links.add(
        j4,
        [0.0; 3],
        joint(4, Y),
        barrel(Y, 0.55 * thick, 0.7 * thick),
    );
    let flange = bar([up(0.0), up(arm.c4_mm)], [0.45 * thick; 2]);
    let j6 = links.add(j5, [0.0; 3], joint(5, Z), flange);
    let (head, head_top) = look.head();
    let tool = &arm.tool;
    // The flange as the tool sees it.
    let to_flange: [f64; 3] = std::array::from_fn(|k| {
        -(0..3)
            .map(|i| tool.rotation[i][k] * tool.origin_mm[i])
            .sum::<f64>()
    });
    let holder = bar([to_flange, up(head_top)], [0.3 * thick; 2]);
    let at_tip = std::array::from_fn(|k| tool.origin_mm[k] + up(arm.c4_mm)[k]);
    let fixed = links.add(j6, at_tip, None, holder);
    links.links[fixed].rotation = tool.rotation;
    let nozzle = arm.nozzle.then(|| LinkJoint::new(6, false, Z));
    links.tool = links.add(fixed, [0.0; 3], nozzle, head);
    links
}
