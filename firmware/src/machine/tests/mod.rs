//! Goal: bytes in, steps out: the steps are those of the spline that was sent, counts end exactly,
//! an empty queue, pauses and overrides never leave the path or the limits, faults stop everything.
//! Method: a small host that obeys credits, a recorder of every step, the f64 spline as oracle.
use super::*;
use crate::configuration::flow_curves::FlowCurves;
use crate::configuration::motors::MotorMatrix;
use crate::configuration::shaping::UNSHAPED;
use crate::configuration::{ExtruderConfiguration, JointConfiguration, Kinematics};
use crate::design::SERVO_DELAY_TICKS;
use crate::path::spline::{Span, Spans};
use headway_protocol::frame::{FRAME_BYTES_MAX, FrameDecoder, encode_frame, hash_of};
use headway_protocol::knot_block::{KnotPredictor, encode_block};
use headway_protocol::message::{
    Ack, Control, DeviceMessage, DeviceState, FaultCause, Finish, Hello, HostMessage,
    PROTOCOL_VERSION, RefusalReason, SCHEMA_HASH, Start,
};
use headway_protocol::segment::{FlowAction, FlowEvent, Knot};
use headway_protocol::units::{CHANNELS, ChannelPoint, Ticks, Units, to_units};
use std::vec::Vec;

fn joint(rotary: bool, steps_per_unit: f64, speed: f64, acceleration: f64) -> JointConfiguration {
    JointConfiguration {
        rotary,
        steps_per_unit,
        position_min: if rotary { -1e4 } else { -500.0 },
        position_max: if rotary { 1e4 } else { 500.0 },
        speed_max: speed,
        acceleration_max: acceleration,
        jerk_max: 1e6,
    }
}

fn planar() -> MachineConfiguration {
    let mut joints = heapless::Vec::new();
    let c = joint(true, 3200.0 / core::f64::consts::TAU * 5.0, 30.0, 800.0);
    for joint in [
        joint(false, 80.0, 200.0, 3000.0),
        joint(false, 80.0, 200.0, 3000.0),
        joint(false, 400.0, 20.0, 200.0),
        c,
    ] {
        joints.push(joint).unwrap();
    }
    MachineConfiguration {
        kinematics: Kinematics::Planar,
        joints,
        shapers: UNSHAPED,
        extruder: ExtruderConfiguration {
            steps_per_mm3: 400.0,
            speed_max_mm3_s: 60.0,
            acceleration_max_mm3_s2: 3000.0,
            pressure_advance_s: 0.03,
            pressure_advance_window_ms: 40.0,
        },
        servo_hz: 2000,
        step_hz: 200_000,
        motors: MotorMatrix::DIRECT,
        curves: FlowCurves::NONE,
    }
}

fn gantry() -> MachineConfiguration {
    let mut configuration = planar();
    configuration.kinematics = Kinematics::Gantry {
        pivot_length_mm: 60.0,
    };
    configuration.joints.truncate(3);
    // The tilting head of the tests swings its pivot.
    for joint in &mut configuration.joints {
        joint.speed_max *= 2.0;
        joint.acceleration_max *= 3.0;
    }
    for rotary in 0..3 {
        let limit = if rotary == 2 { 800.0 } else { 400.0 };
        configuration
            .joints
            .push(joint(true, 2000.0, 30.0, limit))
            .unwrap();
    }
    configuration
}

/// A job in natural units.
struct Job {
    start: ChannelPoint,
    knots: Vec<Knot>,
    events: Vec<FlowEvent>,
    units: Units,
}

impl Job {
    /// Samples of `curve` (s -> channels) every `step_ticks` as control points, rests around it.
    fn of_curve(seconds: f64, step_ticks: u16, curve: impl Fn(f64) -> [f64; CHANNELS]) -> Self {
        let dt = f64::from(step_ticks) / 2000.0;
        let count = (seconds / dt) as usize;
        let start = to_units(&curve(0.0));
        let mut knots: Vec<Knot> = (0..40).map(|_| rest(start, step_ticks)).collect();
        // The parameter eases in and out, so that the control polygon starts and ends at rest.
        let ease = |x: f64| x * x * x * (10.0 - 15.0 * x + 6.0 * x * x);
        for i in 0..=count {
            let s = ease(i as f64 / count as f64) * seconds;
            knots.push(rest(to_units(&curve(s)), step_ticks));
        }
        let end = to_units(&curve(seconds));
        knots.extend((0..40).map(|_| rest(end, step_ticks)));
        let event = |span, action| FlowEvent {
            span,
            offset_ticks: 3,
            action,
            volume_units: 800_000,
            duration_ticks: Ticks(120),
        };
        let last = (knots.len() - 30) as u32;
        Self {
            start,
            knots,
            events: std::vec![
                event(2, FlowAction::Prime),
                event(last, FlowAction::Retract)
            ],
            units: Units::BASE,
        }
    }

