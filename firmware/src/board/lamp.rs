//! A lamp that shows the machine's state by its brightness, through `embedded-hal`'s PWM.

use embedded_hal::pwm::SetDutyCycle;
use headway_protocol::message::DeviceState;

/// Servo ticks of a blink, on and off: half a second at 2 kHz.
const BLINK_TICKS: u64 = 1024;

/// A lamp: dark while idle, half bright while it waits, bright while it moves, blinking in a fault.
#[derive(Debug)]
pub struct Lamp<P> {
    pwm: P,
    percent: u8,
}

impl<P: SetDutyCycle> Lamp<P> {
    /// Dark.
    pub fn new(mut pwm: P) -> Self {
        // A lamp that cannot be set stays as it is; nothing hangs on it.
        let _ = pwm.set_duty_cycle_fully_off();
        Self { pwm, percent: 0 }
    }

    /// Shows a state at a servo tick; writes only where the brightness changes.
    pub fn show(&mut self, state: DeviceState, now_ticks: u64) {
        let percent = match state {
            DeviceState::Idle | DeviceState::Finished => 5,
            DeviceState::Filling
            | DeviceState::Paused
            | DeviceState::Starved
            | DeviceState::Heating => 50,
            DeviceState::Running
            | DeviceState::Aborting
            | DeviceState::Homing
            | DeviceState::Probing
            | DeviceState::Jogging => 100,
            DeviceState::Faulted if now_ticks % BLINK_TICKS < BLINK_TICKS / 2 => 100,
            DeviceState::Faulted => 0,
        };
        if percent != self.percent {
            self.percent = percent;
            let _ = self.pwm.set_duty_cycle_percent(percent);
        }
    }
}
