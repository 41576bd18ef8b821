//! A hot end and a bed to heat, and the board's heat module on them, on a virtual clock.
//!
//! Each heater is two masses, cartridge or mat and what it is in, with losses to the air, and a sensor
//! that lags behind. In: duties of the board, flow, fan, what is broken. Out: conversions of the sensors
//! with noise. The hot end's constants are those that Marlin gives for an E3D V6 with 40 W (Configuration.h:
//! 16.7 J/K, 0.068 W/K, 0.097 W/K with fan, sensor 0.22 1/s, PLA 5.6 mJ/K a mm), its heat split between
//! block (aluminium, 13.7 J/K) and cartridge (6 x 20 mm of steel and magnesia, 3 J/K). The bed is 300 x 300 x
//! 4 mm of aluminium (0.97 kg, 0.90 J/(g K)) with a silicone mat (0.1 kg, 1.3 J/(g K)) and 10 W/(m² K) on
//! both sides. Left out: the heat break, radiation, one heater warming the other.

pub mod campaign;
mod faults;

pub use faults::Injected;

use headway_firmware::configuration::heat::{HEATERS_MAX, HeatConfiguration, PERIOD_S, Plant};
use headway_firmware::configuration::sensor::{Sensor, SensorCurve};
use headway_firmware::heat::pwm::{HEATER_TICKS, SoftPwm};
use headway_firmware::heat::{Heat, Orders, Outputs};
use rand::RngExt;
use rand_pcg::Pcg64;

/// Air, °C.
pub const AIR_C: f64 = 22.0;
/// Slices of a control period.
const SLICES: usize = 10;
/// Conversions of a control period.
const CONVERSIONS: usize = 32;
/// Noise of a conversion, counts: what the STM32F4's data sheet has as total unadjusted error, as if
/// all of it were noise.
const NOISE_COUNTS: f64 = 2.0;

/// What a heater is in.
#[derive(Clone, Copy, Debug)]
pub struct Body {
    /// Power at full supply, W.
    pub power_w: f64,
    /// Cartridge or mat, J/K.
    pub heater_j_k: f64,
    /// Block or plate, J/K.
    pub block_j_k: f64,
    /// Between them, W/K.
    pub contact_w_k: f64,
    /// To the air, W/K.
    pub loss_w_k: f64,
    /// More with the part fan, W/K.
    pub fan_w_k: f64,
    /// Into the melt, J/(mm³ K).
    pub melt_j_mm3_k: f64,
    /// Lag of the sensor, s.
    pub lag_s: f64,
}

impl Body {
    /// A 40 W hot end.
    pub const HOT_END: Self = Self {
        power_w: 40.0,
        heater_j_k: 3.0,
        block_j_k: 13.7,
        contact_w_k: 1.5,
        loss_w_k: 0.068,
        fan_w_k: 0.029,
        melt_j_mm3_k: 0.00233,
        lag_s: 4.5,
    };
    /// A 300 W bed.
    pub const BED: Self = Self {
        power_w: 300.0,
        heater_j_k: 130.0,
        block_j_k: 875.0,
        contact_w_k: 20.0,
        loss_w_k: 1.8,
        fan_w_k: 0.0,
        melt_j_mm3_k: 0.0,
        lag_s: 6.0,
    };

    /// What a measurement of it would give the board.
    pub fn plant(&self) -> Plant {
        Plant {
            power_w: self.power_w as f32,
            loss_w_k: self.loss_w_k as f32,
            fan_loss_w_k: self.fan_w_k as f32,
            melt_j_mm3_k: self.melt_j_mm3_k as f32,
            measured: true,
        }
    }
}

/// Temperatures of a body, °C.
#[derive(Clone, Copy, Debug)]
pub struct Temperatures {
    pub heater_c: f64,
    pub block_c: f64,
    pub sensor_c: f64,
}

