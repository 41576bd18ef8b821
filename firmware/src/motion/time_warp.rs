//! The path rate sigma: how fast segment time flows, 1 = as planned.
//!
//! Feed override, pause, resume and running out of segments are all ramps of sigma. Acceleration
//! of a joint is sigma² q'' + sigma' q' (path/load.rs), so the slope is bounded by
//! (1 - alpha sigma²) / beta, and sigma stays below the ceiling of the queue (path/queue.rs), from
//! which the head can always come to rest on the path. While neither wants less than 1, sigma is
//! exactly 1 and the steps are those of the plan.
//!
//! Requested ramps (override, pause, resume) also increase and decrease their slope gradually, over
//! `SLOPE_TICKS`, and change smoothly when they are cancelled, so that the joints' acceleration does not
//! jump. The same is true of a ramp for the end of the queue, if the end is detected in time; one for a
//! limit may use its full slope at once. Both may end abruptly, because their end point is fixed. The
//! extruder's speed does not jump in either: pressure advance is smoothed over its window (flow/mod.rs),
//! and its acceleration is part of the load.

use crate::design::{CEILING_OPEN, PATH_RATE_MAX, WARP_ROOM};
use crate::numbers::real::{Real, smaller};
use crate::path::interpolator::TICK_Q16;
use crate::path::load::SpanLoad;
use crate::path::queue::Ceiling;

/// Servo ticks in which a requested ramp reaches its full slope: 8 ms at 2 kHz, a tenth of the rest
/// from 150 mm/s.
const SLOPE_TICKS: f32 = 16.0;

/// Present rate, 2^-16.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TimeWarp {
    rate_q16: u32,
    /// Change of the rate in the last tick.
    slope: f32,
    /// The queue's end holds the rate down, or did when the head came to rest.
    is_held: bool,
}

/// What bounds the rate in this servo tick.
#[derive(Clone, Copy, Debug)]
pub struct WarpBounds {
    /// Requested rate, 2^-16: override or 0.
    pub wanted_q16: u32,
    /// Segment time left in the present span, servo ticks.
    pub remaining_ticks: f32,
    /// Demands of the present span.
    pub load: SpanLoad,
    /// Demands of the next span, or of the present one again.
    pub next_load: SpanLoad,
    /// sigma² allowed at the present span's end.
    pub ceiling_at_end: Ceiling,
    /// The head rests here (q' = q'' = 0): the rate may jump.
    pub at_rest: bool,
}

impl TimeWarp {
    /// Present rate, 2^-16.
    pub fn rate_q16(&self) -> u32 {
        self.rate_q16
    }

    /// Stops segment time immediately.
    pub fn stop(&mut self) {
        self.rate_q16 = 0;
        self.slope = 0.0;
    }

    /// True while the queue's end limits the rate, until the head is released again.
    pub fn is_held(&self) -> bool {
        self.is_held
    }

    /// Nothing limits the rate.
    #[inline(always)]
    pub fn let_go(&mut self) {
        self.is_held = false;
    }

    /// After a step that the queue's end `limited`, or not: true if it limits the rate from now on. It then stays so
    /// until the head no longer slows down.
    pub fn hold(&mut self, limited: bool, before_q16: u32) -> bool {
        let was_held = self.is_held;
        self.is_held = limited || (was_held && self.rate_q16 < before_q16);
        self.is_held && !was_held
    }

    /// Starts from rest, where the rate may jump and nothing limits it.
    #[inline(always)]
    pub fn start(&mut self, rate_q16: u32) {
        self.rate_q16 = rate_q16;
        self.slope = 0.0;
    }

    /// Next rate, 2^-16. True as second value if the queue's end keeps it below the requested rate.
    /// `stop_ahead`: near the end, gives the stop ceiling a number of ticks ahead.
    pub fn step(
        &mut self,
        bounds: &WarpBounds,
        stop_ahead: Option<impl Fn(f32) -> f32>,
    ) -> (u32, bool) {
        const PER_TICK: f32 = 1.0 / TICK_Q16 as f32;
        let wanted_q16 = bounds.wanted_q16;
        let old = self.rate_q16 as f32 * PER_TICK;
        let wanted = wanted_q16 as f32 * PER_TICK;
        let ramped = bounds.ramped(old, wanted, self.slope);
        let (free, most) = bounds.bounded(old, ramped);
        let rate = bounds.gentle(old, most, self.slope, stop_ahead);
        self.rate_q16 = if rate == wanted {
            wanted_q16
        } else {
            (rate * TICK_Q16 as f32) as u32
        };
        // Only a requested slope is reduced: what a limit demands may end at once.
        let asked = !bounds.at_rest && rate != wanted && (rate == ramped || rate < most);
        self.slope = if asked { rate - old } else { 0.0 };
        // Where the limits of what comes are tighter, both ceilings are one curve, and what the looser
        // one takes in the tick that crosses into the next span is theirs.
        let end = &bounds.ceiling_at_end;
        let held = rate < most || (most < free && end.stop < end.limits);
        (self.rate_q16, held)
    }
}

