//! Goal: a print that a power cut broke off goes on where it was: nothing is missing, heights are kept, nothing
//! below the print is touched on the way. Method: a planned part on the firmware library on a virtual clock, cut at
//! random moments; a new controller that knows nothing, standing where the old one stood, is homed, sent back and
//! given the rest, by the log of the first one alone. Every step is recorded where it really happened and held
//! against the steps of a run without a cut. Then the command itself, with heaters, cut twice.
#![cfg(unix)]

use crate::board::sensor::with_flow;
use crate::rig::board::{Board, Host};
use crate::rig::{folder, headway, object, path, stderr, stdout};
use headway::drive::link_log::{LinkLog, Way};
use headway::drive::log_place::last_stream;
use headway::drive::sender::Sender;
use headway::drive::sender_state::{SenderEvent, SenderSetup, SenderState};
use headway::drive::transport::Port;
use headway::job::SegmentStream;
use headway::job::file::{self, JobFile};
use headway::job::frames::WireFrames;
use headway::job::resume::{Reached, Resumption, resume};
use headway::settings::{Settings, machine_file};
use headway_firmware::configuration::heat::HeatConfiguration;
use headway_firmware::configuration::homing::HomingConfiguration;
use headway_firmware::configuration::{MOTORS_MAX, MachineConfiguration};
use headway_firmware::machine::Machine;
use headway_firmware::motion::inputs::Inputs;
use headway_firmware::steps::output::StepOutput;
use headway_protocol::frame::FRAME_BYTES_MAX;
use headway_protocol::message::{Control, DeviceState, JointOrder};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::io::{self, Write};
use std::path::Path;
use std::sync::{Arc, Mutex};

const X: usize = 0;
const Y: usize = 1;
const Z: usize = 2;
const C: usize = 3;
const EXTRUDER: usize = 4;
/// Random cuts.
const CUTS: usize = 24;
/// Longest virtual time of anything, ms.
const PATIENCE_MS: u64 = 1_200_000;
/// Most of a log's end that a cut may take, bytes: what waits for the disk.
const LOST_BYTES: usize = 8000;

/// Ticks for which targets wait before they are steps: half of 40 ms at 2 kHz, and the last of them.
const ON_ITS_WAY_TICKS: u64 = 48;

/// Step tick, motor, and the motor's count where it really stands after the step.
type RealStep = (u64, usize, i64);

/// Where the motors really are.
#[derive(Default)]
struct Real {
    directions: u8,
    counts: [i64; MOTORS_MAX],
    steps: Vec<RealStep>,
}

impl StepOutput for Real {
    fn set_directions(&mut self, directions: u8) {
        self.directions = directions;
    }
    fn step(&mut self, tick: u64, motors: u8) {
        for motor in (0..MOTORS_MAX).filter(|motor| motors >> motor & 1 == 1) {
            let forward = self.directions >> motor & 1 == 1;
            self.counts[motor] += if forward { 1 } else { -1 };
            self.steps.push((tick, motor, self.counts[motor]));
        }
    }
}

#[derive(Clone, Default)]
struct Shared(Arc<Mutex<Vec<u8>>>);

impl Write for Shared {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.lock().map_or(Ok(0), |mut held| held.write(bytes))
    }
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// A machine whose controller has just been switched on, with its motors at these counts of its real axes.
struct World {
    configuration: MachineConfiguration,
    switches: HomingConfiguration,
    machine: Machine,
    real: Real,
    now_ms: u64,
}

impl World {
    fn at(configuration: &MachineConfiguration, session: u32, counts: [i64; MOTORS_MAX]) -> World {
        let switches = HomingConfiguration::standard(configuration);
        World {
            machine: Machine::with_switches(configuration, &switches, session).unwrap(),
            configuration: configuration.clone(),
            switches,
            real: Real {
                counts,
                ..Real::default()
            },
            now_ms: 0,
        }
    }

