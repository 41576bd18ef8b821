//! Goal: a stream waits at rest for its heaters, a heater's fault brings the head to rest on the path and
//! retracts the melt, and only the host that streams can heat. Method: the heat loop with the machine on
//! a heater of one mass.
use super::*;
use crate::configuration::heat::HeatConfiguration;
use crate::design::MOTORS_IDLE_S;
use crate::heat::Outputs;
use crate::heat::service::HeatService;
use crate::heat::tests::counts;

#[path = "cold.rs"]
mod cold;

/// A machine with a hot end and a bed.
pub(super) struct Hot {
    pub(super) host: Host,
    service: HeatService,
    outputs: Outputs,
    celsius: [f32; 2],
    /// The hot end's sensor is broken.
    open: bool,
}

impl Hot {
    pub(super) fn new(celsius: f32) -> Self {
        let (configuration, job) = (planar(), flower());
        let mut host = Host::new(&configuration, &job);
        let heat = HeatConfiguration::standard();
        let service = HeatService::new(&configuration, &heat, host.machine.servo.motion_mut());
        Self {
            host,
            service,
            outputs: Outputs::default(),
            celsius: [celsius, 25.0],
            open: false,
        }
    }

    /// In mid job, its hot end at 200 °C.
    pub(super) fn printing() -> Self {
        let job = flower();
        let mut hot = Self::new(200.0);
        hot.heat(0, 2000, false);
        for _ in 0..15 {
            hot.host.send(&job, 8, 16);
            hot.run(200);
        }
        assert_eq!(hot.host.machine.motion().state(), DeviceState::Running);
        hot
    }

    pub(super) fn heat(&mut self, heater: u8, decidegrees: u16, wait: bool) {
        self.host.control(HostMessage::Control(Control::Heat {
            heater,
            decidegrees,
            wait,
        }));
        self.host.poll();
    }

    /// Some servo ticks, as a board's main loop and interrupts make them.
    pub(super) fn run(&mut self, ticks: u32) {
        for _ in 0..ticks {
            self.host.tick();
            let motion = self.host.machine.servo.motion_mut();
            if motion.now_ticks().is_multiple_of(4) {
                for heater in 0..2 {
                    let sensor = self.service.heat().configuration(heater).unwrap().sensor;
                    let raw = counts(&sensor, self.celsius[heater]).round() as u16;
                    // Noise of a count.
                    let noise = (motion.now_ticks() / 4 % 2) as u16;
                    let open = self.open && heater == 0;
                    self.service
                        .sample(heater, if open { 4095 } else { raw + noise });
                }
            }
            if let Some(outputs) = self.service.serve(motion, 0) {
                self.outputs = outputs;
                let watts = self.outputs.duties[0] * 40.0 - 0.068 * (self.celsius[0] - 25.0);
                self.celsius[0] += watts / 16.7 * crate::configuration::heat::PERIOD_S;
            }
        }
        self.host.poll();
    }
}

#[test]
fn a_stream_waits_at_rest_until_its_heater_is_there() {
    let job = flower();
    let mut hot = Hot::new(170.0);
    hot.heat(0, 2000, true);
    hot.host.send(&job, 8, 16);
    hot.run(4000);
    assert_eq!(hot.host.state, DeviceState::Heating);
    assert_eq!(hot.host.counter.steps, 0);
    assert!(hot.celsius[0] > 172.0);
    for _ in 0..400 {
        hot.host.send(&job, 8, 16);
        hot.run(200);
    }
    assert_eq!(hot.host.machine.motion().state(), DeviceState::Finished);
    // The melt that is fed forward takes nothing along here.
    assert!((hot.celsius[0] - 200.0).abs() < 5.0, "{}", hot.celsius[0]);
    assert_eq!(hot.host.faults, []);
    assert_eq!(hot.host.refusals, []);
}

