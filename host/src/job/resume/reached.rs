//! The progress of a job according to the log of its stream.
//!
//! In: the contents of a log (`drive::log_place`), the job. Out: servo ticks of the job. The log of a resumed job
//! counts from the point where it was resumed. Not covered: reading the log.

use super::rest::{pass_at, rest_of};
use crate::job::SegmentStream;
use crate::job::frames::WireFrames;
use crate::text::refusal::{Refusal, refusal};
use headway_firmware::design::LINE_TICKS;

/// The last stream of a log.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LoggedStream {
    /// Identity of the stream.
    pub job: u32,
    /// The job that it resumed, and the pass from which it did.
    pub rest_of: Option<(u32, u32)>,
    /// Spans that the board has reported as done.
    pub spans_done: u32,
    /// Frames that were sent: the board may have them all.
    pub frames_sent: u32,
    /// The board has reported the end.
    pub finished: bool,
    /// The flow override that the board reported last.
    pub flow_percent: Option<u16>,
    /// The log ends within a line.
    pub is_torn: bool,
    /// The stream continued after the end of the log (as its last line states).
    pub went_on: bool,
}

/// Targets wait in a line before they are steps: a span that is done may not be printed yet for that long, at
/// twice the planned rate.
const BEHIND_TICKS: u64 = 2 * LINE_TICKS as u64;

/// How far, servo ticks of the job.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Reached {
    /// The board has reported that it is done up to here.
    pub done_tick: u64,
    /// It was sent up to here, and may have printed that.
    pub sent_tick: u64,
}

impl Reached {
    /// By the last stream of a log.
    ///
    /// # Errors
    /// [`Refusal`].
    pub fn of(
        logged: &LoggedStream,
        stream: &SegmentStream,
        frames: &WireFrames,
    ) -> Result<Reached, Refusal> {
        let given = frames.job();
        let foreign = |logged| {
            Err(refusal!(
                "this is the log of job {logged:08x}, and the job given is {given:08x}: give the \
             job file that was printed then, and the same --mesh"
            ))
        };
        let [done, sent] = match logged.rest_of {
            Some((job, _)) if job != given => return foreign(job),
            Some((_, pass)) => {
                let rest = rest_of(stream, &[], pass)?;
                let frames = WireFrames::encode(&rest.stream)?;
                if logged.job != frames.job() {
                    return foreign(logged.job);
                }
                let of_job = |tick: u64| tick.saturating_sub(rest.lead_ticks) + rest.cut_tick;
                ticks_of(logged, &rest.stream, &frames).map(of_job)
            }
            None if logged.job != given => return foreign(logged.job),
            None => ticks_of(logged, stream, frames),
        };
        let end = stream.marks.last().map_or(0, |mark| mark.end_tick);
        Ok(Reached {
            done_tick: if logged.finished {
                end + BEHIND_TICKS
            } else {
                done
            },
            sent_tick: sent,
        })
    }

    /// The incomplete pass; between two passes the next one.
    ///
    /// # Errors
    /// A `Refusal`.
    pub fn pass(&self, stream: &SegmentStream) -> Result<u32, Refusal> {
        pass_at(stream, self.done_tick.saturating_sub(BEHIND_TICKS))
    }
}

/// The progress in a log, as ticks of its stream: done, and sent.
fn ticks_of(logged: &LoggedStream, stream: &SegmentStream, frames: &WireFrames) -> [u64; 2] {
    let sent = match logged.frames_sent.checked_sub(1) {
        Some(last) => frames.totals_after(last as usize).0,
        None => 0,
    };
    let mut ticks = [0, 0];
    for span in stream.spans() {
        let end = span.start_tick + u64::from(span.duration_ticks);
        for (tick, spans) in ticks.iter_mut().zip([logged.spans_done, sent]) {
            if span.index < spans as usize {
                *tick = end;
            }
        }
    }
    ticks
}