    fn pressed(&self) -> u8 {
        let mut mask = 0;
        for switch in &self.switches.joints {
            let number = usize::from(switch.joint);
            let steps_per_unit = self.configuration.joints[number].steps_per_unit;
            let at = self.real.counts[number] as f64 / steps_per_unit;
            let pressed = match switch.towards_max {
                true => at >= switch.position_natural,
                false => at <= switch.position_natural,
            };
            mask |= u8::from(pressed) << number;
        }
        mask
    }

    /// A millisecond of host, line and machine.
    fn turn(&mut self, sender: &mut Sender, log: Option<&mut LinkLog>) {
        let (now_us, mut log) = (1000 * self.now_ms, log);
        let mut note = |way, bytes: &[u8]| {
            if let Some(log) = &mut log {
                log.bytes(now_us, way, bytes);
            }
        };
        let mut out = [0u8; FRAME_BYTES_MAX];
        while let Some(length) = sender.poll_transmit(now_us, &mut out) {
            note(Way::Down, &out[..length]);
            self.machine.handle_bytes(&out[..length]);
        }
        for _ in 0..self.configuration.servo_hz / 1000 {
            self.machine.set_inputs(Inputs {
                switches: self.pressed(),
                emergency: false,
            });
            self.machine.run_servo_interval(&mut self.real);
        }
        loop {
            let length = self.machine.poll_report(&mut out);
            if length == 0 {
                break;
            }
            note(Way::Up, &out[..length]);
            sender.handle_bytes(now_us, &out[..length]);
        }
        self.now_ms += 1;
        assert!(self.now_ms < PATIENCE_MS, "{:?}", sender.state());
    }

    /// Gives a command by hand and waits until the machine rests.
    fn order(&mut self, control: Control) {
        let mut sender = Sender::talking(self.now_ms as u32);
        let mut taken = false;
        let moves = |state| matches!(state, DeviceState::Jogging | DeviceState::Homing);
        while !taken || moves(self.machine.motion().state()) {
            self.turn(&mut sender, None);
            while let Some(event) = sender.poll_event() {
                assert!(
                    !matches!(event, SenderEvent::Refused(_)),
                    "{control:?}: {event:?}"
                );
                // Nobody is heard before the greeting.
                if matches!(event, SenderEvent::Connected(_)) {
                    sender.command(control);
                }
                taken |= event == SenderEvent::Taken(control);
            }
        }
        assert_eq!(self.machine.motion().fault(), None, "{control:?}");
    }

    /// Streams, to the end or until so many milliseconds after the first move; true at the end.
    fn stream(
        &mut self,
        frames: &WireFrames,
        cut_ms: Option<u64>,
        mut log: Option<&mut LinkLog>,
    ) -> bool {
        let setup = SenderSetup {
            host_session: 9,
            machine_hash: self.configuration.hash(),
            servo_hz: self.configuration.servo_hz,
            resume: false,
            solution: 0,
        };
        let mut sender = Sender::new(frames.clone(), setup);
        let mut begun_ms = None;
        loop {
            self.turn(&mut sender, log.as_deref_mut());
            while sender.poll_event().is_some() {}
            match sender.state() {
                SenderState::Done => return true,
                SenderState::Failed(error) => panic!("{error}"),
                _ => {}
            }
            if begun_ms.is_none() && self.machine.motion().stream_start_ticks().is_some() {
                begun_ms = Some(self.now_ms);
            }
            if let (Some(begun_ms), Some(cut_ms)) = (begun_ms, cut_ms)
                && self.now_ms >= begun_ms + cut_ms
            {
                return false;
            }
        }
    }

    /// Step tick at which the stream began.
    fn origin(&self) -> u64 {
        let servo = self
            .machine
            .motion()
            .stream_start_ticks()
            .expect("a stream");
        servo * u64::from(self.machine.interval_ticks())
    }
}

