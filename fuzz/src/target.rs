//! A controller under messages that look right, with the invariants that must hold whatever comes.
//!
//! 1. No step of a referenced joint beyond its range, but towards a switch or a probe.
//! 2. A latched fault brings the machine to rest within [`REST_TICKS_MAX`], and once it rests no
//!    motor steps again before the fault is cleared: no motion, no flow.
//! 3. After an emergency stop, from any line or by its input, nothing steps at all.
//! 4. Reports are frames of messages, and no more at once than there are kinds.
//! 5. No step before a stream or a move was taken, and none in a tick that begins at rest with no
//!    stream open and nothing heard.
//! 6. Heaters have power only with a target, and no longer than the board's patience after the last frame of the
//!    host that heats.
//! 7. Afterwards a fresh host can open a stream.

use crate::attack::{Action, Attack, Command, Kind, Move};
use crate::host::{Host, Told};
use crate::machines::{Subject, opening, subject_of};
use headway::drive::virtual_heaters::VirtualHeaters;
use headway_firmware::configuration::{MOTORS_MAX, MachineConfiguration};
use headway_firmware::design::{LIMIT_MARGIN, RAMP_MARGIN, SERVO_DELAY_TICKS};
use headway_firmware::machine::Machine;
use headway_firmware::motion::inputs::Inputs;
use headway_firmware::steps::output::StepOutput;
use headway_protocol::frame::{FRAME_BYTES_MAX, encode_frame, encode_payload};
use headway_protocol::knot_block::{KnotPredictor, encode_block};
use headway_protocol::message::{
    Control, DeviceState, Finish, Hello, HostMessage, JointOrder, PROTOCOL_VERSION, PinPosition,
    SCHEMA_HASH, Start,
};
use headway_protocol::segment::{FlowAction, FlowEvent, Knot};
use headway_protocol::units::{CHANNEL_TILT_X, CHANNEL_TILT_Y, CHANNEL_Z, CHANNELS, Ticks, Units};
use std::collections::VecDeque;

/// A soft fault ends in rest on the path: longer than any ramp of these machines, servo ticks.
const REST_TICKS_MAX: u32 = 8_000;
/// Steps that a joint may be beyond its range: the rounding of a count, and of the range itself.
const RANGE_SLACK_STEPS: i64 = 2;
/// Servo ticks of one run: what bounds its time.
const RUN_TICKS_MAX: u32 = 6_000;
/// Actions of one run that are followed.
const ACTIONS_MAX: usize = 64;
/// The board waits so long for a host that heats, ms: a run is short.
const PATIENCE_MS: u32 = 1_000;
/// Slack of that: two periods of the heat loop, ms.
const PATIENCE_SLACK_MS: u32 = 200;
/// Lines of the board.
pub const LINES: usize = 2;

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
    subject: &'static Subject,
    machine: Machine,
    hosts: [Host; LINES],
    /// The line that the present action is on.
    line: usize,
    heaters: VirtualHeaters,
    steps: Steps,
    ticks: u32,
    ticks_faulted: u32,
    rested: bool,
    /// An emergency stop was sent, and no fault was cleared since.
    stopped: bool,
    emergency_pressed: bool,
    /// It moves towards a switch or a probe: beyond its range, where that is late.
    searches: bool,
    beyond: [i64; MOTORS_MAX],
    /// The session that heats, and the tick at which it was heard last; `None`: not known.
    heats: Option<u32>,
    heard_tick: u32,
    /// Something came since the last tick.
    heard: bool,
    /// Ticks at rest with nothing heard.
    still_ticks: u32,
    watch: Option<SpeedWatch>,
}

impl Target {
    /// As it comes from start-up.
    pub fn new(kind: Kind) -> Self {
        let subject = subject_of(kind);
        let mut machine = subject.machine.clone();
        machine.wait_for_host(PATIENCE_MS);
        let mut heaters = VirtualHeaters::new(&mut machine, &subject.configuration, &subject.heat);
        heaters.wait_for_host(PATIENCE_MS as f32 / 1000.0);
        Target {
            subject,
            machine,
            hosts: [1, 2].map(|line| Host::new(subject, line)),
            line: 0,
            heaters,
            steps: Steps::default(),
            ticks: 0,
            ticks_faulted: 0,
            rested: false,
            stopped: false,
            emergency_pressed: false,
            searches: false,
            beyond: [0; MOTORS_MAX],
            heats: None,
            heard_tick: 0,
            heard: false,
            still_ticks: 0,
            watch: None,
        }
    }

    /// Runs a whole attack.
    pub fn run(attack: &Attack) {
        let mut target = Target::new(attack.kind);
        if attack.opened {
            target.begin();
        }
        for action in attack.actions.iter().take(ACTIONS_MAX) {
            target.act(0, action);
        }
        target.end();
    }

