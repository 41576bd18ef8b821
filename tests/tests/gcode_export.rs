//! Goal: what is written for another controller is the job's own motion: every dialect's text, read
//! back by the reader of G-code, has the same path (5 µm, 0.05°), volume and time. Method: planned
//! jobs written in all dialects; every third tick of the stream against the moves that are read.

use headway::gcode::interpreter::{Firmware, steps};
use headway::gcode::write::dialect::{Dialect, Retraction};
use headway::gcode::write::{JobText, WriteOptions, Written, write_gcode};
use headway::gcode::{GcodeOptions, Place, read};
use headway::input::ReadOptions;
use headway::job::{MotionState, SegmentStream};
use headway::report::pose_table::{StreamSample, duration_ticks, samples};
use headway::settings::{Settings, machine_file};
use headway::{plan_target, plan_waypoints};
use headway_firmware::pose::{Pose, tilt_of_axis};
use std::f64::consts::PI;
use std::path::Path;

const DIALECTS: [Dialect; 5] = [
    Dialect::Klipper,
    Dialect::RepRapFirmware,
    Dialect::LinuxCnc,
    Dialect::GrblHal,
    Dialect::Marlin,
];
/// What is asked of the path, and of the area of 1.75 mm filament.
const TIP_MM: f64 = 0.005;
const TURN_RAD: f64 = 0.05 * PI / 180.0;
const FILAMENT_MM2: f64 = 0.25 * PI * 1.75 * 1.75;

fn written(stream: &SegmentStream, servo_hz: f64, options: &WriteOptions) -> (String, Written) {
    let job = JobText {
        name: "test (part)",
        machine: "bench",
        stream,
        servo_hz,
        heat: &[],
    };
    let mut text = Vec::new();
    let written = write_gcode(&mut text, &job, options).expect("written");
    (String::from_utf8(text).expect("text"), written)
}

/// Tip, tilt and heading as the stream has them.
fn channels(place: &Place) -> [f64; 6] {
    let (axis, heading_rad) = place.axis_and_heading();
    let tilt = tilt_of_axis(&axis.into_inner());
    let [x, y, z] = place.tip_mm;
    [x, y, z, tilt.x, tilt.y, heading_rad]
}

/// How far a sample is from a move, against what is asked; headings are known up to turns.
fn beside(sample: &StreamSample, from: &[f64; 6], to: &[f64; 6]) -> f64 {
    let unit = |c: usize| if c < 3 { TIP_MM } else { TURN_RAD };
    let pose = Pose::from_channels(&sample.position);
    let tilt = tilt_of_axis(&pose.tool_axis());
    let p = sample.position;
    let own = [p[0], p[1], p[2], tilt.x, tilt.y, p[5]];
    let mut off: [f64; 6] = std::array::from_fn(|c| (own[c] - from[c]) / unit(c));
    let turn = 2.0 * PI / TURN_RAD;
    let mut way: [f64; 6] = std::array::from_fn(|c| (to[c] - from[c]) / unit(c));
    way[5] -= turn * (way[5] / turn).round();
    off[5] -= turn * (off[5] / turn).round();
    let dot = |a: &[f64; 6], b: &[f64; 6]| -> f64 { (0..6).map(|c| a[c] * b[c]).sum() };
    let share = (dot(&off, &way) / dot(&way, &way).max(1e-12)).clamp(0.0, 1.0);
    let left: [f64; 6] = std::array::from_fn(|c| off[c] - share * way[c]);
    let tip = (left[0].powi(2) + left[1].powi(2) + left[2].powi(2)).sqrt();
    left[3..].iter().fold(tip, |most, c| most.max(c.abs()))
}

/// Every third tick of a stream against moves in order, which end where it does; the worst place
/// against what is asked.
fn beside_moves(stream: &SegmentStream, servo_hz: f64, places: &[[f64; 6]]) -> f64 {
    let (mut at, mut worst) = (0, 0.0f64);
    for sample in samples(stream, servo_hz, 3.0) {
        let ahead = at..(at + 6).min(places.len() - 1);
        let of = |i: usize| beside(&sample, &places[i], &places[i + 1]);
        let best = ahead
            .min_by(|i, k| of(*i).total_cmp(&of(*k)))
            .expect("a move");
        at = best;
        worst = worst.max(of(best));
    }
    assert!(
        at + 12 > places.len(),
        "the path ends at {at} of {}",
        places.len()
    );
    worst
}

