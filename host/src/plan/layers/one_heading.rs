//! A region at one heading throughout, for a head that turns slowly.
//!
//! An ellipse that does not turn is the image of a circle: scaled along its short axis, the region becomes one that a round
//! nozzle fills, and the beads of that, scaled back, are as wide as the ellipse is across each direction, between 2b and
//! 2a. No pass needs the heading's axis; where a heading pays, the optimiser turns it.
//!
//! In: the hull of a region (mm, its own frame), the settings. Out: its passes in printing order, before they are
//! optimised. Not covered: apertures that are not elliptical, infill, chosen seams.

use crate::geometry::aperture::Aperture;
use crate::geometry::clearance::Configuration;
use crate::geometry::edge_index::EdgeIndex;
use crate::geometry::polygon::{Region, Ring};
use crate::geometry::{Point2, Vector2};
use crate::plan::axis::medial_axis::{AxisOptions, MedialAxis};
use crate::plan::axis::pruned_axis::Axis;
use crate::plan::beads::passes::{PassSettings, passes};
use crate::plan::joining::printed_order::{RegionPasses, in_printing_order};
use crate::plan::layers::optimised_passes::{Ground, interruption_s};
use crate::plan::outline::trimmed_outline::trimmed_outline;
use crate::plan::pass::{Contact, LayerPass, Placement};
use crate::plan::pose_limits::pose_limits;
use crate::settings::{SeamPlace, Settings};
use std::f64::consts::{FRAC_PI_2, PI};

/// Headings that are compared, over half a turn.
const HEADINGS: usize = 36;
/// True where two quarter turns take longer than an interruption of flow, and nothing but the region's outline decides
/// where its passes run. With the built-in axis (0.36 of an interruption at 60 mm/s, 0.9 at 150) one heading never costs
/// less, on 43 slices at 60 mm/s and 8 at 150.
pub fn may_keep_one_heading(ground: &Ground, settings: &Settings) -> bool {
    let turns_s = 2.0 * pose_limits(settings).rest_to_rest_s(0.0, FRAC_PI_2);
    turns_s > interruption_s(settings)
        && settings.infill.is_none()
        && ground.scale.is_none()
        && settings.seam.place == SeamPlace::Nearest
        && settings.wide_beads.width_by_radius_max().is_none()
}

/// The plane at one heading of an ellipse, scaled so that this is a circle of radius a.
#[derive(Clone, Copy, Debug)]
pub struct OneHeading {
    heading_rad: f64,
    aperture: Aperture,
    /// Scale along the short axis, a / b.
    stretch: f64,
}

impl OneHeading {
    /// `None` unless the aperture is an ellipse that is not a circle.
    fn new(aperture: Aperture, heading_rad: f64) -> Option<OneHeading> {
        let (a, b) = (aperture.major_mm(), aperture.minor_mm());
        let is_ellipse = matches!(aperture, Aperture::Ellipse { .. });
        (is_ellipse && !aperture.is_round()).then_some(OneHeading {
            heading_rad,
            aperture,
            stretch: a / b,
        })
    }

    /// The heading at which beads along the region's boundary make the shortest path, and the one at which that boundary is
    /// shortest in the scaled plane: there the fewest corners and necks are narrower than the beads.
    pub fn candidates(hull: &Region, aperture: Aperture) -> Vec<OneHeading> {
        let all: Vec<OneHeading> = (0..HEADINGS)
            .filter_map(|number| OneHeading::new(aperture, PI * number as f64 / HEADINGS as f64))
            .collect();
        let least = |of_edge: fn(f64, f64) -> f64| {
            let sum = |one: &OneHeading| -> f64 {
                let edges = hull.edges().map(|(p, q)| q - p);
                let sizes = edges.map(|edge| (edge.norm(), one.vector_in(edge).norm()));
                sizes
                    .filter(|(own, _)| *own > 0.0)
                    .map(|(own, scaled)| of_edge(own, scaled))
                    .sum()
            };
            let sums = all.iter().map(|one| (*one, sum(one)));
            // The first of equals: rounding must not choose.
            let least = sums.reduce(|p, q| if q.1 < p.1 * (1.0 - 1e-9) { q } else { p });
            least.map(|(one, _)| one)
        };
        // A bead along an edge is as much wider than 2b as the edge is longer in the scaled plane.
        let path = least(|own, scaled| own * own / scaled);
        let boundary = least(|_, scaled| scaled);
        let mut found: Vec<OneHeading> = path.into_iter().chain(boundary).collect();
        found.dedup_by_key(|one| one.heading_rad.to_bits());
        found
    }

