//! Goal: homing finds the switch to within the motion of a servo tick, in any order, from anywhere;
//! limit switches and the emergency input stop what they should. Method: every step moves a simulated
//! carriage whose switch bounces; the motor counts are compared with the carriage.
use super::world::{World, machine};
use super::*;
use crate::configuration::homing::{HomingConfiguration, JointHoming};
use crate::motion::CommandError;
use crate::motion::inputs::Inputs;
use headway_protocol::message::JointOrder;

/// What the belief must be after homing: the switch's stated place less its true one.
fn expected(
    world: &World,
    configuration: &MachineConfiguration,
    switches: &HomingConfiguration,
    joint: usize,
) -> f64 {
    let stated = switches.of(joint as u8).unwrap().position_natural;
    let place = world.switches.iter().find(|s| s.0 == joint).unwrap().2;
    stated * configuration.joints[joint].steps_per_unit - place as f64
}

#[test]
fn homing_finds_the_switch_from_anywhere_in_any_order() {
    let (configuration, switches) = machine();
    for (case, order) in [&[][..], &[0, 1, 2, 3], &[3, 2, 1, 0], &[1], &[2, 0]]
        .into_iter()
        .enumerate()
    {
        let mut world = World::new(&configuration, &switches);
        world.bounce_ticks = 2 * case as u32;
        world.offsets = core::array::from_fn(|m| 400 * case as i64 - 900 + 17 * m as i64);
        let order_message = JointOrder::of(order).unwrap();
        world.command(Control::Home(order_message));
        world.tick();
        assert_eq!(world.host.machine.motion().state(), DeviceState::Homing);
        world.settle();
        assert_eq!(world.host.faults, []);
        let homed: &[u8] = if order.is_empty() {
            &[2, 0, 1, 3]
        } else {
            order
        };
        let mut mask = 0;
        for &joint in homed {
            mask |= 1 << joint;
            let joint = usize::from(joint);
            let error =
                world.belief(joint) as f64 - expected(&world, &configuration, &switches, joint);
            // The switch is looked at once a servo tick: slow speed / 2 kHz, and the whole step.
            let slow = switches.of(joint as u8).unwrap().slow_natural_s;
            let tick = slow * configuration.joints[joint].steps_per_unit / 2000.0;
            // Chatter can hide the edge for its length.
            let late = 1.0 + f64::from(world.bounce_ticks);
            assert!(error.abs() <= 1.0 + tick * late, "joint {joint}: {error}");
        }
        assert_eq!(world.host.machine.motion().referenced(), mask);
        assert_eq!(world.last_pressed, 0, "all switches are free again");
    }
}

#[test]
fn joints_are_homed_at_either_end_in_the_order_given() {
    let (configuration, _) = machine();
    // Z down onto its switch, after X and Y; X and Y at either end.
    for ends in 0..8u8 {
        let mut switches = HomingConfiguration::none();
        for joint in [0u8, 1, 2] {
            let limits = &configuration.joints[usize::from(joint)];
            let towards_max = ends >> joint & 1 == 1;
            let homing = JointHoming::usual(joint, towards_max, limits);
            switches.joints.push(homing).unwrap();
        }
        let mut world = World::new(&configuration, &switches);
        world.command(Control::Home(JointOrder::ALL));
        let mut first_moved = [None; 3];
        for tick in 0..400_000u32 {
            world.tick();
            for (joint, moved) in first_moved.iter_mut().enumerate() {
                if moved.is_none() && world.truth(joint) != 0 {
                    *moved = Some(tick);
                }
            }
            if world.host.machine.motion().state() == DeviceState::Idle {
                break;
            }
        }
        world.settle();
        assert_eq!(world.host.faults, [], "ends {ends:03b}");
        assert!(first_moved.is_sorted(), "{first_moved:?}");
        assert_eq!(world.host.machine.motion().referenced(), 0b111);
        for joint in 0..3 {
            let error =
                world.belief(joint) as f64 - expected(&world, &configuration, &switches, joint);
            // As above, without chatter.
            assert!(
                error.abs() <= 1.3,
                "ends {ends:03b}, joint {joint}: {error}"
            );
        }
    }
}

#[test]
fn homing_leaves_a_pressed_switch_first_and_fails_where_there_is_none() {
    let (configuration, switches) = machine();
    let mut world = World::new(&configuration, &switches);
    // X stands 100 steps inside its switch.
    world.offsets[0] = world.switches.iter().find(|s| s.0 == 0).unwrap().2 - 100;
    world.command(Control::Home(JointOrder::of(&[0]).unwrap()));
    world.settle();
    assert_eq!(world.host.faults, []);
    let error = world.belief(0) as f64 - expected(&world, &configuration, &switches, 0);
    assert!(error.abs() <= 1.2, "{error}");

    // No switch in reach: 1.1 times the range, then a fault with the joint.
    world.switches.retain(|switch| switch.0 != 1);
    let before = world.truth(1);
    world.command(Control::Home(JointOrder::of(&[1]).unwrap()));
    world.settle();
    assert_eq!(world.host.faults.len(), 1);
    let fault = world.host.faults[0];
    assert_eq!((fault.cause, fault.index), (FaultCause::Homing, 1));
    let way = (before - world.truth(1)) as f64 / 80.0;
    assert!((way - 220.0).abs() < 0.1, "{way} mm");
    // Its place is not known any more: nothing may stream until it is.
    let start = flower().start;
    world.command(Control::ClearFault);
    world.settle();
    assert_eq!(
        world.host.machine.servo.motion_mut().start(&start),
        Err(CommandError::Invalid)
    );
    assert_eq!(world.host.machine.motion().referenced(), 1);

    // A switch that stays pressed.
    world.stuck = 1;
    world.command(Control::Home(JointOrder::of(&[0]).unwrap()));
    world.settle();
    assert_eq!(world.host.faults.len(), 2);
    assert_eq!(world.host.faults[1].cause, FaultCause::Homing);
}

