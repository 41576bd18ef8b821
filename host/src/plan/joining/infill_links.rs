//! Joins sparse lines along the walls at which they end, without an interruption of flow.
//!
//! In: lines, their area. Out: fewer passes, unordered. The ends of lines are sorted along each wall; neighbours are
//! joined, each end once and no pass with itself, those first that have a single remaining neighbour (R. Karp and M.
//! Sipser, Maximum matching in sparse random graphs, 1981), so that rows become one pass there and back. From end to
//! end the nozzle slides along the wall as it is turned for the lines: turning takes longer than the path. Not
//! covered: ends at different walls, and paths so long that an interruption is faster.

use crate::geometry::aperture::Aperture;
use crate::geometry::clearance::Configuration;
use crate::geometry::edge_index::{Edge, EdgeIndex};
use crate::geometry::polygon::{Region, Ring};
use crate::geometry::union_find::root;
use crate::geometry::{Point2, Vector2};
use crate::plan::headings::profile::slide_inside;
use crate::plan::headings::runs::unwrap_headings;
use crate::plan::pass::{Contact, LayerPass, Placement};
use std::collections::BTreeSet;

/// Longest path along a wall, relative to a: an interruption takes as long as some 25 mm of path, and stops the flow.
const LENGTH_SHARE: f64 = 35.0;
/// Largest distance of the middle of a line's end from the wall, relative to a.
const NEAR_SHARE: f64 = 3.0;
/// Distance of placements along the wall, against b.
const STEP_SHARE: f64 = 0.5;
/// Most slides of a placement off the walls, and its permitted cut afterwards.
const SLIDES: usize = 8;
const CUT_SHARE: f64 = 1e-3;
/// Orders in which ends are joined, to see which leaves the fewest passes; fewer where there are so many gaps.
const TRIALS_MAX: usize = 64;
const TRIED_GAPS_MAX: usize = 20_000;

/// Joins lines along the walls of `open`.
pub fn linked_along_walls(
    lines: Vec<LayerPass>,
    open: &[Region],
    aperture: &Aperture,
) -> Vec<LayerPass> {
    let edges = open.iter().flat_map(Region::edges);
    let edges = edges.map(|(a, b)| Edge { a, b });
    let ground = EdgeIndex::new(edges.collect(), aperture.major_mm());
    let rings: Vec<WallRing> = open
        .iter()
        .flat_map(Region::rings)
        .map(WallRing::of)
        .collect();
    let along = AlongWalls {
        rings,
        ground,
        aperture,
    };
    let links = along.links(&lines);
    chained(lines, links, aperture)
}

/// One of both ends of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct LineEnd {
    line: usize,
    is_last: bool,
}

impl LineEnd {
    fn of(self, lines: &[LayerPass]) -> Option<&Placement> {
        let placements = &lines[self.line].placements;
        match self.is_last {
            true => placements.last(),
            false => placements.first(),
        }
    }

    fn other(self) -> LineEnd {
        LineEnd {
            is_last: !self.is_last,
            ..self
        }
    }

    /// Its index in a list with two ends per line.
    fn number(self) -> usize {
        2 * self.line + usize::from(self.is_last)
    }
}

/// A path from the end of a line to an end of another.
struct Link {
    ends: [LineEnd; 2],
    path: Vec<Placement>,
}

/// Two ends that follow each other along a wall.
struct Gap {
    ring: usize,
    ends: [LineEnd; 2],
    /// Their positions along the ring, the second beyond the first.
    at_mm: [f64; 2],
}

impl Gap {
    fn length_mm(&self) -> f64 {
        let [from_mm, to_mm] = self.at_mm;
        to_mm - from_mm
    }
}

/// The lines in passes from free end to free end, in the order of their first lines.
fn chained(lines: Vec<LayerPass>, links: Vec<Link>, aperture: &Aperture) -> Vec<LayerPass> {
    let mut link_at: Vec<Option<usize>> = vec![None; 2 * lines.len()];
    for (number, link) in links.iter().enumerate() {
        for end in link.ends {
            link_at[end.number()] = Some(number);
        }
    }
    let mut is_laid = vec![false; lines.len()];
    let mut passes = Vec::new();
    for line in 0..lines.len() {
        let ends = [false, true].map(|is_last| LineEnd { line, is_last });
        let free = ends.into_iter().find(|end| link_at[end.number()].is_none());
        // No pass is closed: each has a line with a free end.
        let Some(free) = free.filter(|_| !is_laid[line]) else {
            continue;
        };
        let mut pass = LayerPass {
            placements: Vec::new(),
            ..lines[line].clone()
        };
        let mut next = Some(free);
        while let Some(entered) = next.take() {
            is_laid[entered.line] = true;
            lay(
                &mut pass.placements,
                &lines[entered.line].placements,
                entered.is_last,
            );
            let left = entered.other();
            if let Some(link) = link_at[left.number()].and_then(|number| links.get(number)) {
                let is_back = link.ends[1] == left;
                lay(&mut pass.placements, &link.path, is_back);
                next = Some(link.ends[usize::from(!is_back)]);
            }
        }
        unwrap_headings(&mut pass.placements, aperture.period_rad());
        passes.push(pass);
    }
    passes
}

