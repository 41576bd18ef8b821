//! The share of the printing time that each limit determines, the places where the nozzle is
//! slowest, those where beads are uneven, and the largest use of the limits.
//!
//! [`SegmentStream`] -> shares by the name of the limit, the slowest and the uneven places, ratios to the planned share.
//! At every servo tick of a pass the limit with the highest use counts, if that is at least `AT_LIMIT` of its planned share;
//! otherwise none does ("none": the motion is between one limit and another, or the segments' fit
//! slows it). The extruder with its events, which is hardly ever the limit, counts for the ratios only.

use crate::drive::evenness::{Evenness, Sample, Uneven, UnevenPlaces};
use crate::drive::extruder_use::ExtruderUse;
use crate::drive::moment::Moment;
use crate::job::{MotionState, SegmentStream};
use crate::settings::{Settings, joint_names};
use headway_firmware::path::spline::Span;
use headway_protocol::units::{CHANNEL_HEADING, CHANNEL_VOLUME, CHANNELS};
use std::collections::BTreeMap;

/// Share of a limit at which it counts as reached: what the time law and the fit leave below it.
const AT_LIMIT: f64 = 0.9;
/// Path length of a place, mm: about the width of the widest bead.
const PLACE_MM: f64 = 1.0;
/// Maximum number of points of a span that are evaluated: every tick of all that do not crawl. A span is a cubic of a
/// tenth of a millimetre or 128 ms, of which accelerations have their extremes at its ends.
const LOOKS_A_SPAN: u16 = 64;
/// Number of reported places.
const PLACES: usize = 5;

/// A slow stretch of about a millimetre of a pass.
#[derive(Clone, Debug, PartialEq)]
pub struct SlowPlace {
    /// Its first point, machine coordinates.
    pub at_mm: [f64; 3],
    /// Its duration.
    pub seconds: f64,
    /// The limit with the largest share of that.
    pub limit: String,
    /// Layer from 0.
    pub layer: u32,
}

/// The printing time by limit.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TimeByLimit {
    /// Share of the printing time by the name of the limit, including "none".
    pub shares: BTreeMap<String, f64>,
    /// The slowest first.
    pub slow_places: Vec<SlowPlace>,
    /// Where beads are uneven, by kind.
    pub uneven: BTreeMap<Uneven, UnevenPlaces>,
    /// Largest speed, acceleration and jerk of the whole motion, as ratios to the planned share of their limits.
    pub ratios: [f64; 3],
    /// Largest heading rate.
    pub heading_rate_max_rad_s: f64,
    /// Largest flow.
    pub flow_max_mm3_s: f64,
    /// Heading travelled in all.
    pub heading_travel_rad: f64,
}

/// A limit: (which derivative, which quantity); quantities are the joints, then tip and flow.
type Key = Option<(usize, usize)>;
const DERIVATIVES: [&str; 3] = ["speed", "acceleration", "jerk"];

/// Evaluates the complete stream.
pub fn time_by_limit(stream: &SegmentStream, settings: &Settings) -> TimeByLimit {
    let mut tally = TimeTally::default();
    tally.add(stream, settings);
    tally.finish(settings)
}

/// Counts a stream part by part.
#[derive(Default)]
pub struct TimeTally {
    ticks: BTreeMap<Key, u64>,
    places: Places,
    evenness: Evenness,
    extruder: ExtruderUse,
    /// What is known of the whole motion.
    whole: TimeByLimit,
}

