//! Goal: the command prints multi-axis files of other programs on another machine, with their volumes and feeds, and asks
//! what they do not say. Method: small files in the manner of a polar printer, RotBot, the S4 slicer and Open5x, planned
//! and simulated; files that nothing is said of.

use crate::rig::{example, folder, headway, object, path, stderr, succeeded};
use serde_json::{Map, Value};
use std::f64::consts::PI;
use std::path::Path;

/// A table turns under a nozzle that stands: two layers of a ring.
fn ring() -> String {
    let mut text = String::from("M83\nG0 X25 Z0.2 C0\nG1 F5400\n");
    for k in 1..=8 {
        let z = 0.2 * f64::from((k + 3) / 4);
        text += &format!("G1 C{} Z{z:.1} E1.6\n", 90 * k);
    }
    text
}

/// Turns of a vase, four in all, its angle counted on.
fn vase(mut line: impl FnMut(usize, f64) -> String) -> String {
    (0..=240).map(|k| line(k, PI * k as f64 / 30.0)).collect()
}

/// The tip beside the cone, U towards the outside, as RotBot's back-transformation writes it.
fn rotbot() -> String {
    let lines = vase(|k, angle| {
        let r = 20.0 + 0.01 * k as f64;
        let z = 40.0 - r + 0.005 * k as f64;
        let (x, y, u) = (r * angle.cos(), r * angle.sin(), angle.to_degrees());
        match k {
            0 => format!("G0 X{x:.3} Y{y:.3} Z{z:.3} U{u:.2} F6000\nG1 F1500\n"),
            _ => format!("G1 X{x:.3} Y{y:.3} Z{z:.3} U{u:.2} E0.15\n"),
        }
    });
    format!("G28\nM83\nG90\n{lines}")
}

/// Places of the pivot over a polar table, by inverse time, as the S4 slicer writes them.
fn s4() -> String {
    let lines = vase(|k, angle| {
        let lean = (12.0 - 0.1 * k as f64).to_radians();
        let r = 20.0 + 0.01 * k as f64 - lean.sin() * 42.0;
        let z = 0.3 + 0.005 * k as f64 + (lean.cos() - 1.0) * 42.0;
        let code = if k == 0 { "G00" } else { "G01" };
        let e = if k == 0 { "" } else { " E0.1500" };
        let (c, b) = (angle.to_degrees(), lean.to_degrees());
        format!("{code} C{c:.5} X{r:.5} Z{z:.5} B{b:.5}{e} F600.0000\n")
    });
    format!("G94\nG28\nM83\nG90\nG0 C0 X0 Z20 B0\nG93\n{lines}")
}

/// Places of a table that tilts about Y and turns, as Open5x has them.
fn open5x() -> String {
    let lines = vase(|k, angle| {
        let lean = (5.0 + 0.06 * k as f64).to_radians();
        let (r, z) = (20.0 + 0.02 * k as f64, 10.0 + 0.005 * k as f64);
        let (x, height) = (
            r * lean.cos() - z * lean.sin(),
            r * lean.sin() + z * lean.cos(),
        );
        let (u, v) = (-lean.to_degrees(), -angle.to_degrees());
        match k {
            0 => format!("G0 X{x:.4} Y0 Z{height:.4} U{u:.4} V{v:.4}\n"),
            _ => format!("G1 X{x:.4} Y0 Z{height:.4} U{u:.4} V{v:.4} E0.15 F1500\n"),
        }
    });
    format!("M83 ; use relative distances for extrusion\nG90\nG0 u0 v0 ;\n{lines}")
}

fn machine_file(name: &str) -> String {
    example(&format!("machines/{name}.toml"))
}

/// A file planned with its axes and simulated: the plan's figures, after the verdict of the simulation.
fn printed(folder: &Path, name: &str, text: &str, options: &[&str]) -> Map<String, Value> {
    let (input, job) = (
        folder.join(name).with_extension("gcode"),
        folder.join(name).with_extension("hwj"),
    );
    std::fs::write(&input, text).expect("written");
    let plan = ["plan", path(&input), "-o", path(&job), "--json"];
    let ran = headway(&[&plan, options].concat());
    assert!(ran.status.success(), "{name}: {}", stderr(&ran));
    let told = succeeded(&headway(&["simulate", path(&job)]));
    assert!(
        told.contains("Nothing was found against starting it."),
        "{name}: {told}"
    );
    object(&ran)
}

