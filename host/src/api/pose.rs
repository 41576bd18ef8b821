//! The poses of a job: position and rotation of the nozzle, and the volume that it deposits.
//!
//! In: a sample of the stream, machine coordinates. Out: a [`JobPose`] in the part's coordinates.

use crate::geometry::Vector2;
use crate::geometry::aperture::Aperture;
use crate::job::MotionState;
use crate::job::transform::PartTransform;
use crate::report::pose_table::StreamSample;
use headway_firmware::kinematics::pose::Pose;
use headway_protocol::units::{CHANNEL_X, CHANNEL_Y, CHANNEL_Z};
use nalgebra::Vector3;

/// Slower tips have no direction of travel, mm/s.
const RESTS_MM_S: f64 = 1e-6;

/// One moment of a job.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct JobPose {
    /// Time since the job began.
    pub time_s: f64,
    /// Layer from 0.
    pub layer: u32,
    /// Pass from 0 over the complete job; `None` between passes.
    pub pass: Option<u32>,
    /// The nozzle's tip, the part's coordinates.
    pub tip_mm: [f64; 3],
    /// Unit vector along the tool axis, from the tip into the head.
    pub tool_axis: [f64; 3],
    /// Heading about the tool axis, counter-clockwise, unwrapped.
    pub heading_rad: f64,
    /// Width across the direction of motion: that of the bead; `None` where nothing is printed, or the
    /// tip rests.
    pub width_mm: Option<f64>,
    /// Speed of the tip.
    pub speed_mm_s: f64,
    /// Flow of the deposited volume; 0 off the passes.
    pub flow_mm3_s: f64,
    /// What the head does.
    pub state: MotionState,
}

impl JobPose {
    pub(super) fn of(
        sample: &StreamSample,
        transform: &PartTransform,
        aperture: &Aperture,
    ) -> JobPose {
        let p = &sample.position;
        let pose = Pose::from_channels(p);
        JobPose {
            time_s: sample.time_s,
            layer: sample.mark.layer,
            pass: sample.mark.pass,
            tip_mm: transform.to_input([p[CHANNEL_X], p[CHANNEL_Y], p[CHANNEL_Z]]),
            tool_axis: pose.tool_axis().into(),
            heading_rad: pose.heading_rad,
            width_mm: width_mm(sample, &pose, aperture),
            speed_mm_s: sample.speed_mm_s(),
            flow_mm3_s: sample.flow_mm3_s(),
            state: sample.mark.state,
        }
    }
}

/// The aperture's width across the tip's path, in the plane across the tool axis.
fn width_mm(sample: &StreamSample, pose: &Pose<f64>, aperture: &Aperture) -> Option<f64> {
    if sample.mark.state != MotionState::Print {
        return None;
    }
    let v = &sample.velocity;
    let way = Vector3::new(v[CHANNEL_X], v[CHANNEL_Y], v[CHANNEL_Z]);
    // The heading counts from where the smallest turn of Z onto the tool axis takes X.
    let upright = Pose {
        heading_rad: 0.0,
        ..*pose
    };
    let in_plane = upright.rotation().inverse() * way;
    let along = Vector2::new(in_plane.x, in_plane.y);
    (along.norm() > RESTS_MM_S).then(|| {
        let across = Vector2::new(-along.y, along.x) / along.norm();
        2.0 * aperture.extent_mm(pose.heading_rad, across)
    })
}
