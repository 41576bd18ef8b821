//! Goal: an exported file prints the job behind any start block, or is refused with the block's line; it ends with the tip
//! clear of the print, and says its time, filament and progress. Method: the command on a U-shaped part for all five
//! dialects; the files are run by the models of the controllers, which share nothing with Headway's reader.

use crate::rig::{example, folder, headway, path, stderr, succeeded};
use headway_tests::controllers::{HEADING, Printed, guide};
use std::path::{Path, PathBuf};

const DIALECTS: [&str; 5] = ["klipper", "reprapfirmware", "marlin", "linuxcnc", "grblhal"];

/// The part's job, which heats nothing.
fn job(folder: &Path) -> PathBuf {
    let job = folder.join("u.hwj");
    let part = example("u-part.json");
    succeeded(&headway(&["plan", &part, "-o", path(&job)]));
    job
}

/// `export` to stdout with heat, and what more is given.
fn export(job: &Path, dialect: &str, more: &[&str]) -> std::process::Output {
    let all = ["export", path(job), "--to", "gcode", "--dialect", dialect];
    let heat = ["--hot-end", "210", "--bed", "60"];
    headway(&[&all[..], &heat, more].concat())
}

fn printed(dialect: &str, text: &str) -> Printed {
    let guide = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/guide/gcode.md");
    let guide = std::fs::read_to_string(guide).expect("the guide");
    guide::print(dialect, &guide, text).unwrap_or_else(|error| panic!("{dialect}: {error}"))
}

/// A block that leaves relative places, absolute E, inches where the controller has them, and counts that are not zero; a
/// purge line.
fn careless(dialect: &str) -> &'static str {
    match dialect {
        "klipper" => {
            "M190 S60\nM109 S210\nG28\nM82\nG92 E0\nG1 X60 Y2 Z0.3 F3000\nG1 X90 E9 F900\nG91\nG1 Z2 F600\nG92 E7\n"
        }
        "reprapfirmware" | "marlin" => {
            "M190 S60\nM109 S210\nG28\nM82\nG92 E0\nG1 X60 Y2 Z0.3 F3000\nG1 X90 C360 E9 F900\nG20\nG91\nG1 Z.1 F60\nG92 E7\n"
        }
        _ => "G94\nG21\nG90\nG1 X60 Y2 Z0.3 C360 F3000\nG20\nG91\nG1 Z.1 F60\nG92 U7\n",
    }
}

#[test]
fn what_the_moves_need_stands_behind_any_block() {
    let folder = folder("needs");
    let job = job(&folder);
    let start = folder.join("mine.g");
    for dialect in DIALECTS {
        let whole = succeeded(&export(&job, dialect, &[]));
        let wanted = printed(dialect, &whole);
        assert_eq!(wanted.left, Vec::<String>::new(), "{dialect}");
        std::fs::write(&start, careless(dialect)).expect("written");
        let ran = export(&job, dialect, &["--start", path(&start)]);
        let own = printed(dialect, &succeeded(&ran));
        assert_eq!(own.left, Vec::<String>::new(), "{dialect}");
        let share = own.filament_mm / wanted.filament_mm;
        assert!((share - 1.0).abs() < 1e-9, "{dialect}: {share}");
        // The zero of a heading that the block turned is where it stands then; Klipper's has no letter yet.
        let zero_deg = own.places[0][HEADING] - wanted.places[0][HEADING];
        let turned_deg = if dialect == "klipper" { 0.0 } else { 360.0 };
        assert!((zero_deg - turned_deg).abs() < 1e-9, "{dialect}");
        assert_eq!(own.places.len(), wanted.places.len(), "{dialect}");
        for (own, wanted) in own.places.iter().zip(&wanted.places) {
            for axis in 0..6 {
                let zero = if axis == HEADING { zero_deg } else { 0.0 };
                assert!((own[axis] - zero - wanted[axis]).abs() < 1e-9, "{dialect}");
            }
        }
        let headings = wanted.places.iter().map(|place| place[HEADING]);
        let most_deg = headings.fold(0.0, |most: f64, deg| most.max(deg.abs()));
        assert!(most_deg > 90.0, "{dialect}: the nozzle hardly turns");
    }
}

