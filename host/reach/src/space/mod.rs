//! How much of a part a tilting head can lay at most, before any planning: the configuration space of a body in space.
//!
//! ```text
//! Part (cells), directions, Rules --poses--> which poses fit, by aperture, bed, joints, obstacles
//!     --support, order--> at most: what grows with no head     (one set, whatever the order)
//!     --head_rows, order--> found: steps that work one by one  (no more than the best order)
//! ```
//!
//! A pose is a cell, under the middle of the aperture, and a direction from the tip into the head. Its step lays one cell.
//! Lengths in mm, angles in rad. Exact on the grid and for the given directions; the same in every run. Leaves out how the
//! head comes to a pose, and beads: this is what is possible with material laid cell by cell, not a plan.

mod cuts;
mod grid;
mod head_rows;
mod order;
mod pieces;
mod poses;
mod rings;
mod support;
#[cfg(test)]
mod tests;

pub use cuts::{Cut, CutError};
pub use grid::Part;
pub use pieces::Facet;
pub use rings::directions;

use crate::Vector3;
use crate::profile::HeadProfile;
use grid::Grid;
use head_rows::HeadRows;
use poses::Poses;
use rayon::prelude::*;
use support::Support;

/// As many directions as a mask has bits.
pub const DIRECTIONS_MAX: usize = 128;
/// Most cells of a part times directions: 0.2 GB of tables.
pub const POSES_MAX: usize = 1 << 25;
/// What rounding may decide.
const EPSILON: f64 = 1e-9;

/// The aperture in the tool's frame, about its middle.
pub struct Aperture<'a> {
    /// The headings to try, at most 16.
    pub headings_rad: Vec<f64>,
    /// No point of it is farther from the middle in either coordinate.
    pub reach_mm: f64,
    /// Whether it contains a point, mm.
    pub contains: &'a (dyn Fn([f64; 2]) -> bool + Sync),
}

/// What a machine and its material permit.
pub struct Rules<'a> {
    /// The head; above its top it continues with the same width.
    pub head: &'a HeadProfile,
    /// What is no higher than this above the tip's plane is under the flat end, not in the head.
    pub slack_mm: f64,
    /// How far a bead may lean off what supports it, from the tool axis.
    pub self_support_rad: f64,
    /// The nozzle's opening.
    pub aperture: Aperture<'a>,
    /// Whether the joints permit a direction, by its index, over a cell.
    pub allowed: &'a (dyn Fn([u16; 3], usize) -> bool + Sync),
}

/// One cell of material.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Step {
    /// What is laid: an index of [`Part::cells`].
    pub cell: u32,
    /// The cell under the middle of the aperture.
    pub pose: u32,
    /// Index of the direction.
    pub direction: u8,
}

/// Why a cell is not laid: the first of these that applies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum LeftOut {
    /// The aperture does not fit into the part around it.
    Aperture,
    /// The head would be below the bed.
    Bed,
    /// No joints for it.
    Joints,
    /// The head would be in an obstacle.
    Obstacle,
    /// Nothing that could be laid supports it.
    Support,
    /// The head was in the way of every order that was tried.
    Head,
}

/// The answer for a set of directions.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reach {
    /// By cell of the part: an order might lay it.
    pub at_most: Vec<bool>,
    /// An order that works.
    pub steps: Vec<Step>,
    /// By cell of the part; `None` where a step lays it.
    pub left_out: Vec<Option<LeftOut>>,
}

/// Why there is no answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SpaceError {
    /// A number of cells along an axis is zero or above the 1,024 that fit, or the voxel is no size.
    Size,
    /// The part has no cell.
    Empty,
    /// More cells, or cells times directions, than there is room for.
    TooLarge,
    /// None, more than [`DIRECTIONS_MAX`], or not unit vectors.
    Directions,
    /// A number of the rules is not finite or negative, or there are no headings or above 16.
    Rules,
}

/// Tables of a part, a set of directions and rules.
pub struct Space {
    part: Part,
    grid: Grid,
    heads: Vec<HeadRows>,
    support: Support,
    poses: Poses,
}

impl Space {
    /// Makes the tables.
    ///
    /// # Errors
    /// [`SpaceError`]: too large, or wrong numbers.
    pub fn new(part: &Part, directions: &[Vector3], rules: &Rules) -> Result<Space, SpaceError> {
        let is_unit = |n: &Vector3| (n.norm() - 1.0).abs() < 1e-6;
        let count = directions.len();
        if !(1..=DIRECTIONS_MAX).contains(&count) || !directions.iter().all(is_unit) {
            return Err(SpaceError::Directions);
        }
        let aperture = &rules.aperture;
        let numbers = [rules.slack_mm, rules.self_support_rad, aperture.reach_mm];
        let are_numbers = numbers.iter().all(|x| x.is_finite() && *x >= 0.0);
        if !are_numbers || !(1..=16).contains(&aperture.headings_rad.len()) {
            return Err(SpaceError::Rules);
        }
        let reach = (aperture.reach_mm / part.voxel_mm).ceil();
        let rows = 4 * part.size[1] * part.size[2];
        let most = rows.max(part.cells.len()) * count;
        if reach > grid::SIDE_MAX as f64 || most > POSES_MAX {
            return Err(SpaceError::TooLarge);
        }
        let grid = Grid::new(part, (reach as usize).max(support::DEPTH as usize + 1))?;
        let heads = directions.par_iter();
        let heads = heads.map(|axis| HeadRows::new(part, axis, rules));
        let heads: Vec<HeadRows> = heads.collect();
        Ok(Space {
            support: Support::new(&grid, directions, rules.self_support_rad),
            poses: Poses::new((part, &grid), directions, rules, &heads),
            part: part.clone(),
            grid,
            heads,
        })
    }

    /// What some directions reach: bit k of `usable` stands for direction k.
    pub fn reach(&self, usable: u128) -> Reach {
        let grown = self.grow(usable);
        let cells = self.part.cells.len();
        let mut at_most = vec![false; cells];
        for &cell in &grown {
            at_most[cell as usize] = true;
        }
        let left = |cell: usize| match at_most[cell] {
            true => LeftOut::Head,
            false => self.poses.refused(cell),
        };
        let mut left_out: Vec<_> = (0..cells).map(|cell| Some(left(cell))).collect();
        let steps = self.order(&grown, usable);
        for step in &steps {
            left_out[step.cell as usize] = None;
        }
        Reach {
            at_most,
            steps,
            left_out,
        }
    }
}

/// Indices of the bits that are set, lowest first.
fn bits(mut mask: u128) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let bit = mask.trailing_zeros() as usize;
        mask &= mask.wrapping_sub(1);
        (bit < 128).then_some(bit)
    })
}

/// Offsets of up to so many cells along each axis.
fn cube(reach: i16) -> impl Iterator<Item = [i16; 3]> {
    let near = move || -reach..=reach;
    near().flat_map(move |z| near().flat_map(move |y| near().map(move |x| [x, y, z])))
}
