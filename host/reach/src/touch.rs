//! Whether a head at a pose touches what stands, and whether it can between two poses.
//!
//! A place is touched where it is higher above the tip's plane than the slack, below the head's top, and closer to
//! the axis than the head's radius there; a point where its middle or its edge is. All of it is exact for the points; a
//! box is passed over where none of its points can be.

use crate::profile::HeadProfile;
use crate::standing::{DEPTH_MAX, Leaf, Node, Point, Standing};
use crate::{Pose, Vector3};
use std::ops::ControlFlow;

/// Touches of one pose that are looked at: where there are more it is far inside, and they are much alike.
pub const TOUCHES_MAX: usize = 512;

/// A touched place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Touch {
    /// Where it is, mm: a point's middle or its edge.
    pub at_mm: Vector3,
    /// Which one, in the order in which they came to stand.
    pub order: usize,
    /// Height above the tip's plane, mm.
    pub height_mm: f64,
    /// How deep, mm.
    pub depth_mm: f64,
}

/// A head and what it may dip: the queries.
#[derive(Clone, Copy, Debug)]
pub struct Head<'a> {
    /// Its profile.
    pub profile: &'a HeadProfile,
    /// What is no higher than that above the tip's plane is no touch, mm.
    pub slack_mm: f64,
}

/// How far a head may have moved from the pose that is looked at, to each side.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Motion {
    along_mm: f64,
    across_mm: f64,
    turned_rad: f64,
}

