//! Goal: the regions of a layer are the ground that its beads fill, and other beads stay lines in their order. Method: beads of
//! squares as a slicer lays them, by a few lines of their own; areas, corners and volumes by hand.

use super::regions::{Parts, parts};
use crate::gcode::comments::Slicer;
use crate::gcode::{BeadKind, GcodePass, Leg, Place};
use std::f64::consts::FRAC_PI_4;

const WIDTH_MM: f64 = 0.45;
const HEIGHT_MM: f64 = 0.2;
/// From line to line of solid ground: what a bead of round sides is wide at its mean.
const SPACING_MM: f64 = WIDTH_MM - HEIGHT_MM * (1.0 - FRAC_PI_4);

/// A pass through these points.
fn pass(points: &[[f64; 3]], kinds: &[BeadKind]) -> GcodePass {
    let place = |tip_mm: &[f64; 3]| Place {
        tip_mm: *tip_mm,
        turn_deg: [0.0; 3],
    };
    let points: Vec<Place> = points.iter().map(place).collect();
    let legs = points.windows(2).enumerate().map(|(k, pair)| Leg {
        line: 1,
        speed_mm_s: 60.0,
        width_mm: Some(WIDTH_MM),
        height_mm: Some(HEIGHT_MM),
        volume_mm3: Some(SPACING_MM * HEIGHT_MM * pair[1].distance_mm(&pair[0])),
        is_inside: false,
        kind: kinds[k % kinds.len()],
    });
    GcodePass {
        legs: legs.collect(),
        points,
        ..GcodePass::default()
    }
}

/// A square loop inside the one from `low` to `high`, with a gap at its seam.
fn square(low: f64, high: f64, inset_mm: f64, kind: BeadKind) -> GcodePass {
    let (a, b) = (low + inset_mm, high - inset_mm);
    let seam = a + 0.2;
    let corners = [[a, a], [b, a], [b, b], [a, b], [a, seam]];
    pass(&corners.map(|[x, y]| [x, y, HEIGHT_MM]), &[kind])
}

/// Parallel lines across the square, each a pass.
fn lines(low: f64, high: f64, step_mm: f64, kind: BeadKind) -> Vec<GcodePass> {
    let count = ((high - low) / step_mm).round() as usize;
    let line = |k: usize| {
        let y = low + (k as f64 + 0.5) * (high - low) / count as f64;
        pass(&[[low, y, HEIGHT_MM], [high, y, HEIGHT_MM]], &[kind])
    };
    (0..count).map(line).collect()
}

/// Two walls of a square of 20 mm and what is inside them.
fn filled(step_mm: f64, kind: BeadKind) -> Vec<GcodePass> {
    let mut passes = vec![
        square(0.0, 20.0, 0.5 * WIDTH_MM + SPACING_MM, BeadKind::Wall),
        square(0.0, 20.0, 0.5 * WIDTH_MM, BeadKind::OuterWall),
    ];
    let inset_mm = 0.5 * WIDTH_MM + 1.5 * SPACING_MM;
    passes.extend(lines(inset_mm, 20.0 - inset_mm, step_mm, kind));
    passes
}

/// Solid ground is one region with the corners of the square, whatever its lines are called, and lays its area times its
/// height; its beads are all of them.
#[test]
fn solid_ground_is_one_region() {
    for kind in [BeadKind::Solid, BeadKind::Sparse] {
        let passes = filled(SPACING_MM, kind);
        let parts = parts(&passes, 0, Slicer::PrusaSlicer);
        let Parts {
            grounds: found,
            kept,
        } = parts;
        assert_eq!((found.len(), kept.len()), (1, 0), "{kind:?}");
        let region = &found[0].region;
        let bounds = region.bounds();
        for (found, wanted) in [(bounds.min, 0.0), (bounds.max, 20.0)] {
            // The grid of the offsets, and widths in hundredths.
            assert!((found.x - wanted).abs() < 1e-6 && (found.y - wanted).abs() < 1e-6);
        }
        assert_eq!(region.holes.len(), 0);
        assert!(
            (region.area_mm2() - 400.0).abs() < 1e-4,
            "{}",
            region.area_mm2()
        );
        let share = found[0].volume_mm3 / (region.area_mm2() * HEIGHT_MM);
        assert!((share - 1.0).abs() < 0.01, "{share}");
        assert!(found[0].covered_pct > 96.0, "{}", found[0].covered_pct);
        assert_eq!(found[0].runs.len(), passes.len());
    }
}

