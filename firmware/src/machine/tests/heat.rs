//! Goal: a stream waits at rest for its heaters, a heater's fault brings the head to rest on the path and
//! retracts the melt, and only the host that streams can heat. Method: the heat loop with the machine on
//! a heater of one mass.
use super::*;
use crate::configuration::heat::HeatConfiguration;
use crate::heat::Outputs;
use crate::heat::service::HeatService;
use crate::heat::tests::counts;

#[path = "cold.rs"]
mod cold;

/// A machine with a hot end and a bed.
struct Hot {
    host: Host,
    service: HeatService,
    outputs: Outputs,
    celsius: [f32; 2],
    /// The hot end's sensor is broken.
    open: bool,
}

impl Hot {
    fn new(celsius: f32) -> Self {
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

    fn heat(&mut self, heater: u8, decidegrees: u16, wait: bool) {
        self.host.control(HostMessage::Control(Control::Heat {
            heater,
            decidegrees,
            wait,
        }));
        self.host.poll();
    }

    /// Some servo ticks, as a board's main loop and interrupts make them.
    fn run(&mut self, ticks: u32) {
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
    let mut hot = Hot::new(200.0);
    hot.heat(0, 2000, false);
    for _ in 0..15 {
        hot.host.send(&job, 8, 16);
        hot.run(200);
    }
    assert_eq!(hot.host.machine.motion().state(), DeviceState::Running);
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
    // Nobody is heard any more.
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
