//! Smooths a speed profile with jumps of acceleration, on servo ticks.
//!
//! In: u̇ at path samples. Out: u at every servo tick. u(t) is averaged over a window of length T,
//! so that the acceleration is a moving average and changes by at most a / T per second. An average
//! is above the profile in its valleys and keeps sharp peaks sharp, so first peaks are cut to
//! plateaus and valleys widened (an opening and an erosion by T/2 in the profile's own time; Serra,
//! "Image Analysis and Mathematical Morphology", 1982). Along the path the average lags or leads by
//! about T² ü / 24 only.

use rayon::prelude::*;
use std::collections::VecDeque;

/// Ticks that are worth a thread.
const TICKS_MIN: usize = 1024;

/// Time at every sample for the rates u̇; the acceleration is constant between samples.
fn times(u: &[f64], rate: &[f64]) -> Vec<f64> {
    let mut time = Vec::with_capacity(u.len());
    let mut now = 0.0;
    time.push(now);
    for i in 1..u.len() {
        now += 2.0 * (u[i] - u[i - 1]) / (rate[i] + rate[i - 1]).max(RATE_MIN);
        time.push(now);
    }
    time
}

/// Duration of the path at the rates u̇, s.
pub fn duration_s(u: &[f64], rate: &[f64]) -> f64 {
    times(u, rate).last().copied().unwrap_or(0.0)
}

/// Keeps times finite where the profile stops between rests (a limit near zero).
const RATE_MIN: f64 = 1e-9;

/// Smallest (`sign` 1) or largest (-1) value within `radius` of time around each sample. Samples
/// outside `first..=last` do not count for their side of the window.
fn sliding_extreme(
    time: &[f64],
    value: &[f64],
    radius: f64,
    sign: f64,
    range: (usize, usize),
) -> Vec<f64> {
    let mut queue: VecDeque<usize> = VecDeque::new();
    let mut entered = 0;
    let mut extremes = Vec::with_capacity(value.len());
    for i in 0..value.len() {
        let right_end = range.1.max(i);
        while entered <= right_end && entered < value.len() && time[entered] <= time[i] + radius {
            while queue
                .back()
                .is_some_and(|&back| sign * value[back] >= sign * value[entered])
            {
                queue.pop_back();
            }
            queue.push_back(entered);
            entered += 1;
        }
        let left_end = range.0.min(i);
        while queue
            .front()
            .is_some_and(|&front| front < left_end || time[front] < time[i] - radius)
        {
            queue.pop_front();
        }
        extremes.push(queue.front().map_or(value[i], |&front| value[front]));
    }
    extremes
}

/// Cuts peaks to plateaus and widens valleys by half a window on each side; never above `rate`.
pub fn ease_rates(u: &[f64], rate: &[f64], window_s: f64) -> Vec<f64> {
    let time = times(u, rate);
    let last = rate.len() - 1;
    // A move shorter than a few windows keeps a peak: cutting it would leave nothing.
    let radius_s = (window_s / 2.0).min(time[last] / 8.0);
    let everywhere = (0, last);
    let eroded = sliding_extreme(&time, rate, radius_s, 1.0, everywhere);
    let mut opened: Vec<f64> = sliding_extreme(&time, &eroded, radius_s, -1.0, everywhere)
        .iter()
        .zip(rate)
        .map(|(opened, rate)| opened.min(*rate))
        .collect();
    lift_ends(&mut opened, rate);
    // The first rise and the last fall are no valleys: the average is below them already.
    let first_peak = (0..last)
        .find(|&i| opened[i + 1] < opened[i])
        .unwrap_or(last);
    let last_peak = (1..=last)
        .rev()
        .find(|&i| opened[i - 1] < opened[i])
        .unwrap_or(0);
    sliding_extreme(
        &time,
        &opened,
        window_s / 2.0,
        1.0,
        (first_peak, last_peak.max(first_peak)),
    )
}

/// If the samples are further apart than the window, the rest at an end extends over its
/// neighbours, and the motion would never leave it. The rise from rest and the fall to it are not
/// peaks: they keep their rates, below the adjacent plateau.
fn lift_ends(opened: &mut [f64], rate: &[f64]) {
    let last = rate.len() - 1;
    let moves = |opened: &[f64], i: &usize| opened[*i] > RATE_MIN;
    let Some(first_moving) = (1..last).find(|i| moves(opened, i)) else {
        opened.copy_from_slice(rate);
        return;
    };
    for i in (1..first_moving).rev() {
        opened[i] = rate[i].min(opened[i + 1]);
    }
    let last_moving = (1..last).rev().find(|i| moves(opened, i)).unwrap_or(last);
    for i in last_moving + 1..last {
        opened[i] = rate[i].min(opened[i - 1]);
    }
}

/// u at every tick for the rates, unsmoothed, slowed by up to a tick so that it ends on one.
fn sampled(u: &[f64], rate: &[f64], tick_s: f64, duration_min_s: f64) -> Vec<f64> {
    let time = times(u, rate);
    let duration_s = time[time.len() - 1];
    let ticks = (duration_s.max(duration_min_s) / tick_s).ceil().max(1.0);
    let scale = duration_s / ticks;
    let mut cell = 0;
    (0..=ticks as usize)
        .map(|tick| {
            let t = tick as f64 * scale;
            while cell + 2 < time.len() && time[cell + 1] < t {
                cell += 1;
            }
            let length_s = (time[cell + 1] - time[cell]).max(f64::MIN_POSITIVE);
            let s = ((t - time[cell]) / length_s).clamp(0.0, 1.0);
            let (v0, v1) = (rate[cell], rate[cell + 1]);
            // Exact ends whatever the rounding: the share of the cell's length that is done.
            let share = if v0 + v1 > RATE_MIN {
                s * (2.0 * v0 + s * (v1 - v0)) / (v0 + v1)
            } else {
                s
            };
            u[cell] + (u[cell + 1] - u[cell]) * share
        })
        .collect()
}

