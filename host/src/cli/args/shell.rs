//! The options of `headway completions` and `headway man`, with their help.

use crate::cli::args::output_path::OutputPath;
use clap::{Args, ValueEnum, ValueHint};
use clap_complete::Shell;

/// `headway completions`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  headway completions bash > ~/.local/share/bash-completion/completions/headway
  headway completions zsh > ~/.zfunc/_headway
  headway completions fish > ~/.config/fish/completions/headway.fish
  headway completions powershell >> $PROFILE")]
pub(crate) struct CompletionsArgs {
    /// The shell that reads the script.
    #[arg(value_enum)]
    pub shell: ShellName,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub(crate) enum ShellName {
    /// Bash, with its bash-completion.
    Bash,
    /// Z shell.
    Zsh,
    /// Fish.
    Fish,
    /// PowerShell.
    Powershell,
}

impl ShellName {
    pub(crate) fn generator(self) -> Shell {
        match self {
            ShellName::Bash => Shell::Bash,
            ShellName::Zsh => Shell::Zsh,
            ShellName::Fish => Shell::Fish,
            ShellName::Powershell => Shell::PowerShell,
        }
    }
}

/// `headway man`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  headway man | man -l -
  headway man -o ~/.local/share/man/man1")]
pub(crate) struct ManArgs {
    /// Folder for the pages of all commands [default: the first page, to stdout].
    #[arg(short, long, value_name = "DIR", value_hint = ValueHint::AnyPath)]
    pub output: Option<OutputPath>,
}
