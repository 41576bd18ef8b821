//! A span prepared for the servo tick: cubics for motors, tilt and position, from exact integer
//! bases.
//!
//! In: a queued knot, the spline's shape (channel units), the joint channels. Out: at any tick of the span, motors
//! in steps from their bases, the tilt in µrad, tip in mm and heading in rad from theirs.

use crate::configuration::MOTORS_MAX;
use crate::numbers::real::Real;
use crate::path::joint_channels::{JointChannel, JointChannels};
use crate::path::load::SpanLoad;
use crate::path::queue::QueuedKnot;
use crate::path::spline::{SpanShape, SpanWeights};
use crate::steps::{NEAR_STEP, NEAR_STEPS_MAX, ScaledUnits, Target};
use headway_protocol::units::{
    CHANNEL_HEADING, CHANNEL_TILT_X, CHANNEL_TILT_Y, CHANNEL_X, CHANNEL_Y, CHANNEL_Z, ChannelPoint,
};

/// c0..c3 of a cubic in servo ticks.
type Cubic = [f32; 4];

/// Demands of a span on one motor. One address reaches all of it.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
struct MotorSpan {
    /// From the base, in steps where the span is far, else in 2^-16 steps; 0 for joints that follow no
    /// channel.
    cubic: Cubic,
    /// The base as a target.
    anchor: Target,
}

/// A span, ready to be played.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub(super) struct ReadySpan {
    motors: [MotorSpan; MOTORS_MAX],
    /// The tilt from its base, µrad; not on machines that do not tilt.
    tilt: [Cubic; 2],
    tilt_base: [i32; 2],
    /// Tip and heading relative to their base, mm and rad; only on machines whose joints follow
    /// them.
    place: [Cubic; PLACE_CHANNELS.len()],
    place_base: [f32; PLACE_CHANNELS.len()],
    pub(super) load: SpanLoad,
    pub(super) duration_q16: u32,
    pub(super) ends_at_rest: bool,
    /// Some motor may get further than [`NEAR_STEPS_MAX`] from its base; so of machines whose joints follow
    /// more than a channel.
    is_far: bool,
}

impl ReadySpan {
    pub(super) fn at_rest(joint_channels: &JointChannels, start: &ChannelPoint) -> Self {
        let bases = joint_channels.scaled(start);
        Self {
            motors: bases.map(|base| MotorSpan::at_rest(base.position)),
            tilt: [[0.0; 4]; 2],
            tilt_base: TILT_CHANNELS.map(|channel| joint_channels.urad(start, channel)),
            place: [[0.0; 4]; PLACE_CHANNELS.len()],
            place_base: PLACE_CHANNELS.map(|channel| place_of(start, channel, joint_channels)),
            load: SpanLoad::REST,
            duration_q16: 0,
            ends_at_rest: true,
            is_far: false,
        }
    }

    /// Lays a span that waits, of this shape; `bases` are those of the span before, and move on.
    #[inline(always)]
    pub(super) fn lay(
        &mut self,
        waiting: &QueuedKnot,
        joint_channels: &JointChannels,
        shape: &SpanShape,
        bases: &mut [ScaledUnits; MOTORS_MAX],
    ) {
        let weights = shape.weights();
        self.load = waiting.load;
        self.duration_q16 = u32::from(waiting.span_ticks) << 16;
        self.ends_at_rest = waiting.ends_at_rest;
        if joint_channels.tilts() {
            let urad = joint_channels.urad_per_unit();
            self.tilt_base =
                TILT_CHANNELS.map(|channel| joint_channels.urad(shape.base(), channel));
            self.tilt = TILT_CHANNELS.map(|channel| {
                let cubic = shape.cubic::<f32>(channel, &weights);
                cubic.map(|units| units * urad)
            });
        }
        if joint_channels.follows_pose() {
            self.place_base =
                PLACE_CHANNELS.map(|channel| place_of(shape.base(), channel, joint_channels));
            self.place = PLACE_CHANNELS.map(|channel| {
                let natural = joint_channels.natural(channel);
                let cubic = shape.cubic::<f32>(channel, &weights);
                cubic.map(|units| units * natural)
            });
        }
        let may_be_near = joint_channels.may_be_near();
        let ticks = f32::from(waiting.span_ticks);
        let mut reach = 0.0f32;
        for joint_channel in joint_channels.motors() {
            let index = joint_channel.motor % MOTORS_MAX;
            let motor = &mut self.motors[index];
            motor.lay(&mut bases[index], joint_channel, shape, &weights);
            if may_be_near {
                reach = reach.larger(motor.reach(ticks));
            }
        }
        self.is_far = !may_be_near;
        if reach > NEAR_STEPS_MAX * NEAR_STEP {
            self.become_far();
        }
    }

