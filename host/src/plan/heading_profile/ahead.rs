//! What an aperture that touches the wall at a contact may cut, whatever its heading: looked up once
//! for the many headings that are tried there.

use super::CUT_SHARE_MAX;
use crate::geometry::Point2;
use crate::geometry::aperture::Aperture;
use crate::geometry::clearance::EdgesAbout;
use crate::geometry::edge_index::{Edge, EdgeIndex};
use crate::geometry::polygon::Box2;
use crate::plan::contacts::Contact;
use rayon::prelude::*;

/// An edge that rises less than this above the tangent is not cut by what touches there, against b:
/// half of what may be cut.
const RISE_SHARE: f64 = CUT_SHARE_MAX / 2.0;
/// Far above the rounding of places, mm.
const NEAR_MM: f64 = 1e-6;

/// What lies ahead of one contact.
#[derive(Clone, Debug)]
pub enum Ahead {
    /// Edges that some heading may cut.
    Edges(EdgesAbout),
    /// None: at any heading the placement touches the wall at the contact alone. All of them are
    /// inside, or none is.
    Clear {
        /// Inside.
        is_inside: bool,
    },
}

/// What lies ahead of each contact: the same for all contacts at the same places and normals.
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

/// The edges that an aperture touching the wall at `contact` may cut by more than it may, whatever
/// its heading: near enough, not behind the tangent, and not beside the disk that it keeps in.
fn edges_ahead(contact: &Contact, aperture: &Aperture, walls: &EdgeIndex) -> Vec<Edge> {
    let p = contact.point;
    let reach_mm = 2.0 * aperture.reach_mm() + NEAR_MM;
    let rise_mm = RISE_SHARE * aperture.minor_mm();
    let rises = |q: Point2| contact.normal.dot(&(q - p)) > rise_mm;
    let rolling_mm = rolling_radius_mm(aperture);
    let meets_disk = |edge: &Edge| {
        rolling_mm.is_none_or(|radius_mm| {
            let middle = p + contact.normal * radius_mm;
            (edge.foot(middle) - middle).norm() <= radius_mm + NEAR_MM
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
/// rolling theorem, 1916: nowhere is the ellipse less curved), mm; none for flat sides.
fn rolling_radius_mm(aperture: &Aperture) -> Option<f64> {
    match aperture {
        Aperture::Ellipse { major_mm, minor_mm } => Some(major_mm * major_mm / minor_mm),
        Aperture::Rounded(_) => None,
    }
}
