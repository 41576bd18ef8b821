//! The path rate of a servo tick, and the advance of segment time by it.
//!
//! In: the rates requested by override, pause and flow (2^-16), the spans' loads and ceilings. Out: the
//! advanced segment time, and the phase where the head came to rest. The effect of limits on the rate is in
//! `motion/time_warp.rs`.

use super::Motion;
use super::state::State;
use crate::design::CEILING_OPEN;
use crate::flow::UNSCALED_Q16;
use crate::motion::time_warp::WarpBounds;
use crate::path::interpolator::TICK_Q16;

impl Motion {
    /// Chooses the path rate and moves segment time on by it.
    pub(super) fn move_on(&mut self) {
        let wanted_q16 = self.wanted_rate_q16();
        if wanted_q16 == 0 && self.warp.rate_q16() == 0 {
            self.rest();
            return;
        }
        self.hold.moving();
        let rate_q16 = if self.is_unlimited(wanted_q16) {
            self.warp.let_go();
            wanted_q16
        } else {
            self.ask_warp(wanted_q16)
        };
        if rate_q16 != TICK_Q16 {
            self.off_plan_ticks = self.now_ticks as u32;
        }
        self.interpolator.advance(rate_q16, &mut self.queue);
        self.note_rest(rate_q16, wanted_q16);
    }

    /// True if nothing limits the requested rate, as in nearly all ticks, so that the time warp need not be
    /// evaluated: a steady one, or one from rest, of up to 1 where the outlook is free.
    #[inline(always)]
    fn is_unlimited(&mut self, wanted_q16: u32) -> bool {
        if wanted_q16 > TICK_Q16 || !self.interpolator.is_free(wanted_q16, &self.queue) {
            return false;
        }
        if wanted_q16 != self.warp.rate_q16() {
            if !self.interpolator.is_at_rest_point() {
                return false;
            }
            self.warp.start(wanted_q16);
        }
        true
    }

    /// The next path rate; notes whether the queue's end holds it.
    // Its registers are not to be those of all ticks.
    #[inline(never)]
    fn ask_warp(&mut self, wanted_q16: u32) -> u32 {
        let before_q16 = self.warp.rate_q16();
        let (interpolator, queue) = (&self.interpolator, &self.queue);
        let load = *interpolator.load();
        let remaining_ticks = interpolator.remaining_q16() as f32 / TICK_Q16 as f32;
        let bounds = WarpBounds {
            wanted_q16,
            remaining_ticks,
            load,
            next_load: queue.front().map_or(load, |next| next.load),
            ceiling_at_end: interpolator.ceiling_at_end(queue),
            at_rest: interpolator.is_at_rest_point(),
        };
        let stop_ahead = |ticks: f32| {
            if ticks < remaining_ticks {
                bounds
                    .ceiling_at_end
                    .before(remaining_ticks - ticks, &load)
                    .stop
            } else if interpolator.ends_at_rest() {
                CEILING_OPEN
            } else {
                queue.stop_ahead(ticks - remaining_ticks)
            }
        };
        let stop_ahead = queue.is_short().then_some(stop_ahead);
        let (rate_q16, limited) = self.warp.step(&bounds, stop_ahead);
        if self.warp.hold(limited, before_q16) {
            self.underruns = self.underruns.saturating_add(1);
        }
        rate_q16
    }

    /// Rate requested by override and pause, before any limit.
    fn wanted_rate_q16(&self) -> u32 {
        match &self.state {
            State::Running(stream) if self.may_move(stream) => self.rate_asked_q16(),
            _ => 0,
        }
    }

    fn rate_asked_q16(&self) -> u32 {
        let asked = self.override_q16;
        if self.interpolator.is_dwell() {
            // A dwell waits for melt, which runs in real time whatever the override.
            return TICK_Q16;
        }
        let factor_q16 = self.flow.factor_q16();
        if factor_q16 > UNSCALED_Q16 {
            // More melt than planned at the planned motor speed: the head goes slower.
            return asked.min(u32::MAX / factor_q16);
        }
        asked
    }
}
