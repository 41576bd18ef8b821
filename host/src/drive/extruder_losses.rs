//! What the extruder's motor turns beyond what is to arrive, where its curve says that a share does not.
//!
//! In: the planned volume at successive servo ticks, and the machine. Out: the sum of the losses, mm³, by the rate of
//! the moment: that of the volume half a window ago, with the advance of the window's mean flow, in double precision.
//! Leaves out primes and retracts, which are not flow.

use headway_firmware::configuration::MachineConfiguration;
use headway_firmware::configuration::flow_curves::Curve;
use headway_firmware::steps::delay::{advance_centre_ticks, window_ticks};
use std::collections::VecDeque;

/// The sum so far.
#[derive(Debug)]
pub(crate) struct ExtruderLosses {
    asked: Curve,
    /// None: in proportion, by K.
    advance: Option<Curve>,
    advance_s: f64,
    behind: usize,
    tick_s: f64,
    /// Of the last window, the newest at the back.
    volumes_mm3: VecDeque<f64>,
    window: usize,
    /// Place and advance of the steps before, mm³.
    before_mm3: Option<[f64; 2]>,
    sum_mm3: f64,
}

impl ExtruderLosses {
    pub(crate) fn new(machine: &MachineConfiguration) -> Self {
        let (extruder, curves) = (&machine.extruder, &machine.curves);
        let window = window_ticks(extruder, machine.servo_hz) as usize;
        Self {
            asked: curves.asked(),
            advance: (!curves.advance.is_empty()).then(|| curves.advance_volume()),
            advance_s: extruder.pressure_advance_s,
            behind: advance_centre_ticks(extruder, machine.servo_hz) as usize,
            tick_s: 1.0 / f64::from(machine.servo_hz),
            volumes_mm3: VecDeque::with_capacity(window + 1),
            window,
            before_mm3: None,
            sum_mm3: 0.0,
        }
    }

    /// The planned volume a servo tick later.
    pub(crate) fn add(&mut self, volume_mm3: f64) {
        self.volumes_mm3.push_back(volume_mm3);
        if self.volumes_mm3.len() > self.window + 1 {
            self.volumes_mm3.pop_front();
        }
        let window_s = self.window as f64 * self.tick_s;
        let mean_mm3_s = (volume_mm3 - self.volumes_mm3[0]) / window_s;
        let advance_mm3 = match &self.advance {
            Some(curve) => curve.at(mean_mm3_s)[0],
            None => self.advance_s * mean_mm3_s,
        };
        let newest = self.volumes_mm3.len() - 1;
        let place_mm3 = self.volumes_mm3[newest.saturating_sub(self.behind)];
        let [place, advance] = self
            .before_mm3
            .replace([place_mm3, advance_mm3])
            .unwrap_or([place_mm3, advance_mm3]);
        let rate_mm3_s = (place_mm3 - place + advance_mm3 - advance) / self.tick_s;
        if rate_mm3_s > 0.0 {
            self.sum_mm3 += (self.asked.at(rate_mm3_s)[0] - rate_mm3_s) * self.tick_s;
        }
    }

    /// Once the last volume rests.
    pub(crate) fn sum_mm3(mut self) -> f64 {
        let last_mm3 = self.volumes_mm3.back().copied().unwrap_or_default();
        (0..self.window).for_each(|_| self.add(last_mm3));
        self.sum_mm3
    }
}
