//! Skirts and brims: loops around the part, printed before it.
//!
//! Loop i touches the level curve of the outside distance that the loops inside it are to fill: the
//! outline of the part grown by that distance. Such curves end at the exterior medial axis, so they
//! cannot cross themselves. Contacts along a curve get a heading profile like any wall, with the
//! widest bead wherever the opposite side leaves space, so the loops fit together.
//!
//! Input: the target's regions (mm, input coordinates). Output: passes about a local origin, in
//! printing order, the outermost loop first. A brim follows every level curve, a skirt the outer
//! ones only: no skirt in a pocket. Holes of the part get neither, but a part inside a hole gets the loops of a
//! brim for which there is room.

use crate::plan::headings::contacts::wall_contacts;
use crate::text::refusal::Refusal;

use crate::geometry::aperture::Aperture;
use crate::geometry::boolean::{difference, filled, grown};
use crate::geometry::edge_index::{Edge, EdgeIndex};
use crate::geometry::polygon::{Box2, Region, Ring};
use crate::geometry::repair::FillRule;
use crate::geometry::{Point2, Vector2};
use crate::plan::axis::medial_axis::{AxisOptions, MedialAxis, PruneOptions};
use crate::plan::beads::passes::Lengths;
use crate::plan::headings::profile::profile;
use crate::plan::headings::runs::{feasible_runs, printable_runs};
use crate::plan::joining::links::linked;
use crate::plan::joining::order::ordered;
use crate::plan::pass::{Contact, LayerPass, PassKind};
use crate::settings::{Settings, Skirt};

/// Weight of turning along the loops, of the aperture's unit to the fourth: less than along beads of the part, since
/// loops that share a slot may not cross its middle and nothing is filled up beside them.
const LOOP_TURN_WEIGHT: f64 = 0.01;
/// A wall whose normal turns further than this against the contact's faces it, cosine.
const FACING_COS: f64 = -0.7;
/// Least object angle of the exterior axis, rad: that of right-angled corners stays.
const AXIS_ANGLE_MIN_RAD: f64 = 1.4;
/// Distance of the frame from the loops, relative to theirs: farther than any level curve, so that
/// it takes no part in them.
const FRAME_SHARE: f64 = 4.0;

/// The plan around a target.
#[derive(Clone, Debug)]
pub struct SkirtPlan {
    /// Add this to local coordinates to get the input's.
    pub offset: Vector2,
    /// Boundary of the area of the loops, local, with the area on the left.
    pub walls: EdgeIndex,
    /// The exterior medial axis as far as the loops reach, local.
    pub axis: Vec<[Point2; 2]>,
    /// The loops, in printing order, local.
    pub passes: Vec<LayerPass>,
    /// Loops of a brim without room between parts inside a hole and its wall.
    pub crowded: usize,
}

/// Where loops lie, local.
struct LoopGround {
    /// What they are around.
    shapes: Vec<Region>,
    /// The ground's outer boundary, with the ground on the left: a box, or the wall of a hole.
    frame: Ring,
    is_hole: bool,
}

impl LoopGround {
    /// True where the loop at a distance fits between parts and hole.
    fn has_room(&self, distance_mm: f64, is_brim: bool, settings: &Settings) -> bool {
        let hole = Region {
            exterior: self.frame.clone(),
            holes: Vec::new(),
        };
        let filled = || grown(&self.shapes, distance_mm + bead_mm(settings));
        !self.is_hole || is_brim && difference(&filled(), &[hole]).is_empty()
    }
}

impl SkirtPlan {
    /// Where the last loop ends, input coordinates.
    pub fn end(&self) -> Option<Point2> {
        let last = self.passes.last()?.placements.last()?;
        Some(last.at.center + self.offset)
    }
}

/// How far from the outline the outermost loop reaches, mm.
pub fn skirt_reach_mm(settings: &Settings) -> f64 {
    let steps = loop_distances_mm(&settings.skirt, settings);
    let last = steps.last().map(|step| step.0 + bead_mm(settings));
    last.unwrap_or(0.0)
}

/// Distance between neighbouring loops, mm.
fn bead_mm(settings: &Settings) -> f64 {
    2.0 * settings.aperture.major_mm() * (1.0 - settings.overlap_pct / 100.0)
}

