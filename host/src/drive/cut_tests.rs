//! Goal: a stream that is cut at any byte continues where it was, and every step is made once. Method:
//! the sender and the firmware library over two pipes that lose everything in transit at random bytes of
//! either direction, a thousand times in all; counts and spans are those of an undisturbed stream.
use crate::drive::sender::Sender;
use crate::drive::sender_state::{SenderSetup, SenderState};
use crate::drive::test_streams::{planar, spiral};
use crate::job::frames::WireFrames;
use headway_firmware::configuration::MOTORS_MAX;
use headway_firmware::machine::Machine;
use headway_firmware::steps::output::StepOutput;
use headway_protocol::frame::{FRAME_BYTES_MAX, hash_of};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::collections::VecDeque;

/// Bytes that a line moves in a millisecond: 1,000,000 baud.
const BYTES_PER_MS: usize = 100;
/// Cuts of a run, and how long the line is away, ms.
const CUTS: usize = 50;
const AWAY_MS: std::ops::Range<u64> = 1..60;

/// Counts the steps that really come out.
#[derive(Default)]
struct Counts {
    directions: u8,
    counts: [i64; MOTORS_MAX],
}

impl StepOutput for Counts {
    fn set_directions(&mut self, directions: u8) {
        self.directions = directions;
    }
    fn step(&mut self, _tick: u64, motors: u8) {
        for (motor, count) in self.counts.iter_mut().enumerate() {
            if motors >> motor & 1 == 1 {
                *count += if self.directions >> motor & 1 == 1 {
                    1
                } else {
                    -1
                };
            }
        }
    }
}

/// Runs to the end with cuts after these numbers of bytes that crossed, both ways counted.
fn run(mut cuts: VecDeque<u64>, random: &mut Pcg64Mcg) -> ([i64; MOTORS_MAX], u32, usize) {
    let configuration = planar();
    let setup = SenderSetup {
        host_session: 5,
        machine_hash: hash_of(&configuration),
        servo_hz: configuration.servo_hz,
        resume: false,
        solution: 0,
    };
    let mut sender = Sender::new(WireFrames::encode(&spiral(4.0)).unwrap(), setup);
    let mut machine = Machine::new(&configuration, 77).unwrap();
    let mut counts = Counts::default();
    let (mut down, mut up) = (VecDeque::new(), VecDeque::new());
    let mut out = [0u8; FRAME_BYTES_MAX];
    let (mut crossed, mut away_until, mut made) = (0u64, 0u64, 0);
    for ms in 0..600_000u64 {
        let now_us = ms * 1000;
        let is_open = ms >= away_until;
        while down.len() < BYTES_PER_MS {
            let Some(length) = sender.poll_transmit(now_us, &mut out) else {
                break;
            };
            down.extend(out[..length].iter().filter(|_| is_open));
        }
        for (line, to_machine) in [(&mut down, true), (&mut up, false)] {
            for _ in 0..BYTES_PER_MS {
                let Some(byte) = line.pop_front() else { break };
                crossed += 1;
                if cuts.front().is_some_and(|at| crossed >= *at) {
                    // In the middle of a frame: what is behind it is gone.
                    cuts.pop_front();
                    line.clear();
                    made += 1;
                    away_until = ms + random.random_range(AWAY_MS);
                    break;
                }
                match to_machine {
                    true => machine.handle_bytes(&[byte]),
                    false => sender.handle_bytes(now_us, &[byte]),
                }
            }
        }
        if !is_open {
            down.clear();
            up.clear();
        }
        for _ in 0..configuration.servo_hz / 1000 {
            machine.run_servo_interval(&mut counts);
        }
        loop {
            let length = machine.poll_report(&mut out);
            if length == 0 {
                break;
            }
            up.extend(out[..length].iter().filter(|_| is_open));
        }
        while sender.poll_event().is_some() {}
        match sender.state() {
            SenderState::Done => return (counts.counts, machine.motion().spans_done(), made),
            SenderState::Failed(error) => panic!("{error}"),
            _ => {}
        }
    }
    panic!("it never ends: {:?}", sender.state());
}

#[test]
fn a_thousand_cuts_at_random_bytes_change_no_count() {
    let mut random = Pcg64Mcg::seed_from_u64(24);
    let clean = run(VecDeque::new(), &mut random);
    assert_eq!(clean.2, 0);
    let mut all = 0;
    while all < 1000 {
        let mut cuts: Vec<u64> = (0..CUTS).map(|_| random.random_range(40..9000)).collect();
        cuts.sort_unstable();
        let cut = run(cuts.into(), &mut random);
        assert_eq!((cut.0, cut.1), (clean.0, clean.1));
        assert!(cut.2 > 10, "only {} cuts", cut.2);
        all += cut.2;
    }
    println!("{all} cuts, counts {:?}, {} spans", clean.0, clean.1);
}
