//! `headway export --to rapid|krl|urscript|sinumerik`: a job as a program of a controller, in one file or several.

use crate::cli::args::export::{ExportArgs, ExportName};
use crate::cli::args::output_path::OutputPath;
use crate::cli::error::CliError;
use crate::cli::reading::job::Job;
use crate::cli::terminal::console::Console;
use crate::cli::terminal::output_file::OutputFile;
use crate::cli::terminal::result_kind::PROGRAM;
use crate::programs::{Language, ProgramJob, ProgramOptions, write_program};
use std::path::Path;

/// The language of what is written.
pub(crate) fn language(to: ExportName) -> Option<Language> {
    match to {
        ExportName::Rapid => Some(Language::Rapid),
        ExportName::Krl => Some(Language::Krl),
        ExportName::Urscript => Some(Language::UrScript),
        ExportName::Sinumerik => Some(Language::Sinumerik),
        _ => None,
    }
}

/// Writes the program's files beside the one that is named.
pub(crate) fn run(
    job: &Job,
    language: Language,
    args: &ExportArgs,
    console: &Console,
) -> Result<(), CliError> {
    let usage = |problem: String| CliError::Usage(problem);
    let ending = language.ending();
    let Some(output) = args.output.as_ref().map(OutputPath::name) else {
        return Err(usage(format!(
            "--to {}: a program is files named after it: give -o part.{ending}",
            language.option()
        )));
    };
    let has_ending = (output.extension()).is_some_and(|own| own.eq_ignore_ascii_case(ending));
    let stem = output.file_stem().and_then(|stem| stem.to_str());
    let Some(stem) = stem.filter(|_| has_ending) else {
        return Err(usage(format!(
            "{}: a program of {} is a file that ends in .{ending}",
            output.display(),
            language.name()
        )));
    };
    let Some(settings) = &job.settings else {
        return Err(CliError::Job(format!(
            "{}: the job does not have its machine file with it: plan it again",
            job.name
        )));
    };
    let usual = ProgramOptions::of_settings(language, stem, settings);
    let given = &args.program;
    let options = ProgramOptions {
        tolerance_mm: given.tolerance.unwrap_or(usual.tolerance_mm),
        tool: given.tool.clone(),
        work_object: given.work_object.clone(),
        kb_max: given.max_kb,
        ..usual
    };
    let program = ProgramJob {
        stream: &job.stream,
        machine: &job.file.header.machine,
        tip_acceleration_mm_s2: settings.tip_acceleration_mm_s2,
        pump: settings.pump.as_ref(),
    };
    let written = write_program(&program, &options).map_err(|error| usage(error.to_string()))?;
    let folder = output.parent().unwrap_or(Path::new(""));
    let files: Vec<OutputFile> = (written.files.iter())
        .map(|file| OutputPath::from(folder.join(&file.name)).file(PROGRAM, console))
        .collect::<Result<_, _>>()?;
    // The main program last: it is not there without what it calls.
    for (file, text) in files.iter().zip(&written.files).rev() {
        console.result_to(Some(file), &text.text)?;
    }
    console.notes(&written.notes);
    console.say(&format!(
        "{} files, {} points, at most {:.0} a second, for {:.1} s of motion",
        written.files.len(),
        written.points,
        written.points_a_second,
        written.duration_s
    ));
    Ok(())
}
