//! Goal: modes, units, arcs, retraction and comments come out as a controller would move; what is no
//! G-code is refused with line and remedy. Method: short programs whose passes are known.
use super::*;

fn program(text: &str) -> GcodeProgram {
    read(text.as_bytes(), "t", &GcodeOptions::default()).expect(text)
}

fn tips(pass: &GcodePass) -> Vec<[f64; 3]> {
    pass.points.iter().map(|place| place.tip_mm).collect()
}

/// Cross-section of 1.75 mm filament.
const FILAMENT_MM2: f64 = 0.25 * std::f64::consts::PI * 1.75 * 1.75;

#[test]
fn modes_and_units() {
    let absolute = program("G1 X10 Y0 Z.2 F1200\nG1 X20 E1\nG1 Y10 E3\nG92 E0 X0\nG1 X-5 E1\n");
    assert_eq!(absolute.passes.len(), 1);
    let pass = &absolute.passes[0];
    assert_eq!(
        tips(pass),
        [
            [10.0, 0.0, 0.2],
            [20.0, 0.0, 0.2],
            [20.0, 10.0, 0.2],
            [15.0, 10.0, 0.2]
        ]
    );
    let volumes: Vec<f64> = pass
        .legs
        .iter()
        .map(|leg| leg.volume_mm3.expect("told") / FILAMENT_MM2)
        .collect();
    assert!(
        volumes
            .iter()
            .zip([1.0, 2.0, 1.0])
            .all(|(a, b)| (a - b).abs() < 1e-12),
        "{volumes:?}"
    );
    assert_eq!(pass.legs[0].speed_mm_s, 20.0);
    assert_eq!(pass.legs[0].height_mm, Some(0.2));
    let relative = program("G91\nM83\nG1 X10 Z.2 F600\nG1 X10 E1\nG90\nG1 X10 E1 F1200\n");
    assert_eq!(
        tips(&relative.passes[0]),
        [[10.0, 0.0, 0.2], [20.0, 0.0, 0.2], [10.0, 0.0, 0.2]]
    );
    assert_eq!(relative.passes[0].legs[1].speed_mm_s, 20.0);
    // Marlin's G90 is also that of E, Klipper's and Prusa's is not.
    let marlin = program(";FLAVOR:Marlin\nM83\nG1 X1 E5\nG90\nG1 X2 E6\n");
    assert!((marlin.volume_mm3().expect("told") / FILAMENT_MM2 - 6.0).abs() < 1e-12);
    let inches = program("G20\nG1 X1 Z.01 F60\nG1 X2 E.1\n");
    assert!((inches.passes[0].points[1].tip_mm[0] - 50.8).abs() < 1e-12);
    assert!((inches.passes[0].legs[0].speed_mm_s - 25.4).abs() < 1e-12);
    let volumetric = program("M200 D2\nM221 S50\nM220 S200\nG1 X10 E3 F600\n");
    assert_eq!(volumetric.volume_mm3(), Some(1.5));
    assert_eq!(volumetric.passes[0].legs[0].speed_mm_s, 20.0);
    let inverse = program("G93\nG1 X10 E1 F6\n");
    assert_eq!(inverse.passes[0].legs[0].speed_mm_s, 1.0);
}

#[test]
fn curves_go_through_planes_modes_and_turns() {
    let length = |text: &str| program(text).print_mm();
    let quarter = 5.0 * std::f64::consts::PI;
    for text in [
        "G0 X10\nG3 X0 Y10 I-10 E1",
        "G0 X10\nG2 X20 Y10 R10 E1",
        "G0 X10\nG90.1\nG3 X0 Y10 I0 J0 E1",
        "G18\nG0 Z10\nG3 X10 Z0 K-10 E1",
        "G19\nG0 Y10\nG3 Y0 Z10 J-10 E1",
        "G0 X10\nG5 I0 J5.522847 P5.522847 Q0 X0 Y10 E1",
    ] {
        // G5 is a Bezier curve, 0.03 % off a circle.
        assert!(
            (length(text) / quarter - 1.0).abs() < 4e-4,
            "{text}: {}",
            length(text)
        );
    }
    let helix = program("G91.1\nG0 X10 Z1\nG3 X10 Y0 Z2 I-10 P2 E4\n");
    let pass = &helix.passes[0];
    assert_eq!(
        pass.points.last().map(|place| place.tip_mm),
        Some([10.0, 0.0, 2.0])
    );
    assert!((helix.print_mm() / (8.0 * quarter) - 1.0).abs() < 1e-3);
    assert!((helix.volume_mm3().expect("told") / FILAMENT_MM2 - 4.0).abs() < 1e-9);
}

