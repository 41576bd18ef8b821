//! A board as one table: what is at which pin, checked when it is compiled.
//!
//! In: pins by the names that data sheets print, at most eight drivers, three heaters, three fans. Out: what the
//! code of the chip's family (`bin/shared/stm32f4.rs`) is compiled for; [`BoardTable::check`] refuses, in a
//! constant, a pin that is used twice, a thermistor where the converter has no channel, and what is too much.
//! Not covered: boards with other chips than an STM32F405 to F446, which need such code of their own.

use crate::board::sector_flash::Sector;
use crate::configuration::MOTORS_MAX;
use crate::configuration::board_name::BoardName;
use crate::configuration::heat::{HEATERS_MAX, HeatConfiguration};
use crate::configuration::wiring::{BoardInputs, INPUTS_MAX};
use crate::heat::pwm::CHANNELS;
use crate::steps::output::{PORTS, Pin};

/// Fans at most: those of part, hot end and controller.
const FANS_MAX: usize = CHANNELS - HEATERS_MAX;
/// Pins of a port.
const PORT_PINS: u32 = 16;
/// Where a table may have nothing, by the name `""`.
pub const NO_PIN: Pin = (PORTS, 0);
/// Columns of [`BoardTable::drivers`].
pub const STEP: usize = 0;
/// As above.
pub const DIRECTION: usize = 1;
const ENABLE: usize = 2;
const WIRE: usize = 3;

/// A pin by its name, `"PA0"` to `"PH15"`; for constants, where another name is an error of the compiler's.
pub const fn pin(name: &str) -> Pin {
    let bytes = name.as_bytes();
    if bytes.is_empty() {
        return NO_PIN;
    }
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
    let mut found = [NO_PIN; N];
    let mut place = 0;
    while place < N {
        found[place] = pin(names[place]);
        place += 1;
    }
    found
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
    /// By motors: step, direction (high towards larger positions), enable (low = on; several may share it), and the
    /// one-wire UART of a TMC2209, which is also the chip select of a driver with SPI, or [`NO_PIN`].
    pub drivers: &'static [[Pin; 4]],
    /// SCK, MOSI and MISO for drivers with SPI; used only if settings have one.
    pub bus: Option<[Pin; 3]>,
    /// Switches and probes by their number, pulled up: normally closed to ground, pressed = high.
    pub inputs: &'static [Pin],
    /// Which of them is the emergency input, unless settings name another one.
    pub emergency: u8,
    /// Output (high = heats) and thermistor (4.7 kOhm to 3.3 V) of hot end, bed and second hot end.
    pub heaters: &'static [[Pin; 2]],
    /// Of part, hot end and controller.
    pub fans: &'static [Pin],
    /// Which converter has all thermistors: 1 or 3.
    pub converter: u8,
    /// Other outputs that heat or turn, and are never used.
    pub held_low: &'static [Pin],
    /// High = the supply of heaters and motors is on.
    pub supply: Option<Pin>,
    /// Servo pulses of a probe: the pin, the timer among its functions, which timer (2 to 5), and its channel (1 to 4).
    pub servo: Option<(Pin, u32, u8, u8)>,
    /// USART to the host, beside USB: 1 to 3.
    pub usart: u8,
    /// Its TX and RX.
    pub serial: [Pin; 2],
    /// Outputs that are something else on a similar board: inputs until settings name this one.
    pub differs: &'static [Pin],
}

impl BoardTable {
    /// A column of the drivers' pins. Motors without a driver have the last one's, and are never stepped.
    pub const fn column(&self, column: usize) -> [Pin; MOTORS_MAX] {
        let mut found = [NO_PIN; MOTORS_MAX];
        let last = self.drivers.len() - 1;
        let mut motor = 0;
        while motor < MOTORS_MAX {
            found[motor] = self.drivers[if motor < last { motor } else { last }][column];
            motor += 1;
        }
        found
    }

    /// The enable pins.
    pub fn enables(&self) -> impl Iterator<Item = Pin> + use<> {
        self.drivers.iter().map(|driver| driver[ENABLE])
    }

    /// The wire of a motor's driver, if there is one.
    pub fn wire(&self, motor: usize) -> Option<Pin> {
        let wire = self.drivers.get(motor)?[WIRE];
        (wire != NO_PIN).then_some(wire)
    }

    /// Bits of the motors whose drivers each motor's enable pin switches.
    pub const fn enabled_together(&self) -> [u8; MOTORS_MAX] {
        let mut masks = [0; MOTORS_MAX];
        let mut pair = 0;
        while pair < self.drivers.len() * self.drivers.len() {
            let (motor, other) = (pair / self.drivers.len(), pair % self.drivers.len());
            if same(self.drivers[motor][ENABLE], self.drivers[other][ENABLE]) {
                masks[motor] |= 1 << other;
            }
            pair += 1;
        }
        masks
    }

    /// Inputs by number; any may be the emergency input.
    pub const fn board_inputs(&self) -> BoardInputs {
        BoardInputs {
            count: self.inputs.len() as u8,
            emergency: self.emergency,
            emergency_mask: ((1u32 << self.inputs.len()) - 1) as u16,
        }
    }

