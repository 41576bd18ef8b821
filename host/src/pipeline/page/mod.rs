//! The report of a planned job: its pictures, its layers and what its page is told.
//!
//! In: [`Planned`], planned just now or read from a file. Out: the report's files, or the page as one text. Leaves out
//! how they are drawn ([`crate::report`]) and where they go.

pub mod layers;
pub mod pictures;

use crate::drive::time_by_limit::time_by_limit;
use crate::pipeline::findings::settled_verdict::settle;
use crate::pipeline::findings::time_figures;
use crate::pipeline::planned::Planned;

/// Adds what takes its time to the figures, which a job that was only planned has not.
pub fn with_times(planned: &mut Planned) {
    let times = time_by_limit(&planned.stream, &planned.settings);
    let times = time_figures(times, &planned.transform);
    planned.figures = std::mem::take(&mut planned.figures).merged_with(&times);
}

/// The page of a job that was read back, as one text with everything in it.
pub fn page_of(mut planned: Planned) -> String {
    with_times(&mut planned);
    settle(&mut planned);
    pictures::inline_page(&planned)
}
