//! An image as it is flashed, in QEMU, with a model of the chip's registers behind it until its set-up is over.
//!
//! QEMU's netduinoplus2 (STM32F405) reads RCC, ports and USB as zeros. Its debugger stops at each read of a peripheral
//! (with `-icount` before it), which is done here: [`RegisterModel`] says what is there. Writes are done by QEMU and
//! looked up in its trace, in their order. Afterwards the image runs alone at full speed.

use super::debugger::{At, Debugger};
use super::register_model::RegisterModel;
use super::thumb_access::ThumbAccess;
use crate::elf::Elf;
use std::io::{BufRead, BufReader, Read, Write as _};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

/// Where peripherals are.
const PERIPHERALS: std::ops::Range<u32> = 0x4000_0000..0x6000_0000;
/// Peripherals, a bit of each in a word, and USB.
const WATCHED: [At; 2] = [
    At::Read(0x4000_0000, 0x8_0000),
    At::Read(0x5000_0000, 0x4_0000),
];
/// Clocks, and the words of their bits: a barrier behind a write is looked for.
const CLOCKS: [At; 2] = [At::Write(0x4002_3830, 0x18), At::Write(0x4247_0600, 0x300)];
/// Nothing uses the random number generator: a read of it by the debugger ends what was written before a stop.
const MARK: u32 = 0x5006_0800;
/// `DSB`.
const BARRIER: [u16; 2] = [0xf3bf, 0x8f4f];
/// Accesses of a set-up, at most.
const ACCESSES_MAX: usize = 20_000;
const PATIENCE: Duration = Duration::from_secs(60);

/// A write to a peripheral.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Write {
    pub address: u32,
    pub value: u32,
}

/// Of a line of the trace: a write, or the mark.
fn write_of(line: &str) -> Option<Write> {
    let (is_write, rest) = match line.split_once("memory_region_ops_write") {
        Some((_, rest)) => (true, rest),
        None => (false, line.split_once("memory_region_ops_read")?.1),
    };
    let number = |name: &str| {
        let rest = rest.split_once(name)?.1;
        let digits = rest.split_whitespace().next()?.trim_start_matches("0x");
        u64::from_str_radix(digits, 16).ok()
    };
    let write = Write {
        address: number(" addr ")? as u32,
        value: number(" value ")? as u32,
    };
    (is_write || write.address == MARK).then_some(write)
}

/// The chip's number is where the emulator has memory: the first words of the flash stand for it.
pub fn with_chip_number(elf: &Elf, (first, mut image): (u32, Vec<u8>)) -> (u32, Vec<u8>) {
    let place = elf.address_of("CHIP_UNIQUE_AT").expect("the image has it");
    let place = (place - first) as usize;
    image[place..place + 4].copy_from_slice(&first.to_le_bytes());
    (first, image)
}

/// What an emulator is started with.
pub struct Start<'a> {
    /// Binaries and where they lie; the first one holds the vectors.
    pub flash: Vec<(u32, Vec<u8>)>,
    /// For sockets and files.
    pub folder: &'a Path,
}

/// A chip. Killed when dropped.
pub struct EmulatedChip {
    process: Child,
    pub debugger: Debugger,
    pub model: RegisterModel,
    writes: Receiver<Write>,
    folder: PathBuf,
}

