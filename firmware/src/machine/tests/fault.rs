//! Goal: a fault stops the machine as its cause requires, is reported, stays until it is cleared,
//! and nothing extrudes until then. Method: one cause at a time in the middle of a job.
use super::*;
use crate::configuration::shaping::{Shaper, ShaperKind};
use crate::motion::CommandError;
use crate::motion::inputs::Inputs;

/// Starts a job and runs it for some ticks.
fn running(configuration: &MachineConfiguration, job: &Job, ticks: u32) -> Host {
    let mut host = Host::new(configuration, job);
    for _ in 0..ticks {
        host.send(job, 8, 16);
        host.tick();
    }
    assert_eq!(host.machine.motion().state(), DeviceState::Running);
    host
}

/// Runs on and returns the steps made; the counts must stay those that the steps add up to.
fn steps_of(host: &mut Host, ticks: u32) -> u64 {
    let before = host.counter.steps;
    for _ in 0..ticks {
        host.tick();
    }
    host.poll();
    assert_eq!(host.counter.counts, host.machine.motion().counts());
    host.counter.steps - before
}

#[test]
fn an_emergency_stops_between_two_step_ticks_and_knows_its_counts() {
    let (configuration, job) = (planar(), flower());
    for into_interval in [0, 1, 37, 99] {
        let mut host = running(&configuration, &job, 3000);
        host.machine.servo_tick();
        for _ in 0..into_interval {
            host.machine.step_tick(&mut host.counter);
        }
        host.control(HostMessage::Control(Control::EmergencyStop));
        let steps = host.counter.steps;
        for _ in into_interval..100 {
            host.machine.step_tick(&mut host.counter);
        }
        assert_eq!(host.counter.steps, steps);
        assert_eq!(steps_of(&mut host, 500), 0);
        assert_eq!(host.faults.len(), 1);
        assert_eq!(host.faults[0].cause, FaultCause::Emergency);
        assert_eq!(host.state, DeviceState::Faulted);
    }
}

#[test]
fn a_fault_stays_until_it_is_cleared_and_a_lost_position_must_be_declared() {
    let (configuration, job) = (planar(), flower());
    let mut host = running(&configuration, &job, 3000);
    host.control(HostMessage::Control(Control::EmergencyStop));
    steps_of(&mut host, 10);
    assert_eq!(
        host.machine.servo.motion_mut().start(&job.start),
        Err(CommandError::Faulted)
    );
    host.control(HostMessage::Control(Control::ClearFault));
    steps_of(&mut host, 10);
    assert_eq!(host.machine.motion().state(), DeviceState::Idle);
    assert_eq!(
        host.machine.servo.motion_mut().start(&job.start),
        Err(CommandError::Invalid)
    );
    assert_eq!(
        host.machine.servo.motion_mut().set_position(&job.start),
        Ok(())
    );
    assert_eq!(host.machine.servo.motion_mut().start(&job.start), Ok(()));
}

#[test]
fn a_span_beyond_the_soft_limit_is_never_entered_and_the_head_ramps_to_rest() {
    let mut configuration = planar();
    // The flower reaches -22 mm in x.
    configuration.joints[0].position_min = -12.0;
    let job = flower();
    let mut host = Host::new(&configuration, &job);
    let mut last = [0i64; 8];
    let mut worst_change = 0.0f64;
    let mut history: Vec<[i64; 8]> = Vec::new();
    for _ in 0..9000 {
        host.send(&job, 8, 16);
        host.tick();
        last = host.machine.motion().targets();
        history.push(last);
        if let [.., a, b, c] = history.as_slice() {
            let change = (c[0] - 2 * b[0] + a[0]) as f64 / crate::steps::STEP as f64;
            worst_change = worst_change.max((change / 80.0 * 4e6).abs());
        }
    }
    host.poll();
    assert_eq!(host.faults.len(), 1);
    assert_eq!(
        (host.faults[0].cause, host.faults[0].index),
        (FaultCause::SoftLimit, 0)
    );
    let x_mm = last[0] as f64 / crate::steps::STEP as f64 / 80.0;
    assert!(x_mm > -12.0, "{x_mm}");
    assert!(worst_change < 3000.0, "{worst_change} mm/s²");
    assert_eq!(steps_of(&mut host, 100), 0);
}

#[test]
fn a_start_elsewhere_than_the_machine_is_refused() {
    let (configuration, job) = (planar(), flower());
    let mut host = Host::new(&configuration, &job);
    host.run(&job);
    let mut elsewhere = job.knots.last().unwrap().control;
    assert_eq!(host.machine.servo.motion_mut().start(&elsewhere), Ok(()));
    host.machine.servo.motion_mut().finish();
    steps_of(&mut host, 300);
    assert_eq!(host.machine.motion().state(), DeviceState::Finished);
    elsewhere[0] += 1000;
    assert_eq!(
        host.machine.servo.motion_mut().start(&elsewhere),
        Err(CommandError::Invalid)
    );
}

