//! The delay of all motors that centres pressure advance on the motion.
//!
//! e = V + K dV/dt needs the current dV/dt, but a mean over a past window W is that of W / 2 ago. So everything
//! else is delayed: targets of joints and of the planned extruder are followed W / 2 after they were evaluated
//! (`steps/waiting_targets.rs`), only the advance at once. A shaper uses the past too: all are delayed for the
//! longest, and the advance by the excess of that over W / 2 (`steps/shaping.rs`). Without either there is no
//! delay. In: the machine's configuration. Out: servo ticks, and the total delay in s. An immediate stop is not
//! delayed.

use crate::configuration::{ExtruderConfiguration, MachineConfiguration};
use crate::design::{self, ADVANCE_WINDOW_TICKS_MAX};
use crate::steps::WAIT_TICKS_MAX;
use crate::steps::shaping::shapes;

/// Largest distance from the plan, motor steps: targets are unambiguous up to 512, less a tick's
/// displacement (`steps/waiting_targets.rs`).
const OFF_PLAN_STEPS_MAX: f64 = 400.0;

/// Servo ticks of the window over which the flow is averaged, of 1 to [`ADVANCE_WINDOW_TICKS_MAX`].
pub fn window_ticks(extruder: &ExtruderConfiguration, servo_hz: u32) -> u32 {
    let window_s = extruder.pressure_advance_window_ms * 1e-3;
    let ticks = (window_s * f64::from(servo_hz) + 0.5) as u32;
    ticks.clamp(1, ADVANCE_WINDOW_TICKS_MAX as u32)
}

/// Servo ticks by which the advance lags its flow: all motors are delayed by that.
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

/// Delays of targets and advance.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Delays {
    /// Servo ticks that joints and the planned extruder wait.
    pub line_ticks: u32,
    /// Servo ticks that the advance waits, so that it stays centred.
    pub advance_ticks: u32,
    /// Servo ticks after which a target has completely left the delay line.
    pub settle_ticks: u32,
}

impl Delays {
    /// For a machine; `None` if a shaper is longer than the line, or moves a joint too far off its plan.
    #[inline(never)]
    pub fn of(configuration: &MachineConfiguration) -> Option<Self> {
        let servo_hz = configuration.servo_hz.max(1);
        let centre_ticks = advance_centre_ticks(&configuration.extruder, servo_hz);
        let mut line_ticks = centre_ticks;
        let shapes = shapes(configuration);
        for (shape, joint) in shapes.iter().zip(&configuration.joints) {
            let Some(shape) = shape else { continue };
            // A motor that two joints move adds up what both are off.
            let per_tick2 =
                configuration.motors.share() * joint.acceleration_max * joint.steps_per_unit
                    / (f64::from(servo_hz) * f64::from(servo_hz));
            if per_tick2 * shape.variance_ticks2() / 2.0 > OFF_PLAN_STEPS_MAX {
                return None;
            }
            line_ticks = line_ticks.max(libm::ceil(shape.delay_ticks()) as u32);
        }
        let mut settle_ticks = line_ticks;
        for shape in shapes.iter().flatten() {
            let rest = libm::ceil(shape.length_ticks() - shape.delay_ticks()) as u32;
            // One for the part of a tick, one for the displacement that ends there.
            settle_ticks = settle_ticks.max(line_ticks.saturating_add(rest).saturating_add(2));
        }
        (settle_ticks <= WAIT_TICKS_MAX).then_some(Self {
            line_ticks,
            advance_ticks: line_ticks - centre_ticks,
            settle_ticks,
        })
    }
}
