//! Registers of the ports of the BTT Octopus v1.1, except for steps. The pin assignment is in
//! `headway_firmware::board::octopus`.

use crate::ports::{PORT_BYTES, SET_RESET};
use crate::stm32f4::rcc::{Bus, clock_on};
use crate::stm32f4::{CoreDelay, start};
use embedded_hal::delay::DelayNs;
use headway_firmware::board::input_map::InputMap;
use headway_firmware::board::octopus::{
    DIFFERS, DIRECTION, ENABLE, HEAT, OFF, PROBE, SENSORS, SERIAL, STEP, SUPPLY, SWITCHES,
};
use headway_firmware::board::{BoardPins, INPUTS_SETTLE_MS};
use headway_firmware::configuration::board_name::Known;
use headway_firmware::motion::inputs::Inputs;
use headway_firmware::steps::output::Pin;

const MODE: usize = 0x00;
const PULL: usize = 0x0c;
const INPUT: usize = 0x10;
const ALTERNATE: usize = 0x20;
/// USART 2 among the functions of its pins.
const SERIAL_FUNCTION: u32 = 7;

/// Mode of a pin that a converter reads.
const ANALOG: u32 = 3;
/// Ports A, B, D and E, which switch heaters and fans.
const HEAT_PORTS_CLOCK_MASK: u32 = 0b1_1011;

/// Port A; the others follow.
pub const PORTS: usize = 0x4002_0000;

fn register(port: usize, offset: usize) -> *mut u32 {
    (PORTS + port * PORT_BYTES + offset) as *mut u32
}

/// Changes `width` bits of a port's register.
fn modify(port: usize, offset: usize, shift: u32, width: u32, value: u32) {
    let register = register(port, offset);
    let mask = ((1 << width) - 1) << shift;
    // SAFETY: a register of a port of this chip; used before interrupts are on, and after it for the
    // drivers' wires from the main loop alone, where no interrupt changes modes.
    unsafe {
        let old = register.read_volatile();
        register.write_volatile(old & !mask | value << shift);
    }
}

/// Sets (low half) and resets (high half) pins of a port at once.
#[inline(always)]
fn write(port: usize, word: u32) {
    // SAFETY: the register acts on the named pins alone, whatever context writes it.
    unsafe { register(port, SET_RESET).write_volatile(word) }
}

pub fn is_high((port, number): Pin) -> bool {
    // SAFETY: reading an input has no effect.
    let levels = unsafe { register(port, INPUT).read_volatile() };
    levels >> number & 1 == 1
}

/// The level of an output.
#[inline(always)]
fn put((port, number): Pin, high: bool) {
    write(port, 1 << if high { number } else { number + 16 });
}

pub fn output((port, number): Pin, high: bool) {
    put((port, number), high);
    modify(port, MODE, 2 * number, 2, 1);
}

pub fn input((port, number): Pin) {
    modify(port, PULL, 2 * number, 2, 1);
    modify(port, MODE, 2 * number, 2, 0);
}

/// Puts a pin to its alternate function.
pub fn alternate((port, number): Pin, function: u32) {
    let offset = ALTERNATE + if number >= 8 { 4 } else { 0 };
    modify(port, offset, 4 * (number % 8), 4, function);
    modify(port, MODE, 2 * number, 2, 2);
}

/// Switches, emergency input and enables, by ports.
pub struct OctopusPins {
    motors: usize,
    map: InputMap,
}

impl BoardPins for OctopusPins {
    #[inline(always)]
    fn inputs(&mut self) -> Inputs {
        self.map.inputs(levels())
    }

    #[inline(always)]
    fn hold(&mut self, motors: u8) {
        enable(self.motors, motors);
    }

    #[inline(always)]
    fn put_heat(&mut self, levels: u8) {
        for (channel, pin) in HEAT.into_iter().enumerate() {
            put(pin, levels >> channel & 1 == 1);
        }
    }
}

/// Heaters and fans off: outputs go low. Pins that are not yet outputs stay inputs, as the board may be another
/// one.
pub fn heaters_off() {
    clock_on(Bus::Ahb1, HEAT_PORTS_CLOCK_MASK);
    for pin in OFF {
        put(pin, false);
    }
}

/// The supply of heaters and motors, by PS-ON.
pub fn supply(on: bool) {
    put(SUPPLY, on);
}

/// Sets every pin up, before any interrupt is on: all off, and no output where the board may be one that has
/// something else there. Port clocks must run, and nothing may reset a port afterwards.
pub fn set_up(motors: usize, map: InputMap, known: Known) -> OctopusPins {
    let low = OFF.into_iter();
    // A driver that is not used leaves its pins as they are: PA14 to the debugger.
    let low = low.chain(STEP.into_iter().take(motors));
    let low = low.chain(DIRECTION.into_iter().take(motors));
    let supply = [(SUPPLY, !start::kept_fault().cuts_supply())];
    let high = ENABLE.map(|pin| (pin, true)).into_iter().chain(supply);
    for (pin, level) in low.map(|pin| (pin, false)).chain(high) {
        let is_ours = match known {
            Known::Foreign => false,
            Known::Unnamed => !DIFFERS.contains(&pin),
            Known::Named => true,
        };
        if is_ours {
            output(pin, level);
        }
    }
    for (pin, _) in SENSORS {
        modify(pin.0, MODE, 2 * pin.1, 2, ANALOG);
    }
    SWITCHES.into_iter().for_each(input);
    input(PROBE);
    for pin in SERIAL {
        // An input that floats hears noise.
        modify(pin.0, PULL, 2 * pin.1, 2, 1);
        alternate(pin, SERIAL_FUNCTION);
    }
    CoreDelay.delay_ms(INPUTS_SETTLE_MS);
    OctopusPins { motors, map }
}

/// Levels of the inputs, by number.
#[inline(always)]
fn levels() -> u16 {
    let mut high = 0;
    for (number, pin) in SWITCHES.into_iter().chain([PROBE]).enumerate() {
        high |= u16::from(is_high(pin)) << number;
    }
    high
}

/// Lets the drivers of the first `motors` motors hold where their bit says so, and all others go.
fn enable(motors: usize, held: u8) {
    for (motor, (port, number)) in ENABLE.into_iter().enumerate() {
        let low = held >> motor & 1 == 1 && motor < motors;
        write(port, 1 << if low { number + 16 } else { number });
    }
}
