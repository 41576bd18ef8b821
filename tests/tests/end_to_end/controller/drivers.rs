//! Goal: drivers are set up and asked over their one wire bit by bit as their data sheet wants it, through
//! noise, and what is wrong with them is told.
//! Method: a wire of levels over a clock that the firmware's own waits move on, with jitter as of interrupts; a
//! decoder of its own measures the rate off the first byte and samples the bits, a model of the registers
//! (`virtual_drivers`, written from the data sheet) answers by edges at that rate.

use headway::drive::virtual_drivers::VirtualDriver;
use headway_firmware::board::built_in::built_in_planar;
use headway_firmware::configuration::drivers::{
    Chopper, CurrentScale, DriverConfiguration, DriverKind, DriversConfiguration, run_range_ma,
};
use headway_firmware::configuration::homing::HomingConfiguration;
use headway_firmware::drivers::one_wire::{BitClock, OneWire, Wires};
use headway_firmware::drivers::{DriverLink, DriverPort, DriverService, LinkError};
use headway_firmware::machine::Machine;
use headway_protocol::message::{Control, DriverFlags, FaultCause};
use std::cell::RefCell;
use std::rc::Rc;

/// 10 kbit/s at 168 MHz.
const BIT_CLOCKS: u32 = 16_800;

/// A wire with a chip at its other end.
struct Line {
    now: u32,
    /// What the board drives; `None` lets the pull-up have it.
    driven: Option<bool>,
    /// Edges that the board has made: when, and to which level.
    edges: Vec<(u32, bool)>,
    /// Levels of the answer, with the time at which each begins.
    answer: Vec<(u32, bool)>,
    driver: Option<VirtualDriver>,
    random: u32,
    /// Most clocks that an interrupt takes; one in 64 looks meets one.
    jitter_clocks: u32,
    /// One in so many bits of an answer is turned round.
    noise: Option<u32>,
    /// Datagrams decoded, and both sides driving at once.
    datagrams: Vec<Vec<u8>>,
    collisions: u32,
}

impl Line {
    fn new(driver: Option<VirtualDriver>) -> Rc<RefCell<Self>> {
        Rc::new(RefCell::new(Self {
            now: u32::MAX - 500_000,
            driven: None,
            edges: Vec::new(),
            answer: Vec::new(),
            driver,
            random: 1,
            jitter_clocks: 0,
            noise: None,
            datagrams: Vec::new(),
            collisions: 0,
        }))
    }

    fn roll(&mut self) -> u32 {
        self.random = self
            .random
            .wrapping_mul(1_664_525)
            .wrapping_add(1_013_904_223);
        self.random >> 8
    }

    /// The board has let go: what it sent, by a UART that knows no rate beforehand.
    fn released(&mut self) {
        let edges = std::mem::take(&mut self.edges);
        let bytes = sampled(&edges);
        self.datagrams.push(bytes.clone());
        let reply = self.driver.as_mut().and_then(|driver| driver.take(&bytes));
        let Some(reply) = reply else { return };
        let bit = rate_of(&edges).expect("a byte of sync");
        let mut at = self.now.wrapping_add(8 * bit);
        for byte in reply {
            let levels = u32::from(byte) << 1 | 1 << 9;
            for place in 0..10 {
                let flips = self
                    .noise
                    .is_some_and(|one_in| self.roll().is_multiple_of(one_in));
                let level = (levels >> place & 1 == 1) != flips;
                self.answer.push((at, level));
                at = at.wrapping_add(bit);
            }
        }
    }
}

/// Clocks of a bit, off the sync byte 0x05: from its start's falling edge, bits 1 0 1 0 0 0 0 0 follow, so that
/// the third falling edge is 4 bits after the first.
fn rate_of(edges: &[(u32, bool)]) -> Option<u32> {
    let mut falls = edges.windows(2).filter(|pair| pair[0].1 && !pair[1].1);
    let first = falls.next()?[1].0;
    let third = falls.nth(1)?[1].0;
    Some(third.wrapping_sub(first) / 4)
}

