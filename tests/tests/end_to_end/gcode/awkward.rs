//! Goal: files that others write are read as the firmware they are for would run them, or refused with the
//! line; and any file ends soon. Method: programs of a few lines, one for each thing that slicers, macros and
//! firmwares do differently, against lengths, volumes, heights and times computed by hand.

use headway::gcode::{GcodeOptions, GcodePass, GcodeProgram, read};
use headway::pipeline::gcode::{GcodePlan, plan_gcode};
use headway::pipeline::packing::JobPacking;
use headway::settings::Settings;
use headway_tests::cpu_clock::thread_s;
use headway_tests::folders::files;
use headway_tests::plain_gcode::{Meant, plain};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::f64::consts::PI;
use std::io::Cursor;

/// Cross-section of 1.75 mm filament, mm².
const FILAMENT_MM2: f64 = 0.25 * PI * 1.75 * 1.75;
/// Arcs are chords within 1 µm of them, which are up to 2e-4 shorter here.
const LENGTH_SHARE: f64 = 4e-4;

fn program(text: &[u8]) -> GcodeProgram {
    let shown = String::from_utf8_lossy(text);
    read(text, "awkward", &GcodeOptions::default())
        .unwrap_or_else(|error| panic!("{shown}: {error}"))
}

fn error(text: &[u8]) -> String {
    let read = read(text, "awkward", &GcodeOptions::default());
    let shown = String::from_utf8_lossy(text);
    let error = read.err().unwrap_or_else(|| panic!("{shown} is read"));
    error.to_string()
}

fn filament_mm(program: &GcodeProgram) -> f64 {
    program.volume_mm3().expect("extrusion") / FILAMENT_MM2
}

