//! Timer 4 of the STM32F446, after RM0390 (chapter 18): pulses of the probe port's servo pin, PB6, its channel 1.
//! The timer generates them by itself; the main loop changes their length.

use crate::pins;
use crate::stm32f4::rcc::{Bus, clock_on};
use headway_firmware::board::octopus::PROBE_SERVO;
use headway_firmware::configuration::board_name::Known;
use headway_firmware::motion::probe_pin::{PULSE_PERIOD_US, PulsePort};

/// Timer 4.
const CLOCK: u32 = 1 << 2;
const TIMER: usize = 0x4000_0800;
const CONTROL: *mut u32 = TIMER as *mut u32;
const EVENT: *mut u32 = (TIMER + 0x14) as *mut u32;
const CHANNEL_MODE: *mut u32 = (TIMER + 0x18) as *mut u32;
const CHANNEL_ON: *mut u32 = (TIMER + 0x20) as *mut u32;
const PRESCALER: *mut u32 = (TIMER + 0x28) as *mut u32;
const RELOAD: *mut u32 = (TIMER + 0x2c) as *mut u32;
const COMPARE: *mut u32 = (TIMER + 0x34) as *mut u32;
/// Twice APB1's 42 MHz, by this and one: a microsecond.
const BY_84: u32 = 84 - 1;
/// PWM mode 1 of channel 1; a new length takes effect at the period's end.
const PWM: u32 = 0b110 << 4 | 1 << 3;
const UPDATE: u32 = 1;
/// Counting, the period buffered.
const ON: u32 = 1 << 7 | 1;

/// The servo pin.
pub struct OctopusServo;

impl OctopusServo {
    /// Before interrupts are on: low until a length is set; not on a foreign board.
    pub fn set_up(known: Known) -> Self {
        clock_on(Bus::Apb1, CLOCK);
        // SAFETY: registers of this timer, which nothing else uses.
        unsafe {
            PRESCALER.write_volatile(BY_84);
            RELOAD.write_volatile(u32::from(PULSE_PERIOD_US) - 1);
            COMPARE.write_volatile(0);
            CHANNEL_MODE.write_volatile(PWM);
            CHANNEL_ON.write_volatile(1);
            EVENT.write_volatile(UPDATE);
            CONTROL.write_volatile(ON);
        }
        if known != Known::Foreign {
            let (pin, function) = PROBE_SERVO;
            pins::alternate(pin, function);
        }
        Self
    }
}

impl PulsePort for OctopusServo {
    fn put(&mut self, pulse_us: u16) {
        // SAFETY: as above; it is taken over at the end of a period.
        unsafe { COMPARE.write_volatile(pulse_us.into()) }
    }
}
