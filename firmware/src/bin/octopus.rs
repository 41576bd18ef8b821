//! BTT Octopus v1.1 (STM32F446ZE at 168 MHz): eight drivers, stand-alone TMCs, USB CDC and USART 2.
//!
//! Steps, servo and link run as in `shared/runtime.rs`; pins and their sense are in
//! `shared/octopus_pins.rs`. The emergency input has the steps' own priority; the independent
//! watchdog is fed by a healthy servo tick only. `docs/guide/boards.md` says how to build, flash and
//! wire it. Built and checked by tools only: it has not run on hardware.
//!
//! The USB driver masks interrupts while it moves a packet; it is polled just after a step tick, so
//! that this falls between two of them. USART 2 at 1 Mbaud has an interrupt of its own and masks
//! nothing.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!("this binary is for the board: build it for thumbv7em-none-eabihf");
}

#[cfg(all(target_os = "none", feature = "defmt"))]
use defmt_rtt as _;

#[cfg(target_os = "none")]
#[path = "shared/octopus_pins.rs"]
mod pins;
#[cfg(target_os = "none")]
#[path = "shared/octopus_ports.rs"]
mod ports;
#[cfg(target_os = "none")]
#[path = "shared/runtime.rs"]
mod runtime;

#[cfg(target_os = "none")]
use board::{Output, pend_stop};

#[cfg(target_os = "none")]
mod board {
    use crate::pins;
    use crate::ports::DriverPorts;
    use crate::runtime::{self, Outgoing, with_motion};
    use core::sync::atomic::{AtomicU8, AtomicUsize, Ordering};
    use cortex_m::peripheral::{NVIC, Peripherals, SYST};
    use cortex_m_rt::exception;
    use headway_firmware::boards::octopus_machine;
    use headway_firmware::inputs::Inputs;
    use headway_firmware::machine::Machine;
    use headway_firmware::octopus::SERIAL;
    use headway_firmware::output::PortOutput;
    use headway_firmware::receiver::Receiver;
    use headway_protocol::message::{Fault, FaultCause};
    use stm32f4xx_hal::pac::{self, Interrupt, interrupt};
    use stm32f4xx_hal::prelude::*;

    pub type Output = PortOutput<DriverPorts>;

    const CORE_HZ: u32 = 168_000_000;
    /// Of the upper four priority bits: below the steps, above the servo.
    const SERIAL_PRIORITY: u8 = 0x40;
    /// Time without a healthy servo after which everything is reset.
    const WATCHDOG_MS: u16 = 200;
    /// Motors that the machine has, the extruder last; for the servo tick.
    static MOTORS: AtomicUsize = AtomicUsize::new(0);

    #[exception]
    fn SysTick() {
        runtime::step_interrupt();
    }

    #[exception]
    fn PendSV() {
        let done = runtime::servo_interrupt(Inputs {
            switches: pins::switches(),
            emergency: pins::emergency(),
        });
        pins::enable(MOTORS.load(Ordering::Relaxed), done.drivers_on);
        if done.healthy {
            watchdog::feed();
        }
    }

    /// The emergency input has opened, or a stop is asked for. A spike of the input shorter than the
    /// way into here is ignored.
    #[interrupt]
    fn EXTI9_5() {
        emergency_input::clear();
        runtime::stop_interrupt(pins::emergency());
    }

    /// Asks for the stop interrupt.
    pub fn pend_stop() {
        NVIC::pend(Interrupt::EXTI9_5);
    }

    mod emergency_input {
        //! Line 7 of the external interrupts, port B, rising edge.
        const MULTIPLEXER: *mut u32 = 0x4001_380c as *mut u32;
        const MASK: *mut u32 = 0x4001_3c00 as *mut u32;
        const RISING: *mut u32 = 0x4001_3c08 as *mut u32;
        const PENDING: *mut u32 = 0x4001_3c14 as *mut u32;
        const LINE: u32 = 7;

        pub fn set_up() {
            // SAFETY: registers of this line only, before its interrupt is on.
            unsafe {
                let others = MULTIPLEXER.read_volatile() & !0xf000;
                MULTIPLEXER.write_volatile(others | 1 << 12);
                RISING.write_volatile(RISING.read_volatile() | 1 << LINE);
                MASK.write_volatile(MASK.read_volatile() | 1 << LINE);
            }
            clear();
        }

        pub fn clear() {
            // SAFETY: writing a one clears this line's flag alone.
            unsafe { PENDING.write_volatile(1 << LINE) }
        }
    }

    mod watchdog {
        //! The independent watchdog: its own 32 kHz oscillator, cannot be stopped once started.
        const KEY: *mut u32 = 0x4000_3000 as *mut u32;
        const PRESCALER: *mut u32 = 0x4000_3004 as *mut u32;
        const RELOAD: *mut u32 = 0x4000_3008 as *mut u32;