/// What each is: text, length of its beads (mm), filament that they take (mm of 1.75).
const READ: [(&str, &str, f64, f64); 22] = [
    (
        "G91 is also E's in Marlin, and G90 takes both back",
        ";FLAVOR:Marlin\nM82\nG1 X10 Y0 Z.2 F1200\nG91\nG1 X10 E1\nG1 X10 E1\nG90\nG1 X40 E3\n",
        30.0,
        3.0,
    ),
    (
        "G91 is also E's in Klipper",
        "; gcode_flavor = klipper\nM82\nG1 X10 Z.2 F1200\nG91\nG1 X10 E1\nG1 X10 E1\nG90\nG1 X40 E3\n",
        30.0,
        3.0,
    ),
    (
        "Klipper keeps M83 over G90",
        "; gcode_flavor = klipper\nM83\nG90\nG1 X10 Z.2 F1200\nG1 X20 E1\nG1 X30 E1\n",
        20.0,
        2.0,
    ),
    (
        "G91 is not E's in RepRapFirmware",
        "; gcode_flavor = reprapfirmware\nM82\nG1 X10 Z.2 F1200\nG91\nG1 X10 E1\nG1 X10 E2\n",
        20.0,
        2.0,
    ),
    (
        "relative E whose M83 stands in a macro",
        "G21\nG90\nG1 X0 Y0 Z.2 F3000\nG1 X10 E.4\nG1 Y10 E.3\nG1 X0 E.4\nG1 Y0 E.3\n",
        40.0,
        1.4,
    ),
    (
        "relative E by the file's figure alone",
        "G90\nG1 X0 Y0 Z.2 F3000\nG1 X10 E.1\nG1 Y10 E.2\nG1 X0 E.4\nG1 Y0 E.7\n\
         ; --- filament used: 1.4 mm ---\n",
        40.0,
        1.4,
    ),
    (
        "absolute E whose figure agrees",
        "G90\nG1 X0 Y0 Z.2 F3000\nG1 X10 E.1\nG1 Y10 E.2\nG1 X0 E.4\nG1 Y0 E.7\n; filament used [mm] = 0.7\n",
        40.0,
        0.7,
    ),
    (
        "the setting of a slicer",
        "G1 X0 Y0 Z.2 F3000\nG1 X10 E.1\nG1 Y10 E.2\n; use_relative_e_distances = 1\n",
        20.0,
        0.3,
    ),
    (
        "UltiGCode is in mm³",
        ";FLAVOR:UltiGCode\nG1 X0 Y0 Z.2 F3000\nG1 X10 E2.405281875\nG1 X20 E4.81056375\n",
        20.0,
        2.0,
    ),
    (
        "mm³ by the file's figure",
        "M82\nG1 X0 Y0 Z.2 F3000\nG1 X50 E12.026\nG1 X100 E24.0528\n; filament used [mm] = 10\n",
        100.0,
        10.0,
    ),
    (
        "Klipper's states come back with their E, and the head with MOVE",
        "M82\nG1 X0 Y0 Z.2 F1200\nG92 E0\nG1 X10 E1\nSAVE_GCODE_STATE NAME=a\nG91\nG1 Z1\nG1 X5\nM83\n\
         G1 E-1 F1800\nG1 E1\nRESTORE_GCODE_STATE NAME=a MOVE=1 MOVE_SPEED=50\nG1 X20 E2\n",
        20.0,
        2.0,
    ),
    (
        "M120 and M121 are a stack in RepRapFirmware",
        "; gcode_flavor = reprapfirmware\nM83\nG1 X0 Y0 Z.2 F1200\nG1 X10 E1\nM120\nG91\nG1 Z1 F6000\nG1 Z-1\n\
         M121\nG1 X20 E1\n",
        20.0,
        2.0,
    ),
    (
        "and switch endstops in Marlin",
        ";FLAVOR:Marlin\nG91\nG1 X5 Z.2 F1200\nG1 X10 E1\nM120\nG1 Z1 F6000\nG1 Z-1\nM121\nG1 X20 E1\n",
        30.0,
        2.0,
    ),
    (
        "M121 that changes nothing is no question",
        "M83\nM120\nM121\nG1 X5 Z.2 F1200\nG1 X15 E1\n",
        10.0,
        1.0,
    ),
    (
        "a bare G92 is 0 everywhere in Klipper",
        "; gcode_flavor = klipper\nM82\nG1 X10 Y0 Z.2 F1200\nG1 X20 E1\nG92\nG1 X10 E1\n",
        20.0,
        2.0,
    ),
    (
        "and nothing in RepRapFirmware",
        "; gcode_flavor = reprapfirmware\nM82\nG1 X10 Y0 Z.2 F1200\nG1 X20 E1\nG92\nG1 X30 E2\n",
        20.0,
        2.0,
    ),
    (
        "P of an arc is a turn more in Marlin",
        ";FLAVOR:Marlin\nM83\nG1 X10 Y0 Z.2 F1200\nG3 X0 Y10 I-10 J0 P1 E4\n",
        25.0 * PI,
        4.0,
    ),
    (
        "and counts the arc itself in RS274/NGC",
        "G91.1\nM83\nG1 X10 Y0 Z.2 F1200\nG3 X0 Y10 I-10 J0 P1 E4\n",
        5.0 * PI,
        4.0,
    ),
    (
        "tools that are changed behind the last bead",
        "T0\nM83\nG1 X0 Z.2 F1200\nG1 X10 E1\nT1\nM104 S0\nT0\n",
        10.0,
        1.0,
    ),
    (
        "a text with a star, brackets with a semicolon, a feed of 0, a program's number",
        "O1000 (PART)\nM117 2*3 of 9 (\nM83\nG1 X0 Z.2 F1200\nG1 F0\nG1 X10 (a; b) E1\n",
        10.0,
        1.0,
    ),
    (
        "CR alone ends lines, NUL and Ctrl-Z files",
        "M83\rG1 X0 Z.2 F1200\rG1 X10 E1\rG1 X20 E1\r\u{1a}\0\0",
        20.0,
        2.0,
    ),
    (
        "an inverse time of the extruder alone",
        "G91.1\nM83\nG93\nG1 X0 Z.2 F100\nG1 E-1 F600\nG1 E1 F600\nG1 X10 E1 F60\n",
        10.0,
        1.0,
    ),
];