    fn spans(&self) -> Vec<Span> {
        Spans::new(&self.start, &self.knots, self.units).collect()
    }
}

fn rest(control: ChannelPoint, duration_ticks: u16) -> Knot {
    Knot {
        control,
        duration_ticks,
    }
}

/// A flower with a turning nozzle: 3 s at about 40 mm/s.
fn flower() -> Job {
    Job::of_curve(4.0, 12, |s| {
        let a = s * core::f64::consts::TAU / 4.0;
        let r = 20.0 + 3.0 * (5.0 * a).cos();
        let volume = 8.0 * s;
        [
            r * a.cos(),
            r * a.sin(),
            0.2,
            0.0,
            0.0,
            a + 0.4 * (5.0 * a).sin(),
            volume,
        ]
    })
}

fn tilted_flower() -> Job {
    Job::of_curve(3.0, 10, |s| {
        let a = s * core::f64::consts::TAU / 3.0;
        let tilt = 0.3 * (1.0 - a.cos());
        [
            20.0 * a.cos(),
            20.0 * a.sin(),
            5.0 + 2.0 * a.sin(),
            -tilt * a.sin(),
            tilt * a.cos(),
            2.0 * a,
            8.0 * s,
        ]
    })
}

/// Follows every step.
#[derive(Default)]
struct Counter {
    counts: [i64; 8],
    directions: u8,
    steps: u64,
    digest: u64,
}

impl StepOutput for Counter {
    fn set_directions(&mut self, directions: u8) {
        self.directions = directions;
    }
    fn step(&mut self, tick: u64, motors: u8) {
        for motor in 0..8 {
            if motors >> motor & 1 == 1 {
                let up = self.directions >> motor & 1 == 1;
                self.counts[motor] += if up { 1 } else { -1 };
                self.steps += 1;
                let word = tick << 4 | (motor as u64) << 1 | u64::from(up);
                self.digest = (self.digest ^ word).wrapping_mul(0x0100_0000_01b3);
            }
        }
    }
}

/// A host without a line: every byte arrives; it obeys credits.
struct Host {
    machine: Machine,
    counter: Counter,
    decoder: FrameDecoder,
    sequence: u16,
    stream_sequence: u16,
    ack: Option<Ack>,
    state: DeviceState,
    statuses: u32,
    faults: Vec<Fault>,
    refusals: Vec<RefusalReason>,
    predictor: KnotPredictor,
    knots_sent: usize,
    events_sent: usize,
    finished: bool,
    way: Way,
}

/// How a host runs its machine.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Way {
    /// Whole intervals at once.
    Fast,
    /// Step by step.
    Ticks,
    /// With a main loop that is late once the stream runs: servo ticks prepare spans themselves.
    Late,
}

/// Servo ticks between two rounds of a main loop that is late: longer than what is prepared lasts.
const LATE_TICKS: u64 = 170;

impl Host {
    fn new(configuration: &MachineConfiguration, job: &Job) -> Self {
        let mut host = Self::greet(Machine::new(configuration, 77).unwrap(), job);
        host.control(HostMessage::Start(Start {
            job: 1,
            machine_hash: configuration.hash(),
            first_sequence: 500,
            position: job.start,
            solution: configuration.kinematics.solution(),
            units: job.units,
        }));
        host.poll();
        assert!(host.ack.is_some());
        host.counter.counts = host.machine.motion().counts();
        host
    }

