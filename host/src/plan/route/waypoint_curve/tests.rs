//! Goal: the curve goes through every waypoint, is C² between corners, rests at corners, and turns
//! the nozzle across the travel where no heading is given. Method: shapes with known answers.

use super::fit::CURVE_SHARE;
use super::*;
use crate::input::ReadOptions;
use crate::input::waypoints::read;
use crate::text::refusal::Refusal;

fn curves_of(text: &str, settings: &Settings) -> Result<Vec<PathCurve>, Refusal> {
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
    let begins = "line 2: the tool axis is tilted by ";
    assert!(error.to_string().starts_with(begins), "{error}");
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
    let error = curves_of(&text, &Settings::default()).unwrap_err();
    assert!(error.to_string().contains("are so uneven"), "{error}");
}

fn rounding(corner_mm: f64, settings: Settings) -> Settings {
    let mut settings = Settings {
        aperture: Aperture::Ellipse {
            major_mm: 0.3,
            minor_mm: 0.3,
        },
        ..settings
    };
    settings.tolerances.corner_mm = corner_mm;
    settings
}

fn passes_of(text: &str, settings: &Settings) -> WaypointPasses {
    let run = read(text.as_bytes(), "run", &ReadOptions::default()).unwrap();
    waypoint_passes(&run, [0.0; 3], settings).unwrap()
}

/// Waypoints along legs of a length and a direction, `step_mm` apart, upright.
fn legs(legs: &[(f64, f64)], step_mm: f64) -> (String, Vec<Vector2<f64>>) {
    let mut text = "0 0 1 0 0 1\n".to_string();
    let mut corners = vec![Vector2::zeros()];
    for (length_mm, direction_rad) in legs {
        let from = corners[corners.len() - 1];
        let along = Vector2::new(direction_rad.cos(), direction_rad.sin());
        let steps = (length_mm / step_mm).ceil();
        for i in 1..=steps as usize {
            let at = from + along * (length_mm * i as f64 / steps);
            text += &format!("{:.9} {:.9} 1 0 0 1\n", at.x, at.y);
        }
        corners.push(from + along * *length_mm);
    }
    (text, corners)
}