/// u at every tick, averaged over `window_ticks` (even); duration at least `duration_min_s`.
pub fn on_ticks(
    u: &[f64],
    rate: &[f64],
    tick_s: f64,
    window_ticks: usize,
    duration_min_s: f64,
) -> Vec<f64> {
    let raw = sampled(
        u,
        rate,
        tick_s,
        duration_min_s - window_ticks as f64 * tick_s,
    );
    // At rest before the start and after the end.
    let rests = [raw[0], raw[raw.len() - 1]].map(|rest| std::iter::repeat_n(rest, window_ticks));
    let [before, behind] = rests;
    let long: Vec<f64> = before.chain(raw.iter().copied()).chain(behind).collect();
    let windows = long.par_windows(window_ticks + 1).with_min_len(TICKS_MIN);
    windows
        .map(|window| {
            let (oldest, newest) = (window[0], window[window_ticks]);
            // Differences from the start keep the sums small where u is large.
            let inner = &window[1..window_ticks];
            let inner: f64 = inner.iter().map(|u| u - oldest).sum();
            oldest + (inner + 0.5 * (newest - oldest)) / window_ticks as f64
        })
        .collect()
}

#[cfg(test)]
mod tests {
    //! Goal: plateaus in valleys and on peaks, never above the profile, rests kept, acceleration
    //! bounded by the profile's, jerk by acceleration over window.
    use super::*;

    /// Rates of a rise, a V-shaped valley and a fall over u = 0..=100, |ü| = 500.
    fn profile() -> (Vec<f64>, Vec<f64>) {
        let u: Vec<f64> = (0..=2000).map(|i| f64::from(i) * 0.05).collect();
        let rate = u
            .iter()
            .map(|&u| {
                let rise = 2.0 * 500.0 * u;
                let fall = 2.0 * 500.0 * (100.0 - u);
                let valley = 100.0 * 100.0 + 2.0 * 500.0 * (u - 50.0f64).abs();
                rise.min(fall).min(valley).max(0.0).sqrt()
            })
            .collect();
        (u, rate)
    }

    /// Goal: a last sample closer to the end than the window does not stand still. Found on a real
    /// slice, which was refused with a move of 500,000,000 s.
    #[test]
    fn coarse_samples_near_the_ends_go_on() {
        let u = [0.0, 0.1, 1.0, 2.0, 2.9, 3.0];
        let rate = [0.0, 60.0, 100.0, 100.0, 60.0, 0.0];
        let eased = ease_rates(&u, &rate, 0.03);
        for i in 1..5 {
            assert!(eased[i] > 10.0 && eased[i] <= rate[i], "{eased:?}");
        }
        assert!(duration_s(&u, &eased) < 0.2);
    }

    #[test]
    fn eased_rates_stay_below_and_only_near_valleys_and_peaks() {
        let (u, rate) = profile();
        let eased = ease_rates(&u, &rate, 0.01);
        assert!(eased.iter().zip(&rate).all(|(eased, rate)| eased <= rate));
        // The first rise and the last fall are kept.
        assert_eq!(eased[..500], rate[..500]);
        assert_eq!(eased[1501..], rate[1501..]);
        // The valley is flat for the window: 0.01 s at a rate of 100 is 1.
        let flat = u
            .iter()
            .zip(&eased)
            .filter(|(u, eased)| (*u - 50.0).abs() < 3.0 && **eased < 100.0 + 1e-9)
            .count();
        assert!((18..=24).contains(&flat), "{flat}");
        let lost_s = duration_s(&u, &eased) - duration_s(&u, &rate);
        assert!(lost_s > 0.0 && lost_s < 0.01, "{lost_s}");
    }

    #[test]
    fn ticks_run_from_rest_to_rest_with_bounded_acceleration_and_jerk() {
        let (u, rate) = profile();
        let eased = ease_rates(&u, &rate, 0.01);
        let tick_s = 1.0 / 2000.0;
        let law = on_ticks(&u, &eased, tick_s, 20, 0.0);
        assert_eq!((law[0], law[law.len() - 1]), (0.0, 100.0));
        assert!(law.windows(2).all(|pair| pair[1] >= pair[0]));
        let difference = |values: &[f64]| -> Vec<f64> {
            values
                .windows(2)
                .map(|pair| (pair[1] - pair[0]) / tick_s)
                .collect()
        };
        let acceleration = difference(&difference(&law));
        let jerk = difference(&acceleration);
        let worst = |values: &[f64]| values.iter().fold(0.0f64, |a, v| a.max(v.abs()));
        // One per cent for cells that end between ticks.
        assert!(worst(&acceleration) < 505.0, "{}", worst(&acceleration));
        assert!(worst(&jerk) < 1.02 * 500.0 / 0.01 * 2.0, "{}", worst(&jerk));
    }

    #[test]
    fn a_least_duration_is_kept() {
        let (u, rate) = profile();
        let law = on_ticks(&u, &rate, 1.0 / 2000.0, 20, 5.0);
        assert_eq!(law.len(), 10_001);
    }

    #[test]
    fn a_very_short_move_keeps_its_peak() {
        let u: Vec<f64> = (0..=10).map(|i| f64::from(i) * 0.001).collect();
        let rate: Vec<f64> = u
            .iter()
            .map(|&u| (1000.0 * u.min(0.01 - u).max(0.0)).sqrt())
            .collect();
        let eased = ease_rates(&u, &rate, 0.02);
        let lost = duration_s(&u, &eased) / duration_s(&u, &rate);
        assert!(lost < 1.3, "{lost}");
    }
}
