//! Arms by their makers' published data, for `headway machine new --arm`.
//!
//! Lengths, zero poses, senses and ranges as two public descriptions of each agree on them (those of ROS-Industrial with the
//! makers' data sheets they name, and a second one); speeds likewise. Speeds to begin with are half of these, accelerations
//! eight times the speed a second, jerks a hundred times that: ours, since no data sheet has any. Not covered: arms whose axis
//! 3 is coupled to axis 2 by a linkage (ABB IRB 2400, Fanuc), limits of two axes together, where the robot stands: the bed is
//! put before it.

use super::Settings;
use super::examples::MachineExample;
use super::machine_file;
use crate::text::refusal::Refusal;
use headway_firmware::configuration::{Arm, Frame, JOINTS_MAX, Kinematics};
use headway_firmware::kinematics::forward;

/// Share of the published speeds to begin with.
const SPEED_SHARE: f64 = 0.5;
/// Accelerations as so many speeds a second, jerks as so many accelerations.
const ACCELERATION: f64 = 8.0;
const JERK: f64 = 100.0;
/// Of the reach: the side of the bed, and how far before axis 1 its middle is.
const BED_SHARE: f64 = 0.3;
const AHEAD_SHARE: f64 = 0.65;
/// The bed's side is a multiple of this, mm.
const BED_STEP_MM: f64 = 50.0;

/// A published arm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ArmModel {
    /// As `--arm` calls it.
    pub name: &'static str,
    /// As its maker does.
    pub title: &'static str,
    /// a1 a2 b c1 c2 c3 c4 (Brandstötter and others, 2014).
    pub lengths_mm: [f64; 7],
    /// Joint = model angle + offset,
    pub offset_deg: [f64; 6],
    /// negated where a bit is set.
    pub reversed: u8,
    /// Ranges.
    pub least_deg: [f64; 6],
    /// See `least_deg`.
    pub most_deg: [f64; 6],
    /// Greatest speeds.
    pub speed_deg_s: [f64; 6],
}

