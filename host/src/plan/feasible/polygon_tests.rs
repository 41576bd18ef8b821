//! Goal: F(p) of slots, rectangles and polygons agrees with the clearance query, and the slides
//! along flat sides are right. Method: random stars with a fine sweep of alpha; closed forms.

use crate::geometry::aperture::Aperture;
use crate::geometry::clearance::{outside_depth_mm, scaled_clearance};
use crate::geometry::rounded_polygon::RoundedPolygon;
use crate::geometry::test_shapes::{SQUARE, drop_corners, random_numbers, star, walls};
use crate::geometry::{Point2, Vector2};
use crate::plan::feasible::{configuration_at, feasible_angles};
use std::f64::consts::{FRAC_PI_2, PI};

fn slot() -> Aperture {
    Aperture::Rounded(RoundedPolygon::stadium(1.2, 0.4))
}

fn rectangle(radius_mm: f64) -> Aperture {
    Aperture::Rounded(RoundedPolygon::rectangle(1.2, 0.4, radius_mm))
}

fn drop() -> Aperture {
    Aperture::Rounded(RoundedPolygon::polygon(&drop_corners()).expect("a drop"))
}

#[test]
fn agrees_with_clearance() {
    let mut random = random_numbers(5);
    for aperture in [slot(), rectangle(0.1), rectangle(0.0), drop()] {
        let (mut inside, mut outside, mut border) = (0, 0, 0);
        for _ in 0..8 {
            let star = walls(&[&star(40, |_| 1.5 + 2.5 * random())]);
            for edge in star.edges() {
                let p = edge.a + (edge.b - edge.a) * random();
                let angles = feasible_angles(&aperture, &star, p, edge.normal());
                let period = aperture.period_rad();
                for k in 0..180 {
                    let alpha = period * ((f64::from(k) + 0.5) / 180.0 - 0.5);
                    let at = configuration_at(&aperture, p, edge.normal(), alpha);
                    let clear = scaled_clearance(&aperture, at, &star, 2.0);
                    let feasible = clear >= 1.0 - 1e-7 && star.contains(at.center);
                    if feasible == angles.contains_rad(alpha, 1e-12) {
                        inside += u32::from(feasible);
                        outside += u32::from(!feasible);
                    } else {
                        border += 1;
                        assert!((clear - 1.0).abs() < 1e-6, "{alpha} {clear} {angles:?}");
                    }
                }
                // Every end of an interval, flats included, is a placement inside.
                for alpha in angles.intervals().iter().flatten() {
                    let at = angles.placement(&aperture, p, edge.normal(), *alpha);
                    let depth = outside_depth_mm(&aperture, at, &star);
                    assert!(depth < 1e-6, "{depth} {alpha} {angles:?}");
                }
            }
        }
        assert!(inside > 1000 && outside > 1000, "{inside} {outside}");
        assert!(border < 20, "{border}");
    }
}

/// A passage exactly as wide as the rectangle: it fits lying flat and no other way.
#[test]
fn flat_in_an_exact_passage() {
    let (p, up) = (Point2::new(15.0, 0.0), Vector2::y());
    let passage = |w: f64| walls(&[&[[0.0, 0.0], [30.0, 0.0], [30.0, w], [0.0, w]]]);
    let angles = feasible_angles(&rectangle(0.0), &passage(0.4), p, up);
    assert!(angles.contains_rad(FRAC_PI_2, 1e-9), "{angles:?}");
    assert!(!angles.contains_rad(FRAC_PI_2 - 0.01, 1e-9), "{angles:?}");
    assert!(feasible_angles(&rectangle(0.0), &passage(0.399), p, up).is_empty());
    // A slot in a wider passage: 0.8 cos(alpha) + 0.4 is its width.
    let angles = feasible_angles(&slot(), &passage(0.8), p, up);
    assert_eq!(angles.intervals().len(), 1);
    let [low, high] = angles.intervals()[0];
    assert!((low - PI / 3.0).abs() < 1e-9, "{low}");
    assert!((high - 2.0 * PI / 3.0).abs() < 1e-9, "{high}");
}

/// Next to a corner the flat side slides back as far as the other wall asks.
#[test]
fn slides_along_the_wall() {
    let square = walls(&[SQUARE]);
    for aperture in [rectangle(0.0), rectangle(0.1), slot()] {
        for x in [0.25, 0.45, 3.0] {
            let p = Point2::new(x, 0.0);
            let angles = feasible_angles(&aperture, &square, p, Vector2::y());
            assert!(angles.contains_rad(FRAC_PI_2, 1e-9), "{x} {angles:?}");
            let at = angles.placement(&aperture, p, Vector2::y(), FRAC_PI_2);
            assert!((at.center.y - 0.2).abs() < 1e-9);
            // As near to p as the corner allows.
            assert!((at.center.x - x.max(0.6)).abs() < 1e-9, "{x} {}", at.center);
        }
    }
    // The round end of the slot keeps it from the very corner, a sharp rectangle fills it.
    let p = Point2::new(0.01, 0.0);
    assert!(feasible_angles(&slot(), &square, p, Vector2::y()).is_empty());
    assert!(!feasible_angles(&rectangle(0.0), &square, p, Vector2::y()).is_empty());
}

/// A wedge has no symmetry: point first it goes into a notch of its own angle, blunt end first not.
#[test]
fn without_symmetry() {
    let corners = [[-0.6, -0.19], [0.6, 0.0], [-0.6, 0.19]].map(Vector2::from);
    let wedge = Aperture::Rounded(RoundedPolygon::polygon(&corners).expect("a wedge"));
    let notch = walls(&[&[[0.0, 0.0], [6.0, -1.0], [6.0, 1.0]]]);
    let normal = notch.edges()[0].normal();
    let alpha = |heading: f64| heading - normal.y.atan2(normal.x);
    let off = |x: f64, heading: f64| {
        let angles = feasible_angles(&wedge, &notch, Point2::new(x, -x / 6.0), normal);
        let found = angles.nearest_rad(alpha(heading)).expect("reachable");
        wedge.wrapped_rad(found - alpha(heading)).abs()
    };
    for x in [0.05, 0.3, 0.6] {
        assert!(off(x, PI) < 0.01, "{x} {}", off(x, PI));
        assert!(off(x, 0.0) > 1.5, "{x} {}", off(x, 0.0));
    }
    assert!(off(3.0, 0.0) < 0.1 && off(3.0, PI) < 0.1);
}
