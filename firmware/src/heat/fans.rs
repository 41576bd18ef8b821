//! Fans: the part's as requested, the hot end's by temperature, the controller's by the drivers.
//!
//! In: readings, targets, whether drivers are energised. Out: speeds, 0 to 1. Values after Klipper's
//! `heater_fan` (`heater_temp` 50) and `controller_fan` (`idle_timeout` 30).

use super::unit_share;
use crate::configuration::heat::PERIOD_S;

/// Above it a hot end needs its fan, °C: below, no plastic softens.
const HOT_C: f32 = 50.0;
/// Run-on time of the controller's fan, s.
const AFTER_RUN_S: f32 = 30.0;
/// A fan takes this long to start, and may be without a turn for as long, s.
const STALL_S: f32 = 3.0;

/// Speeds, 0 to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FanSpeeds {
    /// At the part.
    pub part: f32,
    /// At the hot end's heat sink.
    pub hot_end: f32,
    /// At the controller.
    pub controller: f32,
}

/// State of the fans.
#[derive(Clone, Copy, Debug, Default)]
pub struct Fans {
    speeds: FanSpeeds,
    after_run_s: f32,
    still_s: f32,
}

impl Fans {
    /// A hot end's heat sink must be cooled. A reading that is missing changes nothing: it was hot or
    /// not.
    pub fn tick_hot_end(&mut self, readings_c: impl Iterator<Item = Option<f32>>, heats: bool) {
        let mut known = false;
        let mut hot = heats;
        for reading_c in readings_c.flatten() {
            known = true;
            hot |= reading_c > HOT_C;
        }
        if known || hot {
            self.speeds.hot_end = f32::from(u8::from(hot));
        }
    }

    /// The controller's and the part's.
    pub fn tick_others(&mut self, part: f32, drivers_on: bool) -> FanSpeeds {
        self.after_run_s = if drivers_on {
            AFTER_RUN_S
        } else {
            self.after_run_s - PERIOD_S
        };
        self.speeds.controller = f32::from(u8::from(self.after_run_s > 0.0));
        self.speeds.part = unit_share(part);
        self.speeds
    }

    /// True if the hot end's fan should turn and does not.
    pub fn stalled(&mut self, turns: u8) -> bool {
        if self.speeds.hot_end <= 0.0 || turns > 0 {
            self.still_s = 0.0;
        } else {
            self.still_s += PERIOD_S;
        }
        self.still_s > STALL_S
    }
}
