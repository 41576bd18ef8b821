//! Goal: a joint that turns without an end never runs out of counts, and is never unwound; counters work
//! where they wrap. Method: streams that begin several turns from the end of the last one, and motion
//! across the wrap of the whole steps, equal step for step to motion far from it.
use super::*;
use crate::steps::STEP;

const TURN_UNITS: i32 = 6_283_185;

fn endless() -> MachineConfiguration {
    let mut configuration = planar();
    configuration.joints[3].position_min = f64::NEG_INFINITY;
    configuration.joints[3].position_max = f64::INFINITY;
    configuration
}

fn start(host: &mut Host, configuration: &MachineConfiguration, position: ChannelPoint) {
    host.refusals.clear();
    host.control(HostMessage::Start(Start {
        job: 3,
        machine_hash: hash_of(configuration),
        first_sequence: 7000,
        position,
        solution: 0,
        units: Units::BASE,
    }));
    host.poll();
}

#[test]
fn a_stream_may_begin_turns_away_and_go_to_takes_the_shorter_way() {
    let configuration = endless();
    let job = flower();
    let mut host = Host::new(&configuration, &job);
    host.run(&job);
    let end = job.knots.last().unwrap().control;
    let mut turned = end;
    // 300 turns back: whole steps of a joint with 16,000 a turn.
    turned[5] -= 300 * TURN_UNITS;
    let steps = host.counter.steps;
    let mut other = turned;
    other[5] += TURN_UNITS / 3;
    start(&mut host, &configuration, other);
    assert_eq!(host.refusals, [RefusalReason::Invalid]);
    start(&mut host, &configuration, turned);
    assert_eq!(host.refusals, []);
    assert_eq!(host.counter.steps, steps);
    host.control(HostMessage::Control(Control::Abort));
    (0..200).for_each(|_| host.tick());
    host.control(HostMessage::Control(Control::GoTo(other)));
    (0..8000).for_each(|_| host.tick());
    host.poll();
    assert_eq!(host.refusals, []);
    let third = (configuration.joints[3].steps_per_unit * core::f64::consts::TAU / 3.0).round();
    let made = host.counter.steps - steps;
    assert!((made as f64 - third).abs() <= 2.0, "{made} {third}");
    start(&mut host, &configuration, other);
    assert_eq!(host.refusals, []);
}

#[test]
fn steps_across_the_wrap_of_the_counts_are_those_far_from_it() {
    use crate::steps::{StepPlayer, StepProgrammer};
    let wrap = 1i64 << 62;
    let mut digests = Vec::new();
    // 2^31 whole steps: 223,000 turns of 9600 steps; of the extruder 5.4 litres at 400 steps a mm³.
    for start in [0, 1000 * STEP, wrap - 200 * STEP, -wrap + 200 * STEP] {
        let mut programmer = StepProgrammer::new(1, 100);
        let mut player = StepPlayer::new(100);
        let mut counter = Counter::default();
        programmer.set_positions(&[start; 8]);
        for tick in 0..3000i64 {
            let swing = 400.0 * (1.0 - (tick as f64 * 0.004).cos());
            let target = start.wrapping_add((swing * STEP as f64) as i64);
            let advanced = programmer.advance(&[target; 8], player.idle_bank());
            assert!(advanced.is_ok());
            player.hand_over();
            player.run_interval(&mut counter);
        }
        digests.push((counter.digest, counter.steps));
        assert!(counter.steps > 1000);
    }
    assert!(
        digests.iter().all(|digest| *digest == digests[0]),
        "{digests:?}"
    );
}

#[test]
fn sequence_numbers_go_on_where_they_wrap() {
    let (configuration, job) = (planar(), flower());
    let mut host = Host::new(&configuration, &job);
    host.control(HostMessage::Control(Control::Abort));
    (0..3).for_each(|_| host.tick());
    // A few frames before 2^32, and 16 bits of it on the line.
    let first_sequence = u32::MAX - 5;
    host.control(HostMessage::Start(Start {
        job: 3,
        machine_hash: hash_of(&configuration),
        first_sequence,
        position: job.start,
        solution: 0,
        units: Units::BASE,
    }));
    host.stream_sequence = first_sequence as u16;
    host.poll();
    let before = host.sequence;
    // Commands wrap too.
    host.sequence = u16::MAX - 4;
    host.control(HostMessage::Hello(Hello {
        protocol_version: PROTOCOL_VERSION,
        schema_hash: SCHEMA_HASH,
        host_session: u32::from(before) + 99,
    }));
    for percent in 90..=100 {
        host.sequence = host.sequence.wrapping_add(1);
        let sequence = host.sequence;
        host.write(sequence, &HostMessage::Control(Control::Override(percent)));
        host.poll();
        assert_eq!(host.machine.motion().override_percent(), percent);
    }
    host.run(&job);
    assert_eq!(
        host.counter.counts[..5],
        final_steps(&configuration, &job)[..]
    );
    assert_eq!((host.faults.len(), host.refusals.len()), (0, 0));
}

#[test]
fn a_span_longer_than_a_short_way_is_followed_step_by_step() {
    let mut configuration = planar();
    let x = &mut configuration.joints[0];
    x.steps_per_unit = 400.0;
    (x.speed_max, x.acceleration_max, x.position_max) = (250.0, 2000.0, 1000.0);
    // 1 s a span, up to 160 mm: 64,000 steps.
    let places = [
        0.0, 0.0, 0.0, 40.0, 200.0, 360.0, 400.0, 400.0, 400.0, 400.0,
    ];
    let point = |x: f64| to_units(&[x, 0.0, 0.2, 0.0, 0.0, 0.0, 0.1 * x]);
    let job = Job {
        start: point(0.0),
        knots: places.map(|x| rest(point(x), 2000)).to_vec(),
        events: Vec::new(),
        units: Units::BASE,
    };
    let spans = job.spans();
    let mut host = Host::new(&configuration, &job);
    let (mut worst, mut longest) = (0.0f64, 0.0f64);
    for tick in 0u64.. {
        host.send(&job, 8, 16);
        host.tick();
        if host.machine.motion().state() == DeviceState::Finished {
            break;
        }
        assert!(tick < 40_000, "it never ends: {:?}", host.faults);
        let motion = host.machine.motion();
        let Some(start) = motion.stream_start_ticks() else {
            continue;
        };
        let late = SERVO_DELAY_TICKS + motion.delay_ticks();
        let Some(u) = (tick + 1).checked_sub(start + u64::from(late)) else {
            continue;
        };
        let Some(span) = spans.iter().rfind(|span| span.start_tick <= u) else {
            continue;
        };
        let at = exact(&configuration, &span.position((u - span.start_tick) as f64));
        let end = exact(
            &configuration,
            &span.position(f64::from(span.duration_ticks)),
        );
        longest = longest.max(end[0] - exact(&configuration, &span.position(0.0))[0]);
        worst = worst.max((host.counter.counts[0] as f64 - at[0]).abs());
    }
    assert_eq!(host.faults, []);
    assert!(
        longest > f64::from(crate::steps::NEAR_STEPS_MAX),
        "{longest}"
    );
    // Half a step, and what single precision makes of 64,000.
    assert!(worst < 0.75, "{worst}");
    assert_eq!(host.counter.counts[..5], final_steps(&configuration, &job));
}