impl TimeTally {
    /// Counts the next part, which begins at rest.
    pub fn add(&mut self, piece: &SegmentStream, settings: &Settings) {
        let servo_hz = f64::from(settings.machine.servo_hz);
        let mut marks = piece.marks.iter();
        let mut mark = marks.next();
        let mut events = piece.events.as_slice();
        for span in piece.spans() {
            while mark.is_some_and(|mark| span.start_tick >= mark.end_tick) {
                mark = marks.next();
                self.places.close();
            }
            let begun = events.partition_point(|event| event.span as usize <= span.index);
            let (own, later) = events.split_at(begun);
            events = later;
            self.extruder.add(&span, own, settings);
            let state = mark.map(|mark| mark.state);
            let tip_mm_s = match state {
                Some(MotionState::Travel) => settings.travel_speed_mm_s,
                _ => settings.speed_mm_s,
            };
            if state != Some(MotionState::Print) {
                self.evenness.end();
            }
            // Accelerations have their extremes at the ends of a span, and its jerk differs from the next one's.
            for end in [0.0, f64::from(span.duration_ticks)] {
                self.look(&Moment::of(&span, end, servo_hz), tip_mm_s, settings);
            }
            self.places.layer = mark.map_or(0, |mark| mark.layer);
            // Each evaluated point represents the ticks up to the next one.
            let stride = span.duration_ticks.div_ceil(LOOKS_A_SPAN).max(1);
            for tick in (0..span.duration_ticks).step_by(usize::from(stride)) {
                let ticks = stride.min(span.duration_ticks - tick);
                let middle = f64::from(tick) + 0.5 * f64::from(ticks);
                let moment = Moment::of(&span, middle, servo_hz);
                let key = self.look(&moment, tip_mm_s, settings);
                let turned_rad =
                    moment.velocity[CHANNEL_HEADING].abs() * f64::from(ticks) / servo_hz;
                self.whole.heading_travel_rad += turned_rad;
                if state == Some(MotionState::Print) {
                    *self.ticks.entry(key).or_default() += u64::from(ticks);
                    self.places
                        .add(&span, &moment, key, [f64::from(ticks), servo_hz]);
                    let sample = Sample {
                        moment: &moment,
                        ticks: f64::from(ticks),
                        is_limited: key.is_some(),
                        layer: self.places.layer,
                    };
                    self.evenness.add(&sample, settings);
                }
            }
        }
        self.places.close();
        self.evenness.end();
    }

    /// Notes what a moment uses of the limits; the one that is used most, if it is reached.
    fn look(&mut self, moment: &Moment, tip_mm_s: f64, settings: &Settings) -> Key {
        let whole = &mut self.whole;
        let heading_rad_s = moment.velocity[CHANNEL_HEADING].abs();
        whole.heading_rate_max_rad_s = whole.heading_rate_max_rad_s.max(heading_rad_s);
        whole.flow_max_mm3_s = (whole.flow_max_mm3_s).max(moment.velocity[CHANNEL_VOLUME]);
        binding(moment, tip_mm_s, settings, |derivative, used| {
            let ratio = used / settings.plan_share;
            let most = &mut whole.ratios[derivative];
            // A value that is not a number must not pass.
            if ratio > *most || ratio.is_nan() {
                *most = ratio;
            }
        })
    }

    /// The result of all parts.
    pub fn finish(self, settings: &Settings) -> TimeByLimit {
        let servo_hz = f64::from(settings.machine.servo_hz);
        let all: u64 = self.ticks.values().sum();
        let share = |(key, ticks): (Key, u64)| (name(key, settings), ticks as f64 / all as f64);
        let slow = self.places.slowest.into_iter();
        let slow = slow.map(|(ticks, at_mm, key, layer)| SlowPlace {
            at_mm,
            seconds: ticks as f64 / servo_hz,
            limit: name(key, settings),
            layer,
        });
        let [speed, acceleration, jerk] = self.whole.ratios;
        let of_extruder = self.extruder.ratios;
        TimeByLimit {
            shares: self.ticks.into_iter().map(share).collect(),
            slow_places: slow.collect(),
            uneven: self.evenness.found(),
            ratios: [
                speed.max(of_extruder[0]),
                acceleration.max(of_extruder[1]),
                jerk,
            ],
            ..self.whole
        }
    }
}

/// Joints, tip and flow, and the motors of a pair.
fn quantities(settings: &Settings) -> usize {
    let motors = if settings.machine.motors.pair.is_some() {
        2
    } else {
        0
    };
    joint_names(&settings.machine.kinematics).len() + 2 + motors
}

