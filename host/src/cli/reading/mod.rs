//! The command's readers: machine files and options to settings, inputs, keep-outs, job files. In: arguments and
//! paths. Out: checked settings, inputs and parts; problems name file and option.

pub(crate) mod file_axes;
pub(crate) mod job;
pub(crate) mod layer_options;
pub(crate) mod load;
pub(crate) mod machine_keys;
pub(crate) mod part;
