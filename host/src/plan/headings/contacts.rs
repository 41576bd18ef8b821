//! Contact samples: where the aperture is to touch the wall of its bead channel, and the bead's
//! width there.
//!
//! Normals are smoothed over a length proportional to the aperture, so that noise and the facets of
//! a curve do not shake the heading; real corners stay: a convex one keeps its two normals, a
//! reflex one gets a fan of normals around which the aperture swings with its contact on the
//! corner.
//!
//! In: a closed ring (mm), inside on its left, spacing and smoothing (mm). Out: contacts with
//! position (mm), unit normal and length of wall (mm). Not covered: the desired width, which the
//! channel gives.

use crate::geometry::polygon::Ring;
use crate::geometry::{Point2, Vector2};
use crate::plan::pass::Contact;

/// Spacing and smoothing of contact samples, all lengths tied to the aperture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactSpacing {
    /// Distance between samples, mm; at most half as much again on short edges.
    pub spacing_mm: f64,
    /// Half-window over which normals are averaged, mm.
    pub smoothing_mm: f64,
    /// Vertices that turn more than this are corners, rad.
    pub corner_rad: f64,
    /// Step of the normal in a reflex fan, rad.
    pub fan_rad: f64,
}

/// Contacts along one wall ring, in ring order (inside on the left). `extent_mm` is 0.
pub fn wall_contacts(ring: &Ring, spacing: ContactSpacing) -> Vec<Contact> {
    let points = &ring.points;
    let count = points.len();
    let mut contacts = Vec::new();
    let mut breaks = Vec::new();
    for i in 0..count {
        let (a, b) = (points[i], points[(i + 1) % count]);
        let after = points[(i + 2) % count];
        let delta = b - a;
        let length = delta.norm();
        if length < 1e-9 {
            continue;
        }
        let normal = Vector2::new(-delta.y, delta.x) / length;
        let pieces = whole_pieces(length, spacing.spacing_mm);
        for piece in 0..pieces {
            contacts.push(Contact {
                point: a + delta * ((piece as f64 + 0.5) / pieces as f64),
                normal,
                length_mm: length / pieces as f64,
                extent_mm: 0.0,
                on_axis: false,
            });
            breaks.push(false);
        }
        let turn = turn_rad(delta, after - b);
        if turn.abs() > spacing.corner_rad && is_corner(points, (i + 1) % count, turn, spacing) {
            if let Some(last) = breaks.last_mut() {
                *last = true;
            }
            if turn < 0.0 {
                push_fan(&mut contacts, &mut breaks, b, normal, turn, spacing.fan_rad);
            }
        }
    }
    thin_out(&mut contacts, &mut breaks, spacing.spacing_mm);
    smooth_normals(&mut contacts, &breaks, spacing.smoothing_mm);
    contacts
}

/// The number of parts of about `piece_mm` into which a length is divided, at least one. Lengths of
/// round dimensions are often halfway between two counts, where rounding must not decide.
pub fn whole_pieces(length_mm: f64, piece_mm: f64) -> usize {
    (length_mm / piece_mm - 1e-6).round().max(1.0) as usize
}

/// Share of the spacing below which samples are taken together.
const FINE_SHARE: f64 = 0.25;

/// True where the wall as a whole turns at vertex `at` by more than half as much as a corner does,
/// the same way: noise turns back and forth.
fn is_corner(points: &[Point2], at: usize, turn: f64, spacing: ContactSpacing) -> bool {
    let count = points.len();
    let window_mm = spacing.smoothing_mm;
    let beyond = |step: usize| {
        let mut far = at;
        for _ in 0..count {
            far = (far + step) % count;
            if (points[far] - points[at]).norm() > window_mm {
                break;
            }
        }
        points[far]
    };
    let (before, after) = (beyond(count - 1), beyond(1));
    let whole = turn_rad(points[at] - before, after - points[at]);
    whole * turn.signum() > 0.5 * spacing.corner_rad
}

