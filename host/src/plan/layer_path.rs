//! From placements to the curve that is printed: a uniform cubic B-spline in (x, y, heading) whose
//! every pose keeps inside the region.
//!
//! The placements are the control polygon, sharpened by one step of the interpolation inverse
//! (P - second difference / 6) where they are smooth, so that the curve passes through them to
//! fourth order; corners stay rounded by the spline itself. Then poses along each span are checked
//! against the true walls and the control points pushed back, all at once and where that goes astray
//! one pose after the other, until none cuts deeper than the tolerance.

use super::passes::LayerPass;
use crate::geometry::aperture::Aperture;
use crate::geometry::clearance::{Configuration, WallContact, contact};
use crate::geometry::edge_index::EdgeIndex;
use crate::geometry::{Point2, Vector2};
use rayon::prelude::*;

/// Control polygon in the layer plane: x, y in mm, heading in rad.
pub type PlaneControl = [f64; 3];

/// Longest way of any point of the aperture between two poses that are looked at, mm. A vertex of a wall
/// that passes a tip of radius b²/a is at most step² a / 8 b² deeper between two of them: 0.75 µm for
/// 0.6 x 0.2 mm, a quarter of that in the close look.
const STEP_MM: f64 = 0.02;
/// Least and most poses of a span.
const POSES_MIN: usize = 6;
/// See [`POSES_MIN`].
const POSES_MAX: usize = 2000;
/// Rounds of pushing back; each at least halves what is left.
const ROUNDS_MAX: usize = 40;
/// Round from which poses are turned as well as pushed: where pushing alone settles, headings stay.
const TURNING_ROUND: usize = 8;
/// Sweeps in which poses are taken back one by one.
const PROJECTIONS_MAX: usize = 200;
/// Second differences above this share of the step are corners, not curvature.
const SMOOTH_SHARE: f64 = 0.35;
/// Placements closer than this and turned by less than `MERGE_RAD` are one, mm.
const MERGE_MM: f64 = 0.012;
/// See `MERGE_MM`.
const MERGE_RAD: f64 = 0.02;

/// Least spans of a curve that is kept after a cut.
const SPANS_MIN: usize = 2;

/// The printed curves of an opened pass: one, or several where the aperture does not fit in between.
/// `tolerance_mm` is how deep a pose may cut.
pub fn pass_curves(
    pass: &LayerPass,
    aperture: &Aperture,
    walls: &EdgeIndex,
    tolerance_mm: f64,
) -> Vec<Vec<PlaneControl>> {
    let control = sharpened(&merged(pass));
    // Where pushing does not help the curve is cut; the pieces have new ends, so they are pushed
    // again. Each round removes at least one span, and few rounds ever happen.
    let mut curves = Vec::new();
    let mut open = vec![control];
    while let Some(raw) = open.pop() {
        let mut control = raw.clone();
        let mut is_inside = push_inside(&mut control, aperture, walls, tolerance_mm);
        if !is_inside {
            // In a tight swing pushes that do not know of each other can go astray.
            control.clone_from(&raw);
            is_inside = project_inside(&mut control, aperture, walls, tolerance_mm);
        }
        if is_inside && walls.contains(configuration(control[0]).center) {
            curves.push(control);
            continue;
        }
        let bad = cutting_spans(&control, aperture, walls, tolerance_mm);
        if bad.iter().any(|&b| b) {
            open.extend(pieces_without(&raw, &bad));
        } else {
            curves.push(control);
        }
    }
    curves.reverse();
    curves
}

/// Which spans have a pose that cuts deeper than the tolerance or has left the region.
fn cutting_spans(
    control: &[PlaneControl],
    aperture: &Aperture,
    walls: &EdgeIndex,
    tolerance_mm: f64,
) -> Vec<bool> {
    (0..control.len().saturating_sub(1))
        .into_par_iter()
        .with_min_len(SPANS_AT_ONCE)
        .map(|span| {
            let closely = Look::closely(tolerance_mm);
            closely.poses_of(control, span, aperture).any(|(_, at)| {
                closely.cut(aperture, at, walls).is_some() || !walls.contains(at.center)
            })
        })
        .collect()
}

