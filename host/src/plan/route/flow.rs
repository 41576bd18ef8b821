//! Deposited volume along a printed path: what the advancing front newly covers, times the height.
//!
//! In: poses along a pass (centre, heading), aperture, layer height, flow factor. Out: cumulative
//! volume at each pose, mm³, for the path's volume channel. For a step that moves the centre by d
//! and turns by w, an outline point r with outward normal n advances by n·d + w (r x n); the new
//! ground is the integral of its positive part over the outline (SPEC section 3). Straight travel
//! gives exactly bead width x length. The footprint at the start of a pass is laid by the first
//! length of its run (see [`deposit`]): a front that only moves on leaves it empty.
//! Left out: ground that other passes or earlier parts of this one have covered already.

use crate::geometry::Vector2;
use crate::geometry::aperture::Aperture;
use rayon::prelude::*;

/// A pose of the aperture in the layer plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlowPose {
    /// Aperture centre, mm.
    pub centre_mm: [f64; 2],
    /// Heading, rad, unwrapped.
    pub heading_rad: f64,
}

/// Points of the outline. The front of a pure translation is scaled to be exact, so this bounds
/// only how well the ground of a turn is known: to (pi / n)² = 0.1 %.
const OUTLINE_POINTS: usize = 96;

/// The aperture's outline at heading 0.
struct Outline {
    points: Vec<Vector2>,
    /// Outward normals of the edges that end there, times their lengths (counter-clockwise).
    normals: Vec<Vector2>,
}

impl Outline {
    fn new(aperture: &Aperture) -> Self {
        let points: Vec<Vector2> = (0..OUTLINE_POINTS)
            .map(|i| {
                let angle = std::f64::consts::TAU * i as f64 / OUTLINE_POINTS as f64;
                // Equal angles of the normal bunch points where the outline is sharp.
                aperture.support_point(0.0, Vector2::new(angle.cos(), angle.sin()))
            })
            .collect();
        let normal = |i: usize| {
            let edge = points[i] - points[(i + OUTLINE_POINTS - 1) % OUTLINE_POINTS];
            Vector2::new(edge.y, -edge.x)
        };
        Self {
            normals: (0..OUTLINE_POINTS).map(normal).collect(),
            points,
        }
    }

    /// Ground newly covered by a step `move_mm` (in the aperture's frame) that does not turn, and
    /// by one that turns by `turn_rad`, mm².
    fn fronts_mm2(&self, move_mm: Vector2, turn_rad: f64) -> [f64; 2] {
        let (mut straight, mut turning) = (0.0, 0.0);
        let moved =
            |r: &Vector2| Vector2::new(move_mm.x - turn_rad * r.y, move_mm.y + turn_rad * r.x);
        let mut from = moved(&self.points[OUTLINE_POINTS - 1]);
        for (point, normal) in self.points.iter().zip(&self.normals) {
            let to = moved(point);
            let advance = |moved: Vector2| normal.x * moved.x + normal.y * moved.y;
            straight += advance(move_mm).max(0.0);
            turning += positive_mean(advance(from), advance(to));
            from = to;
        }
        [straight, turning]
    }
}

/// Mean over an edge of the positive part of what goes linearly from `a` to `b`.
fn positive_mean(a: f64, b: f64) -> f64 {
    match (a > 0.0, b > 0.0) {
        (true, true) => 0.5 * (a + b),
        (false, false) => 0.0,
        _ => {
            let high = a.max(b);
            0.5 * high * high / (high - a.min(b))
        }
    }
}

/// Ground newly covered by the step from one pose to the next, mm².
fn step_area_mm2(aperture: &Aperture, outline: &Outline, from: &FlowPose, to: &FlowPose) -> f64 {
    let step = Vector2::new(
        to.centre_mm[0] - from.centre_mm[0],
        to.centre_mm[1] - from.centre_mm[1],
    );
    let turn_rad = to.heading_rad - from.heading_rad;
    let heading_rad = from.heading_rad + 0.5 * turn_rad;
    let length_mm = step.norm();
    let width_mm = if length_mm > 0.0 {
        let across = Vector2::new(-step.y, step.x) / length_mm;
        2.0 * aperture.extent_mm(heading_rad, across)
    } else {
        0.0
    };
    if turn_rad == 0.0 || aperture.is_round() {
        return width_mm * length_mm;
    }
    let (sin, cos) = heading_rad.sin_cos();
    let in_frame = Vector2::new(step.x * cos + step.y * sin, step.y * cos - step.x * sin);
    let [straight, turning] = outline.fronts_mm2(in_frame, turn_rad);
    let correction = if straight > 1e-12 {
        width_mm * length_mm / straight
    } else {
        1.0
    };
    correction * turning
}

