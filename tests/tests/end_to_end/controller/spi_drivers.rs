//! Goal: drivers with SPI are set up and asked bit by bit as their data sheets want it, also while the machine moves, and
//! what is wrong with one is told in the right words.
//! Method: a bus of levels that the firmware's own bits drive; it holds them to mode 3, hands whole datagrams to models of
//! the registers (`virtual_spi_driver`, written from the data sheets), and spoils lines; chips are spoilt by their registers.

use super::drivers::{Nothing, clear, order};
use headway::drive::virtual_spi_driver::VirtualSpiDriver;
use headway_firmware::board::built_in::built_in_planar;
use headway_firmware::configuration::drivers::{
    Chopper, DriverConfiguration, DriverKind, DriversConfiguration, run_range_ma,
};
use headway_firmware::configuration::homing::HomingConfiguration;
use headway_firmware::drivers::soft_spi::{BusWires, transfer};
use headway_firmware::drivers::{DATAGRAM_BYTES, DriverPort, DriverService, LinkError, SpiLink};
use headway_firmware::machine::Machine;
use headway_protocol::message::{Control, DriverFlags, DriverStatus};

const GCONF: u8 = 0x00;
const GSTAT: u8 = 0x01;
const IOIN: u8 = 0x04;
const DRV_CONF: u8 = 0x0a;
const GLOBALSCALER: u8 = 0x0b;
const IHOLD_IRUN: u8 = 0x10;
const ADC_TEMP: u8 = 0x51;
const CHOPCONF: u8 = 0x6c;
const DRV_STATUS: u8 = 0x6f;
const BITS: u32 = 40;

/// What a line does.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum Line {
    #[default]
    Right,
    /// The line from the drivers has this level for ever.
    Dead(bool),
    /// This bit of every answer, from the lowest, has this level.
    Stuck(u32, bool),
    /// One in so many bits from the drivers is turned round.
    Noisy(u32),
    /// The line to the drivers is low for ever.
    Deaf,
}

/// Four wires with chips.
#[derive(Default)]
struct Bus {
    chips: Vec<Option<VirtualSpiDriver>>,
    line: Line,
    /// A register that ignores writes.
    lost: Option<u8>,
    selected: Option<usize>,
    /// Levels of clock and data, and whether there was time since the last edge.
    clock_low: bool,
    data: bool,
    waited: bool,
    falls: u32,
    request: u64,
    answer: u64,
    datagrams: usize,
    random: u32,
}

impl Bus {
    fn new(kind: DriverKind) -> Self {
        Self {
            chips: vec![Some(VirtualSpiDriver::new(kind))],
            ..Self::default()
        }
    }

    fn chip(&mut self) -> &mut VirtualSpiDriver {
        self.chips[0].as_mut().expect("it is there")
    }

    fn roll(&mut self) -> u32 {
        self.random = self
            .random
            .wrapping_mul(1_664_525)
            .wrapping_add(1_013_904_223);
        self.random >> 8
    }

    /// Bits 0 to 39 as bytes, and back.
    fn bytes(bits: u64) -> [u8; 5] {
        let [_, _, _, bytes @ ..] = bits.to_be_bytes();
        bytes
    }

    fn bits(bytes: [u8; 5]) -> u64 {
        bytes
            .into_iter()
            .fold(0, |all, byte| all << 8 | u64::from(byte))
    }
}

impl BusWires for Bus {
    fn select(&mut self, motor: usize, selected: bool) -> bool {
        assert!(!self.clock_low, "the clock idles high");
        if selected {
            assert_eq!(self.selected, None, "one at a time");
            self.selected = Some(motor);
            (self.falls, self.request) = (0, 0);
            // What comes does not depend on what is being sent.
            let chip = self.chips[motor].clone();
            let answer = chip.map_or([0xff; 5], |mut chip| chip.transfer(&[0; 5]));
            self.answer = Self::bits(answer);
        } else {
            assert_eq!(self.selected.take(), Some(motor));
            assert_eq!(self.falls, BITS, "a datagram has 40 bits");
            let request = Self::bytes(self.request);
            self.datagrams += 1;
            if let Some(chip) = &mut self.chips[motor] {
                let kept = self.lost.map(|lost| (lost, chip.register(lost)));
                chip.transfer(&request);
                chip.registers.extend(kept);
            }
        }
        self.waited = false;
        true
    }

