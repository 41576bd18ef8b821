//! An estimate of the round-trip time, as in TCP (Jacobson; RFC 6298).

/// First guess: a slow line with a full window.
const START_US: u64 = 100_000;
/// Shortest wait before a repeat: below it a busy controller would get a query twice.
pub const RETRY_MIN_US: u64 = 10_000;
/// Longest wait between repeats on a silent line: how soon a returned cable is noticed.
pub const RETRY_MAX_US: u64 = 500_000;

/// Smoothed round trip and its mean deviation.
#[derive(Clone, Copy, Debug)]
pub struct RoundTrip {
    smoothed_us: u64,
    deviation_us: u64,
}

impl Default for RoundTrip {
    fn default() -> Self {
        RoundTrip {
            smoothed_us: START_US,
            deviation_us: START_US / 2,
        }
    }
}

impl RoundTrip {
    /// Takes a measured round trip; frames sent twice must not be measured (Karn).
    pub fn measure(&mut self, sample_us: u64) {
        let off_us = self.smoothed_us.abs_diff(sample_us);
        self.deviation_us = (3 * self.deviation_us + off_us) / 4;
        self.smoothed_us = (7 * self.smoothed_us + sample_us) / 8;
    }

    /// The estimate.
    pub fn estimate_us(&self) -> u64 {
        self.smoothed_us
    }

    /// Silence after which a frame is sent again.
    pub fn retry_us(&self) -> u64 {
        (self.smoothed_us + 4 * self.deviation_us).clamp(RETRY_MIN_US, RETRY_MAX_US)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_estimate_settles_on_a_steady_line_and_retries_wait_longer() {
        let mut round_trip = RoundTrip::default();
        for _ in 0..60 {
            round_trip.measure(20_000);
        }
        assert!(round_trip.estimate_us().abs_diff(20_000) < 100);
        assert!(round_trip.retry_us() >= round_trip.estimate_us());
        assert!(round_trip.retry_us() < 25_000);
        round_trip.measure(400_000);
        assert_eq!(
            round_trip.retry_us(),
            RETRY_MAX_US.min(round_trip.retry_us())
        );
        assert!(round_trip.retry_us() > 300_000);
    }
}
