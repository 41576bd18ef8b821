//! Figures of the firmware on a real core: instructions, memory, panics.
//!
//! Plays jobs that were planned once and kept (`tests/data/firmware_bench`) on the emulated Cortex-M4F
//! through `qemu_bench`, reads sizes and symbols out of the board's ELF, and prints one JSON object.
//! Instructions are not cycles: the emulator has neither pipeline nor flash wait states.

use headway_firmware::configuration::MachineConfiguration;
use headway_firmware::configuration::shaping::{Shaper, ShaperKind};
use headway_firmware::design::QUEUE_KNOTS;
use headway_protocol::frame::{FRAME_BYTES_MAX, encode_frame, encode_payload, hash_of};
use headway_protocol::message::{
    Control, Hello, HostMessage, PROTOCOL_VERSION, SCHEMA_HASH, Start,
};
use headway_protocol::units::ChannelPoint;
use headway_tests::elf::Elf;
use headway_tests::emulation::board_image::{image, missing};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::error::Error;
use std::path::Path;
use std::process::Command;

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
const CORE_HZ: f64 = 168e6;
/// What the core itself pushes at the entry of an interrupt, floating point included.
const EXCEPTION_FRAME_BYTES: u64 = 104;
/// 64 ns of virtual time per instruction, so that the 40 ns timer resolves each one.
const ICOUNT: &str = "shift=6,sleep=off";

/// A job of the bench: kept as it was planned once, so that a planner that changes does not move the measure.
struct Job {
    machine: &'static str,
    name: String,
    configuration: MachineConfiguration,
    start: ChannelPoint,
    solution: u8,
    /// The stream's messages in their order.
    payloads: Vec<Vec<u8>>,
    /// Feed override, per cent.
    override_percent: u16,
}

impl Job {
    /// The same with the joints shaped that swing a frame: X and Y, or all but the nozzle of an arm.
    fn shaped(&self) -> Self {
        let mut configuration = self.configuration.clone();
        let joints = if self.machine == "arm6" { 6 } else { 2 };
        configuration.shapers[..joints].fill(BENCH_SHAPER);
        Self {
            name: format!("{}, {joints} joints shaped", self.name),
            configuration,
            payloads: self.payloads.clone(),
            ..*self
        }
    }

    /// The same at the fastest feed override.
    fn doubled(&self) -> Self {
        Self {
            name: format!("{}, at 200 %", self.name),
            configuration: self.configuration.clone(),
            payloads: self.payloads.clone(),
            override_percent: 200,
            ..*self
        }
    }
}

/// The shaper of the bench: one that costs as much as any.
const BENCH_SHAPER: Shaper = Shaper {
    kind: ShaperKind::Ei,
    frequency_hz: 43.0,
    damping: 0.1,
};

/// Machine, file in `tests/data/firmware_bench`, what it is.
const JOBS: [(&str, &str, &str); 5] = [
    ("planar", "planar-u-part.bin", "u-part.json at 60 mm/s"),
    ("planar", "planar-gear.bin", "gear.json at 150 mm/s"),
    ("gantry", "gantry-gear.bin", "six-axis gear at 60 mm/s"),
    (
        "trunnion",
        "trunnion-swinging.bin",
        "swinging tool on trunnion.toml",
    ),
    (
        "arm6",
        "arm6-swinging.bin",
        "swinging tool on arm-small.toml",
    ),
];

/// Takes so many bytes off the front.
fn bytes<'a>(rest: &mut &'a [u8], count: usize) -> Result<&'a [u8], Box<dyn Error>> {
    let (taken, left) = rest
        .split_at_checked(count)
        .ok_or("a job of the bench is cut")?;
    *rest = left;
    Ok(taken)
}

/// Reads a kept job: u32 length and postcard of the machine, u8 solution, seven i32 of the start, then u16
/// length and bytes of each message; numbers are little-endian. The README beside it says how it was made.
fn kept(machine: &'static str, file: &str, name: &str) -> Result<Job, Box<dyn Error>> {
    let path = Path::new(ROOT).join("tests/data/firmware_bench").join(file);
    let content = std::fs::read(&path).map_err(|error| format!("{}: {error}", path.display()))?;
    let mut rest = &content[..];
    let length = u32::from_le_bytes(bytes(&mut rest, 4)?.try_into()?);
    let configuration = postcard::from_bytes(bytes(&mut rest, length as usize)?)?;
    let solution = bytes(&mut rest, 1)?[0];
    let mut start = ChannelPoint::default();
    for number in &mut start {
        *number = i32::from_le_bytes(bytes(&mut rest, 4)?.try_into()?);
    }
    let mut payloads = Vec::new();
    while !rest.is_empty() {
        let length = u16::from_le_bytes(bytes(&mut rest, 2)?.try_into()?);
        payloads.push(bytes(&mut rest, length.into())?.to_vec());
    }
    Ok(Job {
        machine,
        name: name.to_string(),
        configuration,
        start,
        solution,
        payloads,
        override_percent: 100,
    })
}

