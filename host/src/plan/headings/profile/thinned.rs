//! Thins out contacts on straight walls before a profile is found, and fills in the placements
//! afterwards.
//!
//! Along a straight wall whose bead keeps its width, neighbouring contacts are redundant: few of
//! them are kept, farther apart the farther they are from the ends of the straight part. In:
//! contacts. Out: the numbers of those kept; placements of all contacts from placements of those,
//! each tangent to its own contact, headings by cubic Hermite interpolation with three-point
//! slopes. Runs on the axis and fans at corners stay as they are.

use crate::geometry::aperture::Aperture;
use crate::geometry::clearance::Configuration;
use crate::geometry::hermite::hermite;
use crate::plan::pass::{Contact, Placement};

/// Most that a wall may bend over a straight, as its normal, rad, and aside, against b.
const BEND_MAX_RAD: f64 = 1e-3;
const ASIDE_MAX_SHARE: f64 = 1e-2;
/// Most that the wanted extent may change over a straight, against b.
const CHANGE_MAX_SHARE: f64 = 1e-2;
/// Distance of kept contacts against that from the nearer end of their straight, and at most, against
/// the major semi-axis.
const GROWTH: f64 = 0.2;
const STEP_MAX_SHARE: f64 = 1.7;

/// The contacts that are kept, rising; the first and the last are.
pub fn kept(contacts: &[Contact], aperture: &Aperture) -> Vec<usize> {
    let mut kept = Vec::new();
    let mut from = 0;
    while from < contacts.len() {
        let to = straight_end(contacts, from, aperture);
        keep_of_straight(contacts, from..to + 1, aperture, &mut kept);
        from = to + 1;
    }
    kept
}

/// The last contact of the straight that begins at `from`.
fn straight_end(contacts: &[Contact], from: usize, aperture: &Aperture) -> usize {
    let first = &contacts[from];
    let b = aperture.minor_mm();
    let goes_on = |contact: &Contact| {
        let aside_mm = first.normal.dot(&(contact.point - first.point));
        contact.length_mm > 0.0
            && !contact.on_axis
            && first.normal.perp(&contact.normal).abs() < BEND_MAX_RAD
            && first.normal.dot(&contact.normal) > 0.0
            && aside_mm.abs() < ASIDE_MAX_SHARE * b
            && (contact.extent_mm - first.extent_mm).abs() < CHANGE_MAX_SHARE * b
    };
    if !goes_on(first) {
        return from;
    }
    let following = contacts[from + 1..].iter();
    from + following.take_while(|contact| goes_on(contact)).count()
}

/// Keeps contacts of a straight, both ends among them.
fn keep_of_straight(
    contacts: &[Contact],
    numbers: std::ops::Range<usize>,
    aperture: &Aperture,
    kept: &mut Vec<usize>,
) {
    let own = &contacts[numbers.clone()];
    let length_mm: f64 = own.iter().map(|contact| contact.length_mm).sum();
    let step_max_mm = STEP_MAX_SHARE * aperture.major_mm();
    let (mut along_mm, mut last_mm) = (0.0, f64::NEG_INFINITY);
    for (number, contact) in numbers.clone().zip(own) {
        let at_mm = along_mm + 0.5 * contact.length_mm;
        along_mm += contact.length_mm;
        let to_end_mm = at_mm.min(length_mm - at_mm);
        let step_mm = (GROWTH * to_end_mm).min(step_max_mm);
        let is_end = number == numbers.start || number + 1 == numbers.end;
        if is_end || at_mm - last_mm >= step_mm {
            kept.push(number);
            last_mm = at_mm;
        }
    }
}

/// The kept contacts, each representing the wall up to halfway to its neighbours.
pub fn standing_for_all(contacts: &[Contact], kept: &[usize]) -> Vec<Contact> {
    let mut sums_mm = vec![0.0];
    for contact in contacts {
        sums_mm.push(sums_mm[sums_mm.len() - 1] + contact.length_mm);
    }
    let middle_mm = |number: usize| 0.5 * (sums_mm[number] + sums_mm[number + 1]);
    // Of neighbours that were neighbours before the border is where it was.
    let border_mm = |p: usize, q: usize| match q - p {
        1 => sums_mm[q],
        _ => 0.5 * (middle_mm(p) + middle_mm(q)),
    };
    (0..kept.len())
        .map(|k| {
            let low_mm = if k == 0 {
                0.0
            } else {
                border_mm(kept[k - 1], kept[k])
            };
            let high_mm = match kept.get(k + 1) {
                Some(&next) => border_mm(kept[k], next),
                None => sums_mm[contacts.len()],
            };
            Contact {
                length_mm: high_mm - low_mm,
                ..contacts[kept[k]]
            }
        })
        .collect()
}

