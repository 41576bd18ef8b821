//! Goal: steps are made where the commanded curve crosses n + 1/2, none is lost or added, and the
//! fast path equals the tick-by-tick one. Method: known curves, sampled at the servo rate; their
//! crossings are found by bisection.
use super::*;
use crate::design::{SERVO_DELAY_TICKS, motion_delay_s};
use crate::steps::output::StepOutput;
use std::vec::Vec;

const SERVO_HZ: u32 = 2000;
const STEP_HZ: u32 = 200_000;
const TICKS: u32 = STEP_HZ / SERVO_HZ;

#[derive(Default, PartialEq, Debug)]
struct Record {
    steps: Vec<(u64, u8, u8)>,
    directions: u8,
    last_direction_change: Vec<u64>,
}

impl StepOutput for Record {
    fn set_directions(&mut self, directions: u8) {
        self.directions = directions;
        self.last_direction_change
            .push(self.steps.last().map_or(0, |s| s.0));
    }
    fn step(&mut self, tick: u64, motors: u8) {
        assert_ne!(motors, 0);
        self.steps.push((tick, motors, self.directions));
    }
}

/// Plays `curve` (steps over seconds, per motor) and returns the record and the end positions.
fn play(
    motors: usize,
    seconds: f64,
    fast: bool,
    curve: impl Fn(usize, f64) -> f64,
) -> (Record, [i64; MOTORS_MAX]) {
    let mut programmer = StepProgrammer::new(motors, TICKS);
    let mut player = StepPlayer::new(TICKS);
    let mut record = Record::default();
    let start = core::array::from_fn(|m| (curve(m, 0.0) * STEP as f64) as i64);
    programmer.set_positions(&start);
    let ticks = (seconds * f64::from(SERVO_HZ)) as u32 + SERVO_DELAY_TICKS + 1;
    for tick in 0..ticks {
        let t = (f64::from(tick) / f64::from(SERVO_HZ)).min(seconds);
        let targets = core::array::from_fn(|m| (curve(m, t) * STEP as f64) as i64);
        programmer.advance(&targets, player.idle_bank()).unwrap();
        player.hand_over();
        if fast {
            player.run_interval(&mut record);
        } else {
            for _ in 0..TICKS {
                player.tick(&mut record);
            }
        }
    }
    assert_eq!(player.overruns(), 0);
    (record, programmer.positions(&WaitingTargets::NONE))
}

#[test]
fn steps_come_at_the_crossings_of_the_curve() {
    let curve = |_: usize, t: f64| 800.0 * (1.0 - (6.0 * t).cos()) + 3000.0 * t * t;
    let seconds = 1.5;
    let (record, end) = play(1, seconds, true, curve);
    let delay_s = motion_delay_s(SERVO_HZ, STEP_HZ);
    let mut position = count((curve(0, 0.0) * STEP as f64) as i64);
    let (mut sum_of_squares, mut worst_us, mut counted) = (0.0, 0.0f64, 0);
    for (tick, _, directions) in &record.steps {
        let forward = directions & 1 == 1;
        let level = position as f64 + if forward { 0.5 } else { -0.5 };
        position += if forward { 1 } else { -1 };
        let time_s = *tick as f64 / f64::from(STEP_HZ) - delay_s;
        // Within two ticks the curve must cross the level; slow places have no sharp crossing.
        let speed = (curve(0, time_s + 1e-4) - curve(0, time_s - 1e-4)) / 2e-4;
        if speed.abs() < 200.0 || time_s > seconds - 2e-3 || time_s < 2e-3 {
            continue;
        }
        let error_us = (curve(0, time_s) - level) / speed * 1e6;
        sum_of_squares += error_us * error_us;
        worst_us = worst_us.max(error_us.abs());
        counted += 1;
    }
    let rms_us = (sum_of_squares / f64::from(counted)).sqrt();
    assert!(counted > 5000, "{counted}");
    // A tick's own quantisation is 5 us / sqrt(12) = 1.44 us rms.
    assert!(rms_us > 1.3 && rms_us < 1.6, "rms {rms_us} us");
    assert!(worst_us < 5.0, "worst {worst_us} us");
    assert_eq!(position, count((curve(0, seconds) * STEP as f64) as i64));
    assert_eq!(position, count(end[0]));
}

