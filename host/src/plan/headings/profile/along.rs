//! Desired extents before and after each contact of a run: a turned aperture touches a wall there,
//! not at its contact.
//!
//! In: contacts in order with the desired extents (mm). Out: that extent and the lateral offset
//! (mm) at any distance along the run (mm), from tables at even steps.

use crate::plan::pass::Contact;

/// Entries of a table for each contact.
const ENTRIES_PER_CONTACT: usize = 2;
/// Contacts with their values at equal steps along the run.
pub struct Along<'a> {
    contacts: &'a [Contact],
    closed: bool,
    length_mm: f64,
    /// Position of each contact along the run, mm.
    positions_mm: Vec<f64>,
    /// Wanted extents, mm.
    extents_mm: Vec<f64>,
    /// Position of a run on the axis, x and y, mm; empty for others.
    axis_mm: [Vec<f64>; 2],
}

impl<'a> Along<'a> {
    /// The tables of a run in steps of `entry_mm` at most; `closed` where the last contact meets the
    /// first.
    pub fn new(contacts: &'a [Contact], closed: bool, entry_mm: f64) -> Along<'a> {
        let mut length_mm = 0.0;
        let mut positions_mm = Vec::with_capacity(contacts.len());
        for contact in contacts {
            positions_mm.push(length_mm + 0.5 * contact.length_mm);
            length_mm += contact.length_mm;
        }
        let count = (contacts.len() * ENTRIES_PER_CONTACT).max(1);
        // On straight parts contacts may be farther apart.
        let count = count.max((length_mm / entry_mm) as usize);
        let table = |value: fn(&Contact) -> f64| {
            let known: Vec<(f64, f64)> = contacts
                .iter()
                .zip(&positions_mm)
                .filter(|(c, _)| c.length_mm > 0.0)
                .map(|(c, &s)| (s, value(c)))
                .collect();
            interpolated(&known, length_mm / count as f64, count)
        };
        let on_axis = contacts.iter().any(|c| c.on_axis);
        let axis_mm = on_axis.then(|| [table(|c| c.point.x), table(|c| c.point.y)]);
        Along {
            extents_mm: table(|c| c.extent_mm),
            axis_mm: axis_mm.unwrap_or_default(),
            contacts,
            closed,
            length_mm,
            positions_mm,
        }
    }

    /// The extent wanted `along_mm` further along the run than contact `i`.
    pub fn wanted_mm(&self, i: usize, along_mm: f64) -> f64 {
        let found = self.entry(&self.extents_mm, i, along_mm);
        found.unwrap_or(self.contacts[i].extent_mm)
    }

    /// Lateral offset of a run on the axis from the normal at contact `i`, `along_mm` further along,
    /// mm.
    pub fn aside_mm(&self, i: usize, along_mm: f64) -> f64 {
        let [x, y] = self.axis_mm.each_ref();
        let there = self.entry(x, i, along_mm).zip(self.entry(y, i, along_mm));
        let Contact { point, normal, .. } = self.contacts[i];
        there.map_or(0.0, |(x, y)| {
            normal.x * (x - point.x) + normal.y * (y - point.y)
        })
    }

    /// A table's value `along_mm` further along than contact `i`; `None` if that has no length.
    fn entry(&self, table: &[f64], i: usize, along_mm: f64) -> Option<f64> {
        if self.contacts[i].length_mm <= 0.0 || self.length_mm <= 0.0 {
            return None;
        }
        // Linear between the middles of the steps: at a jump, rounding would choose.
        let count = table.len() as f64;
        let at = (self.positions_mm[i] + along_mm) / self.length_mm * count - 0.5;
        let low = at.floor();
        let entry = |index: f64| {
            let last = count - 1.0;
            let index = if (0.0..=last).contains(&index) {
                index
            } else if self.closed {
                index.rem_euclid(count).min(last)
            } else {
                index.clamp(0.0, last)
            };
            table[index as usize]
        };
        let (before, after) = (entry(low), entry(low + 1.0));
        Some(before + (after - before) * (at - low))
    }
}

/// Values known at rising positions, linear at `count` equal steps (their middles).
fn interpolated(known: &[(f64, f64)], step: f64, count: usize) -> Vec<f64> {
    let mut next = 0;
    (0..count)
        .map(|i| {
            let s = (i as f64 + 0.5) * step;
            while next < known.len() && known[next].0 < s {
                next += 1;
            }
            match (
                next.checked_sub(1).and_then(|n| known.get(n)),
                known.get(next),
            ) {
                (Some(p), Some(q)) if q.0 > p.0 => p.1 + (q.1 - p.1) * (s - p.0) / (q.0 - p.0),
                (Some(p), _) => p.1,
                (None, Some(q)) => q.1,
                (None, None) => 0.0,
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use crate::geometry::test_shapes::{ELLIPSE, star, walls};
    use crate::geometry::{Point2, Vector2};
    use crate::plan::headings::profile::{TURN_WEIGHT_MM4, profile};
    use crate::plan::pass::Contact;

    /// Goal: one bead in a bent wall touches both its sides, although a tilted aperture touches the
    /// one ahead and the other behind (found on a cookie cutter: 20 um stayed open along the inside).
    /// Method: a ring 0.72 mm wide, 8 mm across, contacts on its axis; how near the points of the
    /// placed apertures come to either side.
    #[test]
    fn one_bead_touches_both_sides_of_a_bent_wall() {
        const MIDDLE_MM: f64 = 4.0;
        const HALF_MM: f64 = 0.36;
        let mut inner = star(2000, |_| MIDDLE_MM - HALF_MM);
        inner.reverse();
        let walls = walls(&[&star(2000, |_| MIDDLE_MM + HALF_MM), &inner]);
        let contacts: Vec<Contact> = (0..250)
            .map(|i| std::f64::consts::TAU * f64::from(i) / 250.0)
            .map(|angle| Contact {
                point: Point2::new(MIDDLE_MM * angle.cos(), MIDDLE_MM * angle.sin()),
                normal: Vector2::new(-angle.cos(), -angle.sin()),
                length_mm: std::f64::consts::TAU * MIDDLE_MM / 250.0,
                extent_mm: HALF_MM,
                on_axis: true,
            })
            .collect();
        let found = profile(&contacts, true, TURN_WEIGHT_MM4, &ELLIPSE, &walls);
        for placement in &found {
            assert!(placement.feasible);
            let turn = placement.at.heading_rad;
            let radii = (0..3600).map(|k| {
                let angle = std::f64::consts::TAU * f64::from(k) / 3600.0;
                let out = Vector2::new(angle.cos(), angle.sin());
                let point = placement.at.center + ELLIPSE.support_point(turn, out);
                point.coords.norm()
            });
            let (near_mm, far_mm) = radii.fold((f64::INFINITY, 0.0), |(near, far), r| {
                (r.min(near), r.max(far))
            });
            let inside_mm = near_mm - (MIDDLE_MM - HALF_MM);
            let outside_mm = MIDDLE_MM + HALF_MM - far_mm;
            // As far as the price of turning lets the heading miss the width: half of what was found.
            assert!(
                inside_mm < 0.01 && outside_mm < 0.01,
                "{inside_mm} {outside_mm}"
            );
        }
    }
}