/// Distance of each loop's inner side from the outline, innermost first, and whether the loop is a
/// brim's.
fn loop_distances_mm(skirt: &Skirt, settings: &Settings) -> Vec<(f64, bool)> {
    let bead_mm = bead_mm(settings);
    let brim = (0..skirt.brim_loops).map(|i| (f64::from(i) * bead_mm, true));
    let from_mm = f64::from(skirt.brim_loops) * bead_mm + skirt.distance_mm;
    let loops = (0..skirt.loops).map(|i| (from_mm + f64::from(i) * bead_mm, false));
    brim.chain(loops).collect()
}

/// Plans the loops; `None` if none are requested. They avoid `taken`. `from` is the head's
/// position, input coordinates.
///
/// # Errors
/// The exterior medial axis.
pub fn skirt_plan(
    regions: &[Region],
    taken: &[Region],
    from: Point2,
    settings: &Settings,
) -> Result<Option<SkirtPlan>, Refusal> {
    let distances = loop_distances_mm(&settings.skirt, settings);
    let Some(&(first_mm, _)) = distances.first() else {
        return Ok(None);
    };
    let bounds = bounds_of(regions);
    let offset = (bounds.min.coords + bounds.max.coords) / 2.0;
    let frame = frame(bounds, offset, FRAME_SHARE * skirt_reach_mm(settings));
    let taken: Vec<Region> = taken.iter().map(|region| region.shifted(-offset)).collect();
    let reach_mm = settings.aperture.major_mm();
    let mut position = from - offset;
    let (mut passes, mut axis, mut walls, mut crowded) = (Vec::new(), Vec::new(), Vec::new(), 0);
    for ground in loop_grounds(regions, offset, frame) {
        let LoopGround { shapes, frame, .. } = &ground;
        let mut own: Vec<LayerPass> = Vec::new();
        for (number, &(distance_mm, is_brim)) in distances.iter().enumerate().rev() {
            if !ground.has_room(distance_mm, is_brim, settings) {
                crowded += usize::from(is_brim);
                continue;
            }
            let rings = level_rings(&grown(shapes, distance_mm), is_brim);
            let walls = ground_walls(&rings, frame, &taken, reach_mm);
            let found = loop_passes(&rings, &walls, number as u32 + 1, &settings.aperture);
            let found = ordered(found, position, &settings.aperture);
            if let Some(last) = found.last().and_then(|pass| pass.placements.last()) {
                position = last.at.center;
            }
            own.extend(found);
        }
        if own.is_empty() {
            continue;
        }
        let inner = level_rings(&grown(shapes, first_mm), true);
        let own_walls = ground_walls(&inner, frame, &taken, reach_mm);
        passes.extend(linked(own, &settings.aperture, &own_walls));
        walls.extend_from_slice(own_walls.edges());
        let around = ground_walls(&level_rings(shapes, true), frame, &[], reach_mm);
        axis.extend(exterior_axis(&around, skirt_reach_mm(settings))?);
    }
    Ok(Some(SkirtPlan {
        offset,
        walls: EdgeIndex::new(walls, reach_mm),
        axis,
        passes,
        crowded,
    }))
}

/// The ground around all parts, after that of each hole with parts inside it.
fn loop_grounds(regions: &[Region], offset: Vector2, frame: Ring) -> Vec<LoopGround> {
    let holes = regions.iter().flat_map(|region| &region.holes);
    let inside = holes.filter_map(|hole| {
        let alone = Region {
            exterior: hole.clone(),
            holes: Vec::new(),
        };
        let is_in = |region: &&Region| {
            let first = region.exterior.points.first();
            first.is_some_and(|first| alone.contains(*first))
        };
        let parts: Vec<Region> = regions.iter().filter(is_in).cloned().collect();
        let mut frame: Vec<Point2> = hole.points.iter().map(|p| p - offset).collect();
        frame.reverse();
        (!parts.is_empty()).then(|| LoopGround {
            shapes: outer_shapes(&parts, offset),
            frame: Ring { points: frame },
            is_hole: true,
        })
    });
    let around = LoopGround {
        shapes: outer_shapes(regions, offset),
        frame,
        is_hole: false,
    };
    inside.chain([around]).collect()
}

