//! The position on the table where a run of waypoints is reachable and takes the least time
//! (`--place best`).
//!
//! In: the passes at one place (mm, rad, machine coordinates) and how far they may be moved. Out: their
//! displacement. Positions on an even grid are tried, including the middle; each is followed in every joint
//! solution, as in planning. If none is reachable, rotations of the part are tried, to report one that helps:
//! the user applies it (`--turn`). Not covered: heights, since the part is on the bed.

use crate::geometry::polygon::Box2;
use crate::geometry::{Point2, Vector2};
use crate::plan::motion::motion_error::MotionError;
use crate::plan::motion::singular::{Passes, passed_places};
use crate::settings::Settings;
use crate::text::refusal::{Refusal, refusal};
use headway_protocol::units::{
    CHANNEL_HEADING, CHANNEL_TILT_X, CHANNEL_TILT_Y, CHANNEL_X, CHANNEL_Y, CHANNELS,
};
use nalgebra::Rotation2;
use rayon::prelude::*;

/// Places along x and y.
const PLACES: usize = 7;
/// The same for each turn of the part, and the step of the turns, degrees.
const PLACES_TURNED: usize = 3;
const TURN_DEG: f64 = 45.0;

/// A place that was found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FoundPlace {
    /// From where the passes are, mm.
    pub shift_mm: [f64; 2],
    /// Number of tried positions at which the complete run is reachable.
    pub reached: usize,
    /// Places tried.
    pub tried: usize,
}

fn turn_hint(turn_deg: Option<f64>) -> String {
    match turn_deg {
        Some(degrees) => format!(
            "; it does with the part turned by {degrees:.0}° (--turn {degrees:.0} --place best)"
        ),
        None => format!(", nor with the part turned in steps of {TURN_DEG:.0}°"),
    }
}

/// Tries positions; `room_mm` is the permitted displacement of the passes (x, then y: least, most). If
/// they `may_lift` they may be cut at singular poses.
///
/// # Errors
/// [`Refusal`] if none is reachable.
pub fn best_place(
    passes: &Passes,
    room_mm: [[f64; 2]; 2],
    start: [f64; CHANNELS],
    settings: &Settings,
    may_lift: bool,
) -> Result<FoundPlace, Refusal> {
    let seconds_at = |shift: [f64; 2], turn_rad: f64| {
        let moved = moved(passes, shift, turn_rad);
        passed_places(&moved, start, settings, may_lift).map(|passed| passed.seconds)
    };
    let shifts = shifts(room_mm, PLACES);
    let timed: Vec<Result<f64, MotionError>> = shifts
        .par_iter()
        .map(|&shift| seconds_at(shift, 0.0))
        .collect();
    let reached = timed.iter().filter(|seconds| seconds.is_ok()).count();
    let of_places = shifts.iter().zip(&timed);
    let seconds = of_places.filter_map(|(shift, seconds)| Some((shift, *seconds.as_ref().ok()?)));
    let best = seconds.min_by(|a, b| a.1.total_cmp(&b.1));
    let tried = shifts.len();
    match (best, timed.into_iter().next()) {
        (None, Some(Err(error))) => {
            let fewer = self::shifts(room_mm, PLACES_TURNED);
            let turns = (1..=(180.0 / TURN_DEG) as i32).flat_map(|step| [step, -step]);
            let turn_deg = turns
                .map(|step| TURN_DEG * f64::from(step))
                .find(|turn_deg| {
                    fewer
                        .par_iter()
                        .any(|&shift| seconds_at(shift, turn_deg.to_radians()).is_ok())
                });
            Err(refusal!(
                "the machine reaches the whole run at none of {tried} places on the table{}; where it \
                 would lie: {error}",
                turn_hint(turn_deg)
            ))
        }
        (best, _) => Ok(FoundPlace {
            shift_mm: best.map_or([0.0; 2], |(shift, _)| *shift),
            reached,
            tried,
        }),
    }
}

/// An even grid of positions in each direction, and the middle; the nearest first.
pub fn shifts(room_mm: [[f64; 2]; 2], places: usize) -> Vec<[f64; 2]> {
    let along = |[low, high]: [f64; 2], index: usize| {
        low + (high - low) * index as f64 / (places - 1) as f64
    };
    let places_of = |index: usize| {
        [
            along(room_mm[0], index % places),
            along(room_mm[1], index / places),
        ]
    };
    let mut shifts: Vec<[f64; 2]> = (0..places * places).map(places_of).collect();
    shifts.push([0.0; 2]);
    shifts.sort_by(|a, b| a[0].hypot(a[1]).total_cmp(&b[0].hypot(b[1])));
    shifts.dedup();
    shifts
}

/// The passes at another position, rotated about their middle.
pub fn moved(passes: &Passes, [x, y]: [f64; 2], turn_rad: f64) -> Passes {
    let mut passes = passes.clone();
    let points = || passes.iter().flatten().flat_map(|curve| &curve.control);
    let tips: Vec<Point2> = points()
        .map(|point| Point2::new(point[CHANNEL_X], point[CHANNEL_Y]))
        .collect();
    let box_mm = Box2::of(&tips);
    let middle = nalgebra::center(&box_mm.min, &box_mm.max);
    let turn = Rotation2::new(turn_rad);
    let points = passes.iter_mut().flatten();
    for point in points.flat_map(|curve| &mut curve.control) {
        let from_middle = Vector2::new(point[CHANNEL_X] - middle.x, point[CHANNEL_Y] - middle.y);
        let tip = middle.coords + turn * from_middle + Vector2::new(x, y);
        let tilt = turn * Vector2::new(point[CHANNEL_TILT_X], point[CHANNEL_TILT_Y]);
        (point[CHANNEL_X], point[CHANNEL_Y]) = (tip.x, tip.y);
        (point[CHANNEL_TILT_X], point[CHANNEL_TILT_Y]) = (tilt.x, tilt.y);
        point[CHANNEL_HEADING] += turn_rad;
    }
    passes
}
