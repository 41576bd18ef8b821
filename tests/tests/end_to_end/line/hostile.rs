//! Goal: whatever comes over the line, the controller neither panics nor moves on after a fault,
//! and its reports stay readable. Method: random bytes and well-formed frames of random messages
//! (plausible sequence numbers, real knot blocks, wild values), ticks in between, invariants after
//! each. `HEADWAY_SEEDS` sets the number of runs (default 6, times 20).

use headway::drive::record::StepLog;
use headway::settings::Settings;
use headway_firmware::configuration::Kinematics;
use headway_firmware::machine::Machine;
use headway_protocol::frame::{FRAME_BYTES_MAX, FrameDecoder, encode_frame, hash_of};
use headway_protocol::knot_block::{KnotPredictor, encode_block};
use headway_protocol::message::{
    Control, DeviceMessage, Finish, Hello, HostMessage, JointOrder, PROTOCOL_VERSION, SCHEMA_HASH,
    Start,
};
use headway_protocol::segment::{FlowAction, FlowEvent, Knot};
use headway_protocol::units::{CHANNEL_TILT_X, CHANNEL_TILT_Y, CHANNEL_Z, Ticks};
use headway_tests::gear;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// The middle of both machines' ranges, channel units.
const CENTRE: [i32; 7] = [1_000_000, 1_000_000, 50_000, 0, 0, 0, 0];
/// Messages of one run.
const MESSAGES: usize = 400;
/// A soft fault comes to rest on the path: longer than any ramp of these machines, servo ticks.
const REST_TICKS_MAX: u32 = 8_000;

fn seeds() -> u64 {
    let runs = std::env::var("HEADWAY_SEEDS").ok();
    runs.and_then(|text| text.parse::<u64>().ok()).unwrap_or(6) * 20
}

/// What has been seen of the controller, for the coverage of the test itself.
#[derive(Debug, Default)]
struct Seen {
    knots_taken: u64,
    faults: u64,
    steps: u64,
    reports: u64,
}

struct Attacker {
    random: Pcg64Mcg,
    machine: Machine,
    machine_hash: u32,
    log: StepLog,
    decoder: FrameDecoder,
    predictor: KnotPredictor,
    position: [i32; 7],
    next_sequence: u32,
    control: u16,
    ticks_faulted: u32,
    /// The machine cannot tilt.
    upright: bool,
    seen: Seen,
}

impl Attacker {
    fn new(settings: &Settings, seed: u64) -> Self {
        let mut attacker = Attacker {
            random: Pcg64Mcg::seed_from_u64(seed),
            machine: Machine::new(&settings.machine, seed as u32).expect("machine"),
            machine_hash: hash_of(&settings.machine),
            log: StepLog::default(),
            decoder: FrameDecoder::new(),
            predictor: KnotPredictor::new([0; 7]),
            position: CENTRE,
            next_sequence: 0,
            control: 0,
            ticks_faulted: 0,
            upright: settings.machine.kinematics == Kinematics::Planar,
            seen: Seen::default(),
        };
        attacker.greet();
        attacker.start();
        attacker
    }

    fn send(&mut self, sequence: u16, message: &HostMessage<'_>) {
        let mut out = [0u8; FRAME_BYTES_MAX];
        let length = encode_frame(sequence, message, &mut out).expect("fits");
        self.machine.handle_bytes(&out[..length]);
    }

    fn send_control(&mut self, message: &HostMessage<'_>) {
        self.control = self.control.wrapping_add(1);
        self.send(self.control, message);
    }

    fn greet(&mut self) {
        let hello = Hello {
            protocol_version: PROTOCOL_VERSION,
            schema_hash: SCHEMA_HASH,
            host_session: self.random.random_range(0..3),
        };
        self.send_control(&HostMessage::Hello(hello));
    }

    fn start(&mut self) {
        self.predictor = KnotPredictor::new(self.position);
        let first_sequence = self.random.random();
        let start = Start {
            job: 1,
            machine_hash: self.machine_hash,
            first_sequence,
            position: self.position,
            solution: 0,
            units: headway_protocol::units::Units::BASE,
        };
        self.send_control(&HostMessage::Start(start));
        self.next_sequence = first_sequence;
    }

    /// A block that is smooth, or wild in one way.
    fn knots(&mut self) {
        let wild = self.random.random_range(0..60);
        let count = self.random.random_range(1..33);
        let reach = match wild {
            0 => i32::MAX / 2,
            1 => 100_000,
            _ => 100,
        };
        let started_at = self.position;
        let knots: Vec<Knot> = (0..count)
            .map(|_| {
                for (channel, value) in self.position.iter_mut().enumerate() {
                    let reach = match channel {
                        _ if reach > 100 => reach,
                        // A planar machine cannot tilt, and the slow axis is Z.
                        CHANNEL_TILT_X | CHANNEL_TILT_Y if self.upright => 0,
                        CHANNEL_Z => reach / 20,
                        _ => reach,
                    };
                    *value = value.wrapping_add(self.random.random_range(-reach..=reach));
                }
                Knot {
                    control: self.position,
                    duration_ticks: if wild == 2 {
                        self.random.random_range(1..4)
                    } else {
                        self.random.random_range(10..60)
                    },
                }
            })
            .collect();
        let before = (self.predictor, self.next_sequence);
        let (block, count) = encode_block(&mut self.predictor, &knots);
        self.position = knots[count - 1].control;
        let mut bytes = block.to_vec();
        if wild == 3 {
            let at = self.random.random_range(0..bytes.len());
            bytes[at] ^= 1 << self.random.random_range(0..8);
        }
        self.send_stream(&HostMessage::Knots(&bytes));
        self.listen(0);
        if self.next_sequence == before.1 {
            // It was not taken: go on from where the controller is.
            self.predictor = before.0;
            self.position = started_at;
        }
    }