/// Two squares of three layers.
fn planned(folder: &Path) -> (JobFile, SegmentStream, Settings) {
    let job = planned_file(folder, "");
    let mut open = std::fs::File::open(&job).unwrap();
    let file = file::read(&mut open).unwrap();
    let stream = file.stream().unwrap();
    let settings = machine_file::from_toml(&file.header.texts["settings"]).unwrap();
    (file, stream, settings)
}

fn planned_file(folder: &Path, material: &str) -> String {
    let machine = folder.join("machine.toml");
    let text = stdout(&headway(&["machine", "new", "--kind", "planar"]));
    std::fs::write(&machine, text + material).unwrap();
    let part = folder.join("square.json");
    let square = r#"{"units":"mm","exterior":[[0,0],[8,0],[8,8],[0,8]]}"#;
    std::fs::write(&part, square).unwrap();
    let job = folder.join("square.hwj").display().to_string();
    let planned = headway(&[
        "plan",
        path(&part),
        "-m",
        path(&machine),
        "--layers",
        "3",
        "--copies",
        "2",
        "--copy-gap",
        "4",
        "-o",
        &job,
    ]);
    assert!(planned.status.success(), "{}", stderr(&planned));
    job
}

/// Counts at a pose of a planar machine.
fn counts_at(configuration: &MachineConfiguration, stream: &SegmentStream) -> [i64; MOTORS_MAX] {
    let mut counts = [0; MOTORS_MAX];
    for (joint, (channel, units)) in [(0, 1e4), (1, 1e4), (2, 1e4), (5, 1e6)]
        .into_iter()
        .enumerate()
    {
        let at = f64::from(stream.start[channel]) / units;
        counts[joint] = (at * configuration.joints[joint].steps_per_unit).round() as i64;
    }
    counts
}

/// Counts of each motor by its steps at a tick, taken in order of time.
struct Follow<'a> {
    steps: std::iter::Peekable<std::slice::Iter<'a, RealStep>>,
    counts: [i64; MOTORS_MAX],
}

impl<'a> Follow<'a> {
    fn new(steps: &'a [RealStep], counts: [i64; MOTORS_MAX]) -> Follow<'a> {
        Follow {
            steps: steps.iter().peekable(),
            counts,
        }
    }

    fn until(&mut self, tick: u64) -> [i64; MOTORS_MAX] {
        while let Some((_, motor, count)) = self.steps.next_if(|step| step.0 <= tick) {
            self.counts[*motor] = *count;
        }
        self.counts
    }
}

/// What is left by a log alone.
fn by_log(text: &[u8], file: &JobFile, stream: &SegmentStream, settings: &Settings) -> Resumption {
    let logged = last_stream(&mut &*text).unwrap();
    let reached = Reached::of(&logged, stream, &file.frames).unwrap();
    let pass = reached.pass(stream).unwrap();
    let machine = &file.header.machine;
    resume(stream, &[], pass, Some(reached), Some(settings), machine).unwrap()
}

/// What was seen of a cut.
#[derive(Debug, Default)]
struct Seen {
    off_steps: i64,
    crossing_mm: f64,
    again_s: f64,
}

/// The whole of it, with the steps of a run without a cut.
struct Whole<'a> {
    file: &'a JobFile,
    stream: &'a SegmentStream,
    settings: &'a Settings,
    begin: [i64; MOTORS_MAX],
    /// Ticks from the stream's start.
    steps: Vec<RealStep>,
}

fn from_start(world: &World) -> Vec<RealStep> {
    let origin = world.origin();
    let steps = world.real.steps.iter();
    steps
        .filter(|step| step.0 >= origin)
        .map(|&(tick, motor, count)| (tick - origin, motor, count))
        .collect()
}

