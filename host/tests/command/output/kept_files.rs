//! Goal: no command costs anybody a file: what it reads, a log, a machine file, or anything that is no older result
//! of the same kind. Method: each command onto such files, by their own names and by links; the exit status, the message,
//! and every byte before and after. What is refused is refused before the work: nothing is planned then.

use crate::rig::{example, folder, headway, path, stderr, succeeded};
use std::path::{Path, PathBuf};

/// A folder with inputs of its own, a machine file whose nozzle is in a file, and a job.
struct Inputs {
    folder: PathBuf,
    input: String,
    machine: String,
    nozzle: String,
    job: String,
}

impl Inputs {
    fn new(test: &str) -> Inputs {
        let folder = folder(test);
        let at = |name: &str| path(&folder.join(name)).to_string();
        let [input, machine, nozzle, job] =
            ["in.json", "pr.toml", "nozzle.json", "job.hwj"].map(at);
        std::fs::copy(example("taper.json"), &input).expect("input");
        let corners = "[[0.6,0.2],[-0.6,0.2],[-0.6,-0.2],[0.6,-0.2]]";
        std::fs::write(&nozzle, corners).expect("nozzle");
        let text = succeeded(&headway(&["machine", "new"]));
        let mut lines = text.lines();
        let aperture = lines.find(|line| line.starts_with("aperture = "));
        let polygon = "aperture = \"polygon:nozzle.json\"";
        let text = text.replace(aperture.expect("aperture"), polygon);
        std::fs::write(&machine, text).expect("machine");
        succeeded(&headway(&["plan", &input, "-o", &job]));
        Inputs {
            folder,
            input,
            machine,
            nozzle,
            job,
        }
    }

    fn at(&self, name: &str) -> String {
        path(&self.folder.join(name)).to_string()
    }
}

/// Every file below, with its bytes.
fn contents(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).expect("folder") {
        let entry = entry.expect("entry");
        let path = entry.path();
        match entry.file_type().expect("type").is_dir() {
            true => found.extend(contents(&path)),
            false => found.push((path.clone(), std::fs::read(path).unwrap_or_default())),
        }
    }
    found.sort();
    found
}

/// Refused with these words, before any planning, and every file in the folder stays as it is.
#[track_caller]
fn refused(folder: &Path, arguments: &[&str], words: &[&str]) {
    let before = contents(folder);
    let output = headway(arguments);
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
    for word in words {
        assert!(said.contains(word), "{arguments:?}: no `{word}` in {said}");
    }
    // What is planned of the taper has notes.
    assert!(!said.contains("note:"), "{arguments:?}: {said}");
    assert!(contents(folder) == before, "{arguments:?}: files changed");
}

