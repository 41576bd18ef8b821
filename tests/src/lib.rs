//! What the end-to-end tests in `tests/` share: [`rig`] (host, link and firmware on a virtual
//! clock), [`gear`] (the six-axis job that bytes are measured with), [`layer_oracle`] (coverage
//! from the knots alone), [`ground_oracle`] (the same on curved
//! ground) and [`judge`] (a plan before it), [`segment_oracle`] (what a stream does,
//! by de Boor), [`limit_oracle`] (what of the limits it uses),
//! [`solid_oracle`] (what of a part should be solid, and is open), [`dense_search`] (the published grid search
//! for headings), [`routes`] and
//! [`outlines`] (of any size), [`beads`] (as they are laid), [`centre_line`] (a slicer's, against the
//! stream), [`written_path`] (a stream against what was written of it), [`rs274`] (another interpreter of
//! G-code), [`plain_gcode`] (one of printers' files),
//! [`parts`] (that no constant was chosen on),
//! [`robot_programs`] (interpreters of robots' languages), [`thermal`] (heaters to heat and to break),
//! [`two_hosts`] (and a board, and what may happen between them), [`folders`] (of reference data), [`cpu_clock`] (for benches),
//! [`elf`] (what a controller binary holds),
//! [`emulation`] (of the boards' images, over a model of their chip).

pub mod beads;
pub mod centre_line;
pub mod controllers;
pub mod cpu_clock;
pub mod curved_parts;
pub mod dense_search;
pub mod elf;
#[cfg(unix)]
pub mod emulation;
pub mod folders;
pub mod gear;
pub mod ground_oracle;
pub mod jerk_reference;
pub mod judge;
pub mod layer_oracle;
pub mod limit_oracle;
pub mod outlines;
pub mod parts;
pub mod plain_gcode;
pub mod refusal_numbers;
pub mod rig;
pub mod robot_programs;
pub mod routes;
pub mod rs274;
pub mod scanner;
pub mod segment_oracle;
pub mod solid_oracle;
pub mod thermal;
pub mod two_hosts;
pub mod written_path;
