//! The common runtime of all boards: three contexts of different priority around the library.
//!
//! ```text
//! SysTick, highest:  step ticks; pends the servo at the end of each interval
//! PendSV, below:     servo tick: motion -> program for the next interval
//! main loop, lowest: link: bytes -> requests, reports -> bytes; the spans to come
//! ```
//! The main loop masks the servo by BASEPRI while it hands knots over, copies a status, prepares a span or executes a
//! command. The durations, in instructions, are in `docs/measurements/firmware.md`: some 700, 3,800, 1,700, and up to
//! 24,000 for a start at rest. **Nothing here delays the steps.** Servo and steps have a bank each, and exchange them
//! through one word ([`HANDOVER`]):
//!
//! ```text
//! EMPTY   --servo: its bank is written-->      HANDED
//! HANDED  --steps: interval ends, they swap--> EMPTY     (if it is not HANDED then: an overrun)
//! any     --steps: stopped-->                  STOPPED   (what was handed over is not played)
//! STOPPED --servo: has found the motors-->     EMPTY
//! ```
//! A stop is an interrupt of the steps' own priority, whatever requests it. A delayed or lost step
//! tick shifts time, never a count: everything is counted in step ticks.

// Each board uses what it needs of this.
#![allow(dead_code)]

// The HAL of the STM32F4 brings a critical section of its own.
#[cfg(all(feature = "defmt", not(feature = "octopus-serial")))]
#[path = "log_lock.rs"]
mod log_lock;
#[path = "measure.rs"]
mod measure;

use super::{Clock, Output, pend_stop};
use core::cell::UnsafeCell;
use core::mem::MaybeUninit;
use core::ptr::NonNull;
use core::sync::atomic::{AtomicBool, AtomicPtr, AtomicU32, Ordering};
use cortex_m::peripheral::scb::SystemHandler;
use cortex_m::peripheral::syst::SystClkSource;
use cortex_m::peripheral::{SCB, SYST};
use cortex_m::register::basepri;
use cortex_m::register::control::{self, Npriv};
use cortex_m_rt::exception;
use headway_firmware::board::gaps::BoardClock;
use headway_firmware::configuration::MachineConfiguration;
use headway_firmware::configuration::homing::HomingConfiguration;
use headway_firmware::line::Receiver;
use headway_firmware::machine::Machine;
use headway_firmware::machine::round::Controller;
use headway_firmware::machine::servo::{Handover, Servo, ServoDone, StepSide, stop_if_due};
use headway_firmware::motion::Motion;
use headway_firmware::motion::inputs::Inputs;
use headway_firmware::steps::{Moment, StepBank, StepEngine, StepPlayer, Stopped};
// As above.
#[allow(unused_imports)]
pub use measure::{measure, paint_stack};

/// Of the upper four priority bits, which both chips have; steps 0, servo here.
pub const SERVO_PRIORITY: u8 = 0x80;

/// What the step interrupt owns.
struct Stepping {
    engine: StepEngine,
    playing: *mut StepBank,
    /// What plays next, known shortly before the interval ends.
    next: Option<NonNull<StepBank>>,
    output: Output,
}

/// A value shared by contexts of different priority; each access states why it is exclusive. It has
/// no value at first, and so no image in flash.
pub struct Shared<T> {
    value: UnsafeCell<MaybeUninit<T>>,
    is_set: AtomicBool,
}

// SAFETY: accesses follow the rule at each `with`; there is one core.
unsafe impl<T> Sync for Shared<T> {}

impl<T> Shared<T> {
    pub const fn empty() -> Self {
        Self {
            value: UnsafeCell::new(MaybeUninit::uninit()),
            is_set: AtomicBool::new(false),
        }
    }

    fn place(&self) -> NonNull<T> {
        // Not null: it is in a static.
        unsafe { NonNull::new_unchecked(self.value.get().cast()) }
    }

    /// # Safety
    /// Nothing that can interrupt the caller may use the same value.
    pub unsafe fn set(&self, value: T) {
        // SAFETY: the caller's promise.
        unsafe { (*self.value.get()).write(value) };
        self.is_set.store(true, Ordering::Release);
    }

    /// # Safety
    /// Nothing that can interrupt the caller may use the same value.
    pub unsafe fn with<R>(&self, work: impl FnOnce(&mut T) -> R) -> Option<R> {
        if !self.is_set.load(Ordering::Relaxed) {
            return None;
        }
        // SAFETY: the caller's promise, and it was set: on one core in that order.
        Some(work(unsafe { self.get() }))
    }

