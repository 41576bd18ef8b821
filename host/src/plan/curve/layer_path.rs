//! From placements to the printed curve: a uniform cubic B-spline in (x, y, heading) that keeps
//! every pose inside the region.
//!
//! The placements are the control polygon, sharpened by one step of the interpolation inverse (P - second difference
//! / 6) where they are smooth, so that the curve passes through them to fourth order; corners stay rounded by the
//! spline itself. Then the curve is pushed inside the walls ([`crate::plan::curve::pushing_inside`]), led around
//! where that fails ([`crate::plan::curve::detours`]), and cut where there is no detour.
//!
//! In: an opened pass (mm, rad), the walls, the tolerance (mm). Out: control points of one curve or
//! several. The sharpening: see C. de Boor, "A Practical Guide to Splines" (1978).

use crate::geometry::aperture::Aperture;
use crate::geometry::plane_curve::PlaneControl;
use crate::plan::beads::passes::CORNER_RAD;
use crate::plan::curve::detours::detoured;
use crate::plan::curve::pushing_inside::{InsideWalls, bad_runs, strayed_spans};
use crate::plan::pass::LayerPass;
use crate::settings::Settings;

/// Placements closer than this, of the aperture's unit, and turned by less than `MERGE_RAD` are one.
const MERGE: f64 = 0.012;
/// See `MERGE`.
const MERGE_RAD: f64 = 0.02;

/// Least spans of a curve that is kept after a cut.
const SPANS_MIN: usize = 2;

/// Share of the outside tolerance that the path may use; the rest is the fit's.
const PATH_SHARE: f64 = 0.4;

/// Largest depth to which a pose of a curve may cut, mm.
pub fn path_tolerance_mm(settings: &Settings) -> f64 {
    PATH_SHARE * settings.tolerances.outside_mm
}

/// The printed curves of an opened pass, in order: one, or several if the aperture does not fit in
/// between.
pub fn pass_curves(pass: &LayerPass, inside: &InsideWalls) -> Vec<Vec<PlaneControl>> {
    if pass.placements.is_empty() {
        return Vec::new();
    }
    let control = sharpened(&merged(pass, inside.aperture).0);
    let mut curves = Vec::new();
    let mut open = Vec::new();
    match led(control, inside) {
        Ok(whole) => curves.push(whole),
        Err((control, bad)) => open = pieces_without(&control, &bad),
    }
    // The first piece is the last of `open`. They have new ends, so they are pushed again. Each round
    // removes at least one span, and few rounds ever happen.
    while let Some(piece) = open.pop() {
        match pushed_inside(&piece, inside).or_else(NotInside::makeshift) {
            Ok(curve) => curves.push(curve),
            Err(bad) => open.extend(pieces_without(&piece, &bad)),
        }
    }
    curves
}

/// One undivided curve inside the walls, pushed and led around like that of a pass; `None` if it would have to be
/// cut.
pub fn whole_inside(control: &[PlaneControl], inside: &InsideWalls) -> Option<Vec<PlaneControl>> {
    led(control.to_vec(), inside).ok()
}

/// What pushing left of a curve.
struct NotInside {
    /// Spans that stay outside or are moved off their path.
    bad: Vec<bool>,
    /// The curve inside the walls, but somewhat off its path.
    makeshift: Option<Vec<PlaneControl>>,
}

impl NotInside {
    /// Nothing but where it is bad.
    fn cut(bad: Vec<bool>) -> NotInside {
        NotInside {
            bad,
            makeshift: None,
        }
    }

    /// Off its path rather than cut.
    fn makeshift(self) -> Result<Vec<PlaneControl>, Vec<bool>> {
        self.makeshift.ok_or(self.bad)
    }
}

/// The curve inside the walls, led around where pushing does not help; or where it is to be cut.
fn led(
    raw: Vec<PlaneControl>,
    inside: &InsideWalls,
) -> Result<Vec<PlaneControl>, (Vec<PlaneControl>, Vec<bool>)> {
    let left = match pushed_inside(&raw, inside) {
        Ok(control) => return Ok(control),
        Err(left) => left,
    };
    let Some(around) = detoured(&raw, &left.bad, inside) else {
        return left.makeshift().map_err(|bad| (raw, bad));
    };
    match (pushed_inside(&around, inside), left.makeshift) {
        (Ok(control), _) | (Err(_), Some(control)) => Ok(control),
        (Err(left), None) => left.makeshift().map_err(|bad| (around, bad)),
    }
}

