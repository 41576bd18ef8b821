//! Goal: what is written for another controller is the job's own motion: every dialect's text, read
//! back by the reader of G-code, has the same path (5 µm, 0.05°), volume and time. Method: planned
//! jobs written in all dialects; every third tick of the stream against the moves that are read.

use headway::api::{self, Machine, Options, Part, Reading};
use headway::gcode::extrusion::Taken;
use headway::gcode::flavour::declared;
use headway::gcode::interpreter::{Firmware, steps};
use headway::gcode::write::dialect::{Dialect, Retraction};
use headway::gcode::write::{JobText, WriteOptions, Written, write_gcode};
use headway::gcode::{GcodeOptions, Place, read};
use headway::input::ReadOptions;
use headway::job::heat::{BED, HOT_END, HeatEvent, HeatOrder};
use headway::job::{MotionState, SegmentStream};
use headway::report::pose_table::{duration_ticks, samples_within};
use headway::settings::{Settings, machine_file};
use headway::{plan_target, plan_waypoints};
use headway_tests::rs274::{Canonical, canonical, places};
use headway_tests::written_path::{TIP_MM, beside_moves, channels};
use std::f64::consts::PI;
use std::path::Path;

const DIALECTS: [Dialect; 5] = [
    Dialect::Klipper,
    Dialect::RepRapFirmware,
    Dialect::LinuxCnc,
    Dialect::GrblHal,
    Dialect::Marlin,
];
/// Cross-section of 1.75 mm filament.
const FILAMENT_MM2: f64 = 0.25 * PI * 1.75 * 1.75;

fn written(stream: &SegmentStream, servo_hz: f64, options: &WriteOptions) -> (String, Written) {
    written_with(stream, servo_hz, &[], options)
}

fn written_with(
    stream: &SegmentStream,
    servo_hz: f64,
    heat: &[HeatEvent],
    options: &WriteOptions,
) -> (String, Written) {
    let job = JobText {
        name: "test (part)",
        machine: "bench",
        stream,
        servo_hz,
        heat,
    };
    let mut text = Vec::new();
    let written = write_gcode(&mut text, &job, options).expect("written");
    (String::from_utf8(text).expect("text"), written)
}

