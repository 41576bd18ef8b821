//! Goal: the curve goes through every waypoint, is C² between corners, rests at corners, and lays
//! the nozzle across the travel where no heading is given. Method: shapes with known answers.

use super::*;
use crate::input::ReadOptions;
use crate::input::waypoints::read;

fn curves_of(text: &str, settings: &Settings) -> Result<Vec<PathCurve>, WaypointCurveError> {
    let run = read(text.as_bytes(), "run", &ReadOptions::default()).unwrap();
    waypoint_passes(&run, [0.0; 3], settings).map(|all| all.passes.into_iter().flatten().collect())
}

fn circle(heading: bool) -> String {
    (0..=72)
        .map(|i| {
            let t = f64::from(i) * 5f64.to_radians();
            let (x, y) = (20.0 * t.cos(), 20.0 * t.sin());
            let column = if heading {
                format!(" {}", t.to_degrees())
            } else {
                String::new()
            };
            format!("{x} {y} 1 0 0 1{column}\n")
        })
        .collect()
}

#[test]
fn the_curve_goes_through_every_waypoint() {
    let settings = Settings::default();
    let text = circle(true);
    let curves = curves_of(&text, &settings).unwrap();
    assert_eq!(curves.len(), 1);
    let spans = curves[0].span_count();
    for i in 0..=72 {
        let at = curves[0].evaluate(spans as f64 * f64::from(i) / 72.0).value;
        let t = f64::from(i) * 5f64.to_radians();
        let off = (at[0] - 20.0 * t.cos()).hypot(at[1] - 20.0 * t.sin());
        // Equal chords: the parameter of each waypoint is known.
        assert!(
            off < CURVE_SHARE * settings.tolerances.tip_mm,
            "waypoint {i}: {off} mm"
        );
        assert!((at[CHANNEL_HEADING] - t).abs() < CURVE_SHARE * settings.tolerances.heading_rad);
    }
    // A circle between its waypoints: a cubic spline over chords of 5° is off by 20 (5°)^4 / 384.
    let middle = curves[0].evaluate(spans as f64 * 36.5 / 72.0).value;
    assert!((middle[0].hypot(middle[1]) - 20.0).abs() < 1e-5);
}

#[test]
fn without_headings_the_major_axis_lies_across_the_travel() {
    let settings = Settings::default();
    let curve = &curves_of(&circle(false), &settings).unwrap()[0];
    let spans = curve.span_count() as f64;
    let first = curve.evaluate(0.0).value[CHANNEL_HEADING];
    // Across the travel of a circle is its radius: heading and polar angle turn alike.
    for i in 1..20 {
        let at = curve.evaluate(spans * f64::from(i) / 20.0).value;
        let polar = at[1].atan2(at[0]).rem_euclid(std::f64::consts::TAU);
        let turned = at[CHANNEL_HEADING] - first;
        // The parabola at the end is off the circle's direction by about (5°)² / 12.
        assert!((turned - polar).abs() < 0.002, "{turned} {polar}");
    }
    assert!((first / PI - (first / PI).round()).abs() < 0.002, "{first}");
}

#[test]
fn corners_rest_and_turn_on_the_spot() {
    let settings = Settings::default();
    let text = "0 0 1 0 0 1\n10 0 1 0 0 1\n20 0 1 0 0 1\n20 10 1 0 0 1\n";
    let curves = curves_of(text, &settings).unwrap();
    let lengths: Vec<usize> = curves.iter().map(|curve| curve.control.len()).collect();
    assert_eq!(curves.len(), 3, "{lengths:?}");
    for pair in curves.windows(2) {
        assert_eq!(pair[0].control.last(), pair[1].control.first());
    }
    let [from, to] = curves[1].control[..] else {
        panic!("a turn on the spot")
    };
    assert_eq!(from[..3], [20.0, 0.0, 1.0]);
    assert!((to[CHANNEL_HEADING] - from[CHANNEL_HEADING]).abs() - FRAC_PI_2 < 1e-12);
    // 29° is no corner.
    let (x, y) = (
        10.0 + 10.0 * 29f64.to_radians().cos(),
        10.0 * 29f64.to_radians().sin(),
    );
    let bend = format!("0 0 1 0 0 1\n10 0 1 0 0 1\n{x} {y} 1 0 0 1\n");
    assert_eq!(curves_of(&bend, &settings).unwrap().len(), 1);
}

#[test]
fn a_head_that_turns_on_the_spot_stays_there() {
    let text = "0 0 1 0 0 1 0\n10 0 1 0 0 1 0\n10 0 1 0 0 1 90\n20 0 1 0 0 1 90\n";
    let curves = curves_of(text, &Settings::default()).unwrap();
    assert_eq!(curves.len(), 3);
    assert_eq!(curves[1].control.len(), 2);
    assert_eq!(curves[1].control[0][..5], curves[1].control[1][..5]);
}

#[test]
fn a_planar_machine_refuses_a_tilted_axis_and_a_gantry_takes_it() {
    let text = "0 0 1 0 0 1 0\n10 0 1 0.1 0 0.995 0\n";
    let error = curves_of(text, &Settings::default()).unwrap_err();
    assert!(
        matches!(error, WaypointCurveError::CannotTilt { line: 2, .. }),
        "{error}"
    );
    assert_eq!(curves_of(text, &Settings::gantry()).unwrap().len(), 1);
}

#[test]
fn spacing_beyond_all_measure_is_refused() {
    // Waves of a micrometre before ten metres: even spans would be ten million.
    let mut text = String::new();
    for i in 0..8 {
        text += &format!(
            "{} {} 1 0 0 1\n",
            0.005 * f64::from(i),
            0.001 * f64::from(i % 2)
        );
    }
    text += "10000 500 1 0 0 1\n";
    let error = curves_of(&text, &Settings::default());
    assert!(
        matches!(error, Err(WaypointCurveError::TooUneven { .. })),
        "{error:?}"
    );
}
