//! What is made of a job: simulation, report, exports, inspection. In: a planned job or a job file. Out:
//! files and figures.

pub(crate) mod export;
pub(crate) mod export_gcode;
pub(crate) mod export_program;
pub(crate) mod inspect;
pub(crate) mod measure;
pub(crate) mod simulate;
pub(crate) mod view;
