//! Goal: shaped joints ring as little as the shaper promises, follow its weighted mean, delay all motors
//! equally, and end on the exact counts whatever happens in between. Method: jobs through the machine; a
//! second-order model of a frame, driven by every step tick's counts, shares nothing with the shapers;
//! targets are compared with sums in f64.
use super::*;
use crate::configuration::shaping::{Shaper, ShaperKind};
use crate::steps::STEP;
use crate::steps::delay::Delays;
use crate::steps::shaping::{Shape, shapes};

const KINDS: [ShaperKind; 4] = [
    ShaperKind::Zv,
    ShaperKind::Mzv,
    ShaperKind::Ei,
    ShaperKind::Smooth,
];

fn shaped(kind: ShaperKind, frequency_hz: f64, damping: f64) -> MachineConfiguration {
    let mut configuration = planar();
    let shaper = |frequency_hz| Shaper {
        kind,
        frequency_hz,
        damping,
    };
    configuration.shapers[0] = shaper(frequency_hz);
    configuration.shapers[1] = shaper(1.37 * frequency_hz);
    configuration.shapers[3] = shaper(0.81 * frequency_hz);
    configuration.check().unwrap();
    configuration
}

/// Counts of the first joint at every step tick of a job.
fn counts_of(configuration: &MachineConfiguration, job: &Job) -> Vec<i64> {
    let mut host = Host::new(configuration, job);
    let mut counts = Vec::new();
    for _ in 0..20_000 {
        if host.machine.motion().state() == DeviceState::Finished {
            break;
        }
        host.send(job, 8, 16);
        host.machine.servo_tick();
        for _ in 0..100 {
            host.machine.step_tick(&mut host.counter);
            counts.push(host.counter.counts[0]);
        }
    }
    host.poll();
    assert_eq!(host.faults, []);
    counts
}

/// How far a frame of this frequency and damping swings once its drive rests, steps.
fn residual(counts: &[i64], frequency_hz: f64, damping: f64) -> f64 {
    const DT_S: f64 = 5e-6;
    let omega = core::f64::consts::TAU * frequency_hz;
    let end = counts[counts.len() - 1];
    let last = counts.iter().rposition(|count| *count != end).unwrap();
    let (mut x, mut v) = (counts[0] as f64, 0.0);
    for count in &counts[..last] {
        // Semi-implicit Euler: its error in amplitude is omega dt, one in a thousand.
        v += (omega * omega * (*count as f64 - x) - 2.0 * damping * omega * v) * DT_S;
        x += v * DT_S;
    }
    let off = x - end as f64;
    // The swing of a damped oscillator with this place and speed.
    let damped = omega * (1.0 - damping * damping).sqrt();
    let quadrature = (v + damping * omega * off) / damped;
    off.hypot(quadrature)
}

#[test]
fn a_frame_rings_little_at_its_frequency_and_beside_it() {
    // 1.8 mm in 60 ms, 2900 mm/s²: strong at 40 Hz. Fine steps, so that they are not what is seen.
    let fine = |mut configuration: MachineConfiguration| {
        configuration.joints[0].steps_per_unit = 800.0;
        configuration
    };
    let job = Job::of_curve(0.06, 6, |s| [1.8 * s / 0.06, 0.0, 0.2, 0.0, 0.0, 0.0, 0.0]);
    let plain = counts_of(&fine(planar()), &job);
    for damping in [0.0, 0.05, 0.1] {
        for kind in KINDS {
            let counts = counts_of(&fine(shaped(kind, 40.0, damping)), &job);
            let share = |factor: f64| {
                let frequency_hz = 40.0 * factor;
                let left = residual(&counts, frequency_hz, damping);
                left / residual(&plain, frequency_hz, damping)
            };
            let [low, tuned, high] = [0.85, 1.0, 1.15].map(share);
            std::println!("{kind:?} {damping}: {low:.3} {tuned:.3} {high:.3}");
            // EI leaves its 5 % by design, a step in 300 is what counts are worth here.
            assert!(tuned <= 0.053, "{kind:?} {damping}: {tuned}");
            // ZV leaves |cos(0.5 pi 1.15)| = 0.234 by its nature, and says so.
            let bound = if kind == ShaperKind::Zv { 0.26 } else { 0.2 };
            assert!(low <= bound && high <= bound, "{kind:?} {low} {high}");
        }
    }
    let rings = residual(&plain, 40.0, 0.0);
    std::println!("unshaped {rings:.1} steps");
    assert!(rings > 30.0, "{rings}");
}

/// Targets of all motors, steps, at every servo tick from the stream's start.
fn targets_of(configuration: &MachineConfiguration, job: &Job) -> Vec<[f64; 8]> {
    let mut host = Host::new(configuration, job);
    let mut targets = Vec::new();
    for _ in 0..20_000 {
        if host.machine.motion().state() == DeviceState::Finished {
            break;
        }
        host.send(job, 8, 16);
        host.tick();
        if host.machine.motion().stream_start_ticks().is_some() {
            let now = host.machine.motion().targets();
            targets.push(now.map(|position| position as f64 / STEP as f64));
        }
    }
    host.poll();
    assert_eq!(host.faults, []);
    targets
}

