//! Plays queued spans: segment time -> channels, as an exact integer base plus an f32 offset.
//!
//! Segment time is counted in 2^-16 servo ticks, so a path rate of 1 stays on whole ticks and
//! meets every knot exactly. At the end of a span that rests, the offset is exactly 0 and the base
//! is the control point itself.

use crate::load::SpanLoad;
use crate::queue::{Ceiling, KnotQueue};
use crate::spline::{SpanPolynomial, SpanWindow};
use headway_protocol::units::{CHANNELS, ChannelPoint};

/// One servo tick of segment time.
pub const TICK_Q16: u32 = 1 << 16;
/// Spans that one servo tick can pass at most: at twice the planned rate two of one tick each, and
/// the one it began in.
const SPANS_PER_TICK_MAX: usize = 3;

/// The playing side of the motion.
#[derive(Clone, Debug)]
pub struct Interpolator {
    window: SpanWindow,
    polynomial: SpanPolynomial<f32>,
    load: SpanLoad,
    /// A span is being played; otherwise the head rests before knot 0.
    playing: bool,
    local_q16: u32,
    duration_q16: u32,
    /// Spans begun since the stream's start.
    spans_begun: u32,
    /// Segment time of the spans completed, servo ticks.
    completed_ticks: u64,
    rests_at_end: bool,
    rests_at_start: bool,
    dwells: bool,
}

impl Interpolator {
    /// At rest on `start`.
    pub fn at_rest(start: &ChannelPoint) -> Self {
        Self {
            window: SpanWindow::at_rest(start),
            polynomial: SpanPolynomial::zero(),
            load: SpanLoad::REST,
            playing: false,
            local_q16: 0,
            duration_q16: 0,
            spans_begun: 0,
            completed_ticks: 0,
            rests_at_end: true,
            rests_at_start: true,
            dwells: true,
        }
    }

    /// Integer part of the present pose, channel units, unwrapped.
    pub fn base(&self) -> &[i64; CHANNELS] {
        self.window.base()
    }

    /// Offset of the present pose from its base, channel units.
    #[inline]
    pub fn offset(&self) -> [f32; CHANNELS] {
        // Below 2^24 (256 ticks) the conversion is exact.
        let t = self.local_q16 as f32 * (1.0 / TICK_Q16 as f32);
        self.polynomial.offset(t)
    }

    /// Demands of the present span.
    pub fn load(&self) -> &SpanLoad {
        &self.load
    }

    /// Index of the present span, `None` before the first.
    pub fn span(&self) -> Option<u32> {
        self.spans_begun.checked_sub(1)
    }

    /// Spans completed since the stream's start.
    pub fn spans_done(&self) -> u32 {
        if self.playing && self.remaining_q16() > 0 {
            self.spans_begun - 1
        } else {
            self.spans_begun
        }
    }

    /// Whole ticks since the present span's start.
    pub fn local_ticks(&self) -> u16 {
        (self.local_q16 >> 16) as u16
    }

    /// Segment time since the stream's start, 2^-16 servo ticks.
    pub fn segment_time_q16(&self) -> u64 {
        (self.completed_ticks << 16) + u64::from(self.local_q16)
    }

    /// Segment time left in the present span, 2^-16 servo ticks.
    pub fn remaining_q16(&self) -> u32 {
        self.duration_q16 - self.local_q16
    }

    /// True if nothing moves during the present span, or none has begun.
    pub fn is_dwell(&self) -> bool {
        self.dwells
    }

    /// True where velocity and acceleration are zero: a dwell, or a place between spans at rest.
    pub fn is_at_rest_point(&self) -> bool {
        self.is_dwell()
            || (self.local_q16 == 0 && self.rests_at_start)
            || (self.remaining_q16() == 0 && self.rests_at_end)
    }

    /// True if the present span ends at rest.
    pub fn ends_at_rest(&self) -> bool {
        self.rests_at_end
    }

    /// sigma² allowed where the present span ends.
    pub fn ceiling_at_end(&self, queue: &KnotQueue) -> Ceiling {
        if self.rests_at_end {
            Ceiling::OPEN
        } else {
            queue.front().map_or(Ceiling::END, |next| next.ceiling)
        }
    }

    /// Begins the next span if the present one is over and one waits, so that its dwell or load is
    /// known before the head moves. True if a span was begun.
    pub fn begin_next(&mut self, queue: &mut KnotQueue) -> bool {
        if self.playing && self.remaining_q16() > 0 {
            return false;
        }
        let Some(next) = queue.pop() else {
            return false;
        };
        self.completed_ticks += u64::from(self.duration_q16 >> 16);
        self.window.push(&next.knot);
        self.playing = true;
        self.spans_begun = self.spans_begun.wrapping_add(1);
        self.local_q16 = 0;
        self.duration_q16 = u32::from(self.window.duration_ticks()) << 16;
        self.load = next.load;
        self.rests_at_start = self.rests_at_end;
        self.rests_at_end = next.ends_at_rest;
        self.dwells = self.rests_at_start && self.rests_at_end;
        self.polynomial = self.window.polynomial();
        true
    }

    /// Moves segment time on, through as many spans as it takes. True if the base has changed.
    pub fn advance(&mut self, mut step_q16: u32, queue: &mut KnotQueue) -> bool {
        let mut changed = false;
        for _ in 0..SPANS_PER_TICK_MAX {
            let remaining = self.remaining_q16();
            if step_q16 < remaining {
                self.local_q16 += step_q16;
                return changed;
            }
            step_q16 -= remaining;
            self.local_q16 = self.duration_q16;
            if !self.begin_next(queue) {
                // The path ends here, at rest or (starved) with the rate at zero.
                self.settle();
                return changed;
            }
            changed = true;
        }
        changed
    }

    /// Makes the end of a span that rests exact.
    fn settle(&mut self) {
        if self.rests_at_end {
            self.polynomial = SpanPolynomial::zero();
        }
    }
}
