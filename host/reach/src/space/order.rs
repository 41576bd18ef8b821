//! At most and found: what grows from the bed, without and with the head.
//!
//! An order is sought by height first; up to the head's free tilt that nearly always lays everything. Otherwise it is sought
//! from its end too: what the head reaches while all of the rest stands is taken away, what is farthest from the bed first, as
//! long as the rest keeps its support. That frees poses and never blocks one, so a blocked pose is tried again only when the
//! cell in its way has gone. What stays is laid first. The larger result counts.

use super::grid::{NONE, Standing};
use super::{Space, Step, bits};

/// Rounds in which cells that had no pose yet are tried again.
const ROUNDS_MAX: usize = 12;
/// A pose that was not looked at yet; a free one. Others are a place in the way.
const UNKNOWN: u32 = u32::MAX;
const FREE: u32 = u32::MAX - 1;

impl Space {
    /// Cells that support and poses allow in some order, in such an order. More material never takes support away, so that
    /// the set is the same for each order of growing.
    pub(super) fn grow(&self, usable: u128) -> Vec<u32> {
        let mut standing = Standing::new(&self.grid);
        let mut grown = Vec::new();
        let mut left: Vec<u32> = (0..self.part.cells.len() as u32).collect();
        loop {
            let before = grown.len();
            left.retain(|&cell| {
                let wanted = self.poses.layable[cell as usize] & usable;
                if wanted == 0 || self.supported(&standing, cell, wanted, true) == 0 {
                    return true;
                }
                standing.turn(&self.grid, self.grid.places[cell as usize]);
                grown.push(cell);
                false
            });
            if grown.len() == before {
                return grown;
            }
            // What hangs grows downwards.
            left.reverse();
        }
    }

    /// Directions among `wanted` along which what stands supports a cell: all, or `any` one.
    fn supported(&self, standing: &Standing, cell: u32, wanted: u128, any: bool) -> u128 {
        let place = self.grid.places[cell as usize];
        let found = self.support.of_bed(&self.part, cell, wanted);
        self.support.add(standing, place, wanted, any, found)
    }

    fn in_head(&self, standing: &Standing, pose: u32, direction: usize) -> Option<usize> {
        let cell = self.part.cells[pose as usize];
        standing.in_head(&self.grid, cell, &self.heads[direction])
    }

    /// The first pose that lays a cell and is free, the lowest tilt first.
    fn free_step(
        &self,
        cell: u32,
        directions: u128,
        mut is_free: impl FnMut(u32, usize) -> bool,
    ) -> Option<Step> {
        bits(directions).find_map(|direction| {
            let mut poses = self.poses.over(&self.grid, cell, direction);
            let pose = poses.find(|&pose| is_free(pose, direction))?;
            let direction = direction as u8;
            Some(Step {
                cell,
                pose,
                direction,
            })
        })
    }

    /// Steps that lay as much as possible of what the bound allows.
    pub(super) fn order(&self, grown: &[u32], usable: u128) -> Vec<Step> {
        let mut by_level: Vec<(u32, u128)> = grown.iter().map(|&cell| (cell, 0)).collect();
        by_level.sort_by_key(|&(cell, _)| self.part.cells[cell as usize][2]);
        let forwards = self.laid(by_level, usable);
        if forwards.len() == grown.len() {
            return forwards;
        }
        let (mut cells, taken) = self.take_away(grown, usable);
        cells.extend(
            taken
                .iter()
                .rev()
                .map(|step| (step.cell, 1 << step.direction)),
        );
        let backwards = self.laid(cells, usable);
        match backwards.len() > forwards.len() {
            true => backwards,
            false => forwards,
        }
    }

    /// Lays cells one by one, along their own direction where that works; those that cannot be laid yet are tried again later.
    fn laid(&self, mut cells: Vec<(u32, u128)>, usable: u128) -> Vec<Step> {
        let mut standing = Standing::new(&self.grid);
        // By cell: directions along which its pose is blocked. What stands stays, so that this is final.
        let mut blocked = vec![0u128; self.part.cells.len()];
        let mut steps = Vec::new();
        for _ in 0..ROUNDS_MAX {
            let before = steps.len();
            cells.retain(|&(cell, own)| {
                let wanted = self.poses.layable[cell as usize] & usable;
                let step = [own, wanted].into_iter().find_map(|wanted| {
                    let directions = self.supported(&standing, cell, wanted, false);
                    self.free_step(cell, directions, |pose, direction| {
                        let blocked = &mut blocked[pose as usize];
                        if *blocked >> direction & 1 == 0
                            && self.in_head(&standing, pose, direction).is_some()
                        {
                            *blocked |= 1 << direction;
                        }
                        *blocked >> direction & 1 == 0
                    })
                });
                if let Some(step) = step {
                    standing.turn(&self.grid, self.grid.places[cell as usize]);
                    steps.push(step);
                }
                step.is_none()
            });
            if steps.len() == before || cells.is_empty() {
                break;
            }
        }
        steps
    }

