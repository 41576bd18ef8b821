//! What stands: points in the order in which they come to be, in a tree whose nodes know their earliest.
//!
//! Each point stands for a disc of material about it: a bead is as wide in its layer. For a head it is two places, its
//! middle and its edge, the place of the disc nearest to the tip's foot on its plane. A query says how many points stand
//! already ("before"), and a node whose earliest point comes later is passed over. Bounding boxes, halved at
//! the median of their longest side.

use crate::Vector3;

/// Points of a leaf.
const LEAF: usize = 8;
/// Levels of the tree: more points than fit in memory.
pub(crate) const DEPTH_MAX: usize = 64;

/// A point of what stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Where, mm.
    pub at_mm: Vector3,
    /// Radius of the disc that it stands for, mm.
    pub half_width_mm: f64,
    /// Normal of the disc, unit: the tool axis that laid it.
    pub normal: Vector3,
}

impl Point {
    /// The place of its disc that is nearest to a tip's foot on its plane. A tip that moves moves it by no more, and
    /// within the plane.
    #[inline]
    pub fn edge_mm(&self, tip_mm: &Vector3) -> Vector3 {
        let away = tip_mm - self.at_mm;
        let aside = away - self.normal * away.dot(&self.normal);
        let square = aside.norm_squared();
        if square <= self.half_width_mm * self.half_width_mm {
            return self.at_mm + aside;
        }
        self.at_mm + aside * (self.half_width_mm / square.sqrt())
    }
}

/// A point in the tree, with its place in the order.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Leaf {
    pub point: Point,
    pub order: u32,
}

/// A box of points.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Node {
    pub middle_mm: Vector3,
    pub half_mm: Vector3,
    /// Half its diagonal and its points' greatest half width.
    pub radius_mm: f64,
    pub half_width_mm: f64,
    /// Its earliest point.
    pub earliest: u32,
    /// Its points.
    pub from: u32,
    pub to: u32,
    /// The second child; the first one follows at once. Zero for a leaf.
    pub second: u32,
}

/// What stands, in order.
#[derive(Clone, Debug, Default)]
pub struct Standing {
    pub(crate) leaves: Vec<Leaf>,
    pub(crate) nodes: Vec<Node>,
}

impl Standing {
    /// A tree of points in the order in which they come to stand; at most 2³² - 1.
    pub fn new(points: &[Point]) -> Standing {
        let leaf = |(order, point): (usize, &Point)| Leaf {
            point: *point,
            order: u32::try_from(order).unwrap_or(u32::MAX),
        };
        let mut standing = Standing {
            leaves: points.iter().enumerate().map(leaf).collect(),
            nodes: Vec::with_capacity(points.len() / 2),
        };
        if !points.is_empty() {
            standing.divide(0, points.len());
        }
        standing
    }

    /// How many points there are.
    pub fn len(&self) -> usize {
        self.leaves.len()
    }

    /// True where nothing stands.
    pub fn is_empty(&self) -> bool {
        self.leaves.is_empty()
    }

    /// Builds the node of some points, its children behind it. As deep as the logarithm of their number.
    fn divide(&mut self, from: usize, to: usize) {
        let node = self.node(from, to);
        let longest = node.half_mm.imax();
        let index = self.nodes.len();
        self.nodes.push(node);
        if to - from <= LEAF {
            return;
        }
        let half = (to - from) / 2;
        self.leaves[from..to].select_nth_unstable_by(half, |a, b| {
            let [a_mm, b_mm] = [a, b].map(|leaf| leaf.point.at_mm[longest]);
            a_mm.total_cmp(&b_mm).then(a.order.cmp(&b.order))
        });
        self.divide(from, from + half);
        self.nodes[index].second = self.nodes.len() as u32;
        self.divide(from + half, to);
    }

    fn node(&self, from: usize, to: usize) -> Node {
        let first = self.leaves[from].point.at_mm;
        let (mut low_mm, mut high_mm) = (first, first);
        let (mut half_width_mm, mut earliest) = (0.0, u32::MAX);
        for leaf in &self.leaves[from..to] {
            low_mm = low_mm.inf(&leaf.point.at_mm);
            high_mm = high_mm.sup(&leaf.point.at_mm);
            half_width_mm = f64::max(half_width_mm, leaf.point.half_width_mm);
            earliest = earliest.min(leaf.order);
        }
        let middle_mm = 0.5 * (low_mm + high_mm);
        // Rounding of the middle is covered.
        let half_mm = (high_mm - middle_mm).sup(&(middle_mm - low_mm));
        Node {
            middle_mm,
            half_mm,
            radius_mm: half_mm.norm(),
            half_width_mm,
            earliest,
            from: from as u32,
            to: to as u32,
            second: 0,
        }
    }
}
