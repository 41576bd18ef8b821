//! Pushes a curve inside the walls.
//!
//! Poses along each span are checked against the true walls, and one after the other is taken back by the least move and turn of
//! its control points, until none cuts deeper than the tolerance. Input: control points. Output: the control points moved and
//! turned, the spans that still cut, and those that were moved too far from their path.

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
/// that passes a tip of radius b²/a is at most step² a / 8 b² deeper between two of them: 0.19 µm for 0.6 x 0.2
/// mm.
const STEP: f64 = 0.01;
/// Least and most poses of a span.
const POSES_MIN: usize = 12;
/// See [`POSES_MIN`].
const POSES_MAX: usize = 2000;
/// Sweeps in which poses are moved back one by one.
const PROJECTIONS_MAX: usize = 200;
/// Largest total displacement of a control point, relative to b: beyond it, more than half of the
/// narrowest bead is misplaced.
const NEAR_SHARE: f64 = 1.0;
/// What a control point may be moved in all where there is no detour, against a: farther, the nozzle
/// would cover a different area. With one, [`NEAR_SHARE`].
const FAR_SHARE: f64 = 2.0;
/// Spans that are worth a thread.
const SPANS_AT_ONCE: usize = 64;

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

    /// What a control point may be moved in all where there is a detour, mm.
    pub fn near_mm(&self) -> f64 {
        NEAR_SHARE * self.aperture.minor_mm()
    }

    /// What it may be moved where there is none, mm.
    pub fn far_mm(&self) -> f64 {
        FAR_SHARE * self.aperture.major_mm()
    }

    /// Moves the deepest pose of one span after another back by the least displacement and rotation of its control
    /// points (Kaczmarz, 1937), each step with the current contacts: the correction of one is not confused with that of
    /// the next. It stops once a control point is moved farther than [`Self::far_mm`]: it would not converge, and spans would
    /// grow. Returns the spans that cut deeper than twice the tolerance in the end.
    pub fn project(&self, control: &mut [PlaneControl]) -> Vec<bool> {
        let spans = control.len().saturating_sub(1);
        let raw = control.to_vec();
        let mut dirty = self.spans_deeper_than(self.tolerance_mm, control);
        for _ in 0..PROJECTIONS_MAX {
            let mut changed = vec![false; spans];
            for span in (0..spans).filter(|&span| dirty[span]) {
                let poses = self.poses_of(control, span);
                let cuts = poses.filter_map(|(t, at)| Some((t, self.cut(at, self.tolerance_mm)?)));
                let deepest = cuts.max_by(|(_, p), (_, q)| p.depth_mm.total_cmp(&q.depth_mm));
                if let Some((t, found)) = deepest {
                    self.project_pose(control, span, t, &found);
                    // Control points span - 1 to span + 2 moved; each shapes four spans.
                    let low = span.saturating_sub(3);
                    changed[low..(span + 4).min(spans)].fill(true);
                }
            }
            if !changed.contains(&true)
                || strayed_spans(&raw, control, self.far_mm()).contains(&true)
            {
                break;
            }
            dirty = changed;
        }
        self.cutting_spans(control)
    }

    /// The spans with a pose that cuts deeper than twice the tolerance or has left the region.
    pub fn cutting_spans(&self, control: &[PlaneControl]) -> Vec<bool> {
        self.spans_deeper_than(2.0 * self.tolerance_mm, control)
    }

    fn spans_deeper_than(&self, depth_mm: f64, control: &[PlaneControl]) -> Vec<bool> {
        (0..control.len().saturating_sub(1))
            .into_par_iter()
            .with_min_len(SPANS_AT_ONCE)
            .map(|span| {
                let mut poses = self.poses_of(control, span);
                poses.any(|(_, at)| {
                    self.cut(at, depth_mm).is_some() || !self.walls.contains(at.center)
                })
            })
            .collect()
    }

    /// Poses along a span with their places in it, its end left to the next: the curve runs no faster
    /// than the longest of the three legs that it follows.
    fn poses_of(
        &self,
        control: &[PlaneControl],
        span: usize,
    ) -> impl Iterator<Item = (f64, Configuration)> {
        let way_mm = (0..3)
            .map(|leg| {
                let [p, q] = [0, 1].map(|end| control_at(control, (span + leg + end) as isize - 1));
                (q[0] - p[0]).hypot(q[1] - p[1]) + self.aperture.reach_mm() * (q[2] - p[2]).abs()
            })
            .fold(0.0, f64::max);
        let step_mm = STEP * self.aperture.unit_mm();
        let count = ((way_mm / step_mm).ceil() as usize).clamp(POSES_MIN, POSES_MAX);
        // The curve's end is nobody else's.
        let end = usize::from(span + 2 == control.len());
        (0..count + end).map(move |pose| {
            let t = pose as f64 / count as f64;
            (t, configuration(curve_at(control, span, t)))
        })
    }

    /// Where the pose cuts deeper than this, if it does.
    fn cut(&self, at: Configuration, depth_mm: f64) -> Option<WallContact> {
        let found = match self.scale {
            None => contact(self.aperture, at, self.walls, 1.0),
            Some(scale) => contact_on_ground(scale, self.aperture, at, self.walls),
        };
        found.filter(|found| found.depth_mm > depth_mm)
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
