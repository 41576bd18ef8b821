//! Goal: no heater on without an owner, no step without a job, a next job always possible, whatever happens between
//! two hosts, a page and a board. Method: random schedules of arrivals, commands, deaths, losses and reopenings on a
//! virtual clock (`headway_tests::two_hosts`); each is run to its end and followed by a job that must succeed.
//! `cargo test -p headway-tests --test end_to_end two_hosts -- --ignored --nocapture` runs 100,000 of them, of which
//! `HEADWAY_SEEDS=FROM-TO` takes a part. Then hours of waiting, which must not end in a silent host.

use headway::drive::sender_state::SenderState;
use headway::job::SegmentStream;
use headway_firmware::configuration::heat::HeatConfiguration;
use headway_protocol::message::{Control, DeviceState, FaultCause};
use headway_tests::two_hosts::{Board, Errand, Host, SERVO_HZ, job, turn};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::ops::Range;

const S: u64 = 1_000_000;
/// The board's patience, and the periods in which it notices.
const SILENT_US: u64 = 31 * S;
/// Longest that a host may live after everything has become well again: the host's own bounds, a minute for rest
/// after an abort the longest of them.
const LAST_US: u64 = 150 * S;
/// Steps that are on their way when a state changes: pressure advance, shapers and the servo's own delay.
const ON_THEIR_WAY_TICKS: u64 = 20;

fn heat(heater: u8, celsius: u16, wait: bool) -> Control {
    Control::Heat {
        heater,
        decidegrees: 10 * celsius,
        wait,
    }
}

/// What happened in schedules, summed.
#[derive(Clone, Copy, Debug, Default)]
struct Met {
    schedules: u64,
    hosts: u64,
    done: u64,
    killed: u64,
    ended_by_signal: u64,
    commands: u64,
    lines_closed: u64,
    lines_silent: u64,
    frames_lost: u64,
    board_restarts: u64,
    faults: u64,
    /// Hosts after whose end a heater was left to the board's own patience.
    left_to_the_board: u64,
    longest_unowned_s: f64,
}

impl Met {
    fn add(&mut self, other: &Met) {
        self.schedules += other.schedules;
        self.hosts += other.hosts;
        self.done += other.done;
        self.killed += other.killed;
        self.ended_by_signal += other.ended_by_signal;
        self.commands += other.commands;
        self.lines_closed += other.lines_closed;
        self.lines_silent += other.lines_silent;
        self.frames_lost += other.frames_lost;
        self.board_restarts += other.board_restarts;
        self.faults += other.faults;
        self.left_to_the_board += other.left_to_the_board;
        self.longest_unowned_s = self.longest_unowned_s.max(other.longest_unowned_s);
    }
}

/// One schedule.
struct Schedule<'a> {
    seed: u64,
    random: Pcg64Mcg,
    board: Board,
    hosts: Vec<Host>,
    stream: &'a SegmentStream,
    arrived: u32,
    /// Since when a heater is on and nobody lives who answers for it.
    unowned_us: Option<u64>,
    /// Somebody has left a heater on who could not switch it off, or handed it over.
    left_on: bool,
    /// Since when no job is open.
    idle_ticks: u64,
    met: Met,
}

