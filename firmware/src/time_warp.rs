//! The path rate sigma: how fast segment time flows, 1 = as planned.
//!
//! Feed override, pause, resume and running out of segments are all ramps of sigma. Acceleration
//! of a joint is sigma² q'' + sigma' q' (load.rs), so the slope is bounded by
//! (1 - alpha sigma²) / beta, and sigma stays below the ceiling of the queue (queue.rs), from
//! which the head can always come to rest on the path. While neither wants less than 1, sigma is
//! exactly 1 and the steps are those of the plan.

use crate::design::PATH_RATE_MAX;
use crate::interpolator::TICK_Q16;
use crate::load::SpanLoad;
use crate::queue::ceiling_before;

/// Present rate, 2^-16.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TimeWarp {
    rate_q16: u32,
}

/// What bounds the rate in this servo tick.
#[derive(Clone, Copy, Debug)]
pub struct WarpBounds {
    /// Rate asked for, 2^-16: override or 0.
    pub wanted_q16: u32,
    /// Segment time left in the present span, servo ticks.
    pub remaining_ticks: f32,
    /// Demands of the present span.
    pub load: SpanLoad,
    /// Demands of the next span, or of the present one again.
    pub next_load: SpanLoad,
    /// sigma² allowed at the present span's end.
    pub ceiling_at_end: f32,
    /// The head rests here (q' = q'' = 0): the rate may jump.
    pub at_rest: bool,
}

impl TimeWarp {
    /// Present rate, 2^-16.
    pub fn rate_q16(&self) -> u32 {
        self.rate_q16
    }

    /// Stops segment time at once.
    pub fn stop(&mut self) {
        self.rate_q16 = 0;
    }

    /// Next rate. True as second value if the queue's end holds it below what is wanted.
    pub fn step(&mut self, bounds: &WarpBounds) -> (u32, bool) {
        let old_q16 = self.rate_q16;
        let wanted_q16 = bounds.wanted_q16;
        let old = old_q16 as f32 * (1.0 / TICK_Q16 as f32);
        let wanted = wanted_q16 as f32 * (1.0 / TICK_Q16 as f32);
        let here = ceiling_before(bounds.ceiling_at_end, bounds.remaining_ticks, &bounds.load);
        let slope = bounds.slope(old * old, old);
        // Most ticks: nothing limits, nothing changes.
        if old_q16 == wanted_q16 && here > 1.1 * PATH_RATE_MAX {
            return (old_q16, false);
        }
        let ramped = if bounds.at_rest {
            wanted
        } else if wanted > old {
            (old + slope).min(wanted)
        } else {
            (old - slope).max(wanted)
        };
        let highest = bounds.highest_rate(here, old.max(ramped));
        let held = highest < ramped;
        let rate = if held { highest } else { ramped };
        self.rate_q16 = if rate == wanted {
            wanted_q16
        } else {
            (rate.max(0.0) * TICK_Q16 as f32) as u32
        };
        (self.rate_q16, held && highest < wanted)
    }
}

impl WarpBounds {
    /// Safe |sigma'| per tick at sigma² = `square`, over the spans that a tick can touch.
    fn slope(&self, square: f32, rate: f32) -> f32 {
        let here = slope_of(&self.load, square);
        if rate < self.remaining_ticks {
            here
        } else {
            here.min(slope_of(&self.next_load, square))
        }
    }

    /// Largest rate after which the ceiling still holds, one tick of that rate later. With the
    /// ceiling's slope 2k taken where it is steepest: sigma² <= here - 2 k sigma.
    fn highest_rate(&self, here: f32, rate: f32) -> f32 {
        let (ahead, load) = if rate < self.remaining_ticks {
            let left = self.remaining_ticks - rate;
            (
                ceiling_before(self.ceiling_at_end, left, &self.load),
                &self.load,
            )
        } else {
            (self.ceiling_at_end, &self.next_load)
        };
        if here >= crate::queue::CEILING_OPEN && ahead >= crate::queue::CEILING_OPEN {
            return PATH_RATE_MAX;
        }
        let steepest = slope_of(&self.load, ahead).max(slope_of(load, ahead));
        libm::sqrtf(steepest * steepest + here) - steepest
    }
}

/// (1 - alpha sigma²) / beta.
fn slope_of(load: &SpanLoad, square: f32) -> f32 {
    let room = 1.0 - load.alpha * square;
    if room > 0.0 {
        room / load.beta_ticks
    } else {
        0.0
    }
}
