//! What the command writes and says: figures, jobs, reports, verdicts, help.

mod browser;
mod command;
mod guide;
mod jobs;
mod joints;
mod kept_files;
mod material;
mod mistakes;
mod outputs;
mod shell;
mod verdict;