impl Temperatures {
    fn step(&mut self, body: &Body, power_w: f64, fan: f64, flow_mm3_s: f64, seconds: f64) {
        let across_w = body.contact_w_k * (self.heater_c - self.block_c);
        let loss_w_k = body.loss_w_k + body.fan_w_k * fan + body.melt_j_mm3_k * flow_mm3_s;
        let loss_w = loss_w_k * (self.block_c - AIR_C);
        self.heater_c += (power_w - across_w) / body.heater_j_k * seconds;
        self.block_c += (across_w - loss_w) / body.block_j_k * seconds;
    }

    fn step_sensor(&mut self, around_c: f64, lag_s: f64, seconds: f64) {
        self.sensor_c += (around_c - self.sensor_c) / lag_s * seconds;
    }
}

/// Board, heaters and what is broken of them.
pub struct World {
    pub heat: Heat,
    pwm: SoftPwm,
    pub orders: Orders,
    pub outputs: Outputs,
    pub bodies: [Body; 2],
    pub temperatures: [Temperatures; 2],
    configuration: HeatConfiguration,
    sensors: [Sensor; 2],
    broken: Option<Injected>,
    /// Mean electrical power of the last period, W.
    pub power_w: [f64; 2],
    supply_cut: bool,
    levels: u8,
    frozen: Option<u16>,
    random: Pcg64,
    pub now_s: f64,
}

impl World {
    /// Cold and off; the board knows the bodies as `known` has measured them.
    pub fn new(bodies: [Body; 2], known: [Plant; 2], random: Pcg64) -> Self {
        let mut configuration = HeatConfiguration::standard();
        configuration.fan_tells_turns = true;
        for (heater, plant) in configuration.heaters.iter_mut().zip(known) {
            heater.plant = plant;
        }
        let sensors = [0, 1].map(|heater| configuration.heaters[heater].sensor);
        let cold = Temperatures {
            heater_c: AIR_C,
            block_c: AIR_C,
            sensor_c: AIR_C,
        };
        Self {
            heat: Heat::new(&configuration),
            pwm: SoftPwm::default(),
            orders: Orders {
                host_heard: true,
                ..Orders::default()
            },
            outputs: Outputs::default(),
            bodies,
            temperatures: [cold; 2],
            configuration,
            sensors,
            broken: None,
            power_w: [0.0; 2],
            supply_cut: false,
            levels: 0,
            frozen: None,
            random,
            now_s: 0.0,
        }
    }

    /// Starts with a temperature everywhere in a body.
    pub fn warm(&mut self, heater: usize, celsius: f64) {
        self.temperatures[heater] = Temperatures {
            heater_c: celsius,
            block_c: celsius,
            sensor_c: celsius,
        };
    }

    /// Breaks something.
    pub fn inject(&mut self, fault: Injected) {
        self.broken = Some(fault);
        if fault == Injected::Reset {
            // What a watchdog, a brown-out or a panic leave: pins off, memory gone.
            self.heat = Heat::new(&self.configuration);
            self.pwm.cut();
            self.orders.targets_c = [0.0; HEATERS_MAX];
        }
    }

    /// One control period: heaters, conversions, then the board.
    pub fn tick(&mut self) {
        self.play();
        self.now_s += f64::from(PERIOD_S);
        if self.broken == Some(Injected::MainLoopHangs) {
            return;
        }
        for heater in 0..2 {
            self.convert(heater);
        }
        self.orders.host_heard = self.broken != Some(Injected::HostGone);
        let turns = self.outputs.fans.hot_end > 0.0 && self.broken != Some(Injected::FanStuck);
        self.orders.fan_turns = if turns { 5 } else { 0 };
        self.outputs = self.heat.tick(&self.orders);
        self.supply_cut |= self.outputs.cut_supply;
        if self.heat.fault().is_some() {
            self.pwm.cut();
            // As the machine does with every fault.
            self.orders.targets_c = [0.0; HEATERS_MAX];
        }
        self.pwm.load(&self.outputs.schedule());
    }