#[test]
fn a_stream_that_ends_in_motion_is_a_sequence_fault() {
    let configuration = planar();
    let mut job = flower();
    job.knots.truncate(200);
    job.events.truncate(1);
    let mut host = Host::new(&configuration, &job);
    for _ in 0..8000 {
        host.send(&job, 8, 16);
        host.tick();
    }
    host.poll();
    assert_eq!(host.faults.len(), 1);
    assert_eq!(host.faults[0].cause, FaultCause::Sequence);
    assert_eq!(steps_of(&mut host, 100), 0);
}

#[test]
fn a_missed_servo_tick_in_motion_is_a_fault() {
    let (configuration, job) = (planar(), flower());
    let mut host = running(&configuration, &job, 3000);
    for _ in 0..200 {
        host.machine.step_tick(&mut host.counter);
    }
    steps_of(&mut host, 5);
    assert_eq!(host.faults.len(), 1);
    assert_eq!(host.faults[0].cause, FaultCause::StepOverrun);
    assert_eq!(steps_of(&mut host, 100), 0);
}

#[test]
fn a_long_pause_in_a_pass_pulls_the_melt_back_and_pushes_it_again() {
    let (configuration, job) = (planar(), flower());
    let mut host = running(&configuration, &job, 3000);
    host.control(HostMessage::Control(Control::Pause));
    // Ramp, pressure advance and dwell.
    steps_of(&mut host, 500);
    let held = host.counter.counts;
    steps_of(&mut host, 1000);
    let retracted = host.counter.counts;
    assert_eq!(held[..4], retracted[..4]);
    // The job primes 0.8 mm³ at 400 steps/mm³.
    assert_eq!(held[4] - retracted[4], 320);
    host.control(HostMessage::Control(Control::Resume));
    // The prime; the joints wait for the advance after it.
    (0..160).for_each(|_| host.tick());
    assert_eq!(host.counter.counts[..4], held[..4]);
    host.run(&job);
    assert_eq!(host.faults, []);
    assert_eq!(host.counter.counts[..5], final_steps(&configuration, &job));
    assert_eq!(host.machine.motion().holds(), 1);
}

#[test]
fn an_abort_comes_to_rest_and_forgets_the_stream() {
    let (configuration, job) = (planar(), flower());
    let mut host = running(&configuration, &job, 3000);
    host.control(HostMessage::Control(Control::Abort));
    steps_of(&mut host, 600);
    assert_eq!(host.machine.motion().state(), DeviceState::Idle);
    assert_eq!(host.machine.motion().queued_knots(), 0);
    assert_eq!(steps_of(&mut host, 100), 0);
    assert_eq!(host.faults, []);
}

#[test]
fn garbage_lost_and_repeated_frames_change_no_step() {
    let (configuration, job) = (planar(), flower());
    let mut clean = Host::new(&configuration, &job);
    clean.run(&job);
    let mut host = Host::new(&configuration, &job);
    let mut tick = 0u32;
    while host.machine.motion().state() != DeviceState::Finished {
        tick += 1;
        assert!(tick < 50_000);
        if tick.is_multiple_of(5) {
            let noise: Vec<u8> = (0..tick % 300).map(|i| (i * i + tick) as u8).collect();
            host.machine.handle_bytes(&noise);
            host.machine.handle_bytes(&[0]);
        }
        if tick.is_multiple_of(11) && host.knots_sent > 0 {
            // An old frame again, and one from the future.
            for sequence in [
                host.stream_sequence.wrapping_sub(1),
                host.stream_sequence + 3,
            ] {
                host.write(sequence, &HostMessage::Flow(job.events[0]));
            }
        }
        host.send(&job, 8, 16);
        host.tick();
    }
    for _ in 0..SERVO_DELAY_TICKS {
        host.tick();
    }
    assert_eq!(host.counter.counts, clean.counter.counts);
    assert_eq!(host.counter.steps, clean.counter.steps);
    host.poll();
    assert_eq!(host.faults, []);
}

/// A bump in x of 20 mm and 2800 mm/s² in long spans, so that it goes further between the places that
/// are looked at on reception than at them: the two maxima, mm.
fn bump(phase: f64) -> (Job, f64, f64) {
    let job = Job::of_curve(0.7, 40, |s| {
        let angle = s * core::f64::consts::TAU / 0.7 + phase;
        [10.0 * (1.0 - angle.cos()), 0.0, 0.2, 0.0, 0.0, 0.0, 0.0]
    });
    let (mut looked_at, mut all) = (0.0f64, 0.0f64);
    for span in job.spans() {
        for tick in 0..=span.duration_ticks {
            let x_mm = span.position(f64::from(tick))[0];
            all = all.max(x_mm);
            if tick % (span.duration_ticks / 2).max(1) == 0 {
                looked_at = looked_at.max(x_mm);
            }
        }
    }
    (job, looked_at, all)
}

