//! Goal: the index switch of a joint that turns without an end gives its position, and does not stop a turn
//! past it. Method: a planar machine whose nozzle has one, with various settings; homed, turned by hand and in
//! a stream past the switch; the same switch on a joint with ends as the counter-proof.
use super::world::World;
use super::*;
use crate::configuration::homing::{HomingConfiguration, JointHoming};
use crate::motion::inputs::Inputs;
use headway_protocol::message::JointOrder;

/// The nozzle's joint.
const C: u8 = 3;

fn machine(endless: bool) -> (MachineConfiguration, HomingConfiguration) {
    let mut configuration = planar();
    let limits = &mut configuration.joints[usize::from(C)];
    if endless {
        limits.position_min = f64::NEG_INFINITY;
        limits.position_max = f64::INFINITY;
    }
    let mut switches = HomingConfiguration::none();
    let mut switch = JointHoming::usual(C, false, limits);
    switch.position_natural = 0.0;
    assert_eq!(switch.guards, !endless);
    // A record may say so all the same.
    switch.guards = true;
    switches.joints.push(switch).unwrap();
    (configuration, switches)
}

fn past_the_switch(endless: bool) -> Vec<Fault> {
    let (configuration, switches) = machine(endless);
    let job = flower();
    let mut host = Host::new(&configuration, &job);
    *host.machine.servo.motion_mut() = Motion::new(&configuration, &switches);
    assert_eq!(host.machine.servo.motion_mut().start(&job.start), Ok(()));
    host.counter.counts = host.machine.motion().counts();
    for tick in 0..3300 {
        host.send(&job, 8, 16);
        // Two passes of 10 ms.
        let pressed = (2500..2520).contains(&tick) || (3000..3020).contains(&tick);
        host.machine.set_inputs(Inputs {
            switches: u8::from(pressed) << C,
            emergency: false,
        });
        host.tick();
    }
    host.poll();
    host.faults
}

#[test]
fn a_stream_turns_past_the_index_switch_of_an_endless_joint() {
    assert_eq!(past_the_switch(true), []);
    let faults = past_the_switch(false);
    assert_eq!(
        (faults[0].cause, faults[0].index),
        (FaultCause::LimitSwitch, C)
    );
}

/// A world whose nozzle has an index mark so wide, as a share of a turn.
fn indexed(width: f64) -> (World, i64) {
    let (configuration, switches) = machine(true);
    let mut world = World::new(&configuration, &switches);
    let turn =
        (configuration.joints[usize::from(C)].steps_per_unit * core::f64::consts::TAU).round();
    world.index = Some((C.into(), (width * turn) as i64, turn as i64));
    (world, turn as i64)
}

/// How far the belief is from the middle of the mark, steps, whole turns left out.
fn off_middle(world: &World, turn: i64) -> i64 {
    let (_, width, _) = world.index.unwrap();
    let place = world
        .switches
        .iter()
        .find(|switch| switch.0 == usize::from(C))
        .unwrap()
        .2;
    // Stated at 0; the carriage is `belief` away from what it is taken for.
    let off = world.belief(C.into()) + place - width / 2;
    (off + turn / 2).rem_euclid(turn) - turn / 2
}

/// Goal: the zero of an endless heading is the middle of its index mark, from wherever, whatever its width,
/// with edges that chatter. Method: 1,000 random starts and widths from half a degree to a third of a turn.
#[test]
fn an_endless_joint_finds_the_middle_of_its_index_mark() {
    find_index_marks(20);
}

#[test]
#[ignore = "a minute; run by name"]
fn a_thousand_index_marks_are_found() {
    find_index_marks(1000);
}

fn find_index_marks(cases: i32) {
    let mut random = 99u64;
    let mut next = |below: i64| {
        random = random
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (random >> 33) as i64 % below
    };
    let (mut worst, mut pressed_at_first) = (0, 0);
    for case in 0..cases {
        let width = 0.5 / 360.0 + 0.33 * (next(1000) as f64 / 1000.0).powi(2);
        let (mut world, turn) = indexed(width);
        world.offsets[usize::from(C)] = next(turn);
        world.bounce_ticks = next(3) as u32;
        world.command(Control::Home(JointOrder::of(&[C]).unwrap()));
        world.tick();
        pressed_at_first += i32::from(world.last_pressed != 0);
        world.settle();
        assert_eq!(world.host.faults, [], "case {case}, {width} of a turn");
        assert_eq!(world.host.machine.motion().referenced(), 1 << C);
        let off = off_middle(&world, turn);
        // 0.1 rad/s at 2 kHz is a tenth of a step in a servo tick; chatter hides an edge for up to 2 ms.
        assert!(
            off.abs() <= 2,
            "case {case}, {width} of a turn: off by {off} steps"
        );
        worst = worst.max(off.abs());
    }
    assert!(
        pressed_at_first * 20 > cases && worst > 0,
        "{pressed_at_first} {worst}"
    );
}

#[test]
fn the_zero_is_lost_with_the_motors_and_a_stream_does_not_begin_on_it() {
    let (mut world, turn) = indexed(0.02);
    world.command(Control::Home(JointOrder::of(&[C]).unwrap()));
    world.settle();
    assert_eq!(world.host.machine.motion().referenced(), 1 << C);
    world.command(Control::MotorsOff);
    world.tick();
    world.host.poll();
    assert_eq!(world.host.machine.motion().referenced(), 0);
    assert!(!world.host.machine.motion().drivers_on());
    // The nozzle is turned by hand; nobody knows.
    world.offsets[usize::from(C)] += 1234;
    let start = flower().start;
    assert!(world.host.machine.servo.motion_mut().start(&start).is_err());
    world.command(Control::Home(JointOrder::of(&[C]).unwrap()));
    world.settle();
    assert_eq!(world.host.machine.motion().referenced(), 1 << C);
    assert!(off_middle(&world, turn).abs() <= 2);
}

#[test]
fn a_mark_that_never_comes_or_never_ends_is_a_fault() {
    for stuck in [0, 1 << C] {
        let (mut world, _) = indexed(0.0);
        world.stuck = stuck;
        world.command(Control::Home(JointOrder::of(&[C]).unwrap()));
        world.settle();
        let [fault] = world.host.faults[..] else {
            panic!("{:?}", world.host.faults);
        };
        assert_eq!((fault.cause, fault.index), (FaultCause::Homing, C));
        assert_eq!(world.host.machine.motion().referenced(), 0);
    }
}

#[test]
fn an_endless_joint_is_jogged_past_its_index_mark() {
    let (configuration, _) = machine(true);
    let (mut world, _) = indexed(0.05);
    world.command(Control::Home(JointOrder::of(&[C]).unwrap()));
    world.settle();
    // Back over the mark.
    world.command(Control::Jog {
        joint: C,
        distance_units: 1_000_000,
        speed_units_s: 1_000_000,
    });
    let before = world.truth(usize::from(C));
    world.settle();
    assert_eq!((world.host.faults.len(), world.host.refusals.len()), (0, 0));
    let way = world.truth(usize::from(C)) - before;
    let asked = configuration.joints[usize::from(C)].steps_per_unit.round() as i64;
    assert!((way - asked).abs() <= 1, "{way} of {asked}");
}
