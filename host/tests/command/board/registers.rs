//! Goal: the image to flash boots behind a boot loader that leaves everything on, talks over its own
//! serial port, and makes the very steps of the simulation at a real chip's registers. Method: QEMU's
//! netduinoplus2 (STM32F405) runs the octopus image, built with `emulated` (no clocks to set
//! up); the command streams an example to it; the GPIO writes that QEMU logs are decoded by the board's
//! pin table. Skipped, and said so, where QEMU or the target is missing;
//! `HEADWAY_DEMAND_EMULATOR=1` makes that a failure.
#![cfg(unix)]

use crate::rig::{command, example, folder, headway, path, stderr, succeeded};
use headway::drive::record::Step;
use headway::drive::simulator::{Simulator, SimulatorSetup};
use headway_firmware::board::octopus::BOARD;
use headway_firmware::board::table::{DIRECTION, STEP};
use headway_firmware::configuration::board_name::BoardName;
use headway_firmware::steps::output::Pin;
use headway_tests::elf::Elf;
use headway_tests::emulation::board_flash::named_flash;
use headway_tests::emulation::board_image::{alone, build, skipped};
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Flash of the boot loader, and of the image behind it.
const LOADER_FLASH: u32 = 0x0800_0000;
const IMAGE_FLASH: u32 = 0x0800_8000;
/// The emulator logs some million writes; a busy machine needs its time for them.
const PATIENCE: Duration = Duration::from_secs(400);
const FEATURES: &str = "octopus-serial,prove-no-panic,emulated";
/// The write that begins every step tick: the first of those that end pulses.
const TICK: (usize, u32) = (2, 1 << (13 + 16));
/// RX, which must not float.
const RX: Pin = BOARD.serial[1];

/// Writes a binary's flash to a file; its first address.
fn flash_file(elf: &Elf, file: &Path) -> u32 {
    let (address, image) = elf.image();
    std::fs::write(file, image).expect("the folder is there");
    address
}

/// Writes the board's flash to a file, with settings that name it; its first address.
fn image_file(file: &Path) -> u32 {
    let elf = build("octopus", FEATURES);
    let (address, image) = named_flash(&elf, BoardName::Octopus11);
    std::fs::write(file, image).expect("the folder is there");
    address
}

/// A write to a register of a port: port, offset, value.
type PortWrite = (usize, usize, u32);

/// Of a line of the emulator's log.
fn port_write(line: &str) -> Option<PortWrite> {
    let rest = line.strip_prefix("GPIO")?;
    let port = rest.bytes().next()?.checked_sub(b'A')?;
    let (_, rest) = rest.split_once("write (size 4, offset 0x")?;
    let (offset, rest) = rest.split_once(", value 0x")?;
    let value = rest.trim_end().trim_end_matches(')');
    Some((
        port.into(),
        usize::from_str_radix(offset, 16).ok()?,
        u32::from_str_radix(value, 16).ok()?,
    ))
}

/// What the port writes say that the motors did.
struct Decoder {
    levels: [u32; 16],
    ticks: u64,
    steps: Vec<Step>,
    /// Pull resistors that were set.
    pulls: BTreeMap<usize, u32>,
    watchdog_first: Option<bool>,
}

impl Decoder {
    fn new() -> Self {
        Self {
            levels: [0; 16],
            ticks: 0,
            steps: Vec::new(),
            pulls: BTreeMap::new(),
            watchdog_first: None,
        }
    }

    fn take(&mut self, line: &str) {
        if line.contains("value 0x0000cccc") {
            self.watchdog_first.get_or_insert(true);
        }
        let Some((port, offset, value)) = port_write(line) else {
            return;
        };
        self.watchdog_first.get_or_insert(false);
        match offset {
            0x0c => {
                // Ports read as zero here: what was set before is not written again.
                *self.pulls.entry(port).or_default() |= value;
            }
            0x18 => self.set_reset(port, value),
            _ => {}
        }
    }

    fn set_reset(&mut self, port: usize, value: u32) {
        if (port, value) == TICK {
            self.ticks += 1;
        }
        let (set, reset) = (value & 0xffff, value >> 16);
        self.levels[port] = self.levels[port] & !reset | set;
        for (motor, pin) in (0..).zip(BOARD.column(STEP)) {
            if pin.0 == port && set >> pin.1 & 1 == 1 {
                let direction = BOARD.column(DIRECTION)[usize::from(motor)];
                self.steps.push(Step {
                    tick: self.ticks,
                    motor,
                    forward: self.levels[direction.0] >> direction.1 & 1 == 1,
                });
            }
        }
    }

