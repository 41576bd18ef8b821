//! How a run ends: all off, a record of the crash if it was one, and the watchdog restarts the board.
//!
//! Handlers of the last resort, from ARM DDI 0403 (B1.5). Not covered: a servo that hangs, of which the watchdog's own
//! fault tells.

use super::pins::heaters_off;
use super::{PINS, runtime, start};
use cortex_m_rt::exception;
use headway_firmware::board::BoardPins;
use headway_protocol::message::{Crash, CrashCause};

/// Heaters and drivers off, no more interrupts, from any context; the watchdog restarts.
pub fn stop() -> ! {
    all_off();
    wait_for_reset()
}

/// The same after a crash, which the next start reports. It is recorded when all is off: to look for its data may fail.
fn crash(find: impl FnOnce() -> (CrashCause, [u32; 2])) -> ! {
    all_off();
    let (cause, [pc, lr]) = find();
    start::keep_crash(&Crash {
        cause,
        pc,
        lr,
        servo_tick: runtime::now_servo_tick(),
    });
    wait_for_reset()
}

fn wait_for_reset() -> ! {
    loop {
        cortex_m::asm::nop();
    }
}

fn all_off() {
    runtime::regain_privilege();
    cortex_m::interrupt::disable();
    heaters_off();
    // SAFETY: nothing interrupts any more.
    unsafe {
        PINS.with(|pins| pins.hold(0));
    }
}

/// Configurable Fault Status Register.
const CFSR: *const u32 = 0xe000_ed28 as *const u32;

/// What no handler has dealt with.
#[exception]
unsafe fn HardFault(frame: &cortex_m_rt::ExceptionFrame) -> ! {
    crash(|| {
        // SAFETY: reading a register of the core's has no effect.
        let cfsr = unsafe { CFSR.read_volatile() };
        (CrashCause::HardFault(cfsr), [frame.pc(), frame.lr()])
    })
}

/// An interrupt that was not enabled.
#[exception]
unsafe fn DefaultHandler(number: i16) -> ! {
    crash(|| (CrashCause::Interrupt(number as u32), [0; 2]))
}

#[cfg(feature = "prove-no-panic")]
unsafe extern "C" {
    /// Defined nowhere: the image only links if the panic handler is never reached.
    safe fn a_panic_can_be_reached() -> !;
}

#[panic_handler]
fn panic(_info: &core::panic::PanicInfo<'_>) -> ! {
    #[cfg(feature = "prove-no-panic")]
    a_panic_can_be_reached();
    #[cfg(not(feature = "prove-no-panic"))]
    crash(|| {
        let line = _info.location().map_or(0, |location| location.line());
        (CrashCause::Panic(line), [0; 2])
    })
}