    /// Greets and opens a stream on the first line.
    pub fn begin(&mut self) {
        let hello = Action::Hello {
            session: 1,
            version: None,
        };
        let start = Action::Start {
            position: [0; CHANNELS],
            wild: None,
            right_machine: true,
            units: [0; 3],
        };
        self.act(0, &hello);
        self.act(0, &start);
    }

    /// From now on speeds are looked at too.
    pub fn hold_limits(&mut self) {
        let pairs = self.subject.configuration.motors.pair.is_some();
        self.watch = (!pairs).then(|| SpeedWatch::new(&self.subject.configuration));
    }

    /// Bytes of any meaning on a line.
    pub fn noise(&mut self, line: usize, bytes: &[u8]) {
        self.line = line % LINES;
        self.hear();
        (self.heats, self.host().session) = (None, None);
        let host = &mut self.hosts[self.line];
        host.say(&mut self.machine, bytes);
        self.listen();
    }

    /// A payload in a frame, whatever it says.
    fn payload(&mut self, sequence: u16, bytes: &[u8]) {
        let mut out = [0u8; FRAME_BYTES_MAX];
        if let Ok(length) = encode_payload(sequence, bytes, &mut out) {
            self.noise(self.line, &out[..length]);
        }
    }

    /// The connection of a line ends.
    pub fn hang_up(&mut self, line: usize) {
        self.machine.hang_up(&self.hosts[line % LINES].talk);
    }

    /// Levels of the inputs.
    pub fn press(&mut self, switches: u8, emergency: bool) {
        self.emergency_pressed = emergency;
        self.heard = true;
        self.machine.set_inputs(Inputs {
            switches,
            emergency,
        });
    }

    /// What follows is on this line.
    pub fn turn_to(&mut self, line: usize) {
        self.line = line % LINES;
    }

    fn host(&mut self) -> &mut Host {
        &mut self.hosts[self.line]
    }

    fn hear(&mut self) {
        self.heard = true;
        let session = self.hosts[self.line].session;
        if self.heats.is_none() || session.is_none() || session == self.heats {
            self.heard_tick = self.ticks;
        }
    }

    fn send(&mut self, sequence: u16, message: &HostMessage<'_>) -> Told {
        self.hear();
        let mut out = [0u8; FRAME_BYTES_MAX];
        let host = &mut self.hosts[self.line];
        let next = host.next_sequence;
        if *message == HostMessage::Control(Control::EmergencyStop) {
            // As the sender does: noise before a stop does not take it along.
            host.say(&mut self.machine, &[0]);
        }
        if let Ok(length) = encode_frame(sequence, message, &mut out) {
            host.say(&mut self.machine, &out[..length]);
        }
        let told = self.listen();
        if *message == HostMessage::Control(Control::EmergencyStop) {
            self.stopped = true;
            let fault = self.machine.motion().fault();
            assert!(fault.is_some(), "an emergency stop is no fault");
        }
        let host = &self.hosts[self.line];
        let took = match message {
            // As the stream's own numbers say.
            HostMessage::Knots(_) | HostMessage::Flow(_) => host.next_sequence != next,
            _ => heats(message) && told.taken == Some(sequence),
        } && self.machine.is_owner(&host.talk);
        if took {
            (self.heats, self.heard_tick) = (host.session, self.ticks);
        }
        told
    }

    pub fn send_control(&mut self, message: &HostMessage<'_>) -> Told {
        let host = self.host();
        host.control = host.control.wrapping_add(1);
        let sequence = host.control;
        self.send(sequence, message)
    }

    fn send_stream(&mut self, shift: i16, message: &HostMessage<'_>) {
        // Mostly in order: one in eight shifts is taken as it is.
        let shift = if shift & 7 == 7 { shift } else { 0 };
        let sequence = (self.host().next_sequence as u16).wrapping_add_signed(shift);
        self.send(sequence, message);
    }

    fn greet(&mut self, host_session: u32, protocol_version: u16) {
        let hello = Hello {
            protocol_version,
            schema_hash: SCHEMA_HASH,
            host_session,
        };
        let told = self.send_control(&HostMessage::Hello(hello));
        if told.welcome.is_some() {
            self.host().session = Some(host_session);
        }
    }

