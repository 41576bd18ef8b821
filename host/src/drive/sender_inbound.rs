//! How the sender handles the controller's messages: welcome, acknowledgements, gaps, refusals,
//! faults, status. A part of [`Sender`]; the outgoing side and the call order are in `sender`.

use super::Sender;
use crate::drive::sender_state::{
    ControlMessage, Intent, Outstanding, SenderError, SenderEvent, SenderState,
};
use headway_protocol::message::{
    Ack, Control, DeviceMessage, DeviceState, Fault, OpenStream, Refusal, RefusalReason, Status,
    Welcome,
};

impl Sender {
    pub(super) fn handle_message(&mut self, now_us: u64, message: DeviceMessage) {
        match message {
            DeviceMessage::Welcome(welcome) => self.handle_welcome(&welcome),
            DeviceMessage::Ack(ack) => self.handle_ack(now_us, &ack),
            DeviceMessage::Nak(ack) => {
                self.handle_ack(now_us, &ack);
                self.handle_gap(now_us);
            }
            DeviceMessage::Refused(refusal) => self.handle_refusal(refusal),
            DeviceMessage::Status(status) => self.handle_status(status),
            DeviceMessage::Fault(fault) => {
                self.events.push_back(SenderEvent::Fault(fault));
                self.handle_fault(fault);
            }
            DeviceMessage::Measured(figures) => {
                self.events.push_back(SenderEvent::Measured(figures));
            }
            DeviceMessage::Crash(crash) => self.events.push_back(SenderEvent::Crash(crash)),
        }
    }

    fn fail(&mut self, error: SenderError) {
        if !matches!(self.state, SenderState::Failed(_)) {
            self.state = SenderState::Failed(error);
            self.outstanding = None;
        }
    }

    fn handle_welcome(&mut self, welcome: &Welcome) {
        let is_ours = welcome.host_session == self.setup.host_session;
        if !is_ours {
            return;
        }
        if self.state != SenderState::Greeting {
            self.look_for_loss(welcome);
            return;
        }
        // A command that was given before the greeting waits on: the board has refused it, if it has heard it.
        match &mut self.outstanding {
            Some(waits) if waits.what != ControlMessage::Hello => waits.sent_us = None,
            outstanding => *outstanding = None,
        }
        self.events.push_back(SenderEvent::Connected(*welcome));
        if let Err(error) = self.setup.check_welcome(welcome, self.intent) {
            self.fail(error);
            return;
        }
        self.device_session = Some(welcome.session);
        let first = welcome.session.wrapping_mul(0x9e37_79b9);
        let job = self.frames.job();
        match (self.intent, welcome.stream) {
            (Intent::Talk, _) => self.state = SenderState::Talking,
            (Intent::ResumeOrStream | Intent::ResumeOnly, Some(stream)) if stream.job == job => {
                self.resume(&stream);
            }
            (Intent::ResumeOnly, _) => self.fail(SenderError::NothingToResume { job }),
            (_, stream) => {
                self.first_sequence = stream.map_or(first, |stream| stream.next_sequence);
                self.state = SenderState::Opening;
            }
        }
    }

    /// True if the controller greets us without the stream that it had acknowledged: it has restarted,
    /// whatever session it names. An abort ends the stream before we hear of it. A welcome that does not
    /// know our stream, while we stream. It may be an old one that was overtaken in transit: the
    /// controller is greeted again, and the answer accepted if it is repeated with no acknowledgement in
    /// between.
    fn look_for_loss(&mut self, welcome: &Welcome) {
        let answers = |outstanding: &Outstanding| {
            outstanding.what == ControlMessage::Hello && outstanding.sent_us.is_some()
        };
        let greeted = self.outstanding.as_ref().is_some_and(answers);
        if greeted {
            self.outstanding = None;
        }
        if !self.is_session(welcome.session) {
            return;
        }
        let lost = self.has_lost_stream(welcome);
        // A copy of the first one is no second one.
        if lost && self.may_have_lost_stream && greeted {
            let job = self.frames.job();
            self.fail(SenderError::StreamLost { job });
        }
        self.may_have_lost_stream = lost;
    }

    fn has_lost_stream(&self, welcome: &Welcome) -> bool {
        let streams = matches!(self.state, SenderState::Streaming | SenderState::Finishing);
        let job = welcome.stream.map(|stream| stream.job);
        streams && job != Some(self.frames.job()) && !self.ends_itself()
    }

    /// What ends the stream is under way: the board may have done it before we hear that it was taken.
    fn ends_itself(&self) -> bool {
        self.outstanding.as_ref().is_some_and(|outstanding| {
            matches!(
                outstanding.what,
                ControlMessage::Command(Control::Abort | Control::ClearFault)
            )
        })
    }

    /// Continues a stream that the controller already has in part.
    fn resume(&mut self, stream: &OpenStream) {
        self.first_sequence = stream.first_sequence;
        let taken = stream.next_sequence.wrapping_sub(stream.first_sequence) as usize;
        let (knots, _) = match taken.checked_sub(1) {
            Some(last) => self.frames.totals_after(last),
            None => (0, 0),
        };
        if taken > self.frames.len() || knots != stream.knots_taken {
            self.fail(SenderError::Busy { job: stream.job });
            return;
        }
        self.acknowledged = taken;
        self.cursor = taken;
        self.high_water = taken;
        self.state = if taken == self.frames.len() {
            SenderState::Finishing
        } else {
            SenderState::Streaming
        };
    }

