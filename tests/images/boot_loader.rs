//! Simulates a careless boot loader in emulation: it jumps to the image after it and leaves SysTick
//! running with its interrupt, foreign interrupts enabled and pending, and priorities masked.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!("this binary is for the emulated board: build it for thumbv7em-none-eabihf");
}

#[cfg(target_os = "none")]
mod loader {
    use cortex_m::peripheral::{NVIC, Peripherals};
    use cortex_m_rt::exception;

    /// Start of the image after it.
    const IMAGE: *const u32 = 0x0800_8000 as *const u32;
    /// Short enough to occur many times before the image has set itself up.
    const SYSTICK_CLOCKS: u32 = 2000;
    /// Below the mask: what is pending stays so.
    const PRIORITY: u8 = 0x80;

    /// Any interrupts that the image does not use, and the one of its serial ports.
    #[derive(Clone, Copy)]
    struct Foreign(u16);

    // SAFETY: numbers of the chip.
    unsafe impl cortex_m::interrupt::InterruptNumber for Foreign {
        fn number(self) -> u16 {
            self.0
        }
    }

    const FOREIGN: [Foreign; 5] = [
        Foreign(0),
        Foreign(28),
        Foreign(38),
        Foreign(39),
        Foreign(67),
    ];

    #[exception]
    fn SysTick() {}

    #[cortex_m_rt::entry]
    fn main() -> ! {
        if let Some(mut core) = Peripherals::take() {
            // SAFETY: leaving a mess is what it is for.
            unsafe {
                cortex_m::register::basepri::write(PRIORITY);
                for interrupt in FOREIGN {
                    core.NVIC.set_priority(interrupt, PRIORITY);
                    NVIC::unmask(interrupt);
                    NVIC::pend(interrupt);
                }
                core.SYST.set_reload(SYSTICK_CLOCKS);
                core.SYST.clear_current();
                core.SYST.enable_interrupt();
                core.SYST.enable_counter();
                cortex_m::asm::bootload(IMAGE)
            }
        }
        loop {
            cortex_m::asm::nop();
        }
    }

    #[panic_handler]
    fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
        loop {
            cortex_m::asm::nop();
        }
    }
}
