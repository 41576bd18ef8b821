//! Passes -> passes between whose parts the nozzle turns back, where they turn further than it may between its stops.
//!
//! In: passes (mm, rad), the stops and the aperture's symmetry. Out: the passes, cut at as few control points as the stops
//! allow ([`crate::plan::headings::stops`]), at corners and away from the ends where that is as good. A pass in which a
//! heading fits nowhere is left as it is: the check of the joints' ranges names the place.

use crate::plan::headings::stops::{Stops, cheapest_cuts};
use crate::plan::route::curve_cuts::CutPasses;
use crate::plan::route::moves::{PathCurve, tip, ways_mm};
use crate::plan::route::waypoint_curve::WaypointPasses;
use crate::settings::Settings;
use headway_protocol::units::{CHANNEL_HEADING, CHANNELS};

/// Costs are whole numbers of this share of what a cut on a straight line costs.
const COST_STEPS: f64 = 1000.0;

/// The passes, of which those that `may_turn` are cut, with some room before each stop; `None` where none is.
pub fn turned_back(
    passes: &[Vec<PathCurve>],
    may_turn: impl Fn(usize) -> bool,
    room_rad: f64,
    settings: &Settings,
) -> Option<CutPasses> {
    let stops = Stops::of(settings);
    let cuts_of = |(number, pass): (usize, &Vec<PathCurve>)| match may_turn(number) {
        true => cuts(pass, &stops, room_rad, settings),
        false => Vec::new(),
    };
    let places: Vec<Vec<usize>> = passes.iter().enumerate().map(cuts_of).collect();
    if places.iter().all(Vec::is_empty) {
        return None;
    }
    let mut cut = CutPasses::default();
    let mut number = 0;
    for (pass, places) in passes.iter().zip(&places) {
        cut.passes.push(Vec::new());
        let mut before = 0;
        for (index, curve) in pass.iter().enumerate() {
            let own = before..before + curve.control.len();
            let within = places.iter().filter(|place| own.contains(place));
            let within: Vec<usize> = within.map(|place| place - before).collect();
            let ends = [index == 0, index + 1 == pass.len()];
            cut.add(curve, number, ends, &within, |part| part);
            before = own.end;
            number += 1;
        }
    }
    Some(cut)
}

/// Cuts the passes of a run that do not keep their headings; returns at how many places. Where it is cut a pass has the
/// machine's prime and retract.
pub fn turn_back(of_run: &mut WaypointPasses, room_rad: f64, settings: &Settings) -> usize {
    let asked = &of_run.asked;
    let keeps = |pass: usize| asked.get(pass).is_some_and(|asked| asked.keeps_heading);
    let Some(cut) = turned_back(&of_run.passes, |pass| !keeps(pass), room_rad, settings) else {
        return 0;
    };
    let CutPasses { passes, cuts } = cut;
    of_run.asked = cuts.of_passes(asked);
    for &pass in &cuts.goes_on {
        of_run.asked[pass - 1].pushes_mm3[1] = None;
        of_run.asked[pass].pushes_mm3[0] = None;
    }
    of_run.speeds_mm_s = cuts.speeds(&of_run.speeds_mm_s);
    of_run.passes = passes;
    cuts.goes_on.len()
}

/// Where a pass is cut, of its curves' control points one after another.
fn cuts(pass: &[PathCurve], stops: &Stops, room_rad: f64, settings: &Settings) -> Vec<usize> {
    let control = || pass.iter().flat_map(|curve| &curve.control);
    let headings = || control().map(|point| point[CHANNEL_HEADING]);
    if stops.headings_fit(headings(), room_rad) {
        return Vec::new();
    }
    // Curves stay within the range of their control points.
    let Some(fits_from) = stops.fits_from(&headings().collect::<Vec<_>>(), room_rad) else {
        return Vec::new();
    };
    let points: Vec<[f64; CHANNELS]> = control().copied().collect();
    let along_mm = ways_mm(&points);
    let length_mm = along_mm.last().copied().unwrap_or_default();
    let short_mm = 2.0 * settings.aperture.major_mm();
    cheapest_cuts(&fits_from, |k| {
        let Some(next) = points.get(k + 1) else {
            return 0;
        };
        let [comes, leaves] = [
            tip(&points[k]) - tip(&points[k - 1]),
            tip(next) - tip(&points[k]),
        ];
        let sizes = comes.norm() * leaves.norm();
        // At the end of a curve the head rests, and it turns there in place.
        let cos = if sizes > 0.0 {
            comes.dot(&leaves) / sizes
        } else {
            -1.0
        };
        // A part that is shorter than the nozzle is wide is the last resort.
        let is_short = along_mm[k].min(length_mm - along_mm[k]) < short_mm;
        (COST_STEPS * (0.5 * (1.0 + cos) + if is_short { 2.0 } else { 0.0 })) as i64
    })
}
