//! G-code: codes that move, states, E, heights, and what claims much time or memory.

use super::Kind::{Gcode, Planned};
use super::Want::{Beads, Heights, Pushes, Refused, Seconds, Taken};
use super::{Case, case};
use std::f64::consts::PI;

/// A bead of 10 mm with 1 mm of filament behind what `head` says.
fn behind(head: &str) -> String {
    format!("{head}M83\nG1 X0 Y0 Z.2 F1200\nG1 X10 E1\n")
}

pub fn cases() -> Vec<Case> {
    let tables = [
        motions(),
        refused_codes(),
        states(),
        extrusion(),
        texts(),
        retracts(),
        heights(),
        claims(),
    ];
    tables.into_iter().flatten().collect()
}

/// What moves, and where to.
fn motions() -> Vec<Case> {
    let milled = |text: &str| format!("G21 G90\nG0 X0 Y0 Z.2\n{text}\n");
    vec![
        case(
            "a move beside a length offset",
            Gcode,
            milled("G0 Z5\nG43 Z.2 H1\nG1 X10 F600"),
            Heights(&[0.2]),
        ),
        case(
            "a move beside a spindle that stops",
            Gcode,
            milled("M3 S9 G1 X70 F600\nM5 G0 X50 Y10\nM3 S9 G1 X70"),
            Beads(90.0, 0.0, 1),
        ),
        case(
            "no power, no bead",
            Gcode,
            milled("M4 S0\nG1 X10 F600\nG1 X20 S500\nG1 X30 S0"),
            Beads(10.0, 0.0, 1),
        ),
        case(
            "a circle of its centre alone",
            Gcode,
            "M83\nG0 X5\nG2 I-5 E3\n",
            Beads(10.0 * PI, 3.0, 1),
        ),
        case(
            "a half circle by a radius a little short",
            Gcode,
            "M83\nG0 X0\nG2 X10 R4.9999 E1\n",
            Beads(5.0 * PI, 1.0, 1),
        ),
        case(
            "arcs in the plane XZ",
            Gcode,
            "M83\nG18\nG0 Z10\nG3 X10 Z0 K-10 E1\n",
            Beads(5.0 * PI, 1.0, 1),
        ),
        case(
            "offsets suspended and taken back",
            Gcode,
            "M83\nG1 X10 Z.2 F1200\nG92 X0\nG1 X10 E1\nG92.2\nG1 X30 E1\nG92.3\nG1 X40 E1\n",
            Beads(40.0, 3.0, 1),
        ),
        case(
            "homing within a print moves the head",
            Gcode,
            "M83\nG1 X10 Y0 Z.2 F1200\nG1 X20 E1\nG28 X\nG1 X10 E1\n",
            Beads(20.0, 2.0, 1),
        ),
        case(
            "inches and relative places",
            Gcode,
            "G20 G91\nM83\nG1 Z.01 F60\nG1 X1 E.1\nG1 Y-1 E.1\n",
            Beads(50.8, 5.08, 1),
        ),
        case(
            "G0 that extrudes is a bead",
            Gcode,
            "M83\nG0 Z.2 F1200\nG0 X10 E1\n",
            Beads(10.0, 1.0, 1),
        ),
        case(
            "axes without a code go on",
            Gcode,
            "M83\nG1 X0 Z.2 F1200\nX10 E1\nE1 X20\n",
            Beads(20.0, 2.0, 1),
        ),
        case(
            "a second per cent sign ends",
            Gcode,
            "%\nG21 G90\nG0 Z.2\nG1 X10 F600\n%\nG1 X20\n",
            Beads(10.0, 0.0, 1),
        ),
        case(
            "what stands behind M2",
            Gcode,
            behind("") + "M2\nG1 X99 E9\n",
            Beads(10.0, 1.0, 1),
        ),
    ]
}

