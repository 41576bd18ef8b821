//! Path to time: the fastest motion along a path within the limits, smoothed, on servo ticks.
//!
//! In: path samples with their constraints ([`crate::plan::motion::path_samples`]). Out: the path parameter
//! u at every servo tick, from rest to rest. Two steps: time-optimal parametrisation by reachability
//! ([`reachability`], after Pham and Pham, TOPP-RA, 2018), then a smoothing of the speed profile that makes
//! the acceleration continuous ([`smoothing`]). The remaining distance to the jerk's limit is used on the
//! fitted motion ([`crate::plan::motion::segments`]).

pub mod reachability;
pub mod smoothing;

use crate::plan::motion::joint_limits::MotionLimits;
use crate::plan::motion::motion_error::MotionError;
use crate::plan::motion::path_samples::{PathSample, tip_way_mm};
use crate::text::refusal::refusal;

/// Shares of the limits that are aimed at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shares {
    /// Of every speed limit.
    pub speed: f64,
    /// Of every acceleration limit.
    pub acceleration: f64,
}

/// The motion along one move.
#[derive(Clone, Debug, PartialEq)]
pub struct TimeLaw {
    /// Path parameter at ticks 0..=n; at rest at both ends.
    pub u_at_tick: Vec<f64>,
}

impl TimeLaw {
    /// Duration in servo ticks.
    pub fn ticks(&self) -> usize {
        self.u_at_tick.len() - 1
    }

    /// Waits at the end until the move lasts `ticks`.
    pub fn pad_to(&mut self, ticks: usize) {
        let end = self.u_at_tick[self.ticks()];
        while self.ticks() < ticks {
            self.u_at_tick.push(end);
        }
    }
}

/// Shortest and longest smoothing window, s.
const WINDOW_S: [f64; 2] = [0.004, 0.030];

/// Smoothing window in ticks: the time in which the weakest moving joint may build up its
/// acceleration. Between 4 ms (less than a cubic span resolves) and 30 ms (a longer one costs more
/// time than the avoided vibration is worth).
pub fn smoothing_ticks(samples: &[PathSample], limits: &MotionLimits) -> usize {
    let seconds = limits
        .joints
        .iter()
        .enumerate()
        .filter(|&(joint, _)| samples.iter().any(|sample| sample.moves_joint(joint)))
        .map(|(_, limit)| limit)
        .chain(limits.pair.iter().map(|pair| &pair.motor))
        .map(|limit| limit.acceleration_max / limit.jerk_max * 1.5)
        .fold(0.0, f64::max)
        .clamp(WINDOW_S[0], WINDOW_S[1]);
    // Even, so that the window is centred on a tick.
    2 * (seconds * limits.servo_hz / 2.0).ceil() as usize
}

/// Largest displacement in a tick, mm or rad, up to which ticks are made coarser. Corners are rounded over 50
/// µm, in which a dozen ticks are enough for the limits.
const WAY_OF_TICK: f64 = 0.004;
/// Most servo ticks of a coarse one: a longest span has 32 of them.
const COARSE_MAX: u16 = 128;
/// Least number of coarse ticks of a move, so that short ones are unchanged: the windows in which speeds grow
/// have as many coarse ticks as otherwise servo ticks, 1 % of these.
const COARSE_TICKS_MIN: f64 = 8192.0;

/// Servo ticks per step of a move's time law, a power of two: a very slow move needs no more work than one of
/// 4 mm/s, however long it lasts. 1 for all moves that are faster than 2 mm/s anywhere.
pub fn coarseness(samples: &[PathSample], limits: &MotionLimits) -> u16 {
    let most = WAY_OF_TICK * limits.servo_hz;
    let (mut fastest, mut seconds) = (1e-9f64, 0.0);
    for (sample, next) in samples.iter().zip(samples.iter().skip(1)) {
        fastest = fastest.max(sample.fastest(limits));
        if 2.0 * fastest > most {
            return 1;
        }
        seconds += (next.u - sample.u) / sample.rate_max(limits, 1.0);
    }
    let ticks = seconds * limits.servo_hz;
    let mut coarse = 1;
    while coarse < COARSE_MAX
        && 2.0 * f64::from(coarse) * fastest <= most
        && ticks >= 2.0 * f64::from(coarse) * COARSE_TICKS_MIN
    {
        coarse *= 2;
    }
    coarse
}

/// Longest move: beyond it a limit is next to zero somewhere, and the ticks would fill memory.
const STRETCH_MAX_S: f64 = 6.0 * 3600.0;
/// A move that takes longer than this may take this multiple of its time at the tip's speed:
/// planning time grows with the ticks, and a slower move comes from an unintended limit.
const PATIENCE_S: f64 = 20.0 * 60.0;
const SLOWDOWN_MAX: f64 = 200.0;

/// Fails for a move that would take unreasonably long. `way_mm` is the tip's distance, `from_mm` its
/// start.
pub fn check_duration(
    duration_s: f64,
    way_mm: f64,
    limits: &MotionLimits,
    from_mm: [f64; 3],
) -> Result<(), MotionError> {
    let at_speed_s = way_mm / limits.tip_speed_mm_s;
    let most_s = (SLOWDOWN_MAX * at_speed_s).clamp(PATIENCE_S, STRETCH_MAX_S);
    match duration_s <= most_s {
        true => Ok(()),
        false => Err(MotionError::Refused(refusal!(
            "the path that begins with the tip at {from_mm:.3?} mm (machine coordinates) would \
             take {duration_s:.0} s ({at_speed_s:.0} s at its speed), more than the {most_s:.0} \
             s that can be planned: {}",
            match at_speed_s > most_s {
                true => "raise the speed",
                false => "raise the limit that is close to zero (a joint's or the flow's)",
            }
        ))),
    }
}

/// Least time of a sampled path by its speeds and accelerations, without jerk limits, s.
pub fn without_jerk_s(samples: &[PathSample], limits: &MotionLimits) -> f64 {
    let mut limits = limits.clone();
    let motor = limits.pair.as_mut().map(|pair| &mut pair.motor);
    for joint in limits.joints.iter_mut().chain(motor) {
        joint.jerk_max = f64::INFINITY;
    }
    let all = Shares {
        speed: 1.0,
        acceleration: 1.0,
    };
    let rate = reachability::fastest_rates(samples, &limits, all);
    let u: Vec<f64> = samples.iter().map(|sample| sample.u).collect();
    smoothing::duration_s(&u, &rate)
}

/// The time law of a sampled path: duration at least `duration_min_s`. `from_mm` is its start.
pub fn time_law(
    samples: &[PathSample],
    limits: &MotionLimits,
    aims: Shares,
    duration_min_s: f64,
    from_mm: [f64; 3],
) -> Result<TimeLaw, MotionError> {
    let rate = reachability::fastest_rates(samples, limits, aims);
    let u: Vec<f64> = samples.iter().map(|sample| sample.u).collect();
    let window_ticks = smoothing_ticks(samples, limits);
    let tick_s = 1.0 / limits.servo_hz;
    let eased = smoothing::ease_rates(&u, &rate, window_ticks as f64 * tick_s);
    let duration_s = smoothing::duration_s(&u, &eased).max(duration_min_s);
    check_duration(duration_s, tip_way_mm(samples), limits, from_mm)?;
    let u_at_tick = smoothing::on_ticks(&u, &eased, tick_s, window_ticks, duration_min_s);
    Ok(TimeLaw { u_at_tick })
}
