//! A model of the registers of an STM32F405 and STM32F446 that decide over their pins: clocks and resets (RCC), ports,
//! and what the set-up of a board waits for.
//!
//! In: reads and writes in their order. Out: what a read gives, where the emulator does not know it; the state of the
//! pins; every access to a peripheral whose clock is off, that is in reset, or that comes too soon after its clock was
//! switched on. After RM0090 and RM0390 (chapters 6 and 8 each), and ES0182 and ES0298, "Delay after an RCC peripheral
//! clock enabling". Left out: what a port does beyond mode, level and pull; peripherals that only have to be clocked.

use std::collections::BTreeMap;

const RCC: u32 = 0x4002_3800;
const PORT_A: u32 = 0x4002_0000;
const PORT_BYTES: u32 = 0x400;
const PORTS: u32 = 8;
/// Registers of RCC: control, configuration, resets of the ports, clocks of the buses.
const CR: u32 = RCC;
const CFGR: u32 = RCC + 0x08;
const PORTS_RESET: u32 = RCC + 0x10;
const CLOCKS: [u32; 4] = [RCC + 0x30, RCC + 0x34, RCC + 0x40, RCC + 0x44];
const TIMER_11: u32 = 0x4001_4800;
const USB: u32 = 0x5000_0000;
/// Words of a bit each, from here on, of the peripherals from 0x40000000 on.
const BIT_BAND: u32 = 0x4200_0000;
const BIT_BAND_END: u32 = 0x4400_0000;

/// A peripheral: name, first address, bytes, the register with its clock, and which bits are that.
type Peripheral = (&'static str, u32, u32, Option<(u32, u32)>);

/// All that a board's set-up may touch. The chip's own (RCC, flash, watchdog, external interrupts) have no clock to
/// switch on.
const PERIPHERALS: [Peripheral; 16] = [
    ("RCC", RCC, 0x400, None),
    ("flash controller", 0x4002_3c00, 0x400, None),
    ("watchdog", 0x4000_3000, 0x400, None),
    ("EXTI", 0x4001_3c00, 0x400, None),
    ("timer 4", 0x4000_0800, 0x400, Some((CLOCKS[2], 1 << 2))),
    ("USART 1", 0x4001_1000, 0x400, Some((CLOCKS[3], 1 << 4))),
    ("USART 2", 0x4000_4400, 0x400, Some((CLOCKS[2], 1 << 17))),
    ("USART 3", 0x4000_4800, 0x400, Some((CLOCKS[2], 1 << 18))),
    ("converter 1", 0x4001_2000, 0x100, Some((CLOCKS[3], 1 << 8))),
    ("converter 2", 0x4001_2100, 0x100, Some((CLOCKS[3], 1 << 9))),
    (
        "converter 3",
        0x4001_2200,
        0x100,
        Some((CLOCKS[3], 1 << 10)),
    ),
    ("SYSCFG", 0x4001_3800, 0x400, Some((CLOCKS[3], 1 << 14))),
    ("timer 11", TIMER_11, 0x400, Some((CLOCKS[3], 1 << 18))),
    // Common registers of the converters: the clock of any.
    ("converters", 0x4001_2300, 0x100, Some((CLOCKS[3], 7 << 8))),
    ("USB", USB, 0x4_0000, Some((CLOCKS[1], 1 << 7))),
    ("ports", PORT_A, PORTS * PORT_BYTES, None),
];
/// What QEMU's own model of a chip answers.
const ANSWERED_BY_QEMU: [&str; 9] = [
    "EXTI",
    "timer 4",
    "USART 1",
    "USART 2",
    "USART 3",
    "converter 1",
    "converter 3",
    "converters",
    "SYSCFG",
];

/// What a pin is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PinState {
    /// With its pull resistor: 0 none, 1 up, 2 down.
    Input(u32),
    /// With its level.
    Output(bool),
    /// With the function's number.
    Alternate(u32),
    /// A converter's.
    Analog,
}

/// The registers.
#[derive(Default)]
pub struct RegisterModel {
    words: BTreeMap<u32, u32>,
    /// Clocks that were switched on and not waited for: the register, and its bits.
    fresh: BTreeMap<u32, u32>,
    /// Captures of timer 11 so far.
    captures: u32,
    /// What must not be.
    pub wrong: Vec<String>,
    /// Peripherals that were accessed, with clock and all.
    pub used: std::collections::BTreeSet<&'static str>,
}

impl RegisterModel {
    fn get(&self, address: u32) -> u32 {
        let reset = || reset_value(address);
        self.words.get(&address).copied().unwrap_or_else(reset)
    }

    /// The clocks that were switched on are waited for: the register was read back, or a barrier stands behind the
    /// write.
    pub fn waited(&mut self, clocks: u32) {
        self.fresh.remove(&clocks);
    }

    /// The register that an address stands for, and the bit of it in the words of a bit.
    pub fn target(address: u32) -> (u32, Option<u32>) {
        if !(BIT_BAND..BIT_BAND_END).contains(&address) {
            return (address & !3, None);
        }
        let bit = (address - BIT_BAND) / 4;
        (0x4000_0000 + bit / 32 * 4, Some(bit % 32))
    }