impl WarpBounds {
    /// From `old` towards `wanted` as fast as the joints allow, the slope built up from `last`; a slope
    /// in the other direction is reduced first.
    fn ramped(&self, old: f32, wanted: f32, last: f32) -> f32 {
        if old == wanted || self.at_rest {
            return wanted;
        }
        let full = self.slope(old, old);
        let step = if wanted < old {
            -eased(full, -last, old - wanted)
        } else {
            eased(full, last, wanted - old)
        };
        let reached = old + step;
        if step <= 0.0 {
            let least = if wanted < old { wanted } else { 0.0 };
            return reached.larger(least);
        }
        // The room shrinks while the rate grows: take the slope of where it will be.
        let step = smaller(step, self.slope(reached, reached));
        let most = if wanted > old { wanted } else { PATH_RATE_MAX };
        smaller(old + step, most)
    }

    /// Safe |sigma'| per tick at `rate`, over the spans that the tick can touch.
    fn slope(&self, rate: f32, step_ticks: f32) -> f32 {
        let square = rate * rate;
        let here = slope_of(&self.load, square);
        if step_ticks < self.remaining_ticks {
            here
        } else {
            smaller(here, slope_of(&self.next_load, square))
        }
    }

    /// Not above 1 further than the limits of this and the coming spans allow, and, second, not faster
    /// than the head can be stopped by the end of the queue.
    fn bounded(&self, old: f32, rate: f32) -> (f32, f32) {
        let ends = self.ceiling_at_end.stop < CEILING_OPEN;
        if rate <= 1.0 && !ends {
            return (rate, rate);
        }
        let here = self.ceiling_at_end.before(self.remaining_ticks, &self.load);
        let ahead = self.ahead(old.larger(rate));
        let free = if rate <= 1.0 {
            rate
        } else {
            self.below(here.limits, ahead.limits, rate).larger(1.0)
        };
        if !ends || free * free <= ahead.stop {
            // Still stoppable from where the tick ends. A plan near its limits lives just below
            // the ceiling; the bound on the ceiling's slope would hold it up on a full queue.
            return (free, free);
        }
        (free, self.below(here.stop, ahead.stop, free).larger(0.0))
    }

    /// Not so fast that the slope could not be built up before the ceiling of the queue's end is met.
    fn gentle(
        &self,
        old: f32,
        rate: f32,
        last: f32,
        stop_ahead: Option<impl Fn(f32) -> f32>,
    ) -> f32 {
        let Some(stop_ahead) = stop_ahead else {
            return rate;
        };
        let full = self.slope(old, old);
        if self.at_rest || full <= 0.0 {
            return rate;
        }
        let build_up = full * (1.0 / SLOPE_TICKS);
        // From this slope to the full one downwards, as slowly as a requested ramp.
        let slope = rate - old;
        let ticks = (slope + full) / build_up;
        if ticks <= 0.0 {
            return rate;
        }
        let fits = [0.5, 1.0].iter().all(|part| {
            let ticks = part * ticks;
            let reached = rate + ticks * (slope - 0.5 * build_up * ticks);
            let way = ticks * (rate + ticks * (0.5 * slope - build_up * ticks * (1.0 / 6.0)));
            // A tick further, so that the ceiling itself is hardly ever met.
            reached <= 0.0 || reached * reached <= stop_ahead(rate + way + reached)
        });
        if fits {
            return rate;
        }
        smaller(rate, old + (last - build_up).larger(-full))
    }

    /// Ceilings after one tick at `rate`.
    fn ahead(&self, rate: f32) -> Ceiling {
        let left = self.remaining_ticks - rate;
        if left > 0.0 {
            return self.ceiling_at_end.before(left, &self.load);
        }
        let end = self.ceiling_at_end;
        let drop = -2.0 * left * slope_of(&self.next_load, end.stop);
        Ceiling {
            stop: (end.stop - drop).larger(0.0),
            limits: end.limits,
        }
    }

    /// Largest rate up to `rate` after which the ceiling still holds one tick later: sigma² <= here -
    /// 2 k sigma, with the ceiling's slope 2k where it is steepest.
    fn below(&self, here: f32, ahead: f32, rate: f32) -> f32 {
        let steepest = slope_of(&self.load, ahead).larger(slope_of(&self.next_load, ahead));
        if here >= CEILING_OPEN && ahead >= CEILING_OPEN || rate * (rate + 2.0 * steepest) <= here {
            return rate;
        }
        let highest = (steepest * steepest + here).root() - steepest;
        smaller(highest, rate)
    }
}

