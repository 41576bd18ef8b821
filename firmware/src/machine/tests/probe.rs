//! Goal: a probing reports the height of the bed to within a step, in all circumstances, and changes no
//! position; failures are reported, move nothing further than permitted, and end by themselves. Method:
//! every step moves a simulated carriage over a bed of its own, whose probe chatters.
use super::world::{Pin, World, machine};
use super::*;
use crate::configuration::homing::JointHoming;
use crate::motion::probe_pin::ProbePin;
use headway_protocol::message::{JointOrder, PROBE_BIT, PinPosition, ProbeResult};

const Z: usize = 2;
/// 0.1 µm a step of Z.
const UNITS_PER_STEP: f64 = 25.0;

/// A plane with steps on it, true steps.
fn bed(x: i64, y: i64) -> i64 {
    -900 + x / 7 - y / 11 + (x / 640 + y / 480).rem_euclid(3) * 37
}

fn probe(distance_mm: f64) -> Control {
    Control::Probe {
        joint: Z as u8,
        distance_units: (distance_mm * 1e4) as i32,
        fast_units_s: 50_000,
        slow_units_s: 10_000,
        back_off_units: 10_000,
    }
}

fn jog(joint: u8, distance_units: i32) -> Control {
    Control::Jog {
        joint,
        distance_units,
        speed_units_s: 100_000,
    }
}

/// X and Y at 100 mm, Z at 10, all declared; the carriages are elsewhere.
fn declared(bounce_ticks: u32) -> World {
    let (configuration, switches) = machine();
    let mut world = World::new(&configuration, &switches);
    world.bounce_ticks = bounce_ticks;
    for (joint, position_units) in [(0, 1_000_000), (1, 1_000_000), (2, 100_000)] {
        world.command(Control::SetJoint {
            joint,
            position_units,
        });
    }
    world.settle();
    world.bed = Some(bed);
    world
}

fn result(world: &World) -> ProbeResult {
    world.host.machine.motion().probe_result()
}

#[test]
fn a_probing_tells_where_the_bed_is_and_changes_no_position() {
    for bounce_ticks in [0, 2, 4] {
        let mut world = declared(bounce_ticks);
        let mut heights = Vec::new();
        for (x, y) in [
            (0, 0),
            (80_000, 0),
            (0, 130_000),
            (-250_000, 0),
            (7000, -9000),
        ] {
            world.command(jog(0, x));
            world.settle();
            world.command(jog(1, y));
            world.settle();
            let (belief, before) = (world.belief(Z), world.truth(Z));
            // Nobody says anything until it is over.
            world.command(probe(-9.0));
            world.tick();
            assert_eq!(world.host.machine.motion().state(), DeviceState::Probing);
            assert_eq!(result(&world), ProbeResult::None);
            world.settle();
            let ProbeResult::Touched(units) = result(&world) else {
                panic!("{:?}", result(&world));
            };
            let height = bed(world.truth(0), world.truth(1));
            let error = f64::from(units) / UNITS_PER_STEP - (height + belief) as f64;
            // The slow touch moves 0.2 steps a tick; chatter may hide the edge for its length.
            let late = 1.0 + 0.2 * f64::from(bounce_ticks);
            assert!(error.abs() <= late, "{error} steps at {x}, {y}");
            assert_eq!(world.belief(Z), belief);
            assert_eq!(world.host.machine.motion().referenced(), 0b111);
            // It has gone back by what was asked, and lets go of the probe.
            let left = (world.truth(Z) - height) as f64 / 400.0;
            assert!((left - 1.0).abs() < 0.02, "{left} mm above the bed");
            assert_eq!(world.last_pressed, 0);
            heights.push(height);
            world.command(jog(2, ((before - world.truth(Z)) * 25) as i32));
            world.settle();
        }
        assert_eq!(world.host.faults, []);
        heights.sort_unstable();
        heights.dedup();
        assert_eq!(heights.len(), 5, "a bed that differs");
    }
}

#[test]
fn what_goes_wrong_is_told_and_is_no_fault() {
    let mut world = declared(0);
    // The bed is 12 mm away at most: not on a way of 1 mm.
    world.command(probe(-1.0));
    world.settle();
    assert_eq!(result(&world), ProbeResult::NotFound);
    let way = world.truth(Z);
    assert_eq!(way, -400, "no further than it may");
    // Pressed before anything moves.
    world.stuck = 1 << PROBE_BIT;
    world.tick();
    world.command(probe(-1.0));
    world.settle();
    assert_eq!(result(&world), ProbeResult::Pressed);
    assert_eq!(world.truth(Z), way);
    // Presses on the way, and stays.
    world.stuck = 0;
    world.tick();
    world.command(probe(-8.0));
    for _ in 0..400 {
        world.tick();
    }
    assert_eq!(world.host.machine.motion().state(), DeviceState::Probing);
    world.stuck = 1 << PROBE_BIT;
    world.settle();
    assert_eq!(result(&world), ProbeResult::StaysPressed);
    assert!(world.truth(Z) > bed(0, 0), "it never came to the bed");
    assert_eq!(world.host.faults, []);
    assert_eq!(world.host.refusals, []);
    assert_eq!(world.host.machine.motion().referenced(), 0b111);
    // The same probe works where it is free again.
    world.stuck = 0;
    world.tick();
    world.command(probe(-7.0));
    world.settle();
    assert!(matches!(result(&world), ProbeResult::Touched(_)));
}

