//! A controller under messages that look right, with the invariants that must hold whatever comes.
//!
//! 1. No step of a referenced joint beyond its range.
//! 2. A latched fault brings the machine to rest within [`REST_TICKS_MAX`], and once it rests no
//!    motor steps again before the fault is cleared: no motion, no flow.
//! 3. After an emergency stop nothing steps at all.
//! 4. Reports are frames of messages, and they end.

use crate::attack::{Action, Attack, Command, Kind, Move};
use headway::settings::Settings;
use headway_firmware::configuration::{MOTORS_MAX, MachineConfiguration};
use headway_firmware::design::{LIMIT_MARGIN, RAMP_MARGIN, SERVO_DELAY_TICKS};
use headway_firmware::line::Conversation;
use headway_firmware::machine::Machine;
use headway_firmware::steps::output::StepOutput;
use headway_protocol::frame::{
    FRAME_BYTES_MAX, FrameDecoder, encode_frame, encode_payload, hash_of,
};
use headway_protocol::knot_block::{KnotPredictor, encode_block};
use headway_protocol::message::{
    Control, DeviceMessage, DeviceState, FaultCause, Finish, Hello, HostMessage, JointOrder,
    PROTOCOL_VERSION, PinPosition, SCHEMA_HASH, Start,
};
use headway_protocol::segment::{FlowAction, FlowEvent, Knot};
use headway_protocol::units::{CHANNEL_TILT_X, CHANNEL_TILT_Y, CHANNEL_Z, CHANNELS, Ticks, Units};
use std::collections::VecDeque;
use std::sync::LazyLock;

/// A soft fault ends in rest on the path: longer than any ramp of these machines, servo ticks.
const REST_TICKS_MAX: u32 = 8_000;
/// Steps that a joint may be beyond its range: the rounding of a count, and of the range itself.
const RANGE_SLACK_STEPS: i64 = 2;
/// Servo ticks of one run: what bounds its time.
const RUN_TICKS_MAX: u32 = 3_000;
/// Actions of one run that are followed.
const ACTIONS_MAX: usize = 64;

static MACHINES: LazyLock<[(MachineConfiguration, Machine); 2]> = LazyLock::new(|| {
    [Settings::planar(), Settings::gantry()].map(|settings| {
        let machine = Machine::new(&settings.machine, 0xfeed).expect("built-in machines run");
        (settings.machine, machine)
    })
});

/// A machine as it comes from start-up.
pub fn machine(kind: Kind) -> (&'static MachineConfiguration, Machine) {
    let (configuration, machine) = &MACHINES[kind as usize];
    (configuration, machine.clone())
}

/// Counts steps.
#[derive(Debug, Default)]
struct Steps {
    directions: u8,
    steps: u64,
    /// Of each motor, forward less backward.
    made: [i64; MOTORS_MAX],
    last_tick: Option<u64>,
}

impl StepOutput for Steps {
    fn set_directions(&mut self, directions: u8) {
        self.directions = directions;
    }
    fn step(&mut self, tick: u64, motors: u8) {
        assert!(motors != 0, "a step of no motor");
        assert!(
            self.last_tick < Some(tick),
            "two steps of a motor in a tick"
        );
        self.last_tick = Some(tick);
        self.steps += u64::from(motors.count_ones());
        for (motor, made) in self.made.iter_mut().enumerate() {
            if motors >> motor & 1 == 1 {
                *made += if self.directions >> motor & 1 == 1 {
                    1
                } else {
                    -1
                };
            }
        }
    }
}

/// Servo ticks over which speeds are looked at.
const SPEED_TICKS: usize = 40;

/// Steps of all motors over a short time, against their limits.
struct SpeedWatch {
    /// Most steps of each in [`SPEED_TICKS`].
    most: [f64; MOTORS_MAX],
    history: VecDeque<[i64; MOTORS_MAX]>,
}

