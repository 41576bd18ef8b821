//! Samples of a path and the constraints of its motion at each.
//!
//! In: a [`PathCurve`], the limits. Out: at each sample, by path parameter u, the bounds of u̇ and of
//! |a ü + b x| <= c with x = u̇² (Bobrow, Dubowsky, Gibson 1985), in joint space, for the tip, for
//! the flow and for the extruder. Not covered: the part of the jerk that comes from changes of ü
//! (the smoothing window limits it).

use crate::plan::motion::joint_limits::{MotionLimits, check_range, joint_point, tip_mm};
use crate::plan::motion::motion_error::MotionError;
use crate::plan::route::moves::PathCurve;
use headway_firmware::configuration::JOINTS_MAX;
use headway_firmware::kinematics::winding::Winding;
use headway_protocol::units::{CHANNEL_HEADING, CHANNEL_TILT_X, CHANNEL_VOLUME};
use nalgebra::Vector3;

/// A path sample: data for the constraints, by path parameter u.
#[derive(Clone, Copy, Debug)]
pub struct PathSample {
    /// Path parameter.
    pub u: f64,
    joint_first: [f64; JOINTS_MAX],
    joint_second: [f64; JOINTS_MAX],
    joint_third: [f64; JOINTS_MAX],
    tip_speed_mm: f64,
    tip_along_mm: f64,
    tip_across_mm: f64,
    volume_first_mm3: f64,
    volume_second_mm3: f64,
}

/// Path length of the tip along the samples, mm.
pub fn tip_way_mm(samples: &[PathSample]) -> f64 {
    let pairs = samples.windows(2);
    pairs
        .map(|pair| 0.5 * (pair[0].tip_speed_mm + pair[1].tip_speed_mm) * (pair[1].u - pair[0].u))
        .sum()
}

/// One constraint |a ü + b x| <= c.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Row {
    /// Factor of ü, not negative.
    pub a: f64,
    /// Factor of x = u̇².
    pub b: f64,
    /// Bound.
    pub c: f64,
}

/// Normals (sine, cosine of 11.25°, 33.75°, ...) of the inscribed polygon that represents a quarter
/// of the circle of tip accelerations: four sides lose at most 1 - cos(11.25°) = 2 % of it, and
/// nothing on a straight line.
const TIP_SIDES: [[f64; 2]; 4] = [
    [0.195_090_322_016_128_27, 0.980_785_280_403_230_4],
    [0.555_570_233_019_602_2, 0.831_469_612_302_545_2],
    [0.831_469_612_302_545_2, 0.555_570_233_019_602_2],
    [0.980_785_280_403_230_4, 0.195_090_322_016_128_27],
];
/// Most rows of a sample.
pub const ROWS_MAX: usize = JOINTS_MAX + 2 + 1 + 2 * TIP_SIDES.len();

/// Longest distance between samples, of the aperture's unit.
const SAMPLE_STEP: f64 = 0.05;
/// Largest turn of heading or tilt between samples.
const SAMPLE_STEP_RAD: f64 = 0.03;
/// Longest time between samples at the limit of the tip's speed: where it alone binds, the rate
/// follows the shape of the path, and between coarser samples of a slow path it runs beyond.
const SAMPLE_STEP_S: f64 = 0.1;
/// Least distance of samples, of the unit: slower paths get no more of them.
const SAMPLE_STEP_MIN: f64 = 0.003;
/// Least samples a span and a move: second derivatives are linear in a span.
const SAMPLES_PER_SPAN_MIN: usize = 2;
const SAMPLES_PER_STRETCH_MIN: usize = 200;
/// Bound for absurdly long spans: the grid only gets coarser.
const SAMPLES_PER_SPAN_MAX: usize = 20_000;

impl PathSample {
    fn new(
        curve: &PathCurve,
        span: usize,
        s: f64,
        limits: &MotionLimits,
        winding: &mut Winding<f64>,
    ) -> Result<Self, MotionError> {
        let point = curve.evaluate_in_span(span, s);
        let mut joints = joint_point(&limits.kinematics, &point)?;
        winding.unwound(&limits.kinematics, &mut joints.position);
        check_range(limits, tip_mm(&point.value), &joints.position)?;
        let first = Vector3::from(tip_mm(&point.first));
        let second = Vector3::from(tip_mm(&point.second));
        let speed = first.norm();
        let along = if speed > 1e-9 {
            first.dot(&second) / speed
        } else {
            second.norm()
        };
        Ok(Self {
            u: span as f64 + s,
            joint_first: joints.first,
            joint_second: joints.second,
            joint_third: joints.third,
            tip_speed_mm: speed,
            tip_along_mm: along,
            tip_across_mm: (second.norm_squared() - along * along).max(0.0).sqrt(),
            volume_first_mm3: point.first[CHANNEL_VOLUME],
            volume_second_mm3: point.second[CHANNEL_VOLUME],
        })
    }

    /// True where the joint has a share in the motion.
    pub fn moves_joint(&self, joint: usize) -> bool {
        self.joint_first[joint].abs() > 1e-9 || self.joint_second[joint].abs() > 1e-9
    }

