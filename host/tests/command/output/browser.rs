//! Goal: the report's page works in a real browser: it loads without an error or a request, plays,
//! slides, zooms, shows places, switches layers, fits a phone, prints, and has no serious accessibility
//! fault. Method: `host/tests/browser/report.mjs` drives Chromium by Playwright over reports that the
//! command wrote.
//!
//! Skipped, and said so, where Node, Chromium or the two packages are missing (`NODE_TOOLS` names the
//! folder whose `node_modules` has playwright-core and axe-core); `HEADWAY_DEMAND_BROWSER=1` makes
//! that a failure.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Largest page of an example, bytes.
const PAGE_BYTES_MAX: u64 = 15_000_000;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// What is missing to drive a browser, if anything.
fn missing() -> Option<String> {
    let tools = std::env::var_os("NODE_TOOLS").map(PathBuf::from);
    let Some(tools) = tools else {
        return Some("NODE_TOOLS is not set".to_string());
    };
    let browser = std::env::var("CHROMIUM").unwrap_or_else(|_| "/usr/bin/chromium".to_string());
    let needed = [
        tools.join("node_modules/playwright-core"),
        tools.join("node_modules/axe-core"),
        PathBuf::from(browser),
    ];
    let absent = needed.iter().find(|path| !path.exists());
    absent.map(|path| format!("{} is missing", path.display()))
}

/// True where there is no browser to drive, which may be forbidden.
fn skipped() -> bool {
    let missing = missing();
    if let Some(what) = &missing {
        let demanded = std::env::var_os("HEADWAY_DEMAND_BROWSER").is_some();
        assert!(!demanded, "{what}");
        eprintln!("left out: {what}");
    }
    missing.is_some()
}

/// What a script said of a page, which must be nothing bad.
fn driven(script: &str, page: impl AsRef<OsStr>) -> String {
    driven_with(script, &[page.as_ref()])
}

fn driven_with(script: &str, arguments: &[&OsStr]) -> String {
    let driven = Command::new("node")
        .arg(root().join("host/tests/browser").join(script))
        .args(arguments)
        .output()
        .expect("node");
    let said = String::from_utf8_lossy(&driven.stdout).into_owned();
    let failed = String::from_utf8_lossy(&driven.stderr);
    assert!(driven.status.success(), "{said}{failed}");
    said
}

/// The page of an example.
fn written(input: &str, options: &[&str], report: &Path) -> PathBuf {
    let view = Command::new(env!("CARGO_BIN_EXE_headway"))
        .current_dir(root())
        .args(["view", "--no-open", "--quiet"])
        // A path of its own stays as it is.
        .arg(Path::new("examples").join(input))
        .arg("--report")
        .arg(report)
        .args(options)
        .output()
        .expect("the command");
    assert!(view.status.success(), "{input}: {view:?}");
    report.join("index.html")
}

