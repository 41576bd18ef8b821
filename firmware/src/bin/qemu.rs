//! The emulated board: Arm MPS2 AN386 (Cortex-M4F) in QEMU.
//!
//! Link over UART 0; steps from the SysTick interrupt at 200 kHz, at the highest priority; the
//! servo in PendSV, below it; the link in the main loop, which holds the servo off by BASEPRI for
//! the moment of a hand-over and never the steps. At the end of a stream it prints step digest and
//! counts as JSON by semihosting and exits. Run it with `-icount` or timer ticks are lost; with
//! `shift=4` (16 ns an instruction) the idle loop costs the emulator little. `tests/emulated.rs`
//! prints a whole example on it and finds the steps of the simulation.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!("this binary is for the emulated board: build it for thumbv7em-none-eabihf");
}

#[cfg(target_os = "none")]
mod board {
    use core::cell::UnsafeCell;
    use cortex_m::peripheral::scb::SystemHandler;
    use cortex_m::peripheral::syst::SystClkSource;
    use cortex_m::peripheral::{Peripherals, SCB};
    use cortex_m::register::basepri;
    use cortex_m_rt::exception;
    use cortex_m_semihosting::{debug, hprintln};
    use headway_firmware::boards::emulated_planar;
    use headway_firmware::machine::Machine;
    use headway_firmware::motion::Motion;
    use headway_firmware::output::StepOutput;
    use headway_firmware::receiver::Receiver;
    use headway_firmware::steps::StepEngine;
    use headway_protocol::frame::FRAME_BYTES_MAX;
    use headway_protocol::message::{DeviceState, Fault, FaultCause};

    /// 25 MHz / 200 kHz.
    const CLOCKS_PER_STEP_TICK: u32 = 125;
    /// Of the eight priority bits; steps 0, servo here, the main loop below.
    const SERVO_PRIORITY: u8 = 0x80;
    const SESSION: u32 = 1;
    /// Servo ticks that the link is still served after the end, so that the host hears of it.
    const LINGER_TICKS: u64 = 2000;

    const UART_DATA: *mut u32 = 0x4000_4000 as *mut u32;
    const UART_STATE: *mut u32 = 0x4000_4004 as *mut u32;
    const UART_CONTROL: *mut u32 = 0x4000_4008 as *mut u32;
    const UART_DIVIDER: *mut u32 = 0x4000_4010 as *mut u32;
    const UART_TX_FULL: u32 = 1;
    const UART_RX_FULL: u32 = 2;

    /// Follows every step: the digest that the simulator makes, too.
    struct Trace {
        directions: u8,
        origin_tick: u64,
        digest: u64,
        steps: u32,
    }

    impl StepOutput for Trace {
        fn set_directions(&mut self, directions: u8) {
            self.directions = directions;
        }
        fn step(&mut self, tick: u64, motors: u8) {
            let tick = tick.wrapping_sub(self.origin_tick);
            for motor in 0..8u64 {
                if motors >> motor & 1 == 1 {
                    let forward = u64::from(self.directions >> motor & 1);
                    let word = tick << 4 | motor << 1 | forward;
                    let mixed = (self.digest ^ word).wrapping_mul(0x9e37_79b9_7f4a_7c15);
                    self.digest = mixed ^ mixed >> 29;
                    self.steps += 1;
                }
            }
        }
    }

    /// What the step interrupt owns.
    struct Stepping {
        engine: StepEngine,
        trace: Trace,
        ticks_left: u32,
        interval_ticks: u32,
    }

    /// A value that contexts of different priority share; each access says why it is alone.
    struct Shared<T>(UnsafeCell<Option<T>>);

    // SAFETY: accesses follow the rule at each `with`; there is one core.
    unsafe impl<T> Sync for Shared<T> {}

    impl<T> Shared<T> {
        const fn empty() -> Self {
            Self(UnsafeCell::new(None))
        }
        /// # Safety
        /// Nothing that can interrupt the caller may use the same value.
        unsafe fn with<R>(&self, work: impl FnOnce(&mut T) -> R) -> Option<R> {
            // SAFETY: the caller's promise.
            unsafe { (*self.0.get()).as_mut().map(work) }
        }
    }