fn figure(figures: &Map<String, Value>, key: &str) -> f64 {
    figures[key]
        .as_f64()
        .unwrap_or_else(|| panic!("{key}: {figures:?}"))
}

/// What 240 moves of 0.15 mm of filament lay, mm³.
const VASE_MM3: f64 = 240.0 * 0.15 * 0.25 * PI * 1.75 * 1.75;

#[test]
fn a_ring_of_a_polar_table_is_a_ring() {
    let folder = folder("axes_ring");
    let words = "C=table:z,coordinates=pivot";
    let options = ["--axes", words, "-m", &machine_file("planar")];
    let figures = printed(&folder, "ring", &ring(), &options);
    // Two turns of 25 mm, and the rise between the layers.
    let round_mm = 4.0 * PI * 25.0;
    assert!(
        (figure(&figures, "print_mm") / round_mm - 1.0).abs() < 1e-3,
        "{figures:?}"
    );
    // The same words in the machine file.
    let (input, machine) = (folder.join("ring.gcode"), folder.join("machine.toml"));
    let text = std::fs::read_to_string(machine_file("planar")).expect("an example");
    std::fs::write(&machine, format!("{text}\n[gcode]\naxes = \"{words}\"\n")).expect("written");
    let job = folder.join("by_file.hwj");
    let ran = headway(&[
        "plan",
        path(&input),
        "-m",
        path(&machine),
        "-o",
        path(&job),
        "--json",
    ]);
    assert_eq!(object(&ran)["print_mm"], figures["print_mm"]);
    // Headway's own export says its axes itself, whatever the machine file declares: it is known, and not planned.
    let text = succeeded(&headway(&["machine", "check", path(&machine)]));
    assert!(!text.is_empty());
    let export = folder.join("again.gcode");
    succeeded(&headway(&[
        "export",
        path(&job),
        "--to",
        "gcode",
        "--dialect",
        "klipper",
        "--no-heat",
        "-o",
        path(&export),
    ]));
    let again = folder.join("again.hwj");
    let plan = [
        "plan",
        path(&export),
        "-m",
        path(&machine),
        "-o",
        path(&again),
    ];
    for axes in [&[][..], &["--axes", words]] {
        let refused = headway(&[&plan[..], axes].concat());
        let told = stderr(&refused);
        assert_eq!(refused.status.code(), Some(1), "{told}");
        assert!(told.contains("exported it from a job"), "{told}");
    }
}

#[test]
fn vases_of_other_programs_print_on_other_machines() {
    let folder = folder("axes_vases");
    // The first stands on a cone that is there already: on the bed a nozzle that leans by 45° would touch it.
    for (name, text, words, machine, at, seconds) in [
        (
            "rotbot",
            rotbot(),
            "U=head:z,lean=45,coordinates=tip",
            "gantry",
            "125,125,0",
            None,
        ),
        (
            "s4",
            s4(),
            "C=table:-z,B=head:-y:at=0/0/42,coordinates=pivot",
            "trunnion",
            "150,150,25",
            // 240 moves of a 600th of a minute.
            Some(24.0),
        ),
        (
            "open5x",
            open5x(),
            "U=table:y,V=table:z,coordinates=pivot,feed=tip",
            "table-bc",
            "150,150,25",
            None,
        ),
    ] {
        let options = ["--axes", words, "-m", &machine_file(machine), "--at", at];
        let figures = printed(&folder, name, &text, &options);
        // The curve is as long as its chords to a thousandth, and so is its volume.
        let laid_mm3 = figure(&figures, "volume_mm3");
        assert!(
            (laid_mm3 / VASE_MM3 - 1.0).abs() < 2e-3,
            "{name}: {laid_mm3} {VASE_MM3}"
        );
        let mean_mm = 2.0 * PI * if name == "open5x" { 22.4 } else { 21.2 };
        let length_mm = figure(&figures, "print_mm");
        assert!(
            (length_mm / (4.0 * mean_mm) - 1.0).abs() < 0.02,
            "{name}: {length_mm}"
        );
        if let Some(meant_s) = seconds {
            let print_s = figure(&figures, "print_s");
            // It begins and ends at rest, and travels to and fro.
            assert!(
                print_s > meant_s && print_s < 1.25 * meant_s + 4.0,
                "{name}: {print_s}"
            );
        }
    }
}

