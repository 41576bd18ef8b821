//! Options of how runs of waypoints are taken: gaps between passes, rounded corners, the place on the table.
//!
//! In: what was given, `None` where the machine's stays. Out: settings, or why not, with the option.

use super::{Place, Settings};

/// Options of runs of waypoints.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct RunOptions {
    /// Waypoints further apart end a pass, mm.
    pub gap_mm: Option<f64>,
    /// How far corners may be rounded, mm.
    pub corner_tolerance_mm: Option<f64>,
    /// Where the run lies.
    pub place: Option<Place>,
}

/// An option that cannot be used.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub(crate) enum RunOptionsError {
    /// The gap is no length.
    #[error("--gap {gap_mm}: write a length in mm above 0, as in --gap 5")]
    Gap {
        /// What was given.
        gap_mm: f64,
    },
    /// Corners cannot be rounded so far.
    #[error(
        "--corner-tolerance {corner_mm}: write a length in mm from 0, which leaves corners as they are, to \
         {widest_mm}, the widest bead of this aperture; 0.2 is usual"
    )]
    Corner {
        /// What was given.
        corner_mm: f64,
        /// The most.
        widest_mm: f64,
    },
}

impl RunOptions {
    /// The settings with these options.
    ///
    /// # Errors
    /// [`RunOptionsError`].
    pub(crate) fn over(&self, mut settings: Settings) -> Result<Settings, RunOptionsError> {
        if let Some(gap_mm) = self.gap_mm {
            if !(gap_mm > 0.0 && gap_mm.is_finite()) {
                return Err(RunOptionsError::Gap { gap_mm });
            }
            settings.gap_mm = Some(gap_mm);
        }
        if let Some(corner_mm) = self.corner_tolerance_mm {
            let widest_mm = 2.0 * settings.aperture.major_mm();
            if !(0.0..=widest_mm).contains(&corner_mm) {
                return Err(RunOptionsError::Corner {
                    corner_mm,
                    widest_mm,
                });
            }
            settings.tolerances.corner_mm = corner_mm;
        }
        settings.place = self.place.unwrap_or(settings.place);
        Ok(settings)
    }
}