impl SpeedWatch {
    fn new(configuration: &MachineConfiguration) -> Self {
        let seconds = SPEED_TICKS as f64 / f64::from(configuration.servo_hz);
        let mut most = [0.0; MOTORS_MAX];
        let joints = configuration.joints.iter();
        let speeds = joints.map(|joint| joint.speed_max * joint.steps_per_unit * LIMIT_MARGIN);
        let extruder = &configuration.extruder;
        let extruder = extruder.speed_max_mm3_s * extruder.steps_per_mm3 * RAMP_MARGIN;
        for (most, speed) in most.iter_mut().zip(speeds.chain([extruder])) {
            // The counts' rounding at both ends, and 1 % of the servo's interpolation.
            *most = 1.01 * speed * seconds + 2.0;
        }
        SpeedWatch {
            most,
            history: VecDeque::new(),
        }
    }

    fn look(&mut self, made: &[i64; MOTORS_MAX]) {
        self.history.push_back(*made);
        if self.history.len() <= SPEED_TICKS {
            return;
        }
        let before = self.history.pop_front().unwrap_or(*made);
        for (motor, most) in self.most.iter().enumerate() {
            let steps = (made[motor] - before[motor]).abs();
            assert!(
                steps as f64 <= *most,
                "motor {motor} made {steps} steps in {SPEED_TICKS} ticks, {most:.1} at its limit"
            );
        }
    }
}

/// The controller and what is known of it.
pub struct Target {
    configuration: &'static MachineConfiguration,
    /// The machine cannot tilt.
    upright: bool,
    machine: Machine,
    steps: Steps,
    decoder: FrameDecoder,
    predictor: KnotPredictor,
    position: [i32; CHANNELS],
    next_sequence: u32,
    control: u16,
    ticks: u32,
    ticks_faulted: u32,
    rested: bool,
    knots: u32,
    events: u32,
    watcher: Conversation,
    /// Newest sequence number there.
    second: u16,
    /// Something came since the last tick.
    heard: bool,
    /// Ticks at rest with nothing heard.
    still_ticks: u32,
    watch: Option<SpeedWatch>,
}

/// The middle of both machines' ranges, channel units.
const CENTRE: [i32; CHANNELS] = [1_000_000, 1_000_000, 50_000, 0, 0, 0, 0];

impl Target {
    /// As it comes from start-up.
    pub fn new(kind: Kind) -> Self {
        let (configuration, machine) = machine(kind);
        Target {
            configuration,
            upright: matches!(kind, Kind::Planar),
            machine,
            steps: Steps::default(),
            decoder: FrameDecoder::new(),
            predictor: KnotPredictor::new(CENTRE),
            position: CENTRE,
            next_sequence: 0,
            control: 0,
            ticks: 0,
            ticks_faulted: 0,
            rested: false,
            knots: 0,
            events: 0,
            watcher: Conversation::new(configuration, 1),
            second: 0,
            heard: false,
            still_ticks: 0,
            watch: None,
        }
    }

    /// Runs a whole attack.
    pub fn run(attack: &Attack) {
        let mut target = Target::new(attack.kind);
        target.begin(attack);
        for action in attack.actions.iter().take(ACTIONS_MAX) {
            target.act(action);
        }
        target.pass(500);
        target.listen();
    }

    /// Greets and opens a stream, if the attack says so.
    pub fn begin(&mut self, attack: &Attack) {
        let target = self;
        if attack.opened {
            target.act(&Action::Hello {
                session: 1,
                version: None,
            });
            let position = [0; CHANNELS];
            target.act(&Action::Start {
                position,
                wild: None,
                right_machine: true,
                units: [0; 3],
            });
        }
    }

    /// From now on speeds are looked at too.
    pub fn hold_limits(&mut self) {
        self.watch = Some(SpeedWatch::new(self.configuration));
    }

    /// A payload in a frame on the second line.
    pub fn second_payload(&mut self, sequence: u16, payload: &[u8]) {
        let mut out = [0u8; FRAME_BYTES_MAX];
        if let Ok(length) = encode_payload(sequence, payload, &mut out) {
            self.noise(true, &out[..length]);
        }
    }

