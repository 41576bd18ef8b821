//! What supports a cell: a line of standing cells below it, along the tool axis, that leans no more than the material permits.
//!
//! Lines are up to [`DEPTH`] cells long: with the nearest cells alone slopes would be multiples of 45°, and the share of a
//! part wrong by up to 8 points. Obstacles support nothing.

use super::grid::{Grid, Standing};
use super::{EPSILON, Part};
use crate::Vector3;

/// Longest line, cells. (7, 2) is one: 74° from Z, within 1° of the slope of self-support 45° at a tilt of 30°.
pub(super) const DEPTH: f64 = 7.3;
/// What is allowed above the angle of self-support, so that a slope of just that angle has lines on the grid.
const TOLERANCE_RAD: f64 = 0.5 * std::f64::consts::PI / 180.0;

/// A line from a cell to one that stands.
struct Line {
    /// Directions along which it supports, a bit each.
    directions: u128,
    to: isize,
    /// Cells on the way, rounded down and up: one of each four stands.
    way: Vec<[isize; 4]>,
}

/// Lines, the shortest first, and the bed.
pub(super) struct Support {
    lines: Vec<Line>,
    bed: u128,
}

impl Support {
    pub(super) fn new(grid: &Grid, directions: &[Vector3], self_support_rad: f64) -> Support {
        let most_rad = (self_support_rad + TOLERANCE_RAD).min(std::f64::consts::PI);
        let along = |down: Vector3| {
            let supports = |n: &Vector3| -down.dot(n) >= most_rad.cos() - EPSILON;
            let bits = (0..).zip(directions).filter(|(_, n)| supports(n));
            bits.fold(0u128, |mask, (bit, _): (u32, _)| mask | 1 << bit)
        };
        let mut lines = Vec::new();
        for to in super::cube(DEPTH as i16) {
            let line = Vector3::from(to.map(f64::from));
            if line.norm() <= DEPTH && to.into_iter().fold(0, gcd) == 1 {
                let directions = along(line.normalize());
                let (to, way) = (grid.step(to), way(grid, to));
                lines.push((
                    line.norm(),
                    Line {
                        directions,
                        to,
                        way,
                    },
                ));
            }
        }
        lines.retain(|(_, line)| line.directions != 0);
        lines.sort_by(|a, b| a.0.total_cmp(&b.0));
        Support {
            lines: lines.into_iter().map(|(_, line)| line).collect(),
            bed: along(-Vector3::z()),
        }
    }

    /// Directions among `wanted` along which the bed supports a cell.
    pub(super) fn of_bed(&self, part: &Part, cell: u32, wanted: u128) -> u128 {
        let [_, _, z] = part.cells[cell as usize];
        if z == 0 { self.bed & wanted } else { 0 }
    }

    /// Adds directions along which lines support a place until `found` has all `wanted` ones, or with `any` one.
    pub(super) fn add(
        &self,
        standing: &Standing,
        place: usize,
        wanted: u128,
        any: bool,
        mut found: u128,
    ) -> u128 {
        for line in &self.lines {
            if found == wanted || any && found != 0 {
                break;
            }
            if line.directions & wanted & !found != 0 && line.stands(standing, place) {
                found |= line.directions & wanted;
            }
        }
        found
    }

    /// The shortest line that supports a place along a direction among `wanted`: all that it needs.
    pub(super) fn needs(
        &self,
        standing: &Standing,
        place: usize,
        wanted: u128,
    ) -> Option<Vec<usize>> {
        let supports = |line: &&Line| line.directions & wanted != 0 && line.stands(standing, place);
        let line = self.lines.iter().find(supports)?;
        let way = line.way.iter();
        let way = way.filter_map(|four| four.iter().find(|&&step| standing.has(place, step)));
        let all = way.chain([&line.to]);
        Some(all.map(|&step| place.wrapping_add_signed(step)).collect())
    }
}

impl Line {
    #[inline]
    fn stands(&self, standing: &Standing, place: usize) -> bool {
        let one = |four: &[isize; 4]| four.iter().any(|&step| standing.has(place, step));
        standing.has(place, self.to) && self.way.iter().all(one)
    }
}

/// Cells on the way of a line, one four for each step along its longest axis, where every step is a whole cell.
fn way(grid: &Grid, to: [i16; 3]) -> Vec<[isize; 4]> {
    let length = to.map(i16::abs).into_iter().max().unwrap_or(1);
    let longest = to.iter().position(|n| n.abs() == length).unwrap_or(0);
    let four = |step: i16| {
        [0, 1, 2, 3].map(|which: usize| {
            let mut cell = to.map(|n| (n * step).div_euclid(length));
            for side in [1, 2].into_iter().filter(|side| which & side != 0) {
                let axis = (longest + side) % 3;
                cell[axis] = -(-to[axis] * step).div_euclid(length);
            }
            grid.step(cell)
        })
    };
    (1..length).map(four).collect()
}

fn gcd(a: i16, b: i16) -> i16 {
    if b == 0 { a.abs() } else { gcd(b, a % b) }
}
