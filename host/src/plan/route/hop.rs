//! One travel without a stop: up, across and down as one curve (a z-hop with rounded corners).
//!
//! Up to half the lift the head moves straight up, so that it leaves the bead; then Z decelerates while
//! the head begins to cross, both at constant accelerations: a quadratic corner. The end is the same in
//! reverse. The corner's length along the path is chosen so that neither waits for the other.
//!
//! In: pose at rest, legs of the path (mm), heading at their end (rad), heights (mm), limits. Out:
//! control points of one curve in channel space (mm, rad, mm³). Not covered: time, which the motion
//! stage finds.

use crate::geometry::Point2;
use crate::settings::Settings;
use headway_protocol::units::{CHANNEL_HEADING, CHANNEL_X, CHANNEL_Y, CHANNEL_Z, CHANNELS};

/// Steps of one corner; the straight piece below it takes half as many.
const CORNER_STEPS: usize = 12;
/// Maximum number of steps along the path; longer ones have longer steps.
const CROSS_STEPS_MAX: f64 = 20_000.0;
/// Least length of a corner along a long path, of the aperture's unit: without a lift there is nothing to wait for.
const CORNER_MIN: f64 = 0.5;
/// A distance below this counts as 0, of the unit: the head lifts, turns and lowers.
const CROSS_MIN: f64 = 0.05;

/// True where a pass begins right above the end of another: nothing is crossed, so the material stays where it is.
pub fn is_right_above(begin_mm: [f64; 3], end_mm: [f64; 3], settings: &Settings) -> bool {
    let [x, y, z] = [0, 1, 2].map(|axis| begin_mm[axis] - end_mm[axis]);
    z > 0.0 && x.hypot(y) < CROSS_MIN * settings.aperture.unit_mm()
}

/// What a hop climbs, and where it goes.
#[derive(Clone, Debug)]
pub(super) struct Hop<'a> {
    /// Pose at rest before it.
    pub(super) start: [f64; CHANNELS],
    /// The path, with its first point at the start.
    pub(super) legs: &'a [Point2],
    /// Heading at its end; turned in proportion to the path.
    pub(super) heading_rad: f64,
    /// Height that is crossed at.
    pub(super) above_mm: f64,
    /// Height at the end.
    pub(super) end_mm: f64,
    /// Longest step along the path; infinite where it has no corners.
    pub(super) step_mm: f64,
}

impl Hop<'_> {
    /// The control points; `None` if there is nothing to cross.
    pub(super) fn control(&self, settings: &Settings) -> Option<Vec<[f64; CHANNELS]>> {
        let way = Polyline::new(self.legs);
        let (up_mm, down_mm) = (
            self.above_mm - self.start[CHANNEL_Z],
            self.above_mm - self.end_mm,
        );
        let unit_mm = settings.aperture.unit_mm();
        if way.whole_mm < CROSS_MIN * unit_mm {
            return None;
        }
        let corner_mm = corner_mm(up_mm.max(down_mm), settings).max(CORNER_MIN * unit_mm);
        let corner_mm = corner_mm.min(0.5 * way.whole_mm);
        let steps = (2.0 * corner_mm / self.step_mm)
            .ceil()
            .max(CORNER_STEPS as f64);
        let steps = steps.min(CROSS_STEPS_MAX);
        // The piece between both corners in whole steps as long as the corners' last one.
        let between = ((way.whole_mm / corner_mm - 2.0) * steps / 2.0).round();
        let between = between.clamp(0.0, CROSS_STEPS_MAX);
        let corner_mm = way.whole_mm / (2.0 + 2.0 * between / steps);
        let steps = steps as usize;
        let pose = |along_mm: f64, z_mm: f64| self.pose(&way, along_mm, z_mm);
        // Z and distance of a quadratic corner, with its share from the straight part up or down.
        let z_share = |share: f64| 0.5 + share - 0.5 * share * share;
        let mut control = Vec::with_capacity(3 * steps + between as usize + 2);
        let height = |i: usize| i as f64 / steps as f64;
        let shares = || (0..=steps).map(|i| i as f64 / steps as f64);
        let start_mm = self.start[CHANNEL_Z];
        let upright = |rise_mm: f64| if rise_mm > 0.0 { steps.div_ceil(2) } else { 0 };
        let above_start = 0..upright(up_mm);
        control.extend(above_start.map(|i| pose(0.0, start_mm + up_mm * height(i))));
        control.extend(
            shares()
                .map(|share| pose(corner_mm * share * share, start_mm + up_mm * z_share(share))),
        );
        let step_mm = 2.0 * corner_mm / steps as f64;
        let crossing = (1..between as usize).map(|i| corner_mm + step_mm * i as f64);
        control.extend(crossing.map(|along_mm| pose(along_mm, self.above_mm)));
        // Both corners meet if there is nothing between them.
        let skipped = usize::from(between == 0.0);
        control.extend(shares().rev().skip(skipped).map(|share| {
            let along_mm = way.whole_mm - corner_mm * share * share;
            pose(along_mm, self.end_mm + down_mm * z_share(share))
        }));
        let above_end = (0..upright(down_mm)).rev();
        control.extend(above_end.map(|i| pose(way.whole_mm, self.end_mm + down_mm * height(i))));
        Some(control)
    }

    fn pose(&self, way: &Polyline, along_mm: f64, z_mm: f64) -> [f64; CHANNELS] {
        let at = way.at(along_mm);
        let mut pose = self.start;
        pose[CHANNEL_X] = at.x;
        pose[CHANNEL_Y] = at.y;
        pose[CHANNEL_Z] = z_mm;
        // Ends to the last digit: the next move begins there.
        pose[CHANNEL_HEADING] = if along_mm >= way.whole_mm {
            self.heading_rad
        } else {
            let turn_rad = self.heading_rad - self.start[CHANNEL_HEADING];
            self.start[CHANNEL_HEADING] + turn_rad * along_mm / way.whole_mm
        };
        pose
    }
}

