//! A stream's motion as curves over time: tip speed, joints, heading, flow.

use super::plots::{Curve, Panel, TimePlots};
use super::pose_table::{duration_ticks, samples_within};
use crate::job::{MotionState, SegmentStream};
use crate::settings::{Settings, joint_names};
use headway_firmware::configuration::{JOINTS_MAX, JointConfiguration, MachineConfiguration};
use headway_firmware::kinematics;
use headway_firmware::kinematics::pose::Pose;
use headway_firmware::kinematics::winding::Winding;
use headway_protocol::units::CHANNEL_HEADING;

/// Most samples of a curve: forty for each pixel, so that least and greatest are true to a pixel.
const SAMPLES_MAX: u64 = 40_000;

/// What of the stream is shown, and how long that lasts, ticks.
fn shown(stream: &SegmentStream) -> (String, u64) {
    match stream.layers() {
        0 | 1 => (String::new(), duration_ticks(stream)),
        layers => {
            let [_, end] = stream.ticks_of_layer(0);
            (format!(", layer 1 of {layers}"), end)
        }
    }
}

/// Samples the stream for the report's motion sheet: its first layer, where there are more.
pub fn stream_plots(title: &str, stream: &SegmentStream, settings: &Settings) -> TimePlots {
    let machine = &stream.machine(&settings.machine);
    let servo_hz = f64::from(machine.servo_hz);
    let (what, ticks) = shown(stream);
    let every_ticks = ticks.div_ceil(SAMPLES_MAX).max(1) as f64;
    let names = joint_names(&machine.kinematics);
    let (mut speed, mut heading, mut flow) = (Vec::new(), Vec::new(), Vec::new());
    let mut joints: Vec<Vec<[f64; 2]>> = vec![Vec::new(); names.len()];
    let mut places = joints.clone();
    let mut before: Option<(f64, [f64; JOINTS_MAX])> = None;
    let mut winding: Option<Winding<f64>> = None;
    for sample in samples_within(stream, servo_hz, every_ticks, [0, ticks]) {
        let time_s = sample.time_s;
        speed.push([time_s, sample.speed_mm_s()]);
        heading.push([time_s, sample.position[CHANNEL_HEADING].to_degrees()]);
        flow.push([time_s, sample.flow_mm3_s()]);
        let pose = Pose::from_channels(&sample.position);
        let Ok(found) = kinematics::inverse(&machine.kinematics, &pose) else {
            before = None;
            continue;
        };
        let mut position = found.position;
        unwind(&mut winding, &mut position, machine);
        for (k, places) in places.iter_mut().enumerate() {
            let place_pct = place_pct(&machine.joints[k], position[k]);
            places.extend(place_pct.map(|place_pct| [time_s, place_pct]));
        }
        if let Some((earlier_s, earlier)) = &before {
            for (k, joint) in machine.joints.iter().enumerate() {
                let rate = (position[k] - earlier[k]) / (time_s - earlier_s);
                joints[k].push([time_s, 100.0 * rate / joint.speed_max]);
            }
        }
        before = Some((time_s, position));
    }
    let panel = |title: &str, limit, curves| Panel {
        title: title.to_string(),
        limit,
        curves,
    };
    TimePlots {
        title: format!("{title}: motion as planned{what}"),
        duration_s: ticks as f64 / servo_hz,
        bands: bands(stream, ticks, servo_hz),
        panels: vec![
            panel("Tip speed, mm/s", None, one(speed)),
            panel(
                "Joint speeds, % of each joint's limit",
                Some(100.0),
                of_joints(names, joints),
            ),
            panel(
                "Joint positions, % of the distance from the middle of the range to its ends",
                Some(100.0),
                of_joints(names, places),
            ),
            panel("Heading, degrees", None, one(heading)),
            panel(
                "Flow of deposited volume, mm³/s",
                Some(settings.flow_max_mm3_s * settings.plan_share),
                one(flow),
            ),
        ],
    }
}

/// What the head does, from when to when, s.
fn bands(stream: &SegmentStream, ticks: u64, servo_hz: f64) -> Vec<(f64, f64, MotionState)> {
    let shown = stream.marks.iter().filter(|mark| mark.start_tick < ticks);
    let seconds = |tick: u64| tick as f64 / servo_hz;
    shown
        .map(|mark| (seconds(mark.start_tick), seconds(mark.end_tick), mark.state))
        .collect()
}

/// A panel's only curve.
fn one(points: Vec<[f64; 2]>) -> Vec<Curve> {
    let name = String::new();
    vec![Curve { name, points }]
}

/// A curve for each joint that has points.
fn of_joints(names: &[&str], points: Vec<Vec<[f64; 2]>>) -> Vec<Curve> {
    let of_joints = names.iter().zip(points);
    of_joints
        .filter(|(_, points)| !points.is_empty())
        .map(|(name, points)| Curve {
            name: name.to_uppercase(),
            points,
        })
        .collect()
}

/// Where a joint is, from the middle of its range (0) to its ends (-100 and 100); a joint without ends is
/// nowhere between them.
fn place_pct(joint: &JointConfiguration, position: f64) -> Option<f64> {
    let half = 0.5 * (joint.position_max - joint.position_min);
    half.is_finite()
        .then(|| 100.0 * ((position - joint.position_min) / half - 1.0))
}

/// Adds the turns that joints have made since the first sample.
fn unwind(
    winding: &mut Option<Winding<f64>>,
    position: &mut [f64; JOINTS_MAX],
    machine: &MachineConfiguration,
) {
    let kinematics = &machine.kinematics;
    let at_rest = Winding::at_rest(kinematics, position, &machine.ranges());
    winding.get_or_insert(at_rest).unwound(kinematics, position);
}
