//! F(p) for tool axes: those at which a head with its tip at p is clear of everything, and the nearest
//! of them.
//!
//! Each obstacle point excludes one cap of the sphere of axes (its direction from the tip, the head's half angle at
//! its distance); F is the rest of some cones about given axes. The axis of F nearest to a desired axis is that axis,
//! its foot on a circle that bounds a cap or a cone, or an intersection of two circles. Caps are added as they are
//! found: the best candidate outside the known ones is tried, the point deepest inside the head adds its cap, and so
//! on, until no point is inside, or no candidate remains. The result is exact for all points: no other cap excludes
//! it, and every nearer axis is excluded by a known one.

use crate::standing::Standing;
use crate::touch::{Head, Touch};
use crate::{Pose, Vector3};

/// Caps of a search: more are given up.
const CAPS_MAX: usize = 96;
/// Touches of a place among which the deepest is searched: a search finds the others in its next round.
const TOUCHES_LOOKED: usize = 64;
/// By how much caps are larger than they must be, rad: rounding of a candidate on a circle.
const ROUNDING_RAD: f64 = 1e-7;
/// Rounding of a candidate's place.
const SURE_RAD: f64 = 1e-8;

/// A cone or a cap of axes: all that differ from `axis` by at most `angle_rad`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cap {
    /// Its middle, unit.
    pub axis: Vector3,
    /// Its half angle.
    pub angle_rad: f64,
}

/// A tip position, and the number of points that exist then.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// The tip, mm.
    pub tip_mm: Vector3,
    /// Number of existing points.
    pub before: usize,
}

/// The axis nearest to `wish` that is in all of `within` and clear at all of the places; `None` if there is none, or
/// after `CAPS_MAX` caps.
pub fn nearest_free(
    head: &Head,
    standing: &Standing,
    places: &[Place],
    wish: Vector3,
    within: &[Cap],
) -> Option<Vector3> {
    let mut caps: Vec<Cap> = Vec::new();
    loop {
        let axis = best_candidate(wish, &caps, within)?;
        let Some(cap) = worst(head, standing, places, axis) else {
            return Some(axis);
        };
        if caps.len() == CAPS_MAX {
            return None;
        }
        caps.push(cap);
    }
}

/// The cap that one point excludes for a tip, if any.
fn cap_of(head: &Head, tip_mm: &Vector3, place_mm: &Vector3) -> Option<Cap> {
    let away = place_mm - tip_mm;
    let distance_mm = away.norm();
    let angle_rad = head.profile.half_angle_rad(distance_mm, head.slack_mm);
    (angle_rad > 0.0).then(|| Cap {
        axis: away / distance_mm,
        angle_rad,
    })
}

/// The cap of the touch that is deepest as seen from its tip, over all places.
fn worst(head: &Head, standing: &Standing, places: &[Place], axis: Vector3) -> Option<Cap> {
    let mut deepest: Option<(f64, Vector3, Touch)> = None;
    for at in places {
        let pose = Pose {
            tip_mm: at.tip_mm,
            axis,
        };
        head.first_touches(standing, &pose, at.before, TOUCHES_LOOKED, |touch| {
            // About by how much the axis has to turn.
            let inside = touch.depth_mm / (touch.at_mm - at.tip_mm).norm().max(f64::MIN_POSITIVE);
            if deepest.as_ref().is_none_or(|(most, ..)| inside > *most) {
                deepest = Some((inside, at.tip_mm, touch));
            }
        });
    }
    let (_, tip_mm, touch) = deepest?;
    let mut cap = cap_of(head, &tip_mm, &touch.at_mm)?;
    cap.angle_rad += ROUNDING_RAD;
    Some(cap)
}

/// The axis nearest to the desired one outside of all caps and inside of all cones; `None` if there is
/// no such axis.
fn best_candidate(wish: Vector3, caps: &[Cap], within: &[Cap]) -> Option<Vector3> {
    // By the squares of chords: exact for small angles too.
    let outside: Vec<f64> = caps
        .iter()
        .map(|cap| chord2(cap.angle_rad - SURE_RAD))
        .collect();
    let inside: Vec<f64> = within
        .iter()
        .map(|cone| chord2(cone.angle_rad + SURE_RAD))
        .collect();
    let is_free = |axis: &Vector3| {
        let square = |cap: &Cap| (cap.axis - axis).norm_squared();
        within
            .iter()
            .zip(&inside)
            .all(|(cone, most)| square(cone) <= *most)
            && caps
                .iter()
                .zip(&outside)
                .all(|(cap, least)| square(cap) >= *least)
    };
    if is_free(&wish) {
        return Some(wish);
    }
    let circles: Vec<&Cap> = caps.iter().chain(within).collect();
    let mut best: Option<(f64, Vector3)> = None;
    let mut consider = |axis: Vector3| {
        let near = axis.dot(&wish);
        if best.as_ref().is_none_or(|(most, _)| near > *most) && is_free(&axis) {
            best = Some((near, axis));
        }
    };
    for (index, circle) in circles.iter().enumerate() {
        consider(foot(circle, &wish));
        for other in &circles[..index] {
            for axis in crossings(circle, other).into_iter().flatten() {
                consider(axis);
            }
        }
    }
    best.map(|(_, axis)| axis)
}

/// The square of the chord of an angle, which is clamped to the possible range.
fn chord2(angle_rad: f64) -> f64 {
    let half = 2.0 * (0.5 * angle_rad.clamp(0.0, std::f64::consts::PI)).sin();
    half * half
}

/// The place on a cap's circle nearest to an axis.
fn foot(cap: &Cap, axis: &Vector3) -> Vector3 {
    let aside = axis - cap.axis * cap.axis.dot(axis);
    let aside = aside.try_normalize(1e-12).unwrap_or_else(|| {
        // All are as near: one of them.
        let least = cap.axis.iamin();
        let unit = Vector3::ith(least, 1.0);
        (unit - cap.axis * cap.axis[least]).normalize()
    });
    cap.axis * cap.angle_rad.cos() + aside * cap.angle_rad.sin()
}

/// Where two circles on the sphere cut.
fn crossings(a: &Cap, b: &Cap) -> [Option<Vector3>; 2] {
    let (cos_a, cos_b, cos_ab) = (a.angle_rad.cos(), b.angle_rad.cos(), a.axis.dot(&b.axis));
    let determinant = 1.0 - cos_ab * cos_ab;
    if determinant < 1e-14 {
        return [None; 2];
    }
    let middle = a.axis * ((cos_a - cos_ab * cos_b) / determinant)
        + b.axis * ((cos_b - cos_ab * cos_a) / determinant);
    let out_square = 1.0 - middle.norm_squared();
    if out_square < 0.0 {
        return [None; 2];
    }
    let out = a.axis.cross(&b.axis) * (out_square / determinant).sqrt();
    [middle + out, middle - out].map(|axis| axis.try_normalize(0.5))
}
