//! Goal: the guide cannot rot. Method: each page's blocks of shell commands are run in their order by a shell,
//! but those that are marked as not to be run here (`sh,no-run`); every other command that README and guide
//! name is looked up in that command's own help, with its options; links are followed.

use crate::rig::{folder, headway, succeeded};
use std::path::{Path, PathBuf};
use std::process::Command;

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|problem| panic!("{}: {problem}", path.display()))
}

/// README and the guide's pages.
fn pages() -> Vec<PathBuf> {
    let root = Path::new(ROOT);
    let mut pages = vec![root.join("README.md")];
    let guide = std::fs::read_dir(root.join("docs/guide")).expect("guide");
    pages.extend(guide.map(|entry| entry.expect("entry").path()));
    pages.retain(|page| page.extension().is_some_and(|ending| ending == "md"));
    pages.sort();
    assert!(pages.len() > 5, "{pages:?}");
    pages
}

/// Blocks of shell commands that are run, and those that are marked as not for here (a board, a build).
const RUN: &str = "```sh\n";
const NOT_RUN: &str = "```sh,no-run\n";

/// The texts between fences of this kind.
fn blocks(text: &str, fence: &str) -> Vec<String> {
    let fenced = text.split(fence).skip(1);
    fenced
        .map(|rest| rest.split("\n```").next().unwrap_or_default().to_owned())
        .collect()
}

/// Runs a page's blocks in their order in a folder of its own that has the project's `examples` in it.
#[cfg(unix)]
fn run_page(page: &Path) -> (PathBuf, usize) {
    let name = page.file_stem().expect("name").to_string_lossy();
    let folder = folder(&format!("guide-{name}"));
    std::os::unix::fs::symlink(format!("{ROOT}/examples"), folder.join("examples")).expect("link");
    let command = Path::new(env!("CARGO_BIN_EXE_headway"));
    let mut search = vec![command.parent().expect("folder").to_path_buf()];
    search.extend(std::env::split_paths(
        &std::env::var_os("PATH").unwrap_or_default(),
    ));
    let blocks = blocks(&read(page), RUN);
    for block in &blocks {
        let ran = Command::new("sh")
            .args(["-e", "-c", block])
            .current_dir(&folder)
            .env("PATH", std::env::join_paths(&search).expect("path"))
            .output()
            .expect("sh");
        let said = String::from_utf8_lossy(&ran.stderr);
        assert!(ran.status.success(), "{}: {block}\n{said}", page.display());
    }
    (folder, blocks.len())
}

#[cfg(unix)]
#[test]
fn the_guides_blocks_run_as_they_stand() {
    let of_guide = |page: &PathBuf| page.parent().is_some_and(|of| of.ends_with("docs/guide"));
    let pages = pages().into_iter().filter(of_guide);
    let mut run = 0;
    for page in pages {
        let (folder, blocks) = run_page(&page);
        run += blocks;
        let made: &[&str] = match page.file_stem().and_then(|name| name.to_str()) {
            Some("first-prints") => &[
                "report/index.html",
                "poses.csv",
                "hook.hwj",
                "hill-report/index.html",
                "turned.gcode",
            ],
            Some("calibration") => &["heading.hwj", "pivot.hwj", "advance-0.0600.toml"],
            _ => &[],
        };
        for made in made {
            let length = std::fs::metadata(folder.join(made)).map_or(0, |made| made.len());
            assert!(length > 100, "{made}: {length} bytes");
        }
        if page.ends_with("first-prints.md") {
            let machine = read(&folder.join("machine.toml"));
            let is_changed = machine.contains("\nspeed_mm_s = 40\n");
            assert!(is_changed, "the file was changed");
        }
    }
    assert!(run >= 12, "{run} blocks run");
}

