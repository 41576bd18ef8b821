//! The verdict on a job: what keeps it from being good is said first, and refuses it unless the user allows it.
//!
//! In: a planned job with its objections, `--allow`. Out: the first lines of the figures, exit status 1 where an
//! objection stands. Leaves out how objections are found.

use super::CliError;
use super::args_allow::{AllowArgs, AllowName};
use super::planned::Planned;
use crate::findings::objections::{Objection, ObjectionKind};
use crate::report::figures::Figures;

impl AllowArgs {
    /// Objections of this kind do not refuse the job.
    fn allows(&self, kind: ObjectionKind) -> bool {
        let name = match kind {
            ObjectionKind::Touches => AllowName::Touches,
            ObjectionKind::Range => AllowName::Range,
            ObjectionKind::Fault => return false,
        };
        self.allow.contains(&name)
    }
}

/// Plans; joints that leave their ranges do so again with wider ones, where that is allowed. `plan` is given the
/// joints whose ranges are widened.
pub(super) fn planned_as_allowed<T>(
    allow: &AllowArgs,
    mut plan: impl FnMut(&[usize]) -> Result<(Planned, T), CliError>,
) -> Result<(Planned, T), CliError> {
    let (mut joints, mut places) = (Vec::new(), Vec::new());
    loop {
        match plan(&joints) {
            Err(CliError::OutsideRange { joint, place, .. })
                if allow.allows(ObjectionKind::Range) && !joints.contains(&joint) =>
            {
                joints.push(joint);
                places.push(Objection::of_range(&place));
            }
            Err(error) => return Err(error),
            Ok((mut planned, more)) => {
                planned.objections.splice(0..0, places);
                return Ok((planned, more));
            }
        }
    }
}

/// Fails where an objection stands; `consequence` says what becomes of the job.
pub(super) fn check(
    objections: &[Objection],
    allow: &AllowArgs,
    consequence: &str,
) -> Result<(), CliError> {
    let standing = objections.iter().filter(|o| !allow.allows(o.kind));
    let standing: Vec<&Objection> = standing.collect();
    if standing.is_empty() {
        return Ok(());
    }
    let texts: Vec<&str> = standing.iter().map(|o| o.text.as_str()).collect();
    let mut names: Vec<&str> = Vec::new();
    for objection in &standing {
        if objection.kind != ObjectionKind::Fault && !names.contains(&objection.kind.name()) {
            names.push(objection.kind.name());
        }
    }
    let can_be_allowed = standing.iter().all(|o| o.kind != ObjectionKind::Fault);
    let hint = match can_be_allowed {
        true => format!(" (--allow {} takes it as it is)", names.join(",")),
        false => String::new(),
    };
    Err(CliError::Job(format!(
        "{}; {consequence}{hint}",
        texts.join("; ")
    )))
}

/// Notes the objections in the figures, which say them first, before those that the job was written with.
pub(super) fn note(objections: &[Objection], figures: &mut Figures) {
    let mut lines: Vec<String> = objections.iter().map(|o| o.text.clone()).collect();
    lines.extend(figures.objections.take().unwrap_or_default());
    if !lines.is_empty() {
        figures.objections = Some(lines);
    }
}

/// The first lines of a job's figures; none of a good one.
pub(super) fn first_lines(figures: &Figures) -> String {
    let lines = figures.objections.iter().flatten();
    lines.map(|line| format!("{line}\n")).collect()
}