/// Codes after which the others go elsewhere.
fn refused_codes() -> Vec<Case> {
    let milled = |text: &str| format!("G21 G90\nG0 Z.2\n{text}\nG1 X10 F600\n");
    vec![
        case(
            "diameters",
            Gcode,
            milled("G7"),
            Refused("line 3: G7 is not read"),
        ),
        case(
            "polar places",
            Gcode,
            milled("G16"),
            Refused("line 3: G16 is not read"),
        ),
        case(
            "scaled places",
            Gcode,
            milled("G51 X0 Y0 I2 J2"),
            Refused("line 3: G51 is not read"),
        ),
        case(
            "moved places",
            Gcode,
            milled("G52 X100"),
            Refused("line 3: G52 is not read"),
        ),
        case(
            "places moved by nothing",
            Gcode,
            milled("G52 X0 Y0"),
            Beads(10.0, 0.0, 1),
        ),
        case(
            "turned places",
            Gcode,
            milled("G68 X0 Y0 R90"),
            Refused("line 3: G68 is not read"),
        ),
        case(
            "a macro's call",
            Gcode,
            milled("G65 P1000"),
            Refused("line 3: G65 is not read"),
        ),
        case(
            "a subprogram's call",
            Gcode,
            milled("M98 P1000"),
            Refused("line 3: variables"),
        ),
        case(
            "a way back to a kept place",
            Gcode,
            behind("; gcode_flavor = reprapfirmware\n") + "G60 S0\nG0 X50\nG61 S0\nG1 X10 E1\n",
            Refused("line 7: G61 is not read"),
        ),
        case(
            "a condition of RepRapFirmware",
            Gcode,
            behind("") + "if move.axes[0].homed\n  G1 X20 E1\nelse\n  G1 X30 E1\n",
            Refused("line 4: variables"),
        ),
        case(
            "a loop of RepRapFirmware",
            Gcode,
            behind("") + "while iterations < 5\n  G1 X20 E1\n",
            Refused("line 4: variables"),
        ),
        case(
            "a tool of Klipper that has printed nothing yet",
            Gcode,
            behind("") + "ACTIVATE_EXTRUDER EXTRUDER=extruder1\nG1 X20 E1\n",
            Refused("line 4: tool T1 after T0"),
        ),
        case(
            "a second tool that cuts",
            Gcode,
            milled("T1 M6\nG1 X5 F600\nT2\nM6"),
            Refused("line 5: tool T2 after T1"),
        ),
        case(
            "a tool made ready that does not cut",
            Gcode,
            milled("T1 M6\nT2"),
            Beads(10.0, 0.0, 1),
        ),
        case(
            "another coordinate system",
            Gcode,
            milled("G55"),
            Refused("line 3: G55 is not read"),
        ),
    ]
}

/// Modes that are kept and come back.
fn states() -> Vec<Case> {
    let stack = "M120\nG91\nG1 Z1 F6000\nG1 Z-1\nM121\nG1 X20 E1\n";
    vec![
        case(
            "a stack",
            Gcode,
            behind("; gcode_flavor = reprapfirmware\n") + stack,
            Beads(20.0, 2.0, 1),
        ),
        case(
            "endstops",
            Gcode,
            behind(";FLAVOR:Marlin\n") + stack,
            Beads(30.0, 2.0, 1),
        ),
        case(
            "either of them",
            Gcode,
            behind("") + stack,
            Refused("line 8: M121 takes back"),
        ),
        case(
            "a state of Klipper within another",
            Gcode,
            behind("")
                + "SAVE_GCODE_STATE NAME=a\nG91\nSAVE_GCODE_STATE NAME=b\nG90\n\
             RESTORE_GCODE_STATE NAME=b\nG1 X10 E1\nRESTORE_GCODE_STATE NAME=a\nG1 X30 E1\n",
            Beads(30.0, 3.0, 1),
        ),
        case(
            "a bare G92 of Klipper",
            Gcode,
            behind("; gcode_flavor = klipper\n") + "G92\nG1 X10 E1\n",
            Beads(20.0, 2.0, 1),
        ),
        case(
            "a bare G92 of nobody",
            Gcode,
            behind("") + "G92\nG1 X10 E1\n",
            Refused("line 4: G92 without axes"),
        ),
        case(
            "turns beside an arc",
            Gcode,
            ";FLAVOR:Marlin\nM83\nG1 X10 Y0 Z.2\nG3 X0 Y10 I-10 J0 P1 E4\n",
            Beads(25.0 * PI, 4.0, 1),
        ),
        case(
            "turns of nobody",
            Gcode,
            "M83\nG1 X10 Y0 Z.2\nG3 X0 Y10 I-10 J0 P1 E4\n",
            Refused("line 3: P of an arc"),
        ),
        case(
            "Prusa's bed levelling is no machine tool's",
            Gcode,
            behind("G80\n") + "G92\nG1 X20 E1\n",
            Refused("line 5: G92 without axes"),
        ),
        case(
            "tools changed behind the last bead",
            Gcode,
            behind("T0\n") + "T1\nM104 S0\nT0\n",
            Beads(10.0, 1.0, 1),
        ),
        case(
            "a tool of no T",
            Gcode,
            behind("") + "T1\nG1 X20 E1\n",
            Refused("line 4: tool T1 after T0"),
        ),
    ]
}

