//! Which stretches of the axis hold one bead and which two sides.
//!
//! Two sides are needed where one bead is not wide enough (r > a), one bead where two would cover
//! each other (r < 2b); between them, and a little beyond, either will do. What decides there is where
//! flow has to be interrupted: a single run ends wherever it changes into two sides, in a dead end and
//! at a joint of an odd number of single runs, and two ends are one pass (L. Euler, 1736). The
//! division is the cheapest of all in this sense, whatever loops the axis has.

use super::passes::PassSettings;
use super::skeleton::{Axis, flood};
use super::two_labels::{COST_MAX, TwoLabels};

/// Length of badly divided axis that one end of a single run is worth, mm against a. Two ends are an
/// interruption of flow: with 4 as much as to cover half of the aperture's area again (ellipse of
/// 0.6 x 0.2 mm).
const END_SHARE: f64 = 4.0;
/// Cost of a passage wider than one bead can be, for each a of excess radius, per mm.
const TOO_WIDE: f64 = 40.0;
/// Cost of a passage too narrow for two sides, for each b of missing radius, per mm.
const TOO_NARROW: f64 = 10.0;
/// The same below [`TIGHT_SHARE`], on top: two sides that lie on each other nearly altogether are not laid
/// in the end, and the passage stays open.
const TIGHT: f64 = 40.0;
/// Radius of such a passage, against b.
const TIGHT_SHARE: f64 = 1.4;
/// Cost of laying two beads where one would do, per mm.
const TWO_FOR_ONE: f64 = 0.05;
/// Share of a that a single bead may need: the rest is for bends.
const WIDEST_SHARE: f64 = 0.89;

/// The nodes that single runs are on. `is_neck` are the nodes too narrow for any bead that do not
/// just end in a corner.
pub fn cheapest_division(
    axis: &Axis,
    neighbours: &[Vec<u32>],
    is_neck: &[bool],
    settings: &PassSettings,
) -> Vec<bool> {
    let graph = Graph::new(axis, neighbours, is_neck, settings);
    let mut single = graph.labels().cheapest();
    graph.make_islands_single(&mut single);
    single
}

/// An axis and what dividing it costs.
struct Graph<'a> {
    axis: &'a Axis,
    neighbours: &'a [Vec<u32>],
    is_neck: &'a [bool],
    /// What each node costs in a stretch of two sides and in one of one bead.
    costs: Vec<[f64; 2]>,
    /// What one end of a single run costs.
    end_cost: f64,
    /// Half-width of the widest passage for one bead, mm.
    widest_mm: f64,
}

impl<'a> Graph<'a> {
    fn new(
        axis: &'a Axis,
        neighbours: &'a [Vec<u32>],
        is_neck: &'a [bool],
        settings: &PassSettings,
    ) -> Graph<'a> {
        let (a, b) = (settings.aperture.major_mm(), settings.aperture.minor_mm());
        let end_cost = END_SHARE * a;
        let mut costs = width_costs(axis, settings);
        for (node, near) in neighbours.iter().enumerate() {
            if is_neck[node] {
                costs[node] = [COST_MAX, 0.0];
                continue;
            }
            // Nothing goes on through a neck.
            let ways = near.iter().filter(|&&n| !is_neck[n as usize]).count();
            if ways % 2 == 1 {
                costs[node][1] += end_cost;
            }
            // An axis of one point has no length to weigh: it is single only where it has to be.
            if near.is_empty() && axis.radii_mm[node] < 2.0 * b {
                costs[node][0] += end_cost;
            }
        }
        Graph {
            axis,
            neighbours,
            is_neck,
            costs,
            end_cost,
            widest_mm: WIDEST_SHARE * a,
        }
    }

    /// The costs as those of labels, `true` for one bead.
    fn labels(&self) -> TwoLabels {
        let mut labels = TwoLabels::new(&self.costs);
        for &[p, q] in &self.axis.links {
            let (p, q) = (p as usize, q as usize);
            if !self.is_neck[p] && !self.is_neck[q] {
                labels.link(p, q, self.end_cost);
            }
        }
        labels
    }

    /// Makes parts between necks that one bead spans single all over where that costs no more: what
    /// has no end is a pass all the same, as much as two ends.
    fn make_islands_single(&self, single: &mut [bool]) {
        let mut seen = self.is_neck.to_vec();
        for seed in 0..single.len() {
            if seen[seed] {
                continue;
            }
            let island = flood(seed, self.neighbours, &mut seen, |n| !self.is_neck[n]);
            // The middle of a disk has no length to weigh its width by.
            let fits = |n: usize| !single[n] && self.axis.radii_mm[n] <= self.widest_mm;
            if !island.iter().all(|&n| fits(n)) {
                continue;
            }
            let cost = |label: usize| island.iter().map(|&n| self.costs[n][label]).sum::<f64>();
            if cost(1) < cost(0) + 2.0 * self.end_cost {
                for node in island {
                    single[node] = true;
                }
            }
        }
    }
}

/// What the width there costs each node in a stretch of two sides and in one of one bead.
fn width_costs(axis: &Axis, settings: &PassSettings) -> Vec<[f64; 2]> {
    let (a, b) = (settings.aperture.major_mm(), settings.aperture.minor_mm());
    let mut costs = vec![[0.0; 2]; axis.points.len()];
    for &[p, q] in &axis.links {
        let half_mm = (axis.points[p as usize] - axis.points[q as usize]).norm() / 2.0;
        for node in [p as usize, q as usize] {
            let r = axis.radii_mm[node];
            let two_sides = if settings.one_pass && r <= a {
                TOO_WIDE
            } else {
                let narrow = TOO_NARROW * (2.0 - r / b).max(0.0);
                narrow + TIGHT * (TIGHT_SHARE - r / b).max(0.0) + TWO_FOR_ONE
            };
            costs[node][0] += half_mm * two_sides;
            costs[node][1] += half_mm * TOO_WIDE * (r / (WIDEST_SHARE * a) - 1.0).max(0.0);
        }
    }
    costs
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Point2;
    use crate::geometry::test_shapes::ELLIPSE;
    use crate::settings::{HeadingLaw, HeadingProfile};

    const SETTINGS: PassSettings = PassSettings {
        aperture: ELLIPSE,
        overlap: 0.0,
        one_pass: false,
        law: HeadingLaw::Tangent,
        profile: HeadingProfile::Corridor,
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

    /// Goal: struts a little too narrow for two sides keep them, since single runs would end at each
    /// joint; much narrower ones are single all over, joints too, and necks between wide places cut
    /// nothing else off. Method: a square with arms, half-widths 0.39, 0.25 and 0.5 mm (2b is 0.4).
    #[test]
    fn ends_of_single_runs_are_weighed_against_width() {
        let count = square(0.39).points.len();
        let none = vec![false; count];
        assert_eq!(division(&square(0.39), &none), none);
        assert_eq!(division(&square(0.25), &none), vec![true; count]);
        let mut necks = none;
        necks[8] = true;
        assert_eq!(division(&square(0.5), &necks), necks);
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
}
