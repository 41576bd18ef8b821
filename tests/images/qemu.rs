//! The emulated board: Arm MPS2 AN386 (Cortex-M4F) in QEMU.
//!
//! Link over UART 0, steps from SysTick at 200 kHz, servo in PendSV (`shared/runtime.rs`); switches
//! at the positions of the simulated carriages, a byte on UART 1 as the emergency input. At the end
//! of a stream it prints step digest and counts as JSON by semihosting and exits. Run it with
//! `-icount` or timer ticks are lost; with `shift=4` (16 ns per instruction) the idle loop costs
//! the emulator little. `tests/tests/end_to_end/controller/emulated.rs` prints a complete example on it and checks that the
//! steps are those of the simulation.
#![cfg_attr(target_os = "none", no_std, no_main)]
// It follows no steps then.
#![cfg_attr(feature = "octopus-ports", allow(dead_code, unused_imports))]

#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!("this binary is for the emulated board: build it for thumbv7em-none-eabihf");
}

#[cfg(all(target_os = "none", feature = "defmt"))]
use defmt_semihosting as _;

#[cfg(all(target_os = "none", feature = "octopus-ports"))]
#[path = "../../firmware/src/bin/shared/step_ports.rs"]
mod ports;
#[cfg(all(target_os = "none", feature = "octopus-ports"))]
use headway_firmware::board::octopus::BOARD;
#[cfg(target_os = "none")]
#[path = "../../firmware/src/bin/shared/runtime.rs"]
mod runtime;

#[cfg(target_os = "none")]
use board::{Clock, Output, pend_stop};

#[cfg(target_os = "none")]
mod board {
    use crate::runtime::{self, Board, Locked, with_motion, with_output};
    use core::sync::atomic::{AtomicI32, AtomicU32, Ordering};
    use cortex_m::peripheral::{NVIC, Peripherals};
    use cortex_m_rt::exception;
    use cortex_m_semihosting::{debug, hprintln};
    use headway_firmware::board::built_in::{EMULATED_SWITCHES_STEPS, emulated_planar};
    use headway_firmware::board::gaps::BoardClock;
    use headway_firmware::configuration::MOTORS_MAX;
    use headway_firmware::configuration::MachineConfiguration;
    use headway_firmware::configuration::homing::HomingConfiguration;
    use headway_firmware::design::WEIGHED_KNOTS;
    use headway_firmware::line::measurement::Measurement;
    use headway_firmware::line::{Conversation, Receiver};
    use headway_firmware::machine::round::{Link, Surroundings, round};
    use headway_firmware::motion::inputs::Inputs;
    use headway_firmware::steps::output::StepOutput;
    use headway_protocol::message::DeviceState;

    const CLOCK_HZ: u32 = 25_000_000;
    /// 25 MHz / 200 kHz.
    const CLOCKS_PER_STEP_TICK: u32 = 125;
    /// 200 kHz / 2 kHz.
    const INTERVAL_TICKS: u32 = 100;
    /// No emergency so far.
    const NEVER: u32 = u32::MAX;
    const SESSION: u32 = 1;
    /// Servo ticks without a byte from the host after which the link is no longer served once all has
    /// ended: until then the host may not have heard of it.
    const LINGER_TICKS: u64 = 2000;

    /// Registers of a UART: data, state, control, interrupt state, divider.
    struct Uart(usize);
    /// The link.
    const LINK: Uart = Uart(0x4000_4000);
    /// A byte from here is the emergency input.
    const BUTTON: Uart = Uart(0x4000_5000);
    const TX_FULL: u32 = 1;
    const RX_FULL: u32 = 2;
    const DATA: usize = 0;
    const STATE: usize = 4;
    const CONTROL: usize = 8;
    const INTERRUPT: usize = 12;
    const DIVIDER: usize = 16;

