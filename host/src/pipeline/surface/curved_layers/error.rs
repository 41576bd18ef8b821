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
    /// The field does not keep its bounds.
    #[error(
        "--curved-layers all: near ({:.2}, {:.2}) mm layers would be {share:.2} times as thick as nominal, beyond {least} to \
         {most}: the part's heights differ too much for one count of layers; use --curved-layers skin",
        at_mm[0], at_mm[1]
    )]
    Thickness {
        /// Place from above.
        at_mm: [f64; 2],
        /// Thickness there.
        share: f64,
        /// Least one.
        least: f64,
        /// Greatest one.
        most: f64,
    },
    /// The field is steeper than the head may tilt.
    #[error(
        "--curved-layers all: near ({:.2}, {:.2}) mm a layer would slope by {slope_deg:.1}°, and {most_deg:.1}° is what \
         this machine's head allows; use --curved-layers skin",
        at_mm[0], at_mm[1]
    )]
    TooSteep {
        /// Place from above.
        at_mm: [f64; 2],
        /// Slope there.
        slope_deg: f64,
        /// What is allowed.
        most_deg: f64,
    },
    /// A sparse inside with layers that are all curved.
    #[error(
        "--curved-layers all prints solid parts: use skin, which may have a sparse inside, or leave --infill-density out"
    )]
    SparseAll,
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