    /// Largest u̇ that every speed limit (and the jerk of the path's shape) allows, times `scale`.
    pub fn rate_max(&self, limits: &MotionLimits, scale: f64) -> f64 {
        let mut inverse: f64 = self.tip_speed_mm / limits.tip_speed_at_mm_s(self.u);
        let joints = limits.bounded([&self.joint_first, &self.joint_third]);
        for (limit, [first, third]) in joints {
            inverse = inverse.max(first.abs() / limit.speed_max);
            // The part of the jerk that the path's shape makes at constant u̇.
            inverse = inverse.max((third.abs() / limit.jerk_max).cbrt());
        }
        inverse = inverse.max(self.volume_first_mm3.abs() / limits.flow_rate_max_mm3_s());
        scale / inverse.max(1e-9)
    }

    /// Fastest that the tip or a joint may go here, mm/s or rad/s.
    pub fn fastest(&self, limits: &MotionLimits) -> f64 {
        let joints = self.joint_first.iter().map(|first| first.abs());
        self.rate_max(limits, 1.0) * joints.fold(self.tip_speed_mm, f64::max)
    }

    /// Fills the acceleration constraints, bounds times `scale`; returns how many.
    pub fn rows(&self, limits: &MotionLimits, scale: f64, rows: &mut [Row; ROWS_MAX]) -> usize {
        let mut count = 0;
        let mut push = |a: f64, b: f64, c: f64| {
            // Rows that cannot bind (a joint at rest) are dropped.
            if a != 0.0 || b != 0.0 {
                let sign = if a < 0.0 { -1.0 } else { 1.0 };
                rows[count] = Row {
                    a: sign * a,
                    b: sign * b,
                    c: c * scale,
                };
                count += 1;
            }
        };
        let joints = limits.bounded([&self.joint_first, &self.joint_second]);
        for (limit, [first, second]) in joints {
            push(first, second, limit.acceleration_max);
        }
        let flow_bound = limits.flow_slope_max_mm3_s2();
        push(self.volume_first_mm3, self.volume_second_mm3, flow_bound);
        let bound = limits.tip_acceleration_mm_s2 * TIP_SIDES[0][1];
        for [sin, cos] in TIP_SIDES {
            let across = self.tip_across_mm * sin;
            let (along, speed) = (self.tip_along_mm * cos, self.tip_speed_mm * cos);
            push(speed, along + across, bound);
            push(speed, along - across, bound);
        }
        count
    }
}

/// How many cells a span is cut into.
fn cells_of_span(curve: &PathCurve, span: usize, limits: &MotionLimits) -> usize {
    let (a, b) = (&curve.control[span], &curve.control[span + 1]);
    let leg_mm = |a, b| (Vector3::from(tip_mm(a)) - Vector3::from(tip_mm(b))).norm();
    let turn_rad = (CHANNEL_TILT_X..=CHANNEL_HEADING)
        .map(|channel| (a[channel] - b[channel]).abs())
        .fold(0.0, f64::max);
    // Where the tip turns back, its speed in the span comes from the adjacent legs.
    let last = curve.control.len() - 1;
    let legs = curve.control[span.saturating_sub(1)..=(span + 2).min(last)].windows(2);
    let longest_mm = legs.map(|leg| leg_mm(&leg[0], &leg[1])).fold(0.0, f64::max);
    let unit_mm = limits.unit_mm;
    let slow_mm = (limits.slowest_tip_mm_s() * SAMPLE_STEP_S).max(SAMPLE_STEP_MIN * unit_mm);
    let cells = (leg_mm(a, b) / (SAMPLE_STEP * unit_mm))
        .max(turn_rad / SAMPLE_STEP_RAD)
        .max(longest_mm / slow_mm);
    let least = SAMPLES_PER_SPAN_MIN.max(SAMPLES_PER_STRETCH_MIN.div_ceil(curve.span_count()));
    (cells.ceil() as usize).clamp(least, SAMPLES_PER_SPAN_MAX)
}

/// Samples a curve of at least two control points from end to end, fine enough for the reachability
/// analysis. Fails if a joint leaves its range or the pose is unreachable.
pub fn sample_path(
    curve: &PathCurve,
    limits: &MotionLimits,
) -> Result<Vec<PathSample>, MotionError> {
    let cells_of = |span| cells_of_span(curve, span, limits);
    // Counted first: a long path's samples are most of what planning needs of memory.
    let count = (0..curve.span_count()).map(cells_of).sum::<usize>() + 1;
    let mut samples = Vec::with_capacity(count);
    let mut winding = limits.winding;
    for span in 0..curve.span_count() {
        let cells = cells_of(span);
        for cell in 0..cells {
            let s = cell as f64 / cells as f64;
            samples.push(PathSample::new(curve, span, s, limits, &mut winding)?);
        }
    }
    let last = curve.span_count() - 1;
    samples.push(PathSample::new(curve, last, 1.0, limits, &mut winding)?);
    Ok(samples)
}
