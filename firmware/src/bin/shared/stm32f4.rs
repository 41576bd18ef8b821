//! All of an STM32F4 board but its table: start-up, clocks, watchdog, emergency input, serial line, main loop.
//!
//! A board's crate has its [`BoardTable`](headway_firmware::board::table::BoardTable) as `BOARD` in its root, and this
//! module; `runtime.rs` does the rest. Registers after RM0090 (STM32F405) and RM0390 (STM32F446), which
//! agree in everything used here. Built and emulated: it has not run on hardware.

// Each board uses what it needs of this.
#![allow(dead_code)]

#[cfg(feature = "defmt")]
use defmt_rtt as _;

#[cfg_attr(feature = "emulated", allow(unused_imports))]
#[path = "stm32f4_clocks.rs"]
mod clocks;
#[path = "stm32f4_converter.rs"]
mod converter;
#[path = "stm32f4_emergency.rs"]
mod emergency_input;
#[path = "stm32f4_ends.rs"]
mod ends;
#[path = "stm32f4_flash.rs"]
mod flash;
#[path = "stm32f4_heat.rs"]
mod heat;
#[path = "stm32f4_pins.rs"]
mod pins;
#[path = "stm32f4_rcc.rs"]
mod rcc;
#[path = "runtime.rs"]
mod runtime;
#[path = "stm32f4_servo.rs"]
mod servo;
#[path = "stm32f4_start.rs"]
mod start;
#[path = "step_ports.rs"]
mod step_ports;
#[cfg(feature = "octopus")]
#[path = "stm32f4_usb.rs"]
mod usb;
#[cfg(not(feature = "octopus"))]
mod usb {
    pub type UsbLine = headway_firmware::board::NoLine;
    pub fn set_up(_: super::pac::Peripherals) -> Option<UsbLine> {
        Some(headway_firmware::board::NoLine)
    }
}
#[path = "stm32f4_wires.rs"]
mod wires;

use crate::BOARD;
use CoreClock as Clock;
use converter::Thermistors;
use core::convert::Infallible;
use cortex_m::peripheral::{DWT, NVIC, Peripherals};
use cortex_m_rt::exception;
use embedded_hal::delay::DelayNs;
use embedded_io::{ErrorType, Read, ReadReady, Write, WriteReady};
pub use ends::stop;
use flash::KeptSettings;
use headway_firmware::board::built_in::built_for;
use headway_firmware::board::gaps::BoardClock;
use headway_firmware::board::{BoardPins, ByteRing, Incoming, chip_fault, fetch, send};
use headway_firmware::configuration::board_name::{Known, UNNAMED};
use headway_firmware::design::WEIGHED_KNOTS;
use headway_firmware::line::measurement::Measurement;
use headway_firmware::line::{Conversation, Receiver};
use headway_firmware::machine::round::{Controller, Link, Surroundings, round};
use headway_firmware::motion::inputs::Inputs;
use headway_firmware::motion::probe_pin::PulsePort;
use headway_firmware::settings::BoardSettings;
use headway_firmware::steps::output::PortOutput;
use headway_protocol::message::{Fault, FaultCause};
use heat::HeatLoop;
use pins::Pins;
use rcc::{Bus, clock_on};
use runtime::{Board, Locked, Shared, with_motion};
use servo::ProbeServo;
use step_ports::DriverPorts;
use stm32f4xx_hal::pac::{self, Interrupt, interrupt};
use usb::UsbLine;
use wires::DriverLoop;

/// System configuration, which has the multiplexer of the external interrupts.
const MULTIPLEXER_CLOCK_MASK: u32 = 1 << 14;
pub const CORE_HZ: u32 = 168_000_000;
/// Of the upper four priority bits: below the steps, above the servo.
const SERIAL_PRIORITY: u8 = 0x40;

/// The serial line, and USB.
const LINES: usize = 2;
const USB_LINE: usize = 1;

const _: () = BOARD.check();

type Output = PortOutput<DriverPorts>;

/// The servo interrupt's.
static PINS: Shared<Pins> = Shared::empty();

#[exception]
fn SysTick() {
    runtime::step_interrupt();
}

