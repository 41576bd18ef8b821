//! A pass in the optimiser, and what that leaves of it as the curve that is printed.
//!
//! In: control points (mm, rad), the walls. Out: the curve inside them, and its poses as placements.

use crate::geometry::plane_curve::{PlaneControl, configuration, curve_at};
use crate::plan::curve::layer_path::whole_inside;
use crate::plan::curve::pushing_inside::{InsideWalls, strayed_spans};
use crate::plan::pass::{LayerPass, Placement};
use headway_optimiser::OptimisedPass;

/// Largest displacement of a curve that is pushed inside, against b: 50 µm for 0.2 mm, which one pose in a
/// thousand needs. A curve farther outside is not a residual of the optimiser.
const MOVED_SHARE: f64 = 0.25;

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

/// The curve where it is inside the walls, or all but; else pushed inside as the curve of any other pass.
pub fn checked(control: &[PlaneControl], inside: &InsideWalls) -> Option<Vec<PlaneControl>> {
    let mut pushed = control.to_vec();
    let far_mm = MOVED_SHARE * inside.aperture.minor_mm();
    let is_inside = |curve: &[PlaneControl]| !inside.cutting_spans(curve).contains(&true);
    let hardly_moved =
        inside.push(&mut pushed) && !strayed_spans(control, &pushed, far_mm).contains(&true);
    let found = match hardly_moved {
        true => Some(pushed),
        false => whole_inside(control, inside),
    };
    found.filter(|curve| is_inside(curve))
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
