//! Host, link and firmware on a virtual clock, with faults drawn from a seed.

use headway::drive::link::{LinkSpec, Outage};
use headway::drive::rehearsal::{Rehearsal, rehearse};
use headway::drive::simulator::SimulatorSetup;
use headway::job::SegmentStream;
use headway::settings::Settings;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// How bad a campaign's line is.
#[derive(Clone, Copy, Debug)]
pub struct FaultRates {
    /// Probability that a frame is lost.
    pub drop_per_frame: f64,
    /// Probability that a bit of a byte flips.
    pub flip_per_byte: f64,
    /// Longest stall; up to one every 10 s, short ones more often.
    pub stall_max_us: u64,
    /// Longest cable pull; there is one every minute.
    pub pull_max_us: u64,
}

/// Issue 4's line: 1 % of frames lost, 10⁻⁴ flips a byte, stalls up to 5 s, a pull every minute.
pub const ISSUE_4: FaultRates = FaultRates {
    drop_per_frame: 0.01,
    flip_per_byte: 1e-4,
    stall_max_us: 5_000_000,
    pull_max_us: 3_000_000,
};

/// A line with faults for a run of about `duration_us`; odd seeds stall as well.
pub fn faulty_line(rates: &FaultRates, seed: u64, baud: u64, duration_us: u64) -> LinkSpec {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let mut spec = LinkSpec {
        drop_per_frame: rates.drop_per_frame,
        flip_per_byte: rates.flip_per_byte,
        delay_us: random.random_range(0..5_000),
        baud,
        ..LinkSpec::default()
    };
    let mut draw = |length_max_us: u64| Outage {
        start_us: random.random_range(0..duration_us.max(1)),
        length_us: (random.random_range(0.0..1.0f64).powi(2) * length_max_us as f64) as u64,
    };
    let stalls = (duration_us.div_ceil(10_000_000)) * (seed % 2);
    spec.stalls = (0..stalls).map(|_| draw(rates.stall_max_us)).collect();
    let pulls = duration_us.div_ceil(60_000_000);
    spec.pulls = (0..pulls).map(|_| draw(rates.pull_max_us)).collect();
    spec
}

/// One job and its clean run.
pub struct Rig {
    /// The job.
    pub stream: SegmentStream,
    /// Its machine.
    pub settings: Settings,
    /// The run over a perfect line.
    pub clean: Rehearsal,
}

impl Rig {
    /// Runs the job once over a perfect line, which must go without a fault.
    pub fn new(stream: SegmentStream, settings: Settings) -> Self {
        let clean = run(&stream, &settings, &SimulatorSetup::default());
        let figures = &clean.simulation.figures;
        assert_eq!(figures.faults, 0, "{:?}", clean.simulation.fault);
        assert_eq!((figures.holds, figures.underruns), (0, 0), "clean run");
        Rig {
            stream,
            settings,
            clean,
        }
    }

    /// Runs it again over another line.
    pub fn run(&self, setup: &SimulatorSetup) -> Rehearsal {
        run(&self.stream, &self.settings, setup)
    }

    /// Issue 4, point 1: without a hold the same steps; with one the same path, counts and volume.
    /// Returns true if the head had to stop.
    pub fn check(&self, setup: &SimulatorSetup) -> bool {
        let seed = setup.seed;
        let noisy = self.run(setup);
        let (figures, clean) = (&noisy.simulation.figures, &self.clean.simulation.figures);
        let place = format!("seed {seed}, line {:?}", setup.link);
        assert_eq!(figures.faults, 0, "{place}: {:?}", noisy.simulation.fault);
        assert_eq!(figures.final_counts, clean.final_counts, "{place}");
        if figures.underruns == 0 {
            assert_eq!(figures.step_digest, clean.step_digest, "{place}");
            return false;
        }
        let (trace, clean_trace) = (&noisy.trace, &self.clean.trace);
        let one_step_um = 2.0 * clean_trace.half_step_um_max;
        let one_step_mrad = 2.0 * clean_trace.half_step_mrad_max;
        assert!(
            trace.tip_error_um_max <= clean_trace.tip_error_um_max + one_step_um,
            "{place}: {trace:?}"
        );
        assert!(
            trace.heading_error_mrad_max <= clean_trace.heading_error_mrad_max + one_step_mrad,
            "{place}: {trace:?}"
        );
        assert!(trace.volume_error_pct < 0.1, "{place}: {trace:?}");
        true
    }
}

fn run(stream: &SegmentStream, settings: &Settings, setup: &SimulatorSetup) -> Rehearsal {
    match rehearse(stream, settings, setup, |_| {}) {
        Ok(rehearsal) => rehearsal,
        Err(error) => panic!("seed {}, line {:?}: {error}", setup.seed, setup.link),
    }
}
