//! The only traits at the edge to the pins.
//!
//! The library calls them; a board, a recorder and a tracer implement them. Bit m of a mask is
//! motor m: the joints in order, then the extruder.

use embedded_hal::digital::OutputPin;

use crate::configuration::MOTORS_MAX;

/// Where steps go.
pub trait StepOutput {
    /// Sets the direction pins: bit set = towards larger positions. Called after the steps of a
    /// tick, so at least one step tick before the first step that needs the new direction.
    fn set_directions(&mut self, directions: u8);
    /// One step of each motor in the mask (never 0) in step tick `tick`, counted from start-up.
    fn step(&mut self, tick: u64, motors: u8);
}

/// Discards everything; for servo-only tests and benches.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoOutput;

impl StepOutput for NoOutput {
    fn set_directions(&mut self, _directions: u8) {}
    fn step(&mut self, _tick: u64, _motors: u8) {}
}

/// Step and direction pins of up to eight drivers through `embedded-hal`.
///
/// A step pulse begins in [`StepOutput::step`] and ends with [`PinOutput::end_pulses`], which the
/// board calls later in the same tick, before it may change a direction.
#[derive(Debug)]
pub struct PinOutput<Step, Direction> {
    step: [Step; MOTORS_MAX],
    direction: [Direction; MOTORS_MAX],
    /// Motors whose positive direction is a low pin.
    inverted: u8,
    raised: u8,
}

impl<Step: OutputPin, Direction: OutputPin> PinOutput<Step, Direction> {
    /// `inverted`: mask of motors whose direction pin is low for larger positions.
    pub fn new(step: [Step; MOTORS_MAX], direction: [Direction; MOTORS_MAX], inverted: u8) -> Self {
        Self {
            step,
            direction,
            inverted,
            raised: 0,
        }
    }

    /// Lowers the step pins that [`StepOutput::step`] raised.
    pub fn end_pulses(&mut self) {
        for (motor, pin) in self.step.iter_mut().enumerate() {
            if self.raised >> motor & 1 == 1 {
                // Port writes of a microcontroller cannot fail; there is nobody to tell either.
                let _ = pin.set_low();
            }
        }
        self.raised = 0;
    }
}

impl<Step: OutputPin, Direction: OutputPin> StepOutput for PinOutput<Step, Direction> {
    fn set_directions(&mut self, directions: u8) {
        let levels = directions ^ self.inverted;
        for (motor, pin) in self.direction.iter_mut().enumerate() {
            let _ = if levels >> motor & 1 == 1 {
                pin.set_high()
            } else {
                pin.set_low()
            };
        }
    }

    fn step(&mut self, _tick: u64, motors: u8) {
        for (motor, pin) in self.step.iter_mut().enumerate() {
            if motors >> motor & 1 == 1 {
                let _ = pin.set_high();
            }
        }
        self.raised |= motors;
    }
}