impl Head<'_> {
    /// The first point found that is touched, of those that stand `before`.
    pub fn any(&self, standing: &Standing, pose: &Pose, before: usize) -> Option<usize> {
        let mut found = None;
        self.each(standing, pose, before, Motion::default(), |leaf| {
            found = Some(leaf.order as usize);
            ControlFlow::Break(())
        });
        found
    }

    /// Calls `on` for the touches of a pose, at most [`TOUCHES_MAX`] of them.
    pub fn each_touch(
        &self,
        standing: &Standing,
        pose: &Pose,
        before: usize,
        on: impl FnMut(Touch),
    ) {
        self.first_touches(standing, pose, before, TOUCHES_MAX, on);
    }

    /// The same for so many points at most.
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
                        order: leaf.order as usize,
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

    /// How far the flat end dips into what stands, mm: the greatest height of a point below it, up to the flat's radius
    /// (what it dips by at 45°). Zero where it does not.
    pub fn tip_dip_mm(&self, standing: &Standing, pose: &Pose, before: usize) -> f64 {
        let radius_mm = self.profile.tip_radius_mm();
        let Ok(flat) = HeadProfile::new(&[[0.0, radius_mm], [radius_mm.max(1e-9), radius_mm]])
        else {
            return 0.0;
        };
        let flat = Head {
            profile: &flat,
            slack_mm: 0.0,
        };
        let mut dip_mm = 0.0;
        flat.each(standing, pose, before, Motion::default(), |leaf| {
            let seen = pose.seen(&leaf.point.at_mm);
            if seen[1] < radius_mm {
                dip_mm = f64::max(dip_mm, seen[0]);
            }
            ControlFlow::Continue(())
        });
        dip_mm
    }

    /// True where no point is touched anywhere on a straight way with an even turn between two poses, found at its
    /// middle; false where that is not sure.
    pub fn is_clear_between(&self, standing: &Standing, ends: [&Pose; 2], before: usize) -> bool {
        let [from, to] = ends;
        let sum = from.axis + to.axis;
        let Some(axis) = sum.try_normalize(1e-6) else {
            return false;
        };
        let middle = Pose {
            tip_mm: 0.5 * (from.tip_mm + to.tip_mm),
            axis,
        };
        let half_way = 0.5 * (to.tip_mm - from.tip_mm);
        let along_mm = half_way.dot(&axis).abs();
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

    /// Calls `on` for each point that is touched after at most that motion, until it breaks.
    fn each(
        &self,
        standing: &Standing,
        pose: &Pose,
        before: usize,
        motion: Motion,
        mut on: impl FnMut(&Leaf) -> ControlFlow<()>,
    ) {
        let before = u32::try_from(before).unwrap_or(u32::MAX);
        let along = pose.axis.abs();
        let across = pose.axis.map(|share| (1.0 - share * share).max(0.0).sqrt());
        let mut stack = [0u32; DEPTH_MAX];
        let mut waiting = usize::from(!standing.nodes.is_empty());
        while waiting > 0 {
            waiting -= 1;
            let index = stack[waiting];
            let node = &standing.nodes[index as usize];
            if node.earliest >= before || !self.may_hold(node, pose, [&along, &across], motion) {
                continue;
            }
            if node.second > 0 {
                stack[waiting] = node.second;
                stack[waiting + 1] = index + 1;
                waiting += 2;
                continue;
            }
            for leaf in &standing.leaves[node.from as usize..node.to as usize] {
                let stands = leaf.order < before;
                if stands && self.holds_point(&leaf.point, pose, motion) && on(leaf).is_break() {
                    return;
                }
            }
        }
    }

    /// True where the head may hold a point's middle or its edge, after at most that motion.
    #[inline]
    fn holds_point(&self, point: &Point, pose: &Pose, motion: Motion) -> bool {
        let seen = pose.seen(&point.at_mm);
        if self.holds(seen, motion) {
            return true;
        }
        // The edge is no farther than the half width.
        let [height_mm, from_axis_mm] = seen;
        let is_near = |grown_mm: f64| {
            height_mm + grown_mm > self.slack_mm
                && from_axis_mm - grown_mm < self.profile.radius_mm(height_mm + grown_mm)
        };
        let is_still = motion == Motion::default();
        if point.half_width_mm <= 0.0 || (is_still && !is_near(point.half_width_mm)) {
            return false;
        }
        // The edge follows the tip, within its plane.
        let way_mm = motion.along_mm.hypot(motion.across_mm);
        let leaning = point.normal.cross(&pose.axis).norm() + motion.turned_rad;
        let of_edge = Motion {
            along_mm: motion.along_mm + leaning.min(1.0) * way_mm,
            across_mm: motion.across_mm + way_mm,
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

    /// False where the head holds none of a box's points.
    #[inline]
    fn may_hold(&self, node: &Node, pose: &Pose, sides: [&Vector3; 2], motion: Motion) -> bool {
        let [along, across] = sides;
        if motion == Motion::default() {
            return self.may_hold_still(node, pose, sides);
        }
        let seen = pose.seen(&node.middle_mm);
        // Edges are within a half width, and may follow the tip.
        let way_mm = motion.along_mm.hypot(motion.across_mm);
        let grown_mm = match node.half_width_mm > 0.0 {
            true => node.half_width_mm + way_mm,
            false => 0.0,
        };
        let mut along_mm = motion.along_mm + along.dot(&node.half_mm) + grown_mm;
        let aside_mm = node.radius_mm.min(across.dot(&node.half_mm));
        let mut across_mm = motion.across_mm + aside_mm + grown_mm;
        if motion.turned_rad > 0.0 {
            // The farthest place of the box turns farthest.
            let distance_mm = seen[0].hypot(seen[1]) + along_mm + across_mm;
            along_mm += motion.turned_rad * distance_mm;
            across_mm += motion.turned_rad * distance_mm;
        }
        let still = Motion {
            along_mm,
            across_mm,
            turned_rad: 0.0,
        };
        self.holds(seen, still)
    }

    /// The same for a head that stands still.
    #[inline]
    fn may_hold_still(&self, node: &Node, pose: &Pose, [along, across]: [&Vector3; 2]) -> bool {
        let away = node.middle_mm - pose.tip_mm;
        let middle_mm = away.dot(&pose.axis);
        let up_mm = along.dot(&node.half_mm) + node.half_width_mm;
        if middle_mm + up_mm <= self.slack_mm || middle_mm - up_mm > self.profile.top_mm() {
            return false;
        }
        // No corner is farther aside than its edges' sum, or than the diagonal.
        let aside_mm = node.radius_mm.min(across.dot(&node.half_mm));
        let reach_mm = self.profile.radius_mm(middle_mm + up_mm) + aside_mm + node.half_width_mm;
        away.norm_squared() - middle_mm * middle_mm < reach_mm * reach_mm
    }
}