/// Bytes of a wire that is high at first.
fn sampled(edges: &[(u32, bool)]) -> Vec<u8> {
    let Some(bit) = rate_of(edges) else {
        return Vec::new();
    };
    let begin = edges[0].0;
    let since = |clock: u32| clock.wrapping_sub(begin);
    let level_at = |clock: u32| {
        let before = edges.iter().take_while(|edge| since(edge.0) <= clock);
        before.last().is_none_or(|edge| edge.1)
    };
    let mut bytes = Vec::new();
    let mut from = 0;
    loop {
        let start = edges
            .windows(2)
            .map(|pair| (pair[0].1, pair[1]))
            .find(|(was, (at, is))| *was && !is && since(*at) >= from);
        let Some((_, (start, _))) = start else {
            return bytes;
        };
        let middle = |place: u32| since(start) + place * bit + bit / 2;
        assert!(!level_at(middle(0)), "a start bit");
        assert!(level_at(middle(9)), "a stop bit");
        let byte = (0..8).fold(0, |byte, place| {
            byte | u8::from(level_at(middle(place + 1))) << place
        });
        bytes.push(byte);
        from = middle(9);
    }
}

#[derive(Clone)]
struct Bench(Rc<RefCell<Line>>);

impl BitClock for Bench {
    fn now_clocks(&mut self) -> u32 {
        let mut line = self.0.borrow_mut();
        // What a look takes, and now and then an interrupt.
        let interrupt = if line.jitter_clocks > 0 && line.roll().is_multiple_of(64) {
            line.roll() % line.jitter_clocks
        } else {
            0
        };
        line.now = line.now.wrapping_add(37 + interrupt);
        line.now
    }
}

impl Wires for Bench {
    fn drive(&mut self, _motor: usize, high: bool) {
        let mut line = self.0.borrow_mut();
        let now = line.now;
        let answers = line
            .answer
            .last()
            .map(|last| last.0.wrapping_add(BIT_CLOCKS));
        if answers.is_some_and(|end| (now.wrapping_sub(end) as i32) < 0) {
            line.collisions += 1;
        }
        line.answer.clear();
        if line.driven != Some(high) {
            line.driven = Some(high);
            line.edges.push((now, high));
        }
    }

    fn release(&mut self, _motor: usize) {
        let mut line = self.0.borrow_mut();
        line.driven = None;
        line.released();
    }

    fn is_high(&mut self, _motor: usize) -> bool {
        let line = self.0.borrow();
        let now = line.now;
        let passed = line
            .answer
            .iter()
            .take_while(|(at, _)| now.wrapping_sub(*at) as i32 >= 0);
        line.driven
            .unwrap_or_else(|| passed.last().is_none_or(|(_, level)| *level))
    }
}

fn wire(line: &Rc<RefCell<Line>>) -> OneWire<Bench, Bench> {
    OneWire::new(Bench(line.clone()), Bench(line.clone()), BIT_CLOCKS)
}

/// 800 mA at 0.11 ohm for the built-in machine's X.
fn driver() -> DriverConfiguration {
    DriverConfiguration {
        address: 2,
        sense_mohm: 110,
        run_ma: 800,
        hold_ma: 400,
        microsteps: 16,
        interpolates: true,
        full_steps_per_unit: 5.0,
        chopper: Chopper::Spread,
        spread_below_clocks: 77,
        kind: DriverKind::Tmc2209,
    }
}

