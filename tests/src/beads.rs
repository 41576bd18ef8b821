//! The beads of an outline as they are laid, before they are ordered, joined and optimised.

use crate::layer_oracle::Rings;
use crate::outlines::region;
use headway::geometry::aperture::Aperture;
use headway::plan::axis::medial_axis::{AxisOptions, MedialAxis};
use headway::plan::axis::pruned_axis::Axis;
use headway::plan::beads::passes::{PassSettings, passes};
use headway::plan::headings::profile::TURN_WEIGHT_MM4;
use headway::plan::outline::contour::{Contour, SIMPLIFY_MM};
use headway::plan::pass::LayerPass;
use headway::settings::HeadingLaw;

/// The contour and its beads, about the contour's local origin.
///
/// # Panics
///
/// Where the rings are no valid region.
pub fn plain_passes(
    rings: &Rings,
    aperture: Aperture,
    one_pass: bool,
) -> (Contour, Vec<LayerPass>) {
    let contour = Contour::of_region(&region(rings), SIMPLIFY_MM).expect("contour");
    let walls = contour.edge_index(aperture.major_mm());
    let axis = MedialAxis::of_edges(&walls, &AxisOptions::default()).expect("axis");
    let settings = PassSettings {
        aperture,
        overlap: 0.0,
        one_pass,
        law: HeadingLaw::Tangent,
        turn_weight_mm4: TURN_WEIGHT_MM4,
    };
    let axis = Axis::of_medial_axis(&axis, &aperture);
    let found = passes(&contour.region, &walls, &axis, &settings);
    (contour, found)
}