#[exception]
fn PendSV() {
    // SAFETY: set before this interrupt is on, which alone uses it.
    let pins = unsafe { PINS.get() };
    let done = runtime::servo_interrupt(confirmed(pins.inputs()));
    pins.hold(done.held_motors);
    heat::servo_tick(pins);
    if done.healthy {
        start::feed_watchdog();
    }
}

/// An emergency input that is pressed for a moment only is not.
#[inline(always)]
fn confirmed(inputs: Inputs) -> Inputs {
    Inputs {
        emergency: inputs.emergency && emergency_input::is_pressed(),
        ..inputs
    }
}

/// The interrupts of the lines: the emergency input has opened, or a stop is requested.
const STOPS: [Interrupt; 7] = [
    Interrupt::EXTI0,
    Interrupt::EXTI1,
    Interrupt::EXTI2,
    Interrupt::EXTI3,
    Interrupt::EXTI4,
    Interrupt::EXTI9_5,
    Interrupt::EXTI15_10,
];

macro_rules! interrupts {
    ($work:expr; $($name:ident),*) => {
        $(#[interrupt]
        fn $name() {
            $work
        })*
    };
}
interrupts!(runtime::stop_interrupt(emergency_input::take()); EXTI0, EXTI1, EXTI2, EXTI3, EXTI4, EXTI9_5, EXTI15_10);
interrupts!(SerialLine::interrupt(); USART1, USART2, USART3);

/// Asks for the stop interrupt.
pub fn pend_stop() {
    NVIC::pend(Interrupt::EXTI9_5);
}

/// A USART at 1 Mbaud: received bytes go into a ring, sent ones straight out.
pub struct SerialLine;

/// Its registers, its clock, its interrupt, and the clock of its bus.
const SERIAL: (usize, Bus, u32, Interrupt, u32) = match BOARD.usart {
    1 => (0x4001_1000, Bus::Apb2, 1 << 4, Interrupt::USART1, 84),
    2 => (0x4000_4400, Bus::Apb1, 1 << 17, Interrupt::USART2, 42),
    _ => (0x4000_4800, Bus::Apb1, 1 << 18, Interrupt::USART3, 42),
};
const SERIAL_PORT: usize = SERIAL.0;
const SERIAL_INTERRUPT: Interrupt = SERIAL.3;
const STATE: *mut u32 = SERIAL_PORT as *mut u32;
const DATA: *mut u32 = (SERIAL_PORT + 4) as *mut u32;
const BAUD: *mut u32 = (SERIAL_PORT + 8) as *mut u32;
const CONTROL: *mut u32 = (SERIAL_PORT + 12) as *mut u32;
const TX_EMPTY: u32 = 1 << 7;
/// On; interrupt when a byte has arrived; sends and receives.
const SERIAL_ON: u32 = 1 << 13 | 1 << 5 | 1 << 3 | 1 << 2;
/// Of the bus's clock, MHz, by 16 with four bits behind the point.
const ONE_MBAUD: u32 = SERIAL.4;
/// 41 ms at 1 Mbaud: twice the time in which an arm processes a full block of knots, while nothing is read.
/// The host sends no more than its credit, so at most two blocks arrive in a row.
static ARRIVED: ByteRing<4096> = ByteRing::new();

impl SerialLine {
    fn set_up() -> Self {
        // SAFETY: registers of this USART, before its interrupt is on.
        unsafe {
            BAUD.write_volatile(ONE_MBAUD);
            CONTROL.write_volatile(SERIAL_ON);
        }
        Self
    }

    /// A byte has arrived.
    fn interrupt() {
        // SAFETY: reading state and data, as this interrupt alone does.
        let byte = unsafe {
            let _ = STATE.read_volatile();
            DATA.read_volatile() as u8
        };
        ARRIVED.push(byte);
    }
}

impl ErrorType for SerialLine {
    type Error = Infallible;
}

impl Read for SerialLine {
    fn read(&mut self, bytes: &mut [u8]) -> Result<usize, Infallible> {
        let mut length = 0;
        for (place, byte) in bytes.iter_mut().zip(core::iter::from_fn(|| ARRIVED.pop())) {
            *place = byte;
            length += 1;
        }
        Ok(length)
    }
}

impl ReadReady for SerialLine {
    fn read_ready(&mut self) -> Result<bool, Infallible> {
        Ok(!ARRIVED.is_empty())
    }
}

