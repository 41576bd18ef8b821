//! Figures of heating: how well temperatures are held, and how soon faults switch off.
//!
//! Bodies are varied around those that the board knows: power ± 10 %, masses and losses ± 20 %, lags
//! ± 30 %. Every run is deterministic in its seed.

use super::{AIR_C, Body, Injected, Temperatures, World};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::collections::BTreeMap;

/// Targets of hot end and bed, °C.
const HOT_END_C: [f32; 3] = [190.0, 230.0, 270.0];
const BED_C: [f32; 3] = [50.0, 80.0, 110.0];
/// A flow step, mm³/s: of the class that a 40 W hot end can still melt.
const FLOW_MM3_S: f32 = 25.0;
/// Share of a heater's power up to which a step is one that it can hold.
const POWER_SHARE_MAX: f64 = 0.95;
/// Time from cold until all has settled, s: the bed needs most of it.
const SETTLED_S: f64 = 1200.0;

/// How well it heats: worst of all runs.
#[derive(Clone, Copy, Debug, Default)]
pub struct Held {
    /// Above the target at first, K, of what is heated, not of its sensor.
    pub overshoot_k: f64,
    /// Away from the target later, K.
    pub steady_k: f64,
    /// Away from the target after steps of flow and fan, K.
    pub flow_step_k: f64,
    /// Such steps that the heater has the power for.
    pub flow_steps: u32,
    /// Faults where nothing was broken.
    pub false_alarms: u32,
}

fn varied(body: &Body, random: &mut Pcg64) -> Body {
    let mut by = |share: f64| 1.0 + share * (2.0 * random.random::<f64>() - 1.0);
    Body {
        power_w: body.power_w * by(0.1),
        heater_j_k: body.heater_j_k * by(0.2),
        block_j_k: body.block_j_k * by(0.2),
        contact_w_k: body.contact_w_k * by(0.2),
        loss_w_k: body.loss_w_k * by(0.2),
        fan_w_k: body.fan_w_k * by(0.2),
        melt_j_mm3_k: body.melt_j_mm3_k * by(0.2),
        lag_s: body.lag_s * by(0.3),
    }
}

fn world(random: &mut Pcg64, vary: bool) -> World {
    let known = [Body::HOT_END, Body::BED];
    let bodies = known.map(|body| if vary { varied(&body, random) } else { body });
    let noise = Pcg64::seed_from_u64(random.random());
    World::new(bodies, known.map(|body| body.plant()), noise)
}

fn run(world: &mut World, seconds: f64, mut look: impl FnMut(&World)) {
    let until_s = world.now_s + seconds;
    while world.now_s < until_s {
        world.tick();
        look(world);
    }
}

/// Heats up, holds, and steps flow and fan, with bodies as known and with `runs` varied ones.
pub fn held(runs: u64) -> Held {
    let mut held = Held::default();
    for run_number in 0..=runs {
        let mut random = Pcg64::seed_from_u64(run_number);
        let place = run_number as usize % HOT_END_C.len();
        let mut world = world(&mut random, run_number > 0);
        world.orders.targets_c = [HOT_END_C[place], BED_C[place], 0.0];
        hold_one(&mut world, &mut held);
    }
    held
}

fn hold_one(world: &mut World, held: &mut Held) {
    let targets_c = [0, 1].map(|heater| f64::from(world.orders.targets_c[heater]));
    let above_k = |world: &World| {
        let of = |heater: usize| world.temperatures[heater].block_c - targets_c[heater];
        [of(0), of(1)]
    };
    run(world, SETTLED_S, |world| {
        held.overshoot_k = above_k(world).into_iter().fold(held.overshoot_k, f64::max);
    });
    run(world, 60.0, |world| {
        let away = above_k(world).map(f64::abs);
        held.steady_k = away.into_iter().fold(held.steady_k, f64::max);
    });
    for (flow_mm3_s, part_fan) in [
        (FLOW_MM3_S, 0.0),
        (0.0, 0.0),
        (0.0, 1.0),
        (FLOW_MM3_S, 1.0),
        (0.0, 0.0),
    ] {
        let body = &world.bodies[0];
        let loss_w_k = body.loss_w_k
            + body.fan_w_k * f64::from(part_fan)
            + body.melt_j_mm3_k * f64::from(flow_mm3_s);
        if loss_w_k * (targets_c[0] - AIR_C) > POWER_SHARE_MAX * body.power_w {
            // No regulator holds what the heater cannot give.
            continue;
        }
        held.flow_steps += 1;
        world.orders.flow_mm3_s = flow_mm3_s;
        world.orders.part_fan = part_fan;
        run(world, 60.0, |world| {
            held.flow_step_k = held.flow_step_k.max(above_k(world)[0].abs());
        });
    }
    held.false_alarms += u32::from(world.heat.fault().is_some());
}