#[test]
fn a_soft_limit_that_reception_cannot_see_stops_at_run_time_and_knows_its_counts() {
    let bumps = (0..20).map(|i| bump(0.02 * f64::from(i)));
    let (job, looked_at, all) = bumps
        .max_by(|a, b| (a.2 - a.1).total_cmp(&(b.2 - b.1)))
        .unwrap();
    let mut configuration = planar();
    // A step is 12.5 µm.
    assert!(all - looked_at > 0.025, "{looked_at} {all}");
    configuration.joints[0].position_max = looked_at + 0.002;
    let mut host = Host::new(&configuration, &job);
    for _ in 0..4000 {
        host.send(&job, 8, 16);
        host.tick();
    }
    assert_eq!(steps_of(&mut host, 500), 0);
    assert_eq!(host.faults.len(), 1, "{:?}", host.faults);
    let fault = host.faults[0];
    assert_eq!((fault.cause, fault.index), (FaultCause::SoftLimit, 0));
    let highest = (configuration.joints[0].position_max * 80.0).round() as i64;
    // The steps of the tick that would have gone too far were not made, nor those that led there, nor those
    // that waited for the advance: 20 ms at 800 mm/s² before the turn are 13 steps, 40 ms 51.
    let waited = if configuration.extruder.pressure_advance_s > 0.0 {
        51
    } else {
        0
    };
    let stopped = host.counter.counts[0];
    assert!(
        (highest - 40 - waited..=highest).contains(&stopped),
        "{stopped} {highest}"
    );
    assert!((f64::from(fault.value) * 1e-4 - looked_at) > 0.0);
}

#[test]
fn a_motor_asked_for_more_than_a_step_a_tick_stops_the_machine() {
    let mut configuration = planar();
    // 40 mm/s and more: 320,000 steps a second.
    configuration.joints[0].steps_per_unit = 8000.0;
    let job = flower();
    let mut host = Host::new(&configuration, &job);
    for _ in 0..4000 {
        host.send(&job, 8, 16);
        host.tick();
    }
    assert_eq!(steps_of(&mut host, 500), 0);
    assert!(host.counter.steps > 1000);
    let fault = host.faults[0];
    assert_eq!((fault.cause, fault.index), (FaultCause::StepRate, 0));
    // Steps a second: just above 0.98 of the step rate.
    assert!((195_000..230_000).contains(&fault.value), "{fault:?}");
}

#[test]
fn a_latched_fault_is_reported_at_every_greeting() {
    let mut host = Host::new(&planar(), &flower());
    let hello = |session| {
        HostMessage::Hello(Hello {
            protocol_version: PROTOCOL_VERSION,
            schema_hash: SCHEMA_HASH,
            host_session: session,
        })
    };
    host.control(hello(20));
    host.poll();
    assert_eq!(host.faults, [], "there is none");
    let watchdog = Fault {
        cause: FaultCause::Watchdog,
        index: 0,
        value: 0,
    };
    host.machine.servo.motion_mut().fail_softly(watchdog);
    host.poll();
    assert_eq!(host.faults, [watchdog]);
    // A host that comes later has not heard it.
    for session in 21..24 {
        host.faults.clear();
        host.control(hello(session));
        host.poll();
        assert_eq!(host.faults, [watchdog], "greeting {session}");
        host.poll();
        assert_eq!(host.faults.len(), 1, "once");
    }
}

/// The input's stop on a board that reads it in the servo tick alone, while another fault's soft stop runs: it used to
/// be looked at only without a fault, and 327 steps followed.
#[test]
fn the_emergency_input_stops_within_a_tick_while_another_faults_soft_stop_runs() {
    let (configuration, job) = (planar(), flower());
    for shaped in [false, true] {
        let mut configuration = configuration.clone();
        if shaped {
            configuration.shapers[..2].fill(Shaper {
                kind: ShaperKind::Zv,
                frequency_hz: 40.0,
                damping: 0.1,
            });
        }
        let mut host = running(&configuration, &job, 3000);
        host.machine.servo.motion_mut().fail_softly(Fault {
            cause: FaultCause::Sequence,
            index: 0,
            value: 0,
        });
        let before = host.counter.steps;
        (0..20).for_each(|_| host.tick());
        assert!(host.counter.steps > before + 20, "the soft stop moves");
        host.machine.set_inputs(Inputs {
            switches: 0,
            emergency: true,
        });
        steps_of(&mut host, 1);
        assert_eq!(steps_of(&mut host, 1000), 0);
        // The first fault stays, and is cleared only once the input is released.
        assert_eq!(host.faults.len(), 1);
        host.control(HostMessage::Control(Control::ClearFault));
        steps_of(&mut host, 10);
        assert!(host.machine.motion().fault().is_some());
        host.machine.set_inputs(Inputs::default());
        host.control(HostMessage::Control(Control::ClearFault));
        steps_of(&mut host, 10);
        assert_eq!(host.machine.motion().fault(), None);
        // It does not know where it is.
        assert_eq!(host.machine.motion().referenced(), 0);
    }
}
