//! Goal: runs that people lay across the place where a machine's axes line up are printed without a
//! fault, with the tool axis off by no more than the tolerance, or refused before a job is written; and a
//! place on the table is found where there is one. Method: runs made here (arcs over the pole, helices
//! that begin upright, random smooth ones), planned for the example table and arm and simulated.

use headway::drive::dry_run::dry_run;
use headway::drive::simulator::SimulatorSetup;
use headway::input::ReadOptions;
use headway::input::waypoints::{WaypointRun, read};
use headway::job::MotionState;
use headway::settings::{Place, Settings, machine_file};
use headway::{Plan, plan_waypoints};
use headway_tests::limit_oracle;
use nalgebra::{Unit, Vector3};
use rand::{RngExt, SeedableRng};
use std::f64::consts::TAU;
use std::path::Path;

pub fn machine(name: &str) -> Settings {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../examples/machines")
        .join(name);
    machine_file::from_toml(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// A run of places and tool axes.
fn run(points: impl Iterator<Item = (Vector3<f64>, Vector3<f64>)>) -> WaypointRun {
    let mut text = String::new();
    for (tip, axis) in points {
        for number in tip.iter().chain(axis.normalize().iter()) {
            text += &format!("{number:.7} ");
        }
        text.push('\n');
    }
    read(text.as_bytes(), "made", &ReadOptions::default()).unwrap()
}

fn leaning(tilt: f64, turn: f64) -> Vector3<f64> {
    Vector3::new(tilt.sin() * turn.cos(), tilt.sin() * turn.sin(), tilt.cos())
}

/// Over the top of a ball, `beside_mm` beside its pole.
fn arc(beside_mm: f64) -> WaypointRun {
    run((-60..=60).map(|degrees: i32| {
        let (sin, cos) = f64::from(degrees).to_radians().sin_cos();
        let normal = Vector3::new(sin, beside_mm / 25.0, cos).normalize();
        (25.0 * normal, normal)
    }))
}

/// A helix whose tool leans out, from upright, by so much in all.
fn helix(lean: f64) -> WaypointRun {
    run((0..600).map(|index| {
        let turn = f64::from(index) * 0.04;
        let tip = Vector3::new(20.0 * turn.cos(), 20.0 * turn.sin(), 5.0 + 0.1 * turn);
        (tip, leaning(lean * f64::from(index) / 600.0, turn))
    }))
}

/// Places and tilts by four harmonics each, the tool no further from upright than `tilt_max`.
fn random_run(seed: u64, tilt_max: f64) -> WaypointRun {
    let mut random = rand_pcg::Pcg64Mcg::seed_from_u64(seed);
    let parts: [[[f64; 2]; 4]; 5] = std::array::from_fn(|_| {
        std::array::from_fn(|_| std::array::from_fn(|_| random.random_range(-1.0..1.0)))
    });
    let raw: Vec<[f64; 5]> = (0..=400)
        .map(|index| {
            std::array::from_fn(|channel| {
                let harmonics = parts[channel].iter().zip(1..);
                harmonics
                    .map(|([a, b], k)| {
                        let phase = TAU * f64::from(k) * f64::from(index) / 400.0;
                        (a * phase.sin() + b * phase.cos()) / f64::from(k)
                    })
                    .sum()
            })
        })
        .collect();
    let largest = |of: fn(&[f64; 5]) -> f64| raw.iter().map(of).fold(0.0, f64::max);
    let (wide, high) = (largest(|r| r[0].hypot(r[1])), largest(|r| r[2].abs()));
    let steep = largest(|r| r[3].hypot(r[4]));
    run(raw.iter().map(|[x, y, z, u, v]| {
        let tip = Vector3::new(35.0 * x / wide, 35.0 * y / wide, 15.0 + 10.0 * z / high);
        (tip, leaning(tilt_max * u.hypot(*v) / steep, v.atan2(*u)))
    }))
}

/// No fault, the limits kept, the tip where it is to be.
fn assert_prints(name: &str, plan: &Plan, settings: &Settings) {
    let done = dry_run(&plan.stream, settings, &SimulatorSetup::default(), |_| {}).unwrap();
    assert_eq!(done.simulation.figures.faults, 0, "{name}");
    let limits = limit_oracle::sample(&plan.stream, settings);
    assert!(limits.velocity.ratio <= 1.0, "{name}");
    assert!(
        limits.acceleration.ratio <= 1.0,
        "{name} {}",
        limits.acceleration.ratio
    );
    assert!(limits.jerk.ratio <= 1.02, "{name}");
    let trace = &done.trace;
    assert!(
        trace.tip_error_um_max <= trace.half_step_um_max + 5.0,
        "{name}"
    );
}

/// Largest angle between the tool axis of a run and that of the pass that was planned for it at the same
/// place, rad.
fn led_by_rad(run: &WaypointRun, plan: &Plan) -> f64 {
    let passes = plan
        .route
        .moves
        .iter()
        .filter(|route_move| route_move.pass.is_some());
    let curves: Vec<_> = passes.map(|route_move| &route_move.curve).collect();
    let offset = Vector3::from(plan.transform.offset_mm);
    let mut worst = 0.0f64;
    for point in &run.points {
        let tip = point.tip_mm.coords + offset;
        let mut nearest = (f64::INFINITY, 0.0);
        for curve in &curves {
            for part in 0..=8 * curve.span_count() {
                let pose = curve.evaluate(part as f64 / 8.0).value;
                let away = (Vector3::new(pose[0], pose[1], pose[2]) - tip).norm();
                if away < nearest.0 {
                    let tilt = nalgebra::Vector2::new(pose[3], pose[4]);
                    let axis =
                        Unit::new_normalize(headway_firmware::kinematics::pose::tool_axis(tilt));
                    nearest = (away, axis.angle(&point.axis));
                }
            }
        }
        worst = worst.max(nearest.1);
    }
    worst
}

#[test]
fn a_path_through_the_pole_is_led_past_it_within_the_tolerance() {
    let mut settings = machine("trunnion.toml");
    for (name, run) in [("arc", arc(0.0)), ("helix", helix(1.0))] {
        let plan = plan_waypoints(&run, &settings).unwrap();
        assert_eq!(plan.singular.places, 1, "{name}");
        assert_eq!(plan.singular.slowing_s, None, "{name}");
        assert_prints(name, &plan, &settings);
        // Between the samples the path goes on by up to a sixteenth of a span: 0.03 mm on a ball of 25 mm.
        let led_rad = led_by_rad(&run, &plan);
        assert!(
            led_rad < settings.axis_tolerance_rad + 2e-3,
            "{name}: {led_rad}"
        );
        assert!(
            led_rad > 0.5 * settings.axis_tolerance_rad,
            "{name}: {led_rad}"
        );
    }
    // With no tolerance the head lifts off at the pole, and goes on at the same place.
    settings.axis_tolerance_rad = 0.0;
    let lifted = plan_waypoints(&arc(0.0), &settings).unwrap();
    assert_eq!((lifted.singular.lifts, lifted.figures.passes), (1, 2));
    assert_prints("lifted", &lifted, &settings);
    let led_rad = led_by_rad(&arc(0.0), &lifted);
    assert!(led_rad < 2e-3, "{led_rad}");
    let printed = lifted.route.moves.iter().filter(|m| m.pass.is_some());
    let ends: Vec<_> = printed
        .map(|m| [&m.curve.control[0], m.curve.control.last().unwrap()].map(|p| [p[0], p[1], p[2]]))
        .collect();
    assert_eq!(ends.len(), 2);
    assert_eq!(ends[0][1], ends[1][0]);
    // What it is told to cost is what passes between the two prints, as the joints' speeds alone allow.
    let marks = lifted.stream.marks.iter();
    let printed: Vec<_> = marks.filter(|m| m.state == MotionState::Print).collect();
    let ticks = printed[1].start_tick - printed[0].end_tick;
    let between_s = ticks as f64 / f64::from(settings.machine.servo_hz);
    let told_s = lifted.singular.lifting_s;
    println!("lifting off takes {between_s:.2} s, told {told_s:.2} s");
    assert!(told_s > 0.5 * between_s && told_s < 1.05 * between_s);
    // What begins at the pole needs no lift, and an arm's wrist is refused with what helps.
    let begins = plan_waypoints(&helix(1.0), &settings).unwrap();
    assert_eq!(begins.singular.lifts, 0);
    assert_prints("begins upright", &begins, &settings);
    // Beside the pole slowing is enough, and the axis is what the run says.
    let beside = plan_waypoints(&arc(0.5), &machine("trunnion.toml")).unwrap();
    assert_eq!(beside.singular.led_by_rad, 0.0);
    assert!(led_by_rad(&arc(0.5), &beside) < 2e-3);
}

/// How many of these runs print; whatever is planned must not fault.
fn printed(runs: impl Iterator<Item = (String, WaypointRun)>) -> [usize; 2] {
    let settings = machine("trunnion.toml");
    let mut counts = [0; 2];
    for (name, run) in runs {
        counts[1] += 1;
        match plan_waypoints(&run, &settings) {
            Ok(plan) => {
                assert_prints(&name, &plan, &settings);
                counts[0] += 1;
            }
            Err(error) => println!("{name}: {error}"),
        }
    }
    counts
}

fn random_runs(seeds: std::ops::Range<u64>) -> impl Iterator<Item = (String, WaypointRun)> {
    seeds.map(|seed| {
        let tilt_max = [0.3, 0.6, 0.9, 1.2, 1.5][seed as usize % 5];
        (format!("random {seed}"), random_run(seed, tilt_max))
    })
}

#[test]
fn random_smooth_runs_print_on_a_tilting_table() {
    let [printed, tried] = printed(random_runs(0..3));
    assert_eq!(printed, tried);
}

#[test]
#[ignore = "a minute; run by name"]
fn nine_of_ten_runs_print_on_a_tilting_table() {
    let helices = (0..20).map(|n| (format!("helix {n}"), helix(0.1 * f64::from(n))));
    let arcs = (0..10).map(|n| (format!("arc {n}"), arc(0.2 * f64::from(n))));
    let [printed, tried] = printed(random_runs(100..160).chain(helices).chain(arcs));
    println!("{printed} of {tried} printed");
    assert!(10 * printed >= 9 * tried, "{printed} of {tried}");
}

/// A ring of 20 mm whose tool leans out by so much all the way round.
fn ring(lean: f64) -> WaypointRun {
    run((0..=120).map(|index| {
        let turn = f64::from(index) * TAU / 120.0;
        let tip = Vector3::new(20.0 * turn.cos(), 20.0 * turn.sin(), 20.0);
        (tip, leaning(lean, turn))
    }))
}

/// Goal: the ends of a joint's range, and the largest tilt of a pose, belong to it; what is told of one beyond shows
/// by how much. Method: rings at the table's last 120 degrees and a little beyond, and at 150 degrees on a table that
/// tilts further.
#[test]
fn a_ring_at_the_very_end_of_a_range_prints() {
    let settings = machine("trunnion.toml");
    let at = |degrees: f64| plan_waypoints(&ring(degrees.to_radians()), &settings);
    assert_prints("A -120", &at(120.0).unwrap(), &settings);
    let refused = at(120.009).unwrap_err().to_string();
    assert!(refused.contains("to -120.009°, outside"), "{refused}");
    let refused = at(120.0045).unwrap_err().to_string();
    let told = refused.split("to -120.").nth(1).unwrap_or(&refused);
    assert!(!told.starts_with("000°"), "{refused}");

    let mut tilting = settings.clone();
    tilting.machine.joints[3].position_min = -160f64.to_radians();
    let steep = ring(150f64.to_radians());
    assert_prints(
        "A -150",
        &plan_waypoints(&steep, &tilting).unwrap(),
        &tilting,
    );
    // Four digits of an axis of 150 degrees: 150.004 degrees.
    let read = |axis: &str| {
        let text = format!("0 0 1 {axis}\n5 0 1 {axis}\n");
        read(text.as_bytes(), "rounded", &ReadOptions::default())
    };
    assert!(read("0.4999 0 -0.8660").is_ok());
    let refused = read("0.4996 0 -0.8663").unwrap_err().to_string();
    assert!(refused.contains("150.03°, more than 150°"), "{refused}");
}

/// Goal: `--place best` finds a place where the middle of the table is out of reach. Method: the small arm
/// with a bed that is far longer than its arm.
#[test]
fn a_place_is_found_on_a_table_beyond_the_arm() {
    let mut settings = machine("arm-small.toml");
    settings.work_area_mm[1][1] = 700.0;
    // Short, for it is followed at every place.
    let mut run = random_run(1, 0.2);
    run.points.truncate(60);
    let refused = plan_waypoints(&run, &settings).unwrap_err().to_string();
    assert!(refused.contains("--place best"), "{refused}");
    settings.place = Place::Best;
    let plan = plan_waypoints(&run, &settings).unwrap();
    let found = plan.found_place.unwrap();
    assert!(
        found.reached > 0 && found.reached < found.tried,
        "{found:?}"
    );
    assert!(found.shift_mm[1] < -50.0, "{found:?}");
    assert_prints("best place", &plan, &settings);
}
