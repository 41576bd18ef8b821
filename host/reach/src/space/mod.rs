//! How much of a part a tilting head can lay at most, before any planning: the configuration space of a body in space.
//!
//! ```text
//! Part (cells) , directions, Rules --poses--> which poses fit, by aperture, bed, joints, obstacles
//!     --support, bound--> at most: what grows with no head        (one set, whatever the order)
//!     --head_rows, order--> found: steps that work one by one     (no more than the best order)
//! ```
//!
//! A pose is a cell, under the middle of the aperture, and a direction from the tip into the head. Its step lays one cell.
//! Lengths in mm, angles in rad. Exact on the grid and for the given directions; the same in every run. Leaves out how the
//! head comes to a pose, and beads: this is what is possible with material laid cell by cell, not a plan.

mod backwards;
mod bound;
mod grid;
mod head_rows;
mod order;
mod poses;
mod rings;
mod support;
#[cfg(test)]
mod tests;

pub use grid::Part;
pub use rings::directions;

use crate::Vector3;
use crate::profile::HeadProfile;
use grid::Standing;
use head_rows::HeadRows;
use poses::Poses;
use support::Support;

/// As many directions as a mask has bits.
pub const DIRECTIONS_MAX: usize = 128;
/// Cells of a part times directions: what the tables of [`Space`] have room for, about 0.4 GB.
pub const POSES_MAX: usize = 1 << 26;

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
    /// A number of cells along an axis is zero or above [`grid::SIDE_MAX`], or the voxel is no size.
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
    rows: Vec<HeadRows>,
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
        if directions.is_empty()
            || directions.len() > DIRECTIONS_MAX
            || !directions.iter().all(is_unit)
        {
            return Err(SpaceError::Directions);
        }
        let numbers = [
            rules.slack_mm,
            rules.self_support_rad,
            rules.aperture.reach_mm,
        ];
        let headings = rules.aperture.headings_rad.len();
        if numbers.iter().any(|x| !x.is_finite() || *x < 0.0) || !(1..=16).contains(&headings) {
            return Err(SpaceError::Rules);
        }
        let pad = (rules.aperture.reach_mm / part.voxel_mm()).ceil();
        let [_, ny, nz] = part.size();
        let rows = 2 * ny * nz * directions.len();
        if pad > f64::from(grid::SIDE_MAX)
            || rows.max(part.cells().len() * directions.len()) > POSES_MAX
        {
            return Err(SpaceError::TooLarge);
        }
        let part = part.padded((pad as usize).max(support::DEPTH as usize + 1))?;
        let head = |n: &Vector3| HeadRows::new(&part, n, rules.head, rules.slack_mm);
        let rows: Vec<HeadRows> = directions.iter().map(head).collect();
        let support = Support::new(&part, directions, rules.self_support_rad);
        let poses = Poses::new(&part, directions, rules, &rows);
        Ok(Space {
            part,
            rows,
            support,
            poses,
        })
    }

    /// What some directions reach: bit k of `usable` stands for direction k.
    pub fn reach(&self, usable: u128) -> Reach {
        let grown = self.grow(usable);
        let mut at_most = vec![false; self.part.cells().len()];
        for &cell in &grown {
            at_most[cell as usize] = true;
        }
        let steps = self.order(&grown, usable);
        let left = |cell: usize| match self.poses.refused(cell, usable) {
            Some(why) => why,
            None if at_most[cell] => LeftOut::Head,
            None => LeftOut::Support,
        };
        let mut left_out: Vec<Option<LeftOut>> =
            (0..at_most.len()).map(|cell| Some(left(cell))).collect();
        for step in &steps {
            left_out[step.cell as usize] = None;
        }
        Reach {
            at_most,
            steps,
            left_out,
        }
    }

    /// The pose closest to a cell, along a direction, that lays it and keeps the head off all that stands.
    fn free_pose(
        &self,
        cell: u32,
        direction: usize,
        mut is_free: impl FnMut(u32) -> bool,
    ) -> Option<u32> {
        self.poses
            .over(&self.part, cell, direction)
            .find(|&pose| is_free(pose))
    }

    /// A cell of the grid in which the head stands.
    fn in_the_way(&self, pose: u32, direction: usize, standing: &Standing) -> Option<u32> {
        standing.first_in(self.part.cells()[pose as usize], &self.rows[direction])
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
