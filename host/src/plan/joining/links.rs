//! Links: passes that follow each other closely become one, without an interruption of flow.
//!
//! If the straight connection from the end of a pass to the start of the next one is short and
//! stays inside the region, the head continues printing: neighbouring loops become a spiral. The
//! connection covers the area between the two ends, which the seams left uncovered.
//!
//! In: passes in printing order (mm, rad), the walls. Out: fewer passes, joined by placements in
//! between.

use crate::geometry::Point2;
use crate::geometry::aperture::Aperture;
use crate::geometry::clearance::Configuration;
use crate::geometry::edge_index::EdgeIndex;
use crate::geometry::point_grid::PointGrid;
use crate::plan::coverage::connections::bent_connection;
use crate::plan::coverage::raster::NearbyPasses;
use crate::plan::pass::{LayerPass, Placement};
use std::collections::BTreeMap;

/// Longest link, relative to a: neighbouring beads are up to 2a apart, and where one crosses, ends
/// are cut back on either side of it.
pub const LENGTH_SHARE: f64 = 3.6;
/// The same between two lines of an infill, whose ends are far apart along a wall at a low angle.
const LINE_LENGTH_SHARE: f64 = 10.0;
/// Path at either end whose area a link may cover, relative to a.
const OWN_SHARE: f64 = 2.0;
/// Largest turn of the heading on a link or a bridge, rad.
pub const TURN_MAX_RAD: f64 = 2.0;

/// Joins passes in printing order where a link is possible.
pub fn linked(passes: Vec<LayerPass>, aperture: &Aperture, walls: &EdgeIndex) -> Vec<LayerPass> {
    let nearby = NearbyPasses::of(&passes, aperture);
    let mut result: Vec<LayerPass> = Vec::with_capacity(passes.len());
    for mut next in passes {
        let before = result.last().map(Directed::ahead);
        let link = before.and_then(|before| link(before, Directed::ahead(&next), &nearby, walls));
        let (Some(before), Some((link, _))) = (result.last_mut(), link) else {
            result.push(next);
            continue;
        };
        // Headings are unwrapped: the next pass is turned by whole periods.
        let (Some(end), Some(start)) = (link.last(), next.placements.first()) else {
            continue;
        };
        let turned = end.at.heading_rad - start.at.heading_rad;
        for placement in &mut next.placements {
            placement.at.heading_rad += turned;
        }
        before.placements.extend(link);
        before.append(next);
    }
    result
}

/// A pass with its direction.
#[derive(Clone, Copy)]
pub struct Directed<'a> {
    /// The pass.
    pub pass: &'a LayerPass,
    /// From its last placement to its first.
    pub backwards: bool,
}

impl<'a> Directed<'a> {
    /// The pass from its first placement to its last.
    fn ahead(pass: &'a LayerPass) -> Directed<'a> {
        Directed {
            pass,
            backwards: false,
        }
    }

    fn placements(self) -> impl DoubleEndedIterator<Item = &'a Placement> {
        let all = &self.pass.placements;
        let number = move |k| {
            if self.backwards { all.len() - 1 - k } else { k }
        };
        (0..all.len()).map(move |k| &all[number(k)])
    }
}

/// The placements between the end of one pass and the start of the next, that start included, and
/// the area of other beads that they cover again, mm².
pub fn link(
    before: Directed,
    next: Directed,
    nearby: &NearbyPasses,
    walls: &EdgeIndex,
) -> Option<(Vec<Placement>, f64)> {
    let aperture = *nearby.aperture();
    let (end, start) = (before.placements().next_back()?, next.placements().next()?);
    let length_mm = (start.at.center - end.at.center).norm();
    let lines = [before, next].iter().all(|d| d.pass.kind.is_line());
    let share = if lines {
        LINE_LENGTH_SHARE
    } else {
        LENGTH_SHARE
    };
    if length_mm > share * aperture.major_mm() {
        return None;
    }
    let way = bent_connection(end.at, start.at, TURN_MAX_RAD, &aperture, walls)?;
    let reach_mm = OWN_SHARE * aperture.major_mm();
    let own_end = stretch(before.placements().rev(), reach_mm);
    let own_start = stretch(next.placements(), reach_mm);
    let recovered_mm2 = nearby.recovered_mm2([own_end, own_start], &way);
    let placement = |at| Placement {
        at,
        feasible: true,
        contact: end.contact,
    };
    Some((way.into_iter().map(placement).collect(), recovered_mm2))
}

/// The nearest placement of each pass from number `first` on in `index` (pass and placement) within
/// `reach_mm` of a point: pass, placement, and its distance in whole nanometres.
pub fn nearest_of_each(
    index: &PointGrid<(usize, usize)>,
    passes: &[LayerPass],
    first: usize,
    place: Point2,
    reach_mm: f64,
) -> impl Iterator<Item = (usize, usize, f64)> {
    let mut nearest: BTreeMap<usize, (f64, usize)> = BTreeMap::new();
    for &(number, i) in index.around(place).filter(|(number, _)| *number >= first) {
        let apart_mm = (passes[number].placements[i].at.center - place).norm();
        // Straight passes are equally far apart all along: rounding must not choose.
        let found = ((apart_mm * 1e6).round(), i);
        let best = nearest.entry(number).or_insert(found);
        if found < *best {
            *best = found;
        }
    }
    let all = nearest.into_iter().map(|(n, (apart, i))| (n, i, apart));
    all.filter(move |(_, _, apart)| *apart < 1e6 * reach_mm)
}

/// The first placements, as far as `length_mm` of path.
fn stretch<'a>(
    placements: impl Iterator<Item = &'a Placement>,
    length_mm: f64,
) -> Vec<Configuration> {
    let mut found: Vec<Configuration> = Vec::new();
    let mut left_mm = length_mm;
    for placement in placements {
        if let Some(last) = found.last() {
            left_mm -= (placement.at.center - last.center).norm();
        }
        if left_mm < 0.0 {
            break;
        }
        found.push(placement.at);
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::test_shapes::{ELLIPSE as APERTURE, walls};
    use crate::plan::pass::test_passes::run;

    const BOX: &[[f64; 2]] = &[[-5.0, -5.0], [5.0, -5.0], [5.0, 5.0], [-5.0, 5.0]];
    const SLIT: &[[f64; 2]] = &[[-4.0, 0.59], [-4.0, 0.61], [4.0, 0.61], [4.0, 0.59]];

    /// Goal: neighbours become one pass whose heading goes on without a turn of 180°, but not
    /// through a wall, nor over a long way. Method: two runs 1.2 mm apart, there and back.
    #[test]
    fn neighbours_are_linked_where_the_way_is_free() {
        let there = run([-3.0, 0.0], [3.0, 0.0]);
        let back = run([3.0, 1.2], [-3.0, 1.2]);
        let joined = linked(vec![there.clone(), back.clone()], &APERTURE, &walls(&[BOX]));
        assert_eq!(joined.len(), 1);
        for pair in joined[0].placements.windows(2) {
            assert!((pair[1].at.center - pair[0].at.center).norm() < 0.25);
            assert!((pair[1].at.heading_rad - pair[0].at.heading_rad).abs() < 1e-9);
        }
        let apart = linked(vec![there.clone(), back], &APERTURE, &walls(&[BOX, SLIT]));
        assert_eq!(apart.len(), 2);
        let far = linked(
            vec![there, run([3.0, 3.0], [-3.0, 3.0])],
            &APERTURE,
            &walls(&[BOX]),
        );
        assert_eq!(far.len(), 2);
    }
}
