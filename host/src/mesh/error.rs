//! Why a mesh cannot be sliced: reason, place (mm, in the file's coordinates), remedy.

use super::Point3;
use super::close_gaps::GAP_MAX_MM;
use super::layers::LAYER_MM;
use super::read::{SIZE_MAX_MM, SIZE_MIN_MM, TRIANGLES_MAX};
use crate::settings::LAYERS_MAX;
use crate::text::short_number::Short;

/// A place for messages: `(12.345, -3.000, 0.200) mm`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct At3(pub Point3);

impl std::fmt::Display for At3 {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let p = self.0;
        write!(f, "({:.3}, {:.3}, {:.3}) mm", p.x, p.y, p.z)
    }
}

/// Refusals of the mesh stage.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MeshError {
    /// The bytes do not follow the format.
    #[error("not a readable {format} file: {problem}")]
    Syntax {
        /// Format by name.
        format: &'static str,
        /// The parser's message, and the remedy.
        problem: String,
    },
    /// Layers cannot be so high.
    #[error("{option} {height_mm}: write a height of {} to {} mm", LAYER_MM[0], LAYER_MM[1])]
    LayerHeight {
        /// The option that requests it.
        option: &'static str,
        /// The requested value.
        height_mm: f64,
    },
    /// Nothing is left of a range of heights above the first layer.
    #[error(
        "--layer-heights: the range up to {to_mm} mm lies in the first layer, which is {first_mm} mm high: leave it out or \
         give a smaller --first-layer-height"
    )]
    RangeInFirstLayer {
        /// Its end.
        to_mm: f64,
        /// Height of the first layer.
        first_mm: f64,
    },
    /// No triangle in it.
    #[error("there is no triangle in it: export the solid as a mesh once more")]
    Empty,
    /// Nothing is left once what encloses nothing is gone.
    #[error(
        "all of its {triangles} triangles lie flat on each other and enclose nothing: export a \
         solid, not a surface"
    )]
    NothingEnclosed {
        /// How many there were.
        triangles: usize,
    },
    /// No triangle is in the requested region.
    #[error(
        "no triangle of the surface is in the requested region; its groups: {}",
        if groups.is_empty() { "none" } else { groups }
    )]
    NoSuchRegion {
        /// Names of the groups that there are.
        groups: String,
    },
    /// More than can be sliced in reasonable memory.
    #[error(
        "{triangles} triangles, more than {TRIANGLES_MAX}: export with a coarser tolerance, 0.01 mm \
         is finer than any bead"
    )]
    TooMany {
        /// How many.
        triangles: usize,
    },
    /// A coordinate that is not a number.
    #[error(
        "a corner of triangle {triangle} (counted from 0) is ({}, {}, {}), which is no place: \
         export the mesh once more",
        Short(corner[0]), Short(corner[1]), Short(corner[2])
    )]
    NotFinite {
        /// Which triangle.
        triangle: usize,
        /// Its corner as the file has it.
        corner: [f64; 3],
    },
    /// A triangle of a vertex that the file does not have.
    #[error(
        "triangle {triangle} (counted from 0) names vertex {vertex} of {vertices}: the file is \
         damaged, export it once more"
    )]
    NoSuchVertex {
        /// Which triangle.
        triangle: usize,
        /// The vertex that it names, counted from 0.
        vertex: usize,
        /// How many there are.
        vertices: usize,
    },
    /// Larger than any machine.
    #[error(
        "the part is {} x {} x {} mm, larger than {SIZE_MAX_MM} mm: check its units (--units) or \
         give --scale",
        Short(size_mm[0]), Short(size_mm[1]), Short(size_mm[2])
    )]
    TooBig {
        /// Extent along the axes.
        size_mm: [f64; 3],
    },
    /// Smaller than anything printable.
    #[error(
        "the part is {size} mm, smaller than {SIZE_MIN_MM} mm: check its units (in metres, --units m, it \
         is {metres} mm) or give --scale"
    )]
    TooSmall {
        /// Extent along the axes, mm.
        size: String,
        /// The same of a file in metres.
        metres: String,
    },
    /// So far from the origin that digits are lost.
    #[error(
        "the part lies around {at}, farther than {} mm from the origin: move it closer before the \
         export", Short(*max_mm)
    )]
    TooFar {
        /// The middle of its box.
        at: At3,
        /// The largest accepted coordinate.
        max_mm: f64,
    },
    /// Holes in the surface.
    #[error(
        "the surface is open in {holes} place{}: the largest hole is {size_mm:.3} mm across, of \
         {edges} edges near {at}; gaps up to {GAP_MAX_MM} mm are closed, this one is wider: close it in \
         the CAD program, or let a mesh tool fill it", if *holes == 1 { "" } else { "s" }
    )]
    Open {
        /// How many holes.
        holes: usize,
        /// Diagonal of the largest one's box.
        size_mm: f64,
        /// Edges around it.
        edges: usize,
        /// The middle of its box.
        at: At3,
    },
    /// Flatter than half a layer.
    #[error(
        "the part is {height_mm:.4} mm high, less than half of its first layer of {first_mm} mm: \
         turn it (--rotate), or give a smaller --layer-height"
    )]
    NoLayer {
        /// Its height.
        height_mm: f64,
        /// The first layer's.
        first_mm: f64,
    },
    /// More layers than a job has.
    #[error(
        "{layers:.0} layers of {layer_mm} mm, more than {LAYERS_MAX}: give a larger --layer-height, \
         or check the units (--units)"
    )]
    TooManyLayers {
        /// How many.
        layers: f64,
        /// How high each is.
        layer_mm: f64,
    },
    /// A range that has no layer.
    #[error("--layer-range {from}-{to}: the part has layers 1 to {layers}")]
    NoSuchLayer {
        /// First of the range.
        from: u32,
        /// Last of the range.
        to: u32,
        /// How many the part has.
        layers: u32,
    },
    /// Layers without any area.
    #[error("there is nothing inside the mesh on layers {from} to {to}: choose other ones")]
    NothingInside {
        /// First of the range.
        from: u32,
        /// Last of the range.
        to: u32,
    },
    /// A 3MF file that builds nothing.
    #[error("its build has no item: place at least one object on the plate before the export")]
    NothingBuilt,
    /// A 3MF file of which all is switched off or no material.
    #[error(
        "nothing in it is printed: its items are switched off, or are modifiers, supports or negative \
         volumes: switch one on, or make one a part, and export it again"
    )]
    NothingPrinted,
    /// A part whose first layer is cut away.
    #[error(
        "the negative volumes leave nothing of the first layer, {first_mm} mm high, at the part's lowest \
         point: move them up, or cut the part there and lay it on the bed before the export"
    )]
    NothingLowest {
        /// How high the first layer is.
        first_mm: f64,
    },
    /// A 3MF file's item of an object that is not there.
    #[error(
        "an item or component names object {id}, which the file does not have: export it again"
    )]
    NoSuchObject {
        /// The missing number.
        id: usize,
    },
    /// Objects and components that place each other any number of times.
    #[error(
        "its objects and components are placed more than {max} times: export them as one object"
    )]
    TooManyParts {
        /// The bound.
        max: usize,
    },
    /// 3MF components that contain each other.
    #[error("the components of object {id} nest deeper than {max}: export them as one object")]
    TooDeep {
        /// The object at the bound.
        id: usize,
        /// The bound.
        max: usize,
    },
}