/// The runs of control points between bad spans, short ones left out.
fn pieces_without(control: &[PlaneControl], bad: &[bool]) -> Vec<Vec<PlaneControl>> {
    let mut pieces = Vec::new();
    let mut run: Vec<PlaneControl> = vec![control[0]];
    for (span, &cut) in bad.iter().enumerate() {
        if cut {
            pieces.push(std::mem::take(&mut run));
        }
        run.push(control[span + 1]);
    }
    pieces.push(run);
    pieces.retain(|piece| piece.len() > SPANS_MIN);
    pieces.reverse();
    pieces
}

/// Placements as control points, near-duplicates merged.
fn merged(pass: &LayerPass) -> Vec<PlaneControl> {
    let mut control: Vec<PlaneControl> = Vec::with_capacity(pass.placements.len() + 1);
    for p in &pass.placements {
        let next = [p.at.center.x, p.at.center.y, p.at.heading_rad];
        let near = control.last().is_some_and(|l| {
            (l[0] - next[0]).hypot(l[1] - next[1]) < MERGE_MM && (l[2] - next[2]).abs() < MERGE_RAD
        });
        if !near {
            control.push(next);
        }
    }
    if control.len() == 1 {
        control.push(control[0]);
    }
    control
}

fn sharpened(raw: &[PlaneControl]) -> Vec<PlaneControl> {
    let mut control = raw.to_vec();
    for i in 1..raw.len().saturating_sub(1) {
        let step = (raw[i + 1][0] - raw[i - 1][0]).hypot(raw[i + 1][1] - raw[i - 1][1]) / 2.0;
        let second: [f64; 3] =
            std::array::from_fn(|c| raw[i - 1][c] - 2.0 * raw[i][c] + raw[i + 1][c]);
        if second[0].hypot(second[1]) < SMOOTH_SHARE * step {
            control[i] = std::array::from_fn(|c| raw[i][c] - second[c] / 6.0);
        }
    }
    control
}

/// Control point `i`, phantom points beyond the ends included (natural ends).
fn control_at(control: &[PlaneControl], i: isize) -> PlaneControl {
    let n = control.len() as isize;
    let mirror = |end: PlaneControl, inner: PlaneControl| -> PlaneControl {
        std::array::from_fn(|c| 2.0 * end[c] - inner[c])
    };
    if i < 0 {
        mirror(control[0], control[1.min(n as usize - 1)])
    } else if i >= n {
        mirror(control[n as usize - 1], control[(n - 2).max(0) as usize])
    } else {
        control[i as usize]
    }
}

/// Weights of the four control points of a span at `t`.
fn span_weights(t: f64) -> [f64; 4] {
    [
        (1.0 - t).powi(3) / 6.0,
        (3.0 * t.powi(3) - 6.0 * t * t + 4.0) / 6.0,
        (-3.0 * t.powi(3) + 3.0 * t * t + 3.0 * t + 1.0) / 6.0,
        t.powi(3) / 6.0,
    ]
}

/// The curve at parameter i + t of the uniform cubic B-spline.
pub fn curve_at(control: &[PlaneControl], span: usize, t: f64) -> PlaneControl {
    let w = span_weights(t);
    let points: [PlaneControl; 4] =
        std::array::from_fn(|k| control_at(control, span as isize + k as isize - 1));
    std::array::from_fn(|c| (0..4).map(|k| w[k] * points[k][c]).sum())
}

/// The aperture's placement for a curve point.
pub fn configuration(point: PlaneControl) -> Configuration {
    Configuration {
        center: Point2::new(point[0], point[1]),
        heading_rad: point[2],
    }
}

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

/// How closely a curve is looked at.
#[derive(Clone, Copy)]
struct Look {
    /// Longest way of any point of the aperture from pose to pose.
    step_mm: f64,
    /// Least poses of a span.
    poses_min: usize,
    /// Deeper ones are cuts.
    depth_mm: f64,
}

impl Look {
    /// As far as pushing goes.
    fn first(tolerance_mm: f64) -> Look {
        Look {
            step_mm: STEP_MM,
            poses_min: POSES_MIN,
            depth_mm: tolerance_mm,
        }
    }