/// Names of all limits of a machine, in words, by the numbers of [`limit_at`].
pub fn limit_names(settings: &Settings) -> Vec<String> {
    let quantities = quantities(settings);
    let keys = (0..DERIVATIVES.len() * quantities).map(|k| Some((k / quantities, k % quantities)));
    keys.map(|key| name(key, settings).replace('_', " "))
        .collect()
}

/// The limit with the highest use at a tick of a span, if one is reached.
pub fn limit_at(span: &Span, t_ticks: f64, settings: &Settings) -> Option<usize> {
    let servo_hz = f64::from(settings.machine.servo_hz);
    let quantities = quantities(settings);
    let moment = Moment::of(span, t_ticks, servo_hz);
    let (derivative, quantity) = binding(&moment, settings.speed_mm_s, settings, |_, _| ())?;
    Some(derivative * quantities + quantity)
}

fn name(key: Key, settings: &Settings) -> String {
    let Some((derivative, quantity)) = key else {
        return "none".to_string();
    };
    let joints = joint_names(&settings.machine.kinematics);
    let quantity = match quantity.checked_sub(joints.len()) {
        None => joints[quantity],
        Some(0) => "tip",
        Some(1) => "flow",
        Some(2) => "sum_motor",
        Some(_) => "difference_motor",
    };
    format!("{quantity}_{}", DERIVATIVES[derivative])
}

/// The limit that is used most at a moment, if it is reached; `note` has the use of each.
fn binding(
    moment: &Moment,
    tip_mm_s: f64,
    settings: &Settings,
    mut note: impl FnMut(usize, f64),
) -> Key {
    let joint_count = joint_names(&settings.machine.kinematics).len();
    let norm = |v: &[f64; CHANNELS]| v[0].hypot(v[1]).hypot(v[2]);
    let mut most = (AT_LIMIT * settings.plan_share, None);
    let mut look = |derivative: usize, quantity: usize, value: f64, limit: f64| {
        let used = value.abs() / limit;
        note(derivative, used);
        if used > most.0 {
            most = (used, Some((derivative, quantity)));
        }
    };
    let [velocity, acceleration, jerk] = moment.joint_derivatives(&settings.machine.kinematics);
    for (joint, limit) in settings.machine.joints.iter().take(joint_count).enumerate() {
        look(0, joint, velocity[joint], limit.speed_max);
        look(1, joint, acceleration[joint], limit.acceleration_max);
        look(2, joint, jerk[joint], limit.jerk_max);
    }
    if let Some(pair) = &settings.machine.motors.pair {
        let motors = [&velocity, &acceleration, &jerk].map(|of| pair.motors_of(of));
        let limits = [pair.speed_max, pair.acceleration_max, pair.jerk_max];
        for (derivative, (motors, limit)) in motors.into_iter().zip(limits).enumerate() {
            for (motor, value) in motors.into_iter().enumerate() {
                look(derivative, joint_count + 2 + motor, value, limit);
            }
        }
    }
    let (tip, flow) = (joint_count, joint_count + 1);
    look(0, tip, norm(&moment.velocity), tip_mm_s);
    look(
        1,
        tip,
        norm(&moment.acceleration),
        settings.tip_acceleration_mm_s2,
    );
    look(
        0,
        flow,
        moment.velocity[CHANNEL_VOLUME],
        settings.flow_max_mm3_s,
    );
    let change_max = settings.flow_rate_of_change_max_mm3_s2;
    look(1, flow, moment.acceleration[CHANNEL_VOLUME], change_max);
    most.1
}

/// Places of [`PLACE_MM`] one after the other; the slowest are kept.
#[derive(Default)]
struct Places {
    way_mm: f64,
    at_mm: [f64; 3],
    layer: u32,
    ticks: BTreeMap<Key, u64>,
    slowest: Vec<(u64, [f64; 3], Key, u32)>,
}