    /// Checks an access to a peripheral.
    fn look(&mut self, address: u32, what: &str) {
        let found = PERIPHERALS
            .iter()
            .find(|(_, from, bytes, _)| (*from..from + bytes).contains(&address));
        let Some(&(name, _, _, clock)) = found else {
            self.wrong
                .push(format!("{what} of {address:#010x}, which nobody knows"));
            return;
        };
        let port = (address.wrapping_sub(PORT_A)) / PORT_BYTES;
        let is_port = name == "ports";
        let clock = if is_port {
            Some((CLOCKS[0], 1 << port))
        } else {
            clock
        };
        self.used.insert(name);
        let Some((register, bits)) = clock else {
            return;
        };
        let place = format!("{what} of {name} at {address:#010x}");
        let running = self.get(register) & bits;
        if running == 0 {
            self.wrong.push(format!("{place} without its clock"));
        } else if self.fresh.get(&register).copied().unwrap_or(0) & running == running {
            self.wrong.push(format!("{place} too soon after its clock"));
        }
        if is_port && self.get(PORTS_RESET) >> port & 1 == 1 {
            self.wrong.push(format!("{place} in reset"));
        }
    }

    /// A write of the core's.
    pub fn write(&mut self, address: u32, value: u32) {
        let (register, bit) = Self::target(address);
        let old = self.get(register);
        let value = match bit {
            Some(bit) => old & !(1 << bit) | (value & 1) << bit,
            None => value,
        };
        self.look(register, "write");
        if CLOCKS.contains(&register) {
            *self.fresh.entry(register).or_default() |= value & !old;
        }
        if register == PORTS_RESET {
            self.reset_ports(value);
        }
        match port_offset(register) {
            // Levels by set and reset.
            Some((port, 0x18)) => {
                let levels = port + 0x14;
                let (set, reset) = (value & 0xffff, value >> 16);
                self.words.insert(levels, self.get(levels) & !reset | set);
            }
            _ => {
                self.words.insert(register, value);
            }
        }
    }

    fn reset_ports(&mut self, ports: u32) {
        for port in (0..PORTS).filter(|port| ports >> port & 1 == 1) {
            let first = PORT_A + port * PORT_BYTES;
            self.words
                .retain(|address, _| !(first..first + PORT_BYTES).contains(address));
        }
    }

    /// A read of the core's: what it gives, `None` where the emulator knows.
    pub fn read(&mut self, address: u32) -> Option<u32> {
        let (register, bit) = Self::target(address);
        self.look(register, "read");
        self.waited(register);
        let qemus = PERIPHERALS.iter().any(|(name, from, bytes, _)| {
            ANSWERED_BY_QEMU.contains(name) && (*from..from + bytes).contains(&register)
        });
        if qemus {
            return None;
        }
        let value = self.value(register);
        Some(bit.map_or(value, |bit| value >> bit & 1))
    }

    fn value(&mut self, register: u32) -> u32 {
        let value = self.get(register);
        // Oscillators and the loop are ready as soon as they are on, the core follows its switch.
        match register {
            CR => value | (value & 1) << 1 | (value >> 16 & 1) << 17 | (value >> 24 & 1) << 25,
            CFGR => value & !0xc | (value & 3) << 2,
            _ if register == TIMER_11 + 0x10 => 1 << 1,
            // 16 MHz between eight edges of 12 MHz divided by 16.
            _ if register == TIMER_11 + 0x34 => {
                self.captures += 1;
                (self.captures * 16 * 8 * 16 / 12) & 0xffff
            }
            // The bus is idle and no reset is under way; the core of an STM32F446.
            _ if register == USB + 0x10 => 1 << 31,
            _ if register == USB + 0x3c => 0x2000,
            _ => match port_offset(register) {
                Some((port, 0x10)) => self.levels(port),
                _ => value,
            },
        }
    }

    /// Levels of a port's pins: outputs as they are driven, inputs low, as a closed switch to ground.
    fn levels(&self, port: u32) -> u32 {
        let (modes, driven) = (self.get(port), self.get(port + 0x14));
        let is_output = |pin: &u32| modes >> (2 * pin) & 3 == 1;
        (0..16)
            .filter(is_output)
            .fold(0, |levels, pin| levels | driven & 1 << pin)
    }

    /// A pin as it is now.
    pub fn pin(&self, (port, pin): (usize, u32)) -> PinState {
        let port = PORT_A + port as u32 * PORT_BYTES;
        let field = |offset| self.get(port + offset) >> (2 * pin) & 3;
        match field(0) {
            0 => PinState::Input(field(0x0c)),
            1 => PinState::Output(self.get(port + 0x14) >> pin & 1 == 1),
            2 => {
                let functions = self.get(port + 0x20 + if pin < 8 { 0 } else { 4 });
                PinState::Alternate(functions >> (4 * (pin % 8)) & 0xf)
            }
            _ => PinState::Analog,
        }
    }
}

/// First address of the port of a register, and the register's offset.
fn port_offset(register: u32) -> Option<(u32, u32)> {
    let offset = register.checked_sub(PORT_A)?;
    let port = offset / PORT_BYTES;
    (port < PORTS).then_some((PORT_A + port * PORT_BYTES, offset % PORT_BYTES))
}

/// What a register has after a reset of the chip: pins of the debugger, and the internal oscillator.
fn reset_value(register: u32) -> u32 {
    match register {
        CR => 0x83,
        PORT_A => 0xa800_0000,
        _ if register == PORT_A + 0x0c => 0x6400_0000,
        _ if register == PORT_A + PORT_BYTES => 0x280,
        _ if register == PORT_A + PORT_BYTES + 0x0c => 0x100,
        _ => 0,
    }
}
