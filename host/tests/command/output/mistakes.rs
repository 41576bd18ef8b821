//! Goal: a mistake on the command line or in a file says what is wrong, where, and what to do. Method: mistakes of each kind
//! that first users make, by the whole command; what the message says, and the exit status: 1 for files, 2 for options.

use crate::rig::{example, folder, headway, path, stderr, succeeded};
use std::path::Path;

/// Arguments, the exit status, a part of the message. `@` is the folder of the files below.
type Mistake = (&'static str, i32, &'static str);

const MISSING: [Mistake; 5] = [
    (
        "plan @/gone.json -o @/x.hwj",
        1,
        "gone.json: there is no such file",
    ),
    ("plan @/ok.json", 2, "--output <JOB.hwj>"),
    (
        "plan @/ok.json -m @/gone.toml -o @/x.hwj",
        1,
        "gone.toml: there is no such file",
    ),
    (
        "plan @/ok.json -o @/no/x.hwj",
        1,
        "make it, or name another one",
    ),
    ("stream @/ok.hwj", 2, "--port <PORT>"),
];
const WRONG_KIND: [Mistake; 7] = [
    (
        "plan @/ok.hwj -o @/x.hwj",
        2,
        "is a job, which is planned: simulate, export or stream it",
    ),
    (
        "plan @/ok.toml -o @/x.hwj",
        2,
        "is a machine file: give it with -m",
    ),
    ("plan @ -o @/x.hwj", 2, "is a folder: name a file in it"),
    ("plan @/part.step -o @/x.hwj", 2, "export it as a mesh"),
    (
        "export @/ok.json --to gcode",
        1,
        "this is not a Headway job file",
    ),
    (
        "machine check @/ok.json",
        1,
        "line 1 is no line of a machine file",
    ),
    (
        "plan @/note.txt -o @/x.hwj",
        1,
        "not a readable waypoint file",
    ),
];
const CUT_OFF: [Mistake; 3] = [
    (
        "plan @/cut.stl -o @/x.hwj",
        1,
        "ends at byte 3000; copy or export it again",
    ),
    (
        "plan @/cut.json -o @/x.hwj",
        1,
        "it is cut off; copy or export it again",
    ),
    ("export @/cut.hwj --to csv", 1, "cut.hwj"),
];
const MISSPELT: [Mistake; 6] = [
    ("plna @/ok.json", 2, "'plan'"),
    (
        "plan @/ok.json --layr-height 0.2 -o @/x.hwj",
        2,
        "'--layer-height'",
    ),
    ("plan @/ok.json --quality fasst -o @/x.hwj", 2, "'fast'"),
    (
        "plan @/ok.json --seam neer -o @/x.hwj",
        2,
        "nearest, aligned, sharpest",
    ),
    ("plan @/unit.json -o @/x.hwj", 1, "is 'units' meant?"),
    (
        "plan @/ok.json --aperture elipse:1x2 -o @/x.hwj",
        2,
        "write ellipse:LxW",
    ),
];
const BAD_NUMBER: [Mistake; 9] = [
    (
        "plan @/ok.json --layer-height 0,2 -o @/x.hwj",
        2,
        "'--layer-height <MM>': write 0.2",
    ),
    (
        "plan @/ok.json --walls 2.5 -o @/x.hwj",
        2,
        "write a whole number, as in 3",
    ),
    (
        "plan @/ok.json --walls two -o @/x.hwj",
        2,
        "write a whole number, as in 2",
    ),
    (
        "plan @/ok.json --speed fast -o @/x.hwj",
        2,
        "write a number, as in 0.2",
    ),
    (
        "plan @/ok.json --speed -5 -o @/x.hwj",
        2,
        "must be at least 0.01",
    ),
    (
        "plan @/ok.json --layer-height 2 -o @/x.hwj",
        2,
        "at most 1.2 mm wide",
    ),
    (
        "plan @/ok.json --walls 2 --infill-density 120 -o @/x.hwj",
        2,
        "at most 100",
    ),
    ("plan @/ok.json --at 1,2 -o @/x.hwj", 2, "--at 100,80,0"),
    (
        "plan @/letter.wpt -o @/x.hwj",
        1,
        "line 2, column 3: `O.2` is not a finite number",
    ),
];
const BAD_UNIT: [Mistake; 6] = [
    (
        "plan @/ok.json --layer-height 0.2mm -o @/x.hwj",
        2,
        "write 0.2",
    ),
    ("plan @/ok.json --speed 60mm/s -o @/x.hwj", 2, "write 60"),
    (
        "plan @/ok.json --infill-density 20% -o @/x.hwj",
        2,
        "write 20",
    ),
    (
        "plan @/ok.json --units furlong -o @/x.hwj",
        2,
        "mm, cm, m, um, in",
    ),
    (
        "plan @/furlong.json -o @/x.hwj",
        1,
        "units 'furlong' are not known: use mm",
    ),
    (
        "plan @/ok.json --aperture circle:0.4mm -o @/x.hwj",
        2,
        "'0.4mm' is not a size in mm greater than 0, as in 0.4",
    ),
];
const MACHINE_KEY: [Mistake; 5] = [
    ("machine check @/key.toml", 1, "is `speed_mm_s` meant?"),
    (
        "machine check @/text.toml",
        1,
        "write a number without quotes",
    ),
    (
        "machine check @/point.toml",
        1,
        "write decimals with a point, as in 0.2",
    ),
    (
        "machine check @/old.toml",
        1,
        "format = 2\naperture = \"ellipse:1.2x0.4\"",
    ),
    ("machine check @/name.toml", 1, "the key `name` is missing"),
];
const SCANS: [Mistake; 7] = [
    ("measure @/ok.json", 2, "--job <JOB.hwj>"),
    (
        "measure @/scan.csv --job @/ok.json",
        2,
        "name a job file (.hwj)",
    ),
    (
        "measure @/gone.csv --job @/ok.hwj",
        1,
        "gone.csv: there is no such file",
    ),
    ("measure @/scan.csv --job @/cut.hwj", 1, "cut.hwj"),
    (
        "measure @/scan.csv --job @/ok.hwj --layer 9",
        1,
        "the job has 1 layers, but --layer is 9",
    ),
    ("measure @/scan.csv --job @/ok.hwj --layer 0", 2, "--layer"),
    (
        "measure @/scan.csv --job @/ok.hwj --units m",
        1,
        "is its unit mm (--units)?",
    ),
];
const OUTPUTS: [Mistake; 7] = [
    ("simulate @/ok.hwj -o @/x", 2, "'--report'"),
    (
        "plan @/ok.json -o @/ok.json",
        2,
        "is read by this command, so it is not written",
    ),
    (
        "plan @/ok.json -o @/part.gcode",
        2,
        "name it .hwj, and `headway export` it",
    ),
    (
        "plan @/ok.json -o @",
        1,
        "is a directory; name a file in it",
    ),
    (
        "simulate @/ok.json --report @/note.txt",
        1,
        "a folder is to be made there",
    ),
    ("machine new -o @/key.toml", 2, "replace it with --force"),
    ("export @/ok.hwj --to gcod", 2, "gcode"),
];
const PROGRAMS: [Mistake; 22] = [
    ("export @/ok.hwj --to rapid", 2, "give -o part.mod"),
    (
        "export @/ok.hwj --to rapid -o @/part.src",
        2,
        "ends in .mod",
    ),
    (
        "export @/ok.hwj --to rapid -o @/part.mod",
        2,
        "arms of six joints",
    ),
    (
        "export @/ok.hwj --to krl -o @/part.src",
        2,
        "arms of six joints",
    ),
    (
        "export @/arm.hwj --to sinumerik -o @/part.mpf",
        2,
        "gantries that stay upright",
    ),
    (
        "export @/arm.hwj --to rapid -o @/a-long-name.mod",
        2,
        "letters, digits and underscores",
    ),
    (
        "export @/arm.hwj --to krl -o @/7part.src",
        2,
        "a letter first",
    ),
    (
        "export @/arm.hwj --to rapid -o @/p.mod --tool 1x",
        2,
        "--tool 1x: a name of RAPID",
    ),
    (
        "export @/arm.hwj --to krl -o @/p.src --tool nozzle",
        2,
        "the number of TOOL_DATA, 1 to 16",
    ),
    (
        "export @/arm.hwj --to krl -o @/p.src --work-object 40",
        2,
        "the number of BASE_DATA, 1 to 32",
    ),
    (
        "export @/arm.hwj --to urscript -o @/p.script --tool t",
        2,
        "the TCP that is active",
    ),
    (
        "export @/arm.hwj --to urscript -o @/p.script --work-object b;",
        2,
        "a feature of the installation",
    ),
    (
        "export @/ok.hwj --to sinumerik -o @/p.mpf --work-object 60",
        2,
        "54 to 57",
    ),
    (
        "export @/ok.hwj --to sinumerik -o @/p.mpf --work-object 3",
        2,
        "54 to 57",
    ),
    (
        "export @/ok.hwj --to sinumerik -o @/p.mpf --tolerance 0",
        2,
        "--tolerance 0: give 0.001 to 20 mm",
    ),
    (
        "export @/ok.hwj --to sinumerik -o @/p.mpf --tolerance nan",
        2,
        "give 0.001 to 20 mm",
    ),
    (
        "export @/ok.hwj --to sinumerik -o @/p.mpf --max-kb 1",
        2,
        "give at least 16",
    ),
    (
        "export @/ok.hwj --to gcode --dialect klipper --tool x",
        2,
        "--tool goes with programs",
    ),
    ("export @/cut.hwj --to sinumerik -o @/p.mpf", 1, "cut.hwj"),
    ("machine new --arm irb", 2, "known are abb-irb-2600"),
    ("plan @/robot.src -o @/x.hwj", 2, "a robot's program"),
    (
        "plan @/curve.mpf -o @/x.hwj",
        1,
        "line 3: BSPLINE is not read",
    ),
];

