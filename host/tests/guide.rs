//! Goal: the guide cannot rot. Method: the blocks of first-prints.md are run in their order by a shell; every
//! other command that README and guide name is looked up in that command's own help, with its options.

mod rig;

use rig::{folder, headway, succeeded};
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

/// The texts between fences of this kind.
fn blocks(text: &str) -> Vec<String> {
    let fenced = text.split("```sh\n").skip(1);
    fenced
        .map(|rest| rest.split("\n```").next().unwrap_or_default().to_owned())
        .collect()
}

#[cfg(unix)]
#[test]
fn first_prints_run_as_they_stand() {
    let folder = folder("guide");
    std::os::unix::fs::symlink(format!("{ROOT}/examples"), folder.join("examples")).expect("link");
    let blocks = blocks(&read(&Path::new(ROOT).join("docs/guide/first-prints.md")));
    assert!(blocks.len() >= 5, "{}", blocks.len());
    let command = Path::new(env!("CARGO_BIN_EXE_headway"));
    let mut search = vec![command.parent().expect("folder").to_path_buf()];
    search.extend(std::env::split_paths(
        &std::env::var_os("PATH").unwrap_or_default(),
    ));
    for block in blocks {
        let ran = Command::new("sh")
            .args(["-e", "-c", &block])
            .current_dir(&folder)
            .env("PATH", std::env::join_paths(&search).expect("path"))
            .output()
            .expect("sh");
        let said = String::from_utf8_lossy(&ran.stderr);
        assert!(ran.status.success(), "{block}\n{said}");
    }
    for made in ["report/index.html", "poses.csv", "hook.hwj", "turned.gcode"] {
        let length = std::fs::metadata(folder.join(made)).map_or(0, |made| made.len());
        assert!(length > 100, "{made}: {length} bytes");
    }
    let machine = read(&folder.join("machine.toml"));
    assert!(
        machine.contains("\nspeed_mm_s = 40\n"),
        "the file was changed"
    );
}

/// Commands in code: lines of blocks and what stands between backticks, each to its end.
fn named_commands(text: &str) -> Vec<String> {
    let in_blocks = blocks(text);
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