/// Change of rate in this tick, on a ramp with `way` to go whose last tick changed it by `last`: at most
/// `full`, increased and reduced by `full / SLOPE_TICKS`. Negative while a ramp in the other direction
/// is reduced.
fn eased(full: f32, last: f32, way: f32) -> f32 {
    let build_up = full * (1.0 / SLOPE_TICKS);
    let risen = last + build_up;
    if risen < 0.0 {
        return risen.larger(-full);
    }
    // Slopes s, s - b, s - 2 b, ... add up to s² / 2b + s / 2.
    let half = 0.5 * build_up;
    let ending = (half * half + 2.0 * build_up * way).root() - half;
    smaller(smaller(risen, ending), full).larger(half)
}

/// (1 - alpha sigma²) / beta, with a little in reserve for ticks that end in another span.
fn slope_of(load: &SpanLoad, square: f32) -> f32 {
    let room = WARP_ROOM - load.alpha * square;
    if room > 0.0 {
        room / load.beta_ticks
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    //! Goal: ramps keep their slope, reach rest at the end of the queue and never before or after.
    //! Method: one long span with known load, integrated tick by tick.
    use super::*;
    use crate::design::WARP_ROOM;

    const LOAD: SpanLoad = SpanLoad {
        alpha: 0.5,
        beta_ticks: 30.0,
        rate_squared_max: CEILING_OPEN,
    };

    fn bounds(wanted: f32, remaining_ticks: f32, ceiling_at_end: Ceiling) -> WarpBounds {
        WarpBounds {
            wanted_q16: (wanted * TICK_Q16 as f32) as u32,
            remaining_ticks,
            load: LOAD,
            next_load: LOAD,
            ceiling_at_end,
            at_rest: false,
        }
    }

    /// With the queue's end far away.
    fn step(warp: &mut TimeWarp, bounds: &WarpBounds) -> (u32, bool) {
        warp.step(bounds, None::<fn(f32) -> f32>)
    }

    fn rate(warp: &TimeWarp) -> f32 {
        warp.rate_q16() as f32 / TICK_Q16 as f32
    }

    #[test]
    fn the_head_comes_to_rest_exactly_at_the_end_of_the_queue() {
        let mut warp = TimeWarp::default();
        let mut at_rest = bounds(1.0, 4000.0, Ceiling::OPEN);
        at_rest.at_rest = true;
        assert_eq!(step(&mut warp, &at_rest), (TICK_Q16, false));
        let (mut remaining, mut held_ticks) = (300.0f32, 0);
        for _ in 0..2000 {
            let before = rate(&warp);
            let (_, held) = step(&mut warp, &bounds(1.0, remaining, Ceiling::END));
            held_ticks += u32::from(held);
            let now = rate(&warp);
            let used = LOAD.alpha * before * before + (before - now).abs() * LOAD.beta_ticks;
            assert!(
                used < 1.0,
                "{used} of the full limit at rate {now}, {remaining} left"
            );
            assert!(now <= remaining, "{now} {remaining}");
            remaining -= now;
        }
        assert!(remaining < 0.01, "{remaining} ticks left");
        assert!(held_ticks > 20);
    }

    /// Goal: on a full queue the limits of what comes hold the rate, and nothing is said of its end.
    /// Method: the tick of a gear at 200 % that crosses into a span where both ceilings nearly meet, as
    /// it was met; and the same with an end that is in fact nearer.
    #[test]
    fn limits_of_what_comes_are_not_taken_for_the_end_of_the_queue() {
        let mut crossing = bounds(2.0, 0.06, Ceiling::END);
        crossing.load.beta_ticks = 12.193;
        crossing.load.alpha = 0.2066;
        crossing.next_load.beta_ticks = 10.087;
        crossing.next_load.alpha = 0.1884;
        for (stop, limits, held) in [(3.168_623, 3.168_619, false), (3.0, 3.168_619, true)] {
            crossing.ceiling_at_end = Ceiling { stop, limits };
            let mut warp = TimeWarp {
                rate_q16: (1.768_066_4 * TICK_Q16 as f32) as u32,
                slope: 0.0,
                is_held: false,
            };
            assert_eq!(step(&mut warp, &crossing).1, held, "{stop}");
            let (rate, most) = (rate(&warp), stop.min(limits).sqrt());
            assert!(rate < most && rate > most - 0.1, "{rate}");
        }
    }

    #[test]
    fn a_pause_and_a_resume_ramp_with_the_allowed_slope() {
        let mut warp = TimeWarp::default();
        let mut rates = std::vec::Vec::new();
        for wanted in [1.0f32, 0.0, 1.5, 0.3] {
            for _ in 0..400 {
                step(&mut warp, &bounds(wanted, 1e6, Ceiling::OPEN));
                rates.push(rate(&warp));
            }
            let reached = rate(&warp);
            // Above 1 the span's own acceleration bounds it: 0.985 / 0.5.
            let most = (WARP_ROOM / LOAD.alpha).sqrt();
            assert!(
                (reached - wanted.min(most)).abs() < 0.02,
                "{wanted}: {reached}"
            );
        }
        for pair in rates.windows(2) {
            let largest = pair[0].max(pair[1]);
            let used = LOAD.alpha * largest * largest + (pair[1] - pair[0]).abs() * LOAD.beta_ticks;
            assert!(used < 1.03, "{used} at {pair:?}");
        }
    }

    #[test]
    fn the_slope_of_a_ramp_that_was_asked_for_is_built_up_and_taken_back() {
        let mut warp = TimeWarp::default();
        let mut rates = std::vec![0.0f32, 0.0];
        for wanted in [1.0f32, 0.0, 1.2, 0.3] {
            for _ in 0..400 {
                step(&mut warp, &bounds(wanted, 1e6, Ceiling::OPEN));
                rates.push(rate(&warp));
            }
        }
        let steepest = WARP_ROOM / LOAD.beta_ticks;
        let mut full = 0;
        for three in rates.windows(3) {
            let [before, after] = [three[1] - three[0], three[2] - three[1]];
            // The allowed slope itself changes with the rate, by half from rest to 1; two steps of
            // the fixed-point rate.
            let most = 1.6 * steepest / SLOPE_TICKS + 2.0 / TICK_Q16 as f32;
            assert!((after - before).abs() <= most, "{three:?}");
            full += u32::from(after.abs() > 0.9 * slope_of(&LOAD, three[1] * three[1]));
        }
        assert!(full > 30, "the whole slope is used: {full}");
    }

    #[test]
    fn an_end_that_is_seen_in_time_is_met_gently_and_exactly() {
        let mut warp = TimeWarp::default();
        let mut at_rest = bounds(1.0, 4000.0, Ceiling::OPEN);
        at_rest.at_rest = true;
        step(&mut warp, &at_rest);
        let (mut remaining, mut rates) = (300.0f32, std::vec![1.0f32, 1.0]);
        for _ in 0..2000 {
            let stop_ahead = |ticks: f32| match remaining - ticks {
                left if left > 0.0 => Ceiling::END.before(left, &LOAD).stop,
                _ => 0.0,
            };
            warp.step(&bounds(1.0, remaining, Ceiling::END), Some(stop_ahead));
            rates.push(rate(&warp));
            remaining -= rate(&warp);
        }
        assert!((0.0..0.01).contains(&remaining), "{remaining} ticks left");
        let mut bent = 0;
        for three in rates.windows(3) {
            // Until it is so slow that the end comes before the slope.
            if three[2] < 0.4 {
                break;
            }
            let full = slope_of(&LOAD, three[1] * three[1]);
            let bend = (three[2] - 2.0 * three[1] + three[0]).abs();
            assert!(bend < 0.15 * full, "{three:?}");
            bent += u32::from(bend > 0.04 * full);
        }
        assert!(bent > 10, "{bent}");
    }

    #[test]
    fn a_ramp_that_is_called_back_bends_round() {
        let mut warp = TimeWarp::default();
        let mut rates = std::vec![0.0f32, 0.0];
        // Each is called back in the middle, on its full slope.
        for (wanted, ticks) in [(1.0f32, 25), (0.0, 25), (1.2, 30), (0.3, 400)] {
            for _ in 0..ticks {
                step(&mut warp, &bounds(wanted, 1e6, Ceiling::OPEN));
                rates.push(rate(&warp));
            }
        }
        let most = 1.6 * WARP_ROOM / LOAD.beta_ticks / SLOPE_TICKS + 2.0 / TICK_Q16 as f32;
        let mut goes_on = 0;
        for (tick, three) in rates.windows(3).enumerate() {
            let [before, after] = [three[1] - three[0], three[2] - three[1]];
            assert!((after - before).abs() <= most, "{three:?}");
            goes_on += u32::from(tick > 25 && tick < 40 && after > 0.0);
        }
        assert!(goes_on > 5, "the slope is taken back: {goes_on}");
        assert!((rate(&warp) - 0.3).abs() < 1e-3);
    }

    #[test]
    fn a_steady_rate_stays_exactly_one() {
        let mut warp = TimeWarp::default();
        let mut start = bounds(1.0, 100.0, Ceiling::OPEN);
        start.at_rest = true;
        step(&mut warp, &start);
        for remaining in (1..2000).rev() {
            let (rate_q16, held) = step(&mut warp, &bounds(1.0, remaining as f32, Ceiling::OPEN));
            assert_eq!((rate_q16, held), (TICK_Q16, false));
        }
    }
}