    impl Uart {
        fn read(&self, register: usize) -> u32 {
            // SAFETY: a register of this UART, without effect on memory.
            unsafe { ((self.0 + register) as *const u32).read_volatile() }
        }
        fn write(&self, register: usize, value: u32) {
            // SAFETY: as above.
            unsafe { ((self.0 + register) as *mut u32).write_volatile(value) }
        }
        fn receive(&self) -> Option<u8> {
            (self.read(STATE) & RX_FULL != 0).then(|| self.read(DATA) as u8)
        }
    }

    /// Interrupt 2: the second UART has received.
    #[derive(Clone, Copy)]
    struct Button;

    // SAFETY: the number is that of the machine.
    unsafe impl cortex_m::interrupt::InterruptNumber for Button {
        fn number(self) -> u16 {
            2
        }
    }

    /// Step tick at which the stream began: where digests count from.
    static ORIGIN_TICK: AtomicU32 = AtomicU32::new(0);
    /// Last tick with a step, and that of the emergency.
    static LAST_TICK: AtomicU32 = AtomicU32::new(0);
    static EMERGENCY_TICK: AtomicU32 = AtomicU32::new(NEVER);
    /// Servo ticks that would not have fed a watchdog.
    static UNFED: AtomicU32 = AtomicU32::new(0);
    /// Servo ticks, each pended by a step tick.
    static INTERVALS: AtomicU32 = AtomicU32::new(0);
    /// Steps forward less steps back since start-up.
    static PLACES: [AtomicI32; MOTORS_MAX] = [const { AtomicI32::new(0) }; MOTORS_MAX];

    /// CMSDK timer 0 counts down at the core's 25 MHz, as SysTick does.
    const TIMER_CONTROL: *mut u32 = 0x4000_0000 as *mut u32;
    const TIMER_VALUE: *mut u32 = 0x4000_0004 as *mut u32;
    const TIMER_RELOAD: *mut u32 = 0x4000_0008 as *mut u32;

    fn start_timer() {
        // SAFETY: the registers of the emulated machine's first timer, used by nobody else.
        unsafe {
            TIMER_RELOAD.write_volatile(u32::MAX);
            TIMER_VALUE.write_volatile(u32::MAX);
            TIMER_CONTROL.write_volatile(1);
        }
    }

    pub struct Clock;

    impl BoardClock for Clock {
        // 2.5 instructions each: the loop takes four or five, a step tick more than thirty.
        const GAP_CLOCKS: u32 = 12;
        #[inline(always)]
        fn now_clocks() -> u32 {
            // SAFETY: a read-only use of the same timer.
            unsafe { TIMER_VALUE.read_volatile() }.wrapping_neg()
        }
    }

    /// The octopus's port writes, to a memory that nothing else uses: for a measurement of its ticks.
    #[cfg(feature = "octopus-ports")]
    pub type Output = headway_firmware::steps::output::PortOutput<crate::ports::DriverPorts>;
    #[cfg(feature = "octopus-ports")]
    fn output() -> Output {
        Output::new(crate::ports::DriverPorts::new(0x2100_0000), MOTORS_MAX, 0)
    }
    #[cfg(feature = "octopus-ports")]
    fn digest_of(_: &mut Output) -> (u64, u32) {
        (0, 0)
    }

    #[cfg(not(feature = "octopus-ports"))]
    pub type Output = Trace;
    #[cfg(not(feature = "octopus-ports"))]
    fn output() -> Output {
        Trace {
            directions: 0,
            digest: 0xcbf2_9ce4_8422_2325,
            steps: 0,
        }
    }
    #[cfg(not(feature = "octopus-ports"))]
    fn digest_of(trace: &mut Output) -> (u64, u32) {
        (trace.digest, trace.steps)
    }

    /// Follows every step: the digest that the simulator makes, too, and where carriages would be.
    pub struct Trace {
        directions: u8,
        digest: u64,
        steps: u32,
    }

