//! An edge of one line of the external interrupts, and the input's level. The chip latches the edge
//! until it is handled; every servo tick reads the level. Either counts if the input stays pressed for some
//! microseconds.

use super::pins::PORTS;
use super::step_ports::PORT_BYTES;
use super::{CoreDelay, DelayNs};
use core::sync::atomic::{AtomicPtr, AtomicU32, Ordering};
use headway_firmware::motion::inputs::{EMERGENCY_LOOK_NS, is_held};
use headway_firmware::steps::output::Pin;

/// Levels of port A.
const LEVELS: usize = PORTS + 0x10;

/// Ports in the multiplexer, four lines to a register.
const MULTIPLEXER: *mut u32 = 0x4001_3808 as *mut u32;
const MASK: *mut u32 = 0x4001_3c00 as *mut u32;
const RISING: *mut u32 = 0x4001_3c08 as *mut u32;
const FALLING: *mut u32 = 0x4001_3c0c as *mut u32;
const PENDING: *mut u32 = 0x4001_3c14 as *mut u32;
/// Bit of the line.
static LINE: AtomicU32 = AtomicU32::new(0);
/// Levels of its port, and the bits that differ from them where it is pressed.
static PORT: AtomicPtr<u32> = AtomicPtr::new(LEVELS as *mut u32);
static RELEASED: AtomicU32 = AtomicU32::new(0);

/// `falls`: it is normally open, so that it stops by going low.
pub fn set_up((port, line): Pin, falls: bool) {
    let bit = 1u32 << (line & 15);
    let shift = line % 4 * 4;
    let edge = if falls { FALLING } else { RISING };
    // SAFETY: registers of this line only, one of 16, before its interrupt is on.
    unsafe {
        let multiplexer = MULTIPLEXER.add((line & 15) as usize / 4);
        let others = multiplexer.read_volatile() & !(0xf << shift);
        multiplexer.write_volatile(others | (port as u32) << shift);
        edge.write_volatile(edge.read_volatile() | bit);
        MASK.write_volatile(MASK.read_volatile() | bit);
        // Writing a one clears the flag.
        PENDING.write_volatile(bit);
    }
    let levels = LEVELS + port * PORT_BYTES;
    PORT.store(levels as *mut u32, Ordering::Relaxed);
    RELEASED.store(if falls { bit } else { 0 }, Ordering::Relaxed);
    LINE.store(bit, Ordering::Relaxed);
}

/// True if there was an edge since the last call, and the input is pressed now. An edge during the check is
/// returned by the next call.
pub fn take() -> bool {
    let bit = LINE.load(Ordering::Relaxed);
    // SAFETY: as above; a one clears this line's flag alone.
    let edge = unsafe {
        let edge = PENDING.read_volatile() & bit != 0;
        PENDING.write_volatile(bit);
        edge
    };
    edge && is_pressed()
}

/// True if it is pressed during the complete check.
#[cold]
pub fn is_pressed() -> bool {
    let (bit, released) = (
        LINE.load(Ordering::Relaxed),
        RELEASED.load(Ordering::Relaxed),
    );
    let levels = PORT.load(Ordering::Relaxed);
    is_held(|| {
        CoreDelay.delay_ns(EMERGENCY_LOOK_NS);
        // SAFETY: reading the levels of a port has no effect.
        unsafe { levels.read_volatile() & bit != released }
    })
}
