//! What the optimiser leaves of a pass as the curve that is printed.
//!
//! In: control points (mm, rad), the walls. Out: the curve inside them, and its poses as placements.

use crate::geometry::plane_curve::{PlaneControl, configuration, curve_at};
use crate::plan::curve::layer_path::whole_inside;
use crate::plan::curve::pushing_inside::{InsideWalls, strayed_spans};
use crate::plan::pass::Placement;

/// Largest displacement of a curve that is pushed inside, against b: 50 µm for 0.2 mm, which one pose in a
/// thousand needs. A curve farther outside is not a residual of the optimiser.
const MOVED_SHARE: f64 = 0.25;

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