/// Relative or absolute, mm or mm³.
fn extrusion() -> Vec<Case> {
    let ring = "G90\nG1 X0 Y0 Z.2 F3000\nG1 X10 E.4\nG1 Y11 E.44\nG1 X-2 E.48\nG1 Y0 E.44\nG1 X10 E.48\n\
                G1 Y12 E.48\nG1 X-3 E.52\nG1 Y0 E.48\n";
    let grows = "G90\nG1 X0 Y0 Z.2 F3000\nG1 X10 E.4\nG1 Y11 E.44\nG1 X-2 E.48\nG1 Y0 E.44\nG1 X10 E.45\n\
                 G1 Y12 E.48\nG1 X-3 E.49\nG1 Y0 E.5\nG1 X10 E.51\n";
    vec![
        case("E that falls", Gcode, ring, Beads(93.0, 3.72, 1)),
        case("E that falls seldom", Gcode, grows, Beads(106.0, 4.19, 1)),
        case(
            "Cura's RepRap is RepRapFirmware",
            Gcode,
            ";FLAVOR:RepRap\nM82\nG1 X0 Z.2 F1200\nG91\nG1 X10 E1\nG1 X10 E2\n",
            Beads(20.0, 2.0, 1),
        ),
        case(
            "mm³ by the flavour",
            Gcode,
            ";FLAVOR:UltiGCode\nG1 X0 Z.2 F3000\nG1 X10 E2.405281875\n",
            Beads(10.0, 1.0, 1),
        ),
        case(
            "mm³ by the end's figure",
            Gcode,
            "M82\nG1 X0 Z.2 F3000\nG1 X50 E24.0528\n; filament used [mm] = 10\n",
            Beads(50.0, 10.0, 1),
        ),
        case(
            "KISSlicer's filament and figure, without M83",
            Gcode,
            // 3 mm of 3 mm filament are 21.2 mm³, as 8.816 mm of 1.75 mm are.
            "; fiber_dia_mm = 3\nG1 X0 Y0 Z.2 F3000\nG1 X10 E.5\nG1 Y10 E.9\nG1 X0 E1.6\n\
             ; Estimated Build Volume: 0.0212 cm^3\n",
            Beads(30.0, 3.0 * (3.0 / 1.75) * (3.0 / 1.75), 1),
        ),
        case(
            "the same E again is no bead",
            Gcode,
            // In doubles 1.01 + (3.22 - 1.01) is less than 3.22.
            "M82\nG1 X0 Y0 Z.2 F1200\nG1 X10 E1.01\nG1 X20 E3.22\nG1 X30 E3.22\nG1 X40 E4\n",
            Beads(30.0, 4.0, 1),
        ),
        case(
            "absolute with a wipe",
            Gcode,
            "M82\nG1 X0 Y0 Z.2 F1200\nG1 X10 E1\nG1 X8 E.5\nG1 E.2 F1800\nG0 X20\nG1 E.5 F1800\nG1 X22 E1\n",
            Beads(12.0, 1.5, 1),
        ),
        case(
            "a feed of the filament where E is in mm³",
            Planned,
            // The rate of a push rises to the feed's and falls again: 60 mm³ at 10 mm/s of filament are 5 s, at
            // 10 mm³/s 12 s; there are two, and 2 s of ways.
            "M200 D1.75\nM83\nG1 X0 Z.2 F3000\nG1 X10 E1\nG1 E-60 F600\nG1 X10 Y0\nG1 E60\nG1 X20 E1 F3000\n",
            Seconds(10.0, 12.5),
        ),
    ]
}

