//! Goal: multi-axis files of other programs become the poses that those programs meant, within 5 µm and 0.02°, with their
//! volumes and times. Method: twenty-three files in the manner of as many programs, made here from poses on the part by
//! each program's own published equations, as products of plain matrices that share nothing with the reader; each pose
//! is looked for along the path that is read.

use super::plain_turns::{
    Matrix, Vector, about, applied, plus, product, scaled, transposed, x, y, z,
};
use headway::gcode::axes::FileAxes;
use headway::gcode::{GcodeOptions, GcodeProgram, Place, read};
use headway::settings::axes_words::AxesWords;
use std::f64::consts::{FRAC_1_SQRT_2, PI};
use std::sync::Arc;

/// How far what is read may be from what is meant; the last digits that each file prints stay below it.
const TIP_MM: f64 = 5e-3;
const TURN_DEG: f64 = 0.02;
/// Filament of each move, mm, and its area.
const E_MM: f64 = 0.05;
const FILAMENT_MM2: f64 = 0.25 * PI * 1.75 * 1.75;

/// A pose that a program meant.
#[derive(Clone, Copy)]
struct Meant {
    tip: Vector,
    axis: Vector,
    /// The nozzle's own X axis, where the file turns it.
    ahead: Option<Vector>,
}

/// A file and what it means.
struct Foreign {
    name: &'static str,
    words: Option<String>,
    text: String,
    meant: Vec<Meant>,
    /// Moves that lay E_MM each; none of files that extrude nothing.
    beads: Option<usize>,
    /// Time of its beads, where it says it.
    seconds: Option<f64>,
}

impl Foreign {
    fn new(name: &'static str, words: &str, text: String, meant: Vec<Meant>) -> Foreign {
        Foreign {
            name,
            words: (!words.is_empty()).then(|| words.to_string()),
            beads: Some(meant.len() - 1),
            text,
            meant,
            seconds: None,
        }
    }

    fn read(&self) -> GcodeProgram {
        let axes = self.words.as_ref().map(|words| {
            let words = AxesWords::parse(words).expect("words");
            Arc::new(FileAxes::new(&words, None).expect("axes"))
        });
        let options = GcodeOptions {
            axes,
            ..GcodeOptions::default()
        };
        let read = read(self.text.as_bytes(), self.name, &options);
        read.unwrap_or_else(|error| panic!("{}: {error}", self.name))
    }
}

fn upright(tip: Vector) -> Meant {
    Meant {
        tip,
        axis: [0.0, 0.0, 1.0],
        ahead: None,
    }
}

fn leaning(tip: Vector, axis: Vector) -> Meant {
    Meant {
        tip,
        axis,
        ahead: None,
    }
}

/// Places of a vase, its angle counted on.
fn vase(count: usize) -> impl Iterator<Item = (f64, Vector)> {
    (0..count).map(|k| {
        let angle = 0.13 * k as f64;
        let radius = 20.0 + 2.0 * (0.7 * angle).sin();
        let tip = [
            radius * angle.cos(),
            radius * angle.sin(),
            5.0 + 0.02 * k as f64,
        ];
        (angle, tip)
    })
}

/// How far the head leans at an angle, degrees: through 0 both ways.
fn tilt_deg(angle: f64) -> f64 {
    25.0 * (0.9 * angle).sin() - 4.0
}

/// The first is gone to, the others are printed.
fn moves(count: usize, mut words: impl FnMut(usize) -> String) -> String {
    let one = |k: usize| match k {
        0 => format!("G0 {}\n", words(0)),
        k => format!("G1 {} E{E_MM}\n", words(k)),
    };
    (0..count).map(one).collect()
}

fn rad(degrees: f64) -> f64 {
    degrees.to_radians()
}

