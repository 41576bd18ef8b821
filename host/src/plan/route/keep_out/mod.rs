//! Keep-out regions: areas that neither aperture nor nozzle body enters.
//!
//! The body is a disk about the tool's axis. Every placement inside a region keeps its centre at
//! least b from the region's boundary, so passes are planned on the target minus the keep-outs
//! grown by body radius - b: then neither body nor aperture enters. Where the body is the larger of
//! the two, this loses a margin at most a - b wider than with an aperture pointed at the keep-out.
//!
//! Travel is routed around the keep-outs for a disk that holds aperture and body at any heading.
//! Where a pass begins or ends closer than that (a body smaller than the aperture), the head first
//! moves away at a constant heading.
//!
//! In: regions and keep-outs (mm), radius of the body (mm). Out: regions for planning, and corners
//! (mm) of a path between two placements. Paths are shortest over mutually visible corners (E.
//! Dijkstra, 1959).

pub mod shadows;

use crate::geometry::aperture::Aperture;
use crate::geometry::boolean::{difference, grown};
use crate::geometry::clearance::{Configuration, scaled_clearance};
use crate::geometry::edge_index::EdgeIndex;
use crate::geometry::polygon::{Region, Ring};
use crate::geometry::{Point2, Vector2};
use crate::plan::route::shortest_path::TravelRouter;
use crate::settings::Settings;

/// Directions tried when leaving a narrow area.
const DIRECTIONS: usize = 48;
/// Step of that move, relative to b.
const STEP_SHARE: f64 = 0.05;
/// Farthest that it goes, against the disk's radius.
const OUT_SHARE_MAX: f64 = 3.0;
/// Arcs of grown keep-outs are chords inside them by this share of the radius (see `grown`).
const CHORD_SHARE: f64 = 2e-4;

/// The target without the area of the keep-outs.
#[derive(Clone, Debug, PartialEq)]
pub struct Cleared {
    /// The remaining regions, input coordinates.
    pub regions: Vec<Region>,
    /// Lost area, mm².
    pub lost_mm2: f64,
}

/// Takes the keep-outs from the target. Pieces too small for the aperture go as well.
pub fn cleared(regions: &[Region], keep_out: &[Region], settings: &Settings) -> Cleared {
    if keep_out.is_empty() {
        return Cleared {
            regions: regions.to_vec(),
            lost_mm2: 0.0,
        };
    }
    let taken = taken(keep_out, settings);
    let area = |regions: &[Region]| regions.iter().map(Region::area_mm2).sum::<f64>();
    let mut left = Vec::new();
    for region in regions {
        let pieces = difference(std::slice::from_ref(region), &taken);
        let own_mm2 = region.area_mm2();
        if (area(&pieces) - own_mm2).abs() < 1e-9 * own_mm2 {
            left.push(region.clone());
            continue;
        }
        let holds = |piece: &Region| piece.area_mm2() >= settings.aperture.area_mm2();
        left.extend(pieces.into_iter().filter(holds));
    }
    Cleared {
        lost_mm2: area(regions) - area(&left),
        regions: left,
    }
}

/// The keep-outs, grown so that a placement outside them keeps body and aperture out.
pub fn taken(keep_out: &[Region], settings: &Settings) -> Vec<Region> {
    let body_mm = settings.nozzle_body_radius_mm - settings.aperture.minor_mm();
    // The finished curve may cut by the tolerance.
    let margin_mm = 2.0 * settings.tolerances.outside_mm;
    grown(keep_out, body_mm.max(0.0) * (1.0 + CHORD_SHARE) + margin_mm)
}

/// A path around the keep-outs: straight legs over these corners, without ends.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Way {
    /// Left with the heading kept.
    pub out: Option<Point2>,
    /// In between, the head turns.
    pub corners: Vec<Point2>,
    /// From this point on with the heading of the next pass.
    pub back: Option<Point2>,
    /// The corners may be rounded, so that the head need not stop there.
    pub rounded: bool,
}

/// Leads travel around keep-outs; all in the coordinates of its `keep_out`.
#[derive(Clone, Debug)]
pub struct Detours {
    router: TravelRouter,
    walls: EdgeIndex,
    aperture: Aperture,
    disk_mm: f64,
    body_mm: f64,
}

impl Detours {
    /// `None` if the keep-outs have more corners than can be routed around.
    pub fn new(keep_out: &[Region], settings: &Settings) -> Option<Detours> {
        let reversed = |ring: &Ring| Ring {
            points: ring.points.iter().rev().copied().collect(),
        };
        let rings: Vec<Ring> = keep_out
            .iter()
            .flat_map(Region::rings)
            .map(reversed)
            .collect();
        let body_mm = settings.nozzle_body_radius_mm;
        let disk_mm = body_mm.max(settings.aperture.reach_mm());
        let edges = rings.iter().flat_map(Ring::edges);
        let edges = edges.map(|(a, b)| crate::geometry::edge_index::Edge { a, b });
        Some(Detours {
            walls: EdgeIndex::new(edges.collect(), disk_mm),
            router: TravelRouter::new(rings.iter(), false, disk_mm)?,
            aperture: settings.aperture,
            disk_mm,
            body_mm,
        })
    }

