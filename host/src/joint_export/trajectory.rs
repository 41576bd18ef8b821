//! Joints as `trajectory_msgs/msg/JointTrajectory` of ROS 2, in JSON or in YAML.
//!
//! In: a [`JointTable`], the joints' names as the robot's description has them. Out: text with positions,
//! velocities and accelerations in rad or m (the units of that message), `time_from_start` in whole seconds and
//! nanoseconds. The first point is at time 0, and the robot has to be there already; the last is at rest. Source:
//! the message's definition, <https://docs.ros.org/en/jazzy/p/trajectory_msgs/msg/JointTrajectory.html>. Not
//! covered: effort, and the deposited volume, for which a joint controller has no channel.

use super::samples::{JointSample, names};
use super::tables::JointTable;
use crate::text::refusal::{Refusal, refusal};
use std::io::{Result, Write};

/// How the message is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TrajectoryFormat {
    /// One JSON object.
    Json,
    /// YAML, as `ros2 topic pub` and `ros2 action send_goal` read it.
    Yaml,
}

/// The given names where they are one for each joint; without any the machine file's.
///
/// # Errors
/// [`Refusal`].
pub fn joint_names_of(
    table: &JointTable,
    given: Option<&[String]>,
) -> std::result::Result<Vec<String>, Refusal> {
    let known: Vec<&str> = names(table.machine).iter().map(|of| of.name).collect();
    let Some(given) = given else {
        return Ok(known.into_iter().map(str::to_string).collect());
    };
    if given.len() != known.len() {
        return Err(refusal!(
            "{given} joint names for {joints} joints ({known}): give one for each, in this \
             order",
            given = given.len(),
            joints = known.len(),
            known = known.join(", ")
        ));
    }
    for (number, name) in given.iter().enumerate() {
        let is_plain = |c: char| c.is_ascii_alphanumeric() || "_-./".contains(c);
        let is_right = !name.is_empty() && name.chars().all(is_plain);
        if !is_right || given[..number].contains(name) {
            return Err(refusal!(
                "joint name {name:?}: write letters, digits, _ - . / only, each name once",
                name = name.chars().take(40).collect::<String>()
            ));
        }
    }
    Ok(given.to_vec())
}

/// Writes the message.
///
/// # Errors
/// Of the writer, and if a pose has no joints.
pub fn write_trajectory(
    out: &mut impl Write,
    table: &JointTable,
    joint_names: &[String],
    format: TrajectoryFormat,
) -> Result<()> {
    // Names are plain: quotes are all that they need, in either notation.
    let joint_names = format!("[\"{}\"]", joint_names.join("\", \""));
    match format {
        TrajectoryFormat::Json => write!(
            out,
            "{{\"header\": {{\"stamp\": {{\"sec\": 0, \"nanosec\": 0}}, \"frame_id\": \"\"}},\n\
             \"joint_names\": {joint_names},\n\"points\": ["
        )?,
        TrajectoryFormat::Yaml => write!(
            out,
            "header:\n  stamp: {{sec: 0, nanosec: 0}}\n  frame_id: \"\"\njoint_names: {joint_names}\npoints:\n"
        )?,
    }
    for (number, sample) in table.rows().enumerate() {
        let sample = sample?;
        let point = Point::of(&sample, table);
        match format {
            TrajectoryFormat::Json => {
                let comma = if number == 0 { "" } else { "," };
                write!(out, "{comma}\n{}", point.json())?;
            }
            TrajectoryFormat::Yaml => out.write_all(point.yaml().as_bytes())?,
        }
    }
    match format {
        TrajectoryFormat::Json => writeln!(out, "\n]}}"),
        TrajectoryFormat::Yaml => Ok(()),
    }
}

/// A point of the message, its numbers as text.
struct Point {
    positions: String,
    velocities: String,
    accelerations: String,
    sec: u64,
    nanosec: u64,
}

impl Point {
    fn of(sample: &JointSample, table: &JointTable) -> Self {
        let list = |values: &[f64]| {
            let joints = values.iter().zip(&table.machine.joints);
            let natural = joints.map(|(value, joint)| match joint.rotary {
                true => format!("{value:.9}"),
                // From mm to m.
                false => format!("{:.9}", value * 1e-3),
            });
            natural.collect::<Vec<_>>().join(", ")
        };
        let nanoseconds = (sample.sample.time_s * 1e9).round() as u64;
        Point {
            positions: list(&sample.position),
            velocities: list(&sample.velocity),
            accelerations: list(&sample.acceleration),
            sec: nanoseconds / 1_000_000_000,
            nanosec: nanoseconds % 1_000_000_000,
        }
    }

    fn json(&self) -> String {
        format!(
            "{{\"positions\": [{}], \"velocities\": [{}], \"accelerations\": [{}], \"effort\": [], \
             \"time_from_start\": {{\"sec\": {}, \"nanosec\": {}}}}}",
            self.positions, self.velocities, self.accelerations, self.sec, self.nanosec
        )
    }

    fn yaml(&self) -> String {
        format!(
            "- positions: [{}]\n  velocities: [{}]\n  accelerations: [{}]\n  effort: []\n  \
             time_from_start: {{sec: {}, nanosec: {}}}\n",
            self.positions, self.velocities, self.accelerations, self.sec, self.nanosec
        )
    }
}