impl Write for SerialLine {
    fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        let Some(&byte) = bytes.first() else {
            return Ok(0);
        };
        // SAFETY: the main loop alone sends.
        unsafe { DATA.write_volatile(byte.into()) };
        Ok(1)
    }

    fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

impl WriteReady for SerialLine {
    fn write_ready(&mut self) -> Result<bool, Infallible> {
        // SAFETY: reading the state has no effect before data is read.
        Ok(unsafe { STATE.read_volatile() } & TX_EMPTY != 0)
    }
}

/// What the main loop works with.
struct Around {
    heat: HeatLoop,
    drivers: DriverLoop,
    kept: KeptSettings,
    serial: SerialLine,
    usb: UsbLine,
    servo: ProbeServo,
    from_serial: Incoming,
    from_usb: Incoming,
}

impl Surroundings for Around {
    const AT_ONCE: bool = false;
    const WEIGHED_KNOTS: usize = WEIGHED_KNOTS;
    type Bytes = Incoming;

    #[inline(always)]
    fn heard(&mut self, line: usize) -> &mut Incoming {
        if line == USB_LINE {
            fetch(&mut self.usb, &mut self.from_usb);
            &mut self.from_usb
        } else {
            fetch(&mut self.serial, &mut self.from_serial);
            &mut self.from_serial
        }
    }

    #[inline(always)]
    fn send(&mut self, line: usize, bytes: &[u8]) -> usize {
        if line == USB_LINE {
            send(&mut self.usb, bytes)
        } else {
            send(&mut self.serial, bytes)
        }
    }

    #[inline(always)]
    fn store(&mut self, receiver: &mut Receiver, talk: &mut Conversation) {
        self.kept.store(receiver, talk);
    }

    #[inline(always)]
    fn heat(&mut self, _controller: &mut impl Controller) {
        self.heat.turn();
    }

    #[inline(always)]
    fn drivers(&mut self, _controller: &mut impl Controller) {
        self.drivers.turn();
    }

    fn measure(&mut self, measurement: &mut Measurement) {
        runtime::measure(measurement);
    }

    #[inline(always)]
    fn pulse(&mut self, pulse_us: u16) {
        self.servo.put(pulse_us);
    }
}

/// The main loop.
// A function of its own: tests stop where the set-up is over.
#[inline(never)]
fn serve(mut receiver: Receiver, mut links: [Link; LINES], mut around: Around) -> ! {
    loop {
        round(&mut receiver, &mut links, &mut Locked, &mut around);
    }
}

/// The settings in flash, else the built-in ones.
// Never part of its caller, whose stack lasts.
#[inline(never)]
fn what_to_run(kept: &mut KeptSettings) -> Option<BoardSettings> {
    kept.settings().or_else(built_for)
}

/// Clocks of the chip, the ports, the serial port and the multiplexer of the external interrupts; the fault of this
/// board, if it has one.
fn set_up_clocks(device: &pac::Peripherals) -> Option<Fault> {
    let wrong_clock = clocks::set_up(&device.RCC, &device.FLASH);
    clock_on(Bus::Ahb1, const { BOARD.ports_mask() });
    clock_on(SERIAL.1, SERIAL.2);
    clock_on(Bus::Apb2, MULTIPLEXER_CLOCK_MASK);
    chip_fault(start::device_id(), BOARD.chip_id).or(wrong_clock)
}

/// The fault of a run that the watchdog has ended, once; a heater's of before stays or goes by the kind of reset.
fn watchdog_fault(rcc: &pac::RCC) -> Option<Fault> {
    let flags = rcc.csr().read();
    start::keep_fault(start::kept_fault().after_reset(flags.bits()));
    let by_watchdog = flags.wdgrstf().bit_is_set();
    rcc.csr().modify(|_, w| w.rmvf().set_bit());
    by_watchdog.then_some(Fault {
        cause: FaultCause::Watchdog,
        index: 0,
        value: 0,
    })
}

/// Tells the receiver what settings are kept and in force, by which clock the board measures, and how the last run ended.
fn introduce(receiver: &mut Receiver, kept: &KeptSettings) {
    receiver.keep_settings(kept.limits());
    receiver.settings_in_force(kept.hash());
    receiver
        .measurement()
        .measure_with(CORE_HZ, Some(flash::brown_out_level()));
    receiver.has_crashed(start::take_crash());
}

