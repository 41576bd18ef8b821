//! Goal: the firmware on an emulated Cortex-M4F makes the very steps of the host's simulation, and
//! faults on the line cost it none. Method: builds the emulated board, runs it in QEMU, streams a
//! planned example over its UART with the real sender, and compares step digest and counts.
//! Skipped, and said so, where QEMU or the target is missing; `HEADWAY_DEMAND_EMULATOR=1` makes
//! that a failure.

use headway::drive::dry_run::dry_run;
use headway::drive::sender::Sender;
use headway::drive::sender_state::{SenderError, SenderEvent, SenderSetup, SenderState};
use headway::drive::simulator::{SimulationFigures, SimulatorSetup};
use headway::input::{Format, ReadOptions, read};
use headway::job::frames::WireFrames;
use headway::plan_target;
use headway::settings::Settings;
use headway_firmware::board::built_in::{EMULATED_SWITCHES_STEPS, emulated_planar};
use headway_firmware::configuration::homing::HomingConfiguration;
use headway_protocol::frame::{FRAME_BYTES_MAX, FrameDecoder, encode_frame, hash_of};
use headway_protocol::message::{
    Control, DeviceMessage, DeviceState, FaultCause, Hello, HostMessage, JointOrder,
    PROTOCOL_VERSION, SCHEMA_HASH, Status,
};
use headway_tests::emulation::board_image::{image, skipped};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::io::{ErrorKind, Read, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Mutex, MutexGuard, OnceLock};
use std::time::{Duration, Instant};

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
/// The job takes some seconds of virtual time; a busy machine needs many times that.
const PATIENCE: Duration = Duration::from_secs(240);
/// Times that the example is printed until the line was fast enough.
const ATTEMPTS: usize = 3;
/// 16 ns of virtual time per instruction, a core of 62.5 MIPS: with fewer a step tick hardly fits
/// between two, with more the idle loop costs the emulator most of its time.
const ICOUNT: &str = "shift=4";
/// One emulator at a time: two would halve each other's speed.
static ALONE: Mutex<()> = Mutex::new(());

/// The board's binary, or why there is none.
/// The board's binary, the same that its sizes are read off; `None` after saying why the test is skipped.
fn board() -> Option<&'static Path> {
    static BOARD: OnceLock<PathBuf> = OnceLock::new();
    if skipped() {
        return None;
    }
    let built = || image("qemu", "prove-no-panic").unwrap_or_else(|error| panic!("{error}"));
    Some(BOARD.get_or_init(built))
}

/// A planned example and what the simulation makes of it.
pub(super) struct Example {
    pub(super) frames: WireFrames,
    pub(super) settings: Settings,
    simulated: SimulationFigures,
}

pub(super) fn example() -> &'static Example {
    static EXAMPLE: OnceLock<Example> = OnceLock::new();
    EXAMPLE.get_or_init(|| {
        let settings = Settings {
            machine: emulated_planar(),
            ..Settings::default()
        };
        let path = Path::new(ROOT).join("examples/taper.json");
        let bytes = std::fs::read(&path).expect("example");
        let format = Format::of_ending(&path).expect("ending");
        let loaded = read(&bytes, "taper", format, &ReadOptions::default()).expect("valid");
        let plan = plan_target(&loaded.target, &settings).expect("plan");
        let setup = SimulatorSetup::default();
        let dry_run = dry_run(&plan.stream, &settings, &setup, |_| {}).expect("dry_run");
        Example {
            frames: WireFrames::encode(&plan.stream).expect("a plan can be sent"),
            settings,
            simulated: dry_run.simulation.figures,
        }
    })
}

#[test]
fn the_board_to_flash_has_the_machine_that_the_command_plans_for() {
    let planned = Settings::default().machine;
    let built_in = headway_firmware::board::built_in::built_in_planar();
    assert_eq!(built_in, planned);
    assert_eq!(hash_of(&built_in), hash_of(&planned));
}

/// The board in QEMU, with its UART as a socket. Killed when dropped.
pub(super) struct Emulator {
    process: Child,
    line: UnixStream,
    socket: PathBuf,
}

