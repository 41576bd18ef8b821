//! Joints of a stream at even steps of time.
//!
//! In: a stream and the machine of its job. Out: a [`JointSample`] for each step, and one at the end. Between
//! two rows the joints are followed in steps of at most `TURNS_EVERY_TICKS`, so that no turn is missed.

use crate::drive::joint_track::JointTrack;
use crate::drive::moment::Moment;
use crate::drive::trace::count_of;
use crate::job::SegmentStream;
use crate::report::pose_table::{StreamSample, duration_ticks, moments_within};
use crate::settings::joint_names;
use headway_firmware::configuration::{JOINTS_MAX, MachineConfiguration};
use headway_firmware::path::spline::Span;
use std::rc::Rc;

/// Servo ticks between two samples of the joints, to count their turns: 32 ms at 2 kHz.
const TURNS_EVERY_TICKS: f64 = 64.0;
/// Rows nearer to the end than this, in servo ticks, are the end.
const SAME_TICK: f64 = 1e-6;

/// The joints at one moment; those past the machine's are 0.
#[derive(Clone, Debug, PartialEq)]
pub struct JointSample {
    /// Time, channels, and state of the head.
    pub sample: StreamSample,
    /// Positions, mm or rad.
    pub position: [f64; JOINTS_MAX],
    /// Their rates, per second.
    pub velocity: [f64; JOINTS_MAX],
    /// Their second derivatives.
    pub acceleration: [f64; JOINTS_MAX],
    /// Whole motor steps, by the controller's rounding.
    pub steps: [i64; JOINTS_MAX],
}

/// A pose that the machine has no joints for.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "{time_s:.4} s: the machine of the job has no joint positions for this pose; plan it again"
)]
pub struct NoJoints {
    /// Time since the job began.
    pub time_s: f64,
}

/// A joint as tables and trajectories name it.
#[derive(Clone, Debug, PartialEq)]
pub struct JointName {
    /// Name as in the machine file.
    pub name: &'static str,
    /// `mm` or `rad`.
    pub unit: &'static str,
    /// What its columns begin with: `joint_x`, `joint_1`.
    pub column: String,
}

/// The joints of a machine in order.
pub fn names(machine: &MachineConfiguration) -> Vec<JointName> {
    let names = joint_names(&machine.kinematics).iter().copied();
    let joints = names.zip(&machine.joints);
    let named = joints.map(|(name, joint)| JointName {
        name,
        unit: if joint.rotary { "rad" } else { "mm" },
        column: format!("joint_{}", name.strip_prefix('j').unwrap_or(name)),
    });
    named.collect()
}

/// Joints at every multiple of `every_ticks` (more than 0), and at the end.
pub fn joint_samples<'a>(
    stream: &'a SegmentStream,
    machine: &MachineConfiguration,
    every_ticks: f64,
) -> impl Iterator<Item = Result<JointSample, NoJoints>> + 'a {
    let machine = stream.machine(machine);
    let servo_hz = f64::from(machine.servo_hz);
    let end = duration_ticks(stream);
    // Looks of a row: the last of them is the next row.
    let looks = (every_ticks / TURNS_EVERY_TICKS).ceil().max(1.0);
    let look_ticks = every_ticks / looks;
    let moments = moments_within(stream, servo_hz, look_ticks, [0, end]);
    let at_end = moments_within(stream, servo_hz, 1.0, [end, end]);
    let rows = moments.enumerate().map(move |(look, moment)| {
        let is_row = (look as f64 % looks) == 0.0;
        (is_row, moment)
    });
    let is_before_end =
        move |(_, (sample, _, _)): &(bool, Look)| sample.time_s * servo_hz < end as f64 - SAME_TICK;
    let rows = rows.filter(is_before_end);
    let rows = rows.chain(at_end.map(|moment| (true, moment)).take(1));
    let mut track = JointTrack::new(&machine);
    rows.filter_map(move |(is_row, moment)| {
        let joints = track.joints(&moment.0.position);
        is_row.then(|| match joints {
            Some(position) => Ok(sample_of(&moment, position, &machine)),
            None => Err(NoJoints {
                time_s: moment.0.time_s,
            }),
        })
    })
}

/// A sample, its span and the ticks since that began.
type Look = (StreamSample, Rc<Span>, f64);

fn sample_of(
    (sample, span, local): &Look,
    position: [f64; JOINTS_MAX],
    machine: &MachineConfiguration,
) -> JointSample {
    let moment = Moment::of(span, *local, f64::from(machine.servo_hz));
    let [velocity, acceleration, _] = moment.joint_derivatives(&machine.kinematics);
    let mut steps = [0; JOINTS_MAX];
    for (index, joint) in machine.joints.iter().enumerate() {
        steps[index] = count_of(position[index] * joint.steps_per_unit);
    }
    JointSample {
        sample: *sample,
        position,
        velocity,
        acceleration,
        steps,
    }
}
