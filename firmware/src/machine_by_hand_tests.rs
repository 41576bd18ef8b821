//! Goal: homing finds the switch to within what a servo tick moves, in any order, from anywhere;
//! jogs, prime and retract by hand go exactly as far as asked; switches, soft limits and the
//! emergency input stop what they should, and nothing begins while it must not. Method: every step
//! moves a simulated carriage whose switch bounces; the motor counts are compared with the carriage.
use super::*;
use crate::homing::{HomingConfiguration, JointHoming};
use crate::inputs::Inputs;
use crate::motion::CommandError;
use crate::steps::STEP;
use headway_protocol::message::JointOrder;

/// A machine with carriages: where each motor really is, in steps from its switch.
struct World {
    host: Host,
    /// Joint, true if the switch is at the upper end, its place in true steps.
    switches: Vec<(usize, bool, i64)>,
    /// True position = counted steps + this.
    offsets: [i64; 8],
    /// Ticks for which a switch chatters after its edge.
    bounce_ticks: u32,
    last_pressed: u8,
    chatter: [u32; 8],
    random: u32,
    stuck: u8,
}

fn machine() -> (MachineConfiguration, HomingConfiguration) {
    let mut configuration = planar();
    for joint in 0..3 {
        configuration.joints[joint].position_min = 0.0;
        configuration.joints[joint].position_max = 200.0;
    }
    let mut switches = HomingConfiguration::standard(&configuration);
    let nozzle = JointHoming {
        joint: 3,
        towards_max: false,
        fast_natural_s: 2.0,
        slow_natural_s: 0.2,
        back_off_natural: 0.1,
        travel_max_natural: 7.0,
        position_natural: 0.5,
        guards: false,
    };
    switches.joints.push(nozzle).unwrap();
    (configuration, switches)
}

impl World {
    fn new(configuration: &MachineConfiguration, switches: &HomingConfiguration) -> Self {
        let machine = Machine::with_switches(configuration, switches, 77).unwrap();
        let places = switches.joints.iter().map(|switch| {
            let joint = usize::from(switch.joint);
            // Somewhere between the starts and the ends of the carriages.
            let place = if switch.towards_max { 7000 } else { -6000 };
            (joint, switch.towards_max, place + 13 * joint as i64)
        });
        Self {
            host: Host::greet(machine, &flower()),
            switches: places.collect(),
            offsets: [0; 8],
            bounce_ticks: 0,
            last_pressed: 0,
            chatter: [0; 8],
            random: 7,
            stuck: 0,
        }
    }

    fn truth(&self, motor: usize) -> i64 {
        self.host.counter.counts[motor] + self.offsets[motor]
    }

    fn pressed(&mut self) -> u8 {
        let mut pressed = self.stuck;
        for &(joint, upper, place) in &self.switches {
            let truth = self.truth(joint);
            if (upper && truth >= place) || (!upper && truth <= place) {
                pressed |= 1 << joint;
            }
        }
        for joint in 0..8 {
            if (pressed ^ self.last_pressed) >> joint & 1 == 1 {
                self.chatter[joint] = self.bounce_ticks;
            }
        }
        self.last_pressed = pressed;
        for joint in 0..8 {
            if self.chatter[joint] > 0 {
                self.chatter[joint] -= 1;
                self.random = self
                    .random
                    .wrapping_mul(1_664_525)
                    .wrapping_add(1_013_904_223);
                if self.random >> 31 == 1 {
                    pressed ^= 1 << joint;
                }
            }
        }
        pressed
    }

    fn tick(&mut self) {
        let switches = self.pressed();
        self.host.machine.set_inputs(Inputs {
            switches,
            emergency: false,
        });
        self.host.tick();
    }

    fn command(&mut self, control: Control) {
        self.host.control(HostMessage::Control(control));
    }

    /// Runs until nothing moves; the number of ticks it took.
    fn settle(&mut self) -> u32 {
        for tick in 1..400_000 {
            self.tick();
            let motion = self.host.machine.motion();
            let free = !matches!(motion.state(), DeviceState::Homing | DeviceState::Jogging);
            if free && motion.is_at_rest() {
                for _ in 0..SERVO_DELAY_TICKS {
                    self.tick();
                }
                self.host.poll();
                return tick;
            }
        }
        panic!("it never rests: {:?}", self.host.machine.motion().state());
    }