    /// Channels of the PWM: three heaters, then the fans.
    pub const fn channels(&self) -> [Option<Pin>; CHANNELS] {
        let mut found = [None; CHANNELS];
        let mut place = 0;
        while place < CHANNELS {
            if place < self.heaters.len() {
                found[place] = Some(self.heaters[place][0]);
            } else if place >= HEATERS_MAX && place - HEATERS_MAX < self.fans.len() {
                found[place] = Some(self.fans[place - HEATERS_MAX]);
            }
            place += 1;
        }
        found
    }

    /// All heaters and fans: off until they are requested.
    pub fn off(&self) -> impl Iterator<Item = Pin> + use<> {
        let heaters = self.heaters.iter().map(|[output, _]| *output);
        heaters.chain(self.fans.iter().chain(self.held_low).copied())
    }

    /// The thermistors' channels of the converter.
    pub const fn sensor_channels(&self) -> [u32; HEATERS_MAX] {
        let mut channels = [0; HEATERS_MAX];
        let mut heater = 0;
        while heater < self.heaters.len() {
            channels[heater] = match channel(self.converter, self.heaters[heater][1]) {
                Some(channel) => channel,
                None => panic!("the converter has no channel at this thermistor's pin"),
            };
            heater += 1;
        }
        channels
    }

    /// Settings of the heaters: a hot end and a bed with the usual thermistors, if there are none.
    pub fn heat(&self, settings: Option<HeatConfiguration>) -> HeatConfiguration {
        if self.heaters.is_empty() {
            return HeatConfiguration::none();
        }
        settings.unwrap_or_else(HeatConfiguration::standard)
    }

    /// Clocks of the ports that it uses.
    pub const fn ports_mask(&self) -> u32 {
        let used = self.used();
        let mut mask = 0;
        let mut port = 0;
        while port < PORTS {
            if used.0[port] != 0 {
                mask |= 1 << port;
            }
            port += 1;
        }
        mask
    }

    /// Its pins, each used once. USB's are those of every board.
    const fn used(&self) -> Used {
        let mut used = Used([0; PORTS]).and(&pins(["PA11", "PA12"]));
        let together = self.enabled_together();
        let mut motor = 0;
        while motor < self.drivers.len() {
            let [step, direction, enable, wire] = self.drivers[motor];
            // Enables may be shared.
            let is_first = together[motor].trailing_zeros() == motor as u32;
            let enable = if is_first { enable } else { NO_PIN };
            used = used.and(&[step, direction, enable, wire]);
            motor += 1;
        }
        let mut heater = 0;
        while heater < self.heaters.len() {
            used = used.and(&self.heaters[heater]);
            heater += 1;
        }
        used = used.and(self.inputs).and(self.fans).and(self.held_low);
        if let Some(bus) = self.bus {
            used = used.and(&bus);
        }
        if let Some((servo, ..)) = self.servo {
            used = used.and(&[servo]);
        }
        if let Some(supply) = self.supply {
            used = used.and(&[supply]);
        }
        used.and(&self.serial)
    }

    /// Refuses a table that cannot be, when it is compiled: `const _: () = BOARD.check();`.
    pub const fn check(&self) {
        let (drivers, inputs) = (self.drivers.len(), self.inputs.len());
        assert!(drivers >= 1 && drivers <= MOTORS_MAX, "one driver to eight");
        let emergency = self.emergency as usize;
        assert!(
            emergency < inputs && inputs <= INPUTS_MAX as usize,
            "16 inputs at most, one of them the emergency input"
        );
        let (heaters, fans) = (self.heaters.len(), self.fans.len());
        assert!(
            heaters <= HEATERS_MAX && fans <= FANS_MAX && self.usart >= 1 && self.usart <= 3,
            "three heaters, three fans, and USART 1 to 3 at most"
        );
        self.sensor_channels();
        if let Some((_, _, timer, channel)) = self.servo {
            assert!(
                timer >= 2 && timer <= 5 && channel >= 1 && channel <= 4,
                "servo pulses come from timer 2 to 5, channel 1 to 4"
            );
        }
        let used = self.used();
        let mut differs = 0;
        while differs < self.differs.len() {
            let (port, number) = self.differs[differs];
            let has_use = used.0[port] >> number & 1 == 1;
            assert!(has_use, "a pin that differs has no use");
            differs += 1;
        }
    }
}

/// Pins in use, a bit each by ports.
struct Used([u16; PORTS]);

impl Used {
    const fn and(mut self, pins: &[Pin]) -> Self {
        let mut place = 0;
        while place < pins.len() {
            let (port, number) = pins[place];
            if port < PORTS {
                assert!(self.0[port] >> number & 1 == 0, "a pin is used twice");
                self.0[port] |= 1 << number;
            }
            place += 1;
        }
        self
    }
}

const fn same(a: Pin, b: Pin) -> bool {
    a.0 == b.0 && a.1 == b.1
}

/// Channel of a pin at converter 1 or 3 (data sheets of the STM32F405 and F446, alternate functions of the pins).
const fn channel(converter: u8, (port, number): Pin) -> Option<u32> {
    match (converter, port, number) {
        (1 | 3, 0, 0..=3) | (1, 0, 4..=7) => Some(number),
        (1, 1, 0 | 1) => Some(8 + number),
        (1 | 3, 2, 0..=3) | (1, 2, 4 | 5) | (3, 5, 4 | 5) => Some(10 + number),
        (3, 5, 3) => Some(9),
        (3, 5, 6..=10) => Some(number - 2),
        _ => None,
    }
}

#[cfg(test)]
#[path = "table_tests.rs"]
mod tests;