/// Registers that the data sheet asks for with these settings, worked out by hand.
fn assert_set_up(chip: &VirtualDriver) {
    // pdn_disable, mstep_reg_select, multistep_filt, en_SpreadCycle.
    assert_eq!(chip.register(0x00), 0x1c4);
    // intpol, 16 microsteps (4), vsense, tbl 2, hstrt 5, toff 3.
    assert_eq!(chip.register(0x6c), 0x1403_0053);
    // 0.8 A: 32 * 0.8 * sqrt 2 * 0.13 / 0.18 = 26.1, so CS 25; 13.07 for 0.4 A, so 12; delay 8.
    assert_eq!(chip.register(0x10), 8 << 16 | 25 << 8 | 12);
    assert_eq!(chip.register(0x13), 77);
    assert_eq!(chip.register(0x01), 0, "a restart would show");
}

#[test]
fn a_driver_is_set_up_bit_by_bit_whatever_interrupts_do() {
    // 15 us of 100 us: more than the servo takes at rest.
    for jitter_clocks in [0, 2_520] {
        let line = Line::new(Some(VirtualDriver::new(2)));
        line.borrow_mut().jitter_clocks = jitter_clocks;
        let mut port = wire(&line);
        let mut link = DriverLink::new(&mut port, 0, 2);
        assert_eq!(link.set_up(&driver()), Ok(()));
        assert_eq!(link.retries, 0, "jitter {jitter_clocks}");
        let line = line.borrow();
        assert_set_up(line.driver.as_ref().expect("it is there"));
        assert_eq!(line.collisions, 0);
        // Node 2's version was asked for first; its checksum by long division on paper's rule.
        assert_eq!(line.datagrams[0][..3], [0x05, 0x02, 0x06]);
        assert!(line.datagrams.len() > 20);
    }
}

/// Drivers with a wire each, as the Octopus has them: all at node address 0.
#[derive(Clone)]
struct Each(Vec<Bench>);

impl Wires for Each {
    fn drive(&mut self, motor: usize, high: bool) {
        self.0[motor].drive(motor, high);
    }
    fn release(&mut self, motor: usize) {
        self.0[motor].release(motor);
    }
    fn is_high(&mut self, motor: usize) -> bool {
        self.0[motor].is_high(motor)
    }
}

impl BitClock for Each {
    fn now_clocks(&mut self) -> u32 {
        let now = self.0[0].now_clocks();
        for other in &self.0[1..] {
            other.0.borrow_mut().now = now;
        }
        now
    }
}

#[test]
fn each_motor_has_a_wire_and_a_current_of_its_own() {
    let lines: Vec<_> = (0..8)
        .map(|_| Line::new(Some(VirtualDriver::new(0))))
        .collect();
    let each = Each(lines.iter().cloned().map(Bench).collect());
    let mut port = OneWire::new(each.clone(), each, BIT_CLOCKS);
    // In another order than that of the motors.
    for motor in [3, 0, 7, 1, 6, 2, 5, 4] {
        let with = DriverConfiguration {
            address: 0,
            run_ma: 300 + 50 * motor as u16,
            hold_ma: 150,
            ..driver()
        };
        let mut link = DriverLink::new(&mut port, motor, 0);
        assert_eq!(link.set_up(&with), Ok(()));
    }
    for (motor, line) in lines.iter().enumerate() {
        let line = line.borrow();
        let chip = line.driver.as_ref().expect("it is there");
        // Step of the fine range at 0.11 ohm: 30.6 mA.
        let scale = ((300.0 + 50.0 * motor as f64) / 30.6).floor() as u32 - 1;
        assert_eq!(chip.register(0x10) >> 8 & 31, scale, "motor {motor}");
        assert_eq!(line.collisions, 0);
    }
}

#[test]
fn noise_is_tried_again_and_counted_and_never_taken_for_a_value() {
    let (mut retried, mut failed) = (0, 0);
    for seed in 0..200 {
        let line = Line::new(Some(VirtualDriver::new(2)));
        line.borrow_mut().random = seed;
        // One bit in 800: every tenth answer is damaged.
        line.borrow_mut().noise = Some(800);
        let mut port = wire(&line);
        let mut link = DriverLink::new(&mut port, 0, 2);
        match link.set_up(&driver()) {
            Ok(()) => assert_set_up(line.borrow().driver.as_ref().expect("it is there")),
            Err(LinkError::Noise | LinkError::Silent) => failed += 1,
            Err(other) => panic!("seed {seed}: {other:?}"),
        }
        retried += u32::from(link.retries);
    }
    assert!(retried > 100, "{retried} retries");
    assert!(failed <= 2, "{failed} of 200 were not set up");
}

