//! Which cuts leave the least that hangs: a beam search over planes of every height and direction.
//!
//! ```text
//! facets of the surface --hang along a direction--> mm² by cell
//! direction --cells from the top down, joined by their faces--> pieces of every height, with what they avoid
//!     --rest on the bed, head, support, joints--> those that can be printed --beam--> cuts
//! ```
//! Cuts are found from the last piece to the first, so that a piece's rest is what stands when it is printed. What is below a
//! piece's plane is never in the head along its normal: only the bed and what else stands above the plane is looked at. Lengths
//! in mm. The same in every run. Leaves out travel, and how well a piece holds on its plane.

use super::cuts::{CRUMBS_MAX, Cells, Cut};
use super::grid::{Grid, Standing};
use super::head_rows::HeadRows;
use super::support::{DEPTH, Support};
use super::{DIRECTIONS_MAX, EPSILON, Part, Rules, SpaceError, bits};
use crate::Vector3;
use rayon::prelude::*;
use std::sync::OnceLock;

/// Orders that are followed at a time, and pieces that each is tried with.
const BEAM: usize = 6;
const BRANCHES: usize = 6;
/// Kinds of pieces that are tried, and how often each: with other directions and heights.
const KINDS_MAX: usize = 24;
const TRIES: usize = 5;
/// Pieces are of a kind that have this share of each other's cells, and middles this near. Orders with more in common than the
/// last are one.
const LIKE_SHARE: f64 = 0.7;
const LIKE_VOXELS: f64 = 3.0;
const SAME_SHARE: f64 = 0.85;
/// Pieces of a direction that are looked at: the best, and others of less height or more.
const OF_DIRECTION: usize = 6;
/// A piece avoids at least this share of what hangs.
const LEAST_SHARE: f64 = 0.01;
/// Share of a piece's cells that must be supported: the rest are stairs of the grid.
const SUPPORTED_SHARE: f64 = 0.97;
/// Cells of a piece at which joints are asked for.
const JOINTS_ASKED: usize = 100;
/// What a piece costs, and each of its layers, s; and what a second is worth, mm² of overhang.
const PIECE_S: f64 = 10.0;
const LAYER_S: f64 = 1.0;
const SECOND_MM2: f64 = 0.02;
/// A face hangs if it is steeper than the material supports by more than this.
const STEEPER: f64 = 1e-3;
/// How far below a facet the cell is that it belongs to, voxels.
const BELOW: f64 = 0.6;
/// A facet this near to the bed, voxels, that faces down lies on it.
const ON_BED: f64 = 0.02;

/// A small piece of the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Facet {
    /// Its middle, mm from the grid's corner.
    pub middle_mm: Vector3,
    /// Outwards, unit.
    pub normal: Vector3,
    /// How large it is.
    pub area_mm2: f64,
}

impl Facet {
    /// Whether it hangs in print along a direction.
    fn hangs(&self, direction: &Vector3, rules: &Rules, voxel_mm: f64) -> bool {
        let lies = self.normal.z < -0.99 && self.middle_mm.z < ON_BED * voxel_mm;
        !lies && self.normal.dot(direction) < -(rules.self_support_rad.sin() + STEEPER)
    }
}

impl Part {
    /// The cell that a facet belongs to.
    fn under(&self, facet: &Facet) -> Option<usize> {
        let inside = facet.middle_mm - BELOW * self.voxel_mm * facet.normal;
        let at = (inside / self.voxel_mm).map(|n| n.floor() as i64);
        let near = || -1..=1i64;
        let beside = near().flat_map(|z| near().flat_map(move |y| near().map(move |x| [x, y, z])));
        let cell = |[x, y, z]: [i64; 3]| {
            let key = [at.z + z, at.y + y, at.x + x];
            let of = |cell: &[u16; 3]| [2, 1, 0].map(|axis| i64::from(cell[axis]));
            self.cells.binary_search_by_key(&key, of).ok()
        };
        cell([0; 3]).or_else(|| beside.filter_map(cell).next())
    }

