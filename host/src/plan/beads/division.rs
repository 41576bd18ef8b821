//! Which stretches of the axis get one bead and which get two sides.
//!
//! Two sides are needed where one bead is not wide enough (r > a), one bead where two would overlap (r
//! < 2b); between them, and a little beyond, either will do. There the number of flow interruptions
//! decides: a single bead ends where it changes into two sides, in a dead end and at a junction of an
//! odd number of single beads, and two ends make one pass (L. Euler, 1736). Two sides turn round and
//! have no end. All these ends are nodes with an odd number of single links, so the division is the
//! cheapest choice of single links with a price on odd nodes, whatever loops the axis has.
//!
//! In: axis with radii (mm), the necks among its nodes, widths of beads (mm). Out: for each node
//! whether a single bead is on it. Not covered: the exact ends of beads (the cut gives them).

use crate::geometry::aperture::Aperture;
use crate::plan::axis::pruned_axis::{Axis, flood};
use crate::plan::beads::bead_count::{TOO_NARROW, TOO_WIDE};
use crate::plan::beads::passes::PassSettings;
use crate::plan::beads::t_join::cheapest_links;

/// Length of badly divided axis that one end of a single run is worth, mm against a. Two ends are an
/// interruption of flow: as much as to cover 1.2 times the aperture's area again (ellipse of 0.6 x
/// 0.2 mm). Real slices divide the same from 9 to 10.
const END_SHARE: f64 = 9.5;
/// Cost of laying two beads where one would do, per mm.
const TWO_FOR_ONE: f64 = 0.05;
/// How much wider than the widest bead a stretch may be, against a, and still be one with what that bead spans, where
/// one bead is asked for: walls whose width varies by less than that have beads all of one kind.
pub const SPANNED_SLACK: f64 = 0.02;
/// Share of a that a single bead may need: the rest is for bends.
pub const WIDEST_SINGLE_SHARE: f64 = 0.89;

/// The nodes that single runs are on, necks among them. `is_neck` are the nodes too narrow for any
/// bead that do not just end in a corner.
pub fn cheapest_division(
    axis: &Axis,
    neighbours: &[Vec<u32>],
    is_neck: &[bool],
    settings: &PassSettings,
) -> Vec<bool> {
    let passages = Passages::new(axis, neighbours, is_neck, settings);
    let (links, costs) = passages.links();
    let end_cost = END_SHARE * settings.aperture.major_mm();
    let chosen = cheapest_links(axis.points.len(), &links, &costs, end_cost);
    let chosen = links.iter().zip(chosen).filter(|link| link.1);
    let mut single = passages.nodes_of(chosen.map(|link| link.0));
    passages.make_islands_single(&mut single, &links, &costs, end_cost);
    single
}

/// The axis and the beads on it.
struct Passages<'a> {
    axis: &'a Axis,
    neighbours: &'a [Vec<u32>],
    is_neck: &'a [bool],
    aperture: &'a Aperture,
    /// Where one bead is to span the passage because it can.
    is_spanned: Vec<bool>,
    /// What one bead costs more than two sides at the width of each node, per mm.
    more: Vec<f64>,
}

