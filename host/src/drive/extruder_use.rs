//! How much of its limits the extruder uses: flow, pressure advance, primes and retracts together.
//!
//! In: spans of a stream in order, and the events that begin in each (servo ticks). Out: its largest rate and
//! acceleration, as ratios to the planned share. With the advance centred on the motion, e' at t is V'(t - W/2) +
//! K/W (V'(t) - V'(t - W)) + events(t - W/2), K the advance (its largest, where it is a curve) and W its window; the flow
//! without the events is what is to arrive, of which the motor is asked for more.

use crate::settings::Settings;
use headway_firmware::path::spline::Span;
use headway_firmware::steps::delay::{advance_centre_ticks, window_ticks};
use headway_protocol::segment::{FlowAction, FlowEvent};
use headway_protocol::units::{CHANNEL_VOLUME, Units};
use std::collections::VecDeque;

/// Points at which a servo tick is evaluated: the shortest events peak within one.
const LOOKS_PER_TICK: u32 = 2;

/// The extruder's use of its limits, stream so far.
#[derive(Clone, Debug, Default)]
pub struct ExtruderUse {
    /// Largest rate and acceleration.
    pub ratios: [f64; 2],
    /// Both of the deposit at the last points, one window of the advance in all.
    deposit: VecDeque<[f64; 2]>,
    /// Servo ticks so far.
    ticks: f64,
    /// Start (servo ticks) and event, in order; those that may not have ended.
    events: VecDeque<(f64, FlowEvent)>,
}

impl ExtruderUse {
    /// Evaluates the next span; `events` begin in it.
    pub fn add(&mut self, span: &Span, events: &[FlowEvent], settings: &Settings) {
        let (extruder, servo_hz) = (&settings.machine.extruder, settings.machine.servo_hz);
        let share = settings.plan_share;
        let asked = settings.machine.curves.asked();
        let limits = [extruder.speed_max_mm3_s, extruder.acceleration_max_mm3_s2];
        let window = (window_ticks(extruder, servo_hz) * LOOKS_PER_TICK) as usize;
        let delay_ticks = advance_centre_ticks(extruder, servo_hz);
        let behind = (delay_ticks * LOOKS_PER_TICK) as usize;
        let gain =
            extruder.pressure_advance_s * f64::from(servo_hz * LOOKS_PER_TICK) / window as f64;
        let servo_hz = f64::from(servo_hz);
        let start = |event: &FlowEvent| self.ticks + f64::from(event.offset_ticks);
        self.events
            .extend(events.iter().map(|event| (start(event), *event)));
        self.deposit.resize(window, [0.0; 2]);
        for look in 0..u32::from(span.duration_ticks) * LOOKS_PER_TICK {
            let local = f64::from(look) / f64::from(LOOKS_PER_TICK);
            self.deposit
                .push_back(span.rate_and_acceleration_of(CHANNEL_VOLUME, local, servo_hz));
            let [before, middle, now] = [0, window - behind, window].map(|at| self.deposit[at]);
            self.deposit.pop_front();
            let at = self.ticks + local - f64::from(delay_ticks);
            let event = self.events_at(at, servo_hz, &span.units);
            let flow: [f64; 2] = std::array::from_fn(|k| middle[k] + gain * (now[k] - before[k]));
            let [rate, slope] = asked.at(flow[0].max(0.0));
            let of_motor = [rate + flow[0].min(0.0), slope * flow[1]];
            for (derivative, most) in self.ratios.iter_mut().enumerate() {
                let value = of_motor[derivative] + event[derivative];
                let ratio = value.abs() / (limits[derivative] * share);
                // A value that is not a number must not pass.
                if ratio > *most || ratio.is_nan() {
                    *most = ratio;
                }
            }
        }
        self.ticks += f64::from(span.duration_ticks);
    }

    /// Rate and acceleration of primes and retracts, which follow x³ (10 - 15 x + 6 x²) of their volume.
    fn events_at(&mut self, ticks: f64, servo_hz: f64, units: &Units) -> [f64; 2] {
        let duration = |event: &FlowEvent| f64::from(event.duration_ticks.0);
        let has_ended = |(start, event): &(f64, FlowEvent)| ticks >= start + duration(event);
        while self.events.front().is_some_and(has_ended) {
            self.events.pop_front();
        }
        let mut sum = [0.0; 2];
        for (start, event) in self.events.iter().take_while(|(start, _)| *start <= ticks) {
            let duration_s = duration(event) / servo_hz;
            let x = ((ticks - start) / duration(event)).min(1.0);
            let rest = 1.0 - x;
            let volume_mm3 = f64::from(event.volume_units) / units.per_natural(CHANNEL_VOLUME);
            let per_s = match event.action {
                FlowAction::Prime => volume_mm3 / duration_s,
                FlowAction::Retract => -volume_mm3 / duration_s,
            };
            sum[0] += per_s * 30.0 * x * x * rest * rest;
            sum[1] += per_s * 60.0 * x * rest * (1.0 - 2.0 * x) / duration_s;
        }
        sum
    }
}