    /// # Safety
    /// As [`Self::with`], and it was set.
    #[inline(always)]
    #[allow(clippy::mut_from_ref)]
    pub unsafe fn get(&self) -> &mut T {
        // SAFETY: the caller's promise.
        unsafe { (*self.value.get()).assume_init_mut() }
    }
}

static STEPPING: Shared<Stepping> = Shared::empty();
static SERVO: Shared<Servo> = Shared::empty();
/// One plays, the other is the servo's while [`HANDOVER`] is not `HANDED`.
static BANKS: [Shared<StepBank>; 2] = [Shared::empty(), Shared::empty()];
/// The bank that plays; the step interrupt alone writes it.
static PLAYING: AtomicPtr<StepBank> = AtomicPtr::new(core::ptr::null_mut());
static HANDOVER: AtomicU32 = AtomicU32::new(EMPTY);
const EMPTY: u32 = 0;
const HANDED: u32 = 1;
const STOPPED: u32 = 2;
/// Where the steps were stopped: the servo's while [`HANDOVER`] is `STOPPED`.
static STOPPED_AT: Shared<Stopped> = Shared::empty();
/// A fault demands a stop.
static STOP_ASKED: AtomicBool = AtomicBool::new(false);
/// The emergency input has stopped the steps; the servo has not dealt with it yet.
static EMERGENCY_SEEN: AtomicBool = AtomicBool::new(false);
/// Intervals that had no program.
static OVERRUNS: AtomicU32 = AtomicU32::new(0);
/// Rounds of the main loop.
static LINK_PASSES: AtomicU32 = AtomicU32::new(0);

/// Clocks of the longest lock and of the longest round since they were last set to 0, and when the last round began.
pub static LONGEST_LOCK: AtomicU32 = AtomicU32::new(0);
static LONGEST_ROUND: AtomicU32 = AtomicU32::new(0);
static ROUND_BEGUN: AtomicU32 = AtomicU32::new(0);

/// Notes the time since `begun`; the main loop alone does.
#[inline(always)]
fn note_longest(longest: &AtomicU32, begun: u32) {
    let clocks = Clock::now_clocks().wrapping_sub(begun);
    if clocks > longest.load(Ordering::Relaxed) {
        longest.store(clocks, Ordering::Relaxed);
    }
}

/// Adds one to a counter that only one context writes.
fn count(counter: &AtomicU32) {
    let value = counter.load(Ordering::Relaxed);
    counter.store(value.wrapping_add(1), Ordering::Relaxed);
}

/// The step tick, for the SysTick interrupt.
#[inline(always)]
pub fn step_interrupt() {
    // SAFETY: the highest priority, and all is set before this interrupt is on. The bank that plays
    // is ours until we change it.
    unsafe {
        let stepping = STEPPING.get();
        let bank = &mut *stepping.playing;
        match stepping.engine.tick(bank, &mut stepping.output) {
            Moment::Within => {}
            Moment::Begun => SCB::set_pendsv(),
            Moment::Ending => {
                let handed = HANDOVER.load(Ordering::Acquire) == HANDED;
                stepping.next = handed.then(|| idle_bank(bank));
            }
            Moment::Ended => next_interval(stepping, bank),
        }
    }
}

/// The next bank plays, if there is one.
#[inline(always)]
fn next_interval(stepping: &mut Stepping, bank: &mut StepBank) {
    let Some(next) = stepping.next else {
        stepping.engine.idle(bank);
        count(&OVERRUNS);
        return;
    };
    // SAFETY: it was handed over; from here on it is ours, and the other is the servo's.
    stepping
        .engine
        .begin(unsafe { next.as_ref() }, &mut stepping.output);
    stepping.playing = next.as_ptr();
    PLAYING.store(next.as_ptr(), Ordering::Relaxed);
    HANDOVER.store(EMPTY, Ordering::Release);
}

/// Servo tick since the start, where nothing interrupts any more.
pub fn now_servo_tick() -> u32 {
    // SAFETY: a number is read, and whoever used the motion does not go on.
    unsafe { SERVO.with(|servo| servo.motion().now_ticks()) }.unwrap_or(0) as u32
}

/// The present step tick, for interrupts of the steps' own priority.
pub fn now_tick() -> u64 {
    // SAFETY: the caller cannot interrupt the steps, nor be interrupted by them.
    unsafe { STEPPING.with(|stepping| stepping.engine.now_tick()) }.unwrap_or(0)
}

/// True if a motor turns round within the interval that plays.
pub fn interval_reverses() -> bool {
    // SAFETY: for tests, where nothing interrupts.
    unsafe { (*PLAYING.load(Ordering::Relaxed)).reverses() }
}