    /// The steps from the first one on, in order of ticks and motors.
    fn into_steps(mut self) -> Vec<Step> {
        self.steps.sort_by_key(|step| (step.tick, step.motor));
        from_first(self.steps)
    }
}

/// Ticks from the first step on.
fn from_first(mut steps: Vec<Step>) -> Vec<Step> {
    let first = steps.first().map_or(0, |step| step.tick);
    steps.iter_mut().for_each(|step| step.tick -= first);
    steps
}

/// A board in QEMU behind the boot loader. Killed when dropped.
struct Emulator {
    process: Child,
    port: String,
    monitor: PathBuf,
    decoded: Option<JoinHandle<Decoder>>,
    /// Told when so many steps were made.
    moving: Receiver<()>,
}

/// Steps after which a test meddles with a job.
const UNDER_WAY_STEPS: usize = 3000;

impl Emulator {
    fn start(folder: &Path) -> Self {
        let [loader, image] = ["loader.bin", "image.bin"].map(|name| folder.join(name));
        let loader_at = flash_file(&build("boot_loader", ""), &loader);
        let image_at = image_file(&image);
        assert_eq!((loader_at, image_at), (LOADER_FLASH, IMAGE_FLASH));
        let [serial, monitor] = ["serial", "monitor"].map(|name| folder.join(name));
        let socket = |path: &Path| format!("unix:{},server=on,wait=off", path.display());
        let mut process = Command::new("qemu-system-arm");
        process
            .args(["-machine", "netduinoplus2", "-nographic", "-d", "unimp"])
            .args(["-icount", "shift=4", "-monitor", &socket(&monitor)])
            // The board uses the second USART.
            .args(["-serial", "null", "-serial", &socket(&serial)])
            .args(["-kernel", path(&loader)])
            .arg("-device")
            .arg(format!(
                "loader,file={},addr={image_at:#x}",
                image.display()
            ))
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped());
        let mut process = process.spawn().expect("QEMU starts");
        let log = process.stderr.take().expect("it is piped");
        let (told, moving) = channel();
        let decoded = std::thread::spawn(move || {
            let mut decoder = Decoder::new();
            let mut log = BufReader::with_capacity(1 << 16, log);
            let mut line = String::new();
            while log.read_line(&mut line).is_ok_and(|length| length > 0) {
                decoder.take(&line);
                line.clear();
                if decoder.steps.len() == UNDER_WAY_STEPS {
                    // Nobody may wait for it.
                    let _ = told.send(());
                }
            }
            decoder
        });
        while !serial.exists() {
            std::thread::sleep(Duration::from_millis(20));
        }
        Self {
            process,
            port: format!("unix:{}", serial.display()),
            monitor,
            decoded: Some(decoded),
            moving,
        }
    }

    /// Begins to stream a job with the command; returns once the board moves.
    fn print_until_it_moves(&self, job: &str) -> Child {
        let streaming = command(&["stream", job, "--no-heat", "--port", &self.port]).spawn();
        let moves = self.moving.recv_timeout(PATIENCE);
        moves.expect("the board moves");
        streaming.expect("the command starts")
    }

    /// Ends the emulator; what its log said.
    fn end(mut self) -> Decoder {
        let _ = self.process.kill();
        let decoded = self.decoded.take().expect("once").join();
        decoded.expect("the log can be read")
    }
}

