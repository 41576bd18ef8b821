//! Where on the table a run is reached and takes least time (`--place best`).
//!
//! In: the passes at one place (mm, rad, machine coordinates) and how far they may be moved. Out: by how
//! much they are moved. Places on an even grid are tried, the one in the middle among them; each is
//! followed in every joint solution, as planning follows it. Leaves out turning the part, which the user
//! does, and heights: the part stands on the bed.

use crate::plan::motion::joint_limits::MotionError;
use crate::plan::motion::singular::{Passes, passed_route};
use crate::settings::Settings;
use headway_protocol::units::{CHANNEL_X, CHANNEL_Y, CHANNELS};
use rayon::prelude::*;

/// Places along x and y, odd: the middle is one.
const PLACES: usize = 7;

/// A place that was found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FoundPlace {
    /// From where the passes are, mm.
    pub shift_mm: [f64; 2],
    /// Places at which the whole run is reached, of those tried.
    pub reached: usize,
    /// Places tried.
    pub tried: usize,
}

/// Looks at places; `room_mm` is how far the passes may be moved each way (x, then y: least, most).
///
/// # Errors
/// [`MotionError`] of the place nearest to where the passes are, if none is reached.
pub fn best_place(
    passes: &Passes,
    room_mm: [[f64; 2]; 2],
    start: [f64; CHANNELS],
    settings: &Settings,
) -> Result<FoundPlace, MotionError> {
    let along = |[low, high]: [f64; 2], index: usize| {
        low + (high - low) * index as f64 / (PLACES - 1) as f64
    };
    let mut shifts: Vec<[f64; 2]> = (0..PLACES * PLACES)
        .map(|index| {
            [
                along(room_mm[0], index % PLACES),
                along(room_mm[1], index / PLACES),
            ]
        })
        .collect();
    shifts.push([0.0; 2]);
    shifts.sort_by(|a, b| a[0].hypot(a[1]).total_cmp(&b[0].hypot(b[1])));
    shifts.dedup();
    let timed: Vec<Result<f64, MotionError>> = shifts
        .par_iter()
        .map(|shift| {
            let moved = moved(passes, *shift);
            passed_route(&moved, start, settings).map(|passed| passed.seconds)
        })
        .collect();
    let reached = timed.iter().filter(|seconds| seconds.is_ok()).count();
    let of_places = shifts.iter().zip(&timed);
    let seconds = of_places.filter_map(|(shift, seconds)| Some((shift, *seconds.as_ref().ok()?)));
    let best = seconds.min_by(|a, b| a.1.total_cmp(&b.1));
    match (best, timed.into_iter().next()) {
        (Some((&shift_mm, _)), _) => Ok(FoundPlace {
            shift_mm,
            reached,
            tried: shifts.len(),
        }),
        (None, Some(Err(error))) => Err(error),
        (None, _) => Ok(FoundPlace {
            shift_mm: [0.0; 2],
            reached,
            tried: shifts.len(),
        }),
    }
}

/// The passes at another place.
pub fn moved(passes: &Passes, [x, y]: [f64; 2]) -> Passes {
    let mut passes = passes.clone();
    for point in passes
        .iter_mut()
        .flatten()
        .flat_map(|curve| &mut curve.control)
    {
        point[CHANNEL_X] += x;
        point[CHANNEL_Y] += y;
    }
    passes
}
