//! The time of a host that waits for a board: only time in which it could have heard the board counts.
//!
//! In: readings of clocks at each round of the loop that moves bytes. Out: [`HostClock`], for sender and patience, which
//! advances by [`ROUND_MAX_US`] a round at most: a host that was suspended (Ctrl-Z, a laptop's lid, a virtual machine
//! that stood) has first read what waits on the line before its absence can be the board's silence. And [`RealClock`],
//! for heat, which must not stay on longer because the host slept: whatever clock has gone further counts. Not covered:
//! who reads the clocks.

use std::time::{Duration, Instant, SystemTime};

/// Longest time of a round that counts: far beyond a round on a busy machine, far below every wait.
pub const ROUND_MAX_US: u64 = 500_000;
/// How much further the clock on the wall has to go than the other to count, which is more than it is corrected by.
const ASLEEP: Duration = Duration::from_secs(1);

/// Time that counts for waits, microseconds.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct HostClock {
    counted_us: u64,
    round_us: u64,
}

impl HostClock {
    /// The time, at this reading since the start.
    pub fn at(&self, real_us: u64) -> u64 {
        self.counted_us + real_us.saturating_sub(self.round_us).min(ROUND_MAX_US)
    }

    /// The time at which the round began.
    pub fn counted(&self) -> Duration {
        Duration::from_micros(self.counted_us)
    }

    /// A round begins.
    pub fn round(&mut self, real_us: u64) {
        self.counted_us = self.at(real_us);
        self.round_us = real_us;
    }
}

/// Time that has really passed, with sleep in which the system's monotonic clock stands.
#[derive(Clone, Debug)]
pub struct RealClock {
    passed: Duration,
    read: (Instant, SystemTime),
}

impl RealClock {
    /// Begins at 0.
    pub fn begin(now: Instant, wall: SystemTime) -> RealClock {
        RealClock {
            passed: Duration::ZERO,
            read: (now, wall),
        }
    }

    /// Time since the start, microseconds; a wall clock that is set back counts nothing.
    pub fn at_us(&mut self, now: Instant, wall: SystemTime) -> u64 {
        let ran = now.saturating_duration_since(self.read.0);
        let on_wall = wall.duration_since(self.read.1).unwrap_or_default();
        self.passed += match on_wall > ran + ASLEEP {
            true => on_wall,
            false => ran,
        };
        self.read = (now, wall);
        self.passed.as_micros() as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drive::patience::{ANSWER_US, Patience, Wait};
    use crate::drive::sender::Sender;

    /// Goal: a host's sleep is not the board's silence, and a silent board is late as before. Method: a greeting that
    /// is not answered, in rounds of 5 ms with sleeps of a minute and an hour between, by the clock alone.
    #[test]
    fn a_sleep_of_the_host_is_no_silence_of_the_board() {
        let sender = Sender::talking(1);
        let mut patience = Patience::without_stream();
        let (mut clock, mut real_us, mut asleep_us) = (HostClock::default(), 0, 0);
        let mut rounds = 0;
        let late = loop {
            rounds += 1;
            let sleep_us = match rounds {
                100 => 60_000_000,
                900 => 3_600_000_000,
                _ => 0,
            };
            asleep_us += sleep_us;
            real_us += 5_000 + sleep_us;
            let before_us = clock.at(real_us - 1);
            clock.round(real_us);
            let now_us = clock.at(real_us);
            assert!((before_us..=before_us + ROUND_MAX_US).contains(&now_us));
            if let Some(late) = patience.look(now_us, &sender, true) {
                break late;
            }
        };
        assert_eq!(late.wait, Wait::Welcome);
        let awake_us = real_us - asleep_us;
        // Two sleeps count as a round each.
        let expected_us = ANSWER_US - 2 * ROUND_MAX_US;
        // Some rounds of 5 ms.
        assert!(awake_us.abs_diff(expected_us) < 30_000, "{awake_us}");
    }

    /// Goal: heat's time goes on while the host sleeps, and no clock that is set back or forward by little stops it.
    /// Method: readings by hand.
    #[test]
    fn heat_counts_the_sleep_of_the_host() {
        let (begun, wall) = (Instant::now(), SystemTime::UNIX_EPOCH + ASLEEP * 9000);
        let at = |ran_s: u64, wall_s: i64| {
            let moved = Duration::from_secs(wall_s.unsigned_abs());
            let wall = if wall_s < 0 {
                wall - moved
            } else {
                wall + moved
            };
            (begun + Duration::from_secs(ran_s), wall)
        };
        let mut clock = RealClock::begin(begun, wall);
        for ((now, wall), expected_s) in [
            (at(10, 10), 10),
            // The machine was suspended: the monotonic clock stood.
            (at(11, 3611), 3611),
            (at(12, -500), 3612),
            (at(13, -499), 3613),
            // A process that stood: both went on.
            (at(113, -399), 3713),
        ] {
            assert_eq!(clock.at_us(now, wall), expected_s * 1_000_000);
        }
    }
}
