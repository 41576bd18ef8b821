//! Goal: what arrives is what the model's keys say. Method: a motor whose steps are made by a formula, a straight path at
//! a constant speed, and the answers by hand: shares of a curve, an exponential, a line by layers, a limit.

use super::*;
use crate::drive::test_streams::planar;
use crate::settings::extruder_model::{Drift, Slip};
use headway_firmware::steps::delay::motion_delay_s;
use headway_firmware::steps::output::StepOutput;
use headway_protocol::segment::{FlowEvent, Knot};
use headway_protocol::units::{Ticks, to_units};

/// Of the path, mm/s, and what is planned along it, mm³/s.
const SPEED_MM_S: f64 = 20.0;
const ASKED_MM3_S: f64 = 6.0;

/// A straight path of so many seconds, its second half on another layer.
fn straight(seconds: f64, layers: [u32; 2]) -> SegmentStream {
    let servo_hz = f64::from(planar().servo_hz);
    let at = |t_s: f64| {
        let [x, volume] = [SPEED_MM_S, ASKED_MM3_S].map(|rate| rate * t_s);
        to_units(&[10.0 + x, 10.0, 0.2, 0.0, 0.0, 0.0, volume])
    };
    let duration_ticks = 40;
    let spans = (seconds * servo_hz / f64::from(duration_ticks)) as u64;
    let knot = |number: u64| Knot {
        control: at(number as f64 * f64::from(duration_ticks) / servo_hz),
        duration_ticks,
    };
    let end_tick = spans * u64::from(duration_ticks);
    let mark = |half: u64| Mark {
        start_tick: half * end_tick / 2,
        end_tick: (half + 1) * end_tick / 2,
        state: MotionState::Print,
        layer: layers[half as usize],
        pass: Some(half as u32),
    };
    SegmentStream {
        start: at(0.0),
        knots: (0..spans).map(knot).collect(),
        marks: vec![mark(0), mark(1)],
        ..SegmentStream::default()
    }
}

/// Steps of a motor that pushes `mm3(t)` until `t` seconds after the job's start, forwards and backwards.
fn record(seconds: f64, mm3: impl Fn(f64) -> f64) -> MotionRecord {
    let machine = planar();
    let [servo_hz, step_hz] = [machine.servo_hz, machine.step_hz].map(f64::from);
    let ticks = (seconds * servo_hz) as usize;
    let mut record = MotionRecord {
        rates_q16: vec![1 << 16; ticks],
        first_servo_tick: 11,
        ..MotionRecord::default()
    };
    let begins_s = 11.0 / servo_hz + motion_delay_s(&machine);
    let mut count = 0.0;
    for tick in 0..((begins_s + seconds + 0.01) * step_hz) as u64 {
        let t_s = (tick as f64 / step_hz - begins_s).max(0.0);
        let off = mm3(t_s) * machine.extruder.steps_per_mm3 - count;
        assert!(off.abs() < 1.5, "a motor too fast for the test");
        if off.abs() >= 0.5 {
            count += off.signum();
            record
                .steps
                .set_directions(u8::from(off > 0.0) << machine.joints.len());
            record.steps.step(tick, 1 << machine.joints.len());
        }
    }
    record
}

fn laid(stream: &SegmentStream, record: &MotionRecord, model: &ExtruderModel) -> LaidBeads {
    let transform = PartTransform {
        offset_mm: [10.0, 10.0, 0.0],
    };
    laid_beads(stream, &Settings::default(), record, model, &transform)
}

fn with_loss(points: &[[f32; 2]]) -> ExtruderModel {
    ExtruderModel {
        flow_loss: points.iter().copied().collect(),
        ..ExtruderModel::default()
    }
}

/// Pieces away from starts and stops.
fn middle(beads: &LaidBeads) -> Vec<LaidPiece> {
    let middle = beads.pieces.iter().filter(|piece| !piece.is_end).copied();
    let middle: Vec<LaidPiece> = middle.collect();
    assert!(middle.len() > 20, "{}", middle.len());
    middle
}

#[test]
fn a_steady_bead_lacks_the_curves_share() {
    let stream = straight(2.0, [0, 0]);
    let model = with_loss(&[[4.0, 0.04], [8.0, 0.25]]);
    // Between 3.84 of 4 and 6 of 8: 4.92 of 6.
    for (motor_mm3_s, arrives_mm3_s) in [(6.0, 4.92), (2.0, 1.92), (8.0, 6.0), (10.0, 7.08)] {
        let beads = laid(&stream, &record(2.0, |t| motor_mm3_s * t), &model);
        for piece in middle(&beads) {
            // A piece is cut where a servo tick ends, and a step is a hundredth of it.
            let [asked, laid] = [piece.asked_mm3, piece.laid_mm3].map(|mm3| mm3 / piece.length_mm);
            assert!((asked - ASKED_MM3_S / SPEED_MM_S).abs() < 1e-4, "{asked}");
            let wanted = arrives_mm3_s / SPEED_MM_S;
            assert!(
                (laid / wanted - 1.0).abs() < 2e-3,
                "{motor_mm3_s}: {laid} {wanted}"
            );
        }
    }
}

