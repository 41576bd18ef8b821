//! Deposited volume along a printed path: the area that the advancing front newly covers, times the
//! height.
//!
//! In: poses along a pass (centre, heading), aperture, layer height, flow factor. Out: cumulative
//! volume at each pose, mm³, for the path's volume channel. For a step that moves the centre by d and
//! turns by w, an outline point r with outward normal n advances by n·d + w (r x n); the new area is
//! the integral of its positive part over the outline (docs/design/flow.md). Straight travel gives
//! exactly bead width x length. Only the part of the front counts that meets area not covered by any
//! pass or an earlier part of this one ([`fresh_ground`]). The footprint at the start of a pass is
//! added to the first length of its path, since the advancing front does not fill it. The flow is
//! averaged over a short length, so that the extruder can follow it; the sum is unchanged.

pub mod fresh_ground;
pub mod pass_volumes;

use crate::geometry::Vector2;
use crate::geometry::aperture::Aperture;
use crate::geometry::clearance::Configuration;
use crate::geometry::place_scale::ScaleField;
use crate::plan::route::flow::fresh_ground::FreshShares;
use crate::settings::Settings;
use rayon::prelude::*;

/// Points of the outline. The front of a pure translation is scaled to be exact, so this only
/// bounds the accuracy of a turn's area: to (pi / n)² = 0.1 %.
const OUTLINE_POINTS: usize = 96;

/// Turn of the major axis' end, against the move, below which a step is straight: what both ends of
/// the front do is opposite, so that it counts by its square.
const HARDLY_TURNED_SHARE: f64 = 3e-3;

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

