//! Whether a head at a pose collides with obstacles or print, and whether it can between two poses.
//!
//! The head touches a position that is higher above the tip's plane than the slack, below the head's top, and closer
//! to the axis than the head's radius there; it touches a point if it touches its middle or its edge. All of it is
//! exact for the points; a box is skipped if none of its points can be touched.

use crate::profile::HeadProfile;
use crate::standing::{
    BLOCK, Block, Content, DEPTH_MAX, Discs, Halves, Leaf, Node, Point, Standing,
};
use crate::{Pose, Vector3};
use std::ops::ControlFlow;

/// Maximum number of collisions evaluated for one pose: with more, the pose is far inside, and they are
/// similar.
pub const TOUCHES_MAX: usize = 512;

/// A collision.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Touch {
    /// Where it is, mm: a point's middle or its edge.
    pub at_mm: Vector3,
    /// Height above the tip's plane, mm.
    pub height_mm: f64,
    /// How deep, mm.
    pub depth_mm: f64,
}

/// A head with its permitted dip: the queries.
#[derive(Clone, Copy, Debug)]
pub struct Head<'a> {
    /// Its profile.
    pub profile: &'a HeadProfile,
    /// Points no higher than this above the tip's plane do not count, mm.
    pub slack_mm: f64,
}

/// Possible displacement of a head from the evaluated pose, to each side.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Motion {
    along_mm: f64,
    across_mm: f64,
    turned_rad: f64,
}

/// A pose that may move, with the values that each test of a box or a point needs.
struct Look {
    pose: Pose,
    motion: Motion,
    is_still: bool,
    discs: Discs,
    /// How far a place goes without the turn, mm.
    way_mm: f64,
    /// What a box's sides reach along the axis and across it, of each side's length.
    along: Vector3,
    across: Vector3,
    /// What discs and motion reach along the axis and across it, mm, but for the turn.
    grown_mm: [f64; 2],
    /// Rounding of places in single precision, mm.
    rounding_mm: f64,
}

impl Look {
    fn new(pose: &Pose, motion: Motion, standing: &Standing) -> Look {
        let [up_mm, aside_mm] = standing.discs.reach_mm(&pose.axis, motion.turned_rad);
        Look {
            pose: *pose,
            motion,
            is_still: motion == Motion::default(),
            discs: standing.discs,
            way_mm: motion.along_mm.hypot(motion.across_mm),
            along: pose.axis.abs(),
            across: pose.axis.map(|share| (1.0 - share * share).max(0.0).sqrt()),
            grown_mm: [up_mm + motion.along_mm, aside_mm + motion.across_mm],
            rounding_mm: 1e-6 * (standing.far_mm + pose.tip_mm.amax() + 1.0),
        }
    }

    /// The same for places that are turned by so much.
    fn grown_by(&self, turned_mm: f64) -> [f64; 2] {
        self.grown_mm.map(|grown_mm| grown_mm + turned_mm)
    }
}

/// A box that waits to be opened, and how far its places are turned, mm.
#[derive(Clone, Copy, Default)]
struct Waiting {
    link: u32,
    turned_mm: f64,
}

