//! Data between motion and heat: the only structure that both write.
//!
//! In: a host's requests; readings of each period. Out: targets for the heat loop; values for a
//! status; whether the stream waits. It is part of the motion, which a board locks briefly.

use crate::configuration::heat::{HEATERS_MAX, HeatConfiguration, PERIOD_S};
use crate::motion::CommandError;
use headway_protocol::message::{ColdHeater, DeviceState, Fault, HeaterStatus};
use heapless::Vec;

/// Tenths of a degree.
const PER_CELSIUS: f32 = 10.0;
/// Thousandths.
const PER_WHOLE: f32 = 1000.0;

/// Periods at rest, 30 s, after which an unused permission to extrude cold expires: the host that
/// requested it has gone.
const LEAVE_PERIODS: u16 = (30.0 / PERIOD_S) as u16;

/// Periods from the board's start within which a sensor may not have been read yet: a second.
const FIRST_PERIODS: u8 = 10;

/// Leave to extrude cold.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum ColdLeave {
    #[default]
    None,
    /// For the next stream or extrusion; the periods at rest since then.
    Next(u16),
    /// For the current one.
    Running,
}

/// Whether melt may move.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Melt {
    /// It may.
    Ready,
    /// Once this hot end, which is heating up, has reached it.
    Warming(ColdHeater),
    /// This hot end is too cold and has no target to wait for.
    Cold(ColdHeater),
}

/// Orders and readings.
#[derive(Clone, Debug, Default)]
pub struct HeatPanel {
    targets_c: [f32; HEATERS_MAX],
    target_max_c: Vec<f32, HEATERS_MAX>,
    part_fan: f32,
    /// Heaters that the stream waits for: a mask,
    waits: u8,
    /// and those that the board has lowered by itself, for which it waits too,
    owed: u8,
    /// of them those that it has switched off: a host must order their targets again.
    lapsed: u8,
    /// A heater that only its supply can stop.
    stuck: Option<Fault>,
    heard: bool,
    /// Lowest temperatures at which melt may move, tenths of a degree; 0 where it does not matter.
    melt_from: Vec<u16, HEATERS_MAX>,
    cold_leave: ColdLeave,
    /// The last temperatures that were known, tenths of a degree: the heat guard handles a failing
    /// sensor during a print.
    known: [Option<i16>; HEATERS_MAX],
    /// Periods since the board's start, up to [`FIRST_PERIODS`].
    periods: u8,
    readings: Vec<HeaterStatus, HEATERS_MAX>,
}

impl HeatPanel {
    /// Available heaters.
    pub fn set_up(&mut self, configuration: &HeatConfiguration) {
        self.target_max_c.clear();
        self.readings.clear();
        self.melt_from.clear();
        for heater in &configuration.heaters {
            // Room for all by the type's bound; collecting could panic.
            let _ = self.target_max_c.push(heater.target_max_c());
            let _ = self.readings.push(HeaterStatus::default());
            let melt_from_c = heater.melt_from_c().unwrap_or(0.0);
            let _ = self.melt_from.push((melt_from_c * PER_CELSIUS) as u16);
        }
    }