/// The files that the mistakes name.
fn files(folder: &Path) {
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.join(name), bytes).expect(name);
    let read = |name: &str| std::fs::read(example(name)).expect(name);
    write("ok.json", &read("bracket.json"));
    write("cut.json", &read("bracket.json")[..60]);
    write("cut.stl", &read("hook.stl")[..3000]);
    write("note.txt", b"hello\n");
    write("part.step", b"ISO-10303-21;\n");
    write(
        "unit.json",
        br#"{"unit":"mm","exterior":[[0,0],[9,0],[9,9]]}"#,
    );
    write(
        "furlong.json",
        br#"{"units":"furlong","exterior":[[0,0],[9,0],[9,9]]}"#,
    );
    write("letter.wpt", b"0 0 0.2 0 0 1\n1 0 O.2 0 0 1\n");
    let machine = succeeded(&headway(&["machine", "new"]));
    let edits = [
        ("ok.toml", "", ""),
        ("key.toml", "\nspeed_mm_s = 60", "\nspede_mm_s = 60"),
        ("text.toml", "\nspeed_mm_s = 60", "\nspeed_mm_s = \"400\""),
        ("point.toml", "\nspeed_mm_s = 60", "\nspeed_mm_s = 4,5"),
        ("name.toml", "\nname = \"planar\"", ""),
    ];
    for (name, old, new) in edits {
        write(name, machine.replacen(old, new, 1).as_bytes());
    }
    let old = machine.replace("format = 2\n", "");
    write(
        "old.toml",
        old.replace("ellipse:1.2x0.4", "ellipse:0.6x0.2").as_bytes(),
    );
    let job = folder.join("ok.hwj");
    succeeded(&headway(&[
        "plan",
        &example("bracket.json"),
        "-o",
        path(&job),
    ]));
    let arm = folder.join("arm.toml");
    succeeded(&headway(&[
        "machine",
        "new",
        "--arm",
        "kuka-kr-10-r1100-sixx",
        "-o",
        path(&arm),
    ]));
    succeeded(&headway(&[
        "plan",
        &example("taper.json"),
        "-m",
        path(&arm),
        "-o",
        path(&folder.join("arm.hwj")),
    ]));
    write("robot.src", b"DEF part( )\nEND\n");
    write(
        "curve.mpf",
        b"G90\nG1 X0 Y0 Z0.2 F600\nBSPLINE\nX1 E1\nX2 Y1 E2\n",
    );
    write("scan.csv", b"x,y,z\n0,0,0\n30,0,0\n");
    let job = std::fs::read(job).expect("a job");
    write("cut.hwj", &job[..job.len() / 2]);
}

#[test]
fn mistakes_are_told_with_what_to_do() {
    let folder = folder("mistakes");
    files(&folder);
    let tables: [&[Mistake]; 10] = [
        &MISSING,
        &WRONG_KIND,
        &CUT_OFF,
        &MISSPELT,
        &BAD_NUMBER,
        &BAD_UNIT,
        &MACHINE_KEY,
        &OUTPUTS,
        &PROGRAMS,
        &SCANS,
    ];
    let mut wrong = Vec::new();
    for (line, status, part) in tables.into_iter().flatten() {
        let words = line.split(' ').map(|word| word.replace('@', path(&folder)));
        let words: Vec<String> = words.collect();
        let words: Vec<&str> = words.iter().map(String::as_str).collect();
        let output = headway(&words);
        let message = stderr(&output);
        if output.status.code() != Some(*status) || !message.contains(part) {
            wrong.push(format!("{line}: {:?}\n{message}", output.status.code()));
        }
        assert!(!message.contains("os error"), "{message}");
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(!folder.join("x.hwj").exists());
}
