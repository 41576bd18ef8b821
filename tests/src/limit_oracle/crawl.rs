//! Spans that are very slow or at rest: sampled at a few points, so that the work grows with the number of spans and
//! not with their time.
//!
//! In: a [`Span`] (servo ticks) and the events that run in it. Out: the sampler's figures, as if every tick of it
//! had been sampled: a span is one cubic, whose extremes are sampled in addition. Around its ends, where the
//! pressure advance still depends on the previous span, every tick is sampled.

use super::{LOOKS_PER_TICK, Limit, Moment, Sampler, VolumeRate, note};
use headway_firmware::path::spline::Span;
use headway_protocol::units::CHANNEL_HEADING;
use std::ops::Range;

/// Spans longer than this crawl, servo ticks.
const SPAN_TICKS: u32 = 512;
/// Points at which one is sampled.
pub(super) const LOOKS: u32 = 128;
/// Events longer than this crawl as well, servo ticks; a span at rest without an event needs no samples.
const EVENT_TICKS: u32 = 20_000;

impl Sampler<'_> {
    /// True for a span without anything fast: nothing moves in it, or it takes long for a single cubic.
    pub(super) fn crawls(&self, span: &Span) -> bool {
        let end = span.start_tick as f64 + f64::from(span.duration_ticks);
        let mut running = self.events.iter().take_while(|(start, _)| *start <= end);
        let is_slow = running.all(|(_, event)| event.duration_ticks.0 > EVENT_TICKS);
        let coefficients = span.polynomial.coefficients;
        let stands = coefficients
            .iter()
            .all(|c| c[1..].iter().all(|c| *c == 0.0));
        is_slow && (stands || u32::from(span.duration_ticks) > SPAN_TICKS)
    }

    /// The middle of a span that crawls, in a few places; the advance's window is filled again after it.
    pub(super) fn crawl(&mut self, span: &Span, middle: &Range<u32>) {
        let per_tick = f64::from(LOOKS_PER_TICK);
        let stride = f64::from(middle.end - middle.start) / f64::from(LOOKS);
        for k in 0..LOOKS {
            let local = (f64::from(middle.start) + stride * f64::from(k)) / per_tick;
            let moment = Moment::of(span, local, self.servo_hz);
            self.look(&moment, span.start_tick as f64 + local);
            self.steady_extruder(&moment, span.start_tick as f64 + local);
            let heading_rate_rad_s = moment.velocity[CHANNEL_HEADING].abs();
            self.figures.heading_travel_rad +=
                heading_rate_rad_s * stride / (per_tick * self.servo_hz);
        }
        let last = self.window.len() as u32;
        for (k, rate) in (0u32..).zip(self.window.iter_mut()) {
            let local = f64::from(middle.end + k - last) / per_tick;
            *rate = VolumeRate::of(&Moment::of(span, local, self.servo_hz));
        }
    }

    /// e' = V' + K V'' and events, where the window sees the same change all along.
    fn steady_extruder(&mut self, moment: &Moment, ticks: f64) {
        let extruder = &self.settings.machine.extruder;
        let now = VolumeRate::of(moment);
        let advance_s = extruder.pressure_advance_s;
        let (rate_max, change_max) = (extruder.speed_max_mm3_s, extruder.acceleration_max_mm3_s2);
        let event = self.event_rate(ticks - self.delay_looks as f64 / f64::from(LOOKS_PER_TICK));
        let share = self.settings.plan_share;
        let rate = now.rate_mm3_s + advance_s * now.change_mm3_s2 + event.rate_mm3_s;
        let change = now.change_mm3_s2 + event.change_mm3_s2;
        let time_s = ticks / self.servo_hz;
        let figures = &mut self.figures;
        let speed = rate / (rate_max * share);
        note(&mut figures.velocity, speed, Limit::Extruder, time_s);
        let bend = change / (change_max * share);
        note(&mut figures.acceleration, bend, Limit::Extruder, time_s);
    }
}