    static STEPPING: Shared<Stepping> = Shared::empty();
    static MOTION: Shared<Motion> = Shared::empty();

    /// Runs at the step rate; nothing delays it but `interrupt::free` in the servo, under a
    /// hundred instructions.
    #[exception]
    fn SysTick() {
        // SAFETY: the highest priority; lower ones mask interrupts while they use it.
        unsafe {
            STEPPING.with(|stepping| {
                stepping.engine.tick(&mut stepping.trace);
                stepping.ticks_left -= 1;
                if stepping.ticks_left == 0 {
                    stepping.ticks_left = stepping.interval_ticks;
                    SCB::set_pendsv();
                }
            });
        }
    }

    /// The servo tick, pended by the step tick that ends an interval.
    #[exception]
    fn PendSV() {
        // SAFETY: the main loop raises BASEPRI while it uses the motion.
        unsafe {
            MOTION.with(servo_tick);
        }
    }

    fn servo_tick(motion: &mut Motion) {
        note_overruns(motion);
        let moving = motion.tick().map(|program| {
            with_stepping(|stepping| stepping.engine.load(program));
        });
        if moving.is_none() {
            stop_if_due(motion);
        }
        if let Some(start) = motion.stream_start_ticks() {
            with_stepping(|stepping| {
                stepping.trace.origin_tick = start * u64::from(stepping.interval_ticks);
            });
        }
    }

    fn note_overruns(motion: &mut Motion) {
        let overruns = with_stepping(|stepping| stepping.engine.overruns()).unwrap_or(0);
        if overruns > 0 && !motion.is_at_rest() && motion.fault().is_none() {
            motion.fail_at_once(Fault {
                cause: FaultCause::StepOverrun,
                index: 0,
                value: overruns as i32,
            });
            stop_if_due(motion);
        }
    }

    fn stop_if_due(motion: &mut Motion) {
        if motion.take_stop()
            && let Some(stopped) = with_stepping(|stepping| stepping.engine.stop())
        {
            motion.engine_stopped(&stopped);
        }
    }

    fn with_stepping<R>(work: impl FnOnce(&mut Stepping) -> R) -> Option<R> {
        // SAFETY: all interrupts are masked meanwhile.
        cortex_m::interrupt::free(|_| unsafe { STEPPING.with(work) })
    }

    /// Uses the motion from the main loop.
    fn with_motion<R>(work: impl FnOnce(&mut Motion) -> R) -> Option<R> {
        // SAFETY: BASEPRI keeps the servo out; the step interrupt does not use the motion.
        unsafe {
            basepri::write(SERVO_PRIORITY);
            let result = MOTION.with(work);
            basepri::write(0);
            result
        }
    }

    fn receive() -> Option<u8> {
        // SAFETY: the registers of the first UART, used by the main loop only.
        unsafe {
            if UART_STATE.read_volatile() & UART_RX_FULL == 0 {
                return None;
            }
            Some(UART_DATA.read_volatile() as u8)
        }
    }

    /// A report on its way out. A host that does not listen holds it up, never the rest.
    struct Outgoing {
        frame: [u8; FRAME_BYTES_MAX],
        length: usize,
        sent: usize,
    }

    impl Outgoing {
        /// Sends the next byte if the line takes it, and gets the next report when all are out.
        fn go_on(&mut self, receiver: &mut Receiver) {
            if self.sent < self.length {
                // SAFETY: as above.
                let full = unsafe { UART_STATE.read_volatile() } & UART_TX_FULL != 0;
                if !full && let Some(&byte) = self.frame.get(self.sent) {
                    // SAFETY: as above.
                    unsafe { UART_DATA.write_volatile(u32::from(byte)) };
                    self.sent += 1;
                }
                return;
            }
            self.sent = 0;
            self.length = with_motion(|motion| receiver.poll_report(motion, &mut self.frame))
                .unwrap_or(0)
                .min(FRAME_BYTES_MAX);
        }
    }

