//! Where loops begin and end: at the nearest point, aligned along a direction, or in their sharpest
//! corner.
//!
//! A chosen seam is fixed before the order: the loop is opened there, and the order may only choose
//! the direction. Loops without a corner begin at the nearest point.
//!
//! In: a closed pass (mm, rad), the requested seam. Out: the pass opened there. Not covered: the
//! effect on the order.

use crate::geometry::Vector2;
use crate::geometry::aperture::Aperture;
use crate::plan::beads::passes::CORNER_RAD;
use crate::plan::joining::order::{opened, rotated};
use crate::plan::pass::LayerPass;
use crate::settings::{Seam, SeamPlace};

/// Length of wall to each side of a placement over which its turn is measured, against b: a
/// corner's smoothed normals and its fan are within it.
const WINDOW_SHARE: f64 = 1.5;

/// Turns that differ by less are equal: 5 µm of noise on windows of 0.3 mm, and twice as much between corners, rad.
const EQUAL_RAD: f64 = 0.1;

/// The pass opened at its seam; unchanged if the order chooses the seam, or if the pass is open.
pub fn with_seam(pass: LayerPass, seam: &Seam, aperture: &Aperture) -> LayerPass {
    if !pass.closed {
        return pass;
    }
    let place = match seam.place {
        SeamPlace::Nearest => None,
        SeamPlace::Aligned => farthest(&pass, seam.direction_rad),
        SeamPlace::Sharpest => {
            let window_mm = WINDOW_SHARE * aperture.minor_mm();
            sharpest(&pass, window_mm, seam.direction_rad)
        }
    };
    match place {
        Some(start) => opened(rotated(pass, start, aperture.period_rad()), aperture),
        None => pass,
    }
}

/// The placement whose contact is farthest along a direction.
fn farthest(pass: &LayerPass, direction_rad: f64) -> Option<usize> {
    farthest_of(pass, direction_rad, |_| true)
}

/// The same of some.
fn farthest_of(
    pass: &LayerPass,
    direction_rad: f64,
    is_one: impl Fn(&usize) -> bool,
) -> Option<usize> {
    let direction = Vector2::new(direction_rad.cos(), direction_rad.sin());
    let along_mm = |i: &usize| pass.placements[*i].contact.point.coords.dot(&direction);
    // The first of several at an equal distance.
    let some = (0..pass.placements.len()).filter(is_one);
    some.min_by(|i, j| along_mm(j).total_cmp(&along_mm(i)))
}

/// The placement about which the wall turns most, of several equal corners in the one farthest along a direction; `None` if
/// it does not turn.
fn sharpest(pass: &LayerPass, window_mm: f64, direction_rad: f64) -> Option<usize> {
    let count = pass.placements.len();
    let turns: Vec<f64> = (0..count).map(|i| turn_rad(pass, i, window_mm)).collect();
    let most_rad = turns.iter().copied().fold(0.0, f64::max);
    if most_rad < CORNER_RAD {
        return None;
    }
    let is_equal = |i: &usize| turns[*i] > most_rad - EQUAL_RAD;
    let corner = farthest_of(pass, direction_rad, is_equal)?;
    let place = |i: usize| pass.placements[i].contact.point;
    let is_of_corner = |i: &usize| (place(*i) - place(corner)).norm() <= window_mm;
    let of_corner = (0..count).filter(|i| is_equal(i) && is_of_corner(i));
    let most = of_corner.min_by(|&i, &j| turns[j].total_cmp(&turns[i]))?;
    // Windows that hold the whole corner agree but for rounding: the middle one of them.
    let top = |i: usize| turns[i % turns.len()] > turns[most] - 1e-3;
    let run = (1..turns.len()).take_while(|&k| top(most + k)).count();
    Some((most + run / 2) % turns.len())
}

