//! The page of a job during printing: planned job -> page, and which layer it shows at each time.

use crate::cli::error::CliError;
use crate::cli::live::{LivePrint, serve};
use crate::cli::plan::planned;
use crate::cli::reading::job::Job;
use crate::cli::terminal::console::Console;
use crate::pipeline::page::pictures::{live_page, page_layers};
use crate::pipeline::page::with_times;
use crate::pipeline::planned::Planned;
use std::time::Duration;

/// Time for which a page may still query after the print.
pub(crate) const LAST_LOOK: Duration = Duration::from_millis(800);

/// The clocks of the page's layers. Layers that are alike are shown by the first of them.
pub(crate) struct PageClock {
    /// For each layer of the job: the page's layer, and what to add to a time of the job, s.
    of_layer: Vec<(usize, f64)>,
}

impl PageClock {
    fn of(planned: &Planned) -> PageClock {
        let servo_hz = f64::from(planned.settings.machine.servo_hz);
        let begins = |layer: u32| match planned.stream.layers() {
            0 | 1 => 0.0,
            _ => planned.stream.ticks_of_layer(layer)[0] as f64 / servo_hz,
        };
        let (of_page, page_of) = page_layers(planned);
        let shift = |(layer, page): (usize, usize)| {
            let shown = of_page.get(page).copied().unwrap_or(0);
            (page, begins(shown) - begins(layer as u32))
        };
        let of_layer = page_of.into_iter().enumerate().map(shift).collect();
        PageClock { of_layer }
    }

    /// The page's layer and the time on its clock.
    pub(crate) fn at(&self, layer: u32, time_s: f64) -> (usize, f64) {
        let of = self.of_layer.get(layer as usize).copied();
        let (page, shift_s) = of.unwrap_or((0, 0.0));
        (page, time_s + shift_s)
    }
}

/// Makes the page, serves it and prints its address.
pub(crate) fn open(
    job: Job,
    port: u16,
    no_open: bool,
    console: &Console,
) -> Result<(LivePrint, PageClock), CliError> {
    let mut planned = planned::of_job(job);
    with_times(&mut planned);
    let clock = PageClock::of(&planned);
    let live = serve(live_page(&planned), port)?;
    console.say(&format!("page: {}", live.url));
    if !no_open && let Err(error) = open::that_detached(&live.url) {
        console.say(&format!("no program opens it here: {error}"));
    }
    Ok((live, clock))
}