#[test]
fn retraction_and_travel_part_passes() {
    let text = "M83\nG1 E3 F300 ; purge\nG1 E-1 F1800\nG0 X5 Y5 Z.2\nG1 E1\nG1 X15 E.5 F1200\nG1 E-.8 F2400\n\
                G0 Z.6\nG0 X20 Y9\nG0 Z.2\nG1 E.9\nG1 Y19 E.5\nG10\nG0 X0\nG11\nG1 X-5 E.2\nG0 X-9\nG1 X-11 E.1\n";
    let read = program(text);
    assert_eq!(read.passes.len(), 4);
    let volumes = |push: Option<Push>| {
        push.and_then(|push| push.mm3)
            .map(|mm3| (mm3 / FILAMENT_MM2 * 1e9).round() / 1e9)
    };
    assert_eq!(volumes(read.passes[0].prime), Some(1.0));
    assert_eq!(volumes(read.passes[0].retract), Some(0.8));
    // A little more than was pulled is a prime; what went into the air before is not.
    assert_eq!(volumes(read.passes[1].prime), Some(0.9));
    assert!(
        read.notes
            .iter()
            .any(|note| note.contains("line 2") && note.contains("7.22 mm³")),
        "{:?}",
        read.notes
    );
    assert_eq!(
        read.passes[0].retract.and_then(|push| push.rate_mm3_s),
        Some(40.0 * FILAMENT_MM2)
    );
    let ways: Vec<[f64; 3]> = read.passes[1]
        .travel
        .iter()
        .map(|place| place.tip_mm)
        .collect();
    assert_eq!(ways, [[15.0, 5.0, 0.6], [20.0, 9.0, 0.6]]);
    // Firmware retraction without M207 is the machine's own.
    assert_eq!(
        read.passes[1].retract,
        Some(Push {
            mm3: None,
            rate_mm3_s: None
        })
    );
    assert_eq!(
        read.passes[2].prime,
        Some(Push {
            mm3: None,
            rate_mm3_s: None
        })
    );
    assert_eq!((read.passes[2].retract, read.passes[3].prime), (None, None));
}

#[test]
fn layers_and_widths_are_those_of_comments_or_of_z() {
    let told = program(
        ";LAYER_CHANGE\n;HEIGHT:0.3\n;WIDTH:0.5\nG0 Z.3\nG1 X9 E1\n;WIDTH:0.6\nG1 X19 E2\n;LAYER_CHANGE\n;HEIGHT:0.2\nG0 Z.5\nG1 X0 E4\n",
    );
    assert_eq!(
        told.passes
            .iter()
            .map(|pass| pass.layer)
            .collect::<Vec<_>>(),
        [0, 1]
    );
    let legs: Vec<_> = told
        .passes
        .iter()
        .flat_map(|pass| &pass.legs)
        .map(|leg| (leg.width_mm, leg.height_mm))
        .collect();
    assert_eq!(
        legs,
        [
            (Some(0.5), Some(0.3)),
            (Some(0.6), Some(0.3)),
            (Some(0.6), Some(0.2))
        ]
    );
    let plain = program("G0 Z.3\nG1 X9 E1\nG0 Z5\nG0 X0\nG0 Z.3\nG1 Y5 E2\nG0 Z.55\nG1 X9 E3\n");
    assert_eq!(
        plain
            .passes
            .iter()
            .map(|pass| pass.layer)
            .collect::<Vec<_>>(),
        [0, 0, 1]
    );
    assert!((plain.passes[2].legs[0].height_mm.expect("z") - 0.25).abs() < 1e-12);
}

#[test]
fn what_extrudes_nothing_prints_what_it_mills() {
    let read = program(
        "%\nG21 G90\nG0 Z5\nG0 X1 Y1\nG1 Z.2 F300\nG1 X9 F900\nX9 Y9 C45\nG0 Z5\nM30\nG1 X99\n",
    );
    assert_eq!(read.passes.len(), 1);
    assert_eq!(
        tips(&read.passes[0]),
        [[1.0, 1.0, 0.2], [9.0, 1.0, 0.2], [9.0, 9.0, 0.2]]
    );
    assert!(read.has_headings && !read.has_tilts);
    assert_eq!(read.volume_mm3(), None);
    assert_eq!(read.passes[0].prime, Some(Push::default()));
}