    /// Count that the machine believes, less where the carriage truly is.
    fn belief(&self, joint: usize) -> i64 {
        self.host.machine.motion().counts()[joint] - self.truth(joint)
    }
}

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
        world.host.machine.motion.start(&start),
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
    let motion = &mut world.host.machine.motion;
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
    let motion = &mut world.host.machine.motion;
    assert_eq!(motion.counts()[..4], [6400, 2400, 800, 0]);
    assert_eq!(motion.start(&elsewhere), Err(CommandError::Invalid));
    let mut undisturbed = world.host.machine.motion.clone();
    assert_eq!(undisturbed.start(&job), Ok(()));
    assert_eq!(undisturbed.referenced(), 0b1111);
    world.command(Control::GoTo(position));
    world.settle();
    let motion = &mut world.host.machine.motion;
    assert_eq!(motion.start(&position), Ok(()));
    assert_eq!(motion.counts()[..3], counts[..3]);
    assert_eq!(motion.referenced(), 0b1111);
}

#[test]
fn jogs_go_exactly_as_far_as_asked_and_keep_the_range_of_a_referenced_joint() {
    let (configuration, switches) = machine();
    let mut world = World::new(&configuration, &switches);
    let jog = |joint: u8, distance_units: i32, speed_units_s: u32| Control::Jog {
        joint,
        distance_units,
        speed_units_s,
    };
    world.command(jog(0, 123_456, 500_000));
    world.tick();
    assert_eq!(world.host.machine.motion().state(), DeviceState::Jogging);
    // Nothing else begins meanwhile.
    world.command(jog(1, 1000, 1000));
    world.command(Control::Home(JointOrder::ALL));
    world.settle();
    assert_eq!(
        world.host.refusals.len(),
        1,
        "the newest of what was refused"
    );
    assert_eq!(world.host.refusals[0], RefusalReason::Busy);
    assert_eq!(world.truth(0), (12.3456f64 * 80.0).round() as i64);
    world.command(jog(3, -1_000_000, 2_000_000));
    let ticks = world.settle();
    let steps_per_rad = configuration.joints[3].steps_per_unit;
    assert_eq!(world.truth(3), (-steps_per_rad).round() as i64);
    // A radian at 2 rad/s, and the ramps.
    assert!((1000..1200).contains(&ticks), "{ticks}");

    // Too fast; then beyond the range of a joint that is declared.
    world.command(jog(0, 1000, 2_100_000));
    world.settle();
    world.command(Control::SetJoint {
        joint: 0,
        position_units: 1_990_000,
    });
    world.command(jog(0, 20_000, 500_000));
    world.settle();
    assert_eq!(
        world.host.refusals[1..],
        [RefusalReason::Invalid, RefusalReason::Invalid]
    );
    let before = world.truth(0);
    world.command(jog(0, 10_000, 500_000));
    world.settle();
    assert_eq!(world.truth(0) - before, 80);
    assert_eq!(world.host.machine.motion().counts()[0], 200 * 80);
    assert_eq!(world.host.faults, []);
}

#[test]
fn an_abort_brakes_a_jog_and_the_counts_stay_true() {
    let (configuration, switches) = machine();
    let mut world = World::new(&configuration, &switches);
    world.command(Control::Jog {
        joint: 0,
        distance_units: 1_000_000,
        speed_units_s: 1_000_000,
    });
    for _ in 0..400 {
        world.tick();
    }
    let before = world.truth(0);
    world.command(Control::Abort);
    let ticks = world.settle();
    // 100 mm/s at half of 3000 mm/s²: 67 ms and the smoothing.
    assert!((130..250).contains(&ticks), "{ticks}");
    assert!(world.truth(0) > before);
    assert!(world.truth(0) < 80 * 60);
    assert_eq!(world.belief(0), 0);
    assert_eq!(world.host.machine.motion().state(), DeviceState::Idle);
    assert_eq!(world.host.faults, []);
}