/// The bank that is not playing. [`HANDOVER`] says who owns it.
#[inline(always)]
fn idle_bank(playing: *const StepBank) -> NonNull<StepBank> {
    let [first, second] = &BANKS;
    if core::ptr::eq(playing, first.place().as_ptr()) {
        second.place()
    } else {
        first.place()
    }
}

/// Stops the steps, in an interrupt of the steps' priority: no step follows.
fn stop_steps() {
    // SAFETY: as the step interrupt, which cannot interrupt this one. Where they were stopped is
    // ours unless it waits to be read.
    unsafe {
        if HANDOVER.load(Ordering::Relaxed) != STOPPED {
            let stepping = STEPPING.get();
            stepping.next = None;
            STOPPED_AT.set(stepping.engine.stop(&mut *stepping.playing));
            HANDOVER.store(STOPPED, Ordering::Release);
        }
    }
}

/// The board's stop interrupt, pended by its emergency input (a spike counts as well) or by any code that
/// requested a stop.
pub fn stop_interrupt(emergency: bool) {
    let asked = STOP_ASKED.swap(false, Ordering::Relaxed);
    if STEPPING.is_set.load(Ordering::Acquire) && (emergency || asked) {
        stop_steps();
    }
    if emergency {
        EMERGENCY_SEEN.store(true, Ordering::Relaxed);
    }
}

/// The servo tick, for the PendSV interrupt.
#[inline(always)]
pub fn servo_interrupt(inputs: Inputs) -> ServoDone {
    // SAFETY: it is set before this interrupt is on, and the main loop raises BASEPRI while it uses
    // the motion.
    let servo = unsafe { SERVO.get() };
    servo.tick(inputs, &mut Steps, LINK_PASSES.load(Ordering::Relaxed))
}

/// Servo tick at which the current stream began; for the servo interrupt.
pub fn stream_start_ticks() -> Option<u64> {
    // SAFETY: as there.
    unsafe { SERVO.with(|servo| servo.motion().stream_start_ticks()) }.flatten()
}

/// The step interrupt, as the servo sees it.
struct Steps;

impl StepSide for Steps {
    #[inline(always)]
    fn handover(&self) -> Handover {
        match HANDOVER.load(Ordering::Acquire) {
            EMPTY => Handover::Empty,
            HANDED => Handover::Handed,
            _ => Handover::Stopped,
        }
    }

    #[inline(always)]
    fn overruns(&self) -> u32 {
        OVERRUNS.load(Ordering::Relaxed)
    }

    fn take_emergency(&mut self) -> bool {
        EMERGENCY_SEEN.swap(false, Ordering::Relaxed)
    }

    #[inline(always)]
    fn idle_bank(&mut self) -> &mut StepBank {
        // SAFETY: nothing is handed over, so the bank is the servo's, and the playing one stays.
        unsafe { idle_bank(PLAYING.load(Ordering::Relaxed)).as_mut() }
    }

    #[inline(always)]
    fn hand_over(&mut self) {
        // It fails where the steps were stopped meanwhile: that is found in the next servo tick.
        let (success, failure) = (Ordering::Release, Ordering::Relaxed);
        let _ = HANDOVER.compare_exchange(EMPTY, HANDED, success, failure);
    }

    fn stop(&mut self) {
        STOP_ASKED.store(true, Ordering::Relaxed);
        pend_stop();
        // The interrupt is to be over before the next line.
        cortex_m::asm::dsb();
        cortex_m::asm::isb();
    }

    fn tell_stopped(&mut self, tell: impl FnOnce(&Stopped)) {
        if HANDOVER.load(Ordering::Acquire) == STOPPED {
            // SAFETY: the servo's while it is so.
            unsafe {
                STOPPED_AT.with(|stopped| tell(stopped));
            }
            HANDOVER.store(EMPTY, Ordering::Release);
        }
    }
}

/// Uses the output when nothing moves any more, with all interrupts masked.
pub fn with_output<R>(work: impl FnOnce(&mut Output) -> R) -> Option<R> {
    // SAFETY: nothing interrupts.
    cortex_m::interrupt::free(|_| unsafe { STEPPING.with(|stepping| work(&mut stepping.output)) })
}

/// Uses the motion from the main loop.
pub fn with_motion<R>(work: impl FnOnce(&mut Motion) -> R) -> Option<R> {
    // SAFETY: BASEPRI keeps the servo out; the step interrupt does not use the motion.
    unsafe {
        basepri::write(SERVO_PRIORITY);
        let begun = Clock::now_clocks();
        let result = SERVO.with(|servo| work(servo.motion_mut()));
        note_longest(&LONGEST_LOCK, begun);
        basepri::write(0);
        result
    }
}

/// What a board is to run.
pub struct Board<'a> {
    pub configuration: &'a MachineConfiguration,
    pub switches: &'a HomingConfiguration,
    /// Of this start of the board.
    pub session: u32,
}