/// Weights of the smoothing over neighbouring steps: binomial, so that noise of the headings from
/// step to step does not reach the flow; the sum over the path stays exact.
const SMOOTHING_WEIGHTS: [f64; 5] = [1.0 / 16.0, 4.0 / 16.0, 6.0 / 16.0, 4.0 / 16.0, 1.0 / 16.0];

/// Spreads every step's volume over its neighbours; what would pass an end stays on it.
fn smoothed(steps: &[f64]) -> Vec<f64> {
    let last = steps.len() as isize - 1;
    let mut spread = vec![0.0; steps.len()];
    for (i, step) in steps.iter().enumerate() {
        for (k, weight) in SMOOTHING_WEIGHTS.iter().enumerate() {
            // Reflected at the ends: a constant stays constant.
            let wanted = i as isize + k as isize - 2;
            let mirrored = if wanted < 0 { -1 - wanted } else { wanted };
            let mirrored = if mirrored > last {
                2 * last + 1 - mirrored
            } else {
                mirrored
            };
            spread[mirrored.clamp(0, last) as usize] += weight * step;
        }
    }
    spread
}

/// Cumulative deposited volume at each pose of a pass, mm³, from 0, never falling.
///
/// `start_footprint_mm2` is ground under the aperture at the first pose that nothing has covered
/// (the aperture's area on fresh ground, 0 where a closed pass begins on its own end): the flow
/// brings it along the first aperture length of the path, as a surplus that fades out linearly.
pub fn deposit(
    poses: &[FlowPose],
    aperture: &Aperture,
    height_mm: f64,
    flow_factor: f64,
    start_footprint_mm2: f64,
) -> Vec<f64> {
    if poses.is_empty() {
        return Vec::new();
    }
    let outline = Outline::new(aperture);
    let mut steps: Vec<f64> = poses
        .par_windows(2)
        .map(|pair| step_area_mm2(aperture, &outline, &pair[0], &pair[1]))
        .collect();
    add_start_footprint(&mut steps, poses, aperture, start_footprint_mm2);
    let mut volume_mm3 = 0.0;
    let mut cumulative = Vec::with_capacity(poses.len());
    cumulative.push(volume_mm3);
    for area_mm2 in smoothed(&steps) {
        volume_mm3 += area_mm2 * height_mm * flow_factor;
        cumulative.push(volume_mm3);
    }
    cumulative
}

/// Adds the start's ground to the first steps, with a weight that falls to 0 after one aperture
/// length (or the whole path, where that is shorter).
fn add_start_footprint(
    steps: &mut [f64],
    poses: &[FlowPose],
    aperture: &Aperture,
    start_footprint_mm2: f64,
) {
    let reach_mm = 2.0 * aperture.major_mm();
    let mut along_mm = 0.0;
    let shares: Vec<f64> = poses
        .windows(2)
        .map(|pair| {
            let step_mm = (pair[1].centre_mm[0] - pair[0].centre_mm[0])
                .hypot(pair[1].centre_mm[1] - pair[0].centre_mm[1]);
            let middle_mm = along_mm + 0.5 * step_mm;
            along_mm += step_mm;
            step_mm * (1.0 - middle_mm / reach_mm).max(0.0)
        })
        .collect();
    let total: f64 = shares.iter().sum();
    if total > 0.0 {
        for (step, share) in steps.iter_mut().zip(&shares) {
            *step += start_footprint_mm2 * share / total;
        }
    }
}

/// Shortest duration of a prime or retract of `volume_mm3`: its peak rate (1.875 times the mean)
/// is `rate_mm3_s` at most, its peak acceleration (10 / sqrt 3 volume / duration²)
/// `acceleration_mm3_s2`.
pub fn event_duration_s(volume_mm3: f64, rate_mm3_s: f64, acceleration_mm3_s2: f64) -> f64 {
    let by_rate = 1.875 * volume_mm3 / rate_mm3_s;
    let by_acceleration = (10.0 / 3f64.sqrt() * volume_mm3 / acceleration_mm3_s2).sqrt();
    by_rate.max(by_acceleration)
}

