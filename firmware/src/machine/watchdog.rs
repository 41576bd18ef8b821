//! Decides every servo tick whether the hardware watchdog may be fed.
//!
//! The controller is healthy if the servo has a program ready whenever an interval of the step interrupt ends, and
//! the link loop still runs: without it no host could stop the machine. A board feeds its watchdog in the servo tick,
//! and only on `true`; after the reset it latches `FaultCause::Watchdog` at start-up.

/// Servo ticks between two rounds of the link loop: half a second at 2 kHz, many times its longest
/// work (a full block of knots), well below a noticeable failure.
pub const LINK_AWAY_TICKS_MAX: u32 = 1000;

/// Watches servo, steps and link.
#[derive(Clone, Copy, Debug, Default)]
pub struct ServoHealth {
    last_overruns: u32,
    last_link_pass: u32,
    away_ticks: u32,
}

impl ServoHealth {
    /// Before the first servo tick.
    pub const fn new() -> Self {
        Self {
            last_overruns: 0,
            last_link_pass: 0,
            away_ticks: 0,
        }
    }

    /// One servo tick: the number of step intervals without a program in time, and of rounds of the
    /// link loop.
    pub fn tick(&mut self, overruns: u32, link_passes: u32) -> bool {
        let in_time = self.last_overruns == overruns;
        self.last_overruns = overruns;
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
        let mut health = ServoHealth::new();
        for pass in 0..5000 {
            assert!(health.tick(0, pass / 900));
        }
        // The servo was late for an interval.
        assert!(!health.tick(1, 6));
        assert!(health.tick(1, 6));
        let fed = (0..3000).take_while(|_| health.tick(1, 7));
        assert_eq!(fed.count() as u32, LINK_AWAY_TICKS_MAX);
    }
}
