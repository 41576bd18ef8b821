//! The part of a region that the optimiser still moves.
//!
//! In: knots at two times of the iterations. Out: the knots that moved across their path or turned between them, with
//! those next to them, and the windows of the passes around these: a smaller problem, whose other knots stay. Long straight beads
//! that fit their walls do not move after the first iterations. Lengths are in a.

use super::curve::{Knot, PassKnots};
use std::ops::Range;

/// Displacement across the path from which a knot moves, a; and turn at its place, rad.
const ACROSS_MIN: f64 = 0.004;
const TURN_MIN: f64 = 0.008;
/// Knots next to one that moves that may move with it, on both sides along the path.
const BESIDE: usize = 6;
/// Knots at the ends of a pass that always move.
pub const AT_ENDS: usize = 8;
/// Path between two windows of a pass, a: a return over more counts in full, so that its exact length has no effect.
const APART: f64 = 4.0;
/// Cells that count are this much farther from a moving knot than the aperture reaches, a.
const ROOM: f64 = 0.25;
/// Side of a square in which poses near those cells are looked up, a.
const SQUARE: f64 = 0.25;
/// Most squares: beyond that they grow.
const SQUARES_MAX: f64 = 16e6;
/// Share of the knots that must stay. With fewer, it saves little, and small gains of many iterations are lost.
const STAYING_MIN: f64 = 2.0 / 3.0;

/// The smaller problem.
#[derive(Clone, Debug)]
pub struct Moving {
    /// The passes' windows, numbered by the knots of the part.
    pub passes: Vec<PassKnots>,
    /// For each knot of the part its number in the whole.
    pub knots: Vec<usize>,
    /// For each knot of the part whether it stays.
    pub stays: Vec<bool>,
    /// Distance from a moving knot within which cells count, a.
    pub reach: f64,
}

impl Moving {
    /// The part's knots among all.
    pub fn own(&self, all: &[Knot]) -> Vec<Knot> {
        self.knots.iter().map(|&knot| all[knot]).collect()
    }

    /// Of the part's knots those that move.
    pub fn moving<'k>(&'k self, own: &'k [Knot]) -> impl Iterator<Item = &'k Knot> {
        let knots = own.iter().zip(&self.stays);
        knots.filter(|(_, stays)| !**stays).map(|(knot, _)| knot)
    }

    /// Puts the part's knots back among all.
    pub fn put_back(&self, own: &[Knot], all: &mut [Knot]) {
        for (&knot, own) in self.knots.iter().zip(own) {
            all[knot] = *own;
        }
    }
}

/// The part that moved between two times, except for what `stays` in any case; `None` if that is almost all. The aperture
/// reaches `radius` from its middle.
pub fn moving(
    [before, now]: [&[Knot]; 2],
    stays: &[bool],
    passes: &[PassKnots],
    radius: f64,
) -> Option<Moving> {
    let mut moves = vec![false; now.len()];
    for pass in passes.iter().filter(|pass| pass.free) {
        let own = moves.iter_mut().enumerate().take(pass.end());
        for (knot, moves) in own.skip(pass.first) {
            *moves = has_moved(before, now, knot, pass);
        }
    }
    let moves = with_those_beside(&moves, stays, passes);
    part_of(now, &moves, passes, radius)
}

/// Knots that may move, and those next to them, except for those that stay.
pub fn with_those_beside(may_move: &[bool], stays: &[bool], passes: &[PassKnots]) -> Vec<bool> {
    let mut moves = vec![false; may_move.len()];
    for pass in passes.iter().filter(|pass| pass.free) {
        for knot in (pass.first..pass.end()).filter(|&knot| may_move[knot]) {
            let from = knot.saturating_sub(BESIDE).max(pass.first);
            moves[from..(knot + BESIDE + 1).min(pass.end())].fill(true);
        }
    }
    let stays = stays.iter().chain(std::iter::repeat(&false));
    for (moves, stays) in moves.iter_mut().zip(stays) {
        *moves &= !stays;
    }
    moves
}

/// The part in which these knots move; `None` if that is almost all.
pub fn part_of(now: &[Knot], moves: &[bool], passes: &[PassKnots], radius: f64) -> Option<Moving> {
    let staying = moves.iter().filter(|moves| !**moves).count();
    if (staying as f64) < STAYING_MIN * now.len() as f64 {
        return None;
    }
    let reach = radius + ROOM;
    let near = near(now, moves, reach + radius + SQUARE);
    let mut part = Moving {
        passes: Vec::new(),
        knots: Vec::new(),
        stays: Vec::new(),
        reach,
    };
    for pass in passes {
        for window in windows(now, &near, pass) {
            let first = part.knots.len();
            part.passes.push(PassKnots {
                first,
                spans: window.len() - 3,
                cut: [
                    pass.cut[0] || window.start > pass.first,
                    pass.cut[1] || window.end < pass.end(),
                ],
                ..*pass
            });
            part.stays.extend(window.clone().map(|knot| !moves[knot]));
            part.knots.extend(window);
        }
    }
    (!part.passes.is_empty()).then_some(part)
}

