//! A part as cells, and what stands: a byte a cell with empty cells around, and rows of bits along x.

use super::SpaceError;
use super::head_rows::HeadRows;

/// Most cells along an axis.
pub const SIDE_MAX: u16 = 1024;
/// Most cells of a grid, with the empty ones around it.
const CELLS_MAX: usize = 1 << 24;
/// No cell of the part.
pub(super) const NONE: u32 = u32::MAX;

/// A part on a grid of cubes above the bed, z = 0.
#[derive(Clone, Debug)]
pub struct Part {
    size: [usize; 3],
    voxel_mm: f64,
    cells: Vec<[u16; 3]>,
    obstacles: Vec<[u16; 3]>,
    pad: usize,
    /// By cell of the padded grid: the cell of the part, or [`NONE`].
    index: Vec<u32>,
}

impl Part {
    /// Of the cells for which `solid` holds.
    ///
    /// # Errors
    /// [`SpaceError`]: no cell, or too many.
    pub fn new(
        size: [usize; 3],
        voxel_mm: f64,
        mut solid: impl FnMut([usize; 3]) -> bool,
    ) -> Result<Part, SpaceError> {
        let is_size = |&n: &usize| (1..=usize::from(SIDE_MAX)).contains(&n);
        if !size.iter().all(is_size) || !(voxel_mm.is_finite() && voxel_mm > 0.0) {
            return Err(SpaceError::Size);
        }
        if size.iter().product::<usize>() > CELLS_MAX {
            return Err(SpaceError::TooLarge);
        }
        let cells: Vec<[u16; 3]> = all(size)
            .filter(|&at| solid(at))
            .map(|at| at.map(|x| x as u16))
            .collect();
        if cells.is_empty() {
            return Err(SpaceError::Empty);
        }
        let (obstacles, index) = (Vec::new(), Vec::new());
        Part {
            size,
            voxel_mm,
            cells,
            obstacles,
            pad: 0,
            index,
        }
        .padded(0)
    }

    /// With cells that stand from the beginning, where they are not the part's.
    #[must_use]
    pub fn with_obstacles(mut self, mut stands: impl FnMut([usize; 3]) -> bool) -> Part {
        let cells = all(self.size)
            .filter(|&at| stands(at))
            .map(|at| at.map(|x| x as u16));
        self.obstacles = cells
            .filter(|&at| self.index[self.at(at)] == NONE)
            .collect();
        self
    }

    /// With as many empty cells on each side.
    pub(super) fn padded(&self, pad: usize) -> Result<Part, SpaceError> {
        let mut part = Part {
            pad,
            ..self.clone()
        };
        let room = part.strides()[2] * (part.size[2] + 2 * pad);
        if room > CELLS_MAX {
            return Err(SpaceError::TooLarge);
        }
        part.index = vec![NONE; room];
        for (cell, &at) in (0..).zip(&self.cells) {
            let at = part.at(at);
            part.index[at] = cell;
        }
        Ok(part)
    }

    /// Its cells in the order z, y, x, x first.
    pub fn cells(&self) -> &[[u16; 3]] {
        &self.cells
    }

    /// Cells that stand from the beginning.
    pub fn obstacles(&self) -> &[[u16; 3]] {
        &self.obstacles
    }

    /// Cells of the grid along x, y, z.
    pub fn size(&self) -> [usize; 3] {
        self.size
    }

    /// Side of a cell.
    pub fn voxel_mm(&self) -> f64 {
        self.voxel_mm
    }

    /// Steps from a cell to the next along x, y, z in the padded grid.
    pub(super) fn strides(&self) -> [usize; 3] {
        let row = self.size[0] + 2 * self.pad;
        [1, row, row * (self.size[1] + 2 * self.pad)]
    }

    /// Where a cell is in the padded grid.
    pub(super) fn at(&self, cell: [u16; 3]) -> usize {
        let strides = self.strides();
        (0..3)
            .map(|axis| (usize::from(cell[axis]) + self.pad) * strides[axis])
            .sum()
    }

    /// How far an offset is in the padded grid.
    pub(super) fn delta(&self, offset: [i16; 3]) -> isize {
        let strides = self.strides();
        (0..3)
            .map(|axis| isize::from(offset[axis]) * strides[axis] as isize)
            .sum()
    }

    /// The cell of the part in a place of the padded grid, or [`NONE`].
    #[inline]
    pub(super) fn cell_at(&self, at: usize) -> u32 {
        self.index[at]
    }
}

fn all([nx, ny, nz]: [usize; 3]) -> impl Iterator<Item = [usize; 3]> {
    (0..nz * ny * nx).map(move |i| [i % nx, i / nx % ny, i / (nx * ny)])
}

