//! The state of the motion, as one value: idle, a stream, the end of one, a manual move.
//!
//! In: requests of the line, and the advance of segment time. Out: whether the motors follow the path, whether it may
//! move, its state for a status. Impossible states do not compile: the motors of an open stream are never released, a
//! manual move follows no path, an engine that must be stopped plays nothing, only a stream pauses, waits for heat or
//! has an end. Not covered: the latched fault, which may occur in any of them.

/// State of the motors while nothing moves them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Standing {
    /// On the interpolator's pose; otherwise they stay where they are.
    pub(super) on_pose: bool,
    /// The drivers hold them.
    pub(super) held: bool,
}

impl Standing {
    /// As a stream leaves them.
    pub(super) const ON_PATH: Self = Self {
        on_pose: true,
        held: true,
    };

    /// Where they were left, on no pose.
    pub(super) const fn left(held: bool) -> Self {
        Self {
            on_pose: false,
            held,
        }
    }
}

/// What an open stream is to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Demand {
    /// Continue, except for requests to rest on the path.
    Go {
        /// A host does,
        pauses: bool,
        /// a heater that is not there yet does.
        heats: bool,
    },
    /// Come to rest on the path, then drop the stream.
    Leave,
}

impl Demand {
    /// No rest is requested.
    const MOVE: Self = Self::Go {
        pauses: false,
        heats: false,
    };

    /// True if nothing holds the stream.
    #[inline(always)]
    pub(super) fn moves(&self) -> bool {
        matches!(
            self,
            Self::Go {
                pauses: false,
                heats: false
            }
        )
    }
}

/// An open stream: its motors follow the path and are held.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Stream {
    pub(super) demand: Demand,
    /// All of it has arrived.
    pub(super) is_complete: bool,
}

impl Stream {
    /// Just begun.
    pub(super) const NEW: Self = Self {
        demand: Demand::MOVE,
        is_complete: false,
    };
}

/// What the motion is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum State {
    /// An open stream at rest until enough is queued, at its start or at a rest of the path,
    Filling(Stream),
    /// or in the middle of the path.
    Starved(Stream),
    /// An open stream that moves.
    Running(Stream),
    /// A stream ran to its end.
    Finished(Standing),
    /// A joint or melt moves by command: the motors are energised and follow no path.
    Jog {
        /// It was aborted and comes to rest.
        brakes: bool,
    },
    /// Nothing.
    Idle {
        standing: Standing,
        /// An aborted stream: the delayed targets of shapers and pressure advance are still to be
        /// executed.
        settles: bool,
    },
    /// A fault: nothing, and the engine must be stopped before its interval ends.
    Stopping {
        /// The drivers hold the motors, which follow nothing.
        held: bool,
        /// As above.
        settles: bool,
    },
}

impl State {
    /// Nothing was requested yet.
    pub(super) const NEW: Self = Self::idle(Standing::left(false));

    /// Nothing is in progress.
    pub(super) const fn idle(standing: Standing) -> Self {
        Self::Idle {
            standing,
            settles: false,
        }
    }

    /// Segment time flows.
    #[inline(always)]
    pub(super) fn runs(&self) -> bool {
        matches!(self, Self::Running(_))
    }

    /// The open stream.
    #[inline(always)]
    pub(super) fn stream(&self) -> Option<&Stream> {
        match self {
            Self::Filling(stream) | Self::Starved(stream) | Self::Running(stream) => Some(stream),
            _ => None,
        }
    }

    /// The same, to write to.
    #[inline(always)]
    pub(super) fn stream_mut(&mut self) -> Option<&mut Stream> {
        match self {
            Self::Filling(stream) | Self::Starved(stream) | Self::Running(stream) => Some(stream),
            _ => None,
        }
    }

    /// The open stream, where it rests.
    #[inline(always)]
    pub(super) fn waiting(&self) -> Option<&Stream> {
        match self {
            Self::Filling(stream) | Self::Starved(stream) => Some(stream),
            _ => None,
        }
    }

