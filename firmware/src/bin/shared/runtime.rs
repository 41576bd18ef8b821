//! What both boards do alike: three contexts of different priority around the library.
//!
//! ```text
//! SysTick, highest:  step ticks; pends the servo at the end of each interval
//! PendSV, below:     servo tick: motion -> program for the next interval
//! main loop, lowest: link: bytes -> requests, reports -> bytes
//! ```
//! The main loop holds the servo off by BASEPRI for the moment of a hand-over, never the steps.
//! The servo masks all interrupts while it copies a program into the engine's idle bank (about a
//! hundred instructions, once per servo tick): the one thing here that can delay a step tick.
//! A delayed or lost step tick moves time, never a count: everything is counted in step ticks.

// Each board uses what it needs of this.
#![allow(dead_code)]

use super::Output;
use core::cell::UnsafeCell;
use core::mem::MaybeUninit;
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use cortex_m::peripheral::scb::SystemHandler;
use cortex_m::peripheral::syst::SystClkSource;
use cortex_m::peripheral::{SCB, SYST};
use cortex_m::register::basepri;
use headway_firmware::inputs::Inputs;
use headway_firmware::machine::Machine;
use headway_firmware::motion::{EMERGENCY, Motion};
use headway_firmware::receiver::Receiver;
use headway_firmware::steps::StepEngine;
use headway_firmware::watchdog::ServoHealth;
use headway_protocol::frame::FRAME_BYTES_MAX;
use headway_protocol::message::{Fault, FaultCause};

/// Of the upper four priority bits, which both chips have; steps 0, servo here.
pub const SERVO_PRIORITY: u8 = 0x80;

/// What the step interrupt owns.
pub struct Stepping {
    pub engine: StepEngine,
    pub output: Output,
    ticks_left: u32,
    interval_ticks: u32,
    /// The emergency input has stopped the engine; the servo has not dealt with it yet.
    emergency: bool,
}

/// What the servo interrupt owns, besides the motion.
struct Servo {
    motion: Motion,
    health: ServoHealth,
    overruns_seen: u32,
}

/// A value that contexts of different priority share; each access says why it is alone. Without
/// a value at first, and so without an image of one in flash.
struct Shared<T> {
    value: UnsafeCell<MaybeUninit<T>>,
    is_set: AtomicBool,
}

// SAFETY: accesses follow the rule at each `with`; there is one core.
unsafe impl<T> Sync for Shared<T> {}

impl<T> Shared<T> {
    const fn empty() -> Self {
        Self {
            value: UnsafeCell::new(MaybeUninit::uninit()),
            is_set: AtomicBool::new(false),
        }
    }

    /// # Safety
    /// Nothing that can interrupt the caller may use the same value.
    unsafe fn set(&self, value: T) {
        // SAFETY: the caller's promise.
        unsafe { (*self.value.get()).write(value) };
        self.is_set.store(true, Ordering::Release);
    }

    /// # Safety
    /// Nothing that can interrupt the caller may use the same value.
    unsafe fn with<R>(&self, work: impl FnOnce(&mut T) -> R) -> Option<R> {
        if !self.is_set.load(Ordering::Relaxed) {
            return None;
        }
        // SAFETY: the caller's promise, and it was set: on one core in that order.
        Some(work(unsafe { (*self.value.get()).assume_init_mut() }))
    }
}

static STEPPING: Shared<Stepping> = Shared::empty();
static SERVO: Shared<Servo> = Shared::empty();
/// Rounds of the main loop.
static LINK_PASSES: AtomicU32 = AtomicU32::new(0);

/// The step tick, for the SysTick interrupt.
#[inline(always)]
pub fn step_interrupt() {
    // SAFETY: the highest priority; lower ones mask interrupts while they use it.
    unsafe {
        STEPPING.with(|stepping| {
            stepping.engine.tick(&mut stepping.output);
            stepping.ticks_left -= 1;
            if stepping.ticks_left == 0 {
                stepping.ticks_left = stepping.interval_ticks;
                SCB::set_pendsv();
            }
        });
    }
}

/// The emergency input, for an interrupt of the steps' own priority: no step comes after it.
pub fn emergency_interrupt() {
    // SAFETY: as the step interrupt, which cannot interrupt this one.
    unsafe {
        STEPPING.with(|stepping| {
            stepping.engine.stop();
            stepping.emergency = true;
        });
    }
}

/// What a servo tick tells its board.
#[derive(Clone, Copy, Default)]
pub struct ServoDone {
    /// The watchdog may be fed.
    pub healthy: bool,
    /// The drivers are to hold their motors.
    pub drivers_on: bool,
    /// Servo tick at which the present stream began.
    pub stream_start_ticks: Option<u64>,
}

/// The servo tick, for the PendSV interrupt.
pub fn servo_interrupt(inputs: Inputs) -> ServoDone {
    // SAFETY: the main loop raises BASEPRI while it uses the motion.
    let done = unsafe {
        SERVO.with(|servo| {
            let step_tick = with_stepping(|stepping| stepping.engine.now_tick()).unwrap_or(0);
            servo_tick(servo, inputs);
            let passes = LINK_PASSES.load(Ordering::Relaxed);
            ServoDone {
                healthy: servo.health.tick(step_tick, passes),
                drivers_on: servo.motion.drivers_on(),
                stream_start_ticks: servo.motion.stream_start_ticks(),
            }
        })
    };
    done.unwrap_or_default()
}

