//! Mean speeds of moves -> the tip's maximum speed along them.
//!
//! In: means (mm/s), times (s) and distances (mm). Out: bounds, mm/s. A mean is not a bound: within a move the tip
//! accelerates and decelerates.

use std::collections::VecDeque;

/// The highest speed within a chord of this mean speed and time, by the acceleration, with this many of its ends
/// at rest.
pub fn peak_mm_s(mean_mm_s: f64, seconds: f64, rests: usize, acceleration_mm_s2: f64) -> f64 {
    let by_change = 0.25 * acceleration_mm_s2 * seconds;
    if rests == 0 {
        return mean_mm_s + by_change;
    }
    // At the peak except for the distances from rest and to it: seconds = distance / peak + rests peak
    // / (2 acceleration).
    let half = acceleration_mm_s2 * seconds / rests as f64;
    let room = half * half - 2.0 * half * mean_mm_s;
    match room > 0.0 {
        true => half - room.sqrt(),
        false => half.max(mean_mm_s),
    }
}

/// The greatest of the speeds within a distance of each leg: a speed is a bound within that distance, and a rising
/// one is not a limit.
pub fn fastest_within(speeds_mm_s: &[f64], ways_mm: &[f64], within_mm: f64) -> Vec<f64> {
    let mut ends_mm = vec![0.0];
    for way_mm in ways_mm {
        ends_mm.push(ends_mm[ends_mm.len() - 1] + way_mm);
    }
    let mut next = 0;
    // Of the legs that are near, those that no later one exceeds.
    let mut near: VecDeque<usize> = VecDeque::new();
    let fastest = (0..speeds_mm_s.len()).map(|leg| {
        while next < speeds_mm_s.len() && ends_mm[next] <= ends_mm[leg + 1] + within_mm {
            while near
                .back()
                .is_some_and(|last| speeds_mm_s[*last] <= speeds_mm_s[next])
            {
                near.pop_back();
            }
            near.push_back(next);
            next += 1;
        }
        while near
            .front()
            .is_some_and(|first| ends_mm[*first + 1] < ends_mm[leg] - within_mm)
        {
            near.pop_front();
        }
        near.front()
            .map_or(speeds_mm_s[leg], |fastest| speeds_mm_s[*fastest])
    });
    fastest.collect()
}

#[cfg(test)]
mod tests {
    //! Goal: bounds that a mean speed allows. Method: motions of constant acceleration, by hand.
    use super::*;

    /// From rest to rest over 10 mm at 50 mm/s and 1,000 mm/s² takes 0.25 s, from rest alone 0.225 s.
    #[test]
    fn the_peak_of_a_mean_is_that_of_its_ramps() {
        let close = |peak_mm_s: f64| assert!((peak_mm_s - 50.0).abs() < 1e-9, "{peak_mm_s}");
        close(peak_mm_s(10.0 / 0.25, 0.25, 2, 1000.0));
        close(peak_mm_s(10.0 / 0.225, 0.225, 1, 1000.0));
        // 0.02 s about a mean of 45 mm/s: up by 10 mm/s and down again has its peak 5 above.
        close(peak_mm_s(45.0, 0.02, 0, 1000.0));
    }

    #[test]
    fn speeds_hold_within_a_way() {
        let fastest = fastest_within(&[9.0, 1.0, 2.0, 5.0], &[1.0, 2.0, 2.0, 1.0], 1.5);
        assert_eq!(fastest, [9.0, 9.0, 5.0, 5.0]);
    }
}
