//! Switches and the emergency input, read by the servo once per tick.

use crate::design::SWITCH_SETTLE_TICKS;

/// Levels of the inputs: bits set while pressed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Inputs {
    /// Limit switches, bit 0 = joint 0; bit 7 is the probe.
    pub switches: u8,
    /// Emergency input.
    pub emergency: bool,
}

/// Samples that must all find the emergency input pressed, [`EMERGENCY_LOOK_NS`] apart, before it counts: 3 µs. A
/// spike from an adjacent motor wire is shorter, a bouncing contact is closed for tens of microseconds. The steps are
/// delayed by this time, less than a step tick.
pub const EMERGENCY_LOOKS: u32 = 6;
/// Time between two samples.
pub const EMERGENCY_LOOK_NS: u32 = 500;

/// True if every sample finds the emergency input pressed. `look` waits between them.
#[inline]
pub fn is_held(mut look: impl FnMut() -> bool) -> bool {
    (0..EMERGENCY_LOOKS).all(|_| look())
}

/// A switch that stops motion must stay pressed for [`SWITCH_SETTLE_TICKS`].
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

#[cfg(test)]
mod tests {
    //! Goal: a spike of the emergency input is none, a press is one. Method: every pattern of the looks.
    use super::*;

    #[test]
    fn a_press_counts_where_every_look_agrees() {
        for pattern in 0..1u32 << EMERGENCY_LOOKS {
            let mut looks = 0;
            let held = is_held(|| {
                looks += 1;
                pattern >> (looks - 1) & 1 == 1
            });
            assert_eq!(held, pattern == (1 << EMERGENCY_LOOKS) - 1, "{pattern:b}");
            assert!(looks <= EMERGENCY_LOOKS);
        }
    }
}
