//! Bridges: neighbouring loops become one, without an interruption of flow.
//!
//! Two neighbouring loops are opened over a short stretch each, and joined by two parallel
//! connections that cover the area of the removed stretches. Bridges are chosen by their cost, the
//! cheapest first, as a minimum spanning forest (Kruskal 1956): every loop is reached by as few
//! bridges as possible.
//!
//! In: passes of a region (mm, rad), the walls. Out: fewer passes that cover about the same area.
//! Not covered: bridges over more than 2.6 a.

use crate::geometry::aperture::Aperture;
use crate::geometry::edge_index::EdgeIndex;
use crate::geometry::point_grid::PointGrid;
use crate::geometry::union_find::root;
use crate::plan::coverage::connections::connection;
use crate::plan::joining::bridge_cost::{Bridge, BridgeCosts, PairCosts};
use crate::plan::joining::bridge_tour::Tour;
use crate::plan::joining::links::{TURN_MAX_RAD, nearest_of_each};
use crate::plan::pass::LayerPass;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Longest bridge, and largest distance of the ends of an open bead that is treated like a loop, against a: neighbouring
/// beads are up to 2a apart.
const LENGTH_SHARE: f64 = 2.6;
/// Places tried along two neighbouring loops.
const PLACES: usize = 6;
/// Length first removed from either loop, against the extents of the aperture along the travel:
/// beads side by side, or the tip of a loop that meets the flank of another bead.
const OPENINGS: [f64; 3] = [1.7, 0.8, 0.3];
/// Least placements of a pass that is opened.
const COUNT_MIN: usize = 16;
/// Places of two loops, the cheapest, that are fitted where a bridge is built.
const FITTED: usize = 3;
/// Most moves of ends of openings, by a placement, that are tried to fit a bridge.
const FIT_TRIES: usize = 60;
/// Joins loops and open beads to adjacent loops where that is cheap; others are unchanged.
pub fn bridged(passes: Vec<LayerPass>, aperture: &Aperture, walls: &EdgeIndex) -> Vec<LayerPass> {
    let costs = BridgeCosts::of(&passes, aperture);
    let near = neighbours(&passes, LENGTH_SHARE * aperture.major_mm());
    let mut found: Vec<Candidate> = near
        .into_par_iter()
        .flat_map_iter(|(pair, places)| {
            let mut costs = costs.between(pair, &passes);
            candidates(&passes, pair, &places, aperture, walls, &mut costs)
        })
        .collect();
    found.sort_by(|x, y| {
        let by_cost = x.cost_mm2.total_cmp(&y.cost_mm2);
        by_cost.then(x.bridge.key().cmp(&y.bridge.key()))
    });
    let mut fine = fitted_tree(&found, &passes, aperture, walls, &costs);
    fine.extend(found.into_iter().map(|found| found.bridge));
    let tours = joined(&passes, &fine);
    let tours = tours.iter().zip(&passes);
    tours
        .filter(|(tour, _)| !tour.is_empty())
        .map(|(tour, pass)| tour.pass(pass, &passes, aperture.period_rad()))
        .collect()
}

/// A bridge that could be built.
struct Candidate {
    bridge: Bridge,
    /// The area that it wastes ([`BridgeCosts::cost_mm2`]).
    cost_mm2: f64,
}

/// For each bridge of the tree that the first ones make the best of those fitted between its loops,
/// and itself, should the fitted one be in the way of another.
fn fitted_tree(
    found: &[Candidate],
    passes: &[LayerPass],
    aperture: &Aperture,
    walls: &EdgeIndex,
    costs: &BridgeCosts,
) -> Vec<Bridge> {
    let mut parent: Vec<usize> = (0..passes.len()).collect();
    let (mut tree, mut of_pair) = (Vec::new(), BTreeMap::<_, Vec<&Candidate>>::new());
    for candidate in found {
        let loops = candidate.bridge.loops;
        of_pair.entry(loops).or_default().push(candidate);
        let [a, b] = loops.map(|number| root(&mut parent, number));
        if a != b {
            parent[a.max(b)] = a.min(b);
            tree.push(&candidate.bridge);
        }
    }
    let fits = tree.into_par_iter().flat_map_iter(|bridge| {
        let like = of_pair[&bridge.loops].iter().take(FITTED);
        let mut costs = costs.between(bridge.loops, passes);
        let fits = like.map(|like| fitted(like, passes, aperture, walls, &mut costs));
        let best = fits.min_by(|x, y| x.0.total_cmp(&y.0));
        let best = best.into_iter().map(|(_, best)| best);
        best.chain([bridge.clone()])
    });
    fits.collect()
}