fn servo_tick(servo: &mut Servo, inputs: Inputs) {
    note_stops(servo);
    let motion = &mut servo.motion;
    motion.set_inputs(inputs);
    let moving = motion.tick().map(|program| {
        with_stepping(|stepping| {
            if !stepping.emergency {
                stepping.engine.load(program);
            }
        });
    });
    if moving.is_none() {
        stop_if_due(motion);
    }
}

/// Finds out what the step interrupt has met since the last servo tick.
fn note_stops(servo: &mut Servo) {
    let seen = with_stepping(|stepping| {
        let emergency = core::mem::take(&mut stepping.emergency);
        (emergency, stepping.engine.overruns())
    });
    let Some((emergency, overruns)) = seen else {
        return;
    };
    let motion = &mut servo.motion;
    if emergency {
        motion.fail_at_once(EMERGENCY);
    } else if overruns != servo.overruns_seen && !motion.is_at_rest() {
        motion.fail_at_once(Fault {
            cause: FaultCause::StepOverrun,
            index: 0,
            value: overruns as i32,
        });
    }
    servo.overruns_seen = overruns;
    stop_if_due(motion);
}

/// Stops the engine if a fault demands it.
pub fn stop_if_due(motion: &mut Motion) {
    if motion.take_stop()
        && let Some(stopped) = with_stepping(|stepping| stepping.engine.stop())
    {
        motion.engine_stopped(&stopped);
    }
}

/// Uses the stepping from servo or main loop.
pub fn with_stepping<R>(work: impl FnOnce(&mut Stepping) -> R) -> Option<R> {
    // SAFETY: all interrupts are masked meanwhile.
    cortex_m::interrupt::free(|_| unsafe { STEPPING.with(work) })
}

/// Uses the motion from the main loop.
pub fn with_motion<R>(work: impl FnOnce(&mut Motion) -> R) -> Option<R> {
    // SAFETY: BASEPRI keeps the servo out; the step interrupt does not use the motion.
    unsafe {
        basepri::write(SERVO_PRIORITY);
        let result = SERVO.with(|servo| work(&mut servo.motion));
        basepri::write(0);
        result
    }
}

/// Puts the machine to work: from here on steps and servo run.
pub fn start(
    machine: Machine,
    output: Output,
    interval_ticks: u32,
    clocks_per_step_tick: u32,
    scb: &mut SCB,
    syst: &mut SYST,
) -> Receiver {
    let (receiver, motion, engine) = machine.into_parts();
    let stepping = Stepping {
        engine,
        output,
        ticks_left: interval_ticks,
        interval_ticks,
        emergency: false,
    };
    let servo = Servo {
        motion,
        health: ServoHealth::new(interval_ticks),
        overruns_seen: 0,
    };
    // SAFETY: none of the interrupts that use these is on yet.
    unsafe {
        STEPPING.set(stepping);
        SERVO.set(servo);
        scb.set_priority(SystemHandler::SysTick, 0);
        scb.set_priority(SystemHandler::PendSV, SERVO_PRIORITY);
    }
    SCB::set_pendsv();
    syst.set_clock_source(SystClkSource::Core);
    syst.set_reload(clocks_per_step_tick - 1);
    syst.clear_current();
    syst.enable_interrupt();
    syst.enable_counter();
    receiver
}

/// A byte from the line, in the main loop.
pub fn take_byte(receiver: &mut Receiver, byte: u8) {
    if let Some(request) = receiver.push(byte) {
        with_motion(|motion| {
            receiver.apply(request, motion);
            stop_if_due(motion);
        });
    }
}

/// A report on its way out. A host that does not listen holds it up, never the rest.
pub struct Outgoing {
    frame: [u8; FRAME_BYTES_MAX],
    length: usize,
    sent: usize,
}

impl Outgoing {
    pub const fn new() -> Self {
        Self {
            frame: [0; FRAME_BYTES_MAX],
            length: 0,
            sent: 0,
        }
    }

    /// What is to be sent now; gets the next report when the last one is out. One call per round of
    /// the main loop: it also tells the servo that the loop lives.
    pub fn pending(&mut self, receiver: &mut Receiver) -> &[u8] {
        LINK_PASSES.store(
            LINK_PASSES.load(Ordering::Relaxed).wrapping_add(1),
            Ordering::Relaxed,
        );
        if self.sent >= self.length {
            self.sent = 0;
            self.length = with_motion(|motion| receiver.poll_report(motion, &mut self.frame))
                .unwrap_or(0)
                .min(FRAME_BYTES_MAX);
        }
        self.frame.get(self.sent..self.length).unwrap_or_default()
    }

    /// So many bytes of it are out.
    pub fn sent(&mut self, bytes: usize) {
        self.sent += bytes;
    }
}
