//! Input shapers: the weights by which a joint's targets are averaged, so that its frame does not
//! ring.
//!
//! Shaped targets are y(t) = sum of A_k x(t - t_k) with A_k > 0 that add up to 1: a mean of the plan at a
//! few earlier times. It exceeds neither speed, acceleration nor range of the plan, and ends where the
//! plan ends. ZV (Singer and Seering, 1990), MZV and EI are Klipper's (`klippy/extras/shaper_defs.py`);
//! `Smooth` is the average over one period of the vibration, of the average over one period.
//!
//! In: kind, frequency in Hz and damping of a joint. Out: impulses in servo ticks, the total delay, and
//! the position of each tap in it (`steps/shaper.rs`). All joints and the extruder are delayed by the
//! mean of the longest shaper (`steps/delay.rs`). Not covered: the extruder, which is not shaped.

use crate::configuration::shaping::{Shaper, ShaperKind};
use crate::configuration::{JOINTS_MAX, MachineConfiguration};
use heapless::Vec;

/// Impulses of a shaper, at most.
pub const IMPULSES_MAX: usize = 3;
/// Residual vibration that EI leaves at its tuned frequency, for a wider tolerance around it.
const EI_TOLERANCE: f64 = 0.05;
/// Lowest frequency that is considered; how low it may be hangs on the line.
const FREQUENCY_MIN_HZ: f64 = 1.0;
/// Largest damping ratio: a frame with more damping does not ring.
pub(crate) const DAMPING_MAX: f64 = 0.5;

/// A shaper, sampled to a machine's servo ticks.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// Weights, which add up to 1, and times in servo ticks, the first 0.
    Impulses(Vec<(f64, f64), IMPULSES_MAX>),
    /// The average over this many ticks, applied twice.
    Averages(u32),
}

impl Shaper {
    /// Its impulses or averages; `None` if it does not shape.
    #[inline(never)]
    pub fn shape(&self, servo_hz: u32) -> Option<Shape> {
        let damped = libm::sqrt(1.0 - self.damping * self.damping);
        let period_ticks = f64::from(servo_hz) / (self.frequency_hz * damped);
        let decay =
            |periods: f64| libm::exp(-core::f64::consts::TAU * periods * self.damping / damped);
        let half = decay(0.5);
        let impulses: [(f64, f64); IMPULSES_MAX] = match self.kind {
            ShaperKind::None => return None,
            ShaperKind::Smooth => return Some(Shape::Averages((period_ticks + 0.5) as u32)),
            ShaperKind::Zv => [(1.0, 0.0), (half, 0.5), (0.0, 0.5)],
            ShaperKind::Mzv => {
                let (k, a) = (decay(0.375), 1.0 - core::f64::consts::FRAC_1_SQRT_2);
                [
                    (a, 0.0),
                    ((core::f64::consts::SQRT_2 - 1.0) * k, 0.375),
                    (a * k * k, 0.75),
                ]
            }
            ShaperKind::Ei => {
                let a = 0.25 * (1.0 + EI_TOLERANCE);
                [
                    (a, 0.0),
                    (0.5 * (1.0 - EI_TOLERANCE) * half, 0.5),
                    (a * half * half, 1.0),
                ]
            }
        };
        let sum: f64 = impulses.iter().map(|(weight, _)| weight).sum();
        let scaled = impulses.map(|(weight, periods)| (weight / sum, periods * period_ticks));
        Some(Shape::Impulses(scaled.into_iter().collect()))
    }

    /// True if its numbers make sense; that it fits the line is [`Delays::of`](crate::steps::delay::Delays::of)'s.
    pub(crate) fn is_right(&self, servo_hz: u32) -> bool {
        // A period of at least four servo ticks: shorter ones cannot be distinguished from others.
        let highest_hz = f64::from(servo_hz) / 4.0;
        self.kind == ShaperKind::None
            || ((FREQUENCY_MIN_HZ..=highest_hz).contains(&self.frequency_hz)
                && (0.0..=DAMPING_MAX).contains(&self.damping))
    }
}

impl Shape {
    /// Mean of its times, servo ticks: the delay of a steady motion.
    pub fn delay_ticks(&self) -> f64 {
        match self {
            Self::Impulses(impulses) => impulses.iter().map(|(a, t)| a * t).sum(),
            // Each average looks back by (n - 1) / 2.
            Self::Averages(ticks) => f64::from(ticks.saturating_sub(1)),
        }
    }

    /// Its longest time, servo ticks.
    pub fn length_ticks(&self) -> f64 {
        match self {
            Self::Impulses(impulses) => impulses.iter().fold(0.0, |most, (_, t)| t.max(most)),
            Self::Averages(ticks) => 2.0 * f64::from(*ticks),
        }
    }

    /// Variance of its times, servo ticks²: at a steady acceleration a the joint is a / 2 times it off
    /// the plan.
    pub fn variance_ticks2(&self) -> f64 {
        match self {
            Self::Impulses(impulses) => {
                let mean = self.delay_ticks();
                let off = impulses.iter().map(|(a, t)| a * (t - mean) * (t - mean));
                off.sum()
            }
            Self::Averages(ticks) => f64::from(*ticks) * f64::from(*ticks) / 6.0 - 1.0 / 6.0,
        }
    }
}

/// The shapes of a machine's joints.
#[inline(never)]
pub fn shapes(configuration: &MachineConfiguration) -> [Option<Shape>; JOINTS_MAX] {
    let servo_hz = configuration.servo_hz.max(1);
    let mut shapes = [const { None }; JOINTS_MAX];
    let shapers = configuration
        .shapers
        .iter()
        .take(configuration.joints.len());
    for (shape, shaper) in shapes.iter_mut().zip(shapers) {
        if shaper.is_right(servo_hz) {
            *shape = shaper.shape(servo_hz);
        }
    }
    shapes
}
