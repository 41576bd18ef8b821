//! How long all motors wait, so that pressure advance is centred on the motion.
//!
//! e = V + K dV/dt needs dV/dt of now, but a mean over a window W that looks back is that of W / 2 ago.
//! So everything else waits for it: targets of joints and of the planned extruder are followed W / 2
//! after they were evaluated (`steps/line.rs`), the advance alone at once. A shaper looks back too: all
//! wait for the longest, and the advance for what that is above W / 2 (`shaping.rs`). Without either
//! nothing waits. In: the machine's configuration. Out: servo ticks, and the whole delay in s. A stop at
//! once does not wait.

use crate::configuration::{ExtruderConfiguration, MachineConfiguration};
use crate::design::{self, ADVANCE_WINDOW_TICKS_MAX};
use crate::shaping::Delays;
use crate::steps::WAIT_TICKS_MAX;

/// Servo ticks of the window over which the flow is averaged, of 1 to [`ADVANCE_WINDOW_TICKS_MAX`].
pub fn window_ticks(extruder: &ExtruderConfiguration, servo_hz: u32) -> u32 {
    let window_s = extruder.pressure_advance_window_ms * 1e-3;
    let ticks = (window_s * f64::from(servo_hz) + 0.5) as u32;
    ticks.clamp(1, ADVANCE_WINDOW_TICKS_MAX as u32)
}

/// Servo ticks that the advance lies behind the flow it is for: all motors wait for it.
pub fn advance_centre_ticks(extruder: &ExtruderConfiguration, servo_hz: u32) -> u32 {
    if extruder.pressure_advance_s > 0.0 {
        (window_ticks(extruder, servo_hz) / 2).min(WAIT_TICKS_MAX)
    } else {
        0
    }
}

/// Constant delay between a pose's evaluation and its steps, in s: that of the steps
/// ([`design::motion_delay_s`]) and this one.
pub fn motion_delay_s(configuration: &MachineConfiguration) -> f64 {
    let ticks = Delays::of(configuration).unwrap_or_default().line_ticks;
    design::motion_delay_s(configuration.servo_hz, configuration.step_hz)
        + f64::from(ticks) / f64::from(configuration.servo_hz)
}