        pub fn start(ms: u16) {
            // SAFETY: registers of the watchdog, used here alone. 32 kHz / 32 = 1 per ms.
            unsafe {
                KEY.write_volatile(0x5555);
                PRESCALER.write_volatile(3);
                RELOAD.write_volatile(u32::from(ms) & 0xfff);
                KEY.write_volatile(0xcccc);
            }
            feed();
        }

        pub fn feed() {
            // SAFETY: as above; a single write.
            unsafe { KEY.write_volatile(0xaaaa) }
        }
    }

    mod serial {
        //! USART 2 at 1 Mbaud: received bytes go into a ring, sent ones straight out.
        use super::{AtomicU8, AtomicUsize, Ordering};

        const STATE: *mut u32 = 0x4000_4400 as *mut u32;
        const DATA: *mut u32 = 0x4000_4404 as *mut u32;
        const BAUD: *mut u32 = 0x4000_4408 as *mut u32;
        const CONTROL: *mut u32 = 0x4000_440c as *mut u32;
        /// 5 ms at 1 Mbaud: longer than the main loop's longest round.
        const RING: usize = 512;

        static BYTES: [AtomicU8; RING] = [const { AtomicU8::new(0) }; RING];
        static WRITTEN: AtomicUsize = AtomicUsize::new(0);
        static READ: AtomicUsize = AtomicUsize::new(0);

        pub fn set_up() {
            // SAFETY: registers of this USART, before its interrupt is on. 42 MHz / 16 / 2.625.
            unsafe {
                BAUD.write_volatile(2 << 4 | 10);
                CONTROL.write_volatile(1 << 13 | 1 << 5 | 1 << 3 | 1 << 2);
            }
        }

        /// A byte has arrived. With the ring full it is lost: the host sends the frame again.
        pub fn interrupt() {
            // SAFETY: reading state and data, as this interrupt alone does.
            let byte = unsafe {
                let _ = STATE.read_volatile();
                DATA.read_volatile() as u8
            };
            let written = WRITTEN.load(Ordering::Relaxed);
            if written.wrapping_sub(READ.load(Ordering::Acquire)) < RING
                && let Some(slot) = BYTES.get(written % RING)
            {
                slot.store(byte, Ordering::Relaxed);
                WRITTEN.store(written.wrapping_add(1), Ordering::Release);
            }
        }

        pub fn receive() -> Option<u8> {
            let read = READ.load(Ordering::Relaxed);
            if read == WRITTEN.load(Ordering::Acquire) {
                return None;
            }
            let byte = BYTES.get(read % RING)?.load(Ordering::Relaxed);
            READ.store(read.wrapping_add(1), Ordering::Release);
            Some(byte)
        }

        /// Sends a byte; false if the last one is not out yet.
        pub fn send(byte: u8) -> bool {
            // SAFETY: the main loop alone sends.
            unsafe {
                let free = STATE.read_volatile() & 1 << 7 != 0;
                if free {
                    DATA.write_volatile(byte.into());
                }
                free
            }
        }
    }

    #[interrupt]
    fn USART2() {
        serial::interrupt();
    }

    /// Where the host was heard last: reports go there.
    #[derive(Clone, Copy, PartialEq)]
    enum Line {
        Usb,
        Serial,
    }

    /// The USB line. In an image without it nothing is here, and nothing can panic.
    #[cfg(feature = "octopus")]
    mod usb {
        use super::SYST;
        use stm32f4xx_hal::gpio::gpioa::{PA11, PA12};
        use stm32f4xx_hal::otg_fs::{USB, UsbBus};
        use stm32f4xx_hal::pac::{OTG_FS_DEVICE, OTG_FS_GLOBAL, OTG_FS_PWRCLK};
        use stm32f4xx_hal::prelude::*;
        use usb_device::prelude::*;
        use usbd_serial::SerialPort;

        /// Core clocks left of a step tick while which the USB driver may be polled: after the step
        /// interrupt, with 2.5 us to go.
        const WINDOW_CLOCKS: u32 = 420;

        pub struct Line {
            device: UsbDevice<'static, UsbBus<USB>>,
            port: SerialPort<'static, UsbBus<USB>>,
        }

