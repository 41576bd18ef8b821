//! Goal: the axis and its radii are the polygon's. Method: shapes with known axes, and distances
//! to the nearest edge.

use super::*;
use crate::geometry::polygon::Region;
use crate::geometry::test_shapes::{random_numbers, region, star};
use crate::plan::outline::contour::{Contour, SIMPLIFY_MM};

fn axis_of(region: &Region) -> (MedialAxis, EdgeIndex) {
    let index = Contour::of_region(region, SIMPLIFY_MM)
        .unwrap()
        .edge_index(0.6);
    (
        MedialAxis::of_edges(&index, &AxisOptions::default()).unwrap(),
        index,
    )
}

fn gear(teeth: usize, radius_mm: f64, noise_mm: f64) -> Region {
    let mut random = random_numbers(1);
    let count = teeth * 24;
    let points = star(count, |i| {
        let wave = (i as f64 * std::f64::consts::TAU / 24.0).sin().tanh();
        radius_mm + 1.2 * wave + noise_mm * (random() - 0.5)
    });
    region(&[&points])
}

/// Goal: every point of the axis is what it says. Method: radius against the nearest edge, feet on
/// the boundary at that distance, over a gear, a plate with a hole and a comb.
#[test]
fn radii_and_feet_agree_with_the_boundary() {
    let comb: Vec<[f64; 2]> = (0..40)
        .flat_map(|i| {
            let x = i as f64;
            [
                [x + 0.4, 8.0],
                [x + 0.4, 1.0],
                [x + 0.8, 1.0],
                [x + 0.8, 8.0],
            ]
        })
        .rev()
        .chain([[0.0, 8.0], [0.0, 0.0], [41.0, 0.0], [41.0, 8.0]])
        .collect();
    let plate = region(&[
        &[[0.0, 0.0], [20.0, 0.0], [20.0, 10.0], [0.0, 10.0]],
        &[[5.0, 5.0], [6.0, 6.0], [7.0, 5.0], [6.0, 4.0]],
    ]);
    for region in [gear(20, 20.0, 0.0), plate, region(&[&comb])] {
        let (axis, index) = axis_of(&region);
        assert_eq!(axis.dropped_edges, 0);
        assert!(axis.edges.len() > 10);
        for edge in &axis.edges {
            for p in &edge.points {
                let nearest = index.nearest(p.point).unwrap().distance_mm;
                assert!((nearest - p.radius_mm).abs() < 1e-3, "{nearest} {p:?}");
                for foot in p.feet {
                    assert!(
                        ((foot - p.point).norm() - p.radius_mm).abs() < 1e-3,
                        "{p:?}"
                    );
                    assert!(index.nearest(foot).unwrap().distance_mm < 2e-4);
                }
            }
        }
    }
}

/// Goal: the axis has the region's topology: connected, with one independent loop for each hole.
/// Method: vertices - edges + loops = 1.
#[test]
fn topology_is_the_regions() {
    let plate = region(&[
        &[[0.0, 0.0], [30.0, 0.0], [30.0, 10.0], [0.0, 10.0]],
        &[[5.0, 5.0], [6.0, 6.0], [7.0, 5.0], [6.0, 4.0]],
        &[[15.0, 3.0], [15.0, 7.0], [22.0, 7.0], [22.0, 3.0]],
    ]);
    for (region, holes) in [(plate, 2i64), (gear(12, 10.0, 0.02), 0)] {
        let (axis, _) = axis_of(&region);
        let (vertices, edges) = (axis.vertices.len() as i64, axis.edges.len() as i64);
        assert_eq!(vertices - edges + holes, 1);
        // Connected: chains reach every vertex from the first.
        let mut seen = vec![false; axis.vertices.len()];
        let mut stack = vec![0];
        seen[0] = true;
        while let Some(v) = stack.pop() {
            for &e in &axis.adjacency[v] {
                for next in [axis.edges[e].v0, axis.edges[e].v1] {
                    if !std::mem::replace(&mut seen[next], true) {
                        stack.push(next);
                    }
                }
            }
        }
        assert!(seen.iter().all(|s| *s));
    }
}