fn bounds_of(regions: &[Region]) -> Box2 {
    let boxes = regions.iter().map(Region::bounds);
    let corners: Vec<Point2> = boxes.flat_map(|b| [b.min, b.max]).collect();
    Box2::of(&corners)
}

/// The regions without holes, those inside others gone, local.
fn outer_shapes(regions: &[Region], offset: Vector2) -> Vec<Region> {
    let exteriors: Vec<Ring> = regions
        .iter()
        .map(|region| Ring {
            points: region.exterior.points.iter().map(|p| p - offset).collect(),
        })
        .collect();
    let mut shapes = filled(exteriors.iter(), FillRule::NonZero);
    for shape in &mut shapes {
        shape.holes.clear();
    }
    shapes
}

/// A box far around everything, with the area on the left.
fn frame(bounds: Box2, offset: Vector2, margin_mm: f64) -> Ring {
    let Box2 { min, max } = bounds.grown(margin_mm);
    let corners = [
        [min.x, min.y],
        [max.x, min.y],
        [max.x, max.y],
        [min.x, max.y],
    ];
    Ring {
        points: corners.map(|c| Point2::from(c) - offset).to_vec(),
    }
}

/// The rings of a level curve, with the area outside it on the left; `pockets` are those around
/// areas that the shape encloses.
fn level_rings(level: &[Region], pockets: bool) -> Vec<Ring> {
    let reversed = |ring: &Ring| Ring {
        points: ring.points.iter().rev().copied().collect(),
    };
    let mut rings = Vec::new();
    for region in level {
        rings.push(reversed(&region.exterior));
        if pockets {
            rings.extend(region.holes.iter().map(reversed));
        }
    }
    rings
}

/// Boundary of the area between rings and frame, without the occupied one.
fn ground_walls(rings: &[Ring], frame: &Ring, taken: &[Region], reach_mm: f64) -> EdgeIndex {
    let all: Vec<Ring> = rings.iter().chain([frame]).cloned().collect();
    let left: Vec<Ring> = if taken.is_empty() {
        all
    } else {
        // The shapes are nested at most once: a frame and the rings inside it.
        let ground = difference(&filled(all.iter(), FillRule::EvenOdd), taken);
        ground.iter().flat_map(Region::rings).cloned().collect()
    };
    let edges = left.iter().flat_map(Ring::edges);
    EdgeIndex::new(edges.map(|(a, b)| Edge { a, b }).collect(), reach_mm)
}

/// The passes of one loop, against the rings of its level curve.
fn loop_passes(
    rings: &[Ring],
    walls: &EdgeIndex,
    channel: u32,
    aperture: &Aperture,
) -> Vec<LayerPass> {
    let lengths = Lengths::of(aperture);
    let turn_weight_mm4 = LOOP_TURN_WEIGHT * aperture.unit_mm().powi(4);
    let mut found = Vec::new();
    for ring in rings {
        let mut contacts = wall_contacts(ring, lengths.spacing());
        for contact in &mut contacts {
            contact.extent_mm = room_mm(contact, walls, aperture);
        }
        for (run, closed) in printable_runs(&contacts, aperture) {
            let placements = profile(&run, closed, turn_weight_mm4, aperture, walls);
            let runs = feasible_runs(placements, closed, aperture);
            found.extend(runs.into_iter().map(|(placements, closed)| LayerPass {
                kind: PassKind::Skirt,
                channel,
                closed,
                placements,
                then: Vec::new(),
            }));
        }
    }
    found.retain(|pass| pass.placements.len() > 2);
    found
}

/// Half the bead that fits between the contact and half the distance to a wall that faces it.
fn room_mm(contact: &Contact, walls: &EdgeIndex, aperture: &Aperture) -> f64 {
    let a = aperture.major_mm();
    let mut free_mm = 4.0 * a;
    let end = contact.point + contact.normal * free_mm;
    let area = Box2::of(&[contact.point, end]);
    walls.for_edges_in(area, |number| {
        let edge = &walls.edges()[number];
        if edge.normal().dot(&contact.normal) > FACING_COS {
            return;
        }
        let (from, along) = (edge.a - contact.point, edge.b - edge.a);
        let turn = contact.normal.perp(&along);
        let on_edge = contact.normal.perp(&from) / -turn;
        let ahead_mm = from.perp(&along) / turn;
        if (0.0..=1.0).contains(&on_edge) && ahead_mm > 0.0 {
            free_mm = free_mm.min(ahead_mm);
        }
    });
    0.25 * free_mm
}

