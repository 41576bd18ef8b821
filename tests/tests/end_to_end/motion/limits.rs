//! Goal: the finished segments keep every limit, the path and the rests.
//! Method: routes of known shape are timed and fitted; an evaluator that shares no code with what it
//! checks looks at the result.

use headway::plan::motion::segments::lay_segments;
use headway::settings::Settings;
use headway_tests::jerk_reference::{ReferenceLimits, derivatives_of, least_time_s};
use headway_tests::refusal_numbers::numbers_behind;
use headway_tests::routes::{gear, random_smooth, route_of, two_passes, wave, zigzag};
use headway_tests::segment_oracle::{Oracle, duration_s, sample_limits, units_of, worst_fit};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;

#[test]
fn a_straight_line_takes_the_time_of_its_trapezoid() {
    let settings = Settings::default();
    let control = vec![
        [50.0, 50.0, 0.2, 0.0, 0.0, 0.0, 0.0],
        [150.0, 50.0, 0.2, 0.0, 0.0, 0.0, 0.0],
    ];
    let (stream, report) = lay_segments(&route_of(control), &settings).unwrap();
    let worst = sample_limits(&stream, &settings, 4);
    assert!(worst.all() <= 1.0 + 1e-6, "{worst:?}");
    assert!(worst.tip_speed > 0.995, "{worst:?}");
    let (v, a) = (0.95 * 60.0, 0.95 * 3000.0);
    let smoothing_s = 0.010;
    let best_s = 100.0 / v + v / a + smoothing_s + 0.008;
    assert!(duration_s(&stream) >= best_s - smoothing_s - 0.001);
    // Two per cent above the optimum with its smoothing and the rest before it.
    assert!(duration_s(&stream) <= 1.02 * best_s, "{report:?}");
}

#[test]
fn gear_keeps_its_limits_and_its_path() {
    for speed_mm_s in [60.0, 150.0] {
        let settings = Settings {
            speed_mm_s,
            ..Settings::default()
        };
        let control = gear(130.0);
        let started = std::time::Instant::now();
        let (stream, report) = lay_segments(&route_of(control.clone()), &settings).unwrap();
        println!("{:?}", started.elapsed());
        let worst = sample_limits(&stream, &settings, 4);
        println!(
            "gear at {speed_mm_s}: {:.3} s, {} knots, {:.1} knots/s {report:?}\n{worst:?}",
            duration_s(&stream),
            stream.knots.len(),
            stream.knots.len() as f64 / duration_s(&stream)
        );
        assert!(worst.all() <= 1.0 + 1e-6, "{worst:?}");
        // Something must bind, or the plan is too slow.
        assert!(worst.all() > 0.97, "{worst:?}");
        assert_eq!(report.doubled_moves, 0);
        let (tip_mm, heading_rad) = worst_fit(&stream, &control);
        println!("fit {tip_mm} {heading_rad}");
        assert!(tip_mm <= settings.tolerances.tip_mm, "{tip_mm}");
        assert!(
            heading_rad <= settings.tolerances.heading_rad,
            "{heading_rad}"
        );
    }
}

/// Goal: the time is that of the best motion within speed, acceleration and jerk, to 4 %. Method: a
/// reference of its own that only knows the path ([`jerk_reference`](headway_tests::jerk_reference));
/// paths on which tip speed, heading speed, heading acceleration and heading jerk bind.
#[test]
fn smooth_paths_take_the_time_of_a_jerk_limited_reference() {
    let settings = Settings::default();
    let limits = ReferenceLimits::of(&settings);
    let paths = [
        gear(60.0),
        wave(0.0, 1.0),
        wave(0.6, 1.3),
        wave(1.2, 2.1),
        wave(0.3, 4.0),
    ];
    for (case, control) in paths.into_iter().enumerate() {
        let route = route_of(control);
        let reference_s = least_time_s(&derivatives_of(&route.moves[0].curve), &limits);
        let (stream, _) = lay_segments(&route, &settings).unwrap();
        let mark = stream.marks.last().unwrap();
        let ticks = mark.end_tick - mark.start_tick;
        let ratio = ticks as f64 / f64::from(settings.machine.servo_hz) / reference_s;
        println!("case {case}: {ratio:.4} of {reference_s:.4} s");
        assert!(ratio > 0.99 && ratio < 1.04, "case {case}: {ratio}");
    }
}

