//! One job simulated and checked: the entry of `simulate` and of the tests.
//!
//! ```text
//! SegmentStream -> WireFrames -> Simulator -> steps -> TraceFigures
//! ```

use crate::drive::plan_curve::stream_ticks;
use crate::drive::simulator::{Simulation, Simulator, SimulatorError, SimulatorSetup};
use crate::drive::trace::{self, TraceFigures};
use crate::job::SegmentStream;
use crate::job::frames::WireFrames;
use crate::settings::Settings;
use crate::text::refusal::Refusal;
use std::time::Instant;
use thiserror::Error;

/// Why a job could not be run dry.
#[derive(Debug, Error)]
pub enum DryRunError {
    /// The stream cannot be packed.
    #[error(transparent)]
    Frames(#[from] Refusal),
    /// The simulation could not be run to its end.
    #[error(transparent)]
    Simulator(#[from] SimulatorError),
}

/// The result.
#[derive(Clone, Debug)]
pub struct DryRun {
    /// Steps, counters, the fault if there was one.
    pub simulation: Simulation,
    /// Steps against the plan.
    pub trace: TraceFigures,
    /// Bytes to the controller for each second of motion.
    pub bytes_per_s: f64,
    /// Seconds of motion for each second of simulation (wall clock; the checks not counted).
    pub realtime_factor: f64,
}

/// Streams the job to the firmware library over the simulated link and checks the result.
/// `progress` is called from time to time with the finished share.
///
/// # Errors
/// [`DryRunError`]; a latched fault is not one, it is in the result.
pub fn dry_run(
    stream: &SegmentStream,
    settings: &Settings,
    setup: &SimulatorSetup,
    progress: impl FnMut(f64),
) -> Result<DryRun, DryRunError> {
    let frames = WireFrames::encode(stream)?;
    let machine = &stream.machine(&settings.machine);
    let begun = Instant::now();
    let simulator = Simulator::new(frames, stream_ticks(&stream.knots), machine, setup)?;
    let simulation = simulator.run(progress)?;
    let wall_s = begun.elapsed().as_secs_f64();
    let motion_s = simulation.figures.motion_s;
    Ok(DryRun {
        trace: trace::compare(stream, machine, &simulation.motion),
        bytes_per_s: simulation.figures.bytes as f64 / motion_s.max(1e-9),
        realtime_factor: motion_s / wall_s.max(1e-9),
        simulation,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drive::test_streams::spiral;

    #[test]
    fn a_dry_run_holds_its_parts() {
        let settings = Settings::default();
        let stream = spiral(2.0);
        let setup = SimulatorSetup::default();
        let dry_run = dry_run(&stream, &settings, &setup, |_| {}).unwrap();
        assert_eq!(dry_run.simulation.figures.faults, 0);
        assert_eq!(dry_run.trace.final_counts, dry_run.trace.expected_counts);
        assert!(dry_run.bytes_per_s > 100.0);
        assert!(dry_run.realtime_factor > 1.0);
    }
}
