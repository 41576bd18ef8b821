//! Goal: the joints of a job are those that make its poses and its steps, and trajectories say the same. Method:
//! the command's own tables of one six-axis path on a gantry, a trunnion and an arm, against forward kinematics
//! by plain products of frames written here, against the steps of a simulated run, and against each other.

use crate::rig::{Table, example, folder, headway, stderr, succeeded};
use headway::drive::dry_run::dry_run;
use headway::drive::simulator::SimulatorSetup;
use headway::job_file;
use headway::settings::{Settings, machine_file};
use headway_firmware::configuration::{Arm, Frame, Kinematics};
use headway_firmware::steps::delay::motion_delay_s;
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use serde_json::Value;
use std::f64::consts::TAU;
use std::sync::OnceLock;

/// Kinematics and how many joints they have.
const MACHINES: [(&str, usize); 4] = [
    ("gantry", 6),
    ("trunnion", 6),
    ("arm-small", 7),
    ("table-bc", 6),
];

/// Lines of the gear's file that are planned.
const WAYPOINTS: usize = 400;

/// The gear planned for a machine, once for all tests; the job's path and the machine's settings.
fn planned(machine: &str) -> (String, Settings) {
    static JOBS: [OnceLock<String>; 4] = [const { OnceLock::new() }; 4];
    let number = MACHINES.iter().position(|(name, _)| *name == machine);
    let file = example(&format!("machines/{machine}.toml"));
    let job = JOBS[number.expect("machine")].get_or_init(|| {
        let folder = folder(machine);
        let (job, input) = (folder.join("gear.hwj"), folder.join("gear.wpt"));
        // A part of its rim is enough.
        let whole = std::fs::read_to_string(example("gear-6axis.wpt")).expect("waypoints");
        let lines: Vec<&str> = whole.lines().take(WAYPOINTS).collect();
        std::fs::write(&input, lines.join("\n") + "\n").expect("waypoints");
        let (job, input) = (job.display().to_string(), input.display().to_string());
        succeeded(&headway(&["plan", &input, "-m", &file, "-o", &job]));
        job
    });
    let text = std::fs::read_to_string(&file).expect("machine");
    let settings = machine_file::from_toml(&text).expect("machine");
    (job.clone(), settings)
}

/// The columns between the first six and their like: positions, rates, accelerations, steps.
fn joints_of(table: &Table, kind: usize, joints: usize) -> Vec<Vec<f64>> {
    let names = &table.head[6 + kind * joints..6 + (kind + 1) * joints];
    names.iter().map(|name| table.column(name)).collect()
}

fn export(job: &str, options: &str) -> String {
    let mut words = vec!["export", job];
    words.extend(options.split_whitespace());
    succeeded(&headway(&words))
}

fn moved(x: f64, y: f64, z: f64) -> Isometry3<f64> {
    Translation3::new(x, y, z).into()
}

fn turned(axis: Vector3<f64>, angle_rad: f64) -> Isometry3<f64> {
    let rotation = UnitQuaternion::from_scaled_axis(axis * angle_rad);
    Isometry3::from_parts(Translation3::identity(), rotation)
}

fn framed(frame: &Frame) -> Isometry3<f64> {
    let rows: [[f64; 3]; 3] = frame.rotation;
    let matrix = Matrix3::from_fn(|row, column| rows[row][column]);
    let rotation = UnitQuaternion::from_matrix(&matrix);
    let [x, y, z] = frame.origin_mm;
    Isometry3::from_parts(Translation3::new(x, y, z), rotation)
}

/// The arm by its published frames, link by link.
fn arm_tool(arm: &Arm, q: &[f64]) -> Isometry3<f64> {
    let (y, z) = (Vector3::y(), Vector3::z());
    let model = |joint: usize| {
        let sign = if arm.reversed >> joint & 1 != 0 {
            -1.0
        } else {
            1.0
        };
        sign * q[joint] - arm.offset_rad[joint]
    };
    framed(&arm.base)
        * turned(z, model(0))
        * moved(arm.a1_mm, arm.b_mm, arm.c1_mm)
        * turned(y, model(1))
        * moved(0.0, 0.0, arm.c2_mm)
        * turned(y, model(2))
        * moved(arm.a2_mm, 0.0, arm.c3_mm)
        * turned(z, model(3))
        * turned(y, model(4))
        * turned(z, model(5))
        * moved(0.0, 0.0, arm.c4_mm)
        * framed(&arm.tool)
        * turned(z, q[6])
}

