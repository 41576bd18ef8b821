//! The joints of the part's axes: those along x, y and z, and the one that turns the nozzle; whether the tool axis tilts.

use super::{Settings, joint_names};
use headway_firmware::configuration::{JointConfiguration, Kinematics};
use headway_firmware::kinematics::joint_channels;
use headway_protocol::units::CHANNEL_HEADING;

/// Joint 6 of an arm.
const WRIST: usize = 5;

/// The last joint of an arm as what turns the nozzle about its axis: its stops as headings, wherever the tip is within the
/// job's box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WristStops {
    /// Least and greatest heading, rad.
    pub headings_rad: [f64; 2],
}

fn number_of(kinematics: &Kinematics) -> Option<usize> {
    let channels = joint_channels(kinematics);
    channels
        .iter()
        .position(|channel| *channel == Some(CHANNEL_HEADING))
}

/// The name in the machine file of the joint that follows the heading one to one, where there is one.
pub(super) fn heading_joint_name(kinematics: &Kinematics) -> Option<&'static str> {
    let names = joint_names(kinematics);
    names.get(number_of(kinematics)?).copied()
}

/// The number of the joint along x, y or z (0 to 2); an arm has none, whatever its joints' numbers.
pub fn linear_joint_number(kinematics: &Kinematics, axis: usize) -> Option<usize> {
    let names = joint_names(kinematics);
    names.iter().position(|name| *name == ["x", "y", "z"][axis])
}

impl Settings {
    /// The joint along x, y or z (0 to 2), where there is one.
    pub fn linear_joint(&self, axis: usize) -> Option<&JointConfiguration> {
        let number = linear_joint_number(&self.machine.kinematics, axis)?;
        self.machine.joints.get(number)
    }

    /// The number of the joint by which an arm without one for the nozzle turns it.
    pub fn wrist_number(&self) -> Option<usize> {
        match &self.machine.kinematics {
            Kinematics::Arm6 { arm, .. } if !arm.nozzle => Some(WRIST),
            _ => None,
        }
    }

    /// The joint that turns the nozzle: one of its own, or an arm's wrist.
    pub fn turning_joint(&self) -> Option<&JointConfiguration> {
        let number = self.heading_joint_number().or(self.wrist_number())?;
        self.machine.joints.get(number)
    }

    /// Its name in the machine file.
    pub fn turning_joint_name(&self) -> Option<&'static str> {
        let number = self.heading_joint_number().or(self.wrist_number())?;
        joint_names(&self.machine.kinematics).get(number).copied()
    }

    pub(super) fn heading_joint_number(&self) -> Option<usize> {
        number_of(&self.machine.kinematics)
    }

    /// The joint that follows the heading one to one, where there is one.
    pub fn heading_joint(&self) -> Option<&JointConfiguration> {
        self.machine.joints.get(self.heading_joint_number()?)
    }

    /// Its name in the machine file.
    pub fn heading_joint_name(&self) -> Option<&'static str> {
        heading_joint_name(&self.machine.kinematics)
    }

    /// The same joint, to change its limits.
    pub fn heading_joint_mut(&mut self) -> Option<&mut JointConfiguration> {
        let number = self.heading_joint_number()?;
        self.machine.joints.get_mut(number)
    }

    /// True where the tool axis can follow a slope; else the head stays upright.
    pub fn tilts(&self) -> bool {
        self.machine.kinematics != Kinematics::Planar
    }
}