/// Takes runs of samples on edges far below the spacing together, where the wall comes furthest in:
/// there the aperture can touch it.
fn thin_out(contacts: &mut Vec<Contact>, breaks: &mut Vec<bool>, spacing_mm: f64) {
    let fine = |c: &Contact| c.length_mm > 0.0 && c.length_mm < FINE_SHARE * spacing_mm;
    let (mut thin, mut ends) = (Vec::new(), Vec::new());
    let mut at = 0;
    while at < contacts.len() {
        let from = at;
        let mut sum = contacts[at].normal * contacts[at].length_mm;
        while fine(&contacts[from])
            && !breaks[at]
            && contacts.get(at + 1).is_some_and(fine)
            // Each normal by its length is its edge turned: their sum is as long as the chord.
            && sum.norm() < spacing_mm
        {
            at += 1;
            sum += contacts[at].normal * contacts[at].length_mm;
        }
        let mut contact = contacts[from];
        if at > from && sum.norm() > 1e-12 {
            contact.normal = sum.normalize();
            contact.length_mm = sum.norm();
            let inward = |c: &Contact| c.point.coords.dot(&contact.normal);
            let deepest = contacts[from..=at]
                .iter()
                .max_by(|c, d| inward(c).total_cmp(&inward(d)));
            contact.point = deepest.map_or(contact.point, |c| c.point);
        }
        thin.push(contact);
        ends.push(breaks[at]);
        at += 1;
    }
    (*contacts, *breaks) = (thin, ends);
}

/// Signed turn from one edge to the next; negative is reflex for a region on the left.
fn turn_rad(from: Vector2, to: Vector2) -> f64 {
    from.perp(&to).atan2(from.dot(&to))
}

/// The normals between the two edges of a reflex vertex, without ends.
fn push_fan(
    contacts: &mut Vec<Contact>,
    breaks: &mut Vec<bool>,
    at: Point2,
    normal: Vector2,
    turn_rad: f64,
    step_rad: f64,
) {
    let steps = (turn_rad.abs() / step_rad).ceil().max(2.0) as usize;
    for step in 0..=steps {
        let rotation = nalgebra::Rotation2::new(turn_rad * step as f64 / steps as f64);
        contacts.push(Contact {
            point: at,
            normal: rotation * normal,
            length_mm: 0.0,
            extent_mm: 0.0,
            on_axis: false,
        });
        breaks.push(true);
    }
}

/// Replaces each normal by the length-weighted mean within the window, never across a break
/// (`breaks[i]`: a corner is between i and i + 1).
fn smooth_normals(contacts: &mut [Contact], breaks: &[bool], window_mm: f64) {
    let count = contacts.len();
    if count < 3 {
        return;
    }
    let raw: Vec<Contact> = contacts.to_vec();
    for i in 0..count {
        if raw[i].length_mm == 0.0 {
            continue;
        }
        let mut sum = raw[i].normal * raw[i].length_mm;
        let mut forward = 0.0;
        let mut at = i;
        for _ in 0..count {
            let next = (at + 1) % count;
            forward += 0.5 * (raw[at].length_mm + raw[next].length_mm);
            if breaks[at] || forward > window_mm {
                break;
            }
            sum += raw[next].normal * raw[next].length_mm;
            at = next;
        }
        let mut backward = 0.0;
        at = i;
        for _ in 0..count {
            let previous = (at + count - 1) % count;
            backward += 0.5 * (raw[at].length_mm + raw[previous].length_mm);
            if breaks[previous] || backward > window_mm {
                break;
            }
            sum += raw[previous].normal * raw[previous].length_mm;
            at = previous;
        }
        if sum.norm() > 1e-12 {
            contacts[i].normal = sum.normalize();
        }
    }
}

/// A ring resampled at equal steps of about `step_mm` and smoothed by `rounds` of [1 2 1] / 4.
pub fn resampled(ring: &Ring, step_mm: f64, rounds: usize) -> Ring {
    let perimeter = ring.perimeter_mm();
    let count = whole_pieces(perimeter, step_mm).max(8);
    let step = perimeter / count as f64;
    let mut points = Vec::with_capacity(count);
    let mut walked = 0.0;
    for (a, b) in ring.edges() {
        let length = (b - a).norm();
        while points.len() < count && points.len() as f64 * step <= walked + length {
            let t = (points.len() as f64 * step - walked) / length.max(1e-12);
            points.push(a + (b - a) * t);
        }
        walked += length;
    }
    let n = points.len();
    for _ in 0..rounds {
        points = (0..n)
            .map(|i| {
                let (p, q, r) = (points[(i + n - 1) % n], points[i], points[(i + 1) % n]);
                Point2::from((p.coords + q.coords * 2.0 + r.coords) / 4.0)
            })
            .collect();
    }
    Ring { points }
}