/// Places the machine where the interrupts expect it, before any of them is on; `None` if it cannot
/// be run.
// Never inlined into its caller: this function's stack is free again when the main loop begins.
#[inline(never)]
pub fn set_up(board: &Board, output: Output) -> Option<Receiver> {
    let Board {
        configuration,
        switches,
        session,
    } = *board;
    Machine::check(configuration, switches).ok()?;
    place_servo(configuration, switches);
    // SAFETY: none of the interrupts that use these is on yet.
    unsafe {
        for bank in &BANKS {
            bank.set(StepBank::default());
        }
        let playing = BANKS[0].place().as_ptr();
        PLAYING.store(playing, Ordering::Relaxed);
        STEPPING.set(Stepping {
            engine: StepPlayer::new(configuration.interval_ticks()).into_engine(),
            playing,
            next: None,
            output,
        });
    }
    Some(Receiver::new(configuration, session))
}

/// The servo's part, the largest, by itself: two of its size on the stack at once would leave no room
/// for anything else.
#[inline(never)]
fn place_servo(configuration: &MachineConfiguration, switches: &HomingConfiguration) {
    let mut motion = Motion::new(configuration, switches);
    motion.work_in_pieces();
    // SAFETY: the servo's interrupt is not on yet.
    unsafe { SERVO.set(Servo::new(motion)) };
}

/// Starts the machine: from here on steps and servo run. `None` if it cannot be run.
pub fn start(
    board: &Board,
    output: Output,
    clocks_per_step_tick: u32,
    scb: &mut SCB,
    syst: &mut SYST,
) -> Option<Receiver> {
    let receiver = set_up(board, output)?;
    // SAFETY: none of these interrupts is on yet, and what they use is set.
    unsafe {
        scb.set_priority(SystemHandler::SysTick, 0);
        scb.set_priority(SystemHandler::PendSV, SERVO_PRIORITY);
    }
    SCB::set_pendsv();
    syst.set_clock_source(SystClkSource::Core);
    syst.set_reload(clocks_per_step_tick - 1);
    syst.clear_current();
    syst.enable_interrupt();
    syst.enable_counter();
    Some(receiver)
}

/// Calls code of the main loop that would mask interrupts, so that it cannot: without privilege the
/// core ignores `cpsid`. This is for third-party drivers that mask interrupts without need, and use
/// neither the motion nor the core's own registers.
pub fn without_masking<R>(work: impl FnOnce() -> R) -> R {
    let mut control = control::read();
    control.set_npriv(Npriv::Unprivileged);
    // SAFETY: the work needs no privilege; what follows has it again.
    unsafe { control::write(control) };
    let result = work();
    regain_privilege();
    result
}

/// Restores the main loop's privilege, from anywhere in unprivileged code: `cpsid` has no effect before. An
/// interrupt is privileged whatever it interrupted, and must not call the supervisor, which could not run: that
/// would be a hard fault.
pub fn regain_privilege() {
    // Without privilege this register reads as 0: then it is the main loop, as no interrupt is without.
    let interrupt: u32;
    // SAFETY: reading has no effect.
    unsafe { core::arch::asm!("mrs {0}, ipsr", out(reg) interrupt, options(nomem, nostack)) };
    if interrupt == 0 && control::read().npriv().is_unprivileged() {
        // SAFETY: the handler below gives privilege back. Its priority is the highest, and nothing masks it.
        unsafe { core::arch::asm!("svc 0") };
    }
}

/// The main loop asks for its privilege back.
#[exception]
fn SVCall() {
    let mut control = control::read();
    control.set_npriv(Npriv::Privileged);
    // SAFETY: what it was before the work without it.
    unsafe { control::write(control) };
}

/// The main loop's access to data that the servo owns.
pub struct Locked;

impl Controller for Locked {
    #[inline(always)]
    fn with_motion<R>(&mut self, work: impl FnOnce(&mut Motion) -> R) -> Option<R> {
        with_motion(work)
    }

    #[inline(always)]
    fn command(&mut self, work: impl FnOnce(&mut Motion)) {
        with_motion(|motion| {
            work(motion);
            stop_if_due(motion, &mut Steps);
        });
    }

    #[inline(always)]
    fn note_round(&mut self) {
        note_pass();
        note_longest(&LONGEST_ROUND, ROUND_BEGUN.load(Ordering::Relaxed));
        ROUND_BEGUN.store(Clock::now_clocks(), Ordering::Relaxed);
    }
}

/// Notes that the main loop is alive: also for its longer work.
#[inline(always)]
pub fn note_pass() {
    count(&LINK_PASSES);
}
