//! Why a plan does not go onto a surface: what is wrong, where, and what the user can do.

use crate::geometry::conformal::FlattenError;
use crate::text::refusal::{Refusal, refusal};

/// Refusals, by what may be tried then.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SurfaceError {
    /// It cannot be flattened, or some of it is far larger then than other: cuts or smaller patches may do.
    #[error(transparent)]
    NotFlat(Refusal),
    /// A smooth chart is off the mesh, bends sharply or folds: smaller patches may do.
    #[error(transparent)]
    TooRough(Refusal),
    /// Nothing else helps.
    #[error(transparent)]
    Refused(#[from] Refusal),
}

/// A place for messages.
pub(super) fn spot(at_mm: [f64; 3]) -> String {
    let [x, y, z] = at_mm;
    format!("({x:.2}, {y:.2}, {z:.2}) mm")
}

/// A part of the plan hangs in the air.
pub(super) fn not_under([x, y]: [f64; 2]) -> SurfaceError {
    SurfaceError::Refused(refusal!(
        "the surface does not lie under the whole plan: nothing of the mesh is at ({x:.2}, {y:.2}) mm; both are \
         taken in the same coordinates: move one of them in its file, or make the outline smaller"
    ))
}

/// Steps and sharp edges: how far a smooth surface is off the mesh, and may be.
pub(super) fn too_rough(off_mm: f64, most_mm: f64, at_mm: [f64; 3]) -> SurfaceError {
    SurfaceError::TooRough(refusal!(
        "a smooth surface is {off_mm:.3} mm off the mesh near {}, more than half a layer ({most_mm:.3} mm): the mesh \
         has a step, a wall or a sharp edge there; keep the outline off it or round it",
        spot(at_mm)
    ))
}

/// The patch cannot be flattened.
pub(super) fn not_flat(problem: FlattenError, at_mm: [f64; 3]) -> SurfaceError {
    SurfaceError::NotFlat(refusal!(
        "{problem}, near {}; cut the surface into smaller patches",
        spot(at_mm)
    ))
}

/// A mesh without a rim, and nothing that says which part of it is meant.
pub(super) fn closed(at_mm: [f64; 3]) -> SurfaceError {
    SurfaceError::Refused(refusal!(
        "the surface near {} is closed: all of it cannot be printed, since no tool reaches what looks down; draw an \
         outline on it, or choose a part with --surface-region (as in normal:120)",
        spot(at_mm)
    ))
}

impl SurfaceError {
    /// Whether smaller patches may have a chart where the whole has none: a chart that ranges far is rough and bent
    /// where it is smallest.
    pub(super) fn may_be_divided(&self) -> bool {
        !matches!(self, SurfaceError::Refused(_))
    }
}