/// Appends placements, in reverse order if they are followed backwards.
fn lay(placements: &mut Vec<Placement>, added: &[Placement], is_back: bool) {
    match is_back {
        true => placements.extend(added.iter().rev()),
        false => placements.extend(added),
    }
}

/// A ring with the length up to each of its points.
struct WallRing<'a> {
    ring: &'a Ring,
    lengths_mm: Vec<f64>,
}

impl<'a> WallRing<'a> {
    fn of(ring: &'a Ring) -> WallRing<'a> {
        let mut lengths_mm = vec![0.0];
        for (a, b) in ring.edges() {
            lengths_mm.push(lengths_mm[lengths_mm.len() - 1] + (b - a).norm());
        }
        WallRing { ring, lengths_mm }
    }

    fn perimeter_mm(&self) -> f64 {
        self.lengths_mm[self.lengths_mm.len() - 1]
    }

    /// Distance of a point from the ring, and the position of the nearest point along it.
    fn nearest(&self, p: Point2) -> (f64, f64) {
        let mut best = (f64::INFINITY, 0.0);
        for (edge, (a, b)) in self.ring.edges().enumerate() {
            let along = b - a;
            let t = (p - a).dot(&along) / along.norm_squared().max(f64::MIN_POSITIVE);
            let t = t.clamp(0.0, 1.0);
            let apart_mm = (p - (a + along * t)).norm();
            if apart_mm < best.0 {
                best = (apart_mm, self.lengths_mm[edge] + t * along.norm());
            }
        }
        best
    }

    /// Point and inward normal at a length along it, which may be beyond either end.
    fn at(&self, length_mm: f64) -> (Point2, Vector2) {
        let within_mm = length_mm.rem_euclid(self.perimeter_mm());
        let points = &self.ring.points;
        let edge = self.lengths_mm.partition_point(|&l| l <= within_mm);
        let edge = edge.clamp(1, points.len()) - 1;
        let (a, b) = (points[edge], points[(edge + 1) % points.len()]);
        let along = (b - a).try_normalize(1e-12).unwrap_or(Vector2::x());
        let point = a + along * (within_mm - self.lengths_mm[edge]);
        (point, Vector2::new(-along.y, along.x))
    }
}

/// Data for paths along the walls.
struct AlongWalls<'a> {
    rings: Vec<WallRing<'a>>,
    ground: EdgeIndex,
    aperture: &'a Aperture,
}