    /// By cell: how many cells it is from the bed through those that may be laid.
    fn far_from_bed(&self, grown: &[u32]) -> Vec<u32> {
        let mut far = vec![0; self.part.cells.len()];
        for &cell in grown {
            far[cell as usize] = u32::MAX;
        }
        let on_bed = |cell: &u32| self.part.cells[*cell as usize][2] == 0;
        let mut next: Vec<u32> = grown.iter().copied().filter(on_bed).collect();
        for distance in 1.. {
            next.retain(|&cell| std::mem::replace(&mut far[cell as usize], distance) > distance);
            let beside = |&cell: &u32| {
                let place = self.grid.places[cell as usize];
                super::cube(1).map(move |by| self.grid.cell(place, self.grid.step(by)))
            };
            let is_new = |cell: &u32| *cell != NONE && far[*cell as usize] == u32::MAX;
            next = next.iter().flat_map(beside).filter(is_new).collect();
            next.sort_unstable();
            next.dedup();
            if next.is_empty() {
                break;
            }
        }
        far
    }

    /// Steps in the order of taking away, and before them the cells that stay.
    fn take_away(&self, grown: &[u32], usable: u128) -> (Vec<(u32, u128)>, Vec<Step>) {
        let mut taking = Taking {
            space: self,
            usable,
            standing: Standing::new(&self.grid),
            in_the_way: vec![UNKNOWN; self.part.cells.len() * self.heads.len()],
            needed_by: vec![Vec::new(); self.part.cells.len()],
            taken: Vec::new(),
        };
        for &cell in grown {
            taking.supports(cell);
            let place = self.grid.places[cell as usize];
            taking.standing.turn(&self.grid, place);
        }
        let far = self.far_from_bed(grown);
        let mut left: Vec<u32> = grown.iter().rev().copied().collect();
        left.sort_by_key(|&cell| std::cmp::Reverse(far[cell as usize]));
        let mut level = left.first().map_or(0, |&cell| far[cell as usize]);
        loop {
            let before = left.len();
            left.retain(|&cell| far[cell as usize] < level || !taking.take(cell));
            if left.len() == before {
                let Some(lower) = level.checked_sub(1) else {
                    break;
                };
                level = lower;
            }
        }
        let stays = left.into_iter().rev().map(|cell| (cell, 0));
        (stays.collect(), taking.taken)
    }
}

struct Taking<'a> {
    space: &'a Space,
    usable: u128,
    standing: Standing,
    /// By cell, then direction.
    in_the_way: Vec<u32>,
    /// By cell: others that may need it for support.
    needed_by: Vec<Vec<u32>>,
    taken: Vec<Step>,
}

impl Taking<'_> {
    /// Whether what stands supports a cell; notes what that needs.
    fn supports(&mut self, cell: u32) -> bool {
        let Space {
            part,
            grid,
            support,
            poses,
            ..
        } = self.space;
        let wanted = poses.layable[cell as usize] & self.usable;
        if support.of_bed(part, cell, wanted) != 0 {
            return true;
        }
        let place = grid.places[cell as usize];
        let Some(needs) = support.needs(&self.standing, place, wanted) else {
            return false;
        };
        for place in needs {
            self.needed_by[grid.cells[place] as usize].push(cell);
        }
        true
    }

    /// Takes a cell away if laying it can be the last step.
    fn take(&mut self, cell: u32) -> bool {
        let space = self.space;
        let wanted = space.poses.layable[cell as usize] & self.usable;
        let directions = space.supported(&self.standing, cell, wanted, false);
        let step = space.free_step(cell, directions, |pose, direction| {
            let known = &mut self.in_the_way[pose as usize * space.heads.len() + direction];
            if *known == UNKNOWN || *known != FREE && !self.standing.has(*known as usize, 0) {
                let in_the_way = space.in_head(&self.standing, pose, direction);
                *known = in_the_way.map_or(FREE, |place| place as u32);
            }
            *known == FREE
        });
        let Some(step) = step else {
            return false;
        };
        let place = space.grid.places[cell as usize];
        self.standing.turn(&space.grid, place);
        let mut needing = std::mem::take(&mut self.needed_by[cell as usize]);
        needing.sort_unstable();
        needing.dedup();
        needing.retain(|&other| self.standing.has(space.grid.places[other as usize], 0));
        if needing.iter().all(|&other| self.supports(other)) {
            self.taken.push(step);
            return true;
        }
        self.standing.turn(&space.grid, place);
        self.needed_by[cell as usize] = needing;
        false
    }
}