impl Places {
    /// A time that represents a number of ticks of a given rate.
    fn add(&mut self, span: &Span, moment: &Moment, key: Key, [ticks, servo_hz]: [f64; 2]) {
        if self.ticks.is_empty() {
            let at = span.position(0.0);
            self.at_mm = [at[0], at[1], at[2]];
        }
        *self.ticks.entry(key).or_default() += ticks as u64;
        let v = &moment.velocity;
        self.way_mm += ticks * v[0].hypot(v[1]).hypot(v[2]) / servo_hz;
        if self.way_mm >= PLACE_MM {
            self.close();
        }
    }

    fn close(&mut self) {
        let ticks: u64 = self.ticks.values().sum();
        let most = self.ticks.iter().max_by_key(|(_, ticks)| **ticks);
        if let Some((&key, _)) = most {
            self.keep(ticks, key);
        }
        self.ticks.clear();
        self.way_mm = 0.0;
    }

    /// The same place on another layer counts once, where it is slowest.
    fn keep(&mut self, ticks: u64, key: Key) {
        let at_mm = self.at_mm;
        let apart_mm = |other: &[f64; 3]| (other[0] - at_mm[0]).hypot(other[1] - at_mm[1]);
        let mut others = self.slowest.iter();
        if let Some(same) = others.position(|(_, other, ..)| apart_mm(other) < PLACE_MM) {
            if self.slowest[same].0 >= ticks {
                return;
            }
            self.slowest.remove(same);
        }
        let behind = self.slowest.partition_point(|other| other.0 >= ticks);
        self.slowest.insert(behind, (ticks, at_mm, key, self.layer));
        self.slowest.truncate(PLACES);
    }
}

#[cfg(test)]
mod tests {
    //! Goal: shares add up to one, a spiral run at the tip's speed is bound by it, and a limit that
    //! is lowered takes over.
    use super::*;
    use crate::drive::test_streams::spiral;

    #[test]
    fn the_limit_that_is_reached_takes_the_time() {
        let mut settings = Settings::default();
        let stream = spiral(2.0);
        let fastest = |settings: &mut Settings| {
            let found = time_by_limit(&stream, settings);
            let sum: f64 = found.shares.values().sum();
            assert!((sum - 1.0).abs() < 1e-9, "{found:?}");
            assert!((1..=PLACES).contains(&found.slow_places.len()));
            let slow = found.slow_places.windows(2);
            assert!(
                slow.into_iter()
                    .all(|pair| pair[0].seconds >= pair[1].seconds)
            );
            // No place is reported twice.
            for (i, one) in found.slow_places.iter().enumerate() {
                let others = found.slow_places[..i].iter();
                let apart = |other: &SlowPlace| {
                    (other.at_mm[0] - one.at_mm[0]).hypot(other.at_mm[1] - one.at_mm[1])
                };
                assert!(others.into_iter().all(|other| apart(other) >= PLACE_MM));
            }
            found
        };
        settings.speed_mm_s = 1e6;
        let free = fastest(&mut settings);
        assert!(!free.shares.contains_key("tip_speed"), "{free:?}");
        settings.speed_mm_s = 1e-3;
        let bound = fastest(&mut settings);
        assert!(bound.shares["tip_speed"] > 0.9, "{bound:?}");
        assert_eq!(bound.slow_places[0].limit, "tip_speed");
    }

    #[test]
    fn primes_count_towards_the_largest_use() {
        let mut settings = Settings::default();
        let mut stream = spiral(2.0);
        let still = time_by_limit(&stream, &settings).ratios[0];
        // A prime of 0.3 mm³ in 80 ticks peaks at 1.875 · 0.3 / 0.04 s = 14.06 mm³/s.
        settings.machine.extruder.speed_max_mm3_s = 10.0;
        let tight = time_by_limit(&stream, &settings).ratios[0];
        let expected = 14.0625 / (10.0 * settings.plan_share);
        assert!((tight / expected - 1.0).abs() < 1e-3, "{tight}");
        stream.events.clear();
        let without = time_by_limit(&stream, &settings).ratios[0];
        assert!(without < tight && still < tight, "{without} {still}");
    }
}
