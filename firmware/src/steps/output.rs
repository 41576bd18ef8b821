//! The only traits between the library and the pins.
//!
//! The library calls them; a board, a recorder and a tracer implement them. Bit m of a mask is
//! motor m: the joints in order, then the extruder.

use crate::configuration::MOTORS_MAX;

/// Where steps go.
pub trait StepOutput {
    /// The start of a step tick: pulses of the one before end here.
    #[inline(always)]
    fn end_pulses(&mut self) {}
    /// Sets the direction pins: bit set = towards larger positions. Called after the steps of a
    /// tick, so at least one step tick before the first step that needs the new direction.
    fn set_directions(&mut self, directions: u8);
    /// One step of each motor in the mask (never 0) in step tick `tick`, counted from start-up.
    fn step(&mut self, tick: u64, motors: u8);
    /// The same with a word for each motor, whose sign bit is set if it steps; in every tick. Ports
    /// that use the words unchanged need no mask.
    #[inline(always)]
    fn begin_pulses_by_sign(&mut self, tick: u64, signs: &[u32; MOTORS_MAX]) {
        // The last motor first: the mask moves up, so that motor 0 ends in bit 0.
        let mut motors = 0;
        for sign in signs.iter().rev() {
            motors = motors << 1 | sign >> 31;
        }
        if motors != 0 {
            self.step(tick, motors as u8);
        }
    }
}

/// Discards everything; for servo-only tests and benches.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoOutput;

impl StepOutput for NoOutput {
    fn set_directions(&mut self, _directions: u8) {}
    fn step(&mut self, _tick: u64, _motors: u8) {}
}

/// A pin: port (0 = A) and number.
pub type Pin = (usize, u32);
/// Ports that a board may have its drivers on.
pub const PORTS: usize = 8;

/// Ports of a microcontroller whose pins are set and reset by one word, and the drivers' pins.
pub trait Ports {
    /// Step pins of the motors.
    const STEP: [Pin; MOTORS_MAX];
    /// Their direction pins.
    const DIRECTION: [Pin; MOTORS_MAX];
    /// Sets (low half of the word) and resets (high half) pins of a port at once.
    fn write(&mut self, port: usize, word: u32);
}

/// Bits of a motor mask that one look-up takes.
const HALF: usize = MOTORS_MAX / 2;
/// Words of all ports, for each value of half a mask.
type HalfTable = [[u32; PORTS]; 1 << HALF];

/// Step and direction pins of up to eight drivers. A pulse begins with its step and ends with the
/// next step tick. Words for the direction pins are looked up, because they change in a tick that
/// has other work as well.
#[derive(Clone, Debug)]
pub struct PortOutput<P> {
    ports: P,
    low: HalfTable,
    high: HalfTable,
}

impl<P: Ports> PortOutput<P> {
    /// For the first `motors` motors: direction pins of others are unchanged. `inverted`: a mask of
    /// motors whose direction pin is low for larger positions.
    pub fn new(ports: P, motors: usize, inverted: u8) -> Self {
        Self {
            ports,
            low: half_table::<P>(0, motors, inverted),
            high: half_table::<P>(HALF, motors, inverted),
        }
    }
}

fn half_table<P: Ports>(first: usize, motors: usize, inverted: u8) -> HalfTable {
    let mut table = [[0; PORTS]; 1 << HALF];
    for (mask, words) in table.iter_mut().enumerate() {
        let pins = P::DIRECTION.into_iter().enumerate().take(motors);
        for (motor, (port, pin)) in pins.skip(first).take(HALF) {
            let level = (mask >> (motor - first) ^ usize::from(inverted) >> motor) & 1;
            words[port % PORTS] |= 1 << if level == 1 { pin } else { pin + 16 };
        }
    }
    table
}

/// True if one of the pins is on a port; known when it is compiled.
#[inline(always)]
fn is_used(pins: &[Pin], port: usize) -> bool {
    pins.iter().any(|pin| pin.0 == port)
}

impl<P: Ports> StepOutput for PortOutput<P> {
    #[inline(always)]
    fn end_pulses(&mut self) {
        for port in 0..PORTS {
            if is_used(&P::STEP, port) {
                let pins = P::STEP.iter().filter(|pin| pin.0 == port);
                let word = pins.fold(0, |word, pin| word | 1 << (pin.1 + 16));
                self.ports.write(port, word);
            }
        }
    }

    #[inline(always)]
    fn set_directions(&mut self, directions: u8) {
        let directions = usize::from(directions);
        let low = &self.low[directions % (1 << HALF)];
        let high = &self.high[directions >> HALF & ((1 << HALF) - 1)];
        let (low_pins, high_pins) = P::DIRECTION.split_at(HALF);
        for port in 0..PORTS {
            let words = [
                is_used(low_pins, port).then(|| low[port]),
                is_used(high_pins, port).then(|| high[port]),
            ];
            if is_used(&P::DIRECTION, port) {
                let word = words.into_iter().flatten().fold(0, |all, word| all | word);
                self.ports.write(port, word);
            }
        }
    }

    fn step(&mut self, tick: u64, motors: u8) {
        let signs = core::array::from_fn(|motor| u32::from(motors >> motor) << 31);
        self.begin_pulses_by_sign(tick, &signs);
    }

    #[inline(always)]
    fn begin_pulses_by_sign(&mut self, _tick: u64, signs: &[u32; MOTORS_MAX]) {
        let mut word = 0;
        let order = const { by_port(P::STEP) };
        for (place, &motor) in order.iter().enumerate() {
            let (port, pin) = P::STEP[motor % MOTORS_MAX];
            // The word moves up from pin to pin, so that each takes two instructions.
            word |= signs[motor % MOTORS_MAX] >> 31;
            let next = order
                .get(place + 1)
                .map(|&motor| P::STEP[motor % MOTORS_MAX]);
            match next {
                Some(next) if next.0 == port => word <<= pin - next.1,
                _ => {
                    // A word without steps does nothing; a test would cost more.
                    self.ports.write(port, word << pin);
                    word = 0;
                }
            }
        }
    }
}

/// Motors by the port of their pin, in each port the highest pin first.
const fn by_port(pins: [Pin; MOTORS_MAX]) -> [usize; MOTORS_MAX] {
    let mut order = [0; MOTORS_MAX];
    let mut motor = 0;
    while motor < MOTORS_MAX {
        let mut place = motor;
        while place > 0 && comes_before(pins[motor], pins[order[place - 1]]) {
            order[place] = order[place - 1];
            place -= 1;
        }
        order[place] = motor;
        motor += 1;
    }
    order
}

const fn comes_before(a: Pin, b: Pin) -> bool {
    a.0 < b.0 || a.0 == b.0 && a.1 > b.1
}

#[cfg(test)]
#[path = "output_tests.rs"]
mod tests;