/// The curve pushed inside.
fn pushed_inside(
    raw: &[PlaneControl],
    inside: &InsideWalls,
) -> Result<Vec<PlaneControl>, NotInside> {
    let mut control = raw.to_vec();
    let cutting = inside.project(&mut control);
    let strayed_by = |far_mm| strayed_spans(raw, &control, far_mm);
    let strayed = strayed_by(inside.near_mm());
    match (cutting.contains(&true), strayed.contains(&true)) {
        (false, false) => Ok(control),
        (true, _) => Err(NotInside::cut(cutting)),
        (false, true) => {
            let is_near = !strayed_by(inside.far_mm()).contains(&true);
            Err(NotInside {
                bad: strayed,
                makeshift: is_near.then_some(control),
            })
        }
    }
}

/// The runs of control points between bad spans, without short ones, the last first.
fn pieces_without(control: &[PlaneControl], bad: &[bool]) -> Vec<Vec<PlaneControl>> {
    let mut pieces = Vec::new();
    let mut first = 0;
    let after_the_last = bad.len()..control.len();
    for run in bad_runs(bad).into_iter().chain([after_the_last]) {
        if run.start + 1 > first + SPANS_MIN {
            pieces.push(control[first..=run.start].to_vec());
        }
        first = run.end;
    }
    pieces.reverse();
    pieces
}

/// Placements as control points, near-duplicates merged, and the number of the placement that each
/// one is.
pub fn merged(pass: &LayerPass, aperture: &Aperture) -> (Vec<PlaneControl>, Vec<usize>) {
    let merge_mm = MERGE * aperture.unit_mm();
    let mut control: Vec<PlaneControl> = Vec::with_capacity(pass.placements.len() + 1);
    let mut numbers = Vec::with_capacity(pass.placements.len() + 1);
    for (number, p) in pass.placements.iter().enumerate() {
        let next = [p.at.center.x, p.at.center.y, p.at.heading_rad];
        let near = control.last().is_some_and(|l| {
            (l[0] - next[0]).hypot(l[1] - next[1]) < merge_mm && (l[2] - next[2]).abs() < MERGE_RAD
        });
        if !near {
            control.push(next);
            numbers.push(number);
        }
    }
    if control.len() == 1 {
        control.push(control[0]);
        numbers.push(numbers[0]);
    }
    (control, numbers)
}

/// True if the second difference of a control polygon is its curve's curvature and not a corner: over the step it is
/// the turn, rad; `step_mm` is the distance to the next control point.
pub fn is_smooth(second: &PlaneControl, step_mm: f64) -> bool {
    second[0].hypot(second[1]) < CORNER_RAD * step_mm
}