        pub fn set_up(
            (usb_global, usb_device, usb_pwrclk): (OTG_FS_GLOBAL, OTG_FS_DEVICE, OTG_FS_PWRCLK),
            (pin_dm, pin_dp): (PA11, PA12),
        ) -> Option<Line> {
            let usb = USB {
                usb_global,
                usb_device,
                usb_pwrclk,
                pin_dm: pin_dm.into(),
                pin_dp: pin_dp.into(),
                hclk: super::CORE_HZ.Hz(),
            };
            let memory = cortex_m::singleton!(: [u32; 320] = [0; 320])?;
            let bus = UsbBus::new(usb, memory);
            let bus = cortex_m::singleton!(: UsbBusAllocator = bus)?;
            let port = SerialPort::new(bus);
            let strings = StringDescriptors::default()
                .manufacturer("Headway")
                .product("Headway controller");
            // The numbers that the USB device crate's authors have set aside for serial ports.
            let device = UsbDeviceBuilder::new(bus, UsbVidPid(0x16c0, 0x27dd))
                .device_class(usbd_serial::USB_CLASS_CDC)
                .strings(&[strings])
                .ok()?
                .build();
            Some(Line { device, port })
        }

        type UsbBusAllocator = usb_device::bus::UsbBusAllocator<UsbBus<USB>>;

        impl Line {
            /// Takes bytes into `packet` and sends what is `pending`: lengths of both.
            pub fn poll(&mut self, packet: &mut [u8], pending: &[u8]) -> (usize, usize) {
                if SYST::get_current() <= WINDOW_CLOCKS {
                    return (0, 0);
                }
                self.device.poll(&mut [&mut self.port]);
                let length = self.port.read(packet).unwrap_or(0);
                let sent = if pending.is_empty() {
                    0
                } else {
                    self.port.write(pending).unwrap_or(0)
                };
                (length, sent)
            }
        }
    }

    /// An image that has the serial line alone.
    #[cfg(not(feature = "octopus"))]
    mod usb {
        pub struct Line;

        impl Line {
            pub fn poll(&mut self, _packet: &mut [u8], _pending: &[u8]) -> (usize, usize) {
                (0, 0)
            }
        }
    }

    fn serve(mut receiver: Receiver, mut usb: usb::Line) -> ! {
        let mut outgoing = Outgoing::new();
        let mut line = Line::Usb;
        loop {
            if let Some(byte) = serial::receive() {
                line = Line::Serial;
                runtime::take_byte(&mut receiver, byte);
            }
            runtime::look_ahead();
            let mut packet = [0; 64];
            let pending = outgoing.pending(&mut receiver);
            let for_usb = if line == Line::Usb { pending } else { &[] };
            let (length, mut sent) = usb.poll(&mut packet, for_usb);
            if line == Line::Serial
                && let Some(&byte) = pending.first()
            {
                sent = usize::from(serial::send(byte));
            }
            outgoing.sent(sent);
            for &byte in packet.get(..length).unwrap_or_default() {
                line = Line::Usb;
                runtime::take_byte(&mut receiver, byte);
            }
        }
    }

    mod clocks {
        //! 12 MHz crystal, 168 MHz core, 48 MHz USB (180 MHz could not give USB its clock). By hand,
        //! because the chip's library computes dividers with panics; after RM0390, chapter 6.
        use super::pac::{FLASH, RCC};

        /// 12 MHz / 6 * 168 = 336 MHz; by 2 for the core, by 7 for USB; the fourth output, unused, at
        /// its reset value.
        const PLL: u32 = 2 << 28 | 7 << 24 | FROM_CRYSTAL | 168 << 6 | 6;
        const FROM_CRYSTAL: u32 = 1 << 22;
        /// APB1 by 4 (42 MHz), APB2 by 2 (84 MHz); core from the internal oscillator, or the PLL.
        const BUSES: u32 = 0b100 << 13 | 0b101 << 10;
        const CORE_FROM_PLL: u32 = 2;
        const CORE_FROM: u32 = 3;
        /// Five wait states, prefetch, both caches.
        const FLASH_ACCESS: u32 = 0x705;

        /// The bootloader has left clocks of its own: back to the internal oscillator first.
        pub fn set_up(rcc: &RCC, flash: &FLASH) {
            rcc.cr().modify(|_, w| w.hsion().set_bit());
            while rcc.cr().read().hsirdy().bit_is_clear() {}
            core_from(rcc, 0);
            rcc.cr().modify(|_, w| w.pllon().clear_bit());
            while rcc.cr().read().pllrdy().bit_is_set() {}
            rcc.cr().modify(|_, w| w.hseon().set_bit());
            while rcc.cr().read().hserdy().bit_is_clear() {}
            // SAFETY: values that the reference manual allows, see above.
            unsafe {
                rcc.pllcfgr().write(|w| w.bits(PLL));
                flash.acr().write(|w| w.bits(FLASH_ACCESS));
            }
            rcc.cr().modify(|_, w| w.pllon().set_bit());
            while rcc.cr().read().pllrdy().bit_is_clear() {}
            core_from(rcc, CORE_FROM_PLL);
        }

