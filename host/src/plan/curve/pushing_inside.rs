//! Pushes a curve inside the walls.
//!
//! Poses along each span are checked against the true walls and the control points pushed back, all at
//! once and, where that diverges, one pose after the other, until none cuts deeper than the tolerance.
//! Input: control points. Output: the control points moved and turned, the spans that still cut, and
//! those that were moved too far from their path.

use crate::geometry::Vector2;
use crate::geometry::aperture::Aperture;
use crate::geometry::clearance::{Configuration, WallContact, contact};
use crate::geometry::edge_index::EdgeIndex;
use crate::geometry::place_scale::{ScaleField, contact_on_ground};
use crate::geometry::plane_curve::{
    PlaneControl, configuration, control_at, curve_at, span_weights,
};
use rayon::prelude::*;
use std::ops::Range;

/// Largest displacement of any point of the aperture between two checked poses, of its unit. A vertex of a wall
/// that passes a tip of radius b²/a is at most step² a / 8 b² deeper between two of them: 0.75 µm for 0.6 x 0.2
/// mm, a quarter of that in the fine check.
const STEP: f64 = 0.02;
/// Least and most poses of a span.
const POSES_MIN: usize = 6;
/// See [`POSES_MIN`].
const POSES_MAX: usize = 2000;
/// Rounds of pushing back; each at least halves the remaining cut.
const ROUNDS_MAX: usize = 40;
/// Excess of a push over the depth of the cut, against the tolerance.
const DEEPER_SHARE: f64 = 0.3;
/// Increase of the push of each round over the first.
const GAIN_A_ROUND: f64 = 0.05;
/// Round from which poses are turned as well as pushed: where pushing alone settles, headings stay.
const TURNING_ROUND: usize = 8;
/// Sweeps in which poses are moved back one by one.
const PROJECTIONS_MAX: usize = 200;
/// Largest total displacement of a control point, relative to b: beyond it, more than half of the
/// narrowest bead is misplaced. On slices nearly all pushes that converge move less than 0.9 of it.
pub const NEAR_SHARE: f64 = 1.0;
/// Spans that are worth a thread.
const SPANS_AT_ONCE: usize = 64;

/// A pose of the curve that cuts too deep.
struct Cut {
    span: usize,
    /// Where in the span.
    t: f64,
    heading_rad: f64,
    found: WallContact,
}

/// Density of the checks of a curve.
#[derive(Clone, Copy)]
struct Look {
    /// Largest displacement of any point of the aperture from pose to pose.
    step_mm: f64,
    /// Least poses of a span.
    poses_min: usize,
    /// Deeper ones are cuts.
    depth_mm: f64,
}

/// An aperture and the walls inside which it stays.
#[derive(Clone, Copy)]
pub struct InsideWalls<'a> {
    /// The aperture.
    pub aperture: &'a Aperture,
    /// The walls that it keeps inside of.
    pub walls: &'a EdgeIndex,
    /// Largest depth to which a pose may cut, mm.
    pub tolerance_mm: f64,
    /// Size of the aperture by position, if the plane is the chart of a curved surface.
    pub scale: Option<&'a ScaleField>,
}

