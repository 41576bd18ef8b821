//! Host, link and firmware on a virtual clock, with faults drawn from a seed.

use headway::drive::dry_run::{DryRun, dry_run};
use headway::drive::link::{LinkSpec, Outage};
use headway::drive::simulator::SimulatorSetup;
use headway::job::SegmentStream;
use headway::settings::Settings;
use headway_protocol::segment::FlowAction;
use headway_protocol::units::CHANNEL_VOLUME;
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
    pub clean: DryRun,
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
    pub fn run(&self, setup: &SimulatorSetup) -> DryRun {
        run(&self.stream, &self.settings, setup)
    }

    /// Issue 4, point 1: without a hold the same steps to the tick; with one every pose on the same
    /// path within the clean run's error and one step, the same counts, and a volume that differs
    /// by no more than the holds' own retracts and primes. Returns what the run met.
    pub fn check(&self, setup: &SimulatorSetup) -> Met {
        let seed = setup.seed;
        let noisy = self.run(setup);
        let (figures, clean) = (&noisy.simulation.figures, &self.clean.simulation.figures);
        let place = format!("seed {seed}, line {:?}", setup.link);
        assert_eq!(figures.faults, 0, "{place}: {:?}", noisy.simulation.fault);
        assert_eq!(figures.final_counts, clean.final_counts, "{place}");
        let met = Met {
            underruns: figures.underruns,
            holds: figures.holds,
            resent_frames: figures.resent_frames,
        };
        if figures.underruns == 0 {
            assert_eq!(figures.step_digest, clean.step_digest, "{place}");
            return met;
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
        assert!(
            trace.axis_error_mrad_max <= clean_trace.axis_error_mrad_max + one_step_mrad,
            "{place}: {trace:?}"
        );
        // Net, the extruder ends on the same step. Forward and back, it may go farther by what the
        // holds pull back and push, and by the pressure that each slowing takes off and puts on.
        let extra_steps = self.extruder_steps(&noisy) - self.extruder_steps(&self.clean);
        let extruder = &self.settings.machine.extruder;
        let hold_mm3 = 2.0 * self.prime_mm3();
        let advance_mm3 = 2.0 * extruder.pressure_advance_s * self.flow_max_mm3_s();
        let most_mm3 = figures.holds as f64 * hold_mm3 + figures.underruns as f64 * advance_mm3;
        // Two steps for the rounding of each event.
        let most = most_mm3 * extruder.steps_per_mm3 + 2.0 * figures.holds as f64;
        assert!(
            (0.0..=most).contains(&extra_steps),
            "{place}: {extra_steps} extruder steps more, {} holds account for {most}",
            figures.holds
        );
        met
    }
}

/// What a run over a faulty line met.
#[derive(Clone, Copy, Debug, Default)]
pub struct Met {
    /// How often the queue ran dry.
    pub underruns: u64,
    /// How often the head came to rest in the middle of a move.
    pub holds: u64,
    /// Stream frames sent again.
    pub resent_frames: u64,
}

impl Rig {
    /// The largest prime of the job: what a hold pulls back and pushes again.
    fn prime_mm3(&self) -> f64 {
        let per_mm3 = self.stream.units.per_natural(CHANNEL_VOLUME);
        let primes = self.stream.events.iter();
        primes
            .filter(|event| event.action == FlowAction::Prime)
            .map(|event| f64::from(event.volume_units) / per_mm3)
            .fold(0.0, f64::max)
    }

    /// Fastest deposit of the job's spans.
    fn flow_max_mm3_s(&self) -> f64 {
        let servo_hz = f64::from(self.settings.machine.servo_hz);
        self.stream
            .spans()
            .map(|span| span.velocity(0.5 * f64::from(span.duration_ticks), servo_hz))
            .map(|rate| rate[CHANNEL_VOLUME])
            .fold(0.0, f64::max)
    }

    /// Steps of the extruder, forward and back.
    fn extruder_steps(&self, dry_run: &DryRun) -> f64 {
        let extruder = self.settings.machine.joints.len() as u8;
        let steps = dry_run.simulation.motion.steps.iter();
        steps.filter(|step| step.motor == extruder).count() as f64
    }
}

fn run(stream: &SegmentStream, settings: &Settings, setup: &SimulatorSetup) -> DryRun {
    match dry_run(stream, settings, setup, |_| {}) {
        Ok(dry_run) => dry_run,
        Err(error) => panic!("seed {}, line {:?}: {error}", setup.seed, setup.link),
    }
}
