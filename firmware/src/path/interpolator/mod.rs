//! Plays queued spans: segment time -> motors, as f32 offsets in steps from exact integer bases.
//!
//! Segment time is counted in 2^-16 servo ticks, so a path rate of 1 stays on whole ticks and meets
//! every knot exactly. At the end of a span that rests, the offset is exactly 0 and the base is the
//! control point itself. The polynomials of coming spans are computed in advance, in the main loop of
//! a board ([`Interpolator::prepare_next`]); a servo tick computes them only if that is late. The
//! time of this computation does not affect the result.

mod ready_span;

use crate::configuration::MOTORS_MAX;
use crate::design::{CEILING_OPEN, SPANS_AHEAD};
use crate::path::joint_channels::JointChannels;
use crate::path::load::SpanLoad;
use crate::path::queue::{Ceiling, KnotQueue};
use crate::path::spline::SpanShape;
use crate::steps::ScaledUnits;
use headway_protocol::units::ChannelPoint;
use ready_span::ReadySpan;
pub use ready_span::{Offset, RestPose};

/// One servo tick of segment time.
pub const TICK_Q16: u32 = 1 << 16;
/// Spans that one servo tick can pass at most: at twice the planned rate two of one tick each, and
/// the one it began in.
const SPANS_PER_TICK_MAX: usize = 3;
/// The present span and those that are ready: a power of two, so that a place in the ring is a mask.
const SPANS: usize = (SPANS_AHEAD + 1).next_power_of_two();

/// What the ceiling at the present span's end means for a steady path rate of up to 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outlook {
    /// Not checked since the span began: the tick that begins one has enough work.
    Unknown,
    /// It limits nothing.
    Open,
    /// No limit within the span: up to 1 a ceiling only rises towards a span's start, so that its value
    /// at the end is valid in all of it.
    OpenToEnd,
    /// It may.
    Limited,
}

/// The playing side of the motion.
#[derive(Clone, Debug)]
// Fields that every tick uses are first.
#[repr(C)]
pub struct Interpolator {
    local_q16: u32,
    duration_q16: u32,
    /// Which of the spans is present.
    place: usize,
    /// A span is being played; otherwise the head rests before knot 0.
    playing: bool,
    rests_at_end: bool,
    rests_at_start: bool,
    dwells: bool,
    /// Of the ceiling at the present span's end.
    outlook: Outlook,
    /// Spans begun since the stream's start.
    spans_begun: u32,
    /// How many are ready after the present one: the first of those that wait.
    ready: usize,
    /// Segment time of the spans completed, servo ticks.
    completed_ticks: u64,
    /// The present span and those that are ready, in a ring.
    spans: [ReadySpan; SPANS],
    /// Shape of the newest span that is ready.
    shape: SpanShape,
    /// Its bases.
    bases: [ScaledUnits; MOTORS_MAX],
    joint_channels: JointChannels,
}

impl Interpolator {
    /// At rest on the origin.
    pub fn new(joint_channels: &JointChannels) -> Self {
        let origin = ChannelPoint::default();
        Self {
            spans: [ReadySpan::at_rest(joint_channels, &origin); SPANS],
            place: 0,
            ready: 0,
            joint_channels: joint_channels.clone(),
            bases: joint_channels.scaled(&origin),
            shape: SpanShape::at_rest(&origin),
            playing: false,
            outlook: Outlook::Open,
            local_q16: 0,
            duration_q16: 0,
            spans_begun: 0,
            completed_ticks: 0,
            rests_at_end: true,
            rests_at_start: true,
            dwells: true,
        }
    }

    /// Restarts at rest on `start`, in the units of `joint_channels`. In place, because it is too large for a
    /// stack.
    pub fn start_at(&mut self, start: &ChannelPoint, joint_channels: &JointChannels) {
        self.joint_channels = joint_channels.clone();
        self.shape = SpanShape::at_rest(start);
        self.bases = self.joint_channels.scaled(start);
        self.place = 0;
        self.ready = 0;
        self.spans[0] = ReadySpan::at_rest(joint_channels, start);
        self.playing = false;
        self.outlook = Outlook::Open;
        self.local_q16 = 0;
        self.duration_q16 = 0;
        self.spans_begun = 0;
        self.completed_ticks = 0;
        self.rests_at_end = true;
        self.rests_at_start = true;
        self.dwells = true;
    }

    #[inline(always)]
    fn present(&self) -> &ReadySpan {
        &self.spans[self.place % SPANS]
    }