/// Seconds from each injected fault until no heater has power, and the bound that it is held to; `None`
/// where it never happened.
pub fn faults() -> BTreeMap<&'static str, (Option<f64>, f64)> {
    let one = |(name, fault, bound_s): (&'static str, Injected, f64)| {
        (name, (seconds_until_off(name, fault), bound_s))
    };
    Injected::ALL.into_iter().map(one).collect()
}

fn seconds_until_off(name: &str, fault: Injected) -> Option<f64> {
    let mut random = Pcg64::seed_from_u64(7);
    let mut world = world(&mut random, false);
    if name != "heater_on_at_reset" {
        world.orders.targets_c = [210.0, 60.0, 0.0];
        world.warm(0, 205.0);
        world.warm(1, 58.0);
        run(&mut world, 300.0, |_| {});
        assert_eq!(world.heat.fault(), None, "{name}");
    }
    world.inject(fault);
    let injected_s = world.now_s;
    // The last period in which any heater had power.
    let mut last_on_s = injected_s;
    run(&mut world, 600.0, |world| {
        if world.power_w.iter().any(|power_w| *power_w > 0.0) {
            last_on_s = world.now_s;
        }
    });
    (last_on_s < injected_s + 590.0).then_some(last_on_s - injected_s)
}

/// What random schedules found.
#[derive(Clone, Debug, Default)]
pub struct Schedules {
    /// Run.
    pub schedules: u64,
    /// In which a fault was latched.
    pub faulted: u64,
    /// In which a heater had power where it must not have, or longer than the fault's bound.
    pub heater_on_past_bound: u64,
    /// In which something was hotter than its limit and the margin of a stuck transistor.
    pub too_hot: u64,
    /// Seeds of those.
    pub bad_seeds: Vec<u64>,
    /// Hottest hot end and bed, °C.
    pub hottest_c: [f64; 2],
}

/// Random schedules of heating, pausing, starving and faults.
pub fn schedules(count: u64) -> Schedules {
    let mut found = Schedules::default();
    for seed in 0..count {
        schedule(seed, &mut found);
    }
    found
}

/// A heater must be off this long after everything told it so, s: a period of the control, and one of
/// the PWM.
const OFF_WITHIN_S: f64 = 0.25;
/// A transistor that conducts is cut off from its supply above the limits (290 and 135 °C): what a sensor
/// that lags by 4.5 s and the cut's 2.3 s let pass at 2.4 and 0.3 K/s, and the variation.
const HOTTEST_C: [f64; 2] = [315.0, 145.0];
/// How long a schedule runs, s, and how often it changes.
const SCHEDULE_S: f64 = 400.0;
const CHANGE_S: f64 = 40.0;

fn schedule(seed: u64, found: &mut Schedules) {
    let mut random = Pcg64::seed_from_u64(seed);
    let mut world = world(&mut random, true);
    for heater in 0..2 {
        if random.random_bool(0.5) {
            world.warm(heater, [200.0, 60.0][heater]);
        }
    }
    let (_, fault, bound_s) = Injected::ALL[random.random_range(0..Injected::ALL.len())];
    let fault_s = SCHEDULE_S * (0.1 + 0.6 * random.random::<f64>());
    let mut watch = Watch::default();
    let mut next_s = 0.0;
    while world.now_s < SCHEDULE_S {
        if world.now_s >= next_s {
            change(&mut world.orders, &mut random);
            next_s = world.now_s + CHANGE_S * (0.5 + random.random::<f64>());
        }
        if world.now_s >= fault_s && !watch.injected {
            watch.injected = true;
            world.inject(fault);
        }
        world.tick();
        watch.look(&world, fault, bound_s);
    }
    found.schedules += 1;
    found.faulted += u64::from(world.heat.fault().is_some());
    found.heater_on_past_bound += u64::from(watch.past_bound);
    found.too_hot += u64::from(watch.too_hot);
    if watch.past_bound || watch.too_hot {
        found.bad_seeds.push(seed);
    }
    for (hottest_c, of) in found.hottest_c.iter_mut().zip(watch.hottest_c) {
        *hottest_c = hottest_c.max(of);
    }
}

