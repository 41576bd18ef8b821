//! Logs are written only from the main loop: writing one delays the servo, never the steps.

use super::SERVO_PRIORITY;
use cortex_m::register::basepri;
use critical_section::{Impl, RawRestoreState, set_impl};

struct ServoOff;
set_impl!(ServoOff);

// SAFETY: no interrupt writes logs, and nothing else uses critical sections of this crate.
unsafe impl Impl for ServoOff {
    unsafe fn acquire() -> RawRestoreState {
        let before = basepri::read();
        // SAFETY: it is raised, or stays as it is.
        unsafe { basepri::write(SERVO_PRIORITY) };
        u32::from(before)
    }

    unsafe fn release(before: RawRestoreState) {
        // SAFETY: what it was.
        unsafe { basepri::write(before as u8) };
    }
}