/// Whether a knot moved across the path, or the heading at its place changed.
fn has_moved(before: &[Knot], now: &[Knot], knot: usize, pass: &PassKnots) -> bool {
    let [from_first, to_end] = [knot - pass.first, pass.end() - 1 - knot];
    if from_first == 0 || to_end == 0 {
        return !pass.cut[usize::from(to_end == 0)];
    }
    if (from_first < AT_ENDS && !pass.cut[0]) || (to_end < AT_ENDS && !pass.cut[1]) {
        return true;
    }
    let (ahead, behind) = (&before[knot + 1], &before[knot - 1]);
    let way = [ahead[0] - behind[0], ahead[1] - behind[1]];
    let length = way[0].hypot(way[1]).max(1e-9);
    let moved = [
        now[knot][0] - before[knot][0],
        now[knot][1] - before[knot][1],
    ];
    let across = (way[0] * moved[1] - way[1] * moved[0]) / length;
    let along = (way[0] * moved[0] + way[1] * moved[1]) / length;
    let turn = now[knot][2] - before[knot][2] - (ahead[2] - behind[2]) / length * along;
    across.abs() > ACROSS_MIN || turn.abs() > TURN_MIN
}

/// Knots within `reach` of a moving one, or up to two squares farther.
fn near(knots: &[Knot], moves: &[bool], reach: f64) -> Vec<bool> {
    let squares = Squares::around(knots);
    let [columns, rows] = squares.counts;
    let mut held = vec![false; columns * rows];
    for (knot, _) in knots.iter().zip(moves).filter(|(_, moves)| **moves) {
        held[squares.number([knot[0], knot[1]])] = true;
    }
    let steps = (reach / squares.side) as usize + 1;
    let mut grown = vec![false; columns * rows];
    for (at, _) in held.iter().enumerate().filter(|(_, held)| **held) {
        let (column, row) = (at % columns, at / columns);
        for other in row.saturating_sub(steps)..(row + steps + 1).min(rows) {
            let up = (row.abs_diff(other) as f64 - 1.0).max(0.0) * squares.side;
            let aside = ((reach * reach - up * up).max(0.0).sqrt() / squares.side) as usize + 1;
            let from = column.saturating_sub(aside);
            let to = (column + aside + 1).min(columns);
            grown[other * columns + from..other * columns + to].fill(true);
        }
    }
    let is_near = |knot: &Knot| grown[squares.number([knot[0], knot[1]])];
    knots.iter().map(is_near).collect()
}

/// Squares of the box around the knots.
pub struct Squares {
    low: [f64; 2],
    side: f64,
    counts: [usize; 2],
}

impl Squares {
    /// Of a side of [`SQUARE`], or as many as there may be.
    pub fn around(knots: &[Knot]) -> Squares {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for knot in knots {
            for c in 0..2 {
                low[c] = low[c].min(knot[c]);
                high[c] = high[c].max(knot[c]);
            }
        }
        let size = [0, 1].map(|c| high[c] - low[c]);
        let longest = size[0].max(size[1]);
        let least = (longest / SQUARES_MAX.sqrt()).max((size[0] * size[1] / SQUARES_MAX).sqrt());
        let side = SQUARE.max(least);
        Squares {
            low,
            side,
            counts: size.map(|size| (size / side) as usize + 1),
        }
    }

    fn number(&self, at: [f64; 2]) -> usize {
        let [column, row] = self.place(at);
        row * self.counts[0] + column
    }

    /// Column and row of a point, or the nearest ones.
    fn place(&self, at: [f64; 2]) -> [usize; 2] {
        // A cast saturates; NaN is 0.
        [0, 1].map(|c| (((at[c] - self.low[c]) / self.side) as usize).min(self.counts[c] - 1))
    }

    /// Numbers of the squares that a point within `reach` of this one may be in.
    pub fn within(&self, at: [f64; 2], reach: f64) -> impl Iterator<Item = usize> {
        let [from, to] = [-reach, reach].map(|by| self.place(at.map(|c| c + by)));
        let columns = self.counts[0];
        (from[1]..=to[1]).flat_map(move |row| (from[0]..=to[0]).map(move |c| row * columns + c))
    }

    /// The numbers of points by the square that they are in, and for each square where its own begin.
    pub fn sorted(&self, points: impl Iterator<Item = [f64; 2]> + Clone) -> [Vec<u32>; 2] {
        let mut ends = vec![0; self.counts[0] * self.counts[1] + 1];
        let squares = points.map(|at| self.number(at));
        for square in squares.clone() {
            ends[square + 1] += 1;
        }
        for square in 1..ends.len() {
            ends[square] += ends[square - 1];
        }
        let firsts = ends.clone();
        let mut sorted = vec![0; firsts[firsts.len() - 1] as usize];
        for (point, square) in squares.enumerate() {
            sorted[ends[square] as usize] = point as u32;
            ends[square] += 1;
        }
        [firsts, sorted]
    }
}

/// The windows of a pass around its spans with a knot that is near.
fn windows(knots: &[Knot], near: &[bool], pass: &PassKnots) -> Vec<Range<usize>> {
    let mut windows: Vec<Range<usize>> = Vec::new();
    for span in pass
        .span_starts()
        .filter(|&span| near[span..span + 4].contains(&true))
    {
        match windows.last_mut() {
            Some(last) if length(knots, last.end, span) < APART => last.end = span + 4,
            _ => windows.push(span..span + 4),
        }
    }
    windows
}

/// Length of the path through these knots, a.
fn length(knots: &[Knot], from: usize, to: usize) -> f64 {
    let pairs = knots[from.min(to)..=to].windows(2);
    pairs
        .map(|pair| (pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1]))
        .sum()
}
