//! Finds the gains of a heater from an oscillation (Åström and Hägglund, 1984).
//!
//! In: temperature, °C, and duty with their times, s, while full power is switched on and off around a
//! temperature. Out: whether full power is due, and at the end the gains and the loss to the air. A relay
//! of amplitude d makes a lagging plant oscillate by a with the period of its stability limit, whose gain
//! is 4 d / (pi a); from there the gains are those of Ziegler and Nichols, as in Klipper's `PID_CALIBRATE`,
//! with half the proportional gain, because the controller here has a heat balance as well. Not covered:
//! the switching itself.

use headway_firmware::configuration::heat::Gains;
use headway_firmware::heat::regulator::AMBIENT_C;
use std::f64::consts::PI;

/// Swings that are measured, after the first that has the heating up in it.
const SWINGS: usize = 5;
/// Power is switched this far from the target, K, so that noise does not switch it.
const HYSTERESIS_K: f64 = 0.5;
/// Share of Ziegler's and Nichols' proportional gain.
const PROPORTIONAL: f64 = 0.3;

/// What was found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tuned {
    /// Gains.
    pub gains: Gains,
    /// Loss to the air as a share of full power, 1/K.
    pub loss_share_k: f64,
    /// Swing, K, and its period, s.
    pub amplitude_k: f64,
    /// Period, s.
    pub period_s: f64,
}

/// An oscillation being measured.
#[derive(Clone, Debug)]
pub struct RelayTuning {
    target_c: f64,
    on: bool,
    /// Times of switching on, s.
    begun_s: Vec<f64>,
    lowest_c: f64,
    highest_c: f64,
    swings_k: Vec<f64>,
    last_s: f64,
    on_s: f64,
}

impl RelayTuning {
    /// Around a temperature, °C.
    pub fn new(target_c: f64) -> Self {
        Self {
            target_c,
            on: true,
            begun_s: Vec::new(),
            lowest_c: f64::INFINITY,
            highest_c: f64::NEG_INFINITY,
            swings_k: Vec::new(),
            last_s: 0.0,
            on_s: 0.0,
        }
    }

    /// Handles a reading: whether full power is due, and the result once it is known.
    pub fn look(&mut self, now_s: f64, celsius: f64) -> (bool, Option<Tuned>) {
        if self.on && self.begun_s.len() > 1 {
            self.on_s += now_s - self.last_s;
        }
        self.last_s = now_s;
        self.lowest_c = self.lowest_c.min(celsius);
        self.highest_c = self.highest_c.max(celsius);
        if self.on && celsius > self.target_c + HYSTERESIS_K {
            self.on = false;
        } else if !self.on && celsius < self.target_c - HYSTERESIS_K {
            self.on = true;
            if !self.begun_s.is_empty() {
                self.swings_k.push((self.highest_c - self.lowest_c) / 2.0);
            }
            self.begun_s.push(now_s);
            (self.lowest_c, self.highest_c) = (celsius, celsius);
        }
        (self.on, self.found())
    }

    fn found(&self) -> Option<Tuned> {
        if self.begun_s.len() < SWINGS + 2 {
            return None;
        }
        let (first, last) = (self.begun_s.get(1)?, self.begun_s.last()?);
        let period_s = (last - first) / SWINGS as f64;
        let swings = self.swings_k.get(1..)?;
        let amplitude_k = swings.iter().sum::<f64>() / swings.len() as f64;
        let share = self.on_s / (last - first);
        let limit_gain = 4.0 * 0.5 / (PI * amplitude_k);
        let proportional = PROPORTIONAL * limit_gain;
        Some(Tuned {
            gains: Gains {
                proportional: proportional as f32,
                integral: (proportional / (2.0 * period_s)) as f32,
                derivative: (proportional * 0.25 * period_s) as f32,
            },
            loss_share_k: share / (self.target_c - f64::from(AMBIENT_C)),
            amplitude_k,
            period_s,
        })
    }
}
