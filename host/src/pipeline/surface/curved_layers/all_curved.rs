//! The layers of a part that are all curved.
//!
//! In: the mesh, which stands on z = 0 (mm), the smooth tops of its pieces. Out: layers upwards, layer n where the field
//! ([`super::field`]) has n; or why not, where it cannot keep layers between half and one and a half times as thick, or
//! gentle enough.

use super::Job;
use super::error::CurvedLayersError;
use super::field::{THICKNESS, thickness};
use super::layer_shape::{Below, LevelSurface, PartLayer, Shape};
use super::sections::sections;
use super::smooth_top::FollowedTop;
use super::stair_error::Bounds;
use crate::mesh::Point3;
use std::sync::Arc;

/// The field's bounds may be missed by this, of the layer height and of the slope.
const THICKNESS_SLACK: f64 = 0.02;
const SLOPE_SLACK: f64 = 1.05;

/// The layers.
pub fn curved_throughout(job: &Job, followed: &[FollowedTop]) -> Vec<PartLayer> {
    let layer_mm = job.layer_mm;
    let mut tops = vec![None; job.grid.z_mm.len()];
    for (number, top) in followed.iter().enumerate() {
        for &cell in &top.piece.cells {
            let at = job.grid.place(cell);
            tops[cell] = Some((number, top.surface.jet(at.x, at.y).z_mm));
        }
    }
    let thick = Arc::new(thickness(job, followed.len(), &tops));
    // As many layers as have their middle in the part, in height above the bed over thickness.
    let height = |p: &Point3| p.z / thick.jet(p.x, p.y).z_mm.max(0.1);
    let cells = (0..job.grid.z_mm.len()).filter(|&cell| !job.grid.z_mm[cell].is_nan());
    let tops = cells.map(|cell| {
        let at = job.grid.place(cell);
        height(&Point3::new(at.x, at.y, job.grid.z_mm[cell]))
    });
    let count = (tops.fold(0.0, f64::max) / layer_mm + 0.5).floor() as u32;
    let middles: Vec<f64> = (0..count)
        .map(|number| layer_mm * (f64::from(number) + 0.5))
        .collect();
    let level = |number: u32| LevelSurface {
        base: Arc::clone(&thick),
        factor: layer_mm * f64::from(number),
        offset_mm: 0.0,
    };
    let sections = sections(&job.mesh, &height, &middles, layer_mm);
    let layers = (1u32..).zip(sections).map(|(number, regions)| PartLayer {
        shape: Shape::Curved {
            top: level(number),
            below: Below::Surface(level(number - 1)),
        },
        regions,
        rank_mm: layer_mm * f64::from(number),
    });
    layers.filter(|layer| !layer.regions.is_empty()).collect()
}

/// Whether the layers keep their bounds.
///
/// # Errors
/// Where they do not.
pub fn check(bounds: &Bounds, slope_max: f64) -> Result<(), CurvedLayersError> {
    let [least, most] = THICKNESS;
    let thickness = [(least - bounds.thickness[0]), (bounds.thickness[1] - most)];
    if let Some(side) = (0..2).find(|&side| thickness[side] > THICKNESS_SLACK) {
        return Err(CurvedLayersError::Thickness {
            at_mm: bounds.thickness_at[side].into(),
            share: bounds.thickness[side],
            least,
            most,
        });
    }
    if bounds.slope > SLOPE_SLACK * slope_max {
        return Err(CurvedLayersError::TooSteep {
            at_mm: bounds.slope_at.into(),
            slope_deg: bounds.slope.atan().to_degrees(),
            most_deg: slope_max.atan().to_degrees(),
        });
    }
    Ok(())
}