    /// Says hello; no stream is open.
    fn greet(machine: Machine, job: &Job) -> Self {
        let mut host = Self {
            machine,
            counter: Counter::default(),
            decoder: FrameDecoder::new(),
            sequence: 0,
            stream_sequence: 500,
            ack: None,
            state: DeviceState::Idle,
            statuses: 0,
            faults: Vec::new(),
            refusals: Vec::new(),
            predictor: KnotPredictor::new(job.start),
            knots_sent: 0,
            events_sent: 0,
            finished: false,
            way: Way::Fast,
        };
        host.control(HostMessage::Hello(Hello {
            protocol_version: PROTOCOL_VERSION,
            schema_hash: SCHEMA_HASH,
            host_session: 5,
        }));
        host.poll();
        host
    }

    fn control(&mut self, message: HostMessage<'_>) {
        self.sequence += 1;
        self.write(self.sequence, &message);
    }

    fn stream(&mut self, message: HostMessage<'_>) {
        self.write(self.stream_sequence, &message);
        self.stream_sequence = self.stream_sequence.wrapping_add(1);
    }

    fn write(&mut self, sequence: u16, message: &HostMessage<'_>) {
        let mut frame = [0; FRAME_BYTES_MAX];
        let length = encode_frame(sequence, message, &mut frame).unwrap();
        self.machine.handle_bytes(&frame[..length]);
    }

    fn poll(&mut self) {
        let mut out = [0; FRAME_BYTES_MAX];
        loop {
            let length = self.machine.poll_report(&mut out);
            if length == 0 {
                return;
            }
            for &byte in &out[..length] {
                let Some(frame) = self.decoder.push(byte) else {
                    continue;
                };
                match DeviceMessage::decode(frame.unwrap().payload).unwrap() {
                    DeviceMessage::Ack(ack) => self.ack = Some(ack),
                    DeviceMessage::Status(status) => {
                        self.state = status.state;
                        self.statuses += 1;
                    }
                    DeviceMessage::Fault(fault) => self.faults.push(fault),
                    DeviceMessage::Welcome(welcome) => assert_eq!(welcome.session, 77),
                    DeviceMessage::Nak(ack) => self.ack = Some(ack),
                    DeviceMessage::Refused(refusal) => self.refusals.push(refusal.reason),
                    DeviceMessage::Measured(_) | DeviceMessage::Crash(_) => {}
                }
            }
        }
    }

    /// Sends as much as the credits allow, at most `blocks` blocks of up to `per_block` knots.
    fn send(&mut self, job: &Job, blocks: usize, per_block: usize) {
        for _ in 0..blocks {
            self.poll();
            let ack = self.ack.unwrap();
            let room = (ack.knot_limit as usize).saturating_sub(self.knots_sent);
            let end = job.knots.len().min(self.knots_sent + room.min(per_block));
            if end == self.knots_sent {
                break;
            }
            while let Some(event) = job.events.get(self.events_sent)
                && (event.span as usize) < end
            {
                self.stream(HostMessage::Flow(*event));
                self.events_sent += 1;
            }
            let block = &job.knots[self.knots_sent..end];
            let (bytes, count) = encode_block(&mut self.predictor, block);
            self.stream(HostMessage::Knots(&bytes));
            self.knots_sent += count;
        }
        if self.knots_sent == job.knots.len() && !self.finished {
            self.finished = true;
            self.stream(HostMessage::Finish(Finish {
                knots: self.knots_sent as u32,
                events: self.events_sent as u32,
            }));
        }
    }

    fn tick(&mut self) {
        let machine = &mut self.machine;
        match self.way {
            Way::Fast => machine.run_servo_interval(&mut self.counter),
            Way::Ticks => {
                machine.servo_tick();
                (0..100).for_each(|_| machine.step_tick(&mut self.counter));
            }
            Way::Late => {
                let bank = machine.player.idle_bank();
                assert!(machine.servo.motion_mut().tick(bank));
                machine.player.hand_over();
                let runs = machine.motion().state() == DeviceState::Running;
                if !runs || machine.motion().now_ticks().is_multiple_of(LATE_TICKS) {
                    machine.servo.motion_mut().look_ahead();
                }
                machine.run_step_interval(&mut self.counter);
            }
        }
    }