/// Reads a text back and holds it against the stream; the worst place against what is asked.
fn check(stream: &SegmentStream, servo_hz: f64, options: &WriteOptions) -> (f64, Written) {
    let dialect = options.dialect;
    let (text, written) = written(stream, servo_hz, options);
    let back = steps(&text).expect("our own text");
    let moves: Vec<_> = back
        .steps
        .iter()
        .filter(|step| step.firmware == Firmware::None)
        .collect();
    let places: Vec<[f64; 6]> = moves
        .iter()
        .map(|step| {
            let [x, y, z, a, b, c] = step.to;
            channels(&Place {
                tip_mm: [x, y, z],
                turn_deg: [a, b, c],
            })
        })
        .collect();
    let worst = beside_moves(stream, servo_hz, &places);
    assert!(worst <= 1.0, "{dialect:?}: {worst} of what is asked");
    // Volume of the moves: primes stand.
    let mut before = None;
    let (mut extruded_mm, mut seconds) = (0.0, 0.0);
    for step in moves.iter().skip(1) {
        let from: [f64; 6] = before.unwrap_or(moves[0].to);
        let length = |range: std::ops::Range<usize>| -> f64 {
            range
                .map(|c| (step.to[c] - from[c]).powi(2))
                .sum::<f64>()
                .sqrt()
        };
        if from != step.to {
            extruded_mm += step.extruded;
            let tip_mm = length(0..3);
            // F is the tip's speed; of turns alone degrees.
            seconds += if tip_mm > 0.0 { tip_mm } else { length(3..6) } / step.speed_mm_s;
        }
        before = Some(step.to);
    }
    let asked_mm3 = written.volume_mm3;
    let share = extruded_mm * FILAMENT_MM2 / asked_mm3;
    assert!(
        (share - 1.0).abs() < 1e-4,
        "{dialect:?}: {share} of the volume"
    );
    // Dwells of primes and retracts are the controller's.
    let moving = stream
        .marks
        .iter()
        .filter(|mark| matches!(mark.state, MotionState::Print | MotionState::Travel));
    let moving_s: f64 = moving
        .map(|mark| (mark.end_tick - mark.start_tick) as f64 / servo_hz)
        .sum();
    assert!(
        (seconds / moving_s - 1.0).abs() < 5e-3,
        "{dialect:?}: {seconds} s of {moving_s}"
    );
    (worst, written)
}

fn example(name: &str) -> Vec<u8> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../examples")
        .join(name);
    std::fs::read(path).expect("an example")
}

/// A plate with a hole and its job of two layers.
fn plate() -> (SegmentStream, f64) {
    let text = br#"{"units":"mm","exterior":[[0,0],[14,0],[14,9],[5,9],[0,6]],"holes":[[[8,3],[8,6],[11,6],[11,3]]]}"#;
    let read = headway::input::read(
        text,
        "plate",
        headway::input::Format::Polygon,
        &ReadOptions::default(),
    );
    let settings = Settings {
        layers: 2,
        ..Settings::default()
    };
    let plan = plan_target(&read.expect("a plate").target, &settings).expect("a plan");
    (plan.stream, f64::from(settings.machine.servo_hz))
}

#[test]
fn every_dialect_is_read_back_as_the_job() {
    let (stream, servo_hz) = plate();
    assert!(duration_ticks(&stream) > 4000);
    for dialect in DIALECTS {
        let (worst, written) = check(&stream, servo_hz, &WriteOptions::of_dialect(dialect));
        println!("{dialect:?}: {worst:.3} of what is asked, {written:?}");
        assert!(
            written.moves_a_second <= dialect.moves_a_second_max(),
            "{written:?}"
        );
        for retraction in [
            Retraction::Firmware,
            Retraction::Source,
            Retraction::Extruder,
        ] {
            if dialect.is_machine_tool() && retraction == Retraction::Firmware {
                // G10 is a coordinate system there.
                continue;
            }
            let other = WriteOptions {
                retraction: Some(retraction),
                wrapped: true,
                turns: *b"UVW",
                extruder: dialect.is_machine_tool().then_some(b'A'),
                ..WriteOptions::of_dialect(dialect)
            };
            check(&stream, servo_hz, &other);
            // The passes and their pushes come back too.
            let (text, _) = self::written(
                &stream,
                servo_hz,
                &WriteOptions {
                    turns: *b"ABC",
                    ..other
                },
            );
            let program =
                read(text.as_bytes(), "t", &GcodeOptions::default()).expect("our own text");
            assert_eq!(program.layers(), 2, "{dialect:?}");
            assert!(program.has_headings && !program.has_tilts);
            let primes = program
                .passes
                .iter()
                .filter(|pass| pass.prime.is_some())
                .count();
            let events = stream.events.len();
            let retracts = program
                .passes
                .iter()
                .filter(|pass| pass.retract.is_some())
                .count();
            assert_eq!(primes + retracts, events, "{dialect:?} {retraction:?}");
        }
    }
}

/// Goal: a tilt comes back as the same axis and heading. Method: the first waypoints of the gear in six axes.
#[test]
fn tilts_are_read_back_as_axes() {
    let text = String::from_utf8(example("gear-6axis.wpt")).expect("text");
    let head: Vec<&str> = text.lines().take(160).collect();
    let read = headway::input::waypoints::read(
        head.join("\n").as_bytes(),
        "gear",
        &ReadOptions::default(),
    );
    let machine = String::from_utf8(example("machines/gantry.toml")).expect("text");
    let settings = machine_file::from_toml(&machine).expect("a machine");
    let plan = plan_waypoints(&read.expect("a run"), &settings).expect("a plan");
    let servo_hz = f64::from(settings.machine.servo_hz);
    for dialect in DIALECTS {
        let (worst, written) = check(&plan.stream, servo_hz, &WriteOptions::of_dialect(dialect));
        println!("{dialect:?}: {worst:.3} of what is asked, {written:?}");
    }
}