/// What words are.
fn texts() -> Vec<Case> {
    let outline = format!(
        "EXCLUDE_OBJECT_DEFINE POLYGON=[{}]\n",
        "[1.5,2.5],".repeat(400)
    );
    let latin = b"; 210 \xb0C, f\xfcr PLA\nM83\nG1 X0 Z.2 F1200\nG1 X10 E1 ; \xb5m\n";
    vec![
        case(
            "an outline of 4,000 characters",
            Gcode,
            behind(&outline),
            Beads(10.0, 1.0, 1),
        ),
        case(
            "a star in a text",
            Gcode,
            behind("M117 2*3 of 9\n"),
            Beads(10.0, 1.0, 1),
        ),
        case(
            "stars in a text with a sum",
            Gcode,
            behind("N5 M117 a*b*40\n"),
            Beads(10.0, 1.0, 1),
        ),
        case(
            "a wrong sum",
            Gcode,
            behind("N5 G28*99\n"),
            Refused("line 1: its checksum is 99"),
        ),
        case(
            "bytes of Latin-1 in comments",
            Gcode,
            &latin[..],
            Beads(10.0, 1.0, 1),
        ),
        case(
            "bytes of Latin-1 in a word",
            Gcode,
            &b"M83\nG1 X\xb5 E1\n"[..],
            Refused("line 2"),
        ),
        case(
            "UTF-16",
            Gcode,
            &b"\xff\xfe?\x001\x00"[..],
            Refused("line 1"),
        ),
        case(
            "a comment in a comment",
            Gcode,
            behind("( a; b )\nO1000 (part)\nG1 F0\n"),
            Beads(10.0, 1.0, 1),
        ),
        case(
            "CR alone, NUL and Ctrl-Z",
            Gcode,
            behind("").replace('\n', "\r") + "\r\u{1a}\0",
            Beads(10.0, 1.0, 1),
        ),
        case(
            "a bead of F0",
            Gcode,
            "M83\nG1 X10 E1 F0\n",
            Refused("line 2: F0 is no feed"),
        ),
        case(
            "a number with two points",
            Gcode,
            behind("G0 X1.2.3\n"),
            Refused("line 1: X has no"),
        ),
        case(
            "a line without an end",
            Gcode,
            format!("G1 X{}", "1".repeat(3000)),
            Refused("line 1 is longer"),
        ),
        case(
            "an open comment",
            Gcode,
            behind("G28 (home\n"),
            Refused("line 1: the comment"),
        ),
        case(
            "words of a macro",
            Gcode,
            behind("_START_PRINT BED=60 HOTEND=220\n"),
            Taken,
        ),
        case(
            "words that are none",
            Gcode,
            behind("PRINT_START BED_TEMP=hot\n"),
            Refused("line 1: BED_TEMP='hot'"),
        ),
        case(
            "settings of grbl",
            Gcode,
            behind("$H\n$X\n"),
            Beads(10.0, 1.0, 1),
        ),
        case(
            "binary",
            Gcode,
            &b"GCDE\x01\0\0\0"[..],
            Refused("binary G-code"),
        ),
        case("nothing", Gcode, "", Refused("nothing is printed")),
    ]
}

