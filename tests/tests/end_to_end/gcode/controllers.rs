//! Goal: what is written for a controller is the job as that controller drives it: its time, its axes within their limits,
//! its path, and nothing left behind, at a second print as at the first. Method: jobs exported in all dialects, start and
//! end blocks included, run twice by models of the controllers' planners (`tests/src/controllers`), which are configured as
//! the guide has it. The big table is by name: `cargo test -p headway-tests --test end_to_end gcode::controllers --
//! --ignored --nocapture`.

use headway::gcode::Place;
use headway::gcode::write::dialect::Dialect;
use headway::gcode::write::limits::AxisLimits;
use headway::gcode::write::{JobText, WriteOptions, Written, is_tilting, write_gcode};
use headway::input::{Format, ReadOptions};
use headway::job::SegmentStream;
use headway::job::heat::{BED, HOT_END, HeatEvent, HeatOrder};
use headway::settings::{Settings, machine_file};
use headway::{plan_target, plan_waypoints};
use headway_firmware::configuration::Kinematics;
use headway_tests::controllers::{self, AXES, HEADING, Printed, guide, klipper};
use headway_tests::written_path::{beside_moves, channels};
use std::path::Path;

/// A planned job.
struct Job {
    name: &'static str,
    stream: SegmentStream,
    settings: Settings,
}