/// Blocks behind which a controller does something else, and the line that does it.
#[test]
fn blocks_that_change_the_job_are_refused_with_their_line() {
    let folder = folder("refused");
    let job = job(&folder);
    let (start, out) = (folder.join("mine.g"), folder.join("out.gcode"));
    for dialect in DIALECTS {
        let tool = matches!(dialect, "linuxcnc" | "grblhal");
        for (block, line, told) in [
            ("G90\nG92 X10 Y5\nM82\n", "line 2", "X would be -10.000 mm"),
            ("\nM221 S90\n", "line 2", "0.900 times the job's filament"),
            ("M82\nM200 D1.75\n", "line 2", "mm for mm³"),
            ("G90\nG55\n", "line 2", "first coordinate system"),
            ("G90\nG1 X5 F\nG28\n", "line 2", "number"),
        ] {
            std::fs::write(&start, block).expect("written");
            let more = ["--start", path(&start), "-o", path(&out)];
            let refused = export(&job, dialect, &more);
            let said = stderr(&refused);
            assert_eq!(refused.status.code(), Some(2), "{dialect} {block}: {said}");
            let place = format!("{line} of the start block");
            assert!(said.contains(&place) && said.contains(told), "{said}");
            assert!(!out.exists(), "{dialect} {block}");
        }
        // What is taken back within the block, or undone behind it, is no matter; nor what a macro does.
        let fine = match tool {
            true => "G92 X10\nG92.1\nG18\nG43 H1\n",
            false => "M221 S90\nM221 S100\nG92 X10\nG28\nPRINT_START BED=60 EXTRUDER=210\n",
        };
        std::fs::write(&start, fine).expect("written");
        succeeded(&export(&job, dialect, &["--start", path(&start)]));
    }
}

/// The printed block given back is the file without it, and heaters are waited for once.
#[test]
fn the_printed_block_is_the_start() {
    let folder = folder("printed");
    let job = job(&folder);
    let (start, end) = (folder.join("start.g"), folder.join("end.g"));
    for dialect in DIALECTS {
        let whole = succeeded(&export(&job, dialect, &[]));
        let blocks = [(&start, "--print-start"), (&end, "--print-end")];
        for (file, print) in blocks {
            let text = succeeded(&export(&job, dialect, &[print]));
            std::fs::write(file, text).expect("written");
        }
        let given = ["--start", path(&start), "--end", path(&end)];
        assert_eq!(
            succeeded(&export(&job, dialect, &given)),
            whole,
            "{dialect}"
        );
    }
    let waits = |block: &str| {
        std::fs::write(&start, block).expect("written");
        let text = succeeded(&export(&job, "marlin", &["--start", path(&start)]));
        ["M190 S", "M109 S", "M109 S210\n"].map(|order| text.matches(order).count())
    };
    assert_eq!(waits("M190 S55\nG28\nM109 S205\n"), [1, 1, 0]);
    assert_eq!(waits("; M109 comes later\nM104 S150\nG28\n"), [1, 1, 1]);
    assert_eq!(waits("START BED={bed_c} HOT={hot_end_c}\n"), [0, 0, 0]);
}

#[test]
fn files_end_clear_of_the_print_and_say_what_front_ends_show() {
    let folder = folder("ends");
    let job = job(&folder);
    for dialect in DIALECTS {
        let text = succeeded(&export(&job, dialect, &[]));
        let (moves, end) = text.split_once(";end of the job").expect("an end");
        let z_of = |line: &str| {
            let word = line
                .split_whitespace()
                .find_map(|word| word.strip_prefix('Z'));
            word.and_then(|word| word.parse::<f64>().ok())
        };
        let top_mm = moves.lines().filter_map(z_of).fold(0.0, f64::max);
        let lift_mm = end.lines().find_map(z_of).expect("a lift");
        assert!(
            (lift_mm - top_mm - 10.0).abs() < 1e-6,
            "{dialect}: {lift_mm}"
        );
        assert!(end.contains("\nG0 X0.000 Y0.000"), "{dialect}: {end}");
        assert!(moves.contains("\n;LAYER_COUNT:1\n") && moves.contains("\n;LAYER:0\n"));
        let said = ["time (normal mode) = ", "filament used [mm] = "];
        assert!(said.iter().all(|said| end.contains(said)), "{end}");
        let tool = matches!(dialect, "linuxcnc" | "grblhal");
        assert_eq!(moves.contains("\nM73 P50 R0\n"), !tool, "{dialect}");
    }
    // Without heat the job is refused as before; a temperature that no board has is no option.
    let bare = ["export", path(&job), "--to", "gcode", "--dialect", "marlin"];
    let cold = headway(&bare);
    assert_eq!(cold.status.code(), Some(1));
    assert!(stderr(&cold).contains("--hot-end 210"), "{}", stderr(&cold));
    let wrong = headway(&[&bare[..], &["--hot-end", "-5"]].concat());
    assert_eq!(wrong.status.code(), Some(2), "{}", stderr(&wrong));
}
