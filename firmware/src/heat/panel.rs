//! What the motion's side and the heat's side tell each other: the one place where both write.
//!
//! In: what a host asks for; readings of each period. Out: targets for the heat loop; what a status
//! shows; whether the stream waits. It lies in the motion, which a board locks for a moment.

use super::configuration::{HEATERS_MAX, HeatConfiguration};
use crate::motion::CommandError;
use headway_protocol::message::HeaterStatus;
use heapless::Vec;

/// Tenths of a degree.
const PER_CELSIUS: f32 = 10.0;
/// Thousandths.
const PER_WHOLE: f32 = 1000.0;

/// Orders and readings.
#[derive(Clone, Debug, Default)]
pub struct HeatPanel {
    targets_c: [f32; HEATERS_MAX],
    target_max_c: Vec<f32, HEATERS_MAX>,
    part_fan: f32,
    /// Heaters that the stream waits for: a mask.
    waits: u8,
    heard: bool,
    readings: Vec<HeaterStatus, HEATERS_MAX>,
}

impl HeatPanel {
    /// Heaters that may be asked for.
    pub fn set_up(&mut self, configuration: &HeatConfiguration) {
        self.target_max_c.clear();
        self.readings.clear();
        for heater in &configuration.heaters {
            // Room for all by the type's bound; collecting could panic.
            let _ = self.target_max_c.push(heater.target_max_c());
            let _ = self.readings.push(HeaterStatus::default());
        }
    }

    /// A target, in tenths of a degree, 0 for off; the stream `wait`s for it, or no longer.
    ///
    /// # Errors
    /// [`CommandError::Invalid`]: a heater that is not there, or above what it may have.
    pub fn set_target(
        &mut self,
        heater: u8,
        decidegrees: u16,
        wait: bool,
    ) -> Result<(), CommandError> {
        let place = usize::from(heater);
        let target_c = f32::from(decidegrees) / PER_CELSIUS;
        let most_c = self.target_max_c.get(place).copied();
        if !most_c.is_some_and(|most_c| target_c <= most_c) {
            return Err(CommandError::Invalid);
        }
        if let Some(target) = self.targets_c.get_mut(place) {
            *target = target_c;
        }
        let bit = 1 << heater;
        self.waits &= !bit;
        if wait && decidegrees > 0 {
            self.waits |= bit;
        }
        Ok(())
    }

    /// True if a heater is asked for.
    pub fn is_on(&self) -> bool {
        self.targets_c.iter().any(|target_c| *target_c > 0.0)
    }

    /// The part fan, in thousandths.
    ///
    /// # Errors
    /// [`CommandError::Invalid`] where the board has no heaters, and so no fans.
    pub fn set_fan(&mut self, permille: u16) -> Result<(), CommandError> {
        if self.target_max_c.is_empty() {
            return Err(CommandError::Invalid);
        }
        self.part_fan = f32::from(permille) / PER_WHOLE;
        Ok(())
    }

    /// A host has been heard.
    pub fn hear(&mut self) {
        self.heard = true;
    }

    /// Whether one was, since this was last asked.
    pub(super) fn take_heard(&mut self) -> bool {
        core::mem::take(&mut self.heard)
    }

    /// Everything off, nothing waited for.
    pub(super) fn all_off(&mut self) {
        self.targets_c = [0.0; HEATERS_MAX];
        self.waits = 0;
    }

    /// Targets, °C, and the part fan, 0 to 1.
    pub(super) fn orders(&self) -> ([f32; HEATERS_MAX], f32) {
        (self.targets_c, self.part_fan)
    }

    /// A period's temperature (`None`: unknown), target and duty of a heater.
    pub(super) fn note(&mut self, heater: usize, reading_c: Option<f32>, target_c: f32, duty: f32) {
        if let Some(status) = self.readings.get_mut(heater) {
            *status = HeaterStatus {
                decidegrees: reading_c.map_or(i16::MIN, |c| (c * PER_CELSIUS) as i16),
                target_decidegrees: (target_c * PER_CELSIUS + 0.5) as u16,
                duty_permille: (duty * PER_WHOLE + 0.5) as u16,
            };
        }
    }

    /// Heaters that are there no longer hold the stream.
    pub(super) fn note_ready(&mut self, not_ready: u8) {
        self.waits &= not_ready;
    }

    /// True while the stream waits for a heater.
    pub fn holds_stream(&self) -> bool {
        self.waits != 0
    }

    /// Heaters for a status.
    pub fn readings(&self) -> &Vec<HeaterStatus, HEATERS_MAX> {
        &self.readings
    }

    /// The part fan in thousandths.
    pub fn fan_permille(&self) -> u16 {
        (self.part_fan * PER_WHOLE + 0.5) as u16
    }
}