#[test]
fn turns_of_the_head_are_axes_and_headings() {
    let place = |a: f64, b: f64, c: f64| Place {
        tip_mm: [0.0; 3],
        turn_deg: [a, b, c],
    };
    let (axis, heading_rad) = place(0.0, 0.0, 30.0).axis_and_heading();
    assert!((axis.z - 1.0).abs() < 1e-15 && (heading_rad.to_degrees() - 30.0).abs() < 1e-12);
    let (axis, _) = place(0.0, 20.0, 0.0).axis_and_heading();
    assert!((axis.x - 20f64.to_radians().sin()).abs() < 1e-12);
    let (axis, heading_rad) = place(20.0, 0.0, -10.0).axis_and_heading();
    assert!((axis.y + 20f64.to_radians().sin()).abs() < 1e-12);
    assert!((heading_rad.to_degrees() + 10.0).abs() < 1e-9);
}

#[test]
fn what_is_not_done_is_told_with_its_line() {
    let read = program(
        "M141 S60\nG29\nM900 K0.05\nM117 hello\nSTART_PRINT BED=60\nG1 X9 E1\nM900 K0\nM106 P1 S255\n",
    );
    let notes = read.notes.join("\n");
    for part in [
        "line 1 M141 S60",
        "line 8 M106 P1 S255",
        "line 2 G29",
        "line 3 M900 (2 times)",
        "line 4 M117",
        "line 5 START_PRINT",
    ] {
        assert!(notes.contains(part), "{part}: {notes}");
    }
}

/// Goal: orders of heaters and fan are read as controllers mean them. Method: one line of each, before the
/// only bead.
#[test]
fn orders_of_heaters_and_fans_are_read() {
    let read = program(
        "M140 S60\nM104 T1 S190\nM109 R215\nM116\nM106\nM106 S0.25\nM106 S51\nM107\nM109\nM190 S0\nG1 X9 E1\n",
    );
    let orders: Vec<(usize, String)> = read
        .heat
        .iter()
        .map(|placed| (placed.line, placed.order.text()))
        .collect();
    let orders: Vec<(usize, &str)> = orders.iter().map(|(l, o)| (*l, &**o)).collect();
    assert_eq!(
        orders,
        [
            (1, "bed 60 °C"),
            (2, "second hot end 190 °C"),
            (3, "hot end 215 °C, waits"),
            (4, "bed 60 °C, waits"),
            (4, "hot end 215 °C, waits"),
            (4, "second hot end 190 °C, waits"),
            (5, "fan 100 %"),
            (6, "fan 25 %"),
            (7, "fan 20 %"),
            (8, "fan off"),
            (9, "hot end 215 °C, waits"),
            (10, "bed off"),
        ]
    );
    let first = HeatPlace::Leaving(0);
    assert!(read.heat.iter().all(|placed| placed.place == first));
}

/// Lines and orders of a program whose only bead comes last.
fn orders_of(text: &str) -> (Vec<String>, GcodeProgram) {
    let read = program(&format!("{text}G1 X9 E1\n"));
    let told = |placed: &PlacedOrder| format!("{} {}", placed.line, placed.order.text());
    (read.heat.iter().map(told).collect(), read)
}

/// Goal: RepRapFirmware's G10 with a tool sets its temperature and retracts nothing. Method: G10 and M568 of
/// two tools and of a third, beside a G10 that retracts.
#[test]
fn temperatures_of_tools_are_no_retracts() {
    let (orders, read) = orders_of(
        "G10 P0 S215 R180\nG10 S190 P1\nM568 P0 S210.5 A2\nG10 S200\nG10 P2 S99\nG10 P1 X3 Y4\nM116\nM568 P1 S0\n",
    );
    assert_eq!(
        orders,
        [
            "1 hot end 215 °C",
            "2 second hot end 190 °C",
            "3 hot end 210.5 °C",
            "4 hot end 200 °C",
            "7 hot end 200 °C, waits",
            "7 second hot end 190 °C, waits",
            "8 second hot end off",
        ]
    );
    assert_eq!((read.passes.len(), read.passes[0].prime), (1, None));
    let notes = read.notes.join("\n");
    for part in [
        "line 1 G10 R",
        "line 3 M568 A",
        "line 5 G10 P2 S99",
        "line 6 G10 P1 X3 Y4",
    ] {
        assert!(notes.contains(part), "{part}: {notes}");
    }
    // A switch of 0 or 1 retracts, as Marlin has it.
    for retract in ["G10", "G10 S1", "G10 S0"] {
        let text = format!("M207 S1\nG1 X9 E1\n{retract}\nG0 X19\nG11\nG1 X29 E2\n");
        let read = program(&text);
        let pulled = read.passes[0].retract.and_then(|push| push.mm3);
        assert!(
            (pulled.expect(retract) - FILAMENT_MM2).abs() < 1e-9,
            "{retract}"
        );
        assert!(read.heat.is_empty());
    }
    let hot = read_error("G10 P0 S9000\nG1 X1 E1");
    assert!(hot.contains("line 1: a target of 9000"), "{hot}");
}