#[test]
fn a_missing_driver_another_node_and_another_chip_are_told_in_bounded_time() {
    let mut old = VirtualDriver::new(2);
    old.registers.insert(0x06, 0x2000_0000);
    for (chip, error) in [
        (None, LinkError::Silent),
        (Some(VirtualDriver::new(1)), LinkError::Silent),
        (Some(old), LinkError::Version(0x20)),
    ] {
        let line = Line::new(chip);
        let begun = line.borrow().now;
        let mut port = wire(&line);
        let mut link = DriverLink::new(&mut port, 0, 2);
        assert_eq!(link.set_up(&driver()), Err(error));
        let took_bits = line.borrow().now.wrapping_sub(begun) / BIT_CLOCKS;
        // Five tries of 12 bits of rest, 40 of the question, 32 of waiting.
        assert!(took_bits <= 5 * 90, "{error:?}: {took_bits} bits");
    }
    // A wire that is held low gives no byte either.
    struct Stuck;
    impl Wires for Stuck {
        fn drive(&mut self, _: usize, _: bool) {}
        fn release(&mut self, _: usize) {}
        fn is_high(&mut self, _: usize) -> bool {
            false
        }
    }
    let line = Line::new(None);
    let mut port = OneWire::new(Stuck, Bench(line), BIT_CLOCKS);
    assert_eq!(port.exchange(0, &[5, 0, 0, 0x48], &mut [0; 8]), 0);
}

#[test]
fn currents_are_those_of_the_data_sheet() {
    // Its table for 0.11 ohm, rms: full scale 1.77 A coarse, 0.98 A fine (chapter 9).
    let [least, most] = run_range_ma(DriverKind::Tmc2209, 110);
    assert!((1750..=1780).contains(&most));
    // 0.98 A / 32, rounded up.
    assert_eq!(least, 31);
    let mut ranges = [0, 0];
    for run_ma in 40..=1760u16 {
        let with = DriverConfiguration {
            run_ma,
            hold_ma: run_ma / 2,
            ..driver()
        };
        let CurrentScale { fine, run, hold } = with.current_scale().expect("it reaches");
        // By the formula in floating point: not above what was asked, and within a step of it.
        let volts = if fine { 0.18 } else { 0.325 };
        let step = volts / 0.13 / 2f64.sqrt() / 32.0 * 1e3;
        let given = step * f64::from(run + 1);
        let asked = f64::from(run_ma);
        assert!(
            given <= asked * 1.001 && given > asked - step,
            "{run_ma}: {given}"
        );
        assert!(
            hold <= run && fine == (run_ma < 980 || run_ma == 979),
            "{run_ma}"
        );
        ranges[usize::from(fine)] += 1;
    }
    assert!(ranges.iter().all(|count| *count > 500), "{ranges:?}");
}

