//! Goal: a link that cannot lose a print. Method: the whole chain on a
//! virtual clock, lines with seeded faults, the steps compared with those of a clean run.
//! `HEADWAY_SEEDS` sets the number of runs for each line rate (default 6; the campaign took 200).

use headway::drive::dry_run::dry_run;
use headway::drive::plan_curve::stream_ticks;
use headway::drive::sender_state::{SenderError, SenderState};
use headway::drive::simulator::{Simulator, SimulatorError, SimulatorSetup};
use headway::input::ReadOptions;
use headway::input::waypoints::read;
use headway::job::SegmentStream;
use headway::job::frames::WireFrames;
use headway::plan::motion::segments::lay_segments;
use headway::plan_waypoints;
use headway::settings::Settings;
use headway_protocol::knot_block::KNOTS_PER_BLOCK_MAX;
use headway_tests::gear;
use headway_tests::rig::{ISSUE_4, Met, Rig, faulty_line};

fn seeds() -> u64 {
    std::env::var("HEADWAY_SEEDS")
        .ok()
        .and_then(|text| text.parse().ok())
        .unwrap_or(6)
}

/// The six-axis gear, planned from its waypoints.
fn example() -> (SegmentStream, Settings) {
    let text = gear::waypoint_file(400.0);
    let run = read(text.as_bytes(), "gear", &ReadOptions::default()).unwrap();
    let settings = gear::free_gantry();
    let plan = plan_waypoints(&run, &settings).unwrap();
    (plan.stream, settings)
}

#[test]
fn faults_on_the_line_cost_time_but_no_step() {
    let (stream, settings) = example();
    let rig = Rig::new(stream, settings);
    let duration_us = (rig.clean.simulation.figures.motion_s * 1e6) as u64;
    let (mut same, mut runs) = (0, 0);
    for baud in [115_200, 1_000_000] {
        let met: Vec<Met> = (0..seeds())
            .map(|seed| {
                rig.check(&SimulatorSetup {
                    link: faulty_line(&ISSUE_4, seed, baud, duration_us),
                    seed,
                    ..SimulatorSetup::default()
                })
            })
            .collect();
        let never_dry = met.iter().filter(|met| met.underruns == 0).count();
        let sum = |of: fn(&Met) -> u64| met.iter().map(of).sum::<u64>();
        println!(
            "{baud} baud: {} runs, {never_dry} never dry, {} underruns, {} holds, {} frames sent \
             again",
            met.len(),
            sum(|met| met.underruns),
            sum(|met| met.holds),
            sum(|met| met.resent_frames),
        );
        assert!(sum(|met| met.resent_frames) > 0, "{baud} baud: no fault");
        same += never_dry;
        runs += met.len();
    }
    assert!(same > 0, "no run could be compared to the step");
    assert!(same < runs, "no line was bad enough to stop the head");
}

#[test]
fn credits_never_hold_up_a_line_that_carries_the_rate() {
    // Goal: goodput on clean lines. Method: clean lines from twice the job's mean rate up; once the
    // queue has been full, a free place in it for more than the next blocks would be a stall.
    let (stream, settings) = example();
    let payload = WireFrames::encode(&stream).unwrap().line_bytes();
    for baud in [19_200, 115_200, 1_000_000] {
        let setup = SimulatorSetup {
            link: format!("baud={baud}").parse().unwrap(),
            ..SimulatorSetup::default()
        };
        let frames = WireFrames::encode(&stream).unwrap();
        let ticks = stream_ticks(&stream.knots);
        let simulator = Simulator::new(frames, ticks, &settings.machine, &setup).unwrap();
        let (mut filled, mut room_most) = (false, 0);
        let simulation = simulator
            .run_disturbed(|simulator| {
                let room = simulator.machine().motion().knot_room();
                let more = simulator.sender().state() == &SenderState::Streaming;
                filled |= room < 2 * KNOTS_PER_BLOCK_MAX;
                if filled && more {
                    room_most = room_most.max(room);
                }
            })
            .unwrap();
        let figures = &simulation.figures;
        let goodput = payload as f64 / figures.bytes as f64;
        println!("{baud} baud: goodput {goodput:.4}, at most {room_most} places free");
        assert!(goodput >= 0.9, "{baud} baud: {goodput}");
        assert_eq!((figures.underruns, figures.holds), (0, 0), "{baud} baud");
        assert!(filled, "{baud} baud: the queue was never full");
        if baud > 100_000 {
            // A block under way, a block that does not fit yet, and what is played meanwhile.
            assert!(room_most <= 3 * KNOTS_PER_BLOCK_MAX, "{baud} baud");
        }
    }
}