    fn is_session(&mut self, session: u32) -> bool {
        match self.device_session {
            Some(before) if before == session => true,
            Some(before) => {
                let now = session;
                self.fail(SenderError::DeviceRestarted { before, now });
                false
            }
            None => false,
        }
    }

    fn handle_ack(&mut self, now_us: u64, ack: &Ack) {
        if !self.is_session(ack.session) {
            return;
        }
        self.answered_us = now_us;
        let taken = ack.next_sequence.wrapping_sub(self.first_sequence) as usize;
        if let Some(outstanding) = self.outstanding {
            // One goes at a time: a board that has taken a later one has not taken ours.
            let is_taken = ack.control_taken == outstanding.sequence;
            if outstanding.sent_us.is_some() && is_taken {
                self.outstanding = None;
                self.note_taken(outstanding.what, taken);
            }
        }
        let streams = matches!(self.state, SenderState::Streaming | SenderState::Finishing);
        // Frames of the previous host may have been in transit when the controller sent its
        // welcome.
        let most = match self.intent {
            Intent::ResumeOrStream | Intent::ResumeOnly => self.frames.len(),
            Intent::Stream | Intent::Talk => self.high_water,
        };
        if !streams || taken > most {
            return;
        }
        self.knot_limit = self.knot_limit.max(ack.knot_limit);
        self.event_limit = self.event_limit.max(ack.event_limit);
        self.may_have_lost_stream = false;
        self.take_acknowledged(now_us, taken);
        if self.acknowledged == self.frames.len() {
            self.state = SenderState::Finishing;
        }
    }

    /// A control message has arrived.
    fn note_taken(&mut self, what: ControlMessage, frames_taken: usize) {
        match what {
            ControlMessage::Start if frames_taken == 0 => self.state = SenderState::Streaming,
            ControlMessage::Command(control) => {
                if control == Control::Abort && self.intent != Intent::Talk {
                    self.state = SenderState::Aborted;
                }
                self.events.push_back(SenderEvent::Taken(control));
            }
            ControlMessage::Hello | ControlMessage::Start => {}
        }
    }

    fn take_acknowledged(&mut self, now_us: u64, taken: usize) {
        if taken <= self.acknowledged {
            return;
        }
        let mut newest = None;
        for _ in self.acknowledged..taken {
            newest = self.in_flight.pop_front().or(newest);
        }
        self.acknowledged = taken;
        self.cursor = self.cursor.max(taken);
        self.high_water = self.high_water.max(taken);
        if let Some(frame) = newest.filter(|frame| !frame.repeated) {
            self.round_trip
                .measure(now_us.saturating_sub(frame.sent_us));
        }
        self.retry_us = self.round_trip.retry_us();
    }

    /// The controller requests the frame after the acknowledged ones.
    fn handle_gap(&mut self, now_us: u64) {
        if self.cursor <= self.acknowledged {
            return;
        }
        // A second request for the same frame within a round trip is an echo of the first gap.
        let is_echo = self.went_back.is_some_and(|(frame, at_us)| {
            frame == self.acknowledged && now_us < at_us + self.round_trip.estimate_us()
        });
        if !is_echo {
            self.go_back(now_us, self.acknowledged);
        }
    }

    fn handle_refusal(&mut self, refusal: Refusal) {
        if refusal.reason == RefusalReason::NoHello {
            // It has restarted, or never met us: its welcome has the answer.
            self.greet_next();
            return;
        }
        let refused = self
            .outstanding
            .filter(|outstanding| outstanding.sequence == refusal.sequence);
        match (refused, refusal.reason) {
            (Some(outstanding), reason) => {
                self.events.push_back(SenderEvent::Refused(refusal));
                self.outstanding = None;
                if matches!(
                    outstanding.what,
                    ControlMessage::Hello | ControlMessage::Start
                ) {
                    self.fail(self.setup.refusal_error(reason));
                }
            }
            (None, RefusalReason::NoStream)
                if self.state == SenderState::Streaming && !self.ends_itself() =>
            {
                self.events.push_back(SenderEvent::Refused(refusal));
                let job = self.frames.job();
                self.fail(SenderError::StreamLost { job });
            }
            // A second answer to a repeated query: it refuses nothing else.
            _ => {}
        }
    }

    /// Spans of the whole stream.
    fn spans(&self) -> u32 {
        let last = self.frames.len().checked_sub(1);
        last.map_or(0, |last| self.frames.totals_after(last).0)
    }

    /// A fault ends the stream: the controller forgets it.
    fn handle_fault(&mut self, fault: Fault) {
        let begun = matches!(
            self.state,
            SenderState::Opening | SenderState::Streaming | SenderState::Finishing
        );
        if begun {
            self.fail(SenderError::Fault(fault));
        }
    }

    fn handle_status(&mut self, status: Status) {
        if !self.is_session(status.session) {
            return;
        }
        self.last_status = Some(status.clone());
        let is_over = status.state == DeviceState::Finished && status.spans_done == self.spans();
        if self.state == SenderState::Finishing && is_over {
            self.state = SenderState::Done;
            self.outstanding = None;
        }
        if let Some(fault) = status.fault {
            self.handle_fault(fault);
        }
        self.events.push_back(SenderEvent::Status(status));
    }
}
