//! Goal: the pair of state machines, host and controller, keeps its promise on any line: every
//! segment once and in order, or an error, and never a wait without end. Method: proptest draws
//! the line's faults (loss, duplication, reordering, flips, truncation, delay, stalls, pulls) and
//! resets of either side; both run on one virtual clock, for a bounded time. `HEADWAY_SEEDS` sets
//! the number of cases.

use headway::drive::link::{LinkSpec, Outage};
use headway::drive::plan_curve::stream_ticks;
use headway::drive::sender_state::SenderError;
use headway::drive::simulator::{SimulationFigures, Simulator, SimulatorError, SimulatorSetup};
use headway::job::SegmentStream;
use headway::job::frames::WireFrames;
use headway::plan::motion::segments::lay_segments;
use headway::settings::Settings;
use headway_tests::gear;
use proptest::prelude::*;
use std::cell::Cell;

/// Longest that a run may take, virtual time: the job's seconds, all outages, deaths and retries.
const BOUND_US: u64 = 180_000_000;

/// `HEADWAY_SEEDS` (default 6) times 25.
fn cases() -> u32 {
    let runs = std::env::var("HEADWAY_SEEDS").ok();
    runs.and_then(|text| text.parse().ok()).unwrap_or(6) * 25
}

#[derive(Clone, Debug)]
struct Case {
    link: LinkSpec,
    seed: u64,
    /// When the host dies, and for how long.
    host_deaths_us: Vec<(u64, u64)>,
    controller_reset_us: Option<u64>,
}

fn outage(length_max_us: u64) -> impl Strategy<Value = Outage> {
    (0..6_000_000u64, 0..length_max_us).prop_map(|(start_us, length_us)| Outage {
        start_us,
        length_us,
    })
}

fn line() -> impl Strategy<Value = LinkSpec> {
    let rates = (
        0.0..0.1f64,
        0.0..1e-3f64,
        0.0..0.1f64,
        0.0..0.1f64,
        0.0..0.05f64,
    );
    let outages = (
        prop::collection::vec(outage(3_000_000), 0..3),
        prop::collection::vec(outage(2_000_000), 0..3),
    );
    let baud = prop::sample::select(vec![57_600, 115_200, 1_000_000]);
    (rates, outages, 0..20_000u64, baud).prop_map(|(rates, (stalls, pulls), delay_us, baud)| {
        LinkSpec {
            drop_per_frame: rates.0,
            flip_per_byte: rates.1,
            dup_per_frame: rates.2,
            reorder_per_frame: rates.3,
            truncate_per_frame: rates.4,
            delay_us,
            stalls,
            pulls,
            baud,
        }
    })
}

fn case() -> impl Strategy<Value = Case> {
    let deaths = prop::collection::vec((50_000..5_000_000u64, 0..2_000_000u64), 0..3);
    let reset = prop::option::weighted(0.25, 50_000..3_000_000u64);
    (line(), 0..1_000_000u64, deaths, reset).prop_map(|(link, seed, mut deaths, reset)| {
        deaths.sort_unstable();
        Case {
            link,
            seed,
            host_deaths_us: deaths,
            controller_reset_us: reset,
        }
    })
}

struct Job {
    stream: SegmentStream,
    settings: Settings,
    clean: SimulationFigures,
}

impl Job {
    fn new() -> Job {
        let settings = gear::gantry();
        let (stream, _) = lay_segments(&gear::route(120.0), &settings).unwrap();
        let mut job = Job {
            stream,
            settings,
            clean: SimulationFigures::default(),
        };
        let clean = job.simulator(&LinkSpec::default(), 1).run(|_| {}).unwrap();
        job.clean = clean.figures;
        job
    }

    fn simulator(&self, link: &LinkSpec, seed: u64) -> Simulator {
        let frames = WireFrames::encode(&self.stream).unwrap();
        let setup = SimulatorSetup {
            link: link.clone(),
            seed,
            ..SimulatorSetup::default()
        };
        let ticks = stream_ticks(&self.stream.knots);
        Simulator::new(frames, ticks, &self.settings.machine, &setup).unwrap()
    }
}

/// Runs a case; the figures and whether the controller was reset before the end.
fn run(job: &Job, case: &Case) -> (Result<SimulationFigures, SimulatorError>, bool) {
    let mut deaths = case.host_deaths_us.clone();
    let mut reset_us = case.controller_reset_us;
    let reset = Cell::new(false);
    let result = job
        .simulator(&case.link, case.seed)
        .run_disturbed(|simulator| {
            let now_us = simulator.now_us();
            assert!(now_us < BOUND_US, "no end: {case:?}");
            if deaths.first().is_some_and(|death| now_us >= death.0) {
                simulator.restart_host(deaths.remove(0).1);
            }
            if reset_us.is_some_and(|at_us| now_us >= at_us) {
                reset_us = None;
                reset.set(true);
                simulator.restart_controller().unwrap();
            }
        });
    (result.map(|simulation| simulation.figures), reset.get())
}

#[test]
fn every_segment_once_and_in_order_or_an_error_and_always_an_end() {
    let job = Job::new();
    let (resent, dry, resets) = (Cell::new(0u64), Cell::new(0u64), Cell::new(0u64));
    let config = ProptestConfig {
        cases: cases(),
        failure_persistence: None,
        ..ProptestConfig::default()
    };
    proptest!(config, |(case in case())| {
        let (result, reset) = run(&job, &case);
        match result {
            Ok(figures) => {
                prop_assert_eq!(figures.faults, 0);
                resent.set(resent.get() + figures.resent_frames);
                dry.set(dry.get() + u64::from(figures.underruns > 0));
                if !reset {
                    prop_assert_eq!(&figures.final_counts, &job.clean.final_counts);
                    if figures.underruns == 0 {
                        prop_assert_eq!(&figures.step_digest, &job.clean.step_digest);
                    }
                }
            }
            Err(error) => {
                resets.set(resets.get() + 1);
                let noticed = matches!(
                    error,
                    SimulatorError::Sender(
                        SenderError::DeviceRestarted { .. }
                            | SenderError::StreamLost { .. }
                    )
                );
                prop_assert!(reset && noticed, "{}", error);
            }
        }
    });
    println!(
        "{} frames again, {} dry runs, {} resets",
        resent.get(),
        dry.get(),
        resets.get()
    );
    // The lines were bad, queues ran dry, and controllers did forget.
    assert!(resent.get() > 100 && dry.get() > 0 && resets.get() > 0);
}