/// Numbers of the line of a page's code that begins with a key, comments left out.
fn set(page: &str, key: &str) -> Vec<f64> {
    let code = page.split("```").skip(1).step_by(2);
    let mut lines = code.flat_map(str::lines);
    let line = lines.find(|line| {
        line.strip_prefix(key)
            .is_some_and(|rest| !rest.starts_with('_'))
    });
    let line = line.unwrap_or_else(|| panic!("no {key}"));
    let line = line[key.len()..]
        .split([';', '#'])
        .next()
        .unwrap_or_default();
    let words = line.split(|c: char| !(c.is_ascii_digit() || ".-".contains(c)));
    words.filter_map(|word| word.parse().ok()).collect()
}

/// Goal: what the pages of the controllers have one paste is what their models are run with, for X Y Z, heading and
/// extruder; and no pin or driver is taken twice. Method: the numbers of each page against those of gcode.md, which has the
/// tilts too and which the models read.
#[test]
fn the_pages_of_controllers_agree_with_the_limits_that_are_tried() {
    let page = |name: &str| read(&Path::new(ROOT).join(format!("docs/guide/{name}.md")));
    let all = page("gcode");
    let klipper = page("klipper");
    let keys = [
        "max_velocity:",
        "max_accel:",
        "max_z_velocity:",
        "max_z_accel:",
        "square_corner_velocity:",
        "minimum_cruise_ratio:",
        "max_extrude_cross_section:",
        "instantaneous_corner_velocity:",
        "velocity:",
        "accel:",
        "gear_ratio:",
    ];
    for key in keys {
        assert_eq!(set(&klipper, key), set(&all, key), "klipper: {key}");
    }
    // Klipper's own file for this board has these on X, Y, Z, extruder, heaters and fan.
    let taken =
        "PF13 PF12 PF14 PG6 PG0 PG1 PF15 PG9 PF11 PG3 PG5 PG10 PF9 PF10 PG2 PA2 PF4 PA1 PF3 PA8";
    let code = klipper.split("```").skip(1).step_by(2);
    let pins = code
        .flat_map(str::lines)
        .filter_map(|line| line.split_once("_pin:"));
    let mut pins: Vec<&str> = pins
        .map(|(_, pin)| pin.trim().trim_start_matches('!'))
        .collect();
    pins.extend(taken.split(' '));
    let count = pins.len();
    pins.sort_unstable();
    pins.dedup();
    assert_eq!((pins.len(), count), (24, 24), "{pins:?}");

    let duet = page("reprapfirmware");
    for code in ["M566", "M203", "M201"] {
        // X Y Z A B C E there, X Y Z C E here.
        let [own, whole] = [&duet, &all].map(|text| set(text, code));
        assert_eq!(
            own,
            [whole[0], whole[1], whole[2], whole[5], whole[6]],
            "{code}"
        );
    }
    let mut drivers = set(&duet, "M584");
    drivers.pop();
    drivers.sort_by(f64::total_cmp);
    drivers.dedup();
    assert_eq!(drivers.len(), 5, "a driver each: {drivers:?}");

    let marlin = page("marlin");
    for key in ["STEPS_PER_UNIT", "FEEDRATE", "ACCELERATION"] {
        let of = ["AXIS_", "MAX_", "MAX_"][usize::from(key != "STEPS_PER_UNIT")];
        let key = format!("#define DEFAULT_{of}{key}");
        let [own, whole] = [&marlin, &all].map(|text| set(text, &key));
        assert_eq!(
            own,
            [whole[0], whole[1], whole[2], whole[5], whole[6]],
            "{key}"
        );
    }
    let heading = set(&marlin, "#define DEFAULT_IJERK");
    assert_eq!(heading, set(&all, "#define DEFAULT_KJERK"));
    let steps = "#define MIN_STEPS_PER_SEGMENT";
    assert_eq!(set(&marlin, steps), set(&all, steps));

    let grblhal = page("grblhal");
    for first in [110, 120] {
        for (own, whole) in [0, 1, 2, 3, 4].into_iter().zip([0, 1, 2, 5, 6]) {
            let [own, whole] = [(&grblhal, own), (&all, whole)]
                .map(|(text, axis)| set(text, &format!("${}=", first + axis)));
            assert_eq!(own, whole, "${first}");
        }
    }
    let linuxcnc = page("linuxcnc");
    for axis in ["[AXIS_C]", "[AXIS_U]"] {
        let of = |text: &str| {
            let section = text.split(axis).nth(1).expect(axis);
            let section = format!("```{}", section.split('[').next().expect("section"));
            ["MAX_VELOCITY =", "MAX_ACCELERATION ="].map(|key| set(&section, key))
        };
        assert_eq!(of(&linuxcnc), of(&all), "{axis}");
    }
}

