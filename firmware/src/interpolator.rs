//! Plays queued spans: segment time -> motors, as f32 offsets in steps from exact integer bases.
//!
//! Segment time is counted in 2^-16 servo ticks, so a path rate of 1 stays on whole ticks and
//! meets every knot exactly. At the end of a span that rests, the offset is exactly 0 and the base
//! is the control point itself. The polynomials of the spans to come are laid beforehand, in the main
//! loop of a board ([`Interpolator::prepare_next`]); a servo tick does it itself only where that is
//! late. When it is done changes nothing in the result.

use crate::carriers::{Carrier, Carriers};
use crate::configuration::MOTORS_MAX;
use crate::design::{CEILING_OPEN, SPANS_AHEAD};
use crate::load::SpanLoad;
use crate::queue::{Ceiling, KnotQueue};
use crate::real::Real;
use crate::spline::{SpanShape, SpanWeights};
use crate::steps::{NEAR_STEPS_MAX, ScaledUnits, Target};
use headway_protocol::units::{
    CHANNEL_HEADING, CHANNEL_TILT_X, CHANNEL_TILT_Y, CHANNEL_X, CHANNEL_Y, CHANNEL_Z, ChannelPoint,
    UNITS_PER_NATURAL,
};

/// One servo tick of segment time.
pub const TICK_Q16: u32 = 1 << 16;
/// Spans that one servo tick can pass at most: at twice the planned rate two of one tick each, and
/// the one it began in.
const SPANS_PER_TICK_MAX: usize = 3;
/// The present span and those that are ready: a power of two, so that a place in the ring is a mask.
const SPANS: usize = (SPANS_AHEAD + 1).next_power_of_two();

/// c0..c3 of a cubic in servo ticks.
type Cubic = [f32; 4];

/// What a span asks of one motor. One address reaches all of it.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
struct MotorSpan {
    /// Steps from the base; 0 for joints that follow no channel.
    cubic: Cubic,
    /// The base as a target.
    anchor: Target,
}

/// A span, ready to be played.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
struct ReadySpan {
    motors: [MotorSpan; MOTORS_MAX],
    /// The tilt from its base, µrad; not on machines that do not tilt.
    tilt: [Cubic; 2],
    tilt_base: [i32; 2],
    /// Tip and heading from their base, mm and rad; only on machines whose joints follow them.
    place: [Cubic; PLACE_CHANNELS.len()],
    place_base: [f32; PLACE_CHANNELS.len()],
    load: SpanLoad,
    duration_q16: u32,
    ends_at_rest: bool,
    /// Some motor may get further than [`NEAR_STEPS_MAX`] from its base; so of machines whose joints follow
    /// more than a channel.
    is_far: bool,
}

impl ReadySpan {
    fn at_rest(bases: &[ScaledUnits; MOTORS_MAX], start: &ChannelPoint) -> Self {
        Self {
            motors: bases.map(|base| MotorSpan::at_rest(base.position)),
            tilt: [[0.0; 4]; 2],
            tilt_base: [start[CHANNEL_TILT_X], start[CHANNEL_TILT_Y]],
            place: [[0.0; 4]; PLACE_CHANNELS.len()],
            place_base: PLACE_CHANNELS.map(|channel| place_of(start, channel)),
            load: SpanLoad::REST,
            duration_q16: 0,
            ends_at_rest: true,
            is_far: false,
        }
    }
}

/// What joints follow beside the tilt on machines that follow the whole pose.
const PLACE_CHANNELS: [usize; 4] = [CHANNEL_X, CHANNEL_Y, CHANNEL_Z, CHANNEL_HEADING];

/// A place channel of a control point, mm or rad: far-off headings are brought within a turn of 0, so
/// that single precision holds them.
fn place_of(point: &ChannelPoint, channel: usize) -> f32 {
    let units = point.get(channel).copied().unwrap_or(0);
    if channel != CHANNEL_HEADING {
        return units as f32 * 1e-4;
    }
    let turn_units = core::f64::consts::TAU * 1e6;
    let turns = (f64::from(units) / turn_units) as i32;
    ((f64::from(units) - f64::from(turns) * turn_units) * 1e-6) as f32
}

/// A pose at rest.
#[derive(Clone, Copy, Debug)]
pub struct RestPose(ReadySpan);

