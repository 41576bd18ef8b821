//! The machine file's kinematics and joints: which keys each machine needs, and what they become.

use super::axes::FileKinematics;
use super::{File, KinematicsName};
use crate::settings::check::{joint_names, kinematics_name};
use crate::text::refusal::{Refusal, refusal};
use headway_firmware::configuration::{Arm, Frame, JointConfiguration, Kinematics};
use serde::Deserialize;
use std::f64::consts::TAU;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Joints {
    x: Option<LinearJoint>,
    y: Option<LinearJoint>,
    z: Option<LinearJoint>,
    a: Option<RotaryJoint>,
    b: Option<RotaryJoint>,
    c: Option<RotaryJoint>,
    h: Option<RotaryJoint>,
    j1: Option<RotaryJoint>,
    j2: Option<RotaryJoint>,
    j3: Option<RotaryJoint>,
    j4: Option<RotaryJoint>,
    j5: Option<RotaryJoint>,
    j6: Option<RotaryJoint>,
}

impl Joints {
    /// Joints that stay on when the others are let go, a bit each, in the order of `names`.
    pub(super) fn held(&self, names: &[&str]) -> u8 {
        let linear = [("x", &self.x), ("y", &self.y), ("z", &self.z)];
        let linear =
            linear.map(|(name, joint)| (name, joint.as_ref().and_then(|joint| joint.hold)));
        let rotary = self.rotary();
        let rotary =
            rotary.map(|(name, joint)| (name, joint.as_ref().and_then(|joint| joint.hold)));
        let held = linear
            .into_iter()
            .chain(rotary)
            .filter(|(_, hold)| *hold == Some(true));
        let numbers = held.filter_map(|(name, _)| names.iter().position(|known| *known == name));
        numbers.fold(0, |mask, number| mask | 1 << number)
    }

