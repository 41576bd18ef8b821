//! Checks of the medial axis on examples and real slices that share nothing with how it is made:
//! Euler's formula, and the closed-form r(p) whose disk centres must lie on it.

use headway::geometry::Point2;
use headway::geometry::polygon::{Region, Ring};
use headway::geometry::tangent_disk::tangent_disk_radius_mm;
use headway::plan::axis::medial_axis::{AxisOptions, MedialAxis, PruneOptions};
use headway::plan::outline::contour::{Contour, SIMPLIFY_MM};
use headway_tests::folders::files;

/// Example shapes, then the valid reference slices where they are there.
fn regions() -> Vec<(String, Region)> {
    let root = env!("CARGO_MANIFEST_DIR");
    let mut regions = Vec::new();
    for folder in [
        "../examples",
        "../../shared/data/slices",
        "../../shared/data/peer",
    ] {
        for path in files(format!("{root}/{folder}"), "json") {
            let text = std::fs::read_to_string(&path).expect("readable");
            let json: serde_json::Value = serde_json::from_str(&text).expect("JSON");
            if json["valid"] == false {
                continue;
            }
            let ring = |value: &serde_json::Value| -> Ring {
                let points: Vec<[f64; 2]> = serde_json::from_value(value.clone()).expect("ring");
                Ring {
                    points: points.into_iter().map(Point2::from).collect(),
                }
            };
            let region = Region {
                exterior: ring(&json["exterior"]),
                holes: json["holes"]
                    .as_array()
                    .expect("holes")
                    .iter()
                    .map(ring)
                    .collect(),
            };
            regions.push((path.display().to_string(), region));
        }
    }
    assert!(regions.len() >= 6);
    regions
}

/// Goal: right on everything real. Method: nothing dropped; vertices - edges = 1 - holes (less the
/// joining of touching rings, which none here has); centres of tangent disks at edge middles lie on
/// the axis within 3 µm (1 µm of flattening, the rest the diagram's grid) with the same radius.
#[test]
fn axis_agrees_with_tangent_disks() {
    let (mut spent_s, mut edges, mut checked) = (0.0, 0, 0);
    for (name, region) in regions() {
        let contour = Contour::of_region(&region, SIMPLIFY_MM).expect("a contour");
        let index = contour.edge_index(0.6);
        let started = std::time::Instant::now();
        let axis = MedialAxis::of_edges(&index, &AxisOptions::default()).expect("an axis");
        let pruned = axis.pruned(&PruneOptions::default());
        let one_s = started.elapsed().as_secs_f64();
        spent_s += one_s;
        edges += index.edges().len();
        if one_s > 0.2 {
            println!("{name}: {} edges in {one_s:.3} s", index.edges().len());
        }
        assert_eq!(axis.dropped_edges, 0, "{name}");
        let euler = axis.vertices.len() as i64 - axis.edges.len() as i64;
        assert_eq!(euler, 1 - contour.region.holes.len() as i64, "{name}");
        assert!(!pruned.vertices.is_empty(), "{name}");
        let (segments, radii_mm) = axis.segment_index(0.6);
        for edge in index.edges() {
            let p = edge.a + (edge.b - edge.a) * 0.5;
            let radius_mm = tangent_disk_radius_mm(&index, p, edge.normal());
            let center = p + edge.normal() * radius_mm;
            let nearest = segments.nearest(center).expect("a segment");
            assert!(
                nearest.distance_mm < 3e-3,
                "{name}: {p} {radius_mm} {nearest:?}"
            );
            let [r0, r1] = radii_mm[nearest.edge];
            assert!(
                r0.min(r1) - 5e-3 < radius_mm && radius_mm < r0.max(r1) + 5e-3,
                "{name}: {radius_mm} {r0} {r1}"
            );
            checked += 1;
        }
    }
    println!("{checked} disks, {edges} edges, axis and pruned in {spent_s:.2} s");
    assert!(checked > 400);
}
