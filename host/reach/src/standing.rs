//! Obstacles and print: points in the order of printing, in a tree whose nodes store their earliest
//! point.
//!
//! Each point represents a disc of material about it, as wide as the bead in its layer. The head is checked against
//! two points of it, its middle and its edge, the point of the disc nearest to the tip's foot on its plane. A query
//! gives the number of points that exist already ("before"), and a node whose earliest point comes later is skipped.
//! The nodes are bounding boxes, halved near the median of their longest side; both halves of a box are in one cache
//! line, eight points in two, in single precision: this suffices to skip most of them, and the others are checked
//! exactly.

use crate::Vector3;

/// Points of a block.
pub(crate) const BLOCK: usize = 8;
/// Levels of the tree: more points than fit in memory.
pub(crate) const DEPTH_MAX: usize = 64;

/// A point of an obstacle or of earlier print.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Where, mm.
    pub at_mm: Vector3,
    /// Radius of the disc that it represents, mm.
    pub half_width_mm: f64,
    /// Unit normal of the disc: the tool axis when it was printed.
    pub normal: Vector3,
}

impl Point {
    /// The point of its disc nearest to a tip's foot on its plane. If the tip moves, this point moves by no more
    /// than the tip, and within the plane.
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

/// A box about some points.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Node {
    middle_mm: [f32; 3],
    half_mm: [f32; 3],
    /// Its earliest point.
    pub earliest: u32,
    /// Where its halves or its points are: see [`Content`].
    pub link: u32,
}

/// What a box is made of.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Content {
    /// Two boxes: a number of [`Standing::halves`].
    Halves(usize),
    /// Points: a number of [`Standing::blocks`].
    Points(usize),
}

/// Set if a link is one of points.
const HAS_POINTS: u32 = 1 << 31;

/// Points of a tree at most.
pub const POINTS_MAX: usize = 1 << 31;

impl Content {
    #[inline]
    pub fn of(link: u32) -> Content {
        match link & HAS_POINTS {
            0 => Content::Halves(link as usize),
            _ => Content::Points((link & !HAS_POINTS) as usize),
        }
    }
}

/// Some points' places, by coordinate, for a quick test of all of them. Unused places are later than
/// any point.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
pub(crate) struct Block {
    pub at_mm: [[f32; BLOCK]; 3],
    pub order: [u32; BLOCK],
}

impl Block {
    fn of(leaves: &[Leaf]) -> Block {
        let mut block = Block {
            at_mm: [[0.0; BLOCK]; 3],
            order: [u32::MAX; BLOCK],
        };
        for (index, leaf) in leaves.iter().enumerate() {
            for side in 0..3 {
                block.at_mm[side][index] = leaf.point.at_mm[side] as f32;
            }
            block.order[index] = leaf.order;
        }
        block
    }
}

impl Node {
    #[inline]
    pub fn middle_mm(&self) -> Vector3 {
        Vector3::from(self.middle_mm.map(f64::from))
    }

    #[inline]
    pub fn half_mm(&self) -> Vector3 {
        Vector3::from(self.half_mm.map(f64::from))
    }

    /// Half the diagonal.
    #[inline]
    pub fn radius_mm(&self) -> f64 {
        let [x, y, z] = self.half_mm;
        // Rounding of the root is covered.
        f64::from((x * x + y * y + z * z).sqrt() * 1.000_001)
    }

    /// The box about some points, without its content.
    fn about(leaves: &[Leaf]) -> Node {
        let mut low_mm = Vector3::repeat(f64::INFINITY);
        let mut high_mm = -low_mm;
        let mut earliest = u32::MAX;
        for leaf in leaves {
            low_mm = low_mm.inf(&leaf.point.at_mm);
            high_mm = high_mm.sup(&leaf.point.at_mm);
            earliest = earliest.min(leaf.order);
        }
        let middle_mm = (0.5 * (low_mm + high_mm)).map(|side| side as f32);
        let rounded_mm = middle_mm.map(f64::from);
        let half_mm = (high_mm - rounded_mm).sup(&(rounded_mm - low_mm));
        Node {
            middle_mm: middle_mm.into(),
            half_mm: half_mm.map(|side| (side as f32).next_up()).into(),
            earliest,
            link: 0,
        }
    }
}

