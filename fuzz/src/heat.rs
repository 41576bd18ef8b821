//! Heaters with sensors that fail and transistors that do not obey, whatever is ordered, in periods of the heat loop.
//!
//! 1. Duties and fans are shares.
//! 2. No power without a target, with a fault of the machine or of a heater, in a period whose reading is none or out
//!    of range.
//! 3. No power a period longer than the patience after a host was heard.
//! 4. No heater whose transistor obeys gets hotter than its limit, and of one that does not the supply is cut in time,
//!    for ever.
//! 5. A sensor that has come off is not heated for long, whatever targets follow one another.

use arbitrary::Arbitrary;
use headway_firmware::configuration::heat::{
    HEATERS_MAX, HeatConfiguration, HeaterConfiguration, HeaterRole, PERIOD_S,
};
use headway_firmware::configuration::sensor::Sensor;
use headway_firmware::heat::samples::FULL_SCALE;
use headway_firmware::heat::{HOST_SILENT_S, Heat, Orders, Outputs};
use std::sync::LazyLock;

/// Where everything begins, and where heat goes, °C.
const AIR_C: f32 = 25.0;
/// Heat capacities of a usual hot end and bed, J/K.
const HOT_END_J_K: f32 = 16.7;
const BED_J_K: f32 = 900.0;
/// Conversions of a sensor in a period.
const CONVERSIONS: u16 = 16;
/// What a reading may be below its sensor: counts are of whole degrees, and half a count of noise is a degree where the
/// curve is flat.
const READING_ERROR_K: f32 = 4.0;
/// Steps of one run that are followed, and its periods.
const STEPS_MAX: usize = 64;
const PERIODS_MAX: u32 = 8_000;
/// Periods that a sensor may be out of range before its fault, and until the supply is cut: 0.3 s and 2 s, and one.
const CUT_PERIODS: f32 = 24.0;
/// A target so far above the reading is far: its guard trips for want of a rise, and for nothing else.
const FAR_K: f32 = 40.0;
/// Time that a heater may heat a sensor that does not rise: the guard's time for a rise, and the tenth of the rest that
/// it forgives; periods of slack for every change.
const VAIN_S: [f32; 2] = [20.0, 60.0];
const FORGIVEN_SHARE: f32 = 0.1;

/// What becomes of a sensor.
#[derive(Arbitrary, Clone, Copy, Debug, PartialEq)]
pub enum Defect {
    /// Nothing.
    None,
    Open,
    Shorted,
    Silent,
    /// It gives this number.
    Frozen(u16),
    /// It has come off, and is in the air.
    Loose,
}

/// Some periods.
#[derive(Arbitrary, Debug)]
pub struct Step {
    /// Targets in units of 2 °C.
    targets: [u8; HEATERS_MAX],
    defects: [Option<Defect>; HEATERS_MAX],
    /// Transistors that conduct whatever their pin says, one bit each, if it is to change.
    conducts: Option<u8>,
    fan: u8,
    flow: u8,
    flags: u8,
    fan_turns: u8,
    clears: bool,
    periods: u8,
}

/// A whole run.
#[derive(Arbitrary, Debug)]
pub struct Run {
    fan_tells_turns: bool,
    measured: bool,
    steps: Vec<Step>,
}

/// Counts of a sensor for every degree from 0 on.
static COUNTS: LazyLock<Vec<u16>> = LazyLock::new(|| {
    let sensor = Sensor::GENERIC_3950;
    let warmer = |count: u16, celsius: u16| {
        let read = sensor.celsius(f32::from(count) / f32::from(FULL_SCALE));
        read.map_or(count < FULL_SCALE / 2, |read| read > f32::from(celsius))
    };
    (0..500)
        .map(|celsius| (0..FULL_SCALE).rev().find(|count| warmer(*count, celsius)))
        .map(|count| count.unwrap_or(0))
        .collect()
});

