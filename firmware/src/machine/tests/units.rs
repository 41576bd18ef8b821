//! Goal: a stream in coarse units moves exactly like the same positions in base units, to the step, and commands
//! outside a stream keep base units. Method: jobs on a coarse lattice, sent in their own units and in base units;
//! commands between streams; invalid units.
use super::*;
use headway_protocol::units::UNIT_EXPONENT_MAX;

const COARSE: Units = Units {
    length_exponent: 5,
    angle_exponent: 4,
    volume_exponent: 9,
};

/// The job of `points` in these units.
fn coarse(fine: &Job, units: Units) -> Job {
    let on_lattice = |point: &ChannelPoint| units.of_base(point);
    let events = fine.events.iter().map(|event| FlowEvent {
        volume_units: event.volume_units >> units.volume_exponent,
        ..*event
    });
    Job {
        start: on_lattice(&fine.start),
        knots: fine
            .knots
            .iter()
            .map(|knot| rest(on_lattice(&knot.control), knot.duration_ticks))
            .collect(),
        events: events.collect(),
        units,
    }
}

/// The same places in base units.
fn in_base_units(job: &Job) -> Job {
    let units = job.units;
    let events = job.events.iter().map(|event| FlowEvent {
        volume_units: event.volume_units << units.volume_exponent,
        ..*event
    });
    Job {
        start: units.to_base(&job.start),
        knots: job
            .knots
            .iter()
            .map(|knot| rest(units.to_base(&knot.control), knot.duration_ticks))
            .collect(),
        events: events.collect(),
        units: Units::BASE,
    }
}

/// The gantry of the tests with its tilt in the table.
pub(super) fn trunnion() -> MachineConfiguration {
    let mut configuration = gantry();
    configuration.kinematics = Kinematics::Trunnion {
        centre_mm: [0.0, 0.0, -40.0],
        solution: 1,
    };
    configuration
}

/// A ring on a cone: leans outwards all round, so that a table has one way to hold it.
pub(super) fn cone() -> Job {
    Job::of_curve(6.0, 10, |s| {
        let a = s * core::f64::consts::TAU / 6.0;
        let (sin, cos) = a.sin_cos();
        [
            20.0 * cos,
            20.0 * sin,
            5.0,
            -0.3 * sin,
            0.3 * cos,
            0.5 * a,
            8.0 * s,
        ]
    })
}

#[test]
fn coarse_units_make_the_very_steps_of_the_same_places_in_base_units() {
    for (configuration, fine) in [
        (planar(), flower()),
        (gantry(), tilted_flower()),
        (trunnion(), cone()),
    ] {
        let job = coarse(&fine, COARSE);
        let mut made = Vec::new();
        for job in [&job, &in_base_units(&job)] {
            let mut host = Host::new(&configuration, job);
            let mut ticks = 0;
            // A pause in the middle: the melt is pulled back and pushed again, in the stream's unit.
            while ticks < 8000 {
                host.send(job, 8, 16);
                match ticks {
                    2000 => host.control(HostMessage::Control(Control::Pause)),
                    6000 => host.control(HostMessage::Control(Control::Resume)),
                    _ => {}
                }
                host.tick();
                ticks += 1;
            }
            host.run(job);
            assert_eq!((host.faults.len(), host.refusals.len()), (0, 0));
            // By whole turns the joints of a table may be elsewhere.
            let known = if configuration.kinematics == trunnion().kinematics {
                3
            } else {
                configuration.joints.len() + 1
            };
            let expected = final_steps(&configuration, job);
            assert_eq!(host.counter.counts[..known], expected[..known]);
            assert!(host.counter.steps > 20_000);
            made.push((host.counter.digest, host.counter.steps));
        }
        assert_eq!(made[0], made[1]);
    }
}

#[test]
fn commands_keep_base_units_whatever_the_stream_had() {
    let (configuration, job) = (planar(), coarse(&flower(), COARSE));
    let mut host = Host::new(&configuration, &job);
    host.run(&job);
    let before = host.counter.counts;
    let end = COARSE.to_base(&job.knots.last().unwrap().control);
    let extrude = Control::Extrude {
        action: FlowAction::Prime,
        volume_units: 2_500_000,
        duration_ticks: Ticks(1000),
    };
    let mut away = end;
    away[0] += 50_000;
    for (command, moved) in [
        (extrude, [0, 0, 0, 0, 1000]),
        (Control::GoTo(away), [400, 0, 0, 0, 0]),
        (Control::GoTo(end), [-400, 0, 0, 0, 0]),
    ] {
        let before = host.counter.counts;
        host.control(HostMessage::Control(command));
        (0..6000).for_each(|_| host.tick());
        host.poll();
        assert_eq!((host.faults.len(), host.refusals.len()), (0, 0));
        let way: Vec<i64> = (0..5)
            .map(|motor| host.counter.counts[motor] - before[motor])
            .collect();
        assert_eq!(way, moved, "{command:?}");
    }
    assert_eq!(host.counter.counts[..4], before[..4]);
    // Where the machine stands, a stream may begin in either units; beside it in neither.
    for (units, position, refused) in [
        (COARSE, COARSE.of_base(&end), false),
        (COARSE, COARSE.of_base(&away), true),
        (Units::BASE, end, false),
        (Units::BASE, away, true),
    ] {
        host.control(HostMessage::Control(Control::Abort));
        (0..200).for_each(|_| host.tick());
        host.refusals.clear();
        host.control(HostMessage::Start(Start {
            job: 3,
            machine_hash: configuration.hash(),
            first_sequence: 9000,
            position,
            solution: 0,
            units,
        }));
        host.poll();
        let expected: &[_] = if refused {
            &[RefusalReason::Invalid]
        } else {
            &[]
        };
        assert_eq!(host.refusals, expected, "{units:?}");
    }
    assert_eq!(host.faults, []);
}

#[test]
fn units_too_coarse_for_a_motor_or_the_wire_are_refused() {
    let (configuration, job) = (planar(), flower());
    // 400 steps a mm³: a unit of 2^13 · 10⁻⁶ mm³ is 3.3 steps; of Z's 400 a mm 2^7 · 0.1 µm are 5.
    for (length_exponent, angle_exponent, volume_exponent, is_taken) in [
        (6, 0, 12, true),
        (0, 0, 13, false),
        (7, 0, 0, false),
        (0, UNIT_EXPONENT_MAX, 0, false),
        (UNIT_EXPONENT_MAX + 1, 0, 0, false),
        (0, 255, 0, false),
        (0, 0, 64, false),
    ] {
        let units = Units {
            length_exponent,
            angle_exponent,
            volume_exponent,
        };
        let mut host = Host::greet(Machine::new(&configuration, 77).unwrap(), &job);
        host.control(HostMessage::Start(Start {
            job: 1,
            machine_hash: configuration.hash(),
            first_sequence: 500,
            position: [0; CHANNELS],
            solution: 0,
            units,
        }));
        host.poll();
        let expected: &[_] = if is_taken {
            &[]
        } else {
            &[RefusalReason::Invalid]
        };
        assert_eq!(host.refusals, expected, "{units:?}");
    }
}