/// The tours that the bridges, built one by one where they join two, make of the passes; some are
/// empty.
fn joined(passes: &[LayerPass], bridges: &[Bridge]) -> Vec<Tour> {
    let numbered = passes.iter().enumerate();
    let mut tours: Vec<Tour> = numbered.map(|(n, p)| Tour::of(n, p)).collect();
    // Which tour a loop belongs to.
    let mut tour_of: Vec<usize> = (0..passes.len()).collect();
    for bridge in bridges {
        let [a, b] = bridge.loops.map(|number| tour_of[number]);
        if a == b {
            continue;
        }
        let Some(joined) = tours[a].joined(&tours[b], bridge, passes) else {
            continue;
        };
        tours[a] = joined;
        tours[b] = Tour::default();
        for tour in &mut tour_of {
            if *tour == b {
                *tour = a;
            }
        }
    }
    tours
}

/// The bridge with the ends of its openings moved, placement by placement, to where it wastes
/// least, and its cost.
fn fitted(
    begun: &Candidate,
    passes: &[LayerPass],
    aperture: &Aperture,
    walls: &EdgeIndex,
    costs: &mut PairCosts,
) -> (f64, Bridge) {
    let mut best = (begun.cost_mm2, begun.bridge.clone());
    let Bridge { loops, crossed, .. } = begun.bridge;
    let all: Vec<[[isize; 2]; 2]> = moves(crossed).collect();
    let (mut number, mut vain) = (0, 0);
    // A move that helps is made again, until a round of all of them is in vain.
    for _ in 0..FIT_TRIES {
        let ends = moved(&best.1, all[number], passes);
        let other = ends.and_then(|ends| with_ways(passes, loops, ends, aperture, walls));
        let other = other.map(|other| (costs.cost_mm2(&other), other));
        match other.filter(|other| other.0 < best.0) {
            Some(other) => (best, vain) = (other, 0),
            None => (number, vain) = ((number + 1) % all.len(), vain + 1),
        }
        if vain == all.len() {
            break;
        }
    }
    best
}

/// How the ends of the openings of both loops are moved: one of them, or the two that a connection
/// joins, by one placement to the same side.
fn moves(crossed: bool) -> impl Iterator<Item = [[isize; 2]; 2]> {
    let ends = [0, 1].into_iter();
    let stepped = ends.flat_map(|end| [-1, 1].map(|step| (end, step)));
    stepped.flat_map(move |(end, step)| {
        let mut moves = [[[0; 2]; 2]; 3];
        moves[0][0][end] = step;
        moves[1][1][end] = step;
        moves[2][0][end] = step;
        moves[2][1][end ^ usize::from(crossed)] = if crossed { -step } else { step };
        moves
    })
}

/// The ends of a bridge's openings after such a move; `None` if it would close one, make it too
/// long, or move the ends of a run.
fn moved(bridge: &Bridge, moves: [[isize; 2]; 2], passes: &[LayerPass]) -> Option<[[usize; 2]; 2]> {
    let mut ends = bridge.ends;
    for side in [0, 1] {
        if moves[side] == [0, 0] {
            continue;
        }
        let pass = &passes[bridge.loops[side]];
        let count = pass.placements.len();
        for end in [0, 1] {
            let at = ends[side][end].checked_add_signed(moves[side][end]);
            ends[side][end] = match (at, pass.closed) {
                (Some(at), _) if at < count => at,
                (Some(at), true) => at - count,
                (None, true) => count - 1,
                _ => return None,
            };
        }
        let [from, to] = ends[side];
        let is_forwards = pass.closed || bridge.ends[side][0] < bridge.ends[side][1] && from < to;
        let between = (to + count - from) % count;
        if !is_forwards || !(1..=COUNT_MIN / 2).contains(&between) {
            return None;
        }
    }
    Some(ends)
}

/// Pairs of loops with the places where they are close: placement of the one, of the other, and
/// their distance, in whole nanometres.
type Near = BTreeMap<[usize; 2], Vec<(usize, usize, f64)>>;

fn neighbours(passes: &[LayerPass], reach_mm: f64) -> Near {
    let numbered = passes.iter().enumerate();
    let joinable = numbered.filter(|(_, pass)| pass.kind.follows_walls());
    let all = joinable.flat_map(|(number, pass)| {
        let placements = pass.placements.iter().enumerate();
        placements.map(move |(i, placement)| (placement.at.center, (number, i)))
    });
    let index = PointGrid::of(reach_mm, all.clone());
    let mut near = Near::new();
    for (own, (number, i)) in all {
        for (other, j, apart) in nearest_of_each(&index, passes, number + 1, own, reach_mm) {
            near.entry([number, other]).or_default().push((i, j, apart));
        }
    }
    near
}