/// Joshua Bird's slicers, cell "save transformed gcode": r and z of the pivot, theta counted on; `sense` is that of the
/// sine (S4: -1; the radial slicer writes -rotation as B).
fn polar_head(name: &'static str, offset_mm: f64, sense: f64) -> Foreign {
    let (mut text, mut meant, mut seconds) = (
        "G94 ; mm/min feed  \nG28 ; home \nM83 ; relative extrusion \nG1 E10 ; prime extruder \nG90 \n\
         G0 C0 X0 Z20 B0 ; go to start \nG93 ; inverse time feed \n"
            .to_string(),
        Vec::new(),
        0.0,
    );
    for (k, (angle, tip)) in vase(60).enumerate() {
        let rotation = rad(tilt_deg(angle));
        let r = tip[0].hypot(tip[1]) + sense * rotation.sin() * offset_mm;
        let height = tip[2] + (rotation.cos() - 1.0) * offset_mm;
        let (c, b) = (angle.to_degrees(), -sense * rotation.to_degrees());
        let feed = 400.0 + 10.0 * k as f64;
        let code = if k == 0 { "G00" } else { "G01" };
        text += &format!("{code} C{c:.5} X{r:.5} Z{height:.5} B{b:.5}");
        if k > 0 {
            text += &format!(" E{E_MM:.4}");
            seconds += 60.0 / feed;
        }
        text += &format!(" F{feed:.4}\n");
        let out = sense * rotation.sin();
        let axis = [out * angle.cos(), out * angle.sin(), rotation.cos()];
        meant.push(leaning(tip, axis));
    }
    let words = format!("C=table:-z,B=head:-y:at=0/0/{offset_mm},coordinates=pivot");
    Foreign {
        seconds: Some(seconds),
        ..Foreign::new(name, &words, text, meant)
    }
}

/// Fractal Cortex, `write_5_axis_gcode`: chunks of planar layers, the part turned by Q_x(B) Q_z(A) between them.
fn fractal_cortex() -> Foreign {
    let mut text =
        ";SLICER:       Fractal Cortex\nG28\nhome_ab\nM82\nG92 E0\nG1 F2700 E-5\n".to_string();
    let (mut meant, mut e) = (Vec::new(), 0.0);
    for (chunk, [a, b]) in [[0.0, 0.0], [30.0, 40.0], [-115.0, 25.0]]
        .into_iter()
        .enumerate()
    {
        if chunk > 0 {
            text += &format!(
                "G0 F1000 Z90\nG0 X0.0 Y-175.0\nMANUAL_STEPPER STEPPER=stepper_a MOVE={a} SPEED=20.0 SYNC=0\n\
                 MANUAL_STEPPER STEPPER=stepper_b MOVE={b} SPEED=15.0 SYNC=1 STOP_ON_ENDSTOP=2\n"
            );
        }
        let turn = product(&about(x(), b), &about(z(), a));
        let height = 12.0 + 9.0 * chunk as f64;
        for (k, (_, at)) in vase(20).enumerate() {
            let at = [at[0], at[1], height];
            match k {
                0 => {
                    text += &format!(
                        "G0 F3000 X{:.5} Y{:.5}\nG0 Z{height}\nG1 F2700 E{e:.5}\n",
                        at[0], at[1]
                    )
                }
                _ => {
                    e += E_MM;
                    text += &format!("G1 F1800 X{:.5} Y{:.5} E{e:.5}\n", at[0], at[1]);
                }
            }
            let back = transposed(&turn);
            meant.push(leaning(applied(&back, at), applied(&back, z())));
        }
        text += &format!("G1 F2700 E{:.5}\n", e - 5.0);
    }
    Foreign {
        beads: Some(3 * 19),
        ..Foreign::new(
            "Fractal Cortex",
            "stepper_b=table:x,stepper_a=table:z,coordinates=pivot",
            text,
            meant,
        )
    }
}

/// A table of two axes, the first at the base: the nozzle stands where the turned part is.
fn two_tables(
    name: &'static str,
    words: &str,
    letters: [char; 2],
    head: &str,
    place: impl Fn(f64, f64, Vector) -> (Vector, Matrix),
) -> Foreign {
    let mut meant = Vec::new();
    let mut at = Vec::new();
    for (angle, tip) in vase(60) {
        let (a, c) = (tilt_deg(angle), 40.0 * angle);
        let (joints, turn) = place(a, c, tip);
        at.push((joints, a, c));
        meant.push(leaning(tip, applied(&transposed(&turn), z())));
    }
    let [one, two] = letters;
    let text = moves(60, |k| {
        let ([x, y, z], a, c) = at[k];
        format!("X{x:.4} Y{y:.4} Z{z:.4} {one}{a:.4} {two}{c:.4}")
    });
    Foreign::new(name, words, format!("{head}{text}"), meant)
}