/// How far the wall turns between `window_mm` before and after placement `i`.
fn turn_rad(pass: &LayerPass, i: usize, window_mm: f64) -> f64 {
    let count = pass.placements.len();
    let contact = |k: usize| &pass.placements[k % count].contact;
    let reach = |step: &dyn Fn(usize) -> usize| {
        let mut walked_mm = 0.0;
        let mut at = i;
        for k in 1..count {
            let next = step(k);
            walked_mm += 0.5 * (contact(at).length_mm + contact(next).length_mm);
            if walked_mm > window_mm {
                break;
            }
            at = next;
        }
        contact(at).normal
    };
    let (before, after) = (reach(&|k| i + count - k), reach(&|k| i + k));
    before.perp(&after).atan2(before.dot(&after)).abs()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Point2;
    use crate::geometry::frame::Frame;
    use crate::geometry::test_shapes::{ELLIPSE, ring, walls};
    use crate::plan::beads::passes::Lengths;
    use crate::plan::headings::contacts::wall_contacts;
    use crate::plan::headings::profile::{TURN_WEIGHT_MM4, profile};
    use crate::plan::pass::PassKind;

    fn wall_loop(points: &[[f64; 2]]) -> LayerPass {
        let mut contacts = wall_contacts(&ring(points), Lengths::of(&ELLIPSE).spacing());
        for contact in &mut contacts {
            contact.extent_mm = 0.5;
        }
        let walls = walls(&[points]);
        LayerPass {
            kind: PassKind::TwoPass,
            channel: 1,
            closed: true,
            placements: profile(&contacts, true, TURN_WEIGHT_MM4, &ELLIPSE, &walls),
            then: Vec::new(),
        }
    }

    fn start_of(pass: LayerPass, place: SeamPlace, direction_deg: f64) -> Option<Point2> {
        let seam = Seam {
            place,
            direction_rad: direction_deg.to_radians(),
        };
        let placed = with_seam(pass, &seam, &ELLIPSE);
        (!placed.closed).then(|| placed.placements[0].contact.point)
    }

    /// Goal: seams lie in the sharpest corner, or farthest along the direction; a circle has no
    /// corner. Method: a kite with one corner of about 53°, an L with a reflex corner of 90°, whose
    /// other corners are cut off at 45°; positions by hand.
    #[test]
    fn seams_lie_where_they_are_asked_for() {
        let kite = wall_loop(&[[0.0, 0.0], [8.0, -4.0], [11.0, 0.0], [8.0, 4.0]]);
        let at = start_of(kite.clone(), SeamPlace::Sharpest, 0.0).expect("a corner");
        assert!((at - Point2::origin()).norm() < 0.4, "{at}");
        let at = start_of(kite.clone(), SeamPlace::Aligned, 0.0).expect("a place");
        assert!((at - Point2::new(11.0, 0.0)).norm() < 0.2, "{at}");
        let at = start_of(kite.clone(), SeamPlace::Aligned, 90.0).expect("a place");
        assert!((at - Point2::new(8.0, 4.0)).norm() < 0.2, "{at}");
        assert_eq!(start_of(kite, SeamPlace::Nearest, 0.0), None);
        let l = wall_loop(&[
            [1.0, 0.0],
            [9.0, 0.0],
            [10.0, 1.0],
            [10.0, 3.0],
            [9.0, 4.0],
            [4.0, 4.0],
            [4.0, 9.0],
            [3.0, 10.0],
            [1.0, 10.0],
            [0.0, 9.0],
            [0.0, 1.0],
        ]);
        let at = start_of(l, SeamPlace::Sharpest, 0.0).expect("a corner");
        assert!((at - Point2::new(4.0, 4.0)).norm() < 0.2, "{at}");
        let circle: Vec<[f64; 2]> = (0..90)
            .map(|i| (f64::from(i) * std::f64::consts::TAU / 90.0).sin_cos())
            .map(|(sin, cos)| [6.0 * cos, 6.0 * sin])
            .collect();
        assert_eq!(start_of(wall_loop(&circle), SeamPlace::Sharpest, 0.0), None);
    }

    /// Goal: seams of neighbouring layers lie in the same corner of a square, although its sides and corners are equal but
    /// for noise. Method: 30 layers with the corners moved by up to 0.1 µm and 2 µm, in all frames of a region.
    #[test]
    fn seams_do_not_jump_between_equal_corners() {
        let mut state = 1u32;
        let mut noise = |most_mm: f64| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            most_mm * (f64::from(state >> 8) / f64::from(1 << 23) - 1.0)
        };
        for place in [SeamPlace::Aligned, SeamPlace::Sharpest] {
            for most_mm in [1e-4, 2e-3] {
                let mut first: Option<Point2> = None;
                for layer in 0..30 {
                    let corners = [[-9.5, -9.5], [9.5, -9.5], [9.5, 9.5], [-9.5, 9.5]];
                    let corners = corners.map(|corner| corner.map(|mm| mm + noise(most_mm)));
                    let frame = Frame {
                        turn_rad: f64::from(layer % 4) * std::f64::consts::FRAC_PI_2,
                        is_mirrored: layer % 8 > 3,
                        ..Frame::IDENTITY
                    };
                    let mut points = corners.map(|[x, y]| frame.point_in(Point2::new(x, y)));
                    if frame.is_mirrored {
                        points.reverse();
                    }
                    let seam = Seam {
                        place,
                        direction_rad: std::f64::consts::FRAC_PI_2,
                    };
                    let seam = Seam {
                        direction_rad: frame.angle_in(seam.untied_rad()),
                        ..seam
                    };
                    let pass = with_seam(wall_loop(&points.map(<[f64; 2]>::from)), &seam, &ELLIPSE);
                    let at = frame.point_out(pass.placements[0].contact.point);
                    // Contacts stand 0.2 mm apart at corners.
                    let off_mm = (at - *first.get_or_insert(at)).norm();
                    assert!(off_mm < 0.5, "{place:?} {most_mm}: {at} in layer {layer}");
                }
            }
        }
    }

    /// Goal: opening a loop keeps its headings continuous. Method: steps over the new start.
    #[test]
    fn headings_go_on_over_the_seam() {
        let seam = Seam {
            place: SeamPlace::Aligned,
            direction_rad: 0.0,
        };
        let kite = wall_loop(&[[0.0, 0.0], [8.0, -4.0], [11.0, 0.0], [8.0, 4.0]]);
        let placed = with_seam(kite, &seam, &ELLIPSE);
        for pair in placed.placements.windows(2) {
            let turn_rad = pair[1].at.heading_rad - pair[0].at.heading_rad;
            assert!(turn_rad.abs() < 1.5, "{turn_rad}");
        }
    }
}
