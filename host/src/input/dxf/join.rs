//! Curves as chords -> contours: ends that meet become one point.
//!
//! Ends are joined in two rounds, those at the same point and then those within [`JOIN_MM`], each with
//! its mutual nearest neighbour. In and out: mm before `--scale`. Not covered: checking the contours:
//! open ones are refused, or repaired, in the stage that all formats share.

use crate::geometry::Point2;
use crate::geometry::point_grid::PointGrid;
use crate::geometry::polygon::Box2;
use crate::input::error::At;
use crate::input::outline::{RawRing, SIZE_MAX_MM};
use crate::text::refusal::{Refusal, refusal};
use std::collections::HashSet;

/// Ends closer than this are joined, mm: drawing programs round to three digits and more.
pub(super) const JOIN_MM: f64 = 0.01;
/// Ends closer than this are at the same place, mm: rounding.
const SAME_MM: f64 = 1.0e-4;
/// Maximum number of ends near one point that are checked: an outline has two.
const ENDS_MAX: usize = 64;
/// Most contours: nesting compares their boxes in pairs.
const CONTOURS_MAX: usize = 20_000;

/// An end of a piece: its number, and whether it is the last point.
type End = (usize, bool);

/// Contours from pieces, in the order of the file. Where more than two ends meet, none is joined if `may_branch`.
pub(in crate::input) fn contours(
    pieces: Vec<RawRing>,
    scale: f64,
    may_branch: bool,
    notes: &mut Vec<String>,
) -> Result<Vec<RawRing>, Refusal> {
    let mut pieces = without_copies(pieces, notes);
    let count = pieces.len();
    let is_line = |piece: &RawRing| piece.closed || extent_mm(&piece.points) > SAME_MM / scale;
    pieces.retain(is_line);
    let short = count - pieces.len();
    if short > 0 {
        notes.push(format!("{short} entities without length were left out"));
    }
    let mut links: Vec<[Option<End>; 2]> = vec![[None; 2]; pieces.len()];
    let all: Vec<Point2> = pieces
        .iter()
        .flat_map(|piece| piece.points.clone())
        .collect();
    let bounds = Box2::of(&all);
    let [mut same, mut near] = [Vec::new(), Vec::new()];
    // What is larger than any machine is refused as that; the grid does not reach so far.
    if !all.is_empty() && bounds.size().max() * scale <= SIZE_MAX_MM {
        let mut joined = |reach_mm: f64, is_exact| {
            let reach = (reach_mm / scale, bounds.min);
            link(&mut pieces, &mut links, reach, [is_exact, may_branch])
        };
        same = joined(SAME_MM, true)?;
        near = joined(JOIN_MM, false)?;
    }
    let widest = near.iter().fold(0.0, |widest: f64, gap| widest.max(*gap)) * scale;
    if !near.is_empty() {
        notes.push(format!(
            "{} of {} joints had a gap, up to {widest:.4} mm: the ends were moved together",
            near.len(),
            near.len() + same.len()
        ));
    }
    let rings = chains(&pieces, &links);
    match rings.len() > CONTOURS_MAX {
        true => Err(super::syntax(format!(
            "{} contours, more than {CONTOURS_MAX}: choose layers with --dxf-layer, or split the drawing",
            rings.len()
        ))),
        false => Ok(rings),
    }
}

fn extent_mm(points: &[Point2]) -> f64 {
    let from = points.first().copied().unwrap_or_default();
    let each = points.iter().map(|point| (point - from).norm());
    each.fold(0.0, f64::max)
}

/// The pieces without those that are drawn twice, forwards or backwards.
fn without_copies(pieces: Vec<RawRing>, notes: &mut Vec<String>) -> Vec<RawRing> {
    let bits = |point: &Point2| [point.x, point.y].map(|x| (x + 0.0).to_bits());
    let mut seen: HashSet<Vec<[u64; 2]>> = HashSet::new();
    let count = pieces.len();
    let mut kept = Vec::with_capacity(count);
    for piece in pieces {
        let forwards: Vec<[u64; 2]> = piece.points.iter().map(bits).collect();
        let backwards: Vec<[u64; 2]> = forwards.iter().rev().copied().collect();
        if seen.insert(forwards.min(backwards)) {
            kept.push(piece);
        }
    }
    if kept.len() < count {
        let copies = count - kept.len();
        notes.push(format!(
            "{copies} entities are drawn twice: one of each was read"
        ));
    }
    kept
}

