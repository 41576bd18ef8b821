//! Goal: temperatures are held, and whatever breaks, the heaters go off in time.
//! Method: the firmware's heat module on modelled heaters (`headway_tests::thermal`), a part of what
//! `tools/thermal-campaign` runs.

use headway_tests::thermal::campaign;

#[test]
fn temperatures_are_held_through_steps_of_flow_and_fan() {
    let held = campaign::held(12);
    println!("{held:?}");
    assert!(held.overshoot_k <= 3.0, "{held:?}");
    assert!(held.steady_k <= 0.5, "{held:?}");
    assert!(held.flow_step_k <= 3.0, "{held:?}");
    assert!(held.flow_steps > 40 && held.false_alarms == 0, "{held:?}");
}

#[test]
fn every_fault_switches_the_heaters_off_within_its_bound() {
    let faults = campaign::faults();
    assert!(faults.len() >= 12);
    for (name, (off_s, bound_s)) in faults {
        println!("{name}: {off_s:?} s of {bound_s}");
        assert!(
            off_s.is_some_and(|off_s| off_s <= bound_s),
            "{name}: {off_s:?}"
        );
    }
}

#[test]
fn no_heater_is_on_past_its_bound_in_random_schedules() {
    let schedules = campaign::schedules(60);
    println!("{schedules:?}");
    assert!(schedules.bad_seeds.is_empty(), "{schedules:?}");
    assert_eq!(schedules.heater_on_past_bound + schedules.too_hot, 0);
    // They were not idle.
    assert!(schedules.faulted > 20 && schedules.hottest_c[0] > 150.0);
}
