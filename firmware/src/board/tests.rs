//! Goal: port-wide writes drive every pin as writes one by one would, and a start trusts no state that it finds.
//! Method: recorded levels, known crystals.

use super::table::{DIRECTION, STEP};
use super::*;
use crate::configuration::MOTORS_MAX;
use crate::steps::output::{Pin, PortOutput, Ports, StepOutput};
use core::convert::Infallible;
use headway_protocol::message::{Fault, FaultCause};
use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;
use std::vec::Vec;

/// Levels of 16 pins of 8 ports, shared by the recorders.
type Levels = Rc<RefCell<[u16; 8]>>;

struct RecordedPorts(Levels);

impl Ports for RecordedPorts {
    const STEP: [Pin; MOTORS_MAX] = crate::board::octopus::BOARD.column(STEP);
    const DIRECTION: [Pin; MOTORS_MAX] = crate::board::octopus::BOARD.column(DIRECTION);

    fn write(&mut self, port: usize, word: u32) {
        let mut levels = self.0.borrow_mut();
        levels[port] = levels[port] & !(word >> 16) as u16 | word as u16;
    }
}

/// The same, pin by pin.
struct RecordedPins {
    levels: Levels,
    inverted: u8,
}

impl RecordedPins {
    fn put(&mut self, (port, number): Pin, high: bool) {
        let mut levels = self.levels.borrow_mut();
        levels[port] = levels[port] & !(1 << number) | u16::from(high) << number;
    }
}

impl StepOutput for RecordedPins {
    fn end_pulses(&mut self) {
        for pin in RecordedPorts::STEP {
            self.put(pin, false);
        }
    }

    fn set_directions(&mut self, directions: u8) {
        for (motor, pin) in RecordedPorts::DIRECTION.into_iter().enumerate() {
            self.put(pin, (directions ^ self.inverted) >> motor & 1 == 1);
        }
    }

    fn step(&mut self, _tick: u64, motors: u8) {
        for (motor, pin) in RecordedPorts::STEP.into_iter().enumerate() {
            if motors >> motor & 1 == 1 {
                self.put(pin, true);
            }
        }
    }
}

#[test]
fn pins_one_by_one_have_the_levels_of_the_port_wide_writes() {
    let (by_port, by_pin) = (Levels::default(), Levels::default());
    let inverted = 0b0110_0101;
    let mut ports = PortOutput::new(RecordedPorts(by_port.clone()), MOTORS_MAX, inverted);
    let mut pins = RecordedPins {
        levels: by_pin.clone(),
        inverted,
    };
    pins.end_pulses();
    pins.set_directions(0);
    ports.end_pulses();
    ports.set_directions(0);
    let mut random = 1u32;
    let mut seen = [0u16; 8];
    for tick in 0..20_000 {
        random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        ports.end_pulses();
        pins.end_pulses();
        let signs = core::array::from_fn(|motor| random.rotate_left(3 * motor as u32));
        ports.begin_pulses_by_sign(tick, &signs);
        pins.begin_pulses_by_sign(tick, &signs);
        if random >> 20 & 3 == 0 {
            ports.set_directions((random >> 8) as u8);
            pins.set_directions((random >> 8) as u8);
        }
        assert_eq!(by_port, by_pin, "tick {tick}");
        for (all, now) in seen.iter_mut().zip(by_pin.borrow().iter()) {
            *all |= now;
        }
    }
    let pins_seen: u32 = seen.iter().map(|port| port.count_ones()).sum();
    assert_eq!(pins_seen, 2 * MOTORS_MAX as u32, "every pin was high once");
}

/// A line with what has arrived, and room for so many bytes at once.
struct Recorded {
    arrived: VecDeque<u8>,
    sent: Vec<u8>,
    room: usize,
}

impl embedded_io::ErrorType for Recorded {
    type Error = Infallible;
}

impl embedded_io::Read for Recorded {
    fn read(&mut self, bytes: &mut [u8]) -> Result<usize, Infallible> {
        assert!(!self.arrived.is_empty(), "it would wait");
        let length = bytes.len().min(self.arrived.len());
        for (byte, arrived) in bytes.iter_mut().zip(self.arrived.drain(..length)) {
            *byte = arrived;
        }
        Ok(length)
    }
}

impl embedded_io::ReadReady for Recorded {
    fn read_ready(&mut self) -> Result<bool, Infallible> {
        Ok(!self.arrived.is_empty())
    }
}

impl embedded_io::Write for Recorded {
    fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        assert!(self.room > 0, "it would wait");
        let length = bytes.len().min(self.room);
        self.sent.extend(&bytes[..length]);
        self.room -= length;
        Ok(length)
    }

    fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

impl embedded_io::WriteReady for Recorded {
    fn write_ready(&mut self) -> Result<bool, Infallible> {
        Ok(self.room > 0)
    }
}

#[test]
fn a_line_is_never_waited_for() {
    let mut line = Recorded {
        arrived: (0..100).collect(),
        sent: Vec::new(),
        room: 3,
    };
    let (mut taken, mut incoming) = (Vec::new(), Incoming::new());
    let mut turn = |line: &mut Recorded, pending: &[u8], most: usize| {
        fetch(line, &mut incoming);
        taken.extend((&mut incoming).take(most));
        send(line, pending)
    };
    assert_eq!(turn(&mut line, b"report", 0), 3);
    // What is not taken waits, and so does the rest of the line.
    assert_eq!(turn(&mut line, b"ort", 50), 0);
    assert_eq!(line.arrived.len(), 36);
    (0..3).for_each(|_| assert_eq!(turn(&mut line, &[], 64), 0));
    assert_eq!(taken, (0..100).collect::<Vec<u8>>());
    assert_eq!(line.sent, b"rep");
    let mut nothing = Incoming::new();
    fetch(&mut NoLine, &mut nothing);
    assert_eq!(nothing.next(), None);
    assert_eq!(send(&mut NoLine, b"report"), 0);
}