#[test]
fn a_stream_goes_on_from_homed_joints_and_declares_the_others() {
    let (configuration, switches) = machine();
    let mut world = World::new(&configuration, &switches);
    world.command(Control::Home(JointOrder::of(&[2, 0, 1]).unwrap()));
    world.settle();
    let motion = world.host.machine.servo.motion_mut();
    let counts = motion.counts();
    let mut position = [0i32; 7];
    for axis in 0..3 {
        let natural = counts[axis] as f64 / configuration.joints[axis].steps_per_unit;
        position[axis] = (natural * 1e4).round() as i32;
    }
    position[5] = 1_000_000;
    let mut elsewhere = position;
    elsewhere[0] += 1000;
    // A job far away, and lower: the machine goes there, and the last joint is Z.
    let job = [800_000, 300_000, 20_000, 0, 0, 1_000_000, 0];
    assert_eq!(motion.start(&job), Err(CommandError::Invalid));
    world.command(Control::GoTo(job));
    world.settle();
    assert_eq!(world.host.refusals, []);
    let motion = world.host.machine.servo.motion_mut();
    assert_eq!(motion.counts()[..4], [6400, 2400, 800, 0]);
    assert_eq!(motion.start(&elsewhere), Err(CommandError::Invalid));
    let mut undisturbed = world.host.machine.motion().clone();
    assert_eq!(undisturbed.start(&job), Ok(()));
    assert_eq!(undisturbed.referenced(), 0b1111);
    world.command(Control::GoTo(position));
    world.settle();
    let motion = world.host.machine.servo.motion_mut();
    assert_eq!(motion.start(&position), Ok(()));
    assert_eq!(motion.counts()[..3], counts[..3]);
    assert_eq!(motion.referenced(), 0b1111);
}

#[test]
fn a_limit_switch_stops_a_stream_and_a_jog_towards_it_but_not_away() {
    let (configuration, switches) = machine();
    let mut world = World::new(&configuration, &switches);
    let jog = |distance_units: i32| Control::Jog {
        joint: 0,
        distance_units,
        speed_units_s: 300_000,
    };
    world.command(jog(-1_000_000));
    world.settle();
    assert_eq!(world.host.faults.len(), 1);
    let fault = world.host.faults[0];
    assert_eq!((fault.cause, fault.index), (FaultCause::LimitSwitch, 0));
    let place = world.switches.iter().find(|s| s.0 == 0).unwrap().2;
    // 30 mm/s over the ticks that the switch has to hold, and the one it is seen in.
    let late = (place - world.truth(0)) as f64 / 80.0;
    assert!((0.0..0.1).contains(&late), "{late} mm");
    assert!((f64::from(fault.value) * 1e-4 - world.truth(0) as f64 / 80.0).abs() < 0.02);
    world.command(Control::ClearFault);
    world.command(jog(-10_000));
    world.settle();
    assert_eq!(world.host.faults.len(), 2, "towards the switch again");
    world.command(Control::ClearFault);
    world.command(jog(50_000));
    world.settle();
    assert_eq!(world.host.faults.len(), 2, "away from it");
    assert_eq!(world.last_pressed, 0);

    let (configuration, job) = (planar(), flower());
    let mut host = Host::new(&configuration, &job);
    *host.machine.servo.motion_mut() = Motion::new(&configuration, &switches);
    assert_eq!(host.machine.servo.motion_mut().start(&job.start), Ok(()));
    host.counter.counts = host.machine.motion().counts();
    for tick in 0..3300 {
        host.send(&job, 8, 16);
        host.machine.set_inputs(Inputs {
            // A spike first, then for good.
            switches: if tick == 2500 || tick >= 3000 { 2 } else { 0 },
            emergency: false,
        });
        host.tick();
    }
    host.poll();
    assert_eq!(host.faults.len(), 1);
    assert_eq!(
        (host.faults[0].cause, host.faults[0].index),
        (FaultCause::LimitSwitch, 1)
    );
    assert_eq!(host.counter.counts, host.machine.motion().counts());
}

#[test]
fn the_emergency_input_stops_within_a_servo_tick_and_holds_off_the_clearing() {
    let (configuration, job) = (planar(), flower());
    let mut host = Host::new(&configuration, &job);
    for _ in 0..3000 {
        host.send(&job, 8, 16);
        host.tick();
    }
    let pressed = Inputs {
        switches: 0,
        emergency: true,
    };
    host.machine.set_inputs(pressed);
    let before = host.counter.steps;
    host.tick();
    for _ in 0..10 {
        host.tick();
    }
    assert_eq!(host.counter.steps, before);
    host.control(HostMessage::Control(Control::ClearFault));
    host.tick();
    host.poll();
    assert_eq!(host.state, DeviceState::Faulted);
    assert_eq!(host.faults.len(), 1);
    assert_eq!(host.faults[0].cause, FaultCause::Emergency);
    host.machine.set_inputs(Inputs::default());
    host.control(HostMessage::Control(Control::ClearFault));
    host.tick();
    host.poll();
    assert_eq!(host.machine.motion().state(), DeviceState::Idle);
    assert_eq!(host.counter.counts, host.machine.motion().counts());
}
