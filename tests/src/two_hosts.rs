//! Two hosts, a board and what may happen between them, on a virtual clock.
//!
//! The board is the firmware library with modelled heaters, which decides by itself which of its lines' hosts streams,
//! moves and heats. Its lines are either connections, whose end it notices, or the two wires of a real board, on which
//! one host silently takes the place of another. A host is the conversation of
//! `headway stream` without its terminal: orders before the job, the job, everything off, each on a line of its own,
//! with the command's own sender, patience, owner of heat and pauses. Lines lose frames, are silent, or are closed
//! and opened again; hosts are killed, ended, and follow their operator. Left out: planning, files, the wall clock.

use headway::drive::heat_owner::HeatOwner;
use headway::drive::patience::{ANSWER_US, Patience};
use headway::drive::pause_heat::{PauseHeat, PauseNews};
use headway::drive::sender::Sender;
use headway::drive::sender_state::{SenderEvent, SenderSetup, SenderState};
use headway::drive::virtual_heaters::VirtualHeaters;
use headway::job::SegmentStream;
use headway::job::frames::WireFrames;
use headway::settings::Settings;
use headway_firmware::configuration::MachineConfiguration;
use headway_firmware::configuration::flow_curves::FlowCurves;
use headway_firmware::configuration::heat::HeatConfiguration;
use headway_firmware::configuration::motors::MotorMatrix;
use headway_firmware::line::Conversation;
use headway_firmware::machine::Machine;
use headway_firmware::steps::output::StepOutput;
use headway_protocol::frame::FRAME_BYTES_MAX;
use headway_protocol::message::{Control, DeviceState, Status};
use headway_protocol::segment::{FlowAction, FlowEvent, Knot};
use headway_protocol::units::{Ticks, to_units};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::collections::VecDeque;

/// A slow servo, so that an hour is soon over: nothing here depends on its rate.
pub const SERVO_HZ: u32 = 100;
const STEP_HZ: u32 = 25_600;
const TICK_US: u64 = 1_000_000 / SERVO_HZ as u64;
/// Time between two attempts to open a line, as the command's pump has it.
const REOPEN_US: u64 = 250_000;

/// The built-in planar machine with that servo.
pub fn machine() -> MachineConfiguration {
    MachineConfiguration {
        servo_hz: SERVO_HZ,
        step_hz: STEP_HZ,
        motors: MotorMatrix::DIRECT,
        curves: FlowCurves::NONE,
        ..Settings::default().machine
    }
}

/// A line of 20 mm there and back as often as `seconds` ask for, primed and retracted.
pub fn job(seconds: u32) -> SegmentStream {
    const SPAN_TICKS: u16 = 5;
    let spans = seconds * SERVO_HZ / u32::from(SPAN_TICKS);
    let ease = |x: f64| x * x * x * (10.0 - 15.0 * x + 6.0 * x * x);
    let pose = |span: u32| {
        let share = f64::from(span) / f64::from(spans);
        let turns = ease(share) * f64::from(seconds) / 4.0;
        let along_mm = 10.0 - 10.0 * (turns * std::f64::consts::TAU).cos();
        [100.0 + along_mm, 100.0, 0.2, 0.0, 0.0, 0.0, 20.0 * turns]
    };
    let knot = |span| Knot {
        control: to_units(&pose(span)),
        duration_ticks: SPAN_TICKS,
    };
    let rests = |span: u32| (0..10).map(move |_| span);
    let order = rests(0).chain(0..=spans).chain(rests(spans));
    let knots: Vec<Knot> = order.map(knot).collect();
    let event = |span: usize, action| FlowEvent {
        span: span as u32,
        offset_ticks: 1,
        action,
        volume_units: 100_000,
        duration_ticks: Ticks(20),
    };
    SegmentStream {
        start: to_units(&pose(0)),
        events: vec![
            event(2, FlowAction::Prime),
            event(knots.len() - 8, FlowAction::Retract),
        ],
        knots,
        ..SegmentStream::default()
    }
}

/// Counts what the motors do.
#[derive(Default)]
struct Steps(u64);

impl StepOutput for Steps {
    fn set_directions(&mut self, _directions: u8) {}
    fn step(&mut self, _tick: u64, _motors: u8) {
        self.0 += 1;
    }
}

