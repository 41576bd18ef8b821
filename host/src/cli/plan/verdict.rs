//! The verdict on a job: objections come first, and refuse the job unless the user allows them.
//!
//! In: a planned job with its objections, `--allow`. Out: the printed verdict, exit status 1 if an
//! objection remains. Not covered: how objections are found.

use crate::cli::args::PartArgs;
use crate::cli::args::allow::{AllowArgs, VerdictArgs};
use crate::cli::error::CliError;
use crate::cli::terminal::console::Console;
use crate::pipeline::findings::objections::{Objection, ObjectionKind};
use crate::pipeline::planned::Planned;
use crate::report::figures::{AgainstFigures, Figures};
use crate::report::verdict as report;
use crate::settings::aperture_text::words_of;
use clap::ValueEnum;

impl AllowArgs {
    /// Objections of this kind do not refuse the job. Options spell kinds as objections do.
    fn allows(&self, kind: ObjectionKind) -> bool {
        match kind {
            ObjectionKind::Fault => false,
            _ if kind.can_be_allowed() => is_named(&self.allow, kind),
            _ => !is_named(&self.refuse, kind),
        }
    }
}

/// One of the names of an option is that of the kind.
fn is_named<T: ValueEnum>(names: &[T], kind: ObjectionKind) -> bool {
    let mut values = names.iter().filter_map(ValueEnum::to_possible_value);
    values.any(|value| value.get_name() == kind.name())
}

/// Plans; if joints leave their ranges and that is allowed, plans again with wider ranges. `plan` is given the
/// joints whose ranges are widened.
pub(crate) fn planned_as_allowed<T>(
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

/// Fails if an objection remains; `consequence` describes the effect on the job.
pub(crate) fn check(
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
        if objection.kind.can_be_allowed() && !names.contains(&objection.kind.name()) {
            names.push(objection.kind.name());
        }
    }
    let can_be_allowed = standing.iter().all(|o| o.kind.can_be_allowed());
    let hint = match can_be_allowed {
        true => format!(" (--allow {} takes it as it is)", names.join(",")),
        false => String::new(),
    };
    Err(CliError::Job(format!(
        "{}; {consequence}{hint}",
        texts.join("; ")
    )))
}

/// Plans the part with another nozzle, if requested, and notes the time with it.
pub(crate) fn compare(
    args: &VerdictArgs,
    asked: &PartArgs,
    plan: impl FnOnce(&PartArgs) -> Result<Planned, CliError>,
    figures: &mut Figures,
) -> Result<(), CliError> {
    let Some(aperture) = &args.against else {
        return Ok(());
    };
    let mut asked = asked.clone();
    asked.settings.aperture = vec![aperture.clone()];
    let print_s = match plan(&asked) {
        Ok(planned) => planned.figures.print_s,
        Err(error) if !error.is_of_part() => return Err(error),
        Err(_) => None,
    };
    figures.against = Some(AgainstFigures {
        aperture: words_of(aperture),
        print_s,
    });
    Ok(())
}

/// What a terminal is shown of settled figures: the verdict, or all of them between two verdicts.
pub(crate) fn text(figures: &Figures, args: &VerdictArgs, console: &Console) -> String {
    let verdict = figures.verdict.clone().unwrap_or_default();
    let mut lines = report::terminal_lines(&verdict).join("\n") + "\n";
    match args.figures {
        true => {
            let reasons = verdict.reasons.join("\n");
            let first = match reasons.as_str() {
                "" => lines.clone(),
                reasons => format!("{reasons}\n{}\n", verdict.lines.join("\n")),
            };
            format!("{first}\n{}\n{first}", figures.to_text())
        }
        false => {
            match console.notes_hidden() {
                0 => {}
                1 => lines += "1 more note: --figures shows it.\n",
                more => lines += &format!("{more} more notes: --figures shows them.\n"),
            }
            lines
        }
    }
}
