//! Rules of the planner alone: the order of its stages, the size of its folders, and what the heads of
//! its files say.

use super::{Breaches, ROOT, Source, assert_none, code, sources};
use std::path::Path;

/// The planner's stages in the order of the data: a stage imports only from those before it.
const STAGES: [&str; 15] = [
    "pass",
    "progress",
    "pose_limits",
    "feasible",
    "outline",
    "axis",
    "headings",
    "coverage",
    "beads",
    "joining",
    "curve",
    "layers",
    "route",
    "motion",
    "judge",
];
pub const PLAN: &str = "host/src/plan/";
/// Where what optimises the passes is.
pub const OPTIMISER: &str = "host/optimiser/src/";
/// Most files of the planner beside its modules, and of each of its folders.
const PLAN_FILES_MAX: usize = 4;
const FOLDER_FILES_MAX: usize = 12;

/// The stage that a path of the planner belongs to, as its place in [`STAGES`].
fn stage_of(path: &str) -> Option<usize> {
    let name = path.split([':', '/', '.', ';', ' ']).next()?;
    STAGES.iter().position(|stage| *stage == name)
}

pub fn check_stages(source: &Source, breaches: &mut Breaches) {
    let Some(below) = source.name.strip_prefix(PLAN) else {
        return;
    };
    if below == "mod.rs" {
        return;
    }
    let Some(own) = stage_of(below) else {
        breaches.add(
            source,
            0,
            "a file of the planner belongs to one of its stages",
        );
        return;
    };
    for (number, line) in source.lines.iter().enumerate() {
        for named in code(line).split("crate::plan::").skip(1) {
            match stage_of(named) {
                Some(stage) if stage <= own => {}
                _ => breaches.add(
                    source,
                    number,
                    &format!("stage {} imports from a later one", STAGES[own]),
                ),
            }
        }
    }
}

#[test]
fn stages_of_the_planner_import_from_earlier_ones() {
    let mut breaches = Breaches(Vec::new());
    let sources = sources();
    for source in &sources {
        check_stages(source, &mut breaches);
    }
    let mut folders = std::collections::BTreeMap::<&str, usize>::new();
    for name in sources.iter().filter_map(|s| s.name.strip_prefix(PLAN)) {
        let is_test = name.ends_with("tests.rs") || name.contains("/test_");
        *folders
            .entry(name.rsplit_once('/').map_or("", |f| f.0))
            .or_default() += usize::from(!is_test);
    }
    for (folder, files) in folders {
        let most = if folder.is_empty() {
            PLAN_FILES_MAX
        } else {
            FOLDER_FILES_MAX
        };
        if files > most {
            breaches
                .0
                .push(format!("{PLAN}{folder}: {files} files, at most {most}"));
        }
    }
    assert_none(&breaches);
}

/// A head says what goes in and what comes out: a diagram or a sentence.
#[test]
fn heads_say_what_goes_in_and_comes_out() {
    let mut breaches = Breaches(Vec::new());
    for source in sources() {
        let is_test = source.name.ends_with("tests.rs") || source.name.contains("/test_");
        if is_test
            || ![PLAN, OPTIMISER]
                .iter()
                .any(|room| source.name.starts_with(room))
        {
            continue;
        }
        let text = std::fs::read_to_string(Path::new(ROOT).join(&source.name)).expect("a source");
        let head: String = text.lines().take_while(|l| l.starts_with("//!")).collect();
        if !["->", "In:", "In and out:", "Input:"]
            .iter()
            .any(|word| head.contains(word))
        {
            breaches.add(
                &source,
                0,
                "the head does not say what goes in and comes out",
            );
        }
    }
    assert_none(&breaches);
}