    /// By piece, the rest first: what of it would hang upright, and along its own direction, mm². A facet without a cell is
    /// the rest's.
    pub fn hanging(
        &self,
        owners: &[u8],
        cuts: &[Cut],
        facets: &[Facet],
        rules: &Rules,
    ) -> Vec<[f64; 2]> {
        let mut hanging = vec![[0.0; 2]; cuts.len() + 1];
        for facet in facets {
            let owner = self
                .under(facet)
                .map_or(0, |cell| usize::from(owners[cell]));
            let own = owner
                .checked_sub(1)
                .map_or(Vector3::z(), |cut| cuts[cut].direction);
            for (sum, direction) in hanging[owner].iter_mut().zip([Vector3::z(), own]) {
                *sum += f64::from(facet.hangs(&direction, rules, self.voxel_mm)) * facet.area_mm2;
            }
        }
        hanging
    }

    /// The cuts of at most so many pieces besides the rest, in the order of printing; none where nothing is gained.
    ///
    /// # Errors
    /// [`SpaceError`]: too many directions, or cells.
    pub fn best_cuts(
        &self,
        directions: &[Vector3],
        rules: &Rules,
        facets: &[Facet],
        layer_mm: f64,
        most: usize,
    ) -> Result<Vec<Cut>, SpaceError> {
        if !(1..=DIRECTIONS_MAX).contains(&directions.len()) {
            return Err(SpaceError::Directions);
        }
        let grid = Grid::new(self, DEPTH as usize + 1)?;
        let search = Search::new(self, &grid, directions, rules, facets, layer_mm);
        let mut beam = vec![State {
            owners: vec![0; self.cells.len()],
            ..State::default()
        }];
        let mut best = beam[0].clone();
        for _ in 0..most.min(255) {
            let children: Vec<Vec<State>> = beam
                .par_iter()
                .map(|state| search.children(state))
                .collect();
            let mut next: Vec<State> = children.into_iter().flatten().collect();
            next.sort_by(|a, b| b.score_mm2.total_cmp(&a.score_mm2));
            let next = different(next);
            if next
                .first()
                .is_some_and(|first| first.score_mm2 > best.score_mm2)
            {
                best = next[0].clone();
            }
            beam = next;
        }
        best.cuts.reverse();
        Ok(best.cuts)
    }
}

/// Some cuts.
#[derive(Clone, Debug, Default)]
struct State {
    /// By cell: 0 or the number of its cut.
    owners: Vec<u8>,
    /// The last piece first.
    cuts: Vec<Cut>,
    /// What they avoid, less what they cost.
    score_mm2: f64,
}

/// A piece that may be cut off.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    direction: usize,
    level_mm: f64,
    /// One of its cells.
    cell: u32,
    cells: f64,
    middle_mm: Vector3,
    score_mm2: f64,
}

impl Candidate {
    /// About the same piece, whatever its direction.
    fn is_like(&self, other: &Candidate, voxel_mm: f64) -> bool {
        let near_mm = LIKE_VOXELS * voxel_mm;
        let is_as_large = (LIKE_SHARE..=1.0 / LIKE_SHARE).contains(&(self.cells / other.cells));
        is_as_large && (self.middle_mm - other.middle_mm).norm() < near_mm
    }
}

impl State {
    /// Share of the cells of either that are cut off both.
    fn shared(&self, other: &State) -> f64 {
        let both = self.owners.iter().zip(&other.owners);
        let counted = both.fold([0usize; 2], |[both, any], (a, b)| {
            [
                both + usize::from(*a > 0 && *b > 0),
                any + usize::from(*a > 0 || *b > 0),
            ]
        });
        counted[0] as f64 / counted[1].max(1) as f64
    }
}

/// The best of the orders, each unlike the others.
fn different(all: Vec<State>) -> Vec<State> {
    let mut kept: Vec<State> = Vec::new();
    for state in all {
        if kept.len() < BEAM && kept.iter().all(|other| state.shared(other) < SAME_SHARE) {
            kept.push(state);
        }
    }
    kept
}