    /// The present pose's offset from its base.
    #[inline]
    pub fn offset(&self) -> Offset<'_> {
        // Below 2^24 (256 ticks) the conversion is exact.
        let t = self.local_q16 as f32 * (1.0 / TICK_Q16 as f32);
        self.present().at(t)
    }

    /// Demands of the present span.
    pub fn load(&self) -> &SpanLoad {
        &self.present().load
    }

    /// Spans begun since the stream's start, and whole ticks since the current one's start.
    #[inline]
    pub fn spans_and_ticks(&self) -> (u32, u16) {
        (self.spans_begun, (self.local_q16 >> 16) as u16)
    }

    /// Spans completed since the stream's start.
    pub fn spans_done(&self) -> u32 {
        if self.playing && self.remaining_q16() > 0 {
            self.spans_begun - 1
        } else {
            self.spans_begun
        }
    }

    /// Segment time since the stream's start, 2^-16 servo ticks.
    pub fn segment_time_q16(&self) -> u64 {
        (self.completed_ticks << 16) + u64::from(self.local_q16)
    }

    /// Segment time left in the present span, 2^-16 servo ticks.
    pub fn remaining_q16(&self) -> u32 {
        self.duration_q16 - self.local_q16
    }

    /// True if nothing moves during the current span, or none has begun.
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

    /// To be called when ceilings of the queue have changed.
    // Its registers are not to be those of all ticks.
    #[inline(never)]
    pub fn look_at_ceilings(&mut self, queue: &KnotQueue) {
        let stop = self.ceiling_at_end(queue).stop;
        self.outlook = if stop >= CEILING_OPEN {
            Outlook::Open
        } else if stop >= 1.0 && !queue.is_short() {
            Outlook::OpenToEnd
        } else {
            Outlook::Limited
        };
    }

    /// True if no ceiling limits a tick at a steady rate of up to 1.
    #[inline(always)]
    pub fn is_free(&mut self, rate_q16: u32, queue: &KnotQueue) -> bool {
        if self.outlook == Outlook::Unknown {
            self.look_at_ceilings(queue);
        }
        match self.outlook {
            Outlook::Open => true,
            Outlook::OpenToEnd => rate_q16 <= self.remaining_q16(),
            Outlook::Limited | Outlook::Unknown => false,
        }
    }

    /// Begins the next span if the current one is over and one is queued, so that its dwell or load
    /// is known before the head moves. True if a span was begun.
    #[inline]
    pub fn begin_next(&mut self, queue: &mut KnotQueue) -> bool {
        self.remaining_q16() == 0 && self.begin_from_rest(queue)
    }

    // As for `cross`.
    #[inline(never)]
    fn begin_from_rest(&mut self, queue: &mut KnotQueue) -> bool {
        self.begin(queue)
    }

    #[inline(always)]
    fn begin(&mut self, queue: &mut KnotQueue) -> bool {
        if self.ready == 0 && !self.prepare_next(queue) {
            return false;
        }
        queue.pop();
        self.ready -= 1;
        self.place = (self.place + 1) % SPANS;
        self.completed_ticks += u64::from(self.duration_q16 >> 16);
        self.playing = true;
        self.spans_begun = self.spans_begun.wrapping_add(1);
        self.local_q16 = 0;
        self.duration_q16 = self.present().duration_q16;
        self.rests_at_start = self.rests_at_end;
        self.rests_at_end = self.present().ends_at_rest;
        self.dwells = self.rests_at_start && self.rests_at_end;
        self.outlook = Outlook::Unknown;
        true
    }

    /// Lays the first of the waiting spans that is not ready, if fewer than [`SPANS_AHEAD`] are; true
    /// if it did.
    #[inline(never)]
    pub fn prepare_next(&mut self, queue: &KnotQueue) -> bool {
        if self.ready >= SPANS_AHEAD {
            return false;
        }
        let Some(waiting) = queue.get(self.ready) else {
            return false;
        };
        self.shape.push(&waiting.knot);
        let next = &mut self.spans[(self.place + 1 + self.ready) % SPANS];
        next.lay(waiting, &self.joint_channels, &self.shape, &mut self.bases);
        self.ready += 1;
        true
    }

    /// True if the next span can begin at once.
    pub fn is_prepared(&self) -> bool {
        self.ready > 0
    }

    /// Drops prepared spans that will not be executed. Only before a new start.
    pub fn forget_next(&mut self) {
        self.ready = 0;
    }

    /// Advances segment time, over as many spans as necessary.
    #[inline(always)]
    pub fn advance(&mut self, step_q16: u32, queue: &mut KnotQueue) {
        if step_q16 < self.remaining_q16() {
            self.local_q16 += step_q16;
        } else {
            self.cross(step_q16, queue);
        }
    }

    // Few ticks end in another span: its registers are not to be theirs.
    #[inline(never)]
    fn cross(&mut self, mut step_q16: u32, queue: &mut KnotQueue) {
        for _ in 0..SPANS_PER_TICK_MAX {
            step_q16 -= self.remaining_q16();
            self.local_q16 = self.duration_q16;
            if !self.begin(queue) {
                // The path ends here, at rest or (starved) with the rate at zero.
                self.settle();
                return;
            }
            if step_q16 < self.duration_q16 {
                self.local_q16 = step_q16;
                return;
            }
        }
    }

    /// Makes the end of a span that rests exact.
    fn settle(&mut self) {
        if self.rests_at_end {
            self.spans[self.place % SPANS].stay_on_base();
        }
    }
}
