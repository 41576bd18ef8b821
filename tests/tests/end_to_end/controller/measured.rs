//! Goal: what a board measures of itself while it prints is what its interrupts cost. Method: the emulated board, with the
//! port writes of the octopus, prints an example over its line and measures meanwhile, by the gaps that interrupts leave in
//! its main loop; the bench image counts the instructions of the same job's ticks one by one, with nothing that interrupts.
//! Skipped, and said so, where QEMU or the target is missing.

use super::emulated::{Emulator, Faults, alone, example, sender, stream};
use headway::drive::sender_state::{SenderEvent, SenderState};
use headway_protocol::frame::{FRAME_BYTES_MAX, encode_frame, encode_payload, hash_of};
use headway_protocol::message::{
    BoardFigures, Control, DeviceState, Hello, HostMessage, PROTOCOL_VERSION, SCHEMA_HASH, Start,
    TickFigures,
};
use headway_tests::emulation::board_image::{image, skipped};
use std::collections::BTreeMap;
use std::process::Command;

/// Nanoseconds of an instruction and of a clock in the emulated board.
const INSTRUCTION_NS: f64 = 16.0;
const CLOCK_NS: f64 = 40.0;

/// The example as the bench reads it, see `firmware_bench`.
fn bench_job() -> Vec<u8> {
    let machine = &example().settings.machine;
    let frames = &example().frames;
    let mut configuration = [0; 1024];
    let configuration = postcard::to_slice(machine, &mut configuration).expect("it fits");
    let mut file = (configuration.len() as u32).to_le_bytes().to_vec();
    file.extend(&*configuration);
    let hello = HostMessage::Hello(Hello {
        protocol_version: PROTOCOL_VERSION,
        schema_hash: SCHEMA_HASH,
        host_session: 1,
    });
    let start = HostMessage::Start(Start {
        job: 1,
        machine_hash: hash_of(machine),
        first_sequence: 0,
        position: *frames.start(),
        solution: 0,
        units: frames.units(),
    });
    let mut out = [0; FRAME_BYTES_MAX];
    for (sequence, message) in [(1, hello), (2, start)] {
        let length = encode_frame(sequence, &message, &mut out).expect("it fits");
        file.extend(&out[..length]);
    }
    for index in 0..frames.len() {
        let length = encode_payload(index as u16, frames.payload(index), &mut out);
        file.extend(&out[..length.expect("it fits")]);
    }
    file
}

/// Instructions by name, as the bench image prints them.
fn counted() -> BTreeMap<String, f64> {
    let elf = image("qemu_bench", "").expect("it builds");
    let folder = elf.with_file_name("bench-of-example");
    std::fs::create_dir_all(&folder).expect("a folder");
    std::fs::write(folder.join("bench.job"), bench_job()).expect("a file");
    let output = Command::new("timeout")
        .current_dir(&folder)
        .args(["300", "qemu-system-arm", "-machine", "mps2-an386"])
        .args(["-cpu", "cortex-m4", "-nographic", "-monitor", "none"])
        .args(["-serial", "null", "-icount", "shift=6,sleep=off"])
        .args(["-semihosting-config", "enable=on,target=native", "-kernel"])
        .arg(elf)
        .output()
        .expect("QEMU runs");
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{text}");
    let pairs = text.lines().filter_map(|line| line.split_once(' '));
    pairs
        .filter_map(|(name, value)| Some((name.to_string(), value.parse().ok()?)))
        .collect()
}

/// Prints the example, and lets the board measure while it runs. False with it where a busy host let the board slow down, or
/// ended the measurement when the job was over.
fn measured() -> (BoardFigures, bool) {
    let elf = image("qemu", "octopus-ports").expect("it builds");
    let mut board = Emulator::start(&elf, "measured");
    let mut sender = sender();
    let frames = &example().frames;
    let spans = frames.totals_after(frames.len() - 1).0;
    let (mut orders, mut figures) = (0, None);
    let (mut starved, mut was_printing) = (false, false);
    let watch = |event: &SenderEvent, sender: &mut headway::drive::sender::Sender| match event {
        SenderEvent::Status(status) if status.state == DeviceState::Running => {
            starved |= orders == 1 && status.sigma_permille < 1000;
            was_printing |= figures.is_some();
            let due = match orders {
                0 => status.spans_done > 4,
                _ => status.spans_done > spans * 8 / 10,
            };
            if due && orders < 2 {
                orders += 1;
                sender.command(Control::Measure(orders == 1));
            }
        }
        SenderEvent::Measured(found) => figures = Some(*found),
        _ => {}
    };
    stream(
        &mut sender,
        &mut board,
        &mut Faults::new(0, 0.0, 0.0),
        watch,
    );
    assert_eq!(*sender.state(), SenderState::Done);
    let is_whole = was_printing && !starved;
    (figures.expect("the board has measured"), is_whole)
}

#[test]
fn a_board_measures_what_the_bench_counts() {
    if skipped() {
        return;
    }
    let _alone = alone();
    let counted = counted();
    // A board that rests has less to do: three tries on a busy machine, and then a bound below that is no more than sane.
    let (mut figures, mut is_whole) = measured();
    for _ in 0..2 {
        if !is_whole {
            (figures, is_whole) = measured();
        }
    }
    let least_share = if is_whole { 0.95 } else { 0.7 };
    println!("{figures:?}\n{counted:?}");
    assert_eq!(figures.clock_hz, 25_000_000);
    let of = |clocks: f64| clocks * CLOCK_NS / INSTRUCTION_NS;
    for (name, tick, least) in [("step", figures.step, 1000), ("servo", figures.servo, 50)] {
        let TickFigures {
            count,
            min_clocks,
            mean_milliclocks,
            max_clocks,
        } = tick;
        let mean = of(f64::from(mean_milliclocks) / 1e3);
        let expected = counted[&format!("{name}_mean")];
        println!("{name}: {count} measured, {mean:.1} in the mean, {expected} counted");
        assert!(count >= least, "{name}: {count}");
        let share = mean / expected;
        assert!((least_share..1.05).contains(&share), "{name}: {mean}");
        // A share of the ticks is measured, so the longest of all need not be among them; a clock is 2.5 instructions,
        // and a servo tick has up to ten step ticks in it, of which the mean is subtracted.
        let worst = counted[&format!("{name}_worst")].max(counted["step_reversing_worst"]);
        let most = if name == "step" { 5.0 } else { 10.0 * 40.0 };
        assert!(
            of(max_clocks.into()) <= worst + most,
            "{name}: {max_clocks}"
        );
        assert!(of(min_clocks.into()) <= mean && mean <= of(max_clocks.into()));
    }
    // The bench's locks, with the step ticks that come within them: 30 % of the time.
    let lock = of(figures.lock_max_clocks.into());
    let locks =
        ["bytes", "work", "ahead", "report"].map(|piece| counted[&format!("{piece}_lock_worst")]);
    let longest = locks.into_iter().fold(0.0, f64::max);
    assert!(lock < 1.6 * longest, "{lock} {longest}");
    assert!(figures.round_max_clocks > figures.lock_max_clocks);
    let [used, room] = [figures.stack_used_bytes, figures.stack_bytes];
    // The main loop's deepest piece was painted by the bench, within its own frames.
    let deepest =
        ["bytes", "work", "ahead", "report"].map(|piece| counted[&format!("{piece}_stack_bytes")]);
    let deepest = deepest.into_iter().fold(0.0, f64::max);
    println!("stack {used} of {room}, a piece of the main loop {deepest}");
    assert!(f64::from(used) > 0.8 * deepest && used < room);
}