    fn rotary(&self) -> [(&'static str, &Option<RotaryJoint>); 10] {
        [
            ("a", &self.a),
            ("b", &self.b),
            ("c", &self.c),
            ("h", &self.h),
            ("j1", &self.j1),
            ("j2", &self.j2),
            ("j3", &self.j3),
            ("j4", &self.j4),
            ("j5", &self.j5),
            ("j6", &self.j6),
        ]
    }

    /// Those that are given, by name.
    fn given(&self) -> Vec<(&'static str, JointConfiguration)> {
        let linear = [("x", &self.x), ("y", &self.y), ("z", &self.z)];
        let rotary = self.rotary();
        let linear = linear.iter().filter_map(|(name, joint)| {
            let joint = joint.as_ref()?;
            Some((*name, joint.joint()))
        });
        let rotary = rotary.iter().filter_map(|(name, joint)| {
            let joint = joint.as_ref()?;
            Some((*name, joint.joint()))
        });
        linear.chain(rotary).collect()
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct LinearJoint {
    steps_per_mm: f64,
    position_min_mm: f64,
    position_max_mm: f64,
    speed_max_mm_s: f64,
    acceleration_max_mm_s2: f64,
    jerk_max_mm_s3: f64,
    hold: Option<bool>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RotaryJoint {
    steps_per_turn: f64,
    position_min_deg: Option<f64>,
    position_max_deg: Option<f64>,
    turns_max: Option<f64>,
    speed_max_deg_s: f64,
    acceleration_max_deg_s2: f64,
    jerk_max_deg_s3: f64,
    hold: Option<bool>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FileArm {
    a1_mm: f64,
    a2_mm: f64,
    b_mm: f64,
    c1_mm: f64,
    c2_mm: f64,
    c3_mm: f64,
    c4_mm: f64,
    offset_deg: Option<[f64; 6]>,
    reversed: Option<[bool; 6]>,
    base_mm: Option<[f64; 3]>,
    base_roll_pitch_yaw_deg: Option<[f64; 3]>,
    tool_mm: [f64; 3],
    tool_roll_pitch_yaw_deg: [f64; 3],
}

impl FileArm {
    fn arm(&self, nozzle: bool) -> Arm {
        let reversed = self.reversed.unwrap_or_default();
        let bits = reversed.iter().enumerate();
        let frame = |origin_mm: [f64; 3], angles_deg: [f64; 3]| {
            Frame::of_angles(origin_mm, angles_deg.map(f64::to_radians))
        };
        Arm {
            a1_mm: self.a1_mm,
            a2_mm: self.a2_mm,
            b_mm: self.b_mm,
            c1_mm: self.c1_mm,
            c2_mm: self.c2_mm,
            c3_mm: self.c3_mm,
            c4_mm: self.c4_mm,
            offset_rad: self.offset_deg.unwrap_or_default().map(f64::to_radians),
            reversed: bits.fold(0, |mask, (joint, is)| mask | u8::from(*is) << joint),
            base: frame(
                self.base_mm.unwrap_or_default(),
                self.base_roll_pitch_yaw_deg.unwrap_or_default(),
            ),
            tool: frame(self.tool_mm, self.tool_roll_pitch_yaw_deg),
            nozzle,
        }
    }
}

impl File {
    /// The kinematics and its joints in order; refuses what is missing or too much.
    pub(super) fn joints(&self) -> Result<(Kinematics, Vec<JointConfiguration>), Refusal> {
        let kinematics = self.kinematics()?;
        let names = joint_names(&kinematics);
        let given = self.joints.given();
        let wrong = |problem: String| {
            let kinematics = kinematics_name(&kinematics);
            let needed = match &self.kinematics {
                FileKinematics::Named(name) => needed(name),
                FileKinematics::Axes(_) => {
                    "x, y, z, the rotary axes by name and h (a polar table: x, c, z, h)"
                }
            };
            refusal!("kinematics \"{kinematics}\" needs {needed}; {problem}")
        };
        if let Some((name, _)) = given.iter().find(|(name, _)| !names.contains(name)) {
            return Err(wrong(format!(
                "take joints.{name} out, or use another kinematics"
            )));
        }
        let joints = names.iter().map(|name| {
            let found = given.iter().find(|(given, _)| given == name);
            let missing = || wrong(format!("joints.{name} is missing"));
            found.map(|(_, joint)| *joint).ok_or_else(missing)
        });
        let joints = joints.collect::<Result<Vec<_>, _>>()?;
        Ok((kinematics, joints))
    }

    fn kinematics(&self) -> Result<Kinematics, Refusal> {
        let name = match &self.kinematics {
            FileKinematics::Named(name) => name,
            FileKinematics::Axes(axes) => {
                let axes = axes.family()?;
                let others = [
                    ("pivot_length_mm", self.pivot_length_mm.is_some()),
                    ("table_centre_mm", self.table_centre_mm.is_some()),
                    ("the group [arm]", self.arm.is_some()),
                ];
                if let Some((key, _)) = others.iter().find(|(_, given)| *given) {
                    return Err(refusal!(
                        "kinematics: take {key} out of a machine of kind \"axes\""
                    ));
                }
                let kinematics = Kinematics::Axes { axes, solution: 0 };
                return Ok(kinematics.with_solution(self.joint_solution.unwrap_or_default()));
            }
        };
        let wrong = |problem: &str| {
            let kinematics = match name {
                KinematicsName::Planar => "planar",
                KinematicsName::Gantry => "gantry",
                KinematicsName::Trunnion => "trunnion",
                KinematicsName::Arm6 => "arm6",
            };
            let needed = needed(name);
            refusal!("kinematics \"{kinematics}\" needs {needed}; {problem}")
        };
        let (pivot, table) = (self.pivot_length_mm, self.table_centre_mm);
        if pivot.is_some() && *name != KinematicsName::Gantry {
            return Err(wrong("take pivot_length_mm out, or use gantry"));
        }
        if table.is_some() && *name != KinematicsName::Trunnion {
            return Err(wrong("take table_centre_mm out, or use trunnion"));
        }
        if self.arm.is_some() && *name != KinematicsName::Arm6 {
            return Err(wrong("take the group [arm] out, or use arm6"));
        }
        let tilts = self.joints.a.is_some() && self.joints.b.is_some();
        if *name == KinematicsName::Gantry && !tilts {
            return Err(wrong("joints.a or joints.b is missing"));
        }
        let kinematics = match name {
            KinematicsName::Planar => Kinematics::Planar,
            KinematicsName::Gantry => Kinematics::Gantry {
                pivot_length_mm: pivot.ok_or_else(|| wrong("pivot_length_mm is missing"))?,
            },
            KinematicsName::Trunnion => Kinematics::Trunnion {
                centre_mm: table.ok_or_else(|| wrong("table_centre_mm is missing"))?,
                solution: 0,
            },
            KinematicsName::Arm6 => {
                let arm = self.arm.as_ref();
                let arm = arm.ok_or_else(|| wrong("the group [arm] is missing"))?;
                Kinematics::Arm6 {
                    arm: arm.arm(self.joints.h.is_some()),
                    solution: 0,
                }
            }
        };
        Ok(kinematics.with_solution(self.joint_solution.unwrap_or_default()))
    }
}

/// What a machine file of these kinematics must have.
fn needed(name: &KinematicsName) -> &'static str {
    match name {
        KinematicsName::Planar => "the joints x, y, z, c and no pivot_length_mm",
        KinematicsName::Gantry => "the joints x, y, z, a, b, c and pivot_length_mm",
        KinematicsName::Trunnion => "the joints x, y, z, a, c, h and table_centre_mm",
        KinematicsName::Arm6 => {
            "the joints j1 to j6, h where the nozzle turns, and the group [arm]"
        }
    }
}

impl LinearJoint {
    fn joint(&self) -> JointConfiguration {
        JointConfiguration {
            rotary: false,
            steps_per_unit: self.steps_per_mm,
            position_min: self.position_min_mm,
            position_max: self.position_max_mm,
            speed_max: self.speed_max_mm_s,
            acceleration_max: self.acceleration_max_mm_s2,
            jerk_max: self.jerk_max_mm_s3,
        }
    }
}

impl RotaryJoint {
    fn joint(&self) -> JointConfiguration {
        // Cables and hoses wind up so far either way, counted from the index.
        let wound = self.turns_max.map_or(f64::INFINITY, |turns| turns * TAU);
        JointConfiguration {
            rotary: true,
            steps_per_unit: self.steps_per_turn / TAU,
            position_min: self
                .position_min_deg
                .map_or(-wound, |deg| deg.to_radians().max(-wound)),
            position_max: self
                .position_max_deg
                .map_or(wound, |deg| deg.to_radians().min(wound)),
            speed_max: self.speed_max_deg_s.to_radians(),
            acceleration_max: self.acceleration_max_deg_s2.to_radians(),
            jerk_max: self.jerk_max_deg_s3.to_radians(),
        }
    }
}
