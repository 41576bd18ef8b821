//! Durations of interrupts, by the gaps that they leave in a loop of the main loop's which reads a clock.
//!
//! Nothing is added to the interrupts, and what the core itself needs to enter and leave them counts as well. In: a
//! [`BoardClock`]. Out: the first gap, with the step ticks that were due in it. Not covered: what interrupts, which the
//! caller knows by what it masks.

/// A board's free-running clock.
pub trait BoardClock {
    /// Longer than the loop needs from one reading to the next, shorter than any interrupt.
    const GAP_CLOCKS: u32;
    /// Now; wraps at 2^32.
    fn now_clocks() -> u32;
}

/// The timer of the step ticks, in clocks of the [`BoardClock`]: from one to the next, and until the next.
#[derive(Clone, Copy, Debug)]
pub struct StepTimer<F> {
    /// Period.
    pub period_clocks: u32,
    /// Reads the timer.
    pub until_step_clocks: F,
}

/// Readings in one search at most: they end it where the clock has stopped.
const READINGS_MAX: u32 = 20_000;

/// An interruption of the loop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Gap {
    /// Its duration without that of the loop itself, in thousandths of a clock.
    pub milliclocks: u32,
    /// Step ticks that were due in it.
    pub steps: u32,
}

/// The first gap within this many clocks; none as well where the loop was interrupted too soon to know its own duration.
#[inline(always)]
pub fn next_gap<C: BoardClock>(
    timer: StepTimer<impl FnOnce() -> u32>,
    wait_clocks: u32,
) -> Option<Gap> {
    let before = C::now_clocks();
    let until_step = (timer.until_step_clocks)();
    let begun = C::now_clocks();
    let setting_up = begun.wrapping_sub(before);
    let mut last = begun;
    for readings in 0..READINGS_MAX {
        let now = C::now_clocks();
        let clocks = now.wrapping_sub(last);
        if clocks > C::GAP_CLOCKS {
            let readings = core::num::NonZeroU32::new(readings)?;
            let [last, now] = [last, now].map(|at| at.wrapping_sub(begun));
            let loop_milliclocks = last.saturating_mul(1000) / readings;
            // The timer was read half-way between two readings of the clock.
            let first = until_step.saturating_sub(setting_up / 2);
            return (setting_up <= C::GAP_CLOCKS).then_some(Gap {
                milliclocks: (clocks.saturating_mul(1000)).saturating_sub(loop_milliclocks),
                steps: due(now, first, timer.period_clocks).saturating_sub(due(
                    last,
                    first,
                    timer.period_clocks,
                )),
            });
        }
        if now.wrapping_sub(begun) > wait_clocks {
            return None;
        }
        last = now;
    }
    None
}

/// Step ticks that are due after so many clocks, the first after `first`.
fn due(clocks: u32, first: u32, period_clocks: u32) -> u32 {
    let later = clocks.checked_sub(first);
    later.map_or(0, |later| 1 + later.checked_div(period_clocks).unwrap_or(0))
}

#[cfg(test)]
mod tests {
    //! Goal: a gap's duration is the interrupt's, and its step ticks are counted. Method: a clock that advances by what a
    //! loop needs, and by interrupts at known times.
    use super::*;
    use std::cell::Cell;
    use std::thread_local;

    const LOOP: u32 = 7;
    const PERIOD: u32 = 840;

    thread_local! {
        static NOW: Cell<u32> = const { Cell::new(0) };
        /// A longer interrupt begins at the first tick after this time, once, and takes so long.
        static LONG: Cell<(u32, u32)> = const { Cell::new((0, 0)) };
        static STEP: Cell<u32> = const { Cell::new(180) };
    }

    struct Script;

    impl BoardClock for Script {
        const GAP_CLOCKS: u32 = 40;
        fn now_clocks() -> u32 {
            let mut now = NOW.get();
            let mut end = now + LOOP;
            // Ticks at multiples of the period; one that is due within another interrupt follows it.
            while now / PERIOD != end / PERIOD {
                let (at, long) = LONG.get();
                let tick = end / PERIOD * PERIOD;
                now = tick;
                end += STEP.get();
                if at > 0 && tick >= at {
                    end += long;
                    // It is interrupted by the ticks that are due in it.
                    let mut ticks = tick / PERIOD;
                    while end / PERIOD > ticks {
                        ticks += 1;
                        end += STEP.get();
                    }
                    LONG.set((0, 0));
                    break;
                }
            }
            NOW.set(end);
            end
        }
    }

    fn search(wait_clocks: u32) -> Option<Gap> {
        let timer = StepTimer {
            period_clocks: PERIOD,
            until_step_clocks: || PERIOD - Script::now_clocks() % PERIOD,
        };
        next_gap::<Script>(timer, wait_clocks)
    }

    #[test]
    fn a_gap_is_as_long_as_what_interrupts() {
        for from in 0..PERIOD {
            NOW.set(from);
            let Some(gap) = search(PERIOD * 3 / 2) else {
                continue;
            };
            assert_eq!(gap.steps, 1, "from {from}");
            assert_eq!(gap.milliclocks, 180_000, "from {from}");
        }
    }

    #[test]
    fn steps_within_a_longer_interrupt_are_counted() {
        let mut counted = [0; 4];
        for long in (200..2200).step_by(7) {
            NOW.set(100);
            LONG.set((PERIOD, long));
            let gap = search(PERIOD * 3 / 2).expect("a gap");
            let steps = (gap.milliclocks / 1000 - long) / 180;
            assert_eq!(gap.steps, steps, "{long}");
            assert_eq!(gap.milliclocks, (long + 180 * steps) * 1000);
            counted[steps as usize % 4] += 1;
        }
        assert!(counted.iter().filter(|count| **count > 10).count() >= 3);
    }

    #[test]
    fn no_gap_and_a_clock_that_stands_end_the_search() {
        NOW.set(1);
        assert_eq!(search(300), None);
        struct Stands;
        impl BoardClock for Stands {
            const GAP_CLOCKS: u32 = 40;
            fn now_clocks() -> u32 {
                0
            }
        }
        let timer = StepTimer {
            period_clocks: 0,
            until_step_clocks: || 0,
        };
        assert_eq!(next_gap::<Stands>(timer, 300), None);
    }
}
