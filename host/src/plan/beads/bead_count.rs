//! The number of beads between the wall and the medial axis, along the axis.
//!
//! With k beads across r each is r/k wide, so any k with r/(2a) <= k <= r/(2b) works (docs/design/heading-law.md).
//! The count is chosen piecewise constant over the whole axis, by dynamic programming over a spanning forest of the
//! axis graph: the least printed path, where each change costs about what its ends waste. Each change is then spread
//! over a blend length, so that the bead channels narrow and widen smoothly. Where r < 2b only one bead fits across
//! the passage: a single bead.
//!
//! In: axis with radii (mm), narrowest and widest channel (mm). Out: k at every node, whole or
//! blended. Not covered: the outline between axis and wall (`field`).

use crate::geometry::aperture::Aperture;
use crate::plan::axis::pruned_axis::Axis;

/// Maximum number of beads across r; wider regions are refused by the input's size limits, and
/// beyond this the beads stay at their widest (and the gap shows in the figures).
pub const BEADS_MAX: usize = 4096;

/// Weight of a change of k against the other costs, and again of each bead in it, in units of the aperture of printed
/// path.
const CHANGE: f64 = 1.0;
/// Least length of axis that a node represents, of the unit.
const NODE_LEAST: f64 = 0.01;
/// Printed path of one bead, per mm of axis: it is on both sides.
const BEAD_WEIGHT: f64 = 2.0;
/// Cost of a passage wider than its beads can be, for each of their widest half-widths that stays open,
/// per mm of axis.
pub(super) const TOO_WIDE: f64 = 40.0;
/// Cost of a passage too narrow for its beads, for each of their narrowest widths that is missing, per mm.
pub(super) const TOO_NARROW: f64 = 10.0;
/// Most overlap that counts, in narrowest widths.
const OVERLAP_MAX: f64 = 10.0;
/// Most rounds of spreading a change of k.
const BLEND_ROUNDS_MAX: f64 = 400.0;

/// Range of the width of a bead channel, the strip between neighbouring beads' edges that one bead
/// is to fill, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChannelWidths {
    /// Of the narrowest bead.
    pub least_mm: f64,
    /// Of the widest one.
    pub most_mm: f64,
    /// The aperture's unit.
    pub unit_mm: f64,
}

impl ChannelWidths {
    /// For beads that overlap by this share of their width.
    pub fn of(aperture: &Aperture, overlap: f64) -> ChannelWidths {
        let [least_mm, most_mm] = [
            aperture.minor_mm(),
            WIDEST_CHANNEL_SHARE * aperture.major_mm(),
        ]
        .map(|half_mm| 2.0 * half_mm * (1.0 - overlap));
        ChannelWidths {
            least_mm,
            most_mm,
            unit_mm: aperture.unit_mm(),
        }
    }
}

/// The bead count k (at least 1) at every node of `axis`, whole numbers.
pub fn bead_counts(axis: &Axis, widths: ChannelWidths) -> Vec<f64> {
    let count = axis.points.len();
    let (order, parents) = spanning_forest(axis);
    let r_max = axis.radii_mm.iter().copied().fold(0.0, f64::max);
    let states = ((r_max / widths.most_mm).ceil() as usize + 2).min(BEADS_MAX);
    let mut lengths = vec![0.0; count];
    for &[a, b] in &axis.links {
        let half = (axis.points[a as usize] - axis.points[b as usize]).norm() / 2.0;
        lengths[a as usize] += half;
        lengths[b as usize] += half;
    }
    let mut costs = vec![0.0f32; count * states];
    for node in 0..count {
        for state in 0..states {
            let tiling = tiling_cost(axis.radii_mm[node], (state + 1) as f64, widths);
            costs[node * states + state] =
                (tiling * lengths[node].max(NODE_LEAST * widths.unit_mm)) as f32;
        }
    }
    // Leaves to roots: fold each child's best answer into its parent.
    for &node in order.iter().rev() {
        if let Some(parent) = parents[node] {
            let reduced = changed_costs(&costs[node * states..(node + 1) * states], widths.unit_mm);
            for (state, cost) in reduced.iter().enumerate() {
                costs[parent * states + state] += cost;
            }
        }
    }
    let mut chosen = vec![0usize; count];
    for &node in &order {
        let own = &costs[node * states..(node + 1) * states];
        let total = |state: usize| {
            let change =
                parents[node].map_or(0.0, |p| change_cost(chosen[p], state, widths.unit_mm));
            own[state] as f64 + change
        };
        chosen[node] = (0..states).fold(0, |best, s| if total(s) < total(best) { s } else { best });
    }
    chosen.into_iter().map(|state| (state + 1) as f64).collect()
}