#[test]
fn what_a_command_reads_is_not_written() {
    let own = Inputs::new("inputs");
    let (input, machine, job, nozzle) = (&*own.input, &*own.machine, &*own.job, &*own.nozzle);
    let [start, log, mesh, stl] =
        ["start.gcode", "print.log", "bed.toml", "clamp.stl"].map(|name| own.at(name));
    let [start, log, mesh, stl] = [&*start, &*log, &*mesh, &*stl];
    for file in [start, log, mesh, stl] {
        std::fs::write(file, "somebody's\n").expect("file");
    }
    let report = own.at("report");
    std::fs::create_dir(&report).expect("folder");
    let page = own.at("report/index.html");
    let (report, page) = (&*report, &*page);
    std::fs::copy(input, page).expect("page");
    let made = own.at("a-0.0300.toml");
    std::fs::copy(machine, &made).expect("machine");
    let polygon = format!("polygon:{nozzle}");
    let axes = format!("machine:{machine}");
    let (a, p) = ("--aperture", "--picture");
    let board = ["--port", "unix:/nonexistent/board"];
    let on_board = |command: &[&'static str], more: &[&str]| {
        let words = [command, more, &board].concat();
        words.into_iter().map(str::to_owned).collect::<Vec<_>>()
    };
    let of = |words: &[&str]| words.iter().map(|word| word.to_string()).collect();
    let commands: Vec<(Vec<String>, &str)> = vec![
        (of(&["plan", input, "-o", input]), input),
        (of(&["plan", input, "-m", machine, "-o", machine]), machine),
        (of(&["plan", input, "-m", machine, "-o", nozzle]), nozzle),
        (of(&["plan", input, a, &polygon, "-o", nozzle]), nozzle),
        (
            of(&["plan", start, "--axes", &axes, "-o", machine]),
            machine,
        ),
        (
            of(&["plan", input, "--keep-out", start, "-o", start]),
            start,
        ),
        (of(&["plan", input, "--obstacle", stl, "-o", stl]), stl),
        (of(&["plan", input, "--surface", stl, "-o", stl]), stl),
        (of(&["plan", start, log, "-o", log]), log),
        (of(&["simulate", job, "--trace", job]), job),
        (of(&["simulate", job, "--trace-steps", job]), job),
        (
            of(&["simulate", page, "--from", "polygon", "--report", report]),
            page,
        ),
        (of(&["view", page, "--no-open", "--report", report]), page),
        (
            of(&["compare", input, a, "circle:2", a, "circle:4", p, input]),
            input,
        ),
        (
            of(&[
                "compare", input, "--sliced", start, a, "circle:2", a, "circle:4", p, start,
            ]),
            start,
        ),
        (of(&["headings", input, "-o", input]), input),
        (of(&["export", job, "--to", "csv", "-o", job]), job),
        (
            of(&[
                "export", job, "--to", "gcode", "--start", start, "-o", start,
            ]),
            start,
        ),
        (
            of(&["machine", "firmware", machine, "-o", machine]),
            machine,
        ),
        (
            of(&[
                "calibrate",
                "advance",
                "--to",
                "0.06",
                "--from",
                "0",
                "--lines",
                "3",
                "-m",
                &made,
                "-o",
                &own.at("a.hwj"),
            ]),
            &made,
        ),
        (
            of(&[
                "board",
                "simulate",
                "--listen",
                "tcp:127.0.0.1:0",
                "-m",
                machine,
                "--settings",
                machine,
            ]),
            machine,
        ),
        (on_board(&["stream"], &[job, "--log", job]), job),
        (
            on_board(&["stream"], &[job, "--resume-from", log, "--log", log]),
            log,
        ),
        (
            on_board(&["stream"], &[job, "--mesh", mesh, "--log", mesh]),
            mesh,
        ),
        (
            on_board(
                &["board", "mesh", "--area", "1,1,9,9"],
                &["-m", machine, "-o", machine],
            ),
            machine,
        ),
    ];
    for (command, output) in &commands {
        let mut command: Vec<&str> = command.iter().map(String::as_str).collect();
        refused(&own.folder, &command, &[output, "this command"]);
        // Nor by force: it would be gone before it is read again.
        command.push("--force");
        refused(&own.folder, &command, &[output, "this command"]);
    }
}

#[cfg(unix)]
#[test]
fn links_to_what_is_read_are_not_written() {
    use std::os::unix::fs::symlink;
    let own = Inputs::new("links");
    let names = ["soft.hwj", "hard.hwj", "dangling.hwj", "way"];
    let [soft, hard, dangling, way] = names.map(|name| own.at(name));
    symlink(&own.input, &soft).expect("link");
    std::fs::hard_link(&own.input, &hard).expect("link");
    for link in [&soft, &hard] {
        let plan = ["plan", &own.input, "-o", link];
        refused(&own.folder, &plan, &[link, "the same file as", "in.json"]);
        let plan = ["plan", link, "--from", "polygon", "-o", &own.input];
        refused(&own.folder, &plan, &["in.json", "the same file as", link]);
    }
    // Through a link to the folder.
    symlink(&own.folder, &way).expect("link");
    let plan = ["plan", &own.input, "-o", &format!("{way}/in.json")];
    refused(&own.folder, &plan, &["the same file as"]);
    symlink(own.at("nowhere"), &dangling).expect("link");
    let output = headway(&["plan", &own.input, "-o", &dangling]);
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(
        said.contains("dangling.hwj: is a link to a file that is not there"),
        "{said}"
    );
    assert!(!said.contains("note:"), "{said}");
}

