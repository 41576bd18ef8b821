//! The controller's reports and their timing: acknowledgements, status, faults.

use crate::design::{CREDIT_STEP_KNOTS, QUEUE_EVENTS, QUEUE_KNOTS};
use crate::line::{Conversation, Receiver};
use crate::motion::Motion;
use headway_protocol::frame::encode_frame;
use headway_protocol::message::{
    Ack, DeviceMessage, NO_JOB, OpenStream, PROTOCOL_VERSION, SCHEMA_HASH, Status, Welcome,
};
use heapless::Vec;

impl Receiver {
    /// Writes the next report frame into `out` (at least `FRAME_BYTES_MAX`), or returns 0.
    pub fn poll_report(&self, talk: &mut Conversation, motion: &Motion, out: &mut [u8]) -> usize {
        let report = self.take_report(talk, motion);
        report.map_or(0, |report| talk.write_report(&report, out))
    }

    /// The next report, by copying: the part that a board needs the motion for.
    pub fn take_report(&self, talk: &mut Conversation, motion: &Motion) -> Option<DeviceMessage> {
        if talk.host_session.is_none() && talk.due.refusals.is_empty() {
            return None;
        }
        self.note_changes(talk, motion);
        self.next_report(talk, motion)
    }

    /// Determines unsolicited reports.
    fn note_changes(&self, talk: &mut Conversation, motion: &Motion) {
        let (state, fault) = (motion.state(), motion.fault());
        let owns = self.stream.is_some() && self.owner.is(talk);
        if state != talk.last_state {
            log_event!("{}", state);
            talk.last_state = state;
            talk.due.status = true;
        }
        if fault != talk.last_fault {
            talk.last_fault = fault;
            log_event!("{}", fault);
            talk.due.fault = fault.is_some();
        }
        if motion.now_ticks() >= talk.status_tick + talk.status_period_ticks {
            talk.status_tick = motion.now_ticks();
            talk.due.status = true;
            talk.due.ack |= owns;
        }
        let told = talk.knot_limit_told;
        if owns && self.knot_limit(motion).wrapping_sub(told) >= CREDIT_STEP_KNOTS {
            talk.due.ack = true;
        }
    }

    fn next_report(&self, talk: &mut Conversation, motion: &Motion) -> Option<DeviceMessage> {
        if core::mem::take(&mut talk.due.fault)
            && let Some(fault) = motion.fault()
        {
            return Some(DeviceMessage::Fault(fault));
        }
        if core::mem::take(&mut talk.due.crash)
            && let Some(crash) = self.crash
        {
            return Some(DeviceMessage::Crash(crash));
        }
        if core::mem::take(&mut talk.due.welcome) {
            return Some(DeviceMessage::Welcome(self.welcome(talk, motion)));
        }
        if let Some(refusal) = talk.due.refusals.pop_front() {
            return Some(DeviceMessage::Refused(refusal));
        }
        if core::mem::take(&mut talk.due.nak) {
            talk.due.ack = false;
            return Some(DeviceMessage::Nak(self.ack(talk, motion)));
        }
        if core::mem::take(&mut talk.due.ack) {
            return Some(DeviceMessage::Ack(self.ack(talk, motion)));
        }
        if talk.due.measured
            && let Some(figures) = self.measurement.figures()
        {
            talk.due.measured = false;
            return Some(DeviceMessage::Measured(figures));
        }
        if core::mem::take(&mut talk.due.status) {
            return Some(DeviceMessage::Status(self.status(motion)));
        }
        None
    }

    fn knot_limit(&self, motion: &Motion) -> u32 {
        let taken = self.stream.as_ref().map_or(0, |stream| stream.knots);
        taken.wrapping_add(motion.knot_room() as u32)
    }

    fn ack(&self, talk: &mut Conversation, motion: &Motion) -> Ack {
        talk.knot_limit_told = self.knot_limit(motion);
        let events = self.stream.as_ref().map_or(0, |stream| stream.events);
        Ack {
            session: self.session,
            next_sequence: self
                .stream
                .as_ref()
                .map_or(0, |stream| stream.next_sequence),
            knot_limit: talk.knot_limit_told,
            event_limit: events.wrapping_add(motion.event_room() as u32),
            control_taken: talk.control_done(),
        }
    }

    fn welcome(&self, talk: &Conversation, motion: &Motion) -> Welcome {
        Welcome {
            protocol_version: PROTOCOL_VERSION,
            schema_hash: SCHEMA_HASH,
            firmware_version: FIRMWARE_VERSION,
            machine_hash: self.machine_hash,
            queue_knots: QUEUE_KNOTS as u16,
            queue_events: QUEUE_EVENTS as u16,
            servo_hz: self.servo_hz,
            step_hz: self.step_hz,
            session: self.session,
            host_session: talk.host_session.unwrap_or(0),
            stream: self.open_stream(motion),
            settings_hash: self.settings_hash,
        }
    }

    fn open_stream(&self, motion: &Motion) -> Option<OpenStream> {
        let open = self.stream.as_ref().map(|stream| OpenStream {
            job: stream.job,
            first_sequence: stream.first_sequence,
            next_sequence: stream.next_sequence,
            knots_taken: stream.knots,
            spans_done: motion.spans_done(),
        });
        let next = self.next_first_sequence;
        open.or(next.map(|next_sequence| OpenStream {
            job: NO_JOB,
            first_sequence: next_sequence,
            next_sequence,
            knots_taken: 0,
            spans_done: 0,
        }))
    }

    fn status(&self, motion: &Motion) -> Status {
        let mut counts_steps = Vec::new();
        for count in motion.counts().iter().take(motion.motors()) {
            // Room for all motors by the type's bound; counts wrap at 32 bits on the wire.
            let _ = counts_steps.push(*count as i32);
        }
        Status {
            session: self.session,
            state: motion.state(),
            sigma_permille: ((u64::from(motion.rate_q16()) * 1000) >> 16) as u16,
            override_percent: motion.override_percent(),
            flow_percent: motion.flow_percent(),
            referenced: motion.referenced(),
            switches: motion.switches(),
            spans_done: motion.spans_done(),
            queue_knots: motion.queued_knots() as u16,
            queue_events: motion.queued_events() as u16,
            counts_steps,
            heaters: motion.heat().readings().clone(),
            fan_permille: motion.heat().fan_permille(),
            fault: motion.fault(),
            drivers: motion.drivers().status().clone(),
            probe: motion.probe_result(),
        }
    }
}

impl Conversation {
    /// Writes a report's frame into `out`, and returns its length.
    pub fn write_report(&mut self, message: &DeviceMessage, out: &mut [u8]) -> usize {
        self.report_sequence = self.report_sequence.wrapping_add(1);
        // A report always fits a frame; a smaller buffer gets nothing.
        encode_frame(self.report_sequence, message, out).unwrap_or(0)
    }

    /// The newest control message, or the one before it where that was refused: only a refusal ends it,
    /// so that the host repeats it if the refusal was lost.
    fn control_done(&self) -> u16 {
        let refused = self
            .refused
            .is_some_and(|r| r.sequence == self.control_taken);
        self.control_taken.wrapping_sub(u16::from(refused))
    }
}

/// Version of this library.
pub const FIRMWARE_VERSION: [u8; 3] = [0, 1, 0];
