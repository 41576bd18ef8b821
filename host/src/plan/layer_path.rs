//! From placements to the curve that is printed: a uniform cubic B-spline in (x, y, heading) whose
//! every pose keeps inside the region.
//!
//! The placements are the control polygon, sharpened by one step of the interpolation inverse
//! (P - second difference / 6) where they are smooth, so that the curve passes through them to
//! fourth order; corners stay rounded by the spline itself. Then the curve is pushed inside the walls
//! ([`super::curve_inside`]), and cut where that fails.

use super::curve_inside::InsideWalls;
use super::passes::LayerPass;
use super::plane_curve::{PlaneControl, configuration};
use crate::geometry::aperture::Aperture;
use crate::geometry::edge_index::EdgeIndex;

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
    let inside = InsideWalls {
        aperture,
        walls,
        tolerance_mm,
    };
    // Where pushing does not help the curve is cut; the pieces have new ends, so they are pushed
    // again. Each round removes at least one span, and few rounds ever happen.
    let mut curves = Vec::new();
    let mut open = vec![control];
    while let Some(raw) = open.pop() {
        let mut control = raw.clone();
        let bad = if !inside.push(&mut control) {
            // In a tight swing pushes that do not know of each other can go astray.
            control.clone_from(&raw);
            inside.project(&mut control)
        } else if !walls.contains(configuration(control[0]).center) {
            inside.cutting_spans(&control)
        } else {
            Vec::new()
        };
        if bad.contains(&true) {
            open.extend(pieces_without(&raw, &bad));
        } else {
            curves.push(control);
        }
    }
    curves.reverse();
    curves
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::clearance::{Configuration, contact};
    use crate::geometry::test_shapes::{ELLIPSE as APERTURE, walls};
    use crate::geometry::{Point2, Vector2};
    use crate::plan::heading_profile::slide_inside;
    use crate::plan::plane_curve::curve_at;
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
        let inside = InsideWalls {
            aperture: &APERTURE,
            walls: &walls,
            tolerance_mm: 4e-4,
        };
        let is_settled = inside.push(&mut control);
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