#[test]
fn two_outputs_are_two_files() {
    let own = Inputs::new("two");
    let table = own.at("t.csv");
    let simulate = [
        "simulate",
        &own.input,
        "--trace",
        &table,
        "--trace-steps",
        &table,
    ];
    refused(&own.folder, &simulate, &["t.csv", "two outputs"]);
    let report = own.at("report");
    std::fs::create_dir(&report).expect("folder");
    let page = own.at("report/index.html");
    let simulate = [
        "simulate", &own.input, "--trace", &page, "--report", &report,
    ];
    refused(&own.folder, &simulate, &["index.html", "two outputs"]);
}

#[test]
fn machine_files_and_patterns_are_replaced_by_force_alone() {
    let own = Inputs::new("force");
    let printer = own.at("printer.toml");
    let new = ["machine", "new", "--kind", "planar", "-o", &printer];
    let forced = |command: &[&str]| succeeded(&headway(&[command, &["--force"]].concat()));
    // Twice: the same again costs nothing.
    succeeded(&headway(&new));
    succeeded(&headway(&new));
    let measured = std::fs::read_to_string(&printer).expect("file") + "# measured\n";
    std::fs::write(&printer, &measured).expect("file");
    let words = ["printer.toml", "other contents", "another file", "--force"];
    refused(&own.folder, &new, &words);
    forced(&new);
    assert!(std::fs::read_to_string(&printer).expect("file") != measured);

    // A pattern's jobs, and their machine files, which are looked at before the first job is written.
    let pattern = own.at("advance.hwj");
    let range = ["--from", "0", "--to", "0.06", "--lines", "3"];
    let calibrate = [&["calibrate", "advance", "-o", &pattern], &range[..]].concat();
    let last = own.at("advance-0.0600.toml");
    std::fs::write(&last, &measured).expect("file");
    refused(
        &own.folder,
        &calibrate,
        &["advance-0.0600.toml", "other contents", "--force"],
    );
    std::fs::remove_file(&last).expect("file");
    succeeded(&headway(&calibrate));
    succeeded(&headway(&calibrate));
    let steps = ["calibrate", "steps", "-o", &own.job];
    let before = contents(&own.folder);
    let output = headway(&steps);
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(
        said.contains("job.hwj: has other contents") && said.contains("--force"),
        "{said}"
    );
    assert!(contents(&own.folder) == before);
    forced(&steps);
    assert!(contents(&own.folder) != before);
}

#[cfg(unix)]
#[test]
fn a_log_that_is_there_is_not_replaced() {
    use crate::rig::board::Board;
    let own = Inputs::new("log");
    let log = own.at("print.log");
    let board = Board::unix(&own.folder, 50.0);
    let port = board.port.clone();
    let stream = ["stream", &own.job, "--port", &port, "--log", &log];
    // An empty file may be there.
    std::fs::write(&log, "").expect("log");
    succeeded(&headway(&stream));
    let first = std::fs::read(&log).expect("log");
    assert!(first.len() > 1000);
    let output = headway(&stream);
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(
        said.contains("print.log: ") && said.contains("--force"),
        "{said}"
    );
    assert!(std::fs::read(&log).expect("log") == first);
    board.end();
    // Another board, which is where the job begins.
    let board = Board::unix(&own.folder, 50.0);
    succeeded(&headway(&[&stream[..], &["--force"]].concat()));
    assert!(std::fs::read(&log).expect("log") != first);
    board.end();
}