/// The placements of all contacts from those of the kept ones.
pub fn filled_in(
    contacts: &[Contact],
    kept: &[usize],
    found: &[Placement],
    aperture: &Aperture,
) -> Vec<Placement> {
    let mut all = Vec::with_capacity(contacts.len());
    for k in 0..kept.len() {
        all.push(Placement {
            contact: contacts[kept[k]],
            ..found[k]
        });
        let Some(&next) = kept.get(k + 1) else {
            break;
        };
        let feasible = found[k].feasible && found[k + 1].feasible;
        let way = Way::between(found, k);
        for contact in &contacts[kept[k] + 1..next] {
            let heading_rad = way.heading_rad(contact);
            all.push(Placement {
                at: Configuration {
                    center: aperture.center_on_wall(heading_rad, contact.point, contact.normal),
                    heading_rad,
                },
                feasible,
                contact: *contact,
            });
        }
    }
    all
}

/// The heading between two kept contacts of a straight.
struct Way<'a> {
    from: &'a Placement,
    to: &'a Placement,
    length_mm: f64,
    /// Slopes at either end, rad/mm.
    slopes: [f64; 2],
}

impl<'a> Way<'a> {
    fn between(found: &'a [Placement], k: usize) -> Way<'a> {
        let slope = |i: usize, j: usize| {
            let (p, q) = (&found[i], &found[j]);
            let way_mm = (q.contact.point - p.contact.point).norm();
            (q.at.heading_rad - p.at.heading_rad) / way_mm.max(1e-9)
        };
        let own = slope(k, k + 1);
        // After a straight part the heading changes: there the slope is this one's own.
        let beside = |i: usize, j: usize| {
            let is_straight = |p: &Placement| {
                let normal = found[k].contact.normal;
                normal.perp(&p.contact.normal).abs() < BEND_MAX_RAD && p.contact.length_mm > 0.0
            };
            let both = is_straight(&found[i]) && is_straight(&found[j]);
            if both { 0.5 * (own + slope(i, j)) } else { own }
        };
        Way {
            from: &found[k],
            to: &found[k + 1],
            length_mm: (found[k + 1].contact.point - found[k].contact.point).norm(),
            slopes: [
                if k > 0 { beside(k - 1, k) } else { own },
                if k + 2 < found.len() {
                    beside(k + 1, k + 2)
                } else {
                    own
                },
            ],
        }
    }

    fn heading_rad(&self, contact: &Contact) -> f64 {
        let way_mm = (contact.point - self.from.contact.point).norm();
        let t = (way_mm / self.length_mm.max(1e-9)).clamp(0.0, 1.0);
        let ends = [self.from, self.to].map(|placement| placement.at.heading_rad);
        hermite(t, ends, self.slopes.map(|slope| slope * self.length_mm))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::test_shapes::{ELLIPSE, walls};
    use crate::geometry::{Point2, Vector2};
    use crate::plan::headings::profile::{TURN_WEIGHT_MM4, whole_profile};

    /// Contacts 0.1 mm apart along y = 0, whose beads widen slowly in the middle third.
    fn wall() -> Vec<Contact> {
        (0..600)
            .map(|i| {
                let x = 0.1 * (f64::from(i) + 0.5);
                Contact {
                    point: Point2::new(x, 0.0),
                    normal: Vector2::y(),
                    length_mm: 0.1,
                    extent_mm: 0.4 + 0.005 * (x - 20.0).clamp(0.0, 20.0),
                    on_axis: false,
                }
            })
            .collect()
    }

    /// Goal: a thinned wall has the headings of the whole one, and contacts stand for all of its
    /// length. Method: the profile with and without.
    #[test]
    fn thinned_walls_keep_their_headings() {
        let contacts = wall();
        let walls = walls(&[&[[-5.0, 0.0], [70.0, 0.0], [70.0, 9.0], [-5.0, 9.0]]]);
        let kept = kept(&contacts, &ELLIPSE);
        assert!(kept.len() < 300, "{}", kept.len());
        assert_eq!((kept[0], kept[kept.len() - 1]), (0, 599));
        let thin = standing_for_all(&contacts, &kept);
        let length_mm: f64 = thin.iter().map(|contact| contact.length_mm).sum();
        assert!((length_mm - 60.0).abs() < 1e-9);
        let whole = whole_profile(&contacts, false, TURN_WEIGHT_MM4, &ELLIPSE, &walls);
        let found = whole_profile(&thin, false, TURN_WEIGHT_MM4, &ELLIPSE, &walls);
        let found = filled_in(&contacts, &kept, &found, &ELLIPSE);
        assert_eq!(found.len(), whole.len());
        for (p, q) in found.iter().zip(&whole) {
            assert_eq!(p.contact, q.contact);
            // A bead of 0.8 mm is 0.01 mm wider for 0.016 rad.
            let turned_rad = (p.at.heading_rad - q.at.heading_rad).abs();
            assert!(turned_rad < 0.016, "{turned_rad} at {:?}", p.contact.point);
        }
    }
}