impl AlongWalls<'_> {
    /// The pairs of ends that are joined, with their paths.
    fn links(&self, lines: &[LayerPass]) -> Vec<Link> {
        let (mut gaps, mut paths) = (Vec::new(), Vec::new());
        for gap in self.gaps(lines) {
            let [Some(end), Some(start)] = gap.ends.map(|end| end.of(lines)) else {
                continue;
            };
            if let Some(path) = self.path(end, start, &gap) {
                paths.push(path);
                gaps.push(gap);
            }
        }
        let chosen = most_links(&gaps, lines.len());
        let link = |number: usize| Link {
            ends: gaps[number].ends,
            path: std::mem::take(&mut paths[number]),
        };
        chosen.into_iter().map(link).collect()
    }

    /// The gaps between consecutive ends along a wall, no longer than a link may be.
    fn gaps(&self, lines: &[LayerPass]) -> Vec<Gap> {
        let mut of_rings: Vec<Vec<(f64, LineEnd)>> = vec![Vec::new(); self.rings.len()];
        for line in 0..lines.len() {
            for is_last in [false, true] {
                let end = LineEnd { line, is_last };
                let wall = end.of(lines).and_then(|end| self.wall_of(end.at));
                if let Some((ring, at_mm)) = wall {
                    of_rings[ring].push((at_mm, end));
                }
            }
        }
        let longest_mm = LENGTH_SHARE * self.aperture.major_mm();
        let mut gaps = Vec::new();
        for (ring, ends) in of_rings.iter_mut().enumerate() {
            ends.sort_by(|p, q| p.0.total_cmp(&q.0));
            let next = ends.iter().cycle().skip(1);
            for (&(from_mm, from), &(to_mm, to)) in ends.iter().zip(next) {
                let length_mm = (to_mm - from_mm).rem_euclid(self.rings[ring].perimeter_mm());
                if length_mm <= longest_mm && from.line != to.line {
                    gaps.push(Gap {
                        ring,
                        ends: [from, to],
                        at_mm: [from_mm, from_mm + length_mm],
                    });
                }
            }
        }
        gaps
    }

    /// The wall at a line's end, and the position along it.
    fn wall_of(&self, at: Configuration) -> Option<(usize, f64)> {
        let near_mm = NEAR_SHARE * self.aperture.major_mm();
        let walls = self.rings.iter().enumerate().map(|(number, ring)| {
            let (apart_mm, at_mm) = ring.nearest(at.center);
            (apart_mm, number, at_mm)
        });
        let (apart_mm, number, at_mm) = walls.min_by(|x, y| x.0.total_cmp(&y.0))?;
        (apart_mm <= near_mm).then_some((number, at_mm))
    }

    /// The placements from the end of a line along a wall to the start of another, turned as they are and touching
    /// it; `None` if that leaves the area.
    fn path(&self, end: &Placement, start: &Placement, gap: &Gap) -> Option<Vec<Placement>> {
        let heading_rad = end.at.heading_rad;
        let [from_mm, to_mm] = gap.at_mm;
        let step_mm = STEP_SHARE * self.aperture.minor_mm();
        let count = ((to_mm - from_mm) / step_mm).ceil().max(1.0) as usize;
        let mut path: Vec<Placement> = Vec::new();
        let mut last = end.at.center;
        for i in 0..=count {
            let share = (i as f64 + 0.5) / count as f64;
            let (point, normal) = self.rings[gap.ring].at(from_mm + share * (to_mm - from_mm));
            let touching = point + normal * self.aperture.support_mm(heading_rad, -normal);
            let goal = if i == count {
                start.at.center
            } else {
                touching
            };
            // Around a corner that projects into the area the touching places are far apart.
            let steps = ((goal - last).norm() / (2.0 * step_mm)).ceil().max(1.0) as usize;
            for step in 1..=steps {
                let center = last + (goal - last) * (step as f64 / steps as f64);
                let is_start = i == count && step == steps;
                let before = path.last().map_or(end.at.center, |placed| placed.at.center);
                let at = Configuration {
                    center,
                    heading_rad,
                };
                // In a corner that opens to the area they are the same; the start belongs to the next line.
                if is_start || (center - before).norm() < 0.5 * step_mm {
                    continue;
                }
                let at = slide_inside(at, self.aperture, &self.ground, SLIDES, CUT_SHARE)?;
                if (at.center - before).norm() >= 0.5 * step_mm {
                    let contact = Contact {
                        point,
                        normal,
                        length_mm: step_mm,
                        extent_mm: self.aperture.extent_mm(heading_rad, normal),
                        on_axis: false,
                    };
                    let feasible = true;
                    path.push(Placement {
                        at,
                        feasible,
                        contact,
                    });
                }
            }
            last = goal;
        }
        Some(path)
    }
}

/// The gaps to join: as many as one of several trials finds, and of these the shortest together.
fn most_links(gaps: &[Gap], lines: usize) -> Vec<usize> {
    let trials = (TRIED_GAPS_MAX / gaps.len().max(1)).clamp(1, TRIALS_MAX);
    let length_mm = |chosen: &[usize]| -> f64 {
        let lengths = chosen.iter().map(|&number| gaps[number].length_mm());
        lengths.sum()
    };
    (0..trials as u64)
        .map(|trial| Matching::of(gaps, lines, trial).chosen())
        .min_by(|p, q| {
            let more = q.len().cmp(&p.len());
            more.then(length_mm(p).total_cmp(&length_mm(q)))
        })
        .unwrap_or_default()
}

/// Gaps that are still to be joined, by their ends.
struct Matching<'a> {
    gaps: &'a [Gap],
    /// The gaps before and behind each end.
    of_end: Vec<Vec<usize>>,
    is_taken: Vec<bool>,
    /// The lines of a pass have one of them as their representative.
    parent: Vec<usize>,
    /// Ends by the number of their gaps and the trial's order; a number may be out of date, and too large then.
    queue: BTreeSet<(usize, u64, usize)>,
    trial: u64,
}

