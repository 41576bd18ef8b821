//! Says every servo tick whether the hardware watchdog may be fed.
//!
//! Healthy is a servo that runs once per interval of the step interrupt, and a link loop that still
//! comes round: without it no host could stop the machine. A board feeds its watchdog in the servo
//! tick, and only on `true`; after the reset it latches `FaultCause::Watchdog` at start-up.

/// Servo ticks that the link loop may stay away: half a second at 2 kHz, many times its longest
/// work (a full block of knots), well below what anybody would notice as dead.
pub const LINK_AWAY_TICKS_MAX: u32 = 1000;

/// Watches servo, steps and link.
#[derive(Clone, Copy, Debug)]
pub struct ServoHealth {
    interval_ticks: u32,
    last_step_tick: Option<u64>,
    last_link_pass: u32,
    away_ticks: u32,
}

impl ServoHealth {
    /// `interval_ticks`: step ticks of a servo interval.
    pub const fn new(interval_ticks: u32) -> Self {
        Self {
            interval_ticks,
            last_step_tick: None,
            last_link_pass: 0,
            away_ticks: 0,
        }
    }

    /// One servo tick: the step tick it runs in, and how often the link loop has come round.
    pub fn tick(&mut self, step_tick: u64, link_passes: u32) -> bool {
        let passed = self
            .last_step_tick
            .replace(step_tick)
            .map(|last| step_tick.wrapping_sub(last));
        // A servo tick that began late still falls into its own interval.
        let in_time =
            passed.is_none_or(|ticks| ticks > 0 && ticks < 2 * u64::from(self.interval_ticks));
        if self.last_link_pass == link_passes {
            self.away_ticks = self.away_ticks.saturating_add(1);
        } else {
            self.away_ticks = 0;
            self.last_link_pass = link_passes;
        }
        in_time && self.away_ticks < LINK_AWAY_TICKS_MAX
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_servo_in_time_with_a_live_link_feeds() {
        let mut health = ServoHealth::new(100);
        let mut tick = 0;
        for pass in 0..5000 {
            tick += if pass % 2 == 0 { 90 } else { 110 };
            assert!(health.tick(tick, pass / 900));
        }
        // An interval was left out, then the steps stand still.
        assert!(!health.tick(tick + 250, 6));
        assert!(health.tick(tick + 350, 6));
        assert!(!health.tick(tick + 350, 6));
        tick += 350;
        let fed = (0..3000).take_while(|_| {
            tick += 100;
            health.tick(tick, 7)
        });
        assert_eq!(fed.count() as u32, LINK_AWAY_TICKS_MAX);
    }
}