/// LinuxCNC's `xyzac-trt-kins` and `xyzbc-trt-kins`: the rotary point, and the tilting axis beside it by d.
fn linuxcnc(name: &'static str, words: &str, letter: char, along: Vector, d: Vector) -> Foreign {
    let rot = [3.0, -2.0, 4.0];
    two_tables(
        name,
        words,
        [letter, 'C'],
        "G21 G90 G64 P0.01\nM83\nF1800\n",
        |a, c, p| {
            let (tilt, turn) = (about(along, a), about(z(), c));
            let from = plus(p, scaled(rot, -1.0));
            let on_tilt = plus(applied(&turn, from), scaled(d, -1.0));
            let joints = plus(plus(applied(&tilt, on_tilt), d), rot);
            (joints, product(&tilt, &turn))
        },
    )
}

/// RotBot, `backtransform_data_radial` and `..._tangential`: the tip, and U towards which the nozzle leans by 45°.
fn rotbot(name: &'static str, inward: bool) -> Foreign {
    let (mut text, mut meant) = ("M83\nG90\n".to_string(), Vec::new());
    for (k, (angle, tip)) in vase(60).enumerate() {
        let radius = tip[0].hypot(tip[1]);
        let slope = if inward { 1.0 } else { -1.0 };
        let tip = [tip[0], tip[1], 30.0 + tip[2] + slope * radius];
        let tip = tip.map(|mm| (1000.0 * mm).round() / 1000.0);
        // Tangential: across the move, not along the radius.
        let u = if inward { angle + 0.1 + PI } else { angle };
        let u_deg = (100.0 * u.to_degrees()).round() / 100.0;
        let [x, y, z] = tip;
        text += &match k {
            0 => format!("G0 X{x} Y{y} Z{z} U{u_deg} F6000\n"),
            // A turn alone stands between a retract and a prime.
            30 => {
                format!("G1 E-0.800 \nG1 U{u_deg} \nG1 E0.800 \nG1 X{x} Y{y} Z{z} E{E_MM} F1200\n")
            }
            _ => format!("G1 X{x} Y{y} Z{z} U{u_deg} E{E_MM} F1200\n"),
        };
        let u = rad(u_deg);
        let axis = [
            FRAC_1_SQRT_2 * u.cos(),
            FRAC_1_SQRT_2 * u.sin(),
            FRAC_1_SQRT_2,
        ];
        meant.push(leaning(tip, axis));
    }
    Foreign::new(name, "U=head:z,lean=45,coordinates=tip", text, meant)
}

/// Slicer4RTN with five axes: A towards the radius, B constant, E absolute.
fn slicer4rtn() -> Foreign {
    let (mut text, mut meant) = ("G28\nM82\nG92 E0\n".to_string(), Vec::new());
    for (k, (angle, tip)) in vase(40).enumerate() {
        let a = angle.to_degrees();
        let code = if k == 0 { "G0" } else { "G1" };
        let [x, y, z] = tip;
        let e = if k == 0 {
            String::new()
        } else {
            format!(" E{:.5}", E_MM * k as f64)
        };
        text += &format!("{code} F1200 X{x:.4} Y{y:.4} Z{z:.4}{e} A{a:.4} B45 ; extrusion\n");
        let axis = [
            FRAC_1_SQRT_2 * angle.cos(),
            FRAC_1_SQRT_2 * angle.sin(),
            FRAC_1_SQRT_2,
        ];
        meant.push(leaning(tip, axis));
    }
    Foreign::new(
        "Slicer4RTN",
        "A=head:z,B=head:y,coordinates=tip",
        text,
        meant,
    )
}

/// Conical slicing for any printer (variable angle): X Y Z alone, z beside the cone; nothing to declare.
fn cone_of_any_printer() -> Foreign {
    let mut meant = Vec::new();
    let text = moves(60, {
        let places: Vec<Vector> = vase(60)
            .map(|(_, p)| [p[0], p[1], p[2] + 10.0 - 0.2867 * p[0].hypot(p[1])])
            .collect();
        meant.extend(places.iter().map(|place| upright(*place)));
        move |k| {
            let [x, y, z] = places[k];
            format!("X{x:.4} Y{y:.4} Z{z:.4}")
        }
    });
    Foreign::new(
        "variable angle cone",
        "",
        format!("M83\nG1 F1200\n{text}"),
        meant,
    )
}

