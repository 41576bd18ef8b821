//! `[motors]` of a machine file: joints that share two motors (CoreXY), and further motors on a joint.
//!
//! In: names of joints, limits in mm. Out: the controller's matrix. Without limits the motors of a pair are as
//! fast as both joints together, so that the joints' own limits are all there are.

use super::write::number;
use crate::settings::check::joint_names;
use crate::settings::drivers::copy_name;
use crate::text::refusal::{Refusal, refusal};
use headway_firmware::configuration::motors::{COPIES_MAX, MotorMatrix, MotorPair};
use headway_firmware::configuration::{JointConfiguration, MachineConfiguration};
use serde::Deserialize;
use std::fmt::Write;

#[derive(Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FileMotors {
    core: Option<[String; 2]>,
    speed_max_mm_s: Option<f64>,
    acceleration_max_mm_s2: Option<f64>,
    jerk_max_mm_s3: Option<f64>,
    #[serde(default)]
    also: Vec<String>,
}

impl FileMotors {
    /// The matrix of a machine; refuses joints that it has not.
    pub(super) fn matrix(
        &self,
        names: &[&str],
        joints: &[JointConfiguration],
    ) -> Result<MotorMatrix, Refusal> {
        let place =
            |name: &String, key: &str| {
                let found = names.iter().position(|joint| joint == name);
                found.filter(|place| copy_name(names[*place], 2).is_some()).ok_or_else(|| {
                refusal!(
                    "motors.{key}: {name}: it takes joints that move along a line, x, y and z"
                )
            })
            };
        let limits = [
            ("speed_max_mm_s", self.speed_max_mm_s),
            ("acceleration_max_mm_s2", self.acceleration_max_mm_s2),
            ("jerk_max_mm_s3", self.jerk_max_mm_s3),
        ];
        let mut matrix = MotorMatrix::DIRECT;
        if let Some([a, b]) = &self.core {
            let pair = [place(a, "core")?, place(b, "core")?];
            matrix.pair = Some(pair_of(pair, names, joints, &limits)?);
        } else if let Some((key, _)) = limits.iter().find(|(_, given)| given.is_some()) {
            return Err(refusal!(
                "motors.{key}: it is a limit of the motors of core = [\"x\", \"y\"]"
            ));
        }
        if self.also.len() > COPIES_MAX {
            return Err(refusal!(
                "motors.also: a machine has {COPIES_MAX} of them at most"
            ));
        }
        for name in &self.also {
            // As many as fit were counted above.
            let _ = matrix.copies.push(place(name, "also")? as u8);
        }
        Ok(matrix)
    }
}

/// Refuses limits below those of the joints and joints with different steps.
fn pair_of(
    pair: [usize; 2],
    names: &[&str],
    joints: &[JointConfiguration],
    limits: &[(&str, Option<f64>); 3],
) -> Result<MotorPair, Refusal> {
    let [a, b] = pair.map(|place| &joints[place]);
    let [name_a, name_b] = pair.map(|place| names[place]);
    let wrong = |problem: String| Err(Refusal(problem));
    if pair[0] == pair[1] || a.steps_per_unit != b.steps_per_unit {
        return wrong(format!(
            "motors.core: {name_a} and {name_b} must be two joints with the same steps_per_mm"
        ));
    }
    let of_joints = [
        [a.speed_max, b.speed_max],
        [a.acceleration_max, b.acceleration_max],
        [a.jerk_max, b.jerk_max],
    ];
    let mut values = [0.0; 3];
    for ((value, (key, given)), [of_a, of_b]) in values.iter_mut().zip(limits).zip(of_joints) {
        let least = of_a.max(of_b);
        *value = given.unwrap_or(of_a + of_b);
        // Written so that a NaN is refused.
        let is_enough = *value >= least && value.is_finite();
        if !is_enough {
            return wrong(format!(
                "motors.{key} is {value}: one joint alone moves a motor as fast as itself, so it cannot be \
                 below the joints' {least}; lower theirs"
            ));
        }
    }
    let [speed_max, acceleration_max, jerk_max] = values;
    Ok(MotorPair {
        joints: pair.map(|place| place as u8),
        speed_max,
        acceleration_max,
        jerk_max,
    })
}

