//! Plays queued spans: segment time -> channels, as f32 offsets from integer bases in motor steps.
//!
//! Segment time is counted in 2^-16 servo ticks, so a path rate of 1 stays on whole ticks and
//! meets every knot exactly. At the end of a span that rests, the offset is exactly 0 and the base
//! is the control point itself. The next span is prepared in [`PARTS`] parts, one in each servo
//! tick that begins none, so that no tick has all of the work; what is left when the present span
//! ends is done then. When it is done changes nothing in the result.

use crate::carriers::Carriers;
use crate::configuration::MOTORS_MAX;
use crate::load::SpanLoad;
use crate::queue::{Ceiling, KnotQueue};
use crate::spline::{SpanShape, SpanWeights};
use crate::steps::{ScaledUnits, Target};
use headway_protocol::units::{CHANNEL_TILT_X, CHANNEL_TILT_Y, CHANNELS, ChannelPoint};

/// Cubics of the channels, and one more that is always 0, for joints that follow none: a power of
/// two, so that a masked index needs no check.
const CUBICS: usize = (CHANNELS + 1).next_power_of_two();
/// One servo tick of segment time.
pub const TICK_Q16: u32 = 1 << 16;
/// Parts in which a span is prepared: less than the planner's shortest span has ticks (6).
const PARTS: u8 = 5;
/// Spans that one servo tick can pass at most: at twice the planned rate two of one tick each, and
/// the one it began in.
const SPANS_PER_TICK_MAX: usize = 3;

/// A span, ready to be played.
#[derive(Clone, Copy, Debug)]
struct ReadySpan {
    /// c0..c3 of each channel: offsets from the base, channel units and servo ticks.
    coefficients: [[f32; 4]; CUBICS],
    /// The base as the motors' carriers have it.
    bases: [ScaledUnits; MOTORS_MAX],
    /// The same as targets.
    anchors: [Target; MOTORS_MAX],
    /// The base of the tilt, µrad.
    tilt_base: [i32; 2],
    load: SpanLoad,
    duration_q16: u32,
    ends_at_rest: bool,
}

/// Where the channels are above their bases at one moment. Evaluated channel by channel, because
/// not every machine needs all.
#[derive(Clone, Copy, Debug)]
pub struct Offset<'a> {
    coefficients: &'a [[f32; 4]; CUBICS],
    /// Servo ticks of segment time since the span's start.
    t: f32,
}

impl Offset<'_> {
    /// One channel in its units; [`CHANNELS`] for none, which is 0.
    #[inline(always)]
    pub fn of(&self, channel: usize) -> f32 {
        let [c0, c1, c2, c3] = self.coefficients[channel % CUBICS];
        ((c3 * self.t + c2) * self.t + c1) * self.t + c0
    }
}