/// The control polygon of a curve that runs through these points where they are smooth.
pub fn sharpened(raw: &[PlaneControl]) -> Vec<PlaneControl> {
    let mut control = raw.to_vec();
    for i in 1..raw.len().saturating_sub(1) {
        let step = (raw[i + 1][0] - raw[i - 1][0]).hypot(raw[i + 1][1] - raw[i - 1][1]) / 2.0;
        let second: [f64; 3] =
            std::array::from_fn(|c| raw[i - 1][c] - 2.0 * raw[i][c] + raw[i + 1][c]);
        if is_smooth(&second, step) {
            control[i] = std::array::from_fn(|c| raw[i][c] - second[c] / 6.0);
        }
    }
    control
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::clearance::{Configuration, contact};
    use crate::geometry::plane_curve::{configuration, curve_at};
    use crate::geometry::test_shapes::{ELLIPSE as APERTURE, walls};
    use crate::geometry::{Point2, Vector2};
    use crate::plan::headings::profile::slide_inside;
    use crate::plan::pass::test_passes::pass;

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
            let curves = pass_curves(&pass, &InsideWalls::flat(&APERTURE, &walls, 4e-4));
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
        let curves = pass_curves(&pass, &InsideWalls::flat(&APERTURE, &walls, 4e-4));
        assert_eq!(curves.len(), 1);
        for span in 0..curves[0].len() - 1 {
            for step in 0..20 {
                let at = configuration(curve_at(&curves[0], span, f64::from(step) / 20.0));
                let reach = APERTURE.extent_mm(at.heading_rad, Vector2::y()) + at.center.y.abs();
                assert!(reach < 0.501, "{at:?}");
            }
        }
    }

    /// Goal: where a tip stands on one side of a corner and in the next placement on its other side, the
    /// nozzle gets around it and the rest of the curve stays where it was (a find in the part "truss 1":
    /// one pose after the other was taken back until all of a strut's bead lay in the strut before it).
    /// Method: the corner of that part, from a wide strut into one 0.806 mm wide.
    #[test]
    fn a_tip_on_the_other_side_of_a_corner_gets_around_it() {
        let walls = walls(&[&[
            [-0.806, -5.0],
            [0.0, -5.0],
            [0.0, 0.0],
            [5.0, 0.0],
            [5.0, 1.43],
            [-0.374, 1.43],
            [-0.403, 0.725],
            [-0.806, 0.725],
        ]]);
        let ahead = (0..40).map(|i| [2.7 - 0.07 * f64::from(i), 0.43, 5.87]);
        let around = [
            [-0.100, 0.429, 5.869],
            [-0.152, 0.418, 5.861],
            [-0.223, 0.401, 5.819],
            [-0.301, 0.366, 5.727],
            [-0.380, 0.313, 5.585],
            [-0.454, 0.248, 5.414],
            [-0.517, 0.179, 5.249],
            [-0.564, 0.113, 5.118],
            [-0.580, 0.050, 5.000],
        ];
        let beyond = (0..40).map(|i| [-0.58, -0.02 - 0.07 * f64::from(i), 4.9]);
        let raw: Vec<PlaneControl> = ahead.chain(around).chain(beyond).collect();
        let inside = InsideWalls::flat(&APERTURE, &walls, 4e-4);
        let places = raw.iter().map(|at| (Point2::new(at[0], at[1]), at[2]));
        let curves = pass_curves(
            &pass(places, false),
            &InsideWalls::flat(&APERTURE, &walls, 4e-4),
        );
        assert_eq!(curves.len(), 1);
        assert!(!inside.cutting_spans(&curves[0]).contains(&true));
        // Poses of either strut that are clear of the corner stay.
        for at in raw[..36].iter().chain(&raw[raw.len() - 36..]) {
            let off_mm = curves[0].iter().map(|q| (q[0] - at[0]).hypot(q[1] - at[1]));
            let off_mm = off_mm.fold(f64::INFINITY, f64::min);
            assert!(off_mm < 0.036, "{off_mm} mm at {at:?}");
        }
    }

    /// Goal: a curve that fits nowhere near its way is cut, not taken elsewhere. Method: a bead that
    /// runs through a passage too narrow for the nozzle, between two wide rooms.
    #[test]
    fn what_fits_nowhere_near_is_cut() {
        let walls = walls(&[&[
            [-4.0, -1.0],
            [-0.5, -1.0],
            [-0.5, -0.15],
            [0.5, -0.15],
            [0.5, -1.0],
            [4.0, -1.0],
            [4.0, 1.0],
            [0.5, 1.0],
            [0.5, 0.15],
            [-0.5, 0.15],
            [-0.5, 1.0],
            [-4.0, 1.0],
        ]]);
        let places = (-40..=40).map(|i| (Point2::new(0.07 * f64::from(i), 0.0), 1.2));
        let curves = pass_curves(
            &pass(places, false),
            &InsideWalls::flat(&APERTURE, &walls, 4e-4),
        );
        assert_eq!(curves.len(), 2);
        // In the order of the way.
        assert!(curves[0][0][0] < -2.0 && curves[1][0][0] > 0.0);
        for at in curves.iter().flatten() {
            assert!(at[1].abs() < 0.5, "{at:?}");
        }
    }

    /// Goal: a swing around a corner in which moves without turns go astray keeps its curve whole. Method: an
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
        let curves = pass_curves(&pass, &InsideWalls::flat(&APERTURE, &walls, 4e-4));
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