/// Links free ends that are within reach; returns the gaps that were closed, mm.
fn link(
    pieces: &mut [RawRing],
    links: &mut [[Option<End>; 2]],
    (reach_mm, corner): (f64, Point2),
    [is_exact, may_branch]: [bool; 2],
) -> Result<Vec<f64>, Refusal> {
    let free: Vec<End> = (0..pieces.len())
        .filter(|&piece| !pieces[piece].closed)
        .flat_map(|piece| [(piece, false), (piece, true)])
        .filter(|&(piece, last)| links[piece][usize::from(last)].is_none())
        .collect();
    let places: Vec<Point2> = free.iter().map(|&end| place(pieces, end)).collect();
    // Counted from the drawing's corner: the grid's numbers are bounded.
    let in_grid = |place: &Point2| Point2::from(place - corner);
    let grid = PointGrid::of(reach_mm, places.iter().map(in_grid).zip(0..));
    let mut nearest: Vec<Option<usize>> = Vec::with_capacity(free.len());
    for (own, &at) in places.iter().enumerate() {
        let mut best: Option<(f64, usize)> = None;
        let mut within = 0;
        for (looked, &other) in grid.around(in_grid(&at)).enumerate() {
            let gap: f64 = (places[other] - at).norm();
            // A line's two ends are no joint.
            let is_own = free[other].0 == free[own].0 && pieces[free[own].0].points.len() < 3;
            if looked > ENDS_MAX {
                within = ENDS_MAX;
                break;
            }
            if other == own || is_own || gap > reach_mm {
                continue;
            }
            within += 1;
            if best.is_none_or(|found| (gap, other) < found) {
                best = Some((gap, other));
            }
        }
        if within > 1 && (is_exact || may_branch || within >= ENDS_MAX) {
            if !may_branch {
                return Err(refusal!(
                    "more than two ends meet at {at}: a contour goes through each place once; \
                     take the extra lines away, choose the outline's layers with --dxf-layer, or \
                     print lines as beads with --centre-lines",
                    at = At(at)
                ));
            }
            best = None;
        }
        nearest.push(best.map(|(_, other)| other));
    }
    let mut gaps = Vec::new();
    for (own, other) in nearest.iter().enumerate() {
        let Some(other) = other.filter(|&other| own < other && nearest[other] == Some(own)) else {
            continue;
        };
        let (a, b) = (free[own], free[other]);
        links[a.0][usize::from(a.1)] = Some(b);
        links[b.0][usize::from(b.1)] = Some(a);
        gaps.push((places[own] - places[other]).norm());
        let middle = nalgebra::center(&places[own], &places[other]);
        for (piece, last) in [a, b] {
            let points = &mut pieces[piece].points;
            let index = if last { points.len() - 1 } else { 0 };
            points[index] = middle;
        }
    }
    Ok(gaps)
}

fn place(pieces: &[RawRing], (piece, last): End) -> Point2 {
    let points = &pieces[piece].points;
    let found = if last { points.last() } else { points.first() };
    found.copied().unwrap_or_default()
}

/// Goes along the links: closed chains, and open ones from an end that is free.
fn chains(pieces: &[RawRing], links: &[[Option<End>; 2]]) -> Vec<RawRing> {
    let mut is_used = vec![false; pieces.len()];
    let mut rings = Vec::new();
    for first in 0..pieces.len() {
        if is_used[first] {
            continue;
        }
        // Back to the free end, or round to the beginning.
        let mut start: End = (first, false);
        let mut closed = pieces[first].closed;
        while let (false, Some((piece, last))) = (closed, links[start.0][usize::from(start.1)]) {
            start = (piece, !last);
            closed = start == (first, false);
        }
        let mut points: Vec<Point2> = Vec::new();
        let mut next = Some(start);
        while let Some((piece, from_last)) = next.filter(|end| !is_used[end.0]) {
            is_used[piece] = true;
            let of_piece = pieces[piece].points.iter().copied();
            match from_last {
                true => points.extend(of_piece.rev()),
                false => points.extend(of_piece),
            }
            next = links[piece][usize::from(!from_last)];
        }
        let what = format!("the contour with the {}", pieces[first].what);
        rings.push(RawRing {
            what,
            points,
            closed,
        });
    }
    rings
}