impl RestPose {
    /// On `start`.
    pub fn new(carriers: &Carriers, start: &ChannelPoint) -> Self {
        Self(ReadySpan::at_rest(&carriers.scaled(start), start))
    }

    /// As [`Interpolator::offset`].
    pub fn offset(&self) -> Offset<'_> {
        Offset {
            span: &self.0,
            t: 0.0,
        }
    }
}

/// The present span at one moment.
#[derive(Clone, Copy, Debug)]
pub struct Offset<'a> {
    span: &'a ReadySpan,
    /// Servo ticks of segment time since the span's start.
    t: f32,
}

impl Offset<'_> {
    #[inline(always)]
    fn of(&self, [c0, c1, c2, c3]: Cubic) -> f32 {
        ((c3 * self.t + c2) * self.t + c1) * self.t + c0
    }

    /// Where a motor's carrier is above its base, in steps, and that base.
    #[inline(always)]
    pub fn of_motor(&self, motor: usize) -> (f32, Target) {
        let motor = &self.span.motors[motor % MOTORS_MAX];
        (self.of(motor.cubic), motor.anchor)
    }

    /// True if motors may be too far from their bases for [`Target::moved_near`].
    #[inline(always)]
    pub fn is_far(&self) -> bool {
        self.span.is_far
    }

    /// Where a motor's carrier is.
    #[inline(always)]
    pub fn target_of_motor(&self, motor: usize) -> Target {
        let (steps, base) = self.of_motor(motor);
        if self.is_far() {
            base.moved(steps)
        } else {
            base.moved_near(steps)
        }
    }

    /// Tip (mm) and heading (rad, within a turn or so of 0).
    #[inline(always)]
    pub fn place(&self) -> [f32; 4] {
        let (cubics, bases) = (&self.span.place, &self.span.place_base);
        core::array::from_fn(|i| bases[i] + self.of(cubics[i]))
    }

    /// Where the tilt is above its base, and that base, µrad.
    #[inline(always)]
    pub fn tilt(&self) -> ([f32; 2], [i32; 2]) {
        (
            self.span.tilt.map(|cubic| self.of(cubic)),
            self.span.tilt_base,
        )
    }
}

/// What the ceiling at the present span's end means for a steady path rate of up to 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outlook {
    /// It limits nothing.
    Open,
    /// Nothing within the span: up to 1 a ceiling only rises towards a span's start, so that what holds
    /// at its end holds in all of it.
    OpenToEnd,
    /// It may.
    Limited,
}

/// The playing side of the motion.
#[derive(Clone, Debug)]
// What every tick uses comes first.
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
    carriers: Carriers,
}