#[test]
fn the_six_axis_gear_takes_few_bytes_and_keeps_its_tolerances() {
    let settings = gear::gantry();
    let (stream, report) = lay_segments(&gear::route(400.0), &settings).unwrap();
    let dry_run = dry_run(&stream, &settings, &SimulatorSetup::default(), |_| {}).unwrap();
    let figures = &dry_run.simulation.figures;
    let per_mm = figures.bytes as f64 / 400.0;
    println!(
        "{} knots, {:.1} a second, {} bytes, {per_mm:.2} a mm, {:.0} a second, {} steps, fit {:.2}",
        stream.knots.len(),
        stream.knots.len() as f64 / figures.motion_s,
        figures.bytes,
        dry_run.bytes_per_s,
        figures.steps,
        report.fit_error_ratio,
    );
    println!("{:?}", dry_run.trace);
    assert_eq!(figures.faults, 0);
    assert!(per_mm <= 25.0, "{per_mm} bytes per mm");
}

/// The gear over a line with every fault, both ends on the virtual clock.
fn simulator(rig: &Rig, link: &str, seed: u64) -> Simulator {
    let frames = WireFrames::encode(&rig.stream).unwrap();
    let setup = SimulatorSetup {
        link: link.parse().unwrap(),
        seed,
        ..SimulatorSetup::default()
    };
    let ticks = stream_ticks(&rig.stream.knots);
    Simulator::new(frames, ticks, &rig.settings.machine, &setup).unwrap()
}

/// Everything that a line between two programs can do to chunks of bytes.
const ADVERSARIAL: &str =
    "drop=0.01,flip=1e-4,dup=0.02,reorder=0.02,truncate=0.01,delay=2ms,stall=700ms@1s";

fn small_rig() -> Rig {
    let settings = gear::gantry();
    let (stream, _) = lay_segments(&gear::route(300.0), &settings).unwrap();
    Rig::new(stream, settings)
}

#[test]
fn a_host_that_restarts_goes_on_with_its_job() {
    let rig = small_rig();
    let clean = &rig.clean.simulation.figures;
    let mut same_steps = 0;
    for seed in 0..seeds() {
        let mut restarts_us: Vec<u64> = (0..3)
            .map(|i| 400_000 + (seed * 37 + i * 1000) * 1000)
            .collect();
        let simulation = simulator(&rig, ADVERSARIAL, seed)
            .run_disturbed(|simulator| {
                if restarts_us
                    .first()
                    .is_some_and(|&at| simulator.now_us() >= at)
                {
                    restarts_us.remove(0);
                    // Dead for up to three seconds; the queue holds two.
                    simulator.restart_host(seed * 170_000 % 3_000_000);
                }
            })
            .unwrap();
        let figures = &simulation.figures;
        assert_eq!(figures.faults, 0, "seed {seed}: {:?}", simulation.fault);
        assert_eq!(figures.final_counts, clean.final_counts, "seed {seed}");
        if figures.underruns == 0 {
            assert_eq!(figures.step_digest, clean.step_digest, "seed {seed}");
            same_steps += 1;
        }
    }
    assert!(same_steps > 0);
}

#[test]
fn a_controller_that_restarts_is_never_fed_as_if_nothing_had_happened() {
    let rig = small_rig();
    for seed in 0..seeds() {
        // Within the job, whatever the number of seeds.
        let restart_us = 700_000 + seed * 211_000 % 4_000_000;
        let mut restarted_at_steps = None;
        let mut steps = 0;
        let result = simulator(&rig, ADVERSARIAL, seed).run_disturbed(|simulator| {
            steps = simulator.record().steps.len();
            if restarted_at_steps.is_none() && simulator.now_us() >= restart_us {
                simulator.restart_controller().unwrap();
                restarted_at_steps = Some(steps);
            }
            // Not one step comes from the new start.
            assert!(
                restarted_at_steps.is_none_or(|before| before == steps),
                "seed {seed}"
            );
        });
        let error = result
            .err()
            .unwrap_or_else(|| panic!("seed {seed}: not noticed"));
        assert!(
            matches!(
                error,
                SimulatorError::Sender(
                    SenderError::DeviceRestarted { .. } | SenderError::StreamLost { .. }
                )
            ),
            "seed {seed}: {error}"
        );
    }
}