/// Tool axes in part axes: origin at the tip, Z into the head, X along the aperture.
fn tool(kinematics: &Kinematics, q: &[f64]) -> Isometry3<f64> {
    let (x, y, z) = (Vector3::x(), Vector3::y(), Vector3::z());
    match kinematics {
        Kinematics::Gantry { pivot_length_mm } => {
            moved(q[0], q[1], q[2] + pivot_length_mm)
                * turned(x, q[3])
                * turned(y, q[4])
                * turned(z, q[5])
                * moved(0.0, 0.0, -pivot_length_mm)
        }
        Kinematics::Trunnion { centre_mm, .. } => {
            let [cx, cy, cz] = *centre_mm;
            let table =
                moved(cx, cy, cz) * turned(x, q[3]) * turned(z, q[4]) * moved(-cx, -cy, -cz);
            table.inverse() * moved(q[0], q[1], q[2]) * turned(z, q[5])
        }
        Kinematics::Arm6 { arm, .. } => arm_tool(arm, q),
        Kinematics::Planar => moved(q[0], q[1], q[2]) * turned(z, q[3]),
        Kinematics::Axes { axes, .. } => {
            let (mut table, mut head) = (Isometry3::identity(), Isometry3::identity());
            for (axis, angle) in [(Some(axes.first), q[3]), (axes.second, q[4])] {
                let Some(axis) = axis else { continue };
                let [cx, cy, cz] = axis.offset_mm;
                let turn = moved(cx, cy, cz)
                    * turned(Vector3::from(axis.axis), angle)
                    * moved(-cx, -cy, -cz);
                if axis.on_table {
                    table *= turn;
                } else {
                    head *= turn;
                }
            }
            // No nozzle of the examples leans.
            table.inverse() * moved(q[0], q[1], q[2]) * head * turned(z, q[5])
        }
    }
}

#[test]
fn exported_joints_make_the_exported_poses() {
    for (machine, joints) in MACHINES {
        let (job, settings) = planned(machine);
        let poses = Table::of(&export(&job, "--to csv --every-ms 5"));
        let table = Table::of(&export(&job, "--to csv --joints --every-ms 5"));
        let about: Value =
            serde_json::from_str(&export(&job, "--to json --joints --every-ms 500")).expect("JSON");
        let offset = Vector3::from_fn(|k, _| about["offset_mm"][k].as_f64().expect("offset"));
        let columns = joints_of(&table, 0, joints);
        assert!(poses.rows.len() > 500 && table.rows.len() - poses.rows.len() <= 1);
        let of_pose = |names: [&str; 3]| names.map(|name| poses.column(name));
        let (tips, axes) = (
            of_pose(["x_mm", "y_mm", "z_mm"]),
            of_pose(["nx", "ny", "nz"]),
        );
        let headings = poses.column("heading_rad");
        for row in 0..poses.rows.len() {
            let q: Vec<f64> = columns.iter().map(|column| column[row]).collect();
            let made = tool(&settings.machine.kinematics, &q);
            let tip = Vector3::from_fn(|k, _| tips[k][row]) + offset;
            let axis = Vector3::from_fn(|k, _| axes[k][row]);
            // Tips have five digits behind the point, axes seven, headings six.
            let off_mm = (made.translation.vector - tip).norm();
            assert!(off_mm < 2e-5, "{machine} row {row}: {off_mm} mm");
            let made_axis = made.rotation * Vector3::z();
            assert!(
                (made_axis - axis).norm() < 5e-7,
                "{machine} row {row}: {made_axis}"
            );
            // The heading counts from where the smallest turn of Z onto the axis takes X.
            let upright = Rotation3::rotation_between(&Vector3::z(), &axis).expect("axis");
            let long = upright.inverse() * (made.rotation * Vector3::x());
            let turns = (long.y.atan2(long.x) - headings[row]) / TAU;
            let off_rad = TAU * (turns - turns.round()).abs();
            assert!(off_rad < 2e-6, "{machine} row {row}: {off_rad} rad");
        }
    }
}

