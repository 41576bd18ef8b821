//! An independent sampler of the finished segments: their ratio to each limit.
//!
//! [`SegmentStream`] -> ratios to `plan_share` of every limit. It shares no code with the planner:
//! spans are evaluated in double precision from the control points, joints by inverse kinematics of
//! the local Taylor polynomial. It samples every servo tick, knots from both sides (where every
//! channel's acceleration has its extremes), the middle between ticks, and the extremes of every
//! channel's velocity. Joint derivatives of machines that are not linear in the channels come from
//! central differences over `DIFFERENCE_S`.

mod crawl;
mod pair;

use crate::job::{Mark, MotionState, SegmentStream};
use crate::settings::Settings;
use headway_firmware::configuration::{JOINTS_MAX, Kinematics};
use headway_firmware::kinematics::pose::Pose;
use headway_firmware::kinematics::{inverse, winds};
use headway_firmware::path::spline::Span;
use headway_firmware::steps::delay::advance_centre_ticks;
use headway_protocol::segment::{FlowAction, FlowEvent};
use headway_protocol::units::{CHANNEL_HEADING, CHANNEL_VOLUME, CHANNELS, Units};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::f64::consts::TAU;

/// Half width of the central differences: rounding gives 10⁻⁶ of an acceleration, truncation less.
const DIFFERENCE_S: f64 = 2e-4;
/// Samples per servo tick: for quantities that have their extremes between ticks and are not
/// channels themselves (the tip's speed, joints of machines that tilt, primes).
const LOOKS_PER_TICK: u32 = 2;
/// A ratio and its place.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Peak {
    /// Value over `plan_share` of its limit.
    pub ratio: f64,
    /// Which limit.
    pub what: Limit,
    /// Segment time.
    pub time_s: f64,
}

/// The limits that are checked.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Limit {
    /// Nothing moves.
    #[default]
    None,
    /// A joint's.
    Joint(usize),
    /// The tip's speed or acceleration.
    Tip,
    /// dV/dt or d²V/dt².
    Flow,
    /// The extruder's, with pressure advance, prime and retract.
    Extruder,
    /// Of the motor of this joint's number, which two joints move together.
    Motor(usize),
}

/// Ratios to `plan_share` of the limits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LimitFigures {
    /// Velocities: joints, tip, flow, extruder.
    pub velocity: Peak,
    /// Accelerations: joints, tip, rate of change of flow, extruder.
    pub acceleration: Peak,
    /// Jerk of the joints.
    pub jerk: Peak,
    /// Largest heading rate.
    pub heading_rate_max_rad_s: f64,
    /// Heading travelled in all.
    pub heading_travel_rad: f64,
}

/// Spans that one thread samples, and that are in memory at the same time.
const SPANS_AT_ONCE: usize = 256;
const SPANS_HELD: usize = 64 * SPANS_AT_ONCE;

/// Samples the complete stream.
pub fn sample(stream: &SegmentStream, settings: &Settings) -> LimitFigures {
    let mut tally = LimitTally::default();
    tally.add(stream, settings);
    tally.figures
}

/// Samples a stream part by part: the effect of pressure advance and events of one part on the next one
/// counts there.
#[derive(Clone, Debug, Default)]
pub struct LimitTally {
    /// What was found so far.
    pub figures: LimitFigures,
    /// Servo ticks of the pieces so far.
    ticks: u64,
    /// The last spans.
    before: Vec<Span>,
    /// Events that may not have ended: start tick and event, in order.
    events: Vec<(f64, FlowEvent)>,
}