#[test]
fn gear_on_a_machine_whose_axes_do_not_bind() {
    let mut settings = Settings::default();
    for joint in &mut settings.machine.joints {
        joint.acceleration_max *= 100.0;
        joint.jerk_max *= 1000.0;
        joint.speed_max *= 10.0;
    }
    let (stream, report) = lay_segments(&route_of(gear(400.0)), &settings).unwrap();
    println!(
        "free gear: {:.3} s, {} knots, {:.1} knots/s {report:?}",
        duration_s(&stream),
        stream.knots.len(),
        stream.knots.len() as f64 / duration_s(&stream)
    );
    // Only the tip's own limits are left, and they bind.
    let worst = sample_limits(&stream, &settings, 4);
    assert!(worst.all() <= 1.0 + 1e-6, "{worst:?}");
    assert!(worst.tip_speed > 0.97, "{worst:?}");
}

#[test]
fn random_curves_keep_every_limit() {
    let mut random = Pcg32::seed_from_u64(7);
    let mut tightest = 0.0f64;
    for case in 0..12 {
        let settings = Settings {
            speed_mm_s: random.random_range(20.0..200.0),
            ..Settings::default()
        };
        let control = if case % 2 == 0 {
            random_smooth(&mut random, 400)
        } else {
            zigzag(&mut random, 12)
        };
        let (stream, report) = lay_segments(&route_of(control.clone()), &settings).unwrap();
        let worst = sample_limits(&stream, &settings, 4);
        println!(
            "case {case}: {:.3} s {} knots {report:?} {:.4}",
            duration_s(&stream),
            stream.knots.len(),
            worst.all()
        );
        assert!(worst.all() <= 1.0 + 1e-6, "case {case}: {worst:?}");
        assert_eq!(report.doubled_moves, 0, "case {case}");
        assert!(report.ratios.jerk <= 1.02, "case {case}: {report:?}");
        tightest = tightest.max(worst.all());
        let (tip_mm, heading_rad) = worst_fit(&stream, &control);
        assert!(
            tip_mm <= settings.tolerances.tip_mm,
            "case {case}: {tip_mm}"
        );
        assert!(
            heading_rad <= settings.tolerances.heading_rad,
            "case {case}: {heading_rad}"
        );
    }
    assert!(tightest > 0.98);
}

#[test]
fn passes_with_prime_and_retract_keep_the_extruder_within_its_limits() {
    let settings = Settings::default();
    let (stream, report) = lay_segments(&two_passes(&settings), &settings).unwrap();
    let worst = sample_limits(&stream, &settings, 2);
    println!("two passes: {report:?}\n{worst:?}");
    assert!(worst.all() <= 1.0 + 1e-6, "{worst:?}");
    assert_eq!(stream.events.len(), 4);
    assert!(stream.events.is_sorted_by_key(|e| (e.span, e.offset_ticks)));
}

#[test]
fn stretches_join_at_exact_rest_and_marks_have_no_gap() {
    let settings = Settings::default();
    let route = two_passes(&settings);
    let (stream, _) = lay_segments(&route, &settings).unwrap();
    let oracle = Oracle::new(&stream);
    assert_eq!(stream.marks.len(), route.moves.len() + 1);
    assert_eq!(
        stream.marks[stream.marks.len() - 1].end_tick as f64,
        oracle.end_tick()
    );
    for pair in stream.marks.windows(2) {
        assert_eq!(pair[0].end_tick, pair[1].start_tick);
    }
    for (mark, route_move) in stream.marks[1..].iter().zip(&route.moves) {
        let (start, end) = (mark.start_tick as f64, mark.end_tick as f64);
        let control = &route_move.curve.control;
        for (tick, wanted) in [(start, control[0]), (end, control[control.len() - 1])] {
            let (p, v, a) = (oracle.at(tick, 0), oracle.at(tick, 1), oracle.at(tick, 2));
            for c in 0..7 {
                assert!((p[c] - wanted[c]).abs() <= 0.5 / units_of(&stream)[c] + 1e-9);
                assert!(v[c].abs() < 1e-6 && a[c].abs() < 1e-3);
            }
        }
        if route_move.curve.control.len() == 1 {
            let ticks = (route_move.dwell_s * 2000.0).ceil().max(1.0);
            assert_eq!(end - start, ticks);
        }
    }
    let ends: Vec<_> = stream
        .knots
        .iter()
        .rev()
        .take(3)
        .map(|k| k.control)
        .collect();
    assert!(ends[0] == ends[1] && ends[1] == ends[2]);
}

