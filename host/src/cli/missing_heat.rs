//! Heat that a job lacks: melt pushed through a cold hot end.
//!
//! In: a job with the machine it was planned for, its orders of heaters. Out: why it is not sent or written as
//! G-code, where its machine has a hot end and nothing heats one before the first bead. Planning leaves it alone.

use super::job::Job;
use crate::job::MotionState;
use crate::job_heat::{HeatEvent, HeatOrder};
use headway_firmware::heat::HeaterRole;

/// What is missing; `remedy` is what the user can do here.
pub(super) fn missing_heat(job: &Job, events: &[HeatEvent], remedy: &str) -> Option<String> {
    let settings = job.settings.as_ref()?;
    let heaters = &settings.heaters.as_ref()?.heaters;
    let is_hot_end = |heater: u8| {
        let heater = heaters.get(usize::from(heater));
        heater.is_some_and(|heater| heater.role == HeaterRole::HotEnd)
    };
    let has_hot_end = heaters.iter().any(|of| of.role == HeaterRole::HotEnd);
    let mut marks = job.stream.marks.iter();
    let first_bead = marks.find(|mark| mark.state == MotionState::Print)?;
    let heats = |event: &HeatEvent| match event.order {
        HeatOrder::Heater {
            heater, celsius, ..
        } => event.tick <= first_bead.start_tick && celsius > 0.0 && is_hot_end(heater),
        HeatOrder::Fan { .. } => false,
    };
    (has_hot_end && !events.iter().any(heats)).then(|| {
        format!(
            "{}: machine {} has a hot end, and nothing in the job heats it before the first bead: {remedy}, or \
             plan it with a [material] in the machine file; --no-heat takes it as it is",
            job.name, settings.machine_name
        )
    })
}