impl LimitTally {
    /// Samples the next part, which begins at the end of the last one, at rest.
    pub fn add(&mut self, piece: &SegmentStream, settings: &Settings) {
        let from = self.ticks;
        let whole = || {
            let spans = piece.spans();
            spans.map(|mut span| {
                span.start_tick += from;
                span
            })
        };
        let starts: Vec<u64> = whole().map(|span| span.start_tick).collect();
        let start_of = |event: &FlowEvent| {
            let span = starts.get(event.span as usize).copied().unwrap_or(from);
            span as f64 + f64::from(event.offset_ticks)
        };
        let events = piece.events.iter().map(|event| (start_of(event), *event));
        self.events.extend(events);
        let marks: Vec<Mark> = piece.marks.iter().map(|mark| shifted(mark, from)).collect();
        let mut spans = whole();
        let mut held = std::mem::take(&mut self.before);
        loop {
            let known = held.len();
            // A long job has more spans than are to be held at the same time.
            held.extend(spans.by_ref().take(SPANS_HELD));
            if held.len() == known {
                break;
            }
            let parts = (known..held.len()).into_par_iter().step_by(SPANS_AT_ONCE);
            let parts: Vec<LimitFigures> = parts
                .map(|first| {
                    let (before, rest) = held.split_at(first);
                    let rest = &rest[..rest.len().min(SPANS_AT_ONCE)];
                    let mut sampler = Sampler::new(&marks, &self.events, before, rest, settings);
                    for span in rest {
                        sampler.span(span);
                    }
                    sampler.figures
                })
                .collect();
            self.figures = parts.into_iter().fold(self.figures, LimitFigures::with);
            if let Some(last) = held.last() {
                self.ticks = last.start_tick + u64::from(last.duration_ticks);
            }
            // A span has a look at least: the window does not reach back further.
            held.drain(..held.len().saturating_sub(window_looks(settings)));
        }
        let behind = self.ticks as f64 - f64::from(delay_ticks_of(settings));
        self.events.retain(|event| end_of(event) >= behind);
        self.before = held;
    }
}

fn shifted(mark: &Mark, ticks: u64) -> Mark {
    Mark {
        start_tick: mark.start_tick + ticks,
        end_tick: mark.end_tick + ticks,
        ..*mark
    }
}

fn end_of((start, event): &(f64, FlowEvent)) -> f64 {
    start + f64::from(event.duration_ticks.0)
}

/// Ticks that everything else waits for the pressure advance.
fn delay_ticks_of(settings: &Settings) -> u32 {
    advance_centre_ticks(&settings.machine.extruder, settings.machine.servo_hz)
}

/// Samples in the window of the extruder's pressure advance.
fn window_looks(settings: &Settings) -> usize {
    let window_s = settings.machine.extruder.pressure_advance_window_ms * 1e-3;
    let window_ticks = (window_s * f64::from(settings.machine.servo_hz)).round();
    window_ticks.max(1.0) as usize * LOOKS_PER_TICK as usize
}

impl LimitFigures {
    /// These figures and those of the next part.
    fn with(mut self, next: LimitFigures) -> LimitFigures {
        let pairs = [
            (&mut self.velocity, next.velocity),
            (&mut self.acceleration, next.acceleration),
            (&mut self.jerk, next.jerk),
        ];
        for (peak, next) in pairs {
            note(peak, next.ratio, next.what, next.time_s);
        }
        LimitFigures {
            heading_rate_max_rad_s: self.heading_rate_max_rad_s.max(next.heading_rate_max_rad_s),
            heading_travel_rad: self.heading_travel_rad + next.heading_travel_rad,
            ..self
        }
    }
}

/// Volume's first and second derivative at a moment, per second.
#[derive(Clone, Copy, Debug, Default)]
struct VolumeRate {
    rate_mm3_s: f64,
    change_mm3_s2: f64,
}

struct Sampler<'a> {
    settings: &'a Settings,
    marks: &'a [Mark],
    servo_hz: f64,
    units: Units,
    /// Start tick and event, in order.
    events: VecDeque<(f64, FlowEvent)>,
    /// Volume rates over the last window, `LOOKS_PER_TICK` a tick.
    window: VecDeque<VolumeRate>,
    /// Samples by which everything else is delayed for the advance.
    delay_looks: usize,
    figures: LimitFigures,
}

impl<'a> Sampler<'a> {
    /// A sampler that has evaluated the spans `before` and will evaluate `spans`.
    fn new(
        marks: &'a [Mark],
        events: &[(f64, FlowEvent)],
        before: &[Span],
        spans: &[Span],
        settings: &'a Settings,
    ) -> Self {
        let servo_hz = f64::from(settings.machine.servo_hz);
        let delay = delay_ticks_of(settings);
        let first = spans.first().map_or(0, |span| span.start_tick) as f64;
        let from = first - f64::from(delay);
        let to = spans.last().map_or(0.0, |span| {
            span.start_tick as f64 + f64::from(span.duration_ticks)
        });
        let events = &events[..events.partition_point(|event| event.0 <= to)];
        let own = events.iter().filter(|event| end_of(event) >= from);
        Sampler {
            settings,
            marks: &marks[marks.partition_point(|mark| (mark.end_tick as f64) < first)..],
            servo_hz,
            units: spans.first().map_or(Units::BASE, |span| span.units),
            events: own.copied().collect(),
            window: window_behind(before, window_looks(settings), servo_hz),
            delay_looks: (delay * LOOKS_PER_TICK) as usize,
            figures: LimitFigures::default(),
        }
    }

