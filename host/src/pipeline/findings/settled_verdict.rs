//! The verdict on a planned job, with what no figure holds: a hot end that nothing heats.
//!
//! In: a job with its figures, machine and orders of heaters. Out: the verdict among its figures.

use crate::job::heat::HeatOrder;
use crate::pipeline::planned::Planned;
use crate::report::verdict::verdict;
use headway_firmware::configuration::heat::HeaterRole;

/// Notes the verdict in the figures that are shown; job files hold none.
pub fn settle(planned: &mut Planned) {
    let cold = cold_hot_end(planned);
    let is_cold = planned.settings.material.is_none() && planned.heat.is_empty();
    let made = verdict(&planned.figures, cold.as_slice(), is_cold);
    planned.figures.verdict = Some(made);
}

/// Why a planned job is not to be started as it is: its machine has a hot end that nothing heats.
fn cold_hot_end(planned: &Planned) -> Option<String> {
    let settings = &planned.settings;
    let heaters = &settings.heaters.as_ref()?.heaters;
    let is_hot_end = |heater: u8| {
        let heater = heaters.get(usize::from(heater));
        heater.is_some_and(|heater| heater.role == HeaterRole::HotEnd)
    };
    let of_material = settings.material.is_some_and(|of| of.hot_end_c > 0.0);
    let of_file = planned.heat.iter().any(|event| match event.order {
        HeatOrder::Heater {
            heater, celsius, ..
        } => celsius > 0.0 && is_hot_end(heater),
        HeatOrder::Fan { .. } => false,
    });
    let has_hot_end = heaters.iter().any(|of| of.role == HeaterRole::HotEnd);
    (has_hot_end && !of_material && !of_file).then(|| {
        format!(
            "COLD: machine {} has a hot end, and nothing in the job heats it (a [material] in the machine file does)",
            settings.machine_name
        )
    })
}
