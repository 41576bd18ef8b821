//! Limits of the motion of a pose in the plane (x, y, heading).
//!
//! In: limits as numbers, mm or rad and s. Out: the time of a move from rest to rest. Not covered: flow and
//! z.

/// Limits of one axis of the pose: mm or rad, and s.
#[derive(Clone, Copy, Debug)]
pub struct AxisLimits {
    /// Speed.
    pub speed: f64,
    /// Acceleration.
    pub acceleration: f64,
    /// Jerk.
    pub jerk: f64,
}

/// Limits of a pose's motion, with the plan's share applied.
#[derive(Clone, Copy, Debug)]
pub struct PoseLimits {
    /// Of the tip, mm/s.
    pub tip_speed_mm_s: f64,
    /// Of the tip, mm/s².
    pub tip_acceleration_mm_s2: f64,
    /// x, y and heading.
    pub axes: [AxisLimits; 3],
}

impl PoseLimits {
    /// Time from rest to rest over a distance and a turn, whichever takes longer, s.
    pub fn rest_to_rest_s(&self, way_mm: f64, turn_rad: f64) -> f64 {
        let [x, y, heading] = &self.axes;
        let tip = AxisLimits {
            speed: self.tip_speed_mm_s,
            acceleration: self
                .tip_acceleration_mm_s2
                .min(x.acceleration)
                .min(y.acceleration),
            jerk: x.jerk.min(y.jerk),
        };
        tip.rest_to_rest_s(way_mm)
            .max(heading.rest_to_rest_s(turn_rad))
    }
}

impl AxisLimits {
    /// Time from rest to rest: acceleration, perhaps a run at full speed, braking, and the time in which
    /// the acceleration builds up and falls.
    fn rest_to_rest_s(&self, distance: f64) -> f64 {
        if distance <= 0.0 {
            return 0.0;
        }
        let rise_s = (distance / self.acceleration).sqrt();
        let moving_s = match rise_s * self.acceleration > self.speed {
            true => distance / self.speed + self.speed / self.acceleration,
            false => 2.0 * rise_s,
        };
        moving_s + 2.0 * self.acceleration / self.jerk
    }
}
