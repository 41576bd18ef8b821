//! A timer of the STM32F446, after RM0390 (chapter 18): pulses of the probe port's servo pin.
//! The timer generates them by itself; the main loop changes their length.

use super::pins;
use super::rcc::{Bus, clock_on};
use crate::BOARD;
use headway_firmware::configuration::board_name::Known;
use headway_firmware::motion::probe_pin::{PULSE_PERIOD_US, PulsePort};

/// Timer 2; the others follow, by clocks and by addresses.
const TIMER_2: usize = 0x4000_0000;
const TIMER_BYTES: usize = 0x400;
const CONTROL: usize = 0x00;
const EVENT: usize = 0x14;
/// Modes of channels 1 and 2, then of 3 and 4.
const CHANNEL_MODE: usize = 0x18;
const CHANNEL_ON: usize = 0x20;
const PRESCALER: usize = 0x28;
const RELOAD: usize = 0x2c;
/// Of channel 1; the others follow.
const COMPARE: usize = 0x34;
/// Twice APB1's 42 MHz, by this and one: a microsecond.
const BY_84: u32 = 84 - 1;
/// PWM mode 1 of the first channel of a register; a new length takes effect at the period's end.
const PWM: u32 = 0b110 << 4 | 1 << 3;
const UPDATE: u32 = 1;
/// Counting, the period buffered.
const ON: u32 = 1 << 7 | 1;

/// The servo pin, if the board has one.
pub struct ProbeServo;

fn register(timer: u8, offset: usize) -> *mut u32 {
    (TIMER_2 + (usize::from(timer) - 2) * TIMER_BYTES + offset) as *mut u32
}

fn compare(timer: u8, channel: u8) -> *mut u32 {
    register(timer, COMPARE + 4 * (usize::from(channel) - 1))
}

impl ProbeServo {
    /// Before interrupts are on: low until a length is set; not on a foreign board.
    pub fn set_up(known: Known) -> Self {
        let Some((pin, function, timer, channel)) = BOARD.servo else {
            return Self;
        };
        clock_on(Bus::Apb1, 1 << (timer - 2));
        let modes = CHANNEL_MODE + if channel <= 2 { 0 } else { 4 };
        // SAFETY: registers of this timer, which nothing else uses.
        unsafe {
            register(timer, PRESCALER).write_volatile(BY_84);
            register(timer, RELOAD).write_volatile(u32::from(PULSE_PERIOD_US) - 1);
            compare(timer, channel).write_volatile(0);
            register(timer, modes).write_volatile(PWM << (8 * ((channel - 1) % 2)));
            register(timer, CHANNEL_ON).write_volatile(1 << (4 * (channel - 1)));
            register(timer, EVENT).write_volatile(UPDATE);
            register(timer, CONTROL).write_volatile(ON);
        }
        if known != Known::Foreign {
            pins::alternate(pin, function);
        }
        Self
    }
}

impl PulsePort for ProbeServo {
    fn put(&mut self, pulse_us: u16) {
        if let Some((_, _, timer, channel)) = BOARD.servo {
            // SAFETY: as above; it is taken over at the end of a period.
            unsafe { compare(timer, channel).write_volatile(pulse_us.into()) }
        }
    }
}
