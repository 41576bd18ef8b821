//! Switches and the emergency input, as the servo sees them once a tick.

use crate::design::SWITCH_SETTLE_TICKS;

/// Levels of the inputs: bits set while pressed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Inputs {
    /// Limit switches, bit 0 = joint 0; bit 7 is the probe.
    pub switches: u8,
    /// Emergency input.
    pub emergency: bool,
}

/// A switch that stops motion must hold for [`SWITCH_SETTLE_TICKS`].
#[derive(Clone, Copy, Debug, Default)]
pub struct SwitchGuard {
    held_ticks: u32,
}

impl SwitchGuard {
    /// One servo tick: the joint whose switch has stayed pressed, of those that are guarded.
    #[inline]
    pub fn tick(&mut self, pressed: u8) -> Option<u8> {
        if pressed == 0 {
            self.held_ticks = 0;
            return None;
        }
        self.held_ticks += 1;
        if self.held_ticks < SWITCH_SETTLE_TICKS {
            return None;
        }
        self.held_ticks = 0;
        Some(pressed.trailing_zeros() as u8)
    }
}
