//! Monitors a heater, independently of any command.
//!
//! In: reading, target and duty of each period. Out: the fault that switches all heaters off. Slow
//! heating and drift are detected as in Klipper's `verify_heater`, with its values; checks that Klipper
//! leaves to the range of a sensor (stuck heaters, frozen converters, implausible power) are added,
//! since the board has to work without a host. `docs/design/heat.md` has each bound with its reason.

use crate::configuration::heat::{HeaterConfiguration, HeaterRole, PERIOD_S};

/// Periods in a row that a sensor may be unreadable or out of range: 0.3 s, where Klipper's
/// `RANGE_CHECK_COUNT` takes 1.2 s. The heater is off from the first one on.
const BAD_PERIODS: u8 = 3;
/// Lowest reading at which anything is heated, °C: Klipper's usual `min_temp`. Below it a wire is
/// nearly open.
const READING_MIN_C: f32 = 0.0;
/// Klipper's `hysteresis`, K.
const HYSTERESIS_K: f32 = 5.0;
/// Klipper's `max_error`, K s: four seconds 30 K away, or two minutes 1 K outside the hysteresis.
const ERROR_MAX_K_S: f32 = 120.0;
/// Share of time without evidence of a fault that counts against time with it: a host that changes the target cannot
/// wear the guards down, and a person who mends a heater waits minutes, not for ever.
const FORGIVEN_SHARE: f32 = 0.1;
/// Klipper's `heating_gain`, K,
const GAIN_K: f32 = 2.0;
/// and its `check_gain_time` for a hot end and a bed, s.
const GAIN_HOT_END_S: f32 = 20.0;
const GAIN_BED_S: f32 = 60.0;
/// Time after switching off until the heat inside has come out, s: three times the longest lag of a
/// sensor.
const SETTLE_S: f32 = 12.0;
/// A heater that is off must not get warmer by so much, K,
const STUCK_RISE_K: f32 = 4.0;
/// within one to two of these windows, s: a bed next to it warms a hot end by less than 0.1 K/s, a
/// shorted transistor the slowest bed by 0.25 K/s.
const STUCK_WINDOW_S: f32 = 16.0;
/// Time that every conversion may give the same number while heating, s: noise and regulation move
/// a living one many times a second.
const FROZEN_S: f32 = 10.0;
/// Time at the target over which power is compared with the heat balance, s: twice in a row,
const POWER_WINDOW_S: f32 = 30.0;
/// with a reading that moved no more than this, K: 10 W into a bed,
const POWER_DRIFT_K: f32 = 0.5;
/// and how far it may be off: of full duty, and of what was expected.
const POWER_SURPLUS: f32 = 0.15;
const POWER_SURPLUS_SHARE: f32 = 0.25;

/// Why heaters were switched off.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum HeatCause {
    /// The sensor's wire is broken.
    SensorOpen,
    /// The sensor is shorted.
    SensorShorted,
    /// The converter gives no numbers.
    SensorSilent,
    /// The converter always gives the same number.
    SensorFrozen,
    /// Above the heater's limit.
    OverTemperature,
    /// Below any possible temperature of a heater.
    UnderTemperature,
    /// It does not get warmer as fast as it should.
    HeatingSlow,
    /// It has left its target.
    Drift,
    /// It gets warmer while it is off.
    HeaterStuck,
    /// Its power does not match this temperature.
    PowerMismatch,
    /// No host was heard for too long.
    HostSilent,
    /// The hot end's fan does not turn.
    FanStalled,
}

impl HeatCause {
    /// True where switching off may not be enough.
    pub fn is_stuck_on(self) -> bool {
        matches!(self, Self::HeaterStuck | Self::OverTemperature)
    }
}

/// A heater's fault with the value that tripped it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct HeatFault {
    /// What tripped.
    pub cause: HeatCause,
    /// Heater, from 0.
    pub heater: u8,
    /// Last good reading in 0.01 °C; of a silent host the seconds.
    pub value: i32,
}

/// The data that a guard checks.
#[derive(Clone, Copy, Debug)]
pub struct View {
    /// Temperature, °C, or the reason why it is unknown.
    pub reading: Result<f32, HeatCause>,
    /// The conversion that all were equal to.
    pub frozen_at: Option<u16>,
    /// Target, °C; 0 is off.
    pub target_c: f32,
    /// Duty of the period that is over.
    pub duty: f32,
    /// The power expected from the heat balance.
    pub expected: f32,
}

/// Where the reading is.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Place {
    Below(f32),
    Within,
    Above(f32),
}

