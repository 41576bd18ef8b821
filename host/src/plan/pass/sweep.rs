//! Poses along a path, so dense that their union is what the aperture sweeps.
//!
//! In: placements or configurations in mm and rad. Out: configurations between them. Not covered:
//! the curved edges of a sweep that turns: steps are so small that they do not show in a raster's
//! cell.

use super::LayerPass;
use crate::geometry::aperture::Aperture;
use crate::geometry::clearance::Configuration;
use crate::geometry::coverage::SweptPose;
use crate::geometry::{Point2, Vector2};

/// Step between interpolated poses, mm against the minor semi-axis, where the sharpest end of an
/// ellipse of 3 : 1 leaves a scallop of 1 % of b.
const POSE_STEP: f64 = 1.0 / 6.0;
/// The longest one, where the flank is flatter.
const POSE_STEP_MAX: f64 = 0.5;
/// Largest turn between interpolated poses, rad.
const POSE_TURN_RAD: f64 = 0.05;
/// Most poses inserted between two placements.
const POSES_MAX: usize = 64;

/// Poses between two placements, without both, so dense that their union is the sweep.
pub fn poses_between(
    aperture: &Aperture,
    from: Configuration,
    to: Configuration,
) -> impl Iterator<Item = Configuration> + use<> {
    let turn = turn_to(aperture, from.heading_rad, to.heading_rad);
    let delta = to.center - from.center;
    let step_mm = POSE_STEP * aperture.minor_mm();
    let step_mm = match delta.norm() > step_mm {
        true => step_mm * flatness(aperture, from.heading_rad, delta),
        false => step_mm,
    };
    let pieces = (delta.norm() / step_mm.min(POSE_STEP_MAX * aperture.minor_mm()))
        .max(turn.abs() / POSE_TURN_RAD)
        .ceil()
        .clamp(1.0, POSES_MAX as f64) as usize;
    (1..pieces).map(move |piece| {
        let t = piece as f64 / pieces as f64;
        Configuration {
            center: from.center + delta * t,
            heading_rad: from.heading_rad + turn * t,
        }
    })
}

/// Factor by which a step along `way` may be longer than one with the sharpest end of the aperture at
/// the flank of the bead, for a scallop of the same depth: depth = step² / (8 radius), and the radius of
/// an ellipse where its extent is h is a² b² / h³. At least 1.
pub fn flatness(aperture: &Aperture, heading_rad: f64, way: Vector2) -> f64 {
    let Aperture::Ellipse { major_mm, .. } = aperture else {
        return 1.0;
    };
    let across = Vector2::new(-way.y, way.x) / way.norm().max(f64::MIN_POSITIVE);
    let extent_mm = aperture.extent_mm(heading_rad, across);
    (major_mm / extent_mm.max(f64::MIN_POSITIVE))
        .powf(1.5)
        .max(1.0)
}

/// The turn from one heading to the next: in the shorter direction for a symmetric aperture.
pub fn turn_to(aperture: &Aperture, from_rad: f64, to_rad: f64) -> f64 {
    if aperture.is_round() {
        return 0.0;
    }
    aperture.wrapped_rad(to_rad - from_rad)
}

/// All poses of a pass, dense.
pub fn poses(pass: &LayerPass, aperture: &Aperture) -> impl Iterator<Item = Configuration> {
    let closing = pass.placements.first().filter(|_| pass.closed);
    swept(
        pass.placements.iter().chain(closing).map(|p| p.at),
        aperture,
    )
}

/// All poses of several passes, dense.
pub fn swept_poses(passes: &[LayerPass], aperture: &Aperture) -> Vec<SweptPose> {
    let mut swept = Vec::new();
    for (number, pass) in passes.iter().enumerate() {
        let (mut path_mm, mut last) = (0.0, None);
        for at in poses(pass, aperture) {
            path_mm += last.map_or(0.0, |last: Point2| (at.center - last).norm());
            last = Some(at.center);
            swept.push(SweptPose {
                at,
                pass: number as u32,
                path_mm,
            });
        }
    }
    swept
}

/// The poses along a path, dense.
pub fn swept(
    way: impl Iterator<Item = Configuration>,
    aperture: &Aperture,
) -> impl Iterator<Item = Configuration> {
    let mut last: Option<Configuration> = None;
    way.flat_map(move |at| {
        let between = last
            .replace(at)
            .map(|last| poses_between(aperture, last, at));
        between.into_iter().flatten().chain([at])
    })
}
