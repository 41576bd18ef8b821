//! Passes: the types that the stages hand on to each other.
//!
//! A [`Contact`] is a point where the aperture is to touch a wall, with the bead's desired width; a
//! [`Placement`] is the aperture placed there; a [`LayerPass`] is a run of placements that is
//! printed without an interruption of flow. All lengths in mm, headings in rad, coordinates of the
//! region that is planned. Why here: every stage from the headings to the layers knows these three.
//!
//! In and out: only lengths and bounds (mm) are computed here.

pub mod sweep;
#[cfg(test)]
pub mod test_passes;

use crate::geometry::aperture::Aperture;
use crate::geometry::clearance::Configuration;
use crate::geometry::polygon::Box2;
use crate::geometry::{Point2, Vector2};

/// One place of contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    /// The point on the wall, or on the medial axis where `on_axis`.
    pub point: Point2,
    /// Inward unit normal (across the axis where `on_axis`).
    pub normal: Vector2,
    /// Length of wall that this sample represents, mm.
    pub length_mm: f64,
    /// Half the bead width wanted here, mm.
    pub extent_mm: f64,
    /// True for one-pass runs: the centre sits on `point` itself.
    pub on_axis: bool,
}

/// One placement of the profile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Centre and heading (unwrapped along the profile).
    pub at: Configuration,
    /// False where no heading fits at this contact.
    pub feasible: bool,
    /// The contact it belongs to.
    pub contact: Contact,
}

/// Position of a pass in its passage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PassKind {
    /// Along a wall, a neighbour on its other side.
    TwoPass,
    /// On the medial axis, touching both walls.
    OnePass,
    /// A straight line of infill.
    Infill,
    /// A straight line of a sparse infill.
    Sparse,
    /// A straight line over open space, from anchor to anchor.
    Bridge,
    /// A straight line of the first solid layer over a sparse infill, from one of its lines to the next.
    Roof,
    /// A loop around the part: skirt or brim.
    Skirt,
}

impl PassKind {
    /// True for the beads that fill the part along its walls and axis.
    pub fn follows_walls(self) -> bool {
        matches!(self, PassKind::TwoPass | PassKind::OnePass)
    }

    /// True for straight lines inside the walls.
    pub fn is_line(self) -> bool {
        use PassKind::{Bridge, Infill, Roof, Sparse};
        matches!(self, Infill | Sparse | Bridge | Roof)
    }
}

/// One continuous run of placements.
#[derive(Clone, Debug, PartialEq)]
pub struct LayerPass {
    /// Two-pass or one-pass.
    pub kind: PassKind,
    /// Channel number from the wall, 1 the outermost; 0 for single runs.
    pub channel: u32,
    /// True where the end meets the start.
    pub closed: bool,
    /// Placements in order, headings unwrapped.
    pub placements: Vec<Placement>,
    /// Where passes of other kinds were joined to it, in order: the place from which on it is of that kind.
    pub then: Vec<(Point2, PassKind)>,
}

impl LayerPass {
    /// Adds a pass behind the placements that are there already.
    pub fn append(&mut self, next: LayerPass) {
        let own = self.then.last().map_or(self.kind, |(_, kind)| *kind);
        let is_alike = own == next.kind || own.follows_walls() && next.kind.follows_walls();
        let begin = next
            .placements
            .first()
            .map(|first| (first.at.center, next.kind));
        self.then.extend(begin.filter(|_| !is_alike));
        self.then.extend(next.then);
        self.placements.extend(next.placements);
    }

    /// Path length of the centre from the first placement to the last, mm.
    pub fn length_mm(&self) -> f64 {
        let pairs = self.placements.windows(2);
        pairs
            .map(|w| (w[1].at.center - w[0].at.center).norm())
            .sum()
    }
}

/// A box about all placements of the passes.
pub fn bounds_of(passes: &[LayerPass], aperture: &Aperture) -> Box2 {
    let centers = passes.iter().flat_map(|p| &p.placements);
    let centers: Vec<Point2> = centers.map(|p| p.at.center).collect();
    let mut bounds = Box2::of(&centers);
    let margin = Vector2::repeat(aperture.reach_mm());
    bounds.min -= margin;
    bounds.max += margin;
    bounds
}