/// # Safety
/// What these interrupts use is set up, or not looked at before it is.
unsafe fn unmask(nvic: &mut NVIC) {
    // SAFETY: the caller's promise.
    unsafe {
        for stop in STOPS {
            nvic.set_priority(stop, 0);
            NVIC::unmask(stop);
        }
        nvic.set_priority(SERIAL_INTERRUPT, SERIAL_PRIORITY);
        NVIC::unmask(SERIAL_INTERRUPT);
    }
}

fn run() -> Option<()> {
    runtime::paint_stack();
    let mut kept = KeptSettings::find()?;
    let BoardSettings {
        machine: configuration,
        switches,
        heaters: asked,
        drivers,
        wiring,
        board: name,
    } = what_to_run(&mut kept)?;
    let motors = configuration.motor_count();
    let mut core = Peripherals::take()?;
    let device = pac::Peripherals::take()?;
    let by_watchdog = watchdog_fault(&device.RCC);
    let wrong_board = set_up_clocks(&device);
    let known = Known::of(wrong_board, name.is_some() || BOARD.names.is_empty());
    let map = wiring
        .map(&BOARD.board_inputs())
        .with_switches_of(&switches);
    // Before the pins: the library that takes the pins of USB over resets their port.
    let usb = usb::set_up(device)?;
    let pins = pins::set_up(motors, map, known);
    let output = Output::new(
        DriverPorts::new(pins::PORTS),
        motors,
        wiring.reversed_motors,
    );
    let thermistors = Thermistors::set_up();
    let wires = wires::set_up();
    let servo = ProbeServo::set_up(known);
    let serial = SerialLine::set_up();
    let emergency = BOARD.inputs.get(usize::from(map.emergency()))?;
    emergency_input::set_up(*emergency, map.is_open(map.emergency()));
    let clocks = CORE_HZ.checked_div(configuration.step_hz)?;
    let board = Board {
        configuration: &configuration,
        switches: &switches,
        session: start::session(),
    };
    // SAFETY: what these interrupts use is set up, or not looked at before it is.
    unsafe {
        PINS.set(pins);
        heat::set_up();
        unmask(&mut core.NVIC);
    }
    let mut receiver = runtime::start(&board, output, clocks, &mut core.SCB, &mut core.SYST)?;
    let unnamed = (known == Known::Unnamed).then_some(UNNAMED);
    // A heater's fault is more informative than the hang of the board that it caused.
    let of_before = start::kept_fault().fault().or(by_watchdog);
    if let Some(fault) = wrong_board.or(unnamed).or(of_before) {
        with_motion(|motion| motion.fail_softly(fault));
    }
    with_motion(|motion| motion.fit_probe_pin(wiring.pin()));
    introduce(&mut receiver, &kept);
    let heat = HeatLoop::new(&configuration, &BOARD.heat(asked), thermistors)?;
    core.DCB.enable_trace();
    core.DWT.enable_cycle_counter();
    let drivers = DriverLoop::new(&known.of_board(drivers), configuration.servo_hz, wires);
    let links = [0, 1].map(|line| Link::new(Conversation::new(&configuration, line)));
    // SAFETY: all that interrupts use is set.
    unsafe { cortex_m::interrupt::enable() }
    let around = Around {
        heat,
        drivers,
        kept,
        serial,
        usb,
        servo,
        from_serial: Incoming::new(),
        from_usb: Incoming::new(),
    };
    serve(receiver, links, around)
}

/// It only ends if the built-in machine cannot be run, or the chip has no clock: nothing ever moves, and the watchdog
/// restarts.
#[cortex_m_rt::entry]
fn main() -> ! {
    run();
    stop()
}

/// The core's counter of clocks.
pub struct CoreClock;

impl BoardClock for CoreClock {
    // A reading and its comparison take ten clocks or so, a step tick a hundred and more.
    const GAP_CLOCKS: u32 = 40;

    #[inline(always)]
    fn now_clocks() -> u32 {
        DWT::cycle_count()
    }
}

/// Waits in the core.
pub struct CoreDelay;

impl DelayNs for CoreDelay {
    fn delay_ns(&mut self, ns: u32) {
        let clocks = u64::from(ns) * u64::from(CORE_HZ / 1_000_000) / 1000;
        cortex_m::asm::delay(clocks as u32);
    }
}