/// Goal: the README shows the page as it is. Method: `picture.mjs` holds a new picture of it against that one; where
/// the page was changed on purpose, `node host/tests/browser/picture.mjs PAGE docs/pictures/report.png take`.
#[test]
fn the_page_looks_as_the_kept_picture() {
    if skipped() {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let page = written("u-part.json", &[], &folder.path().join("u-part"));
    let kept = root().join("docs/pictures/report.png");
    let said = driven_with("picture.mjs", &[page.as_ref(), kept.as_ref()]);
    assert_eq!(said.lines().count(), 2, "{said}");
}

#[test]
fn the_page_works_in_a_browser() {
    if skipped() {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let reports: [(&str, &[&str]); 5] = [
        (
            "letter.json",
            &["--layers", "3", "--walls", "1", "--infill-density", "40"],
        ),
        ("washers.geojson", &[]),
        ("gear-6axis.wpt", &["-m", "examples/machines/gantry.toml"]),
        ("gear-6axis.wpt", &["-m", "examples/machines/trunnion.toml"]),
        ("u-part.json", &["-m", "examples/machines/arm-small.toml"]),
    ];
    for (number, (input, options)) in reports.into_iter().enumerate() {
        let report = folder.path().join(format!("{number}-{input}"));
        let page = written(input, options, &report);
        let bytes = page.metadata().expect("the page").len();
        assert!(bytes < PAGE_BYTES_MAX, "{input}: {bytes} bytes");
        println!("{input}, {bytes} bytes");
        let said = driven("report.mjs", &page);
        println!("{said}");
        assert!(said.lines().count() > 15, "{input}: {said}");
    }
}

/// The page of an input that the test makes.
fn written_of(folder: &Path, name: &str, contents: &[u8], options: &[&str]) -> PathBuf {
    let input = folder.join(name);
    std::fs::write(&input, contents).expect("an input");
    written(
        input.to_str().expect("text"),
        options,
        &folder.join("report"),
    )
}

/// Goal: beads are the ground that the aperture sweeps, without cracks, and what is red is open. Method: `sweep.mjs`.
#[test]
fn beads_are_drawn_as_the_aperture_sweeps_them() {
    if skipped() {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let page = written("u-part.json", &[], &folder.path().join("u-part"));
    let figures = page.with_file_name("report.json");
    let said = driven_with("sweep.mjs", &[page.as_ref(), figures.as_ref()]);
    assert_eq!(said.lines().count(), 7, "{said}");
}

/// A flower that turns and narrows towards its top as binary STL, mm.
fn flower_stl(height: f64, rings: usize) -> Vec<u8> {
    const CORNERS: usize = 40;
    let point = |ring: usize, corner: usize| {
        let (up, a) = (
            ring as f64 / rings as f64,
            corner as f64 / CORNERS as f64 * std::f64::consts::TAU,
        );
        let r = 8.0 * (1.0 - 0.2 * up) * (1.0 + 0.1 * (5.0 * (a - 0.3 * up)).cos());
        [r * a.cos(), r * a.sin(), height * up]
    };
    let mut triangles: Vec<[[f64; 3]; 3]> = Vec::new();
    for corner in 0..CORNERS {
        let next = (corner + 1) % CORNERS;
        for ring in 0..rings {
            let [a, b] = [point(ring, corner), point(ring, next)];
            let [c, d] = [point(ring + 1, next), point(ring + 1, corner)];
            triangles.extend([[a, b, c], [a, c, d]]);
        }
        triangles.push([[0.0; 3], point(0, next), point(0, corner)]);
        triangles.push([[0.0, 0.0, height], point(rings, corner), point(rings, next)]);
    }
    let mut bytes = vec![0; 80];
    bytes.extend((triangles.len() as u32).to_le_bytes());
    for triangle in triangles {
        let numbers = [[0.0; 3]].into_iter().chain(triangle).flatten();
        bytes.extend(numbers.flat_map(|number| (number as f32).to_le_bytes()));
        bytes.extend([0, 0]);
    }
    bytes
}

/// Goal: every layer of a part has its outline, its open ground, its clock, kinds of bead with time and share; places
/// are shown on their layer, headings within a turn, sparse ground is told from solid. Method: `layers.mjs`.
#[test]
fn the_page_tells_the_layers_of_a_part_apart() {
    if skipped() {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let options = ["--walls=1", "--infill-density=25", "--bottom=1", "--top=1"];
    let page = written_of(folder.path(), "flower.stl", &flower_stl(1.2, 6), &options);
    let figures = page.with_file_name("report.json");
    let said = driven_with("layers.mjs", &[page.as_ref(), figures.as_ref()]);
    assert!(said.lines().count() >= 16, "{said}");
    // The same from its job file, which knows the kinds of its passes.
    let job = folder.path().join("flower.hwj");
    let plan = Command::new(env!("CARGO_BIN_EXE_headway"))
        .args(["plan", "--quiet", "-o"])
        .args([
            job.as_os_str(),
            folder.path().join("flower.stl").as_os_str(),
        ])
        .args(options)
        .output()
        .expect("the command");
    assert!(plan.status.success(), "{plan:?}");
    let of_job = folder.path().join("of-job");
    let page = written(job.to_str().expect("text"), &[], &of_job);
    let figures = page.with_file_name("report.json");
    let of_job = driven_with("layers.mjs", &[page.as_ref(), figures.as_ref()]);
    assert_eq!(of_job.lines().count(), said.lines().count(), "{of_job}");
}

/// A slicer's file of so many layers that all differ.
fn flower_gcode(layers: usize) -> String {
    use std::fmt::Write;
    const CORNERS: usize = 24;
    let mut text = String::from("M83\nG21\nG90\nM104 S210\nM140 S60\n");
    for layer in 0..layers {
        let up = layer as f64 / layers as f64;
        if layer == 1 {
            text += "M104 S195\n";
        }
        let kinds: &[(&str, f64)] = match layer {
            0 => &[("Skirt/Brim", 1.6), ("External perimeter", 1.0)],
            _ => &[("External perimeter", 1.0)],
        };
        let z = 0.2 * (layer + 1) as f64;
        writeln!(text, ";LAYER_CHANGE\nG1 Z{z:.2} F6000").expect("to memory");
        for (kind, scale) in kinds {
            let corner = |k: usize| {
                let a = k as f64 / CORNERS as f64 * std::f64::consts::TAU;
                let r = scale * 4.0 * (1.0 - 0.3 * up) * (1.0 + 0.1 * (4.0 * (a - 1.5 * up)).cos());
                [100.0 + r * a.cos(), 100.0 + r * a.sin()]
            };
            let [x, y] = corner(0);
            writeln!(text, ";TYPE:{kind}\nG1 X{x:.4} Y{y:.4} F9000").expect("to memory");
            for k in 1..=CORNERS {
                let ([x, y], [from_x, from_y]) = (corner(k), corner(k - 1));
                // A bead of 0.8 x 0.2 mm from a filament of 1.75 mm.
                let e = (x - from_x).hypot(y - from_y) * 0.16 / 2.405;
                writeln!(text, "G1 X{x:.4} Y{y:.4} E{e:.5} F1800").expect("to memory");
            }
        }
    }
    text
}

/// Goal: 200 layers that all differ are drawn soon, as a stack that costs little, and the cursor tells the file's line.
/// Method: `stack.mjs`.
#[test]
fn two_hundred_different_layers_are_one_stack() {
    if skipped() {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let gcode = flower_gcode(200);
    let page = written_of(folder.path(), "flower.gcode", gcode.as_bytes(), &[]);
    let bytes = page.metadata().expect("the page").len();
    assert!(bytes <= PAGE_BYTES_MAX, "{bytes} bytes");
    let file = folder.path().join("flower.gcode");
    let said = driven_with("stack.mjs", &[page.as_ref(), file.as_ref()]);
    println!("{bytes} bytes\n{said}");
    assert!(
        said.contains("frames a second") && said.lines().count() >= 20,
        "{said}"
    );
}

/// Goal: the bar of a served page shows the print and commands it. Method: Chromium on the page of a print
/// to a board in this process; the command must end well though the page is closed on the way.
#[cfg(unix)]
#[test]
fn the_page_of_a_print_works_in_a_browser() {
    if skipped() {
        return;
    }
    let folder = crate::rig::folder("live");
    let (job, expected) = crate::rig::board::job(&folder, 12);
    let board = crate::rig::board::Board::unix(&folder, 1.0);
    let view = ["--view", "--no-open", "--json"];
    let stream = [&["stream", &job, "--port", &board.port], &view[..]].concat();
    let host = crate::rig::board::Host::start(&stream);
    host.wait_for("page: http://");
    let said = host.said.lock().expect("words").clone();
    let url = said
        .split("page: ")
        .nth(1)
        .and_then(|rest| rest.lines().next());
    let told = driven("live.mjs", url.expect("an address"));
    assert!(told.lines().count() >= 8, "{told}");
    let (well, _, said) = host.end();
    assert!(well, "{said}");
    assert_eq!(crate::rig::board::counts(&board.end()), expected);
}