    /// All samples of one span: its start from this side, then to its end, and the extremes of the
    /// channels' velocities.
    fn span(&mut self, span: &Span) {
        let looks = u32::from(span.duration_ticks) * LOOKS_PER_TICK;
        let edge = 2 * (self.window.len() as u32 + self.delay_looks as u32) + LOOKS_PER_TICK;
        let middle = match self.crawls(span) && looks > 2 * edge + crawl::LOOKS {
            true => edge..looks - edge,
            false => looks..looks,
        };
        self.looks(span, 0..=middle.start, looks);
        if middle.end > middle.start {
            self.crawl(span, &middle);
            self.looks(span, middle.end..=looks, looks);
        }
        let duration = f64::from(span.duration_ticks);
        for [_, _, c2, c3] in span.polynomial.coefficients {
            let vertex = -c2 / (3.0 * c3);
            if vertex > 0.0 && vertex < duration {
                let moment = Moment::of(span, vertex, self.servo_hz);
                self.look(&moment, span.start_tick as f64 + vertex);
            }
        }
    }

    /// These samples of a span, of which the last is its end.
    fn looks(&mut self, span: &Span, range: std::ops::RangeInclusive<u32>, looks: u32) {
        for look in range {
            let local = f64::from(look) / f64::from(LOOKS_PER_TICK);
            let moment = Moment::of(span, local, self.servo_hz);
            self.look(&moment, span.start_tick as f64 + local);
            self.extruder(&moment, span.start_tick as f64 + local, look == looks);
            if look < looks {
                // The end is the next span's start: once in the sum is enough.
                let step_s = 1.0 / (self.servo_hz * f64::from(LOOKS_PER_TICK));
                let heading_rate_rad_s = moment.velocity[CHANNEL_HEADING].abs();
                self.figures.heading_travel_rad += heading_rate_rad_s * step_s;
            }
        }
    }

    fn look(&mut self, moment: &Moment, ticks: f64) {
        while self.marks.len() > 1 && ticks > self.marks[0].end_tick as f64 {
            self.marks = &self.marks[1..];
        }
        let time_s = ticks / self.servo_hz;
        let heading_rate_rad_s = moment.velocity[CHANNEL_HEADING].abs();
        let figures = &mut self.figures;
        figures.heading_rate_max_rad_s = figures.heading_rate_max_rad_s.max(heading_rate_rad_s);
        self.joints(moment, time_s);
        self.tip_and_flow(moment, time_s);
    }

    fn joints(&mut self, moment: &Moment, time_s: f64) {
        let share = self.settings.plan_share;
        let [velocity, acceleration, jerk] =
            moment.joint_derivatives(&self.settings.machine.kinematics);
        for (index, joint) in self.settings.machine.joints.iter().enumerate() {
            let what = Limit::Joint(index);
            let figures = &mut self.figures;
            let speed = velocity[index] / (joint.speed_max * share);
            note(&mut figures.velocity, speed, what, time_s);
            let bend = acceleration[index] / (joint.acceleration_max * share);
            note(&mut figures.acceleration, bend, what, time_s);
            note(
                &mut figures.jerk,
                jerk[index] / (joint.jerk_max * share),
                what,
                time_s,
            );
        }
        self.pair([velocity, acceleration, jerk], time_s);
    }

