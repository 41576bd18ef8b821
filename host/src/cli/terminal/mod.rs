//! What the command says and writes: the terminal with its bar, texts that can be printed, files that appear whole,
//! signals that end it.

pub(crate) mod console;
pub(crate) mod output_file;
pub(crate) mod printable;
pub(crate) mod signals;