/// All of them.
pub const ARM_MODELS: &[ArmModel] = &[
    ArmModel {
        name: "abb-irb-2600-12-165",
        title: "ABB IRB 2600-12/1.65",
        lengths_mm: [150.0, -115.0, 0.0, 445.0, 700.0, 795.0, 85.0],
        offset_deg: [0.0, 0.0, -90.0, 0.0, 0.0, 0.0],
        reversed: 0,
        least_deg: [-180.0, -95.0, -180.0, -400.0, -120.0, -400.0],
        most_deg: [180.0, 155.0, 75.0, 400.0, 120.0, 400.0],
        speed_deg_s: [175.0, 175.0, 175.0, 360.0, 360.0, 500.0],
    },
    ArmModel {
        name: "abb-irb-4600-60-205",
        title: "ABB IRB 4600-60/2.05",
        lengths_mm: [175.0, -175.0, 0.0, 495.0, 900.0, 960.0, 135.0],
        offset_deg: [0.0, 0.0, -90.0, 0.0, 0.0, 0.0],
        reversed: 0,
        least_deg: [-180.0, -90.0, -180.0, -400.0, -125.0, -400.0],
        most_deg: [180.0, 150.0, 75.0, 400.0, 120.0, 400.0],
        speed_deg_s: [175.0, 175.0, 175.0, 250.0, 250.0, 360.0],
    },
    ArmModel {
        name: "abb-irb-4600-40-255",
        title: "ABB IRB 4600-40/2.55",
        lengths_mm: [175.0, -175.0, 0.0, 495.0, 1095.0, 1270.0, 135.0],
        offset_deg: [0.0, 0.0, -90.0, 0.0, 0.0, 0.0],
        reversed: 0,
        least_deg: [-180.0, -90.0, -180.0, -400.0, -125.0, -400.0],
        most_deg: [180.0, 150.0, 75.0, 400.0, 120.0, 400.0],
        speed_deg_s: [175.0, 175.0, 175.0, 250.0, 250.0, 360.0],
    },
    ArmModel {
        name: "kuka-kr-6-r700-sixx",
        title: "KUKA KR 6 R700 sixx",
        lengths_mm: [25.0, -35.0, 0.0, 400.0, 315.0, 365.0, 80.0],
        offset_deg: [0.0, -90.0, 0.0, 0.0, 0.0, 0.0],
        reversed: 0b101001,
        least_deg: [-170.0, -190.0, -120.0, -185.0, -120.0, -350.0],
        most_deg: [170.0, 45.0, 156.0, 185.0, 120.0, 350.0],
        speed_deg_s: [360.0, 300.0, 360.0, 381.0, 388.0, 615.0],
    },
    ArmModel {
        name: "kuka-kr-10-r1100-sixx",
        title: "KUKA KR 10 R1100 sixx",
        lengths_mm: [25.0, -35.0, 0.0, 400.0, 560.0, 515.0, 80.0],
        offset_deg: [0.0, -90.0, 0.0, 0.0, 0.0, 0.0],
        reversed: 0b101001,
        least_deg: [-170.0, -190.0, -120.0, -185.0, -120.0, -350.0],
        most_deg: [170.0, 45.0, 156.0, 185.0, 120.0, 350.0],
        speed_deg_s: [300.0, 225.0, 225.0, 381.0, 311.0, 492.0],
    },
    ArmModel {
        name: "kuka-kr-60-3",
        title: "KUKA KR 60-3",
        lengths_mm: [350.0, -145.0, 0.0, 815.0, 850.0, 820.0, 170.0],
        offset_deg: [0.0, -90.0, 0.0, 0.0, 0.0, 0.0],
        reversed: 0b101001,
        least_deg: [-185.0, -135.0, -120.0, -350.0, -119.0, -350.0],
        most_deg: [185.0, 35.0, 158.0, 350.0, 119.0, 350.0],
        speed_deg_s: [128.0, 102.0, 128.0, 260.0, 245.0, 322.0],
    },
    ArmModel {
        name: "kuka-kr-150-r3100-2",
        title: "KUKA KR 150 R3100-2",
        lengths_mm: [330.0, -115.0, 0.0, 645.0, 1350.0, 1420.0, 215.0],
        offset_deg: [0.0, -90.0, 0.0, 0.0, 0.0, 0.0],
        reversed: 0b101001,
        least_deg: [-185.0, -140.0, -120.0, -350.0, -125.0, -350.0],
        most_deg: [185.0, -5.0, 168.0, 350.0, 125.0, 350.0],
        speed_deg_s: [105.0, 107.0, 114.0, 190.0, 180.0, 260.0],
    },
    ArmModel {
        name: "kuka-kr-210-r2700-2",
        title: "KUKA KR 210 R2700-2",
        lengths_mm: [330.0, -115.0, 0.0, 645.0, 1150.0, 1220.0, 215.0],
        offset_deg: [0.0, -90.0, 0.0, 0.0, 0.0, 0.0],
        reversed: 0b101001,
        least_deg: [-185.0, -140.0, -120.0, -350.0, -125.0, -350.0],
        most_deg: [185.0, -5.0, 168.0, 350.0, 125.0, 350.0],
        speed_deg_s: [116.8, 111.4, 112.0, 179.0, 172.0, 220.0],
    },
    ArmModel {
        name: "staubli-tx2-90",
        title: "Staubli TX2-90",
        lengths_mm: [50.0, 0.0, 50.0, 478.0, 425.0, 425.0, 100.0],
        offset_deg: [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        reversed: 0,
        least_deg: [-180.0, -130.0, -145.0, -270.0, -115.0, -270.0],
        most_deg: [180.0, 147.5, 145.0, 270.0, 140.0, 270.0],
        speed_deg_s: [265.0, 210.0, 315.0, 450.0, 370.0, 630.0],
    },
];

impl ArmModel {
    /// By its name.
    pub fn named(name: &str) -> Option<&'static ArmModel> {
        ARM_MODELS.iter().find(|model| model.name == name)
    }

    /// How far the wrist's centre is from axis 1 at most, mm.
    pub fn reach_mm(&self) -> f64 {
        let [a1, a2, _, _, c2, c3, _] = self.lengths_mm;
        a1 + c2 + a2.hypot(c3)
    }

    /// A machine with it: its wrist turns the nozzle, the bed lies before it, half as high as its shoulder.
    ///
    /// # Errors
    /// None with the example that is built in.
    pub fn settings(&self) -> Result<Settings, Refusal> {
        let mut settings = machine_file::from_toml(MachineExample::Arm6.text())?;
        let [a1_mm, a2_mm, b_mm, c1_mm, c2_mm, c3_mm, c4_mm] = self.lengths_mm;
        let bed_mm = (BED_SHARE * self.reach_mm() / BED_STEP_MM).ceil() * BED_STEP_MM;
        let ahead_mm = AHEAD_SHARE * self.reach_mm();
        if let Kinematics::Arm6 { arm, .. } = &mut settings.machine.kinematics {
            let base_mm = [
                0.5 * bed_mm,
                (0.5 * bed_mm - ahead_mm).round(),
                -0.5 * c1_mm,
            ];
            let before = [0.0, 0.0, std::f64::consts::FRAC_PI_2];
            *arm = Arm {
                a1_mm,
                a2_mm,
                b_mm,
                c1_mm,
                c2_mm,
                c3_mm,
                c4_mm,
                offset_rad: self.offset_deg.map(f64::to_radians),
                reversed: self.reversed,
                base: Frame::of_angles(base_mm, before),
                tool: arm.tool,
                nozzle: false,
            };
        }
        settings.machine_name = self.name.to_string();
        settings.work_area_mm = [[0.0; 3], [bed_mm; 3]];
        settings.machine.joints.truncate(self.speed_deg_s.len());
        for (axis, joint) in settings.machine.joints.iter_mut().enumerate() {
            joint.position_min = self.least_deg[axis].to_radians();
            joint.position_max = self.most_deg[axis].to_radians();
            joint.speed_max = SPEED_SHARE * self.speed_deg_s[axis].to_radians();
            joint.acceleration_max = ACCELERATION * joint.speed_max;
            joint.jerk_max = JERK * joint.acceleration_max;
        }
        Ok(settings)
    }
}

/// Place of an arm's flange in its base, mm, and its turn as rotations about Z, Y', X'', degrees, at joints as its controller
/// counts them; `None` for other machines.
pub fn flange_pose(kinematics: &Kinematics, joints_deg: [f64; 6]) -> Option<[[f64; 3]; 2]> {
    let Kinematics::Arm6 { arm, solution } = kinematics else {
        return None;
    };
    let bare = Kinematics::Arm6 {
        arm: Arm {
            base: Frame::IDENTITY,
            tool: Frame::IDENTITY,
            nozzle: false,
            ..*arm
        },
        solution: *solution,
    };
    let mut joints = [0.0; JOINTS_MAX];
    for (joint, degrees) in joints.iter_mut().zip(joints_deg) {
        *joint = degrees.to_radians();
    }
    let pose = forward(&bare, &joints);
    let (roll, pitch, yaw) = pose.rotation().euler_angles();
    let turn = [yaw, pitch, roll].map(f64::to_degrees);
    Some([pose.tip_mm.into(), turn])
}
