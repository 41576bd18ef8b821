//! How a stream is left that somebody ends: a board that waits for heat must not go on cold once its heaters are off.
//!
//! In: the conversation, the board's last state and its spans done. Out: what the board is told before its heaters go
//! off, and the words for whoever ended it. Not covered: switching off (`operator.rs`).

use crate::cli::board::talk::ENDED;
use crate::drive::sender_state::SenderState;
use crate::job::LEAD_IN_SPANS;
use headway_protocol::message::{Control, DeviceState};

/// The command before the heaters go off, if any, and why the stream ends.
pub(crate) fn leave(
    sender: &SenderState,
    board: Option<(DeviceState, u32)>,
) -> (Option<Control>, &'static str) {
    let streams = matches!(sender, SenderState::Streaming | SenderState::Finishing);
    match board {
        _ if !streams => (None, ENDED),
        Some((DeviceState::Heating, spans)) if spans as usize <= LEAD_IN_SPANS => {
            (Some(Control::Abort), NOTHING_LEFT)
        }
        Some((DeviceState::Heating, _)) => (Some(Control::Pause), PAUSED),
        _ => (None, LEFT),
    }
}

const NOTHING_LEFT: &str =
    "ended: the heaters go off, and there is nothing to go on with; start it again";
const PAUSED: &str =
    "left while it heats: the heaters go off, the job is paused; go on with --resume, and `resume`";
const LEFT: &str = "left: the heaters go off, the board comes to rest on the path when its queue is empty; go on with \
                    --resume";

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drive::sender_state::SenderState::{Aborted, Finishing, Greeting, Streaming};

    /// Goal: nobody is told to go on where nothing can be gone on with, and no path goes on cold. Method: a person who
    /// ends it in each state.
    #[test]
    fn what_is_left_while_it_heats_does_not_go_on_cold() {
        let heating = |spans| Some((DeviceState::Heating, spans));
        let running = Some((DeviceState::Running, 7));
        let abort = (Some(Control::Abort), NOTHING_LEFT);
        for (sender, board, expected) in [
            (Greeting, None, (None, ENDED)),
            (Aborted, running, (None, ENDED)),
            (Streaming, None, (None, LEFT)),
            (Streaming, running, (None, LEFT)),
            (Streaming, heating(0), abort),
            (Finishing, heating(2), abort),
            (Finishing, heating(40), (Some(Control::Pause), PAUSED)),
        ] {
            assert_eq!(leave(&sender, board), expected, "{sender:?} {board:?}");
        }
    }
}