#[test]
fn files_are_read_as_their_firmware_runs_them() {
    for (what, text, length_mm, used_mm) in READ {
        let read = program(text.as_bytes());
        let (length, used) = (read.print_mm(), filament_mm(&read));
        assert!(
            (length / length_mm - 1.0).abs() < LENGTH_SHARE,
            "{what}: {length} mm"
        );
        // Figures of E have 3 decimals and more.
        assert!(
            (used / used_mm - 1.0).abs() < 1e-4,
            "{what}: {used} mm of filament"
        );
    }
    // What was concluded is reported.
    for (text, part) in [(READ[4].1, "taken as relative"), (READ[9].1, "in mm³")] {
        let notes = program(text.as_bytes()).notes.join("\n");
        assert!(notes.contains(part), "{notes}");
    }
}

/// Goal: motion beside a spindle's code is made, and what a laser does without power is no bead. Method: programs
/// without extrusion.
#[test]
fn beads_of_machine_tools_are_where_they_cut() {
    for (text, length_mm, passes) in [
        (
            "G21 G90\nG0 Z.2\nM3 S200 G1 X70 F600\nM5 G0 X50 Y10\nM3 S200 G1 X70\nM5\n",
            90.0,
            2,
        ),
        (
            "G21 G90\nM4 S0\nG1 X10 Y10 F1000\nG1 X20 S500\nG1 X30 S0\nG1 X40 S500\n",
            20.0,
            2,
        ),
        ("G0 Z.2\nM3\nG1 X10 F600\nM5\nG1 X20\nM3\nG1 X30\n", 20.0, 2),
        // A safe start is no word on what follows.
        ("M5\nG0 Z.2\nG1 X10 F600\n", 10.0, 1),
    ] {
        let read = program(text.as_bytes());
        assert!(
            (read.print_mm() - length_mm).abs() < 1e-6,
            "{text}: {}",
            read.print_mm()
        );
        assert_eq!(read.passes.len(), passes, "{text}");
    }
}

/// Refused: what for.
const REFUSED: [(&str, &str); 14] = [
    (
        "M83\nG1 X0 Z.2 F1200\nG1 X10 E1\nM120\nG91\nM121\nG1 X20 E1\n",
        "line 6: M121 takes back",
    ),
    (
        "M82\nG1 X10 Z.2 F1200\nG1 X20 E1\nG92\nG1 X10 E1\n",
        "line 4: G92 without axes",
    ),
    (
        "M83\nG1 X10 Y0 Z.2 F1200\nG3 X0 Y10 I-10 J0 P1 E4\n",
        "line 3: P of an arc counts",
    ),
    ("G1 X10 E1\nT1\nG1 X20 E2\n", "line 2: tool T1 after T0"),
    (
        "G1 X10 Z.2 E1\nRESTORE_GCODE_STATE NAME=b\n",
        "line 2: no SAVE_GCODE_STATE before it has the name 'b'",
    ),
    ("G1 X10 E1 F0", "line 1: F0 is no feed rate"),
    (
        "M83\nG1 X10 Z.2 E1 F1200\nG1 E-1 F0.001\nG0 X20\nG1 E1 F1800\nG1 X30 E1\n",
        "line 3: the extruder alone is to move",
    ),
    (
        "G1 X10 Z.2 E1 F0.6\n",
        "line 1: it prints at 0.01 mm/s for 1000",
    ),
    ("M83\nG1 X10 Z.2 E1000000000 F1200\n", "line 2: a bead of"),
    (
        "M83\nG1 X10 Z.2 E1 F1200\nG1 E-100000 F6000\nG1 X20 E1\n",
        "mm³ are to be pushed or pulled on the spot, more than 20000",
    ),
    (
        "G91.1\nM83\nG0 X10\nG3 X10 Y0 I-10 J0 P20 E1000000000\n",
        "line 4: a bead of",
    ),
    (
        "G1 X1 (never ends\nG1 X10 E1\n",
        "line 1: the comment that begins with '('",
    ),
    (
        "PRINT_START BED_TEMP=hot\nG1 X10 E1\n",
        "line 1: BED_TEMP='hot'",
    ),
    ("N1 G1 X10*99\nG1 X10 E1\n", "line 1: its checksum is 99"),
];