    pub fn act(&mut self, line: usize, action: &Action) {
        self.line = line % LINES;
        self.heard = true;
        match action {
            Action::Hello { session, version } => {
                self.greet((*session).into(), version.unwrap_or(PROTOCOL_VERSION));
            }
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
                self.host().events += 1;
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
                let host = self.host();
                let (knots, events) = if *right {
                    (host.knots, host.events)
                } else {
                    (*knots, *events)
                };
                self.send_stream(0, &HostMessage::Finish(Finish { knots, events }));
            }
            Action::Command(command) => self.command(command),
            Action::Payload { sequence, bytes } => self.payload(*sequence, bytes),
            Action::Garbage(bytes) => self.noise(self.line, bytes),
            Action::Ticks(ticks) => self.pass((*ticks).into()),
            Action::Listen => {
                self.listen();
            }
        }
    }

    fn start(
        &mut self,
        position: &[i16; CHANNELS],
        wild: &Option<[i32; CHANNELS]>,
        right: bool,
        units: Units,
    ) {
        let subject = self.subject;
        let position = wild.unwrap_or_else(|| units.of_base(&near_centre(subject, position)));
        let [.., volume] = position;
        let host = self.host();
        host.position = position;
        host.predictor = KnotPredictor::new(position);
        (host.knots, host.events) = (0, 0);
        let first_sequence = host.next_sequence;
        if volume % 2 == 0 {
            // Nothing is hot: what is tried is the motion.
            self.send_control(&HostMessage::Control(Control::ExtrudeCold(true)));
        }
        self.send_control(&HostMessage::Start(Start {
            job: 1,
            machine_hash: subject.configuration.hash() ^ u32::from(!right),
            first_sequence,
            position,
            solution: subject.solution,
            units,
        }));
    }

    fn knots(&mut self, shift: i16, moves: &[Move], flip: Option<(u8, u8)>) {
        let upright = self.subject.upright;
        let host = self.host();
        let mut before = host.position;
        let knots: Vec<Knot> = moves
            .iter()
            .take(64)
            .map(|next| {
                for (channel, value) in host.position.iter_mut().enumerate() {
                    let far = next.far.map_or(0, |far| far[channel]);
                    // A planar machine cannot tilt, and the slow axis is Z.
                    let by = match channel {
                        CHANNEL_TILT_X | CHANNEL_TILT_Y if upright => 0,
                        CHANNEL_Z => i32::from(next.by[channel]) / 16,
                        _ => i32::from(next.by[channel]),
                    };
                    *value = value.wrapping_add(by).wrapping_add(far);
                }
                Knot {
                    control: host.position,
                    duration_ticks: next.ticks % 4096 + 1,
                }
            })
            .collect();
        let mut done = 0;
        while done < knots.len() {
            let host = self.host();
            let (predictor, sequence) = (host.predictor, host.next_sequence);
            let (block, count) = encode_block(&mut host.predictor, &knots[done..]);
            done += count;
            host.knots += count as u32;
            let mut bytes = block.to_vec();
            if let Some((at, bits)) = flip
                && let Some(byte) = bytes.get_mut(usize::from(at))
            {
                *byte ^= bits;
            }
            self.send_stream(shift, &HostMessage::Knots(&bytes));
            let host = self.host();
            if host.next_sequence == sequence {
                // It was not taken: go on from where the controller is.
                host.predictor = predictor;
                host.knots -= count as u32;
                host.position = before;
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
        let ticks = ticks.min(RUN_TICKS_MAX.saturating_sub(self.ticks));
        for _ in 0..ticks {
            self.tick();
        }
    }

    fn tick(&mut self) {
        self.ticks += 1;
        let motion = self.machine.motion();
        let (fault, rested) = (motion.fault(), motion.is_at_rest());
        let state = motion.state();
        let resting = matches!(state, DeviceState::Idle | DeviceState::Finished);
        let quiet = rested && resting && !std::mem::take(&mut self.heard);
        self.searches |= matches!(state, DeviceState::Homing | DeviceState::Probing);
        self.searches &= !rested || !resting && fault.is_none();
        self.stopped &= fault.is_some();
        let steps_before = self.steps.steps;
        self.machine.run_servo_interval(&mut self.steps);
        let stepped = self.steps.steps != steps_before;
        self.still_ticks = if quiet { self.still_ticks + 1 } else { 0 };
        assert!(
            !(stepped && self.still_ticks > SERVO_DELAY_TICKS),
            "steps with no stream and no command"
        );
        assert!(!(self.stopped && stepped), "steps after an emergency stop");
        if self.emergency_pressed {
            // The servo has seen it.
            assert!(self.machine.motion().fault().is_some(), "not stopped");
            self.stopped = true;
        }
        self.heat();
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
        // What flows when the head comes to rest is cut within the tick after.
        self.rested = rested && self.ticks_faulted > 1;
    }

    fn heat(&mut self) {
        let mut served = None;
        let machine = &mut self.machine;
        self.heaters.turn(|service| {
            served = machine.serve_heat(service, 0);
            served
        });
        let Some(outputs) = served.filter(|outputs| !outputs.is_cold()) else {
            return;
        };
        let panel = self.machine.motion().heat();
        assert!(panel.is_on(), "{outputs:?} without a target");
        let silent_ms = u64::from(self.ticks - self.heard_tick) * 1000;
        let silent_ms = silent_ms / u64::from(self.subject.configuration.servo_hz);
        assert!(
            silent_ms <= u64::from(PATIENCE_MS + PATIENCE_SLACK_MS),
            "heats {silent_ms} ms after the last frame of {:?}",
            self.heats
        );
    }

    fn check_ranges(&mut self) {
        let motion = self.machine.motion();
        let configuration = &self.subject.configuration;
        if configuration.motors.pair.is_some() {
            return;
        }
        let counts: [i64; MOTORS_MAX] = motion.counts();
        for (number, joint) in configuration.joints.iter().enumerate() {
            let low = (joint.position_min * joint.steps_per_unit).floor() as i64;
            let high = (joint.position_max * joint.steps_per_unit).ceil() as i64;
            let beyond = low
                .saturating_sub(counts[number])
                .max(counts[number].saturating_sub(high));
            let before = std::mem::replace(&mut self.beyond[number], beyond);
            if motion.referenced() >> number & 1 == 0 || self.searches {
                continue;
            }
            // Beyond a switch that tripped late it may only come back.
            assert!(
                beyond <= RANGE_SLACK_STEPS.max(before),
                "joint {number} is at {}",
                counts[number]
            );
        }
    }

    /// Everything that the present line tells.
    pub fn listen(&mut self) -> Told {
        let host = &mut self.hosts[self.line];
        host.listen(&self.machine)
    }

    /// The attack is over: a fresh host stops everything, and opens a stream.
    pub fn end(&mut self) {
        self.pass(500);
        for line in 0..LINES {
            self.line = line;
            self.listen();
        }
        self.press(0, false);
        let configuration = &self.subject.configuration;
        let [_, second] = &mut self.hosts;
        *second = Host::new(self.subject, 3);
        self.line = 1;
        let (centre, solution) = (self.subject.centre, self.subject.solution);
        let (hello, _) = opening(configuration, 0xf4e5_4000, &centre, solution);
        self.send_control(&hello);
        self.hosts[1].session = Some(0xf4e5_4000);
        for heater in 0..self.subject.heat.heaters.len() as u8 {
            let off = Control::Heat {
                heater,
                decidegrees: 0,
                wait: false,
            };
            self.send_control(&HostMessage::Control(off));
        }
        self.send_control(&HostMessage::Control(Control::Abort));
        self.come_to_rest();
        self.send_control(&HostMessage::Control(Control::ClearFault));
        self.come_to_rest();
        let declared = self.send_control(&HostMessage::Control(Control::SetPosition(centre)));
        self.come_to_rest();
        // The attack may have opened a stream in a joint solution that does not hold the centre within the joints' ranges:
        // then the pose cannot be declared before the machine has homed.
        if !declared.refused.is_empty() && configuration.kinematics.solutions() > 1 {
            return;
        }
        // A declared pose is meant in the joint solution in use, which is that of the last stream that was opened.
        let mut told = Told::default();
        for solution in std::iter::once(solution).chain(0..configuration.kinematics.solutions()) {
            if self.machine.motion().state() != DeviceState::Filling {
                let (_, start) = opening(configuration, 0xf4e5_4000, &centre, solution);
                told = self.send_control(&start);
            }
        }
        let motion = self.machine.motion();
        assert_eq!(
            motion.state(),
            DeviceState::Filling,
            "{told:?}, {:?}",
            motion.fault()
        );
    }

    fn come_to_rest(&mut self) {
        // Commands take effect in the next tick.
        for _ in 0..REST_TICKS_MAX {
            self.tick();
            let motion = self.machine.motion();
            if motion.is_at_rest() && !motion.is_aborting() {
                return;
            }
        }
        panic!("no rest: {:?}", self.machine.motion().state());
    }
}

/// A pose near the middle of a machine.
fn near_centre(subject: &Subject, by: &[i16; CHANNELS]) -> [i32; CHANNELS] {
    let tilts = |c| (CHANNEL_TILT_X..=CHANNEL_TILT_Y).contains(&c);
    std::array::from_fn(|c| match c {
        c if subject.upright && tilts(c) => subject.centre[c],
        c => subject.centre[c] + i32::from(by[c]),
    })
}

/// Orders of which the silence of their host ends the heat.
fn heats(message: &HostMessage<'_>) -> bool {
    match message {
        HostMessage::Start(_) => true,
        HostMessage::Control(Control::Heat { decidegrees, .. }) => *decidegrees > 0,
        HostMessage::Control(control) => matches!(
            control,
            Control::Jog { .. }
                | Control::GoTo(_)
                | Control::Home(_)
                | Control::Probe { .. }
                | Control::Extrude { .. }
        ),
        _ => false,
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