/// Rates and accelerations: what a table says of a step of time is what positions do in it.
#[test]
fn exported_rates_and_accelerations_are_the_positions_derivatives() {
    for (machine, joints) in MACHINES {
        let (job, settings) = planned(machine);
        let table = Table::of(&export(&job, "--to csv --joints --every-ms 1"));
        let times = table.column("t_s");
        let kinds = [0, 1, 2].map(|kind| joints_of(&table, kind, joints));
        let mut moving = 0;
        let [positions, rates, accelerations] = &kinds;
        let of_joint = positions.iter().zip(rates).zip(accelerations).enumerate();
        for (joint, ((q, v), a)) in of_joint {
            let jerk = settings.machine.joints[joint].jerk_max;
            moving += usize::from(v.iter().any(|v| v.abs() > 1e-3));
            for (row, pair) in times.windows(2).enumerate() {
                let h = pair[1] - pair[0];
                // A rate is a parabola but where a knot changes the jerk within the step: less than these.
                let rule = 0.5 * h * (v[row] + v[row + 1]) + h * h * (a[row] - a[row + 1]) / 12.0;
                let off = (q[row + 1] - q[row] - rule).abs();
                assert!(
                    off < jerk * h.powi(3) / 12.0 + 1e-8,
                    "{machine} {joint} {row}: {off}"
                );
                let off = (v[row + 1] - v[row] - 0.5 * h * (a[row] + a[row + 1])).abs();
                assert!(
                    off < jerk * h * h / 4.0 + 1e-5,
                    "{machine} {joint} {row}: {off}"
                );
            }
            let (first, last) = (v[0], *v.last().expect("rows"));
            assert!(
                first.abs() < 1e-5 && last.abs() < 1e-5,
                "at rest at both ends"
            );
        }
        // The table of the trunnion keeps its tilt on a cone.
        assert!(moving >= 5, "{machine}: {moving} joints move");
    }
}

#[test]
fn exported_joints_are_within_half_a_step_of_the_simulated_ones() {
    for (machine, joints) in MACHINES {
        let (job, settings) = planned(machine);
        let mut opened = std::fs::File::open(&job).expect("job");
        let file = job_file::read(&mut opened).expect("job");
        let stream = file.stream().expect("stream");
        let machine_of_job = stream.machine(&file.header.machine);
        let setup = SimulatorSetup::default();
        let run = dry_run(&stream, &settings, &setup, |_| {}).expect("run");
        let motion = &run.simulation.motion;
        // No hold and no warp: segment time is the clock's, to the last tick of the motion.
        let rates = &motion.rates_q16;
        let slow = rates.iter().position(|rate| *rate != 1 << 16);
        let (servo_hz, step_hz) = (
            f64::from(machine_of_job.servo_hz),
            f64::from(machine_of_job.step_hz),
        );
        let begun_s = motion.first_servo_tick as f64 / servo_hz + motion_delay_s(&machine_of_job);
        let table = Table::of(&export(&job, "--to csv --joints --every-ms 1"));
        let (times, columns) = (table.column("t_s"), joints_of(&table, 0, joints));
        let end_ticks = times.last().expect("rows") * servo_hz;
        assert!(
            slow.is_none_or(|tick| tick as f64 >= end_ticks - 2.0),
            "{machine}: {slow:?}"
        );
        let (rates, steps) = (joints_of(&table, 1, joints), joints_of(&table, 3, joints));
        let mut counts = motion.start_counts;
        let mut made = motion.steps.iter().peekable();
        for row in 0..table.rows.len() {
            let until = (times[row] + begun_s) * step_hz;
            while let Some(step) = made.next_if(|step| step.tick as f64 <= until) {
                counts[usize::from(step.motor)] += if step.forward { 1 } else { -1 };
            }
            for joint in 0..joints {
                let per_unit = machine_of_job.joints[joint].steps_per_unit;
                let planned = columns[joint][row] * per_unit;
                let off = (planned - counts[joint] as f64).abs();
                // Steps come on ticks of 5 µs, at most one late, and within 5 µs of the crossing.
                let late = 1e-5 * rates[joint][row].abs() * per_unit;
                // The controller computes joints that tilt in f32: two units of their last place.
                let rounded = 2f64.powi(-21) * planned.abs();
                assert!(
                    off <= 0.5 + 1e-3 + late + rounded,
                    "{machine} joint {joint} row {row}: {off} steps"
                );
                assert!((steps[joint][row] - planned).abs() <= 0.5 + 1e-3);
            }
        }
        let moved = (0..joints).filter(|joint| counts[*joint] != motion.start_counts[*joint]);
        assert!(moved.count() >= 3, "{machine}: joints moved");
    }
}