/// The playing side of the motion.
#[derive(Clone, Debug)]
pub struct Interpolator {
    carriers: Carriers,
    /// The present span and the next.
    spans: [ReadySpan; 2],
    /// Which of them is present.
    second: bool,
    /// Parts of the next span that are ready.
    parts: u8,
    /// Shape of the newest span of which a part is ready, and what its durations say.
    shape: SpanShape,
    weights: SpanWeights<f32>,
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
    pub fn at_rest(carriers: &Carriers, start: &ChannelPoint) -> Self {
        let shape = SpanShape::at_rest(start);
        let bases = carriers.scaled(start);
        let span = ReadySpan {
            coefficients: [[0.0; 4]; CUBICS],
            bases,
            anchors: bases.map(|base| Target::of_position(base.position)),
            tilt_base: [start[CHANNEL_TILT_X], start[CHANNEL_TILT_Y]],
            load: SpanLoad::REST,
            duration_q16: 0,
            ends_at_rest: true,
        };
        Self {
            carriers: *carriers,
            spans: [span; 2],
            second: false,
            parts: 0,
            weights: shape.weights(),
            shape,
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

    #[inline(always)]
    fn present(&self) -> &ReadySpan {
        &self.spans[usize::from(self.second)]
    }

    /// Where the motors' carriers are at the base.
    #[inline]
    pub fn anchors(&self) -> &[Target; MOTORS_MAX] {
        &self.present().anchors
    }

    /// Position of a motor's carrier at the base, 2^-31 steps.
    #[inline]
    pub fn base_position(&self, motor: usize) -> i64 {
        self.present().bases[motor % MOTORS_MAX].position
    }

    /// Integer part of the tilt vector, µrad.
    #[inline]
    pub fn tilt_base(&self) -> [i32; 2] {
        self.present().tilt_base
    }

    /// The present pose's offset from its base.
    #[inline]
    pub fn offset(&self) -> Offset<'_> {
        Offset {
            coefficients: &self.present().coefficients,
            // Below 2^24 (256 ticks) the conversion is exact.
            t: self.local_q16 as f32 * (1.0 / TICK_Q16 as f32),
        }
    }

    /// Demands of the present span.
    pub fn load(&self) -> &SpanLoad {
        &self.present().load
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
    #[inline]
    pub fn begin_next(&mut self, queue: &mut KnotQueue) -> bool {
        if self.playing && self.remaining_q16() > 0 {
            return false;
        }
        self.begin(queue)
    }

    fn begin(&mut self, queue: &mut KnotQueue) -> bool {
        while self.parts < PARTS {
            if !self.prepare(queue) {
                return false;
            }
        }
        queue.pop();
        self.parts = 0;
        self.second = !self.second;
        self.completed_ticks += u64::from(self.duration_q16 >> 16);
        self.playing = true;
        self.spans_begun = self.spans_begun.wrapping_add(1);
        self.local_q16 = 0;
        self.duration_q16 = self.present().duration_q16;
        self.rests_at_start = self.rests_at_end;
        self.rests_at_end = self.present().ends_at_rest;
        self.dwells = self.rests_at_start && self.rests_at_end;
        true
    }

    /// Prepares one part of the next span; false if none waits.
    #[inline]
    pub fn prepare(&mut self, queue: &KnotQueue) -> bool {
        let [first, second] = &mut self.spans;
        let (next, present) = if self.second {
            (first, &*second)
        } else {
            (second, &*first)
        };
        match self.parts {
            0 => {
                let Some(waiting) = queue.front() else {
                    return false;
                };
                self.shape.push(&waiting.knot);
                self.weights = self.shape.weights();
                let base = self.shape.base();
                next.tilt_base = [base[CHANNEL_TILT_X], base[CHANNEL_TILT_Y]];
                next.load = waiting.load;
                next.duration_q16 = u32::from(waiting.span_ticks) << 16;
                next.ends_at_rest = waiting.ends_at_rest;
            }
            1 => next.lay([0, 1, 2], &self.shape, &self.weights),
            2 => next.lay([3, 4, 5], &self.shape, &self.weights),
            3 => {
                next.lay([6], &self.shape, &self.weights);
                next.follow([0, 1], &self.carriers, &self.shape, present);
            }
            4 => next.follow([2, 3, 4, 5, 6, 7], &self.carriers, &self.shape, present),
            _ => return true,
        }
        self.parts += 1;
        true
    }

    /// True if the next span can begin at once.
    pub fn is_prepared(&self) -> bool {
        self.parts >= PARTS
    }

    /// Forgets what was prepared of a span that will not come. Only before a new start.
    pub fn forget_next(&mut self) {
        self.parts = 0;
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
            if !self.begin(queue) {
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
            self.spans[usize::from(self.second)].coefficients = [[0.0; 4]; CUBICS];
        }
    }
}

impl ReadySpan {
    /// Moves the bases of some motors from those of the span before.
    #[inline(always)]
    fn follow<const N: usize>(
        &mut self,
        motors: [usize; N],
        carriers: &Carriers,
        shape: &SpanShape,
        before: &ReadySpan,
    ) {
        for motor in motors {
            let (bases, anchors) = (&mut self.bases, &mut self.anchors);
            carriers.advance(motor, shape, &before.bases, bases, anchors);
        }
    }

    #[inline(always)]
    fn lay<const N: usize>(
        &mut self,
        channels: [usize; N],
        shape: &SpanShape,
        weights: &SpanWeights<f32>,
    ) {
        for channel in channels {
            self.coefficients[channel] = shape.cubic(channel, weights);
        }
    }
}
