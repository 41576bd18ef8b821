//! Pins of the BTT Octopus v1.1 (STM32F446ZE), after the board file that Klipper publishes
//! (`generic-bigtreetech-octopus-v1.1.cfg`). Registers are written directly: a step is due every
//! 5 us.

use headway_firmware::output::StepOutput;

/// A pin: port (0 = A) and number.
pub type Pin = (usize, u32);

const A: usize = 0;
const B: usize = 1;
const C: usize = 2;
const D: usize = 3;
const E: usize = 4;
const F: usize = 5;
const G: usize = 6;

/// Step, direction and enable (low = on) of drivers 0 to 7.
pub const DRIVERS: [[Pin; 3]; 8] = [
    [(F, 13), (F, 12), (F, 14)],
    [(G, 0), (G, 1), (F, 15)],
    [(F, 11), (G, 3), (G, 5)],
    [(G, 4), (C, 1), (A, 0)],
    [(F, 9), (F, 10), (G, 2)],
    [(C, 13), (F, 0), (F, 1)],
    [(E, 2), (E, 3), (D, 4)],
    // PA14 is also SWCLK: with eight motors there is no debugger.
    [(E, 6), (A, 14), (E, 0)],
];
/// Switch of joint 0 to 7, STOP_0 to STOP_7: normally closed to ground, pulled up, pressed = high.
pub const SWITCHES: [Pin; 8] = [
    (G, 6),
    (G, 9),
    (G, 10),
    (G, 11),
    (G, 12),
    (G, 13),
    (G, 14),
    (G, 15),
];
/// Emergency input, the signal pin of the probe port: normally closed to ground, pulled up.
pub const EMERGENCY: Pin = (B, 7);
/// Heaters and fans: this firmware does not drive them, they are kept off.
const OFF: [Pin; 11] = [
    (A, 1),
    (A, 2),
    (A, 3),
    (B, 10),
    (B, 11),
    (A, 8),
    (E, 5),
    (D, 12),
    (D, 13),
    (D, 14),
    (D, 15),
];
/// USART 2, the header for a single-board computer: TX, RX.
pub const SERIAL: [Pin; 2] = [(D, 5), (D, 6)];

const MODE: usize = 0x00;
const PULL: usize = 0x0c;
const INPUT: usize = 0x10;
const SET_RESET: usize = 0x18;
const ALTERNATE: usize = 0x20;

fn register(port: usize, offset: usize) -> *mut u32 {
    (0x4002_0000 + port * 0x400 + offset) as *mut u32
}

/// Changes `width` bits of a port's register.
fn modify(port: usize, offset: usize, shift: u32, width: u32, value: u32) {
    let register = register(port, offset);
    let mask = ((1 << width) - 1) << shift;
    // SAFETY: a register of a port of this chip; only used before interrupts are on.
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

fn is_high((port, number): Pin) -> bool {
    // SAFETY: reading an input has no effect.
    let levels = unsafe { register(port, INPUT).read_volatile() };
    levels >> number & 1 == 1
}

fn output((port, number): Pin, high: bool) {
    write(port, 1 << if high { number } else { number + 16 });
    modify(port, MODE, 2 * number, 2, 1);
}

fn input((port, number): Pin) {
    modify(port, PULL, 2 * number, 2, 1);
    modify(port, MODE, 2 * number, 2, 0);
}

/// Puts a pin to its alternate function.
pub fn alternate((port, number): Pin, function: u32) {
    let offset = ALTERNATE + if number >= 8 { 4 } else { 0 };
    modify(port, offset, 4 * (number % 8), 4, function);
    modify(port, MODE, 2 * number, 2, 2);
}

/// Sets every pin up, before any interrupt is on: all off. Port clocks must run.
pub fn set_up(motors: usize) {
    for pin in OFF {
        output(pin, false);
    }
    for (motor, [step, direction, enable]) in DRIVERS.into_iter().enumerate() {
        output(enable, true);
        // A driver that is not used leaves its pins as they are: PA14 to the debugger.
        if motor < motors {
            output(step, false);
            output(direction, false);
        }
    }
    SWITCHES.into_iter().for_each(input);
    input(EMERGENCY);
}

/// Switches pressed, bit 0 = joint 0.
pub fn switches() -> u8 {
    let mut pressed = 0;
    for (joint, pin) in SWITCHES.into_iter().enumerate() {
        pressed |= u8::from(is_high(pin)) << joint;
    }
    pressed
}

/// The emergency input is open.
pub fn emergency() -> bool {
    is_high(EMERGENCY)
}

/// Lets the drivers of the first `motors` motors hold, or all go.
pub fn enable(motors: usize, on: bool) {
    for (motor, [_, _, (port, number)]) in DRIVERS.into_iter().enumerate() {
        let low = on && motor < motors;
        write(port, 1 << if low { number + 16 } else { number });
    }
}

/// Step and direction pins. A pulse begins with its step tick and ends with the next one, or where
/// a direction changes; never below 100 ns, which TMC drivers take.
pub struct Pins {
    /// Motors that the machine has: the others' pins are left alone.
    motors: u8,
    /// Motors whose direction pin is low for larger positions.
    inverted: u8,
}

/// Bits of `motors` at the pins of one port: each motor's bit moves to its pin's place.
macro_rules! port_bits {
    ($motors:expr, $($motor:literal => $pin:literal),+) => {
        $((($motors >> $motor & 1) << $pin))|+
    };
}

impl Pins {
    /// `inverted`: a mask of motors, the extruder last.
    pub fn new(motors: usize, inverted: u8) -> Self {
        Self {
            motors: ((1u16 << motors) - 1) as u8,
            inverted,
        }
    }
}

/// Ends the pulses, at the start of a step tick and before a direction changes.
#[inline(always)]
pub fn lower() {
    write(F, (1 << 13 | 1 << 11 | 1 << 9) << 16);
    write(G, (1 << 4 | 1) << 16);
    write(C, 1 << 13 << 16);
    write(E, (1 << 2 | 1 << 6) << 16);
}

impl StepOutput for Pins {
    #[inline(always)]
    fn set_directions(&mut self, directions: u8) {
        lower();
        let up = u32::from((directions ^ self.inverted) & self.motors);
        let down = u32::from(!(directions ^ self.inverted) & self.motors);
        write(
            F,
            port_bits!(up, 0 => 12, 4 => 10, 5 => 0) | port_bits!(down, 0 => 28, 4 => 26, 5 => 16),
        );
        write(
            G,
            port_bits!(up, 1 => 1, 2 => 3) | port_bits!(down, 1 => 17, 2 => 19),
        );
        write(C, port_bits!(up, 3 => 1) | port_bits!(down, 3 => 17));
        write(E, port_bits!(up, 6 => 3) | port_bits!(down, 6 => 19));
        write(A, port_bits!(up, 7 => 14) | port_bits!(down, 7 => 30));
    }

    #[inline(always)]
    fn step(&mut self, _tick: u64, motors: u8) {
        let motors = u32::from(motors);
        write(F, port_bits!(motors, 0 => 13, 2 => 11, 4 => 9));
        write(G, port_bits!(motors, 1 => 0, 3 => 4));
        write(C, port_bits!(motors, 5 => 13));
        write(E, port_bits!(motors, 6 => 2, 7 => 6));
    }
}