#[test]
fn what_cannot_be_decided_or_run_is_refused_with_the_line() {
    for (text, part) in REFUSED {
        let error = error(text.as_bytes());
        assert!(error.contains(part), "{text}: {error}");
    }
    // Bytes that are no text, in a comment and in a word.
    let latin = b"; 210 \xb0C, f\xfcr PLA\nM83\nG1 X0 Z.2 F1200\nG1 X10 E1 ; \xb5m\n";
    assert!((filament_mm(&program(latin)) - 1.0).abs() < 1e-9);
    assert!(error(b"G1 X1 E1\nG1 X\xb5 E1\n").contains("line 2: "));
}

/// Goal: curves of a few lines make no millions of moves, and no way of hours. Method: arcs of twenty turns, one
/// behind the other, and one of ninety; what they may come to is checked before it is made.
#[test]
fn turns_of_arcs_do_not_fill_the_memory() {
    let arcs = "G3 X10 Y0 I-10 J0 P20 E200\n".repeat(500);
    let many = error(format!("G91.1\nM83\nG0 X10\n{arcs}").as_bytes());
    // 222.14 chords a turn, 4,443 a line of 26 bytes: the 59th is beyond 200,000 and 40 a byte.
    assert!(many.contains("line 62: the curves"), "{many}");
    // 28 m, where 2 m and 50 mm a byte are allowed: 160 s and 1.7 GB of planning at 2 mm/s.
    let wide = error(b"G91.1\nM83\nG0 X50\nG3 X50 Y0 I-50 J0 P90 E900\n");
    assert!(wide.contains("line 4: the curves"), "{wide}");
}

/// Goal: outlines of objects, which are longer than any line of words, are no reason to refuse. Method: one of 6 kB.
#[test]
fn outlines_of_objects_are_of_any_length() {
    let outline = "[12.345,67.890],".repeat(400);
    let text = format!(
        "EXCLUDE_OBJECT_DEFINE NAME=a CENTER=1,2 POLYGON=[{outline}]\nM83\nG1 X0 Z.2 F1200\nG1 X10 E1\n"
    );
    assert!((program(text.as_bytes()).print_mm() - 10.0).abs() < 1e-9);
    let words = format!("G1 X{}\n", "1".repeat(2000));
    assert!(error(words.as_bytes()).contains("line 1 is longer than 1000"));
}

/// Goal: temperatures that a macro gets as words are the job's. Method: the usual names of them.
#[test]
fn macros_of_the_start_have_temperatures() {
    for text in [
        "PRINT_START EXTRUDER_TEMP=220 BED_TEMP=60",
        "START_PRINT EXTRUDER=220 BED=60",
        "START_PRINT BED_TEMPERATURE=60 HOTEND=220",
    ] {
        let read = program(format!("{text}\nM83\nG1 X0 Z.2 F1200\nG1 X10 E1\n").as_bytes());
        let orders: Vec<String> = read.heat.iter().map(|placed| placed.order.text()).collect();
        assert_eq!(
            orders,
            ["bed 60 °C, waits", "hot end 220 °C, waits"],
            "{text}"
        );
    }
    let unknown = program(b"PRINT_START MATERIAL=PLA\nM83\nG1 X0 Z.2 F1200\nG1 X10 E1\n");
    assert!(
        unknown
            .notes
            .iter()
            .any(|note| note.contains("no word of PRINT_START"))
    );
}