    fn clock(&mut self, high: bool) {
        assert!(self.selected.is_some() && self.waited, "an edge too soon");
        assert_ne!(high, !self.clock_low, "an edge");
        self.clock_low = !high;
        if high {
            let data = self.data && self.line != Line::Deaf;
            self.request = self.request << 1 | u64::from(data);
        } else {
            self.falls += 1;
        }
        self.waited = false;
    }

    fn send(&mut self, high: bool) {
        assert!(
            self.clock_low && !self.waited,
            "bits change after the falling edge"
        );
        self.data = high;
    }

    fn receive(&mut self) -> bool {
        assert!(
            self.clock_low && self.waited,
            "bits are taken before the rising edge"
        );
        let place = BITS - self.falls;
        let level = self.answer >> place & 1 == 1;
        match self.line {
            Line::Dead(level) => level,
            Line::Stuck(bit, level) if bit == place => level,
            Line::Noisy(one_in) => level != self.roll().is_multiple_of(one_in),
            _ => level,
        }
    }

    fn wait(&mut self) {
        self.waited = true;
    }
}

impl DriverPort for Bus {
    fn exchange(&mut self, _: usize, _: &[u8], _: &mut [u8]) -> usize {
        panic!("nothing here has a UART");
    }

    fn transfer(
        &mut self,
        motor: usize,
        request: &[u8; DATAGRAM_BYTES],
        reply: &mut [u8; DATAGRAM_BYTES],
    ) -> bool {
        transfer(self, motor, request, reply)
    }
}

/// Of a board without such wires.
struct NoBus;

impl DriverPort for NoBus {
    fn exchange(&mut self, _: usize, _: &[u8], _: &mut [u8]) -> usize {
        0
    }
}

/// 2 A with a TMC5160, 1 A with a TMC2240, for the built-in machine's X.
fn driver(kind: DriverKind) -> DriverConfiguration {
    let (run_ma, sense_mohm) = match kind {
        DriverKind::Tmc5160 => (2000, 75),
        _ => (1000, 12_000),
    };
    DriverConfiguration {
        address: 0,
        sense_mohm,
        run_ma,
        hold_ma: run_ma / 2,
        microsteps: 16,
        interpolates: true,
        full_steps_per_unit: 5.0,
        chopper: Chopper::Stealth,
        spread_below_clocks: 77,
        kind,
    }
}

const KINDS: [DriverKind; 2] = [DriverKind::Tmc5160, DriverKind::Tmc2240];

#[test]
fn drivers_are_set_up_bit_by_bit_as_their_sheets_want_it() {
    for kind in KINDS {
        let mut bus = Bus::new(kind);
        let mut link = SpiLink::new(&mut bus, 0, kind);
        assert_eq!(link.set_up(&driver(kind)), Ok(()));
        assert_eq!(link.retries, 0);
        let chip = bus.chip();
        // en_pwm_mode, multistep_filt.
        assert_eq!(chip.register(GCONF), 0b1100);
        // intpol, 16 microsteps (4), tpfd 4, tbl 2, hend 2, hstrt 5, toff 3.
        assert_eq!(chip.register(CHOPCONF), 0x1441_0153);
        assert_eq!((chip.register(0x11), chip.register(0x13)), (20, 77));
        assert_eq!(chip.register(GSTAT), 0, "a restart would show");
        match kind {
            DriverKind::Tmc5160 => {
                // 0.325 V / 75 mOhm / sqrt 2 = 3.064 A: 2 A are 167 of 256. Half of it is 16 of 32, less one for rounding.
                assert_eq!(chip.register(GLOBALSCALER), 167);
                assert_eq!(chip.register(IHOLD_IRUN), 8 << 16 | 31 << 8 | 15);
                assert_eq!(chip.register(DRV_CONF), 0, "its board's transistors");
                assert_eq!(chip.register(0x70), 0xc40c_001e);
            }
            _ => {
                // 24 kV / 12 kOhm / sqrt 2 = 1.414 A, the second range: 1 A is 181 of 256.
                assert_eq!(chip.register(DRV_CONF), 1);
                assert_eq!(chip.register(GLOBALSCALER), 181);
                assert_eq!(chip.register(IHOLD_IRUN), 4 << 24 | 8 << 16 | 31 << 8 | 15);
                assert_eq!(chip.register(0x70), 0xc44c_001d);
            }
        }
    }
}

