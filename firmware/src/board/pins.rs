//! Drivers, switches and the emergency input on `embedded-hal` pins.
//!
//! Bit m of a mask is motor m. A microcontroller's own pins cannot fail; of those that can, an input
//! counts as pressed, and an output stays unchanged.

use crate::board::input_map::InputMap;
use crate::configuration::wiring::INPUTS_MAX;
use crate::motion::inputs::Inputs;
use crate::steps::output::StepOutput;
use embedded_hal::delay::DelayNs;
use embedded_hal::digital::{InputPin, OutputPin, PinState};

/// Time from the pull-ups on until the inputs are believed: 100 nF of a filter at 40 kΩ, five times
/// over.
pub const INPUTS_SETTLE_MS: u32 = 20;

/// Step and direction pins of `MOTORS` drivers, one by one. A pulse begins with its step and ends with
/// the next step tick, as with `PortOutput`.
#[derive(Debug)]
pub struct PinOutput<S, D, const MOTORS: usize> {
    steps: [S; MOTORS],
    directions: [D; MOTORS],
    inverted: u8,
}

impl<S: OutputPin, D: OutputPin, const MOTORS: usize> PinOutput<S, D, MOTORS> {
    /// No pulse, all directions towards smaller positions. `inverted`: motors whose direction pin is
    /// low for larger positions.
    pub fn new(steps: [S; MOTORS], directions: [D; MOTORS], inverted: u8) -> Self {
        let mut output = Self {
            steps,
            directions,
            inverted,
        };
        output.end_pulses();
        output.set_directions(0);
        output
    }
}

impl<S: OutputPin, D: OutputPin, const MOTORS: usize> StepOutput for PinOutput<S, D, MOTORS> {
    #[inline(always)]
    fn end_pulses(&mut self) {
        // All of them: that is quicker than to know which.
        for step in &mut self.steps {
            let _ = step.set_low();
        }
    }

    fn set_directions(&mut self, directions: u8) {
        let levels = directions ^ self.inverted;
        for (motor, direction) in self.directions.iter_mut().enumerate() {
            let _ = direction.set_state(PinState::from(levels >> motor & 1 == 1));
        }
    }

    #[inline(always)]
    fn step(&mut self, _tick: u64, motors: u8) {
        for (motor, step) in self.steps.iter_mut().enumerate() {
            if motors >> motor & 1 == 1 {
                let _ = step.set_high();
            }
        }
    }
}

/// What the servo tick reads and writes at a board's pins.
pub trait BoardPins {
    /// Levels of the inputs.
    fn inputs(&mut self) -> Inputs;
    /// Lets drivers hold their motors, one bit each, and the others go.
    fn hold(&mut self, motors: u8);
    /// Levels of heaters and fans, a bit each; a board without them has nothing to do.
    #[inline(always)]
    fn put_heat(&mut self, _levels: u8) {}
}

/// Inputs pulled up, by number, with their roles; one that cannot be read counts as pressed. Enable pins, low = on, by
/// motors; the last one is also that of all motors after it.
#[derive(Debug)]
pub struct PinBoard<I, E, const INPUTS: usize, const ENABLES: usize> {
    inputs: [I; INPUTS],
    map: InputMap,
    enables: [E; ENABLES],
}

impl<I: InputPin, E: OutputPin, const INPUTS: usize, const ENABLES: usize>
    PinBoard<I, E, INPUTS, ENABLES>
{
    /// Drivers off; returns when the inputs are stable. 16 inputs at most.
    pub fn new(
        inputs: [I; INPUTS],
        map: InputMap,
        enables: [E; ENABLES],
        delay: &mut impl DelayNs,
    ) -> Self {
        let mut board = Self {
            inputs,
            map,
            enables,
        };
        board.hold(0);
        delay.delay_ms(INPUTS_SETTLE_MS);
        board
    }
}

impl<I: InputPin, E: OutputPin, const INPUTS: usize, const ENABLES: usize> BoardPins
    for PinBoard<I, E, INPUTS, ENABLES>
{
    fn inputs(&mut self) -> Inputs {
        let mut levels = 0;
        for (number, pin) in (0u8..INPUTS_MAX).zip(&mut self.inputs) {
            let pressed = !self.map.is_open(number);
            levels |= u16::from(pin.is_high().unwrap_or(pressed)) << number;
        }
        self.map.inputs(levels)
    }

    fn hold(&mut self, motors: u8) {
        for (motor, enable) in (0u32..).zip(&mut self.enables) {
            let is_last = motor as usize + 1 == ENABLES;
            let own = motors.unbounded_shr(motor);
            let on = if is_last { own != 0 } else { own & 1 == 1 };
            let _ = enable.set_state(PinState::from(!on));
        }
    }
}