    impl StepOutput for Trace {
        fn set_directions(&mut self, directions: u8) {
            self.directions = directions;
        }
        fn step(&mut self, tick: u64, motors: u8) {
            LAST_TICK.store(tick as u32, Ordering::Relaxed);
            let tick = (tick as u32).wrapping_sub(ORIGIN_TICK.load(Ordering::Relaxed));
            for (motor, place) in (0..8u64).zip(&PLACES) {
                if motors >> motor & 1 == 1 {
                    let forward = u64::from(self.directions >> motor & 1);
                    let word = u64::from(tick) << 4 | motor << 1 | forward;
                    let mixed = (self.digest ^ word).wrapping_mul(0x9e37_79b9_7f4a_7c15);
                    self.digest = mixed ^ mixed >> 29;
                    self.steps += 1;
                    let there = place.load(Ordering::Relaxed);
                    let step = if forward == 1 { 1 } else { -1 };
                    place.store(there + step, Ordering::Relaxed);
                }
            }
        }
    }

    /// Switches that the carriages would press, by where the steps have brought them.
    #[cfg(not(feature = "octopus-ports"))]
    fn switches() -> u8 {
        let mut pressed = 0;
        for (joint, towards_max, at_steps) in EMULATED_SWITCHES_STEPS {
            let place = PLACES.get(usize::from(joint));
            let place = place.map_or(0, |place| place.load(Ordering::Relaxed));
            let beyond = if towards_max {
                place >= at_steps
            } else {
                place <= at_steps
            };
            pressed |= u8::from(beyond) << joint;
        }
        pressed
    }

    #[exception]
    fn SysTick() {
        runtime::step_interrupt();
    }

    /// As the bench counts it, without this board's own work.
    #[cfg(feature = "octopus-ports")]
    #[exception]
    fn PendSV() {
        runtime::servo_interrupt(Inputs::default());
    }

    #[cfg(not(feature = "octopus-ports"))]
    #[exception]
    fn PendSV() {
        let done = runtime::servo_interrupt(Inputs {
            switches: switches(),
            emergency: false,
        });
        INTERVALS.fetch_add(1, Ordering::Relaxed);
        // There is no watchdog to feed: what it would not have been fed is counted.
        let unfed = UNFED.load(Ordering::Relaxed) + u32::from(!done.healthy);
        UNFED.store(unfed, Ordering::Relaxed);
        if let Some(start) = runtime::stream_start_ticks() {
            ORIGIN_TICK.store(start as u32 * INTERVAL_TICKS, Ordering::Relaxed);
        }
    }

    /// Every other interrupt: the button, or a requested stop.
    #[exception]
    unsafe fn DefaultHandler(_number: i16) {
        let pressed = BUTTON.receive().is_some();
        BUTTON.write(INTERRUPT, 2);
        runtime::stop_interrupt(pressed);
        if pressed && EMERGENCY_TICK.load(Ordering::Relaxed) == NEVER {
            EMERGENCY_TICK.store(runtime::now_tick() as u32, Ordering::Relaxed);
        }
    }

    /// Asks for the stop interrupt.
    pub fn pend_stop() {
        NVIC::pend(Button);
    }

    /// Bytes of the link, as they arrive.
    struct Bytes {
        /// One has arrived since the last check.
        heard: bool,
    }

    impl Iterator for Bytes {
        type Item = u8;

        fn next(&mut self) -> Option<u8> {
            let byte = LINK.receive();
            self.heard |= byte.is_some();
            byte
        }
    }

    impl Surroundings for Bytes {
        const AT_ONCE: bool = false;
        const WEIGHED_KNOTS: usize = WEIGHED_KNOTS;
        type Bytes = Self;

        fn heard(&mut self, _line: usize) -> &mut Self {
            self
        }

        fn measure(&mut self, measurement: &mut Measurement) {
            runtime::measure(measurement);
        }