/// Pairs of retract and prime.
fn retracts() -> Vec<Case> {
    let pairs = "G1 E-1 F1800\nG1 E1\n".repeat(15);
    vec![
        case(
            "fifteen pairs before the first bead",
            Gcode,
            format!("M83\nG1 X0 Y0 Z.2 F1200\n{pairs}G1 X10 E.5 F1200\n"),
            Pushes(&[[1.0, 0.0]]),
        ),
        case(
            "two pairs between beads",
            Gcode,
            behind("") + "G1 E-.8 F1800\nG1 E.8\nG1 E-.8\nG0 X20\nG1 E.8\nG1 X30 E.5\n",
            Pushes(&[[0.0, 0.8], [0.8, 0.0]]),
        ),
        case(
            "firmware retracts twice",
            Gcode,
            behind("M207 S1\n") + "G10\nG10\nG0 X20\nG11\nG11\nG1 X30 E1\n",
            Pushes(&[[0.0, 1.0], [1.0, 0.0]]),
        ),
        case(
            "a pull in two speeds",
            Gcode,
            behind("") + "G1 E-1 F1800\nG1 E-2 F600\nG0 X20\nG1 E3\nG1 X30 E1\n",
            Pushes(&[[0.0, 3.0], [3.0, 0.0]]),
        ),
        case(
            "a wipe",
            Gcode,
            behind("") + "G1 X8 E-.5\nG1 E-.3 F1800\nG0 X20\nG1 E.8\nG1 X30 E1\n",
            Pushes(&[[0.0, 0.8], [0.8, 0.0]]),
        ),
    ]
}

fn heights() -> Vec<Case> {
    let object = |x: u32| {
        let far = x + 10;
        format!("G0 X{x}\nG0 Z.2\nG1 X{far} E1\nG0 Z.4\nG1 X{x} E1\nG0 Z9\n")
    };
    let marked = |z: &str, n: u32| format!(";LAYER_CHANGE\n;LAYER:{n}\nG0 X0 Z{z}\nG1 X10 E1\n");
    vec![
        case(
            "heights beside whole micrometres",
            Gcode,
            ";LAYER_CHANGE\n;HEIGHT:0.199999\nM83\nG0 Z.2\nG1 X10 E1\n;HEIGHT:0.4000001\nG1 X20 E1\n",
            Heights(&[0.2, 0.4]),
        ),
        case(
            "three turns of a vase",
            Gcode,
            "M83\nG1 X0 Y0 Z.2 F1200\nG1 X10 Z.3 E.4\nG1 X5 Y9 Z.4 E.4\nG1 X0 Y0 Z.5 E.4\nG1 X10 Z.6 E.4\n\
             G1 X5 Y9 Z.7 E.4\nG1 X0 Y0 Z.8 E.4\nG1 X10 Z.9 E.4\nG1 X5 Y9 Z1.0 E.4\nG1 X0 Y0 Z1.1 E.4\n",
            Heights(&[0.3; 9]),
        ),
        case(
            "a vase of three arcs",
            Gcode,
            "G91.1\nM83\nG1 X10 Y0 Z.2\nG3 X10 Y0 I-10 J0 Z.4 E4\nG3 X10 Y0 I-10 J0 Z.6 E4\n",
            // Two helices of a turn, 0.2 mm up each.
            Beads(2.0 * (20.0 * PI).hypot(0.2), 8.0, 2),
        ),
        case(
            "objects one after the other",
            Gcode,
            format!("M83\nG1 F1200\n{}{}", object(0), object(50)),
            Heights(&[0.2; 4]),
        ),
        case(
            "layers that are marked twice",
            Gcode,
            format!("M83\nG1 F1200\n{}{}", marked(".2", 0), marked(".4", 1)),
            Beads(20.0, 2.0, 2),
        ),
        case(
            "heights of one mark",
            Gcode,
            "M83\n;LAYER_CHANGE\nG0 Z.2\nG1 X10 E1\n;LAYER_CHANGE\nG0 Z.4\nG1 X0 E1\n;LAYER_CHANGE\nG0 Z.6\n\
             G1 X10 E1\nG0 Z.5 Y5\nG1 X0 E1\n",
            Heights(&[0.2, 0.2, 0.2, 0.1]),
        ),
    ]
}

