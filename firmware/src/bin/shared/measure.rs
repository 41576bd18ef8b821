//! What a board measures of itself in its main loop: its interrupts by their gaps, its locks and rounds, its stack.
//!
//! A window for a step tick masks all else for 7.5 us at most, less than a byte at 1 Mbaud; one for a servo tick waits for
//! it unmasked. `docs/guide/boards.md` says how to read the figures. Not covered: how long an interrupt waits before it begins.

use super::{Clock, EMPTY, HANDED, HANDOVER, LONGEST_LOCK, LONGEST_ROUND, count};
use core::sync::atomic::{AtomicU32, Ordering};
use cortex_m::peripheral::SYST;
use cortex_m::register::basepri;
use headway_firmware::board::gaps::{Gap, StepTimer, next_gap};
use headway_firmware::line::measurement::Measurement;

/// Masks every interrupt but those of the steps' priority.
const STEPS_ONLY: u8 = 0x10;
/// Rounds of the main loop from one wait for the servo to the next.
const SERVO_ROUNDS: u32 = 16;
/// Step ticks of an interval at most, and some more, that are seen while it waits.
const GAPS_MAX: u32 = 220;

/// Rounds since the measurement began.
static ROUNDS: AtomicU32 = AtomicU32::new(0);

/// One round of the main loop, which alone calls it.
pub fn measure(measurement: &mut Measurement) {
    let longest = [&LONGEST_LOCK, &LONGEST_ROUND];
    if measurement.is_new() {
        for max in longest {
            max.store(0, Ordering::Relaxed);
        }
    }
    measure_step(measurement);
    count(&ROUNDS);
    if ROUNDS.load(Ordering::Relaxed).is_multiple_of(SERVO_ROUNDS) {
        measure_servo(measurement);
    }
    if measurement.is_ending() {
        let longest = longest.map(|max| max.load(Ordering::Relaxed));
        measurement.end(longest, stack_bytes());
    }
}

/// The next gap, if it comes within so many halves of a step period.
#[inline(always)]
fn gap(half_periods: u32) -> Option<Gap> {
    let period_clocks = SYST::get_reload() + 1;
    let timer = StepTimer {
        period_clocks,
        until_step_clocks: SYST::get_current,
    };
    next_gap::<Clock>(timer, half_periods * period_clocks / 2)
}

#[inline(never)]
fn measure_step(measurement: &mut Measurement) {
    // SAFETY: what is masked waits.
    unsafe { basepri::write(STEPS_ONLY) };
    let gap = gap(3);
    // SAFETY: as before.
    unsafe { basepri::write(0) };
    if let Some(gap) = gap.filter(|gap| gap.steps == 1) {
        measurement.note_step(gap.milliclocks);
    }
}

/// Waits for the next servo tick, if it does not come between two searches. It hands a bank over, and nothing else does.
#[inline(never)]
fn measure_servo(measurement: &mut Measurement) {
    for _ in 0..GAPS_MAX {
        let before = HANDOVER.load(Ordering::Relaxed);
        let gap = gap(4);
        if before == EMPTY && HANDOVER.load(Ordering::Relaxed) == HANDED {
            if let Some(gap) = gap.filter(|gap| gap.steps > 0) {
                measurement.note_servo(gap.milliclocks, gap.steps);
            }
            return;
        }
    }
}

unsafe extern "C" {
    /// The lowest word of the stack's memory, and the first one above it (the runtime's linker script).
    static mut _stack_end: u32;
    static mut _stack_start: u32;
}

/// What the stack's memory has where it was never used.
const COLOUR: u32 = 0x5a5a_a5a5;
/// Below the stack pointer, bytes: what painting itself needs.
const MARGIN: usize = 128;

/// Paints the stack below the caller, before any interrupt is on.
#[inline(always)]
pub fn paint_stack() {
    let low = &raw mut _stack_end;
    let high = cortex_m::register::msp::read() as usize - MARGIN;
    for word in 0..high.saturating_sub(low as usize) / 4 {
        // SAFETY: memory of the stack, which nothing uses below its pointer.
        unsafe { low.add(word).write_volatile(COLOUR) }
    }
}

/// Stack that was used since it was painted, and its room.
fn stack_bytes() -> [u32; 2] {
    let [low, high] = [&raw const _stack_end, &raw const _stack_start];
    let words = (high as usize).saturating_sub(low as usize) / 4;
    // SAFETY: words of the stack's own memory, read only.
    let is_painted = |word: &usize| unsafe { low.add(*word).read_volatile() } == COLOUR;
    let free = (0..words).take_while(is_painted).count();
    [words - free, words].map(|words| 4 * words as u32)
}