    fn tip_and_flow(&mut self, moment: &Moment, time_s: f64) {
        let settings = self.settings;
        let share = settings.plan_share;
        let figures = &mut self.figures;
        let norm = |v: &[f64; CHANNELS]| (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
        let speed_mm_s = match self.marks.first().map(|mark| mark.state) {
            Some(MotionState::Travel) => settings.travel_speed_mm_s,
            _ => settings.speed_mm_s,
        };
        let speed = norm(&moment.velocity) / (speed_mm_s * share);
        note(&mut figures.velocity, speed, Limit::Tip, time_s);
        let bend = norm(&moment.acceleration) / (settings.tip_acceleration_mm_s2 * share);
        note(&mut figures.acceleration, bend, Limit::Tip, time_s);
        let flow = moment.velocity[CHANNEL_VOLUME] / (settings.flow_max_mm3_s * share);
        note(&mut figures.velocity, flow, Limit::Flow, time_s);
        let change_max = settings.flow_rate_of_change_max_mm3_s2 * share;
        let change = moment.acceleration[CHANNEL_VOLUME] / change_max;
        note(&mut figures.acceleration, change, Limit::Flow, time_s);
    }

    /// e = V(t - W/2) + K (V(t) - V(t - W)) / W + primes - retracts of t - W/2; everything in it is
    /// piecewise linear in its second derivative between servo ticks, but for the events.
    fn extruder(&mut self, moment: &Moment, ticks: f64, is_end: bool) {
        let extruder = &self.settings.machine.extruder;
        let now = moment.volume_rate();
        let before = self.window.front().copied().unwrap_or_default();
        let looks_back = self.delay_looks.min(self.window.len());
        let middle = match looks_back {
            0 => now,
            back => self.window[self.window.len() - back],
        };
        if !is_end {
            self.window.push_back(now);
            self.window.pop_front();
        }
        let looks_s = 1.0 / (self.servo_hz * f64::from(LOOKS_PER_TICK));
        let gain = extruder.pressure_advance_s / (self.window.len() as f64 * looks_s);
        let event = self.event_rate(ticks - looks_back as f64 / f64::from(LOOKS_PER_TICK));
        let rate = middle.rate_mm3_s + gain * (now.rate_mm3_s - before.rate_mm3_s);
        let change = middle.change_mm3_s2 + gain * (now.change_mm3_s2 - before.change_mm3_s2);
        let time_s = ticks / self.servo_hz;
        let share = self.settings.plan_share;
        let figures = &mut self.figures;
        let speed = (rate + event.rate_mm3_s) / (extruder.speed_max_mm3_s * share);
        note(&mut figures.velocity, speed, Limit::Extruder, time_s);
        let bend = (change + event.change_mm3_s2) / (extruder.acceleration_max_mm3_s2 * share);
        note(&mut figures.acceleration, bend, Limit::Extruder, time_s);
    }

    /// Primes and retracts at this moment: x³ (10 - 15 x + 6 x²) of their volume.
    fn event_rate(&mut self, ticks: f64) -> VolumeRate {
        let ended = |event: &(f64, FlowEvent)| ticks >= end_of(event);
        while self.events.front().is_some_and(ended) {
            self.events.pop_front();
        }
        let mut sum = VolumeRate::default();
        for (start, event) in &self.events {
            if *start > ticks {
                break;
            }
            let duration_s = f64::from(event.duration_ticks.0) / self.servo_hz;
            let x = ((ticks - start) / f64::from(event.duration_ticks.0)).min(1.0);
            let volume_mm3 = f64::from(event.volume_units) / self.units.per_natural(CHANNEL_VOLUME);
            let signed_mm3 = match event.action {
                FlowAction::Prime => volume_mm3,
                FlowAction::Retract => -volume_mm3,
            };
            let rest = 1.0 - x;
            sum.rate_mm3_s += signed_mm3 * 30.0 * x * x * rest * rest / duration_s;
            sum.change_mm3_s2 +=
                signed_mm3 * 60.0 * x * rest * (1.0 - 2.0 * x) / (duration_s * duration_s);
        }
        sum
    }
}

/// Volume rates at the last samples of these spans, as many as given; nothing moves before them.
fn window_behind(spans: &[Span], looks: usize, servo_hz: f64) -> VecDeque<VolumeRate> {
    let mut window = VecDeque::with_capacity(looks + 1);
    let last_first = spans.iter().rev().flat_map(|span| {
        let looks = u32::from(span.duration_ticks) * LOOKS_PER_TICK;
        (0..looks).rev().map(move |look| (span, look))
    });
    for (span, look) in last_first.take(looks) {
        let local = f64::from(look) / f64::from(LOOKS_PER_TICK);
        window.push_front(Moment::of(span, local, servo_hz).volume_rate());
    }
    while window.len() < looks {
        window.push_front(VolumeRate::default());
    }
    window
}

/// The motion at one moment, in natural units and seconds.
pub(crate) struct Moment {
    pub(super) position: [f64; CHANNELS],
    pub(super) velocity: [f64; CHANNELS],
    pub(super) acceleration: [f64; CHANNELS],
    jerk: [f64; CHANNELS],
}

impl Moment {
    pub(crate) fn of(span: &Span, local: f64, servo_hz: f64) -> Self {
        Moment {
            position: span.position(local),
            velocity: span.velocity(local, servo_hz),
            acceleration: span.acceleration(local, servo_hz),
            jerk: span.jerk(servo_hz),
        }
    }

