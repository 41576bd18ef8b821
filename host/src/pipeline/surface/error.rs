//! Why a plan does not go onto a surface: what is wrong, where, and what the user can do.

use crate::geometry::conformal::FlattenError;
use crate::mesh::patch::NotManifold;
use crate::plan::judge::touches::HeadPart;
use crate::plan::route::surface::LayerFoldsError;

/// See the head of this file.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SurfaceError {
    /// A part of the plan hangs in the air.
    #[error(
        "the surface does not lie under the whole plan: nothing of the mesh is at ({:.2}, {:.2}) mm; both are \
         taken in the same coordinates: move one of them in its file, or make the outline smaller",
        at_mm[0], at_mm[1]
    )]
    NotUnder {
        /// Place in the plan.
        at_mm: [f64; 2],
    },
    /// Steps and sharp edges.
    #[error(
        "a smooth surface is {off_mm:.3} mm off the mesh near ({:.2}, {:.2}, {:.2}) mm, more than half a layer \
         ({most_mm:.3} mm): the mesh has a step, a wall or a sharp edge there; keep the outline off it or \
         round it",
        at_mm[0], at_mm[1], at_mm[2]
    )]
    TooRough {
        /// How far it is off.
        off_mm: f64,
        /// How far it may be.
        most_mm: f64,
        /// Place on the mesh.
        at_mm: [f64; 3],
    },
    /// A bend so sharp that a flat nozzle does not lie on it.
    #[error(
        "the surface bends with a radius of {radius_mm:.2} mm near ({:.2}, {:.2}, {:.2}) mm: the ends of a flat \
         nozzle are {off_mm:.2} mm off it there, more than half a layer; keep the outline off the edge, round it, \
         or use a smaller --aperture",
        at_mm[0], at_mm[1], at_mm[2]
    )]
    BendsTooSharply {
        /// Of the smooth surface.
        radius_mm: f64,
        /// How far the nozzle's ends are off it.
        off_mm: f64,
        /// Place on the surface.
        at_mm: [f64; 3],
    },
    /// The machine cannot tilt its head.
    #[error(
        "the surface slopes by {slope_deg:.1}° near ({:.2}, {:.2}, {:.2}) mm, and this machine's head does not tilt; \
         plan for another machine (--machine)",
        at_mm[0], at_mm[1], at_mm[2]
    )]
    CannotTilt {
        /// Angle of the slope.
        slope_deg: f64,
        /// Place on the surface.
        at_mm: [f64; 3],
    },
    /// The patch cannot be flattened.
    #[error("{problem}, near ({:.2}, {:.2}, {:.2}) mm; cut the surface into smaller patches", at_mm[0], at_mm[1], at_mm[2])]
    NotFlat {
        /// Why.
        problem: FlattenError,
        /// Place on the mesh.
        at_mm: [f64; 3],
    },
    /// Flattened, some of the ground is far larger than other.
    #[error(
        "flattened, the surface is {range:.2} times larger near ({:.2}, {:.2}, {:.2}) mm than near ({:.2}, {:.2}, \
         {:.2}) mm, more than {most:.1} times; cut it into smaller patches",
        at_mm[0], at_mm[1], at_mm[2], least_at_mm[0], least_at_mm[1], least_at_mm[2]
    )]
    ScaleRanges {
        /// Greatest length for one of the chart against the least.
        range: f64,
        /// How much it may be.
        most: f64,
        /// Where it is greatest.
        at_mm: [f64; 3],
        /// Where it is least.
        least_at_mm: [f64; 3],
    },
    /// An edge that no surface has.
    #[error(
        "the surface is no sheet near ({:.2}, {:.2}, {:.2}) mm: an edge has more than two triangles, triangles beside \
         each other look to different sides, or two rims touch; mend the mesh there",
        at_mm[0], at_mm[1], at_mm[2]
    )]
    NotManifold {
        /// Place on the mesh.
        at_mm: [f64; 3],
    },
    /// A mesh without a rim, and nothing that says which part of it is meant.
    #[error(
        "the surface near ({:.2}, {:.2}, {:.2}) mm is closed: all of it cannot be printed, since no tool reaches what looks \
         down; draw an outline on it, or choose a part with --surface-region (as in normal:120)",
        at_mm[0], at_mm[1], at_mm[2]
    )]
    Closed {
        /// Place on the mesh.
        at_mm: [f64; 3],
    },
    /// Loops around a surface that is cut into patches.
    #[error(
        "the surface is cut into {patches} patches, around which no skirt or brim is planned: leave it out, or print          the surface in parts that flatten"
    )]
    SkirtAroundPatches {
        /// How many.
        patches: usize,
    },
    /// A point of an outline in space that lies off the mesh.
    #[error(
        "the outline's point ({:.3}, {:.3}, {:.3}) mm lies {off_mm:.3} mm off the surface, more than half a layer \
         ({most_mm:.3} mm): both are taken in the same coordinates",
        at_mm[0], at_mm[1], at_mm[2]
    )]
    OffMesh {
        /// The point.
        at_mm: [f64; 3],
        /// How far it is off.
        off_mm: f64,
        /// How far it may be.
        most_mm: f64,
    },
    /// A layer folds.
    #[error(transparent)]
    Folds(#[from] LayerFoldsError),
    /// Nozzle or head would touch the surface.
    #[error(
        "{} would be {depth_mm:.2} mm in the surface with the tip at ({:.2}, {:.2}, {:.2}) mm ([head] in the \
         machine file): a smaller head, a longer nozzle, or an outline that keeps off the hollow",
        part.name(),
        at_mm[0], at_mm[1], at_mm[2]
    )]
    HeadTouches {
        /// What touches.
        part: HeadPart,
        /// How deep.
        depth_mm: f64,
        /// The tip, input coordinates.
        at_mm: [f64; 3],
    },
}

impl SurfaceError {
    /// Whether smaller patches may have a chart where the whole has none: a chart that ranges far is rough and bent
    /// where it is smallest.
    pub(super) fn may_be_divided(&self) -> bool {
        matches!(
            self,
            SurfaceError::NotFlat { .. }
                | SurfaceError::ScaleRanges { .. }
                | SurfaceError::TooRough { .. }
                | SurfaceError::BendsTooSharply { .. }
                | SurfaceError::Folds(_)
        )
    }
}

impl From<NotManifold> for SurfaceError {
    fn from(error: NotManifold) -> SurfaceError {
        SurfaceError::NotManifold { at_mm: error.at_mm }
    }
}