    /// The motors follow the interpolator's pose; otherwise they stay where they are.
    #[inline(always)]
    pub(super) fn follows_path(&self) -> bool {
        match self {
            Self::Filling(_) | Self::Starved(_) | Self::Running(_) => true,
            Self::Finished(standing) | Self::Idle { standing, .. } => standing.on_pose,
            Self::Jog { .. } | Self::Stopping { .. } => false,
        }
    }

    /// The drivers are to hold the motors.
    pub(super) fn holds_motors(&self) -> bool {
        match self {
            Self::Filling(_) | Self::Starved(_) | Self::Running(_) | Self::Jog { .. } => true,
            Self::Finished(standing) | Self::Idle { standing, .. } => standing.held,
            Self::Stopping { held, .. } => *held,
        }
    }

    /// An abort is in progress.
    #[inline(never)]
    pub(super) fn is_aborting(&self) -> bool {
        match self {
            Self::Filling(stream) | Self::Starved(stream) | Self::Running(stream) => {
                stream.demand == Demand::Leave
            }
            Self::Jog { brakes } => *brakes,
            Self::Idle { settles, .. } | Self::Stopping { settles, .. } => *settles,
            Self::Finished(_) => false,
        }
    }

    /// State of the motors, if nothing moves them.
    #[inline(always)]
    pub(super) fn standing_mut(&mut self) -> Option<&mut Standing> {
        match self {
            Self::Finished(standing) | Self::Idle { standing, .. } => Some(standing),
            _ => None,
        }
    }

    /// An abort: the present motion comes to rest.
    pub(super) fn abort(&mut self) {
        match self {
            Self::Idle { .. } | Self::Stopping { .. } => {}
            Self::Finished(standing) => {
                *self = Self::idle(*standing);
            }
            Self::Filling(stream) | Self::Starved(stream) | Self::Running(stream) => {
                stream.demand = Demand::Leave
            }
            Self::Jog { brakes } => *brakes = true,
        }
    }

    /// A fault that stops at once.
    pub(super) fn stop(&mut self) {
        *self = Self::Stopping {
            held: self.holds_motors(),
            settles: self.is_aborting(),
        };
    }

    /// The engine is stopped; false where it need not be.
    pub(super) fn take_stop(&mut self) -> bool {
        let Self::Stopping { held, settles } = *self else {
            return false;
        };
        *self = Self::Idle {
            standing: Standing::left(held),
            settles,
        };
        true
    }

    /// At rest after an abort or a fault: the stream or move is over. `is_at_rest`: all delayed
    /// targets are executed.
    #[inline(never)]
    pub(super) fn leave(&mut self, is_at_rest: bool) {
        let still_settles = self.is_aborting() && !is_at_rest;
        if let Self::Stopping { settles, .. } = self {
            *settles = still_settles;
            return;
        }
        *self = Self::Idle {
            standing: Standing {
                on_pose: self.follows_path(),
                held: self.holds_motors(),
            },
            settles: still_settles,
        };
    }
}

#[cfg(test)]
mod tests {
    //! Goal: what was asked for of a stream and of the motors outlasts what it must, and no more. Method: sequences of
    //! events against what they leave, by hand.
    use super::*;

    #[test]
    fn an_aborted_stream_settles_on_its_pose() {
        let mut state = State::Running(Stream::NEW);
        state.abort();
        assert!(state.is_aborting() && state.follows_path());
        state.leave(false);
        assert!(state.is_aborting() && state.follows_path() && state.holds_motors());
        state.leave(true);
        assert_eq!(state, State::idle(Standing::ON_PATH));
    }

    #[test]
    fn a_stop_is_taken_once_and_outlasts_ticks_before_that() {
        for mut state in [
            State::NEW,
            State::Running(Stream::NEW),
            State::Jog { brakes: true },
            State::Finished(Standing::default()),
        ] {
            let (held, aborting) = (state.holds_motors(), state.is_aborting());
            state.stop();
            state.leave(false);
            assert_eq!(state.is_aborting(), aborting);
            assert!(!state.follows_path());
            assert!(state.take_stop() && !state.take_stop());
            assert_eq!(
                (state.holds_motors(), state.is_aborting()),
                (held, aborting)
            );
        }
    }
}
