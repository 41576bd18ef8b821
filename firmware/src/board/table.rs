//! A board as one table: what is at which pin, checked when it is compiled.
//!
//! In: pins by the names that data sheets print, at most eight drivers, three heaters, three fans. Out: what the
//! code of the chip's family (`bin/shared/stm32f4.rs`) is compiled for; [`BoardTable::check`] refuses, in a
//! constant, a pin that is used twice, a thermistor where the converter has no channel, and what is too much.
//! Not covered: boards with other chips than an STM32F405 to F446, which need such code of their own.

use crate::board::sector_flash::Sector;
use crate::configuration::MOTORS_MAX;
use crate::configuration::board_name::BoardName;
use crate::configuration::heat::HEATERS_MAX;
use crate::configuration::wiring::{BoardInputs, INPUTS_MAX};
use crate::heat::pwm::CHANNELS;
use crate::steps::output::{PORTS, Pin};

/// Fans at most: those of part, hot end and controller.
const FANS_MAX: usize = CHANNELS - HEATERS_MAX;
/// Pins of a port.
const PORT_PINS: u32 = 16;
/// Room for all pins of a table.
const PINS_MAX: usize = PORTS * PORT_PINS as usize;

/// A pin by its name, `"PA0"` to `"PH15"`; for constants, where another name is an error of the compiler's.
pub const fn pin(name: &str) -> Pin {
    let bytes = name.as_bytes();
    assert!(
        bytes.len() >= 3 && bytes.len() <= 4 && bytes[0] == b'P',
        "a pin is P, its port's letter and its number"
    );
    let mut number = 0;
    let mut place = 2;
    while place < bytes.len() {
        assert!(bytes[place].is_ascii_digit(), "a pin's number has digits");
        number = 10 * number + (bytes[place] - b'0') as u32;
        place += 1;
    }
    let port = bytes[1].wrapping_sub(b'A') as usize;
    assert!(
        port < PORTS && number < PORT_PINS,
        "a port is A to H, a pin 0 to 15"
    );
    (port, number)
}

/// Pins by their names.
pub const fn pins<const N: usize>(names: [&str; N]) -> [Pin; N] {
    let mut found = [(0, 0); N];
    let mut place = 0;
    while place < N {
        found[place] = pin(names[place]);
        place += 1;
    }
    found
}

/// A motor's driver.
#[derive(Clone, Copy, Debug)]
pub struct DriverPins {
    /// A pulse is a step.
    pub step: Pin,
    /// High: towards larger positions.
    pub direction: Pin,
    /// Low = on. Several drivers may share it.
    pub enable: Pin,
    /// One-wire UART of a TMC2209, which is also the chip select of a driver with SPI.
    pub wire: Option<Pin>,
}

impl DriverPins {
    /// By their names; without a wire, `""`.
    pub const fn new(step: &str, direction: &str, enable: &str, wire: &str) -> Self {
        Self {
            step: pin(step),
            direction: pin(direction),
            enable: pin(enable),
            wire: if wire.is_empty() {
                None
            } else {
                Some(pin(wire))
            },
        }
    }
}

/// A heater with its thermistor, 4.7 kOhm to 3.3 V.
#[derive(Clone, Copy, Debug)]
pub struct HeaterPins {
    /// High = heats.
    pub output: Pin,
    /// The converter's.
    pub sensor: Pin,
}

impl HeaterPins {
    /// By their names.
    pub const fn new(output: &str, sensor: &str) -> Self {
        Self {
            output: pin(output),
            sensor: pin(sensor),
        }
    }
}

/// Servo pulses of a probe's pin: a channel of a timer of 16 bits or more on APB1.
#[derive(Clone, Copy, Debug)]
pub struct ServoPin {
    /// Where they come out.
    pub pin: Pin,
    /// The timer among the functions of the pin.
    pub function: u32,
    /// Timer, 2 to 5.
    pub timer: u8,
    /// Its channel, 1 to 4.
    pub channel: u8,
}

/// A serial port of the chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Usart {
    /// On APB2.
    One,
    /// On APB1.
    Two,
    /// On APB1.
    Three,
}

/// A serial line.
#[derive(Clone, Copy, Debug)]
pub struct SerialPins {
    /// Of the chip.
    pub usart: Usart,
    /// TX and RX.
    pub pins: [Pin; 2],
}