/// How bad the line of a host is.
#[derive(Clone, Copy, Debug, Default)]
pub struct Weather {
    /// Share of frames that are lost, each way.
    pub loss: f64,
    /// Nothing arrives until then, and nobody notices.
    pub silent_until_us: u64,
    /// It cannot be opened until then.
    pub closed_until_us: u64,
}

/// A board, and the hosts at its lines.
pub struct Board {
    configuration: MachineConfiguration,
    heat: HeatConfiguration,
    /// The controller.
    pub machine: Machine,
    heaters: VirtualHeaters,
    steps: Steps,
    /// Its lines, with the hosts at them.
    lines: Vec<(Option<u32>, Conversation)>,
    /// They are wires: there are always two, and nobody notices that a host has gone.
    are_wires: bool,
    session: u32,
    tick: u64,
    /// Steps of the last tick.
    pub stepped: u64,
    reports: Vec<(u32, Vec<u8>)>,
}

impl Board {
    /// Cold, and nobody there. Its jobs heat little, so that the virtual clock need not wait: melt may move cold.
    pub fn new(heat: HeatConfiguration) -> Board {
        Board::with_lines(heat, false)
    }

    /// The same with connections for lines, or with wires.
    pub fn with_lines(mut heat: HeatConfiguration, are_wires: bool) -> Board {
        for heater in &mut heat.heaters {
            heater.extrude_min_c = 0.0;
        }
        let configuration = machine();
        let mut machine = Machine::new(&configuration, 1).expect("a machine that can be run");
        let heaters = VirtualHeaters::new(&mut machine, &configuration, &heat);
        Board {
            configuration,
            heat,
            machine,
            heaters,
            steps: Steps::default(),
            lines: Vec::new(),
            are_wires,
            session: 1,
            tick: 0,
            stepped: 0,
            reports: Vec::new(),
        }
    }

    /// Its power fails for a moment: it knows nothing any more, and its lines are closed.
    pub fn restart(&mut self) {
        self.session += 1;
        self.machine = Machine::new(&self.configuration, self.session).expect("as before");
        self.heaters = VirtualHeaters::new(&mut self.machine, &self.configuration, &self.heat);
        for (host, talk) in &mut self.lines {
            *host = None;
            *talk = Conversation::new(&self.configuration, talk.line());
        }
    }

    /// Virtual time.
    pub fn now_us(&self) -> u64 {
        self.tick * TICK_US
    }

    fn has(&self, host: u32) -> bool {
        self.lines.iter().any(|(other, _)| *other == Some(host))
    }

    /// A free line, or a new one; another program has the port where both wires are taken.
    fn connect(&mut self, host: u32) {
        if let Some((free, _)) = self.lines.iter_mut().find(|(host, _)| host.is_none()) {
            *free = Some(host);
        } else if !self.are_wires || self.lines.len() < 2 {
            let number = self.lines.len() as u8 + 1;
            let talk = Conversation::new(&self.configuration, number);
            self.lines.push((Some(host), talk));
        }
    }

    fn disconnect(&mut self, host: u32) {
        let line = self
            .lines
            .iter_mut()
            .find(|(other, _)| *other == Some(host));
        let Some((host, talk)) = line else { return };
        *host = None;
        if !self.are_wires {
            self.machine.hang_up(talk);
            *talk = Conversation::new(&self.configuration, talk.line());
        }
    }

    fn take(&mut self, host: u32, bytes: &[u8]) {
        if let Some((_, talk)) = self.lines.iter_mut().find(|(h, _)| *h == Some(host)) {
            self.machine.handle_line(talk, bytes);
        }
    }

    /// A servo period: motion, heaters, reports.
    fn run(&mut self) {
        let before = self.steps.0;
        self.machine.run_servo_interval(&mut self.steps);
        self.stepped = self.steps.0 - before;
        self.heaters.tick(&mut self.machine);
        self.tick += 1;
        let mut out = [0u8; FRAME_BYTES_MAX];
        for (host, talk) in &mut self.lines {
            loop {
                let length = self.machine.poll_line(talk, &mut out);
                if length == 0 {
                    break;
                }
                let told = host.map(|host| (host, out[..length].to_vec()));
                self.reports.extend(told);
            }
        }
    }

