//! The first instructions, before memory is initialised: they clean up after a boot loader.
//!
//! Interrupts off, SysTick off, nothing pending, nothing enabled, no priority masked, this image's
//! vector table, the watchdog; then data that the program left in memory before the reset are read.
//! From ARM DDI 0403 (B3.2 to B3.4). A boot loader is assumed to enter like a reset: on the main
//! stack, privileged.

use super::rcc::all_inputs;
use core::mem::MaybeUninit;
use headway_firmware::board::{
    KEPT_WORDS, KeptCrash, KeptFault, StartCounter, crash_of, kept_crash, mix_noise, serial_number,
    session_of,
};
use headway_protocol::message::Crash;

const SYSTICK_CONTROL: *mut u32 = 0xe000_e010 as *mut u32;
const ICSR: *mut u32 = 0xe000_ed04 as *mut u32;
const VTOR: *mut u32 = 0xe000_ed08 as *mut u32;
/// Clears PendSV and SysTick.
const CLEAR_PENDING_SYSTEM: u32 = 1 << 27 | 1 << 25;
const NVIC_CLEAR_ENABLE: *mut u32 = 0xe000_e180 as *mut u32;
const NVIC_CLEAR_PENDING: *mut u32 = 0xe000_e280 as *mut u32;
const NVIC_PRIORITY: *mut u32 = 0xe000_e400 as *mut u32;
/// Words of 32 interrupts: the STM32F446 has 97.
const NVIC_WORDS: usize = 4;
/// Words of 4 priorities.
const PRIORITY_WORDS: usize = 25;

const WATCHDOG_KEY: *mut u32 = 0x4000_3000 as *mut u32;
const WATCHDOG_PRESCALER: *mut u32 = 0x4000_3004 as *mut u32;
const WATCHDOG_RELOAD: *mut u32 = 0x4000_3008 as *mut u32;
/// Time without a healthy servo after which everything is reset: its own 32 kHz / 32 = 1 per ms.
const WATCHDOG_MS: u32 = 200;

/// Address of the chip's unique 96-bit identifier. Emulated builds put the address of other words here, as the
/// emulator has nothing at this address.
#[cfg(not(feature = "emulated"))]
#[unsafe(no_mangle)]
static CHIP_UNIQUE_AT: usize = 0x1fff_7a10;
const DEVICE_ID: *const u32 = 0xe004_2000 as *const u32;

const RAM: *const u32 = 0x2000_0000 as *const u32;
const RAM_WORDS: usize = 128 * 1024 / 4;

unsafe extern "C" {
    /// The vector table, placed by the runtime's linker script.
    #[link_name = "__vector_table"]
    static VECTORS: u32;
}

/// Left alone by the set-up of memory: the counter of the run before, and the noise of this start.
#[unsafe(link_section = ".uninit.start")]
static mut COUNTER: MaybeUninit<[u32; 2]> = MaybeUninit::uninit();
/// A fault of the heaters that the run before had latched.
#[unsafe(link_section = ".uninit.start")]
static mut KEPT: MaybeUninit<[u32; KEPT_WORDS]> = MaybeUninit::uninit();
/// How the run before crashed.
#[unsafe(link_section = ".uninit.start")]
static mut CRASH: MaybeUninit<KeptCrash> = MaybeUninit::uninit();
#[unsafe(link_section = ".uninit.start")]
static mut NOISE: MaybeUninit<u32> = MaybeUninit::uninit();

/// The runtime's first call after reset.
///
/// # Safety
/// For the runtime alone.
#[unsafe(export_name = "__pre_init")]
unsafe extern "C" fn clean_up() {
    // SAFETY: core registers of this chip, before anything else uses them; no memory but the stack and
    // what is not set up later.
    unsafe {
        core::arch::asm!("cpsid i");
        start_watchdog();
        // A heater that a run or a boot loader before left on: boards pull its gate down. Nothing is driven before it
        // is known which board this is.
        all_inputs();
        SYSTICK_CONTROL.write_volatile(0);
        for word in 0..NVIC_WORDS {
            NVIC_CLEAR_ENABLE.add(word).write_volatile(u32::MAX);
            NVIC_CLEAR_PENDING.add(word).write_volatile(u32::MAX);
        }
        for word in 0..PRIORITY_WORDS {
            NVIC_PRIORITY.add(word).write_volatile(0);
        }
        ICSR.write_volatile(CLEAR_PENDING_SYSTEM);
        VTOR.write_volatile(core::ptr::addr_of!(VECTORS) as u32);
        core::arch::asm!("msr basepri, {0}", "cpsie f", "dsb", "isb", in(reg) 0);
        let mut noise = 0;
        for word in 0..RAM_WORDS {
            noise = mix_noise(noise, RAM.add(word).read_volatile());
        }
        (&raw mut NOISE).cast::<u32>().write_volatile(noise);
    }
}

