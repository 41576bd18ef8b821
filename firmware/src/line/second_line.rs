//! The controller's end of a second line: for a host that queries and may stop while another one
//! streams.
//!
//! It has a numbering of its own and shares the motion. Streams, moves, heat and fans are refused there, so that
//! nothing started from it runs after the first host has gone. Where several lines can be the first one (a
//! simulated board), two hosts are exchanged by [`Receiver::exchange_hosts`].

use crate::configuration::MachineConfiguration;
use crate::line::{Content, Receiver, Request};
use crate::motion::Motion;
use headway_protocol::message::{Control, OpenStream, RefusalReason};

/// What a second line knows of the first one's stream.
#[derive(Clone, Copy, Debug)]
pub(super) struct Watched(pub(super) Option<OpenStream>);

impl Receiver {
    /// For questions and to stop.
    pub fn watching(configuration: &MachineConfiguration, session: u32) -> Self {
        Self {
            watched: Some(Watched(None)),
            ..Self::new(configuration, session)
        }
    }

    /// Copies the state of the `first` line's stream to a second line.
    pub fn watch(&mut self, first: &Receiver, motion: &Motion) {
        if self.watched.is_some() {
            self.watched = Some(Watched(first.open_stream(motion)));
            self.settings_hash = first.settings_hash;
        }
    }

    /// Exchanges the hosts of two lines: each continues with its own numbering, in the other one's role. Streams
    /// and settings stay.
    pub fn exchange_hosts(&mut self, other: &mut Receiver) {
        use core::mem::swap;
        swap(&mut self.decoders, &mut other.decoders);
        swap(&mut self.line, &mut other.line);
        swap(&mut self.host_session, &mut other.host_session);
        swap(&mut self.control_taken, &mut other.control_taken);
        swap(&mut self.refused, &mut other.refused);
        swap(&mut self.due, &mut other.due);
        swap(&mut self.nak_tick, &mut other.nak_tick);
        swap(&mut self.status_tick, &mut other.status_tick);
        swap(
            &mut self.status_period_ticks,
            &mut other.status_period_ticks,
        );
        swap(&mut self.last_state, &mut other.last_state);
        swap(&mut self.last_fault, &mut other.last_fault);
        swap(&mut self.report_sequence, &mut other.report_sequence);
    }

    /// True for requests that a second line may not make: it is answered.
    pub(super) fn refuses_watcher(&mut self, request: &Request) -> bool {
        if self.watched.is_none() || !request.content.needs_the_line() {
            return false;
        }
        if request.content.is_stream() {
            self.refuse(request.sequence, RefusalReason::Busy);
        } else if self.take_control(request.sequence) {
            self.refuse_control(request.sequence, RefusalReason::Busy);
        }
        true
    }
}

impl Content {
    pub(super) fn is_stream(&self) -> bool {
        matches!(
            self,
            Content::Flow(_) | Content::Finish(_) | Content::Damaged | Content::Misplaced
        )
    }

    /// True for requests that only the host on the first line may make: to stream, to move, to
    /// heat.
    pub(super) fn needs_the_line(&self) -> bool {
        match self {
            Content::Hello(_) | Content::Unreadable(_) => false,
            Content::Control(control) => !is_for_every_line(control),
            _ => true,
        }
    }
}

impl Request {
    /// True for requests that only the host on the first line may make: on a second one they are
    /// refused.
    pub fn needs_the_line(&self) -> bool {
        self.content.needs_the_line()
    }
}

/// Queries, and commands that make a machine slower, cooler or stop: all others are for the first line.
fn is_for_every_line(control: &Control) -> bool {
    matches!(
        control,
        Control::Pause
            | Control::Resume
            | Control::Override(_)
            | Control::FlowOverride(_)
            | Control::Abort
            | Control::EmergencyStop
            | Control::ClearFault
            | Control::StatusRequest
            | Control::ReportPeriod(_)
            | Control::Heat { decidegrees: 0, .. }
    )
}
