//! A pass in the optimiser, and what that leaves of it as the curve that is printed.
//!
//! In: control points (mm, rad). Out: the poses of their curve as placements.

use crate::geometry::plane_curve::{PlaneControl, configuration, curve_at};
use crate::plan::pass::{LayerPass, Placement};
use headway_optimiser::OptimisedPass;

/// A pass in the optimiser.
#[derive(Clone, Debug)]
pub struct Begun {
    /// Its control points and pace.
    pub unknown: OptimisedPass,
    /// For each control point the placement that it came from.
    pub numbers: Vec<usize>,
}

impl Begun {
    /// Leaves these control points, each a placement of its own.
    pub fn keep(&mut self, kept: &[usize]) {
        let unknown = &mut self.unknown;
        unknown.control = kept.iter().map(|&i| unknown.control[i]).collect();
        unknown.log_pace = kept.iter().map(|&i| unknown.log_pace[i]).collect();
        self.numbers = (0..kept.len()).collect();
    }
}

/// The placements of the passes become poses of their optimised curves.
pub fn take(passes: &mut [LayerPass], begun: &mut [Begun]) {
    for (pass, begun) in passes.iter_mut().zip(begun) {
        let (control, numbers) = (&begun.unknown.control, &begun.numbers);
        pass.placements = placements_on(control, |i| pass.placements[numbers[i]]);
        begun.numbers = (0..pass.placements.len()).collect();
    }
}

/// The poses of a curve where its spans meet, each with the contact of the placement that `begun` has.
pub fn placements_on(
    control: &[PlaneControl],
    begun: impl Fn(usize) -> Placement,
) -> Vec<Placement> {
    let last = control.len() - 1;
    (0..=last)
        .map(|i| {
            let at = match i {
                i if i == last => control[last],
                i => curve_at(control, i, 0.0),
            };
            Placement {
                at: configuration(at),
                feasible: true,
                ..begun(i)
            }
        })
        .collect()
}