fn jobs() -> Result<Vec<Job>, Box<dyn Error>> {
    let jobs = JOBS.iter();
    jobs.map(|(machine, file, name)| kept(machine, file, name))
        .collect()
}

/// What `qemu_bench` reads: the machine, then frames as on the wire.
fn job_file(job: &Job) -> Result<Vec<u8>, Box<dyn Error>> {
    let machine = &job.configuration;
    let mut configuration = [0; 1024];
    let configuration = postcard::to_slice(machine, &mut configuration)?;
    let mut file = (configuration.len() as u32).to_le_bytes().to_vec();
    file.extend(&*configuration);
    let hello = Hello {
        protocol_version: PROTOCOL_VERSION,
        schema_hash: SCHEMA_HASH,
        host_session: 1,
    };
    let start = Start {
        job: 1,
        machine_hash: hash_of(machine),
        first_sequence: 0,
        position: job.start,
        solution: job.solution,
        units: headway_protocol::units::Units::BASE,
    };
    let mut out = [0; FRAME_BYTES_MAX];
    let refused = |error| format!("{}: {error:?}", job.name);
    for (sequence, message) in [
        (1, HostMessage::Hello(hello)),
        (2, HostMessage::Start(start)),
        (
            3,
            HostMessage::Control(Control::Override(job.override_percent)),
        ),
    ] {
        let length = encode_frame(sequence, &message, &mut out).map_err(refused)?;
        file.extend(&out[..length]);
    }
    for (index, payload) in job.payloads.iter().enumerate() {
        let length = encode_payload(index as u16, payload, &mut out).map_err(refused)?;
        file.extend(&out[..length]);
    }
    Ok(file)
}

/// Plays a job in the emulator: the values by their names.
fn play(elf: &Path, job: &Job) -> Result<BTreeMap<String, u64>, Box<dyn Error>> {
    let directory = elf.with_file_name("bench");
    std::fs::create_dir_all(&directory)?;
    std::fs::write(directory.join("bench.job"), job_file(job)?)?;
    let output = Command::new("timeout")
        .current_dir(&directory)
        .args([
            "300",
            "qemu-system-arm",
            "-machine",
            "mps2-an386",
            "-cpu",
            "cortex-m4",
        ])
        .args([
            "-nographic",
            "-monitor",
            "none",
            "-serial",
            "null",
            "-icount",
            ICOUNT,
        ])
        .args(["-semihosting-config", "enable=on,target=native", "-kernel"])
        .arg(elf)
        .output()?;
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    if !output.status.success() {
        return Err(format!("{} did not run to its end:\n{text}", job.name).into());
    }
    let values = text.lines().filter_map(|line| {
        let (name, value) = line.split_once(' ')?;
        Some((name.to_string(), value.parse().ok()?))
    });
    let values: BTreeMap<String, u64> = values.collect();
    if values.get("underruns") != Some(&0) {
        return Err(format!("the queue ran dry in {}:\n{text}", job.name).into());
    }
    Ok(values)
}

fn largest(runs: &[(Job, BTreeMap<String, u64>)], key: &str) -> u64 {
    runs.iter()
        .filter_map(|(_, values)| values.get(key))
        .copied()
        .max()
        .unwrap_or(0)
}

fn servo_per_machine(runs: &[(Job, BTreeMap<String, u64>)]) -> Value {
    let mut machines: BTreeMap<&str, [u64; 2]> = BTreeMap::new();
    for (job, values) in runs {
        let of = |key: &str| values.get(key).copied().unwrap_or(0);
        let [worst, mean] = machines.entry(job.machine).or_default();
        *worst = (*worst).max(of("servo_worst"));
        *mean = (*mean).max(of("servo_mean"));
    }
    let named = machines.into_iter().map(|(machine, [worst, mean])| {
        (machine.to_string(), json!({"worst": worst, "mean": mean}))
    });
    Value::Object(named.collect())
}

/// Pieces of the main loop, as `qemu_bench` names them.
const PIECES: [&str; 4] = ["bytes", "work", "ahead", "report"];