/// What the head covers from rest while Z slows down over half the lift.
fn corner_mm(lift_mm: f64, settings: &Settings) -> f64 {
    let joint = |axis: usize| settings.linear_joint(axis);
    let z_mm_s2 = joint(2).map_or(settings.tip_acceleration_mm_s2, |z| z.acceleration_max);
    let z_mm_s = joint(2).map_or(settings.travel_speed_mm_s, |z| z.speed_max);
    let slowing_s = (lift_mm / z_mm_s2).sqrt().max(lift_mm / z_mm_s);
    let across_mm_s2 = joint(0).map_or(settings.tip_acceleration_mm_s2, |x| x.acceleration_max);
    0.5 * across_mm_s2 * slowing_s * slowing_s
}

/// Straight legs by length along them.
struct Polyline<'a> {
    legs: &'a [Point2],
    /// Length up to each point.
    until_mm: Vec<f64>,
    whole_mm: f64,
}

impl<'a> Polyline<'a> {
    fn new(legs: &'a [Point2]) -> Polyline<'a> {
        let mut whole_mm = 0.0;
        let mut until_mm = vec![0.0];
        for leg in legs.windows(2) {
            whole_mm += (leg[1] - leg[0]).norm();
            until_mm.push(whole_mm);
        }
        Polyline {
            legs,
            until_mm,
            whole_mm,
        }
    }

    fn at(&self, along_mm: f64) -> Point2 {
        let last = self.legs.len() - 1;
        if along_mm >= self.whole_mm {
            return self.legs[last];
        }
        let next = self.until_mm.partition_point(|&until| until <= along_mm);
        let next = next.clamp(1, last);
        let leg_mm = self.until_mm[next] - self.until_mm[next - 1];
        let share = (along_mm - self.until_mm[next - 1]) / leg_mm.max(1e-12);
        self.legs[next - 1] + (self.legs[next] - self.legs[next - 1]) * share.clamp(0.0, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::examples::MachineExample;
    use crate::settings::machine_file;

    fn hop(legs: &[Point2], step_mm: f64) -> Vec<[f64; CHANNELS]> {
        let mut start = [0.0; CHANNELS];
        (start[CHANNEL_X], start[CHANNEL_Y], start[CHANNEL_Z]) = (legs[0].x, legs[0].y, 0.2);
        let hop = Hop {
            start,
            legs,
            heading_rad: 1.0,
            above_mm: 0.8,
            end_mm: 0.4,
            step_mm,
        };
        hop.control(&Settings::default()).expect("a hop")
    }

    /// Goal: limits of x, y and z are those of joints that move along them. Method: an arm, whose joint of that number
    /// is the elbow, slow and fast.
    #[test]
    fn an_arm_s_elbow_is_no_z() {
        let mut arm = machine_file::from_toml(MachineExample::Arm6.text()).expect("an arm");
        let before_mm = corner_mm(1.0, &arm);
        arm.machine.joints[2].acceleration_max *= 0.01;
        arm.machine.joints[0].acceleration_max *= 0.01;
        assert_eq!(corner_mm(1.0, &arm), before_mm);
    }

    /// Goal: the head crosses only above half the lift, begins and ends exactly, climbs no higher than it
    /// should, and its points are no further apart than their neighbours' distance doubled. Method: ways
    /// from shorter than both corners to the length of a bed, with and without a bend.
    #[test]
    fn a_hop_leaves_the_bead_before_it_crosses() {
        for length_mm in [0.06, 1.0, 5.9, 6.1, 7.0, 30.0, 250.0] {
            let straight = [Point2::new(1.0, 2.0), Point2::new(1.0 + length_mm, 2.0)];
            let bent = [straight[0], Point2::new(1.0, 2.0 + length_mm), straight[1]];
            for (legs, step_mm) in [(&straight[..], f64::INFINITY), (&bent[..], 0.1)] {
                let control = hop(legs, step_mm);
                let (first, last) = (control[0], control[control.len() - 1]);
                assert_eq!(first[..3], [1.0, 2.0, 0.2]);
                assert_eq!(last[..3], [1.0 + length_mm, 2.0, 0.4]);
                assert_eq!((first[CHANNEL_HEADING], last[CHANNEL_HEADING]), (0.0, 1.0));
                for point in &control {
                    let at = Point2::new(point[CHANNEL_X], point[CHANNEL_Y]);
                    let off = [legs[0], legs[legs.len() - 1]].map(|end| (at - end).norm() > 1e-9);
                    let height_mm = point[CHANNEL_Z];
                    assert!(height_mm <= 0.8 + 1e-12);
                    // From 0.2 to 0.8 up, from 0.8 to 0.4 down.
                    let low_mm = if point[CHANNEL_HEADING] < 0.5 {
                        0.5
                    } else {
                        0.6
                    };
                    assert!(!(off[0] && off[1]) || height_mm >= low_mm - 1e-9);
                }
                let steps = control.windows(2).map(|pair| {
                    let apart = |channel: usize| pair[1][channel] - pair[0][channel];
                    (apart(CHANNEL_X).powi(2) + apart(CHANNEL_Y).powi(2) + apart(CHANNEL_Z).powi(2))
                        .sqrt()
                });
                assert!(steps.into_iter().all(|step| step > 1e-5), "{length_mm}");
            }
        }
    }
}