fn read_error(text: &str) -> String {
    let error = read(text.as_bytes(), "t", &GcodeOptions::default());
    error.expect_err(text).to_string()
}

/// Goal: Klipper's commands are orders, waits those that a target reaches. Method: each of them, known and
/// unknown sections.
#[test]
fn orders_of_klipper_are_read() {
    let (orders, read) = orders_of(
        "SET_HEATER_TEMPERATURE HEATER=heater_bed TARGET=60\nset_heater_temperature heater=extruder target=215\n\
         TEMPERATURE_WAIT SENSOR=heater_bed MINIMUM=58\nTEMPERATURE_WAIT SENSOR=extruder MINIMUM=210 MAXIMUM=220\n\
         TEMPERATURE_WAIT SENSOR=extruder MAXIMUM=50\nTEMPERATURE_WAIT SENSOR=\"temperature_sensor chamber\" MINIMUM=40\n\
         SET_FAN_SPEED FAN=part_cooling_fan SPEED=0.5\nSET_FAN_SPEED FAN=exhaust SPEED=1\n\
         SET_HEATER_TEMPERATURE HEATER=chamber TARGET=50\nSET_HEATER_TEMPERATURE HEATER=extruder1 TARGET=190\n\
         SET_HEATER_TEMPERATURE HEATER=extruder1\nTURN_OFF_HEATERS\n",
    );
    assert_eq!(
        orders,
        [
            "1 bed 60 °C",
            "2 hot end 215 °C",
            "3 bed 60 °C, waits",
            "4 hot end 215 °C, waits",
            "7 fan 50 %",
            "10 second hot end 190 °C",
            "11 second hot end off",
            "12 hot end off",
            "12 bed off",
        ]
    );
    let notes = read.notes.join("\n");
    for line in [5, 6, 8, 9] {
        assert!(notes.contains(&format!("line {line} ")), "{line}: {notes}");
    }
    for (text, part) in [
        (
            "SET_HEATER_TEMPERATURE HEATER=extruder TARGET=hot",
            "line 1: TARGET='hot'",
        ),
        (
            "SET_HEATER_TEMPERATURE HEATER=extruder TARGET=-5",
            "line 1: a target of -5",
        ),
        (
            "SET_FAN_SPEED FAN=fan SPEED=255",
            "line 1: a target of 255: write 0 to 1",
        ),
        (
            "SET_RETRACTION RETRACT_LENGTH=5000",
            "line 1: RETRACT_LENGTH='5000'",
        ),
    ] {
        let error = read_error(&format!("{text}\nG1 X1 E1"));
        assert!(error.contains(part), "{text}: {error}");
    }
}

/// Goal: T is a tool change where it stands alone, and numbers that no tool has change nothing. Method: what
/// start and end blocks of printers with changers write.
#[test]
fn only_tools_change_tools() {
    let read = program(
        "M83\nM620 S0A\nT0\nM221 S; kept\nM221 Z0\nG1 E50 F200\nT1000\nG28 Z P0 T300\nG1 X9 E1 F1200\nM104 T1 S0\n\
         M109 S200 T0\nG1 X0 E1\nM221 R; back\nT255\nT65535\n",
    );
    assert_eq!((read.passes.len(), read.passes[0].points.len()), (1, 3));
    assert!(read_error("T0\nG1 X1 E1\nM6 T1\nG1 X2 E2").contains("line 3: tool T1 after T0"));
    assert!(read_error("T0\nG1 X1 E1\nT1 G1 X2 E2").contains("line 3: tool T1 after T0"));
}

/// Goal: an arc of its centre alone is a full circle. Method: its length.
#[test]
fn a_centre_alone_is_a_full_circle() {
    let read = program("G0 X5\nG2 I-5 E3\n");
    assert!((read.print_mm() / (10.0 * std::f64::consts::PI) - 1.0).abs() < 4e-4);
}

