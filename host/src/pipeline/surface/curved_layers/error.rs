//! Why a part is not printed in curved layers: what is wrong, where, and what the user can do.

/// See the head of this file.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CurvedLayersError {
    /// Nothing to gain.
    #[error(
        "--curved-layers: the part has no top that curved layers follow: tops are flat at whole layers, steeper than \
         {slope_max_deg:.1}°, or smaller than {area_min_mm2:.1} mm²; leave --curved-layers out"
    )]
    NoCurvedTop {
        /// Slopes up to this are followed.
        slope_max_deg: f64,
        /// Least area of a top.
        area_min_mm2: f64,
    },
    /// Too low for its skin.
    #[error(
        "--curved-layers skin:{layers}: the top near ({:.2}, {:.2}) mm is {height_mm:.2} mm high, too low for {layers} curved \
         layers: at most skin:{layers_max} fits, or thinner layers (--layer-height)",
        at_mm[0], at_mm[1]
    )]
    TooLow {
        /// Place from above.
        at_mm: [f64; 2],
        /// Its height above the bed.
        height_mm: f64,
        /// Layers that were asked for.
        layers: u32,
        /// Layers that fit.
        layers_max: u32,
    },
    /// An inside that does not hold what is above it.
    #[error(
        "--curved-layers: an infill of {density_pct} % does not hold solid layers above it, and no bridges are made under curved \
         ones: give --infill-density {least_pct:.0} or more"
    )]
    Hollow {
        /// What was asked for.
        density_pct: f64,
        /// What is needed.
        least_pct: f64,
    },
    /// Loops that rise.
    #[error(
        "--curved-layers: layers that follow the top do not rise along a bead: leave --continuous-z out, or --curved-layers"
    )]
    ContinuousZ,
    /// More layers than a job has.
    #[error(
        "--curved-layers: {layers} layers, and a job has at most {most}: use a greater --layer-height"
    )]
    TooManyLayers {
        /// How many there would be.
        layers: f64,
        /// How many there may be.
        most: u32,
    },
}
