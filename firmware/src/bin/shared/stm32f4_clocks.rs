//! The board's crystal, 168 MHz core, 48 MHz USB (180 MHz cannot provide the USB clock). It is programmed
//! by hand, because the chip's library computes dividers with panics and waits without a bound; after
//! RM0390 and RM0090, chapter 6 each.
//!
//! Without the right crystal the core runs from the internal oscillator (1 %): good enough for the
//! serial line, which reports why nothing moves.

use crate::BOARD;
use headway_firmware::board::{crystal_fault, crystal_hz};
use headway_protocol::message::{Fault, FaultCause};
use stm32f4xx_hal::pac::{FLASH, RCC};

const CRYSTAL_HZ: u32 = BOARD.crystal_hz;
/// What the PLL is fed with.
const PLL_INPUT_HZ: u32 = 2_000_000;
const _: () = assert!(
    CRYSTAL_HZ % PLL_INPUT_HZ == 0 && CRYSTAL_HZ >= 4_000_000 && CRYSTAL_HZ <= 26_000_000,
    "CRYSTAL_HZ: a whole number of 2 MHz, from 4 to 26 MHz"
);
/// 336 MHz from 2 MHz; by 2 for the core, by 7 for USB; the upper bits at their reset value.
const PLL: u32 = 2 << 28 | 7 << 24 | 168 << 6;
/// The crystal, divided to 2 MHz.
const FROM_CRYSTAL: u32 = 1 << 22 | CRYSTAL_HZ / PLL_INPUT_HZ;
/// 16 MHz / 8.
const FROM_INTERNAL: u32 = 8;
/// APB1 by 4 (42 MHz), APB2 by 2 (84 MHz), crystal by 16 for its measurement.
const BUSES: u32 = 16 << 16 | 0b100 << 13 | 0b101 << 10;
const CORE_FROM_PLL: u32 = 2;
const CORE_FROM: u32 = 3;
/// Five wait states, prefetch, both caches.
const FLASH_ACCESS: u32 = 0x705;
/// Rounds of a wait: at 16 MHz and some ten clocks each 50 ms, of which a crystal needs 5.
const WAIT_ROUNDS: u32 = 80_000;

/// Sets the clocks up; the fault of a board that has others. The boot loader has left clocks of its own:
/// back to the internal oscillator first.
#[cfg(not(feature = "emulated"))]
pub fn set_up(rcc: &RCC, flash: &FLASH) -> Option<Fault> {
    rcc.cr().modify(|_, w| w.hsion().set_bit());
    if !wait(|| rcc.cr().read().hsirdy().bit_is_set()) || !core_from(rcc, 0) {
        super::stop();
    }
    rcc.cr()
        .modify(|_, w| w.pllon().clear_bit().hseon().set_bit());
    let stopped = wait(|| rcc.cr().read().pllrdy().bit_is_clear());
    let starts = wait(|| rcc.cr().read().hserdy().bit_is_set());
    super::start::feed_watchdog();
    let fault = if starts {
        crystal_fault(crystal_hz(edges::timer_clocks(rcc)), CRYSTAL_HZ)
    } else {
        Some(board_fault(1))
    };
    super::start::feed_watchdog();
    // SAFETY: a value that the reference manual allows.
    unsafe { flash.acr().write(|w| w.bits(FLASH_ACCESS)) };
    let source = if fault.is_none() {
        FROM_CRYSTAL
    } else {
        FROM_INTERNAL
    };
    if stopped && core_from_pll(rcc, source) {
        return fault;
    }
    // Once more without the crystal; if that fails too, the fault cannot be reported to anyone.
    if source == FROM_CRYSTAL && core_from_pll(rcc, FROM_INTERNAL) {
        return Some(board_fault(2));
    }
    super::stop()
}

/// The emulator's clock has its rate from the start, and no registers.
#[cfg(feature = "emulated")]
#[allow(dead_code)]
pub fn set_up(_rcc: &RCC, _flash: &FLASH) -> Option<Fault> {
    None
}

fn board_fault(index: u8) -> Fault {
    Fault {
        cause: FaultCause::Board,
        index,
        value: 0,
    }
}

fn core_from_pll(rcc: &RCC, source: u32) -> bool {
    rcc.cr().modify(|_, w| w.pllon().clear_bit());
    let stopped = wait(|| rcc.cr().read().pllrdy().bit_is_clear());
    // SAFETY: a value that the reference manual allows, see above.
    unsafe { rcc.pllcfgr().write(|w| w.bits(PLL | source)) };
    rcc.cr().modify(|_, w| w.pllon().set_bit());
    stopped && wait(|| rcc.cr().read().pllrdy().bit_is_set()) && core_from(rcc, CORE_FROM_PLL)
}

fn core_from(rcc: &RCC, source: u32) -> bool {
    // SAFETY: as above.
    unsafe { rcc.cfgr().write(|w| w.bits(BUSES | source)) };
    wait(|| rcc.cfgr().read().bits() >> 2 & CORE_FROM == source)
}

/// Waits until something is so, within a bound; false if it never was.
fn wait(is_so: impl Fn() -> bool) -> bool {
    (0..WAIT_ROUNDS).any(|_| is_so())
}

mod edges {
    //! Timer 11 counts the internal 16 MHz between edges of the crystal divided by 16.
    use super::super::rcc::{Bus, clock_on};
    use super::{RCC, wait};

    /// Timer 11.
    const CLOCK: u32 = 1 << 18;

    const TIMER: usize = 0x4001_4800;
    const CONTROL: *mut u32 = TIMER as *mut u32;
    const STATE: *mut u32 = (TIMER + 0x10) as *mut u32;
    const CHANNEL_MODE: *mut u32 = (TIMER + 0x18) as *mut u32;
    const CHANNEL_ON: *mut u32 = (TIMER + 0x20) as *mut u32;
    const RELOAD: *mut u32 = (TIMER + 0x2c) as *mut u32;
    const CAPTURED: *mut u32 = (TIMER + 0x34) as *mut u32;
    const REMAP: *mut u32 = (TIMER + 0x50) as *mut u32;
    /// Every eighth edge of the input.
    const EVERY_EIGHTH: u32 = 0b1101;
    const CRYSTAL: u32 = 0b10;
    const IS_CAPTURED: u32 = 1 << 1;
    /// Captures after the first: 64 edges.
    const CAPTURES: usize = 8;

    /// Timer clocks of 64 edges; 0 if there are none.
    pub fn timer_clocks(rcc: &RCC) -> u32 {
        clock_on(Bus::Apb2, CLOCK);
        let clocks = count();
        // SAFETY: as below.
        unsafe { CONTROL.write_volatile(0) };
        rcc.apb2enr().modify(|_, w| w.tim11en().clear_bit());
        clocks.unwrap_or(0)
    }

    fn count() -> Option<u32> {
        // SAFETY: registers of this timer, which nothing else uses.
        unsafe {
            REMAP.write_volatile(CRYSTAL);
            RELOAD.write_volatile(0xffff);
            CHANNEL_MODE.write_volatile(EVERY_EIGHTH);
            CHANNEL_ON.write_volatile(1);
            CONTROL.write_volatile(1);
        }
        let first = captured()?;
        let mut last = first;
        for _ in 0..CAPTURES {
            last = captured()?;
        }
        Some(last.wrapping_sub(first) & 0xffff)
    }

    fn captured() -> Option<u32> {
        // SAFETY: as above; reading the value clears the flag.
        unsafe {
            wait(|| STATE.read_volatile() & IS_CAPTURED != 0).then(|| CAPTURED.read_volatile())
        }
    }
}