/// Currents by the sheets' formulas in floating point: not above what was asked, and within 4 % of it (a step of
/// GLOBALSCALER from 32 on), or a step of 1/32 of the least scale.
#[test]
fn currents_are_those_of_the_data_sheets() {
    for (kind, resistor) in [
        (DriverKind::Tmc5160, 75),
        (DriverKind::Tmc5160, 22),
        (DriverKind::Tmc2240, 12_000),
        (DriverKind::Tmc2240, 47_000),
    ] {
        let [least, most] = run_range_ma(kind, resistor);
        let mut ranges = [0; 3];
        for run_ma in least..=most {
            let with = DriverConfiguration {
                run_ma,
                hold_ma: run_ma / 2,
                sense_mohm: resistor,
                ..driver(kind)
            };
            let current = with.spi_current().expect("it reaches");
            let full_a = match kind {
                DriverKind::Tmc5160 => 0.325 / (f64::from(resistor) * 1e-3),
                _ => [11.75e3, 24e3, 36e3][usize::from(current.range)] / f64::from(resistor),
            };
            let share = f64::from(current.global) / 256.0 / 32.0;
            let given = 1e3 * full_a / 2f64.sqrt() * share * f64::from(current.run + 1);
            let asked = f64::from(run_ma);
            assert!((32..=256).contains(&current.global) && current.run < 32);
            assert!(given <= asked * 1.0001, "{kind:?} {run_ma}: {given}");
            let step = 1e3 * full_a / 2f64.sqrt() / 256.0;
            assert!(given > asked - step * 1.01, "{kind:?} {run_ma}: {given}");
            assert!(current.hold <= current.run);
            ranges[usize::from(current.range)] += 1;
        }
        let below = DriverConfiguration {
            run_ma: least - 1,
            sense_mohm: resistor,
            ..driver(kind)
        };
        assert_eq!(below.spi_current(), None, "{kind:?} {resistor}");
        let is_2240 = kind == DriverKind::Tmc2240;
        assert_eq!(
            ranges.iter().all(|count| *count > 50),
            is_2240,
            "{ranges:?}"
        );
    }
    assert_eq!(run_range_ma(DriverKind::Tmc2240, 12_000)[1], 2121);
    assert_eq!(run_range_ma(DriverKind::Tmc5160, 75)[1], 3064);
}

/// A board with one driver on such a bus.
struct Bench {
    board: Machine,
    service: DriverService,
    bus: Bus,
}

impl Bench {
    fn new(kind: DriverKind, bus: Bus) -> Self {
        let machine = built_in_planar();
        let mut drivers = DriversConfiguration::none();
        drivers.drivers.push(Some(driver(kind))).expect("room");
        let mut service = DriverService::new(&drivers, machine.servo_hz);
        let switches = HomingConfiguration::none();
        let mut board = Machine::with_switches(&machine, &switches, 1).expect("runs");
        let mut bus = bus;
        board.set_up_drivers(&mut service, &mut bus);
        Self {
            board,
            service,
            bus,
        }
    }

    /// More than two periods, at rest or not.
    fn pass(&mut self) {
        for _ in 0..1100 {
            self.board.servo_tick();
            self.board.run_step_interval(&mut Nothing);
            self.board.serve_drivers(&mut self.service, &mut self.bus);
        }
    }

    /// X goes for ten seconds.
    fn jog(&mut self) {
        let jog = Control::Jog {
            joint: 0,
            distance_units: 1_000_000,
            speed_units_s: 100_000,
        };
        order(&mut self.board, jog);
        for _ in 0..100 {
            self.board.servo_tick();
            self.board.run_step_interval(&mut Nothing);
        }
        assert!(!self.board.motion().is_at_rest(), "it moves");
    }

    /// What its chip tells of itself, over what it has.
    fn set(&mut self, register: u8, value: u32) {
        self.bus.chip().registers.insert(register, value);
    }

    fn words(&self) -> String {
        let fault = self.board.motion().fault();
        fault.map_or(String::new(), |fault| fault.to_string())
    }

    fn status(&self) -> DriverStatus {
        self.board.motion().drivers().status()[0]
    }
}