        fn core_from(rcc: &RCC, source: u32) {
            // SAFETY: as above.
            unsafe {
                rcc.cfgr().write(|w| w.bits(BUSES | source));
            }
            while rcc.cfgr().read().bits() >> 2 & CORE_FROM != source {}
        }
    }

    /// Returns the USB line and whether the watchdog has caused this start.
    fn set_up_chip(device: pac::Peripherals, motors: usize) -> Option<(usb::Line, bool)> {
        let by_watchdog = device.RCC.csr().read().wdgrstf().bit_is_set();
        device.RCC.csr().modify(|_, w| w.rmvf().set_bit());
        clocks::set_up(&device.RCC, &device.FLASH);
        let rcc = device.RCC.constrain();
        #[cfg(feature = "octopus")]
        let (usb, rcc) = {
            let mut rcc = rcc;
            let port_a = device.GPIOA.split(&mut rcc);
            let blocks = (
                device.OTG_FS_GLOBAL,
                device.OTG_FS_DEVICE,
                device.OTG_FS_PWRCLK,
            );
            (usb::set_up(blocks, (port_a.pa11, port_a.pa12))?, rcc)
        };
        #[cfg(not(feature = "octopus"))]
        let usb = usb::Line;
        // Ports A to G, USART 2, the multiplexer of the external interrupts.
        rcc.ahb1enr()
            .modify(|r, w| unsafe { w.bits(r.bits() | 0x7f) });
        rcc.apb1enr().modify(|_, w| w.usart2en().set_bit());
        rcc.apb2enr().modify(|_, w| w.syscfgen().set_bit());
        pins::set_up(motors);
        for pin in SERIAL {
            pins::alternate(pin, 7);
        }
        serial::set_up();
        emergency_input::set_up();
        Some((usb, by_watchdog))
    }

    fn run() -> Option<()> {
        let (configuration, switches) = octopus_machine()?;
        let motors = configuration.joints.len() + 1;
        MOTORS.store(motors, Ordering::Relaxed);
        let mut core = Peripherals::take()?;
        // SAFETY: the table of this image; the bootloader has left its own in force.
        unsafe {
            core.SCB.vtor.write(core::ptr::addr_of!(VECTORS) as u32);
        }
        let (usb, by_watchdog) = set_up_chip(pac::Peripherals::take()?, motors)?;
        let clocks = CORE_HZ.checked_div(configuration.step_hz)?;
        // Differs from start to start as far as anything here can: the oscillators drift.
        let session = SYST::get_current()
            ^ if by_watchdog {
                0x5a5a_0000
            } else {
                0x0c70_0000
            };
        let machine = Machine::with_switches(&configuration, &switches, session).ok()?;
        let output = PortOutput::new(DriverPorts::new(pins::PORTS), motors, 0);
        // SAFETY: what these interrupts use is set up, or not looked at before it is; no lock relies
        // on their being off.
        unsafe {
            core.NVIC.set_priority(Interrupt::EXTI9_5, 0);
            core.NVIC.set_priority(Interrupt::USART2, SERIAL_PRIORITY);
            NVIC::unmask(Interrupt::EXTI9_5);
            NVIC::unmask(Interrupt::USART2);
        }
        let receiver = runtime::start(machine, output, clocks, &mut core.SCB, &mut core.SYST);
        if by_watchdog {
            with_motion(|motion| {
                motion.fail_softly(Fault {
                    cause: FaultCause::Watchdog,
                    index: 0,
                    value: 0,
                });
            });
        }
        // SAFETY: as above; the bootloader may have left them off.
        unsafe { cortex_m::interrupt::enable() }
        watchdog::start(WATCHDOG_MS);
        serve(receiver, usb)
    }

    unsafe extern "C" {
        /// The vector table, placed by the runtime's linker script.
        #[link_name = "__vector_table"]
        static VECTORS: u32;
    }

    #[cortex_m_rt::entry]
    fn main() -> ! {
        // It only comes back where the machine built in cannot be run: nothing ever moves.
        run();
        stop()
    }

    /// Drivers off, no more interrupts; the watchdog, if it runs, starts anew.
    fn stop() -> ! {
        cortex_m::interrupt::disable();
        pins::enable(0, false);
        loop {
            cortex_m::asm::nop();
        }
    }

    #[cfg(feature = "prove-no-panic")]
    unsafe extern "C" {
        /// Defined nowhere: the image only links if the panic handler is never reached.
        safe fn a_panic_can_be_reached() -> !;
    }

    #[panic_handler]
    fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
        #[cfg(feature = "prove-no-panic")]
        a_panic_can_be_reached();
        #[cfg(not(feature = "prove-no-panic"))]
        stop()
    }
}
