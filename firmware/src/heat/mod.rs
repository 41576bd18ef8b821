//! Heaters, their sensors and fans, and the guards that switch them off.
//!
//! ```text
//! conversions -> samples -> sensor -> guard -> regulator -> schedule of the PWM -> heater pins
//! 12 bit         share      °C        fault    duty 0..1    servo ticks             servo interrupt
//!                                       |        ^ flow, fan (feed-forward)
//!                                       +-> all off, latched, supply cut where only that helps
//! ```
//! In: conversions, targets and flow. Out: duties of heaters and fans, each period, and faults.
//! [`service::HeatService`] connects it with the motion, through [`HeatPanel`](crate::motion::heat_panel::HeatPanel).
//! Call [`Heat::sample`] for every conversion and [`Heat::tick`] ten times per second, both in a board's main loop:
//! the interrupts only output [`pwm::SoftPwm`]. No message of a host raises a limit or removes a cause. Not covered:
//! the conversion, and the pin assignment.

pub mod fans;
pub mod guard;
pub mod pwm;
pub mod regulator;
pub mod samples;
pub mod sensor;
pub mod service;

pub use guard::{HeatCause, HeatFault};

use crate::configuration::heat::{
    HEATERS_MAX, HeatConfiguration, HeaterConfiguration, HeaterRole, PERIOD_S,
};
use crate::design::HOST_SILENT_MS;
use fans::{FanSpeeds, Fans};
use guard::{Guard, View};
use heapless::Vec;
use pwm::{CHANNELS, Schedule};
use regulator::{HeatLoad, Regulator};
use samples::Samples;

/// Longest silence of the host while a heater is on, s.
pub const HOST_SILENT_S: f32 = HOST_SILENT_MS as f32 / 1000.0;
/// Rest in a pause after which hot ends are cooled down, s: for a shorter one reheating takes too long.
pub const STANDBY_AFTER_S: f32 = 60.0;
/// How much cooler, K: PLA at 210 °C stops oozing and does not cook.
pub const STANDBY_K: f32 = 50.0;
/// This close to the target is there, K: twice Klipper's `PID_SETTLE_DELTA`,
const READY_K: f32 = 2.0;
/// and no faster, K/s.
const READY_SLOPE_K_S: f32 = 0.3;
/// Time from a fault that switching off may not cure to the cut of the supply, s: meanwhile the head
/// comes to rest and retracts.
const SUPPLY_CUT_S: f32 = 2.0;

/// Requests and state of the machine for a period.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Orders {
    /// Targets, °C; 0 is off.
    pub targets_c: [f32; HEATERS_MAX],
    /// Part fan, 0 to 1.
    pub part_fan: f32,
    /// Melt that flows, mm³/s.
    pub flow_mm3_s: f32,
    /// The drivers are energised.
    pub drivers_on: bool,
    /// A host was heard since the last period.
    pub host_heard: bool,
    /// A fault of the machine is latched.
    pub faulted: bool,
    /// A stream is open: it outlasts a host that is silent.
    pub streams: bool,
    /// The head rests in a pause.
    pub paused: bool,
    /// Pulses of the hot end's fan since the last period.
    pub fan_turns: u8,
}

/// The outputs to set.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Outputs {
    /// Duties of the heaters, 0 to 1.
    pub duties: [f32; HEATERS_MAX],
    /// Speeds of the fans.
    pub fans: FanSpeeds,
    /// Only without its supply does the heater stop.
    pub cut_supply: bool,
    /// Heaters that are not yet at their target: a mask.
    pub not_ready: u8,
    /// Heaters whose target the board has lowered by itself: a mask.
    pub lowered: u8,
    /// The host of an open stream is silent: its targets end.
    pub lapsed: bool,
}

impl Outputs {
    /// No heater is to have power.
    pub fn is_cold(&self) -> bool {
        self.duties.iter().all(|duty| *duty <= 0.0)
    }

    /// The period as the PWM plays it: heaters from channel 0, then part, hot end and controller fan.
    pub fn schedule(&self) -> Schedule {
        let mut channels = [(0.0, false); CHANNELS];
        let fans = [self.fans.part, self.fans.hot_end, self.fans.controller];
        let heaters = self.duties.into_iter().map(|duty| (duty, false));
        let all = heaters.chain(fans.into_iter().map(|speed| (speed, true)));
        for (channel, output) in channels.iter_mut().zip(all) {
            *channel = output;
        }
        Schedule::new(&channels)
    }
}

/// A heater at work.
#[derive(Clone, Copy, Debug)]
struct Heater {
    configuration: HeaterConfiguration,
    samples: Samples,
    regulator: Regulator,
    guard: Guard,
    target_c: f32,
    reading_c: Option<f32>,
    duty: f32,
    expected: f32,
}