/// Broken files: what each is refused for.
const BROKEN: [(&str, &str); 37] = [
    ("", "nothing is printed"),
    ("; only a comment\n", "nothing is printed"),
    ("G1 X10 Y10\nG1 X0 E-1\n", "nothing is printed"),
    ("G28\nM104 S200\n", "nothing is printed"),
    ("G1 X10 Y", "line 1: Y has no number"),
    ("G1 X1 E1\nG1 X", "line 2: X has no number"),
    ("G1 X1.2.3 E1", "line 1: X has no number"),
    ("G1 X1,5 E1", "line 1: X has no number"),
    ("G1 X-", "line 1: X has no number"),
    ("G1 Xnan E1", "line 1: N is given twice"),
    ("G1 X1 X2 E1", "line 1: X is given twice"),
    ("G1 X1 E1 E2", "line 1: E is given twice"),
    ("X10 Y10 E1", "line 1: it names an axis, and no G0"),
    ("G0 G1 X1", "line 1: two motions"),
    ("G1 X1e9 E1", "E is given twice"),
    ("G1 X1000000000 E1", "line 1: X1000000000 is beyond 100000"),
    (
        "G91\nG1 X90000 E1\nG1 X90000 E1",
        "line 3: X180000 is beyond",
    ),
    ("G1 X10 E1 F0", "line 1: F0 is no feed rate"),
    ("G1 X10 E1 F-100", "line 1: F-100 is no feed rate"),
    ("G93\nG1 X10 E1", "line 2: with G93"),
    ("G2 X10 Y0 E1", "line 1: the arc has neither centre"),
    ("G2 X10 Y0 R1 E1", "line 1: the arc of radius 1"),
    (
        "G3 X10 Y0 I2 J0 E1",
        "line 1: the arc has radius 2.0000 mm at its start and 8.0000",
    ),
    ("G91.1\nG2 X10 Y0 I5 P900 E1", "line 2: the arc has P900"),
    ("G5 X10 Y0 I1 J1 E1", "line 1: the arc (G5) needs P and Q"),
    (
        "G18\nG5 X10 I1 J1 P1 Q1 E1",
        "line 2: the arc (G5) lies in the XY plane",
    ),
    // Found by fuzzing: a control point beyond all machines.
    (
        "G5 X1 Y1 I1 J2 P-4829141 Q1 E1",
        "line 1: the arc leaves 100000 mm",
    ),
    ("G41 D1\nG1 X1 E1", "line 1: G41 is not read"),
    ("G55\nG1 X1 E1", "line 1: G55 is not read"),
    ("G81 X1 Z-1 R1", "line 1: G81 is not read"),
    ("#1=5\nG1 X#1", "line 1: variables, expressions"),
    ("O100 while [#1 LT 5]", "line 1: variables, expressions"),
    ("N1 G1 X1*99", "line 1: its checksum is 99"),
    (
        "G1 X1 (never ends",
        "line 1: the comment that begins with '('",
    ),
    ("T0\nG1 X1 E1\nT1\nG1 X2 E2", "line 3: tool T1 after T0"),
    ("M200 D500\nG1 X1 E1", "line 1: a filament diameter of 500"),
    (
        "{\"exterior\": [[0,0]]}",
        "line 1: '{\"exterior\": [[0,0]]}' is no word",
    ),
];

#[test]
fn broken_files_are_refused() {
    for (text, part) in BROKEN {
        let error = read(text.as_bytes(), "t", &GcodeOptions::default())
            .expect_err(text)
            .to_string();
        assert!(error.contains(part), "{text}: {error}");
    }
    let long = format!("G1 X{}", "1".repeat(LINE_CHARS_MAX));
    let error = |bytes: &[u8]| {
        read(bytes, "t", &GcodeOptions::default())
            .expect_err("broken")
            .to_string()
    };
    assert!(error(long.as_bytes()).contains("line 1 is longer"));
    assert!(error(b"GCDE\x01\x00").contains("binary G-code"));
    assert!(error(b"G1 X1 \xff\xfe E1").contains("line 1: a word has bytes that are no text"));
    let tilted = ";headway extruder=E turns=ABC\nG1 X1 A0 E1\nG1 X2 A170 E2";
    assert!(error(tilted.as_bytes()).contains("line 3: the tool axis is tilted by 170"));
}