impl<'a> Schedule<'a> {
    fn new(seed: u64, stream: &'a SegmentStream) -> Schedule<'a> {
        Schedule {
            seed,
            random: Pcg64Mcg::seed_from_u64(seed),
            // As a simulated board, and as a real one.
            board: Board::with_lines(HeatConfiguration::standard(), seed % 2 == 1),
            hosts: Vec::new(),
            stream,
            arrived: 0,
            unowned_us: None,
            left_on: false,
            // It begins at rest.
            idle_ticks: ON_THEIR_WAY_TICKS,
            met: Met {
                schedules: 1,
                ..Met::default()
            },
        }
    }

    fn arrive(&mut self, errand: Errand) {
        self.arrived += 1;
        let now_us = self.board.now_us();
        let seed = self.seed << 8 | u64::from(self.arrived);
        let mut host = Host::new(self.arrived, errand, self.stream, seed, now_us);
        if self.random.random_bool(0.2) {
            host.keep_heat(0.05);
        }
        host.weather().loss = [0.0, 0.0, 0.01, 0.1, 0.4][self.random.random_range(0..5)];
        self.hosts.push(host);
        self.met.hosts += 1;
    }

    fn errand(&mut self) -> Errand {
        let before = match self.random.random_range(0..4) {
            0 => Vec::new(),
            1 => vec![heat(0, 28, true), Control::Fan(500)],
            2 => vec![heat(1, 30, false)],
            _ => vec![heat(0, 28, false), heat(1, 30, false)],
        };
        match self.random.random_range(0..8) {
            0..4 => Errand::Print {
                before,
                resume: false,
            },
            4..6 => Errand::Print {
                before,
                resume: true,
            },
            6 => Errand::Order(vec![heat(0, 28, false)]),
            _ => Errand::Order(vec![self.command()]),
        }
    }

    /// What a page, a terminal or `headway board` says.
    fn command(&mut self) -> Control {
        match self.random.random_range(0..12) {
            0..3 => Control::Pause,
            3..6 => Control::Resume,
            6 => Control::Abort,
            7 => Control::EmergencyStop,
            8 => Control::Override([1, 3, 50, 200][self.random.random_range(0..4)]),
            9 => heat(self.random.random_range(0..2), 28, false),
            10 => Control::ClearFault,
            _ => Control::Fan(300),
        }
    }

    /// Something happens.
    fn happen(&mut self) {
        let now_us = self.board.now_us();
        let living: Vec<usize> = (0..self.hosts.len())
            .filter(|host| self.hosts[*host].lives())
            .collect();
        let kind = self.random.random_range(0..20);
        if living.is_empty() || (kind < 5 && living.len() < 2) {
            let errand = self.errand();
            return self.arrive(errand);
        }
        let host = living[self.random.random_range(0..living.len())];
        let long_us = self.random.random_range(0..5 * S);
        match kind {
            0..11 => {
                let command = self.command();
                self.hosts[host].wish(&mut self.board, command);
                self.met.commands += 1;
            }
            11..13 => {
                self.hosts[host].kill(&mut self.board);
                self.look_at_end(host);
                self.met.killed += 1;
            }
            13..15 => {
                self.hosts[host].leave(&mut self.board, false);
                if !self.hosts[host].lives() {
                    self.look_at_end(host);
                }
                self.met.ended_by_signal += 1;
            }
            15..17 => {
                self.hosts[host].weather().closed_until_us = now_us + long_us;
                self.met.lines_closed += 1;
            }
            17..19 => {
                self.hosts[host].weather().silent_until_us = now_us + long_us;
                self.met.lines_silent += 1;
            }
            _ => {
                self.board.restart();
                self.met.board_restarts += 1;
            }
        }
    }

    fn turn(&mut self) {
        let was_faulted = self.board.machine.motion().fault().is_some();
        let lived: Vec<bool> = self.hosts.iter().map(Host::lives).collect();
        turn(&mut self.board, &mut self.hosts);
        let motion = self.board.machine.motion();
        self.met.faults += u64::from(!was_faulted && motion.fault().is_some());
        self.look_for_steps();
        self.look_for_owner();
        let ended = lived.into_iter().enumerate();
        let ended = ended.filter(|(host, lived)| *lived && !self.hosts[*host].lives());
        let ended: Vec<usize> = ended.map(|(host, _)| host).collect();
        // Of two that end in one period either may have left a heater on for both.
        ended.iter().for_each(|host| self.note_end(*host));
        ended.iter().for_each(|host| self.check_end(*host));
    }

    /// No step without a job.
    fn look_for_steps(&mut self) {
        let state = self.board.machine.motion().state();
        let is_idle = matches!(state, DeviceState::Idle | DeviceState::Finished);
        self.idle_ticks = if is_idle { self.idle_ticks + 1 } else { 0 };
        let stepped = self.board.stepped;
        assert!(
            self.idle_ticks <= ON_THEIR_WAY_TICKS || stepped == 0,
            "seed {}: {stepped} steps while {state:?}",
            self.seed
        );
    }

    /// No heater without an owner, but for the board's own patience.
    fn look_for_owner(&mut self) {
        let now_us = self.board.now_us();
        let answers = self.hosts.iter().any(Host::lives);
        self.left_on &= self.board.is_heating();
        if !self.board.is_heating() || answers {
            self.unowned_us = None;
            return;
        }
        let since_us = *self.unowned_us.get_or_insert(now_us);
        let unowned_us = now_us - since_us;
        self.met.longest_unowned_s = self.met.longest_unowned_s.max(unowned_us as f64 / 1e6);
        assert!(
            unowned_us <= SILENT_US,
            "seed {}: a heater is on and nobody answers for it",
            self.seed
        );
    }

    fn look_at_end(&mut self, host: usize) {
        self.note_end(host);
        self.check_end(host);
    }

    /// What somebody who has ended leaves on.
    fn note_end(&mut self, host: usize) {
        let ended = self.hosts[host].ended.expect("it has ended");
        self.met.done += u64::from(ended.well);
        let owner = &self.hosts[host].owner;
        if !ended.in_order {
            let left = !owner.all_off().is_empty() && self.board.is_heating();
            self.met.left_to_the_board += u64::from(left);
            self.left_on |= left;
            return;
        }
        // What succeeds by hand hands over.
        self.left_on |= self.hosts[host].hands_over() && self.board.is_heating();
    }

    /// Who has ended in order has left nothing on: the last one of these leaves a cold board.
    fn check_end(&mut self, host: usize) {
        let owner = &self.hosts[host].owner;
        if !self.hosts[host].ended.is_some_and(|ended| ended.in_order) {
            return;
        }
        let alone = !self.hosts.iter().any(Host::lives);
        assert!(
            !alone || self.left_on || !self.board.is_heating(),
            "seed {}: host {} has ended in order, and a heater is on",
            self.seed,
            self.hosts[host].id
        );
        assert!(
            owner.all_off().is_empty(),
            "seed {}: host {} has ended in order and left {:?}",
            self.seed,
            self.hosts[host].id,
            owner.all_off()
        );
    }

    fn run(mut self) -> Met {
        for _ in 0..self.random.random_range(5..25) {
            self.happen();
            let ticks = self.random.random_range(1..SERVO_HZ);
            for _ in 0..ticks {
                self.turn();
            }
        }
        self.end();
        self.next_job();
        for host in &self.hosts {
            self.met.frames_lost += host.lost_frames;
        }
        self.met
    }

    /// The lines become well; who still lives is ended by its own bounds, or by a signal where it waits for people.
    fn end(&mut self) {
        for host in &mut self.hosts {
            *host.weather() = Default::default();
            host.leave(&mut self.board, false);
        }
        let until_us = self.board.now_us() + LAST_US;
        while self.hosts.iter().any(Host::lives) {
            self.turn();
            assert!(
                self.board.now_us() < until_us,
                "seed {}: a host never ends",
                self.seed
            );
        }
        // What nobody switched off the board does.
        while self.board.is_heating() {
            self.turn();
        }
    }

    /// By hand what a user does: clear, abort, declare; then a job to its end.
    fn next_job(&mut self) {
        let position = self.stream.start;
        for command in [
            Control::Override(100),
            Control::Resume,
            Control::Abort,
            Control::ClearFault,
        ] {
            self.by_hand(command);
        }
        let until_us = self.board.now_us() + 60 * S;
        while self.board.machine.motion().state() != DeviceState::Idle {
            self.turn();
            let motion = self.board.machine.motion();
            assert!(
                self.board.now_us() < until_us,
                "seed {}: it never rests: {:?} {:?}",
                self.seed,
                motion.state(),
                motion.fault()
            );
        }
        self.by_hand(Control::SetPosition(position));
        let before = vec![heat(0, 28, false)];
        let resume = false;
        let host = self.by_hand_errand(Errand::Print { before, resume });
        let ended = self.hosts[host].ended;
        let motion = self.board.machine.motion();
        assert!(
            ended.is_some_and(|ended| ended.well && ended.in_order),
            "seed {}: no next job: {ended:?}, {:?} {:?}",
            self.seed,
            motion.state(),
            motion.fault()
        );
        assert!(!self.board.is_heating(), "seed {}: hot after it", self.seed);
        assert_eq!(
            motion.spans_done() as usize,
            self.stream.knots.len(),
            "seed {}",
            self.seed
        );
    }

    /// Gives a command, again and again where it is refused because the machine still moves.
    fn by_hand(&mut self, command: Control) {
        for _ in 0..50 {
            let host = self.by_hand_errand(Errand::Order(vec![command]));
            if self.hosts[host].ended.is_some_and(|ended| ended.well) {
                return;
            }
        }
        let state = self.board.machine.motion().state();
        panic!("seed {}: {command:?} never done: {state:?}", self.seed);
    }

    fn by_hand_errand(&mut self, errand: Errand) -> usize {
        self.arrive(errand);
        let host = self.hosts.len() - 1;
        *self.hosts[host].weather() = Default::default();
        let until_us = self.board.now_us() + LAST_US;
        while self.hosts[host].lives() {
            self.turn();
            assert!(self.board.now_us() < until_us, "seed {}", self.seed);
        }
        host
    }
}

fn run_schedules(seeds: Range<u64>) -> Met {
    let stream = job(4);
    let mut met = Met::default();
    for seed in seeds {
        met.add(&Schedule::new(seed, &stream).run());
    }
    println!("{met:?}");
    met
}

#[test]
fn two_hundred_schedules_leave_no_heat_no_steps_and_a_board_for_the_next_job() {
    let met = run_schedules(0..200);
    // They were not idle.
    assert!(
        met.done > 200 && met.killed > 50 && met.ended_by_signal > 50,
        "{met:?}"
    );
    assert!(
        met.lines_closed > 50 && met.frames_lost > 1000 && met.faults > 20,
        "{met:?}"
    );
    assert!(
        met.left_to_the_board > 10 && met.board_restarts > 20,
        "{met:?}"
    );
}

#[test]
#[ignore = "100,000 schedules: about half an hour"]
fn a_hundred_thousand_schedules_leave_no_heat_no_steps_and_a_board_for_the_next_job() {
    let range = std::env::var("HEADWAY_SEEDS").ok();
    let range = range.and_then(|text| {
        let (from, to) = text.split_once('-')?;
        Some(from.parse().ok()?..to.parse().ok()?)
    });
    run_schedules(range.unwrap_or(0..100_000));
}

/// Goal: a stop is heard at whatever moment of a conversation it is given, also before the greeting is answered.
/// Method: a stop after each of the first ticks, on lines with and without losses.
#[test]
fn a_stop_is_heard_from_the_first_byte_on() {
    let stream = job(4);
    for (ticks, loss) in [
        (0, 0.0),
        (1, 0.0),
        (2, 0.0),
        (3, 0.0),
        (50, 0.0),
        (0, 0.3),
        (2, 0.3),
    ] {
        let mut board = Board::new(HeatConfiguration::none());
        let errand = Errand::Print {
            before: Vec::new(),
            resume: false,
        };
        let mut hosts = [Host::new(1, errand, &stream, 7, 0)];
        hosts[0].weather().loss = loss;
        for _ in 0..ticks {
            turn(&mut board, &mut hosts);
        }
        hosts[0].wish(&mut board, Control::EmergencyStop);
        // Retries of a bad line come within seconds.
        for _ in 0..10 * SERVO_HZ {
            turn(&mut board, &mut hosts);
        }
        let fault = board.machine.motion().fault();
        let cause = fault.map(|fault| fault.cause);
        assert_eq!(cause, Some(FaultCause::Emergency), "{ticks} {loss}");
        assert!(!hosts[0].lives(), "{ticks} {loss}");
    }
}

/// A bed that stays 3 K below its target for ever: neither there nor too slow. 20 W/K, of which its power holds 32 K.
fn never_there() -> HeatConfiguration {
    let mut heat = HeatConfiguration::standard();
    heat.heaters[1].plant.loss_w_k = 20.0;
    heat.heaters[1].plant.power_w = 640.0;
    heat
}

/// Goal: a host that waits is heard, whatever it waits for: an hour of heating, of pause, of a feed of 1 %. Method:
/// the conversation of `headway stream` with a board that heats.
#[test]
fn an_hour_of_heating_of_pause_or_of_slow_feed_is_no_silence() {
    let stream = job(60);
    for name in ["heating", "pause", "feed"] {
        let is_heating = name == "heating";
        let mut board = Board::new(never_there());
        let before = match is_heating {
            true => vec![heat(1, 60, true)],
            false => vec![heat(0, 28, true)],
        };
        let errand = Errand::Print {
            before,
            resume: false,
        };
        let mut hosts = [Host::new(1, errand, &stream, 7, 0)];
        let (mut waits_us, mut told) = (0, false);
        while waits_us < 3600 * S {
            turn(&mut board, &mut hosts);
            let motion = board.machine.motion();
            assert_eq!(motion.fault(), None, "{name}: {waits_us} us");
            assert!(hosts[0].lives(), "{name}: {waits_us} us");
            let state = motion.state();
            if state == DeviceState::Running && !told {
                told = true;
                let command = match name {
                    "pause" => Control::Pause,
                    _ => Control::Override(1),
                };
                hosts[0].wish(&mut board, command);
            }
            let waits = match name {
                "heating" => state == DeviceState::Heating,
                "pause" => state == DeviceState::Paused,
                _ => told && state == DeviceState::Running,
            };
            waits_us += u64::from(waits) * S / u64::from(SERVO_HZ);
            assert!(board.now_us() < 3700 * S, "{name}: {state:?}");
        }
        assert!(board.is_heating(), "{name}");
        let streams = hosts[0].sender().map(|sender| sender.state().clone());
        let waits = [SenderState::Streaming, SenderState::Finishing];
        assert!(waits.contains(&streams.unwrap()), "{name}");
        // A host that dies is noticed as ever.
        hosts[0].kill(&mut board);
        for _ in 0..31 * SERVO_HZ {
            turn(&mut board, &mut hosts);
        }
        // Its heat ends; the job waits for a host that orders it again.
        let motion = board.machine.motion();
        assert_eq!((motion.fault(), motion.heat().is_on()), (None, false));
        assert!(motion.has_stream(), "{name}");
    }
}