struct Search<'a> {
    cells: Cells<'a>,
    directions: &'a [Vector3],
    rules: &'a Rules<'a>,
    support: Support,
    heads: Vec<OnceLock<HeadRows>>,
    /// By direction, then cell: what hangs upright, less what hangs along it, mm².
    gains: Vec<Vec<f32>>,
    /// By direction: cells from the top down, with their levels, mm.
    orders: Vec<Vec<(f64, u32)>>,
    least_mm2: f64,
    bodies: usize,
    layer_mm: f64,
}

impl<'a> Search<'a> {
    fn new(
        part: &'a Part,
        grid: &'a Grid,
        directions: &'a [Vector3],
        rules: &'a Rules<'a>,
        facets: &[Facet],
        layer_mm: f64,
    ) -> Search<'a> {
        let cells = Cells::new(part, grid);
        let under: Vec<Option<usize>> = facets.par_iter().map(|facet| part.under(facet)).collect();
        let hangs =
            |facet: &Facet, direction: &Vector3| facet.hangs(direction, rules, part.voxel_mm);
        let gains = |direction: &Vector3| {
            let mut gains = vec![0.0f32; part.cells.len()];
            for (facet, cell) in facets.iter().zip(&under) {
                let [upright, own] = [&Vector3::z(), direction].map(|of| hangs(facet, of));
                if let Some(cell) = cell.filter(|_| upright != own) {
                    let sign = if upright { 1.0 } else { -1.0 };
                    gains[cell] += (sign * facet.area_mm2) as f32;
                }
            }
            gains
        };
        let order = |direction: &Vector3| {
            let level = |cell: u32| cells.middle_mm(cell).dot(direction);
            let mut order: Vec<(f64, u32)> = (0..part.cells.len() as u32)
                .map(|c| (level(c), c))
                .collect();
            order.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
            order
        };
        let upright = facets.iter().filter(|facet| hangs(facet, &Vector3::z()));
        let all_mm2: f64 = upright.map(|facet| facet.area_mm2).sum();
        Search {
            gains: directions.par_iter().map(gains).collect(),
            orders: directions.par_iter().map(order).collect(),
            least_mm2: (LEAST_SHARE * all_mm2).max(EPSILON),
            bodies: cells.bodies(|_| true).unwrap_or(1),
            support: Support::new(grid, directions, rules.self_support_rad),
            heads: directions.iter().map(|_| OnceLock::new()).collect(),
            cells,
            directions,
            rules,
            layer_mm,
        }
    }

    fn level_mm(&self, cell: u32, direction: usize) -> f64 {
        self.cells.middle_mm(cell).dot(&self.directions[direction])
    }

    /// The best pieces that can be cut off a state, each of another kind.
    fn children(&self, state: &State) -> Vec<State> {
        let of_direction = |direction| self.candidates(state, direction);
        let all: Vec<Vec<Candidate>> = (0..self.directions.len())
            .into_par_iter()
            .map(of_direction)
            .collect();
        let mut all: Vec<Candidate> = all.into_iter().flatten().collect();
        all.sort_by(|a, b| b.score_mm2.total_cmp(&a.score_mm2));
        let mut children = Vec::new();
        // The first of a kind, and how often it is tried still.
        let mut kinds: Vec<(Candidate, usize)> = Vec::new();
        for of in all {
            let kind = kinds
                .iter()
                .position(|(first, _)| of.is_like(first, self.cells.part.voxel_mm));
            let kind = kind.unwrap_or_else(|| {
                kinds.push((of, TRIES));
                kinds.len() - 1
            });
            if kinds.len() > KINDS_MAX || children.len() == BRANCHES {
                break;
            }
            let left = &mut kinds[kind].1;
            if *left > 0 {
                let child = self.child(state, &of);
                *left = if child.is_some() { 0 } else { *left - 1 };
                children.extend(child);
            }
        }
        children
    }

    /// Pieces along a direction, of all heights: the best of them, and some with less.
    fn candidates(&self, state: &State, direction: usize) -> Vec<Candidate> {
        let axis = &self.directions[direction];
        let below_mm = self.rules.head.below_tip_mm(axis);
        let over_bed = |z: u16| {
            let tip_mm = self.cells.part.voxel_mm * (f64::from(z) + 0.5 + 0.5 * axis.z);
            axis.z >= -EPSILON && tip_mm - below_mm >= -self.rules.slack_mm - EPSILON
        };
        let mut bodies = Bodies::new(self.cells.part.cells.len());
        let mut found: Vec<Candidate> = Vec::new();
        let mut end_mm = f64::INFINITY;
        let mut changed: Vec<u32> = Vec::new();
        let left = self.orders[direction]
            .iter()
            .filter(|(_, cell)| state.owners[*cell as usize] == 0);
        for &(level_mm, cell) in left {
            if level_mm <= end_mm {
                changed.sort_unstable();
                changed.dedup();
                for root in changed.drain(..) {
                    let body = &bodies.known[root as usize];
                    let is_one =
                        bodies.parent[root as usize] == root && body.cells as usize > CRUMBS_MAX;
                    if is_one && body.gain_mm2 >= self.least_mm2 && over_bed(body.lowest) {
                        let layers = (f64::from(body.top_mm) - end_mm) / self.layer_mm;
                        found.push(Candidate {
                            direction,
                            level_mm: end_mm,
                            cell: root,
                            cells: f64::from(body.cells),
                            middle_mm: body.sum_mm / f64::from(body.cells),
                            score_mm2: body.gain_mm2 - SECOND_MM2 * (PIECE_S + LAYER_S * layers),
                        });
                    }
                }
                end_mm = level_mm - self.cells.part.voxel_mm;
            }
            let beside = self.cells.beside(cell);
            let gain_mm2 = f64::from(self.gains[direction][cell as usize]);
            let own = Body {
                cells: 1,
                lowest: self.cells.part.cells[cell as usize][2],
                top_mm: level_mm as f32,
                sum_mm: self.cells.middle_mm(cell),
                gain_mm2,
            };
            changed.push(bodies.add(cell, beside, own));
        }
        found.sort_by(|a, b| b.score_mm2.total_cmp(&a.score_mm2));
        let count = found.len().min(OF_DIRECTION);
        let picked = (0..count).map(|k| found[k * (found.len() - 1) / (count - 1).max(1)]);
        picked.collect()
    }

    /// The state without a piece, if that can be printed.
    fn child(&self, state: &State, of: &Candidate) -> Option<State> {
        let is_above = |cell: u32| {
            state.owners[cell as usize] == 0 && self.level_mm(cell, of.direction) > of.level_mm
        };
        let mut piece = self.cells.flooded(vec![of.cell], is_above);
        let mut child = state.clone();
        let number = state.cuts.len() as u8 + 1;
        piece
            .iter()
            .for_each(|cell| child.owners[*cell as usize] = number);
        let is_rest = |cell: u32| child.owners[cell as usize] == 0;
        let bodies = self.cells.bodies(is_rest)?;
        if bodies > self.bodies || !self.is_permitted(&piece, of.direction) {
            return None;
        }
        let is_beside = |cell: u32| is_rest(cell) && is_above(cell);
        if !self.is_free(&piece, is_beside, of.direction) {
            return None;
        }
        let level = |cell: &u32| self.level_mm(*cell, of.direction);
        piece.sort_by(|a, b| level(a).total_cmp(&level(b)).then(a.cmp(b)));
        if !self.is_supported(&piece, is_rest, of.direction) {
            return None;
        }
        let direction = self.directions[of.direction];
        let lowest = *piece.first()?;
        child.cuts.push(Cut {
            direction,
            at_mm: self.cells.middle_mm(lowest) - (level(&lowest) - of.level_mm) * direction,
        });
        child.score_mm2 += of.score_mm2;
        Some(child)
    }

    fn is_permitted(&self, piece: &[u32], direction: usize) -> bool {
        let every = piece.len() / JOINTS_ASKED + 1;
        let mut asked = piece.iter().step_by(every);
        asked.all(|cell| (self.rules.allowed)(self.cells.part.cells[*cell as usize], direction))
    }

    /// Whether the head is free at every pose of a piece.
    fn is_free(&self, piece: &[u32], stands: impl Fn(u32) -> bool, direction: usize) -> bool {
        let (part, grid) = (self.cells.part, self.cells.grid);
        let mut beside = Standing::new(grid);
        let mut is_alone = true;
        for cell in (0..part.cells.len() as u32).filter(|cell| stands(*cell)) {
            beside.turn(grid, grid.places[cell as usize]);
            is_alone = false;
        }
        is_alone || {
            let rows = || HeadRows::new(part, &self.directions[direction], self.rules);
            let head = self.heads[direction].get_or_init(rows);
            let cells = piece.iter().map(|cell| part.cells[*cell as usize]);
            cells
                .into_iter()
                .all(|cell| beside.in_head(grid, cell, head).is_none())
        }
    }

    /// Whether a piece, its lowest cell first, grows from what stands.
    fn is_supported(&self, piece: &[u32], stands: impl Fn(u32) -> bool, direction: usize) -> bool {
        let (part, grid) = (self.cells.part, self.cells.grid);
        let mut standing = Standing::new(grid);
        for cell in (0..part.cells.len() as u32).filter(|cell| stands(*cell)) {
            standing.turn(grid, grid.places[cell as usize]);
        }
        let (wanted, mut supported) = (1u128 << direction, 0usize);
        for &cell in piece {
            let place = grid.places[cell as usize];
            let by_bed = self.support.of_bed(part, cell, wanted);
            let found = self.support.add(&standing, place, wanted, true, by_bed);
            if bits(found).next().is_some() {
                standing.turn(grid, place);
                supported += 1;
            }
        }
        supported as f64 >= SUPPORTED_SHARE * piece.len() as f64
    }
}

