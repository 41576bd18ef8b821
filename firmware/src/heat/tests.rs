//! Goal: each fault of a heater switches everything off, in time and with its own cause. Method:
//! readings invented here, period by period; realistic ones come from the thermal model.

use super::samples::FULL_SCALE;
use super::*;
use crate::configuration::sensor::Sensor;

/// Counts of a reading: the inverse of the sensor, by bisection.
pub(crate) fn counts(sensor: &Sensor, celsius: f32) -> f32 {
    let (mut low, mut high) = (0.0f32, 1.0f32);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        let colder = match sensor.celsius(middle) {
            Ok(found) => found < celsius,
            Err(HeatCause::SensorOpen) => true,
            Err(_) => false,
        };
        if colder {
            high = middle;
        } else {
            low = middle;
        }
    }
    0.5 * (low + high) * f32::from(FULL_SCALE)
}

struct Rig {
    heat: Heat,
    orders: Orders,
    outputs: Outputs,
}

impl Rig {
    fn new() -> Self {
        let mut configuration = HeatConfiguration::standard();
        for heater in &mut configuration.heaters {
            heater.plant.measured = true;
        }
        configuration.check().unwrap();
        Self {
            heat: Heat::new(&configuration),
            orders: Orders {
                host_heard: true,
                ..Orders::default()
            },
            outputs: Outputs::default(),
        }
    }

    /// A period in which the sensors read so.
    fn tick(&mut self, celsius: [f32; 2]) {
        for (heater, celsius) in celsius.into_iter().enumerate() {
            let counts = counts(&self.heat.configuration(heater).unwrap().sensor, celsius);
            for noise in 0..32 {
                let noise = if noise % 2 == 0 { 0.5 } else { -0.5 };
                self.heat.sample(heater, (counts + noise).round() as u16);
            }
        }
        self.outputs = self.heat.tick(&self.orders);
    }

    /// Seconds until a fault, with readings by time; `None` if there is none.
    fn until_fault(&mut self, limit_s: f32, readings: impl Fn(f32) -> [f32; 2]) -> Option<f32> {
        let mut now_s = 0.0;
        while now_s < limit_s {
            self.tick(readings(now_s));
            if self.heat.fault().is_some() {
                assert_eq!(self.outputs.duties, [0.0; HEATERS_MAX]);
                return Some(now_s);
            }
            now_s += PERIOD_S;
        }
        None
    }

    fn cause(&self) -> Option<HeatCause> {
        self.heat.fault().map(|fault| fault.cause)
    }
}

#[test]
fn a_sensor_that_fails_is_told_within_half_a_second() {
    for (raw, cause) in [
        (Some(4095), HeatCause::SensorOpen),
        (Some(0), HeatCause::SensorShorted),
        (None, HeatCause::SensorSilent),
    ] {
        let mut rig = Rig::new();
        rig.orders.targets_c = [210.0, 0.0, 0.0];
        for _ in 0..10 {
            rig.tick([200.0, 25.0]);
        }
        assert!(rig.outputs.duties[0] > 0.0);
        let mut periods = 0;
        while rig.heat.fault().is_none() {
            for _ in 0..32 {
                if let Some(raw) = raw {
                    rig.heat.sample(0, raw);
                }
                rig.heat.sample(1, 3900);
            }
            rig.outputs = rig.heat.tick(&rig.orders);
            // Off from the first period on, latched after the third.
            assert_eq!(rig.outputs.duties[0], 0.0);
            periods += 1;
        }
        assert_eq!((rig.cause(), periods), (Some(cause), 3));
        // It stays off when the sensor comes back, until somebody clears it.
        rig.tick([200.0, 25.0]);
        assert_eq!(rig.outputs.duties[0], 0.0);
        rig.heat.clear_fault();
        rig.tick([200.0, 25.0]);
        assert!(rig.outputs.duties[0] > 0.0);
    }
}

#[test]
fn a_heater_that_is_not_there_may_stay_away_while_it_is_off() {
    let mut rig = Rig::new();
    rig.orders.targets_c = [0.0, 60.0, 0.0];
    for second in 0..200 {
        for _ in 0..32 {
            rig.heat.sample(0, 4095);
            rig.heat
                .sample(1, if second % 2 == 0 { 3000 } else { 3001 });
        }
        rig.heat.tick(&rig.orders);
        assert_eq!(rig.heat.fault(), None);
    }
}