impl Whole<'_> {
    fn cut_and_resume(&self, cut_ms: u64, random: &mut Pcg64Mcg) -> Seen {
        let configuration = &self.file.header.machine;
        // The first half, and what its log kept.
        let file = Shared::default();
        let mut log = LinkLog::new(Box::new(file.clone()), Some(configuration));
        let mut world = World::at(configuration, 1, self.begin);
        assert!(!world.stream(&self.file.frames, Some(cut_ms), Some(&mut log)));
        let done = from_start(&world);
        let ticks_per_ms = u64::from(configuration.step_hz / 1000);
        let cut_tick = world.now_ms * ticks_per_ms - world.origin();
        assert!(
            self.steps[..done.len()] == done[..],
            "the same job up to the cut"
        );
        let mut text = file.0.lock().unwrap().clone();
        let lost = random.random_range(0..LOST_BYTES).min(text.len() / 2);
        text.truncate(text.len() - lost);
        let again = by_log(&text, self.file, self.stream, self.settings);

        // Nothing is missing: no material comes out between the cut and the rest's begin, which is the job from there
        // on (below).
        let interval = u64::from(world.machine.interval_ticks());
        let rest_begin = again.rest.cut_tick * interval;
        let mut at = self.begin[EXTRUDER];
        for &(tick, motor, count) in &self.steps {
            if motor == EXTRUDER {
                let comes_out = count > at;
                assert!(
                    !comes_out || tick < cut_tick || tick >= rest_begin,
                    "{tick}"
                );
                at = count;
            }
        }

        // Power comes back: the motors stand where they stood, nobody knows it.
        let mut world = World::at(configuration, 2, world.real.counts);
        let mut stood = world.real.counts;
        world.order(Control::Home(JointOrder::ALL));
        let turned = world.real.counts[C] as f64 / configuration.joints[C].steps_per_unit;
        world.order(Control::SetJoint {
            joint: C as u8,
            position_units: (turned * 1e6).round() as i32,
        });
        // Every second time the head waits low beside the part, as after looking at it.
        if cut_ms % 2 == 1 {
            self.assert_clear(&world, stood, &done, &again);
            let mut beside = again.way.above;
            (beside[0], beside[1], beside[2]) = (200_000, 200_000, 3_000);
            world.order(Control::GoTo(beside));
            world.real.steps.clear();
            stood = world.real.counts;
        }
        for pose in [again.way.above, again.way.start] {
            world.order(Control::GoTo(pose));
        }
        let crossing_mm = self.assert_clear(&world, stood, &done, &again);
        let frames = WireFrames::encode(&again.rest.stream).unwrap();
        let counts = world.real.counts;
        assert!(world.stream(&frames, None, None));
        Seen {
            off_steps: self.assert_same(&from_start(&world), counts, &again, interval),
            crossing_mm,
            again_s: again.parts.again.time_s,
        }
    }

    /// On the way nothing crosses lower than above what was printed; least height of that, mm.
    fn assert_clear(
        &self,
        world: &World,
        stood: [i64; MOTORS_MAX],
        done: &[RealStep],
        again: &Resumption,
    ) -> f64 {
        let z_steps = self.file.header.machine.joints[Z].steps_per_unit;
        // The highest that material came out at.
        let mut at = self.begin;
        let mut top = i64::MIN;
        for &(_, motor, count) in done {
            if motor == EXTRUDER && count > at[EXTRUDER] {
                top = top.max(at[Z]);
            }
            at[motor] = count;
        }
        // Down to the pass's own height at most.
        let lowest = (f64::from(again.rest.stream.start[2]) * 1e-4 * z_steps).round() as i64;
        let mut at = stood;
        let mut least_mm = f64::INFINITY;
        for &(_, motor, count) in &world.real.steps {
            at[motor] = count;
            if motor == X || motor == Y || motor == C {
                least_mm = least_mm.min((at[Z] - top.max(0)) as f64 / z_steps);
            }
            assert!(at[Z] >= lowest.min(stood[Z]) - 1, "{} {lowest}", at[Z]);
        }
        assert!(least_mm > 4.9, "{least_mm}");
        least_mm
    }

    /// The rest's steps are the job's: largest difference of the joints, and the same volume from tick to tick.
    fn assert_same(
        &self,
        rest: &[RealStep],
        counts: [i64; MOTORS_MAX],
        again: &Resumption,
        interval: u64,
    ) -> i64 {
        let (cut, lead) = (again.rest.cut_tick, again.rest.lead_ticks);
        let mut whole = Follow::new(&self.steps, self.begin);
        let mut left = Follow::new(rest, counts);
        let end = self.stream.marks.last().unwrap().end_tick;
        let c_steps = self.file.header.machine.joints[C].steps_per_unit;
        let turn = (c_steps * std::f64::consts::TAU).round() as i64;
        // The last of the way there is on its way in the whole job, and a prime that the pass is given here has not
        // come out.
        let first = if again.rest.primed {
            ON_ITS_WAY_TICKS
        } else {
            0
        };
        let from = [
            whole.until((cut + first) * interval),
            left.until((lead + first) * interval),
        ];
        let mut off_steps = 0;
        for tick in (cut + ON_ITS_WAY_TICKS..=end + 600).step_by(4) {
            let a = whole.until(tick * interval);
            let b = left.until((tick - cut + lead) * interval);
            for joint in [X, Y, Z] {
                off_steps = off_steps.max((a[joint] - b[joint]).abs());
            }
            // The nozzle takes the shorter way: whole turns do not count.
            let turned = (a[C] - b[C]).rem_euclid(turn);
            off_steps = off_steps.max(turned.min(turn - turned));
            let laid = [
                a[EXTRUDER] - from[0][EXTRUDER],
                b[EXTRUDER] - from[1][EXTRUDER],
            ];
            assert!((laid[0] - laid[1]).abs() <= 1, "{tick}: {laid:?}");
        }
        off_steps
    }
}