    /// The path from one placement to another; `None` if there is none.
    pub fn way(&mut self, from: Configuration, to: Configuration) -> Option<Way> {
        let out = self.exit(from)?;
        let back = self.exit(to)?;
        let start = out.unwrap_or(from.center);
        let end = back.unwrap_or(to.center);
        Some(Way {
            out,
            corners: self.router.way(start, end)?,
            back,
            rounded: false,
        })
    }

    /// True if the disk stays outside along the complete path.
    pub fn is_clear(&self, way: &[Point2]) -> bool {
        let legs = way.windows(2);
        way.iter().all(|&p| self.router.is_free(p))
            && legs.into_iter().all(|w| self.router.sees(w[0], w[1]))
    }

    /// Where the head turns freely: `Some(None)` if it does already, `None` if it cannot get there
    /// in a straight line.
    fn exit(&self, at: Configuration) -> Option<Option<Point2>> {
        if self.router.is_free(at.center) {
            return Some(None);
        }
        let away = self
            .walls
            .nearest(at.center)
            .and_then(|near| (at.center - near.foot).try_normalize(1e-12))
            .unwrap_or(Vector2::x());
        let step_mm = STEP_SHARE * self.aperture.minor_mm();
        let steps = (OUT_SHARE_MAX * self.disk_mm / step_mm).ceil() as usize;
        (0..DIRECTIONS).find_map(|k| {
            // Nearest to straight away first, left and right in turn.
            let side = if k % 2 == 0 { 1.0 } else { -1.0 };
            let angle_rad = side * k.div_ceil(2) as f64 * std::f64::consts::TAU / DIRECTIONS as f64;
            let direction = nalgebra::Rotation2::new(angle_rad) * away;
            for step in 1..=steps {
                let center = at.center + direction * (step as f64 * step_mm);
                if self.router.is_free(center) {
                    return Some(Some(center));
                }
                if !self.fits(Configuration { center, ..at }) {
                    return None;
                }
            }
            None
        })
    }

    /// True where aperture and body keep out.
    fn fits(&self, at: Configuration) -> bool {
        let body_mm = self.body_mm.max(1e-6);
        scaled_clearance(&self.aperture, at, &self.walls, 1.0) >= 1.0 - 1e-6
            && !self.walls.contains(at.center)
            && self
                .walls
                .nearest_within(at.center, body_mm)
                .is_none_or(|near| {
                    // The curve may have come as close as its tolerance.
                    near.distance_mm >= self.body_mm - 1e-6
                })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::test_shapes::region;

    fn rectangle(low: [f64; 2], high: [f64; 2]) -> Region {
        region(&[&[low, [high[0], low[1]], high, [low[0], high[1]]]])
    }

    fn settings(body_mm: f64) -> Settings {
        Settings {
            nozzle_body_radius_mm: body_mm,
            ..Settings::default()
        }
    }

    /// Goal: the ground given up is the keep-out, grown for the body. Method: areas by hand of a
    /// bar across a plate.
    #[test]
    fn the_target_loses_what_is_kept_out() {
        let plate = [rectangle([0.0, 0.0], [20.0, 10.0])];
        let bar = [rectangle([8.0, -5.0], [10.0, 15.0])];
        for (body_mm, lost_mm) in [(0.0, 2.0), (0.2, 2.0), (1.2, 4.0)] {
            let left = cleared(&plate, &bar, &settings(body_mm));
            assert_eq!(left.regions.len(), 2, "{body_mm}");
            // 2 µm on either side, for the tolerance of the path.
            let expected_mm2 = 10.0 * (lost_mm + 0.004);
            assert!(
                (left.lost_mm2 - expected_mm2).abs() < 0.01,
                "{}",
                left.lost_mm2
            );
        }
        let beside = [rectangle([30.0, 0.0], [31.0, 1.0])];
        let whole = cleared(&plate, &beside, &settings(0.0));
        assert_eq!(whole.regions, plate);
        let all = [rectangle([-1.0, -1.0], [21.0, 11.0])];
        assert!(cleared(&plate, &all, &settings(0.0)).regions.is_empty());
    }

    /// Goal: from beside a keep-out, the major axis along it, the head leaves before it turns.
    /// Method: a start 0.21 mm from a wall; the way's first leg must reach the free ground.
    #[test]
    fn the_head_leaves_before_it_turns() {
        let wall = [rectangle([0.0, 0.0], [10.0, 1.0])];
        let mut detours = Detours::new(&wall, &settings(0.0)).expect("few corners");
        let at = |x: f64, y: f64| Configuration {
            center: Point2::new(x, y),
            heading_rad: 0.0,
        };
        let way = detours.way(at(5.0, 1.21), at(5.0, -0.21)).expect("a way");
        let out = way.out.expect("a way out");
        assert!(
            (out.y - 1.6).abs() < 0.011 && (out.x - 5.0).abs() < 1e-9,
            "{out}"
        );
        assert!(!way.corners.is_empty() && way.back.is_some());
        let away = detours.way(at(5.0, 3.0), at(9.0, 3.0)).expect("straight");
        assert_eq!(away, Way::default());
        // Inside a closed frame there is no way out.
        let mut frame = rectangle([0.0, 0.0], [20.0, 20.0]);
        let mut hole = rectangle([1.0, 1.0], [19.0, 19.0]).exterior;
        hole.points.reverse();
        frame.holes.push(hole);
        let mut detours = Detours::new(&[frame], &settings(0.0)).expect("few corners");
        assert_eq!(detours.way(at(10.0, 10.0), at(30.0, 10.0)), None);
    }
}
