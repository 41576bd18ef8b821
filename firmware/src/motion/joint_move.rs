//! One joint from rest to rest, for jogs and homing: a trapezoid of speed, smoothed.
//!
//! Distances in 2^-31 steps, speeds in steps per servo tick. The trapezoid is averaged over
//! [`SMOOTHING_TICKS`], which turns its jumps of acceleration into ramps: its jerk is the
//! acceleration divided by that time. It can be braked at any time and ends exactly at its target.

use crate::configuration::JointConfiguration;
use crate::numbers::real::{Real, smaller};
use crate::steps::{STEP, steps_to_position};

/// Length of the average: 16 ms at 2 kHz. A power of two, so that the mean is a shift.
pub const SMOOTHING_TICKS: usize = 1 << SMOOTHING_SHIFT;
const SMOOTHING_SHIFT: u32 = 5;
/// Share of a joint's full acceleration that a move by hand uses: nobody waits for it.
const ACCELERATION_SHARE: f64 = 0.5;

/// How fast a joint may be moved, steps and servo ticks.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MoveLimits {
    /// Steps per tick.
    pub speed: f32,
    /// Steps per tick².
    pub acceleration: f32,
}

impl MoveLimits {
    /// For a joint at `speed_natural_s` (mm/s or rad/s): half its acceleration, its jerk kept.
    #[inline(never)]
    pub fn new(joint: &JointConfiguration, speed_natural_s: f64, servo_hz: u32) -> Self {
        let servo_hz = f64::from(servo_hz);
        let by_jerk = joint.jerk_max * SMOOTHING_TICKS as f64 / servo_hz;
        let wanted = joint.acceleration_max * ACCELERATION_SHARE;
        let acceleration = if by_jerk < wanted { by_jerk } else { wanted };
        Self {
            speed: (speed_natural_s * joint.steps_per_unit / servo_hz) as f32,
            acceleration: (acceleration * joint.steps_per_unit / (servo_hz * servo_hz)) as f32,
        }
    }
}

/// A move, or the rest after one.
#[derive(Clone, Debug)]
pub struct JointMove {
    limits: MoveLimits,
    /// Where the trapezoid is, and where it ends.
    position: i64,
    goal: i64,
    /// Current speed along the path.
    speed: f32,
    braking: bool,
    /// The last positions of the trapezoid, less `origin`, and their sum.
    recent: [i64; SMOOTHING_TICKS],
    sum: i64,
    origin: i64,
    newest: usize,
}

impl JointMove {
    /// At rest.
    pub const fn at_rest(position: i64) -> Self {
        Self {
            limits: MoveLimits {
                speed: 0.0,
                acceleration: 0.0,
            },
            position,
            goal: position,
            speed: 0.0,
            braking: false,
            recent: [0; SMOOTHING_TICKS],
            sum: 0,
            origin: position,
            newest: 0,
        }
    }

    /// Begins a move from rest.
    pub fn begin(&mut self, position: i64, distance: i64, limits: MoveLimits) {
        *self = Self::at_rest(position);
        self.limits = limits;
        self.goal = position.saturating_add(distance);
    }

    /// Comes to rest as soon as the acceleration allows.
    pub fn brake(&mut self) {
        self.braking = true;
    }

    /// True if the last position was the goal's and nothing moves any more.
    pub fn is_done(&self) -> bool {
        let way = self.goal - self.origin;
        self.position == self.goal && self.recent.iter().all(|place| *place == way)
    }

    /// +1 towards larger positions, -1 towards smaller ones, 0 without a distance to move.
    pub fn direction(&self) -> i64 {
        (self.goal - self.origin).signum()
    }

    /// Position of the next servo tick.
    pub fn tick(&mut self) -> i64 {
        self.step();
        self.newest = (self.newest + 1) % SMOOTHING_TICKS;
        let place = self.position - self.origin;
        if let Some(oldest) = self.recent.get_mut(self.newest) {
            self.sum += place - *oldest;
            *oldest = place;
        }
        self.origin + (self.sum >> SMOOTHING_SHIFT)
    }