#[test]
fn the_fast_path_makes_the_same_calls() {
    let curve = |m: usize, t: f64| 300.0 * (m as f64 + 1.0) * (5.0 * t + m as f64).sin();
    let (slow, slow_end) = play(8, 1.0, false, curve);
    let (fast, fast_end) = play(8, 1.0, true, curve);
    assert!(slow.steps.len() > 10_000);
    assert_eq!(slow, fast);
    assert_eq!(slow_end, fast_end);
}

#[test]
fn counts_follow_every_motor_and_directions_lead_their_steps() {
    let curve = |m: usize, t: f64| 777.0 * (m as f64 - 3.5) * (4.0 * t + m as f64).cos();
    let (record, end) = play(8, 1.25, true, curve);
    let mut counts: [i64; 8] =
        core::array::from_fn(|m| count((curve(m, 0.0) * STEP as f64) as i64));
    for (_, motors, directions) in &record.steps {
        for (m, count) in counts.iter_mut().enumerate() {
            if motors >> m & 1 == 1 {
                *count += if directions >> m & 1 == 1 { 1 } else { -1 };
            }
        }
    }
    for m in 0..8 {
        assert_eq!(
            counts[m],
            count((curve(m, 1.25) * STEP as f64) as i64),
            "{m}"
        );
        assert_eq!(counts[m], count(end[m]));
    }
    assert!(record.last_direction_change.len() > 10);
}

#[test]
fn exact_halves_round_up_wherever_they_are() {
    // 100 steps per mm: 0.01 steps per 0.1 um.
    let scale = StepScale::new(0.01);
    for units in [50i64, 150, -50, 10_000_050, -10_000_050] {
        let expected = (units as f64 * 0.01 + 0.5).floor() as i64;
        assert_eq!(count(scale.scaled(units).position), expected, "{units}");
        assert_eq!(
            count(scale.scaled(units - 1).position),
            expected - 1,
            "{units}"
        );
    }
}

#[test]
fn a_rate_above_the_step_tick_is_refused() {
    let mut programmer = StepProgrammer::new(1, TICKS);
    let mut targets = [0i64; MOTORS_MAX];
    let mut refused = None;
    let mut bank = StepBank::default();
    for _ in 0..5 {
        // 99 steps in 100 ticks.
        targets[0] += 99 * STEP;
        if let Err(error) = programmer.advance(&targets, &mut bank) {
            refused = Some(error);
            break;
        }
    }
    let refused = refused.unwrap();
    assert_eq!(refused.motor, 0);
    assert!(refused.steps_per_interval >= 98, "{refused:?}");
}

#[test]
fn a_missing_program_stops_the_motors_and_is_counted() {
    let mut programmer = StepProgrammer::new(1, TICKS);
    let mut player = StepPlayer::new(TICKS);
    let mut record = Record::default();
    for tick in 0..20i64 {
        let targets = [tick * 20 * STEP; MOTORS_MAX];
        programmer.advance(&targets, player.idle_bank()).unwrap();
        player.hand_over();
        player.run_interval(&mut record);
    }
    player.run_interval(&mut record);
    let steps = record.steps.len();
    assert!(steps > 200);
    player.run_interval(&mut record);
    player.run_interval(&mut record);
    assert_eq!(record.steps.len(), steps);
    assert_eq!(player.overruns(), 3);
}

#[test]
fn moving_a_scaled_position_is_the_same_as_scaling_the_sum() {
    // Goal: nothing drifts over a long job. Method: uneven scales, a random walk of units.
    for steps_per_unit in [0.008, 0.002_546_479_089_470_325, 2.999_999_9, 0.000_4] {
        let scale = StepScale::new(steps_per_unit);
        let mut sum = 123_456_789_012i64;
        let mut moved = scale.scaled(sum);
        let mut state = 7u32;
        for _ in 0..20_000 {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let step = (state as i32) >> (state & 15);
            sum += i64::from(step);
            moved = scale.advanced(&moved, step);
            assert_eq!(moved, scale.scaled(sum));
        }
    }
}
