//! Goal: support, distance and rows of every kind of shape agree with each other and with brute
//! force. Method: random walls against dense points of outline and wall.

use super::*;
use crate::test_shapes::{drop_corners, random_numbers};

fn shapes() -> Vec<RoundedPolygon> {
    vec![
        RoundedPolygon::stadium(1.2, 0.4),
        RoundedPolygon::rectangle(1.2, 0.4, 0.1),
        RoundedPolygon::rectangle(1.2, 0.4, 0.0),
        RoundedPolygon::polygon(&drop_corners()).expect("a drop"),
    ]
}

#[test]
fn sizes() {
    let stadium = RoundedPolygon::stadium(1.2, 0.4);
    assert!((stadium.widest_mm() - 1.2).abs() < 1e-12);
    assert!((stadium.narrowest_mm() - 0.4).abs() < 1e-12);
    let area = 0.8 * 0.4 + std::f64::consts::PI * 0.04;
    assert!((stadium.area_mm2() - area).abs() < 1e-12);
    assert!((stadium.axis_inside_mm() - 0.2).abs() < 1e-12);
    let rectangle = RoundedPolygon::rectangle(1.2, 0.4, 0.0);
    assert!((rectangle.widest_mm() - 1.2f64.hypot(0.4)).abs() < 1e-12);
    assert!((rectangle.narrowest_mm() - 0.4).abs() < 1e-12);
    assert!(stadium.is_symmetric() && rectangle.is_symmetric());
    assert!(!shapes()[3].is_symmetric());
}

#[test]
fn gap_agrees_with_brute_force() {
    let mut random = random_numbers(7);
    let (mut apart, mut cutting) = (0, 0);
    for shape in shapes() {
        for _ in 0..400 {
            let mut point = || Vector2::new(2.4 * random() - 1.2, 2.0 * random() - 1.0);
            let (a, b) = (point(), point());
            let found = shape.gap_to(a, b, f64::INFINITY).expect("no limit");
            assert!((found.outward.norm() - 1.0).abs() < 1e-9);
            // From outside: nearest of dense points of outline and wall.
            let mut least = f64::INFINITY;
            for i in 0..300 {
                let q = shape.outline_at(f64::from(i) / 300.0);
                least = least.min((q - foot(a, b, q)).norm());
            }
            let cuts = (0..=400).any(|k| {
                let q = a + (b - a) * (f64::from(k) / 400.0);
                shape.signed_distance_mm(q) < 0.0
            });
            if cuts {
                cutting += 1;
                assert!(found.gap_mm < 0.0);
                // Moved back by the gap, it touches and no more.
                let back = found.outward * -found.gap_mm;
                let after = shape.gap_to(a + back, b + back, f64::INFINITY);
                assert!(after.expect("no limit").gap_mm > -1e-9, "{shape:?} {a} {b}");
            } else if found.gap_mm > 0.0 {
                apart += 1;
                assert!(
                    (found.gap_mm - least).abs() < 0.01,
                    "{} {least}",
                    found.gap_mm
                );
            }
        }
    }
    assert!(apart > 200 && cutting > 200, "{apart} {cutting}");
}

#[test]
fn outline_lies_on_the_border() {
    for shape in shapes() {
        let mut length = 0.0;
        for i in 0..1000 {
            let p = shape.outline_at(f64::from(i) / 1000.0);
            assert!(shape.signed_distance_mm(p).abs() < 1e-9, "{p} {shape:?}");
            let next = shape.outline_at(f64::from(i + 1) / 1000.0);
            length += (next - p).norm();
        }
        assert!((length - shape.perimeter_mm()).abs() < 3e-3, "{length}");
    }
}

#[test]
fn rows_agree_with_distance() {
    let mut random = random_numbers(3);
    for shape in shapes() {
        for _ in 0..300 {
            let y = 1.4 * random() - 0.7;
            match row_range(shape.corners(), shape.radius_mm(), y) {
                Some([low, high]) => {
                    for x in [low, high] {
                        assert!(shape.signed_distance_mm(Vector2::new(x, y)).abs() < 1e-9);
                    }
                    let middle = Vector2::new((low + high) / 2.0, y);
                    assert!(shape.signed_distance_mm(middle) <= 1e-9);
                }
                None => {
                    for i in 0..80 {
                        let p = Vector2::new(f64::from(i) * 0.02 - 0.8, y);
                        assert!(shape.signed_distance_mm(p) > -1e-9);
                    }
                }
            }
        }
    }
}

#[test]
fn refusals() {
    let polygon = |points: &[[f64; 2]]| {
        let corners: Vec<Vector2> = points.iter().map(|p| Vector2::from(*p)).collect();
        RoundedPolygon::polygon(&corners)
    };
    let square = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
    assert!(polygon(&square).is_ok());
    let mut clockwise = square;
    clockwise.reverse();
    assert_eq!(polygon(&clockwise).map(|s| s.is_symmetric()), Ok(true));
    assert!(matches!(
        polygon(&[[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]]),
        Err(ShapeError::Corners { .. })
    ));
    let dart = [[-1.0, -1.0], [1.0, -1.0], [0.0, -0.5], [-1.0, 1.0]];
    assert!(matches!(polygon(&dart), Err(ShapeError::NotConvex { .. })));
    let away = square.map(|p| [p[0] + 1.0, p[1]]);
    assert_eq!(polygon(&away), Err(ShapeError::AxisOutside));
    // A pentagram turns twice.
    let star: Vec<[f64; 2]> = (0..5)
        .map(|i| {
            let (sin, cos) = (f64::from(i) * 0.8 * std::f64::consts::PI).sin_cos();
            [cos, sin]
        })
        .collect();
    assert!(matches!(polygon(&star), Err(ShapeError::NotConvex { .. })));
    let many: Vec<[f64; 2]> = (0..100)
        .map(|i| {
            let (sin, cos) = (f64::from(i) * std::f64::consts::TAU / 100.0).sin_cos();
            [cos, sin]
        })
        .collect();
    assert_eq!(polygon(&many), Err(ShapeError::Corners { count: 100 }));
}