/// Rep5x, `IKtranslationRW2`: La and Lb.
fn rep5x() -> Foreign {
    let [la, lb] = [2.0, 47.7];
    let (mut at, mut meant) = (Vec::new(), Vec::new());
    for (angle, p) in vase(60) {
        let (a, b) = (-30.0 * angle, tilt_deg(angle));
        let (ar, br) = (rad(a), rad(b));
        at.push([
            p[0] + ar.sin() * la + ar.cos() * br.sin() * lb,
            p[1] - la + ar.cos() * la - ar.sin() * br.sin() * lb,
            p[2] + br.cos() * lb - lb,
            a,
            b,
        ]);
        meant.push(leaning(
            p,
            [ar.cos() * br.sin(), -ar.sin() * br.sin(), br.cos()],
        ));
    }
    let text = moves(60, |k| {
        let [x, y, z, a, b] = at[k];
        format!("X{x:.5} Y{y:.5} Z{z:.5} A{a:.4} B{b:.4}")
    });
    let words = "A=head:-z:at=0/2/0,B=head:y:at=0/0/47.7,coordinates=pivot,feed=xyz";
    Foreign::new("Rep5x", words, format!("M83\nG1 F1200\n{text}"), meant)
}

/// FullControl's lab: `b_nozzle` (four axes) and `b_nozzle_c_bed` (five).
fn fullcontrol_nozzle(name: &'static str, words: &str, turns_bed: bool) -> Foreign {
    let (offset, bed) = ([3.0, 40.0], [5.0, -4.0]);
    let (mut at, mut meant) = (Vec::new(), Vec::new());
    for (angle, p) in vase(60) {
        let (b, c) = (tilt_deg(angle), if turns_bed { 35.0 * angle } else { 0.0 });
        let br = rad(b);
        let (nx, nz) = (-offset[0], -offset[1]);
        let from_b0 = [
            -(nx * (1.0 - br.cos())) + nz * br.sin(),
            -(nz * (1.0 - br.cos())) + nx * -br.sin(),
        ];
        let turn = about(z(), c);
        let on_bed = applied(&turn, [p[0] - bed[0], p[1] - bed[1], p[2]]);
        let turned = [on_bed[0] + bed[0], on_bed[1] + bed[1]];
        at.push([turned[0] - from_b0[0], turned[1], p[2] - from_b0[1], b, c]);
        meant.push(leaning(
            p,
            applied(&transposed(&turn), [br.sin(), 0.0, br.cos()]),
        ));
    }
    let text = moves(60, |k| {
        let [x, y, z, b, c] = at[k];
        let bed = if turns_bed {
            format!(" C{c:.5}")
        } else {
            String::new()
        };
        format!("X{x:.5} Y{y:.5} Z{z:.5} B{b:.5}{bed}")
    });
    Foreign::new(name, words, format!("M83\nG1 F900\n{text}"), meant)
}

/// Post-processors with G43.4: the tip, and the angles of the axes.
fn cam_tip(
    name: &'static str,
    words: &str,
    letters: [char; 2],
    by_time: bool,
    axis: impl Fn(f64, f64) -> Vector,
) -> Foreign {
    let [one, two] = letters;
    let mut text =
        "%\nO1001 (FIVE AXIS)\nG90 G94 G17 G40 G49 G80\nG21\nM3 S100\nG43.4 H1\n".to_string();
    text += if by_time { "G93\n" } else { "" };
    let (mut meant, mut seconds) = (Vec::new(), 0.0);
    for (k, (angle, p)) in vase(60).enumerate() {
        let (a, c) = (tilt_deg(angle), 50.0 * angle);
        let [x, y, z] = p;
        let code = if k == 0 { "G0" } else { "G1" };
        let feed = if by_time { 300.0 + k as f64 } else { 1500.0 };
        text += &format!(
            "N{} {code} X{x:.4} Y{y:.4} Z{z:.4} {one}{a:.4} {two}{c:.4}",
            10 * k
        );
        text += &if k == 0 {
            "\n".to_string()
        } else {
            format!(" F{feed:.3}\n")
        };
        seconds += if k == 0 { 0.0 } else { 60.0 / feed };
        meant.push(leaning(p, axis(a, c)));
    }
    Foreign {
        beads: None,
        seconds: by_time.then_some(seconds),
        ..Foreign::new(name, words, text + "M5\nM30\n%\n", meant)
    }
}

