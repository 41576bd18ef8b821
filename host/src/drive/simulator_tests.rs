//! The three ends together on the built-in machine.

use super::*;
use crate::drive::plan_curve::stream_ticks;
use crate::drive::test_streams::{planar, spiral};
use crate::drive::trace::compare;
use crate::job::SegmentStream;

fn run(stream: &SegmentStream, setup: &SimulatorSetup) -> Simulation {
    let machine = planar();
    let frames = WireFrames::encode(stream).unwrap();
    let ticks = stream_ticks(&stream.knots);
    Simulator::new(frames, ticks, &machine, setup)
        .unwrap()
        .run(|_| {})
        .unwrap()
}

fn with_link(text: &str, seed: u64) -> SimulatorSetup {
    SimulatorSetup {
        link: text.parse().unwrap(),
        seed,
        ..SimulatorSetup::default()
    }
}

#[test]
fn the_steps_reproduce_the_plan() {
    let stream = spiral(3.0);
    let simulation = run(&stream, &SimulatorSetup::default());
    let figures = compare(&stream, &planar(), &simulation.motion);
    assert_eq!(simulation.figures.faults, 0, "{:?}", simulation.fault);
    assert_eq!(simulation.figures.holds, 0);
    assert_eq!(simulation.figures.underruns, 0);
    assert_eq!(figures.final_counts, figures.expected_counts, "{figures:?}");
    // Issue 2's bounds.
    assert!(
        figures.tip_error_um_max <= figures.half_step_um_max + 2.0,
        "{figures:?}"
    );
    assert!(figures.heading_error_mrad_max <= figures.half_step_mrad_max + 0.2);
    assert!(figures.volume_error_pct < 0.1);
    // The tick's quantisation is 1.44 us rms and 2.5 us at most.
    assert!(figures.step_time_error_us_rms < 2.0, "{figures:?}");
    assert!(figures.step_time_error_us_max < 6.0, "{figures:?}");
}

/// Goal: shaped steps are compared with the shaped plan, to half a step like others, and how far that is
/// from the path is told. Method: a spiral, whose tip on a circle of radius r at the speed v comes to lie
/// inside by v² / r times half the variance of the shaper.
#[test]
fn shaped_steps_reproduce_the_shaped_plan() {
    use headway_firmware::configuration::shaping::{Shaper, ShaperKind};
    use headway_firmware::steps::shaping::shapes;
    let stream = spiral(3.0);
    let frames = WireFrames::encode(&stream).unwrap();
    let ticks = stream_ticks(&stream.knots);
    for kind in [ShaperKind::Mzv, ShaperKind::Ei, ShaperKind::Smooth] {
        let mut machine = planar();
        for joint in [0, 1, 3] {
            machine.shapers[joint] = Shaper {
                kind,
                frequency_hz: 38.0 + 3.0 * joint as f64,
                damping: 0.1,
            };
        }
        let simulator = Simulator::new(frames.clone(), ticks, &machine, &SimulatorSetup::default());
        let simulation = simulator.unwrap().run(|_| {}).unwrap();
        assert_eq!(simulation.figures.faults, 0, "{:?}", simulation.fault);
        let figures = compare(&stream, &machine, &simulation.motion);
        assert_eq!(figures.final_counts, figures.expected_counts, "{figures:?}");
        assert!(
            figures.tip_error_um_max <= figures.half_step_um_max + 2.0,
            "{figures:?}"
        );
        assert!(figures.heading_error_mrad_max <= figures.half_step_mrad_max + 0.2);
        assert!(figures.step_time_error_us_max < 6.0, "{figures:?}");
        let variance_ticks2 = shapes(&machine)[0].as_ref().unwrap().variance_ticks2();
        let acceleration_mm_s2 = machine.joints[0].acceleration_max;
        let most_um = 0.5e3 * variance_ticks2 / 4e6 * acceleration_mm_s2;
        // Not more than both joints at their limits, and not nothing.
        let off_um = figures.shaping_error_um_max;
        assert!(
            off_um > 5.0 && off_um < 1.42 * most_um,
            "{off_um} {most_um}"
        );
    }
    let plain = run(&stream, &SimulatorSetup::default());
    assert_eq!(
        compare(&stream, &planar(), &plain.motion).shaping_error_um_max,
        0.0
    );
}

