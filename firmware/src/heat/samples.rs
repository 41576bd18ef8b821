//! Many conversions of a twelve-bit converter -> one reading of a control period.
//!
//! In: raw conversions, 0 to 4095, some tens in each period. Out: their mean without the highest and the
//! lowest, which a motor's edge may have disturbed, as a share of the reference. A mean of 32 has a
//! sixth of the noise of one: 0.03 K for a thermistor with 7 counts per kelvin at 210 °C.

use super::guard::HeatCause;

/// Full scale of the converter.
pub const FULL_SCALE: u16 = 4095;
/// Fewer conversions than this in a period do not count: Klipper takes 8.
const SAMPLES_MIN: u16 = 8;

/// Conversions of the present period.
#[derive(Clone, Copy, Debug)]
pub struct Samples {
    sum: u32,
    count: u16,
    lowest: u16,
    highest: u16,
}

impl Default for Samples {
    fn default() -> Self {
        Self {
            sum: 0,
            count: 0,
            lowest: u16::MAX,
            highest: 0,
        }
    }
}

/// A period's mean.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// Of the reference.
    pub share: f32,
    /// The value that every conversion had, if they had all the same.
    pub frozen_at: Option<u16>,
}

impl Samples {
    /// One conversion.
    pub fn push(&mut self, raw: u16) {
        let raw = raw.min(FULL_SCALE);
        self.sum = self.sum.saturating_add(raw.into());
        self.count = self.count.saturating_add(1);
        self.lowest = self.lowest.min(raw);
        self.highest = self.highest.max(raw);
    }

    /// The mean of the period, and the beginning of the next.
    ///
    /// # Errors
    /// [`HeatCause::SensorSilent`] where the converter has given too little.
    pub fn take(&mut self) -> Result<Reading, HeatCause> {
        let Self {
            sum,
            count,
            lowest,
            highest,
        } = core::mem::take(self);
        if count < SAMPLES_MIN {
            return Err(HeatCause::SensorSilent);
        }
        let sum = sum.saturating_sub(u32::from(lowest) + u32::from(highest));
        let mean = sum as f32 / f32::from(count - 2);
        Ok(Reading {
            share: mean / f32::from(FULL_SCALE),
            frozen_at: (lowest == highest).then_some(lowest),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mean_leaves_the_extremes_out_and_too_few_are_none() {
        let mut samples = Samples::default();
        assert_eq!(samples.take(), Err(HeatCause::SensorSilent));
        for raw in [1000, 1002, 1000, 1002, 4095, 1000, 1002, 0, 1001, 1001] {
            samples.push(raw);
        }
        let reading = samples.take().unwrap();
        assert!((reading.share * 4095.0 - 1001.0).abs() < 0.001);
        assert_eq!(reading.frozen_at, None);
        (0..20).for_each(|_| samples.push(77));
        assert_eq!(samples.take().unwrap().frozen_at, Some(77));
        assert_eq!(samples.take(), Err(HeatCause::SensorSilent));
    }
}