    fn vector_in(&self, v: Vector2) -> Vector2 {
        let (sin, cos) = self.heading_rad.sin_cos();
        Vector2::new(
            v.x * cos + v.y * sin,
            self.stretch * (v.y * cos - v.x * sin),
        )
    }

    fn vector_out(&self, v: Vector2) -> Vector2 {
        let (sin, cos) = self.heading_rad.sin_cos();
        let across = v.y / self.stretch;
        Vector2::new(v.x * cos - across * sin, v.x * sin + across * cos)
    }

    fn region_in(&self, region: &Region) -> Region {
        let ring_in = |ring: &Ring| Ring {
            points: ring
                .points
                .iter()
                .map(|p| Point2::from(self.vector_in(p.coords)))
                .collect(),
        };
        Region {
            exterior: ring_in(&region.exterior),
            holes: region.holes.iter().map(ring_in).collect(),
        }
    }

    fn placement_out(&self, placement: Placement) -> Placement {
        let contact = placement.contact;
        // A normal is scaled the other way round, to be upright on the scaled boundary.
        let (sin, cos) = self.heading_rad.sin_cos();
        let across = contact.normal.y * self.stretch;
        let normal = Vector2::new(
            contact.normal.x * cos - across * sin,
            contact.normal.x * sin + across * cos,
        );
        let normal = normal.normalize();
        Placement {
            at: Configuration {
                center: Point2::from(self.vector_out(placement.at.center.coords)),
                heading_rad: self.heading_rad,
            },
            contact: Contact {
                point: Point2::from(self.vector_out(contact.point.coords)),
                normal,
                extent_mm: self.aperture.extent_mm(self.heading_rad, normal),
                ..contact
            },
            ..placement
        }
    }