#[test]
fn a_bad_line_does_not_change_a_step() {
    let stream = spiral(3.0);
    let clean = run(&stream, &SimulatorSetup::default());
    let mut resent = 0;
    for seed in 0..6 {
        let setup = with_link("drop=0.02,flip=1e-4,dup=0.01,delay=2ms", seed);
        let noisy = run(&stream, &setup);
        assert_eq!(noisy.figures.holds, 0, "seed {seed}");
        assert_eq!(noisy.figures.step_digest, clean.figures.step_digest);
        resent += noisy.figures.resent_frames;
    }
    assert!(resent > 0);
}

#[test]
fn a_stalled_line_costs_time_but_not_the_path() {
    let stream = spiral(6.0);
    let clean = run(&stream, &SimulatorSetup::default());
    let clean_figures = compare(&stream, &planar(), &clean.motion);
    // Slow enough that the queue cannot hold the whole job.
    let stalled = run(&stream, &with_link("stall=5s@200ms,baud=38400", 1));
    let figures = compare(&stream, &planar(), &stalled.motion);
    assert_eq!(stalled.figures.faults, 0, "{:?}", stalled.fault);
    assert!(stalled.figures.holds > 0);
    assert_eq!(stalled.figures.final_counts, clean.figures.final_counts);
    assert!(
        figures.tip_error_um_max <= clean_figures.tip_error_um_max + clean_figures.half_step_um_max,
        "{figures:?} {clean_figures:?}"
    );
    assert!(stalled.figures.motion_s > clean.figures.motion_s);
}

#[test]
fn pause_and_override_keep_to_the_path() {
    let stream = spiral(4.0);
    let clean = run(&stream, &SimulatorSetup::default());
    let setup = SimulatorSetup {
        commands: vec![
            (800_000, Control::Override(50)),
            (1_500_000, Control::Pause),
            (2_500_000, Control::Resume),
            (3_000_000, Control::Override(100)),
        ],
        ..SimulatorSetup::default()
    };
    let paused = run(&stream, &setup);
    assert_eq!(paused.figures.faults, 0);
    assert_eq!(paused.figures.final_counts, clean.figures.final_counts);
    assert!(paused.figures.motion_s > clean.figures.motion_s + 1.0);
    let figures = compare(&stream, &planar(), &paused.motion);
    assert!(
        figures.tip_error_um_max <= figures.half_step_um_max + 2.0,
        "{figures:?}"
    );
}

#[test]
fn an_emergency_stop_ends_the_run_with_a_fault() {
    let stream = spiral(4.0);
    let setup = SimulatorSetup {
        commands: vec![(1_000_000, Control::EmergencyStop)],
        ..SimulatorSetup::default()
    };
    let stopped = run(&stream, &setup);
    assert_eq!(stopped.figures.faults, 1);
    assert!(stopped.figures.steps > 0);
}

#[test]
fn a_dead_line_is_told_and_a_long_outage_is_waited_for() {
    let stream = spiral(2.0);
    let frames = WireFrames::encode(&stream).unwrap();
    let ticks = stream_ticks(&stream.knots);
    let dead = Simulator::new(frames, ticks, &planar(), &with_link("drop=1", 1))
        .unwrap()
        .run(|_| {});
    assert!(
        matches!(dead, Err(SimulatorError::Stuck { .. })),
        "{dead:?}"
    );
    let late = run(&stream, &with_link("pull=100s@0s", 1));
    assert_eq!(late.figures.faults, 0);
    assert_eq!(late.figures.final_counts.len(), 5);
}
