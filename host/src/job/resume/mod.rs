//! Resumes a job after a power failure, from the start of the pass that was being printed.
//!
//! ```text
//! log --last_stream--> LoggedStream --Reached::of--> ticks of the job that are done, and sent
//!                                          '--pass--> the pass that is not whole
//! SegmentStream, heat, pass --rest_of--> Rest, from that pass on
//!                              '--approach--> up, across above what is printed, down to its start
//!                              '--Parts--> what is left out, printed again, to come (mm, s)
//! ```
//! The complete pass is printed again: within a pass the head would have to accelerate on a curve that was
//! planned at speed, and how much was deposited just before the failure is unknown. Not covered: boards and
//! files.

pub mod approach;
mod reached;
pub mod rest;

use crate::text::refusal::Refusal;
pub use reached::{LoggedStream, Reached};

use crate::job::SegmentStream;
use crate::job::heat::HeatEvent;
use crate::settings::Settings;
use approach::{Approach, approach};
use headway_firmware::configuration::MachineConfiguration;
use rest::{Printed, Rest, check_flat, printed_between, printed_top_mm, rest_of};

/// Layer height of a job that does not contain its own, mm.
const LAYER_MM: f64 = 0.2;

/// The data needed to begin again.
#[derive(Clone, Debug, PartialEq)]
pub struct Resumption {
    /// The rest of the job.
    pub rest: Rest,
    /// The approach to its start.
    pub way: Approach,
    /// Amounts of its parts.
    pub parts: Parts,
}

/// Amounts of a job that are omitted, printed again, and remaining.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Parts {
    /// Before the pass.
    pub left_out: Printed,
    /// From the pass's start to the board's last reported position.
    pub again: Printed,
    /// From there to the end of the sent frames.
    pub perhaps_again: Printed,
    /// From the pass's start on.
    pub to_come: Printed,
}

/// A job from a pass on, and the approach to it. `reached` is the progress from a log; without one the pass's
/// complete layer is assumed to exist.
///
/// # Errors
/// [`Refusal`].
pub fn resume(
    stream: &SegmentStream,
    heat: &[HeatEvent],
    pass: u32,
    reached: Option<Reached>,
    settings: Option<&Settings>,
    machine: &MachineConfiguration,
) -> Result<Resumption, Refusal> {
    let layer_mm = settings.map_or(LAYER_MM, |settings| settings.layer_height_mm);
    check_flat(stream, pass, layer_mm)?;
    let rest = rest_of(stream, heat, pass)?;
    let of_layer = || Reached {
        done_tick: rest.cut_tick,
        sent_tick: stream.ticks_of_layer(rest.layer)[1],
    };
    let is_known = reached.is_some();
    let reached = reached.unwrap_or_else(of_layer);
    let done_tick = reached.done_tick.max(rest.cut_tick);
    let there_tick = reached.sent_tick.max(done_tick);
    let way = approach(
        rest.stream.units.to_base(&rest.stream.start),
        printed_top_mm(stream, there_tick).unwrap_or(f64::NEG_INFINITY),
        settings.map_or(0.0, |settings| settings.lift_mm),
        machine,
    )?;
    let between = |from, to| printed_between(stream, [from, to], f64::from(machine.servo_hz));
    let sent_tick = if is_known { there_tick } else { done_tick };
    let parts = Parts {
        left_out: between(0, rest.cut_tick),
        again: between(rest.cut_tick, done_tick),
        perhaps_again: between(done_tick, sent_tick),
        to_come: between(rest.cut_tick, u64::MAX),
    };
    Ok(Resumption { rest, way, parts })
}

#[cfg(test)]
mod tests;