    /// Target of a heater that is in force, °C.
    pub fn is_heating(&self) -> bool {
        self.machine.motion().heat().is_on()
    }
}

/// What a host does, one line after the other.
enum Phase {
    /// Gives orders without a stream.
    Talk(Talk),
    /// Streams.
    Stream(Box<(Sender, Patience, PauseHeat)>),
    /// Switches off, in order.
    Off(Talk),
    Gone,
}

/// Orders in a conversation of their own.
struct Talk {
    sender: Sender,
    orders: VecDeque<Control>,
    given: Option<(Control, HeatOwner)>,
    since_us: u64,
    connected: bool,
}

/// How a conversation without a stream went.
enum Went {
    On,
    Done,
    Wrong,
}

/// What a host has come for.
#[derive(Clone, Debug)]
pub enum Errand {
    /// Orders, and the job; `resume` goes on with it where the board has it.
    Print {
        /// Heaters and fan before it.
        before: Vec<Control>,
        /// Go on where the board has part of it.
        resume: bool,
    },
    /// Orders alone; what they switch on is handed over, as by `board heat`.
    Order(Vec<Control>),
}

/// A host, from its start to its end.
pub struct Host {
    /// Its number.
    pub id: u32,
    errand: Errand,
    phase: Phase,
    sessions: u32,
    weather: Weather,
    next_open_us: u64,
    random: Pcg64Mcg,
    stream: SegmentStream,
    frames: WireFrames,
    pause_max_min: f64,
    /// What it has switched on.
    pub owner: HeatOwner,
    /// Its errand is done, and it only switches off.
    well: bool,
    /// How it ended, once it has.
    pub ended: Option<Ended>,
    /// Its newest status.
    pub status: Option<Status>,
    /// Frames that its line lost.
    pub lost_frames: u64,
}

/// How a host ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ended {
    /// Its errand is done.
    pub well: bool,
    /// Everything that it had switched on was acknowledged to be off, or handed over.
    pub in_order: bool,
}

impl Host {
    /// A host that has just begun.
    pub fn new(id: u32, errand: Errand, stream: &SegmentStream, seed: u64, now_us: u64) -> Host {
        let mut host = Host {
            id,
            phase: Phase::Gone,
            sessions: 0,
            weather: Weather::default(),
            next_open_us: now_us,
            random: Pcg64Mcg::seed_from_u64(seed),
            stream: stream.clone(),
            frames: WireFrames::encode(stream).expect("a stream that can be sent"),
            pause_max_min: 120.0,
            owner: HeatOwner::default(),
            well: false,
            ended: None,
            status: None,
            lost_frames: 0,
            errand,
        };
        let orders = match &host.errand {
            Errand::Print { before, .. } => before.clone(),
            Errand::Order(orders) => orders.clone(),
        };
        let is_print = matches!(host.errand, Errand::Print { .. });
        if is_print && orders.is_empty() {
            host.begin_stream();
        } else {
            let talk = host.talk(orders, now_us);
            host.phase = Phase::Talk(talk);
        }
        host
    }

    /// How long its pauses keep heat.
    pub fn keep_heat(&mut self, minutes: f64) {
        self.pause_max_min = minutes;
    }

    /// How its line is from now on.
    pub fn weather(&mut self) -> &mut Weather {
        &mut self.weather
    }

    /// True until it has ended.
    pub fn lives(&self) -> bool {
        self.ended.is_none()
    }

    /// True where what it has switched on is left on for the next one.
    pub fn hands_over(&self) -> bool {
        matches!(self.errand, Errand::Order(_))
    }

    /// What it says to the stream's board, while it streams.
    pub fn sender(&self) -> Option<&Sender> {
        match &self.phase {
            Phase::Stream(streams) => Some(&streams.0),
            _ => None,
        }
    }

    fn session(&mut self) -> u32 {
        self.sessions += 1;
        // As far apart as the program's, which draws them: a board that hears a host in the place of another takes
        // its commands for that one's where their numbers are the same.
        (self.id << 8 | self.sessions).wrapping_mul(0x9e37_79b1)
    }

    fn talk(&mut self, orders: Vec<Control>, now_us: u64) -> Talk {
        self.owner.begin();
        Talk {
            sender: Sender::talking(self.session()),
            orders: orders.into(),
            given: None,
            since_us: now_us,
            connected: false,
        }
    }

