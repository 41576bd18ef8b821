//! Joint positions along a stream, continuous: from channels in order of time, mm and rad.
//!
//! The inverse kinematics gives joints that turn without end within half a turn; the track counts their
//! turns as the controller does, from the same start.

use headway_firmware::configuration::{JOINTS_MAX, Kinematics, MachineConfiguration};
use headway_firmware::kinematics::inverse;
use headway_firmware::kinematics::pose::Pose;
use headway_firmware::kinematics::winding::Winding;
use headway_protocol::units::CHANNELS;

/// The joints at the last sample.
#[derive(Clone, Debug)]
pub struct JointTrack {
    kinematics: Kinematics,
    ranges: [[f64; 2]; JOINTS_MAX],
    winding: Option<Winding<f64>>,
}

impl JointTrack {
    /// Before the first sample.
    pub fn new(machine: &MachineConfiguration) -> Self {
        Self {
            kinematics: machine.kinematics,
            ranges: machine.ranges(),
            winding: None,
        }
    }

    /// Joints at these channels; `None` if the pose has none. Samples must be so close that no joint
    /// turns by half a turn.
    pub fn joints(&mut self, channels: &[f64; CHANNELS]) -> Option<[f64; JOINTS_MAX]> {
        let joints = inverse(&self.kinematics, &Pose::from_channels(channels)).ok()?;
        let mut position = joints.position;
        let at_rest = || Winding::at_rest(&self.kinematics, &position, &self.ranges);
        let winding = self.winding.get_or_insert_with(at_rest);
        winding.unwound(&self.kinematics, &mut position);
        Some(position)
    }
}