/// The bridges that are possible between two loops, with their costs.
fn candidates(
    passes: &[LayerPass],
    loops: [usize; 2],
    places: &[(usize, usize, f64)],
    aperture: &Aperture,
    walls: &EdgeIndex,
    costs: &mut PairCosts,
) -> Vec<Candidate> {
    let size = places.len().div_ceil(PLACES).max(1);
    let nearest = |group: &[(usize, usize, f64)]| {
        let nearest = group.iter().min_by(|x, y| x.2.total_cmp(&y.2));
        nearest.map(|&(i, j, _)| [i, j])
    };
    let mut candidate = |bridge: Bridge| {
        let cost_mm2 = costs.cost_mm2(&bridge);
        Candidate { bridge, cost_mm2 }
    };
    let own_gaps = [0, 1].into_iter().filter_map(|side| {
        let bridge = bridge_at_gap(passes, loops, side, places, aperture, walls)?;
        Some(candidate(bridge))
    });
    let own_gaps: Vec<Candidate> = own_gaps.collect();
    let places = places.chunks(size).filter_map(nearest);
    let found = places.filter_map(|at| {
        let opened = OPENINGS.into_iter().filter_map(|opening| {
            let bridge = bridge(passes, loops, at, opening, aperture, walls)?;
            Some(candidate(bridge))
        });
        opened.min_by(|x, y| x.cost_mm2.total_cmp(&y.cost_mm2))
    });
    found.chain(own_gaps).collect()
}

/// The bridge to an open bead whose ends are close to each other: it is open already.
fn bridge_at_gap(
    passes: &[LayerPass],
    loops: [usize; 2],
    side: usize,
    places: &[(usize, usize, f64)],
    aperture: &Aperture,
    walls: &EdgeIndex,
) -> Option<Bridge> {
    let run = &passes[loops[side]];
    if run.closed || run.placements.len() < 2 {
        return None;
    }
    let last = run.placements.len() - 1;
    let gap_mm = (run.placements[last].at.center - run.placements[0].at.center).norm();
    if gap_mm > LENGTH_SHARE * aperture.major_mm() {
        return None;
    }
    // Where the other one passes either end.
    let facing = |end: usize| {
        let own = |place: &(usize, usize, f64)| [place.0, place.1][side];
        let of_end = places.iter().filter(|place| own(place) == end);
        let best = of_end.min_by(|x, y| x.2.total_cmp(&y.2))?;
        Some([best.1, best.0][side])
    };
    let (at_last, at_first) = (facing(last)?, facing(0)?);
    let other = &passes[loops[1 - side]];
    let count = other.placements.len();
    let ahead = (at_first + count - at_last) % count;
    let behind = (at_last + count - at_first) % count;
    if ahead.min(behind) > COUNT_MIN {
        return None;
    }
    let middle = if ahead < behind {
        at_last + ahead / 2
    } else {
        at_first + behind / 2
    };
    let opening = opened_at(other, middle % count, OPENINGS[0], aperture)?;
    let mut ends = [[last, 0]; 2];
    ends[1 - side] = opening;
    with_ways(passes, loops, ends, aperture, walls)
}

/// The bridge about placements `at` of two loops, each opened over `opening` extents.
fn bridge(
    passes: &[LayerPass],
    loops: [usize; 2],
    at: [usize; 2],
    opening: f64,
    aperture: &Aperture,
    walls: &EdgeIndex,
) -> Option<Bridge> {
    let opened = |side: usize| opened_at(&passes[loops[side]], at[side], opening, aperture);
    with_ways(passes, loops, [opened(0)?, opened(1)?], aperture, walls)
}

/// The bridge between two openings, if there are connections.
fn with_ways(
    passes: &[LayerPass],
    loops: [usize; 2],
    ends: [[usize; 2]; 2],
    aperture: &Aperture,
    walls: &EdgeIndex,
) -> Option<Bridge> {
    let pose = |side: usize, end: usize| passes[loops[side]].placements[ends[side][end]].at;
    let apart = |m: usize, n: usize| (pose(0, m).center - pose(1, n).center).norm();
    let crossed = apart(0, 0) + apart(1, 1) > apart(0, 1) + apart(1, 0);
    let way = |end: usize| {
        let (from, to) = (pose(0, end), pose(1, end ^ usize::from(crossed)));
        let mut way = connection(from, to, TURN_MAX_RAD, aperture, walls)?;
        way.pop();
        Some(way)
    };
    Some(Bridge {
        loops,
        ends,
        crossed,
        ways: [way(0)?, way(1)?],
    })
}