/// Distance of a place from a polyline.
fn off_mm(at: Vector2<f64>, corners: &[Vector2<f64>]) -> f64 {
    let legs = corners.windows(2).map(|leg| {
        let along = leg[1] - leg[0];
        let share = ((at - leg[0]).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
        (at - leg[0] - share * along).norm()
    });
    legs.fold(f64::INFINITY, f64::min)
}

/// Largest distance of a curve from a polyline, and of its corners from the curve.
fn apart_mm(curves: &[PathCurve], corners: &[Vector2<f64>]) -> [f64; 2] {
    let looks = curves.iter().flat_map(|curve| {
        let looks = 0..=8 * curve.span_count();
        looks.map(|look| curve.value(look as f64 / 8.0))
    });
    let path: Vec<Vector2<f64>> = looks.map(|pose| Vector2::new(pose[0], pose[1])).collect();
    let off = path.iter().map(|at| off_mm(*at, corners));
    let left = corners.iter().map(|corner| off_mm(*corner, &path));
    [off.fold(0.0, f64::max), left.fold(0.0, f64::max)]
}

/// Goal: corners are rounded within the tolerance, and use it. Method: a right angle, whose waypoints away from it
/// stay where they are; then legs of random lengths and turns.
#[test]
fn corners_are_rounded_within_the_tolerance() {
    let settings = rounding(0.2, Settings::default());
    let (text, corners) = legs(&[(10.0, 0.0), (10.0, FRAC_PI_2)], 0.5);
    let all = passes_of(&text, &settings);
    assert_eq!((all.rounded.path, all.rounded.rests), (1, 0));
    assert_eq!(all.passes[0].len(), 1, "no rest");
    let [off_mm, left_mm] = apart_mm(&all.passes[0], &corners);
    assert!(
        off_mm < 0.2 + 1e-3 && left_mm < 0.2 + 1e-3 && left_mm > 0.19,
        "{off_mm} {left_mm}"
    );
    assert!((all.rounded.path_off_mm - 0.2).abs() < 1e-6);
    let curve = &all.passes[0][0];
    let quarter = curve.value(0.25 * curve.span_count() as f64);
    assert!(
        (quarter[0] - 5.0).abs() < 1e-3 && quarter[1].abs() < 1e-4,
        "{quarter:?}"
    );

    let mut rounded = 0;
    for seed in 0..40u64 {
        let random = |k: u64| ((seed * 977 + k * 7919 + seed * k * 31) % 1000) as f64 / 1000.0;
        let mut direction = 0.0;
        let ways: Vec<(f64, f64)> = (0..8)
            .map(|k| {
                direction += 4.0 * (random(2 * k) - 0.5);
                (0.3 + 6.0 * random(2 * k + 1).powi(2), direction)
            })
            .collect();
        let corner_mm = 0.01 + 0.3 * random(99);
        let settings = rounding(corner_mm, Settings::default());
        // Four chords a leg and more, so that every corner is alone on straight ones.
        let (text, corners) = legs(&ways, 0.07);
        let all = passes_of(&text, &settings);
        let apart = apart_mm(&all.passes[0], &corners);
        assert!(
            apart.iter().all(|off| *off < corner_mm + 1e-3),
            "{seed}: {apart:?} {corner_mm}"
        );
        assert!(all.rounded.path_off_mm <= corner_mm + 1e-9);
        rounded += all.rounded.path;
    }
    assert!(rounded > 150, "{rounded}");
}

/// Goal: without corners, or without a tolerance, nothing changes. Method: a circle of few chords, whose turns are no
/// corners, with a tolerance and without; a right angle without.
#[test]
fn what_has_no_corner_stays_as_it_is() {
    let circle: String = (0..=36)
        .map(|i| {
            let (sin, cos) = (f64::from(i) * 10f64.to_radians()).sin_cos();
            format!("{} {} 1 0 0 1\n", 20.0 * cos, 20.0 * sin)
        })
        .collect();
    let plain = rounding(0.0, Settings::default());
    let with_it = passes_of(&circle, &rounding(0.3, Settings::default()));
    assert_eq!(with_it.rounded, RoundedCorners::default());
    assert_eq!(with_it.passes, passes_of(&circle, &plain).passes);
    let (text, _) = legs(&[(10.0, 0.0), (10.0, FRAC_PI_2)], 0.5);
    let all = passes_of(&text, &plain);
    assert_eq!(
        (all.passes[0].len(), all.rounded),
        (2, RoundedCorners::default())
    );
}

/// Goal: a corner of the tool axis alone is rounded within half of its tolerance, and the tip's path is not touched.
/// Method: a straight run whose axis turns by 3 degrees a millimetre from 20 mm to 25 mm.
#[test]
fn a_corner_of_the_axis_alone_is_rounded() {
    let lean = |x: f64| (3.0 * (x - 20.0).clamp(0.0, 5.0) + 5.0).to_radians();
    let text: String = (0..=400)
        .map(|i| {
            let x = 0.1 * f64::from(i);
            let (sin, cos) = lean(x).sin_cos();
            format!("{x:.3} 0 1 {sin:.9} 0 {cos:.9}\n")
        })
        .collect();
    let settings = rounding(0.2, Settings::gantry());
    let all = passes_of(&text, &settings);
    assert_eq!((all.rounded.path, all.rounded.axis), (0, 2));
    let off_by = |curve: &PathCurve| {
        let looks = (0..=4 * curve.span_count()).map(|look| {
            let pose = curve.value(look as f64 / 4.0);
            assert!(pose[1].abs() < 1e-6 && (pose[2] - 1.0).abs() < 1e-6);
            let leans_rad = pose[CHANNEL_TILT_Y];
            (leans_rad - lean(pose[0])).abs()
        });
        looks.fold(0.0, f64::max)
    };
    let off_rad = off_by(&all.passes[0][0]);
    let half_rad = 0.5 * settings.axis_tolerance_rad;
    assert!(
        off_rad < half_rad + 2e-5 && off_rad > 0.8 * half_rad,
        "{off_rad}"
    );
    assert!((all.rounded.axis_off_rad - off_rad).abs() < 1e-4);
    // How fast the turning changes falls with it: the spline does it within two chords.
    let plain = passes_of(&text, &rounding(0.0, Settings::gantry()));
    let bend = |curve: &PathCurve| {
        let per_mm = curve.span_count() as f64 / 40.0;
        let looks = (0..4000).map(|look| {
            let at = curve.evaluate(0.01 * f64::from(look) * per_mm);
            at.second[CHANNEL_TILT_Y].abs() * per_mm * per_mm
        });
        looks.fold(0.0, f64::max)
    };
    let bends = [&plain, &all].map(|all| bend(&all.passes[0][0]));
    assert!(bends[1] < 0.5 * bends[0], "{bends:?}");
}

/// Goal: what cannot be rounded stays a rest, and is counted. Method: a way that turns back, one that turns on the spot, and
/// a corner of path and axis without a tolerance of the axis.
#[test]
fn what_cannot_be_rounded_rests() {
    let settings = rounding(0.2, Settings::gantry());
    let (back, _) = legs(&[(10.0, 0.0), (10.0, 2.6), (10.0, 2.6 + 0.7)], 0.5);
    let all = passes_of(&back, &settings);
    assert_eq!((all.rounded.path, all.rounded.rests), (1, 1));
    assert_eq!(all.passes[0].len(), 2);
    let spot = "0 0 1 0 0 1 0\n10 0 1 0 0 1 0\n10 0 1 0 0 1 90\n10 10 1 0 0 1 90\n";
    let all = passes_of(spot, &settings);
    assert_eq!(
        (all.passes[0].len(), all.rounded),
        (3, RoundedCorners::default())
    );
    // The axis turns along the second leg only.
    let mut text = String::new();
    for i in 0..=80 {
        let (x, y) = (
            f64::from(i.min(40)) * 0.25,
            f64::from((i - 40).max(0)) * 0.25,
        );
        let (sin, cos) = (5.0 + 4.0 * y).to_radians().sin_cos();
        text += &format!("{x} {y} 1 {sin:.9} 0 {cos:.9}\n");
    }
    let all = passes_of(&text, &settings);
    assert_eq!(
        (all.rounded.path, all.rounded.axis, all.rounded.rests),
        (1, 1, 0)
    );
    let exact = Settings {
        axis_tolerance_rad: 0.0,
        ..settings
    };
    let all = passes_of(&text, &exact);
    assert_eq!(
        (all.rounded.path, all.rounded.axis, all.rounded.rests),
        (0, 0, 1)
    );
    assert_eq!(all.passes[0].len(), 2);
}

/// Goal: speeds that are asked for stay with their waypoints where corners are rounded. Method: a right angle whose
/// second leg is slower.
#[test]
fn asked_speeds_stay_with_their_waypoints() {
    let mut text = "x y z nx ny nz speed_mm_s\n".to_string();
    for i in 0..=40 {
        let (x, y) = (f64::from(i.min(20)) * 0.5, f64::from((i - 20).max(0)) * 0.5);
        text += &format!("{x} {y} 1 0 0 1 {}\n", if i < 30 { 40 } else { 20 });
    }
    let settings = rounding(0.2, Settings::default());
    let all = passes_of(&text, &settings);
    assert_eq!(all.passes[0].len(), 1);
    let (curve, speeds) = (&all.passes[0][0], &all.speeds_mm_s[0]);
    let [at, speed_mm_s] = speeds[30];
    assert!((speed_mm_s - 20.0 * settings.plan_share).abs() < 1e-9);
    let pose = curve.value(at);
    assert!((pose[1] - 5.0).abs() < 1e-3, "{pose:?}");
}