/// Mach3's fourth axis: A turns the part about X under an upright head.
fn mach3_rotary() -> Foreign {
    let (mut text, mut meant) = ("G21 G90\nM83\nG1 F900\n".to_string(), Vec::new());
    text += &moves(60, |k| {
        let (a, along) = (4.0 * k as f64 - 115.0, 0.5 * k as f64);
        let radius = 12.0 + (0.2 * k as f64).sin();
        let back = transposed(&about(x(), a));
        meant.push(leaning(
            applied(&back, [along, 0.0, radius]),
            applied(&back, z()),
        ));
        format!("X{along:.4} Y0 Z{radius:.4} A{a:.4}")
    });
    Foreign::new("Mach3 rotary", "A=table:x,coordinates=pivot", text, meant)
}

/// A polar printer without tilts: the nozzle on X, the table from another zero.
fn polar() -> Foreign {
    let (mut text, mut meant) = ("M83\nG1 F900\n".to_string(), Vec::new());
    text += &moves(60, |k| {
        let (c, r) = (9.0 * k as f64, 15.0 + 0.05 * k as f64);
        let back = transposed(&about(z(), c + 90.0));
        meant.push(upright(applied(&back, [r, 0.0, 0.2])));
        format!("X{r:.4} Z0.2 C{c:.4}")
    });
    Foreign::new(
        "polar printer",
        "C=table:z:zero=90,coordinates=pivot",
        text,
        meant,
    )
}

/// A tangential knife: C along the way, counted from Y.
fn knife() -> Foreign {
    let (mut text, mut meant) = ("G21 G90\nM3\n".to_string(), Vec::new());
    for (k, (angle, p)) in vase(60).enumerate() {
        let [x, y, _] = p;
        let c = (angle + 0.2).to_degrees();
        let code = if k == 0 { "G0" } else { "G1" };
        text += &format!("{code} X{x:.4} Y{y:.4} Z0.2 C{c:.4} F900\n");
        let ahead = [rad(c - 90.0).cos(), rad(c - 90.0).sin(), 0.0];
        meant.push(Meant {
            ahead: Some(ahead),
            ..upright([x, y, 0.2])
        });
    }
    Foreign {
        beads: None,
        ..Foreign::new("tangential knife", "C=heading:zero=-90", text, meant)
    }
}

/// A head of two axes with a nozzle that turns: places of the pivot, R_x(A) R_y(B) R_z(U).
fn turning_head() -> Foreign {
    let pivot = [0.0, 0.0, 60.0];
    let (mut at, mut meant) = (Vec::new(), Vec::new());
    for (angle, p) in vase(60) {
        let (a, b, u) = (tilt_deg(angle), 20.0 * (1.3 * angle).cos(), 70.0 * angle);
        let head = product(&about(x(), a), &about(y(), b));
        let joints = plus(plus(p, applied(&head, pivot)), scaled(pivot, -1.0));
        at.push((joints, a, b, u));
        let nozzle = product(&head, &about(z(), u));
        meant.push(Meant {
            tip: p,
            axis: applied(&head, z()),
            ahead: Some(applied(&nozzle, x())),
        });
    }
    let text = moves(60, |k| {
        let ([x, y, z], a, b, u) = at[k];
        format!("X{x:.5} Y{y:.5} Z{z:.5} A{a:.5} B{b:.5} U{u:.4}")
    });
    let words = "A=head:x:at=0/0/60,B=head:y:at=0/0/60,U=heading,coordinates=pivot";
    Foreign::new(
        "turning head",
        words,
        format!("M83\nG1 F900\n{text}"),
        meant,
    )
}

