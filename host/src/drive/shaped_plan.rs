//! The plan after the input shapers: the reference for shaped steps.
//!
//! Plan at successive servo ticks -> the same with every shaped joint at its shaper's weighted mean of
//! earlier and later ticks, the common delay removed, in f64; the pose is that of these joints. Also the
//! distance of the shaped tip from the planned path (from the nearest point of it, not from the planned
//! position at that time: a shaped head is also a little early or late along the path). Source of the
//! shapers: [`headway_firmware::steps::shaping`]. Not covered: the extruder, which is not shaped.

use crate::drive::servo_walk::{PlanSample, PlanSamples};
use headway_firmware::configuration::{JOINTS_MAX, MachineConfiguration};
use headway_firmware::kinematics::forward;
use headway_firmware::kinematics::pose::Pose;
use headway_firmware::steps::shaping::{Shape, shapes};
use headway_protocol::units::{
    CHANNEL_HEADING, CHANNEL_TILT_X, CHANNEL_TILT_Y, CHANNEL_X, CHANNEL_Y, CHANNEL_Z,
};
use nalgebra::Vector3;
use std::collections::VecDeque;
use std::f64::consts::TAU;

/// Shaped samples, one a servo tick.
#[derive(Debug)]
pub(super) struct ShapedPlan<'a> {
    plan: PlanSamples<'a>,
    machine: &'a MachineConfiguration,
    /// Weights and places, servo ticks later than now (negative: earlier), of every shaped joint.
    taps: Vec<(usize, Vec<(f64, f64)>)>,
    /// The plan around the present sample, which is at `behind`.
    around: VecDeque<PlanSample>,
    behind: usize,
    off_path_mm: f64,
}

impl<'a> ShapedPlan<'a> {
    pub(super) fn new(mut plan: PlanSamples<'a>, machine: &'a MachineConfiguration) -> Self {
        let shapes = shapes(machine);
        let shaped = shapes.iter().enumerate();
        let taps: Vec<_> = shaped
            .filter_map(|(joint, shape)| Some((joint, taps(shape.as_ref()?))))
            .collect();
        let reach = |sign: f64| {
            let places = taps.iter().flat_map(|(_, taps)| taps);
            places
                .fold(0.0f64, |most, (_, at)| most.max(sign * at))
                .ceil() as usize
                + 1
        };
        let (mut behind, mut ahead) = (reach(-1.0), reach(1.0));
        if taps.is_empty() {
            (behind, ahead) = (0, 0);
        }
        let mut around = VecDeque::new();
        if !taps.is_empty() {
            // At rest before the start.
            let first = plan.next();
            around.extend(std::iter::repeat_n(first, behind + 1));
            around.extend((1..ahead).map(|_| plan.next()));
        }
        Self {
            plan,
            machine,
            taps,
            around,
            behind,
            off_path_mm: 0.0,
        }
    }

    /// Largest distance of the shaped tip from the planned path so far.
    pub(super) fn off_path_mm(&self) -> f64 {
        self.off_path_mm
    }

    /// The sample of the next tick.
    pub(super) fn next(&mut self) -> PlanSample {
        let newest = self.plan.next();
        if self.taps.is_empty() {
            return newest;
        }
        self.around.push_back(newest);
        let mut sample = self.around[self.behind];
        let planned_rad = sample.channels[CHANNEL_HEADING];
        for (joint, taps) in &self.taps {
            let mean = taps.iter().map(|(weight, at)| {
                let place = self.behind as f64 + at;
                let (low, part) = (place.floor() as usize, place - place.floor());
                let steps = |tick: usize| {
                    let tick = tick.min(self.around.len() - 1);
                    self.around[tick].joint_steps[*joint]
                };
                weight * (steps(low) + part * (steps(low + 1) - steps(low)))
            });
            sample.joint_steps[*joint] = mean.sum();
        }
        let pose = self.pose(&sample.joint_steps);
        // Forward kinematics knows no turns.
        let turns = ((planned_rad - pose.heading_rad) / TAU).round();
        sample.channels[CHANNEL_X] = pose.tip_mm.x;
        sample.channels[CHANNEL_Y] = pose.tip_mm.y;
        sample.channels[CHANNEL_Z] = pose.tip_mm.z;
        sample.channels[CHANNEL_TILT_X] = pose.tilt_rad.x;
        sample.channels[CHANNEL_TILT_Y] = pose.tilt_rad.y;
        sample.channels[CHANNEL_HEADING] = pose.heading_rad + TAU * turns;
        self.off_path_mm = self.off_path_mm.max(self.distance_mm(&pose.tip_mm));
        self.around.pop_front();
        sample
    }

    fn pose(&self, joint_steps: &[f64; JOINTS_MAX]) -> Pose<f64> {
        let mut positions = [0.0; JOINTS_MAX];
        for (index, joint) in self.machine.joints.iter().enumerate() {
            positions[index] = joint_steps[index] / joint.steps_per_unit;
        }
        forward(&self.machine.kinematics, &positions)
    }

    /// From the path around now.
    fn distance_mm(&self, tip_mm: &Vector3<f64>) -> f64 {
        let place = |sample: &PlanSample| {
            let channels = &sample.channels;
            Vector3::new(
                channels[CHANNEL_X],
                channels[CHANNEL_Y],
                channels[CHANNEL_Z],
            )
        };
        let pairs = self.around.iter().zip(self.around.iter().skip(1));
        let distances = pairs.map(|(from, to)| {
            let (from, to) = (place(from), place(to));
            let way = to - from;
            let along = (tip_mm - from).dot(&way) / way.norm_squared().max(f64::MIN_POSITIVE);
            (tip_mm - (from + along.clamp(0.0, 1.0) * way)).norm()
        });
        distances.fold(f64::INFINITY, f64::min)
    }
}

/// Weights and places around the mean, servo ticks.
fn taps(shape: &Shape) -> Vec<(f64, f64)> {
    let delay_ticks = shape.delay_ticks();
    match shape {
        Shape::Impulses(impulses) => {
            let taps = impulses.iter().filter(|(weight, _)| *weight > 0.0);
            taps.map(|(weight, at)| (*weight, delay_ticks - at))
                .collect()
        }
        Shape::Averages(ticks) => {
            // The average of an average weighs by a triangle.
            let n = i64::from(*ticks);
            let square = (n * n) as f64;
            let weight = |at: i64| (n - at.abs()) as f64 / square;
            (1 - n..n).map(|at| (weight(at), at as f64)).collect()
        }
    }
}