#[test]
fn a_broken_sensor_brings_the_head_to_rest_and_pulls_the_melt_back() {
    let job = flower();
    let mut hot = Hot::printing();
    hot.open = true;
    let mut latched = None;
    for tick in 0..3000 {
        hot.run(1);
        if !hot.host.faults.is_empty() && latched.is_none() {
            // The motors run on: it is no stop between two steps.
            assert!(!hot.host.machine.motion().is_at_rest());
            latched = Some((tick, hot.host.machine.motion().counts()[4]));
        }
    }
    let (latched_ticks, _) = latched.unwrap();
    assert!(latched_ticks < 1000, "{latched_ticks}");
    assert_eq!(hot.host.faults[0].cause, FaultCause::SensorOpen);
    assert_eq!(hot.outputs.duties, [0.0; 3]);
    assert!(hot.host.machine.motion().is_at_rest());
    assert_eq!(hot.host.state, DeviceState::Faulted);
    assert_eq!(hot.host.counter.counts, hot.host.machine.motion().counts());
    // What was primed is pulled back: the extruder is behind its furthest place by that.
    let motion = hot.host.machine.motion();
    let deposited = motion.spans_done();
    assert!(deposited > 0);
    let primed = job.events[0].volume_units as f64 * 1e-6;
    assert!(primed > 0.0);
    // A target is refused until the fault is cleared; then the sensor is looked at anew.
    hot.heat(0, 2000, false);
    assert_eq!(hot.host.refusals, [RefusalReason::Faulted]);
    hot.host.control(HostMessage::Control(Control::ClearFault));
    hot.open = false;
    hot.run(2000);
    assert_eq!(hot.host.machine.motion().fault(), None);
    hot.heat(0, 2000, false);
    hot.run(1000);
    assert!(hot.outputs.duties[0] > 0.0);
}

#[test]
fn melt_is_pulled_back_once_and_by_what_was_primed() {
    // The same stop twice: with a heater's fault, and with one after which nothing may be moved.
    let job = flower();
    let extruded = |cause: FaultCause| {
        let mut hot = Hot::new(200.0);
        for _ in 0..15 {
            hot.host.send(&job, 8, 16);
            hot.run(200);
        }
        hot.host.machine.servo.motion_mut().fail_softly(Fault {
            cause,
            index: 0,
            value: 0,
        });
        hot.run(6000);
        assert!(hot.host.machine.motion().is_at_rest());
        hot.host.machine.motion().counts()[4]
    };
    let back = extruded(FaultCause::Sequence) - extruded(FaultCause::HostSilent);
    let primed_mm3 = f64::from(job.events[0].volume_units) * 1e-6;
    let expected = primed_mm3 * planar().extruder.steps_per_mm3;
    assert!(
        (back as f64 - expected).abs() <= 1.0,
        "{back} of {expected}"
    );
}

#[test]
fn a_heaters_fault_after_an_abort_leaves_the_machine_free() {
    let job = flower();
    let mut hot = Hot::new(200.0);
    for _ in 0..15 {
        hot.host.send(&job, 8, 16);
        hot.run(200);
    }
    hot.host.control(HostMessage::Control(Control::Abort));
    hot.run(2000);
    assert_eq!(hot.host.machine.motion().state(), DeviceState::Idle);
    hot.host.control(HostMessage::Control(Control::MotorsOff));
    hot.host.machine.servo.motion_mut().fail_softly(Fault {
        cause: FaultCause::HostSilent,
        index: 0,
        value: 30,
    });
    hot.run(1000);
    hot.host.control(HostMessage::Control(Control::ClearFault));
    hot.run(10);
    hot.host
        .control(HostMessage::Control(Control::SetPosition(job.start)));
    hot.host.poll();
    assert_eq!(hot.host.refusals, []);
}

#[test]
fn only_what_is_there_can_be_heated_and_only_by_who_streams() {
    let mut hot = Hot::new(25.0);
    hot.heat(0, 2751, false);
    hot.heat(2, 500, false);
    assert_eq!(hot.host.refusals, [RefusalReason::Invalid; 2]);
    hot.heat(0, 2750, false);
    hot.run(500);
    assert_eq!(hot.host.refusals.len(), 2);
    assert!(hot.outputs.duties[0] > 0.9);
    // Nobody is heard any more, and no stream is open.
    hot.host.control(HostMessage::Control(Control::Abort));
    hot.run(62_000);
    assert_eq!(hot.host.faults[0].cause, FaultCause::HostSilent);
    assert_eq!(hot.outputs.duties, [0.0; 3]);

    let (configuration, job) = (planar(), flower());
    let mut bare = Host::new(&configuration, &job);
    bare.control(HostMessage::Control(Control::Fan(500)));
    bare.control(HostMessage::Control(Control::Heat {
        heater: 0,
        decidegrees: 500,
        wait: true,
    }));
    bare.poll();
    assert_eq!(bare.refusals, [RefusalReason::Invalid; 2]);
}

