//! Registers of the ports of an STM32F4, except for steps. The pin assignment is the board's table.

use super::rcc::{Bus, clock_on};
use super::step_ports::{PORT_BYTES, SET_RESET};
use super::{CoreDelay, start};
use crate::BOARD;
use embedded_hal::delay::DelayNs;
use headway_firmware::board::input_map::InputMap;
use headway_firmware::board::{BoardPins, INPUTS_SETTLE_MS};
use headway_firmware::configuration::MOTORS_MAX;
use headway_firmware::configuration::board_name::Known;
use headway_firmware::motion::inputs::Inputs;
use headway_firmware::steps::output::Pin;

const MODE: usize = 0x00;
const PULL: usize = 0x0c;
const INPUT: usize = 0x10;
const ALTERNATE: usize = 0x20;
/// USART 1 to 3 among the functions of their pins.
const SERIAL_FUNCTION: u32 = 7;

/// Mode of a pin that a converter reads.
const ANALOG: u32 = 3;
/// Motors with the same enable pin as this one.
const ENABLED_TOGETHER: [u8; MOTORS_MAX] = BOARD.enabled_together();

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
pub fn put((port, number): Pin, high: bool) {
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
pub struct Pins {
    /// Bits of the machine's motors.
    motors: u8,
    map: InputMap,
}

impl BoardPins for Pins {
    #[inline(always)]
    fn inputs(&mut self) -> Inputs {
        self.map.inputs(levels())
    }

    #[inline(always)]
    fn hold(&mut self, motors: u8) {
        enable(self.motors & motors);
    }

    #[inline(always)]
    fn put_heat(&mut self, levels: u8) {
        for (channel, pin) in const { BOARD.channels() }.into_iter().enumerate() {
            if let Some(pin) = pin {
                put(pin, levels >> channel & 1 == 1);
            }
        }
    }
}

/// Heaters and fans off: outputs go low. Pins that are not yet outputs stay inputs, as the board may be another
/// one.
pub fn heaters_off() {
    clock_on(Bus::Ahb1, const { BOARD.ports_mask() });
    BOARD.off().for_each(|pin| put(pin, false));
}

/// The supply of heaters and motors, where the board can switch it.
pub fn supply(on: bool) {
    if let Some(pin) = BOARD.supply {
        put(pin, on);
    }
}

/// Sets every pin up, before any interrupt is on: all off, and no output where the board may be one that has
/// something else there. Port clocks must run, and nothing may reset a port afterwards.
pub fn set_up(motors: usize, map: InputMap, known: Known) -> Pins {
    // A driver that is not used leaves its pins as they are: they may be the debugger's.
    let used = BOARD.drivers.iter().take(motors);
    let steps = used.flat_map(|[step, direction, ..]| [*step, *direction]);
    let low = BOARD.off().chain(steps).map(|pin| (pin, false));
    let supplied = !start::kept_fault().cuts_supply();
    let supply = BOARD.supply.map(|pin| (pin, supplied));
    let high = BOARD.enables().map(|pin| (pin, true));
    for (pin, level) in low.chain(high).chain(supply) {
        let is_ours = match known {
            Known::Foreign => false,
            Known::Unnamed => !BOARD.differs.contains(&pin),
            Known::Named => true,
        };
        if is_ours {
            output(pin, level);
        }
    }
    for [_, (port, number)] in BOARD.heaters.iter().copied() {
        modify(port, MODE, 2 * number, 2, ANALOG);
    }
    BOARD.inputs.iter().copied().for_each(input);
    for pin in BOARD.serial {
        // An input that floats hears noise.
        modify(pin.0, PULL, 2 * pin.1, 2, 1);
        alternate(pin, SERIAL_FUNCTION);
    }
    CoreDelay.delay_ms(INPUTS_SETTLE_MS);
    Pins {
        motors: ((1u32 << motors.min(MOTORS_MAX)) - 1) as u8,
        map,
    }
}

/// Levels of the inputs, by number.
#[inline(always)]
fn levels() -> u16 {
    let mut high = 0;
    for (number, pin) in BOARD.inputs.iter().enumerate() {
        high |= u16::from(is_high(*pin)) << number;
    }
    high
}

/// Lets the drivers of these motors hold, and all others go.
fn enable(held: u8) {
    for ((port, number), together) in BOARD.enables().zip(ENABLED_TOGETHER) {
        let low = held & together != 0;
        write(port, 1 << if low { number + 16 } else { number });
    }
}