    fn volume_rate(&self) -> VolumeRate {
        VolumeRate {
            rate_mm3_s: self.velocity[CHANNEL_VOLUME],
            change_mm3_s2: self.acceleration[CHANNEL_VOLUME],
        }
    }

    /// First to third time derivative of every joint. A pose without joints has none.
    pub(crate) fn joint_derivatives(&self, kinematics: &Kinematics) -> [[f64; JOINTS_MAX]; 3] {
        let mut derivatives = [[0.0; JOINTS_MAX]; 3];
        if matches!(kinematics, Kinematics::Planar) {
            // X Y Z C are channels themselves.
            for (joint, channel) in [0, 1, 2, CHANNEL_HEADING].into_iter().enumerate() {
                derivatives[0][joint] = self.velocity[channel];
                derivatives[1][joint] = self.acceleration[channel];
                derivatives[2][joint] = self.jerk[channel];
            }
            return derivatives;
        }
        let h = DIFFERENCE_S;
        let at = |time_s: f64| self.joints(kinematics, time_s);
        let (Some(a), Some(b), Some(c), Some(d), Some(e)) =
            (at(-2.0 * h), at(-h), at(0.0), at(h), at(2.0 * h))
        else {
            return derivatives;
        };
        for joint in 0..JOINTS_MAX {
            let winds = winds(kinematics) >> joint & 1 != 0;
            let [a, b, c, d, e] = [a, b, c, d, e].map(|joints| {
                // The turn that is nearest to the middle.
                let turns = ((c[joint] - joints[joint]) / TAU).round();
                joints[joint] + if winds { turns * TAU } else { 0.0 }
            });
            // Five-point stencils: fourth order in h for the first two.
            derivatives[0][joint] = (8.0 * (d - b) - (e - a)) / (12.0 * h);
            derivatives[1][joint] = (16.0 * (d + b) - (e + a) - 30.0 * c) / (12.0 * h * h);
            derivatives[2][joint] = (e - a - 2.0 * (d - b)) / (2.0 * h * h * h);
        }
        derivatives
    }

    /// Joints on the local Taylor polynomial, so that a knot is evaluated from one side.
    fn joints(&self, kinematics: &Kinematics, time_s: f64) -> Option<[f64; JOINTS_MAX]> {
        let channels = std::array::from_fn(|c| {
            self.position[c]
                + time_s
                    * (self.velocity[c]
                        + time_s * (self.acceleration[c] / 2.0 + time_s * self.jerk[c] / 6.0))
        });
        let joints = inverse(kinematics, &Pose::from_channels(&channels));
        joints.ok().map(|joints| joints.position)
    }
}

fn note(peak: &mut Peak, value: f64, what: Limit, time_s: f64) {
    let ratio = value.abs();
    // A value that is not a number must not pass.
    if ratio > peak.ratio || ratio.is_nan() {
        *peak = Peak {
            ratio,
            what,
            time_s,
        };
    }
}

#[cfg(test)]
mod tests {
    //! Goal: the sampler finds the limits that are exceeded, and by how much. Method: streams whose
    //! derivatives are known.
    use super::*;
    use crate::drive::test_streams::spiral;
    use headway_firmware::kinematics::pose::tool_axis;
    use headway_protocol::segment::{Knot, REST_TICKS};
    use headway_protocol::units::to_units;
    use nalgebra::Vector2;

    /// A cosine in one channel: amplitude in natural units, one period in `period_ticks`. The
    /// spline of its samples is flatter by theta²/6, theta the angle of one span.
    fn wave(channel: usize, amplitude: f64, period_ticks: f64) -> SegmentStream {
        let mut stream = SegmentStream::default();
        for i in 0..400 {
            // As long as the virtual spans before the first: knots are uniform from the start.
            let duration_ticks = f64::from(REST_TICKS);
            let angle = std::f64::consts::TAU * duration_ticks * f64::from(i) / period_ticks;
            let mut natural = [0.0; CHANNELS];
            natural[channel] = amplitude * (1.0 - angle.cos());
            stream.knots.push(Knot {
                control: to_units(&natural),
                duration_ticks: REST_TICKS,
            });
        }
        stream
    }