impl EmulatedChip {
    /// Stands still before the first instruction.
    pub fn start(start: Start<'_>) -> Self {
        let file = |name: &str| start.folder.join(name).display().to_string();
        let socket = |name: &str| format!("unix:{},server=on,wait=off", file(name));
        let mut process = Command::new("qemu-system-arm");
        process
            .args(["-machine", "netduinoplus2", "-nographic", "-S"])
            .args([
                "-d",
                "trace:memory_region_ops_write,trace:memory_region_ops_read",
            ])
            .args(["-icount", "shift=4", "-monitor", &socket("monitor")])
            .args(["-qtest", &socket("qtest"), "-qtest-log", "/dev/null"])
            .args([
                "-chardev",
                &format!("socket,id=gdb,path={},server=on,wait=off", file("gdb")),
            ])
            .args(["-gdb", "chardev:gdb"])
            // The image uses the second USART.
            .args(["-serial", "null", "-serial", &socket("serial")]);
        for (number, (address, bytes)) in start.flash.iter().enumerate() {
            let name = file(&format!("flash{number}.bin"));
            std::fs::write(&name, bytes).expect("the folder is there");
            if number == 0 {
                process.args(["-kernel", &name]);
            } else {
                process.args(["-device", &format!("loader,file={name},addr={address:#x}")]);
            }
        }
        let streams = process
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped());
        let mut process = streams.spawn().expect("QEMU starts");
        let log = process.stderr.take().expect("it is piped");
        let (sends, writes) = channel();
        std::thread::spawn(move || {
            let log = BufReader::with_capacity(1 << 16, log);
            for line in log.lines().map_while(Result::ok) {
                // Nobody may wait for it any more.
                let _ = write_of(&line).map(|write| sends.send(write));
            }
        });
        Self {
            process,
            debugger: Debugger::connect(&start.folder.join("gdb")),
            model: RegisterModel::default(),
            writes,
            folder: start.folder.to_path_buf(),
        }
    }

    /// Where `headway` connects to.
    pub fn port(&self) -> String {
        format!("unix:{}", self.folder.join("serial").display())
    }

    /// Says lines to one of QEMU's sockets; what it answers within half a second.
    pub fn say(&self, socket: &str, lines: &str) -> String {
        let mut stream = UnixStream::connect(self.folder.join(socket)).expect("QEMU listens");
        let patience = Some(Duration::from_millis(500));
        stream.set_read_timeout(patience).expect("a timeout");
        writeln!(stream, "{lines}").expect("QEMU reads");
        let (mut answer, mut bytes) = (String::new(), [0; 4096]);
        while let Ok(length @ 1..) = stream.read(&mut bytes) {
            answer += &String::from_utf8_lossy(&bytes[..length]);
        }
        answer
    }

    /// Traces writes from here on.
    pub fn trace_writes(&self) {
        self.say("monitor", "trace-event memory_region_ops_write on");
    }

    /// What is written while the chip runs and is traced, until one is the last that is wanted or none comes for some time.
    pub fn writes_until(
        &mut self,
        mut is_last: impl FnMut(&Write) -> bool,
        silence: Duration,
    ) -> Vec<Write> {
        let mut found = Vec::new();
        while let Ok(write) = self.writes.recv_timeout(silence) {
            found.push(write);
            if is_last(&write) {
                break;
            }
        }
        found
    }

    /// Lets the chip find bits of a register set, for so many reads of it.
    pub fn set_bits(&mut self, address: u32, bits: u32, reads: usize) {
        self.debugger.halt();
        let watch = At::Read(address, 4);
        self.debugger.stop_at(watch);
        for _ in 0..reads {
            self.debugger.run();
            let here = self.debugger.place();
            let access = self.access_at(here);
            let value = self.debugger.word(address) | bits;
            self.debugger.set_register(access.target, value);
            self.debugger.set_place(here + access.length);
        }
        self.debugger.pass_by(watch);
        self.debugger.let_go();
    }

    /// What a running chip has written up to now; only writes are traced before and after.
    pub fn writes_so_far(&mut self) -> Vec<Write> {
        self.debugger.halt();
        self.say("monitor", "trace-event memory_region_ops_read on");
        let found = self.writes();
        self.say("monitor", "trace-event memory_region_ops_read off");
        self.debugger.let_go();
        found
    }

    /// What was written up to now; the chip stands still.
    pub fn writes(&mut self) -> Vec<Write> {
        self.debugger.word(MARK);
        let mut found = Vec::new();
        loop {
            let write = self.writes.recv_timeout(PATIENCE).expect("the mark comes");
            if write.address == MARK {
                return found;
            }
            // The core's own registers are no peripherals.
            if PERIPHERALS.contains(&write.address) {
                found.push(write);
            }
        }
    }

    /// Runs until the function's first instruction, the model answering. The model has every access then.
    pub fn set_up(&mut self, elf: &Elf, until: &str) {
        let end = elf.address_of(until).expect("the image has the function") & !1;
        self.debugger.stop_at(At::Instruction(end));
        for watch in WATCHED.into_iter().chain(CLOCKS) {
            self.debugger.stop_at(watch);
        }
        for number in 0.. {
            assert!(number < ACCESSES_MAX, "the set-up does not end");
            self.debugger.run();
            let here = self.debugger.place();
            if here == end {
                break;
            }
            self.pass(here);
        }
        for watch in WATCHED.into_iter().chain(CLOCKS) {
            self.debugger.pass_by(watch);
        }
        self.debugger.pass_by(At::Instruction(end));
        for write in self.writes() {
            self.model.write(write.address, write.value);
        }
        // The steps write a million times a second: the chip is many times as fast without a trace.
        let off = ["read", "write"].map(|way| format!("trace-event memory_region_ops_{way} off"));
        self.say("monitor", &off.join("\n"));
    }

    /// Resets a chip that stands still, as its watchdog does: memory stays. Then as [`Self::set_up`].
    pub fn reset(&mut self, elf: &Elf, until: &str) {
        let on = ["read", "write"].map(|way| format!("trace-event memory_region_ops_{way} on"));
        self.say("monitor", &format!("system_reset\n{}", on.join("\n")));
        self.model = RegisterModel::default();
        self.set_up(elf, until);
    }

    fn access_at(&mut self, here: u32) -> ThumbAccess {
        let code = [0, 2].map(|after| self.debugger.half(here + after));
        let access = ThumbAccess::decode(code[0], code[1]);
        access.unwrap_or_else(|| panic!("no access at {here:#x}: {code:04x?}"))
    }

    /// Does what the chip has stopped at, after what it has written before.
    fn pass(&mut self, here: u32) {
        for write in self.writes() {
            self.model.write(write.address, write.value);
        }
        let access = self.access_at(here);
        let address = access.address(|number| self.debugger.register(number));
        let next = here + access.length;
        if access.is_store {
            let value = self.debugger.register(access.target);
            self.model.write(address, value);
            let behind = [0, 2].map(|after| self.debugger.half(next + after));
            if behind == BARRIER {
                self.model.waited(RegisterModel::target(address).0);
            }
        } else {
            let known = self.model.read(address);
            let value = known.unwrap_or_else(|| self.debugger.word(address & !3));
            assert_eq!(access.bytes, 4, "words only, at {here:#x}");
            self.debugger.set_register(access.target, value);
        }
        if access.advance != 0 {
            let base = self.debugger.register(access.base);
            let base = base.wrapping_add_signed(access.advance);
            self.debugger.set_register(access.base, base);
        }
        self.debugger.set_place(next);
    }
}

impl Drop for EmulatedChip {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