fn pushes(pass: &GcodePass) -> [Option<f64>; 2] {
    let rounded = |mm3: f64| (1e6 * mm3 / FILAMENT_MM2).round() / 1e6;
    [pass.prime, pass.retract].map(|push| push.and_then(|push| push.mm3).map(rounded))
}

/// Goal: pairs of retract and prime are no deeper for being many. Method: fifteen before the first bead, which
/// came to one prime of 36 mm³; two between beads.
#[test]
fn pairs_of_retract_and_prime_are_one() {
    let pairs = "G1 E-1 F1800\nG1 E1\n".repeat(15);
    let text = format!("M83\nG1 X0 Y0 Z.2 F1200\n{pairs}G1 X10 E.5 F1200\n");
    assert_eq!(
        pushes(&program(text.as_bytes()).passes[0]),
        [Some(1.0), None]
    );
    let two = program(
        b"M83\nG1 X0 Y0 Z.2 F1200\nG1 X10 E.5\nG1 E-.8 F1800\nG1 E.8\nG1 E-.8\nG0 X20\nG1 E.8\nG1 X30 E.5 F1200\n",
    );
    assert_eq!(pushes(&two.passes[0]), [None, Some(0.8)]);
    assert_eq!(pushes(&two.passes[1]), [Some(0.8), None]);
    assert!(
        two.notes
            .iter()
            .any(|note| note.contains("line 6") && note.contains("made one"))
    );
}

fn heights_mm(program: &GcodeProgram) -> Vec<f64> {
    let legs = program.passes.iter().flat_map(|pass| &pass.legs);
    legs.map(|leg| (leg.height_mm.unwrap_or(f64::NAN) * 1e6).round() / 1e6)
        .collect()
}

/// Goal: heights and layers as they are printed. Method: one program a kind.
#[test]
fn heights_are_those_of_the_print() {
    let told = program(
        b"M83\n;LAYER_CHANGE\n;HEIGHT:0.199999\nG0 Z.2\nG1 X10 E1 F1200\n;HEIGHT:0.4\nG0 Y5\nG1 X0 E1\n",
    );
    assert_eq!((heights_mm(&told), told.layers()), (vec![0.2, 0.4], 1));
    // Three turns of a vase, a fifth of a millimetre each.
    let corners = ["X10", "Y10", "X0", "Y0"]
        .iter()
        .cycle()
        .take(12)
        .enumerate();
    let legs = corners.map(|(i, to)| format!("G1 {to} Z{:.2} E.4\n", 0.25 + 0.05 * i as f64));
    let vase = format!("M83\nG1 X0 Y0 Z.2 F1200\n{}", legs.collect::<String>());
    let vase = program(vase.as_bytes());
    assert_eq!((heights_mm(&vase), vase.layers()), (vec![0.2; 12], 3));
    // Two objects one after the other, two layers each.
    let object = |x: u32| {
        format!(
            "G0 X{x}\nG0 Z.2\nG1 X{} E1\nG0 Z.4\nG1 X{x} E1\nG0 Z9\n",
            x + 10
        )
    };
    let objects = program(format!("M83\nG1 F1200\n{}{}", object(0), object(50)).as_bytes());
    assert_eq!((heights_mm(&objects), objects.layers()), (vec![0.2; 4], 4));
    let marked =
        |z: &str, n: u32| format!(";LAYER_CHANGE\n;LAYER:{n}\nG0 Z{z}\nG1 X{} E1\n", 10 * n);
    let both = format!("M83\nG1 X5 F1200\n{}{}", marked(".2", 0), marked(".4", 1));
    assert_eq!(program(both.as_bytes()).layers(), 2);
}

