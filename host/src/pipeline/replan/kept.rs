//! Runs of beads that stay lines -> passes that follow each other.
//!
//! In: runs of a layer in their order, where the head comes from. Out: [`GcodePass`]es. Where two runs follow each other in the
//! file, the way between them and what is retracted and primed there are the file's; elsewhere the head lifts, and retracts
//! and primes as the machine does.

use super::regions::Run;
use crate::gcode::{GcodePass, Leg, Place, Push};
use crate::settings::Settings;

/// The passes of runs from a tip on (mm, file coordinates); `is_next` where they are next to what comes before and behind.
pub(super) fn joined_runs(
    runs: &[Run],
    from: Option<[f64; 3]>,
    is_next: [bool; 2],
    settings: &Settings,
) -> Vec<GcodePass> {
    let own = Some(Push::default());
    let mut passes: Vec<GcodePass> = Vec::with_capacity(runs.len());
    let mut at = from;
    for (k, run) in runs.iter().enumerate() {
        let follows = match k.checked_sub(1) {
            Some(before) => follows(&runs[before], run),
            None => is_next[0],
        };
        let mut pass = run.pass.clone();
        if !follows {
            pass.prime = own;
            pass.travel = lifted(at, &pass, settings);
            if let Some(before) = passes.last_mut() {
                before.retract = own;
            }
        }
        at = pass.points.last().map(|place| place.tip_mm);
        passes.push(pass);
    }
    if let Some(last) = passes.last_mut().filter(|_| !is_next[1]) {
        last.retract = own;
    }
    passes
}

impl Run {
    /// Adds another run; what lies between them lays nothing.
    pub(super) fn append(&mut self, rest: Run) {
        let (pass, next) = (&mut self.pass, rest.pass);
        let joins = pass.points.last() == next.points.first();
        let between = pass
            .legs
            .last()
            .copied()
            .filter(|_| !joins)
            .map(|last| Leg {
                volume_mm3: Some(0.0),
                ..last
            });
        pass.legs.extend(between.into_iter().chain(next.legs));
        pass.points
            .extend(next.points.into_iter().skip(usize::from(joins)));
        pass.retract = next.retract;
        self.legs[1] = rest.legs[1];
        self.is_whole[1] = rest.is_whole[1];
    }
}

/// True where nothing is between two runs in the file but the way from one to the other.
pub(super) fn follows(before: &Run, run: &Run) -> bool {
    run.number == before.number + 1 && before.is_whole[1] && run.is_whole[0]
}

/// Up, over and down to a pass.
fn lifted(from: Option<[f64; 3]>, pass: &GcodePass, settings: &Settings) -> Vec<Place> {
    let (Some(from), Some(to)) = (from, pass.points.first()) else {
        return Vec::new();
    };
    let above_mm = from[2].max(to.tip_mm[2]) + settings.lift_mm;
    let above = |[x, y, _]: [f64; 3]| Place {
        tip_mm: [x, y, above_mm],
        turn_deg: [0.0; 3],
    };
    vec![above(from), above(to.tip_mm)]
}
