//! The page of a job during printing: planned job -> page.

use crate::cli::error::CliError;
use crate::cli::live::{LivePrint, serve};
use crate::cli::plan::planned;
use crate::cli::reading::job::Job;
use crate::cli::terminal::console::Console;
use crate::pipeline::page::pictures::live_page;
use crate::pipeline::page::with_times;
use std::time::Duration;

/// Time for which a page may still query after the print.
pub(crate) const LAST_LOOK: Duration = Duration::from_millis(800);

/// Makes the page, serves it and prints its address.
pub(crate) fn open(
    job: Job,
    port: u16,
    no_open: bool,
    console: &Console,
) -> Result<LivePrint, CliError> {
    let mut planned = planned::of_job(job);
    with_times(&mut planned);
    let live = serve(live_page(&planned), port)?;
    console.say(&format!("page: {}", live.url));
    if !no_open && let Err(error) = open::that_detached(&live.url) {
        console.say(&format!("no program opens it here: {error}"));
    }
    Ok(live)
}