/// What a board has at its pins.
#[derive(Clone, Copy, Debug)]
pub struct BoardTable {
    /// What settings may call it. If there are several boards with this chip, they must: before, only what is not in
    /// `differs` is driven. A board without names need not be named.
    pub names: &'static [BoardName],
    /// DEV_ID of its chip.
    pub chip_id: u32,
    /// What is written on its crystal.
    pub crystal_hz: u32,
    /// Sectors of the settings, without code.
    pub settings_sectors: [Sector; 2],
    /// In the motors' order.
    pub drivers: &'static [DriverPins],
    /// Switches and probes by their number, pulled up: normally closed to ground, pressed = high.
    pub inputs: &'static [Pin],
    /// Which of them is the emergency input, unless settings name another one.
    pub emergency: u8,
    /// Hot end, bed, second hot end.
    pub heaters: &'static [HeaterPins],
    /// Of part, hot end and controller.
    pub fans: &'static [Pin],
    /// Which converter has all thermistors: 1 or 3.
    pub converter: u8,
    /// Other outputs that heat or turn, and are never used.
    pub held_low: &'static [Pin],
    /// High = the supply of heaters and motors is on.
    pub supply: Option<Pin>,
    /// Servo pulses of a probe.
    pub servo: Option<ServoPin>,
    /// Line to the host, beside USB.
    pub serial: SerialPins,
    /// Outputs that are something else on a similar board: inputs until settings name this one.
    pub differs: &'static [Pin],
}

impl BoardTable {
    /// Motors that it can drive.
    pub const fn motors(&self) -> usize {
        self.drivers.len()
    }

    /// Step pins. Motors without a driver have the last one's, and are never stepped.
    pub const fn step(&self) -> [Pin; MOTORS_MAX] {
        let mut found = [(0, 0); MOTORS_MAX];
        let mut motor = 0;
        while motor < MOTORS_MAX {
            found[motor] = self.driver(motor).step;
            motor += 1;
        }
        found
    }

    /// Direction pins, as the step pins.
    pub const fn direction(&self) -> [Pin; MOTORS_MAX] {
        let mut found = [(0, 0); MOTORS_MAX];
        let mut motor = 0;
        while motor < MOTORS_MAX {
            found[motor] = self.driver(motor).direction;
            motor += 1;
        }
        found
    }

    const fn driver(&self, motor: usize) -> DriverPins {
        let last = self.drivers.len() - 1;
        self.drivers[if motor < last { motor } else { last }]
    }

    /// A bit for each motor whose driver the enable pin of this one switches.
    pub const fn enabled_with(&self, motor: usize) -> u8 {
        let mut mask = 0;
        let mut other = 0;
        while other < self.drivers.len() {
            if same(self.drivers[other].enable, self.drivers[motor].enable) {
                mask |= 1 << other;
            }
            other += 1;
        }
        mask
    }

    /// Inputs by number; any may be the emergency input.
    pub const fn board_inputs(&self) -> BoardInputs {
        BoardInputs {
            count: self.inputs.len() as u8,
            emergency: self.emergency,
            emergency_mask: ((1u32 << self.inputs.len()) - 1) as u16,
        }
    }

    /// Pin of an input.
    pub fn input(&self, number: u8) -> Option<Pin> {
        self.inputs.get(usize::from(number)).copied()
    }

    /// Channels of the PWM: three heaters, then the fans.
    pub const fn channels(&self) -> [Option<Pin>; CHANNELS] {
        let mut found = [None; CHANNELS];
        let mut place = 0;
        while place < CHANNELS {
            if place < self.heaters.len() {
                found[place] = Some(self.heaters[place].output);
            } else if place >= HEATERS_MAX && place - HEATERS_MAX < self.fans.len() {
                found[place] = Some(self.fans[place - HEATERS_MAX]);
            }
            place += 1;
        }
        found
    }

    /// All heaters and fans: off until they are requested.
    pub fn off(&self) -> impl Iterator<Item = Pin> + use<> {
        let heaters = self.heaters.iter().map(|heater| heater.output);
        let others = self.fans.iter().chain(self.held_low).copied();
        heaters.chain(others)
    }

    /// Channel of a heater's thermistor.
    pub const fn sensor_channel(&self, heater: usize) -> u32 {
        match channel(self.converter, self.heaters[heater].sensor) {
            Some(channel) => channel,
            None => panic!("the converter has no channel at this thermistor's pin"),
        }
    }

    /// Clocks of the ports that it uses, and of port A, which has USB.
    pub const fn ports_mask(&self) -> u32 {
        let all = self.all();
        let mut mask = 1;
        let mut place = 0;
        while place < all.count {
            mask |= 1 << all.pins[place].0;
            place += 1;
        }
        mask
    }