    /// A greeting and a command on the second line.
    pub fn second_command(&mut self, greets: bool, command: u8) {
        let mut out = [0u8; FRAME_BYTES_MAX];
        if greets {
            let hello = HostMessage::Hello(Hello {
                protocol_version: PROTOCOL_VERSION,
                schema_hash: SCHEMA_HASH,
                host_session: 99,
            });
            self.second += 1;
            if let Ok(length) = encode_frame(self.second, &hello, &mut out) {
                self.noise(true, &out[..length]);
            }
        }
        self.second += 1;
        self.second_payload(self.second, &[5, command % 17]);
    }

    /// Bytes as they are.
    pub fn noise(&mut self, second: bool, bytes: &[u8]) {
        self.heard = true;
        if second {
            self.machine.handle_line(&mut self.watcher, bytes);
            let mut out = [0u8; FRAME_BYTES_MAX];
            for _ in 0..10 {
                if self.machine.poll_line(&mut self.watcher, &mut out) == 0 {
                    return;
                }
            }
            panic!("reports without end on the second line");
        }
        self.machine.handle_bytes(bytes);
    }

    fn send(&mut self, sequence: u16, message: &HostMessage<'_>) {
        let mut out = [0u8; FRAME_BYTES_MAX];
        if let Ok(length) = encode_frame(sequence, message, &mut out) {
            self.machine.handle_bytes(&out[..length]);
        }
    }

    fn send_control(&mut self, message: &HostMessage<'_>) {
        self.control = self.control.wrapping_add(1);
        self.send(self.control, message);
    }

    fn send_stream(&mut self, shift: i16, message: &HostMessage<'_>) {
        // Mostly in order: one in eight shifts is taken as it is.
        let shift = if shift & 7 == 7 { shift } else { 0 };
        self.send(
            (self.next_sequence as u16).wrapping_add_signed(shift),
            message,
        );
        self.listen();
    }

    pub fn act(&mut self, action: &Action) {
        self.heard = true;
        match action {
            Action::Hello { session, version } => self.send_control(&HostMessage::Hello(Hello {
                protocol_version: version.unwrap_or(PROTOCOL_VERSION),
                schema_hash: SCHEMA_HASH,
                host_session: (*session).into(),
            })),
            Action::Start {
                position,
                wild,
                right_machine,
                units,
            } => {
                // Mostly what a stream may have.
                let [length, angle, volume] = units.map(|exponent| exponent % 32);
                let units = Units {
                    length_exponent: length,
                    angle_exponent: angle,
                    volume_exponent: volume,
                };
                self.start(position, wild, *right_machine, units);
            }
            Action::Knots { shift, knots, flip } => self.knots(*shift, knots, *flip),
            Action::RawBlock { bytes } => {
                if !bytes.is_empty() {
                    self.send_stream(0, &HostMessage::Knots(bytes));
                }
            }
            Action::Flow {
                span,
                offset,
                retract,
                volume,
                duration,
            } => {
                self.events += 1;
                self.send_stream(
                    0,
                    &HostMessage::Flow(FlowEvent {
                        span: (*span).into(),
                        offset_ticks: *offset,
                        action: flow_action(*retract),
                        volume_units: *volume,
                        duration_ticks: Ticks(*duration),
                    }),
                );
            }
            Action::Finish {
                right,
                knots,
                events,
            } => {
                let (knots, events) = if *right {
                    (self.knots, self.events)
                } else {
                    (*knots, *events)
                };
                self.send_stream(0, &HostMessage::Finish(Finish { knots, events }));
            }
            Action::Command(command) => self.command(command),
            Action::Payload { sequence, bytes } => {
                let mut out = [0u8; FRAME_BYTES_MAX];
                if let Ok(length) = encode_payload(*sequence, bytes, &mut out) {
                    self.machine.handle_bytes(&out[..length]);
                }
            }
            Action::Garbage(bytes) => self.machine.handle_bytes(bytes),
            Action::Ticks(ticks) => self.pass((*ticks).into()),
            Action::Listen => self.listen(),
        }
    }