/// Goal: layers below a line that primes above them are layers of their own, as high as they are: IceSL's first two, at
/// 0.12 and 0.24 mm below a line at 0.3 mm, were one with that line. Method: heights by hand.
#[test]
fn layers_below_a_line_that_primes_are_their_own() {
    let layer = |z: &str| format!("G0 Z{z}\nG1 X10 E1\nG0 X0\n");
    let text: String = ["0.3", "0.12", "0.24", "0.36"].map(layer).concat();
    let read = program(format!("M83\nG1 F1200\n{text}").as_bytes());
    assert_eq!(
        (heights_mm(&read), read.layers()),
        (vec![0.3, 0.12, 0.12, 0.12], 4)
    );
}

/// Planned and packed by one thread, and the seconds of its processor.
fn planned(text: &str) -> (Result<GcodePlan, String>, f64) {
    let program = program(text.as_bytes());
    let settings = Settings::default();
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .expect("a thread");
    pool.install(|| {
        let before_s = thread_s();
        let plan = plan_gcode(&program, None, &settings, &()).map_err(|error| error.to_string());
        if let Ok(plan) = &plan {
            let mut packing = JobPacking::new(Cursor::new(Vec::new()));
            packing
                .take(&plan.stream, 0, &plan.settings)
                .expect("packed");
            packing.finish(&plan.settings).expect("a job");
        }
        (plan, thread_s() - before_s)
    })
}

/// Goal: a speed holds for the move that asks for it. Method: a millimetre at 5 mm/s before 199 at 50, which took
/// the slow one's along: 41.5 s; by hand 0.2 s and 4.0 s, and less than 2 s for the way there and accelerations.
#[test]
fn a_short_slow_leg_leaves_the_next_its_speed() {
    let (plan, _) = planned("G0 X10 Z.2\nG1 X11 E.03 F300\nG1 X210 E6 F3000\n");
    let print_s = plan.expect("a plan").figures.print_s;
    assert!((4.1..6.2).contains(&print_s), "{print_s} s");
    // A short fast one between slow ones is no slower than it asks for either, and no faster.
    let (plan, _) = planned("G0 X10 Z.2\nG1 X20 E.3 F600\nG1 X21 E.33 F300\nG1 X31 E.63 F600\n");
    let print_s = plan.expect("a plan").figures.print_s;
    assert!(print_s > 1.0 + 0.2 + 1.0, "{print_s} s");
}

/// Lines of an export, which took a million seconds of machine time and 11 GB.
const INVERSE_TIME: &str = "G92 E0 C0\nG93\nG1 E.5 F990\nG1 X0.13 C-15 E.5045 F2353\n";

/// Goal: an extruder's inverse time is that of its move. Method: 60 / 990 s and 60 / 2353 s, some tenths of a
/// second with all accelerations.
#[test]
fn lines_of_inverse_time_end() {
    let (plan, _) = planned(INVERSE_TIME);
    let plan = plan.expect("a plan");
    let prime = program(INVERSE_TIME.as_bytes()).passes[0]
        .prime
        .expect("a prime");
    let rate_mm3_s = prime.rate_mm3_s.expect("a rate");
    assert!(
        (rate_mm3_s - 0.5 * FILAMENT_MM2 * 990.0 / 60.0).abs() < 1e-6,
        "{rate_mm3_s}"
    );
    assert!(plan.motion.duration_s < 10.0, "{}", plan.motion.duration_s);
}

/// Goal: planning and packing take the work of the path, not of its time. Method: the same bead at 1 mm/s and at
/// 0.1 mm/s: ten times the time, less than three times the work (the wire has a knot every 2 s at least); its
/// volume and time are right, with 3 s for the way there.
#[test]
fn a_crawl_takes_the_work_of_its_path() {
    let (bead, bead_s) = planned("G0 Z.2\nG1 X12 E.4 F60\n");
    let (crawl, crawl_s) = planned("G0 Z.2\nG1 X12 E.4 F6\n");
    let (bead, crawl) = (bead.expect("a plan"), crawl.expect("a plan"));
    println!("{bead_s:.3} s and {crawl_s:.3} s of processor");
    assert!(crawl_s < 3.0 * bead_s, "{bead_s} {crawl_s}");
    for (plan, seconds) in [(&bead, 12.0), (&crawl, 120.0)] {
        let (f, wanted_mm3) = (&plan.figures, 0.4 * FILAMENT_MM2);
        assert!((f.volume_mm3 / wanted_mm3 - 1.0).abs() < 1e-4, "{f:?}");
        assert!((seconds..seconds + 3.0).contains(&f.print_s), "{f:?}");
        assert!(plan.motion.ratios.speed <= 1.0 && plan.motion.ratios.acceleration <= 1.0);
    }
}