/// Around a sparse infill the walls are a ring as wide as they are, and its lines stay lines behind it.
#[test]
fn walls_around_a_sparse_infill_are_a_ring() {
    let passes = filled(3.0, BeadKind::Sparse);
    let parts = parts(&passes, 0, Slicer::PrusaSlicer);
    let Parts {
        grounds: found,
        kept,
    } = parts;
    assert_eq!((found.len(), kept.len()), (1, passes.len() - 2));
    let inner_mm = 20.0 - 2.0 * (WIDTH_MM + SPACING_MM);
    let ring_mm2 = 400.0 - inner_mm * inner_mm;
    // Round corners of the swept inner edge take nothing from the ring; voids at line ends add a little.
    let area_mm2 = found[0].region.area_mm2();
    assert!(
        (area_mm2 / ring_mm2 - 1.0).abs() < 0.01,
        "{area_mm2} {ring_mm2}"
    );
    assert_eq!(found[0].region.holes.len(), 1);
}

/// A hole is as large as its outer wall says, and a wall over open space is taken out.
#[test]
fn holes_and_overhangs_bound_a_region() {
    let mut passes = filled(SPACING_MM, BeadKind::Solid);
    // Lines that would cross the hole end before it in a slicer's file: here they are cut.
    let half = 0.5 * WIDTH_MM;
    passes.retain(|pass| pass.legs[0].kind != BeadKind::Solid);
    let [low, high] = [half + 1.5 * SPACING_MM, 20.0 - half - 1.5 * SPACING_MM];
    for line in lines(low, high, SPACING_MM, BeadKind::Solid) {
        let y = line.points[0].tip_mm[1];
        if (y - 10.0).abs() > 2.0 + 1.5 * WIDTH_MM {
            passes.push(line);
            continue;
        }
        for [from, to] in [[low, 8.0 - WIDTH_MM], [12.0 + WIDTH_MM, high]] {
            passes.push(pass(
                &[[from, y, HEIGHT_MM], [to, y, HEIGHT_MM]],
                &[BeadKind::Solid],
            ));
        }
    }
    passes.push(square(8.0, 12.0, -half, BeadKind::OuterWall));
    let found = parts(&passes, 0, Slicer::PrusaSlicer);
    let area_mm2 = found.grounds[0].region.area_mm2();
    assert!((area_mm2 - 384.0).abs() < 1e-3, "{area_mm2}");
    let [wall, hanging] = [BeadKind::OuterWall, BeadKind::Overhang];
    let whole = square(0.0, 20.0, half, wall);
    let points: Vec<[f64; 3]> = whole.points.iter().map(|place| place.tip_mm).collect();
    passes[1] = pass(&points, &[hanging, wall, wall, wall]);
    let found = parts(&passes, 0, Slicer::PrusaSlicer);
    let taken_mm2 = area_mm2 - found.grounds[0].region.area_mm2();
    assert!(
        (taken_mm2 - WIDTH_MM * (20.0 - WIDTH_MM)).abs() < 0.3,
        "{taken_mm2}"
    );
    assert_eq!((found.grounds.len(), found.kept.len()), (1, 1));
    let legs = &found.kept[0].pass.legs;
    assert!(legs.iter().all(|leg| leg.kind == hanging));
}

/// Rough outer walls stay lines, what is inside them is a region.
#[test]
fn fuzzy_walls_stay_lines() {
    let mut passes = filled(SPACING_MM, BeadKind::Solid);
    let legs = passes.iter_mut().flat_map(|pass| &mut pass.legs);
    let outer = legs.filter(|leg| leg.kind == BeadKind::OuterWall);
    outer.for_each(|leg| leg.kind = BeadKind::FuzzyWall);
    let found = parts(&passes, 0, Slicer::PrusaSlicer);
    assert_eq!((found.grounds.len(), found.kept.len()), (1, 1));
    assert_eq!(found.kept[0].pass.legs[0].kind, BeadKind::FuzzyWall);
    let inside_mm = 20.0 - 2.0 * SPACING_MM;
    let area_mm2 = found.grounds[0].region.area_mm2();
    // Its corners are round.
    assert!(
        (area_mm2 / (inside_mm * inside_mm) - 1.0).abs() < 2e-3,
        "{area_mm2}"
    );
}

/// What rises, is a single bead, or has no kind is no region.
#[test]
fn other_beads_stay_lines() {
    let rising = [
        [0.0, 0.0, 0.2],
        [10.0, 0.0, 0.25],
        [10.0, 10.0, 0.3],
        [0.0, 10.0, 0.35],
        [0.0, 0.1, 0.4],
    ];
    let flat = [[0.0, 0.0, 0.2], [10.0, 0.0, 0.2]];
    let passes = [
        pass(&rising, &[BeadKind::OuterWall]),
        pass(&flat, &[BeadKind::Wall]),
        pass(&flat, &[BeadKind::Unknown]),
        square(0.0, 8.0, 0.0, BeadKind::Support),
    ];
    let found = parts(&passes, 0, Slicer::PrusaSlicer);
    assert_eq!((found.grounds.len(), found.kept.len()), (0, passes.len()));
    for (run, pass) in found.kept.iter().zip(&passes) {
        assert_eq!(run.pass.points, pass.points);
    }
}