    fn begin_stream(&mut self) {
        self.owner.begin();
        let configuration = machine();
        let setup = SenderSetup {
            host_session: self.session(),
            machine_hash: configuration.hash(),
            servo_hz: SERVO_HZ,
            solution: 0,
            resume: matches!(self.errand, Errand::Print { resume: true, .. }),
        };
        let sender = match setup.resume {
            true => Sender::resuming(self.frames.clone(), setup),
            false => Sender::new(self.frames.clone(), setup),
        };
        let patience = Patience::new(&self.stream, SERVO_HZ);
        let pause = PauseHeat::new(self.pause_max_min);
        self.phase = Phase::Stream(Box::new((sender, patience, pause)));
    }

    /// It dies: nothing of it is left.
    pub fn kill(&mut self, board: &mut Board) {
        board.disconnect(self.id);
        self.end(false, false);
    }

    /// It is to end: an error, a signal, a panic.
    pub fn leave(&mut self, board: &mut Board, well: bool) {
        if !self.lives() || matches!(self.phase, Phase::Off(_)) {
            return;
        }
        board.disconnect(self.id);
        let off = self.owner.all_off();
        if off.is_empty() {
            return self.end(well, true);
        }
        self.well = well;
        let talk = self.talk(off, board.now_us());
        self.phase = Phase::Off(talk);
    }

    fn end(&mut self, well: bool, in_order: bool) {
        self.phase = Phase::Gone;
        self.ended.get_or_insert(Ended { well, in_order });
    }

    /// What its operator wants.
    pub fn wish(&mut self, board: &mut Board, control: Control) {
        let now_us = board.now_us();
        match &mut self.phase {
            Phase::Stream(streams) => {
                let (sender, _, pause) = streams.as_mut();
                if control == Control::Resume {
                    for heat in pause.take_resume() {
                        self.owner.note(&heat);
                        sender.command(heat);
                    }
                }
                self.owner.note(&control);
                pause.note(now_us, &control);
                sender.command(control);
            }
            Phase::Talk(talk) if control == Control::EmergencyStop => {
                // Said at once, and then it ends.
                talk.orders = VecDeque::from([control]);
                talk.given = None;
                talk.since_us = now_us;
            }
            Phase::Talk(_) if control == Control::Abort => self.leave(board, false),
            Phase::Talk(_) | Phase::Off(_) | Phase::Gone => {}
        }
    }

    /// A servo period of it: its line, its conversation, its decisions.
    fn run(&mut self, board: &mut Board) {
        let now_us = board.now_us();
        if !self.lives() {
            return;
        }
        if now_us < self.weather.closed_until_us {
            board.disconnect(self.id);
            self.next_open_us = self.next_open_us.max(now_us + REOPEN_US);
        } else if !board.has(self.id) && now_us >= self.next_open_us {
            self.next_open_us = now_us + REOPEN_US;
            board.connect(self.id);
        }
        let is_open = board.has(self.id);
        if is_open {
            self.say(board);
        }
        match &mut self.phase {
            Phase::Talk(_) | Phase::Off(_) => self.go_on_talking(board),
            Phase::Stream(_) => self.go_on_streaming(board, is_open),
            Phase::Gone => {}
        }
    }

    fn loses(&mut self, now_us: u64) -> bool {
        let loses = now_us < self.weather.silent_until_us
            || (self.weather.loss > 0.0 && self.random.random_bool(self.weather.loss));
        self.lost_frames += u64::from(loses);
        loses
    }

    fn say(&mut self, board: &mut Board) {
        let (now_us, mut out) = (board.now_us(), [0u8; FRAME_BYTES_MAX]);
        // A millisecond's worth of a slow line and more.
        for _ in 0..16 {
            let sender = match &mut self.phase {
                Phase::Talk(talk) | Phase::Off(talk) => &mut talk.sender,
                Phase::Stream(streams) => &mut streams.0,
                Phase::Gone => return,
            };
            let Some(length) = sender.poll_transmit(now_us, &mut out) else {
                return;
            };
            if !self.loses(now_us) {
                board.take(self.id, &out[..length]);
            }
        }
    }

