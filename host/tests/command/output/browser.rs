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
