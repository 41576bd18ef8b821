//! Goal: motors that are not joints (CoreXY, a second motor on Z) make the steps of the planar machine's joints
//! after the transform, in streams, with shapers, at stops and in homing; their own limits hold. Method: the
//! same jobs on both machines, tick by tick; carriages whose position follows from both motors together.
use super::world::World;
use super::*;
use crate::configuration::homing::HomingConfiguration;
use crate::configuration::motors::MotorPair;
use crate::configuration::shaping::{Shaper, ShaperKind};
use headway_protocol::message::JointOrder;

/// CoreXY with a second motor on Z.
fn core_xy() -> MachineConfiguration {
    let mut configuration = planar();
    configuration.motors = MotorMatrix {
        pair: Some(MotorPair {
            joints: [0, 1],
            speed_max: 250.0,
            acceleration_max: 4000.0,
            jerk_max: 1e6,
        }),
        copies: heapless::Vec::from_slice(&[2]).unwrap(),
    };
    configuration.check().unwrap();
    configuration
}

/// The copy of Z's motor: behind X + Y, X - Y, Z, C and the extruder.
const Z_COPY: usize = 5;

/// Targets of the joints and counts of the motors at each tick of a job.
fn ticks_of(configuration: &MachineConfiguration, job: &Job) -> Vec<([i64; 8], [i64; 8])> {
    let mut host = Host::new(configuration, job);
    let mut ticks = Vec::new();
    for _ in 0..20_000 {
        if host.machine.motion().state() == DeviceState::Finished {
            break;
        }
        host.send(job, 8, 16);
        host.tick();
        ticks.push((host.machine.motion().targets(), host.counter.counts));
    }
    host.poll();
    assert_eq!((host.faults, host.refusals), (Vec::new(), Vec::new()));
    ticks
}

#[test]
fn core_xy_makes_the_steps_of_the_planar_machine_after_the_transform() {
    let job = flower();
    for kind in [ShaperKind::None, ShaperKind::Mzv, ShaperKind::Smooth] {
        let shaped = |mut configuration: MachineConfiguration| {
            for (joint, frequency_hz) in [(0, 44.0), (1, 57.0)] {
                configuration.shapers[joint] = Shaper {
                    kind,
                    frequency_hz,
                    damping: 0.1,
                };
            }
            configuration
        };
        let (direct, core) = (shaped(planar()), shaped(core_xy()));
        let (direct, core) = (ticks_of(&direct, &job), ticks_of(&core, &job));
        assert_eq!(direct.len(), core.len());
        let mut moved = 0;
        for ((targets, counts), (own_targets, own)) in direct.iter().zip(&core) {
            // The joints are told the very same, to 2^-22 of a step.
            assert_eq!(targets[..5], own_targets[..5]);
            // Rounding to steps before the transform and after it: half a step each of three.
            let [x, y] = [counts[0], counts[1]];
            assert!(
                (own[0] - (x + y)).abs() <= 1 && (own[1] - (x - y)).abs() <= 1,
                "{own:?}"
            );
            assert_eq!(own[2..5], counts[2..5]);
            assert_eq!(own[Z_COPY], own[2]);
            moved += i32::from(own[0] != 0 && own[1] != 0);
        }
        assert!(moved > 5000);
        let (_, last) = core.last().unwrap();
        let ends = final_steps(&planar(), &job);
        assert_eq!(
            last[..5],
            [
                ends[0] + ends[1],
                ends[0] - ends[1],
                ends[2],
                ends[3],
                ends[4]
            ]
        );
    }
}

#[test]
fn an_emergency_stop_knows_where_the_joints_are() {
    let (configuration, job) = (core_xy(), flower());
    for into_interval in [0, 1, 37, 99] {
        let mut host = Host::new(&configuration, &job);
        for _ in 0..3000 {
            host.send(&job, 8, 16);
            host.tick();
        }
        host.machine.servo_tick();
        for _ in 0..into_interval {
            host.machine.step_tick(&mut host.counter);
        }
        host.control(HostMessage::Control(Control::EmergencyStop));
        for _ in into_interval..100 {
            host.machine.step_tick(&mut host.counter);
        }
        let steps = host.counter.steps;
        for _ in 0..200 {
            host.tick();
        }
        // What is left of a step's fraction may be rounded to the nearest step once.
        assert!(host.counter.steps - steps <= 4);
        assert_eq!(host.counter.counts, host.machine.motion().counts());
        assert_eq!(host.counter.counts[Z_COPY], host.counter.counts[2]);
    }
}

