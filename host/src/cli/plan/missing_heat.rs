//! Missing heat in a job: extrusion through a cold hot end.
//!
//! In: a job, the machine that it was planned for, its heater commands. Out: a reason not to send it, if the machine
//! has a hot end and nothing heats one before the first bead; a reason not to write it as G-code, if nothing heats
//! and the machine file names no material that is printed cold (another controller's machine may have a hot end).
//! Planning does not check this.

use crate::cli::reading::job::Job;
use crate::job::MotionState;
use crate::job::heat::{BED, HeatEvent, HeatOrder};
use headway_firmware::configuration::heat::HeaterRole;

/// The missing heat commands as text; `remedy` is what the user can do about it.
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

/// True if a command heats one of these heaters before the first bead; `None` without a bead.
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