#[test]
fn a_cut_print_goes_on_with_nothing_missing_and_every_height_kept() {
    let folder = folder("cuts");
    let (file, stream, settings) = planned(&folder);
    let configuration = &file.header.machine;
    let begin = counts_at(configuration, &stream);
    let mut world = World::at(configuration, 1, begin);
    assert!(world.stream(&file.frames, None, None));
    let whole = Whole {
        file: &file,
        stream: &stream,
        settings: &settings,
        begin,
        steps: from_start(&world),
    };
    let passes = stream
        .marks
        .iter()
        .filter_map(|mark| mark.pass)
        .max()
        .unwrap();
    assert!(passes >= 4, "{passes} passes");
    let job_ms = stream.marks.last().unwrap().end_tick / 2;
    let mut random = Pcg64Mcg::seed_from_u64(30);
    let mut seen = Seen {
        crossing_mm: f64::INFINITY,
        ..Seen::default()
    };
    for _ in 0..CUTS {
        // Behind its last pass nothing is left.
        let cut_ms = random.random_range(50..job_ms - 500);
        let cut = whole.cut_and_resume(cut_ms, &mut random);
        seen.off_steps = seen.off_steps.max(cut.off_steps);
        seen.crossing_mm = seen.crossing_mm.min(cut.crossing_mm);
        seen.again_s = seen.again_s.max(cut.again_s);
    }
    println!("{CUTS} cuts in {job_ms} ms of {passes} passes: {seen:?}");
    // Homing finds a switch to a step.
    assert!(seen.off_steps <= 1, "{seen:?}");
}

