//! Cuts through a part -> its pieces, cell by cell.
//!
//! A cut is a plane. What lies above it and is connected with a given place is a piece of its own, printed along the plane's
//! normal after the rest. Cuts are made from the last piece to the first: each takes from what the later ones left. Cells are
//! connected by their faces.

use super::Part;
use super::grid::{Grid, NONE};
use crate::Vector3;

/// As many cells as may be left without a connection to the bed: crumbs of the grid.
pub(super) const CRUMBS_MAX: usize = 20;
/// How far from its place a cut looks for the piece, in voxels.
const NEAR_VOXELS: f64 = 3.0;
const FACES: [[i16; 3]; 6] = [
    [1, 0, 0],
    [-1, 0, 0],
    [0, 1, 0],
    [0, -1, 0],
    [0, 0, 1],
    [0, 0, -1],
];

/// A plane, and which piece it cuts off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cut {
    /// The plane's normal, from the tip into the head, unit.
    pub direction: Vector3,
    /// A place on the plane, below the piece, mm from the grid's corner.
    pub at_mm: Vector3,
}

/// Why a cut makes no piece.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CutError {
    /// Nothing of the part lies above the plane near its place.
    Misses,
    /// Without the piece the rest is in more bodies than the part, or not on the bed.
    InTheAir,
}

/// Neighbours of cells.
pub(super) struct Cells<'a> {
    pub(super) part: &'a Part,
    pub(super) grid: &'a Grid,
    steps: [isize; 6],
}

impl<'a> Cells<'a> {
    pub(super) fn new(part: &'a Part, grid: &'a Grid) -> Cells<'a> {
        let steps = FACES.map(|by| grid.step(by));
        Cells { part, grid, steps }
    }

    pub(super) fn middle_mm(&self, cell: u32) -> Vector3 {
        let at = Vector3::from(self.part.cells[cell as usize].map(f64::from));
        self.part.voxel_mm * at.add_scalar(0.5)
    }

    pub(super) fn beside(&self, cell: u32) -> impl Iterator<Item = u32> + '_ {
        let place = self.grid.places[cell as usize];
        let beside = self
            .steps
            .iter()
            .map(move |step| self.grid.cell(place, *step));
        beside.filter(|cell| *cell != NONE)
    }

    /// The cells connected with some, among those for which `is_in` holds.
    pub(super) fn flooded(&self, from: Vec<u32>, is_in: impl Fn(u32) -> bool) -> Vec<u32> {
        let mut known = vec![false; self.part.cells.len()];
        let mut found = from;
        found.retain(|cell| is_in(*cell) && !std::mem::replace(&mut known[*cell as usize], true));
        let mut next = 0;
        while let Some(&cell) = found.get(next) {
            next += 1;
            for other in self.beside(cell) {
                if !known[other as usize] && is_in(other) {
                    known[other as usize] = true;
                    found.push(other);
                }
            }
        }
        found
    }

    /// The piece that a cut takes from the cells for which `is_left` holds.
    fn piece(&self, cut: &Cut, is_left: impl Fn(u32) -> bool) -> Vec<u32> {
        let level_mm = cut.at_mm.dot(&cut.direction);
        let is_in =
            |cell: u32| is_left(cell) && self.middle_mm(cell).dot(&cut.direction) > level_mm;
        let away = |cell: &u32| (self.middle_mm(*cell) - cut.at_mm).norm_squared();
        let all = (0..self.part.cells.len() as u32).filter(|cell| is_in(*cell));
        let nearest = all.min_by(|a, b| away(a).total_cmp(&away(b)));
        let near_mm = NEAR_VOXELS * self.part.voxel_mm;
        let nearest = nearest.filter(|cell| away(cell) <= near_mm * near_mm);
        self.flooded(nearest.into_iter().collect(), is_in)
    }

    /// How many bodies cells for which `is_rest` holds are, all of them on the bed, but for crumbs; `None` where one is not.
    pub(super) fn bodies(&self, is_rest: impl Fn(u32) -> bool) -> Option<usize> {
        let all = (0..self.part.cells.len() as u32).filter(|cell| is_rest(*cell));
        let mut left = all.clone().count();
        let mut bodies = 0;
        let mut reached = vec![false; self.part.cells.len()];
        for first in all.filter(|cell| self.part.cells[*cell as usize][2] == 0) {
            if !reached[first as usize] {
                let found = self.flooded(vec![first], &is_rest);
                found.iter().for_each(|cell| reached[*cell as usize] = true);
                left -= found.len();
                bodies += usize::from(found.len() > CRUMBS_MAX);
            }
        }
        (bodies > 0 && left <= CRUMBS_MAX).then_some(bodies)
    }
}

impl Part {
    /// By cell: 0 for the rest, which stands on the bed, and the number of its piece, counted from 1, in the order of printing.
    ///
    /// # Errors
    /// The number of the cut, counted from 0, and [`CutError`]. At most 255 are looked at.
    pub fn divided(&self, cuts: &[Cut]) -> Result<Vec<u8>, (usize, CutError)> {
        let grid = Grid::new(self, 1).map_err(|_| (0, CutError::Misses))?;
        let cells = Cells::new(self, &grid);
        let most = cells.bodies(|_| true).unwrap_or(1);
        let mut owners = vec![0u8; self.cells.len()];
        for (number, cut) in cuts.iter().enumerate().take(255).rev() {
            let found = cells.piece(cut, |cell| owners[cell as usize] == 0);
            if found.is_empty() {
                return Err((number, CutError::Misses));
            }
            for cell in found {
                owners[cell as usize] = number as u8 + 1;
            }
            let bodies = cells.bodies(|cell| owners[cell as usize] == 0);
            if bodies.is_none_or(|bodies| bodies > most) {
                return Err((number, CutError::InTheAir));
            }
        }
        Ok(owners)
    }
}