#[cfg(test)]
mod tests {
    //! Goal: the volumes of SPEC section 3 in the cases that have a closed form, and against a
    //! raster for one that has none.
    use super::*;
    use crate::geometry::test_shapes::ELLIPSE;

    fn straight(heading_rad: f64, count: usize) -> Vec<FlowPose> {
        (0..count)
            .map(|i| FlowPose {
                centre_mm: [0.1 * i as f64, 0.0],
                heading_rad,
            })
            .collect()
    }

    #[test]
    fn straight_travel_lays_the_bead_width() {
        for heading_deg in [0.0f64, 20.0, 45.0, 90.0] {
            let phi = heading_deg.to_radians();
            let volume = deposit(&straight(phi, 51), &ELLIPSE, 0.2, 1.1, 0.0);
            let width = 2.0 * ((0.6 * phi.sin()).powi(2) + (0.2 * phi.cos()).powi(2)).sqrt();
            let expected = width * 5.0 * 0.2 * 1.1;
            assert!((volume[50] - expected).abs() < 1e-12, "{heading_deg}");
            assert!((volume[25] - expected / 2.0).abs() < 1e-12);
        }
    }

    #[test]
    fn turning_on_the_spot_lays_what_it_newly_covers() {
        // The front of an ellipse that turns covers |w| (a² - b²) at once: two quarters lead.
        let poses: Vec<FlowPose> = (0..=90)
            .map(|i| FlowPose {
                centre_mm: [0.0, 0.0],
                heading_rad: f64::from(i).to_radians() * 0.1,
            })
            .collect();
        let volume = deposit(&poses, &ELLIPSE, 1.0, 1.0, 0.0);
        let expected = 9f64.to_radians() * (0.36 - 0.04);
        // The outline's polygon, see OUTLINE_POINTS.
        assert!((volume[90] / expected - 1.0).abs() < 2e-3);
    }

    #[test]
    fn a_turn_in_motion_agrees_with_a_raster() {
        // Quarter turn over 1.5 mm, no ground covered twice by the front as a whole.
        let count = 3001;
        let poses: Vec<FlowPose> = (0..count)
            .map(|i| {
                let t = f64::from(i) / f64::from(count - 1);
                FlowPose {
                    centre_mm: [1.5 * t, 0.0],
                    heading_rad: std::f64::consts::FRAC_PI_2 * (1.0 - t),
                }
            })
            .collect();
        let laid = deposit(&poses, &ELLIPSE, 1.0, 1.0, 0.0)[count as usize - 1];
        let cell = 0.005;
        let (mut swept, mut started) = (0, 0);
        for ix in -200..600 {
            for iy in -200..200 {
                let p = Vector2::new(f64::from(ix) * cell, f64::from(iy) * cell);
                let covers = |pose: &FlowPose| {
                    let centre = Vector2::new(pose.centre_mm[0], pose.centre_mm[1]);
                    ELLIPSE.contains(pose.heading_rad, p - centre)
                };
                if covers(&poses[0]) {
                    started += 1;
                } else if poses.iter().step_by(20).any(covers) {
                    swept += 1;
                }
            }
        }
        assert!(started > 10_000);
        let new_mm2 = f64::from(swept) * cell * cell;
        // Raster and sampled sweep 0.3 %; the tips re-cover 1 % that the front counts again.
        assert!((laid / new_mm2 - 1.0).abs() < 0.02, "{laid} {new_mm2}");
    }

    #[test]
    fn the_start_footprint_is_laid_early_and_in_full() {
        let area = ELLIPSE.area_mm2();
        let poses = straight(std::f64::consts::FRAC_PI_2, 101);
        let with = deposit(&poses, &ELLIPSE, 0.2, 1.0, area);
        let without = deposit(&poses, &ELLIPSE, 0.2, 1.0, 0.0);
        assert!((with[100] - without[100] - 0.2 * area).abs() < 1e-12);
        assert!((with[16] - without[16] - 0.2 * area).abs() < 1e-12);
        assert!(with.windows(2).all(|pair| pair[1] > pair[0]));
    }

    #[test]
    fn event_durations_keep_both_limits() {
        assert!((event_duration_s(1.5, 30.0, 1e9) - 0.09375).abs() < 1e-12);
        let short = event_duration_s(1.5, 1e9, 8000.0);
        assert!((10.0 / 3f64.sqrt() * 1.5 / (short * short) - 8000.0).abs() < 1e-6);
    }
}