/// Regression: a second touch that did not trip went on by twice the way back, out of the range.
#[test]
fn the_second_touch_goes_no_further_than_the_first_may() {
    let mut world = declared(0);
    // 9.75 mm down, of 9.9 that it may go, and 10 that Z has left.
    world.bed = Some(|_, _| -3900);
    world.command(probe(-9.9));
    let mut lowest = 0;
    for _ in 0..20_000 {
        world.tick();
        lowest = lowest.min(world.truth(Z));
        if lowest <= -3900 && world.truth(Z) > -3600 {
            world.bed = None;
        }
    }
    world.settle();
    assert!(world.bed.is_none());
    assert_eq!(result(&world), ProbeResult::NotFound);
    assert!((-3960..-3900).contains(&lowest), "{lowest}");
    assert_eq!(world.truth(Z), -3960);
}

#[test]
fn a_probing_that_cannot_be_is_refused_and_moves_nothing() {
    let (configuration, switches) = machine();
    let mut unknown = World::new(&configuration, &switches);
    unknown.command(probe(-1.0));
    unknown.settle();
    assert_eq!(unknown.host.refusals, [RefusalReason::Invalid], "not homed");
    let mut world = declared(0);
    let Control::Probe { distance_units, .. } = probe(-1.0) else {
        panic!("a probing");
    };
    let order = |joint, distance_units, fast_units_s, back_off_units| Control::Probe {
        joint,
        distance_units,
        fast_units_s,
        slow_units_s: 10_000,
        back_off_units,
    };
    for wrong in [
        // Beyond its range, below and above; no way at all; its way back above the range.
        probe(-10.1),
        probe(190.1),
        probe(0.0),
        order(2, distance_units, 50_000, 1_900_001),
        order(2, distance_units, 50_000, u32::MAX),
        order(2, i32::MIN, 50_000, 1),
        // 20 mm/s is Z's limit; the nozzle is not known; there are four joints.
        order(2, distance_units, 200_100, 10_000),
        order(3, 10, 1000, 1000),
        order(4, distance_units, 50_000, 10_000),
    ] {
        world.host.refusals.clear();
        world.command(wrong);
        world.settle();
        assert_eq!(world.host.refusals, [RefusalReason::Invalid], "{wrong:?}");
    }
    assert_eq!(world.truth(Z), 0);
    // Not while something moves, nor with a fault.
    world.host.refusals.clear();
    world.command(jog(0, 10_000));
    world.tick();
    world.command(probe(-1.0));
    world.settle();
    world.command(Control::EmergencyStop);
    world.settle();
    world.command(probe(-1.0));
    world.settle();
    assert_eq!(
        world.host.refusals,
        [RefusalReason::Busy, RefusalReason::Faulted]
    );
    assert_eq!((world.truth(Z), result(&world)), (0, ProbeResult::None));
}

#[test]
fn a_probing_is_broken_off_and_leaves_nothing_behind() {
    let mut world = declared(0);
    world.command(probe(-8.0));
    for _ in 0..300 {
        world.tick();
    }
    world.command(Control::Abort);
    world.settle();
    assert_eq!(result(&world), ProbeResult::None);
    assert_eq!(world.host.machine.motion().referenced(), 0b111);
    let rests = world.truth(Z);
    assert!(rests > bed(0, 0) && rests < 0, "{rests}");
    // Regression: what a stop broke off went on with the next jog.
    for order in [probe(-5.0), Control::Home(JointOrder::of(&[2]).unwrap())] {
        world.command(Control::SetJoint {
            joint: 2,
            position_units: 100_000,
        });
        world.command(order);
        for _ in 0..300 {
            world.tick();
        }
        world.command(Control::EmergencyStop);
        world.settle();
        assert_eq!(world.host.machine.motion().referenced(), 0);
        world.command(Control::ClearFault);
        world.settle();
        let before = world.truth(0);
        world.command(jog(0, 10_000));
        world.tick();
        assert_eq!(world.host.machine.motion().state(), DeviceState::Jogging);
        world.settle();
        assert_eq!(world.truth(0) - before, 80, "{order:?}");
        assert_eq!(world.host.machine.motion().referenced(), 0);
        assert_eq!(result(&world), ProbeResult::None);
    }
    assert_eq!(world.host.faults.len(), 2);
}

