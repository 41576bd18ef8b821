//! The machine's limits for a pose in the plane (x, y, heading), and the value of a move.
//!
//! In: the settings. Out: limits of the tip and of the joints of x, y and heading, with the plan's
//! share applied; the area that a move must cover to be worth its time. Not covered: flow and z.

use crate::geometry::clearance::Configuration;
use crate::settings::Settings;
use headway_firmware::kinematics;
pub use headway_optimiser::pose_limits::{AxisLimits, PoseLimits};
use headway_protocol::units::{CHANNEL_HEADING, CHANNEL_X, CHANNEL_Y};

/// The limits of printing with these settings.
pub fn pose_limits(settings: &Settings) -> PoseLimits {
    let (machine, share) = (&settings.machine, settings.plan_share);
    let joint_channels = kinematics::joint_channels(&machine.kinematics);
    let of_channel = |channel: usize| {
        let wrist = settings.wrist.and(settings.wrist_number());
        let joints = machine.joints.iter().zip(joint_channels).enumerate();
        let joints = joints.filter(|(number, (_, joint_channel))| {
            let is_wrist = channel == CHANNEL_HEADING && wrist == Some(*number);
            is_wrist || **joint_channel == Some(channel)
        });
        let least = AxisLimits {
            speed: f64::INFINITY,
            acceleration: f64::INFINITY,
            jerk: f64::INFINITY,
        };
        joints.fold(least, |least, (_, (joint, _))| AxisLimits {
            speed: least.speed.min(joint.speed_max * share),
            acceleration: least.acceleration.min(joint.acceleration_max * share),
            jerk: least.jerk.min(joint.jerk_max * share),
        })
    };
    PoseLimits {
        tip_speed_mm_s: settings.speed_mm_s * share,
        tip_acceleration_mm_s2: settings.tip_acceleration_mm_s2 * share,
        axes: [CHANNEL_X, CHANNEL_Y, CHANNEL_HEADING].map(of_channel),
    }
}

/// The built-in machine's tip acceleration, mm/s², for which prices of area are defined.
const TIP_ACCELERATION_MM_S2: f64 = 3000.0;

/// Price of area, s/mm²: the quality's price for the built-in machine and nozzle, the same for all in units of the
/// nozzle's area and the time in which it moves by its width from rest.
pub fn price_s_mm2(settings: &Settings) -> f64 {
    let unit_mm = settings.aperture.unit_mm();
    let times = (unit_mm * TIP_ACCELERATION_MM_S2 / settings.tip_acceleration_mm_s2).sqrt();
    settings.quality.price_s_mm2() * times / (unit_mm * unit_mm)
}

/// Value of time in area, covered or left open.
#[derive(Clone, Copy, Debug)]
pub struct AreaPrice {
    limits: PoseLimits,
    price_s_mm2: f64,
}

impl AreaPrice {
    /// The price of these settings.
    pub fn of(settings: &Settings) -> AreaPrice {
        AreaPrice {
            limits: pose_limits(settings),
            price_s_mm2: price_s_mm2(settings),
        }
    }

    /// The same for area with a price multiplied by a factor.
    pub fn times(self, factor: f64) -> AreaPrice {
        AreaPrice {
            price_s_mm2: factor * self.price_s_mm2,
            ..self
        }
    }

    /// The area that a move from a bead and back to it must gain, mm²: `way` is out and back with a
    /// stop where it turns back, and ends at its start.
    pub fn of_gap_fill_mm2(&self, way: &[Configuration]) -> f64 {
        let (mut way_mm, mut turn_rad) = (0.0, 0.0);
        let starts = way.last().into_iter().chain(way);
        for (from, to) in starts.zip(way) {
            way_mm += (to.center - from.center).norm();
            turn_rad += (to.heading_rad - from.heading_rad).abs();
        }
        let one_way_s = self.limits.rest_to_rest_s(0.5 * way_mm, 0.5 * turn_rad);
        2.0 * one_way_s / self.price_s_mm2
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Point2;

    /// Goal: the price of a gap-fill move is its time over the settings' price. Method: 1 mm out and back
    /// without a turn on the built-in machine, 95 % of 3000 mm/s² and 3·10⁵ mm/s³, by hand; a turn by a
    /// radian in place takes longer.
    #[test]
    fn a_gap_fill_move_costs_its_time() {
        let settings = Settings::default();
        let price = AreaPrice::of(&settings);
        let at = |x: f64, heading_rad: f64| Configuration {
            center: Point2::new(x, 0.0),
            heading_rad,
        };
        let found = price.of_gap_fill_mm2(&[at(1.0, 0.0), at(0.0, 0.0)]);
        let one_way_s = 2.0 * (1.0f64 / (0.95 * 3000.0)).sqrt() + 2.0 * 3000.0 / 3e5;
        let expected = 2.0 * one_way_s / settings.quality.price_s_mm2();
        assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        let turned = price.of_gap_fill_mm2(&[at(1.0, 3.0), at(0.0, 0.0)]);
        assert!(turned > found);
    }
}