/// Joints of the gantry from the pose channels, by rotation matrices: X Y Z A B C. C comes without
/// its turns.
fn gantry_joints(pose: &[f64; 7], pivot_mm: f64) -> [f64; 6] {
    let (tx, ty) = (pose[3], pose[4]);
    let theta = tx.hypot(ty);
    // Rodrigues with the axis (tx, ty, 0) / theta.
    let (kx, ky) = if theta > 0.0 {
        (tx / theta, ty / theta)
    } else {
        (1.0, 0.0)
    };
    let (sin, cos) = theta.sin_cos();
    let m = [
        [cos + kx * kx * (1.0 - cos), kx * ky * (1.0 - cos), ky * sin],
        [
            kx * ky * (1.0 - cos),
            cos + ky * ky * (1.0 - cos),
            -kx * sin,
        ],
        [-ky * sin, kx * sin, cos],
    ];
    let n = [m[0][2], m[1][2], m[2][2]];
    let (sin_psi, cos_psi) = pose[5].sin_cos();
    // Row 0 of R_min R_z(psi) is (cos B cos C, -cos B sin C, sin B).
    let row = [
        m[0][0] * cos_psi + m[0][1] * sin_psi,
        m[0][1] * cos_psi - m[0][0] * sin_psi,
    ];
    [
        pose[0] + pivot_mm * n[0],
        pose[1] + pivot_mm * n[1],
        pose[2] + pivot_mm * (n[2] - 1.0),
        (-n[1]).atan2(n[2]),
        n[0].asin(),
        (-row[1]).atan2(row[0]),
    ]
}

#[test]
fn tilting_on_a_gantry_keeps_every_joint_within_its_limits() {
    use headway_firmware::configuration::Kinematics;
    let settings = Settings::gantry();
    let Kinematics::Gantry { pivot_length_mm } = settings.machine.kinematics else {
        panic!("not a gantry");
    };
    let mut control = gear(80.0);
    for (i, point) in control.iter_mut().enumerate() {
        let along = 0.1 * i as f64;
        point[2] = 5.0 + 0.3 * (1.0 - (along / 30.0).cos());
        point[3] = 0.3 * (along / 7.0).sin();
        point[4] = 0.3 * (along / 11.0).cos();
    }
    let (stream, report) = lay_segments(&route_of(control), &settings).unwrap();
    let oracle = Oracle::new(&stream);
    // A twentieth of a tick: truncation and rounding of the differences are both below 1e-4.
    let step = 0.05;
    let step_s = step / 2000.0;
    let mut worst = [[0.0f64; 2]; 6];
    for i in 1..oracle.end_tick() as u64 * 2 {
        let t = i as f64 / 2.0;
        let at = |t: f64| gantry_joints(&oracle.at(t, 0), pivot_length_mm);
        let (before, here, after) = (at(t - step), at(t), at(t + step));
        for joint in 0..6 {
            let turn = |d: f64| {
                if joint == 5 {
                    d - (d / std::f64::consts::TAU).round() * std::f64::consts::TAU
                } else {
                    d
                }
            };
            let (first, second) = (
                turn(here[joint] - before[joint]),
                turn(after[joint] - here[joint]),
            );
            let limit = &settings.machine.joints[joint];
            let share = settings.plan_share;
            let speed = (first + second).abs() / (2.0 * step_s * limit.speed_max * share);
            let acceleration =
                (second - first).abs() / (step_s * step_s * limit.acceleration_max * share);
            worst[joint][0] = worst[joint][0].max(speed);
            worst[joint][1] = worst[joint][1].max(acceleration);
        }
    }
    println!("{report:?}\n{worst:?}");
    let highest = worst.iter().flatten().fold(0.0f64, |a, &b| a.max(b));
    assert!(highest <= 1.0 + 1e-4, "{worst:?}");
    assert!(highest > 0.95, "{worst:?}");
    assert_eq!(report.doubled_moves, 0);
}

#[test]
fn places_outside_the_machine_are_refused_with_joint_and_place() {
    use headway::plan::motion::motion_error::MotionError;
    let settings = Settings::default();
    let mut control = gear(10.0);
    for point in &mut control {
        point[0] += 1000.0;
    }
    match lay_segments(&route_of(control), &settings) {
        Err(MotionError::OutsideJointRange { joint, at_mm, .. }) => {
            assert_eq!(joint, 0);
            assert!(at_mm[0] > 1000.0);
        }
        other => panic!("{other:?}"),
    }
    let mut tilted = gear(10.0);
    tilted[50][3] = 0.2;
    let refused = lay_segments(&route_of(tilted), &settings).expect_err("tilted");
    let text = refused.to_string();
    assert!(
        text.contains("with the tip at [") && text.contains("tilt the tool less"),
        "{text}"
    );
    let mut broken = gear(10.0);
    broken[3][1] = f64::NAN;
    let refused = lay_segments(&route_of(broken), &settings).expect_err("no number");
    assert!(
        refused
            .to_string()
            .starts_with("move 0 of the route has no finite path"),
        "{refused}"
    );
}