/// The cells that stand.
#[derive(Clone)]
pub(super) struct Standing {
    size: [usize; 3],
    /// By place of the padded grid.
    stands: Vec<bool>,
    /// Rows of bits along x, `words` each, y before z.
    rows: Vec<u64>,
    words: usize,
    /// By z: the first row with a cell and the one after the last.
    occupied: Vec<[usize; 2]>,
}

impl Standing {
    pub(super) fn new(part: &Part) -> Standing {
        let words = part.size[0].div_ceil(64);
        Standing {
            size: part.size,
            stands: vec![false; part.index.len()],
            rows: vec![0; words * part.size[1] * part.size[2]],
            words,
            occupied: vec![[0; 2]; part.size[2]],
        }
    }

    #[inline]
    pub(super) fn has(&self, at: usize) -> bool {
        self.stands[at]
    }

    /// Whether a cell stands some way from a place; the pad is as wide as any such way.
    #[inline]
    pub(super) fn has_by(&self, at: usize, delta: isize) -> bool {
        self.stands[at.wrapping_add_signed(delta)]
    }

    pub(super) fn put(&mut self, part: &Part, cell: [u16; 3]) {
        let [x, y, z] = cell.map(usize::from);
        self.stands[part.at(cell)] = true;
        self.rows[(z * self.size[1] + y) * self.words + x / 64] |= 1 << (x % 64);
        let [low, high] = self.occupied[z];
        self.occupied[z] = if low == high {
            [y, y + 1]
        } else {
            [low.min(y), high.max(y + 1)]
        };
    }

    pub(super) fn take(&mut self, part: &Part, cell: [u16; 3]) {
        let [x, y, z] = cell.map(usize::from);
        self.stands[part.at(cell)] = false;
        self.rows[(z * self.size[1] + y) * self.words + x / 64] &= !(1 << (x % 64));
        let row = |y: usize| (z * self.size[1] + y) * self.words;
        let is_empty = |y: usize| {
            self.rows[row(y)..row(y) + self.words]
                .iter()
                .all(|&word| word == 0)
        };
        let [mut low, mut high] = self.occupied[z];
        while low < high && is_empty(low) {
            low += 1;
        }
        while low < high && is_empty(high - 1) {
            high -= 1;
        }
        self.occupied[z] = [low, high];
    }

    /// Place in the padded grid, which `part` made, is not known here: the first cell that a head over `cell` contains, numbered
    /// without the pad.
    pub(super) fn first_in(&self, cell: [u16; 3], head: &HeadRows) -> Option<u32> {
        let [x, y, z] = cell.map(i32::from);
        let [nx, ny, nz] = self.size;
        for plane in &head.planes {
            let at_z = z + i32::from(plane.dz);
            if at_z < 0 || at_z >= nz as i32 {
                continue;
            }
            let [low, high] = self.occupied[at_z as usize];
            let first = (low as i32 - y).max(plane.dy_first);
            let end = (high as i32 - y).min(plane.dy_end);
            if first >= end {
                continue;
            }
            for dy in first..end {
                let row = at_z as usize * ny + (y + dy) as usize;
                let words = &self.rows[row * self.words..(row + 1) * self.words];
                for &[lo, hi] in head.spans(plane, dy) {
                    let lo = (x + i32::from(lo)).max(0);
                    let hi = (x + i32::from(hi)).min(nx as i32 - 1);
                    if lo <= hi
                        && let Some(bit) = first_bit(words, lo as usize, hi as usize)
                    {
                        return Some((row * nx + bit) as u32);
                    }
                }
            }
        }
        None
    }

    /// Whether a cell stands, numbered as by [`Standing::first_in`].
    #[inline]
    pub(super) fn has_number(&self, number: u32) -> bool {
        let [row, x] = [
            number as usize / self.size[0],
            number as usize % self.size[0],
        ];
        self.rows[row * self.words + x / 64] >> (x % 64) & 1 == 1
    }
}

/// The first bit that is set from `lo` to `hi`, both included.
#[inline]
fn first_bit(words: &[u64], lo: usize, hi: usize) -> Option<usize> {
    for (word, &held) in words.iter().enumerate().take(hi / 64 + 1).skip(lo / 64) {
        let mut held = held;
        if word == lo / 64 {
            held &= u64::MAX << (lo % 64);
        }
        if word == hi / 64 {
            held &= u64::MAX >> (63 - hi % 64);
        }
        if held != 0 {
            return Some(word * 64 + held.trailing_zeros() as usize);
        }
    }
    None
}
