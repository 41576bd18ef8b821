//! What supports a cell: a line of standing cells below it, along the tool axis, that leans no more than the material permits.
//!
//! Lines are up to [`DEPTH`] cells long: with the nearest cells alone slopes would be multiples of 45°, and a share of a part be wrong
//! by up to 8 points. Obstacles support nothing.

use super::grid::{Part, Standing};
use crate::Vector3;

/// Longest line, cells. (7, 2) is in it: 74° from Z, the slope of self-support 45° at a tilt of 30°, is wrong by 1°.
pub(super) const DEPTH: f64 = 7.3;
/// What is allowed above the angle of self-support, so that a slope of just that angle has lines on the grid.
const TOLERANCE_RAD: f64 = 0.5 * std::f64::consts::PI / 180.0;
/// What rounding may decide.
const EPSILON: f64 = 1e-9;

/// A line from a cell to one that stands.
struct Line {
    to: isize,
    /// Directions along which it supports, a bit each.
    directions: u128,
    /// Cells on the way, rounded down and up; one of each four stands.
    way: Vec<[isize; 4]>,
}

/// Lines, the shortest first.
pub(super) struct Support {
    lines: Vec<Line>,
    /// Directions along which the bed supports.
    bed: u128,
}

/// Number of a line, or [`BED`].
pub(super) type LineId = u16;
pub(super) const BED: LineId = LineId::MAX;

impl Support {
    pub(super) fn new(part: &Part, directions: &[Vector3], self_support_rad: f64) -> Support {
        let least = (self_support_rad + TOLERANCE_RAD)
            .min(std::f64::consts::PI)
            .cos()
            - EPSILON;
        let along = |supports: &dyn Fn(&Vector3) -> bool| {
            let bits = (0..).zip(directions).filter(|(_, n)| supports(n));
            bits.fold(0u128, |mask, (bit, _): (u32, _)| mask | 1 << bit)
        };
        let mut lines = Vec::new();
        let reach = DEPTH as i16;
        let near = || -reach..=reach;
        for to in near().flat_map(|z| near().flat_map(move |y| near().map(move |x| [x, y, z]))) {
            let line = Vector3::from(to.map(f64::from));
            let length = line.norm();
            if length > DEPTH || gcd(to) != 1 {
                continue;
            }
            let directions = along(&|n: &Vector3| -line.dot(n) / length >= least);
            if directions != 0 {
                let line = Line {
                    to: part.delta(to),
                    directions,
                    way: way(part, to),
                };
                lines.push((length, line));
            }
        }
        lines.sort_by(|a, b| a.0.total_cmp(&b.0));
        let lines = lines.into_iter().map(|(_, line)| line).collect();
        Support {
            lines,
            bed: along(&|n: &Vector3| n.z >= least),
        }
    }

    /// Directions along which what stands supports a cell; stops as soon as all `wanted` do, or with `any` as soon as one does.
    pub(super) fn of(
        &self,
        part: &Part,
        standing: &Standing,
        cell: [u16; 3],
        wanted: u128,
        any: bool,
    ) -> u128 {
        let at = part.at(cell);
        let mut found = if cell[2] == 0 { self.bed & wanted } else { 0 };
        for line in &self.lines {
            if found == wanted || any && found != 0 {
                break;
            }
            if line.directions & wanted & !found != 0 && stands(line, standing, at) {
                found |= line.directions & wanted;
            }
        }
        found
    }

    /// A line that supports a cell along one of the `wanted` directions: the last one if it still does, otherwise the shortest.
    pub(super) fn line(
        &self,
        part: &Part,
        standing: &Standing,
        cell: [u16; 3],
        wanted: u128,
        last: LineId,
    ) -> Option<LineId> {
        if cell[2] == 0 && self.bed & wanted != 0 {
            return Some(BED);
        }
        let at = part.at(cell);
        let holds = |line: &Line| line.directions & wanted != 0 && stands(line, standing, at);
        if self.lines.get(usize::from(last)).is_some_and(holds) {
            return Some(last);
        }
        self.lines.iter().position(holds).map(|line| line as LineId)
    }

    /// The places of the cells that a line over a cell needs.
    pub(super) fn needs(
        &self,
        line: LineId,
        part: &Part,
        standing: &Standing,
        cell: [u16; 3],
    ) -> Vec<usize> {
        let at = part.at(cell);
        let Some(line) = self.lines.get(usize::from(line)) else {
            return Vec::new();
        };
        let way = line
            .way
            .iter()
            .filter_map(|four| four.iter().find(|&&by| standing.has_by(at, by)));
        way.chain([&line.to])
            .map(|&by| at.wrapping_add_signed(by))
            .collect()
    }
}

#[inline]
fn stands(line: &Line, standing: &Standing, at: usize) -> bool {
    let is_on = |four: &[isize; 4]| four.iter().any(|&by| standing.has_by(at, by));
    standing.has_by(at, line.to) && line.way.iter().all(is_on)
}

/// Cells on the way of a line, one four for each step along its longest axis.
fn way(part: &Part, to: [i16; 3]) -> Vec<[isize; 4]> {
    let steps = to.iter().map(|n| n.abs()).max().unwrap_or(0);
    let longest = (0..3).find(|&axis| to[axis].abs() == steps).unwrap_or(0);
    // On the longest axis each step is a whole cell; the other two are rounded both ways.
    let [one, two] = [(longest + 1) % 3, (longest + 2) % 3];
    let four = |step: i16| {
        let down = to.map(|n| (n * step).div_euclid(steps));
        let up = to.map(|n| -(-n * step).div_euclid(steps));
        [[false, false], [true, false], [false, true], [true, true]].map(|is_up| {
            let mut cell = down;
            for (axis, _) in [one, two]
                .into_iter()
                .zip(is_up)
                .filter(|(_, is_up)| *is_up)
            {
                cell[axis] = up[axis];
            }
            part.delta(cell)
        })
    };
    (1..steps).map(four).collect()
}

fn gcd(of: [i16; 3]) -> i16 {
    let two = |mut a: i16, mut b: i16| {
        while b != 0 {
            (a, b) = (b, a % b);
        }
        a
    };
    of.into_iter().fold(0, |sum, n| two(n.abs(), sum))
}