    fn send_stream(&mut self, message: &HostMessage<'_>) {
        let shift = match self.random.random_range(0..20) {
            0 => self.random.random_range(0..0x1_0000),
            _ => 0,
        };
        self.send(self.next_sequence.wrapping_add(shift) as u16, message);
    }

    fn control(&mut self) {
        let control = match self.random.random_range(0..11) {
            0 => Control::Pause,
            1 | 2 => Control::Resume,
            3 => Control::Override(self.random.random_range(0..300)),
            4 => Control::Abort,
            5 => Control::EmergencyStop,
            6 => Control::ClearFault,
            7 => Control::StatusRequest,
            8 => Control::SetPosition(std::array::from_fn(|_| self.random.random())),
            9 => Control::Jog {
                joint: self.random.random(),
                distance_units: self.random.random(),
                speed_units_s: self.random.random(),
            },
            _ => Control::Home(JointOrder::of(&[self.random.random_range(0..8)]).unwrap()),
        };
        if control == Control::ClearFault {
            return self.clear();
        }
        self.send_control(&HostMessage::Control(control));
    }

    /// Clears the fault and starts anew in the middle of the machine.
    fn clear(&mut self) {
        self.ticks_faulted = 0;
        self.position = CENTRE;
        self.send_control(&HostMessage::Control(Control::ClearFault));
        self.send_control(&HostMessage::Control(Control::SetPosition(CENTRE)));
        self.start();
    }

    fn attack(&mut self) {
        let faulted = self.machine.motion().fault().is_some();
        if faulted && self.random.random_range(0..8) == 0 {
            return self.clear();
        }
        match self.random.random_range(0..40) {
            0 => {
                let bytes: Vec<u8> = (0..self.random.random_range(0..600))
                    .map(|_| self.random.random())
                    .collect();
                self.machine.handle_bytes(&bytes);
            }
            1 => self.greet(),
            2 => self.start(),
            3..=7 => self.control(),
            8..=10 => {
                let event = FlowEvent {
                    span: self.random.random_range(0..2_000),
                    offset_ticks: self.random.random_range(0..5_000),
                    action: FlowAction::Prime,
                    volume_units: self.random.random_range(0..2_000_000),
                    duration_ticks: Ticks(self.random.random_range(0..4_000)),
                };
                self.send_stream(&HostMessage::Flow(event));
            }
            11 => {
                let finish = Finish {
                    knots: self.random.random_range(0..100),
                    events: self.random.random_range(0..10),
                };
                self.send_stream(&HostMessage::Finish(finish));
            }
            _ => self.knots(),
        }
    }

    /// A few servo ticks, with the invariants after each.
    fn run(&mut self, seed: u64) {
        for _ in 0..self.random.random_range(0..120) {
            let before = self.log.len();
            let rested = self.machine.motion().is_at_rest();
            let faulted = self.machine.motion().fault().is_some();
            self.machine.run_servo_interval(&mut self.log);
            if !faulted {
                self.ticks_faulted = 0;
                continue;
            }
            self.ticks_faulted += 1;
            if self.ticks_faulted > REST_TICKS_MAX {
                assert!(rested, "seed {seed}: moves long after a fault");
                assert_eq!(self.log.len(), before, "seed {seed}: steps after a fault");
            }
        }
        self.listen(seed);
    }

    fn listen(&mut self, seed: u64) {
        let mut out = [0u8; FRAME_BYTES_MAX];
        // More reports at once than there are kinds would be a report without end.
        for _ in 0..10 {
            let length = self.machine.poll_report(&mut out);
            if length == 0 {
                return;
            }
            for &byte in &out[..length] {
                let Some(frame) = self.decoder.push(byte) else {
                    continue;
                };
                let frame = frame.expect("a whole frame");
                let message = DeviceMessage::decode(frame.payload).expect("a message");
                self.seen.reports += 1;
                match message {
                    DeviceMessage::Ack(ack) | DeviceMessage::Nak(ack) => {
                        self.next_sequence = ack.next_sequence;
                    }
                    DeviceMessage::Fault(_) => self.seen.faults += 1,
                    _ => {}
                }
            }
        }
        panic!("seed {seed}: reports without end");
    }
}

fn campaign(settings: &Settings) -> Seen {
    let mut all = Seen::default();
    for seed in 0..seeds() {
        let mut attacker = Attacker::new(settings, seed);
        for _ in 0..MESSAGES {
            attacker.attack();
            attacker.run(seed);
            let done = u64::from(attacker.machine.motion().spans_done());
            attacker.seen.knots_taken = attacker.seen.knots_taken.max(done);
        }
        all.knots_taken += attacker.seen.knots_taken;
        all.faults += attacker.seen.faults;
        all.reports += attacker.seen.reports;
        all.steps += attacker.log.len() as u64;
    }
    println!("{all:?}");
    all
}

#[test]
fn nothing_on_the_line_panics_the_controller_or_moves_it_after_a_fault() {
    for settings in [Settings::default(), gear::gantry()] {
        let seen = campaign(&settings);
        // The attack reached the motion, not only the door.
        assert!(seen.faults > 20, "{seen:?}");
        assert!(seen.knots_taken > 100, "{seen:?}");
        assert!(seen.steps > 1000, "{seen:?}");
        assert!(seen.reports > 1000, "{seen:?}");
    }
}