#[test]
fn too_hot_too_cold_too_slow_and_away_have_their_own_causes() {
    let mut rig = Rig::new();
    assert!(rig.until_fault(1.0, |_| [291.0, 25.0]).unwrap() < 0.31);
    assert_eq!(rig.cause(), Some(HeatCause::OverTemperature));
    assert!(!rig.outputs.cut_supply);
    (0..30).for_each(|_| rig.tick([291.0, 25.0]));
    assert!(rig.outputs.cut_supply);

    let mut rig = Rig::new();
    rig.orders.targets_c = [210.0, 0.0, 0.0];
    assert!(rig.until_fault(1.0, |_| [-12.0, 25.0]).unwrap() < 0.31);
    assert_eq!(rig.cause(), Some(HeatCause::UnderTemperature));

    let mut rig = Rig::new();
    rig.orders.targets_c = [210.0, 0.0, 0.0];
    let cold_s = rig.until_fault(60.0, |s| [25.0 + 0.02 * s, 25.0]).unwrap();
    assert!((20.0..21.0).contains(&cold_s), "{cold_s}");
    assert_eq!(rig.cause(), Some(HeatCause::HeatingSlow));

    // Falls out of its target by 1 K/s: 120 K s are gathered 15 s after the hysteresis is left.
    let mut rig = Rig::new();
    rig.orders.targets_c = [210.0, 0.0, 0.0];
    assert_eq!(
        rig.until_fault(30.0, |s| [210.0 + 0.5 * s.sin(), 25.0]),
        None
    );
    let lost_s = rig.until_fault(60.0, |s| [210.0 - s, 25.0]).unwrap();
    assert!((19.0..22.0).contains(&lost_s), "{lost_s}");
    assert_eq!(rig.cause(), Some(HeatCause::Drift));
}

#[test]
fn a_heater_that_warms_while_off_loses_its_supply() {
    // From the reset on, and from a rest of any length; the slowest bed of 300 W.
    for rise_k_s in [[2.4, 0.0], [0.0, 0.25]] {
        let mut rig = Rig::new();
        let stuck_s = rig.until_fault(60.0, |s| rise_k_s.map(|k_s| 25.0 + k_s * s));
        assert!(stuck_s.unwrap() < 30.0, "{stuck_s:?}");
        assert_eq!(rig.cause(), Some(HeatCause::HeaterStuck));
    }
    // Even where another fault was there first.
    let mut rig = Rig::new();
    rig.orders.targets_c = [210.0, 0.0, 0.0];
    assert!(rig.until_fault(1.0, |_| [-20.0, 25.0]).is_some());
    (0..400).for_each(|n| rig.tick([25.0 + 0.24 * n as f32, 25.0]));
    assert_eq!(rig.cause(), Some(HeatCause::UnderTemperature));
    assert!(rig.outputs.cut_supply);
    // A hot bed below a cold hot end, and a hot end that cools, are none.
    let mut rig = Rig::new();
    assert_eq!(rig.until_fault(120.0, |s| [25.0 + 0.09 * s, 25.0]), None);
    let mut rig = Rig::new();
    assert_eq!(rig.until_fault(120.0, |s| [200.0 - s, 25.0]), None);
}

#[test]
fn a_frozen_converter_and_power_that_does_not_fit_are_told() {
    let mut rig = Rig::new();
    rig.orders.targets_c = [210.0, 0.0, 0.0];
    let mut periods = 0;
    while rig.heat.fault().is_none() && periods < 1000 {
        for _ in 0..32 {
            rig.heat.sample(0, 379);
            rig.heat.sample(1, 3900);
        }
        rig.heat.tick(&rig.orders);
        periods += 1;
    }
    assert_eq!(rig.cause(), Some(HeatCause::SensorFrozen));
    assert!((99..=105).contains(&periods), "{periods}");
    // 2 K below the target, however much is given: the sensor hangs somewhere else.
    let mut rig = Rig::new();
    rig.orders.targets_c = [210.0, 0.0, 0.0];
    assert!(rig.until_fault(200.0, |_| [208.0, 25.0]).is_some());
    assert_eq!(rig.cause(), Some(HeatCause::PowerMismatch));
}