#[test]
fn a_board_tells_what_is_wrong_with_a_driver_and_mends_what_has_restarted() {
    let machine = built_in_planar();
    let mut drivers = DriversConfiguration::none();
    drivers.drivers.push(Some(driver())).expect("room");
    let line = Line::new(None);
    let mut port = wire(&line);
    let mut service = DriverService::new(&drivers, machine.servo_hz);
    let mut board =
        Machine::with_switches(&machine, &HomingConfiguration::none(), 1).expect("runs");
    board.set_up_drivers(&mut service, &mut port);
    let fault = |board: &Machine| {
        board
            .motion()
            .fault()
            .map(|fault| (fault.cause, fault.index))
    };
    let flags = |board: &Machine| board.motion().drivers().status()[0].flags;
    let silent = Some((FaultCause::DriverSilent, 0));
    assert_eq!(fault(&board), silent);
    let pass = |board: &mut Machine, service: &mut DriverService, port: &mut _| {
        // More than a period.
        for _ in 0..600 {
            board.servo_tick();
            board.run_step_interval(&mut Nothing);
            board.serve_drivers(service, port);
        }
    };
    clear(&mut board);
    assert_eq!(
        fault(&board),
        silent,
        "it comes back while the cause is there"
    );
    // The motors' supply is switched on.
    line.borrow_mut().driver = Some(VirtualDriver::new(2));
    pass(&mut board, &mut service, &mut port);
    assert_set_up(line.borrow().driver.as_ref().expect("it is there"));
    assert_eq!(fault(&board), silent, "latched until somebody clears it");
    clear(&mut board);
    assert_eq!(fault(&board), None);
    assert_eq!(
        flags(&board) & 3,
        DriverFlags::SPOKEN_WITH | DriverFlags::SET_UP
    );
    assert_eq!(board.motion().drivers().status()[0].scale, 25);
    // Its supply has a gap.
    line.borrow_mut().driver.as_mut().expect("there").restart();
    pass(&mut board, &mut service, &mut port);
    assert_eq!(fault(&board), Some((FaultCause::DriverReset, 0)));
    pass(&mut board, &mut service, &mut port);
    assert_set_up(line.borrow().driver.as_ref().expect("it is there"));
    clear(&mut board);
    assert_eq!(fault(&board), None);
    // A coil without current is told, heat and shorts stop.
    let stands = 1 << 31;
    for (status, flag, cause) in [
        (1 << 6, DriverFlags::OPEN_LOAD, None),
        (1, DriverFlags::WARM, None),
        (0b11, DriverFlags::HOT, Some((FaultCause::DriverHot, 0))),
        (
            1 << 3,
            DriverFlags::SHORT,
            Some((FaultCause::DriverShort, 0)),
        ),
    ] {
        let set = |status| {
            let mut line = line.borrow_mut();
            let chip = line.driver.as_mut().expect("there");
            chip.registers.insert(0x6f, status);
        };
        set(stands | status);
        pass(&mut board, &mut service, &mut port);
        assert_eq!(fault(&board), cause, "{status:#x}");
        assert_ne!(flags(&board) & flag, 0, "{status:#x}");
        set(stands);
        pass(&mut board, &mut service, &mut port);
        clear(&mut board);
        assert_eq!(fault(&board), None);
        assert_eq!(flags(&board) & flag, 0);
    }
}

pub(super) struct Nothing;

impl headway_firmware::steps::output::StepOutput for Nothing {
    fn set_directions(&mut self, _: u8) {}
    fn step(&mut self, _: u64, _: u8) {}
}

/// As a host clears a fault.
pub(super) fn clear(board: &mut Machine) {
    order(board, Control::ClearFault);
}

/// A host's command.
pub(super) fn order(board: &mut Machine, control: Control) {
    use headway_protocol::frame::{FRAME_BYTES_MAX, encode_frame};
    use headway_protocol::message::{Hello, HostMessage, PROTOCOL_VERSION, SCHEMA_HASH};
    // Each time another host, so that the numbering begins anew.
    let host_session = board.motion().now_ticks() as u32 + 2;
    let hello = HostMessage::Hello(Hello {
        protocol_version: PROTOCOL_VERSION,
        schema_hash: SCHEMA_HASH,
        host_session,
    });
    for (sequence, message) in [hello, HostMessage::Control(control)].iter().enumerate() {
        let mut out = [0; FRAME_BYTES_MAX];
        let length = encode_frame(sequence as u16, message, &mut out).expect("a frame");
        board.handle_bytes(&out[..length]);
    }
}
