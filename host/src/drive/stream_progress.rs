//! Progress of a streamed job: finished spans -> time left, layer, pass, tip speed.

use crate::job::{MotionState, SegmentStream};
use headway_protocol::message::Status;
use headway_protocol::units::{CHANNEL_X, CHANNEL_Y, CHANNEL_Z};

/// Progress of a job at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
    /// Share of the job's time that is done, 0..=1.
    pub done: f64,
    /// Time left at the present rate; `None` while the head rests.
    pub left_s: Option<f64>,
    /// Layer from 0.
    pub layer: u32,
    /// Pass from 0; `None` off the passes.
    pub pass: Option<u32>,
    /// What the head does.
    pub state: MotionState,
    /// Speed of the tip.
    pub tip_mm_s: f64,
    /// Where that is, machine coordinates, to a span.
    pub at_mm: [f32; 3],
}

/// A job's times and speeds, for queries.
#[derive(Clone, Debug)]
pub struct Timeline {
    /// End of each span, servo ticks.
    ends: Vec<u64>,
    /// Tip speed in the middle of each span at the planned rate, and the tip at its start.
    tips: Vec<(f32, [f32; 3])>,
    marks: Vec<crate::job::Mark>,
    servo_hz: f64,
}

impl Timeline {
    /// Of a stream.
    pub fn new(stream: &SegmentStream, servo_hz: f64) -> Timeline {
        let mut ends = Vec::with_capacity(stream.knots.len());
        let mut tips = Vec::with_capacity(stream.knots.len());
        for span in stream.spans() {
            let duration = f64::from(span.duration_ticks);
            let rate = span.velocity(0.5 * duration, servo_hz);
            let tip = rate[CHANNEL_X..=CHANNEL_Z]
                .iter()
                .map(|v| v * v)
                .sum::<f64>()
                .sqrt();
            ends.push(span.start_tick + u64::from(span.duration_ticks));
            let start = span.position(0.0);
            let at_mm = [CHANNEL_X, CHANNEL_Y, CHANNEL_Z].map(|channel| start[channel] as f32);
            tips.push((tip as f32, at_mm));
        }
        Timeline {
            ends,
            tips,
            marks: stream.marks.clone(),
            servo_hz,
        }
    }

    /// Layers of the job.
    pub fn layers(&self) -> u32 {
        self.marks.last().map_or(1, |mark| mark.layer + 1)
    }

    /// The complete job's time at the planned rate.
    pub fn duration_s(&self) -> f64 {
        self.ends.last().map_or(0.0, |&end| end as f64) / self.servo_hz
    }

    /// The servo tick up to which a machine with this status is done, in complete spans.
    pub fn done_tick(&self, status: &Status) -> u64 {
        let Some(last) = (status.spans_done as usize).checked_sub(1) else {
            return 0;
        };
        let end = self.ends.get(last).or(self.ends.last());
        end.copied().unwrap_or(0)
    }

    /// Where a machine with this status is.
    pub fn at(&self, status: &Status) -> Progress {
        let spans = (status.spans_done as usize).min(self.tips.len().saturating_sub(1));
        let (tip_mm_s, at_mm) = self.tips.get(spans).copied().unwrap_or_default();
        let tick = self.done_tick(status);
        let total = self.ends.last().copied().unwrap_or(0);
        let rate = f64::from(status.sigma_permille) / 1000.0;
        let left_s = total.saturating_sub(tick) as f64 / self.servo_hz;
        let mark = self.marks.partition_point(|mark| mark.end_tick <= tick);
        let mark = self.marks.get(mark).or(self.marks.last());
        Progress {
            done: tick as f64 / total.max(1) as f64,
            left_s: (rate > 0.0).then(|| left_s / rate),
            layer: mark.map_or(0, |mark| mark.layer),
            pass: mark.and_then(|mark| mark.pass),
            state: mark.map_or(MotionState::Hold, |mark| mark.state),
            tip_mm_s: f64::from(tip_mm_s) * rate,
            at_mm,
        }
    }
}