    fn start(
        &mut self,
        position: &[i16; CHANNELS],
        wild: &Option<[i32; CHANNELS]>,
        right: bool,
        units: Units,
    ) {
        self.position = wild.unwrap_or_else(|| units.of_base(&self.near_centre(position)));
        self.predictor = KnotPredictor::new(self.position);
        self.knots = 0;
        self.events = 0;
        self.send_control(&HostMessage::Start(Start {
            job: 1,
            machine_hash: hash_of(self.configuration) ^ u32::from(!right),
            first_sequence: self.next_sequence,
            position: self.position,
            solution: 0,
            units,
        }));
    }

    fn near_centre(&self, by: &[i16; CHANNELS]) -> [i32; CHANNELS] {
        let tilts = |c| (CHANNEL_TILT_X..=CHANNEL_TILT_Y).contains(&c);
        std::array::from_fn(|c| match c {
            c if self.upright && tilts(c) => 0,
            c => CENTRE[c] + i32::from(by[c]),
        })
    }

    fn knots(&mut self, shift: i16, moves: &[Move], flip: Option<(u8, u8)>) {
        let mut before = self.position;
        let knots: Vec<Knot> = moves
            .iter()
            .take(64)
            .map(|next| {
                for (channel, value) in self.position.iter_mut().enumerate() {
                    let far = next.far.map_or(0, |far| far[channel]);
                    // A planar machine cannot tilt, and the slow axis is Z.
                    let by = match channel {
                        CHANNEL_TILT_X | CHANNEL_TILT_Y if self.upright => 0,
                        CHANNEL_Z => i32::from(next.by[channel]) / 16,
                        _ => i32::from(next.by[channel]),
                    };
                    *value = value.wrapping_add(by).wrapping_add(far);
                }
                Knot {
                    control: self.position,
                    duration_ticks: next.ticks % 4096 + 1,
                }
            })
            .collect();
        let mut done = 0;
        while done < knots.len() {
            let (predictor, sequence) = (self.predictor, self.next_sequence);
            let (block, count) = encode_block(&mut self.predictor, &knots[done..]);
            done += count;
            self.knots += count as u32;
            let mut bytes = block.to_vec();
            if let Some((at, bits)) = flip
                && let Some(byte) = bytes.get_mut(usize::from(at))
            {
                *byte ^= bits;
            }
            self.send_stream(shift, &HostMessage::Knots(&bytes));
            if self.next_sequence == sequence {
                // It was not taken: go on from where the controller is.
                self.predictor = predictor;
                self.knots -= count as u32;
                self.position = before;
                return;
            }
            before = knots[done - 1].control;
        }
    }

    fn command(&mut self, command: &Command) {
        let control = match *command {
            Command::Pause => Control::Pause,
            Command::Resume => Control::Resume,
            Command::Override(percent) => Control::Override(percent),
            Command::Abort => Control::Abort,
            Command::EmergencyStop => Control::EmergencyStop,
            Command::ClearFault => Control::ClearFault,
            Command::Status => Control::StatusRequest,
            Command::SetPosition(position) => Control::SetPosition(position),
            Command::Jog {
                joint,
                distance,
                speed,
            } => Control::Jog {
                joint,
                distance_units: distance,
                speed_units_s: speed,
            },
            Command::Home(ref joints) => match JointOrder::of(joints) {
                Some(order) => Control::Home(order),
                None => Control::Home(JointOrder::ALL),
            },
            Command::SetJoint { joint, position } => Control::SetJoint {
                joint,
                position_units: position,
            },
            Command::ReportPeriod(ms) => Control::ReportPeriod(ms),
            Command::FlowOverride(percent) => Control::FlowOverride(percent),
            Command::Extrude {
                retract,
                volume,
                ticks,
            } => Control::Extrude {
                action: flow_action(retract),
                volume_units: volume,
                duration_ticks: Ticks(ticks),
            },
            Command::Probe {
                joint,
                distance,
                fast,
                slow,
                back_off,
            } => Control::Probe {
                joint,
                distance_units: distance,
                fast_units_s: fast,
                slow_units_s: slow,
                back_off_units: back_off,
            },
            Command::ProbePin { out } => Control::ProbePin(pin_position(out)),
        };
        self.send_control(&HostMessage::Control(control));
    }