impl Heater {
    /// One period: the next duty, or the fault.
    fn tick(&mut self, target_c: f32, load: &HeatLoad) -> Result<f32, HeatCause> {
        let configuration = &self.configuration;
        let read = self.samples.take();
        let reading = read.and_then(|reading| configuration.sensor.celsius(reading.share));
        let view = View {
            reading,
            frozen_at: read.ok().and_then(|reading| reading.frozen_at),
            target_c,
            duty: self.duty,
            expected: self.expected,
        };
        self.reading_c = reading.ok();
        let (duty, expected) = (0.0, 0.0);
        (self.duty, self.expected) = (duty, expected);
        if let Some(cause) = self.guard.tick(configuration, &view) {
            return Err(cause);
        }
        let Ok(reading_c) = reading else {
            return Ok(0.0);
        };
        if target_c <= 0.0 || self.guard.is_blind() {
            self.regulator.rest(reading_c);
            return Ok(0.0);
        }
        let (gains, plant) = (&configuration.gains, &configuration.plant);
        self.expected = plant.holding_duty(target_c, load);
        self.duty = self.regulator.duty(gains, plant, target_c, reading_c, load);
        Ok(self.duty)
    }

    fn is_ready(&self, target_c: f32) -> bool {
        target_c <= 0.0
            || self.reading_c.is_some_and(|reading_c| {
                (reading_c - target_c).abs() <= READY_K
                    && self.regulator.slope_k_s().abs() <= READY_SLOPE_K_S
            })
    }
}

/// A share between 0 and 1; a value that is not a number is 0.
fn unit_share(value: f32) -> f32 {
    if value > 0.0 { value.min(1.0) } else { 0.0 }
}

/// All heaters of a board.
#[derive(Clone, Debug)]
pub struct Heat {
    heaters: Vec<Heater, HEATERS_MAX>,
    fans: Fans,
    fan_tells_turns: bool,
    fault: Option<HeatFault>,
    silent_s: f32,
    host_silent_s: f32,
    paused_s: f32,
    /// A heater was too hot or heated without a command, whatever was latched first. Nothing here ever takes that back:
    /// no reading says that a transistor obeys again.
    stays_on: Option<HeatFault>,
    stays_on_s: f32,
}

impl Heat {
    /// All off.
    pub fn new(configuration: &HeatConfiguration) -> Self {
        let mut heaters = Vec::new();
        for heater in &configuration.heaters {
            // Room for all by the type's bound; collecting could panic.
            let _ = heaters.push(Heater {
                configuration: *heater,
                samples: Samples::default(),
                regulator: Regulator::default(),
                guard: Guard::default(),
                target_c: 0.0,
                reading_c: None,
                duty: 0.0,
                expected: 0.0,
            });
        }
        Self {
            heaters,
            fans: Fans::default(),
            fan_tells_turns: configuration.fan_tells_turns,
            fault: None,
            silent_s: 0.0,
            host_silent_s: HOST_SILENT_S,
            paused_s: 0.0,
            stays_on: None,
            stays_on_s: 0.0,
        }
    }

    /// Waits so long for a silent host: for a simulation whose time runs faster than its host's.
    pub fn wait_for_host(&mut self, silent_s: f32) {
        self.host_silent_s = silent_s;
    }

    /// A conversion of a heater's sensor, 0 to 4095.
    pub fn sample(&mut self, heater: usize, raw: u16) {
        if let Some(heater) = self.heaters.get_mut(heater) {
            heater.samples.push(raw);
        }
    }

    /// One period of [`PERIOD_S`].
    pub fn tick(&mut self, orders: &Orders) -> Outputs {
        let mut outputs = Outputs {
            lapsed: self.note_host(orders),
            ..Outputs::default()
        };
        self.note_pause(orders);
        let off = self.fault.is_some() || orders.faulted || outputs.lapsed;
        let mut heats = false;
        for (index, heater) in self.heaters.iter_mut().enumerate() {
            let asked_c = orders.targets_c.get(index).copied().unwrap_or(0.0);
            // A value that is not a number means off, too.
            let asked_c = if asked_c > 0.0 {
                asked_c.min(heater.configuration.target_max_c())
            } else {
                0.0
            };
            let is_hot_end = heater.configuration.role == HeaterRole::HotEnd;
            let waits = is_hot_end && self.paused_s >= STANDBY_AFTER_S;
            let target_c = match (off, waits) {
                (true, _) => 0.0,
                (false, true) => (asked_c - STANDBY_K).max(0.0),
                (false, false) => asked_c,
            };
            let load = HeatLoad {
                fan: if is_hot_end { orders.part_fan } else { 0.0 },
                flow_mm3_s: if is_hot_end { orders.flow_mm3_s } else { 0.0 },
            };
            heater.target_c = target_c;
            let last_c = heater.reading_c;
            match heater.tick(target_c, &load) {
                Ok(duty) => {
                    if let Some(place) = outputs.duties.get_mut(index) {
                        *place = duty;
                    }
                }
                Err(cause) => {
                    let celsius = heater.reading_c.or(last_c).unwrap_or(0.0);
                    let fault = HeatFault {
                        cause,
                        heater: index as u8,
                        value: (celsius * 100.0) as i32,
                    };
                    if cause.is_stuck_on() {
                        self.stays_on.get_or_insert(fault);
                    }
                    self.fault.get_or_insert(fault);
                }
            }
            outputs.not_ready |= u8::from(!heater.is_ready(asked_c)) << index;
            outputs.lowered |= u8::from(!off && target_c < asked_c) << index;
            heats |= target_c > 0.0;
        }
        self.tick_fans(orders, heats, &mut outputs);
        if self.fault.is_some() {
            self.switch_off(&mut outputs);
        }
        outputs
    }

