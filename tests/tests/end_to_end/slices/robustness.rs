//! Outlines with weak places, planned whole: nothing hangs, panics or leaves the outline, and noise
//! that no eye can see does not change the plan.

use headway::geometry::validity::validate;
use headway::input::Target;
use headway::plan::axis::medial_axis::{AxisOptions, MedialAxis};
use headway::plan::axis::pruned_axis::Axis;
use headway::plan::judge::figures::PlanFigures;
use headway::plan::outline::contour::{Contour, SIMPLIFY_MM};
use headway::plan_target;
use headway::settings::{Quality, Settings};
use headway_tests::layer_oracle::Rings;
use headway_tests::outlines::{
    drawn_ring, example, fine_ring, plate_with_holes, region, with_noise,
};
use rayon::prelude::*;

/// Passes, printed length, covered share of what is reachable, outside depth.
fn planned(name: &str, rings: &Rings) -> (usize, f64, f64, f64) {
    let f = figures(name, rings);
    (
        f.passes,
        f.print_mm,
        f.covered_of_reachable_pct,
        f.outside_depth_mm,
    )
}

fn figures(name: &str, rings: &Rings) -> PlanFigures {
    let shape = region(rings);
    assert_eq!(
        validate(&shape),
        Ok(()),
        "{name}: the case itself must be valid"
    );
    let target = Target {
        name: name.to_string(),
        regions: vec![shape],
    };
    let plan = plan_target(&target, &Settings::default()).unwrap_or_else(|e| panic!("{name}: {e}"));
    let f = &plan.figures;
    println!(
        "{name}: {} passes, {:.2} mm, covered {:.2} % of reachable, overlap {:.2} %, outside {:.2} um",
        f.passes,
        f.print_mm,
        f.covered_of_reachable_pct,
        f.overlap_pct,
        f.outside_depth_mm * 1e3
    );
    assert!(f.outside_depth_mm <= 0.002, "{name}: {f:?}");
    plan.figures
}

/// An L-shaped part, its edges divided every 0.2 mm and moved by noise.
fn noisy_l(noise_mm: f64) -> Rings {
    let corners = [
        [0.0, 0.0],
        [20.0, 0.0],
        [20.0, 7.0],
        [8.0, 7.0],
        [8.0, 16.0],
        [0.0, 16.0],
    ];
    with_noise(&vec![corners.to_vec()], noise_mm, 3)
}

/// Slits, spikes and walls that nearly touch, on a plate of 16 x 10 mm.
fn weak_places() -> Vec<(String, Rings)> {
    let mut cases = Vec::new();
    for gap_mm in [5e-4, 2e-3, 0.02, 0.3] {
        let half = gap_mm / 2.0;
        let slit = vec![
            [0.0, 0.0],
            [8.0 - half, 0.0],
            [8.0 - half, 7.0],
            [8.0 + half, 7.0],
            [8.0 + half, 0.0],
            [16.0, 0.0],
            [16.0, 10.0],
            [0.0, 10.0],
        ];
        cases.push((format!("slit of {gap_mm} mm"), vec![slit]));
        let spike = vec![
            [0.0, 0.0],
            [16.0, 0.0],
            [16.0, 10.0],
            [8.0 + half, 10.0],
            [8.0, 14.0],
            [8.0 - half, 10.0],
            [0.0, 10.0],
        ];
        cases.push((format!("spike of {gap_mm} mm"), vec![spike]));
        let plate = vec![[0.0, 0.0], [16.0, 0.0], [16.0, 10.0], [0.0, 10.0]];
        let hole = vec![[3.0, gap_mm], [3.0, 6.0], [9.0, 6.0], [9.0, gap_mm]];
        cases.push((
            format!("hole {gap_mm} mm from the wall"),
            vec![plate.clone(), hole],
        ));
        let low = vec![
            [3.0, 2.0],
            [3.0, 5.0 - half],
            [13.0, 5.0 - half],
            [13.0, 2.0],
        ];
        let high = vec![
            [3.0, 5.0 + half],
            [3.0, 8.0],
            [13.0, 8.0],
            [13.0, 5.0 + half],
        ];
        cases.push((format!("holes {gap_mm} mm apart"), vec![plate, low, high]));
    }
    // Squares that overlap at a corner: no bead goes through the neck, each side takes the nozzle.
    for (side_mm, neck_mm) in [(1.2, 0.1), (1.2, 0.39), (4.0, 0.31)] {
        let from_mm = side_mm - neck_mm / 2.0_f64.sqrt();
        let to_mm = from_mm + side_mm;
        let squares = vec![
            [0.0, 0.0],
            [side_mm, 0.0],
            [side_mm, from_mm],
            [to_mm, from_mm],
            [to_mm, to_mm],
            [from_mm, to_mm],
            [from_mm, side_mm],
            [0.0, side_mm],
        ];
        let name = format!("neck of {neck_mm} mm between squares of {side_mm} mm");
        cases.push((name, vec![squares]));
    }
    cases
}

