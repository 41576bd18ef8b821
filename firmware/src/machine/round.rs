//! A round of the main loop: the work of a board at the lowest priority, and of a simulation between its servo
//! ticks.
//!
//! ```text
//! bytes of a line -> messages, knots weighed -> (servo and steps) -> spans to come -> heat -> drivers -> probe's pin
//!                 -> bytes of the other lines  -> interrupts measured  -> a report to each
//! ```
//! In: a [`Receiver`], the motion through a [`Controller`], the hardware around it through [`Surroundings`]. Out:
//! bytes; duties and pulses to the surroundings. Time is not counted here: a board repeats it as fast as it can, a
//! simulation once per servo period. Not covered: lines that come and go.

use crate::line::measurement::Measurement;
use crate::line::{Conversation, Outgoing, Receiver, Request};
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
    /// Stores received settings of a line.
    fn store(&mut self, _receiver: &mut Receiver, _talk: &mut Conversation) {}
    /// Serves the heaters when a period is due.
    fn heat(&mut self, _controller: &mut impl Controller) {}
    /// Serves the drivers when their turn is due.
    fn drivers(&mut self, _controller: &mut impl Controller) {}
    /// Measures interrupts, and tells what else was measured, while a measurement is on.
    fn measure(&mut self, _measurement: &mut Measurement) {}
    /// New pulse length of the probe's pin, us; 0 for no pulses.
    fn pulse(&mut self, _pulse_us: u16) {}
}

/// A line with what is said on it.
#[derive(Clone, Debug)]
pub struct Link {
    /// Its host.
    pub talk: Conversation,
    /// The report that is being sent.
    pub outgoing: Outgoing,
}

impl Link {
    /// Nobody was heard yet.
    pub fn new(talk: Conversation) -> Self {
        Self {
            talk,
            outgoing: Outgoing::new(),
        }
    }
}

/// One round.
#[inline(always)]
pub fn round<S: Surroundings>(
    receiver: &mut Receiver,
    links: &mut [Link],
    controller: &mut impl Controller,
    around: &mut S,
) {
    controller.note_round();
    if let Some(first) = links.first_mut() {
        hear(receiver, 0, &mut first.talk, controller, around);
    }
    controller.interrupts();
    look_ahead(controller);
    around.heat(controller);
    around.drivers(controller);
    if let Some(pulse_us) = controller.with_motion(|motion| motion.probe_pulse_us()) {
        around.pulse(pulse_us);
    }
    for (line, link) in links.iter_mut().enumerate().skip(1) {
        hear(receiver, line, &mut link.talk, controller, around);
    }
    if receiver.measurement().is_on() {
        around.measure(receiver.measurement());
    }
    for (line, link) in links.iter_mut().enumerate() {
        report(receiver, line, link, controller, around);
    }
}

/// Bytes of a line and the work that they bring: one piece of each, or all.
#[inline(always)]
fn hear<S: Surroundings>(
    receiver: &mut Receiver,
    line: usize,
    talk: &mut Conversation,
    controller: &mut impl Controller,
    around: &mut S,
) {
    loop {
        let heard = take_bytes(receiver, talk, around.heard(line), controller);
        around.store(receiver, talk);
        let worked = work(receiver, talk, S::WEIGHED_KNOTS, controller);
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
    talk: &mut Conversation,
    bytes: &mut impl Iterator<Item = u8>,
    controller: &mut impl Controller,
) -> bool {
    while !receiver.is_busy()
        && let Some(byte) = bytes.next()
    {
        if let Some(request) = receiver.receive(talk, byte) {
            apply(receiver, talk, request, controller);
            return true;
        }
    }
    false
}

// A message is on the stack while it is executed, not with the line's bytes.
#[inline(never)]
fn apply(
    receiver: &mut Receiver,
    talk: &mut Conversation,
    request: Request,
    controller: &mut impl Controller,
) {
    controller.command(|motion| receiver.apply(talk, request, motion));
}

/// A part of the work due to the last message. True if there was any.
#[inline(never)]
pub fn work(
    receiver: &mut Receiver,
    talk: &mut Conversation,
    knots: usize,
    controller: &mut impl Controller,
) -> bool {
    if !receiver.is_busy_with(talk) {
        return false;
    }
    receiver.work(knots);
    controller.with_motion(|motion| receiver.deliver(talk, motion));
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
    receiver: &Receiver,
    line: usize,
    link: &mut Link,
    controller: &mut impl Controller,
    around: &mut S,
) {
    loop {
        if !around.has_room(line) {
            return;
        }
        let bytes = pending(receiver, link, controller);
        let sent = if bytes.is_empty() {
            0
        } else {
            around.send(line, bytes)
        };
        link.outgoing.sent(sent);
        if !S::AT_ONCE || sent == 0 {
            return;
        }
    }
}

/// The bytes to send now: one part of the main loop's work.
#[inline(never)]
pub fn pending<'a>(
    receiver: &Receiver,
    link: &'a mut Link,
    controller: &mut impl Controller,
) -> &'a [u8] {
    link.outgoing.pending(&mut link.talk, |talk| {
        controller
            .with_motion(|motion| receiver.take_report(talk, motion))
            .flatten()
    })
}
