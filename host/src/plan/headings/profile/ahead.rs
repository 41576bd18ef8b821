//! The edges that an aperture in contact with the wall may cut at any heading: found once for the
//! many headings that are tried there.
//!
//! In: contacts, aperture, edges (mm). Out: for each contact the edges that it can meet (mm), or a
//! mark that there are too many to keep.

use super::CUT_SHARE_MAX;
use crate::geometry::Point2;
use crate::geometry::aperture::Aperture;
use crate::geometry::clearance::EdgesAbout;
use crate::geometry::edge_index::{Edge, EdgeIndex};
use crate::geometry::polygon::Box2;
use crate::plan::pass::Contact;
use rayon::prelude::*;

/// An edge that rises less than this above the tangent is not cut by an aperture that touches
/// there, against b: slightly less than the permitted cut.
const RISE_SHARE: f64 = 0.95 * CUT_SHARE_MAX;
/// Far above the rounding of places, mm.
const NEAR_MM: f64 = 1e-6;

/// The edges near one contact.
#[derive(Clone, Debug)]
pub enum Ahead {
    /// Edges that some heading may cut.
    Edges(EdgesAbout),
    /// No edges: at no heading does the placement cut more than permitted. All of them are inside,
    /// or none is.
    Clear {
        /// Inside.
        is_inside: bool,
    },
}

/// The edges near each contact: the same for all contacts at the same positions and normals.
pub fn all_ahead(contacts: &[Contact], aperture: &Aperture, walls: &EdgeIndex) -> Vec<Ahead> {
    let contacts = contacts.par_iter();
    contacts
        .map(|contact| Ahead::of(contact, aperture, walls))
        .collect()
}

impl Ahead {
    fn of(contact: &Contact, aperture: &Aperture, walls: &EdgeIndex) -> Ahead {
        let edges = edges_ahead(contact, aperture, walls);
        // A placement on the axis touches at no known place.
        if contact.on_axis || !edges.is_empty() {
            return Ahead::Edges(EdgesAbout::new(edges));
        }
        // From this centre to that of any other heading the way lies above the tangent by more than
        // the edges left out rise.
        let center = aperture.center_on_wall(0.0, contact.point, contact.normal);
        Ahead::Clear {
            is_inside: walls.contains(center),
        }
    }
}

/// The edges that an aperture touching the wall at `contact` may cut by more than permitted at some
/// heading: near enough, not behind the tangent, and not outside the disk that contains the
/// aperture.
fn edges_ahead(contact: &Contact, aperture: &Aperture, walls: &EdgeIndex) -> Vec<Edge> {
    let p = contact.point;
    let reach_mm = 2.0 * aperture.reach_mm() + NEAR_MM;
    let rise_mm = RISE_SHARE * aperture.minor_mm();
    let rises = |q: Point2| contact.normal.dot(&(q - p)) > rise_mm;
    let rolling_mm = rolling_radius_mm(aperture);
    let meets_disk = |edge: &Edge| {
        rolling_mm.is_none_or(|radius_mm| {
            let middle = p + contact.normal * (radius_mm + rise_mm);
            (edge.foot(middle) - middle).norm() <= radius_mm
        })
    };
    let mut numbers = Vec::new();
    walls.for_edges_in(Box2 { min: p, max: p }.grown(reach_mm), |number| {
        let edge = &walls.edges()[number];
        let is_ahead = contact.on_axis || ((rises(edge.a) || rises(edge.b)) && meets_disk(edge));
        if is_ahead && (edge.foot(p) - p).norm() <= reach_mm {
            numbers.push(number);
        }
    });
    numbers.sort_unstable();
    numbers.dedup();
    let edges = numbers.into_iter();
    edges.map(|number| walls.edges()[number]).collect()
}

/// A disk of this radius that touches a wall holds the aperture that touches it there (Blaschke's
/// rolling theorem, 1916: nowhere is the ellipse less curved), mm; none for flat sides. Lifted off the
/// wall by a share of b, it holds the aperture that is smaller by that share, at any heading: edges
/// that may be cut are omitted.
fn rolling_radius_mm(aperture: &Aperture) -> Option<f64> {
    match aperture {
        Aperture::Ellipse { major_mm, minor_mm } => Some(major_mm * major_mm / minor_mm),
        Aperture::Rounded(_) => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Vector2;
    use crate::geometry::clearance::{Configuration, contact};
    use crate::geometry::test_shapes::ELLIPSE;

    /// Goal: no edge that is left out is cut by more than may be. Method: walls that turn away from
    /// the tangent or curve over it, edges in many places about them; every placement that touches at
    /// the contact, against each edge that is left out, at headings 1° apart. Some are left out that
    /// rise above the tangent, and some are cut.
    #[test]
    fn what_is_left_out_is_not_cut() {
        let wall = Contact {
            point: Point2::new(3.0, -2.0),
            normal: Vector2::new(0.6, 0.8),
            length_mm: 0.1,
            extent_mm: 0.4,
            on_axis: false,
        };
        let along = Vector2::new(0.8, -0.6);
        let place = |x: f64, y: f64| wall.point + along * x + wall.normal * y;
        let (mut left_out, mut cut) = (0, 0);
        for i in -120..120 {
            for k in 0..40 {
                let (x, y) = (0.01 * f64::from(i), 2e-5 * f64::from(k * k));
                let edge = Edge {
                    a: place(x, y),
                    b: place(x + 0.05, y + 1e-3),
                };
                let walls = EdgeIndex::new(vec![edge], 1.0);
                let deepest = (0..180).map(|degree| {
                    let heading_rad = f64::from(degree).to_radians();
                    let center = ELLIPSE.center_on_wall(heading_rad, wall.point, wall.normal);
                    let at = Configuration {
                        center,
                        heading_rad,
                    };
                    contact(&ELLIPSE, at, &walls, 1.0).map_or(1.0, |found| found.scaled)
                });
                let deepest = deepest.fold(1.0, f64::min);
                cut += usize::from(deepest < 1.0 - CUT_SHARE_MAX);
                if edges_ahead(&wall, &ELLIPSE, &walls).is_empty() {
                    assert!(deepest >= 1.0 - CUT_SHARE_MAX, "{x} {y} {deepest}");
                    left_out += usize::from(y > 1e-3);
                }
            }
        }
        assert!(left_out > 500 && cut > 500, "{left_out} {cut}");
    }
}