    fn set_up(mut peripherals: Peripherals, interval_ticks: u32) {
        // SAFETY: before any interrupt is on; the UART as above.
        unsafe {
            UART_DIVIDER.write_volatile(16);
            UART_CONTROL.write_volatile(3);
            peripherals.SCB.set_priority(SystemHandler::SysTick, 0);
            peripherals
                .SCB
                .set_priority(SystemHandler::PendSV, SERVO_PRIORITY);
        }
        with_stepping(|stepping| stepping.interval_ticks = interval_ticks);
        SCB::set_pendsv();
        peripherals.SYST.set_clock_source(SystClkSource::Core);
        peripherals.SYST.set_reload(CLOCKS_PER_STEP_TICK - 1);
        peripherals.SYST.clear_current();
        peripherals.SYST.enable_interrupt();
        peripherals.SYST.enable_counter();
    }

    fn serve(mut receiver: Receiver) -> bool {
        let mut outgoing = Outgoing {
            frame: [0; FRAME_BYTES_MAX],
            length: 0,
            sent: 0,
        };
        let mut ended_tick = None;
        loop {
            if let Some(request) = receive().and_then(|byte| receiver.push(byte)) {
                with_motion(|motion| {
                    receiver.apply(request, motion);
                    stop_if_due(motion);
                });
            }
            outgoing.go_on(&mut receiver);
            let (now, over) = with_motion(|motion| {
                let ended = matches!(motion.state(), DeviceState::Finished | DeviceState::Faulted);
                (motion.now_ticks(), ended && motion.is_at_rest())
            })
            .unwrap_or((0, true));
            if over && now > *ended_tick.get_or_insert(now) + LINGER_TICKS {
                return report();
            }
        }
    }

    /// Prints what happened; true if it went well.
    fn report() -> bool {
        let trace = with_stepping(|stepping| (stepping.trace.digest, stepping.trace.steps));
        let (digest, steps) = trace.unwrap_or((0, 0));
        with_motion(|motion| {
            let mut counts = motion.counts();
            let counts = counts.get_mut(..motion.motors()).unwrap_or_default();
            hprintln!(
                "{}\"step_digest\": \"{:016x}\", \"steps\": {}, \"final_counts\": {:?}, \
                 \"underruns\": {}, \"holds\": {}, \"faults\": {}{}",
                "{",
                digest,
                steps,
                counts,
                motion.underruns(),
                motion.holds(),
                u8::from(motion.fault().is_some()),
                "}"
            );
            motion.fault().is_none()
        })
        .unwrap_or(false)
    }

    #[cortex_m_rt::entry]
    fn main() -> ! {
        let configuration = emulated_planar();
        if let (Ok(machine), Some(peripherals)) =
            (Machine::new(&configuration, SESSION), Peripherals::take())
        {
            let (receiver, motion, engine) = machine.into_parts();
            let interval_ticks = configuration.interval_ticks();
            let stepping = Stepping {
                engine,
                trace: Trace {
                    directions: 0,
                    origin_tick: 0,
                    digest: 0xcbf2_9ce4_8422_2325,
                    steps: 0,
                },
                ticks_left: interval_ticks,
                interval_ticks,
            };
            // SAFETY: no interrupt is on yet.
            unsafe {
                *STEPPING.0.get() = Some(stepping);
                *MOTION.0.get() = Some(motion);
            }
            set_up(peripherals, interval_ticks);
            let fine = serve(receiver);
            debug::exit(if fine {
                debug::EXIT_SUCCESS
            } else {
                debug::EXIT_FAILURE
            });
        }
        debug::exit(debug::EXIT_FAILURE);
        loop {
            cortex_m::asm::wfi();
        }
    }

    #[panic_handler]
    fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
        debug::exit(debug::EXIT_FAILURE);
        loop {
            cortex_m::asm::bkpt();
        }
    }
}
