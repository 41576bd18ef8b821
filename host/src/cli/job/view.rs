//! `headway view`: the report of a job or an input, opened in the browser.

use crate::cli::args::ViewArgs;
use crate::cli::error::CliError;
use crate::cli::job::simulate::write_report;
use crate::cli::plan::planned;
use crate::cli::terminal::console::Console;
use crate::pipeline::findings::settled_verdict::settle;
use crate::pipeline::page::with_times;
use std::path::PathBuf;

pub(crate) fn run(args: &ViewArgs, console: &Console) -> Result<(), CliError> {
    let report = args.report.clone();
    let folder = report.unwrap_or_else(|| beside(args).into());
    let folder = folder.report(console)?;
    let mut planned = planned::from_file(&args.input, &args.asked, &[], console)?;
    with_times(&mut planned);
    settle(&mut planned);
    write_report(&folder, &planned, console)?;
    let page = folder.page();
    if !args.no_open
        && let Err(error) = open::that_detached(&page)
    {
        console.say(&format!(
            "no program opens {} here: {error}",
            page.display()
        ));
    }
    Ok(())
}

/// The default folder: in the working directory, named after the input.
fn beside(args: &ViewArgs) -> PathBuf {
    let stem = args.input.file_stem().unwrap_or_default();
    let mut name = stem.to_os_string();
    name.push("-report");
    PathBuf::from(name)
}
