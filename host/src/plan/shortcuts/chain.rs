//! A pass as a chain of poses at even steps, as shortcuts need it.
//!
//! In: a [`LayerPass`]. Out: poses at even steps of way and turn along the curve that its placements
//! stand for, each with the contact it came from; the poses that lie on the curve and half way between,
//! which stand for the ground that is swept.

use super::local_time::{Knot, find_rates};
use crate::geometry::clearance::Configuration;
use crate::plan::curve::even_spans::Way;
use crate::plan::curve::layer_path::{merged, sharpened};
use crate::plan::curve::plane_curve::{PlaneControl, configuration};
use crate::plan::pass::Contact;
use crate::plan::pass::LayerPass;
use crate::plan::pass::Placement;
use crate::plan::pose_limits::PoseLimits;
use std::ops::Range;

/// Poses of a span of the placements' curve, among which even steps are found.
const FINE: usize = 12;

/// One pass: poses, contacts, and the motion along them.
pub struct Chain {
    /// The poses.
    pub poses: Vec<PlaneControl>,
    /// The contact of each pose.
    pub contacts: Vec<Contact>,
    /// What binds the motion at each pose.
    pub knots: Vec<Knot>,
    /// u̇² at each pose, 1/s².
    pub rates: Vec<f64>,
}

impl Chain {
    /// The pass at steps of `step_mm`; a turn by a radian counts as `turn_mm`.
    pub fn of(pass: &LayerPass, step_mm: f64, turn_mm: f64) -> Chain {
        let (control, numbers) = merged(pass);
        let way = Way::of(&sharpened(&control), FINE, turn_mm);
        let steps = (way.whole_mm() / step_mm).ceil().max(3.0) as usize;
        let (poses, from) = way.even_steps(steps);
        let contact = |at: &usize| pass.placements[numbers[*at]].contact;
        Chain {
            contacts: from.iter().map(contact).collect(),
            poses,
            knots: Vec::new(),
            rates: Vec::new(),
        }
    }

    /// Finds how fast it is run from rest to rest.
    pub fn time(&mut self, limits: &PoseLimits) {
        let poses = &self.poses;
        self.knots.clear();
        self.knots
            .extend((0..poses.len()).map(|i| limits.knot(poses, i)));
        find_rates(&self.knots, [0.0; 2], &mut self.rates);
    }

    /// The pass's placements.
    pub fn placements(&self) -> Vec<Placement> {
        let places = self.poses.iter().zip(&self.contacts);
        places
            .map(|(&pose, &contact)| Placement {
                at: configuration(pose),
                feasible: true,
                contact,
            })
            .collect()
    }

    /// The poses before `range` (`before`) or behind it within `way_mm`.
    pub fn beside(&self, range: Range<usize>, way_mm: f64) -> [Range<usize>; 2] {
        let leg_mm = |i: usize| {
            let [p, q] = [self.poses[i], self.poses[i + 1]];
            (q[0] - p[0]).hypot(q[1] - p[1])
        };
        let (mut low, mut way) = (range.start, 0.0);
        while low > 0 && way < way_mm {
            low -= 1;
            way += leg_mm(low);
        }
        let (mut high, mut way) = (range.end, 0.0);
        while high < self.poses.len() && way < way_mm {
            way += leg_mm(high - 1);
            high += 1;
        }
        [low..range.start, range.end..high]
    }
}

/// The poses of a curve that runs through `poses` where they are smooth and beside them in corners, as
/// the layer path makes it: those of `range` and the ones half way to the next.
pub fn swept_poses(poses: &[PlaneControl], range: Range<usize>, swept: &mut Vec<Configuration>) {
    let on_curve = |i: usize| -> PlaneControl {
        if i == 0 || i + 1 >= poses.len() {
            return poses[i];
        }
        let (before, own, after) = (poses[i - 1], poses[i], poses[i + 1]);
        let step = (after[0] - before[0]).hypot(after[1] - before[1]) / 2.0;
        let second: PlaneControl = std::array::from_fn(|c| before[c] - 2.0 * own[c] + after[c]);
        if crate::plan::curve::layer_path::is_smooth(&second, step) {
            own
        } else {
            std::array::from_fn(|c| own[c] + second[c] / 6.0)
        }
    };
    let mut last: Option<PlaneControl> = None;
    for i in range {
        let own = on_curve(i);
        if let Some(last) = last {
            let middle: PlaneControl = std::array::from_fn(|c| 0.5 * (last[c] + own[c]));
            swept.push(configuration(middle));
        }
        swept.push(configuration(own));
        last = Some(own);
    }
}
