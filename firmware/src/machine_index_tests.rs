//! Goal: the index switch of a joint that turns without an end finds where it is, and stops nothing that turns
//! past it. Method: a planar machine whose nozzle has one, whatever its settings say of it; homed, turned by
//! hand and in a stream past the switch; the same switch on a joint with ends as the counter-proof.
use super::world::World;
use super::*;
use crate::homing::{HomingConfiguration, JointHoming};
use crate::inputs::Inputs;
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
    host.machine.motion = Motion::new(&configuration, &switches);
    assert_eq!(host.machine.motion.start(&job.start), Ok(()));
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

#[test]
fn an_endless_joint_is_homed_to_its_index_switch_and_jogged_past_it() {
    let (configuration, switches) = machine(true);
    let mut world = World::new(&configuration, &switches);
    world.command(Control::Home(JointOrder::of(&[C]).unwrap()));
    world.settle();
    assert_eq!(world.host.faults, []);
    assert_eq!(world.host.machine.motion().referenced(), 1 << C);
    // Back over the switch, which the model keeps pressed from there on.
    world.command(Control::Jog {
        joint: C,
        distance_units: -1_000_000,
        speed_units_s: 1_000_000,
    });
    let before = world.truth(usize::from(C));
    world.settle();
    assert_eq!(world.host.faults, []);
    assert_eq!(world.host.refusals, []);
    let way = before - world.truth(usize::from(C));
    let asked = configuration.joints[usize::from(C)].steps_per_unit.round() as i64;
    assert!((way - asked).abs() <= 1, "{way} of {asked}");
    assert_ne!(world.last_pressed, 0);
}