    /// The span this many servo ticks after its start.
    #[inline(always)]
    pub(super) fn at(&self, t: f32) -> Offset<'_> {
        Offset { span: self, t }
    }

    /// Nothing moves any more: all is on its base, exactly.
    pub(super) fn stay_on_base(&mut self) {
        for motor in &mut self.motors {
            motor.cubic = [0.0; 4];
        }
        self.tilt = [[0.0; 4]; 2];
        self.place = [[0.0; 4]; PLACE_CHANNELS.len()];
    }

    /// Takes its displacements in whole steps: exact, since a step has a power of two of parts.
    #[cold]
    fn become_far(&mut self) {
        self.is_far = true;
        for motor in &mut self.motors {
            motor.cubic = motor.cubic.map(|way| way * (1.0 / NEAR_STEP));
        }
    }
}

/// Data that joints follow in addition to the tilt on machines that follow the complete pose.
const PLACE_CHANNELS: [usize; 4] = [CHANNEL_X, CHANNEL_Y, CHANNEL_Z, CHANNEL_HEADING];

/// The tilt's.
const TILT_CHANNELS: [usize; 2] = [CHANNEL_TILT_X, CHANNEL_TILT_Y];

/// A place channel of a control point, mm or rad: far-off headings are brought within a turn of 0, so
/// that single precision holds them.
fn place_of(point: &ChannelPoint, channel: usize, joint_channels: &JointChannels) -> f32 {
    let units = point.get(channel).copied().unwrap_or(0);
    if channel != CHANNEL_HEADING {
        return units as f32 * joint_channels.natural(channel);
    }
    let urad = f64::from(units) * f64::from(joint_channels.urad_per_unit());
    let turn_urad = core::f64::consts::TAU * 1e6;
    let turns = (urad / turn_urad) as i32;
    ((urad - f64::from(turns) * turn_urad) * 1e-6) as f32
}

/// A pose at rest.
#[derive(Clone, Copy, Debug)]
pub struct RestPose(ReadySpan);

impl RestPose {
    /// On `start`.
    pub fn new(joint_channels: &JointChannels, start: &ChannelPoint) -> Self {
        Self(ReadySpan::at_rest(joint_channels, start))
    }

    /// As [`super::Interpolator::offset`].
    pub fn offset(&self) -> Offset<'_> {
        self.0.at(0.0)
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

    /// Where a motor's joint channel is above its base, and that base: in steps where motors may be far, else in
    /// 2^-16 steps.
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

    /// Where a motor's joint channel is.
    #[inline(always)]
    pub fn target_of_motor(&self, motor: usize) -> Target {
        let (way, base) = self.of_motor(motor);
        if self.is_far() {
            base.moved(way)
        } else {
            base.moved_near(way)
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

impl MotorSpan {
    fn at_rest(base: i64) -> Self {
        Self {
            cubic: [0.0; 4],
            anchor: Target::of_position(base),
        }
    }

    /// Upper bound of its distance from its base within this many ticks.
    #[inline(always)]
    fn reach(&self, t: f32) -> f32 {
        let [c0, c1, c2, c3] = self.cubic.map(f32::abs);
        ((c3 * t + c2) * t + c1) * t + c0
    }

    /// Lays the motor's part of a span; `base` is that of the span before, and moves on.
    #[inline(always)]
    fn lay(
        &mut self,
        base: &mut ScaledUnits,
        joint_channel: &JointChannel,
        shape: &SpanShape,
        weights: &SpanWeights<f32>,
    ) {
        let cubic = shape.cubic(joint_channel.channel, weights);
        *base = joint_channel
            .scale
            .advanced(base, shape.base_step(joint_channel.channel));
        *self = Self {
            cubic: cubic.map(|units| units * joint_channel.offset_scale),
            anchor: Target::of_position(base.position),
        };
    }
}