/// The group, where motors are not the joints.
pub(super) fn write_motors(text: &mut String, machine: &MachineConfiguration) -> std::fmt::Result {
    let motors = &machine.motors;
    if *motors == MotorMatrix::DIRECT {
        return Ok(());
    }
    let names = joint_names(&machine.kinematics);
    let name = |joint: u8| names.get(usize::from(joint)).copied().unwrap_or("?");
    writeln!(text, "\n[motors]")?;
    if let Some(pair) = &motors.pair {
        let [a, b] = pair.joints.map(name);
        writeln!(
            text,
            "# Two belts: the motor at the place of {a} turns by {a} + {b}, that at the place of {b} by {a} - {b}.\n\
             # Limits of either motor, beside those of the joints; [wiring] reversed turns one round.\n\
             core = [\"{a}\", \"{b}\"]"
        )?;
        writeln!(text, "speed_max_mm_s = {}", number(pair.speed_max))?;
        writeln!(
            text,
            "acceleration_max_mm_s2 = {}",
            number(pair.acceleration_max)
        )?;
        writeln!(text, "jerk_max_mm_s3 = {}", number(pair.jerk_max))?;
    }
    if !motors.copies.is_empty() {
        let also: Vec<String> = motors
            .copies
            .iter()
            .map(|joint| format!("{:?}", name(*joint)))
            .collect();
        writeln!(
            text,
            "# Further motors behind the extruder's, each with the steps of this joint's motor: z2, z3 and so on.\n\
             also = [{}]",
            also.join(", ")
        )?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    //! Goal: motors are read and written back as they are, and what cannot be is refused with its key.
    //! Method: the built-in machine's file with a group more.
    use super::super::tests::{assert_refused, planar_with as read};
    use super::super::{from_toml, to_toml};
    use crate::settings::Settings;
    use crate::settings::drivers::motor_names;

    const ALL: &str = "[motors]\ncore = [\"x\", \"y\"]\nspeed_max_mm_s = 300\nalso = [\"z\", \"z\"]\n\
                       [wiring]\nreversed = [\"z3\"]\n";

    #[test]
    fn motors_read_back() {
        let settings = read(ALL).expect("a machine");
        let pair = settings.machine.motors.pair.expect("a pair");
        assert_eq!(pair.joints, [0, 1]);
        // The acceleration limit is that of both joints together.
        assert_eq!((pair.speed_max, pair.acceleration_max), (300.0, 6000.0));
        assert_eq!(settings.machine.motors.copies[..], [2, 2]);
        let names = motor_names(&settings.machine);
        assert_eq!(names, ["x", "y", "z", "c", "extruder", "z2", "z3"]);
        assert_eq!(settings.wiring.reversed_motors, 1 << 6);
        assert_eq!(from_toml(&to_toml(&settings)).expect("again"), settings);
        assert_ne!(settings.machine.hash(), Settings::planar().machine.hash());
        assert!(!to_toml(&Settings::planar()).contains("[motors]"));
    }

    #[test]
    fn motors_that_cannot_be_are_refused() {
        let cases = [
            ("[\"x\", \"y\"]", "[\"x\", \"x\"]", "two joints"),
            ("[\"x\", \"y\"]", "[\"x\", \"z\"]", "same steps_per_mm"),
            ("[\"x\", \"y\"]", "[\"x\", \"c\"]", "motors.core: c"),
            ("= 300", "= 249", "motors.speed_max_mm_s is 249"),
            ("= 300", "= nan", "motors.speed_max_mm_s is NaN"),
            (
                "core = [\"x\", \"y\"]\n",
                "",
                "a limit of the motors of core",
            ),
            ("\"z\", \"z\"", "\"q\"", "motors.also: q"),
            (
                "\"z\", \"z\"",
                "\"z\", \"z\", \"y\", \"y\"",
                "3 of them at most",
            ),
            ("z3", "z4", "z2, z3"),
        ];
        assert_refused(ALL, &cases);
    }
}
