//! The end of a second line: a host that asks and may stop, while another one streams.
//!
//! It has a numbering of its own and shares the motion. Streams and moves are refused there, so that
//! nothing of it runs when the first host has gone.

use super::{Content, Receiver, Request};
use crate::configuration::MachineConfiguration;
use crate::motion::Motion;
use headway_protocol::message::{OpenStream, RefusalReason};

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

    /// Tells a second line what the `first` one streams.
    pub fn watch(&mut self, first: &Receiver, motion: &Motion) {
        if self.watched.is_some() {
            self.watched = Some(Watched(first.open_stream(motion)));
            self.settings_hash = first.settings_hash;
        }
    }

    /// True for what a second line may not ask: it is answered.
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

    /// True for what only the host on the first line may ask: to stream, and to move.
    pub(super) fn needs_the_line(&self) -> bool {
        match self {
            Content::Hello(_) | Content::Unreadable(_) => false,
            Content::Control(control) => {
                control.is_at_rest_only() || control.heats() || control.lifts_a_guard()
            }
            _ => true,
        }
    }
}
