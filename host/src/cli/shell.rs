//! `headway completions` and `headway man`: shell completions and manual pages of this command.
//!
//! Both are generated from the options that the command reads, so that they cannot get out of date.
//! In: a shell's name, or a folder. Out: a script on stdout; a page, or a page for each command.

use crate::cli::args::Arguments;
use crate::cli::args::output_path::OutputPath;
use crate::cli::args::shell::{CompletionsArgs, ManArgs};
use crate::cli::error::CliError;
use crate::cli::terminal::console::Console;
use crate::cli::terminal::result_kind::MANUAL;
use clap::{Command, CommandFactory};

pub(crate) fn completions(args: &CompletionsArgs, console: &Console) -> Result<(), CliError> {
    let mut script = Vec::new();
    clap_complete::generate(
        args.shell.generator(),
        &mut Arguments::command(),
        "headway",
        &mut script,
    );
    console.result(&String::from_utf8_lossy(&script))
}

pub(crate) fn man(args: &ManArgs, console: &Console) -> Result<(), CliError> {
    let mut command = Arguments::command();
    command.build();
    let Some(folder) = args.output.as_ref().map(OutputPath::name) else {
        return console.result(&page(&command)?);
    };
    let mut pages = Vec::new();
    add_pages(&command, &mut pages)?;
    std::fs::create_dir_all(folder).map_err(|problem| CliError::File {
        path: folder.display().to_string(),
        problem,
    })?;
    // The folder may be one that other pages live in: only ours are written.
    let mut files = Vec::new();
    for (name, _) in &pages {
        files.push(OutputPath::from(folder.join(name)).file(MANUAL, console)?);
    }
    for (file, (_, text)) in files.iter().zip(&pages) {
        file.write(text.as_bytes())?;
    }
    console.say(&format!(
        "{}: {} pages; read one with man -l {}",
        folder.display(),
        pages.len(),
        folder.join("headway.1").display()
    ));
    Ok(())
}

/// The pages of a command and of those below it.
fn add_pages(command: &Command, pages: &mut Vec<(String, String)>) -> Result<(), CliError> {
    let name = command.get_display_name().unwrap_or(command.get_name());
    pages.push((format!("{name}.1"), page(command)?));
    for below in command.get_subcommands() {
        if below.get_name() != "help" && !below.is_hide_set() {
            add_pages(below, pages)?;
        }
    }
    Ok(())
}

fn page(command: &Command) -> Result<String, CliError> {
    let mut text = Vec::new();
    clap_mangen::Man::new(command.clone())
        .render(&mut text)
        .map_err(|problem| CliError::Job(format!("the page cannot be written: {problem}")))?;
    Ok(String::from_utf8_lossy(&text).into_owned())
}