    /// What a curve that is kept must pass.
    fn closely(tolerance_mm: f64) -> Look {
        Look {
            step_mm: STEP_MM / 2.0,
            poses_min: 2 * POSES_MIN,
            depth_mm: 2.0 * tolerance_mm,
        }
    }

    /// Poses along a span with their places in it, its end left to the next: the curve runs no faster than the longest of the
    /// three legs that it follows.
    fn poses_of(
        self,
        control: &[PlaneControl],
        span: usize,
        aperture: &Aperture,
    ) -> impl Iterator<Item = (f64, Configuration)> {
        let way_mm = (0..3)
            .map(|leg| {
                let [p, q] = [0, 1].map(|end| control_at(control, (span + leg + end) as isize - 1));
                (q[0] - p[0]).hypot(q[1] - p[1]) + aperture.reach_mm() * (q[2] - p[2]).abs()
            })
            .fold(0.0, f64::max);
        let count = ((way_mm / self.step_mm).ceil() as usize).clamp(self.poses_min, POSES_MAX);
        // The curve's end is nobody else's.
        let end = usize::from(span + 2 == control.len());
        (0..count + end).map(move |pose| {
            let t = pose as f64 / count as f64;
            (t, configuration(curve_at(control, span, t)))
        })
    }

    /// Where the pose cuts, if it does.
    fn cut(self, aperture: &Aperture, at: Configuration, walls: &EdgeIndex) -> Option<WallContact> {
        contact(aperture, at, walls, 1.0).filter(|found| found.depth_mm > self.depth_mm)
    }

    /// The cuts of one span.
    fn cuts_of(
        self,
        control: &[PlaneControl],
        span: usize,
        aperture: &Aperture,
        walls: &EdgeIndex,
    ) -> impl Iterator<Item = Cut> {
        self.poses_of(control, span, aperture)
            .filter_map(move |(t, at)| {
                Some(Cut {
                    span,
                    t,
                    heading_rad: at.heading_rad,
                    found: self.cut(aperture, at, walls)?,
                })
            })
    }
}

/// Pushes the control points of cutting spans back along the contact normal, from [`TURNING_ROUND`] on
/// turns them as well. True if no pose cuts any more, looked at closely.
fn push_inside(
    control: &mut [PlaneControl],
    aperture: &Aperture,
    walls: &EdgeIndex,
    tolerance_mm: f64,
) -> bool {
    let spans = control.len().saturating_sub(1);
    let mut dirty = vec![true; spans];
    let [first, closely] = [Look::first(tolerance_mm), Look::closely(tolerance_mm)];
    let mut look = first;
    for round in 0..ROUNDS_MAX {
        let find = |look: Look, dirty: &[bool]| -> Vec<Cut> {
            let spans_to_check: Vec<usize> = (0..spans).filter(|&span| dirty[span]).collect();
            spans_to_check
                .into_par_iter()
                .with_min_len(SPANS_AT_ONCE)
                .flat_map_iter(|span| look.cuts_of(control, span, aperture, walls))
                .collect()
        };
        let mut cuts = find(look, &dirty);
        if cuts.is_empty() && look.step_mm > closely.step_mm {
            look = closely;
            cuts = find(look, &vec![true; spans]);
        }
        if cuts.is_empty() {
            return true;
        }
        let turning = round >= TURNING_ROUND;
        dirty = push_back(control, aperture, &cuts, tolerance_mm, round, turning);
    }
    false
}