#[test]
fn shaped_targets_are_the_mean_that_the_shaper_says_and_all_wait_alike() {
    let job = flower();
    let plain = targets_of(&planar(), &job);
    let before = Delays::of(&planar()).unwrap().line_ticks as usize;
    for kind in KINDS {
        let configuration = shaped(kind, 43.0, 0.07);
        let delays = Delays::of(&configuration).unwrap();
        let line = delays.line_ticks as usize;
        let came = targets_of(&configuration, &job);
        // Where the plan is at a tick, not whole, that long before this one.
        let plan = |tick: usize, back: f64, motor: usize| {
            let at = (tick + before) as f64 - back;
            let (low, part) = (at.floor().max(0.0) as usize, at - at.floor());
            let last = plain.len() - 1;
            let place = |tick: usize| plain[tick.min(last)][motor];
            place(low) + part * (place(low + 1) - place(low))
        };
        let shapes = shapes(&configuration);
        let mut worst = 0.0f64;
        for tick in 260..came.len() {
            for motor in 0..5 {
                let expected = match shapes.get(motor).and_then(Option::as_ref) {
                    None => plain[(tick + before - line).min(plain.len() - 1)][motor],
                    Some(Shape::Impulses(impulses)) => {
                        let shift: f64 = impulses.iter().map(|(a, t)| a * t).sum();
                        let mean = impulses.iter().map(|(weight, ticks)| {
                            weight * plan(tick, ticks - shift + line as f64, motor)
                        });
                        mean.sum()
                    }
                    Some(Shape::Averages(ticks)) => {
                        let (mut sum, count) = (0.0, *ticks as usize);
                        for first in 0..count {
                            for second in 0..count {
                                let back = (line + first + second + 1 - count) as f64;
                                sum += plan(tick, back, motor);
                            }
                        }
                        sum / (count * count) as f64
                    }
                };
                worst = worst.max((came[tick][motor] - expected).abs());
            }
        }
        // 2^-22 steps, rounded down in the plan and in the sum.
        assert!(worst < 4e-6, "{kind:?}: {worst}");
    }
}

#[test]
fn shaped_jobs_end_on_the_exact_counts_whatever_happens() {
    for kind in KINDS {
        for (mut configuration, job) in [(planar(), flower()), (gantry(), tilted_flower())] {
            for (joint, shaper) in configuration.shapers.iter_mut().enumerate().take(6) {
                *shaper = Shaper {
                    kind,
                    frequency_hz: 31.0 + 7.3 * joint as f64,
                    damping: 0.1,
                };
            }
            configuration.check().unwrap();
            let mut host = Host::new(&configuration, &job);
            for tick in 0..200_000 {
                // A queue that runs dry in between, a pause, an override.
                if tick % 3000 < 2000 {
                    host.send(&job, 8, 16);
                }
                match tick {
                    1500 => host.control(HostMessage::Control(Control::Pause)),
                    2500 => host.control(HostMessage::Control(Control::Resume)),
                    3500 => host.control(HostMessage::Control(Control::Override(140))),
                    _ => {}
                }
                host.tick();
                if host.machine.motion().state() == DeviceState::Finished {
                    break;
                }
            }
            let motion = host.machine.motion();
            assert_eq!(
                motion.state(),
                DeviceState::Finished,
                "{:?}",
                motion.fault()
            );
            // It is an end only once nothing is on its way: no step comes after it.
            let steps = host.counter.steps;
            (0..400).for_each(|_| host.tick());
            assert_eq!(host.counter.steps, steps);
            host.poll();
            assert_eq!(host.faults, []);
            let motors = configuration.joints.len() + 1;
            let expected = final_steps(&configuration, &job);
            assert_eq!(host.counter.counts[..motors], expected);
            assert_eq!(host.counter.counts, host.machine.motion().counts());
            assert!(host.machine.motion().holds() > 0);
        }
    }
}

#[test]
fn a_stop_at_once_knows_where_shaped_motors_are() {
    let configuration = shaped(ShaperKind::Ei, 30.0, 0.1);
    let job = flower();
    for stop_tick in (1000..7000).step_by(377) {
        let mut host = Host::new(&configuration, &job);
        for _ in 0..stop_tick {
            host.send(&job, 8, 16);
            host.tick();
            let motion = host.machine.motion();
            if motion.now_ticks().is_multiple_of(50) {
                // What is told while it moves is what was stepped, but for the interval being played.
                for (told, is) in motion.counts().iter().zip(host.counter.counts) {
                    assert!((told - is).abs() <= 30, "{told} {is}");
                }
            }
        }
        host.machine.fail_at_once(crate::motion::EMERGENCY);
        (0..10).for_each(|_| host.tick());
        assert_eq!(host.counter.counts, host.machine.motion().counts());
    }
}

#[test]
fn shapers_that_do_not_fit_are_refused() {
    use crate::configuration::ConfigurationError;
    let check = |joint: usize, kind, frequency_hz, damping| {
        let mut configuration = planar();
        configuration.shapers[joint] = Shaper {
            kind,
            frequency_hz,
            damping,
        };
        configuration.check()
    };
    for (kind, lowest_hz) in [
        (ShaperKind::Zv, 5.0),
        (ShaperKind::Mzv, 8.0),
        (ShaperKind::Ei, 11.0),
        (ShaperKind::Smooth, 17.0),
    ] {
        assert_eq!(check(1, kind, lowest_hz, 0.1), Ok(()), "{kind:?}");
        let refused = Err(ConfigurationError::Shaper(1));
        assert_eq!(check(1, kind, 0.4 * lowest_hz, 0.1), refused, "{kind:?}");
        for (frequency_hz, damping) in [
            (0.0, 0.1),
            (f64::NAN, 0.1),
            (f64::INFINITY, 0.1),
            (1e-300, 0.0),
            (501.0, 0.1),
            (40.0, -0.1),
            (40.0, 0.6),
            (40.0, f64::NAN),
        ] {
            assert_eq!(check(1, kind, frequency_hz, damping), refused);
        }
    }
}