#[test]
fn results_replace_results_of_their_kind_and_nothing_else() {
    let own = Inputs::new("kinds");
    let (input, job) = (&*own.input, &*own.job);
    let names = [
        "t.csv",
        "s.csv",
        "p.svg",
        "report",
        "out",
        "man",
        "printer.bin",
    ];
    let [table, steps, picture, report, out, man, firmware] = names.map(|name| own.at(name));
    let export = ["export", job, "--every-ms", "200", "-o", &out, "--to"];
    let to = |more: &[&'static str]| [&export[..], more].concat();
    let nozzles = ["--aperture", "circle:0.8", "--aperture", "circle:1"];
    let headings = ["headings", input, "--spacing", "5", "-o", &table];
    let commands: Vec<(Vec<&str>, &str)> = vec![
        (vec!["plan", input, "-o", job], "job.hwj"),
        (headings.to_vec(), "t.csv"),
        ([&headings[..], &["--json"]].concat(), "t.csv"),
        (vec!["simulate", job, "--trace", &table], "t.csv"),
        (vec!["simulate", job, "--trace-steps", &steps], "s.csv"),
        (
            vec!["simulate", job, "--report", &report],
            "report/index.html",
        ),
        (
            [&["compare", input, "--picture", &picture], &nozzles[..]].concat(),
            "p.svg",
        ),
        (to(&["csv"]), "out"),
        (to(&["csv", "--joints"]), "out"),
        (to(&["svg"]), "out"),
        (to(&["json"]), "out"),
        (to(&["json", "--joints"]), "out"),
        (to(&["ros2-json"]), "out"),
        (to(&["ros2-yaml"]), "out"),
        (to(&["gcode", "--dialect", "klipper", "--no-heat"]), "out"),
        (
            vec!["machine", "firmware", &own.machine, "-o", &firmware],
            "printer.bin",
        ),
        (vec!["man", "-o", &man], "man/headway-plan.1"),
    ];
    let of_somebody = [
        "notes\n",
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"9\">\n<rect fill=\"red\"/></svg>",
        "; a slicer's\nG1 X1\n",
        "{\n  \"polygon\": []\n}\n",
        "t_s,mine\n",
    ];
    for (command, output) in commands {
        let file = own.folder.join(output);
        // What is not there or empty, and its own result; a job is needed for the others.
        if output == "out" {
            std::fs::write(&file, "").expect("file");
        }
        succeeded(&headway(&command));
        succeeded(&headway(&command));
        let good = std::fs::read(&file).expect("file");
        for text in of_somebody {
            std::fs::write(&file, text).expect("file");
            if output != "job.hwj" || command[0] == "plan" {
                refused(
                    &own.folder,
                    &command,
                    &[output, "is not", "another", "--force"],
                );
            }
        }
        if command[0] == "machine" {
            succeeded(&headway(&[&command[..], &["--force"]].concat()));
            assert!(std::fs::read(&file).expect("file") == good);
        }
        std::fs::write(&file, good).expect("file");
    }
}

/// A folder that is not there is reported by its name, at once.
#[test]
fn a_missing_folder_is_reported_before_the_work() {
    let own = Inputs::new("missing");
    let out = own.at("no-such/out");
    let (input, job) = (&*own.input, &*own.job);
    let nozzles = ["--aperture", "circle:0.8", "--aperture", "circle:1"];
    let compare = [&["compare", input, "--picture", &out], &nozzles[..]].concat();
    let commands: [&[&str]; 8] = [
        &["plan", input, "-o", &out],
        &["headings", input, "-o", &out],
        &["simulate", input, "--trace", &out],
        &compare,
        // Before it is read that there is no such job.
        &["export", "nothing.hwj", "--to", "csv", "-o", &out],
        &["machine", "new", "-o", &out],
        &["calibrate", "steps", "-o", &out],
        &[
            "stream",
            job,
            "--port",
            "unix:/nonexistent/board",
            "--log",
            &out,
        ],
    ];
    for command in commands {
        let output = headway(command);
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(1), "{command:?}: {said}");
        let folder = path(&own.folder);
        let named = format!("there is no folder {folder}/no-such;");
        assert!(said.contains(&named), "{command:?}: {said}");
        assert!(!said.contains("note:"), "{command:?}: {said}");
    }
    assert!(!own.folder.join("no-such").exists());
}
