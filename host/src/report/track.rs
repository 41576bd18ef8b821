//! The motion of one layer as columns of samples, which the page plays, colours and plots.
//!
//! In: a [`SegmentStream`] in machine coordinates, a range of its servo ticks, settings. Out: a [`Track`] at
//! even steps of time, up to a maximum number of samples; mm/s, mm³/s, joint speeds in per cent of their
//! limits. Not covered: values between two samples, as the page notes, and positions and headings
//! ([`super::layer_path`]).

use super::pose_table::{StreamIndex, StreamSample};
use crate::job::{MotionState, SegmentStream};
use crate::settings::{Settings, joint_names};
use headway_firmware::configuration::{JOINTS_MAX, Kinematics, MachineConfiguration};
use headway_firmware::kinematics;
use headway_firmware::kinematics::pose::Pose;
use headway_firmware::kinematics::winding::Winding;
use headway_firmware::path::spline::Span;

/// No limit binds.
pub const NO_LIMIT: u8 = u8::MAX;

/// Columns of samples at even steps, all of one length.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Track {
    /// Time of the first sample in the job, s.
    pub start_s: f64,
    /// How long the motion takes, s.
    pub seconds: f64,
    /// Time between two samples, s.
    pub every_s: f64,
    /// Speed of the tip, mm/s.
    pub speed_mm_s: Vec<f32>,
    /// Flow of the deposited volume, mm³/s.
    pub flow_mm3_s: Vec<f32>,
    /// Speed of each joint in per cent of its limit; the name first.
    pub joints_pct: Vec<(String, Vec<f32>)>,
    /// Position of each joint, mm or rad, continuous, at a fixed step of samples; empty if no links are drawn.
    pub joints_at: Vec<Vec<f32>>,
    /// Number of samples between two of those positions.
    pub joints_every: usize,
    /// Number of the limit that binds, or [`NO_LIMIT`].
    pub limit: Vec<u8>,
}

/// Most positions of a joint as a share of the samples: drawn links need fewer than plotted speeds.
const POSITIONS_SHARE: u64 = 4;

/// What of a stream is sampled.
#[derive(Clone, Copy, Debug)]
pub struct TrackOf<'a> {
    /// The stream.
    pub stream: &'a SegmentStream,
    /// Its settings.
    pub settings: &'a Settings,
    /// Where its spans begin.
    pub index: &'a StreamIndex<'a>,
    /// First and last servo tick.
    pub ticks: [u64; 2],
    /// Most samples (at least two).
    pub samples_max: u64,
}

/// Samples the motion; `limit_at` gives the active limit at a tick of a span.
pub fn track(of: TrackOf, limit_at: impl Fn(&Span, f64) -> Option<usize>) -> Track {
    let [from, end] = of.ticks;
    let every_ticks = (end - from).div_ceil(of.samples_max.max(2)).max(1);
    let machine = &of.stream.machine(&of.settings.machine);
    let servo_hz = f64::from(machine.servo_hz);
    let mut track = Track {
        start_s: from as f64 / servo_hz,
        seconds: (end - from) as f64 / servo_hz,
        every_s: every_ticks as f64 / servo_hz,
        joints_pct: joint_names(&machine.kinematics)
            .iter()
            .map(|name| (name.to_uppercase(), Vec::new()))
            .collect(),
        ..Track::default()
    };
    let links = !matches!(machine.kinematics, Kinematics::Planar);
    let samples = (end - from) / every_ticks + 1;
    let positions_max = (of.samples_max / POSITIONS_SHARE).max(1);
    track.joints_every = samples.div_ceil(positions_max).max(1) as usize;
    track.joints_at = vec![Vec::new(); if links { machine.joints.len() } else { 0 }];
    let mut joints = JointSpeeds::default();
    for (sample, span, t) in of
        .index
        .moments_within(servo_hz, every_ticks as f64, of.ticks)
    {
        let due = track.limit.len().is_multiple_of(track.joints_every);
        track.speed_mm_s.push(sample.speed_mm_s() as f32);
        track.flow_mm3_s.push(sample.flow_mm3_s() as f32);
        let speeds = joints.at(&sample, machine);
        for (column, at) in track.joints_at.iter_mut().zip(joints.last).filter(|_| due) {
            column.push(at as f32);
        }
        for (k, (_, column)) in track.joints_pct.iter_mut().enumerate() {
            column.push(speeds[k]);
        }
        let prints = sample.mark.state == MotionState::Print;
        let limit = prints.then(|| limit_at(&span, t)).flatten();
        let number = limit.and_then(|limit| u8::try_from(limit).ok());
        track.limit.push(number.unwrap_or(NO_LIMIT));
    }
    track
}

/// Joint speeds from one sample to the next.
#[derive(Default)]
struct JointSpeeds {
    /// Positions where the joints last reached.
    last: [f64; JOINTS_MAX],
    before: Option<(f64, [f64; JOINTS_MAX])>,
    winding: Option<Winding<f64>>,
}

impl JointSpeeds {
    /// Per cent of each limit since the sample before; 0 at the first and where no joints reach.
    fn at(&mut self, sample: &StreamSample, machine: &MachineConfiguration) -> [f32; JOINTS_MAX] {
        let mut speeds = [0.0; JOINTS_MAX];
        let pose = Pose::from_channels(&sample.position);
        let Ok(found) = kinematics::inverse(&machine.kinematics, &pose) else {
            self.before = None;
            return speeds;
        };
        let mut position = found.position;
        let at_rest = Winding::at_rest(&machine.kinematics, &position, &machine.ranges());
        let winding = self.winding.get_or_insert(at_rest);
        winding.unwound(&machine.kinematics, &mut position);
        self.last = position;
        if let Some((earlier_s, earlier)) = &self.before {
            let passed_s = sample.time_s - earlier_s;
            for (k, joint) in machine.joints.iter().enumerate() {
                let rate = (position[k] - earlier[k]) / passed_s;
                speeds[k] = (100.0 * rate / joint.speed_max) as f32;
            }
        }
        self.before = Some((sample.time_s, position));
        speeds
    }
}