/// One change of what is asked for.
fn change(orders: &mut headway_firmware::heat::Orders, random: &mut Pcg64) {
    let is_on = random.random_bool(0.8);
    match random.random_range(0..5) {
        0 if is_on => orders.targets_c[0] = random.random_range(150.0..320.0),
        0 => orders.targets_c[0] = 0.0,
        1 if is_on => orders.targets_c[1] = random.random_range(40.0..140.0),
        1 => orders.targets_c[1] = 0.0,
        2 => orders.part_fan = random.random(),
        3 => {
            orders.flow_mm3_s = if is_on {
                random.random_range(0.0..25.0)
            } else {
                0.0
            }
        }
        _ => {
            orders.paused = !orders.paused;
            orders.flow_mm3_s = 0.0;
        }
    }
}

/// What must not be.
#[derive(Default)]
struct Watch {
    injected: bool,
    /// Seconds since the broken thing mattered, and with which targets.
    asked_s: f64,
    targets_c: [f32; 2],
    off_s: [f64; 2],
    past_bound: bool,
    too_hot: bool,
    hottest_c: [f64; 2],
}

impl Watch {
    fn look(&mut self, world: &World, fault: Injected, bound_s: f64) {
        let period_s = f64::from(headway_firmware::configuration::heat::PERIOD_S);
        let stuck = self.injected && matches!(fault, Injected::HeaterStuck(_));
        let targets_c = [world.heat.target_c(0), world.heat.target_c(1)];
        for heater in 0..2 {
            let is_stuck = stuck && fault.heater() == heater;
            // What is switched off, by whatever, has no power.
            let off = targets_c[heater] <= 0.0;
            self.off_s[heater] = if off {
                self.off_s[heater] + period_s
            } else {
                0.0
            };
            let on = world.power_w[heater] > 0.0;
            self.past_bound |= on && !is_stuck && self.off_s[heater] > OFF_WITHIN_S + period_s;
            let Temperatures { block_c, .. } = world.temperatures[heater];
            self.hottest_c[heater] = self.hottest_c[heater].max(block_c);
            self.too_hot |= block_c > HOTTEST_C[heater];
        }
        if self.injected {
            self.look_at_fault(world, fault, bound_s, targets_c);
        }
    }

    /// The fault's own bound, from when it could be noticed: with targets that stay as they are.
    fn look_at_fault(&mut self, world: &World, fault: Injected, bound_s: f64, targets_c: [f32; 2]) {
        let heater = fault.heater();
        let wanted = match fault {
            // It can be told from a heater only when it should be off.
            Injected::HeaterStuck(_) => world.outputs.duties[heater] <= 0.0,
            // These can be held or heated with, or are noticed in the heating alone.
            Injected::SupplySags | Injected::HeaterBroken(_) => false,
            // What a host asks for afterwards is meant.
            Injected::Reset => false,
            Injected::HostGone | Injected::MainLoopHangs => targets_c.iter().any(|c| *c > 0.0),
            _ => targets_c[heater] > 0.0,
        };
        if !wanted || targets_c != self.targets_c {
            self.asked_s = 0.0;
            self.targets_c = targets_c;
        }
        self.asked_s += f64::from(headway_firmware::configuration::heat::PERIOD_S);
        let on = match fault {
            Injected::MainLoopHangs | Injected::HostGone => world.power_w.iter().any(|w| *w > 0.0),
            _ => world.power_w[heater] > 0.0,
        };
        self.past_bound |= wanted && on && self.asked_s > bound_s + 0.2;
    }
}
