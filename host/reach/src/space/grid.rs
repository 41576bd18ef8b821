//! A part as cells, the places of a grid with empty cells around it, and which of them stand.

use super::SpaceError;
use super::head_rows::HeadRows;

/// Most cells along an axis.
pub const SIDE_MAX: usize = 1024;
/// Most cells of a grid, with the empty ones around it.
const PLACES_MAX: usize = 1 << 24;
/// No cell of the part.
pub(super) const NONE: u32 = u32::MAX;

/// A part on a grid of cubes above the bed, z = 0.
#[derive(Clone, Debug)]
pub struct Part {
    pub(super) size: [usize; 3],
    pub(super) voxel_mm: f64,
    pub(super) cells: Vec<[u16; 3]>,
    pub(super) obstacles: Vec<[u16; 3]>,
}

impl Part {
    /// Of the cells for which `solid` holds.
    ///
    /// # Errors
    /// [`SpaceError`]: no cell, or too many.
    pub fn new(
        size: [usize; 3],
        voxel_mm: f64,
        solid: impl FnMut([usize; 3]) -> bool,
    ) -> Result<Part, SpaceError> {
        let is_size = |n: &usize| (1..=SIDE_MAX).contains(n);
        let is_voxel = voxel_mm.is_finite() && voxel_mm > 0.0;
        if !is_voxel || !size.iter().all(is_size) {
            return Err(SpaceError::Size);
        }
        if size.iter().product::<usize>() > PLACES_MAX {
            return Err(SpaceError::TooLarge);
        }
        let cells = cells_of(size, solid);
        if cells.is_empty() {
            return Err(SpaceError::Empty);
        }
        Ok(Part {
            size,
            voxel_mm,
            cells,
            obstacles: Vec::new(),
        })
    }

    /// With cells that stand from the beginning, where they are not the part's.
    #[must_use]
    pub fn with_obstacles(mut self, stands: impl FnMut([usize; 3]) -> bool) -> Part {
        let key = |&[x, y, z]: &[u16; 3]| [z, y, x];
        self.obstacles = cells_of(self.size, stands);
        self.obstacles
            .retain(|cell| self.cells.binary_search_by_key(&key(cell), key).is_err());
        self
    }

    /// Its cells, sorted by z, then y, then x.
    pub fn cells(&self) -> &[[u16; 3]] {
        &self.cells
    }

    /// Cells of the grid along x, y, z.
    pub fn size(&self) -> [usize; 3] {
        self.size
    }

    /// Side of a cell.
    pub fn voxel_mm(&self) -> f64 {
        self.voxel_mm
    }
}

fn cells_of([nx, ny, nz]: [usize; 3], mut is_in: impl FnMut([usize; 3]) -> bool) -> Vec<[u16; 3]> {
    let all = (0..nx * ny * nz).map(|n| [n % nx, n / nx % ny, n / (nx * ny)]);
    let all = all.filter(|&cell| is_in(cell));
    all.map(|cell| cell.map(|n| n as u16)).collect()
}

/// Places: cells numbered along x, then y, then z, with so many empty ones around that no step leads from a cell to the
/// next row.
pub(super) struct Grid {
    size: [usize; 3],
    pad: usize,
    strides: [usize; 3],
    /// By cell of the part.
    pub(super) places: Vec<usize>,
    /// By place: the cell of the part, or [`NONE`].
    pub(super) cells: Vec<u32>,
}

impl Grid {
    pub(super) fn new(part: &Part, pad: usize) -> Result<Grid, SpaceError> {
        let [nx, ny, nz] = part.size.map(|n| n + 2 * pad);
        if nx * ny * nz > PLACES_MAX {
            return Err(SpaceError::TooLarge);
        }
        let mut grid = Grid {
            size: part.size,
            pad,
            strides: [1, nx, nx * ny],
            places: Vec::new(),
            cells: vec![NONE; nx * ny * nz],
        };
        grid.places = part.cells.iter().map(|&cell| grid.place(cell)).collect();
        for (cell, &place) in (0..).zip(&grid.places) {
            grid.cells[place] = cell;
        }
        Ok(grid)
    }

    pub(super) fn place(&self, cell: [u16; 3]) -> usize {
        let along = |axis: usize| (usize::from(cell[axis]) + self.pad) * self.strides[axis];
        along(0) + along(1) + along(2)
    }

    /// From a place to the one some cells away.
    pub(super) fn step(&self, [x, y, z]: [i16; 3]) -> isize {
        let [_, row, plane] = self.strides.map(|stride| stride as isize);
        isize::from(x) + isize::from(y) * row + isize::from(z) * plane
    }

    /// The cell of the part a step away from a place, or [`NONE`].
    #[inline]
    pub(super) fn cell(&self, place: usize, step: isize) -> u32 {
        self.cells[place.wrapping_add_signed(step)]
    }
}

/// The places that stand, a bit each.
pub(super) struct Standing {
    bits: Vec<u64>,
    /// How many stand at a height.
    counts: Vec<u32>,
}

impl Standing {
    pub(super) fn new(grid: &Grid) -> Standing {
        Standing {
            bits: vec![0; grid.cells.len() / 64 + 1],
            counts: vec![0; grid.size[2] + 2 * grid.pad],
        }
    }

    #[inline]
    pub(super) fn has(&self, place: usize, step: isize) -> bool {
        let place = place.wrapping_add_signed(step);
        self.bits[place / 64] >> (place % 64) & 1 == 1
    }

    /// Adds a place that does not stand, or takes one away that does.
    pub(super) fn turn(&mut self, grid: &Grid, place: usize) {
        let count = &mut self.counts[place / grid.strides[2]];
        self.bits[place / 64] ^= 1 << (place % 64);
        let stands = self.bits[place / 64] >> (place % 64) & 1 == 1;
        *count = count.wrapping_add_signed(if stands { 1 } else { -1 });
    }

    /// A place that stands in a head over a cell.
    pub(super) fn in_head(&self, grid: &Grid, cell: [u16; 3], head: &HeadRows) -> Option<usize> {
        let [x, y, z] = cell.map(i32::from);
        let [nx, ny, nz] = grid.size.map(|n| n as i32);
        for plane in &head.planes {
            let at_z = z + plane.dz;
            if at_z < 0 || at_z >= nz || self.counts[at_z as usize + grid.pad] == 0 {
                continue;
            }
            for dy in plane.dy_first.max(-y)..plane.dy_end.min(ny - y) {
                let row = grid.place([0, (y + dy) as u16, at_z as u16]);
                for &[low, high] in head.spans(plane, dy) {
                    let low = (x + i32::from(low)).max(0) as usize;
                    let high = (x + i32::from(high)).min(nx - 1);
                    if high >= low as i32 {
                        let found = self.first(row + low, row + high as usize);
                        if found.is_some() {
                            return found;
                        }
                    }
                }
            }
        }
        None
    }

    /// The first of some places that stands, both ends included.
    #[inline]
    fn first(&self, low: usize, high: usize) -> Option<usize> {
        for word in low / 64..=high / 64 {
            let mut bits = self.bits[word];
            if word == low / 64 {
                bits &= u64::MAX << (low % 64);
            }
            if word == high / 64 {
                bits &= u64::MAX >> (63 - high % 64);
            }
            if bits != 0 {
                return Some(word * 64 + bits.trailing_zeros() as usize);
            }
        }
        None
    }
}
