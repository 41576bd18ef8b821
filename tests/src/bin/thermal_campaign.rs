//! Prints one JSON object of figures about heating. `tools/thermal-campaign` runs it.

use headway_tests::thermal::campaign;
use serde_json::json;

fn main() {
    let held = campaign::held(200);
    let faults: serde_json::Map<_, _> = campaign::faults()
        .into_iter()
        .map(|(name, (off_s, _))| (name.to_owned(), json!(off_s)))
        .collect();
    let schedules = campaign::schedules(1000);
    let figures = json!({
        "overshoot_k": held.overshoot_k,
        "steady_k": held.steady_k,
        "flow_step_k": held.flow_step_k,
        "flow_steps": held.flow_steps,
        "false_alarms": held.false_alarms,
        "faults": faults,
        "schedules": schedules.schedules,
        "schedules_faulted": schedules.faulted,
        "heater_on_past_bound": schedules.heater_on_past_bound,
        "too_hot": schedules.too_hot,
        "hottest_c": schedules.hottest_c,
        "bad_seeds": schedules.bad_seeds,
    });
    println!("{figures:#}");
}