    #[test]
    fn a_wave_in_x_has_the_ratios_of_its_formula() {
        let settings = Settings::default();
        let figures = sample(&wave(0, 5.0, 800.0), &settings);
        let omega = std::f64::consts::TAU * 2.5;
        let share = settings.plan_share;
        let tip = 5.0 * omega / (settings.speed_mm_s * share);
        assert!(
            (figures.velocity.ratio / tip - 1.0).abs() < 2e-3,
            "{figures:?}"
        );
        assert_eq!(figures.velocity.what, Limit::Tip);
        let joint = &settings.machine.joints[0];
        let limit = joint.acceleration_max.min(settings.tip_acceleration_mm_s2);
        let bend = 5.0 * omega * omega / (limit * share);
        let measured = figures.acceleration.ratio;
        // Control points are whole units: 0.1 um in (4 ms)² is 6 mm/s² of 1237.
        assert!((measured / bend - 1.0).abs() < 6e-3, "{measured} {bend}");
        // The jerk is largest where the wave begins: from rest to half its acceleration in a span.
        let span_s = f64::from(REST_TICKS) / f64::from(settings.machine.servo_hz);
        let begin = 5.0 * (1.0 - (omega * span_s).cos()) / span_s.powi(3);
        let jerk = begin / (joint.jerk_max * share);
        // And 2 units in (4 ms)³ are 3100 mm/s³ of 154,000.
        assert!(
            (figures.jerk.ratio / jerk - 1.0).abs() < 0.03,
            "{figures:?}"
        );
    }

    #[test]
    fn heading_and_flow_are_limited_by_their_own() {
        let settings = Settings::default();
        let figures = sample(&wave(CHANNEL_HEADING, 1.0, 400.0), &settings);
        assert_eq!(figures.acceleration.what, Limit::Joint(3));
        let omega = std::f64::consts::TAU * 5.0;
        assert!((figures.heading_rate_max_rad_s / omega - 1.0).abs() < 4e-3);
        // 400 spans of 8 ticks are 8 periods of 4 rad.
        assert!((figures.heading_travel_rad - 31.9).abs() < 0.1);
        let flow = sample(&wave(CHANNEL_VOLUME, 1.0, 1000.0), &settings);
        assert!(matches!(flow.velocity.what, Limit::Flow | Limit::Extruder));
    }

    #[test]
    fn gantry_joints_agree_with_the_motion_of_the_pivot() {
        // A tilt alone moves the pivot: its acceleration is L d²n/dt², from the axis itself.
        let kinematics = Kinematics::Gantry {
            pivot_length_mm: 80.0,
        };
        let moment = Moment {
            position: [100.0, 50.0, 10.0, 0.1, -0.2, 0.5, 0.0],
            velocity: [10.0, -5.0, 1.0, 0.7, 0.4, 3.0, 0.0],
            acceleration: [100.0, 50.0, -20.0, 8.0, -6.0, 40.0, 0.0],
            jerk: [0.0; CHANNELS],
        };
        let [velocity, acceleration, _] = moment.joint_derivatives(&kinematics);
        let axis = |t: f64| {
            tool_axis(Vector2::new(
                0.1 + t * (0.7 + 4.0 * t),
                -0.2 + t * (0.4 - 3.0 * t),
            ))
        };
        let h = 1e-4;
        let rate = (axis(h) - axis(-h)) / (2.0 * h);
        let bend = (axis(h) + axis(-h) - 2.0 * axis(0.0)) / (h * h);
        for joint in 0..3 {
            let expected = moment.velocity[joint] + 80.0 * rate[joint];
            assert!((velocity[joint] - expected).abs() < 1e-4 * expected.abs().max(1.0));
            let expected = moment.acceleration[joint] + 80.0 * bend[joint];
            assert!((acceleration[joint] - expected).abs() < 1e-4 * expected.abs().max(10.0));
        }
    }

    #[test]
    fn primes_count_towards_the_extruder() {
        let mut settings = Settings::default();
        let mut stream = spiral(2.0);
        let still = sample(&stream, &settings);
        // A prime of 0.3 mm³ in 80 ticks peaks at 1.875 · 0.3 / 0.04 s = 14.06 mm³/s.
        settings.machine.extruder.speed_max_mm3_s = 10.0;
        let tight = sample(&stream, &settings);
        assert_eq!(tight.velocity.what, Limit::Extruder);
        let expected = 14.0625 / (10.0 * settings.plan_share);
        assert!(
            (tight.velocity.ratio / expected - 1.0).abs() < 1e-3,
            "{tight:?}"
        );
        stream.events.clear();
        let without = sample(&stream, &settings);
        assert!(without.velocity.ratio < tight.velocity.ratio);
        assert!(still.velocity.ratio < tight.velocity.ratio);
    }
}
