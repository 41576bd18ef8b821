//! Chains: open passes whose ends are close together become one, or a loop.
//!
//! A ring in whose sharp corners no bead fits is divided into runs from corner to corner; bead
//! channels end where others begin. The ends are joined by straight connections, those first that
//! cover the least area again; each end is joined once at most ([`super::end_matching`]).
//!
//! In: open passes (mm, rad), the walls. Out: the passes, joined where that covers little area
//! again (mm²).

use crate::geometry::aperture::Aperture;
use crate::geometry::edge_index::EdgeIndex;
use crate::geometry::point_grid::PointGrid;
use crate::plan::coverage::raster::NearbyPasses;
use crate::plan::headings::runs::unwrap_headings;
use crate::plan::joining::end_matching::{End, Pair, matched};
use crate::plan::joining::links::{Directed, LENGTH_SHARE, link, nearest_of_each};
use crate::plan::joining::order::{opened, rotated};
use crate::plan::pass::{LayerPass, Placement};
use rayon::prelude::*;
use std::collections::{HashMap, HashSet};
use std::sync::LazyLock;

/// Least placements of a run that is closed to a loop.
const LOOP_COUNT_MIN: usize = 16;

/// A connection from one end to the other, without both.
struct Join {
    ends: [End; 2],
    cost_mm2: f64,
    way: Vec<Placement>,
}

/// Joins the ends of open passes where that is cheap.
pub fn chained(passes: Vec<LayerPass>, aperture: &Aperture, walls: &EdgeIndex) -> Vec<LayerPass> {
    let near = near_ends(&passes, LENGTH_SHARE * aperture.major_mm());
    let nearby = LazyLock::new(|| NearbyPasses::of(&passes, aperture));
    let joins: Vec<Join> = near
        .into_par_iter()
        .filter_map(|ends| join(&passes, ends, &nearby, walls))
        .collect();
    joined_up(&passes, joins, aperture)
}

/// As many of the joins as there are ends for. A tour of all loops is open at one place anyway: if
/// no end would remain, the most expensive join is omitted, if it costs anything; else a loop may
/// begin anywhere.
fn chosen(pairs: &[Pair], ends_count: usize) -> Vec<usize> {
    let mut chosen = matched(pairs);
    if 2 * chosen.len() == ends_count {
        let cost = |at: usize| pairs[chosen[at]].1;
        let costly = (0..chosen.len()).filter(|&at| cost(at) > 0.0);
        let costliest = costly.max_by(|&i, &j| cost(i).total_cmp(&cost(j)).then(j.cmp(&i)));
        if let Some(at) = costliest {
            chosen.remove(at);
        }
    }
    chosen
}

/// The passes with as many of the joins as there are ends for.
fn joined_up(passes: &[LayerPass], mut joins: Vec<Join>, aperture: &Aperture) -> Vec<LayerPass> {
    let pairs: Vec<Pair> = joins.iter().map(|j| (j.ends, j.cost_mm2)).collect();
    let mut at_end: HashMap<End, (End, Vec<Placement>)> = HashMap::new();
    let open = passes.iter().filter(|pass| is_open_run(pass)).count();
    for number in chosen(&pairs, 2 * open) {
        let Join { ends, way, .. } = &mut joins[number];
        let back = way.iter().rev().copied().collect();
        at_end.insert(ends[0], (ends[1], std::mem::take(way)));
        at_end.insert(ends[1], (ends[0], back));
    }
    let mut taken = vec![false; passes.len()];
    let mut result = Vec::new();
    // Chains from their free ends first; the remaining ones are closed.
    for start_free in [true, false] {
        for number in 0..passes.len() {
            let free = [0, 1].map(|end| !at_end.contains_key(&(number, end)));
            if !taken[number] && start_free == (free[0] || free[1]) {
                let from = (number, usize::from(!free[0] && free[1]));
                result.push(chain(passes, from, &at_end, &mut taken, aperture));
            }
        }
    }
    result
}

/// A loop that the end of a run meets, opened there.
struct Meeting {
    /// The loop's number, and the loop as an open pass.
    number: usize,
    opened: LayerPass,
    join: Join,
}