#[test]
fn trajectories_say_what_the_table_says_in_the_units_of_ros() {
    for (machine, joints) in [("trunnion", 6), ("arm-small", 7)] {
        let (job, settings) = planned(machine);
        // 30 ms is no whole part of the job: the end is a row of its own.
        let table = Table::of(&export(&job, "--to csv --joints --every-ms 30"));
        let names: Vec<String> = (1..=joints).map(|k| format!("arm/joint_{k}")).collect();
        let options = format!("--every-ms 30 --joint-names {}", names.join(","));
        let json = export(&job, &format!("--to ros2-json {options}"));
        let yaml = export(&job, &format!("--to ros2-yaml {options}"));
        let message: Value = serde_json::from_str(&json).expect("JSON");
        assert_eq!(message["joint_names"], serde_json::json!(names));
        let points = message["points"].as_array().expect("points");
        assert_eq!(points.len(), table.rows.len());
        let kinds = [0, 1, 2].map(|kind| joints_of(&table, kind, joints));
        let times = table.column("t_s");
        let mut before_ns = None;
        for (row, point) in points.iter().enumerate() {
            let of = |key: &str| point["time_from_start"][key].as_i64().expect(key);
            let ns = of("sec") * 1_000_000_000 + of("nanosec");
            assert!(
                of("nanosec") < 1_000_000_000 && Some(ns) > before_ns,
                "time rises"
            );
            before_ns = Some(ns);
            assert!((ns as f64 * 1e-9 - times[row]).abs() < 1e-7);
            if row % 10 != 0 && row + 1 < points.len() {
                continue;
            }
            for (kind, key) in ["positions", "velocities", "accelerations"]
                .iter()
                .enumerate()
            {
                let values = point[key].as_array().expect(key);
                assert_eq!(values.len(), joints);
                for (joint, value) in values.iter().enumerate() {
                    let scale = if settings.machine.joints[joint].rotary {
                        1.0
                    } else {
                        1e3
                    };
                    let natural = kinds[kind][joint][row];
                    // Metres of nine digits are 10⁻⁶ mm; accelerations have four digits in the table.
                    let off = (value.as_f64().expect("number") * scale - natural).abs();
                    assert!(off < 1e-4, "{machine} {key} {joint} {row}: {off}");
                }
            }
            // The same lists, letter for letter, under the same keys of the other notation.
            let list = |text: &str| {
                let at = text.match_indices("positions").nth(row).expect("point").0;
                let rest = &text[at..];
                rest[rest.find('[').expect("list")..=rest.find(']').expect("list")].to_string()
            };
            assert_eq!(list(&json), list(&yaml));
        }
        // Poses on every servo tick have one at the end.
        let poses = Table::of(&export(&job, "--to csv --every-ms 0.5"));
        let end_s = *poses.column("t_s").last().expect("rows");
        assert!((before_ns.expect("points") as f64 * 1e-9 - end_s).abs() < 1e-9);
        assert_eq!(
            yaml.matches("time_from_start: {sec: ").count(),
            points.len()
        );
    }
}

#[test]
fn joints_are_asked_for_where_there_are_any() {
    let (job, _) = planned("gantry");
    for (options, said) in [
        ("--to svg --joints", "--joints goes with tables"),
        ("--to csv --joint-names a,b", "--joint-names goes with"),
        (
            "--to ros2-json --joint-names a,b",
            "2 joint names for 6 joints (x, y, z, a, b, c)",
        ),
        (
            "--to ros2-yaml --joint-names a,b,c,d,e,a",
            "joint name \"a\"",
        ),
        ("--to ros2-yaml --joint-names a,b,c,d,e,\"f", "joint name"),
        ("--to csv --joints --every-ms 1e-9", "rows"),
    ] {
        let mut words = vec!["export", &job];
        words.extend(options.split_whitespace());
        let output = headway(&words);
        assert_eq!(output.status.code(), Some(2), "{options}");
        assert!(
            stderr(&output).contains(said),
            "{options}: {}",
            stderr(&output)
        );
    }
}
