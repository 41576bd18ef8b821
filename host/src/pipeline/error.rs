//! Why a target cannot be planned, for every kind of input.

use super::surface::SurfaceError;
use crate::geometry::Point2;
use crate::plan::motion::motion_error::MotionError;
use crate::plan::progress::Stopped;
use crate::plan::route::travel::TravelError;
use crate::settings::Settings;
use crate::text::refusal::{Refusal, refusal};

/// Why a target cannot be planned.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// The caller has stopped planning.
    #[error(transparent)]
    Stopped(#[from] Stopped),
    /// What cannot be, or leaves nothing to print.
    #[error(transparent)]
    Refused(#[from] Refusal),
    /// The motion exceeds a limit that slowing cannot correct.
    #[error(transparent)]
    Motion(MotionError),
    /// The plan does not go onto its surface.
    #[error(transparent)]
    Surface(#[from] SurfaceError),
    /// Travel around the keep-outs.
    #[error(transparent)]
    Travel(#[from] TravelError),
    /// What was planned cannot be handed on.
    #[error("{0}")]
    Output(String),
}

impl From<MotionError> for PlanError {
    fn from(error: MotionError) -> PlanError {
        match error {
            MotionError::Stopped(stopped) => PlanError::Stopped(stopped),
            error => PlanError::Motion(error),
        }
    }
}

/// The widest place of all, with its radius, is too narrow.
pub(super) fn nothing_printable(widest: Option<(Point2, f64)>, settings: &Settings) -> PlanError {
    let (at, radius_mm) = widest.unwrap_or((Point2::origin(), 0.0));
    refusal!(
        "nothing can be printed: the widest place, near ({:.3}, {:.3}) mm, is {:.3} mm wide; nowhere does the aperture of \
         {:.3} x {:.3} mm fit with room to move; use a smaller --aperture or a larger --scale",
        at.x,
        at.y,
        2.0 * radius_mm,
        2.0 * settings.aperture.major_mm(),
        2.0 * settings.aperture.minor_mm()
    )
    .into()
}

/// In none of so many regions the aperture fits.
pub(super) fn no_region_printable(left_out: usize) -> PlanError {
    refusal!(
        "nothing can be printed: in none of its {left_out} regions does the aperture fit with room \
         to move; use a smaller --aperture or a larger --scale"
    )
    .into()
}

/// Nothing of the target is left.
pub(super) fn all_kept_out() -> PlanError {
    refusal!("the keep-outs, grown for the nozzle's body, leave no ground to print on: move them")
        .into()
}

/// Pieces of a part want different solutions.
pub(super) fn another_solution() -> PlanError {
    refusal!("the joints cannot stay in one solution over all layers: print them in parts (--layer-range)").into()
}