    /// One tick of the trapezoid.
    fn step(&mut self) {
        let remaining = self.goal - self.position;
        if remaining == 0 {
            return;
        }
        let MoveLimits {
            speed,
            acceleration,
        } = self.limits;
        if self.braking {
            self.speed -= acceleration;
            if self.speed <= 0.0 {
                self.speed = 0.0;
                self.goal = self.position;
                return;
            }
        } else {
            // Speeds v, v - a, v - 2 a, ... add up to v² / 2a + v / 2.
            let left = remaining.unsigned_abs() as f32 / STEP as f32;
            let half = 0.5 * acceleration;
            let stoppable = libm::sqrtf(half * half + 2.0 * acceleration * left) - half;
            let wanted = smaller(smaller(self.speed + acceleration, speed), stoppable);
            // The root loses its last places near the goal; this much is always allowed.
            self.speed = wanted.larger(0.5 * half);
        }
        let step = steps_to_position(self.speed);
        if step >= remaining.abs() {
            self.position = self.goal;
            self.speed = 0.0;
        } else {
            self.position += step * remaining.signum();
        }
    }
}

#[cfg(test)]
mod tests {
    //! Goal: moves end exactly on their goal, keep speed, acceleration and jerk, and can be braked
    //! anywhere. Method: moves of all lengths, differenced tick by tick.
    use super::*;
    use std::vec::Vec;

    const LIMITS: MoveLimits = MoveLimits {
        speed: 0.8,
        acceleration: 0.01,
    };

    fn run(distance: i64, brake_at: Option<usize>) -> Vec<i64> {
        let start = 123 * STEP + 77;
        let mut mover = JointMove::at_rest(0);
        mover.begin(start, distance, LIMITS);
        let mut places = std::vec![start, start, start];
        while !mover.is_done() {
            if Some(places.len()) == brake_at {
                mover.brake();
            }
            places.push(mover.tick());
            assert!(places.len() < 100_000, "{distance} never ends");
        }
        places.extend([*places.last().unwrap(); 3]);
        places
    }

    fn check(places: &[i64]) {
        let steps = |place: i64| place as f64 / STEP as f64;
        for four in places.windows(4) {
            let [v0, v1, v2] = [0, 1, 2].map(|i: usize| steps(four[i + 1] - four[i]));
            let (a0, a1) = (v1 - v0, v2 - v1);
            assert!(v0.abs() <= 0.8 * 1.0001, "{v0}");
            assert!(a0.abs() <= 0.01 * 1.01, "{a0}");
            // Twice, where the trapezoid's acceleration changes its sign at once.
            let jerk = 0.01 / SMOOTHING_TICKS as f64;
            assert!((a1 - a0).abs() <= 2.0 * jerk * 1.05, "{}", a1 - a0);
        }
    }

    #[test]
    fn moves_of_all_lengths_end_on_their_goal_within_their_limits() {
        let mut distance = 1i64;
        while distance < 4000 * STEP {
            for signed in [distance, -distance] {
                let places = run(signed, None);
                assert_eq!(places.last().unwrap() - places[0], signed);
                check(&places);
            }
            distance = distance * 3 + 1;
        }
    }

    #[test]
    fn a_braked_move_rests_short_of_its_goal_within_its_limits() {
        for brake_at in [1usize, 5, 40, 200, 900, 1240] {
            let places = run(-1000 * STEP, Some(brake_at + 3));
            assert!(places.last().unwrap() - places[0] > -1000 * STEP);
            check(&places);
        }
    }

    #[test]
    fn limits_follow_acceleration_and_jerk_of_the_joint() {
        let joint = JointConfiguration {
            rotary: false,
            steps_per_unit: 80.0,
            position_min: 0.0,
            position_max: 1.0,
            speed_max: 200.0,
            acceleration_max: 3000.0,
            jerk_max: 30_000.0,
        };
        let limits = MoveLimits::new(&joint, 25.0, 2000);
        assert!((limits.speed - 1.0).abs() < 1e-6);
        // 30,000 mm/s³ over 16 ms.
        assert!((limits.acceleration - 480.0 * 80.0 / 4e6).abs() < 1e-6);
    }
}
