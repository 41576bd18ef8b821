//! The emulated board: Arm MPS2 AN386 (Cortex-M4F) in QEMU.
//!
//! Link over UART 0, steps from SysTick at 200 kHz, servo in PendSV (`shared/runtime.rs`); switches
//! where the simulated carriages would press them, a byte on UART 1 as the emergency input. At the
//! end of a stream it prints step digest and counts as JSON by semihosting and exits. Run it with
//! `-icount` or timer ticks are lost; with `shift=4` (16 ns an instruction) the idle loop costs the
//! emulator little. `tests/emulated.rs` prints a whole example on it and finds the steps of the
//! simulation.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!("this binary is for the emulated board: build it for thumbv7em-none-eabihf");
}

#[cfg(all(target_os = "none", feature = "defmt"))]
use defmt_semihosting as _;

#[cfg(target_os = "none")]
#[path = "shared/runtime.rs"]
mod runtime;

#[cfg(target_os = "none")]
use board::Trace as Output;

#[cfg(target_os = "none")]
mod board {
    use crate::runtime::{self, Outgoing, with_motion, with_stepping};
    use cortex_m::peripheral::{NVIC, Peripherals};
    use cortex_m_rt::exception;
    use cortex_m_semihosting::{debug, hprintln};
    use headway_firmware::boards::{EMULATED_SWITCHES_STEPS, emulated_planar};
    use headway_firmware::configuration::MOTORS_MAX;
    use headway_firmware::homing::HomingConfiguration;
    use headway_firmware::inputs::Inputs;
    use headway_firmware::machine::Machine;
    use headway_firmware::output::StepOutput;
    use headway_firmware::receiver::Receiver;
    use headway_protocol::message::DeviceState;

    /// 25 MHz / 200 kHz.
    const CLOCKS_PER_STEP_TICK: u32 = 125;
    /// 200 kHz / 2 kHz.
    const INTERVAL_TICKS: u32 = 100;
    const SESSION: u32 = 1;
    /// Servo ticks that the link is still served after the end, so that the host hears of it.
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

    /// Follows every step: the digest that the simulator makes, too, and where carriages would be.
    pub struct Trace {
        directions: u8,
        pub origin_tick: u64,
        digest: u64,
        steps: u32,
        last_tick: u64,
        /// Tick of the emergency, once there was one.
        emergency_tick: Option<u64>,
        /// Servo ticks that would not have fed a watchdog.
        unfed: u32,
        /// Steps forward less steps back since start-up.
        places: [i32; MOTORS_MAX],
    }

    impl StepOutput for Trace {
        fn set_directions(&mut self, directions: u8) {
            self.directions = directions;
        }
        fn step(&mut self, tick: u64, motors: u8) {
            self.last_tick = tick;
            let tick = tick.wrapping_sub(self.origin_tick);
            for (motor, place) in (0..8u64).zip(&mut self.places) {
                if motors >> motor & 1 == 1 {
                    let forward = u64::from(self.directions >> motor & 1);
                    let word = tick << 4 | motor << 1 | forward;
                    let mixed = (self.digest ^ word).wrapping_mul(0x9e37_79b9_7f4a_7c15);
                    self.digest = mixed ^ mixed >> 29;
                    self.steps += 1;
                    *place += if forward == 1 { 1 } else { -1 };
                }
            }
        }
    }

    /// Switches that the carriages would press, by where the steps have brought them.
    fn switches(places: &[i32; MOTORS_MAX]) -> u8 {
        let mut pressed = 0;
        for (joint, towards_max, at_steps) in EMULATED_SWITCHES_STEPS {
            let place = places.get(usize::from(joint)).copied().unwrap_or(0);
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

    #[exception]
    fn PendSV() {
        let places = with_stepping(|stepping| stepping.output.places).unwrap_or_default();
        let done = runtime::servo_interrupt(Inputs {
            switches: switches(&places),
            emergency: false,
        });
        // There is no watchdog to feed: what it would not have been fed is counted.
        with_stepping(|stepping| stepping.output.unfed += u32::from(!done.healthy));
        if let Some(start) = done.stream_start_ticks {
            let interval = u64::from(INTERVAL_TICKS);
            with_stepping(|stepping| stepping.output.origin_tick = start * interval);
        }
    }

    /// Every other interrupt: there is only the button.
    #[exception]
    unsafe fn DefaultHandler(_number: i16) {
        let _ = BUTTON.receive();
        BUTTON.write(INTERRUPT, 2);
        runtime::emergency_interrupt();
        with_stepping(|stepping| {
            let now = stepping.engine.now_tick();
            stepping.output.emergency_tick.get_or_insert(now);
        });
    }

    fn serve(mut receiver: Receiver) -> bool {
        let mut outgoing = Outgoing::new();
        let mut ended_tick = None;
        loop {
            if let Some(byte) = LINK.receive() {
                runtime::take_byte(&mut receiver, byte);
            }
            if let Some(&byte) = outgoing.pending(&mut receiver).first()
                && LINK.read(STATE) & TX_FULL == 0
            {
                LINK.write(DATA, byte.into());
                outgoing.sent(1);
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

    /// Prints what happened; true if it went well.
    fn report() -> bool {
        let trace = with_stepping(|stepping| {
            let trace = &stepping.output;
            let late = trace
                .emergency_tick
                .map_or(0, |tick| trace.last_tick as i64 - tick as i64);
            (trace.digest, trace.steps, late, trace.unfed)
        });
        let (digest, steps, late, unfed) = trace.unwrap_or((0, 0, 0, 0));
        with_motion(|motion| {
            let mut counts = motion.counts();
            let counts = counts.get_mut(..motion.motors()).unwrap_or_default();
            hprintln!(
                "{}\"step_digest\": \"{:016x}\", \"steps\": {}, \"final_counts\": {:?}, \
                 \"underruns\": {}, \"holds\": {}, \"faults\": {}, \
                 \"last_step_after_emergency_ticks\": {}, \"drivers_on\": {}, \
                 \"unfed_watchdog_ticks\": {}{}",
                "{",
                digest,
                steps,
                counts,
                motion.underruns(),
                motion.holds(),
                u8::from(motion.fault().is_some()),
                late,
                motion.drivers_on(),
                unfed,
                "}"
            );
            motion.fault().is_none()
        })
        .unwrap_or(false)
    }

    fn run() -> Option<bool> {
        let configuration = emulated_planar();
        let switches = HomingConfiguration::standard(&configuration);
        let machine = Machine::with_switches(&configuration, &switches, SESSION).ok()?;
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
        let output = Trace {
            directions: 0,
            origin_tick: 0,
            digest: 0xcbf2_9ce4_8422_2325,
            steps: 0,
            last_tick: 0,
            emergency_tick: None,
            unfed: 0,
            places: [0; MOTORS_MAX],
        };
        let receiver = runtime::start(
            machine,
            output,
            INTERVAL_TICKS,
            CLOCKS_PER_STEP_TICK,
            &mut peripherals.SCB,
            &mut peripherals.SYST,
        );
        Some(serve(receiver))
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

    #[panic_handler]
    fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
        debug::exit(debug::EXIT_FAILURE);
        loop {
            cortex_m::asm::bkpt();
        }
    }
}