/// Mean over an edge of the positive part of a value that changes linearly from `a` to `b`.
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
fn step_area_mm2(
    aperture: &Aperture,
    outline: &Outline,
    from: &Configuration,
    to: &Configuration,
) -> f64 {
    let step = to.center - from.center;
    let turn_rad = to.heading_rad - from.heading_rad;
    let heading_rad = from.heading_rad + 0.5 * turn_rad;
    let length_mm = step.norm();
    let width_mm = if length_mm > 0.0 {
        let across = Vector2::new(-step.y, step.x) / length_mm;
        2.0 * aperture.extent_mm(heading_rad, across)
    } else {
        0.0
    };
    let turned_mm = turn_rad.abs() * aperture.major_mm();
    if turned_mm <= HARDLY_TURNED_SHARE * length_mm || aperture.is_round() {
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

/// The bead of a pass.
#[derive(Clone, Copy, Debug)]
pub struct Bead<'a> {
    /// The nozzle.
    pub aperture: &'a Aperture,
    /// Layer height, mm.
    pub height_mm: f64,
    /// Ratio of the deposited volume to the covered area times the height.
    pub flow_factor: f64,
    /// Length over which the flow is averaged, [`SMOOTHING_ROUNDS`] times, mm.
    pub smoothing_mm: f64,
    /// Size of the nozzle by position, if the plane is the chart of a curved surface.
    pub scale: Option<&'a ScaleField>,
}

impl<'a> Bead<'a> {
    /// The bead of a job.
    pub fn of(settings: &'a Settings) -> Bead<'a> {
        let aperture = &settings.aperture;
        // The widest bead that ends at full speed, at three quarters of its width over a length: the
        // steepest part of the bell.
        let flow_mm3_s = 2.0 * aperture.major_mm() * settings.layer_height_mm * settings.speed_mm_s;
        let change_max_mm3_s2 = settings.flow_rate_of_change_max_mm3_s2 * settings.plan_share;
        let needed_mm = 0.75 * flow_mm3_s * settings.speed_mm_s / change_max_mm3_s2;
        let [least, most] = SMOOTHING_SHARE.map(|share| share * aperture.minor_mm());
        Bead {
            aperture,
            height_mm: settings.layer_height_mm,
            flow_factor: settings.flow_factor,
            smoothing_mm: needed_mm.clamp(least, most),
            scale: None,
        }
    }

    /// Ground newly covered by a step, mm². Where the nozzle is larger or smaller it is seen from a plane that is as much so.
    fn step_mm2(&self, outline: &Outline, from: &Configuration, to: &Configuration) -> f64 {
        let Some(scale) = self.scale else {
            return step_area_mm2(self.aperture, outline, from, to);
        };
        let lambda = scale.at(nalgebra::center(&from.center, &to.center)).lambda;
        let [from, to] = [from, to].map(|pose| Configuration {
            center: pose.center * lambda,
            ..*pose
        });
        step_area_mm2(self.aperture, outline, &from, &to) / lambda.powi(2)
    }

    /// Cumulative deposited volume at each pose of a pass, mm³, from 0, never decreasing: the area
    /// that the steps newly cover, with `fresh` as its share of their fronts.
    ///
    /// The newly covered area under the first pose is deposited along the first aperture length of
    /// the path, as a surplus that decreases linearly.
    pub fn deposit(&self, poses: &[Configuration], fresh: &FreshShares) -> Vec<f64> {
        if poses.is_empty() {
            return Vec::new();
        }
        let outline = Outline::new(self.aperture);
        let steps = poses.par_windows(2).zip(&fresh.steps);
        let mut steps: Vec<f64> = steps
            .map(|(pair, share)| share * self.step_mm2(&outline, &pair[0], &pair[1]))
            .collect();
        let mut start_mm2 = fresh.start * self.aperture.area_mm2();
        if let Some(scale) = self.scale {
            start_mm2 /= scale.at(poses[0].center).lambda.powi(2);
        }
        add_start_footprint(&mut steps, poses, self.aperture, start_mm2);
        let mut area_mm2 = 0.0;
        let mut cumulative = vec![area_mm2];
        for step in steps {
            area_mm2 += step;
            cumulative.push(area_mm2);
        }
        let places = places_mm(poses, self.aperture);
        for _ in 0..SMOOTHING_ROUNDS {
            cumulative = averaged(&places, &cumulative, 0.5 * self.smoothing_mm);
        }
        let mm = self.height_mm * self.flow_factor;
        cumulative
            .into_iter()
            .map(|area_mm2| mm * area_mm2)
            .collect()
    }
}

/// Shortest and longest averaging against the minor semi-axis: flow is known to no less than a
/// quarter of the front, and deposited no farther than the front from where it belongs.
const SMOOTHING_SHARE: [f64; 2] = [1.0, 2.0];

/// Rounds of averaging: of three boxes becomes a bell.
pub const SMOOTHING_ROUNDS: usize = 3;

/// Place of each pose along the pass, mm; a turn counts as the path of the minor axis's end.
fn places_mm(poses: &[Configuration], aperture: &Aperture) -> Vec<f64> {
    let mut places = vec![0.0];
    let mut place_mm = 0.0;
    for pair in poses.windows(2) {
        let turn_rad = (pair[1].heading_rad - pair[0].heading_rad).abs();
        place_mm += step_length_mm(pair) + aperture.minor_mm() * turn_rad;
        places.push(place_mm);
    }
    places
}

fn step_length_mm(pair: &[Configuration]) -> f64 {
    let step = pair[1].center - pair[0].center;
    step.x.hypot(step.y)
}

/// The mean of a rising function over `half_mm` to either side of each place. Beyond the ends the
/// function continues as its point reflection there, so that they stay in place.
fn averaged(places_mm: &[f64], values: &[f64], half_mm: f64) -> Vec<f64> {
    let last = values.len() - 1;
    let length_mm = places_mm[last];
    let half_mm = half_mm.min(length_mm);
    if half_mm <= 0.0 {
        return values.to_vec();
    }
    let mut integrals = vec![0.0];
    let mut integral = 0.0;
    for i in 0..last {
        integral += 0.5 * (values[i] + values[i + 1]) * (places_mm[i + 1] - places_mm[i]);
        integrals.push(integral);
    }
    // Places rise, so that the step which holds one is found from that of the one before.
    let within = |at_mm: f64, from: &mut usize| {
        while *from > 0 && places_mm[*from] > at_mm {
            *from -= 1;
        }
        while *from + 1 < last && places_mm[*from + 1] <= at_mm {
            *from += 1;
        }
        let (low, width_mm) = (
            at_mm - places_mm[*from],
            places_mm[*from + 1] - places_mm[*from],
        );
        let slope = (values[*from + 1] - values[*from]) / width_mm.max(f64::MIN_POSITIVE);
        integrals[*from] + low * (values[*from] + 0.5 * slope * low)
    };
    let to = |at_mm: f64, from: &mut usize| {
        let beyond_mm = at_mm - length_mm;
        if beyond_mm > 0.0 {
            within(length_mm - beyond_mm, from) + 2.0 * values[last] * beyond_mm
        } else {
            within(at_mm.abs(), from)
        }
    };
    let (mut below, mut above) = (0, 0);
    let places = places_mm.iter();
    places
        .map(|at_mm| {
            let [low, high] = [
                to(at_mm - half_mm, &mut below),
                to(at_mm + half_mm, &mut above),
            ];
            (high - low) / (2.0 * half_mm)
        })
        .collect()
}

/// Adds the start's area to the first steps, with a weight that falls to 0 after one aperture
/// length (or the whole path, where that is shorter).
fn add_start_footprint(
    steps: &mut [f64],
    poses: &[Configuration],
    aperture: &Aperture,
    start_footprint_mm2: f64,
) {
    let reach_mm = 2.0 * aperture.major_mm();
    let mut along_mm = 0.0;
    let shares: Vec<f64> = poses
        .windows(2)
        .map(|pair| {
            let step_mm = step_length_mm(pair);
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

/// Peak of a quintic smooth step's rate, against its mean.
pub const QUINTIC_PEAK: f64 = 15.0 / 8.0;

/// Shortest duration of a prime or retract of `volume_mm3`: its peak rate (1.875 times the mean)
/// is `rate_mm3_s` at most, its peak acceleration (10 / sqrt 3 volume / duration²)
/// `acceleration_mm3_s2`.
pub fn event_duration_s(volume_mm3: f64, rate_mm3_s: f64, acceleration_mm3_s2: f64) -> f64 {
    let by_rate = QUINTIC_PEAK * volume_mm3 / rate_mm3_s;
    let by_acceleration = (10.0 / 3f64.sqrt() * volume_mm3 / acceleration_mm3_s2).sqrt();
    by_rate.max(by_acceleration)
}

#[cfg(test)]
mod tests {
    //! Goal: the volumes of docs/design/flow.md in the cases that have a closed form, and against a
    //! raster for one that has none.
    use super::*;
    use crate::geometry::Point2;
    use crate::geometry::test_shapes::ELLIPSE;

    fn bead(height_mm: f64, flow_factor: f64) -> Bead<'static> {
        Bead {
            aperture: &ELLIPSE,
            height_mm,
            flow_factor,
            smoothing_mm: 0.3,
            scale: None,
        }
    }

    /// On ground that nothing has covered, with or without that under the first pose.
    fn deposit(poses: &[Configuration], bead: &Bead, start: f64) -> Vec<f64> {
        let fresh = FreshShares {
            start,
            ..FreshShares::all(poses.len())
        };
        bead.deposit(poses, &fresh)
    }

    fn straight(heading_rad: f64, count: usize) -> Vec<Configuration> {
        (0..count)
            .map(|i| Configuration {
                center: Point2::new(0.1 * i as f64, 0.0),
                heading_rad,
            })
            .collect()
    }

    #[test]
    fn straight_travel_lays_the_bead_width() {
        for heading_deg in [0.0f64, 20.0, 45.0, 90.0] {
            let phi = heading_deg.to_radians();
            let volume = deposit(&straight(phi, 51), &bead(0.2, 1.1), 0.0);
            let width = 2.0 * ((0.6 * phi.sin()).powi(2) + (0.2 * phi.cos()).powi(2)).sqrt();
            let expected = width * 5.0 * 0.2 * 1.1;
            assert!((volume[50] - expected).abs() < 1e-12, "{heading_deg}");
            assert!((volume[25] - expected / 2.0).abs() < 1e-12);
        }
    }

    #[test]
    fn turning_on_the_spot_lays_what_it_newly_covers() {
        // The front of an ellipse that turns covers |w| (a² - b²) at once: two quarters lead.
        let poses: Vec<Configuration> = (0..=90)
            .map(|i| Configuration {
                center: Point2::origin(),
                heading_rad: f64::from(i).to_radians() * 0.1,
            })
            .collect();
        let volume = deposit(&poses, &bead(1.0, 1.0), 0.0);
        let expected = 9f64.to_radians() * (0.36 - 0.04);
        // The outline's polygon, see OUTLINE_POINTS.
        assert!((volume[90] / expected - 1.0).abs() < 2e-3);
    }

    #[test]
    fn a_turn_in_motion_agrees_with_a_raster() {
        // Quarter turn over 1.5 mm, no ground covered twice by the front as a whole.
        let count = 3001;
        let poses: Vec<Configuration> = (0..count)
            .map(|i| {
                let t = f64::from(i) / f64::from(count - 1);
                Configuration {
                    center: Point2::new(1.5 * t, 0.0),
                    heading_rad: std::f64::consts::FRAC_PI_2 * (1.0 - t),
                }
            })
            .collect();
        let laid = deposit(&poses, &bead(1.0, 1.0), 0.0)[count as usize - 1];
        let cell = 0.005;
        let (mut swept, mut started) = (0, 0);
        for ix in -200..600 {
            for iy in -200..200 {
                let p = Vector2::new(f64::from(ix) * cell, f64::from(iy) * cell);
                let covers = |pose: &Configuration| {
                    ELLIPSE.contains(pose.heading_rad, p - pose.center.coords)
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
        let with = deposit(&poses, &bead(0.2, 1.0), 1.0);
        let without = deposit(&poses, &bead(0.2, 1.0), 0.0);
        assert!((with[100] - without[100] - 0.2 * area).abs() < 1e-12);
        // One aperture length, half of three averagings and a step for each.
        assert!((with[20] - without[20] - 0.2 * area).abs() < 1e-12);
        assert!(with.windows(2).all(|pair| pair[1] > pair[0]));
    }

    /// Goal: flow that is to end at once ends over a short length, the sum as it is, without running
    /// back. Method: a straight bead whose second half lies on covered ground.
    #[test]
    fn flow_ends_over_a_length_and_not_at_once() {
        let poses = straight(std::f64::consts::FRAC_PI_2, 201);
        let steps = (0..200).map(|i| if i < 100 { 1.0 } else { 0.0 });
        let fresh = FreshShares {
            start: 0.0,
            steps: steps.collect(),
        };
        let volume = bead(1.0, 1.0).deposit(&poses, &fresh);
        assert!((volume[200] - 12.0).abs() < 1e-9, "{}", volume[200]);
        for (i, pair) in volume.windows(2).enumerate() {
            let rate_mm2 = (pair[1] - pair[0]) / 0.1;
            // Three boxes of 0.3 mm reach 0.45 mm to either side, and a step further each.
            let expected_mm2 = match i {
                0..92 => [1.2 - 1e-9, 1.2 + 1e-9],
                108.. => [-1e-9, 1e-9],
                _ => [-1e-9, 1.2 + 1e-9],
            };
            assert!(
                rate_mm2 >= expected_mm2[0] && rate_mm2 <= expected_mm2[1],
                "{i}: {rate_mm2}"
            );
        }
        let steepest = volume.windows(3).map(|w| w[0] - 2.0 * w[1] + w[2]);
        let steepest = steepest.fold(0.0, f64::min) / 0.01;
        // 0.75 of the width over the length of the averaging.
        assert!(steepest > -1.05 * 0.75 * 1.2 / 0.3, "{steepest}");
    }

    #[test]
    fn event_durations_keep_both_limits() {
        assert!((event_duration_s(1.5, 30.0, 1e9) - 0.09375).abs() < 1e-12);
        let short = event_duration_s(1.5, 1e9, 8000.0);
        assert!((10.0 / 3f64.sqrt() * 1.5 / (short * short) - 8000.0).abs() < 1e-6);
    }
}