#[test]
fn what_a_file_does_not_say_is_asked() {
    let folder = folder("axes_asked");
    let input = folder.join("asked.gcode");
    let job = folder.join("asked.hwj");
    let asked = |text: &str, options: &[&str]| {
        std::fs::write(&input, text).expect("written");
        let plan = [&["plan", path(&input), "-o", path(&job)], options].concat();
        let ran = headway(&plan);
        assert!(!ran.status.success() && !job.exists(), "{text} {options:?}");
        (ran.status.code(), stderr(&ran))
    };
    for (text, parts) in [
        (
            ring(),
            ["line 7: C turns whole turns", "--axes \"C=heading\""],
        ),
        (s4(), ["line 7: B moves an axis", "head or the table"]),
        (rotbot(), ["line 6: U moves an axis", "extruder=U"]),
        (
            "MANUAL_STEPPER STEPPER=stepper_a MOVE=30\nG1 X9 E1\n".to_string(),
            ["line 1: stepper_a moves an axis", "stepper_a=table:x"],
        ),
        (
            "M83\nG1 X9 A3 E1\nG1 X10 E1\n".to_string(),
            ["line 2: A moves an axis", "pivot"],
        ),
    ] {
        let (code, told) = asked(&text, &[]);
        assert_eq!(code, Some(1), "{told}");
        assert!(parts.iter().all(|part| told.contains(part)), "{told}");
    }
    let (code, told) = asked(&s4(), &["--axes", "C=table:z,coordinates=pivot"]);
    assert!(
        code == Some(1) && told.contains("B is no axis that --axes declares"),
        "{told}"
    );
    for (words, part) in [
        ("C=table:z,B=head:y", "coordinates=tip or coordinates=pivot"),
        ("C=table:z,B=head:y,coordinates=pivot", "at=0/0/42"),
        ("C=turntable", "is no term of axes"),
    ] {
        let (code, told) = asked(&s4(), &["--axes", words]);
        assert!(code == Some(2) && told.contains(part), "{told}");
    }
    // A heading beside moves that go around something is one, as ever.
    std::fs::write(
        &input,
        "M83\nG1 X30 C90 E1 F1800\nG1 Y30 C180 E1\nG1 X0 C270 E1\nG1 Y0 C360 E1\n",
    )
    .expect("written");
    let found = object(&headway(&["inspect", path(&input), "--json"]));
    assert_eq!(found["headings"], true);
    // Tilts of a head whose controller knows the tip, as the machine file says.
    let machine = folder.join("machine.toml");
    let text = std::fs::read_to_string(machine_file("gantry")).expect("an example");
    std::fs::write(&machine, format!("{text}\n[gcode]\nletters = \"A,B,C\"\n")).expect("written");
    std::fs::write(
        &input,
        "M83\nG1 X1 A3 E.1 F900\nG1 X30 A5 E1\nG1 X40 A6 E1\n",
    )
    .expect("written");
    let ran = headway(&[
        "plan",
        path(&input),
        "-m",
        path(&machine),
        "-o",
        path(&job),
        "--json",
    ]);
    assert!(ran.status.success(), "{}", stderr(&ran));
    // Not of other inputs.
    let outline = folder.join("square.svg");
    std::fs::write(&outline, "<svg/>").expect("written");
    let refused = headway(&["inspect", path(&outline), "--axes", "C=heading"]);
    assert!(refused.status.code() == Some(2) && stderr(&refused).contains("goes with G-code"));
}