/// Reads a text back and holds it against the stream; the worst place against what is asked.
fn check(stream: &SegmentStream, servo_hz: f64, options: &WriteOptions) -> (f64, Written) {
    let dialect = options.dialect;
    let (text, written) = written(stream, servo_hz, options);
    // The heading turns back behind the job.
    let of_job = text.split(";end of the job").next().expect("a job");
    let flavour = declared(of_job).flavour;
    let back = steps(
        of_job,
        flavour,
        &Taken::default(),
        true,
        &GcodeOptions::default(),
    )
    .expect("our own text");
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

/// A round plate with a round hole: curves at all radii.
fn disk() -> (SegmentStream, f64) {
    let ring = |radius: f64, sign: f64| -> Vec<[f64; 2]> {
        let at = |k: u32| sign * f64::from(k) * 2.0 * PI / 180.0;
        (0..180)
            .map(|k| [radius * at(k).cos(), radius * at(k).sin()])
            .collect()
    };
    let text =
        serde_json::json!({"units": "mm", "exterior": ring(9.0, 1.0), "holes": [ring(3.0, -1.0)]});
    let read = headway::input::read(
        text.to_string().as_bytes(),
        "disk",
        headway::input::Format::Polygon,
        &ReadOptions::default(),
    );
    let settings = Settings::default();
    let plan = plan_target(&read.expect("a disk").target, &settings).expect("a plan");
    (plan.stream, f64::from(settings.machine.servo_hz))
}

/// Goal: arcs are the job's path and fewer moves than straight ones, in the dialects that have them; the others
/// refuse. Method: a round plate and a plate with straight sides in both ways, read back.
#[test]
fn arcs_are_read_back_as_the_job() {
    for (name, (stream, servo_hz)) in [("disk", disk()), ("plate", plate())] {
        for dialect in [
            Dialect::LinuxCnc,
            Dialect::RepRapFirmware,
            Dialect::Marlin,
            Dialect::Klipper,
        ] {
            let [straight, arcs] = [false, true].map(|arcs| {
                let options = WriteOptions {
                    arcs: Some(arcs),
                    ..WriteOptions::of_dialect(dialect)
                };
                let (worst, written_there) = check(&stream, servo_hz, &options);
                let bytes = written(&stream, servo_hz, &options).0.len();
                println!(
                    "{name} {dialect:?}: {worst:.3} of what is asked, {} moves, {} arcs, {:.0} a second, {bytes} bytes",
                    written_there.moves, written_there.arcs, written_there.moves_a_second
                );
                written_there
            });
            assert_eq!(straight.arcs, 0);
            assert!(arcs.moves <= straight.moves, "{dialect:?}");
            assert!(arcs.arcs > 0 || dialect == Dialect::Klipper, "{dialect:?}");
            assert!((arcs.volume_mm3 - straight.volume_mm3).abs() < 1e-6);
        }
    }
    let (stream, servo_hz) = plate();
    let refused = |options: WriteOptions| {
        let job = JobText {
            name: "t",
            machine: "m",
            stream: &stream,
            servo_hz,
            heat: &[],
        };
        let written = write_gcode(std::io::sink(), &job, &options);
        written.expect_err("no arcs").to_string()
    };
    let grbl = WriteOptions {
        arcs: Some(true),
        ..WriteOptions::of_dialect(Dialect::GrblHal)
    };
    assert!(refused(grbl).contains("inverse time"));
    let lettered = WriteOptions {
        arcs: Some(true),
        turns: *b"ABJ",
        ..WriteOptions::of_dialect(Dialect::LinuxCnc)
    };
    assert!(refused(lettered).contains("J is an axis"));
}

/// The extruder as A: the stand-alone interpreter knows no U.
fn linuxcnc_with_a() -> WriteOptions {
    WriteOptions {
        extruder: Some(b'A'),
        ..WriteOptions::of_dialect(Dialect::LinuxCnc)
    }
}

/// Goal: LinuxCNC runs the arcs that are written as the job's path. Method: its stand-alone interpreter on a round
/// plate; its canonical arcs, all axes evenly along them, against every third tick of the stream.
#[test]
fn linuxcnc_runs_the_same_arcs() {
    let (stream, servo_hz) = disk();
    let (text, written) = written(&stream, servo_hz, &linuxcnc_with_a());
    let Some(commands) = canonical(&text) else {
        println!("skipped: rs274 (linuxcnc-uspace) is not installed");
        return;
    };
    let is_arc = |command: &&Canonical| matches!(command, Canonical::Arc { .. });
    assert_eq!(commands.iter().filter(is_arc).count(), written.arcs);
    assert!(written.arcs > 20, "{written:?}");
    let mut moves = vec![[0.0; 6]];
    for command in &commands {
        let at = moves[moves.len() - 1];
        moves.extend(places(command, &at));
    }
    check_canonical(&stream, servo_hz, &moves, &written);
}

/// The first waypoints of the gear in six axes.
fn tilted() -> (SegmentStream, f64) {
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
    (plan.stream, f64::from(settings.machine.servo_hz))
}

/// Goal: a tilt comes back as the same axis and heading. Method: the first waypoints of the gear in six axes.
#[test]
fn tilts_are_read_back_as_axes() {
    let (stream, servo_hz) = tilted();
    for dialect in DIALECTS {
        let (worst, written) = check(&stream, servo_hz, &WriteOptions::of_dialect(dialect));
        println!("{dialect:?}: {worst:.3} of what is asked, {written:?}");
    }
}

/// Goal: an export is not planned: its motion is in its job. Method: the plate and a job that tilts in all dialects, as
/// parts of the library; the same moves behind a slicer's first line are planned.
#[test]
fn exports_are_refused_when_they_are_planned() {
    let planned = |text: &str| {
        let part = Part::from_bytes("part", "gcode", text.as_bytes(), &Reading::default());
        api::plan(
            &part.expect("a part"),
            &Machine::default(),
            &Options::default(),
        )
    };
    for (stream, servo_hz) in [plate(), tilted()] {
        for dialect in DIALECTS {
            let (text, _) = written(&stream, servo_hz, &WriteOptions::of_dialect(dialect));
            let refused = planned(&text).map(|job| job.notes().to_vec());
            let told = refused.expect_err("our own export").to_string();
            assert!(
                told.contains("exported it from a job"),
                "{dialect:?}: {told}"
            );
        }
    }
    let (stream, servo_hz) = plate();
    let (text, _) = written(
        &stream,
        servo_hz,
        &WriteOptions::of_dialect(Dialect::Marlin),
    );
    let moves = text.replace(";generated by headway for marlin", ";");
    let sliced = format!("; generated by PrusaSlicer 2.5.0\n{moves}").replace(" U", " E");
    planned(&sliced).expect("a job");
}

/// Outputs with the number of the place at which each is set.
type Outputs = Vec<(usize, Canonical)>;

/// Places that the interpreter goes through, X Y Z mm, A B C degrees; `None` without it.
fn canonical_places(text: &str) -> Option<(Vec<[f64; 6]>, Outputs)> {
    let mut moves = vec![[0.0; 6]];
    let mut outputs = Vec::new();
    for command in canonical(text)? {
        let at = moves[moves.len() - 1];
        if let Canonical::Output(..) = command {
            outputs.push((moves.len() - 1, command));
        }
        moves.extend(places(&command, &at));
    }
    Some((moves, outputs))
}

/// Goal: LinuxCNC takes its dialect without an error, and moves as the job does. Method: its stand-alone
/// interpreter on the plate's text; every third tick of the stream against its canonical moves, 5 µm
/// and 0.05°; the extruder (A here, it knows no U) against the volume. Skips where it is not installed.
#[test]
fn linuxcnc_makes_the_same_moves() {
    let (stream, servo_hz) = plate();
    let (text, written) = written(&stream, servo_hz, &linuxcnc_with_a());
    let Some((moves, _)) = canonical_places(&text) else {
        println!("skipped: rs274 (linuxcnc-uspace) is not installed");
        return;
    };
    check_canonical(&stream, servo_hz, &moves, &written);
}

fn check_canonical(stream: &SegmentStream, servo_hz: f64, moves: &[[f64; 6]], written: &Written) {
    assert!(moves.len() > written.moves, "{} moves", moves.len());
    let places: Vec<[f64; 6]> = moves[1..]
        .iter()
        .map(|&[x, y, z, _, _, c]| [x, y, z, 0.0, 0.0, c.to_radians()])
        .collect();
    let worst = beside_moves(stream, servo_hz, &places);
    println!("rs274: {worst:.3} of what is asked, {} places", moves.len());
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

/// Orders of all kinds on the plate's path: before it, within beads, on a way, waits, at the end.
fn orders(stream: &SegmentStream) -> Vec<HeatEvent> {
    let marks = &stream.marks;
    let prints = marks.iter().filter(|mark| mark.state == MotionState::Print);
    let middle = |mark: &headway::job::Mark| (mark.start_tick + mark.end_tick) / 2;
    let beads: Vec<u64> = prints.map(middle).collect();
    let ways = marks
        .iter()
        .filter(|mark| mark.state == MotionState::Travel);
    let way = ways.map(middle).nth(2).expect("a way between beads");
    let end = marks.last().expect("marks").end_tick;
    let fan = |fan_pct| HeatOrder::Fan { fan_pct };
    let mut orders = vec![
        (0, HeatOrder::wait_for(BED, 60.0)),
        (0, HeatOrder::wait_for(HOT_END, 215.0)),
        (0, fan(0.0)),
        (beads[0], fan(50.0)),
        (beads[0] + 400, HeatOrder::target(HOT_END, 207.5)),
        (way, HeatOrder::wait_for(2, 190.0)),
        (beads[beads.len() - 1], HeatOrder::wait_for(BED, 55.0)),
        (end, HeatOrder::target(HOT_END, 0.0)),
        (end, fan(0.0)),
    ];
    orders.sort_by_key(|(tick, _)| *tick);
    let event = |(tick, order)| HeatEvent { tick, order };
    orders.into_iter().map(event).collect()
}

/// Goal: LinuxCNC takes orders of heaters, fans and waits, and sets its outputs where the job does. Method:
/// the plate with orders of all kinds through its stand-alone interpreter: the moves as without them, each
/// output with its value, with the motion where nothing waits, at the place of its tick.
#[test]
fn linuxcnc_sets_heaters_and_fans_on_the_path() {
    let (stream, servo_hz) = plate();
    let heat = orders(&stream);
    let (text, written) = written_with(&stream, servo_hz, &heat, &linuxcnc_with_a());
    let waits = text.lines().filter(|line| line.starts_with("M66 ")).count();
    assert_eq!(waits, 4);
    let Some((moves, outputs)) = canonical_places(&text) else {
        println!("skipped: rs274 (linuxcnc-uspace) is not installed");
        return;
    };
    check_canonical(&stream, servo_hz, &moves, &written);
    assert_eq!(outputs.len(), heat.len());
    let end_tick = stream.marks.last().expect("marks").end_tick;
    for (event, (at, output)) in heat.iter().zip(&outputs) {
        let (number, value, waits) = match event.order {
            HeatOrder::Heater {
                heater: 2,
                celsius,
                wait,
            } => (3, celsius, wait),
            HeatOrder::Heater {
                heater,
                celsius,
                wait,
            } => (usize::from(heater), celsius, wait),
            HeatOrder::Fan { fan_pct } => (2, fan_pct / 100.0, false),
        };
        let at_rest = event.tick == 0 || event.tick == end_tick;
        assert_eq!(
            *output,
            Canonical::Output(number, value, !waits && !at_rest)
        );
        if event.tick == 0 {
            assert_eq!(*at, 0);
            continue;
        }
        // The last tick is at rest where the one before it is.
        let tick = event.tick.min(end_tick - 1);
        let mut sample = samples_within(&stream, servo_hz, 1.0, [tick, tick + 1]);
        let p = sample.next().expect("a pose").position;
        let beside_mm = (0..3)
            .map(|i| (p[i] - moves[*at][i]).powi(2))
            .sum::<f64>()
            .sqrt();
        assert!(beside_mm < TIP_MM, "{event:?}: {beside_mm} mm");
    }
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