/// # Safety
/// Registers of the watchdog, before anything else uses them.
unsafe fn start_watchdog() {
    // SAFETY: the caller's promise. Once started it cannot be stopped.
    unsafe {
        WATCHDOG_KEY.write_volatile(0xcccc);
        WATCHDOG_KEY.write_volatile(0x5555);
        WATCHDOG_PRESCALER.write_volatile(3);
        WATCHDOG_RELOAD.write_volatile(WATCHDOG_MS);
        feed_watchdog();
    }
}

const WATCHDOG_STATE: *const u32 = 0x4000_300c as *const u32;
/// Longer than both sectors take to erase, by their worst: 32 kHz / 256 = 125 per s, 10 s.
const PATIENT: [u32; 2] = [6, 1250];
const USUAL: [u32; 2] = [3, WATCHDOG_MS];
/// Its registers take some periods of its own clock, 0.2 ms in all.
const WATCHDOG_LOOKS_MAX: u32 = 200_000;

/// The watchdog waits while flash is erased, or as usual again.
pub fn patient_watchdog(patient: bool) {
    let [prescaler, reload] = if patient { PATIENT } else { USUAL };
    for (register, value) in [(WATCHDOG_PRESCALER, prescaler), (WATCHDOG_RELOAD, reload)] {
        for _ in 0..WATCHDOG_LOOKS_MAX {
            // SAFETY: reading has no effect.
            if unsafe { WATCHDOG_STATE.read_volatile() } & 3 == 0 {
                break;
            }
        }
        // SAFETY: registers that are used for this alone; a write too early is ignored.
        unsafe {
            WATCHDOG_KEY.write_volatile(0x5555);
            register.write_volatile(value);
        }
    }
    // Loads the new value once the registers have it.
    for _ in 0..WATCHDOG_LOOKS_MAX {
        // SAFETY: reading has no effect.
        if unsafe { WATCHDOG_STATE.read_volatile() } & 3 == 0 {
            break;
        }
    }
    feed_watchdog();
}

pub fn feed_watchdog() {
    // SAFETY: a single write to a register that is used for this alone.
    unsafe { WATCHDOG_KEY.write_volatile(0xaaaa) }
}

/// Feeds it before the servo does: while interrupts are masked.
pub fn feed_if_early() {
    if cortex_m::register::primask::read().is_inactive() {
        feed_watchdog();
    }
}

/// Which kind of chip this is; 0 where the register is not there.
pub fn device_id() -> u32 {
    // SAFETY: reading has no effect.
    unsafe { DEVICE_ID.read_volatile() & 0xfff }
}

#[cfg(not(feature = "emulated"))]
fn chip_unique() -> [u32; 3] {
    // SAFETY: reading has no effect.
    unsafe {
        let place = (&raw const CHIP_UNIQUE_AT).read_volatile();
        (place as *const [u32; 3]).read_volatile()
    }
}

/// The emulator has nothing there.
#[cfg(feature = "emulated")]
fn chip_unique() -> [u32; 3] {
    [1, 2, 3]
}

/// The USB device's serial number: this chip's, so that two boards keep their port names.
pub fn usb_serial_number() -> [u8; 24] {
    serial_number(chip_unique())
}

/// The fault of the heaters that the run before has left latched, if a reset ended it.
pub fn kept_fault() -> KeptFault {
    // SAFETY: memory that is there and used from the main loop alone; all values are possible.
    KeptFault::from_memory(unsafe {
        (&raw const KEPT)
            .cast::<[u32; KEPT_WORDS]>()
            .read_volatile()
    })
}

/// Keeps a fault for the program after a reset.
pub fn keep_fault(kept: KeptFault) {
    // SAFETY: as above.
    unsafe {
        (&raw mut KEPT)
            .cast::<[u32; KEPT_WORDS]>()
            .write_volatile(kept.words());
    }
}

/// Keeps a crash for the program after the reset.
pub fn keep_crash(crash: &Crash) {
    let kept = kept_crash(crash);
    // SAFETY: memory that is there; nothing interrupts any more.
    unsafe { (&raw mut CRASH).cast::<KeptCrash>().write_volatile(kept) }
}

/// How the run before crashed, if it did; once.
pub fn take_crash() -> Option<Crash> {
    let place = (&raw mut CRASH).cast::<KeptCrash>();
    // SAFETY: memory that is there and used from the main loop alone; all values are possible.
    let kept = unsafe { place.read_volatile() };
    // SAFETY: as before.
    unsafe { place.write_volatile([0; 28]) };
    crash_of(&kept)
}

/// The number of this start; once, from the main loop.
pub fn session() -> u32 {
    let counter = (&raw mut COUNTER).cast::<[u32; 2]>();
    // SAFETY: memory that is there and used here alone; all values are possible.
    unsafe {
        let [starts, check] = counter.read_volatile();
        let counted = StartCounter::from_memory(starts, check).next();
        counter.write_volatile([counted.starts(), !counted.starts()]);
        let noise = (&raw const NOISE).cast::<u32>().read_volatile();
        session_of(counted.starts(), chip_unique(), noise)
    }
}