#[test]
fn a_host_must_be_heard_and_a_fan_must_turn() {
    let mut rig = Rig::new();
    rig.orders.targets_c = [210.0, 0.0, 0.0];
    assert_eq!(
        rig.until_fault(40.0, |s| [210.0 + 0.5 * s.sin(), 25.0]),
        None
    );
    rig.orders.host_heard = false;
    let silent_s = rig
        .until_fault(60.0, |s| [210.0 + 0.5 * s.sin(), 25.0])
        .unwrap();
    assert!(
        (HOST_SILENT_S - 0.3..HOST_SILENT_S + 0.3).contains(&silent_s),
        "{silent_s}"
    );
    assert_eq!(rig.cause(), Some(HeatCause::HostSilent));
    // Nothing heats: it may be silent for ever.
    rig.heat.clear_fault();
    rig.orders.targets_c = [0.0; 3];
    assert_eq!(rig.until_fault(100.0, |s| [200.0 - s, 25.0]), None);

    let mut rig = Rig::new();
    rig.heat.fan_tells_turns = true;
    rig.orders.fan_turns = 2;
    rig.orders.targets_c = [210.0, 0.0, 0.0];
    assert_eq!(
        rig.until_fault(20.0, |s| [210.0 + 0.5 * s.sin(), 25.0]),
        None
    );
    assert_eq!(rig.outputs.fans.hot_end, 1.0);
    rig.orders.fan_turns = 0;
    assert!(rig.until_fault(20.0, |_| [210.0, 25.0]).unwrap() < 3.3);
    assert_eq!(rig.cause(), Some(HeatCause::FanStalled));
    // The heat sink is still cooled.
    assert_eq!(rig.outputs.fans.hot_end, 1.0);
}

#[test]
fn a_long_pause_waits_cooler_and_is_ready_again_at_the_target() {
    let mut rig = Rig::new();
    rig.orders.targets_c = [210.0, 0.0, 0.0];
    (0..100).for_each(|_| rig.tick([210.0, 25.0]));
    assert_eq!(rig.outputs.not_ready, 0);
    rig.orders.paused = true;
    (0..650).for_each(|_| rig.tick([210.0, 25.0]));
    assert_eq!(rig.outputs.duties[0], 0.0);
    (0..1000).for_each(|n| rig.tick([(210.0 - 0.1 * n as f32).max(160.0), 25.0]));
    assert!(rig.outputs.duties[0] > 0.0 && rig.outputs.not_ready == 1);
    rig.orders.paused = false;
    rig.tick([160.0, 25.0]);
    assert!(rig.outputs.duties[0] > 0.9 && rig.outputs.not_ready == 1);
    assert_eq!(rig.heat.fault(), None);
}

#[test]
fn a_target_above_what_the_heater_may_have_is_not_followed() {
    let mut rig = Rig::new();
    rig.orders.targets_c = [1000.0, f32::NAN, 0.0];
    (0..10).for_each(|_| rig.tick([274.0, 25.0]));
    let near = rig.outputs.duties[0];
    (0..10).for_each(|_| rig.tick([289.0, 25.0]));
    assert!(rig.outputs.duties[0] < near);
    assert_eq!(rig.outputs.duties[1], 0.0);
    rig.orders.faulted = true;
    rig.tick([200.0, 25.0]);
    assert_eq!(rig.outputs.duties, [0.0; HEATERS_MAX]);
}

/// A sensor that has fallen out reads the room's temperature beside a heater at full power; what a host may do about
/// its target must not restart the guards. Mean duty over half an hour of each habit, every fault cleared at once.
#[test]
fn no_habit_of_a_host_keeps_a_heater_on_beside_a_fallen_sensor() {
    type Habit = fn(f32) -> f32;
    let habits: [(&str, Habit); 7] = [
        ("steady", |_| 250.0),
        ("0.1 K every 15 s", |s| 200.0 + 0.1 * (s / 15.0).floor()),
        ("0.1 K less every 15 s", |s| {
            250.0 - 0.1 * (s / 15.0).floor()
        }),
        (
            "off every 15 s",
            |s| {
                if s % 15.0 < 0.2 { 0.0 } else { 250.0 }
            },
        ),
        (
            "low every 15 s",
            |s| {
                if s % 15.0 < 0.2 { 30.0 } else { 250.0 }
            },
        ),
        ("off half of the time", |s| {
            if s % 20.0 < 10.0 { 0.0 } else { 250.0 }
        }),
        ("a little above the reading", |s| {
            if s % 24.0 < 0.2 { 27.0 } else { 35.0 }
        }),
    ];
    for (name, habit) in habits {
        let mut rig = Rig::new();
        let (mut on_s, mut first_s) = (0.0, None);
        for period in 0..18_000 {
            let now_s = period as f32 * PERIOD_S;
            rig.orders.targets_c[0] = habit(now_s);
            rig.tick([25.0, 25.0]);
            on_s += rig.outputs.duties[0] * PERIOD_S;
            if rig.heat.fault().is_some() {
                assert_eq!(rig.cause(), Some(HeatCause::HeatingSlow), "{name}");
                first_s.get_or_insert(now_s);
                rig.heat.clear_fault();
            }
        }
        // Of 20 s that a cold heater may take to rise, a tenth of the time is forgiven.
        assert!(on_s < 0.15 * 1800.0, "{name}: {on_s} s");
        assert!(first_s.is_some_and(|s| s < 60.0), "{name}: {first_s:?}");
    }
}