fn files() -> Vec<Foreign> {
    let plain = |first: Vector| {
        move |a: f64, c: f64, p: Vector| {
            let turn = product(&about(first, a), &about(z(), c));
            (applied(&turn, p), turn)
        }
    };
    let intercept = [110.0, 90.0, 30.0];
    let slanted = [0.0, FRAC_1_SQRT_2, FRAC_1_SQRT_2];
    let head_turn = |c: f64, b: f64| applied(&product(&about(z(), c), &about(y(), b)), z());
    let open5x = "M83 ; use relative distances for extrusion\nG0 u0 v0 ;\nG1 F1200\n";
    vec![
        polar_head("S4 slicer", 42.0, -1.0),
        polar_head("radial slicer", 43.0, 1.0),
        fractal_cortex(),
        two_tables(
            "Open5x",
            "U=table:y,V=table:z,coordinates=pivot,feed=all",
            ['U', 'V'],
            open5x,
            plain(y()),
        ),
        two_tables(
            "Open5x Voron",
            "B=table:y,C=table:z,coordinates=pivot",
            ['B', 'C'],
            "M83\n",
            plain(y()),
        ),
        two_tables(
            "AC trunnion",
            "A=table:x,C=table:z,coordinates=pivot",
            ['A', 'C'],
            "M83\n",
            plain(x()),
        ),
        two_tables(
            "nutating table",
            "B=table:0/1/1,C=table:z,coordinates=pivot",
            ['B', 'C'],
            "M83\n",
            plain(slanted),
        ),
        two_tables(
            "FullControl five axes",
            "B=table:y,C=table:z,coordinates=pivot,shift=-110/-90/-30",
            ['B', 'C'],
            "M83\nG1 F900\n",
            move |b, c, p| {
                let turn = product(&about(y(), b), &about(z(), c));
                (plus(applied(&turn, p), intercept), turn)
            },
        ),
        linuxcnc(
            "xyzac-trt",
            "A=table:x:at=3/0/9,C=table:z:at=3/-2/4,coordinates=pivot",
            'A',
            x(),
            [0.0, 2.0, 5.0],
        ),
        linuxcnc(
            "xyzbc-trt",
            "B=table:y:at=4/-2/9,C=table:z:at=3/-2/4,coordinates=pivot",
            'B',
            y(),
            [1.0, 0.0, 5.0],
        ),
        rotbot("RotBot outward", false),
        rotbot("RotBot inward", true),
        slicer4rtn(),
        cone_of_any_printer(),
        rep5x(),
        fullcontrol_nozzle(
            "FullControl four axes",
            "B=head:y:at=3/0/40,coordinates=pivot",
            false,
        ),
        fullcontrol_nozzle(
            "FullControl C0B1",
            "B=head:y:at=3/0/40,C=table:z:at=5/-4/0,coordinates=pivot",
            true,
        ),
        cam_tip(
            "G43.4 table AC",
            "A=table:x,C=table:z,coordinates=tip",
            ['A', 'C'],
            false,
            |a, c| applied(&transposed(&product(&about(x(), a), &about(z(), c))), z()),
        ),
        cam_tip(
            "G43.4 head CB",
            "C=head:z,B=head:y,coordinates=tip",
            ['B', 'C'],
            false,
            move |b, c| head_turn(c, b),
        ),
        cam_tip(
            "G93 head and table",
            "B=head:y,C=table:z,coordinates=tip",
            ['B', 'C'],
            true,
            |b, c| {
                applied(
                    &transposed(&about(z(), c)),
                    [rad(b).sin(), 0.0, rad(b).cos()],
                )
            },
        ),
        mach3_rotary(),
        polar(),
        knife(),
        turning_head(),
    ]
}

/// The tool axis and the nozzle's X axis of a place: the head stands at R_x(A) R_y(B) R_z(C).
fn axes_of(place: &Place) -> [Vector; 2] {
    let [a, b, c] = place.turn_deg;
    let head = product(&about(x(), a), &about(y(), b));
    [
        applied(&head, z()),
        applied(&product(&head, &about(z(), c)), x()),
    ]
}

fn angle_deg(a: Vector, b: Vector) -> f64 {
    let off = plus(a, scaled(b, -1.0));
    let half = 0.5 * off.iter().map(|share| share * share).sum::<f64>().sqrt();
    2.0 * half.min(1.0).asin().to_degrees()
}

fn distance_mm(a: Vector, b: Vector) -> f64 {
    plus(a, scaled(b, -1.0))
        .iter()
        .map(|mm| mm * mm)
        .sum::<f64>()
        .sqrt()
}