struct Bench {
    heaters: Vec<HeaterConfiguration>,
    heat: Heat,
    celsius: [f32; HEATERS_MAX],
    defects: [Defect; HEATERS_MAX],
    outputs: Outputs,
    /// Transistors that conduct.
    conducts: u8,
    /// Any of them ever did, and a sensor ever failed.
    conducted: bool,
    lied: bool,
    cut: bool,
    /// Above the limit, by its reading, or longer on than it may: periods since.
    hot_periods: f32,
    silent_s: f32,
    /// Time that each sensor is off by now, and that its heater had power for a far target meanwhile.
    loose_s: [f32; HEATERS_MAX],
    vain_s: [f32; HEATERS_MAX],
    changes: f32,
    periods: u32,
}

/// Runs it.
pub fn run(run: &Run) {
    let mut heaters = [HeaterConfiguration::HOT_END, HeaterConfiguration::BED];
    for heater in &mut heaters {
        heater.plant.measured = run.measured;
    }
    let configuration = HeatConfiguration {
        heaters: heaters.into_iter().collect(),
        fan_tells_turns: run.fan_tells_turns,
    };
    let mut bench = Bench {
        heaters: heaters.to_vec(),
        heat: Heat::new(&configuration),
        celsius: [AIR_C; HEATERS_MAX],
        defects: [Defect::None; HEATERS_MAX],
        outputs: Outputs::default(),
        conducts: 0,
        conducted: false,
        lied: false,
        cut: false,
        hot_periods: 0.0,
        silent_s: 0.0,
        loose_s: [0.0; HEATERS_MAX],
        vain_s: [0.0; HEATERS_MAX],
        changes: 0.0,
        periods: 0,
    };
    for step in run.steps.iter().take(STEPS_MAX) {
        bench.step(step);
    }
}

impl Bench {
    fn step(&mut self, step: &Step) {
        for (defect, new) in self.defects.iter_mut().zip(step.defects) {
            *defect = new.unwrap_or(*defect);
        }
        self.lied |= self.defects.iter().any(|defect| *defect != Defect::None);
        self.conducts = step.conducts.unwrap_or(self.conducts);
        self.conducted |= self.conducts & 3 != 0;
        if step.clears {
            self.heat.clear_fault();
            self.silent_s = 0.0;
        }
        self.changes += 1.0;
        let flag = |bit: u8| step.flags >> bit & 1 == 1;
        let orders = Orders {
            targets_c: step.targets.map(|target| f32::from(target) * 2.0),
            part_fan: f32::from(step.fan) / 255.0,
            flow_mm3_s: f32::from(step.flow) / 10.0,
            drivers_on: flag(0),
            host_heard: flag(1),
            faulted: flag(2) && flag(3),
            streams: flag(4),
            paused: flag(5),
            fan_turns: step.fan_turns,
        };
        for _ in 0..step.periods {
            if self.periods < PERIODS_MAX {
                self.periods += 1;
                self.period(&orders);
            }
        }
    }

    fn period(&mut self, orders: &Orders) {
        let readings = [0, 1].map(|heater| self.convert(heater));
        let faulted = self.heat.fault().is_some();
        let stuck = self.heat.stays_on().is_some();
        self.outputs = self.heat.tick(orders);
        let outputs = self.outputs;
        let fans = [
            outputs.fans.part,
            outputs.fans.hot_end,
            outputs.fans.controller,
        ];
        for share in outputs.duties.iter().chain(&fans) {
            assert!((0.0..=1.0).contains(share), "{outputs:?}");
        }
        let heats = orders.targets_c.iter().any(|target_c| *target_c > 0.0);
        let counts = !orders.host_heard && heats;
        self.silent_s = if counts {
            self.silent_s + PERIOD_S
        } else {
            0.0
        };
        let off = faulted || orders.faulted || self.silent_s > HOST_SILENT_S + PERIOD_S;
        assert!(!off || outputs.is_cold(), "{outputs:?}, {orders:?}");
        assert!(
            !stuck || self.heat.stays_on().is_some(),
            "a stuck heater is forgotten"
        );
        assert!(!self.cut || outputs.cut_supply, "the supply is back");
        self.cut = outputs.cut_supply;
        for (number, reading_c) in readings.into_iter().enumerate() {
            let limit_c = self.heaters[number].limit_c;
            let is_believed = reading_c.is_some_and(|c| (0.0..=limit_c).contains(&c));
            let may = orders.targets_c[number] > 0.0 && is_believed;
            assert!(
                may || outputs.duties[number] <= 0.0,
                "{outputs:?}, {reading_c:?}"
            );
            self.look_for_rise(number, reading_c, orders.targets_c[number]);
        }
        self.warm();
    }

