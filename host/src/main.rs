//! The `headway` command.

fn main() -> std::process::ExitCode {
    headway::cli::run(std::env::args_os())
}