    /// Heats for a period by what the PWM plays.
    fn play(&mut self) {
        let ticks = HEATER_TICKS / SLICES as u16;
        let mut energy = [0.0; 2];
        let seconds = f64::from(PERIOD_S) / SLICES as f64;
        let mut levels = self.levels;
        for _ in 0..SLICES {
            let mut on = [0u16; 2];
            for _ in 0..ticks {
                levels = self.pwm.tick().unwrap_or(levels);
                on[0] += u16::from(levels & 1);
                on[1] += u16::from(levels >> 1 & 1);
            }
            for heater in 0..2 {
                let body = self.bodies[heater];
                let share = f64::from(on[heater]) / f64::from(ticks);
                let power_w = body.power_w * self.supplied(heater, share);
                energy[heater] += power_w * seconds;
                let is_hot_end = heater == 0;
                let fan = if is_hot_end {
                    f64::from(self.orders.part_fan)
                } else {
                    0.0
                };
                let flow = if is_hot_end {
                    f64::from(self.orders.flow_mm3_s)
                } else {
                    0.0
                };
                self.temperatures[heater].step(&body, power_w, fan, flow, seconds);
                self.move_sensor(heater, seconds);
            }
        }
        self.levels = levels;
        self.power_w = energy.map(|joule| joule / f64::from(PERIOD_S));
    }

    /// Share of its power that a heater gets, of what the PWM gives.
    fn supplied(&self, heater: usize, share: f64) -> f64 {
        let share = match self.broken {
            _ if self.supply_cut => 0.0,
            Some(Injected::HeaterStuck(stuck)) if stuck == heater => 1.0,
            Some(Injected::HeaterBroken(broken)) if broken == heater => 0.0,
            _ => share,
        };
        // Half the voltage, a quarter of the power.
        if self.broken == Some(Injected::SupplySags) {
            share / 4.0
        } else {
            share
        }
    }

    /// A sensor that has fallen out goes to the air's temperature, over 20 s.
    fn move_sensor(&mut self, heater: usize, seconds: f64) {
        let place = &mut self.temperatures[heater];
        if self.broken == Some(Injected::FallenOut(heater)) {
            place.step_sensor(AIR_C, 20.0, seconds);
        } else {
            place.step_sensor(place.block_c, self.bodies[heater].lag_s, seconds);
        }
    }

    /// A period's conversions of a sensor.
    fn convert(&mut self, heater: usize) {
        let share = divider_share(&self.sensors[heater], self.temperatures[heater].sensor_c);
        for _ in 0..CONVERSIONS {
            // Four uniform numbers: normal enough, variance 1/3.
            let normal: f64 = (0..4)
                .map(|_| self.random.random::<f64>() - 0.5)
                .sum::<f64>()
                * 3f64.sqrt();
            let counts = (share * 4095.0 + NOISE_COUNTS * normal).round();
            let mut raw = counts.clamp(0.0, 4095.0) as u16;
            match self.broken {
                Some(Injected::SensorOpen(broken)) if broken == heater => raw = 4095,
                Some(Injected::SensorShorted(broken)) if broken == heater => raw = 0,
                Some(Injected::ConverterSilent) => continue,
                Some(Injected::ConverterFrozen) if heater == 0 => {
                    raw = *self.frozen.get_or_insert(raw);
                }
                _ => {}
            }
            self.heat.sample(heater, raw);
        }
    }
}

/// Share of the reference that a sensor's divider gives, from the curve itself.
fn divider_share(sensor: &Sensor, celsius: f64) -> f64 {
    let SensorCurve::SteinhartHart(coefficients) = sensor.curve else {
        return 0.5;
    };
    let [a, b, c] = coefficients.map(f64::from);
    let inverse = 1.0 / (celsius + 273.15);
    let mut ln = 8.0;
    // Newton: the curve is smooth and rising.
    for _ in 0..8 {
        ln -= (a + ln * (b + c * ln * ln) - inverse) / (b + 3.0 * c * ln * ln);
    }
    let ohm = f64::exp(ln);
    ohm / (ohm + f64::from(sensor.pull_up_ohm))
}
