//! Input shapers: what a joint's targets are averaged with, so that its frame does not ring.
//!
//! Shaped targets are y(t) = sum of A_k x(t - t_k) with A_k > 0 that add up to 1: a mean of the plan at a
//! few earlier moments. It moves no joint faster, harder or further than the plan does, and ends where the
//! plan ends. ZV (Singer and Seering, 1990), MZV and EI are Klipper's (`klippy/extras/shaper_defs.py`);
//! `Smooth` is the average over one period of the vibration, of the average over one period.
//!
//! In: kind, frequency in Hz and damping of a joint. Out: impulses in servo ticks, the line's whole wait,
//! and the place of each tap in it (`steps/shaper.rs`). All joints and the extruder wait as long as the
//! mean of the longest shaper: [`Delays`]. Left out: the extruder, which is not shaped.

use crate::configuration::{JOINTS_MAX, MachineConfiguration};
use crate::delay::advance_centre_ticks;
use crate::steps::WAIT_TICKS_MAX;
use heapless::Vec;
use serde::{Deserialize, Serialize};

/// Impulses of a shaper, at most.
pub const IMPULSES_MAX: usize = 3;
/// Residual vibration that EI leaves at the frequency it is tuned to, for more room beside it.
const EI_TOLERANCE: f64 = 0.05;
/// Lowest frequency that is looked at; how low it may be hangs on the line.
const FREQUENCY_MIN_HZ: f64 = 1.0;
/// Largest damping ratio: what is damped more does not ring.
const DAMPING_MAX: f64 = 0.5;
/// No joint shaped.
pub const UNSHAPED: [Shaper; JOINTS_MAX] = [Shaper {
    kind: ShaperKind::None,
    frequency_hz: 0.0,
    damping: 0.0,
}; JOINTS_MAX];
/// Largest way off the plan, motor steps: targets are told apart up to 512, less a tick's way (`steps/line.rs`).
const OFF_PLAN_STEPS_MAX: f64 = 400.0;

/// How a joint is shaped.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum ShaperKind {
    /// Not at all.
    #[default]
    None,
    /// Two impulses, half a period long: 23 % are left where the frequency is 15 % off.
    Zv,
    /// Three impulses, three quarters of a period.
    Mzv,
    /// Three impulses, a period: the least left where the frequency is not well known.
    Ei,
    /// Two averages over a period, one after the other, two periods long: the least of all above it too.
    Smooth,
}

/// One joint's shaper.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Shaper {
    /// How.
    pub kind: ShaperKind,
    /// Frequency of the vibration, Hz.
    pub frequency_hz: f64,
    /// Its damping ratio, 0 to 0.5.
    pub damping: f64,
}

/// What is left of a shaper on a machine's servo ticks.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// Weights, which add up to 1, and times in servo ticks, the first 0.
    Impulses(Vec<(f64, f64), IMPULSES_MAX>),
    /// The average over so many ticks, twice.
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

    /// The number to blame where it does not fit, with its place among the items of a refusal.
    pub(crate) fn wrong_number(&self) -> (u8, f64) {
        if (0.0..=DAMPING_MAX).contains(&self.damping) {
            (1, self.frequency_hz)
        } else {
            (2, self.damping)
        }
    }

    /// True if its numbers make sense; that it fits the line is [`Delays::of`]'s.
    fn is_right(&self, servo_hz: u32) -> bool {
        // A period of at least four servo ticks: shorter ones cannot be told from others.
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

/// How long what waits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Delays {
    /// Servo ticks that joints and the planned extruder wait.
    pub line_ticks: u32,
    /// Servo ticks that the advance waits, so that it stays centred.
    pub advance_ticks: u32,
    /// Servo ticks after which nothing of a target is on its way.
    pub settle_ticks: u32,
}

impl Delays {
    /// Of a machine; `None` where a shaper is longer than the line, or takes a joint too far off its plan.
    #[inline(never)]
    pub fn of(configuration: &MachineConfiguration) -> Option<Self> {
        let servo_hz = configuration.servo_hz.max(1);
        let centre_ticks = advance_centre_ticks(&configuration.extruder, servo_hz);
        let mut line_ticks = centre_ticks;
        let shapes = shapes(configuration);
        for (shape, joint) in shapes.iter().zip(&configuration.joints) {
            let Some(shape) = shape else { continue };
            // A motor that two joints move adds up what both are off.
            let per_tick2 =
                configuration.motors.share() * joint.acceleration_max * joint.steps_per_unit
                    / (f64::from(servo_hz) * f64::from(servo_hz));
            if per_tick2 * shape.variance_ticks2() / 2.0 > OFF_PLAN_STEPS_MAX {
                return None;
            }
            line_ticks = line_ticks.max(libm::ceil(shape.delay_ticks()) as u32);
        }
        let mut settle_ticks = line_ticks;
        for shape in shapes.iter().flatten() {
            let rest = libm::ceil(shape.length_ticks() - shape.delay_ticks()) as u32;
            // One for the part of a tick, one for the way that ends there.
            settle_ticks = settle_ticks.max(line_ticks.saturating_add(rest).saturating_add(2));
        }
        (settle_ticks <= WAIT_TICKS_MAX).then_some(Self {
            line_ticks,
            advance_ticks: line_ticks - centre_ticks,
            settle_ticks,
        })
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

/// The first joint whose shaper cannot be run.
pub(crate) fn wrong_shaper(configuration: &MachineConfiguration) -> Option<usize> {
    let servo_hz = configuration.servo_hz;
    let mut shapers = configuration.shapers.iter();
    let wrong = shapers.position(|shaper| !shaper.is_right(servo_hz));
    wrong.or_else(|| {
        if Delays::of(configuration).is_some() {
            return None;
        }
        // The longest is the one to blame.
        let length = |shape: &Option<Shape>| shape.as_ref().map_or(0.0, Shape::length_ticks);
        let mut longest = (0, 0.0);
        for (joint, shape) in shapes(configuration).iter().enumerate() {
            if length(shape) > longest.1 {
                longest = (joint, length(shape));
            }
        }
        Some(longest.0)
    })
}