#[test]
fn a_lag_answers_a_step_by_an_exponential() {
    let (stream, lag_s) = (straight(2.0, [0, 0]), 0.15);
    let model = ExtruderModel {
        lag_s,
        ..with_loss(&[[4.0, 0.04], [8.0, 0.25]])
    };
    // 2 mm³/s for a second, then 6.
    let beads = laid(
        &stream,
        &record(2.0, |t| 2.0 * t + 4.0 * (t - 1.0).max(0.0)),
        &model,
    );
    for (tick, flow) in beads.flow_mm3_s.iter().enumerate() {
        let t_s = (tick as f64 + 0.5) / 2000.0;
        let risen = |since_s: f64| 1.0 - (-since_s.max(0.0) / lag_s).exp();
        let wanted = 1.92 * risen(t_s) + 3.0 * risen(t_s - 1.0);
        // The mean of the motor's flow over 4 ms, and half a step in the beginning.
        assert!(
            (f64::from(*flow) - wanted).abs() < 0.03,
            "{t_s} {flow} {wanted}"
        );
    }
    let first = beads.pieces.first().expect("pieces");
    assert!(first.is_end && first.error() < -0.9, "{first:?}");
    assert_eq!(first.at_mm[1], 0.0);
}

#[test]
fn viscosity_drifts_by_a_line_over_layers() {
    let drift = Drift {
        share: 0.15,
        layers: 20,
    };
    let model = ExtruderModel {
        drift: Some(drift),
        ..ExtruderModel::default()
    };
    for (layers, shares) in [([0, 5], [1.0, 0.9625]), ([20, 40], [0.85, 0.85])] {
        let stream = straight(4.0, layers);
        let beads = laid(&stream, &record(4.0, |t| ASKED_MM3_S * t), &model);
        for piece in middle(&beads) {
            let share = shares[piece.pass as usize];
            assert_eq!(piece.layer, layers[piece.pass as usize]);
            assert!((1.0 + piece.error() - share).abs() < 2e-3, "{piece:?}");
            let at = f64::from(beads.share_at(piece.ticks[0]));
            assert!((at - share).abs() < 2e-3, "{at} {share}");
        }
        assert_eq!(beads.share_at(u64::MAX), 1.0);
    }
}

#[test]
fn a_drive_slips_above_its_flow() {
    let slip = Slip {
        flow_mm3_s: 4.0,
        share: 0.75,
    };
    let model = ExtruderModel {
        slip: Some(slip),
        ..ExtruderModel::default()
    };
    let stream = straight(2.0, [0, 0]);
    // Of the 2 mm³/s above 4 a quarter.
    for (motor_mm3_s, share) in [(6.0, 4.5 / 6.0), (3.0, 0.5)] {
        let beads = laid(&stream, &record(2.0, |t| motor_mm3_s * t), &model);
        for piece in middle(&beads) {
            assert!((1.0 + piece.error() - share).abs() < 2e-3, "{piece:?}");
        }
    }
}

/// Goal: a pulled-back nozzle is filled before anything is laid, and nothing of the prime is lost. Method: a motor that
/// primes 0.5 mm³ in 50 ms, prints, pulls back and primes again.
#[test]
fn retracts_and_primes_lay_nothing() {
    let mut stream = straight(2.0, [0, 0]);
    stream.events.push(FlowEvent {
        span: 1,
        offset_ticks: 0,
        action: FlowAction::Prime,
        volume_units: 500_000,
        duration_ticks: Ticks(100),
    });
    let ramp = |t: f64, from: f64, long: f64| ((t - from) / long).clamp(0.0, 1.0);
    let motor = |t: f64| {
        let printed = ASKED_MM3_S * ((t - 0.05).clamp(0.0, 0.95) + (t - 1.2).max(0.0));
        let pulled = ramp(t, 1.0, 0.05) - ramp(t, 1.1, 0.1);
        0.5 * (ramp(t, 0.0, 0.05) - pulled) + printed
    };
    let model = with_loss(&[[4.0, 0.25], [8.0, 0.25]]);
    let beads = laid(&stream, &record(2.0, motor), &model);
    let laid_mm3: f64 = beads.pieces.iter().map(|piece| piece.laid_mm3).sum();
    let wanted_mm3 = 0.75 * ASKED_MM3_S * (0.95 + 0.8);
    assert!(
        (laid_mm3 - wanted_mm3).abs() < 0.02,
        "{laid_mm3} {wanted_mm3}"
    );
    for (tick, flow) in beads.flow_mm3_s.iter().enumerate() {
        let t_s = tick as f64 / 2000.0;
        let rests = (0.003..0.047).contains(&t_s) || (1.003..1.197).contains(&t_s);
        assert!(!rests || *flow < 0.05, "{t_s} {flow}");
    }
}