/// Continues open beads whose ends meet a loop around it.
pub fn around_loops(
    mut passes: Vec<LayerPass>,
    aperture: &Aperture,
    walls: &EdgeIndex,
) -> Vec<LayerPass> {
    let near = ends_at_loops(&passes, LENGTH_SHARE * aperture.major_mm());
    if near.is_empty() {
        return passes;
    }
    let nearby = NearbyPasses::of(&passes, aperture);
    let mut meetings: Vec<Meeting> = near
        .into_par_iter()
        .flat_map_iter(|(end, place)| meetings_at(&passes, end, place, &nearby, walls))
        .collect();
    meetings.sort_by(|x, y| {
        let (x, y) = (&x.join, &y.join);
        x.cost_mm2.total_cmp(&y.cost_mm2).then(x.ends.cmp(&y.ends))
    });
    let mut joins: Vec<Join> = Vec::new();
    let mut taken = HashSet::new();
    for meeting in meetings {
        let run = meeting.join.ends[0];
        if !taken.contains(&run) && passes[meeting.number].closed {
            taken.insert(run);
            passes[meeting.number] = meeting.opened;
            joins.push(meeting.join);
        }
    }
    joined_up(&passes, joins, aperture)
}

/// Ends of open passes with the loops within `reach_mm`: the loop and its nearest placement.
fn ends_at_loops(passes: &[LayerPass], reach_mm: f64) -> Vec<(End, End)> {
    let numbered = || {
        passes
            .iter()
            .enumerate()
            .filter(|(_, p)| p.kind.follows_walls())
    };
    let is_loop = |pass: &LayerPass| pass.closed && pass.placements.len() >= LOOP_COUNT_MIN;
    let loops = numbered().filter(|(_, pass)| is_loop(pass));
    let places = loops.flat_map(|(number, pass)| {
        let placements = pass.placements.iter().enumerate();
        placements.map(move |(i, placement)| (placement.at.center, (number, i)))
    });
    let index = PointGrid::of(reach_mm, places);
    let mut near = Vec::new();
    for (number, pass) in numbered().filter(|(_, pass)| !pass.closed && !pass.placements.is_empty())
    {
        for end in [0, 1] {
            let own = pass.placements[end * (pass.placements.len() - 1)].at.center;
            let nearest = nearest_of_each(&index, passes, 0, own, reach_mm);
            near.extend(nearest.map(|(other, i, _)| ((number, end), (other, i))));
        }
    }
    near
}

/// The connections from the end of an open bead onto a loop, in both directions.
fn meetings_at(
    passes: &[LayerPass],
    end: End,
    (number, at): (usize, usize),
    nearby: &NearbyPasses,
    walls: &EdgeIndex,
) -> Vec<Meeting> {
    let aperture = nearby.aperture();
    let run = Directed {
        pass: &passes[end.0],
        backwards: end.1 == 0,
    };
    let ahead = rotated(passes[number].clone(), at, aperture.period_rad());
    let mut back = ahead.clone();
    back.placements.reverse();
    let either = [ahead, back].into_iter().filter_map(|pass| {
        let opened = opened(pass, aperture);
        let next = Directed {
            pass: &opened,
            backwards: false,
        };
        let (mut way, cost_mm2) = link(run, next, nearby, walls)?;
        way.pop();
        Some(Meeting {
            number,
            join: Join {
                ends: [end, (number, 0)],
                cost_mm2,
                way,
            },
            opened,
        })
    });
    either.collect()
}

/// True for passes with ends to join.
fn is_open_run(pass: &LayerPass) -> bool {
    pass.kind.follows_walls() && !pass.closed && !pass.placements.is_empty()
}

/// Pairs of ends of open passes within `reach_mm`.
fn near_ends(passes: &[LayerPass], reach_mm: f64) -> Vec<[End; 2]> {
    let place = |(number, end): End| {
        let placements = &passes[number].placements;
        placements[end * (placements.len() - 1)].at.center
    };
    let open = (0..passes.len()).filter(|&number| is_open_run(&passes[number]));
    let ends: Vec<End> = open.flat_map(|number| [(number, 0), (number, 1)]).collect();
    let index = PointGrid::of(reach_mm, ends.iter().map(|&end| (place(end), end)));
    let mut near = Vec::new();
    for &end in &ends {
        for &other in index.around(place(end)) {
            let own = end.0 == other.0;
            let long = passes[end.0].placements.len() >= LOOP_COUNT_MIN;
            if other > end && (!own || long) && (place(end) - place(other)).norm() < reach_mm {
                near.push([end, other]);
            }
        }
    }
    near
}