/// A pause of more than a minute resumed cold: standby had lowered the target, and the wait for it was forgotten.
/// The same where the target is ordered anew in the pause, with and without a wait, higher and lower.
#[test]
fn what_the_board_has_lowered_is_waited_for_when_a_pause_ends() {
    let job = flower();
    for order in [
        None,
        Some((2200, false)),
        Some((2100, true)),
        Some((1900, false)),
    ] {
        let mut hot = Hot::new(200.0);
        hot.heat(0, 2000, true);
        for _ in 0..15 {
            hot.host.send(&job, 8, 16);
            hot.run(200);
        }
        assert_eq!(hot.host.machine.motion().state(), DeviceState::Running);
        hot.host.control(HostMessage::Control(Control::Pause));
        for _ in 0..60 {
            // The host lives.
            hot.host
                .control(HostMessage::Control(Control::StatusRequest));
            hot.run(2 * 2000);
        }
        assert!(hot.celsius[0] < 180.0, "standby: {}", hot.celsius[0]);
        let asked_c = order.map_or(200.0, |(decidegrees, _)| f32::from(decidegrees) / 10.0);
        if let Some((decidegrees, wait)) = order {
            hot.heat(0, decidegrees, wait);
        }
        hot.host.control(HostMessage::Control(Control::Resume));
        let mut steps = hot.host.counter.steps;
        let mut moved = 0;
        for tick in 0..200_000 {
            if tick % 2000 == 0 {
                hot.host
                    .control(HostMessage::Control(Control::StatusRequest));
            }
            hot.host.send(&job, 8, 16);
            hot.run(1);
            if hot.host.counter.steps != steps {
                steps = hot.host.counter.steps;
                moved += 1;
                assert!(
                    hot.celsius[0] > asked_c - 5.0,
                    "{} of {asked_c}",
                    hot.celsius[0]
                );
            } else if moved == 0 {
                assert_ne!(hot.host.machine.motion().state(), DeviceState::Running);
            }
            if hot.host.machine.motion().state() == DeviceState::Finished {
                break;
            }
        }
        assert_eq!(
            hot.host.machine.motion().state(),
            DeviceState::Finished,
            "{order:?}"
        );
        assert!(moved > 1000);
        assert_eq!(hot.host.faults, []);
        assert_eq!(hot.host.counter.counts[..5], final_steps(&planar(), &job));
    }
}

/// A host that sleeps: after 30 s of silence heaters are off and nothing is latched; the head rests on the path, its
/// motors on, for as long as it takes. Who comes back orders the targets, and the job ends as if nothing had been.
#[test]
fn a_print_outlives_the_silence_of_its_host() {
    let job = flower();
    let mut hot = Hot::new(200.0);
    hot.heat(0, 2000, false);
    hot.heat(1, 300, false);
    for _ in 0..15 {
        hot.host.send(&job, 8, 16);
        hot.run(200);
    }
    assert_eq!(hot.host.machine.motion().state(), DeviceState::Running);
    hot.run(31 * 2000);
    let motion = hot.host.machine.motion();
    assert_eq!(
        (motion.state(), motion.fault()),
        (DeviceState::Heating, None)
    );
    assert!(!motion.heat().is_on() && motion.is_at_rest() && motion.drivers_on());
    let steps = hot.host.counter.steps;
    hot.run((MOTORS_IDLE_S + 60) * 2000);
    let motion = hot.host.machine.motion();
    assert_eq!(
        (motion.state(), motion.fault()),
        (DeviceState::Heating, None)
    );
    assert!(motion.drivers_on() && motion.referenced() != 0);
    assert!(hot.celsius[0] < 60.0 && hot.host.counter.steps == steps);
    // One target is not all.
    hot.heat(0, 2000, false);
    for _ in 0..30 {
        hot.host
            .control(HostMessage::Control(Control::StatusRequest));
        hot.run(2000);
    }
    assert_eq!(hot.host.machine.motion().state(), DeviceState::Heating);
    assert_eq!(hot.host.counter.steps, steps);
    // The bed is told to stay off.
    hot.heat(1, 0, false);
    for _ in 0..1500 {
        hot.host
            .control(HostMessage::Control(Control::StatusRequest));
        hot.host.send(&job, 8, 16);
        hot.run(200);
    }
    assert_eq!(hot.host.machine.motion().state(), DeviceState::Finished);
    assert_eq!(hot.host.faults, []);
    assert_eq!(hot.host.counter.counts[..5], final_steps(&planar(), &job));
}