impl Emulator {
    pub(super) fn start(elf: &Path, name: &str) -> Self {
        let socket = elf.with_file_name(format!("{name}.socket"));
        let process = Command::new("qemu-system-arm")
            .args(["-machine", "mps2-an386", "-cpu", "cortex-m4", "-nographic"])
            .args(["-monitor", "none", "-icount", ICOUNT])
            .args(["-semihosting-config", "enable=on,target=native", "-serial"])
            .arg(format!("unix:{},server=on,wait=on", socket.display()))
            .arg("-serial")
            .arg(format!(
                "unix:{},server=on,wait=off",
                button(&socket).display()
            ))
            .arg("-kernel")
            .arg(elf)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .spawn()
            .expect("QEMU starts");
        let line = connect(&socket);
        line.set_read_timeout(Some(Duration::from_millis(2)))
            .expect("a timeout can be set");
        Self {
            process,
            line,
            socket,
        }
    }

    /// What has arrived within 2 ms; `None` when the board has hung up.
    fn receive(&mut self, input: &mut [u8; 4096]) -> Option<usize> {
        match self.line.read(input) {
            Ok(0) => None,
            Ok(length) => Some(length),
            Err(error) => match error.kind() {
                ErrorKind::WouldBlock | ErrorKind::TimedOut => Some(0),
                ErrorKind::ConnectionReset => None,
                _ => panic!("{error}"),
            },
        }
    }

    /// Waits for the board's own end, listening on, and gives its report.
    fn report(mut self) -> serde_json::Value {
        let started = Instant::now();
        while self.receive(&mut [0; 4096]).is_some() {
            assert!(started.elapsed() < PATIENCE, "the board does not end");
        }
        let mut text = String::new();
        let mut output = self.process.stdout.take().expect("it is piped");
        output.read_to_string(&mut text).expect("text");
        serde_json::from_str(text.trim()).expect("a report")
    }
}

impl Drop for Emulator {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.process.kill();
        let _ = self.process.wait();
        let _ = std::fs::remove_file(&self.socket);
        let _ = std::fs::remove_file(button(&self.socket));
    }
}

/// Socket of the emergency button: a byte presses it.
fn button(socket: &Path) -> PathBuf {
    socket.with_extension("button")
}

