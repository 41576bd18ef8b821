mod browser;
mod command;
mod guide;
mod jobs;
mod outputs;
mod shell;
mod verdict;