#[test]
fn weak_places_are_planned() {
    weak_places().par_iter().for_each(|(name, rings)| {
        let (_, _, covered_pct, _) = planned(name, rings);
        assert!(covered_pct > 85.0, "{name}");
    });
}

/// A ring keeps its passes under noise up to 20 um, its length within 0.1 %, its coverage within
/// 0.4 (99.93 without noise, 99.59 with 20 um, whose teeth no nozzle enters); a part with corners its
/// passes, its length within 2 %, its coverage within 0.3.
#[test]
fn invisible_noise_changes_little() {
    let found: Vec<_> = [0.0, 0.001, 0.005, 0.02]
        .par_iter()
        .map(|&mm| planned(&format!("ring with {mm} mm of noise"), &fine_ring(2000, mm)))
        .collect();
    let own = found[0];
    for f in &found {
        assert_eq!(f.0, own.0, "{found:?}");
        assert!((f.1 / own.1 - 1.0).abs() < 1e-3, "{found:?}");
        assert!((f.2 - own.2).abs() < 0.4, "{found:?}");
    }
    let [own, noisy] = [0.0, 0.005].map(|mm| planned("L with noise", &noisy_l(mm)));
    assert_eq!(noisy.0, own.0, "{own:?} {noisy:?}");
    assert!((noisy.1 / own.1 - 1.0).abs() < 0.02, "{own:?} {noisy:?}");
    assert!((noisy.2 - own.2).abs() < 0.3, "{own:?} {noisy:?}");
}

/// Goal: a room behind a neck that the aperture does not pass is printed, though no run in it is long.
/// Method: a bar with such a room on it, 0.5 mm wide with corners of 0.2 mm, and one as a lattice from
/// topology optimisation has it, 0.7 mm at its widest; both stayed empty once (91.0 and 89.6 %).
#[test]
fn a_small_room_behind_a_neck_is_printed() {
    let square = [
        [0.0, 0.0],
        [7.0, 0.0],
        [7.0, 1.2],
        [3.15, 1.2],
        [3.15, 1.5],
        [3.25, 1.7],
        [3.25, 2.7],
        [3.05, 2.9],
        [2.9, 2.9],
        [2.75, 2.65],
        [2.75, 1.7],
        [2.85, 1.5],
        [2.85, 1.2],
        [0.0, 1.2],
    ];
    let egg = [
        [3.13, 0.29],
        [3.46, 0.26],
        [3.555, 0.46],
        [3.57, 0.63],
        [3.56, 0.84],
        [3.525, 1.28],
        [3.57, 1.45],
        [3.61, 1.8],
        [3.65, 2.3],
        [7.0, 2.3],
        [7.0, 3.5],
        [0.0, 3.5],
        [0.0, 2.3],
        [3.3, 2.3],
        [3.295, 1.8],
        [3.285, 1.765],
        [3.21, 1.69],
        [3.145, 1.53],
        [3.075, 1.38],
        [3.01, 1.21],
        [2.94, 1.05],
        [2.87, 0.89],
        [2.885, 0.73],
        [2.89, 0.57],
    ];
    for (name, ring) in [("square", square.to_vec()), ("egg", egg.to_vec())] {
        let found = figures(name, &vec![ring]);
        assert_eq!(found.passes, 2, "{name}");
        // Beads end where going on would lay as much twice as it covers: what is open and half of what is laid twice
        // count. The egg's was 3.9 with ends that stayed (97.2 % covered), and is 3.5 with ends that move (96.8).
        let lost_pct = 100.0 - found.covered_of_reachable_pct + 0.5 * found.overlap_pct;
        assert!(lost_pct < 3.7, "{name}: {found:?}");
    }
}