/// Both halves of a box, in one line of the cache.
#[derive(Clone, Copy, Debug, Default)]
#[repr(align(64))]
pub(crate) struct Halves(pub [Node; 2]);

/// What the discs have in common.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Discs {
    /// The greatest half width.
    half_width_mm: f64,
    /// A normal, and the most that others differ from it (length of the difference).
    normal: Vector3,
    differ: f64,
}

impl Discs {
    fn of(points: &[Point]) -> Discs {
        let wide = points.iter().filter(|point| point.half_width_mm > 0.0);
        let normal = wide
            .clone()
            .next()
            .map_or(Vector3::zeros(), |point| point.normal);
        Discs {
            half_width_mm: wide
                .clone()
                .fold(0.0, |most, point| point.half_width_mm.max(most)),
            normal,
            differ: wide.fold(0.0, |most, point| (point.normal - normal).norm().max(most)),
        }
    }

    /// How far a disc reaches at most along a direction of any length, times that length, mm.
    #[inline]
    pub fn along_mm(&self, direction: &Vector3) -> f64 {
        let length = direction.norm();
        let leaning = self.normal.cross(direction).norm() + self.differ * length;
        self.half_width_mm * leaning.min(length)
    }

    /// How far a disc reaches along an axis that may turn and across it at most, mm.
    pub fn reach_mm(&self, axis: &Vector3, turned_rad: f64) -> [f64; 2] {
        let up_mm = self.along_mm(axis) + self.half_width_mm * turned_rad;
        [up_mm.min(self.half_width_mm), self.half_width_mm]
    }
}

/// Obstacles and print, in order.
#[derive(Clone, Debug, Default)]
pub struct Standing {
    pub(crate) leaves: Vec<Leaf>,
    /// The same, by eights.
    pub(crate) blocks: Vec<Block>,
    /// The box about all of it, where there is anything.
    pub(crate) all: Option<Node>,
    pub(crate) halves: Vec<Halves>,
    pub(crate) discs: Discs,
    /// The greatest coordinate, mm.
    pub(crate) far_mm: f64,
}

impl Standing {
    /// A tree of points in the order of printing; at most [`POINTS_MAX`], others are ignored.
    pub fn new(points: &[Point]) -> Standing {
        let points = &points[..points.len().min(POINTS_MAX)];
        let leaf = |(order, point): (usize, &Point)| Leaf {
            point: *point,
            order: order as u32,
        };
        let mut standing = Standing {
            leaves: points.iter().enumerate().map(leaf).collect(),
            blocks: Vec::with_capacity(points.len().div_ceil(BLOCK)),
            all: None,
            halves: Vec::with_capacity(points.len().div_ceil(BLOCK)),
            discs: Discs::of(points),
            far_mm: points
                .iter()
                .fold(0.0, |most, point| point.at_mm.amax().max(most)),
        };
        if !points.is_empty() {
            standing.all = Some(standing.node(0, points.len()));
        }
        standing
    }

    /// How many points there are.
    pub fn len(&self) -> usize {
        self.leaves.len()
    }

    /// True if there are no points.
    pub fn is_empty(&self) -> bool {
        self.leaves.is_empty()
    }

    /// The node of some points, its halves built: whole blocks, from left to right. As deep as the logarithm of their
    /// number.
    fn node(&mut self, from: usize, to: usize) -> Node {
        let mut node = Node::about(&self.leaves[from..to]);
        if to - from <= BLOCK {
            node.link = HAS_POINTS | self.blocks.len() as u32;
            self.blocks.push(Block::of(&self.leaves[from..to]));
            return node;
        }
        let longest = node.half_mm().imax();
        let half = ((to - from) / 2).next_multiple_of(BLOCK);
        self.leaves[from..to].select_nth_unstable_by(half, |a, b| {
            let [a_mm, b_mm] = [a, b].map(|leaf| leaf.point.at_mm[longest]);
            a_mm.total_cmp(&b_mm).then(a.order.cmp(&b.order))
        });
        let index = self.halves.len();
        self.halves.push(Halves::default());
        self.halves[index] = Halves([self.node(from, from + half), self.node(from + half, to)]);
        node.link = index as u32;
        node
    }
}
