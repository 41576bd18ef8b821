//! Points along a pass at which headings are chosen, with the range of each.
//!
//! In: lines, the bands of their legs. Out: [`Node`]s, close at the ends of legs and further apart between them.

use super::BeadLines;
use super::bands::{LegBands, TURN_REACH_SHARE};
use super::sides::{Choice, Range};
use crate::geometry::aperture::Aperture;
use crate::plan::route::bead_curve::{SPACING_GROWTH, steps_mm};

/// Distances of nodes at vertices and at most, in semi-axes a.
const STEP_SHARE: f64 = 0.3;
const STEP_MAX_SHARE: f64 = 2.0;
/// Nodes closer than this share of the least distance are one.
const MERGE_SHARE: f64 = 0.4;
/// Distance from a corner within which a bead may have nearly the width of the file's, and within which it may
/// have any, in semi-axes a: 1 mm and 0.42 mm of a nozzle of 1.2 mm.
const NEAR_REACH_SHARE: f64 = 5.0 / 3.0;
const FREE_REACH_SHARE: f64 = 0.7;
/// At most this share of a leg is free from either end: its middle has nearly its width.
const FREE_LEG_SHARE: f64 = 0.4;
/// Ranges that overlap by less than this are apart, rad.
const OVERLAP_RAD: f64 = 0.05;

/// A place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Node {
    pub place_mm: f64,
    /// The leg that it is on; of a vertex the one that ends there.
    pub leg: usize,
    pub range: Range,
}

/// The neighbourhood of one end of a leg.
#[derive(Clone, Copy, Debug, Default)]
struct Turning {
    /// Nearly of the width so far from the end, mm.
    near_mm: f64,
    /// Of any width so far from the end, mm, up to the range of the leg on the other side.
    free_mm: f64,
    other: Option<Range>,
}

/// Nodes of a pass.
pub fn nodes(lines: &BeadLines, legs: &[LegBands], aperture: &Aperture) -> Vec<Node> {
    let (major_mm, unit_mm) = (aperture.major_mm(), aperture.unit_mm());
    let turnings = turnings(lines, legs, major_mm);
    let step_mm = STEP_SHARE * major_mm;
    let mut found: Vec<Node> = Vec::new();
    let mut before_mm = 0.0;
    for (leg, length_mm) in lines.length_mm.iter().enumerate() {
        let range = |at_mm: f64| {
            let ends_mm = [at_mm, length_mm - at_mm];
            match ends_mm[0].min(ends_mm[1]) > TURN_REACH_SHARE * major_mm {
                true => legs[leg].choice.exact,
                false => range_at(&legs[leg].choice, ends_mm, &turnings[leg], step_mm),
            }
        };
        if leg == 0 {
            found.push(Node {
                place_mm: 0.0,
                leg,
                range: range(0.0),
            });
        }
        for end_mm in steps_mm(*length_mm, [step_mm; 2], STEP_MAX_SHARE * major_mm, unit_mm) {
            let place_mm = before_mm + end_mm;
            let is_close = found
                .last()
                .is_some_and(|last| place_mm - last.place_mm < MERGE_SHARE * step_mm);
            if !is_close {
                found.push(Node {
                    place_mm,
                    leg,
                    range: range(end_mm),
                });
            }
        }
        before_mm += length_mm;
    }
    // The last one is on the end.
    if found.len() > 1
        && let Some(last) = found.last_mut()
    {
        last.place_mm = before_mm;
    }
    found
}

/// The range at distances from both ends of a leg.
fn range_at(bands: &Choice, ends_mm: [f64; 2], turnings: &[Turning; 2], step_mm: f64) -> Range {
    let mut range = bands.far;
    for (at_mm, turning) in ends_mm.into_iter().zip(turnings) {
        if at_mm <= turning.near_mm {
            range = range.hull(&bands.near);
        }
        // The next node has to be within the reach: the bead is of any width up to there.
        let next_mm = step_mm + (1.0 + SPACING_GROWTH) * at_mm;
        if let Some(other) = turning.other
            && (at_mm <= 0.0 || next_mm <= turning.free_mm)
        {
            range = range.hull(&other);
        }
    }
    range
}

/// The neighbourhoods of the start and the end of each leg.
fn turnings(lines: &BeadLines, legs: &[LegBands], major_mm: f64) -> Vec<[Turning; 2]> {
    let end = Turning {
        near_mm: NEAR_REACH_SHARE * major_mm,
        ..Turning::default()
    };
    let count = legs.len();
    let mut found = vec![[Turning::default(); 2]; count];
    let kept: Vec<usize> = (0..count).filter(|leg| !legs[*leg].is_link).collect();
    if let (Some(first), Some(last)) = (kept.first(), kept.last()) {
        found[*first][0] = end;
        found[*last][1] = end;
    }
    for pair in kept.windows(2) {
        let [before, after] = [&legs[pair[0]].choice, &legs[pair[1]].choice];
        if before.far.overlap_rad(&after.far) >= OVERLAP_RAD {
            continue;
        }
        let link_mm: f64 = lines.length_mm[pair[0] + 1..pair[1]].iter().sum();
        let is_apart = before.near.overlap_rad(&after.near) < OVERLAP_RAD;
        let reach_mm = (FREE_REACH_SHARE * major_mm - 0.5 * link_mm).max(0.0);
        let turning = |leg: usize, other: &Choice| Turning {
            near_mm: NEAR_REACH_SHARE * major_mm,
            free_mm: reach_mm.min(FREE_LEG_SHARE * lines.length_mm[leg]),
            other: is_apart.then_some(other.near),
        };
        found[pair[0]][1] = turning(pair[0], after);
        found[pair[1]][0] = turning(pair[1], before);
    }
    found
}