/// Moves the control points about the cuts, and turns them if `turning`; returns the spans that this
/// changes.
fn push_back(
    control: &mut [PlaneControl],
    aperture: &Aperture,
    cuts: &[Cut],
    tolerance_mm: f64,
    round: usize,
    turning: bool,
) -> Vec<bool> {
    let spans = control.len() - 1;
    let mut push = vec![Vector2::zeros(); control.len()];
    let mut turn = vec![0.0f64; control.len()];
    for cut in cuts {
        let (span, t) = (cut.span, cut.t);
        let depth_mm = cut.found.depth_mm + 0.3 * tolerance_mm;
        let (back, by_rad) = if turning {
            pushed_and_turned(aperture, cut.heading_rad, cut.found.outward, depth_mm)
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
    let gain = 1.0 + 0.05 * round as f64;
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
    aperture: &Aperture,
    heading_rad: f64,
    outward: Vector2,
    depth_mm: f64,
) -> (Vector2, f64) {
    let support = aperture.support_point(heading_rad, outward);
    let arm_mm = outward.dot(&Vector2::new(-support.y, support.x));
    let radius_mm = aperture.major_mm();
    let share = depth_mm / (1.0 + (arm_mm / radius_mm).powi(2));
    (-outward * share, -share * arm_mm / radius_mm.powi(2))
}

/// Takes one pose after the other back by the least move and turn of the control points it hangs on
/// (Kaczmarz, 1937, each step with the contacts as they then are). Slower than pushing all at once,
/// yet what one pose needs is not taken for what the next one does. True if no pose cuts any more.
fn project_inside(
    control: &mut [PlaneControl],
    aperture: &Aperture,
    walls: &EdgeIndex,
    tolerance_mm: f64,
) -> bool {
    let spans = control.len().saturating_sub(1);
    let look = Look::closely(tolerance_mm);
    let mut dirty = cutting_spans(control, aperture, walls, tolerance_mm);
    for _ in 0..PROJECTIONS_MAX {
        let mut changed = vec![false; spans];
        for span in (0..spans).filter(|&span| dirty[span]) {
            let places: Vec<f64> = look
                .poses_of(control, span, aperture)
                .map(|p| p.0)
                .collect();
            for t in places {
                let at = configuration(curve_at(control, span, t));
                if let Some(found) = look.cut(aperture, at, walls) {
                    project(control, span, t, aperture, &found);
                    let low = span.saturating_sub(2);
                    changed[low..(span + 3).min(spans)].fill(true);
                }
            }
        }
        if !changed.contains(&true) {
            return !cutting_spans(control, aperture, walls, tolerance_mm).contains(&true);
        }
        dirty = changed;
    }
    false
}

/// The least move and turn of the control points of a span that takes its pose at `t` off a wall.
fn project(
    control: &mut [PlaneControl],
    span: usize,
    t: f64,
    aperture: &Aperture,
    found: &WallContact,
) {
    let heading_rad = curve_at(control, span, t)[2];
    let (back, by_rad) = pushed_and_turned(aperture, heading_rad, found.outward, found.depth_mm);
    let last = control.len() - 1;
    let mut weights = [(0usize, 0.0); 4];
    for (k, w) in span_weights(t).into_iter().enumerate() {
        // Points beyond an end stand for twice the end less its neighbour.
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

/// Keeps the longer of two pushes of about the same direction, the sum of opposed ones.
fn add_longer(own: &mut Vector2, other: Vector2) {
    if own.dot(&other) <= 0.0 {
        *own += other;
    } else if other.norm_squared() > own.norm_squared() {
        *own = other;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::test_shapes::{ELLIPSE as APERTURE, walls};
    use crate::plan::heading_profile::slide_inside;
    use crate::plan::test_passes::pass;

    /// Goal: a tooth of the wall that passes under the nozzle's tip within a part of a long span is
    /// seen (10 um between two of twelve poses were not), and so is what the last pose cuts. Method:
    /// placements 1 mm apart 0.6 mm above a wall, the long axis upright, and the tooth at several
    /// places of the spans and under the end.
    #[test]
    fn nothing_hides_between_the_poses_of_a_long_span() {
        for tooth_x in [0.042, 0.125, 0.46, 1.709, 2.0] {
            let (low, high) = (tooth_x - 0.01, tooth_x + 0.01);
            let walls = walls(&[&[
                [-5.0, 0.0],
                [low, 0.0],
                [tooth_x, 0.01],
                [high, 0.0],
                [5.0, 0.0],
                [5.0, 5.0],
                [-5.0, 5.0],
            ]]);
            let upright = std::f64::consts::FRAC_PI_2;
            let places = (-2..=2).map(|i| (Point2::new(f64::from(i), 0.6), upright));
            let pass = pass(places, false);
            let curves = pass_curves(&pass, &APERTURE, &walls, 4e-4);
            assert_eq!(curves.len(), 1, "{tooth_x}");
            let last = curves[0].len() - 2;
            for (span, step) in (0..=last).flat_map(|span| (0..=400).map(move |step| (span, step)))
            {
                let at = configuration(curve_at(&curves[0], span, f64::from(step) / 400.0));
                let depth_mm = contact(&APERTURE, at, &walls, 1.0).map_or(0.0, |c| c.depth_mm);
                assert!(depth_mm < 1e-3, "{tooth_x}: {depth_mm} mm at {at:?}");
            }
        }
    }

    /// Goal: where an aperture is turned a little too wide between two walls, it is turned back, and
    /// the curve stays whole. Method: a corridor 1 mm wide in which 0.9 rad of heading fits across
    /// (e = 0.41 mm), and 1.3 rad (e = 0.58 mm) in the middle does not.
    #[test]
    fn a_tight_passage_does_not_cut_the_curve() {
        let walls = walls(&[&[[-5.0, -0.5], [5.0, -0.5], [5.0, 0.5], [-5.0, 0.5]]]);
        let places = (-40..=40).map(|i| {
            let x = 0.1 * f64::from(i);
            (Point2::new(x, 0.0), if x.abs() < 0.5 { 1.3 } else { 0.7 })
        });
        let pass = pass(places, false);
        let curves = pass_curves(&pass, &APERTURE, &walls, 4e-4);
        assert_eq!(curves.len(), 1);
        for span in 0..curves[0].len() - 1 {
            for step in 0..20 {
                let at = configuration(curve_at(&curves[0], span, f64::from(step) / 20.0));
                let reach = APERTURE.extent_mm(at.heading_rad, Vector2::y()) + at.center.y.abs();
                assert!(reach < 0.501, "{at:?}");
            }
        }
    }

    /// Goal: a swing around a corner in which moves alone go astray keeps its curve whole. Method: an
    /// L-shaped channel 1.139 mm wide (a find among 4000 random ones), the heading turned by 136° on
    /// the way, poses slid off the walls until they cut no deeper than 8 % of the aperture.
    #[test]
    fn a_tight_swing_does_not_cut_the_curve() {
        let (w, cut, y, steps) = (1.139, 0.142, 0.573, 16);
        let walls = walls(&[&[
            [-w, 5.0],
            [-w, cut - w],
            [cut - w, -w],
            [5.0, -w],
            [5.0, 0.0],
            [0.0, 0.0],
            [0.0, 5.0],
        ]]);
        let arm = y + w / 2.0;
        let places = (0..=steps).filter_map(|i| {
            let t = f64::from(i) / f64::from(steps);
            let (left, right) = ((1.0 - 2.0 * t).max(0.0), (2.0 * t - 1.0).max(0.0));
            let center = Point2::new(arm * right - w / 2.0, arm * left - w / 2.0);
            let heading_rad = 0.045 - 2.368 * t;
            let at = Configuration {
                center,
                heading_rad,
            };
            let slid = slide_inside(at, &APERTURE, &walls, 8, 0.08)?;
            Some((slid.center, slid.heading_rad))
        });
        let pass = pass(places, false);
        assert!(pass.placements.len() >= steps as usize);
        let mut control = sharpened(&merged(&pass));
        let is_settled = push_inside(&mut control, &APERTURE, &walls, 4e-4);
        assert!(!is_settled, "no longer a swing in which moves go astray");
        let curves = pass_curves(&pass, &APERTURE, &walls, 4e-4);
        assert_eq!(curves.len(), 1);
        for span in 0..curves[0].len() - 1 {
            for step in 0..50 {
                let at = configuration(curve_at(&curves[0], span, f64::from(step) / 50.0));
                let depth_mm = contact(&APERTURE, at, &walls, 1.0).map_or(0.0, |c| c.depth_mm);
                assert!(depth_mm < 1e-3, "{depth_mm} mm at {at:?}");
            }
        }
    }
}