impl<'a> Matching<'a> {
    fn of(gaps: &'a [Gap], lines: usize, trial: u64) -> Matching<'a> {
        let mut of_end = vec![Vec::new(); 2 * lines];
        for (number, gap) in gaps.iter().enumerate() {
            for end in gap.ends {
                of_end[end.number()].push(number);
            }
        }
        let mut matching = Matching {
            gaps,
            queue: BTreeSet::new(),
            is_taken: vec![false; 2 * lines],
            parent: (0..lines).collect(),
            of_end,
            trial,
        };
        for end in 0..2 * lines {
            matching.enqueue(end);
        }
        matching
    }

    /// The first trial takes ends and gaps as they stand, the shorter gap first; others shuffle both.
    fn shuffled(&self, number: usize) -> u64 {
        if self.trial == 0 {
            return 0;
        }
        // A step of SplitMix64 (Steele and others, 2014).
        let mut mixed = (self.trial << 32 ^ number as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        mixed = (mixed ^ mixed >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        mixed ^ mixed >> 27
    }

    fn enqueue(&mut self, end: usize) {
        let count = self.possible(end).len();
        self.queue.insert((count, self.shuffled(end), end));
    }

    /// Gaps of an end along which two passes can be joined.
    fn possible(&mut self, end: usize) -> Vec<usize> {
        let (gaps, is_taken, parent) = (self.gaps, &self.is_taken, &mut self.parent);
        let is_possible = |number: &usize| {
            let [from, to] = gaps[*number].ends;
            !is_taken[from.number()]
                && !is_taken[to.number()]
                && root(parent, from.line) != root(parent, to.line)
        };
        self.of_end[end]
            .iter()
            .copied()
            .filter(is_possible)
            .collect()
    }

    /// Joins gaps until none is left.
    fn chosen(mut self) -> Vec<usize> {
        let mut chosen = Vec::new();
        while let Some((count, _, end)) = self.queue.pop_first() {
            let possible = self.possible(end);
            if possible.len() < count {
                self.enqueue(end);
                continue;
            }
            let next = possible.into_iter().min_by(|&p, &q| {
                let order = self.shuffled(p).cmp(&self.shuffled(q));
                let gaps = self.gaps;
                order.then(gaps[p].length_mm().total_cmp(&gaps[q].length_mm()))
            });
            if let Some(number) = next {
                self.join(number);
                chosen.push(number);
            }
        }
        chosen
    }

    /// Takes both ends of a gap; those beside them have fewer gaps then.
    fn join(&mut self, number: usize) {
        let ends = self.gaps[number].ends;
        let [from, to] = ends.map(|end| root(&mut self.parent, end.line));
        self.parent[from] = to;
        for end in ends {
            self.is_taken[end.number()] = true;
        }
        for end in ends {
            for gap in self.of_end[end.number()].clone() {
                for beside in self.gaps[gap].ends {
                    self.enqueue(beside.number());
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::clearance::is_inside;
    use crate::geometry::test_shapes::{ELLIPSE, region};
    use crate::plan::pass::test_passes::run;

    /// Goal: lines across a room become one pass, without a jump, inside the walls. Method: five
    /// lines 4 mm apart, there and back, and one behind a wall between.
    #[test]
    fn lines_are_joined_along_the_wall_they_end_at() {
        let room =
            |low: f64, high: f64| region(&[&[[low, 0.0], [high, 0.0], [high, 12.0], [low, 12.0]]]);
        let open = [room(0.0, 21.0), room(24.0, 30.0)];
        let line = |i: u32| {
            let x = 2.0 + 4.0 * f64::from(i);
            if i.is_multiple_of(2) {
                run([x, 0.3], [x, 11.7])
            } else {
                run([x, 11.7], [x, 0.3])
            }
        };
        let lines: Vec<LayerPass> = [0, 1, 2, 3, 4, 6].into_iter().map(line).collect();
        let joined = linked_along_walls(lines, &open, &ELLIPSE);
        assert_eq!(joined.len(), 2);
        assert!(joined[0].placements.len() > joined[1].placements.len());
        for pair in joined[0].placements.windows(2) {
            assert!(
                (pair[1].at.center - pair[0].at.center).norm() < 0.35,
                "{pair:?}"
            );
            let turn_rad = pair[1].at.heading_rad - pair[0].at.heading_rad;
            assert!(turn_rad.abs() < 1e-9, "{pair:?}");
        }
        let walls = EdgeIndex::of_region(&open[0], 0.6);
        for placement in &joined[0].placements {
            assert!(is_inside(&ELLIPSE, placement.at, &walls, -0.01));
        }
    }
}