/// Commands in code: lines of blocks and what stands between backticks, each to its end.
fn named_commands(text: &str) -> Vec<String> {
    let in_blocks = [blocks(text, RUN), blocks(text, NOT_RUN)].concat();
    let lines = in_blocks.iter().flat_map(|block| block.lines());
    let inline = text.split('`').skip(1).step_by(2);
    let commands = lines
        .chain(inline)
        .filter(|code| code.starts_with("headway "));
    commands.map(|code| code.replace('\n', " ")).collect()
}

#[test]
fn every_named_command_has_its_options() {
    let mut options = 0;
    for page in pages() {
        for command in named_commands(&read(&page)) {
            let mut words = command.split_whitespace().skip(1).peekable();
            let mut path = Vec::new();
            // Names of commands are plain words; alternatives (`heat|fan`) are each one.
            while let Some(word) = words.next_if(|word| {
                word.chars()
                    .all(|c| c.is_ascii_lowercase() || "|-".contains(c))
                    && !word.starts_with('-')
                    && path.len() < 2
            }) {
                if !path.is_empty() && !["board", "machine"].contains(&path[0]) {
                    break;
                }
                path.push(word);
            }
            let asked: Vec<&str> = words.filter(|word| word.starts_with("--")).collect();
            let names = path.last().copied().unwrap_or_default();
            for name in names.split('|') {
                let mut arguments = path.clone();
                arguments.pop();
                arguments.extend([name, "--help"].into_iter().filter(|word| !word.is_empty()));
                let help = succeeded(&headway(&arguments));
                for option in &asked {
                    let option = option.trim_end_matches(|c: char| !c.is_ascii_alphanumeric());
                    let option = option.split(['=', '|']).next().unwrap_or_default();
                    assert!(
                        help.contains(option),
                        "{}: {command}: no {option}",
                        page.display()
                    );
                    options += 1;
                }
            }
        }
    }
    assert!(options > 20, "{options} options looked up");
}

/// All pages below a folder.
fn pages_below(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).expect("folder");
    let mut found = Vec::new();
    for entry in entries.map(|entry| entry.expect("entry").path()) {
        match entry.is_dir() {
            true => found.extend(pages_below(&entry)),
            false if entry.extension().is_some_and(|ending| ending == "md") => found.push(entry),
            false => {}
        }
    }
    found
}

/// The files that a page's links name, beside it.
fn links(text: &str) -> Vec<&str> {
    let targets = text.split("](").skip(1);
    let targets = targets.filter_map(|rest| rest.split_once(')'));
    let files = targets.map(|(target, _)| target.split('#').next().unwrap_or_default());
    files
        .filter(|file| !file.is_empty() && !file.contains("://"))
        .collect()
}

#[test]
fn the_book_has_every_page_and_every_link_leads_somewhere() {
    let docs = Path::new(ROOT).join("docs");
    let summary = read(&docs.join("SUMMARY.md"));
    let in_book = links(&summary);
    let mut followed = 0;
    for page in pages_below(&docs) {
        let name = page.strip_prefix(&docs).expect("below").to_string_lossy();
        let times = in_book.iter().filter(|file| **file == name).count();
        assert_eq!(
            times,
            usize::from(name != "SUMMARY.md"),
            "{name} in SUMMARY.md"
        );
        for link in links(&read(&page)) {
            let target = page.parent().expect("folder").join(link);
            assert!(target.exists(), "{name}: no {link}");
            followed += 1;
        }
    }
    assert!(followed > 80, "{followed} links");
}