/// Goal: the command begins again by its log, hot before it moves, and by the log of the rest again; another job's
/// log and a damaged one are refused with what to do; the correction of the flow is kept. Method: boards with heaters that
/// are switched off twice, a sensor's program beside the first print alone.
#[test]
fn the_command_resumes_from_its_logs_with_heat_in_order() {
    let folder = folder("command");
    let material = "\n[material]\nhot_end_c = 35\nfirst_layer_hot_end_c = 40\nfan_pct = 50\nfan_from_layer = 2\n\
                    \n[measure]\nflow_change_per_s = 1.0\n";
    let job = planned_file(&folder, material);
    let text = std::fs::read_to_string(folder.join("machine.toml")).unwrap();
    let settings = machine_file::from_toml(&text).unwrap();
    let machine = path(&folder.join("machine.toml")).to_string();
    let board = || {
        let port = Port::Unix(folder.join("board"));
        let mut heat = HeatConfiguration::standard();
        // The job is printed at 35 to 40 °C: a test does not wait for more.
        heat.heaters[0].extrude_min_c = 30.0;
        Board::of_machine(&port, 4.0, settings.machine.clone(), heat)
    };
    let log = |name: &str| folder.join(name).display().to_string();
    let (first, second, third) = (log("1.log"), log("2.log"), log("3.log"));

    let on = board();
    let sensor = with_flow(&folder, "0.9");
    let begun = [
        "stream", &job, "--port", &on.port, "--log", &first, "--sensor", &sensor,
    ];
    let mut host = Host::start(&begun);
    wait_for_spans(&on.port, &spans_of_layer(&job, 1));
    host.child.kill().unwrap();
    host.child.wait().unwrap();
    on.end();

    let on = board();
    let begin = |from: &str, to: &str| {
        [
            "stream",
            &job,
            "--port",
            &on.port,
            "--resume-from",
            from,
            "--log",
            to,
        ]
        .map(str::to_string)
    };
    let ask = |arguments: &[String]| {
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        headway(&arguments)
    };
    let refused = ask(&begin(&first, &second));
    assert_eq!(refused.status.code(), Some(1));
    assert!(
        stderr(&refused).contains("does not know where x, y, z, c is"),
        "{}",
        stderr(&refused)
    );
    let onto = ask(&begin(&first, &first));
    assert_eq!(onto.status.code(), Some(2), "{}", stderr(&onto));
    make_ready(&on.port, &machine);
    let begun = begin(&first, &second);
    let begun: Vec<&str> = begun.iter().map(String::as_str).collect();
    let mut host = Host::start(&begun);
    host.wait_for("to the pass's start");
    let said = host.said.lock().unwrap().clone();
    let told = [
        "layer 2 of 3",
        "left out as printed",
        "printed again for certain",
        "heating",
        "gone cold",
        "the flow is 90 % of the plan's",
    ];
    for words in told {
        assert!(said.contains(words), "{words}: {said}");
    }
    // The second layer's orders, before anything has moved down.
    let status = object(&headway(&["board", "status", "--port", &on.port, "--json"]));
    assert_eq!(status["heaters"][0]["target_celsius"], 35.0, "{status:?}");
    assert!(
        status["heaters"][0]["celsius"].as_f64().unwrap() > 32.0,
        "{status:?}"
    );
    wait_for_running(&on.port);
    // Until the log is on its way to the disk.
    std::thread::sleep(std::time::Duration::from_millis(400));
    host.child.kill().unwrap();
    host.child.wait().unwrap();
    on.end();

    let on = board();
    make_ready(&on.port, &machine);
    let begun = [
        "stream",
        &job,
        "--port",
        &on.port,
        "--resume-from",
        &second,
        "--log",
        &third,
        "--json",
    ];
    let figures = object(&headway(&begun));
    assert_eq!(figures["done"], true);
    assert_eq!(figures["resumed"]["layer"], 1, "{figures:?}");
    let status = object(&headway(&["board", "status", "--port", &on.port, "--json"]));
    assert_eq!(status["state"], "finished", "{status:?}");
    // By the log of the second, which knows it from that of the first.
    assert_eq!(status["flow_percent"], 90, "{status:?}");
    let nothing = ["stream", &job, "--port", &on.port, "--resume-from", &third];
    let nothing = headway(&nothing);
    assert!(
        stderr(&nothing).contains("nothing is left"),
        "{}",
        stderr(&nothing)
    );
    on.end();
    refuses_what_is_no_log_of_it(&folder, &job, &first);
}