    /// The region's loops at this heading, in printing order; empty if it has none.
    pub fn passes(&self, hull: &Region, how: &PassSettings, settings: &Settings) -> Vec<LayerPass> {
        let radius_mm = self.aperture.major_mm();
        let round = Aperture::Ellipse {
            major_mm: radius_mm,
            minor_mm: radius_mm,
        };
        let mut region = trimmed_outline(&self.region_in(hull), &round);
        region.begin_at_extremes();
        let walls = EdgeIndex::of_region(&region, radius_mm);
        let Ok(axis) = MedialAxis::of_edges(&walls, &AxisOptions::of(&round)) else {
            return Vec::new();
        };
        let axis = Axis::of_medial_axis(&axis, &round);
        let how = PassSettings {
            aperture: round,
            ..*how
        };
        let found = passes(&region, &walls, &axis, &how);
        let round = Settings {
            aperture: round,
            ..settings.clone()
        };
        let from = region.bounds().min;
        let passes = RegionPasses {
            passes: found,
            sparse: Vec::new(),
            bridges: Vec::new(),
            walls: &walls,
            open: &[],
        };
        let mut passes = in_printing_order(passes, from, &round);
        for pass in &mut passes {
            for placement in &mut pass.placements {
                *placement = self.placement_out(*placement);
            }
        }
        passes
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::test_shapes::region;
    use crate::plan::layers::optimised_passes::RegionJob;
    use crate::plan::layers::region_plan::topologies::least_costly;
    use crate::settings::HeadingLaw;

    fn how(settings: &Settings) -> PassSettings {
        PassSettings {
            aperture: settings.aperture,
            overlap: 0.0,
            one_pass: false,
            law: HeadingLaw::Tangent,
            turn_weight_mm4: 0.08,
        }
    }

    fn bar(x: f64, y: f64) -> [[f64; 2]; 4] {
        [[0.0, 0.0], [x, 0.0], [x, y], [0.0, y]]
    }

    /// Goal: beads run along a bar with the long axis across it; in a square, both sides get beads of one width. Method: by
    /// hand, 2b s with s the edge's stretch: 1.2 mm along the bar, and sides of a square stretched alike at 45°.
    #[test]
    fn most_of_the_boundary_gets_wide_beads() {
        let aperture = Settings::default().aperture;
        let first = |x: f64, y: f64| {
            OneHeading::candidates(&region(&[&bar(x, y)]), aperture)[0].heading_rad
        };
        assert!((first(200.0, 3.0) - FRAC_PI_2).abs() < 0.2);
        assert!(first(3.0, 200.0).sin().abs() < 0.2);
        let diagonal_rad = first(10.0, 10.0).rem_euclid(FRAC_PI_2);
        assert!((diagonal_rad - 0.5 * FRAC_PI_2).abs() < 1e-9);
    }

    /// Goal: the passes of one heading cover a bracket, before gap-fill moves as a round nozzle does, and stay inside it but
    /// for what the optimiser corrects, b / 4. Method: points of a grid against the ellipses of
    /// the poses, in their own frame; points of these ellipses against the outline.
    #[test]
    fn one_heading_covers_and_stays_inside() {
        let settings = Settings::default();
        let hole = [[4.0, 4.0], [4.0, 9.0], [14.0, 9.0], [14.0, 4.0]];
        let part = region(&[&bar(20.0, 14.0), &hole]);
        let walls = EdgeIndex::of_region(&part, 1.0);
        let (a, b) = (0.6, 0.2);
        for heading in OneHeading::candidates(&part, settings.aperture) {
            let passes = heading.passes(&part, &how(&settings), &settings);
            let (sin, cos) = heading.heading_rad.sin_cos();
            let poses: Vec<Configuration> = passes
                .iter()
                .flat_map(|pass| &pass.placements)
                .map(|placement| placement.at)
                .collect();
            assert!(poses.iter().all(|at| at.heading_rad == heading.heading_rad));
            for at in &poses {
                for step in 0..48 {
                    let (y, x) = (PI * step as f64 / 24.0).sin_cos();
                    let on = Vector2::new(a * x * cos - b * y * sin, a * x * sin + b * y * cos);
                    let p = at.center + on;
                    let is_inside = part.contains(p) || walls.nearest_within(p, 0.05).is_some();
                    assert!(is_inside, "{p} of {at:?}");
                }
            }
            let is_covered = |p: Point2| {
                poses.iter().any(|at| {
                    let q = p - at.center;
                    let own = [(q.x * cos + q.y * sin) / a, (q.y * cos - q.x * sin) / b];
                    own[0].powi(2) + own[1].powi(2) <= 1.0
                })
            };
            let (mut inside, mut covered) = (0, 0);
            for number in 0..200 * 140 {
                let (row, column) = (number / 200, number % 200);
                let p = Point2::new(0.1 * column as f64 + 0.05, 0.1 * row as f64 + 0.05);
                if part.contains(p) {
                    inside += 1;
                    covered += usize::from(is_covered(p));
                }
            }
            assert!(
                covered as f64 > 0.8 * inside as f64,
                "{covered} of {inside}"
            );
        }
    }

    /// Goal: a head that turns slowly keeps one heading where that costs less, a fast one and lines never do. Method: a small
    /// plate, the built-in axis and one of 200°/s and 1000°/s²; how far the headings of the result range.
    #[test]
    fn a_slow_head_keeps_its_heading() {
        let part = region(&[&bar(12.0, 8.0)]);
        let walls = EdgeIndex::of_region(&part, 0.6);
        let ground = Ground {
            walls: &walls,
            area_mm2: part.area_mm2(),
            left_out: &[],
            scale: None,
        };
        let mut slow = Settings::default();
        let heading = slow.machine.joints.iter_mut();
        for joint in heading.filter(|joint| joint.rotary) {
            joint.speed_max = 200f64.to_radians();
            joint.acceleration_max = 1000f64.to_radians();
            joint.jerk_max = 1e5f64.to_radians();
        }
        let fast = Settings::default();
        assert!(may_keep_one_heading(&ground, &slow));
        assert!(!may_keep_one_heading(&ground, &fast));
        let turning = || {
            let axis = MedialAxis::of_edges(&walls, &AxisOptions::of(&fast.aperture)).unwrap();
            let axis = Axis::of_medial_axis(&axis, &fast.aperture);
            let passes = RegionPasses {
                passes: passes(&part, &walls, &axis, &how(&fast)),
                sparse: Vec::new(),
                bridges: Vec::new(),
                walls: &walls,
                open: &[],
            };
            in_printing_order(passes, Point2::origin(), &fast)
        };
        let range_rad = |settings: &Settings| {
            let (_, found) = least_costly(
                vec![turning()],
                &part,
                &RegionJob::new(&ground, settings),
                &how(settings),
            );
            let cost_s = found.cost_s.expect("all passes are known");
            let headings = found.passes.iter().flat_map(|pass| &pass.placements);
            let headings = headings.map(|placement| placement.at.heading_rad);
            let (low, high) = headings.fold((f64::MAX, f64::MIN), |(low, high), rad| {
                (low.min(rad), high.max(rad))
            });
            (high - low, cost_s)
        };
        let ((turned_rad, _), (kept_rad, kept_s)) = (range_rad(&fast), range_rad(&slow));
        assert!(turned_rad > PI, "{turned_rad}");
        assert!(kept_rad < PI, "{kept_rad}");
        let unkept = RegionJob::new(&ground, &slow).optimised(turning());
        let unkept_s = unkept.cost_s.expect("all passes are known");
        assert!(kept_s < 0.9 * unkept_s, "{kept_s} {unkept_s}");
    }
}