fn connect(socket: &Path) -> UnixStream {
    for _ in 0..500 {
        if let Ok(stream) = UnixStream::connect(socket) {
            return stream;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    panic!("QEMU does not listen on {}", socket.display());
}

/// Bytes that are lost at once: a small frame or a part of a long one.
const LOST_BYTES: u32 = 24;

/// What goes wrong between host and board, either way: byte by byte, since a busy machine reads fewer at
/// a time.
pub(super) struct Faults {
    random: Pcg64Mcg,
    flip_per_byte: f64,
    drop_per_byte: f64,
    flips: u32,
    drops: u32,
    /// Bytes of the last drop that are still to come, from the host and from the board.
    to_lose: [u32; 2],
}

/// Which way bytes go.
#[derive(Clone, Copy)]
enum Way {
    Out,
    In,
}

impl Faults {
    pub(super) fn new(seed: u64, flip_per_byte: f64, drop_per_byte: f64) -> Self {
        Self {
            random: Pcg64Mcg::seed_from_u64(seed),
            flip_per_byte,
            drop_per_byte,
            flips: 0,
            drops: 0,
            to_lose: [0; 2],
        }
    }

    /// What is left of some bytes, damaged.
    fn pass(&mut self, way: Way, bytes: &[u8]) -> Vec<u8> {
        let mut left = Vec::with_capacity(bytes.len());
        for &byte in bytes {
            if self.random.random_bool(self.drop_per_byte) {
                self.drops += 1;
                self.to_lose[way as usize] = LOST_BYTES;
            }
            if self.to_lose[way as usize] > 0 {
                self.to_lose[way as usize] -= 1;
            } else if self.random.random_bool(self.flip_per_byte) {
                self.flips += 1;
                left.push(byte ^ 1 << self.random.random_range(0..8));
            } else {
                left.push(byte);
            }
        }
        left
    }
}

/// Streams the job to its end; the sender's clock is the wall's. `watch` sees every piece of news.
pub(super) fn stream(
    sender: &mut Sender,
    board: &mut Emulator,
    faults: &mut Faults,
    mut watch: impl FnMut(&SenderEvent, &mut Sender),
) {
    let started = Instant::now();
    let mut out = [0; FRAME_BYTES_MAX];
    let mut input = [0; 4096];
    let mut last = None;
    while !matches!(sender.state(), SenderState::Done | SenderState::Failed(_)) {
        let place = || format!("{:?} {:?} {last:?}", sender.state(), sender.figures());
        assert!(started.elapsed() < PATIENCE, "{}", place());
        let Some(length) = board.receive(&mut input) else {
            panic!("the board hung up: {}", place());
        };
        let now_us = started.elapsed().as_micros() as u64;
        sender.handle_bytes(now_us, &faults.pass(Way::In, &input[..length]));
        while let Some(length) = sender.poll_transmit(now_us, &mut out) {
            let bytes = faults.pass(Way::Out, &out[..length]);
            board.line.write_all(&bytes).expect("the line is open");
        }
        while let Some(event) = sender.poll_event() {
            watch(&event, sender);
            last = Some(event);
        }
    }
}

pub(super) fn alone() -> MutexGuard<'static, ()> {
    ALONE
        .lock()
        .unwrap_or_else(|poisoned| poisoned.into_inner())
}

pub(super) fn sender() -> Sender {
    let Example {
        frames, settings, ..
    } = example();
    let setup = SenderSetup {
        host_session: 7,
        machine_hash: hash_of(&settings.machine),
        solution: 0,
        servo_hz: settings.machine.servo_hz,
        resume: false,
    };
    Sender::new(frames.clone(), setup)
}

/// Prints the example on the emulated board.
fn print(elf: &Path, name: &str, faults: &mut Faults) -> serde_json::Value {
    let _alone = alone();
    let mut board = Emulator::start(elf, name);
    let mut sender = sender();
    let started = Instant::now();
    stream(&mut sender, &mut board, faults, |_, _| {});
    assert_eq!(*sender.state(), SenderState::Done);
    println!("{name}: {:?}, {:?}", started.elapsed(), sender.figures());
    let report = board.report();
    println!("emulated: {report}\nsimulated: {:?}", example().simulated);
    assert_eq!(report["faults"], 0);
    assert_eq!(report["unfed_watchdog_ticks"], 0);
    // A driver that masks interrupts holds nothing up where it may not.
    assert!(report["servo_ticks_through_a_mask"].as_u64() > Some(0));
    report
}

#[test]
fn the_emulated_core_makes_the_steps_of_the_simulation() {
    let Some(elf) = board() else { return };
    // A board that starves while the sender waits for the processor rests on the path and goes on, which is
    // right but takes other steps.
    let mut emulated = serde_json::Value::Null;
    for _ in 0..ATTEMPTS {
        emulated = print(elf, "clean", &mut Faults::new(0, 0.0, 0.0));
        if emulated["underruns"] == 0 {
            break;
        }
    }
    let simulated = &example().simulated;
    assert_eq!(
        emulated["final_counts"],
        serde_json::json!(simulated.final_counts)
    );
    assert_eq!(
        emulated["underruns"], 0,
        "the line was too slow for the comparison, {ATTEMPTS} times"
    );
    assert_eq!(emulated["step_digest"], simulated.step_digest.as_str());
    assert_eq!(emulated["steps"], simulated.steps);
}

#[test]
fn a_line_with_faults_costs_the_emulated_core_no_step() {
    let Some(elf) = board() else { return };
    // Some frames in ten are lost or damaged, both ways.
    let mut faults = Faults::new(5, 1e-3, 1e-3);
    let emulated = print(elf, "faulty", &mut faults);
    assert!(faults.flips > 0 && faults.drops > 0, "the line was clean");
    println!("{} flips, {} drops", faults.flips, faults.drops);
    let simulated = &example().simulated;
    assert_eq!(
        emulated["final_counts"],
        serde_json::json!(simulated.final_counts)
    );
    // Where it was never short of knots even the times are the same.
    if emulated["underruns"] == 0 {
        assert_eq!(emulated["step_digest"], simulated.step_digest.as_str());
    }
}

#[test]
fn the_emergency_input_of_the_emulated_core_lets_no_further_step_out() {
    let Some(elf) = board() else { return };
    let _alone = alone();
    let mut board = Emulator::start(elf, "emergency");
    let mut sender = sender();
    let mut pressed = false;
    let socket = button(&board.socket);
    let press = |event: &SenderEvent, _: &mut Sender| {
        if let SenderEvent::Status(status) = event
            && status.state == DeviceState::Running
            && status.spans_done > 40
            && !pressed
        {
            pressed = true;
            connect(&socket).write_all(b"!").expect("the button");
        }
    };
    stream(
        &mut sender,
        &mut board,
        &mut Faults::new(0, 0.0, 0.0),
        press,
    );
    let SenderState::Failed(SenderError::Fault(fault)) = sender.state() else {
        panic!("{:?}", sender.state());
    };
    assert_eq!(fault.cause, FaultCause::Emergency);
    let report = board.report();
    println!("{report}");
    assert!(pressed && report["faults"] == 1);
    // The tick that is due when the button's interrupt comes is not played any more.
    let after = &report["last_step_after_emergency_ticks"];
    assert!(after.as_i64().expect("a number") < 0, "{after}");
    assert_ne!(
        report["final_counts"],
        serde_json::json!(example().simulated.final_counts)
    );
}

/// Gives commands without a sender; returns the statuses until one satisfies `done`.
fn command(
    board: &mut Emulator,
    messages: &[HostMessage<'_>],
    done: impl Fn(&Status) -> bool,
) -> Status {
    let mut frame = [0; FRAME_BYTES_MAX];
    for (sequence, message) in messages.iter().enumerate() {
        let length = encode_frame(sequence as u16 + 1, message, &mut frame).expect("it fits");
        board
            .line
            .write_all(&frame[..length])
            .expect("the line is open");
    }
    let started = Instant::now();
    let mut decoder = FrameDecoder::new();
    let mut input = [0; 4096];
    let mut last = None;
    loop {
        assert!(started.elapsed() < PATIENCE, "{last:?}");
        let length = board.receive(&mut input).expect("the board listens");
        for &byte in &input[..length] {
            let Some(Ok(frame)) = decoder.push(byte) else {
                continue;
            };
            match DeviceMessage::decode(frame.payload) {
                Ok(DeviceMessage::Status(status)) if done(&status) => return status,
                Ok(DeviceMessage::Fault(fault)) => panic!("{fault}"),
                Ok(DeviceMessage::Refused(refusal)) => panic!("{refusal:?}"),
                Ok(message) => last = Some(message),
                Err(error) => panic!("{error:?}"),
            }
        }
    }
}

#[test]
fn the_emulated_core_homes_to_its_switches() {
    let Some(elf) = board() else { return };
    let _alone = alone();
    let mut board = Emulator::start(elf, "homing");
    let hello = HostMessage::Hello(Hello {
        protocol_version: PROTOCOL_VERSION,
        schema_hash: SCHEMA_HASH,
        host_session: 9,
    });
    let home = HostMessage::Control(Control::Home(JointOrder::ALL));
    let homed = |status: &Status| status.referenced == 0b111 && status.state == DeviceState::Idle;
    let status = command(&mut board, &[hello, home], homed);
    println!("{status:?}");
    assert_eq!(status.switches, 0);
    let machine = emulated_planar();
    let switches = HomingConfiguration::standard(&machine);
    for (joint, towards_max, _) in EMULATED_SWITCHES_STEPS {
        let switch = switches.of(joint).expect("it has a switch");
        let steps_per_unit = machine.joints[usize::from(joint)].steps_per_unit;
        // It rests the way back from the switch, plus what it ran over while the switch settled:
        // no more than a few ticks and the braking at slow speed.
        let away = if towards_max { -1.0 } else { 1.0 } * switch.back_off_natural;
        let expected = (switch.position_natural + away) * steps_per_unit;
        let error = f64::from(status.counts_steps[usize::from(joint)]) - expected;
        assert!(
            error.abs() < 0.05 * steps_per_unit,
            "joint {joint}: {error}"
        );
    }
}
