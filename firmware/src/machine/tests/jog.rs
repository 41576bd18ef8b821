//! Goal: jogs, prime and retract by hand move exactly the requested distance; soft limits stop what they
//! should, nothing begins while it must not, and reports come at the requested rate. Method: every step
//! moves a simulated carriage; the motor counts are compared with the carriage.
use super::world::{World, machine};
use super::*;
use crate::configuration::motors::MotorPair;
use crate::design::MOTORS_IDLE_S;
use crate::motion::CommandError;
use crate::steps::{StepBank, Stopped};
use headway_protocol::message::JointOrder;

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
    assert_eq!(world.host.refusals, [RefusalReason::Busy; 2]);
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
        world.host.refusals[2..],
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

#[test]
fn motors_that_are_let_go_must_be_found_again() {
    let (configuration, switches) = machine();
    let mut world = World::new(&configuration, &switches);
    world.command(Control::Home(JointOrder::ALL));
    world.settle();
    world.command(Control::SetJoint {
        joint: 3,
        position_units: 0,
    });
    world.tick();
    assert_eq!(world.host.machine.motion().referenced(), 0b1111);
    // Not while something moves.
    world.command(Control::Jog {
        joint: 0,
        distance_units: 100_000,
        speed_units_s: 500_000,
    });
    world.tick();
    world.command(Control::MotorsOff);
    world.settle();
    assert_eq!(world.host.refusals, [RefusalReason::Busy]);
    assert!(world.host.machine.motion().drivers_on());
    world.command(Control::MotorsOff);
    world.tick();
    let motion = world.host.machine.servo.motion_mut();
    assert!(!motion.drivers_on());
    assert_eq!(motion.referenced(), 0);
    assert_eq!(motion.start(&[0; 7]), Err(CommandError::Invalid));
    world.command(Control::Home(JointOrder::ALL));
    world.settle();
    assert!(world.host.machine.motion().drivers_on());
    assert_eq!(world.host.machine.motion().referenced(), 0b1111);
    assert_eq!(world.host.faults, []);
}

#[test]
fn motors_are_let_go_after_ten_minutes_at_rest_without_a_stream() {
    let (configuration, switches) = machine();
    let mut motion = Motion::new(&configuration, &switches);
    let mut bank = StepBank::default();
    let mut run = |motion: &mut Motion, seconds: u32| {
        for _ in 0..seconds * configuration.servo_hz {
            motion.tick(&mut bank);
        }
    };
    // An open stream holds them however long it waits.
    motion.start(&[100_000; 7]).unwrap();
    run(&mut motion, MOTORS_IDLE_S + 60);
    assert!(motion.drivers_on());
    motion.abort();
    run(&mut motion, MOTORS_IDLE_S - 1);
    assert!(motion.drivers_on());
    // Whatever moves begins the time anew.
    let jog = Control::Jog {
        joint: 0,
        distance_units: 1000,
        speed_units_s: 500_000,
    };
    motion.command_at_rest(&jog).unwrap();
    run(&mut motion, MOTORS_IDLE_S - 1);
    assert!(motion.drivers_on());
    run(&mut motion, 2);
    assert!(!motion.drivers_on());
    assert_eq!(motion.referenced(), 0);
}

/// Motors that stayed on for ever: a latched fault held them, and with them the controller's fan.
#[test]
fn a_fault_keeps_no_motors_on_but_those_of_joints_that_would_fall() {
    let (configuration, mut switches) = machine();
    let servo_hz = configuration.servo_hz;
    for (hold, pair, kept) in [(0, false, 0), (0b100, false, 0b100), (0b1, true, 0b11)] {
        switches.hold = hold;
        let mut configuration = configuration.clone();
        if pair {
            configuration.motors.pair = Some(MotorPair {
                joints: [0, 1],
                speed_max: 500.0,
                acceleration_max: 1e4,
                jerk_max: 1e6,
            });
        }
        for at_once in [false, true] {
            let mut motion = Motion::new(&configuration, &switches);
            let mut bank = StepBank::default();
            let mut run = |motion: &mut Motion, seconds: u32| {
                for _ in 0..seconds * servo_hz {
                    motion.tick(&mut bank);
                    if motion.take_stop() {
                        motion.engine_stopped(&Stopped::default());
                    }
                }
            };
            motion.start(&[100_000; 7]).unwrap();
            run(&mut motion, 1);
            let fault = Fault {
                cause: FaultCause::Sequence,
                index: 0,
                value: 0,
            };
            match at_once {
                true => motion.fail_at_once(fault),
                false => motion.fail_softly(fault),
            }
            run(&mut motion, MOTORS_IDLE_S - 1);
            assert_eq!(motion.held_motors(), u8::MAX);
            run(&mut motion, 3);
            assert_eq!(motion.held_motors(), kept, "{hold:b} {at_once}");
            // Joints that were held are where they were, if they were known.
            let known = if at_once { 0 } else { kept };
            assert_eq!(motion.referenced(), known);
            assert!(motion.clear_fault());
            // By command all are let go.
            motion.command_at_rest(&Control::MotorsOff).unwrap();
            assert!(!motion.drivers_on());
        }
    }
}

#[test]
fn firmware_for_another_board_moves_nothing_and_cannot_be_talked_out_of_it() {
    let (configuration, switches) = machine();
    let mut world = World::new(&configuration, &switches);
    let other_chip = Fault {
        cause: FaultCause::Board,
        index: 0,
        value: 0x419,
    };
    world
        .host
        .machine
        .servo
        .motion_mut()
        .fail_softly(other_chip);
    world.tick();
    world.command(Control::ClearFault);
    world.settle();
    world.command(Control::Home(JointOrder::ALL));
    world.settle();
    let refused = [RefusalReason::Busy, RefusalReason::Faulted];
    assert_eq!(world.host.refusals, refused);
    assert_eq!(world.host.faults, [other_chip]);
    assert!(!world.host.machine.motion().drivers_on());
    assert_eq!(world.host.counter.counts, [0; 8]);
}