impl Place {
    /// Relative to a target and its hysteresis, with the distance to that, K.
    fn of(reading_c: f32, target_c: f32) -> Self {
        let off_k = (reading_c - target_c).abs() - HYSTERESIS_K;
        match (off_k > 0.0, reading_c < target_c) {
            (false, _) => Self::Within,
            (true, true) => Self::Below(off_k),
            (true, false) => Self::Above(off_k),
        }
    }
}

/// State of a heater's guard.
#[derive(Clone, Copy, Debug)]
pub struct Guard {
    bad_periods: u8,
    target_c: f32,
    /// The target was reached, and was not moved away from the reading since.
    reached: bool,
    /// Heating up: the reading that is evidence of it, °C, and the time spent without any, s.
    goal_c: f32,
    vain_s: f32,
    /// It has risen in this approach: before, what was hot inside may cool down.
    has_risen: bool,
    error_k_s: f32,
    off_s: f32,
    /// Lowest readings of the window before and of the present one, °C.
    lowest_c: [f32; 2],
    window_s: f32,
    frozen: Option<u16>,
    frozen_s: f32,
    /// Mean of duty less expected duty over the present window, s of it, and its first reading, °C.
    surplus: f32,
    held_s: f32,
    held_from_c: f32,
    /// The window before had too much of it.
    surplus_before: bool,
}

impl Default for Guard {
    fn default() -> Self {
        Self {
            bad_periods: 0,
            target_c: 0.0,
            reached: false,
            goal_c: f32::INFINITY,
            vain_s: 0.0,
            has_risen: false,
            error_k_s: 0.0,
            off_s: 0.0,
            lowest_c: [f32::INFINITY; 2],
            window_s: 0.0,
            frozen: None,
            frozen_s: 0.0,
            surplus: 0.0,
            held_s: 0.0,
            held_from_c: 0.0,
            surplus_before: false,
        }
    }
}

impl Guard {
    /// One period: the fault, if any.
    pub fn tick(&mut self, heater: &HeaterConfiguration, view: &View) -> Option<HeatCause> {
        let heats = view.target_c > 0.0;
        let reading_c = match self.readable(heater, view, heats) {
            Ok(reading_c) => reading_c,
            Err(fault) => return fault,
        };
        let frozen = self.frozen(view, heats);
        let lost = self.follow(heater, view.target_c, reading_c);
        let stuck = self.stuck(view.duty, reading_c);
        let power = self.power(heater, view, reading_c);
        frozen.or(stuck).or(lost).or(power)
    }

    /// True if the reading of this period could not be believed: the heater is to be off.
    pub fn is_blind(&self) -> bool {
        self.bad_periods > 0
    }

    fn readable(
        &mut self,
        heater: &HeaterConfiguration,
        view: &View,
        heats: bool,
    ) -> Result<f32, Option<HeatCause>> {
        let cause = match view.reading {
            Ok(reading_c) if reading_c > heater.limit_c => HeatCause::OverTemperature,
            Ok(reading_c) if reading_c < READING_MIN_C => HeatCause::UnderTemperature,
            Ok(reading_c) => {
                self.bad_periods = 0;
                return Ok(reading_c);
            }
            Err(cause) => cause,
        };
        self.bad_periods = self.bad_periods.saturating_add(1);
        // A second hot end may be absent, as long as it is not heated.
        let matters = heats || cause == HeatCause::OverTemperature;
        Err((matters && self.bad_periods >= BAD_PERIODS).then_some(cause))
    }

    fn frozen(&mut self, view: &View, heats: bool) -> Option<HeatCause> {
        if view.frozen_at.is_none() || view.frozen_at != self.frozen {
            self.frozen = view.frozen_at;
            self.frozen_s = 0.0;
        } else if heats {
            // Off, it may rest; what was counted stays.
            self.frozen_s += PERIOD_S;
        }
        (heats && self.frozen_s >= FROZEN_S).then_some(HeatCause::SensorFrozen)
    }

    /// Too slow in heating up, or off the target later. A new target restarts neither: only a reading that rises is
    /// evidence that the heater heats its sensor, and time alone forgives little.
    fn follow(
        &mut self,
        heater: &HeaterConfiguration,
        target_c: f32,
        reading_c: f32,
    ) -> Option<HeatCause> {
        let before_c = core::mem::replace(&mut self.target_c, target_c);
        let was_there = before_c <= 0.0 || Place::of(reading_c, before_c) == Place::Within;
        match Place::of(reading_c, target_c) {
            _ if target_c <= 0.0 => self.forgive(reading_c),
            Place::Within => {
                self.reached = true;
                if reading_c >= self.goal_c {
                    (self.vain_s, self.error_k_s) = (0.0, 0.0);
                }
                self.forgive(reading_c);
            }
            off => {
                if was_there && before_c != target_c {
                    // It has to get there first.
                    self.reached = false;
                    self.has_risen = false;
                }
                return self.off(heater, off, reading_c);
            }
        }
        None
    }