fn refuses_what_is_no_log_of_it(folder: &Path, job: &str, log: &str) {
    let text = std::fs::read_to_string(log).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    let damaged = folder.join("damaged.log");
    let middle = lines.len() / 2;
    let with = [&lines[..middle], &["12 ? zz"], &lines[middle..]]
        .concat()
        .join("\n");
    std::fs::write(&damaged, with).unwrap();
    let (other, _) = crate::rig::board::job(folder, 1);
    let [damaged, other] = [path(&damaged), &other];
    let cases = [
        (job, damaged, 1, "direction"),
        (other, log, 1, "this is the log of job"),
        (job, job, 1, "no link log"),
        (job, "nowhere.log", 1, "nowhere.log"),
        (job, "pass:999", 1, "no pass 999"),
        (job, "layer:4", 1, "layers 1 to 3"),
        (job, "layer:x", 2, "no number"),
    ];
    for (job, from, code, words) in cases {
        let refused = headway(&[
            "stream",
            job,
            "--port",
            "unix:/nowhere",
            "--resume-from",
            from,
        ]);
        let said = stderr(&refused);
        assert!(said.contains(words), "{from}: {said}");
        assert_eq!(refused.status.code(), Some(code), "{from}: {said}");
    }
    // Z that comes down onto the bed would come down onto the part.
    let text = std::fs::read_to_string(folder.join("machine.toml")).unwrap();
    let machine = folder.join("down.toml");
    std::fs::write(&machine, text + "\n[switches.z]\nend = \"min\"\n").unwrap();
    let down = folder.join("down.hwj");
    let part = folder.join("square.json");
    let planned = headway(&["plan", path(&part), "-m", path(&machine), "-o", path(&down)]);
    assert!(planned.status.success(), "{}", stderr(&planned));
    let asked = [
        "stream",
        path(&down),
        "--port",
        "unix:/nowhere",
        "--resume-from",
        "layer:1",
    ];
    let refused = stderr(&headway(&asked));
    assert!(refused.contains("--part-clear"), "{refused}");
    let clear = stderr(&headway(&[&asked[..], &["--part-clear"]].concat()));
    assert!(clear.contains("/nowhere"), "{clear}");
}

/// Homed, and its nozzle declared.
fn make_ready(port: &str, machine: &str) {
    for asked in [
        &["board", "home", "--port", port][..],
        &[
            "board",
            "set-joint",
            "c",
            "0",
            "-m",
            machine,
            "--port",
            port,
        ],
    ] {
        let done = headway(asked);
        assert!(done.status.success(), "{}", stderr(&done));
    }
}

/// Spans before a layer, and of the whole job.
fn spans_of_layer(job: &str, layer: u32) -> [u64; 2] {
    let file = std::fs::read(job).unwrap();
    let stream = file::read(&mut std::io::Cursor::new(file))
        .unwrap()
        .stream()
        .unwrap();
    let [begin, _] = stream.ticks_of_layer(layer);
    let spans = stream.spans();
    let before = spans.filter(|span| span.start_tick < begin).count();
    [before as u64, stream.knots.len() as u64]
}

fn wait_for_spans(port: &str, spans: &[u64; 2]) {
    wait_for(port, |status| {
        let done = status["spans_done"].as_u64().unwrap();
        // Well into the layer, and far from its end.
        done > spans[0] + (spans[1] - spans[0]) / 8
    });
}

fn wait_for_running(port: &str) {
    wait_for(port, |status| {
        status["state"] == "running" && status["spans_done"].as_u64().unwrap() > 20
    });
}

fn wait_for(port: &str, there: impl Fn(&serde_json::Map<String, serde_json::Value>) -> bool) {
    for _ in 0..3000 {
        let status = object(&headway(&["board", "status", "--port", port, "--json"]));
        if there(&status) {
            return;
        }
    }
    panic!("it never comes there");
}
