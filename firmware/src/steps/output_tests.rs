//! Goal: the drivers' signals are right: a direction is set before its step, a pulse is long
//! enough, and other pins stay unchanged. Method: the engine plays curves into ports that record
//! every word, and pulses and directions are read off the pins' levels.
use super::*;
use crate::board::octopus;
use crate::board::table::{DIRECTION, STEP};
use crate::steps::{STEP as ONE_STEP, StepPlayer, StepProgrammer};
use std::vec::Vec;

const TICKS: u32 = 100;

/// Levels of all pins, and what happened to them.
#[derive(Default)]
struct Recorder {
    levels: [u16; PORTS],
    /// Every word, with its number of the tick.
    words: Vec<(u32, usize, u32)>,
    tick: u32,
}

impl Ports for Recorder {
    const STEP: [Pin; MOTORS_MAX] = octopus::BOARD.column(STEP);
    const DIRECTION: [Pin; MOTORS_MAX] = octopus::BOARD.column(DIRECTION);

    fn write(&mut self, port: usize, word: u32) {
        let (set, reset) = (word as u16, (word >> 16) as u16);
        assert_eq!(set & reset, 0, "set and reset at once");
        self.levels[port] = self.levels[port] & !reset | set;
        self.words.push((self.tick, port, word));
    }
}

fn level(levels: &[u16; PORTS], (port, pin): Pin) -> bool {
    levels[port] >> pin & 1 == 1
}

/// Plays curves of steps over seconds on every motor; what was written.
fn play(motors: usize, inverted: u8) -> Vec<(u32, usize, u32)> {
    let curve =
        |motor: usize, t: f64| 250.0 * (motor as f64 - 3.4) * (9.0 * t + motor as f64).sin();
    let mut programmer = StepProgrammer::new(motors, TICKS);
    let mut player = StepPlayer::new(TICKS);
    let mut output = PortOutput::new(Recorder::default(), motors, inverted);
    let at = |t: f64| core::array::from_fn(|motor| (curve(motor, t) * ONE_STEP as f64) as i64);
    programmer.set_positions(&at(0.0));
    for interval in 0..1500 {
        let targets = at(f64::from(interval) / 2000.0);
        programmer.advance(&targets, player.idle_bank()).unwrap();
        player.hand_over();
        for _ in 0..TICKS {
            player.tick(&mut output);
            output.ports.tick += 1;
        }
    }
    output.ports.words
}

#[test]
fn pulses_last_to_the_next_tick_and_directions_lead_them_by_one() {
    let words = play(MOTORS_MAX, 0);
    let mut levels = [0u16; PORTS];
    let mut raised = [None; MOTORS_MAX];
    let mut turned = [None; MOTORS_MAX];
    let (mut pulses, mut turns) = (0, 0);
    for &(tick, port, word) in &words {
        let before = levels;
        levels[port] = levels[port] & !((word >> 16) as u16) | word as u16;
        for motor in 0..MOTORS_MAX {
            let (step, direction) = (
                octopus::BOARD.column(STEP)[motor],
                octopus::BOARD.column(DIRECTION)[motor],
            );
            match (level(&before, step), level(&levels, step)) {
                (false, true) => {
                    // A whole tick, 5 us: drivers ask for 20 ns.
                    assert!(turned[motor].is_none_or(|turned| tick > turned), "{motor}");
                    raised[motor] = Some(tick);
                    pulses += 1;
                }
                // It ends at the start of the next tick, before anything else: 5 us less the jitter
                // of the interrupt. Drivers ask for 100 ns.
                (true, false) => assert_eq!(raised[motor], Some(tick - 1), "{motor}"),
                _ => {}
            }
            if level(&before, direction) != level(&levels, direction) {
                turned[motor] = Some(tick);
                turns += 1;
            }
        }
    }
    assert!(pulses > 10_000 && turns > 20, "{pulses} {turns}");
}

#[test]
fn a_tick_ends_its_pulses_before_it_steps() {
    let words = play(MOTORS_MAX, 0);
    let steps: u32 = octopus::BOARD
        .column(STEP)
        .iter()
        .fold(0, |all, pin| all | 1 << pin.0);
    for tick in words.chunk_by(|a, b| a.0 == b.0) {
        let (lowered, rest) = tick.split_at(steps.count_ones() as usize);
        assert!(
            lowered
                .iter()
                .all(|word| word.2 as u16 == 0 && steps >> word.1 & 1 == 1)
        );
        assert!(rest.iter().all(
            |word| steps >> word.1 & 1 == 1 || word.1 == octopus::BOARD.column(DIRECTION)[7].0
        ));
    }
}

#[test]
fn pins_of_motors_that_the_machine_has_not_are_left_alone() {
    let words = play(5, 0);
    let (port, pin) = octopus::BOARD.column(DIRECTION)[7];
    let touched = |port: usize, pin: u32| {
        let mask = 1 << pin | 1 << (pin + 16);
        words
            .iter()
            .any(|word| word.1 == port && word.2 & mask != 0)
    };
    assert!(!touched(port, pin), "the debugger's pin");
    let (port, pin) = octopus::BOARD.column(DIRECTION)[4];
    assert!(touched(port, pin));
}

#[test]
fn an_inverted_direction_is_the_other_level() {
    let (plain, inverted) = (play(2, 0), play(2, 0b10));
    let levels = |words: &[(u32, usize, u32)], pin: Pin| -> Vec<bool> {
        let of_pin = words.iter().filter(|word| word.1 == pin.0);
        let set = of_pin.filter_map(|word| match word.2 & (1 << pin.1 | 1 << (pin.1 + 16)) {
            0 => None,
            bits => Some(bits >> pin.1 & 1 == 1),
        });
        set.collect()
    };
    let second = levels(&plain, octopus::BOARD.column(DIRECTION)[1]);
    let flipped = levels(&inverted, octopus::BOARD.column(DIRECTION)[1]);
    assert!(second.len() > 1);
    assert!(second.iter().zip(&flipped).all(|(a, b)| a != b));
    let first = levels(&plain, octopus::BOARD.column(DIRECTION)[0]);
    assert_eq!(
        first,
        levels(&inverted, octopus::BOARD.column(DIRECTION)[0])
    );
}
