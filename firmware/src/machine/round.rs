//! A round of the main loop: the work of a board at the lowest priority, and of a simulation between its servo
//! ticks.
//!
//! ```text
//! bytes of a line -> messages, knots weighed -> (servo and steps) -> spans to come -> heat -> drivers -> probe's pin
//!                 -> bytes of a second line  -> a report
//! ```
//! In: a [`Receiver`], the motion through a [`Controller`], the hardware around it through [`Surroundings`]. Out:
//! bytes; duties and pulses to the surroundings. Time is not counted here: a board repeats it as fast as it can, a
//! simulation once per servo period. Not covered: several hosts that are exchanged, as on a simulated board.

use crate::line::{Outgoing, Receiver, Request, SECOND_LINE};
use crate::motion::Motion;

/// What servo and steps own, as the main loop gets at it: on a board under a lock.
pub trait Controller {
    /// Uses the motion; `None` before there is one.
    fn with_motion<R>(&mut self, work: impl FnOnce(&mut Motion) -> R) -> Option<R>;
    /// The same for work that may stop the steps: if it does, they have stopped before this
    /// returns.
    fn command(&mut self, work: impl FnOnce(&mut Motion));
    /// The main loop lives.
    fn note_round(&mut self);
    /// Lets servo and steps run if nothing interrupts; on a board they interrupt at any time.
    fn interrupts(&mut self) {}
}

/// The hardware around the controller.
pub trait Surroundings {
    /// One round handles all that has arrived and sends all reports that fit: for callers in which no interrupt
    /// waits for a piece of work.
    const AT_ONCE: bool;
    /// Knots of a block that are weighed in one piece.
    const WEIGHED_KNOTS: usize;
    /// Bytes of a line.
    type Bytes: Iterator<Item = u8>;

    /// Bytes that have arrived on a line and are not read yet.
    fn heard(&mut self, line: usize) -> &mut Self::Bytes;
    /// A line takes a report, or more of one.
    fn has_room(&mut self, _line: usize) -> bool {
        true
    }
    /// Sends what a line takes of it: how many bytes.
    fn send(&mut self, line: usize, bytes: &[u8]) -> usize;
    /// Stores received settings.
    fn store(&mut self, _receiver: &mut Receiver) {}
    /// Serves the heaters when a period is due.
    fn heat(&mut self, _controller: &mut impl Controller) {}
    /// Serves the drivers when their turn is due.
    fn drivers(&mut self, _controller: &mut impl Controller) {}
    /// New pulse length of the probe's pin, us; 0 for no pulses.
    fn pulse(&mut self, _pulse_us: u16) {}
}

/// One round.
#[inline(always)]
pub fn round<S: Surroundings>(
    receiver: &mut Receiver,
    outgoing: &mut Outgoing,
    controller: &mut impl Controller,
    around: &mut S,
) {
    controller.note_round();
    hear(receiver, 0, controller, around);
    controller.interrupts();
    look_ahead(controller);
    around.heat(controller);
    around.drivers(controller);
    if let Some(pulse_us) = controller.with_motion(|motion| motion.probe_pulse_us()) {
        around.pulse(pulse_us);
    }
    hear(receiver, SECOND_LINE, controller, around);
    report(receiver, outgoing, controller, around);
}

/// Bytes of a line and the work that they bring: one piece of each, or all.
#[inline(always)]
fn hear<S: Surroundings>(
    receiver: &mut Receiver,
    line: usize,
    controller: &mut impl Controller,
    around: &mut S,
) {
    loop {
        let heard = take_bytes(receiver, line, around.heard(line), controller);
        around.store(receiver);
        let worked = line == 0 && work(receiver, S::WEIGHED_KNOTS, controller);
        if !S::AT_ONCE || !(heard || worked) {
            return;
        }
    }
}

/// Bytes of a line, up to the end of a message: one piece of the main loop's work. True if a message ended.
// Once in the image, however many lines there are.
#[inline(never)]
pub fn take_bytes(
    receiver: &mut Receiver,
    line: usize,
    bytes: &mut impl Iterator<Item = u8>,
    controller: &mut impl Controller,
) -> bool {
    while !receiver.is_busy()
        && let Some(byte) = bytes.next()
    {
        if let Some(request) = receiver.receive(line, byte) {
            apply(receiver, request, controller);
            return true;
        }
    }
    false
}

// A message is on the stack while it is executed, not with the line's bytes.
#[inline(never)]
fn apply(receiver: &mut Receiver, request: Request, controller: &mut impl Controller) {
    controller.command(|motion| receiver.apply(request, motion));
}

/// A part of the work due to the last message. True if there was any.
#[inline(never)]
pub fn work(receiver: &mut Receiver, knots: usize, controller: &mut impl Controller) -> bool {
    if !receiver.is_busy() {
        return false;
    }
    receiver.work(knots);
    controller.with_motion(|motion| receiver.deliver(motion));
    true
}

/// Work for coming spans, one at most. True if there was any.
#[inline(always)]
pub fn look_ahead(controller: &mut impl Controller) -> bool {
    controller.with_motion(Motion::look_ahead) == Some(true)
}

/// A report, or the rest of one; all of them if they are sent at once.
#[inline(always)]
fn report<S: Surroundings>(
    receiver: &mut Receiver,
    outgoing: &mut Outgoing,
    controller: &mut impl Controller,
    around: &mut S,
) {
    loop {
        let line = receiver.line();
        if !around.has_room(line) {
            return;
        }
        let bytes = pending(receiver, outgoing, controller);
        let sent = if bytes.is_empty() {
            0
        } else {
            around.send(line, bytes)
        };
        outgoing.sent(sent);
        if !S::AT_ONCE || sent == 0 {
            return;
        }
    }
}

/// The bytes to send now: one part of the main loop's work.
#[inline(never)]
pub fn pending<'a>(
    receiver: &mut Receiver,
    outgoing: &'a mut Outgoing,
    controller: &mut impl Controller,
) -> &'a [u8] {
    outgoing.pending(receiver, |receiver| {
        controller
            .with_motion(|motion| receiver.take_report(motion))
            .flatten()
    })
}