    fn hear(&mut self, now_us: u64, bytes: &[u8]) {
        if self.loses(now_us) {
            return;
        }
        match &mut self.phase {
            Phase::Talk(talk) | Phase::Off(talk) => talk.sender.handle_bytes(now_us, bytes),
            Phase::Stream(streams) => streams.0.handle_bytes(now_us, bytes),
            Phase::Gone => {}
        }
    }

    fn go_on_talking(&mut self, board: &mut Board) {
        let now_us = board.now_us();
        let (talk, is_off) = match &mut self.phase {
            Phase::Talk(talk) => (talk, false),
            Phase::Off(talk) => (talk, true),
            _ => return,
        };
        let stops = talk.orders.front() == Some(&Control::EmergencyStop);
        match (talk.go_on(now_us, &mut self.owner), is_off) {
            (Went::On, _) => {}
            (went, true) => {
                let well = self.well;
                let in_order = matches!(went, Went::Done);
                board.disconnect(self.id);
                self.end(well, in_order);
            }
            (Went::Wrong, false) => self.leave(board, false),
            (Went::Done, false) => {
                board.disconnect(self.id);
                self.next_open_us = now_us;
                match &self.errand {
                    Errand::Print { .. } if stops => self.leave(board, false),
                    Errand::Print { .. } => self.begin_stream(),
                    Errand::Order(_) => {
                        self.owner = HeatOwner::default();
                        self.end(true, true);
                    }
                }
            }
        }
    }

    fn go_on_streaming(&mut self, board: &mut Board, is_open: bool) {
        let now_us = board.now_us();
        let Phase::Stream(streams) = &mut self.phase else {
            return;
        };
        let (sender, patience, pause) = streams.as_mut();
        while let Some(event) = sender.poll_event() {
            match event {
                SenderEvent::Taken(control) => self.owner.taken(&control),
                SenderEvent::Status(status) => {
                    let news = pause.look(now_us, &status, &self.owner);
                    match news {
                        Some(
                            PauseNews::Ends(orders)
                            | PauseNews::Again(orders)
                            | PauseNews::Returns(orders),
                        ) => {
                            for control in orders {
                                self.owner.note(&control);
                                sender.command(control);
                            }
                        }
                        Some(PauseNews::Keeps(_)) | None => {}
                    }
                    self.status = Some(status);
                }
                _ => {}
            }
        }
        let rests =
            |status: &Status| matches!(status.state, DeviceState::Idle | DeviceState::Faulted);
        let aborted =
            *sender.state() == SenderState::Aborted && self.status.as_ref().is_some_and(rests);
        let done = *sender.state() == SenderState::Done;
        let failed = matches!(sender.state(), SenderState::Failed(_));
        let late = patience.look(now_us, sender, is_open).is_some();
        if done || failed || aborted || late {
            self.leave(board, done);
        }
    }
}

impl Talk {
    fn go_on(&mut self, now_us: u64, owner: &mut HeatOwner) -> Went {
        while let Some(event) = self.sender.poll_event() {
            match event {
                SenderEvent::Connected(_) => {
                    self.connected = true;
                    self.since_us = now_us;
                }
                SenderEvent::Taken(taken) => {
                    if let Some((given, _)) = self.given.take_if(|(given, _)| *given == taken) {
                        owner.taken(&given);
                        self.orders.pop_front();
                        self.since_us = now_us;
                    }
                }
                SenderEvent::Refused(_) => {
                    if let Some((_, before)) = self.given.take() {
                        *owner = before;
                    }
                    return Went::Wrong;
                }
                _ => {}
            }
        }
        if matches!(self.sender.state(), SenderState::Failed(_))
            || now_us > self.since_us + ANSWER_US
        {
            return Went::Wrong;
        }
        let Some(order) = self.orders.front().copied() else {
            return Went::Done;
        };
        if self.connected && self.given.is_none() {
            self.given = Some((order, owner.clone()));
            owner.note(&order);
            self.sender.command(order);
        }
        Went::On
    }
}

/// A servo period of everybody.
pub fn turn(board: &mut Board, hosts: &mut [Host]) {
    board.run();
    let now_us = board.now_us();
    for (to, bytes) in std::mem::take(&mut board.reports) {
        if let Some(host) = hosts.iter_mut().find(|host| host.id == to) {
            host.hear(now_us, &bytes);
        }
    }
    for host in hosts.iter_mut() {
        host.run(board);
    }
}
