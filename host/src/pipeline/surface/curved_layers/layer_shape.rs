//! What one layer of a part is: where its top lies, how thick it is, what of it is printed.
//!
//! In: smooth heights over the plan (mm). Out: heights, slopes and thicknesses at a place. Heights are those above the bed.

use crate::geometry::Point2;
use crate::geometry::polygon::Region;
use crate::geometry::spline_surface::{SplineSurface, SurfaceJet};
use std::sync::Arc;

/// A curved surface of a layer: smooth heights and an offset.
#[derive(Clone, Debug)]
pub struct LevelSurface {
    /// The heights that several layers share.
    pub base: Arc<SplineSurface>,
    /// What is added, mm.
    pub offset_mm: f64,
}

impl LevelSurface {
    /// Height and derivatives.
    pub fn jet(&self, at: Point2) -> SurfaceJet {
        let jet = self.base.jet(at.x, at.y);
        SurfaceJet {
            z_mm: jet.z_mm + self.offset_mm,
            ..jet
        }
    }

    /// Height, mm.
    pub fn z_mm(&self, at: Point2) -> f64 {
        self.jet(at).z_mm
    }
}

/// What lies below a curved layer.
#[derive(Clone, Debug)]
pub enum Below {
    /// Another curved one.
    Surface(LevelSurface),
    /// Flat layers of this height, as many as have their middle below the surface; none below the bed.
    Flat {
        /// The surface.
        surface: LevelSurface,
        /// Height of the flat layers.
        layer_mm: f64,
    },
}

impl Below {
    /// Height of what lies there, mm.
    pub fn z_mm(&self, at: Point2) -> f64 {
        match self {
            Below::Surface(surface) => surface.z_mm(at).max(0.0),
            Below::Flat { surface, layer_mm } => {
                (surface.z_mm(at) / layer_mm + 0.5).floor().max(0.0) * layer_mm
            }
        }
    }
}

/// Where a layer lies.
#[derive(Clone, Debug)]
pub enum Shape {
    /// At one height.
    Flat {
        /// Its top.
        top_mm: f64,
    },
    /// On a curved surface.
    Curved {
        /// Its top.
        top: LevelSurface,
        /// What it is laid on.
        below: Below,
    },
}

/// A layer.
#[derive(Clone, Debug)]
pub struct PartLayer {
    /// Where it lies.
    pub shape: Shape,
    /// What is printed, as seen from above.
    pub regions: Vec<Region>,
    /// Layers are printed by this, upwards: the greatest height of its top, mm.
    pub rank_mm: f64,
}

impl PartLayer {
    /// Height of its top at a place, mm.
    pub fn top_mm(&self, at: Point2) -> f64 {
        match &self.shape {
            Shape::Flat { top_mm } => *top_mm,
            Shape::Curved { top, .. } => top.z_mm(at),
        }
    }

    /// How thick it is at a place, mm; `None` of a flat one, which is a layer height.
    pub fn thickness_mm(&self, at: Point2) -> Option<f64> {
        match &self.shape {
            Shape::Flat { .. } => None,
            Shape::Curved { top, below } => Some(top.z_mm(at) - below.z_mm(at)),
        }
    }

    /// True for a curved one.
    pub fn is_curved(&self) -> bool {
        matches!(self.shape, Shape::Curved { .. })
    }
}