    fn tick_fans(&mut self, orders: &Orders, heats: bool, outputs: &mut Outputs) {
        let hot_ends = self
            .heaters
            .iter()
            .filter(|heater| heater.configuration.role == HeaterRole::HotEnd);
        let hot_end_heats = heats && !self.heaters.is_empty();
        self.fans
            .tick_hot_end(hot_ends.map(|heater| heater.reading_c), hot_end_heats);
        let drivers_on = orders.drivers_on || heats;
        outputs.fans = self.fans.tick_others(orders.part_fan, drivers_on);
        let stalled = self.fan_tells_turns && self.fans.stalled(orders.fan_turns);
        if stalled && heats {
            self.latch(HeatCause::FanStalled, 0);
        }
    }

    /// The host that heats must be heard. True if the one of an open stream is not: its heat ends without a fault, and
    /// it may come back. Without a stream nothing would say what happened, but a fault.
    fn note_host(&mut self, orders: &Orders) -> bool {
        let heats = orders.targets_c.iter().any(|target_c| *target_c > 0.0);
        self.silent_s = if orders.host_heard || !heats {
            0.0
        } else {
            self.silent_s + PERIOD_S
        };
        let is_silent = self.silent_s >= self.host_silent_s;
        if is_silent && !orders.streams {
            self.latch(HeatCause::HostSilent, self.host_silent_s as i32);
        }
        is_silent && orders.streams
    }

    fn note_pause(&mut self, orders: &Orders) {
        self.paused_s = if orders.paused {
            self.paused_s + PERIOD_S
        } else {
            0.0
        };
    }

    fn latch(&mut self, cause: HeatCause, value: i32) {
        self.fault.get_or_insert(HeatFault {
            cause,
            heater: 0,
            value,
        });
    }

    /// Everything off, and the supply where a transistor may not obey.
    fn switch_off(&mut self, outputs: &mut Outputs) {
        outputs.duties = [0.0; HEATERS_MAX];
        for heater in &mut self.heaters {
            heater.duty = 0.0;
        }
        if self.stays_on.is_some() {
            self.stays_on_s += PERIOD_S;
        }
        outputs.cut_supply = self.stays_on_s >= SUPPLY_CUT_S;
    }

    /// The fault of a heater that only its supply can stop: from then on until the board loses its power.
    pub fn stays_on(&self) -> Option<HeatFault> {
        self.stays_on
    }

    /// A run before a reset has left this fault: the supply is cut already.
    pub fn keep_cut(&mut self, fault: HeatFault) {
        if fault.cause.is_stuck_on() {
            (self.fault, self.stays_on) = (Some(fault), Some(fault));
            self.stays_on_s = SUPPLY_CUT_S;
        }
    }

    /// The latched fault.
    pub fn fault(&self) -> Option<HeatFault> {
        self.fault
    }

    /// Restarts with all off; a persisting cause trips again, and a heater that may be stuck stays one.
    pub fn clear_fault(&mut self) {
        self.fault = self.stays_on;
        self.silent_s = 0.0;
        for heater in &mut self.heaters {
            heater.guard.clear();
        }
    }

    /// Heaters.
    pub fn count(&self) -> usize {
        self.heaters.len()
    }

    /// A heater's configuration.
    pub fn configuration(&self, heater: usize) -> Option<&HeaterConfiguration> {
        self.heaters.get(heater).map(|heater| &heater.configuration)
    }

    /// Present target, °C: that of a standby, or 0 after a fault.
    pub fn target_c(&self, heater: usize) -> f32 {
        self.heaters
            .get(heater)
            .map_or(0.0, |heater| heater.target_c)
    }

    /// Duty of the next period, 0 to 1.
    pub fn duty(&self, heater: usize) -> f32 {
        self.heaters.get(heater).map_or(0.0, |heater| heater.duty)
    }

    /// Temperature of the last period, °C.
    pub fn reading_c(&self, heater: usize) -> Option<f32> {
        self.heaters.get(heater)?.reading_c
    }
}

#[cfg(test)]
pub(crate) mod tests;