/// A program of so many lines with every mode of places and of E.
fn random_program(random: &mut Pcg64Mcg, lines: usize) -> String {
    let mut text = "M83\nG1 X0 Y0 Z0.2 F1800\n".to_string();
    for _ in 0..lines {
        let at = |random: &mut Pcg64Mcg| (random.random_range(-400i32..400) as f64) * 0.125;
        let (x, y) = (at(random), at(random));
        let e = f64::from(random.random_range(1u32..40)) * 0.125;
        text += &match random.random_range(0u32..12) {
            0 => "G90\n".to_string(),
            1 => "G91\n".to_string(),
            2 => "M82\nG92 E0\n".to_string(),
            3 => "M83\n".to_string(),
            4 => format!("G92 X{x} E{e}\n"),
            5 => format!("G0 X{x} Y{y}\n"),
            6 => "G92 E0\nG1 E-0.5 F1800\n".to_string(),
            _ => format!("G1 X{x} Y{y} E{e} F1200\n"),
        };
    }
    text
}

/// Goal: modes of places and of E, in any order, come to the same beads. Method: seeded programs against a
/// reading that shares nothing with this one, for three firmwares.
#[test]
fn random_programs_are_read_as_by_another_reader() {
    let mut random = Pcg64Mcg::seed_from_u64(41);
    let mut read_mm = 0.0;
    for round in 0..200 {
        let text = random_program(&mut random, 40);
        for (head, g91_is_of_e, g90_forgets) in [
            (";FLAVOR:Marlin\n", true, true),
            ("; gcode_flavor = klipper\n", true, false),
            ("; gcode_flavor = reprapfirmware\n", false, false),
        ] {
            let meant = Meant {
                e_relative: false,
                g91_is_of_e,
                g90_forgets,
            };
            let text = format!("{head}{text}");
            let wanted = plain(&text, meant);
            if wanted.print_mm == 0.0 {
                continue;
            }
            let Ok(ours) = read(text.as_bytes(), "random", &GcodeOptions::default()) else {
                // A bead backwards over a long way may be more than a nozzle lays.
                continue;
            };
            read_mm += wanted.print_mm;
            let (length, used) = (ours.print_mm(), filament_mm(&ours));
            assert!(
                (length / wanted.print_mm - 1.0).abs() < 1e-9,
                "{round} {head}{text}"
            );
            assert!(
                (used / wanted.filament_mm - 1.0).abs() < 1e-9,
                "{round} {head}{text}"
            );
        }
    }
    assert!(read_mm > 1e5, "{read_mm}");
}

/// Goal: whole files of slicers have the length, filament and layers of another reading. Method: the reference
/// files, without arcs.
#[test]
fn files_of_slicers_are_read_as_by_another_reader() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data/peer");
    for path in files(folder, "gcode") {
        let text = std::fs::read_to_string(&path).expect("a file");
        let wanted = plain(&text, Meant::default());
        let ours = program(text.as_bytes());
        let file = path.display();
        assert!(
            (ours.print_mm() / wanted.print_mm - 1.0).abs() < 1e-6,
            "{file}"
        );
        assert!(
            (filament_mm(&ours) / wanted.filament_mm - 1.0).abs() < 1e-6,
            "{file}"
        );
        assert_eq!(ours.layers() as usize, wanted.layers, "{file}");
    }
}
