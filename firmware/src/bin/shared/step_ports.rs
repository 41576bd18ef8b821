//! The drivers' ports of an STM32F4, written as fast as possible: a step is due every 5 us. In the bench they are
//! memory.

use crate::BOARD;
use headway_firmware::board::table::{DIRECTION, STEP};
use headway_firmware::configuration::MOTORS_MAX;
use headway_firmware::steps::output::{Pin, Ports};

/// From a port to the next.
pub const PORT_BYTES: usize = 0x400;
/// Sets (low half) and resets (high half) pins of a port at once.
pub const SET_RESET: usize = 0x18;
/// Offset of the base from port A's registers: from here the ports C to G are all
/// within an instruction's reach, 255 bytes down and 4095 up.
const BASE: usize = 2 * PORT_BYTES + SET_RESET + 4;

/// The ports. Their address is stored in memory: one load, where constants take two instructions
/// each.
pub struct DriverPorts {
    base: *mut u32,
}

impl DriverPorts {
    /// `ports`: address of port A.
    pub fn new(ports: usize) -> Self {
        Self {
            base: (ports + BASE) as *mut u32,
        }
    }
}

impl Ports for DriverPorts {
    const STEP: [Pin; MOTORS_MAX] = BOARD.column(STEP);
    const DIRECTION: [Pin; MOTORS_MAX] = BOARD.column(DIRECTION);

    #[inline(always)]
    fn write(&mut self, port: usize, word: u32) {
        let bytes = (port * PORT_BYTES + SET_RESET) as isize - BASE as isize;
        // SAFETY: the register of one of the chip's ports; it acts on the named pins alone, whatever
        // context writes it.
        unsafe { self.base.wrapping_byte_offset(bytes).write_volatile(word) }
    }
}