/// The longest of each piece, and what of it held the servo up, for each machine.
fn pieces_per_machine(runs: &[(Job, BTreeMap<String, u64>)]) -> Value {
    let mut machines: BTreeMap<&str, BTreeMap<String, u64>> = BTreeMap::new();
    for (job, values) in runs {
        let pieces = machines.entry(job.machine).or_default();
        for piece in PIECES {
            for key in [piece.to_string(), format!("{piece}_lock")] {
                let value = values.get(&format!("{key}_worst")).copied().unwrap_or(0);
                let worst = pieces.entry(key).or_default();
                *worst = value.max(*worst);
            }
        }
    }
    json!(machines)
}

/// Instructions a second of a job's step and servo ticks, and of the work for the spans to come that the
/// main loop does for the servo. Intervals with a reversal are all among the timed ones, of the others a
/// share: the mean is rather too high.
fn mean_per_second(values: &BTreeMap<String, u64>) -> f64 {
    let of = |key: &str| values.get(key).copied().unwrap_or(0) as f64;
    let (straight, reversing) = (of("step_count"), of("step_reversing_count"));
    let sum = of("step_mean") * straight + of("step_reversing_mean") * reversing;
    let ahead = of("ahead_mean") * of("ahead_count") / of("servo_count").max(1.0);
    sum / (straight + reversing).max(1.0) * 200e3 + (of("servo_mean") + ahead) * 2e3
}

fn measure() -> Result<Value, Box<dyn Error>> {
    let elf = image("qemu_bench", "")?;
    let mut runs = Vec::new();
    let (mut doubled_runs, mut shaped_runs) = (Vec::new(), Vec::new());
    for job in jobs()? {
        for (runs, job) in [
            (&mut doubled_runs, job.doubled()),
            (&mut shaped_runs, job.shaped()),
            (&mut runs, job),
        ] {
            let values = play(&elf, &job)?;
            eprintln!("{}: {values:?}", job.name);
            runs.push((job, values));
        }
    }
    let board = Elf::read(&image("octopus", "octopus")?)?;
    // These two link only if no panic can be reached; the octopus with USB keeps those of its driver.
    let serial = Elf::read(&image("octopus", "octopus-serial,prove-no-panic")?)?;
    let emulated = Elf::read(&image("qemu", "prove-no-panic")?)?;
    for elf in [&board, &serial, &emulated] {
        eprintln!("panics: {:?}", elf.panic_symbols());
        eprintln!("heap or text of floats: {:?}", elf.forbidden_symbols());
    }
    let step_worst = largest(&runs, "step_worst").max(largest(&runs, "step_reversing_worst"));
    let per_second = runs.iter().map(|(_, values)| mean_per_second(values));
    let per_second = per_second.fold(0.0, f64::max);
    let interrupt = |key: &str| largest(&runs, key) + EXCEPTION_FRAME_BYTES;
    let step_stack = interrupt("step_stack_bytes").max(interrupt("step_reversing_stack_bytes"));
    Ok(json!({
        "step_tick_instructions": {
            "worst": step_worst,
            "worst_without_reversal": largest(&runs, "step_worst"),
        },
        "servo_tick_instructions": servo_per_machine(&runs),
        "servo_tick_instructions_at_200_percent": servo_per_machine(&doubled_runs),
        "servo_tick_instructions_shaped": servo_per_machine(&shaped_runs),
        "main_loop_instructions": pieces_per_machine(&runs),
        "cpu_fraction": (per_second / CORE_HZ * 1e4).round() / 1e4,
        "ram_bytes": board.ram_bytes(),
        "flash_bytes": board.flash_bytes(),
        "queue_segments": QUEUE_KNOTS,
        "stack_bytes": {
            "step": step_stack,
            "servo": interrupt("servo_stack_bytes"),
            "main_loop": PIECES.map(|piece| largest(&runs, &format!("{piece}_stack_bytes"))).into_iter().max(),
        },
        "panic_symbols": {
            "qemu": emulated.panic_symbols().len(),
            "octopus": board.panic_symbols().len(),
            "octopus_serial": serial.panic_symbols().len(),
        },
    }))
}

fn main() -> Result<(), Box<dyn Error>> {
    if let Some(reason) = missing() {
        eprintln!("skipped: {reason}");
        let demanded = std::env::var_os("HEADWAY_DEMAND_EMULATOR").is_some();
        return if demanded { Err(reason.into()) } else { Ok(()) };
    }
    println!("{}", measure()?);
    Ok(())
}
