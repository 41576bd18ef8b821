//! At most: what grows from the bed where no head is in the way.

use super::Space;
use super::grid::Standing;

/// Side of the blocks that say whether something near a cell has changed; more than a line of support is long.
const BLOCK: usize = 8;

impl Space {
    /// Cells that support and poses allow in some order, in such an order. More material never takes support away, so the set is the
    /// same for each order of growing.
    pub(super) fn grow(&self, usable: u128) -> Vec<u32> {
        let part = &self.part;
        let mut standing = Standing::new(part);
        let mut blocks = Blocks::new(part.size());
        let mut grown = Vec::new();
        let layable = |cell: &u32| self.poses.layable(*cell) & usable != 0;
        let mut left: Vec<u32> = (0..part.cells().len() as u32).filter(layable).collect();
        // Each round but the last one adds a cell.
        for round in 1.. {
            let before = grown.len();
            left.retain(|&cell| {
                let at = part.cells()[cell as usize];
                if !blocks.is_near_change(at, round) {
                    return true;
                }
                let wanted = self.poses.layable(cell) & usable;
                if self.support.of(part, &standing, at, wanted, true) == 0 {
                    return true;
                }
                standing.put(part, at);
                blocks.change(at, round);
                grown.push(cell);
                false
            });
            if grown.len() == before {
                break;
            }
            // What hangs grows downwards: rounds in turns.
            left.reverse();
        }
        grown
    }
}

/// The round in which a block changed last.
struct Blocks {
    size: [usize; 3],
    changed: Vec<u32>,
}

impl Blocks {
    fn new(size: [usize; 3]) -> Blocks {
        let size = size.map(|n| n / BLOCK + 3);
        Blocks {
            size,
            changed: vec![0; size.iter().product()],
        }
    }

    fn at(&self, cell: [u16; 3]) -> usize {
        let [x, y, z] = cell.map(|n| usize::from(n) / BLOCK + 1);
        (z * self.size[1] + y) * self.size[0] + x
    }

    fn change(&mut self, cell: [u16; 3], round: u32) {
        let at = self.at(cell);
        self.changed[at] = round;
    }

    /// Whether a block beside the cell's has changed since the round before.
    fn is_near_change(&self, cell: [u16; 3], round: u32) -> bool {
        let at = self.at(cell);
        let [row, plane] = [self.size[0], self.size[0] * self.size[1]];
        let beside = |middle: usize, by: usize| [middle - by, middle, middle + by];
        let rows = beside(at, plane).into_iter().flat_map(|at| beside(at, row));
        let mut rows = rows.map(|at| &self.changed[at - 1..=at + 1]);
        rows.any(|three| three.iter().any(|&changed| changed + 1 >= round))
    }
}