fn text_of(path: &str) -> String {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let path = root.join(path);
    std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

fn outline(name: &'static str, settings: Settings) -> Job {
    let text = text_of(&format!("examples/{name}.json"));
    let read = headway::input::read(
        text.as_bytes(),
        name,
        Format::Polygon,
        &ReadOptions::default(),
    );
    let plan = plan_target(&read.expect("an example").target, &settings).expect("a plan");
    Job {
        name,
        stream: plan.stream,
        settings,
    }
}

/// As a job with a `[material]` has them.
fn heat(stream: &SegmentStream) -> Vec<HeatEvent> {
    let end = stream.marks.last().expect("marks").end_tick;
    let fan = |fan_pct| HeatOrder::Fan { fan_pct };
    let orders = [
        (0, HeatOrder::wait_for(BED, 60.0)),
        (0, HeatOrder::wait_for(HOT_END, 210.0)),
        (0, fan(100.0)),
        (end, HeatOrder::target(HOT_END, 0.0)),
        (end, HeatOrder::target(BED, 0.0)),
        (end, fan(0.0)),
    ];
    orders
        .map(|(tick, order)| HeatEvent { tick, order })
        .to_vec()
}

fn exported(job: &Job, dialect: Dialect) -> (String, Written) {
    let servo_hz = f64::from(job.settings.machine.servo_hz);
    let text = JobText {
        name: job.name,
        machine: &job.settings.machine_name,
        stream: &job.stream,
        servo_hz,
        heat: &heat(&job.stream),
    };
    let mut options = WriteOptions::of_dialect(dialect);
    options.limits = AxisLimits::of_machine(&job.settings.machine, 2.405_281_875);
    let mut out = Vec::new();
    let written = write_gcode(&mut out, &text, &options).expect("written");
    (String::from_utf8(out).expect("text"), written)
}

/// The speed, acceleration and corner limits of a controller's configuration, and two prints.
struct Runs {
    speed_max: [f64; AXES],
    acceleration_max: [f64; AXES],
    printed: [Printed; 2],
}

/// Speed and acceleration of a machine's axes where the guide's are another machine's: its blocks are the built-in machine's,
/// its tilts the trunnion's, and it says to set one's own.
fn own_limits(settings: &Settings) -> Vec<(usize, [f64; 2])> {
    let joints: &[(usize, usize)] = match settings.machine.kinematics {
        Kinematics::Gantry { .. } => &[(0, 0), (1, 1), (2, 2), (3, 3), (4, 4), (5, 5)],
        Kinematics::Trunnion { .. } => &[(0, 0), (1, 1), (2, 2), (3, 3), (5, 5)],
        _ => &[],
    };
    let of_joints = joints.iter().map(|(axis, joint)| {
        let joint = &settings.machine.joints[*joint];
        let limits = [joint.speed_max, joint.acceleration_max];
        let unit = |limit: f64| {
            if joint.rotary {
                limit.to_degrees()
            } else {
                limit
            }
        };
        (*axis, limits.map(unit))
    });
    of_joints.collect()
}

/// Sets speeds (0) or accelerations (1) to the machine's, a second or, 60 times, a minute.
fn set_own(of: &mut [f64; AXES], which: usize, times: f64, settings: &Settings) {
    for (axis, limits) in own_limits(settings) {
        of[axis] = times * limits[which];
    }
}

/// The same of corner velocities of what turns: the acceleration over 20 ms, as the guide has it.
fn set_own_corners(of: &mut [f64; AXES], times: f64, settings: &Settings) {
    for (axis, [_, acceleration]) in own_limits(settings) {
        if (3..=HEADING).contains(&axis) {
            of[axis] = times * 0.02 * acceleration;
        }
    }
}

/// Two prints by a controller that is set as the guide has it.
fn run(dialect: Dialect, text: &str, settings: &Settings) -> Result<Runs, String> {
    let guide = text_of("docs/guide/gcode.md");
    let own = |of: &mut [f64; AXES], which: usize, times: f64| {
        set_own(of, which, times, settings);
    };
    let runs =
        |speed_max, acceleration_max, mut print: Box<dyn FnMut() -> Result<Printed, String>>| {
            Ok(Runs {
                speed_max,
                acceleration_max,
                printed: [print()?, print()?],
            })
        };
    let text = text.to_string();
    match dialect {
        Dialect::Klipper => {
            let mut of = guide::klipper(&guide)?;
            for (_, z) in own_limits(settings).iter().filter(|(axis, _)| *axis == 2) {
                of.z_max = *z;
            }
            let ([z, z_a], [v, a]) = (of.z_max, [of.velocity_max_mm_s, of.acceleration_max_mm_s2]);
            let ([e, e_a], heading) = (of.extrude_only_max, of.steppers[0].1);
            let mut speed = [v, v, z, 120.0, 120.0, heading[0], e];
            let mut acceleration = [a, a, z_a, 1500.0, 1500.0, heading[1], e_a];
            own(&mut speed, 0, 1.0);
            own(&mut acceleration, 1, 1.0);
            let mut printer = klipper::Klipper::new(of);
            runs(speed, acceleration, Box::new(move || printer.print(&text)))
        }
        Dialect::RepRapFirmware => {
            let mut of = guide::reprapfirmware(&guide)?;
            own(&mut of.speed_max_min, 0, 60.0);
            own(&mut of.acceleration_max, 1, 1.0);
            set_own_corners(&mut of.jerk_min, 60.0, settings);
            let speed = of.speed_max_min.map(|speed| speed / 60.0);
            let acceleration = of.acceleration_max;
            let mut printer = controllers::reprapfirmware::RepRapFirmware::new(of);
            runs(speed, acceleration, Box::new(move || printer.print(&text)))
        }
        Dialect::Marlin => {
            let mut of = guide::marlin(&guide)?;
            own(&mut of.speed_max, 0, 1.0);
            own(&mut of.acceleration_max, 1, 1.0);
            if let Some(jerk) = &mut of.jerk {
                set_own_corners(jerk, 1.0, settings);
            }
            let (speed, acceleration) = (of.speed_max, of.acceleration_max);
            let mut printer = controllers::marlin::Marlin::new(of);
            runs(speed, acceleration, Box::new(move || printer.print(&text)))
        }
        Dialect::GrblHal => {
            let mut of = guide::grblhal(&guide)?;
            own(&mut of.speed_max_min, 0, 60.0);
            own(&mut of.acceleration_max, 1, 1.0);
            let speed = of.speed_max_min.map(|speed| speed / 60.0);
            let acceleration = of.acceleration_max;
            let mut printer = controllers::grblhal::GrblHal::new(of);
            runs(speed, acceleration, Box::new(move || printer.print(&text)))
        }
        Dialect::LinuxCnc => {
            let mut of = guide::linuxcnc(&guide)?;
            own(&mut of.speed_max, 0, 1.0);
            own(&mut of.acceleration_max, 1, 1.0);
            let (speed, acceleration) = (of.speed_max, of.acceleration_max);
            let mut machine = controllers::linuxcnc::LinuxCnc::new(of);
            runs(speed, acceleration, Box::new(move || machine.print(&text)))
        }
    }
}

/// The worst place of a print against 5 µm and 0.05°.
fn beside(job: &Job, printed: &Printed) -> f64 {
    let places = printed.places.iter().map(|&[x, y, z, a, b, c]| {
        channels(&Place {
            tip_mm: [x, y, z],
            turn_deg: [a, b, c],
        })
    });
    let places: Vec<[f64; 6]> = places.collect();
    beside_moves(
        &job.stream,
        f64::from(job.settings.machine.servo_hz),
        &places,
    )
}

/// An axis at its fastest against its limits. A heading that follows has its acceleration by the speeds of the file: within
/// moves the planner has none for it, and what moves and the steps between them come to in 20 ms is the heading's.
fn over(runs: &Runs, printed: &Printed, axis: usize, follows: bool) -> f64 {
    let peak = printed.peaks[axis];
    let acceleration = match follows && axis == HEADING {
        true => printed.mean_accelerations[axis],
        false => peak.acceleration,
    };
    (peak.speed / runs.speed_max[axis]).max(acceleration / runs.acceleration_max[axis])
}

/// Both prints of a job: nothing left, the path, the volume, no axis over its limits, the estimate that is reported.
fn check(job: &Job, dialect: Dialect, axes_are_the_machines: bool) -> (Runs, Written) {
    let (text, written) = exported(job, dialect);
    let name = format!("{} {}", job.name, dialect.name());
    let runs = run(dialect, &text, &job.settings).unwrap_or_else(|error| panic!("{name}: {error}"));
    for printed in &runs.printed {
        assert_eq!(printed.left, Vec::<String>::new(), "{name}");
        let worst = beside(job, printed);
        assert!(worst <= 1.0, "{name}: {worst} of 5 um and 0.05 degrees");
        let filament_mm = written.volume_mm3 / 2.405_281_875;
        // E is written to 10⁻⁵ mm, and the pushes of a move shorter than a controller's least go with the next.
        let share = printed.filament_mm / filament_mm;
        assert!(
            (share - 1.0).abs() < 1e-3,
            "{name}: {share} of the filament"
        );
        for axis in (0..AXES).filter(|_| axes_are_the_machines) {
            // Sums of products of shares: the last digits.
            let over = over(&runs, printed, axis, dialect.heading_follows());
            assert!(
                over < 1.0 + 1e-6,
                "{name}: axis {axis} at {over} of its limits"
            );
        }
        // 400 degrees/s are what the guide allows for.
        let step = printed.peaks[HEADING].step;
        assert!(step < 400.0 + 1e-6, "{name}: the heading steps by {step}");
        // Each knows of buffers, least lengths and rests what the other does not.
        let estimate = written.controller_time_s / printed.seconds;
        assert!(
            (estimate - 1.0).abs() < 0.03,
            "{name}: {estimate} of the model's time"
        );
    }
    let [first, second] = &runs.printed;
    // The first print comes to the job's first place from zero, the second from where the first one parked: a machine tool
    // does not rest there, and turns back or not: 7 ms of 7 s.
    let apart = (first.seconds / second.seconds - 1.0).abs();
    let most = match dialect {
        Dialect::LinuxCnc | Dialect::GrblHal => 2e-3,
        _ => 1e-9,
    };
    assert!(apart < most, "{name}: {apart}");
    (runs, written)
}

/// Share of the job's time that a controller may take: LinuxCNC blends no tangents, 2.06 today.
fn share_max(dialect: Dialect) -> f64 {
    match dialect {
        Dialect::Klipper | Dialect::RepRapFirmware => 1.10,
        Dialect::Marlin | Dialect::GrblHal => 1.15,
        Dialect::LinuxCnc => 2.1,
    }
}

#[test]
fn controllers_take_the_jobs_time_twice() {
    let job = outline("u-part", Settings::default());
    for dialect in Dialect::ALL {
        let (runs, written) = check(&job, dialect, true);
        let share = runs.printed[0].seconds / written.duration_s;
        let slowed = &runs.printed[0].slowed_by;
        println!(
            "{}: {share:.3} of the job's time, {slowed:?}",
            dialect.name()
        );
        assert!(share < share_max(dialect), "{dialect:?}: {share}");
        assert!(share > 0.99, "{dialect:?}: {share}");
    }
}

/// Goal: the models are anchored. Method: the u-part as it was written for Klipper by commit 235b0ca, for which
/// Klipper's own look-ahead takes 14.7 s, and 7.2 s with a corner velocity of 200 degrees/s for the heading; its
/// second print is refused.
#[test]
fn klipper_takes_what_its_own_code_takes() {
    let kept = text_of("tests/data/gcode/u-part-klipper-235b0ca.gcode");
    let heated = kept.replacen("M83\n", "M83\nM104 S210\n", 1);
    let seconds = |text: &str| {
        let mut printer = klipper::Klipper::new(klipper::Config::default());
        let first = printer.print(text).expect("printed");
        let again = printer.print(text).expect_err("registered");
        assert!(again.contains("Must unregister axis first"), "{again}");
        (
            first.seconds,
            first.slowed_by.get("heading's corner").copied(),
        )
    };
    let (as_it_was, slowed) = seconds(&heated);
    assert!((as_it_was / 14.7 - 1.0).abs() < 0.03, "{as_it_was} s");
    assert_eq!(slowed, Some(761));
    let corner = "GCODE_AXIS=C INSTANTANEOUS_CORNER_VELOCITY=200";
    let (mended, _) = seconds(&heated.replacen("GCODE_AXIS=C", corner, 1));
    assert!((mended / 7.2 - 1.0).abs() < 0.03, "{mended} s");
    // It never heated.
    let cold = klipper::Klipper::new(klipper::Config::default()).print(&kept);
    assert!(cold.expect_err("cold").contains("below minimum temp"));
}

/// Goal: retraction by the firmware works as the job has it, and again at a second print. Method: the washers' pushes by
/// G10 and G11 in Klipper's model, which forgets that the filament is back when its lengths are set.
#[test]
fn klipper_gives_back_what_it_retracts() {
    // Three washers: several passes.
    let text = text_of("examples/washers.geojson");
    let format = Format::GeoJson;
    let read = headway::input::read(text.as_bytes(), "washers", format, &ReadOptions::default());
    let settings = Settings::default();
    let plan = plan_target(&read.expect("washers").target, &settings).expect("a plan");
    let job = Job {
        name: "washers",
        stream: plan.stream,
        settings,
    };
    let servo_hz = f64::from(job.settings.machine.servo_hz);
    let heat = heat(&job.stream);
    let text = JobText {
        name: "t",
        machine: "m",
        stream: &job.stream,
        servo_hz,
        heat: &heat,
    };
    let options = WriteOptions {
        retraction: Some(headway::gcode::write::dialect::Retraction::Firmware),
        ..WriteOptions::of_dialect(Dialect::Klipper)
    };
    let mut out = Vec::new();
    write_gcode(&mut out, &text, &options).expect("written");
    let text = String::from_utf8(out).expect("text");
    let pulled = text.matches("\nG10\n").count();
    assert_eq!(pulled, text.matches("\nG11\n").count());
    assert!(pulled > 0, "the job has several passes");
    let runs = run(Dialect::Klipper, &text, &job.settings).expect("printed");
    let [first, second] = &runs.printed;
    assert_eq!(
        first.moves, second.moves,
        "a push is lost at the second print"
    );
    assert!(
        first.left.is_empty() && second.left.is_empty(),
        "{:?}",
        first.left
    );
}

fn six_axes(name: &'static str, path: &str, machine: &str, lines: usize) -> Job {
    let text = text_of(path);
    let head: Vec<&str> = text.lines().take(lines).collect();
    let read =
        headway::input::waypoints::read(head.join("\n").as_bytes(), name, &ReadOptions::default());
    let settings = machine_file::from_toml(&text_of(machine)).expect("a machine");
    let plan = plan_waypoints(&read.expect("a run"), &settings).expect("a plan");
    Job {
        name,
        stream: plan.stream,
        settings,
    }
}

/// Three turns that rise all the way, as a slicer writes a vase.
fn vase() -> Job {
    let mut text = String::from(
        "; generated by PrusaSlicer 2.5\nG21\nG90\nM83\n;LAYER_CHANGE\n;HEIGHT:0.2\n;WIDTH:0.8\n",
    );
    text += "G1 X60 Y50 Z0.2 F6000\n";
    for k in 1..=540 {
        let angle = f64::from(k) * std::f64::consts::TAU / 180.0;
        let (sin, cos) = angle.sin_cos();
        let (x, y, z) = (
            50.0 + 10.0 * cos,
            50.0 + 10.0 * sin,
            0.2 + 0.2 * f64::from(k) / 180.0,
        );
        text += &format!("G1 X{x:.3} Y{y:.3} Z{z:.4} E0.02 F3000\n");
    }
    let program =
        headway::gcode::read(text.as_bytes(), "vase", &Default::default()).expect("a vase");
    let plan = headway::pipeline::gcode::plan_gcode(&program, None, &Settings::default(), &());
    let plan = plan.expect("a plan");
    Job {
        name: "vase",
        stream: plan.stream,
        settings: plan.settings,
    }
}

/// The table of docs/measurements/gcode.md: seconds of the job and of the controller, their ratio, what export says, the
/// worst axis against its limits, the heading's mean acceleration over 20 and 10 ms, the worst place against 5 µm and 0.05°,
/// what slows most moves down, what is left.
#[test]
#[ignore = "minutes: the table of docs/measurements, by name"]
fn table_of_controllers() {
    let jobs = [
        outline("u-part", Settings::default()),
        outline("gear", Settings::default()),
        outline("bracket", Settings::default()),
        vase(),
        six_axes(
            "gear-6axis",
            "examples/gear-6axis.wpt",
            "examples/machines/gantry.toml",
            160,
        ),
        six_axes(
            "gear-6axis",
            "examples/gear-6axis.wpt",
            "examples/machines/trunnion.toml",
            160,
        ),
    ];
    for job in &jobs {
        let machine = &job.settings.machine_name;
        for dialect in Dialect::ALL {
            let (text, written) = exported(job, dialect);
            let runs = run(dialect, &text, &job.settings)
                .unwrap_or_else(|error| panic!("{}: {error}", job.name));
            let [first, second] = &runs.printed;
            let follows = dialect.heading_follows() && !is_tilting(&job.stream);
            let over = (0..AXES).map(|axis| over(&runs, first, axis, follows));
            let over = over.fold(0.0, f64::max);
            let mean = first.mean_accelerations[HEADING];
            let short = first.short_accelerations[HEADING];
            let most = first.slowed_by.iter().filter(|(by, _)| **by != "speed");
            let most = most.max_by_key(|(_, moves)| **moves);
            println!(
                "| {} on {machine} | {} | {:.1} | {:.1} | {:.2} | {:.1} | {:.2} | {mean:.0} | {short:.0} | {:.2} | {} | {} |",
                job.name,
                dialect.name(),
                written.duration_s,
                first.seconds,
                first.seconds / written.duration_s,
                written.controller_time_s,
                over,
                beside(job, first).max(beside(job, second)),
                most.map_or("none".to_string(), |(by, moves)| format!(
                    "{by} {moves} of {}",
                    first.moves
                )),
                first.left.len() + second.left.len(),
            );
        }
    }
}