#[test]
fn a_full_ring_loses_what_comes_and_keeps_what_it_has() {
    let ring = ByteRing::<8>::new();
    let popped = || core::iter::from_fn(|| ring.pop()).collect::<Vec<u8>>();
    for round in 0..5u8 {
        assert!(ring.is_empty());
        for byte in 0..11 {
            ring.push(round * 16 + byte);
        }
        let expected: Vec<u8> = (0..8).map(|byte| round * 16 + byte).collect();
        assert_eq!(popped(), expected);
    }
}

#[test]
fn every_start_has_a_session_of_its_own() {
    // Memory after switching on is anything, then it is kept.
    let after_power = StartCounter::from_memory(0x1234_5678, 0x9abc_def0);
    let mut counter = after_power.next();
    assert_eq!(counter.starts(), 1);
    let chip = [0x0041_002a, 0x5133_3430, 0x2037_3634];
    let mut sessions = Vec::new();
    for start in 0..1000u32 {
        // The same noise each time, as from a boot loader that writes all memory but the counter.
        sessions.push(session_of(counter.starts(), chip, 7));
        // Another chip, and the counter lost with other noise.
        sessions.push(session_of(counter.starts(), [1, 2, 3], 7));
        sessions.push(session_of(1, chip, mix_noise(start, 99)));
        counter = counter.next();
    }
    assert_eq!(counter.starts(), 1001);
    sessions.sort_unstable();
    sessions.dedup();
    assert!(sessions.len() > 2990, "{} of 3000", sessions.len());
}

#[test]
fn another_chip_and_another_crystal_are_told_by_what_they_are() {
    assert_eq!(chip_fault(0x421, 0x421), None);
    assert_eq!(chip_fault(0, 0x421), None);
    let fault = chip_fault(0x419, 0x421).unwrap();
    assert_eq!(
        (fault.cause, fault.index, fault.value),
        (FaultCause::Board, 0, 0x419)
    );
    // 64 edges of a sixteenth of the crystal, in clocks of 16 MHz, which may be 8 % off.
    let clocks = |mhz: f64, off: f64| (16.0 * off * 1024.0 / mhz) as u32;
    for (mhz, is_ours) in [
        (12.0, true),
        (8.0, false),
        (16.0, false),
        (25.0, false),
        (26.0, false),
    ] {
        for off in [0.92, 1.0, 1.045] {
            let measured = crystal_hz(clocks(mhz, off));
            let fault = crystal_fault(measured, 12_000_000);
            assert_eq!(fault.is_none(), is_ours, "{mhz} MHz: {fault:?}");
        }
    }
    assert_eq!(crystal_fault(crystal_hz(0), 12_000_000), None);
    assert_eq!(
        &serial_number([0x0041_002a, 0x5133_3430, 0x2037_3634]),
        b"0041002A5133343020373634"
    );
}

#[test]
fn a_heaters_fault_outlives_a_reset_and_nothing_else_does() {
    let stuck = Fault {
        cause: FaultCause::HeaterStuck,
        index: 2,
        value: i32::MIN,
    };
    let kept = KeptFault::of(Some(stuck)).words();
    assert_eq!(KeptFault::from_memory(kept).fault(), Some(stuck));
    // A bit that was lost in any of the words: nothing is believed.
    for word in 0..KEPT_WORDS {
        for bit in 0..32 {
            let mut damaged = kept;
            damaged[word] ^= 1 << bit;
            assert_eq!(
                KeptFault::from_memory(damaged).fault(),
                None,
                "{word} {bit}"
            );
        }
    }
    for memory in [
        [0; KEPT_WORDS],
        [u32::MAX; KEPT_WORDS],
        [0x5a5a_5a5a; KEPT_WORDS],
    ] {
        assert_eq!(KeptFault::from_memory(memory).fault(), None);
    }
    // What a host clears, and what says nothing of a heater, leaves nothing behind.
    let emergency = Fault {
        cause: FaultCause::Emergency,
        ..stuck
    };
    for fault in [None, Some(emergency)] {
        assert_eq!(
            KeptFault::from_memory(KeptFault::of(fault).words()).fault(),
            None
        );
    }
}

/// A supply that was cut stays cut through a watchdog's and a program's reset, and where a boot loader has cleared the
/// flags; not after power-on, a brown-out or the reset pin. Flags as RM0390 has them after each.
#[test]
fn only_power_and_the_reset_pin_give_a_stuck_heater_its_supply_back() {
    let fault = |cause| Fault {
        cause,
        index: 1,
        value: 30_000,
    };
    let (pin, power, brown_out) = (1 << 26, 1 << 27, 1 << 25);
    let by_hand = [pin, pin | power | brown_out, pin | brown_out];
    let by_program = [28, 29, 30, 31].map(|bit| pin | 1 << bit);
    for cause in [FaultCause::HeaterStuck, FaultCause::OverTemperature] {
        let kept = KeptFault::of(Some(fault(cause)));
        assert!(kept.cuts_supply());
        for flags in by_hand {
            assert_eq!(kept.after_reset(flags).fault(), None, "{flags:x}");
        }
        for flags in by_program.into_iter().chain([0]) {
            assert!(kept.after_reset(flags).cuts_supply(), "{flags:x}");
        }
    }
    // Others cut nothing, and are latched again until a host clears them.
    let drift = KeptFault::of(Some(fault(FaultCause::TemperatureDrift)));
    for flags in by_hand.into_iter().chain(by_program) {
        assert_eq!(drift.after_reset(flags), drift);
    }
    assert!(!drift.cuts_supply());
}
