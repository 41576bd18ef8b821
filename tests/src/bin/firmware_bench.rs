//! Figures of the firmware on a real core: instructions, memory, panics.
//!
//! Plans the jobs with the host library, plays them on the emulated Cortex-M4F through
//! `qemu_bench`, reads sizes and symbols out of the board's ELF, and prints one JSON object.
//! Instructions are not cycles: the emulator has neither pipeline nor flash wait states.

use headway::input::{Format, ReadOptions, read, waypoints};
use headway::job::SegmentStream;
use headway::plan::motion::segments::lay_segments;
use headway::settings::{Settings, machine_file};
use headway::wire_frames::WireFrames;
use headway::{plan_target, plan_waypoints};
use headway_firmware::design::QUEUE_KNOTS;
use headway_firmware::shaping::{Shaper, ShaperKind};
use headway_protocol::frame::{FRAME_BYTES_MAX, encode_frame, encode_payload, hash_of};
use headway_protocol::message::{
    Control, Hello, HostMessage, PROTOCOL_VERSION, SCHEMA_HASH, Start,
};
use headway_tests::elf::Elf;
use headway_tests::emulation::board_image::{image, missing};
use headway_tests::gear;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::error::Error;
use std::f64::consts::TAU;
use std::path::Path;
use std::process::Command;

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
const CORE_HZ: f64 = 168e6;
/// What the core itself pushes at the entry of an interrupt, floating point included.
const EXCEPTION_FRAME_BYTES: u64 = 104;
/// 64 ns of virtual time per instruction, so that the 40 ns timer resolves each one.
const ICOUNT: &str = "shift=6,sleep=off";

struct Job {
    machine: &'static str,
    name: String,
    settings: Settings,
    stream: SegmentStream,
    /// Feed override, per cent.
    override_percent: u16,
}

impl Job {
    /// The same with the joints shaped that swing a frame: X and Y, or all but the nozzle of an arm.
    fn shaped(&self) -> Self {
        let mut settings = self.settings.clone();
        let joints = if self.machine == "arm6" { 6 } else { 2 };
        settings.machine.shapers[..joints].fill(BENCH_SHAPER);
        Self {
            machine: self.machine,
            name: format!("{}, {joints} joints shaped", self.name),
            settings,
            stream: self.stream.clone(),
            override_percent: 100,
        }
    }

    /// The same at the fastest feed override.
    fn doubled(&self) -> Self {
        Self {
            machine: self.machine,
            name: format!("{}, at 200 %", self.name),
            settings: self.settings.clone(),
            stream: self.stream.clone(),
            override_percent: 200,
        }
    }
}

/// The shaper of the bench: one that costs as much as any.
const BENCH_SHAPER: Shaper = Shaper {
    kind: ShaperKind::Ei,
    frequency_hz: 43.0,
    damping: 0.1,
};

fn example(name: &str, speed_mm_s: f64) -> Result<Job, Box<dyn Error>> {
    let settings = Settings {
        speed_mm_s,
        ..Settings::default()
    };
    let path = Path::new(ROOT).join("examples").join(name);
    let format = Format::of_ending(&path).ok_or("no known ending")?;
    let loaded = read(
        &std::fs::read(&path)?,
        name,
        format,
        &ReadOptions::default(),
    )?;
    let stream = plan_target(&loaded.target, &settings)?.stream;
    Ok(Job {
        machine: "planar",
        name: format!("{name} at {speed_mm_s} mm/s"),
        settings,
        stream,
        override_percent: 100,
    })
}

/// A path on which the tool swings from 5° to 45° and around, on a machine of the examples.
fn swinging(machine: &'static str, file: &str) -> Result<Job, Box<dyn Error>> {
    const WAYPOINTS: usize = 600;
    let path = Path::new(ROOT).join("examples/machines").join(file);
    let settings = machine_file::from_toml(&std::fs::read_to_string(path)?)?;
    let mut text = String::new();
    for point in 0..WAYPOINTS {
        let phase = TAU * point as f64 / WAYPOINTS as f64;
        let (tilt, turn) = (
            (25.0 + 20.0 * (2.0 * phase).sin()).to_radians(),
            0.8 * (3.0 * phase).sin(),
        );
        let place = [
            80.0 * phase / TAU,
            20.0 * (2.0 * phase).sin(),
            6.0 * phase.cos(),
        ];
        let axis = [tilt.sin() * turn.cos(), tilt.sin() * turn.sin(), tilt.cos()];
        for number in place.iter().chain(&axis) {
            text += &format!("{number:.6} ");
        }
        text.push('\n');
    }
    let run = waypoints::read(text.as_bytes(), "swinging", &ReadOptions::default())?;
    let stream = plan_waypoints(&run, &settings)?.stream;
    let mut settings = settings;
    settings.machine = stream.machine(&settings.machine);
    Ok(Job {
        machine,
        name: format!("swinging tool on {file}"),
        settings,
        stream,
        override_percent: 100,
    })
}

fn jobs() -> Result<Vec<Job>, Box<dyn Error>> {
    let settings = gear::gantry();
    let (stream, _) = lay_segments(&gear::route(200.0), &settings)?;
    Ok(vec![
        example("u-part.json", 60.0)?,
        example("gear.json", 150.0)?,
        Job {
            machine: "gantry",
            name: "six-axis gear at 60 mm/s".to_string(),
            settings,
            stream,
            override_percent: 100,
        },
        swinging("trunnion", "trunnion.toml")?,
        swinging("arm6", "arm-small.toml")?,
    ])
}

/// What `qemu_bench` reads: the machine, then frames as on the wire.
fn job_file(job: &Job) -> Result<Vec<u8>, Box<dyn Error>> {
    let machine = &job.settings.machine;
    let mut configuration = [0; 1024];
    let configuration = postcard::to_slice(machine, &mut configuration)?;
    let mut file = (configuration.len() as u32).to_le_bytes().to_vec();
    file.extend(&*configuration);
    let frames = WireFrames::encode(&job.stream)?;
    let hello = Hello {
        protocol_version: PROTOCOL_VERSION,
        schema_hash: SCHEMA_HASH,
        host_session: 1,
    };
    let start = Start {
        job: frames.job(),
        machine_hash: hash_of(machine),
        first_sequence: 0,
        position: job.stream.start,
        solution: machine.kinematics.solution(),
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
    for index in 0..frames.len() {
        let length =
            encode_payload(index as u16, frames.payload(index), &mut out).map_err(refused)?;
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

fn ahead_per_machine(runs: &[(Job, BTreeMap<String, u64>)]) -> Value {
    let mut machines: BTreeMap<&str, u64> = BTreeMap::new();
    for (job, values) in runs {
        let worst = machines.entry(job.machine).or_default();
        *worst = (*worst).max(values.get("ahead_worst").copied().unwrap_or(0));
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
        "span_ahead_instructions": ahead_per_machine(&runs),
        "cpu_fraction": (per_second / CORE_HZ * 1e4).round() / 1e4,
        "ram_bytes": board.ram_bytes(),
        "flash_bytes": board.flash_bytes(),
        "queue_segments": QUEUE_KNOTS,
        "stack_bytes": {
            "step": step_stack,
            "servo": interrupt("servo_stack_bytes"),
            "link": largest(&runs, "link_stack_bytes"),
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