/// Goal: the axes that everybody would draw. Method: rectangle (the spine alone), square (its
/// middle), ring (a closed chain), wedge (reaches into the tip).
#[test]
fn axes_of_simple_shapes() {
    let options = PruneOptions::default();
    let (axis, _) = axis_of(&region(&[&[
        [0.0, 0.0],
        [20.0, 0.0],
        [20.0, 4.0],
        [0.0, 4.0],
    ]]));
    let pruned = axis.pruned(&options);
    let chains = pruned.chains();
    assert_eq!(chains.len(), 1);
    assert!((chains[0].length_mm() - 16.0).abs() < 1e-3);
    assert!(
        chains[0]
            .points
            .iter()
            .all(|p| (p.radius_mm - 2.0).abs() < 1e-3)
    );
    assert_eq!(pruned.vertices.len(), 2);

    let (axis, _) = axis_of(&region(&[&[
        [0.0, 0.0],
        [4.0, 0.0],
        [4.0, 4.0],
        [0.0, 4.0],
    ]]));
    let pruned = axis.pruned(&options);
    assert!(pruned.edges.is_empty());
    assert_eq!(pruned.vertices.len(), 1);
    assert!((pruned.vertices[0].radius_mm - 2.0).abs() < 1e-3);

    let circle = |r: f64, turn: f64| -> Vec<[f64; 2]> {
        (0..90)
            .map(|i| {
                let (sin, cos) = (turn * i as f64 * std::f64::consts::TAU / 90.0).sin_cos();
                [r * cos, r * sin]
            })
            .collect()
    };
    let (axis, _) = axis_of(&region(&[&circle(10.0, 1.0), &circle(7.0, -1.0)]));
    let pruned = axis.pruned(&options);
    let chains = pruned.chains();
    assert_eq!(chains.len(), 1);
    assert!(chains[0].closed);
    assert!((chains[0].length_mm() - 8.5 * std::f64::consts::TAU).abs() < 0.2);

    let (axis, _) = axis_of(&region(&[&[[0.0, 0.0], [20.0, 3.0], [0.0, 6.0]]]));
    let pruned = axis.pruned(&options);
    assert_eq!(pruned.chains().len(), 1);
    let tip = pruned
        .vertices
        .iter()
        .map(|v| v.point.x)
        .fold(f64::MIN, f64::max);
    assert!(
        (tip - 10.0).abs() < 1e-3,
        "the tip, about the box centre: {tip}"
    );
}

/// Goal: invisible noise leaves the pruned axis as it is. Method: total length with and without
/// noise of 20 µm.
#[test]
fn noise_leaves_the_axis() {
    let options = PruneOptions {
        radius_min_mm: 0.18,
        ..PruneOptions::default()
    };
    let length_mm = |noise_mm: f64| {
        let (axis, _) = axis_of(&gear(12, 20.0, noise_mm));
        let pruned = axis.pruned(&options);
        let total: f64 = pruned.edges.iter().map(AxisEdge::length_mm).sum();
        (total, pruned.chains().len(), pruned.vertices.len())
    };
    let (clean, noisy) = (length_mm(0.0), length_mm(0.02));
    println!("{clean:?} {noisy:?}");
    assert!(
        (clean.0 - noisy.0).abs() <= 0.05 * clean.0.max(1.0),
        "{clean:?} {noisy:?}"
    );
}

/// Goal: outlines of thousands of edges have their axis. Method: a gear of 5,000.
#[test]
fn five_thousand_edges_have_an_axis() {
    let region = gear(208, 60.0, 0.0);
    assert!(axis_of(&region).0.edges.len() > 4_000);
}

/// Goal: valid but nasty input gives an axis that is right wherever it claims to be. Method: a hole
/// that touches the exterior in a point, two holes 50 nm apart, a spike of 1 µm, a part far larger
/// than the grid's finest unit can hold; every radius against the nearest edge.
#[test]
fn nasty_but_valid() {
    let square: &[[f64; 2]] = &[[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]];
    let cases = [
        region(&[square, &[[5.0, 0.0], [6.0, 2.0], [4.0, 2.0]]]),
        region(&[
            square,
            &[[2.0, 2.0], [2.0, 4.0], [4.0, 4.0], [4.0, 2.0]],
            &[[4.00005, 2.0], [4.00005, 4.0], [6.0, 4.0], [6.0, 2.0]],
        ]),
        region(&[&[
            [0.0, 0.0],
            [5.0, 0.0],
            [5.0005, 8.0],
            [5.001, 0.0],
            [9.0, 0.0],
            [4.0, 9.0],
        ]]),
        region(&[&[[0.0, 0.0], [3e5, 0.0], [3e5, 1e5], [1.5e5, 5e4], [0.0, 1e5]]]),
    ];
    for (number, region) in cases.iter().enumerate() {
        let (axis, index) = axis_of(region);
        let size = index.bounds().size().norm();
        println!(
            "case {number}: {} edges, {} dropped",
            axis.edges.len(),
            axis.dropped_edges
        );
        assert!(axis.edges.len() >= 5);
        for p in axis.edges.iter().flat_map(|e| &e.points) {
            let nearest = index.nearest(p.point).unwrap().distance_mm;
            assert!(
                (nearest - p.radius_mm).abs() < 2e-3 + 1e-8 * size,
                "{number} {nearest} {p:?}"
            );
        }
        assert!(!axis.pruned(&PruneOptions::default()).vertices.is_empty());
    }
}