/// Ticks of a motion that hardly moves would fill time and memory: such a path is refused with its
/// place, however the slowness comes about; one that is slow because that is its speed is not.
#[test]
fn paths_that_take_for_ever_are_refused_with_their_place() {
    let route = route_of(gear(10.0));
    let begin = route.moves[0].curve.control[0];
    let slow = Settings {
        speed_mm_s: 0.008,
        ..Settings::default()
    };
    let (stream, _) = lay_segments(&route, &slow).expect("a slow print");
    let ticks = stream.marks.last().expect("a mark").end_tick;
    assert!(ticks > 2000 * 1200, "{ticks}");
    let nozzle = |change: fn(&mut headway_firmware::configuration::JointConfiguration)| {
        let mut settings = Settings::default();
        change(&mut settings.machine.joints[3]);
        settings
    };
    let weak = [
        nozzle(|c| c.speed_max = 1e-3),
        nozzle(|c| (c.acceleration_max, c.speed_max) = (1e-5, 1e-2)),
        nozzle(|c| (c.jerk_max, c.acceleration_max) = (1e-7, 1e-2)),
    ];
    for settings in weak {
        let refused = lay_segments(&route, &settings).expect_err("too slow");
        let text = refused.to_string();
        let from_mm = format!("begins with the tip at {:.3?} mm", &begin[..3]);
        assert!(text.contains(&from_mm), "{text}");
        let duration_s = numbers_behind(&text, "would take ")[0];
        assert_eq!(numbers_behind(&text, "more than the ")[0], 1200.0, "{text}");
        assert!(duration_s > 1200.0, "{text}");
    }
}

/// A square with sides of so many mm.
fn square(side_mm: u32) -> headway::input::Target {
    let text = format!(
        r#"{{"units": "mm", "exterior": [[0, 0], [{side_mm}, 0], [{side_mm}, {side_mm}], [0, {side_mm}]]}}"#
    );
    let read = headway::input::read(
        text.as_bytes(),
        "square",
        headway::input::Format::Polygon,
        &headway::input::ReadOptions::default(),
    );
    read.expect("valid").target
}

/// Goal: a print far slower than any limit but its speed takes what path and speed say; found as
/// prints of 0.05 mm/s that took eighteen times as long, at up to twice the speed asked for.
#[test]
fn a_very_slow_print_takes_its_path_by_its_speed() {
    let square = square(4);
    for speed_mm_s in [0.1, 0.05] {
        let settings = Settings {
            speed_mm_s,
            ..Settings::default()
        };
        let plan = headway::plan_target(&square, &settings).expect("a plan");
        let figures = &plan.figures;
        let worst = sample_limits(&plan.stream, &settings, 2);
        assert!(worst.all() <= 1.0 + 1e-5, "{speed_mm_s}: {worst:?}");
        let least_s = figures.print_mm / (0.95 * speed_mm_s);
        assert!(least_s > 100.0 && figures.print_s > least_s);
        // Travel to the part, prime and retract take 3 s.
        assert!(
            figures.print_s < 1.01 * least_s + 3.0,
            "{speed_mm_s}: {} s for {least_s} s",
            figures.print_s
        );
    }
}

#[test]
fn the_stream_does_not_depend_on_the_number_of_threads() {
    let settings = Settings::default();
    let route = two_passes(&settings);
    let with = |threads: usize| {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap()
            .install(|| lay_segments(&route, &settings).unwrap().0)
    };
    let alone = with(1);
    assert_eq!(alone, with(2));
    assert_eq!(alone, with(5));
}

#[test]
fn settings_that_cannot_be_are_refused_by_the_library_too() {
    let square = square(10);
    let mut settings = Settings::default();
    for speed_mm_s in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        settings.speed_mm_s = speed_mm_s;
        let refused = headway::plan_target(&square, &settings).expect_err("no such speed");
        assert!(
            matches!(refused, headway::PlanError::Refused(_)),
            "{speed_mm_s}: {refused}"
        );
    }
    // A motor may use 90 % of the step ticks at its joint's top speed, no more.
    for (share, fits) in [(0.89, true), (0.91, false)] {
        let mut settings = Settings::default();
        let machine = &mut settings.machine;
        let speed_max = machine.joints[0].speed_max;
        machine.joints[0].steps_per_unit = share * f64::from(machine.step_hz) / speed_max;
        let planned = headway::plan_target(&square, &settings);
        assert_eq!(planned.is_ok(), fits, "{share}");
        if let Err(refused) = planned {
            assert!(refused.to_string().contains("90 %"), "{refused}");
        }
    }
    let mut settings = Settings::default();
    settings.machine.joints[0].acceleration_max = 0.0;
    let refused = headway::plan_target(&square, &settings).expect_err("no such machine");
    assert!(
        refused.to_string().contains("joints.x.acceleration_max"),
        "{refused}"
    );
}