#[test]
fn files_of_others_become_the_poses_that_they_mean() {
    let files = files();
    assert!(files.len() >= 20);
    for file in &files {
        let program = file.read();
        let places: Vec<&Place> = program
            .passes
            .iter()
            .flat_map(|pass| &pass.points)
            .collect();
        let mut from = 0;
        for (number, meant) in file.meant.iter().enumerate() {
            let is_it = |place: &&Place| {
                let [axis, ahead] = axes_of(place);
                let turned_deg = meant.ahead.map_or(0.0, |meant| angle_deg(ahead, meant));
                distance_mm(place.tip_mm, meant.tip) < TIP_MM
                    && angle_deg(axis, meant.axis) < TURN_DEG
                    && turned_deg < TURN_DEG
            };
            let found = places[from..].iter().position(is_it);
            let Some(found) = found else {
                let near = places.iter().min_by(|a, b| {
                    let off = |place: &Place| distance_mm(place.tip_mm, meant.tip);
                    off(a).total_cmp(&off(b))
                });
                panic!(
                    "{} pose {number}: {:?} {:?}; nearest {near:?}",
                    file.name, meant.tip, meant.axis
                );
            };
            from += found;
        }
        // The program has nothing else to print.
        assert_eq!(from + 1, places.len(), "{}", file.name);
        if let Some(beads) = file.beads {
            let meant_mm3 = FILAMENT_MM2 * E_MM * beads as f64;
            let read_mm3 = program.volume_mm3().expect("a volume");
            assert!(
                (read_mm3 / meant_mm3 - 1.0).abs() < 1e-9,
                "{}: {read_mm3}",
                file.name
            );
        }
        if let Some(meant_s) = file.seconds {
            let of_pass = |pass: &headway::gcode::GcodePass| -> f64 {
                let pairs = pass.points.windows(2).zip(&pass.legs);
                pairs
                    .map(|(pair, leg)| pair[1].distance_mm(&pair[0]) / leg.speed_mm_s)
                    .sum()
            };
            let read_s: f64 = program.passes.iter().map(of_pass).sum();
            // The chords of the legs are what the speeds are made of.
            assert!(
                (read_s / meant_s - 1.0).abs() < 1e-9,
                "{}: {read_s} {meant_s}",
                file.name
            );
        }
    }
}

/// Goal: between the lines of a file the tip goes as the axes turn. Method: the places that are read of a table's whole
/// turns in four moves, beside their circle.
#[test]
fn few_long_moves_of_a_table_are_a_ring() {
    let words = AxesWords::parse("C=table:z,coordinates=pivot").expect("words");
    let options = GcodeOptions {
        axes: Some(Arc::new(FileAxes::new(&words, None).expect("axes"))),
        ..GcodeOptions::default()
    };
    let text = "M83\nG0 X25 Z0.2 C0\nG1 C90 E1 F5400\nG1 C180 E1\nG1 C270 E1\nG1 C360 E1\n";
    let program = read(text.as_bytes(), "ring", &options).expect("a ring");
    let round_mm = 2.0 * PI * 25.0;
    // Chords within 1 µm of the circle.
    assert!(
        (program.print_mm() / round_mm - 1.0).abs() < 1e-4,
        "{}",
        program.print_mm()
    );
    let points = &program.passes[0].points;
    assert!(
        points
            .iter()
            .all(|place| (place.tip_mm[0].hypot(place.tip_mm[1]) - 25.0).abs() < 1e-9)
    );
    // F of moves without X Y Z is degrees a minute: 4 s in all.
    let legs = points.windows(2).zip(&program.passes[0].legs);
    let seconds: f64 = legs
        .map(|(pair, leg)| pair[1].distance_mm(&pair[0]) / leg.speed_mm_s)
        .sum();
    assert!((seconds - 4.0).abs() < 1e-6, "{seconds}");
    assert!(!program.has_headings && !program.has_tilts);
}

/// Goal: what no head reaches is refused with its line, whatever a table claims. Method: a table that turns the part over.
#[test]
fn a_part_that_is_turned_over_is_refused() {
    let words = AxesWords::parse("A=table:x,coordinates=pivot").expect("words");
    let options = GcodeOptions {
        axes: Some(Arc::new(FileAxes::new(&words, None).expect("axes"))),
        ..GcodeOptions::default()
    };
    let refused = |text: &str| {
        read(text.as_bytes(), "over", &options)
            .expect_err(text)
            .to_string()
    };
    let told = refused("M83\nG0 X1 Y0 Z5 A100\nG1 X5 E1\nG1 X9 A180 E1\n");
    assert!(
        told.contains("line 4: the tool axis is tilted by"),
        "{told}"
    );
    // A hundred thousand turns far out are no way of any machine.
    let told = refused("M83\nG1 X1 Y90000 Z5\nG1 X5 A300000 E1\n");
    assert!(told.contains("line 3"), "{told}");
    let told = refused("M83\nG1 X1 B4 E1\n");
    assert!(
        told.contains("line 2: B is no axis that --axes declares"),
        "{told}"
    );
}
