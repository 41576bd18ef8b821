//! The exact F(p) against the published dense search over 8 million configurations.
//!
//! Goal: the same answers within the grid. Method: (1) every heading of F(p) has a configuration of
//! the grid next to it that the search must find; (2) a heading that the search finds beyond F(p)
//! must be feasible for an aperture smaller by the grid's slack that touches the boundary nearby
//! (on a grid "touches p" cannot be told from "touches next to p").

use headway::geometry::Point2;
use headway::geometry::aperture::Aperture;
use headway::geometry::edge_index::EdgeIndex;
use headway::plan::feasible::{FeasibleAngles, feasible_angles};
use headway_tests::dense_search::{DenseSearch, SIDE};
use headway_tests::outlines::{example, region};

const A: f64 = 0.6;
const B: f64 = 0.2;
/// Side of the square of the grid: the centre lies within a of p.
const WINDOW_MM: f64 = 1.6;
/// How far along the boundary the search may mistake the place of contact: the aperture's flat
/// side stays within twice the slack (10 um) of a wall over sqrt(2 a²/b 2 slack) to each side.
const BESIDE_MM: f64 = 0.31;

fn ellipse(share: f64) -> Aperture {
    Aperture::Ellipse {
        major_mm: A * share,
        minor_mm: B * share,
    }
}

/// F at boundary points within reach of edge `number` at `t`, as (normal's angle, angles).
fn around(
    walls: &EdgeIndex,
    p: Point2,
    aperture: &Aperture,
    reach_mm: f64,
) -> Vec<(f64, FeasibleAngles)> {
    let mut found = Vec::new();
    for edge in walls.edges() {
        let pieces = (edge.length_mm() / 0.02).ceil().max(1.0) as usize;
        for k in 0..pieces {
            let q = edge.a + (edge.b - edge.a) * ((k as f64 + 0.5) / pieces as f64);
            if (q - p).norm() <= reach_mm {
                let n = edge.normal();
                found.push((n.y.atan2(n.x), feasible_angles(aperture, walls, q, n)));
            }
        }
    }
    found
}

#[test]
fn same_answers_within_the_grid() {
    let (mut found_both, mut beyond, mut shut) = (0, 0, 0);
    for (name, place) in [
        ("taper", 0.3),
        ("u-part", 0.62),
        ("letter", 0.45),
        ("bracket", 0.8),
    ] {
        let rings = example(name);
        let walls = EdgeIndex::of_region(&region(&rings), A);
        let number = (walls.edges().len() as f64 * place) as usize;
        let edge = walls.edges()[number];
        let (p, normal) = (edge.a + (edge.b - edge.a) * 0.37, edge.normal());
        let search = DenseSearch::new(&rings, [A, B], [p.x, p.y], WINDOW_MM);
        let dense = search.headings_at([p.x, p.y]);
        let exact = feasible_angles(&ellipse(1.0), &walls, p, normal);
        let smaller = ellipse((1.0 - search.slack_share()).powi(2));
        let nearby = around(&walls, p, &smaller, BESIDE_MM);
        let bin_rad = std::f64::consts::PI / SIDE as f64;
        for (heading, &count) in dense.iter().enumerate() {
            let alpha = search.heading_rad(heading) - normal.y.atan2(normal.x);
            if exact.contains_rad(alpha, 0.0) {
                found_both += 1;
                assert!(
                    count > 0,
                    "{name} at {p}: heading {heading} missed by the grid"
                );
            } else if count > 0 && !exact.contains_rad(alpha, bin_rad) {
                beyond += 1;
                let allowed = nearby.iter().any(|(normal_rad, angles)| {
                    angles.contains_rad(search.heading_rad(heading) - normal_rad, bin_rad)
                });
                assert!(
                    allowed,
                    "{name} at {p}: heading {heading} is feasible, {exact:?}"
                );
            } else {
                shut += usize::from(count == 0);
            }
        }
        println!("{name} at {p}: slack {:.1} um", search.slack_mm * 1e3);
    }
    println!("headings in both {found_both}, beyond but nearby {beyond}, in neither {shut}");
    assert!(found_both > 200 && shut > 50, "{found_both} {shut}");
}