#[test]
fn prime_and_retract_by_hand_move_their_volume_and_keep_the_extruders_limits() {
    let (configuration, switches) = machine();
    let mut world = World::new(&configuration, &switches);
    let extrude = |action, volume_units: u32, duration_ticks: u32| Control::Extrude {
        action,
        volume_units,
        duration_ticks: Ticks(duration_ticks),
    };
    world.command(extrude(FlowAction::Prime, 2_500_000, 1000));
    world.settle();
    assert_eq!(world.truth(4), 1000);
    world.command(extrude(FlowAction::Retract, 500_000, 400));
    world.settle();
    assert_eq!(world.truth(4), 800);
    assert_eq!(world.host.machine.motion().counts()[..5], [0, 0, 0, 0, 800]);
    // 2.5 mm³ in 50 ms peak at 94 mm³/s, above 60.
    world.command(extrude(FlowAction::Prime, 2_500_000, 100));
    world.settle();
    assert_eq!(world.host.refusals, [RefusalReason::Invalid]);
    assert_eq!(world.truth(4), 800);
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
    host.machine.motion = Motion::new(&configuration, &switches);
    assert_eq!(host.machine.motion.start(&job.start), Ok(()));
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

#[test]
fn flow_override_scales_the_volume_and_keeps_the_path_and_the_extruders_limits() {
    let (configuration, job) = (planar(), flower());
    for percent in [50u16, 150] {
        let mut host = Host::new(&configuration, &job);
        host.control(HostMessage::Control(Control::FlowOverride(percent)));
        // Half a second until the factor is there.
        for _ in 0..1100 {
            host.tick();
        }
        let mut last = [0i64; 2];
        let (mut fastest, mut hardest) = (0.0f64, 0.0f64);
        while host.machine.motion().state() != DeviceState::Finished {
            host.send(&job, 8, 16);
            host.tick();
            let target = host.machine.motion().targets()[4];
            if last[0] != 0 {
                let rate = |a: i64, b: i64| (a - b) as f64 / STEP as f64 / 400.0 * 2000.0;
                fastest = fastest.max(rate(target, last[0]).abs());
                let bend = (rate(target, last[0]) - rate(last[0], last[1])) * 2000.0;
                hardest = hardest.max(if last[1] == 0 { 0.0 } else { bend.abs() });
            }
            last = [target, last[0]];
        }
        for _ in 0..100 {
            host.tick();
        }
        host.poll();
        assert_eq!(host.faults, []);
        let planned = final_steps(&configuration, &job);
        assert_eq!(host.counter.counts[..4], planned[..4]);
        let expected = planned[4] as f64 * f64::from(percent) / 100.0;
        let error = host.counter.counts[4] as f64 - expected;
        assert!(error.abs() < 2.0, "{percent} %: {error} of {expected}");
        assert!(fastest < 60.0 && hardest < 3000.0, "{fastest} {hardest}");
    }
}

#[test]
fn a_position_is_declared_at_rest_only_and_without_a_step() {
    let (configuration, switches) = machine();
    let mut world = World::new(&configuration, &switches);
    let place = to_units(&[50.0, 60.0, 0.2, 0.0, 0.0, 1.5, 0.0]);
    world.command(Control::Jog {
        joint: 0,
        distance_units: 50_000,
        speed_units_s: 500_000,
    });
    world.tick();
    world.command(Control::SetPosition(place));
    world.settle();
    assert_eq!(world.host.refusals, [RefusalReason::Busy]);
    let steps = world.host.counter.steps;
    world.command(Control::SetPosition(place));
    world.settle();
    let counts = world.host.machine.motion().counts();
    assert_eq!(counts[..3], [50 * 80, 60 * 80, 80]);
    assert_eq!(world.host.machine.motion().referenced(), 0b1111);
    assert_eq!(world.host.counter.steps, steps);
    // Nor does a place out of range count.
    let mut beyond = place;
    beyond[1] = 2_001_000;
    world.command(Control::SetPosition(beyond));
    world.settle();
    assert_eq!(world.host.refusals[1..], [RefusalReason::Invalid]);
    assert_eq!(world.host.machine.motion().counts(), counts);
    assert_eq!(world.host.faults, []);
}

#[test]
fn status_comes_as_often_as_asked() {
    let (configuration, switches) = machine();
    let mut world = World::new(&configuration, &switches);
    // Ten a second unless asked otherwise.
    for (period_ms, in_two_seconds) in [(None, 20), (Some(20), 100), (Some(500), 4)] {
        if let Some(period_ms) = period_ms {
            world.command(Control::ReportPeriod(period_ms));
        }
        world.host.poll();
        world.host.statuses = 0;
        for _ in 0..4000 {
            world.tick();
            world.host.poll();
        }
        let statuses = world.host.statuses;
        assert!(statuses.abs_diff(in_two_seconds) <= 1, "{statuses}");
    }
}
