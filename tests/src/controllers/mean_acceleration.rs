//! How fast the axes' speeds change in time, whatever moves and junctions make of it.
//!
//! In: blocks with their profiles, in order. Out: for each axis the largest change of its mean speed from one window to
//! the next, over the window: an acceleration. A limit within moves says nothing of the steps between them, and a step between
//! moves nothing of what the move behind it takes back; a motor feels their sum. Leaves out the time at rest, which the
//! places before and behind it show.

use super::AXES;
use super::profiles::{Block, Profile};

/// The time in which a heading reaches its corner velocity at its acceleration, as the guide has it.
pub const MEAN_S: f64 = 0.02;
/// A shorter window, for the table.
pub const SHORT_S: f64 = 0.01;
/// Places are taken so often.
const STEP_S: f64 = 0.0005;

/// Places of the axes at even steps of time.
#[derive(Clone, Debug, Default)]
pub struct Track {
    at: [f64; AXES],
    now_s: f64,
    places: Vec<[f64; AXES]>,
}

impl Track {
    /// A block as it is driven, and a time at rest behind it.
    pub fn add(&mut self, block: &Block, profile: &Profile, rest_s: f64) {
        let start_s = self.now_s;
        self.now_s += profile.seconds;
        while self.next_s() < self.now_s {
            let way = way(block, profile, self.next_s() - start_s);
            let place = std::array::from_fn(|axis| self.at[axis] + way * block.direction[axis]);
            self.places.push(place);
        }
        for (at, share) in self.at.iter_mut().zip(block.direction) {
            *at += share * block.length;
        }
        self.now_s += rest_s;
        while self.next_s() < self.now_s {
            self.places.push(self.at);
        }
    }

    /// Of each axis, over windows of so long.
    pub fn mean_accelerations(&self, window_s: f64) -> [f64; AXES] {
        let window = (window_s / STEP_S).round() as usize;
        let mut most = [0.0f64; AXES];
        for (i, middle) in self.places.iter().enumerate().skip(window) {
            let Some(after) = self.places.get(i + window) else {
                break;
            };
            let before = &self.places[i - window];
            for axis in 0..AXES {
                let change = after[axis] - 2.0 * middle[axis] + before[axis];
                most[axis] = most[axis].max(change.abs() / (window_s * window_s));
            }
        }
        most
    }

    fn next_s(&self) -> f64 {
        STEP_S * self.places.len() as f64
    }
}

/// The way of a trapezoid after a time.
fn way(block: &Block, profile: &Profile, after_s: f64) -> f64 {
    let up_s = (profile.peak - profile.entry) / block.acceleration;
    let down_s = (profile.peak - profile.exit) / block.acceleration;
    let cruise_s = profile.seconds - up_s - down_s;
    let half = 0.5 * block.acceleration;
    if after_s < up_s {
        return profile.entry * after_s + half * after_s * after_s;
    }
    let left_s = profile.seconds - after_s;
    if after_s > up_s + cruise_s {
        return block.length - profile.exit * left_s - half * left_s * left_s;
    }
    0.5 * (profile.entry + profile.peak) * up_s + profile.peak * (after_s - up_s)
}

#[cfg(test)]
mod tests {
    //! Goal: an even acceleration is itself, and a step of the speed its change over the window. Method: by hand.
    use super::super::profiles::trapezoid;
    use super::*;

    fn block(length: f64, speed_max: f64, acceleration: f64) -> Block {
        let mut direction = [0.0; AXES];
        direction[0] = 1.0;
        Block {
            length,
            direction,
            speed_max,
            acceleration,
            entry_max: 0.0,
            entry_by: "rest",
        }
    }

    #[test]
    fn ramps_and_steps() {
        // 1000 mm/s² to 50 mm/s in 0.05 s, longer than the windows, and as long down.
        let ramp = block(10.0, 50.0, 1000.0);
        let mut track = Track::default();
        track.add(&ramp, &trapezoid(&ramp, 0.0, 0.0), 0.1);
        assert!((track.mean_accelerations(MEAN_S)[0] - 1000.0).abs() < 1.0);
        // 10 mm/s, then 20: 10 over 0.02 s; the other axes stand.
        let mut track = Track::default();
        for speed in [10.0, 20.0] {
            let even = block(speed, speed, 1e9);
            track.add(&even, &trapezoid(&even, speed, speed), 0.0);
        }
        let [x, y, ..] = track.mean_accelerations(MEAN_S);
        assert!((x - 500.0).abs() < 1.0 && y == 0.0, "{x} {y}");
        assert!((track.mean_accelerations(SHORT_S)[0] - 1000.0).abs() < 1.0);
    }
}