/// Goal: where a web meets a plate, no channel of the plate is wider than the widest bead (with the
/// bead count of the web's end the next channel lay 1.8 mm further in: overlap 7.3 %). Method: the
/// shipped part.
#[test]
fn a_web_does_not_widen_the_channels_of_its_plates() {
    let target = Target {
        name: "thin-web".to_string(),
        regions: vec![region(&example("thin-web"))],
    };
    let settings = Settings {
        quality: Quality::Fine,
        ..Settings::default()
    };
    let figures = plan_target(&target, &settings).expect("a plan").figures;
    assert!(figures.covered_of_reachable_pct > 99.3, "{figures:?}");
    assert!(figures.overlap_pct < 2.5, "{figures:?}");
}

/// Goal: noise on edges far shorter than the nozzle is no row of corners to swing around (the head
/// went eighteen times as far, at 26 % overlap). Method: a ring of 40,000 edges of 8 um with 5 um of
/// noise, against the same without.
#[test]
fn fine_noise_is_not_a_row_of_corners() {
    let own = planned("ring", &fine_ring(2000, 0.0));
    let noisy = planned("ring of fine noise", &fine_ring(40_000, 0.005));
    assert!((noisy.1 / own.1 - 1.0).abs() < 0.01, "{noisy:?} {own:?}");
    assert!(noisy.2 > own.2 - 0.3, "{noisy:?} {own:?}");
    assert_eq!(noisy.0, own.0);
}

/// Goal: teeth of noise, sharp as they are, are no arms of the part (each kept its branch of the
/// axis as far as the middle, and a third of the ring was covered). Method: rings whose noise of
/// 5 um is higher than their edges are long, against the same without.
#[test]
fn teeth_of_noise_are_no_arms() {
    let rings = [
        ([8.0, 5.0], 20_000),
        ([15.0, 12.5], 50_000),
        ([30.0, 25.0], 100_000),
    ];
    for (radii_mm, edges) in rings {
        let own = planned("ring", &drawn_ring(radii_mm, 2000, 0.0));
        let noisy = planned("ring of teeth", &drawn_ring(radii_mm, edges, 0.005));
        assert_eq!(noisy.0, own.0, "{noisy:?} {own:?}");
        assert!((noisy.1 / own.1 - 1.0).abs() < 0.01, "{noisy:?} {own:?}");
        assert!(noisy.2 > own.2 - 0.3, "{noisy:?} {own:?}");
    }
}

/// Goal: on edges that the diagram's grid turns by whole degrees no part of the axis is doubted (each
/// angle of the grid was tried in vain and a piece of the axis left out). Method: edges of 2 um.
#[test]
fn the_axis_of_teeth_is_whole() {
    let shape = region(&drawn_ring([8.0, 5.0], 40_000, 0.005));
    let contour = Contour::of_region(&shape, SIMPLIFY_MM).expect("contour");
    let walls = contour.edge_index(0.6);
    let axis = MedialAxis::of_edges(&walls, &AxisOptions::default()).expect("axis");
    assert_eq!(axis.dropped_edges, 0);
    let axis = Axis::of_medial_axis(&axis, &Settings::default().aperture);
    assert!(axis.points.len() > 1000);
    assert!(axis.neighbours().iter().all(|near| near.len() == 2));
}

/// A thousand holes: contour and axis, each hole with its loop.
#[test]
fn a_thousand_holes() {
    let rings = plate_with_holes(1000);
    let shape = region(&rings);
    assert_eq!(validate(&shape), Ok(()));
    let contour = Contour::of_region(&shape, SIMPLIFY_MM).expect("contour");
    assert_eq!(contour.region.holes.len(), 1000);
    let walls = contour.edge_index(0.6);
    let axis = MedialAxis::of_edges(&walls, &AxisOptions::default()).expect("axis");
    assert_eq!(axis.dropped_edges, 0);
    // Euler: a connected graph with a loop round each hole.
    assert_eq!(axis.edges.len() + 1 - axis.vertices.len(), 1000);
}