    /// A sensor's conversions of a period, and their temperature.
    fn convert(&mut self, heater: usize) -> Option<f32> {
        let celsius = match self.defects[heater] {
            Defect::Loose => AIR_C,
            _ => self.celsius[heater],
        };
        let place = (celsius.max(0.0) as usize).min(COUNTS.len() - 1);
        let raw = match self.defects[heater] {
            Defect::Open => FULL_SCALE,
            Defect::Shorted => 0,
            Defect::Silent => return None,
            Defect::Frozen(raw) => raw.min(FULL_SCALE),
            Defect::None | Defect::Loose => COUNTS[place],
        };
        let noisy = matches!(self.defects[heater], Defect::None | Defect::Loose);
        for number in 0..CONVERSIONS {
            let noise = if noisy { number % 2 } else { 0 };
            self.heat.sample(heater, raw + noise);
        }
        let mean = f32::from(raw) + if noisy { 0.5 } else { 0.0 };
        let share = mean / f32::from(FULL_SCALE);
        self.heaters[heater].sensor.celsius(share).ok()
    }

    fn look_for_rise(&mut self, number: usize, reading_c: Option<f32>, target_c: f32) {
        if self.defects[number] != Defect::Loose {
            (self.loose_s[number], self.vain_s[number]) = (0.0, 0.0);
            return;
        }
        self.loose_s[number] += PERIOD_S;
        let is_far = reading_c.is_some_and(|reading_c| target_c > reading_c + FAR_K);
        if is_far && self.outputs.duties[number] > 0.0 {
            self.vain_s[number] += PERIOD_S;
        }
        let most_s = VAIN_S[number] + FORGIVEN_SHARE * self.loose_s[number];
        // In a paused stream the board itself lowers the target: that is a change, too.
        let slack_s = (2.0 * self.changes + 40.0) * PERIOD_S;
        assert!(
            self.vain_s[number] <= most_s + slack_s,
            "heater {number} heats {} of {} s in vain",
            self.vain_s[number],
            self.loose_s[number]
        );
    }

    fn warm(&mut self) {
        let mut is_hot = false;
        for (number, heater) in self.heaters.iter().enumerate() {
            let capacity_j_k = match heater.role {
                HeaterRole::HotEnd => HOT_END_J_K,
                HeaterRole::Bed => BED_J_K,
            };
            let share = match (self.cut, self.conducts >> number & 1 == 1) {
                (true, _) => 0.0,
                (false, true) => 1.0,
                (false, false) => self.outputs.duties[number],
            };
            let plant = &heater.plant;
            let away_k = self.celsius[number] - AIR_C;
            let watts = share * plant.power_w - away_k * plant.loss_w_k;
            self.celsius[number] += watts / capacity_j_k * PERIOD_S;
            is_hot |= self.defects[number] == Defect::None
                && self.celsius[number] > heater.limit_c + READING_ERROR_K;
        }
        self.hot_periods = if is_hot && !self.cut {
            self.hot_periods + 1.0
        } else {
            0.0
        };
        assert!(
            self.hot_periods <= CUT_PERIODS,
            "{:?} °C with the supply on",
            self.celsius
        );
        assert!(
            !is_hot || self.conducted || self.lied,
            "{:?} °C while every part obeys",
            self.celsius
        );
    }
}
