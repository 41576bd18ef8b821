//! Limits of a controller's axes: what its own planner is to be told.
//!
//! In: a machine. Out: speeds and accelerations of X Y Z (mm), A B C (degrees) and the extruder (mm of filament), a second.
//! Joints are axes by their names: tilts take those that tilt, and what a machine has no joint for, as an arm for X Y Z, is
//! the built-in machine's.

use crate::settings::{joint_names, linear_joint_number};
use headway_firmware::configuration::MachineConfiguration;
use headway_firmware::kinematics::joint_channels;
use headway_protocol::units::CHANNEL_HEADING;

/// Axes: X Y Z, A B C, the extruder.
pub const AXES: usize = 7;
/// The heading.
pub const HEADING: usize = 5;
/// The extruder.
pub const EXTRUDER: usize = 6;
/// Time in which a heading's corner velocity is reached at its acceleration, s: the length of two moves in time, so that
/// chords of what the heading does at its limit are no corners, nor where that acceleration changes its sign.
const CORNER_S: f64 = 0.02;
/// Time in which the heading's speed may change by its acceleration within one move, s: what its mean acceleration over
/// [`CORNER_S`] is more than the job's grows with it.
const MOVE_CHANGE_S: f64 = 0.0075;
/// Times the heading's acceleration that a planner is given on the job's moves: none would be as good, but some controllers
/// have no way to say so. The speeds of the file keep the heading's acceleration; see [`AxisLimits::followed`].
const FOLLOWED_TIMES: f64 = 20.0;

/// Limits of the axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisLimits {
    /// Speeds.
    pub speed: [f64; AXES],
    /// Accelerations.
    pub acceleration: [f64; AXES],
}

impl AxisLimits {
    /// Those of the built-in machine, the tilts of the trunnion of the examples.
    pub const BUILT_IN: AxisLimits = AxisLimits {
        speed: [250.0, 250.0, 20.0, 120.0, 120.0, 1080.0, 33.0],
        acceleration: [3000.0, 3000.0, 200.0, 1500.0, 1500.0, 20_000.0, 3300.0],
    };

    /// Of a machine, with filament of a cross-section.
    pub fn of_machine(machine: &MachineConfiguration, filament_mm2: f64) -> AxisLimits {
        let kinematics = &machine.kinematics;
        let names = joint_names(kinematics);
        let [a, b] = ["a", "b"].map(|name| names.iter().position(|own| *own == name));
        let [x, y, z] = [0, 1, 2].map(|axis| linear_joint_number(kinematics, axis));
        let channels = joint_channels(kinematics).iter();
        let heading = channels
            .copied()
            .position(|channel| channel == Some(CHANNEL_HEADING));
        // X of a polar table is a radius.
        let joints = [y.and(x), y, z, a.or(b), b.or(a), heading];
        let mut limits = AxisLimits::BUILT_IN;
        for (axis, joint) in joints.into_iter().enumerate() {
            let Some(joint) = joint.and_then(|joint| machine.joints.get(joint)) else {
                continue;
            };
            let unit = |value: f64| {
                if joint.rotary {
                    value.to_degrees()
                } else {
                    value
                }
            };
            limits.speed[axis] = unit(joint.speed_max);
            limits.acceleration[axis] = unit(joint.acceleration_max);
        }
        limits.speed[EXTRUDER] = machine.extruder.speed_max_mm3_s / filament_mm2;
        limits.acceleration[EXTRUDER] = machine.extruder.acceleration_max_mm3_s2 / filament_mm2;
        limits
    }

    /// Change of an axis' speed between two moves that a controller is to allow.
    pub fn corner(&self, axis: usize) -> f64 {
        CORNER_S * self.acceleration[axis]
    }

    /// Change of the heading's speed within a move that is written, degrees/s.
    pub fn heading_change(&self) -> f64 {
        MOVE_CHANGE_S * self.acceleration[HEADING]
    }

    /// What a planner is given on the job's moves, where the heading only follows the tip. A planner of straight moves slows
    /// the tip down within a move by what the heading's share of it allows, although the next move's share is another one
    /// and the heading's own speed does not change: entering a corner, the tip slows down while the heading speeds up. The
    /// job's times have the heading's acceleration already.
    pub fn followed(&self) -> AxisLimits {
        let mut followed = *self;
        followed.acceleration[HEADING] *= FOLLOWED_TIMES;
        followed
    }

    /// The least of some limits for a direction.
    pub fn within(direction: &[f64; AXES], limits: &[f64; AXES]) -> f64 {
        let of_axes = direction.iter().zip(limits);
        let moving = of_axes.filter(|(share, _)| **share != 0.0);
        moving
            .map(|(share, limit)| limit / share.abs())
            .fold(f64::INFINITY, f64::min)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Settings;
    use crate::settings::examples::MachineExample;
    use crate::settings::machine_file::from_toml;

    /// Goal: every axis has its own joint's limits, whatever their number. Method: speeds of X Y Z and the heading by joints'
    /// names on all machines; an arm has the built-in X Y Z, and its nozzle's joint for the heading.
    #[test]
    fn axes_are_joints_by_name() {
        let files = MachineExample::ALL.map(|file| from_toml(file.text()).expect("a machine"));
        let machines = [Settings::planar(), Settings::gantry()].into_iter();
        for settings in machines.chain(files) {
            let limits = AxisLimits::of_machine(&settings.machine, 2.405);
            let names = joint_names(&settings.machine.kinematics).iter();
            let joints = names.zip(&settings.machine.joints);
            let own = |name: &str| {
                let joint = joints.clone().find(|(own, _)| **own == name);
                joint.map(|(_, joint)| joint.speed_max)
            };
            for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
                // X of a polar table is a radius.
                let is_axis = own("y").is_some() || name == "z";
                let speed = own(name)
                    .filter(|_| is_axis)
                    .unwrap_or(AxisLimits::BUILT_IN.speed[axis]);
                assert_eq!(
                    limits.speed[axis], speed,
                    "{} {name}",
                    settings.machine_name
                );
            }
            if let Some(heading) = settings.heading_joint() {
                assert_eq!(limits.speed[HEADING], heading.speed_max.to_degrees());
            }
        }
    }

    /// Goal: a machine's joints are the axes' limits, angles in degrees. Method: the built-in machine.
    #[test]
    fn joints_are_axes() {
        let machine = Settings::default().machine;
        let limits = AxisLimits::of_machine(&machine, 2.405);
        for (own, built_in) in limits.speed.iter().zip(AxisLimits::BUILT_IN.speed) {
            assert!((own / built_in - 1.0).abs() < 0.02, "{limits:?}");
        }
        assert!((limits.corner(HEADING) - 400.0).abs() < 1e-6);
        assert!((limits.heading_change() - 150.0).abs() < 1e-6);
        let followed = limits.followed();
        assert_eq!(followed.speed, limits.speed);
        assert!((followed.acceleration[HEADING] - 400_000.0).abs() < 1e-3);
    }
}