impl<'a> Passages<'a> {
    fn new(
        axis: &'a Axis,
        neighbours: &'a [Vec<u32>],
        is_neck: &'a [bool],
        settings: &'a PassSettings,
    ) -> Passages<'a> {
        let mut passages = Passages {
            axis,
            neighbours,
            is_neck,
            aperture: &settings.aperture,
            is_spanned: vec![false; axis.points.len()],
            more: Vec::new(),
        };
        if settings.one_pass {
            passages.is_spanned = passages.spanned_nodes();
        }
        let more = |node| passages.more_for_one_bead(node);
        passages.more = (0..axis.points.len()).map(more).collect();
        passages
    }

    /// The neighbours of a node into which something continues: nothing does through a neck.
    fn near(&self, node: usize) -> impl Iterator<Item = usize> {
        let near = self.neighbours[node].iter().map(|&n| n as usize);
        near.filter(|&n| !self.is_neck[n])
    }

    /// The links that are divided, and what one bead costs more on each than two sides.
    fn links(&self) -> (Vec<[u32; 2]>, Vec<f64>) {
        let points = &self.axis.points;
        let (mut links, mut costs) = (Vec::new(), Vec::new());
        for &[p, q] in &self.axis.links {
            let nodes = [p as usize, q as usize];
            if nodes.iter().any(|&node| self.is_neck[node]) {
                continue;
            }
            let half_mm = (points[nodes[0]] - points[nodes[1]]).norm() / 2.0;
            let cost = nodes.map(|node| half_mm * self.more[node]);
            links.push([p, q]);
            costs.push(cost[0] + cost[1]);
        }
        (links, costs)
    }

    /// See `more`.
    fn more_for_one_bead(&self, node: usize) -> f64 {
        let (a, b) = (self.aperture.major_mm(), self.aperture.minor_mm());
        let r = self.axis.radii_mm[node];
        let beads = r / (WIDEST_SINGLE_SHARE * a);
        let two_sides = if self.is_spanned[node] {
            TOO_WIDE
        } else {
            TOO_NARROW * (2.0 - r / b).max(0.0) + TWO_FOR_ONE
        };
        TOO_WIDE * (beads - 1.0).max(0.0) - two_sides
    }

    /// Marks the nodes that the widest bead spans, and with each the stretch around it that is wider by no more than a
    /// tolerance: a wall as wide as the bead, but for rounding, is one stretch.
    fn spanned_nodes(&self) -> Vec<bool> {
        let a = self.aperture.major_mm();
        let radii_mm = &self.axis.radii_mm;
        let is_near = |n: usize| radii_mm[n] <= (1.0 + SPANNED_SLACK) * a;
        let mut is_spanned = vec![false; radii_mm.len()];
        let mut seen = is_spanned.clone();
        for seed in 0..is_spanned.len() {
            if seen[seed] || radii_mm[seed] > a {
                continue;
            }
            for node in flood(seed, self.neighbours, &mut seen, is_near) {
                is_spanned[node] = true;
            }
        }
        is_spanned
    }

    /// The nodes of single runs: necks, joints and passages of at least two chosen links, ends of one.
    /// Where a single bead ends in a passage its last node is part of it if its width requires one bead.
    /// An axis of one point has no length to weigh: it is single only where it has to be.
    fn nodes_of<'l>(&self, chosen: impl Iterator<Item = &'l [u32; 2]>) -> Vec<bool> {
        let mut counts = vec![0; self.is_neck.len()];
        for node in chosen.flatten() {
            counts[*node as usize] += 1;
        }
        let is_single = |node: usize| {
            let fits_two = self.axis.radii_mm[node] >= 2.0 * self.aperture.minor_mm();
            match self.near(node).count() {
                0 => !fits_two,
                1 => counts[node] == 1,
                2 => counts[node] == 2 || counts[node] == 1 && self.more[node] < 0.0,
                _ => counts[node] >= 2,
            }
        };
        (0..counts.len())
            .map(|node| self.is_neck[node] || is_single(node))
            .collect()
    }

    /// Makes parts between necks that one bead spans single throughout if that costs no more: a
    /// part without ends still is a pass, which costs as much as two ends.
    fn make_islands_single(
        &self,
        single: &mut [bool],
        links: &[[u32; 2]],
        costs: &[f64],
        end_cost: f64,
    ) {
        let widest_mm = WIDEST_SINGLE_SHARE * self.aperture.major_mm();
        let mut more = vec![0.0; single.len()];
        for (link, cost) in links.iter().zip(costs) {
            more[link[0] as usize] += cost;
        }
        let mut seen = self.is_neck.to_vec();
        for seed in 0..single.len() {
            if seen[seed] {
                continue;
            }
            let island = flood(seed, self.neighbours, &mut seen, |n| !self.is_neck[n]);
            // The middle of a disk has no length to weigh its width by.
            let fits = |n: usize| !single[n] && self.axis.radii_mm[n] <= widest_mm;
            if !island.iter().all(|&n| fits(n)) {
                continue;
            }
            let ends = island.iter().filter(|&&n| self.near(n).count() % 2 == 1);
            let ends = ends.count() as f64;
            if island.iter().map(|&n| more[n]).sum::<f64>() + (ends - 2.0) * end_cost < 0.0 {
                for node in island {
                    single[node] = true;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Point2;
    use crate::geometry::test_shapes::ELLIPSE;
    use crate::plan::headings::profile::TURN_WEIGHT_MM4;
    use crate::settings::HeadingLaw;

    const SETTINGS: PassSettings = PassSettings {
        aperture: ELLIPSE,
        overlap: 0.0,
        one_pass: false,
        law: HeadingLaw::Tangent,
        turn_weight_mm4: TURN_WEIGHT_MM4,
    };

    /// A square of 10 mm with struts as its sides: half-width 0.5 mm at the joints, `least_mm` in the
    /// middle of each side; and an arm of the same kind from each joint outwards.
    fn square(least_mm: f64) -> Axis {
        let joints = [
            [0.0, 0.0],
            [10.0, 0.0],
            [10.0, 10.0],
            [0.0, 10.0],
            [-10.0, 0.0],
            [20.0, 0.0],
            [20.0, 10.0],
            [-10.0, 10.0],
        ];
        let mut axis = Axis::default();
        for joint in joints {
            axis.points.push(Point2::new(joint[0], joint[1]));
            axis.radii_mm.push(0.5);
        }
        let sides = [(0, 1), (1, 2), (2, 3), (3, 0)];
        let arms = [(0, 4), (1, 5), (2, 6), (3, 7)];
        for (p, q) in sides.into_iter().chain(arms) {
            let middle = axis.points.len() as u32;
            axis.points
                .push(nalgebra::center(&axis.points[p], &axis.points[q]));
            axis.radii_mm.push(least_mm);
            axis.links.push([p as u32, middle]);
            axis.links.push([middle, q as u32]);
        }
        axis.densified(0.1)
    }

    fn division(axis: &Axis, is_neck: &[bool]) -> Vec<bool> {
        cheapest_division(axis, &axis.neighbours(), is_neck, &SETTINGS)
    }

    /// Goal: a dead end a little too narrow for two sides keeps them, since a single run would end in it,
    /// and what goes on without an end is single; much narrower ones are single all over, joints too,
    /// and necks between wide places cut nothing else off. Method: a square with arms, half-widths
    /// 0.39, 0.25 and 0.5 mm (2b is 0.4).
    #[test]
    fn ends_of_single_runs_are_weighed_against_width() {
        let axis = square(0.39);
        let none = vec![false; axis.points.len()];
        let is_side = axis.points.iter().map(|p| (0.0..=10.0).contains(&p.x));
        assert_eq!(division(&axis, &none), is_side.collect::<Vec<_>>());
        assert_eq!(division(&square(0.25), &none), vec![true; none.len()]);
        let mut necks = none;
        necks[8] = true;
        assert_eq!(division(&square(0.5), &necks), necks);
    }

    /// Goal: tight stretches are two-sided where they are short, and two ends of a single bead would cost more. Method: a
    /// passage of 0.6 mm half-width but in its middle, 0.25 there over 0.6 and 2 mm.
    #[test]
    fn long_tight_stretches_are_left_to_one_bead() {
        let passage = |tight: std::ops::Range<f64>| {
            let x_mm = |n: u32| 0.1 * f64::from(n);
            let radius = |n| if tight.contains(&x_mm(n)) { 0.25 } else { 0.6 };
            Axis {
                points: (0..101).map(|n| Point2::new(x_mm(n), 0.0)).collect(),
                radii_mm: (0..101).map(radius).collect(),
                links: (0..100).map(|n| [n, n + 1]).collect(),
            }
        };
        let none = [false; 101];
        assert_eq!(division(&passage(4.65..5.25), &none), none);
        let long = division(&passage(4.05..6.05), &none);
        let expected: Vec<bool> = (0..101).map(|n| (41..61).contains(&n)).collect();
        assert_eq!(long, expected);
    }

    /// Goal: passages hardly wider than the narrowest bead are single whatever ends that makes, and so is
    /// a dot between two necks. Method: the square with arms, 0.22 mm; a dot of three
    /// nodes, 0.3 mm.
    #[test]
    fn tight_passages_and_dots_are_single() {
        let tight = square(0.22);
        let none = vec![false; tight.points.len()];
        assert!(division(&tight, &none).iter().all(|&s| s));
        let dot = Axis {
            points: (0..5)
                .map(|i| Point2::new(0.1 * f64::from(i), 0.0))
                .collect(),
            radii_mm: vec![0.19, 0.3, 0.3, 0.3, 0.19],
            links: (0..4).map(|i| [i, i + 1]).collect(),
        };
        assert_eq!(
            division(&dot, &[true, false, false, false, true]),
            [true; 5]
        );
    }

    /// Goal: a disk is no dot, however short its axis (found by the test of aligned seams: nothing of a
    /// disk was printed). Method: an axis of 1 um, half-width 6 mm.
    #[test]
    fn a_disk_keeps_its_two_sides() {
        let disk = Axis {
            points: vec![Point2::new(0.0, 0.0), Point2::new(1e-3, 0.0)],
            radii_mm: vec![6.0; 2],
            links: vec![[0, 1]],
        };
        assert_eq!(division(&disk, &[false; 2]), [false; 2]);
    }

    /// Goal: where single runs are asked for they are everywhere that they fit. Method: one-pass mode.
    #[test]
    fn one_pass_takes_all_that_one_bead_spans() {
        let axis = square(0.39);
        let none = vec![false; axis.points.len()];
        let settings = PassSettings {
            one_pass: true,
            ..SETTINGS
        };
        let single = cheapest_division(&axis, &axis.neighbours(), &none, &settings);
        assert!(single.iter().all(|&s| s));
    }

    /// Goal: where single runs are asked for, a wall about as wide as the widest bead has beads of one kind, however
    /// its width wavers by less than the tolerance; a wide place in it has two sides. Method: a ring of 60 mm whose
    /// half-width wavers by half the tolerance around widths from 0.97 to 1.05 of the bead's; a bulge.
    #[test]
    fn a_wall_as_wide_as_the_bead_is_not_torn() {
        let settings = PassSettings {
            one_pass: true,
            ..SETTINGS
        };
        let a = ELLIPSE.major_mm();
        let ring = |radius: &dyn Fn(u32) -> f64| Axis {
            points: (0..600)
                .map(|n| {
                    let (sin, cos) = (std::f64::consts::TAU * f64::from(n) / 600.0).sin_cos();
                    Point2::new(
                        60.0 / std::f64::consts::TAU * cos,
                        60.0 / std::f64::consts::TAU * sin,
                    )
                })
                .collect(),
            radii_mm: (0..600).map(radius).collect(),
            links: (0..600).map(|n| [n, (n + 1) % 600]).collect(),
        };
        let divided =
            |axis: &Axis| cheapest_division(axis, &axis.neighbours(), &[false; 600], &settings);
        for step in 0..=80 {
            let middle = 0.97 + 0.001 * f64::from(step);
            let waver = |n: u32| a * (middle + 0.24 * SPANNED_SLACK * f64::from(n % 37).sin());
            let single = divided(&ring(&waver));
            assert!(single.iter().all(|&s| s == single[0]), "{middle}");
            if middle < 1.0 - 0.24 * SPANNED_SLACK {
                assert!(single[0], "{middle}");
            }
            if middle > 1.0 + 1.25 * SPANNED_SLACK {
                assert!(!single[0], "{middle}");
            }
        }
        let bulge = |n: u32| if (200..300).contains(&n) { 1.5 * a } else { a };
        let single = divided(&ring(&bulge));
        assert!((0..190).all(|n| single[n]) && (210..290).all(|n| !single[n]));
    }
}