    /// Runs with a full queue until the stream has ended.
    fn run(&mut self, job: &Job) -> u32 {
        for tick in 0..200_000 {
            self.send(job, 8, 16);
            self.tick();
            if self.machine.motion().state() == DeviceState::Finished {
                for _ in 0..SERVO_DELAY_TICKS {
                    self.tick();
                }
                self.poll();
                return tick;
            }
        }
        panic!(
            "the stream never ended: {:?} {:?}",
            self.machine.motion().state(),
            self.machine.motion().fault()
        );
    }
}

/// Joints (mm, rad) and volume of a pose, by the f64 kinematics.
fn exact(configuration: &MachineConfiguration, natural: &[f64; CHANNELS]) -> [f64; 8] {
    let pose = crate::kinematics::pose::Pose::from_channels(natural);
    let joints = crate::kinematics::inverse(&configuration.kinematics, &pose).unwrap();
    let mut steps = [0.0; 8];
    for (index, joint) in configuration.joints.iter().enumerate() {
        steps[index] = joints.position[index] * joint.steps_per_unit;
    }
    steps[joints.count] = natural[6] * configuration.extruder.steps_per_mm3;
    steps
}

fn final_steps(configuration: &MachineConfiguration, job: &Job) -> Vec<i64> {
    let last = job.knots.last().unwrap().control;
    let natural = job.units.to_natural(&last);
    let motors = configuration.joints.len() + 1;
    exact(configuration, &natural)[..motors]
        .iter()
        .map(|steps| (steps + 0.5).floor() as i64)
        .collect()
}

#[test]
fn a_stream_ends_on_the_exact_counts_however_it_is_run() {
    for (configuration, job) in [(planar(), flower()), (gantry(), tilted_flower())] {
        let mut digests = Vec::new();
        for way in [Way::Fast, Way::Ticks, Way::Late] {
            let mut host = Host::new(&configuration, &job);
            host.way = way;
            host.run(&job);
            assert_eq!(host.faults, []);
            let motors = configuration.joints.len() + 1;
            assert_eq!(
                host.counter.counts[..motors],
                final_steps(&configuration, &job)
            );
            assert_eq!(host.counter.counts, host.machine.motion().counts());
            assert_eq!(host.machine.motion().underruns(), 0);
            assert_eq!(host.machine.motion().holds(), 0);
            assert!(host.counter.steps > 20_000);
            digests.push(host.counter.digest);
        }
        assert!(digests.iter().all(|digest| *digest == digests[0]));
    }
}

#[test]
fn step_positions_follow_the_spline_with_a_constant_delay() {
    for (configuration, job) in [(planar(), flower()), (gantry(), tilted_flower())] {
        let spans = job.spans();
        let mut host = Host::new(&configuration, &job);
        let mut worst = [0.0f64; 8];
        let mut compared = 0;
        for tick in 0u64..20_000 {
            host.send(&job, 8, 16);
            host.tick();
            let Some(start) = host.machine.motion().stream_start_ticks() else {
                continue;
            };
            // Counts now are those at the end of servo tick `tick`, whose poses lag by the delay.
            let delay_ticks = SERVO_DELAY_TICKS + host.machine.motion().delay_ticks();
            let Some(u) = (tick + 1).checked_sub(start + u64::from(delay_ticks)) else {
                continue;
            };
            let Some(span) = spans.iter().rfind(|s| s.start_tick <= u) else {
                continue;
            };
            if u > span.start_tick + u64::from(span.duration_ticks) {
                break;
            }
            let at = exact(&configuration, &span.position((u - span.start_tick) as f64));
            for (joint, steps) in at.iter().enumerate().take(configuration.joints.len()) {
                worst[joint] = worst[joint].max((host.counter.counts[joint] as f64 - steps).abs());
            }
            compared += 1;
        }
        assert!(compared > 3000);
        for (joint, worst) in worst.iter().enumerate().take(configuration.joints.len()) {
            // Half a step, and what a speed of a step in a few ticks makes of half a tick.
            assert!(*worst < 0.75, "joint {joint}: {worst} steps");
        }
        assert!(worst[0] > 0.4);
    }
}

mod warp;

mod advance;
mod endless;
mod fault;
mod flow_curves;
mod heat;
mod index;
mod jog;
mod lines;
mod motors;
mod probe;
mod refusal;
mod shaping;
mod stream_end;
mod switch;
mod units;
mod world;