    /// A target, in tenths of a degree, 0 for off; whether the stream `wait`s for it.
    ///
    /// # Errors
    /// [`CommandError::Invalid`]: no such heater, or a target above its maximum.
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
        self.lapsed &= !bit;
        if decidegrees == 0 {
            self.owed &= !bit;
        }
        if wait && decidegrees > 0 {
            self.waits |= bit;
        }
        Ok(())
    }

    /// True if a heater has a target.
    pub fn is_on(&self) -> bool {
        self.targets_c.iter().any(|target_c| *target_c > 0.0)
    }

    /// A heater's target, tenths of a degree; 0 for off, and where there is none.
    pub fn target_decidegrees(&self, heater: u8) -> u16 {
        let target_c = self.targets_c.get(usize::from(heater));
        target_c.map_or(0, |target_c| (target_c * PER_CELSIUS + 0.5) as u16)
    }

    /// The stream waits for this heater.
    pub fn is_awaited(&self, heater: u8) -> bool {
        self.waits.unbounded_shr(heater.into()) & 1 == 1
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

    /// Whether melt may move.
    pub fn melt(&self) -> Melt {
        let mut melt = Melt::Ready;
        if self.cold_leave != ColdLeave::None {
            return melt;
        }
        let heaters = self.melt_from.iter().zip(self.known).zip(self.targets_c);
        for (heater, ((&least_decidegrees, known), target_c)) in heaters.enumerate() {
            let decidegrees = known.unwrap_or(i16::MIN);
            if least_decidegrees == 0 || i32::from(decidegrees) >= least_decidegrees.into() {
                continue;
            }
            let cold = ColdHeater {
                heater: heater as u8,
                decidegrees,
                least_decidegrees,
            };
            let may_come =
                (known.is_none() && self.periods < FIRST_PERIODS) || self.lapsed >> heater & 1 == 1;
            if !may_come && target_c * PER_CELSIUS < f32::from(least_decidegrees) {
                return Melt::Cold(cold);
            }
            melt = Melt::Warming(cold);
        }
        melt
    }

    /// Leave to extrude cold, for the next stream or extrusion, or its end.
    pub fn allow_cold(&mut self, allowed: bool) {
        self.cold_leave = match allowed {
            true => ColdLeave::Next(0),
            false => ColdLeave::None,
        };
    }

    /// A stream or an extrusion begins: it has its own permission, not that of the last one.
    pub fn begin_melt(&mut self) {
        self.cold_leave = match self.cold_leave {
            ColdLeave::Next(_) => ColdLeave::Running,
            ColdLeave::None | ColdLeave::Running => ColdLeave::None,
        };
    }

    /// A period in this state: the permission ends with the stream or extrusion that it was for.
    pub(crate) fn note_leave(&mut self, state: DeviceState) {
        let rests = matches!(
            state,
            DeviceState::Idle | DeviceState::Finished | DeviceState::Faulted
        );
        let by_hand = matches!(
            state,
            DeviceState::Jogging | DeviceState::Homing | DeviceState::Probing
        );
        self.cold_leave = match self.cold_leave {
            ColdLeave::Next(periods) if rests && periods < LEAVE_PERIODS => {
                ColdLeave::Next(periods + 1)
            }
            // Moves before a stream.
            leave if by_hand => leave,
            ColdLeave::Next(_) | ColdLeave::Running if !rests => ColdLeave::Running,
            _ => ColdLeave::None,
        };
    }

    /// A host has been heard.
    pub fn hear(&mut self) {
        self.heard = true;
    }

    /// Whether there was one since the last call.
    pub(crate) fn take_heard(&mut self) -> bool {
        core::mem::take(&mut self.heard)
    }

    /// Everything off, nothing waited for.
    pub(crate) fn all_off(&mut self) {
        self.targets_c = [0.0; HEATERS_MAX];
        (self.waits, self.owed, self.lapsed) = (0, 0, 0);
    }

    /// A stream begins: it has no targets yet that the silence of a host could have ended.
    pub(super) fn begin_stream(&mut self) {
        self.owed &= !self.lapsed;
        self.lapsed = 0;
    }

    /// The host of the open stream is silent: everything off. The stream waits until a host has ordered the targets
    /// again, and until they are reached.
    pub(crate) fn lapse(&mut self) {
        for (heater, target_c) in self.targets_c.iter_mut().enumerate() {
            if core::mem::take(target_c) > 0.0 {
                self.lapsed |= 1 << heater;
            }
        }
        self.owed |= self.lapsed;
    }

    /// The fault of a heater that only its supply can stop: it cannot be cleared.
    pub(crate) fn note_stuck(&mut self, stuck: Option<Fault>) {
        self.stuck = stuck;
    }

    /// The same.
    pub fn stuck(&self) -> Option<Fault> {
        self.stuck
    }

    /// Targets, °C, and the part fan, 0 to 1.
    pub(crate) fn orders(&self) -> ([f32; HEATERS_MAX], f32) {
        (self.targets_c, self.part_fan)
    }

    /// A period's temperature (`None`: unknown), target and duty of a heater.
    pub(crate) fn note(&mut self, heater: usize, reading_c: Option<f32>, target_c: f32, duty: f32) {
        if heater == 0 {
            self.periods = FIRST_PERIODS.min(self.periods + 1);
        }
        let decidegrees = reading_c.map(|c| (c * PER_CELSIUS) as i16);
        if let Some(known) = self.known.get_mut(heater) {
            *known = decidegrees.or(*known);
        }
        if let Some(status) = self.readings.get_mut(heater) {
            *status = HeaterStatus {
                decidegrees: decidegrees.unwrap_or(i16::MIN),
                target_decidegrees: (target_c * PER_CELSIUS + 0.5) as u16,
                duty_permille: (duty * PER_WHOLE + 0.5) as u16,
            };
        }
    }

    /// Heaters that are there no longer hold the stream; those that the board has `lowered` do until they are back.
    pub(crate) fn note_ready(&mut self, not_ready: u8, lowered: u8) {
        self.waits &= not_ready;
        self.owed = (self.owed | lowered) & (not_ready | lowered | self.lapsed);
    }

    /// True while the stream waits for a heater.
    pub fn holds_stream(&self) -> bool {
        self.waits | self.owed != 0
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