/// The placements before and after `at` between which the pass is opened.
fn opened_at(pass: &LayerPass, at: usize, opening: f64, aperture: &Aperture) -> Option<[usize; 2]> {
    let count = pass.placements.len();
    if count < COUNT_MIN {
        return None;
    }
    let pose = |i: usize| pass.placements[i % count].at;
    let ahead = pose(at + 1).center - pose(at + count - 1).center;
    let along = ahead.try_normalize(1e-12).unwrap_or(ahead);
    let half_mm = 0.5 * opening * aperture.extent_mm(pose(at).heading_rad, along);
    let walk = |step: &dyn Fn(usize) -> usize| {
        let mut walked_mm = 0.0;
        let mut k = 0;
        while walked_mm < half_mm && k < COUNT_MIN / 4 {
            walked_mm += (pose(step(k + 1)).center - pose(step(k)).center).norm();
            k += 1;
        }
        step(k) % count
    };
    let ends = [walk(&|k| at + count - k), walk(&|k| at + k)];
    (pass.closed || ends[0] < ends[1]).then_some(ends)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Point2;
    use crate::geometry::clearance::is_inside;
    use crate::geometry::test_shapes::{self, ELLIPSE as APERTURE, star};
    use crate::plan::coverage::gap_raster::GapRaster;
    use crate::plan::headings::runs::unwrap_headings;
    use crate::plan::pass::Placement;
    use crate::plan::pass::test_passes::{arc, run};
    use std::f64::consts::{PI, TAU};

    /// Circles about the origin, each with its inside to its left: the outermost bounds the part.
    fn walls(radii_mm: &[f64]) -> EdgeIndex {
        let circles: Vec<_> = radii_mm.iter().map(|r| star(300, |_| *r)).collect();
        let rings: Vec<&[[f64; 2]]> = circles.iter().map(Vec::as_slice).collect();
        test_shapes::walls(&rings)
    }

    fn no_jumps(pass: &LayerPass) {
        let around = pass.closed.then(|| pass.placements[0]);
        let mut last: Option<Placement> = None;
        for placement in pass.placements.iter().copied().chain(around) {
            if let Some(last) = last.replace(placement) {
                assert!((placement.at.center - last.at.center).norm() < 0.35);
                let turn = placement.at.heading_rad - last.at.heading_rad;
                let lap = (turn / PI).round() * PI;
                assert!(lap == 0.0 || around.is_some_and(|first| first == placement));
                assert!((turn - lap).abs() < 0.6, "{turn}");
            }
        }
    }

    /// Goal: a loop with one inside it and two beside each other in that become one closed pass,
    /// which covers what they covered, inside the walls and without a jump. Method: circles.
    #[test]
    fn loops_that_hang_together_become_one() {
        let walls = walls(&[5.6]);
        let at = |x: f64| Point2::new(x, 0.0);
        let passes = vec![
            arc(at(0.0), 5.0, 0.3, TAU),
            arc(at(0.0), 3.8, 2.0, TAU),
            arc(at(-1.55), 0.9, 1.0, TAU),
            arc(at(1.55), 0.9, 1.0, -TAU),
        ];
        let before = GapRaster::of(&passes, &APERTURE, &walls).covered_pct();
        let joined = bridged(passes, &APERTURE, &walls);
        assert_eq!(joined.len(), 1);
        assert!(joined[0].closed);
        no_jumps(&joined[0]);
        for placement in &joined[0].placements {
            assert!(is_inside(&APERTURE, placement.at, &walls, -2e-3));
        }
        let after = GapRaster::of(&joined, &APERTURE, &walls).covered_pct();
        assert!(after > before - 0.2, "{before} {after}");
    }

    /// Goal: a bridge is fitted to nearly the best openings there are. Method: begun too wide or
    /// too narrow, against all openings whose ends lie up to four placements from where it began.
    #[test]
    fn openings_are_fitted_nearly_as_well_as_can_be() {
        let (walls, center) = (walls(&[5.6]), Point2::origin());
        let passes = vec![arc(center, 5.0, 0.3, TAU), arc(center, 3.8, 2.0, TAU)];
        let all_costs = BridgeCosts::of(&passes, &APERTURE);
        let mut costs = all_costs.between([0, 1], &passes);
        let at = |side: usize| {
            let place = |p: &Placement| p.at.center.y.atan2(p.at.center.x).abs();
            let numbered = passes[side].placements.iter().enumerate();
            let first = numbered.min_by(|x, y| place(x.1).total_cmp(&place(y.1)));
            first.expect("placements").0
        };
        for opening in [0.4, 2.4] {
            let begun = bridge(&passes, [0, 1], [at(0), at(1)], opening, &APERTURE, &walls);
            let begun = begun.expect("a bridge");
            let cost = costs.cost_mm2(&begun);
            let mut least = cost;
            for number in 0..9usize.pow(4) {
                let by = |n: u32| (number / 9usize.pow(n) % 9) as isize - 4;
                let moves = [[by(0), by(1)], [by(2), by(3)]];
                let ends = moved(&begun, moves, &passes);
                let other =
                    ends.and_then(|ends| with_ways(&passes, [0, 1], ends, &APERTURE, &walls));
                if let Some(other) = other {
                    least = least.min(costs.cost_mm2(&other));
                }
            }
            let begun = Candidate {
                bridge: begun,
                cost_mm2: cost,
            };
            let (fitted, _) = fitted(&begun, &passes, &APERTURE, &walls, &mut costs);
            assert!(cost > 1.5 * least, "{cost} {least}");
            assert!(fitted < 1.2 * least, "{cost} {fitted} {least}");
        }
    }

    /// Goal: a loop whose tip meets the flank of a run hangs in it like one that lies beside it.
    /// Method: a loop 0.7 mm wide and 2.7 mm long that stands on a run; both ends of the run stay.
    #[test]
    fn the_tip_of_a_loop_hangs_in_a_flank() {
        let flank = run([-4.0, 0.0], [4.0, 0.0]);
        let mut tip = arc(Point2::new(0.0, 1.55), 0.35, -PI, PI);
        let parts = [
            run([0.35, 1.55], [0.35, 3.55]),
            arc(Point2::new(0.0, 3.55), 0.35, 0.0, PI),
            run([-0.35, 3.55], [-0.35, 1.55]),
        ];
        let parts = parts.into_iter().flat_map(|part| part.placements);
        tip.placements.extend(parts);
        tip.closed = true;
        unwrap_headings(&mut tip.placements, PI);
        let ends = |pass: &LayerPass| {
            let last = pass.placements.len() - 1;
            [0, last].map(|i| pass.placements[i].at.center)
        };
        let joined = bridged(vec![flank.clone(), tip], &APERTURE, &walls(&[12.0]));
        assert_eq!((joined.len(), joined[0].closed), (1, false));
        assert_eq!(ends(&joined[0]), ends(&flank));
        no_jumps(&joined[0]);
    }

    /// Goal: nothing is joined through a wall. Method: two loops, a thin wall between them.
    #[test]
    fn loops_behind_a_wall_stay_apart() {
        let center = Point2::origin();
        let passes = || vec![arc(center, 5.0, 0.3, TAU), arc(center, 3.78, 2.0, TAU)];
        assert_eq!(bridged(passes(), &APERTURE, &walls(&[5.6])).len(), 1);
        let apart = bridged(passes(), &APERTURE, &walls(&[5.6, 4.4, 4.38]));
        assert_eq!(apart, passes());
    }

    /// Goal: a run whose ends lie close together hangs in a loop like one. Method: an open ring
    /// inside a closed one; the result is closed.
    #[test]
    fn an_open_ring_hangs_in_its_neighbour() {
        let center = Point2::origin();
        let passes = vec![
            arc(center, 5.0, 0.3, TAU),
            arc(center, 3.8, 2.0, TAU - 0.15),
        ];
        let joined = bridged(passes, &APERTURE, &walls(&[5.6]));
        assert_eq!((joined.len(), joined[0].closed), (1, true));
        no_jumps(&joined[0]);
    }

    /// Goal: runs around a ring become a loop whatever their order and direction, with all their
    /// placements. Method: a circle in three arcs, one of them backwards.
    #[test]
    fn runs_around_a_ring_become_a_loop() {
        let center = Point2::origin();
        let third = TAU / 3.0;
        let runs = vec![
            arc(center, 5.0, 0.0, third - 0.1),
            arc(center, 5.0, 2.0 * third, third - 0.1),
            arc(center, 5.0, 2.0 * third - 0.1, 0.1 - third),
        ];
        let placed: usize = runs.iter().map(|run| run.placements.len()).sum();
        let chained = crate::plan::joining::chains::chained(runs, &APERTURE, &walls(&[5.6]));
        assert_eq!((chained.len(), chained[0].closed), (1, true));
        assert!(chained[0].placements.len() > placed);
        no_jumps(&chained[0]);
    }
}