#[test]
fn a_core_xy_axis_is_homed_by_both_motors() {
    let (mut configuration, _) = super::world::machine();
    configuration.motors = core_xy().motors;
    let switches = HomingConfiguration::standard(&configuration);
    let mut world = World::new(&configuration, &switches);
    world.offsets[0] = 3000;
    world.offsets[1] = 1234;
    let before = world.host.counter.counts;
    world.command(Control::Home(JointOrder::of(&[1]).unwrap()));
    world.settle();
    assert_eq!(world.host.faults, []);
    let moved: [i64; 3] =
        core::array::from_fn(|motor| world.host.counter.counts[motor] - before[motor]);
    // Y alone: the motors turn by as much, one the other way.
    assert!(
        moved[1] > 6000 && (moved[0] + moved[1]).abs() <= 1 && moved[2] == 0,
        "{moved:?}"
    );
    world.command(Control::Home(JointOrder::ALL));
    world.settle();
    assert_eq!(world.host.faults, []);
    assert_eq!(world.host.machine.motion().referenced(), 0b111);
    for joint in [0, 1] {
        let homing = switches.of(joint).unwrap();
        let joint = usize::from(joint);
        let place = world
            .switches
            .iter()
            .find(|switch| switch.0 == joint)
            .unwrap()
            .2;
        let stated = homing.position_natural * configuration.joints[joint].steps_per_unit;
        let error = world.belief(joint) as f64 - (stated - place as f64);
        // A servo tick of the slow way, and a step of either motor.
        let tick = homing.slow_natural_s * configuration.joints[joint].steps_per_unit / 2000.0;
        assert!(error.abs() <= 2.0 + tick, "joint {joint}: {error}");
    }
    // A stream begins where the joints are, and nowhere else.
    let here = to_units(&[3.0, 3.0, 197.0, 0.0, 0.0, 0.0, 0.0]);
    world.command(Control::GoTo(here));
    world.settle();
    let motion = world.host.machine.servo.motion_mut();
    let mut elsewhere = here;
    elsewhere[1] += 250;
    assert!(motion.start(&elsewhere).is_err());
    assert_eq!(motion.start(&here), Ok(()));
}

#[test]
fn a_span_beyond_the_limit_of_a_pairs_motor_is_refused() {
    // 45° at 190 mm/s of each axis, within 200: the motor would turn by 380 mm/s.
    let job = Job::of_curve(1.0, 12, |s| {
        let way = 100.0 * s;
        [way, way, 0.2, 0.0, 0.0, 0.0, 0.0]
    });
    let run = |configuration: &MachineConfiguration| {
        let mut host = Host::new(configuration, &job);
        for _ in 0..200 {
            host.send(&job, 8, 16);
            host.tick();
        }
        host.poll();
        host.faults
    };
    assert_eq!(run(&planar()), []);
    let faults = run(&core_xy());
    assert_eq!(faults.len(), 1, "{faults:?}");
    assert_eq!((faults[0].cause, faults[0].index), (FaultCause::Limit, 0));
}

#[test]
fn motors_are_in_the_hash_and_in_a_record_and_others_are_as_they_were() {
    use crate::settings::BoardSettings;
    assert_eq!(planar().hash(), hash_of(&planar()));
    assert_ne!(core_xy().hash(), planar().hash());
    let mut other = core_xy();
    other.motors.copies[0] = 1;
    assert_ne!(other.hash(), core_xy().hash());
    let settings = BoardSettings {
        switches: HomingConfiguration::standard(&core_xy()),
        machine: core_xy(),
        heaters: None,
        drivers: Default::default(),
        wiring: Default::default(),
        board: None,
    };
    let record = settings.encode().unwrap();
    assert_eq!(BoardSettings::decode(&record), Ok(settings.clone()));
    let plain = BoardSettings {
        machine: planar(),
        ..settings
    };
    assert!(plain.encode().unwrap().len() < record.len());
    let mut wrong = plain.clone();
    wrong.machine.motors.copies.extend([0, 0, 9]);
    let refusal = wrong.encode().unwrap_err();
    assert!(std::format!("{refusal}").contains("motors"), "{refusal}");
}