/// Faults of line and chip at the start, one by one, by the words that a host shows.
#[test]
fn what_is_wrong_at_the_start_is_told_in_the_right_words() {
    for kind in KINDS {
        let other = KINDS[usize::from(kind == KINDS[0])];
        let with = |line| Bus {
            line,
            ..Bus::new(kind)
        };
        let lost = Bus {
            lost: Some(GCONF),
            ..Bus::new(kind)
        };
        let missing = Bus {
            chips: vec![None],
            ..Bus::default()
        };
        let another = if other == DriverKind::Tmc5160 {
            "its version is 0x30"
        } else {
            "its version is 0x40"
        };
        for (bus, words) in [
            (with(Line::Right), ""),
            (with(Line::Dead(false)), "motor 0 does not answer"),
            (with(Line::Dead(true)), "motor 0 does not answer"),
            (missing, "motor 0 does not answer"),
            (Bus::new(other), another),
            (
                with(Line::Stuck(24, true)),
                "another chip than the machine file says",
            ),
            // Of GCONF's write, that comes back otherwise.
            (with(Line::Stuck(2, false)), "does not take register 0x00"),
            (with(Line::Stuck(5, true)), "does not take register 0x00"),
            // Nothing that is asked for arrives: every answer is GCONF's.
            (with(Line::Deaf), "motor 0 does not answer"),
            (lost, "reads register 0x00 back otherwise"),
        ] {
            let bench = Bench::new(kind, bus);
            let told = bench.words();
            assert!(told.contains(words), "{kind:?}, {words}: {told}");
            assert_eq!(told.is_empty(), words.is_empty(), "{kind:?}: {told}");
            let is_set_up = bench.status().has(DriverFlags::SET_UP);
            assert!(is_set_up || !words.is_empty());
            // Each try is counted and bounded.
            assert!(bench.bus.datagrams < 100, "{}", bench.bus.datagrams);
        }
        // A board without such wires.
        let mut none = NoBus;
        let mut link = SpiLink::new(&mut none, 0, kind);
        assert_eq!(link.set_up(&driver(kind)), Err(LinkError::NoBus));
    }
}

/// Faults of a chip while the machine moves: stops name what it is, and go when the cause has gone.
#[test]
fn what_goes_wrong_while_it_moves_is_told_at_once() {
    for kind in KINDS {
        for (register, value, words, flag) in [
            (GSTAT, 1, "has restarted", 0),
            (
                DRV_STATUS,
                1 << 27,
                "short, coil A to ground",
                DriverFlags::SHORT,
            ),
            (
                DRV_STATUS,
                1 << 28,
                "short, coil B to ground",
                DriverFlags::SHORT,
            ),
            (
                DRV_STATUS,
                1 << 12,
                "coil A to the supply",
                DriverFlags::SHORT,
            ),
            (
                DRV_STATUS,
                1 << 13,
                "coil B to the supply",
                DriverFlags::SHORT,
            ),
            (DRV_STATUS, 3 << 25, "off for heat", DriverFlags::HOT),
            (GSTAT, 1 << 1, "has switched off for a short", 0),
        ] {
            let mut bench = Bench::new(kind, Bus::new(kind));
            assert_eq!(bench.words(), "");
            bench.jog();
            bench.set(register, value);
            if register == GSTAT && value == 1 {
                bench.bus.chip().restart();
            }
            bench.pass();
            let told = bench.words();
            assert!(told.contains(words), "{kind:?}, {words}: {told}");
            assert!(told.contains("driver of motor 0"), "{told}");
            if register == DRV_STATUS {
                assert!(bench.status().has(flag));
                bench.set(DRV_STATUS, 1 << 31);
            }
            for _ in 0..8 {
                bench.pass();
            }
            assert!(bench.board.motion().is_at_rest(), "it comes to rest");
            clear(&mut bench.board);
            assert_eq!(bench.words(), "", "{kind:?}, {words}: the cause has gone");
            assert!(bench.status().has(DriverFlags::SET_UP));
            // Set up anew, if it was lost.
            assert_eq!(bench.bus.chip().register(GCONF), 0b1100);
        }
    }
}

/// A line that dies in mid-move is no driver without faults.
#[test]
fn a_line_that_dies_while_it_moves_is_told() {
    for level in [false, true] {
        let mut bench = Bench::new(KINDS[0], Bus::new(KINDS[0]));
        bench.jog();
        bench.bus.line = Line::Dead(level);
        bench.pass();
        assert!(
            bench.words().contains("does not answer"),
            "{}",
            bench.words()
        );
    }
}

#[test]
fn warnings_are_told_and_stop_nothing() {
    for kind in KINDS {
        for (register, value, flag) in [
            (DRV_STATUS, 1 << 26, DriverFlags::WARM),
            (GSTAT, 1 << 2, DriverFlags::LOW_SUPPLY),
            (DRV_STATUS, 1 << 14, DriverFlags::STEALTH),
        ] {
            let mut bench = Bench::new(kind, Bus::new(kind));
            assert!(!bench.status().has(flag));
            bench.jog();
            bench.set(register, value);
            bench.pass();
            assert!(bench.status().has(flag), "{kind:?}: {flag:#x}");
            assert_eq!(bench.words(), "");
        }
    }
    // A TMC2240's supply.
    let mut bench = Bench::new(DriverKind::Tmc2240, Bus::new(DriverKind::Tmc2240));
    bench.set(GSTAT, 1 << 4);
    bench.pass();
    assert!(bench.status().has(DriverFlags::LOW_SUPPLY));
    assert_eq!(bench.words(), "");
}