impl Drop for Emulator {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// Says a line to one of the emulator's sockets; what it answers within half a second.
fn say(socket: &Path, line: &str) -> String {
    let mut stream = UnixStream::connect(socket).expect("QEMU listens");
    let patience = Some(Duration::from_millis(500));
    stream.set_read_timeout(patience).expect("a timeout");
    writeln!(stream, "{line}").expect("QEMU reads");
    let mut answer = String::new();
    let mut bytes = [0; 4096];
    while let Ok(length @ 1..) = stream.read(&mut bytes) {
        answer += &String::from_utf8_lossy(&bytes[..length]);
    }
    answer
}

/// Plans the example; the job file.
fn plan(folder: &Path) -> String {
    let job = folder.join("taper.hwj").display().to_string();
    let example = example("taper.json");
    succeeded(&headway(&["plan", &example, "--scale", "0.5", "-o", &job]));
    job
}

/// The steps of the simulation of a job.
fn simulated(job: &str) -> Vec<Step> {
    let mut file = std::fs::File::open(job).expect("the job");
    let file = headway::job::file::read(&mut file).expect("a job file");
    let stream = file.stream().expect("its stream");
    let ticks = stream
        .knots
        .iter()
        .map(|knot| u64::from(knot.duration_ticks));
    let simulator = Simulator::new(
        file.frames.clone(),
        ticks.sum(),
        &file.header.machine,
        &SimulatorSetup::default(),
    );
    let simulation = simulator.expect("a machine").run(|_| {}).expect("an end");
    from_first(simulation.motion.steps.iter().collect())
}

#[test]
fn the_octopus_image_makes_the_simulations_steps_at_the_ports_of_a_chip() {
    if skipped() {
        return;
    }
    let _alone = alone();
    let folder = folder("octopus");
    let job = plan(&folder);
    let emulator = Emulator::start(&folder);
    let begun = Instant::now();
    succeeded(&headway(&[
        "stream",
        &job,
        "--no-heat",
        "--port",
        &emulator.port,
    ]));
    let decoded = emulator.end();
    let expected = simulated(&job);
    println!(
        "{} steps in {} ticks, {:?}",
        decoded.steps.len(),
        decoded.ticks,
        begun.elapsed()
    );
    assert_eq!(decoded.watchdog_first, Some(true), "before any pin");
    let rx_pull = decoded
        .pulls
        .get(&RX.0)
        .map_or(0, |pulls| pulls >> (2 * RX.1) & 3);
    assert_eq!(rx_pull, 1, "RX is pulled up");
    let steps = decoded.into_steps();
    let differs = steps.iter().zip(&expected).position(|(a, b)| a != b);
    assert_eq!(differs, None, "of {} steps", expected.len());
    assert_eq!(steps.len(), expected.len());
    assert!(steps.len() > 20_000, "the example is no small one");
}

#[test]
fn a_board_that_is_reset_in_mid_job_is_noticed() {
    if skipped() {
        return;
    }
    let _alone = alone();
    let folder = folder("reset");
    let job = plan(&folder);
    let emulator = Emulator::start(&folder);
    let streaming = emulator.print_until_it_moves(&job);
    say(&emulator.monitor, "system_reset");
    let begun = Instant::now();
    let output = streaming.wait_with_output().expect("it ends");
    println!("noticed after {:?}: {}", begun.elapsed(), stderr(&output));
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains("restarted"), "{}", stderr(&output));
}

#[test]
fn an_image_claims_no_flash_but_its_own() {
    if skipped() {
        return;
    }
    let _alone = alone();
    for (bin, features, first, end) in [
        ("octopus", "octopus", IMAGE_FLASH, 0x0808_0000),
        ("octopus", "octopus-serial", IMAGE_FLASH, 0x0808_0000),
        ("spider", "octopus", IMAGE_FLASH, 0x0808_0000),
        ("spider22", "octopus", IMAGE_FLASH, 0x0808_0000),
        ("boot_loader", "", LOADER_FLASH, IMAGE_FLASH),
    ] {
        let elf = build(bin, features);
        let segments = elf.segments();
        println!("{bin} {features}: {segments:x?}");
        assert_eq!(segments.iter().map(|s| s.address).min(), Some(first));
        let ends = segments.iter().map(|s| s.address + s.bytes).max();
        assert!(ends <= Some(end), "{bin} ends at {ends:x?}");
    }
}

#[test]
fn the_octopus_keeps_its_settings_out_of_reach_of_its_code() {
    if skipped() {
        return;
    }
    let _alone = alone();
    let elf = build("octopus", FEATURES);
    // Sector 3, and the last one with what is behind the chip's 512 KiB.
    let kept = [(0x0800_c000, 0x0801_0000), (0x0806_0000, 0x0900_0000)];
    let flashed = elf.segments().iter().filter(|s| s.address >= LOADER_FLASH);
    let flashed: Vec<_> = flashed.filter(|s| s.address < 0x2000_0000).collect();
    assert!(flashed.len() > 1, "{flashed:?}");
    for segment in flashed {
        let end = segment.address + segment.bytes;
        let is_free = kept.map(|(from, to)| end <= from || segment.address >= to);
        assert_eq!(is_free, [true; 2], "{segment:x?}");
    }
}
