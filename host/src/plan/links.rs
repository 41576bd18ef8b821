//! Links: passes that follow each other closely become one, without an interruption of flow.
//!
//! Where the straight way from the end of a pass to the start of the next one is short and stays
//! inside the region, the head goes on printing there: neighbouring loops become a spiral. What
//! the way covers lies between the two ends, which the seams left open.

use super::darts::eased;
use super::heading_profile::Placement;
use super::passes::LayerPass;
use crate::geometry::aperture::Aperture;
use crate::geometry::clearance::is_inside;
use crate::geometry::edge_index::EdgeIndex;

/// Longest link, against a: neighbouring beads lie up to 2a apart.
const LENGTH_SHARE: f64 = 3.0;
/// Largest turn of the heading on a link, rad.
const TURN_MAX_RAD: f64 = 1.6;
/// A link may cut the wall by this share of the aperture; the finished curve is pushed off.
const CUT_SHARE: f64 = 1e-3;

/// Joins passes in printing order where a link is possible.
pub fn linked(passes: Vec<LayerPass>, aperture: &Aperture, walls: &EdgeIndex) -> Vec<LayerPass> {
    let mut result: Vec<LayerPass> = Vec::with_capacity(passes.len());
    for mut next in passes {
        let link = result
            .last()
            .and_then(|before| link(before, &next, aperture, walls));
        let (Some(before), Some(link)) = (result.last_mut(), link) else {
            result.push(next);
            continue;
        };
        // Headings go on unwrapped: the next pass is turned by whole periods.
        let (Some(end), Some(start)) = (link.last(), next.placements.first()) else {
            continue;
        };
        let turned = end.at.heading_rad - start.at.heading_rad;
        for placement in &mut next.placements {
            placement.at.heading_rad += turned;
        }
        before.placements.extend(link);
        before.placements.extend(next.placements);
    }
    result
}

/// The placements between the end of one pass and the start of the next, that start included.
fn link(
    before: &LayerPass,
    next: &LayerPass,
    aperture: &Aperture,
    walls: &EdgeIndex,
) -> Option<Vec<Placement>> {
    let (end, start) = (before.placements.last()?, next.placements.first()?);
    let turn = aperture.wrapped_rad(start.at.heading_rad - end.at.heading_rad);
    let length_mm = (start.at.center - end.at.center).norm();
    if length_mm > LENGTH_SHARE * aperture.major_mm() || turn.abs() > TURN_MAX_RAD {
        return None;
    }
    let way = eased(end.at, start.at, aperture);
    way.iter()
        .all(|&at| is_inside(aperture, at, walls, -CUT_SHARE))
        .then(|| {
            way.iter()
                .map(|&at| Placement {
                    at,
                    feasible: true,
                    contact: end.contact,
                })
                .collect()
        })
}