    /// A period beyond the hysteresis.
    fn off(
        &mut self,
        heater: &HeaterConfiguration,
        place: Place,
        reading_c: f32,
    ) -> Option<HeatCause> {
        let gain_s = match heater.role {
            HeaterRole::HotEnd => GAIN_HOT_END_S,
            HeaterRole::Bed => GAIN_BED_S,
        };
        let below_k = match place {
            Place::Below(below_k) => below_k,
            // Not while it cools down to a lower target.
            Place::Above(above_k) if self.reached => {
                self.error_k_s += above_k * PERIOD_S;
                return (self.error_k_s >= ERROR_MAX_K_S).then_some(HeatCause::Drift);
            }
            Place::Above(_) | Place::Within => {
                self.forgive(reading_c);
                return None;
            }
        };
        if !self.has_risen {
            self.goal_c = self.goal_c.min(reading_c + GAIN_K);
        }
        if reading_c >= self.goal_c && !self.reached {
            self.goal_c = reading_c + GAIN_K;
            (self.vain_s, self.error_k_s) = (0.0, 0.0);
            self.has_risen = true;
            return None;
        }
        self.error_k_s += below_k * PERIOD_S;
        let is_over = self.error_k_s >= ERROR_MAX_K_S && (self.reached || self.vain_s >= gain_s);
        if !self.reached {
            self.vain_s += PERIOD_S;
        }
        is_over.then_some(match self.reached {
            true => HeatCause::Drift,
            false => HeatCause::HeatingSlow,
        })
    }

    /// A period without evidence of a fault.
    fn forgive(&mut self, reading_c: f32) {
        let less = |value: f32, by: f32| (value - by).max(0.0);
        self.vain_s = less(self.vain_s, FORGIVEN_SHARE * PERIOD_S);
        self.error_k_s = less(self.error_k_s, PERIOD_S);
        self.goal_c = reading_c + GAIN_K;
        self.has_risen = false;
    }

    /// The fault was cleared: what was found about the heater's rise stays.
    pub fn clear(&mut self) {
        *self = Self {
            target_c: self.target_c,
            goal_c: self.goal_c,
            vain_s: self.vain_s,
            error_k_s: self.error_k_s,
            frozen: self.frozen,
            frozen_s: self.frozen_s,
            ..Self::default()
        };
    }

    /// Warmer while it is off.
    fn stuck(&mut self, duty: f32, reading_c: f32) -> Option<HeatCause> {
        if duty > 0.0 {
            self.off_s = 0.0;
            return None;
        }
        if self.off_s < SETTLE_S {
            self.off_s += PERIOD_S;
            self.lowest_c = [f32::INFINITY; 2];
            self.window_s = 0.0;
            return None;
        }
        let [before, present] = self.lowest_c;
        self.lowest_c = [before, present.min(reading_c)];
        self.window_s += PERIOD_S;
        if self.window_s >= STUCK_WINDOW_S {
            self.window_s = 0.0;
            self.lowest_c = [present.min(reading_c), reading_c];
        }
        let [before, present] = self.lowest_c;
        (reading_c >= before.min(present) + STUCK_RISE_K).then_some(HeatCause::HeaterStuck)
    }

    /// Another power than the temperature takes: the sensor is not where the heat is.
    fn power(
        &mut self,
        heater: &HeaterConfiguration,
        view: &View,
        reading_c: f32,
    ) -> Option<HeatCause> {
        let holds = (reading_c - view.target_c).abs() < HYSTERESIS_K;
        if !heater.plant.measured || !holds {
            self.held_s = 0.0;
            self.surplus_before = false;
            return None;
        }
        if self.held_s <= 0.0 {
            (self.held_from_c, self.surplus) = (reading_c, 0.0);
        }
        self.held_s += PERIOD_S;
        self.surplus += (view.duty - view.expected) * (PERIOD_S / POWER_WINDOW_S);
        if self.held_s < POWER_WINDOW_S {
            return None;
        }
        self.held_s = 0.0;
        // Where it still gets warmer, the power goes there.
        let rests = (reading_c - self.held_from_c).abs() <= POWER_DRIFT_K;
        let bound = POWER_SURPLUS + POWER_SURPLUS_SHARE * view.expected;
        let is_off = rests && self.surplus.abs() > bound;
        let before = core::mem::replace(&mut self.surplus_before, is_off);
        (is_off && before).then_some(HeatCause::PowerMismatch)
    }
}