/// The exterior medial axis where it is no farther from the part than `reach_mm`.
fn exterior_axis(around: &EdgeIndex, reach_mm: f64) -> Result<Vec<[Point2; 2]>, Refusal> {
    let axis = MedialAxis::of_edges(around, &AxisOptions::default())?.pruned(&PruneOptions {
        object_angle_min_rad: AXIS_ANGLE_MIN_RAD,
        ..PruneOptions::default()
    });
    let pairs = axis.edges.iter().flat_map(|edge| edge.points.windows(2));
    let near = pairs.filter(|pair| pair.iter().all(|p| p.radius_mm <= reach_mm));
    Ok(near.map(|pair| [pair[0].point, pair[1].point]).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::test_shapes::{ELLIPSE, region};
    use crate::plan::pass::Placement;

    fn settings(loops: u32, brim_loops: u32) -> Settings {
        Settings {
            aperture: ELLIPSE,
            skirt: Skirt {
                loops,
                brim_loops,
                distance_mm: 2.0,
            },
            ..Settings::default()
        }
    }

    /// Goal: a part inside another one's hole has a brim where there is room for it, and what has none is counted.
    /// Method: a square of 8 mm in frames with holes of 32 and 9.6 mm, the loops' distance from it by hand.
    #[test]
    fn a_part_inside_a_hole_has_its_own_brim() {
        let square = |half_mm: f64| {
            [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
                .map(|c: [f64; 2]| c.map(|x| x * half_mm))
        };
        for (hole_mm, crowded) in [(16.0, 0), (4.8, 3)] {
            let mut hole = square(hole_mm);
            hole.reverse();
            let part = [region(&[&square(20.0), &hole]), region(&[&square(4.0)])];
            let plan = skirt_plan(&part, &[], Point2::origin(), &settings(1, 3))
                .expect("axis")
                .expect("loops");
            assert_eq!(plan.crowded, crowded);
            let centres = plan.passes.iter().flat_map(|pass| &pass.placements);
            let away_mm = centres.map(|placement| placement.at.center.coords.amax() - 4.0);
            let inside: Vec<f64> = away_mm.filter(|mm| *mm < 12.0).collect();
            // Three beads of 1.2 mm, less what corners and overlap take.
            let farthest_mm = inside.iter().copied().fold(0.0, f64::max);
            assert_eq!(inside.is_empty(), crowded > 0, "{hole_mm}");
            assert!(
                crowded > 0 || (2.5..3.6).contains(&farthest_mm),
                "{farthest_mm}"
            );
        }
    }

    /// A thick L with a slot 1.8 mm wide, in which one bead fits from either side but not two.
    fn slotted() -> Vec<Region> {
        vec![region(&[&[
            [100.0, 100.0],
            [120.0, 100.0],
            [120.0, 108.0],
            [111.0, 108.0],
            [111.0, 103.0],
            [109.2, 103.0],
            [109.2, 115.0],
            [100.0, 115.0],
        ]])]
    }

    /// Placements may cut by this much before the finished curve is pushed off the walls, mm.
    const CUT_MM: f64 = 0.01;

    /// Goal: every loop keeps its distance and lies against the loop inside it. Method: the
    /// distance of outline points of every placed aperture from the part, by all edges.
    #[test]
    fn loops_keep_their_distance() {
        for (loops, brim_loops) in [(2, 0), (0, 3), (1, 2)] {
            let settings = settings(loops, brim_loops);
            let part = slotted();
            let plan = skirt_plan(&part, &[], Point2::origin(), &settings)
                .expect("axis")
                .expect("loops");
            let distance_mm = |p: Point2| {
                let far = |(a, b): (Point2, Point2)| (p - Edge { a, b }.foot(p)).norm();
                part[0].edges().map(far).fold(f64::INFINITY, f64::min)
            };
            let first_mm = if brim_loops > 0 { 0.0 } else { 2.0 };
            let last_mm = skirt_reach_mm(&settings);
            let (mut nearest_mm, mut farthest_mm) = (f64::INFINITY, 0.0_f64);
            for placement in plan.passes.iter().flat_map(|pass| &pass.placements) {
                for q in ELLIPSE.outline(placement.at.heading_rad, 64) {
                    let p = placement.at.center + plan.offset + q;
                    assert!(!part[0].contains(p) || distance_mm(p) < CUT_MM);
                    nearest_mm = nearest_mm.min(distance_mm(p));
                    farthest_mm = farthest_mm.max(distance_mm(p));
                }
            }
            assert!((nearest_mm - first_mm).abs() < CUT_MM, "{nearest_mm}");
            assert!((farthest_mm - last_mm).abs() < 0.05, "{farthest_mm}");
        }
    }

    /// Goal: no two beads of a brim meet, in the slot neither. Method: distances between the
    /// centres of loop 1 and the middle line of the slot; the exterior axis runs along that line.
    #[test]
    fn a_slot_is_shared_between_its_sides() {
        let settings = settings(0, 1);
        let plan = skirt_plan(&slotted(), &[], Point2::origin(), &settings)
            .expect("axis")
            .expect("loops");
        let mut in_slot = 0;
        for placement in plan.passes.iter().flat_map(|pass| &pass.placements) {
            let p = placement.at.center + plan.offset;
            if p.y > 104.0 && p.y < 107.0 && (p.x - 110.1).abs() < 0.9 {
                in_slot += 1;
                let half_mm = ELLIPSE.extent_mm(placement.at.heading_rad, Vector2::x());
                let reach_mm = (p.x - 110.1).abs() - half_mm;
                // The price of turning lets a heading miss its width by 0.05 b = 0.01 mm, and where the slot
                // begins the profile lags by as much again and half.
                assert!(reach_mm > -0.025, "{p} crosses the middle by {reach_mm}");
            }
        }
        assert!(in_slot > 20, "{in_slot}");
        let on_middle = |p: &Point2| (p.x + plan.offset.x - 110.1).abs() < 1e-4;
        let along = plan
            .axis
            .iter()
            .filter(|[p, q]| on_middle(p) && on_middle(q));
        let length_mm: f64 = along.map(|[p, q]| (q - p).norm()).sum();
        assert!(length_mm > 3.0, "{length_mm}");
    }

    /// Goal: a loop cut open by a keep-out turns as little as one that is whole, wherever its seam
    /// lies. Method: no turn of more than 90° between neighbouring placements; nothing inside the
    /// keep-out.
    #[test]
    fn a_keep_out_opens_the_loops() {
        let part = vec![region(&[&[
            [0.0, 0.0],
            [20.0, 0.0],
            [20.0, 10.0],
            [0.0, 10.0],
        ]])];
        for clamp in [
            region(&[&[[9.0, -3.0], [11.0, -3.0], [11.0, 5.0], [9.0, 5.0]]]),
            region(&[&[[15.0, 4.0], [24.0, 4.0], [24.0, 6.0], [15.0, 6.0]]]),
        ] {
            let taken = [clamp.clone()];
            let plan = skirt_plan(&part, &taken, Point2::origin(), &settings(0, 2))
                .expect("axis")
                .expect("loops");
            assert!((1..=2).contains(&plan.passes.len()), "linked or not");
            for pass in &plan.passes {
                for pair in pass.placements.windows(2) {
                    let turn_rad = pair[1].at.heading_rad - pair[0].at.heading_rad;
                    assert!(turn_rad.abs() < 1.6, "{turn_rad}");
                }
                let center = |p: &Placement| p.at.center + plan.offset;
                assert!(pass.placements.iter().all(|p| !clamp.contains(center(p))));
            }
        }
    }

    #[test]
    fn none_are_planned_where_none_are_asked_for() {
        let found = skirt_plan(&slotted(), &[], Point2::origin(), &settings(0, 0));
        assert!(found.expect("no axis needed").is_none());
    }
}