#[test]
fn a_probe_that_is_the_joints_switch_stops_nothing_and_another_switch_does() {
    let (configuration, mut switches) = machine();
    let lower = JointHoming::usual(2, false, &configuration.joints[Z]);
    switches.joints.retain(|switch| switch.joint != 2);
    switches.joints.push(lower).unwrap();
    for probed in [true, false] {
        let mut world = World::new(&configuration, &switches);
        world.command(Control::SetJoint {
            joint: 2,
            position_units: 200_000,
        });
        world.settle();
        // The switch is 15 mm down, and so is the bed, or there is none.
        world.bed = probed.then_some(|_, _| -5974);
        world.command(probe(-19.0));
        world.settle();
        if probed {
            assert_eq!(world.host.faults, []);
            assert!(matches!(result(&world), ProbeResult::Touched(_)));
        } else {
            assert_eq!(world.host.faults.len(), 1);
            let fault = world.host.faults[0];
            assert_eq!((fault.cause, fault.index), (FaultCause::LimitSwitch, 2));
        }
    }
}

/// A machine whose probe has a pin, Z declared or not.
fn with_pin(mut world: World, is_switch_of_z: bool) -> World {
    world
        .host
        .machine
        .servo
        .motion_mut()
        .fit_probe_pin(ProbePin {
            fitted: true,
            is_switch_of_z,
            ..ProbePin::default()
        });
    world.pin = Some(Pin {
        is_switch_of_z,
        ..Pin::default()
    });
    world.bed = Some(bed);
    world.tick();
    world
}

fn touches(world: &World) -> u32 {
    world.pin.as_ref().unwrap().touches
}

#[test]
fn a_pin_is_put_out_before_each_touch_and_finds_the_bed() {
    let mut world = with_pin(declared(0), false);
    assert_eq!(world.host.machine.motion().probe_pulse_us(), 1475, "in");
    let belief = world.belief(Z);
    for number in 1..3 {
        world.command(probe(-9.0));
        let ticks = world.settle();
        let ProbeResult::Touched(units) = result(&world) else {
            panic!("{:?}", result(&world));
        };
        let height = bed(world.truth(0), world.truth(1));
        let error = f64::from(units) / UNITS_PER_STEP - (height + belief) as f64;
        assert!(error.abs() <= 1.0, "{error} steps");
        assert_eq!(touches(&world), 2 * number, "out for both touches");
        // Twice 0.7 s.
        assert!(ticks > 2800, "{ticks}");
        assert_eq!(world.host.machine.motion().probe_pulse_us(), 1475);
        assert!(!world.pin.as_ref().unwrap().is_out, "in again");
        world.command(jog(2, 60_000));
        world.settle();
    }
    // By hand; and what is out is put in before the next probing.
    for (position, pulse_us) in [
        (PinPosition::Reset, 2190),
        (PinPosition::SelfTest, 1780),
        (PinPosition::Deploy, 650),
    ] {
        world.command(Control::ProbePin(position));
        world.tick();
        assert_eq!(world.host.machine.motion().probe_pulse_us(), pulse_us);
    }
    assert_eq!(world.host.refusals, []);
    // A pin that does not go out touches nothing, and is told.
    world.pin.as_mut().unwrap().is_stuck = true;
    world.command(probe(-2.0));
    world.settle();
    assert_eq!(result(&world), ProbeResult::NotFound);
    assert_eq!(world.host.faults, []);
    // A stop puts it in.
    world.pin.as_mut().unwrap().is_stuck = false;
    world.command(probe(-2.0));
    for _ in 0..300 {
        world.tick();
    }
    assert_eq!(world.host.machine.motion().probe_pulse_us(), 650);
    world.command(Control::EmergencyStop);
    world.settle();
    assert_eq!(world.host.machine.motion().probe_pulse_us(), 1475);
}

#[test]
fn z_is_homed_by_a_pin_and_a_machine_without_one_has_none() {
    let (configuration, mut switches) = machine();
    let mut down = JointHoming::usual(2, false, &configuration.joints[Z]);
    down.position_natural = 1.85;
    switches.joints.retain(|switch| switch.joint == 0);
    switches.joints.push(down).unwrap();
    let mut world = with_pin(World::new(&configuration, &switches), true);
    world.command(Control::Home(JointOrder::ALL));
    world.settle();
    assert_eq!(world.host.faults, []);
    assert_eq!(world.host.machine.motion().referenced(), 0b101);
    assert_eq!(touches(&world), 2);
    let error =
        world.belief(Z) as f64 - (1.85 * 400.0 - bed(world.truth(0), world.truth(1)) as f64);
    assert!(error.abs() <= 1.2, "{error} steps");
    // A pin that does not go out: homing fails where its way ends, and says so.
    world.pin.as_mut().unwrap().is_stuck = true;
    world.command(Control::Home(JointOrder::of(&[2]).unwrap()));
    world.settle();
    let causes: Vec<FaultCause> = world.host.faults.iter().map(|fault| fault.cause).collect();
    assert_eq!(causes, [FaultCause::Homing]);

    let mut plain = declared(0);
    plain.command(Control::ProbePin(PinPosition::Deploy));
    plain.settle();
    assert_eq!(plain.host.refusals, [RefusalReason::Invalid]);
    assert_eq!(plain.host.machine.motion().probe_pulse_us(), 0);
}