/// What LinuxCNC's stand-alone interpreter makes of a text: the places of its canonical moves, X Y Z mm,
/// A B C degrees. `None` where it is not installed (Debian's `linuxcnc-uspace`).
fn canonical_moves(text: &str) -> Option<Vec<[f64; 6]>> {
    let file = std::env::temp_dir().join(format!("headway-rs274-{}.ngc", std::process::id()));
    std::fs::write(&file, text).expect("a file");
    let ran = std::process::Command::new("rs274")
        .arg("-g")
        .arg(&file)
        .current_dir(std::env::temp_dir())
        .output();
    std::fs::remove_file(&file).expect("the file");
    let ran = ran.ok()?;
    let said = String::from_utf8_lossy(&ran.stdout).into_owned();
    let errors = String::from_utf8_lossy(&ran.stderr).into_owned();
    assert!(ran.status.success(), "{errors}{said}");
    assert!(said.contains("PROGRAM_END"), "{errors}{said}");
    let moves = said.lines().filter_map(|line| {
        let numbers = line
            .split_once("STRAIGHT_FEED(")
            .or_else(|| line.split_once("STRAIGHT_TRAVERSE("))?;
        let numbers: Vec<f64> = numbers
            .1
            .trim_end_matches([')', ' '])
            .split(',')
            .filter_map(|number| number.trim().parse().ok())
            .collect();
        <[f64; 6]>::try_from(numbers).ok()
    });
    Some(moves.collect())
}

/// Goal: LinuxCNC takes its dialect without an error, and moves as the job does. Method: its stand-alone
/// interpreter on the plate's text; every third tick of the stream against its canonical moves, 5 µm
/// and 0.05°; the extruder (A here, it knows no U) against the volume. Skips where it is not installed.
#[test]
fn linuxcnc_makes_the_same_moves() {
    let (stream, servo_hz) = plate();
    let with_a = WriteOptions {
        extruder: Some(b'A'),
        ..WriteOptions::of_dialect(Dialect::LinuxCnc)
    };
    let (text, written) = written(&stream, servo_hz, &with_a);
    let Some(moves) = canonical_moves(&text) else {
        println!("skipped: rs274 (linuxcnc-uspace) is not installed");
        return;
    };
    assert!(moves.len() > written.moves, "{} moves", moves.len());
    let places: Vec<[f64; 6]> = moves
        .iter()
        .map(|&[x, y, z, _, _, c]| [x, y, z, 0.0, 0.0, c.to_radians()])
        .collect();
    let worst = beside_moves(&stream, servo_hz, &places);
    println!("rs274: {worst:.3} of what is asked, {} moves", moves.len());
    assert!(worst <= 1.0, "{worst} of what is asked");
    // Primes and retracts stand; what moves extrude is the job's volume.
    let extruded_mm: f64 = moves
        .windows(2)
        .filter(|pair| pair[0][..3] != pair[1][..3] || pair[0][5] != pair[1][5])
        .map(|pair| pair[1][3] - pair[0][3])
        .sum();
    // The interpreter prints A to 10⁻⁴ mm.
    let share = extruded_mm * FILAMENT_MM2 / written.volume_mm3;
    assert!((share - 1.0).abs() < 1e-3, "{share} of the volume");
}

/// Goal: a sliced file that goes through a job and out again is the file's path. Method: its passes.
#[test]
fn start_blocks_have_fields_and_say_what_they_lack() {
    let (stream, servo_hz) = plate();
    let blocks = [
        Some("START X={x} TIME={time_s} ; {name}".to_string()),
        Some("END".to_string()),
    ];
    let (text, _) = written(
        &stream,
        servo_hz,
        &WriteOptions {
            blocks,
            ..WriteOptions::of_dialect(Dialect::Klipper)
        },
    );
    assert!(
        text.contains("START X=0 TIME=") || text.contains("START X=0.000 TIME="),
        "{}",
        &text[..400]
    );
    assert!(text.contains("; test part\n") && text.contains("\nEND\n"));
    let blocks = [Some("G1 X{where}".to_string()), None];
    let job = JobText {
        name: "t",
        machine: "m",
        stream: &stream,
        servo_hz,
        heat: &[],
    };
    let refused = write_gcode(
        std::io::sink(),
        &job,
        &WriteOptions {
            blocks,
            ..WriteOptions::of_dialect(Dialect::Marlin)
        },
    );
    assert!(
        refused
            .expect_err("unknown")
            .to_string()
            .contains("{where}")
    );
}