        fn send(&mut self, _line: usize, bytes: &[u8]) -> usize {
            match bytes.first() {
                Some(&byte) if LINK.read(STATE) & TX_FULL == 0 => {
                    LINK.write(DATA, byte.into());
                    1
                }
                _ => 0,
            }
        }
    }

    fn serve(mut receiver: Receiver, configuration: &MachineConfiguration) -> bool {
        let mut links = [Link::new(Conversation::new(configuration, 0))];
        let mut around = Bytes { heard: false };
        let mut ended_tick = None;
        loop {
            round(&mut receiver, &mut links, &mut Locked, &mut around);
            if core::mem::take(&mut around.heard) {
                ended_tick = None;
            }
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

    /// Servo ticks that occur while unprivileged code tries to mask interrupts.
    fn ticks_through_a_mask() -> u32 {
        let now = || INTERVALS.load(Ordering::Relaxed);
        let before = now();
        runtime::without_masking(|| {
            cortex_m::interrupt::free(|_| {
                // Some intervals long, at any speed of the emulator.
                cortex_m::asm::delay(100_000);
            });
        });
        now().wrapping_sub(before)
    }

    /// Prints what happened; true if it went well.
    fn report() -> bool {
        let trace = with_output(digest_of);
        let (digest, steps) = trace.unwrap_or((0, 0));
        let late = match EMERGENCY_TICK.load(Ordering::Relaxed) {
            NEVER => 0,
            tick => LAST_TICK.load(Ordering::Relaxed).wrapping_sub(tick) as i32,
        };
        let through_a_mask = ticks_through_a_mask();
        with_motion(|motion| {
            let mut counts = motion.counts();
            let counts = counts.get_mut(..motion.motors()).unwrap_or_default();
            hprintln!(
                "{}\"step_digest\": \"{:016x}\", \"steps\": {}, \"final_counts\": {:?}, \
                 \"underruns\": {}, \"holds\": {}, \"faults\": {}, \
                 \"last_step_after_emergency_ticks\": {}, \"drivers_on\": {}, \
                 \"unfed_watchdog_ticks\": {}, \"servo_ticks_through_a_mask\": {}{}",
                "{",
                digest,
                steps,
                counts,
                motion.underruns(),
                motion.holds(),
                u8::from(motion.fault().is_some()),
                late,
                motion.drivers_on(),
                UNFED.load(Ordering::Relaxed),
                through_a_mask,
                "}"
            );
            motion.fault().is_none()
        })
        .unwrap_or(false)
    }

    fn run() -> Option<bool> {
        let configuration = emulated_planar();
        let switches = HomingConfiguration::standard(&configuration);
        let board = Board {
            configuration: &configuration,
            switches: &switches,
            session: SESSION,
        };
        let mut peripherals = Peripherals::take()?;
        for uart in [LINK, BUTTON] {
            uart.write(DIVIDER, 16);
            uart.write(CONTROL, 3);
        }
        // The button's interrupt on, at the steps' priority.
        BUTTON.write(CONTROL, 2 | 8);
        // SAFETY: nothing relies on this interrupt being off.
        unsafe {
            peripherals.NVIC.set_priority(Button, 0);
            NVIC::unmask(Button);
        }
        runtime::paint_stack();
        start_timer();
        let mut receiver = runtime::start(
            &board,
            output(),
            CLOCKS_PER_STEP_TICK,
            &mut peripherals.SCB,
            &mut peripherals.SYST,
        )?;
        receiver.measurement().measure_with(CLOCK_HZ, None);
        Some(serve(receiver, &configuration))
    }

    #[cortex_m_rt::entry]
    fn main() -> ! {
        debug::exit(if run() == Some(true) {
            debug::EXIT_SUCCESS
        } else {
            debug::EXIT_FAILURE
        });
        loop {
            cortex_m::asm::wfi();
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
        {
            debug::exit(debug::EXIT_FAILURE);
            loop {
                cortex_m::asm::bkpt();
            }
        }
    }
}
