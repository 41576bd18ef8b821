//! Heat that a job lacks: melt pushed through a cold hot end.
//!
//! In: a job with the machine it was planned for, its orders of heaters. Out: why it is not sent, where its machine has a
//! hot end and nothing heats one before the first bead; why it is not written as G-code, where nothing does and the
//! machine file names no material that is printed cold: another controller's machine may have a hot end. Planning
//! leaves it alone.

use crate::cli::reading::job::Job;
use crate::job::MotionState;
use crate::job::heat::{BED, HeatEvent, HeatOrder};
use headway_firmware::configuration::heat::HeaterRole;

/// What is missing; `remedy` is what the user can do here.
pub(crate) fn missing_heat(job: &Job, events: &[HeatEvent], remedy: &str) -> Option<String> {
    let settings = job.settings.as_ref()?;
    let heaters = &settings.heaters.as_ref()?.heaters;
    let is_hot_end = |heater: u8| {
        let heater = heaters.get(usize::from(heater));
        heater.is_some_and(|heater| heater.role == HeaterRole::HotEnd)
    };
    let has_hot_end = heaters.iter().any(|of| of.role == HeaterRole::HotEnd);
    (has_hot_end && heats_before_first_bead(job, events, is_hot_end) == Some(false)).then(|| {
        format!(
            "{}: machine {} has a hot end, and nothing in the job heats it before the first bead: {remedy}, or \
             plan it with a [material] in the machine file; --no-heat takes it as it is",
            job.name, settings.machine_name
        )
    })
}

/// What is missing of a job that another controller prints.
pub(crate) fn missing_in_text(job: &Job, events: &[HeatEvent], remedy: &str) -> Option<String> {
    let material = job.settings.as_ref().and_then(|settings| settings.material);
    let is_cold = material.is_some_and(|material| material.hot_end_c <= 0.0);
    let is_hot_end = |heater: u8| heater != BED;
    (!is_cold && heats_before_first_bead(job, events, is_hot_end) == Some(false)).then(|| {
        format!(
            "{}: nothing in the job heats a hot end before the first bead, and its machine file has no [material]: \
             {remedy}, plan it with a [material] (hot_end_c = 0 is printed cold), or take it as it is with --no-heat",
            job.name
        )
    })
}

/// True where an order heats one of these heaters before the first bead; `None` without a bead.
fn heats_before_first_bead(
    job: &Job,
    events: &[HeatEvent],
    is_hot_end: impl Fn(u8) -> bool,
) -> Option<bool> {
    let mut marks = job.stream.marks.iter();
    let first_bead = marks.find(|mark| mark.state == MotionState::Print)?;
    let heats = |event: &HeatEvent| match event.order {
        HeatOrder::Heater {
            heater, celsius, ..
        } => event.tick <= first_bead.start_tick && celsius > 0.0 && is_hot_end(heater),
        HeatOrder::Fan { .. } => false,
    };
    Some(events.iter().any(heats))
}