impl<'a> InsideWalls<'a> {
    /// On a flat surface.
    pub fn flat(
        aperture: &'a Aperture,
        walls: &'a EdgeIndex,
        tolerance_mm: f64,
    ) -> InsideWalls<'a> {
        InsideWalls {
            aperture,
            walls,
            tolerance_mm,
            scale: None,
        }
    }

    /// Pushes the control points of cutting spans back along the contact normal, and from
    /// `TURNING_ROUND` on turns them as well. True if a close check finds no cutting pose any more.
    pub fn push(&self, control: &mut [PlaneControl]) -> bool {
        let spans = control.len().saturating_sub(1);
        let mut dirty = vec![true; spans];
        let mut look = self.first_look();
        let mut is_close = false;
        for round in 0..ROUNDS_MAX {
            let mut cuts = self.cuts(look, control, &dirty);
            if cuts.is_empty() && !is_close {
                (look, is_close) = (self.close_look(), true);
                cuts = self.cuts(look, control, &vec![true; spans]);
            }
            if cuts.is_empty() {
                return true;
            }
            dirty = self.push_back(control, &cuts, round);
        }
        false
    }

    /// Moves one pose after another back by the least displacement and rotation of its control points
    /// (Kaczmarz, 1937, each step with the current contacts). This is slower than pushing all at once,
    /// but the correction of one pose is not confused with that of the next. It stops once a control
    /// point is moved farther than `far_mm`: it would not converge, and spans would grow. Returns the
    /// spans that cut in the end.
    pub fn project(&self, control: &mut [PlaneControl], far_mm: f64) -> Vec<bool> {
        let spans = control.len().saturating_sub(1);
        let look = self.close_look();
        let raw = control.to_vec();
        let mut dirty = self.cutting_spans(control);
        for _ in 0..PROJECTIONS_MAX {
            let mut changed = vec![false; spans];
            for span in (0..spans).filter(|&span| dirty[span]) {
                let places: Vec<f64> = self.poses_of(look, control, span).map(|p| p.0).collect();
                for t in places {
                    let at = configuration(curve_at(control, span, t));
                    if let Some(found) = self.cut(look, at) {
                        self.project_pose(control, span, t, &found);
                        // Control points span - 1 to span + 2 moved; each shapes four spans.
                        let low = span.saturating_sub(3);
                        changed[low..(span + 4).min(spans)].fill(true);
                    }
                }
            }
            if !changed.contains(&true) || strayed_spans(&raw, control, far_mm).contains(&true) {
                break;
            }
            dirty = changed;
        }
        self.cutting_spans(control)
    }

    /// The spans with a pose that cuts deeper than the tolerance or has left the region.
    pub fn cutting_spans(&self, control: &[PlaneControl]) -> Vec<bool> {
        let look = self.close_look();
        (0..control.len().saturating_sub(1))
            .into_par_iter()
            .with_min_len(SPANS_AT_ONCE)
            .map(|span| {
                self.poses_of(look, control, span)
                    .any(|(_, at)| self.cut(look, at).is_some() || !self.walls.contains(at.center))
            })
            .collect()
    }

    /// As far as pushing goes.
    fn first_look(&self) -> Look {
        Look {
            step_mm: STEP * self.aperture.unit_mm(),
            poses_min: POSES_MIN,
            depth_mm: self.tolerance_mm,
        }
    }

    /// What a curve that is kept must pass.
    fn close_look(&self) -> Look {
        Look {
            step_mm: 0.5 * STEP * self.aperture.unit_mm(),
            poses_min: 2 * POSES_MIN,
            depth_mm: 2.0 * self.tolerance_mm,
        }
    }

    /// Poses along a span with their places in it, its end left to the next: the curve runs no faster
    /// than the longest of the three legs that it follows.
    fn poses_of(
        &self,
        look: Look,
        control: &[PlaneControl],
        span: usize,
    ) -> impl Iterator<Item = (f64, Configuration)> {
        let way_mm = (0..3)
            .map(|leg| {
                let [p, q] = [0, 1].map(|end| control_at(control, (span + leg + end) as isize - 1));
                (q[0] - p[0]).hypot(q[1] - p[1]) + self.aperture.reach_mm() * (q[2] - p[2]).abs()
            })
            .fold(0.0, f64::max);
        let count = ((way_mm / look.step_mm).ceil() as usize).clamp(look.poses_min, POSES_MAX);
        // The curve's end is nobody else's.
        let end = usize::from(span + 2 == control.len());
        (0..count + end).map(move |pose| {
            let t = pose as f64 / count as f64;
            (t, configuration(curve_at(control, span, t)))
        })
    }

    /// Where the pose cuts, if it does.
    fn cut(&self, look: Look, at: Configuration) -> Option<WallContact> {
        let found = match self.scale {
            None => contact(self.aperture, at, self.walls, 1.0),
            Some(scale) => contact_on_ground(scale, self.aperture, at, self.walls),
        };
        found.filter(|found| found.depth_mm > look.depth_mm)
    }

    /// The cuts of the `dirty` spans, in their order.
    fn cuts(&self, look: Look, control: &[PlaneControl], dirty: &[bool]) -> Vec<Cut> {
        let spans: Vec<usize> = (0..dirty.len()).filter(|&span| dirty[span]).collect();
        let cuts_of = |span: usize| {
            let poses = self.poses_of(look, control, span);
            poses.filter_map(move |(t, at)| {
                Some(Cut {
                    span,
                    t,
                    heading_rad: at.heading_rad,
                    found: self.cut(look, at)?,
                })
            })
        };
        let spans = spans.into_par_iter().with_min_len(SPANS_AT_ONCE);
        spans.flat_map_iter(cuts_of).collect()
    }

    /// Moves the control points about the cuts, in later rounds turns them as well; returns the spans
    /// that this changes.
    fn push_back(&self, control: &mut [PlaneControl], cuts: &[Cut], round: usize) -> Vec<bool> {
        let turning = round >= TURNING_ROUND;
        let spans = control.len() - 1;
        let mut push = vec![Vector2::zeros(); control.len()];
        let mut turn = vec![0.0f64; control.len()];
        for cut in cuts {
            let (span, t) = (cut.span, cut.t);
            let depth_mm = cut.found.depth_mm + DEEPER_SHARE * self.tolerance_mm;
            let (back, by_rad) = if turning {
                self.pushed_and_turned(cut.heading_rad, cut.found.outward, depth_mm)
            } else {
                (-cut.found.outward * depth_mm, 0.0)
            };
            for (own, share) in [(span, 1.0 - 0.5 * t), (span + 1, 0.5 + 0.5 * t)] {
                add_longer(&mut push[own], back * share);
                if (by_rad * share).abs() > turn[own].abs() {
                    turn[own] = by_rad * share;
                }
            }
        }
        // Later rounds push harder, so that narrow places where two walls push in turn settle.
        let gain = 1.0 + GAIN_A_ROUND * round as f64;
        let mut changed = vec![false; spans];
        for (i, by) in push.iter().enumerate() {
            if by.norm_squared() > 0.0 || turn[i] != 0.0 {
                control[i][0] += by.x * gain;
                control[i][1] += by.y * gain;
                control[i][2] += turn[i];
                for flag in &mut changed[i.saturating_sub(2)..(i + 2).min(spans)] {
                    *flag = true;
                }
            }
        }
        changed
    }

    /// The least move and turn together that take a contact `depth_mm` back, a turn counted at the major
    /// semi-axis: between two walls the moves cancel and the turn is what helps.
    fn pushed_and_turned(
        &self,
        heading_rad: f64,
        outward: Vector2,
        depth_mm: f64,
    ) -> (Vector2, f64) {
        let support = self.aperture.support_point(heading_rad, outward);
        let arm_mm = outward.dot(&Vector2::new(-support.y, support.x));
        let radius_mm = self.aperture.major_mm();
        let share = depth_mm / (1.0 + (arm_mm / radius_mm).powi(2));
        (-outward * share, -share * arm_mm / radius_mm.powi(2))
    }

    /// The least move and turn of the control points of a span that takes its pose at `t` off a wall.
    fn project_pose(&self, control: &mut [PlaneControl], span: usize, t: f64, found: &WallContact) {
        let heading_rad = curve_at(control, span, t)[2];
        let (back, by_rad) = self.pushed_and_turned(heading_rad, found.outward, found.depth_mm);
        let last = control.len() - 1;
        let mut weights = [(0usize, 0.0); 4];
        for (k, w) in span_weights(t).into_iter().enumerate() {
            // Points beyond an end represent twice the end minus its neighbour.
            let place = (span + k) as isize - 1;
            let mut add = |at: usize, w: f64| {
                let low = span.saturating_sub(1);
                let slot = &mut weights[at - low];
                *slot = (at, slot.1 + w);
            };
            if place < 0 {
                add(0, 2.0 * w);
                add(1, -w);
            } else if place as usize > last {
                add(last, 2.0 * w);
                add(last - 1, -w);
            } else {
                add(place as usize, w);
            }
        }
        let sum: f64 = weights.iter().map(|(_, w)| w * w).sum();
        for (at, w) in weights {
            let share = w / sum;
            let point = &mut control[at];
            *point = [
                point[0] + back.x * share,
                point[1] + back.y * share,
                point[2] + by_rad * share,
            ];
        }
    }
}

/// Keeps the longer of two pushes of about the same direction, the sum of opposed ones.
fn add_longer(own: &mut Vector2, other: Vector2) {
    if own.dot(&other) <= 0.0 {
        *own += other;
    } else if other.norm_squared() > own.norm_squared() {
        *own = other;
    }
}

/// The spans of `after` that have moved farther than this.
pub fn strayed_spans(before: &[PlaneControl], after: &[PlaneControl], far_mm: f64) -> Vec<bool> {
    let moved = before.iter().zip(after);
    let strayed = moved.map(|(p, q)| (q[0] - p[0]).hypot(q[1] - p[1]) > far_mm);
    let strayed: Vec<bool> = strayed.collect();
    strayed.windows(2).map(|pair| pair[0] || pair[1]).collect()
}

/// The runs of bad spans, in order.
pub fn bad_runs(bad: &[bool]) -> Vec<Range<usize>> {
    let mut runs: Vec<Range<usize>> = Vec::new();
    for span in (0..bad.len()).filter(|&span| bad[span]) {
        match runs.last_mut() {
            Some(run) if run.end == span => run.end += 1,
            _ => runs.push(span..span + 1),
        }
    }
    runs
}