impl Interpolator {
    /// At rest on the origin.
    pub fn new(carriers: &Carriers) -> Self {
        let origin = ChannelPoint::default();
        let bases = carriers.scaled(&origin);
        Self {
            spans: [ReadySpan::at_rest(&bases, &origin); SPANS],
            place: 0,
            ready: 0,
            carriers: carriers.clone(),
            bases,
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

    /// Starts anew at rest on `start`. In its place: it is large for a stack.
    pub fn start_at(&mut self, start: &ChannelPoint) {
        self.shape = SpanShape::at_rest(start);
        self.bases = self.carriers.scaled(start);
        self.place = 0;
        self.ready = 0;
        self.spans[0] = ReadySpan::at_rest(&self.bases, start);
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
        Offset {
            span: self.present(),
            // Below 2^24 (256 ticks) the conversion is exact.
            t: self.local_q16 as f32 * (1.0 / TICK_Q16 as f32),
        }
    }

    /// Demands of the present span.
    pub fn load(&self) -> &SpanLoad {
        &self.present().load
    }

    /// Spans begun since the stream's start, and whole ticks since the present one's start.
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

    /// To be called when ceilings of the queue have changed.
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
    pub fn is_free(&self, rate_q16: u32) -> bool {
        match self.outlook {
            Outlook::Open => true,
            Outlook::OpenToEnd => rate_q16 <= self.remaining_q16(),
            Outlook::Limited => false,
        }
    }

    /// Begins the next span if the present one is over and one waits, so that its dwell or load is
    /// known before the head moves. True if a span was begun.
    #[inline]
    pub fn begin_next(&mut self, queue: &mut KnotQueue) -> bool {
        self.remaining_q16() == 0 && self.begin(queue)
    }

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
        self.look_at_ceilings(queue);
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
        let weights = self.shape.weights();
        let base = self.shape.base();
        let next = &mut self.spans[(self.place + 1 + self.ready) % SPANS];
        next.load = waiting.load;
        next.duration_q16 = u32::from(waiting.span_ticks) << 16;
        next.ends_at_rest = waiting.ends_at_rest;
        if self.carriers.tilts() {
            let channels = [CHANNEL_TILT_X, CHANNEL_TILT_Y];
            next.tilt_base = channels.map(|channel| base[channel]);
            next.tilt = channels.map(|channel| self.shape.cubic(channel, &weights));
        }
        if self.carriers.follows_pose() {
            next.place_base = PLACE_CHANNELS.map(|channel| place_of(base, channel));
            next.place = PLACE_CHANNELS.map(|channel| {
                let natural = 1.0 / UNITS_PER_NATURAL[channel] as f32;
                let cubic = self.shape.cubic::<f32>(channel, &weights);
                cubic.map(|units| units * natural)
            });
        }
        // Joints that follow more than a channel take any way: there it is not worth a look.
        let may_be_near = !self.carriers.tilts() && !self.carriers.follows_pose();
        let mut reach_steps = 0.0f32;
        for carrier in self.carriers.motors() {
            let motor = carrier.motor % MOTORS_MAX;
            let base = &mut self.bases[motor];
            next.motors[motor].lay(base, carrier, &self.shape, &weights);
            if may_be_near {
                let reach = next.motors[motor].reach_steps(waiting.span_ticks);
                reach_steps = reach_steps.larger(reach);
            }
        }
        next.is_far = !may_be_near || reach_steps > NEAR_STEPS_MAX;
        self.ready += 1;
        true
    }

    /// True if the next span can begin at once.
    pub fn is_prepared(&self) -> bool {
        self.ready > 0
    }

    /// Forgets what was prepared of spans that will not come. Only before a new start.
    pub fn forget_next(&mut self) {
        self.ready = 0;
    }

    /// Moves segment time on, through as many spans as it takes.
    pub fn advance(&mut self, mut step_q16: u32, queue: &mut KnotQueue) {
        for _ in 0..SPANS_PER_TICK_MAX {
            let remaining = self.remaining_q16();
            if step_q16 < remaining {
                self.local_q16 += step_q16;
                return;
            }
            step_q16 -= remaining;
            self.local_q16 = self.duration_q16;
            if !self.begin(queue) {
                // The path ends here, at rest or (starved) with the rate at zero.
                self.settle();
                return;
            }
        }
    }

    /// Makes the end of a span that rests exact.
    fn settle(&mut self) {
        if self.rests_at_end {
            let span = &mut self.spans[self.place % SPANS];
            for motor in &mut span.motors {
                motor.cubic = [0.0; 4];
            }
            span.tilt = [[0.0; 4]; 2];
            span.place = [[0.0; 4]; PLACE_CHANNELS.len()];
        }
    }
}

impl MotorSpan {
    fn at_rest(base: i64) -> Self {
        Self {
            cubic: [0.0; 4],
            anchor: Target::of_position(base),
        }
    }

    /// At least how far it gets from its base in so many ticks.
    #[inline(always)]
    fn reach_steps(&self, ticks: u16) -> f32 {
        let t = f32::from(ticks);
        let [c0, c1, c2, c3] = self.cubic.map(f32::abs);
        ((c3 * t + c2) * t + c1) * t + c0
    }

    /// Lays the motor's part of a span; `base` is that of the span before, and moves on.
    #[inline(always)]
    fn lay(
        &mut self,
        base: &mut ScaledUnits,
        carrier: &Carrier,
        shape: &SpanShape,
        weights: &SpanWeights<f32>,
    ) {
        let cubic = shape.cubic(carrier.channel, weights);
        *base = carrier
            .scale
            .advanced(base, shape.base_step(carrier.channel));
        *self = Self {
            cubic: cubic.map(|units| carrier.scale.steps(units)),
            anchor: Target::of_position(base.position),
        };
    }
}