/// Numbers that claim more time or memory than the file has.
fn claims() -> Vec<Case> {
    let pulls = "G1 E-14 F0.25\nG0 X0\nG1 E14 F0.25\nG1 X10 E.3 F1200\n".repeat(20);
    let inverse_time = "G92 E0 C0\nG93\nG1 E.5 F990\nG1 X0.13 C-15 E.5045 F2353\n";
    vec![
        case(
            "lines of inverse time",
            Planned,
            inverse_time,
            Seconds(0.1, 10.0),
        ),
        case(
            "pulls of an hour",
            Planned,
            behind("") + &pulls,
            Refused("line 4: the extruder alone is to move"),
        ),
        case(
            "a pull of months",
            Planned,
            behind("") + "G1 E-1 F0.001\nG0 X20\nG1 E1\nG1 X30 E1\n",
            Refused("line 4: the extruder alone is to move"),
        ),
        // 160 mm at 0.1 mm/s and at 1 mm/s, with 5 s of ways beside and 1 % for speeding up.
        case(
            "a square at 0.1 mm/s",
            Planned,
            "M83\nG0 Z.2\nG1 X40 E1.2 F6\nG1 Y40 E1.2\nG1 X0 E1.2\nG1 Y0 E1.2\n",
            Seconds(1595.0, 1621.0),
        ),
        case(
            "a square at 1 mm/s",
            Planned,
            "M83\nG0 Z.2\nG1 X40 E1.2 F60\nG1 Y40 E1.2\nG1 X0 E1.2\nG1 Y0 E1.2\n",
            Seconds(159.0, 167.0),
        ),
        case(
            "a bead of 0.01 mm/s",
            Planned,
            behind("M220 S1\n").replace("F1200", "F60"),
            Refused("line 4: it prints at 0.01 mm/s"),
        ),
        case(
            "turns without end",
            Planned,
            "G91.1\nM83\nG1 X50 Y0 Z.2 F120\nG3 X50 Y0 I-50 J0 P90 E900\n",
            Refused("line 4: the curves"),
        ),
        case(
            "turns and E without end",
            Gcode,
            "G91.1\nM83\nG0 X10\nG3 X10 Y0 I-10 J0 P20 E1000000000\n",
            Refused("line 4: a bead of"),
        ),
        case(
            "an arc as wide as a town",
            Planned,
            "M83\nG1 X0 Y0 Z.2 F6000\nG2 X0 Y0 I50000 J0 E9\n",
            Refused("work area"),
        ),
        case(
            "a wait of thirty years",
            Planned,
            behind("") + "G4 S1000000000\nG1 X20 E1\n",
            Seconds(1.0, 10.0),
        ),
        case(
            "a feed beyond all",
            Planned,
            behind("") + "G1 X20 E1 F10000000\n",
            Seconds(1.0, 10.0),
        ),
        case(
            "a place beyond all",
            Gcode,
            behind("") + "G1 X99999999 E1\n",
            Refused("line 4: X"),
        ),
        case(
            "relative places that add up",
            Gcode,
            behind("") + "G91\nG1 X90000 E1\nG1 X90000 E1\n",
            Refused("line 6: X"),
        ),
        case(
            "40,000 states",
            Gcode,
            (0..40_000)
                .map(|n| format!("SAVE_GCODE_STATE NAME=n{n}\n"))
                .collect::<String>(),
            Refused("line 101: more than 100 names"),
        ),
        case(
            "40,000 layers without a bead",
            Gcode,
            behind("") + &";LAYER_CHANGE\n".repeat(40_000),
            Taken,
        ),
        case(
            "a hundred thousand comments of heights",
            Gcode,
            (0..100_000)
                .map(|n| format!(";HEIGHT:0.{n}\n"))
                .collect::<String>()
                + &behind(""),
            Taken,
        ),
        case(
            "a million brackets",
            Gcode,
            behind("") + &"(".repeat(1_000_000),
            Refused("line 4"),
        ),
        case(
            "a pass of 20,000 stubs",
            Gcode,
            "M83\nG91\nG1 Z.2\n".to_string()
                + &"G1 X.01 E.001\nG1 X-.01 Y.001 E.001\n".repeat(10_000),
            Beads(10_000.0 * (0.01 + 0.01f64.hypot(0.001)), 20.0, 1),
        ),
    ]
}
