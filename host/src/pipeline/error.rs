//! Why a target cannot be planned, for every kind of input.

use super::surface::SurfaceError;
use super::surface::curved_layers::CurvedLayersError;
use crate::gcode::GcodeError;
use crate::geometry::Point2;
use crate::plan::axis::medial_axis::MedialAxisError;
use crate::plan::layers::layer_groups::TooLongError;
use crate::plan::motion::best_place::NoPlaceError;
use crate::plan::motion::motion_error::MotionError;
use crate::plan::outline::contour::ContourError;
use crate::plan::progress::Stopped;
use crate::plan::route::lean::LeanError;
use crate::plan::route::travel::TravelError;
use crate::plan::route::waypoint_curve::WaypointCurveError;
use crate::settings::Settings;
use crate::text::refusal::Refusal;

/// Why a target cannot be planned.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// The caller has stopped planning.
    #[error(transparent)]
    Stopped(#[from] Stopped),
    /// The settings are not possible, or the part does not fit on the machine.
    #[error(transparent)]
    Refused(#[from] Refusal),
    /// The outline.
    #[error(transparent)]
    Contour(#[from] ContourError),
    /// The medial axis.
    #[error(transparent)]
    MedialAxis(#[from] MedialAxisError),
    /// A line of G-code that no machine could run in its lifetime.
    #[error(transparent)]
    Gcode(#[from] GcodeError),
    /// No position on the table at which the complete run is reachable.
    #[error(transparent)]
    NoPlace(#[from] NoPlaceError),
    /// The motion exceeds a limit that slowing cannot correct.
    #[error(transparent)]
    Motion(MotionError),
    /// The waypoints have no curve that can be planned.
    #[error(transparent)]
    Waypoints(#[from] WaypointCurveError),
    /// The tool axis cannot tilt as required.
    #[error(transparent)]
    Lean(#[from] LeanError),
    /// The plan does not go onto its surface.
    #[error(transparent)]
    Surface(#[from] SurfaceError),
    /// The part is not printed in curved layers.
    #[error(transparent)]
    CurvedLayers(#[from] CurvedLayersError),
    /// Travel around the keep-outs.
    #[error(transparent)]
    Travel(#[from] TravelError),
    /// More path than a job has.
    #[error(transparent)]
    TooLong(#[from] TooLongError),
    /// Nothing of the target is left.
    #[error("the keep-outs, grown for the nozzle's body, leave no ground to print on: move them")]
    AllKeptOut,
    /// Nothing of a part is left.
    #[error(
        "nothing can be printed: in none of its {left_out} regions does the aperture fit with room \
         to move; use a smaller --aperture or a larger --scale"
    )]
    NoLayerPrintable {
        /// Omitted regions.
        left_out: usize,
    },
    /// Layers of several heights or speeds, where the route cannot be divided between them.
    #[error(
        "this machine's joints wind up and are planned over all layers at once: leave out \
         --layer-heights, --first-layer-height and --first-layer-speed"
    )]
    FirstLayerWinds,
    /// Pieces of a part that want different solutions.
    #[error(
        "the joints cannot stay in one solution over all layers: print them in parts (--layer-range)"
    )]
    AnotherSolution,
    /// What was planned cannot be handed on.
    #[error("{0}")]
    Output(String),
    /// No placement of the aperture is inside, or it has no room to move.
    #[error(
        "nothing can be printed: the widest place, near ({:.3}, {:.3}) mm, is {width_mm:.3} mm \
         wide; nowhere does the aperture of {length_mm:.3} x {needed_mm:.3} mm fit with room to \
         move; use a smaller --aperture or a larger --scale",
        at_mm[0], at_mm[1]
    )]
    NothingPrintable {
        /// Centre of the largest disk.
        at_mm: [f64; 2],
        /// Its diameter.
        width_mm: f64,
        /// The aperture's narrowest width.
        needed_mm: f64,
        /// Its widest one.
        length_mm: f64,
    },
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
    PlanError::NothingPrintable {
        at_mm: [at.x, at.y],
        width_mm: 2.0 * radius_mm,
        needed_mm: 2.0 * settings.aperture.minor_mm(),
        length_mm: 2.0 * settings.aperture.major_mm(),
    }
}