impl Head<'_> {
    /// The first colliding point found among those that exist `before`.
    pub fn any(&self, standing: &Standing, pose: &Pose, before: usize) -> Option<usize> {
        let mut found = None;
        self.each(standing, pose, before, Motion::default(), |leaf| {
            found = Some(leaf.order as usize);
            ControlFlow::Break(())
        });
        found
    }

    /// Calls `on` for the collisions of a pose, at most [`TOUCHES_MAX`] of them.
    pub fn each_touch(
        &self,
        standing: &Standing,
        pose: &Pose,
        before: usize,
        on: impl FnMut(Touch),
    ) {
        self.first_touches(standing, pose, before, TOUCHES_MAX, on);
    }

    /// The same for at most this many points.
    pub(crate) fn first_touches(
        &self,
        standing: &Standing,
        pose: &Pose,
        before: usize,
        points_max: usize,
        mut on: impl FnMut(Touch),
    ) {
        let mut left = points_max;
        self.each(standing, pose, before, Motion::default(), |leaf| {
            let edge_mm = leaf.point.edge_mm(&pose.tip_mm);
            for at_mm in [leaf.point.at_mm, edge_mm] {
                let seen = pose.seen(&at_mm);
                if self.holds(seen, Motion::default()) {
                    on(Touch {
                        at_mm,
                        height_mm: seen[0],
                        depth_mm: self.profile.depth_mm(seen).max(0.0),
                    });
                }
            }
            left -= 1;
            match left {
                0 => ControlFlow::Break(()),
                _ => ControlFlow::Continue(()),
            }
        });
    }

    /// Dip of a flat end ([`HeadProfile::flat_end`], without slack) into obstacles and print, mm: the greatest height
    /// of a point below it. Zero if there is none.
    pub fn tip_dip_mm(&self, standing: &Standing, pose: &Pose, before: usize) -> f64 {
        let radius_mm = self.profile.tip_radius_mm();
        let mut dip_mm = 0.0;
        self.each(standing, pose, before, Motion::default(), |leaf| {
            let seen = pose.seen(&leaf.point.at_mm);
            if seen[1] < radius_mm {
                dip_mm = f64::max(dip_mm, seen[0]);
            }
            ControlFlow::Continue(())
        });
        dip_mm
    }

    /// True if there is no collision on a straight path with a uniform rotation between two poses, tested at its
    /// middle; false if that is not certain.
    pub fn is_clear_between(&self, standing: &Standing, ends: [&Pose; 2], before: usize) -> bool {
        let [from, to] = ends;
        let Some(middle) = from.middle(to) else {
            return false;
        };
        let half_way = 0.5 * (to.tip_mm - from.tip_mm);
        let along_mm = half_way.dot(&middle.axis).abs();
        let square = half_way.norm_squared() - along_mm * along_mm;
        let motion = Motion {
            along_mm,
            across_mm: square.max(0.0).sqrt(),
            turned_rad: 0.5 * from.axis.angle(&to.axis),
        };
        let mut is_clear = true;
        self.each(standing, &middle, before, motion, |_| {
            is_clear = false;
            ControlFlow::Break(())
        });
        is_clear
    }

    /// Calls `on` for each point that is touched after at most that motion, until it breaks. Points near the axis
    /// are first.
    fn each(
        &self,
        standing: &Standing,
        pose: &Pose,
        before: usize,
        motion: Motion,
        mut on: impl FnMut(&Leaf) -> ControlFlow<()>,
    ) {
        let before = u32::try_from(before).unwrap_or(u32::MAX);
        let look = Look::new(pose, motion, standing);
        let mut stack = [Waiting::default(); DEPTH_MAX];
        let mut waiting = 0;
        let push = |waiting: &mut usize, stack: &mut [Waiting], node: &Node, seen: Seen| {
            stack[*waiting] = Waiting {
                link: node.link,
                turned_mm: seen.turned_mm,
            };
            *waiting += 1;
        };
        if let Some(all) = &standing.all
            && all.earliest < before
            && let Some(seen) = self.may_hold(all, &look)
        {
            push(&mut waiting, &mut stack, all, seen);
        }
        while waiting > 0 {
            waiting -= 1;
            let Waiting { link, turned_mm } = stack[waiting];
            match Content::of(link) {
                Content::Points(block) => {
                    let near = self.may_hold_of(&standing.blocks[block], before, &look, turned_mm);
                    for index in (0..BLOCK).filter(|index| near >> index & 1 == 1) {
                        let leaf = &standing.leaves[block * BLOCK + index];
                        if self.holds_point(&leaf.point, &look) && on(leaf).is_break() {
                            return;
                        }
                    }
                }
                Content::Halves(index) => {
                    let Halves([first, second]) = &standing.halves[index];
                    let seen = [first, second].map(|node| match node.earliest < before {
                        true => self.may_hold(node, &look),
                        false => None,
                    });
                    match seen {
                        [Some(a), Some(b)] if a.from_axis_mm2 < b.from_axis_mm2 => {
                            push(&mut waiting, &mut stack, second, b);
                            push(&mut waiting, &mut stack, first, a);
                        }
                        [a, b] => {
                            for (node, seen) in [(first, a), (second, b)] {
                                if let Some(seen) = seen {
                                    push(&mut waiting, &mut stack, node, seen);
                                }
                            }
                        }
                    }
                }
            }
        }
    }

    /// True where the head may hold a point's middle or its edge, after at most that motion.
    #[inline]
    fn holds_point(&self, point: &Point, look: &Look) -> bool {
        let (pose, motion) = (&look.pose, look.motion);
        if self.holds(pose.seen(&point.at_mm), motion) {
            return true;
        }
        if point.half_width_mm <= 0.0 {
            return false;
        }
        // The edge follows the tip, within its plane.
        let leaning = match look.is_still {
            true => 0.0,
            false => point.normal.cross(&pose.axis).norm() + motion.turned_rad,
        };
        let of_edge = Motion {
            along_mm: motion.along_mm + leaning.min(1.0) * look.way_mm,
            across_mm: motion.across_mm + look.way_mm,
            turned_rad: motion.turned_rad,
        };
        self.holds(pose.seen(&point.edge_mm(&pose.tip_mm)), of_edge)
    }

    /// True where the head may hold a place, after at most that motion.
    #[inline]
    fn holds(&self, [height_mm, from_axis_mm]: [f64; 2], motion: Motion) -> bool {
        let distance_mm = if motion.turned_rad > 0.0 {
            height_mm.hypot(from_axis_mm) + motion.along_mm + motion.across_mm
        } else {
            0.0
        };
        let turned_mm = motion.turned_rad * distance_mm;
        let (along_mm, across_mm) = (motion.along_mm + turned_mm, motion.across_mm + turned_mm);
        height_mm + along_mm > self.slack_mm
            && height_mm - along_mm <= self.profile.top_mm()
            && from_axis_mm - across_mm < self.profile.radius_mm(height_mm + along_mm)
    }

    /// The view of a box; `None` if the head contains no place of its discs.
    #[inline]
    fn may_hold(&self, node: &Node, look: &Look) -> Option<Seen> {
        let away = node.middle_mm() - look.pose.tip_mm;
        let (middle_mm, square) = (away.dot(&look.pose.axis), away.norm_squared());
        let half_mm = node.half_mm();
        let radius_mm = node.radius_mm();
        let turned_mm = match look.motion.turned_rad > 0.0 {
            // The farthest place of the box turns farthest.
            true => {
                let [along_mm, across_mm] = look.grown_mm;
                look.motion.turned_rad * (square.sqrt() + radius_mm + along_mm + across_mm)
            }
            false => 0.0,
        };
        let [up_mm, aside_mm] = look.grown_by(turned_mm);
        let up_mm = up_mm + look.along.dot(&half_mm);
        if middle_mm + up_mm <= self.slack_mm || middle_mm - up_mm > self.profile.top_mm() {
            return None;
        }
        // No corner is farther aside than its edges' sum, or than the diagonal.
        let aside_mm = aside_mm + radius_mm.min(look.across.dot(&half_mm));
        let reach_mm = self.profile.radius_bound_mm(middle_mm + up_mm) + aside_mm;
        let from_axis_mm2 = square - middle_mm * middle_mm;
        if from_axis_mm2 >= reach_mm * reach_mm {
            return None;
        }
        if self.is_clear_of_sides(&away, &half_mm, look, turned_mm) {
            return None;
        }
        Some(Seen {
            from_axis_mm2,
            turned_mm,
        })
    }

    /// True where a box is outside of the planes that touch the sides of the head's sections where they face it: each
    /// section is convex. Closer than the bound by heights where the head's sides are nearly parallel to layers.
    #[inline]
    fn is_clear_of_sides(
        &self,
        away: &Vector3,
        half_mm: &Vector3,
        look: &Look,
        turned_mm: f64,
    ) -> bool {
        let axis = &look.pose.axis;
        let middle_mm = away.dot(axis);
        let aside = away - axis * middle_mm;
        let from_axis_mm = aside.norm();
        if from_axis_mm <= 0.0 {
            return false;
        }
        let out = aside / from_axis_mm;
        let up_mm = look.along.dot(half_mm) + look.grown_mm[0] + turned_mm;
        let moved_mm = look.way_mm + turned_mm;
        self.profile
            .sections()
            .all(|[[low_mm, from_mm], [high_mm, to_mm]]| {
                if middle_mm + up_mm < low_mm || middle_mm - up_mm > high_mm || high_mm <= low_mm {
                    return true;
                }
                let slope = (to_mm - from_mm) / (high_mm - low_mm);
                // Normal of the plane, not of unit length.
                let normal = out - axis * slope;
                let off_mm = from_axis_mm - from_mm - slope * (middle_mm - low_mm);
                let disc_mm = look.discs.along_mm(&normal);
                off_mm > normal.abs().dot(half_mm) + disc_mm + moved_mm * normal.norm()
            })
    }

    /// Bits of a block's printed points that the head may contain.
    #[inline]
    fn may_hold_of(&self, block: &Block, before: u32, look: &Look, turned_mm: f64) -> u32 {
        let [up_mm, aside_mm] = look.grown_by(turned_mm + look.rounding_mm);
        let axis = look.pose.axis.map(|share| share as f32);
        let tip_mm = look.pose.tip_mm.map(|side| side as f32);
        let (mut heights_mm, mut squares) = ([0.0f32; BLOCK], [0.0f32; BLOCK]);
        for index in 0..BLOCK {
            let away: [f32; 3] = std::array::from_fn(|k| block.at_mm[k][index] - tip_mm[k]);
            heights_mm[index] = away[0] * axis.x + away[1] * axis.y + away[2] * axis.z;
            squares[index] = away[0] * away[0] + away[1] * away[1] + away[2] * away[2];
        }
        let mut near = 0;
        for index in 0..BLOCK {
            let (height_mm, square) = (f64::from(heights_mm[index]), f64::from(squares[index]));
            let reach_mm = self.profile.radius_bound_mm(height_mm + up_mm) + aside_mm;
            // The difference of squares is as exact as they are.
            let is_near = height_mm + up_mm > self.slack_mm
                && square * (1.0 - 1e-6) - height_mm * height_mm < reach_mm * reach_mm
                && block.order[index] < before;
            near |= u32::from(is_near) << index;
        }
        near
    }
}

/// How a box is seen from a pose.
#[derive(Clone, Copy)]
struct Seen {
    from_axis_mm2: f64,
    turned_mm: f64,
}