/// The connection between two ends, if there is a free and cheap one.
fn join(
    passes: &[LayerPass],
    ends: [End; 2],
    nearby: &NearbyPasses,
    walls: &EdgeIndex,
) -> Option<Join> {
    let directed = |(number, end): End, last: usize| Directed {
        pass: &passes[number],
        backwards: end != last,
    };
    let (mut way, cost_mm2) = link(directed(ends[0], 1), directed(ends[1], 0), nearby, walls)?;
    way.pop();
    Some(Join {
        ends,
        cost_mm2,
        way,
    })
}

/// The chain that begins at an end, along all its joins; closed if it returns there.
fn chain(
    passes: &[LayerPass],
    from: End,
    at_end: &HashMap<End, (End, Vec<Placement>)>,
    taken: &mut [bool],
    aperture: &Aperture,
) -> LayerPass {
    let first = &passes[from.0];
    let mut result = LayerPass {
        placements: Vec::new(),
        then: Vec::new(),
        ..*first
    };
    let mut entry = from;
    loop {
        taken[entry.0] = true;
        let mut placements = passes[entry.0].placements.clone();
        if entry.1 == 1 {
            placements.reverse();
        }
        result.placements.extend(placements);
        let Some((next, way)) = at_end.get(&(entry.0, 1 - entry.1)) else {
            break;
        };
        result.placements.extend(way);
        if *next == from {
            result.closed = true;
            break;
        }
        entry = *next;
    }
    unwrap_headings(&mut result.placements, aperture.period_rad());
    result
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Point2;
    use crate::geometry::test_shapes::{ELLIPSE as APERTURE, walls};
    use crate::plan::pass::test_passes::pass;
    use std::f64::consts::{FRAC_PI_4, TAU};

    const BOX: &[[f64; 2]] = &[[-20.0, -20.0], [20.0, -20.0], [20.0, 20.0], [-20.0, 20.0]];

    /// A circle of 3 mm about the origin, the aperture at 45° to it.
    fn ring() -> LayerPass {
        let angles = (0..188).map(|i| TAU * f64::from(i) / 188.0);
        let place = |t: f64| (Point2::new(3.0 * t.cos(), 3.0 * t.sin()), t + FRAC_PI_4);
        pass(angles.map(place), true)
    }

    /// A run along x to `to_mm` from there 4 mm further out.
    fn run(to_mm: f64) -> LayerPass {
        let places = (0..=40).map(|i| (Point2::new(to_mm + 0.1 * f64::from(i), 0.0), FRAC_PI_4));
        pass(places, false)
    }

    /// Goal: a run whose end meets a loop goes on around it, either end; one that ends far from it
    /// does not. Method: a ring and runs that end 1 mm and 2.5 mm outside it; the steps of the
    /// joined pass are short, and it is as long as both.
    #[test]
    fn a_run_goes_on_around_the_loop_it_meets() {
        let mut back = run(4.0);
        back.placements.reverse();
        for met in [run(4.0), back] {
            let joined = around_loops(vec![ring(), met], &APERTURE, &walls(&[BOX]));
            assert_eq!(joined.len(), 1);
            assert!(!joined[0].closed);
            for pair in joined[0].placements.windows(2) {
                assert!((pair[1].at.center - pair[0].at.center).norm() < 0.25);
                assert!((pair[1].at.heading_rad - pair[0].at.heading_rad).abs() < 0.5);
            }
            let length_mm = joined[0].length_mm();
            assert!(
                (length_mm - (TAU * 3.0 + 4.0 + 1.0)).abs() < 1.0,
                "{length_mm}"
            );
        }
        let apart = around_loops(vec![ring(), run(5.5)], &APERTURE, &walls(&[BOX]));
        assert_eq!(apart, vec![ring(), run(5.5)]);
    }

    /// Goal: a loop is opened once only. Method: two runs that meet it at opposite sides.
    #[test]
    fn a_loop_takes_up_one_run() {
        let mut other = run(4.0);
        for placement in &mut other.placements {
            placement.at.center.x *= -1.0;
        }
        let joined = around_loops(vec![run(4.0), ring(), other], &APERTURE, &walls(&[BOX]));
        assert_eq!(joined.len(), 2);
        assert!(joined.iter().all(|pass| !pass.closed));
    }
}
