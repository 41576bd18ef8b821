//! Output of the command: the terminal with its progress bar, printable texts, files that appear complete, signals
//! that end it.

pub(crate) mod console;
pub(crate) mod named_files;
pub(crate) mod output_file;
pub(crate) mod printable;
pub(crate) mod result_kind;
pub(crate) mod signals;
