//! Clocks and resets of peripherals, after RM0390 and RM0090 (chapter 6 each), which agree in these registers.
//!
//! A peripheral must not be accessed within two clocks of its bus after its clock was switched on (errata sheets
//! ES0298 and ES0182, "Delay after an RCC peripheral clock enabling"): the write is read back and completed first.

use cortex_m::asm::dsb;

const RCC: usize = 0x4002_3800;
/// Resets of the ports, a bit each.
const PORTS_RESET: *mut u32 = (RCC + 0x10) as *mut u32;
/// Ports A to H: the STM32F446 has no more, the STM32F405 has one more, which has no pins on its package.
const ALL_PORTS: u32 = 0xff;

/// The bus that a peripheral's clock belongs to, by the register's place.
#[derive(Clone, Copy)]
#[repr(usize)]
pub enum Bus {
    /// Ports.
    Ahb1 = 0x30,
    /// USB.
    #[cfg(feature = "octopus")]
    Ahb2 = 0x34,
    /// USART 2 and 3, timers 2 to 5.
    Apb1 = 0x40,
    /// System configuration, timer 11, USART 1, converters.
    Apb2 = 0x44,
}

/// Switches clocks on; the others stay. Their peripherals can be accessed when it returns.
#[inline(always)]
pub fn clock_on(bus: Bus, mask: u32) {
    let clocks = (RCC + bus as usize) as *mut u32;
    // SAFETY: bits that switch clocks on; reading has no effect. Interrupts do not change this register.
    unsafe {
        clocks.write_volatile(clocks.read_volatile() | mask);
        let _ = clocks.read_volatile();
    }
    dsb();
}

/// Makes every pin an input, as after a reset of the chip, whatever an earlier program or boot loader has
/// driven. For the first instructions, when the board is not known yet; no memory is used.
#[inline(always)]
pub fn all_inputs() {
    // SAFETY: resets ports alone, and takes the resets back; nothing else uses them yet.
    unsafe {
        PORTS_RESET.write_volatile(ALL_PORTS);
        let _ = PORTS_RESET.read_volatile();
        PORTS_RESET.write_volatile(0);
        let _ = PORTS_RESET.read_volatile();
    }
    dsb();
}