/// An open load shows at the first move, and never by a motor that stands, whose driver cannot know.
#[test]
fn an_open_load_is_told_at_the_first_move() {
    for kind in KINDS {
        for coil in [1 << 29, 1 << 30] {
            let stands = 1 << 31;
            let mut bench = Bench::new(kind, Bus::new(kind));
            bench.set(DRV_STATUS, stands | coil);
            bench.pass();
            assert!(!bench.status().has(DriverFlags::OPEN_LOAD), "it stands");
            bench.jog();
            bench.set(DRV_STATUS, coil);
            bench.pass();
            assert!(bench.status().has(DriverFlags::OPEN_LOAD));
            // It is still told when the move is over.
            bench.set(DRV_STATUS, stands);
            bench.pass();
            assert!(bench.status().has(DriverFlags::OPEN_LOAD));
            bench.set(DRV_STATUS, 0);
            bench.pass();
            assert!(
                !bench.status().has(DriverFlags::OPEN_LOAD),
                "it is plugged in"
            );
            assert_eq!(bench.words(), "");
        }
    }
}

#[test]
fn a_tmc2240_tells_its_temperature() {
    for (reading, celsius) in [(2038, 0), (2238, 25), (2962, 120), (1800, -30)] {
        let mut bench = Bench::new(DriverKind::Tmc2240, Bus::new(DriverKind::Tmc2240));
        bench.set(ADC_TEMP, reading);
        bench.pass();
        assert_eq!(bench.status().celsius(), Some(celsius));
        // (v - 2038) / 7.7, within a degree.
        let sheets = (f64::from(reading) - 2038.0) / 7.7;
        assert!((sheets - f64::from(celsius)).abs() <= 1.0);
    }
    let bench = Bench::new(DriverKind::Tmc5160, Bus::new(DriverKind::Tmc5160));
    assert_eq!(bench.status().celsius(), None);
}

/// Noise costs tries, and is never taken for a fault of the chip.
#[test]
fn noise_is_tried_again_and_counted() {
    let (mut retried, mut set_up) = (0, 0);
    for seed in 0..200 {
        for kind in KINDS {
            let mut bus = Bus::new(kind);
            // One bit in 4,000: one datagram in a hundred.
            (bus.random, bus.line) = (seed, Line::Noisy(4000));
            let mut bench = Bench::new(kind, bus);
            set_up += u32::from(bench.status().has(DriverFlags::SET_UP));
            bench.pass();
            let told = bench.words();
            assert_eq!(told, "", "seed {seed}, {kind:?}");
            retried += u32::from(bench.status().retries);
        }
    }
    // Eight writes of 32 bits each time: 26, and the versions that were read.
    assert!(retried > 20, "{retried}");
    assert!(set_up > 390, "{set_up} of 400");
}

/// A chip each, on one bus.
#[test]
fn each_motor_has_a_chip_of_its_own() {
    let chips = (0..8).map(|motor| Some(VirtualSpiDriver::new(KINDS[motor % 2])));
    let mut bus = Bus {
        chips: chips.collect(),
        ..Bus::default()
    };
    for motor in [3, 0, 7, 1, 6, 2, 5, 4] {
        let kind = KINDS[motor % 2];
        let with = DriverConfiguration {
            run_ma: 700 + 50 * motor as u16,
            ..driver(kind)
        };
        let mut link = SpiLink::new(&mut bus, motor, kind);
        assert_eq!(link.set_up(&with), Ok(()));
        assert_eq!(
            link.read([IOIN]).map(|[pins]| pins >> 24),
            Ok(kind.numbers().1.into())
        );
    }
    for (motor, chip) in bus.chips.iter().enumerate() {
        let chip = chip.as_ref().expect("it is there");
        let full_ma = if motor % 2 == 0 { 3064.1 } else { 1414.2 };
        let global = ((700.0 + 50.0 * motor as f64) / full_ma * 256.0).floor();
        assert_eq!(
            f64::from(chip.register(GLOBALSCALER)),
            global,
            "motor {motor}"
        );
    }
}
