//! An independent sampler of the finished segments: their ratio to each limit.
//!
//! [`SegmentStream`] -> ratios to `plan_share` of every limit. It shares no code with the planner, and with the walk
//! that gives the product's figures only a moment's derivatives: spans are evaluated in double precision from the
//! control points, joints by inverse kinematics of the local Taylor polynomial. It samples every servo tick, knots from
//! both sides (where every channel's acceleration has its extremes), the middle between ticks, and the extremes of
//! every channel's velocity.

mod crawl;
mod pair;

use headway::drive::moment::Moment;
use headway::job::{Mark, MotionState, SegmentStream};
use headway::settings::Settings;
use headway_firmware::path::spline::Span;
use headway_firmware::steps::delay::advance_centre_ticks;
use headway_protocol::segment::{FlowAction, FlowEvent};
use headway_protocol::units::{CHANNEL_HEADING, CHANNEL_VOLUME, CHANNELS, Units};
use rayon::prelude::*;
use std::collections::VecDeque;

/// Samples per servo tick: for quantities that have their extremes between ticks and are not
/// channels themselves (the tip's speed, joints of machines that tilt, primes).
const LOOKS_PER_TICK: u32 = 2;
/// A ratio and its place.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Peak {
    /// Value over `plan_share` of its limit.
    pub ratio: f64,
    /// Which limit.
    pub what: Limit,
    /// Segment time.
    pub time_s: f64,
}

/// The limits that are checked.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
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
#[derive(Clone, Copy, Debug, Default, PartialEq)]
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

/// Spans that one thread samples.
const SPANS_AT_ONCE: usize = 256;

/// Samples the complete stream.
pub fn sample(stream: &SegmentStream, settings: &Settings) -> LimitFigures {
    let spans: Vec<Span> = stream.spans().collect();
    let start_of = |event: &FlowEvent| {
        let span = spans.get(event.span as usize);
        span.map_or(0.0, |span| span.start_tick as f64) + f64::from(event.offset_ticks)
    };
    let events = stream.events.iter().map(|event| (start_of(event), *event));
    let events: Vec<(f64, FlowEvent)> = events.collect();
    let parts = (0..spans.len()).into_par_iter().step_by(SPANS_AT_ONCE);
    let parts: Vec<LimitFigures> = parts
        .map(|first| {
            let (before, rest) = spans.split_at(first);
            let rest = &rest[..rest.len().min(SPANS_AT_ONCE)];
            let mut sampler = Sampler::new(&stream.marks, &events, before, rest, settings);
            rest.iter().for_each(|span| sampler.span(span));
            sampler.figures
        })
        .collect();
    parts
        .into_iter()
        .fold(LimitFigures::default(), LimitFigures::with)
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

impl VolumeRate {
    fn of(moment: &Moment) -> Self {
        VolumeRate {
            rate_mm3_s: moment.velocity[CHANNEL_VOLUME],
            change_mm3_s2: moment.acceleration[CHANNEL_VOLUME],
        }
    }
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
        let now = VolumeRate::of(moment);
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
        window.push_front(VolumeRate::of(&Moment::of(span, local, servo_hz)));
    }
    while window.len() < looks {
        window.push_front(VolumeRate::default());
    }
    window
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
    use headway_protocol::segment::{Knot, REST_TICKS};
    use headway_protocol::units::{Ticks, to_units};

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
    fn primes_count_towards_the_extruder() {
        let mut settings = Settings::default();
        let mut stream = wave(0, 5.0, 800.0);
        stream.events.push(FlowEvent {
            span: 10,
            offset_ticks: 5,
            action: FlowAction::Prime,
            volume_units: 300_000,
            duration_ticks: Ticks(80),
        });
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
