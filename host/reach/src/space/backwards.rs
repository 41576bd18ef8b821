//! The search for an order from its end: takes away what the head reaches while all of the rest stands.
//!
//! What is farthest from the bed through the part goes first. A cell goes if it is supported along a direction in which a pose for it is
//! free, and if all that stays keeps support. Removal frees poses and never blocks one, so a blocked pose is tried again only when
//! the cell in its way has gone.

use super::grid::{NONE, Standing};
use super::support::{BED, LineId};
use super::{Space, Step, bits};
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// A pose that was not looked at yet; a free one. Others are the number of a cell in the way.
const UNKNOWN: u32 = u32::MAX;
const FREE: u32 = u32::MAX - 1;
/// How far neighbours by a face, an edge and a corner are from each other, tenths of a cell.
const TENTHS: [u32; 4] = [0, 10, 14, 17];

struct Taking<'a> {
    space: &'a Space,
    usable: u128,
    standing: Standing,
    /// By direction's pose.
    in_the_way: Vec<u32>,
    /// By cell: the line that supports it.
    lines: Vec<LineId>,
    /// By cell: those that may need it for their line.
    needed_by: Vec<Vec<u32>>,
    taken: Vec<Step>,
}

impl Space {
    /// Steps in the order of taking away.
    pub(super) fn take_away(&self, cells: &[u32], usable: u128) -> Vec<Step> {
        let count = self.part.cells().len();
        let mut standing = Standing::new(&self.part);
        for &cell in cells {
            standing.put(&self.part, self.part.cells()[cell as usize]);
        }
        let mut taking = Taking {
            space: self,
            usable,
            in_the_way: vec![UNKNOWN; count * self.rows.len()],
            lines: vec![BED; count],
            needed_by: vec![Vec::new(); count],
            taken: Vec::new(),
            standing,
        };
        for &cell in cells {
            taking.support(cell);
        }
        let far = self.from_bed(cells);
        let mut left = cells.to_vec();
        left.sort_by_key(|&cell| (Reverse(far[cell as usize]), Reverse(cell)));
        let mut level = left.first().map_or(0, |&cell| far[cell as usize]);
        loop {
            let end = left.partition_point(|&cell| far[cell as usize] >= level);
            let before = left.len();
            let mut seen = 0;
            left.retain(|&cell| {
                seen += 1;
                seen > end || !taking.take(cell)
            });
            if left.len() == before {
                if level == 0 {
                    break;
                }
                level = level.saturating_sub(TENTHS[1]);
            }
        }
        taking.taken
    }

    /// Distances from the bed through the cells, tenths of a cell.
    fn from_bed(&self, cells: &[u32]) -> Vec<u32> {
        let part = &self.part;
        let mut is_in = vec![false; part.cells().len()];
        let mut far = vec![u32::MAX; part.cells().len()];
        let mut next = BinaryHeap::new();
        for &cell in cells {
            is_in[cell as usize] = true;
            if part.cells()[cell as usize][2] == 0 {
                far[cell as usize] = 0;
                next.push(Reverse((0, cell)));
            }
        }
        let beside = (0..27i16).map(|n| [n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1]);
        let beside: Vec<(isize, u32)> = beside
            .map(|by| {
                (
                    part.delta(by),
                    TENTHS[by.iter().filter(|n| **n != 0).count()],
                )
            })
            .collect();
        while let Some(Reverse((distance, cell))) = next.pop() {
            if distance > far[cell as usize] {
                continue;
            }
            let at = part.at(part.cells()[cell as usize]);
            for &(by, step) in &beside {
                let other = part.cell_at(at.wrapping_add_signed(by));
                if other != NONE && is_in[other as usize] && distance + step < far[other as usize] {
                    far[other as usize] = distance + step;
                    next.push(Reverse((distance + step, other)));
                }
            }
        }
        // What is connected by nothing goes last.
        far.into_iter()
            .map(|far| if far == u32::MAX { 0 } else { far })
            .collect()
    }
}

impl Taking<'_> {
    /// Finds a line for a cell on what stands and notes what that needs; whether there is one.
    fn support(&mut self, cell: u32) -> bool {
        let Space {
            part,
            support,
            poses,
            ..
        } = self.space;
        let at = part.cells()[cell as usize];
        let wanted = poses.layable(cell) & self.usable;
        let Some(line) = support.line(part, &self.standing, at, wanted, self.lines[cell as usize])
        else {
            return false;
        };
        self.lines[cell as usize] = line;
        for place in support.needs(line, part, &self.standing, at) {
            let needed = part.cell_at(place);
            if needed != NONE {
                self.needed_by[needed as usize].push(cell);
            }
        }
        true
    }

    /// Takes a cell away if that can be the last step of laying what stands.
    fn take(&mut self, cell: u32) -> bool {
        let Space {
            part,
            support,
            poses,
            ..
        } = self.space;
        let at = part.cells()[cell as usize];
        let wanted = poses.layable(cell) & self.usable;
        let directions = support.of(part, &self.standing, at, wanted, false);
        let found = bits(directions).find_map(|direction| {
            let pose = self
                .space
                .free_pose(cell, direction, |pose| self.is_free(pose, direction))?;
            Some(Step {
                cell,
                pose,
                direction: direction as u8,
            })
        });
        let Some(step) = found else {
            return false;
        };
        self.standing.take(part, at);
        let mut needing = std::mem::take(&mut self.needed_by[cell as usize]);
        needing.retain(|&other| self.standing.has(part.at(part.cells()[other as usize])));
        needing.sort_unstable();
        needing.dedup();
        if !needing.iter().all(|&other| self.support(other)) {
            self.standing.put(part, at);
            // Lines that were found do not need the cell; those that were not still do.
            self.needed_by[cell as usize] = needing;
            return false;
        }
        self.taken.push(step);
        true
    }

    fn is_free(&mut self, pose: u32, direction: usize) -> bool {
        let known = &mut self.in_the_way[pose as usize * self.space.rows.len() + direction];
        let is_blocked = *known < FREE && self.standing.has_number(*known);
        if *known != FREE && !is_blocked {
            *known = self
                .space
                .in_the_way(pose, direction, &self.standing)
                .unwrap_or(FREE);
        }
        *known == FREE
    }
}
