//! Found: an order whose steps all work, as long as one can be found.
//!
//! First forwards, in the order in which the bound grew; below the head's free tilt that nearly always lays everything. Otherwise
//! backwards too (see [`super::backwards`]), and what the search could not take away is laid first. The larger result counts.

use super::grid::Standing;
use super::{Space, Step, bits};

/// Rounds in which cells that had no pose yet are tried again.
const ROUNDS_MAX: usize = 12;

/// Steps that were carried out, and what stands after them.
pub(super) struct Laying<'a> {
    space: &'a Space,
    usable: u128,
    standing: Standing,
    steps: Vec<Step>,
    /// By cell: directions along which its pose is blocked. What stands stays, so that this is final.
    blocked: Vec<u128>,
}

impl Space {
    /// Steps that lay as much as possible of what the bound allows, given in an order that support allows.
    pub(super) fn order(&self, grown: &[u32], usable: u128) -> Vec<Step> {
        let forwards = self.laid(grown.iter().map(|&cell| (cell, None)).collect(), usable);
        if forwards.len() == grown.len() {
            return forwards;
        }
        let taken = self.take_away(grown, usable);
        let mut is_taken = vec![false; self.part.cells().len()];
        for step in &taken {
            is_taken[step.cell as usize] = true;
        }
        let stays = grown.iter().filter(|&&cell| !is_taken[cell as usize]);
        let stays = stays.map(|&cell| (cell, None));
        let backwards = taken.iter().rev().map(|step| (step.cell, Some(*step)));
        let backwards = self.laid(stays.chain(backwards).collect(), usable);
        if backwards.len() > forwards.len() {
            backwards
        } else {
            forwards
        }
    }

    /// Lays cells one by one, with their own step where that works; those that cannot be laid yet are tried again later.
    fn laid(&self, mut cells: Vec<(u32, Option<Step>)>, usable: u128) -> Vec<Step> {
        let standing = Standing::new(&self.part);
        let blocked = vec![0; self.part.cells().len()];
        let mut laying = Laying {
            space: self,
            usable,
            standing,
            steps: Vec::new(),
            blocked,
        };
        for _ in 0..ROUNDS_MAX {
            let before = laying.steps.len();
            cells.retain(|&(cell, step)| !laying.lay(cell, step));
            if laying.steps.len() == before || cells.is_empty() {
                break;
            }
        }
        laying.steps
    }
}

impl Laying<'_> {
    /// Lays a cell if a pose for it is free and it is supported.
    fn lay(&mut self, cell: u32, known: Option<Step>) -> bool {
        let Some(step) = self.step(cell, known) else {
            return false;
        };
        self.standing
            .put(&self.space.part, self.space.part.cells()[cell as usize]);
        self.steps.push(step);
        true
    }

    fn step(&mut self, cell: u32, known: Option<Step>) -> Option<Step> {
        let space = self.space;
        let at = space.part.cells()[cell as usize];
        let supported = |wanted: u128, any| {
            space
                .support
                .of(&space.part, &self.standing, at, wanted, any)
        };
        if let Some(step) = known
            && supported(1 << step.direction, true) != 0
            && space
                .in_the_way(step.pose, usize::from(step.direction), &self.standing)
                .is_none()
        {
            return Some(step);
        }
        let wanted = space.poses.layable(cell) & self.usable;
        // The lowest tilt first: often the first direction is enough.
        let directions = supported(wanted, false);
        for direction in bits(directions) {
            let pose = space.free_pose(cell, direction, |pose| {
                let blocked = &mut self.blocked[pose as usize];
                if *blocked >> direction & 1 == 0
                    && space.in_the_way(pose, direction, &self.standing).is_some()
                {
                    *blocked |= 1 << direction;
                }
                *blocked >> direction & 1 == 0
            });
            if let Some(pose) = pose {
                return Some(Step {
                    cell,
                    pose,
                    direction: direction as u8,
                });
            }
        }
        None
    }
}