/// Spreads each change of k over about `blend_mm` of axis by diffusion, nowhere below the count for
/// the widest beads: otherwise a short wide place, such as the middle of a star, would be left
/// open.
pub fn blended(
    axis: &Axis,
    counts: &[f64],
    step_mm: f64,
    blend_mm: f64,
    widths: ChannelWidths,
) -> Vec<f64> {
    let neighbours = axis.neighbours();
    let rounds = ((blend_mm / step_mm).powi(2) / 2.0).clamp(0.0, BLEND_ROUNDS_MAX) as usize;
    let mut values = counts.to_vec();
    for _ in 0..rounds {
        let next: Vec<f64> = (0..values.len())
            .map(|node| {
                if neighbours[node].is_empty() {
                    return values[node];
                }
                let sum: f64 = neighbours[node].iter().map(|&n| values[n as usize]).sum();
                0.5 * values[node] + 0.5 * sum / neighbours[node].len() as f64
            })
            .collect();
        values = next;
    }
    for (node, value) in values.iter_mut().enumerate() {
        let least = (axis.radii_mm[node] / widths.most_mm).min(counts[node]);
        *value = value.max(least);
    }
    values
}

/// Breadth-first order and parents, roots at the widest nodes so that trees grow from the body.
fn spanning_forest(axis: &Axis) -> (Vec<usize>, Vec<Option<usize>>) {
    let neighbours = axis.neighbours();
    let count = axis.points.len();
    let mut roots: Vec<usize> = (0..count).collect();
    roots.sort_by(|&a, &b| {
        axis.radii_mm[b]
            .total_cmp(&axis.radii_mm[a])
            .then(a.cmp(&b))
    });
    let mut parents = vec![None; count];
    let mut seen = vec![false; count];
    let mut order = Vec::with_capacity(count);
    for root in roots {
        if seen[root] {
            continue;
        }
        seen[root] = true;
        order.push(root);
        let mut head = order.len() - 1;
        while head < order.len() {
            let node = order[head];
            head += 1;
            for &next in &neighbours[node] {
                if !seen[next as usize] {
                    seen[next as usize] = true;
                    parents[next as usize] = Some(node);
                    order.push(next as usize);
                }
            }
        }
    }
    (order, parents)
}

/// What k beads cost across a half-width r, per mm of axis: their path, and more where they leave
/// gaps or are forced to overlap.
fn tiling_cost(radius_mm: f64, beads: f64, widths: ChannelWidths) -> f64 {
    let width = radius_mm / beads;
    let gap = (width / widths.most_mm - 1.0).max(0.0);
    let overlap = (widths.least_mm / width.max(1e-6 * widths.unit_mm) - 1.0).max(0.0);
    TOO_WIDE * gap + TOO_NARROW * overlap.min(OVERLAP_MAX) + BEAD_WEIGHT * beads
}

/// Share of the widest bead that straight channels may need: the rest is for their corners, where
/// the distance across is longer.
const WIDEST_CHANNEL_SHARE: f64 = 0.97;

fn change_cost(from: usize, to: usize, unit_mm: f64) -> f64 {
    if from == to {
        0.0
    } else {
        CHANGE * (1 + from.abs_diff(to)) as f64 * unit_mm
    }
}

/// min over s' of cost[s'] + change(s, s'), for all s, in linear time, above the least of them: the sum over a whole
/// tree would be rounded more coarsely than what a change costs.
fn changed_costs(costs: &[f32], unit_mm: f64) -> Vec<f32> {
    let change = (CHANGE * unit_mm) as f32;
    let mut spread = costs.to_vec();
    for s in 1..spread.len() {
        spread[s] = spread[s].min(spread[s - 1] + change);
    }
    for s in (1..spread.len()).rev() {
        spread[s - 1] = spread[s - 1].min(spread[s] + change);
    }
    let least = costs.iter().copied().fold(f32::INFINITY, f32::min);
    costs
        .iter()
        .zip(&spread)
        .map(|(&own, &other)| own.min(other + change) - least)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::test_shapes::ELLIPSE;
    use crate::geometry::{Point2, Vector2};

    /// Nodes of a passage of 2.2 mm.
    const NODES: usize = 160;

    /// Passages for two beads and for one in turn, of which each saves little more than a change costs, and beyond them
    /// another one of this length.
    fn passages(count: usize, last_mm: f64) -> Axis {
        let nodes = NODES * count;
        let mut points: Vec<Point2> = (0..nodes)
            .map(|i| Point2::new(0.014 * i as f64, 0.0))
            .collect();
        let mut radii_mm: Vec<f64> = (0..nodes).map(|i| [1.3, 1.0][i / NODES % 2]).collect();
        points.push(points[nodes - 1] + Vector2::new(last_mm, 0.0));
        radii_mm.push(1.0);
        Axis {
            points,
            radii_mm,
            links: (1..=nodes as u32).map(|i| [i - 1, i]).collect(),
        }
    }

    /// Goal: the counts of a passage do not depend on how much else the axis has. Method: passages before a short one and
    /// before one whose cost is 10⁷ times that of a node.
    #[test]
    fn counts_do_not_depend_on_the_rest_of_the_axis() {
        let widths = ChannelWidths::of(&ELLIPSE, 0.0);
        let [short, long] = [1.0, 5e5].map(|last_mm| bead_counts(&passages(12, last_mm), widths));
        let changes = short.windows(2).filter(|pair| pair[0] != pair[1]);
        assert_eq!(changes.count(), 11);
        assert_eq!(short, long);
    }
}