    /// Servo ticks, with the invariants after each.
    pub fn pass(&mut self, ticks: u32) {
        let ticks = ticks.min(RUN_TICKS_MAX - self.ticks);
        self.ticks += ticks;
        for _ in 0..ticks {
            self.tick();
        }
    }

    fn tick(&mut self) {
        let motion = self.machine.motion();
        let (fault, rested) = (motion.fault(), motion.is_at_rest());
        let resting = matches!(motion.state(), DeviceState::Idle | DeviceState::Finished);
        let quiet = rested && resting && !std::mem::take(&mut self.heard);
        let steps_before = self.steps.steps;
        self.machine.run_servo_interval(&mut self.steps);
        let stepped = self.steps.steps != steps_before;
        self.still_ticks = if quiet { self.still_ticks + 1 } else { 0 };
        assert!(
            !(stepped && self.still_ticks > SERVO_DELAY_TICKS),
            "steps with no stream and no command"
        );
        if let Some(watch) = &mut self.watch {
            watch.look(&self.steps.made);
        }
        self.check_ranges();
        let Some(fault) = fault else {
            self.ticks_faulted = 0;
            self.rested = false;
            return;
        };
        self.ticks_faulted += 1;
        assert!(
            rested || self.ticks_faulted <= REST_TICKS_MAX,
            "moves long after {fault:?}"
        );
        assert!(!(self.rested && stepped), "steps after {fault:?}");
        let emergency = fault.cause == FaultCause::Emergency;
        assert!(!(emergency && stepped), "steps after an emergency stop");
        // What flows when the head comes to rest is cut within the tick after.
        self.rested = rested && self.ticks_faulted > 1;
    }

    fn check_ranges(&self) {
        let motion = self.machine.motion();
        let counts: [i64; MOTORS_MAX] = motion.counts();
        for (number, joint) in self.configuration.joints.iter().enumerate() {
            if motion.referenced() >> number & 1 == 0 {
                continue;
            }
            let low = (joint.position_min * joint.steps_per_unit).floor() as i64;
            let high = (joint.position_max * joint.steps_per_unit).ceil() as i64;
            let range =
                low.saturating_sub(RANGE_SLACK_STEPS)..=high.saturating_add(RANGE_SLACK_STEPS);
            assert!(
                range.contains(&counts[number]),
                "joint {number} is at {}",
                counts[number]
            );
        }
    }

    pub fn listen(&mut self) {
        let mut out = [0u8; FRAME_BYTES_MAX];
        // More reports at once than there are kinds would be reports without end.
        for _ in 0..10 {
            let length = self.machine.poll_report(&mut out);
            if length == 0 {
                return;
            }
            for &byte in &out[..length] {
                let Some(frame) = self.decoder.push(byte) else {
                    continue;
                };
                let frame = frame.expect("a whole frame");
                let message = DeviceMessage::decode(frame.payload).expect("a message");
                if let DeviceMessage::Ack(ack) | DeviceMessage::Nak(ack) = message {
                    self.next_sequence = ack.next_sequence;
                }
            }
        }
        panic!("reports without end");
    }
}

fn pin_position(out: bool) -> PinPosition {
    if out {
        PinPosition::Deploy
    } else {
        PinPosition::Stow
    }
}

fn flow_action(retract: bool) -> FlowAction {
    if retract {
        FlowAction::Retract
    } else {
        FlowAction::Prime
    }
}