    const fn all(&self) -> Found {
        let mut all = Found::NONE;
        let mut motor = 0;
        while motor < self.drivers.len() {
            let driver = self.drivers[motor];
            all.add(driver.step);
            all.add(driver.direction);
            // Enables may be shared.
            if self.enabled_with(motor).trailing_zeros() == motor as u32 {
                all.add(driver.enable);
            }
            all.add_some(driver.wire);
            motor += 1;
        }
        let mut heater = 0;
        while heater < self.heaters.len() {
            all.add(self.heaters[heater].output);
            all.add(self.heaters[heater].sensor);
            heater += 1;
        }
        all.add_all(self.inputs);
        all.add_all(self.fans);
        all.add_all(self.held_low);
        all.add_all(&self.serial.pins);
        all.add_some(self.supply);
        if let Some(servo) = self.servo {
            all.add(servo.pin);
        }
        all
    }

    /// Refuses a table that cannot be, when it is compiled: `const _: () = BOARD.check();`.
    pub const fn check(&self) {
        assert!(
            !self.drivers.is_empty() && self.drivers.len() <= MOTORS_MAX,
            "one driver to eight"
        );
        assert!(
            (self.emergency as usize) < self.inputs.len()
                && self.inputs.len() <= INPUTS_MAX as usize,
            "16 inputs at most, one of them the emergency input"
        );
        assert!(
            self.heaters.len() <= HEATERS_MAX && self.fans.len() <= FANS_MAX,
            "three heaters and three fans at most"
        );
        let mut heater = 0;
        while heater < self.heaters.len() {
            self.sensor_channel(heater);
            heater += 1;
        }
        if let Some(servo) = self.servo {
            assert!(
                servo.timer >= 2 && servo.timer <= 5 && servo.channel >= 1 && servo.channel <= 4,
                "servo pulses come from timer 2 to 5, channel 1 to 4"
            );
        }
        let all = self.all();
        let mut place = 0;
        while place < all.count {
            // USB's, on every board.
            assert!(
                !same(all.pins[place], pin("PA11")) && !same(all.pins[place], pin("PA12")),
                "PA11 and PA12 are those of USB"
            );
            let mut other = 0;
            while other < place {
                assert!(
                    !same(all.pins[place], all.pins[other]),
                    "a pin is used twice"
                );
                other += 1;
            }
            place += 1;
        }
        let mut differs = 0;
        while differs < self.differs.len() {
            assert!(
                all.has(self.differs[differs]),
                "a pin that differs has no use"
            );
            differs += 1;
        }
    }
}

/// Pins of a table, in constants.
struct Found {
    pins: [Pin; PINS_MAX],
    count: usize,
}

impl Found {
    const NONE: Self = Self {
        pins: [(0, 0); PINS_MAX],
        count: 0,
    };

    const fn add(&mut self, pin: Pin) {
        assert!(self.count < PINS_MAX, "more pins than there are");
        self.pins[self.count] = pin;
        self.count += 1;
    }

    const fn add_some(&mut self, pin: Option<Pin>) {
        if let Some(pin) = pin {
            self.add(pin);
        }
    }

    const fn add_all(&mut self, pins: &[Pin]) {
        let mut place = 0;
        while place < pins.len() {
            self.add(pins[place]);
            place += 1;
        }
    }

    const fn has(&self, pin: Pin) -> bool {
        let mut place = 0;
        while place < self.count {
            if same(self.pins[place], pin) {
                return true;
            }
            place += 1;
        }
        false
    }
}

const fn same(a: Pin, b: Pin) -> bool {
    a.0 == b.0 && a.1 == b.1
}

/// Channel of a pin at converter 1 or 3 (data sheets of the STM32F405 and F446, alternate functions of the pins).
const fn channel(converter: u8, (port, number): Pin) -> Option<u32> {
    match (converter, port, number) {
        (1 | 3, 0, 0..=3) => Some(number),
        (1, 0, 4..=7) => Some(number),
        (1, 1, 0 | 1) => Some(8 + number),
        (1 | 3, 2, 0..=3) => Some(10 + number),
        (1, 2, 4 | 5) => Some(10 + number),
        (3, 5, 3) => Some(9),
        (3, 5, 4 | 5) => Some(10 + number),
        (3, 5, 6..=10) => Some(number - 2),
        _ => None,
    }
}

#[cfg(test)]
#[path = "table_tests.rs"]
mod tests;