/// Connected cells.
#[derive(Clone, Copy, Debug, Default)]
struct Body {
    cells: u32,
    /// The least z of them.
    lowest: u16,
    top_mm: f32,
    sum_mm: Vector3,
    gain_mm2: f64,
}

/// Bodies that grow together.
struct Bodies {
    parent: Vec<u32>,
    known: Vec<Body>,
}

impl Bodies {
    fn new(cells: usize) -> Bodies {
        Bodies {
            parent: vec![u32::MAX; cells],
            known: vec![Body::default(); cells],
        }
    }

    fn root(&mut self, mut cell: u32) -> u32 {
        while self.parent[cell as usize] != cell {
            let above = self.parent[self.parent[cell as usize] as usize];
            self.parent[cell as usize] = above;
            cell = above;
        }
        cell
    }

    /// Adds a cell, and joins what is beside it; the root of its body.
    fn add(&mut self, cell: u32, beside: impl Iterator<Item = u32>, own: Body) -> u32 {
        self.parent[cell as usize] = cell;
        self.known[cell as usize] = own;
        let mut root = cell;
        for other in beside {
            if self.parent[other as usize] == u32::MAX {
                continue;
            }
            let other = self.root(other);
            if other != root {
                let (one, two) = (self.known[root as usize], self.known[other as usize]);
                let [small, large] = if one.cells < two.cells {
                    [root, other]
                } else {
                    [other, root]
                };
                self.parent[small as usize] = large;
                self.known[large as usize] = Body {
                    cells: one.cells + two.cells,
                    lowest: one.lowest.min(two.lowest),
                    top_mm: one.top_mm.max(two.top_mm),
                    sum_mm: one.sum_mm + two.sum_mm,
                    gain_mm2: one.gain_mm2 + two.gain_mm2,
                };
                root = large;
            }
        }
        root
    }
}