/// The same at the target: a heater that falls below it, while the host moves the target by a tenth.
#[test]
fn a_target_that_moves_a_little_does_not_hide_a_drift() {
    for step_k in [-0.1, 0.0, 0.1] {
        let mut rig = Rig::new();
        let lost_s = |s: f32| [210.0 - (s - 30.0).max(0.0), 25.0];
        let mut fault_s = None;
        for period in 0..600 {
            let now_s = period as f32 * PERIOD_S;
            rig.orders.targets_c[0] = 210.0 + step_k * (now_s / 2.0).floor();
            rig.tick(lost_s(now_s));
            if rig.heat.fault().is_some() {
                fault_s.get_or_insert(now_s - 30.0);
            }
        }
        assert_eq!(rig.cause(), Some(HeatCause::Drift), "{step_k}");
        assert!(
            fault_s.is_some_and(|s| (17.0..24.0).contains(&s)),
            "{step_k}: {fault_s:?}"
        );
    }
}

/// A heater that works may be told anything: targets up and down, off and on, within what it does.
#[test]
fn a_heater_that_works_trips_nothing_however_its_target_moves() {
    let mut rig = Rig::new();
    let mut celsius = 25.0f32;
    let mut asked_c = 0.0;
    let mut random = 1u32;
    for period in 0..36_000 {
        if period % 50 == 0 {
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            asked_c = match random >> 28 {
                0..4 => 0.0,
                4..8 => asked_c + 0.1,
                n => 150.0 + 8.0 * n as f32,
            };
            rig.orders.targets_c[0] = asked_c;
        }
        rig.tick([celsius, 25.0]);
        assert_eq!(rig.heat.fault(), None, "after {period} periods");
        celsius += (rig.outputs.duties[0] * 40.0 - 0.068 * (celsius - 25.0)) / 16.7 * PERIOD_S;
    }
    assert!(celsius > 30.0);
}

/// A host that clears each fault gave a shorted heater its supply back: 584 °C. What cut the supply stays: no reading,
/// no message and no reset by a program gives it back.
#[test]
fn a_supply_that_was_cut_stays_cut_whatever_is_cleared_and_read() {
    let mut rig = Rig::new();
    assert!(rig.until_fault(1.0, |_| [291.0, 25.0]).is_some());
    let fault = rig.heat.fault().unwrap();
    (0..30).for_each(|_| rig.tick([291.0, 25.0]));
    for celsius in [291.0, 200.0, 25.0] {
        rig.heat.clear_fault();
        rig.orders.targets_c = [200.0; 3];
        for _ in 0..50 {
            rig.tick([celsius, 25.0]);
            assert!(rig.outputs.cut_supply);
            assert_eq!(rig.outputs.duties, [0.0; 3]);
        }
        assert_eq!(rig.heat.fault(), Some(fault));
    }
    // Where another fault was first, and cleared before the two seconds were over.
    let mut rig = Rig::new();
    rig.orders.targets_c[0] = 210.0;
    assert!(rig.until_fault(1.0, |_| [-20.0, 25.0]).is_some());
    (0..4).for_each(|_| rig.tick([291.0, 25.0]));
    rig.heat.clear_fault();
    assert_eq!(rig.cause(), Some(HeatCause::OverTemperature));
    (0..30).for_each(|_| rig.tick([25.0, 25.0]));
    assert!(rig.outputs.cut_supply);
    // After a reset by the watchdog it is cut from the first period on; other faults cut nothing.
    for (cause, cuts) in [(HeatCause::HeaterStuck, true), (HeatCause::Drift, false)] {
        let mut rig = Rig::new();
        rig.heat.keep_cut(HeatFault {
            cause,
            heater: 0,
            value: 0,
        });
        rig.tick([25.0, 25.0]);
        assert_eq!(rig.outputs.cut_supply, cuts);
    }
}
