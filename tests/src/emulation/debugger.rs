//! The remote protocol of GDB, as much as the tests of the boards need of it: registers, memory, breakpoints, and
//! stops at reads and writes, of a chip in QEMU.
//!
//! Source: GDB manual, appendix "Remote Serial Protocol". Left out: anything of threads, acknowledgements that fail.

use std::io::{Read, Write};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::time::Duration;

/// Longest wait for an answer: a busy machine takes its time.
const PATIENCE: Duration = Duration::from_secs(120);
/// The program counter among the registers of a Cortex-M.
const PC: u8 = 15;

/// Where the chip is to stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum At {
    /// Before the instruction at this address.
    Instruction(u32),
    /// Where something is read from here on, so many bytes.
    Read(u32, u32),
    /// Where something is written.
    Write(u32, u32),
}

/// A chip's debugger.
pub struct Debugger {
    stream: UnixStream,
}

impl Debugger {
    /// Connects to QEMU's socket. The chip stands still afterwards.
    pub fn connect(socket: &Path) -> Self {
        let stream = (0..500).find_map(|_| {
            std::thread::sleep(Duration::from_millis(20));
            UnixStream::connect(socket).ok()
        });
        let stream = stream.expect("QEMU's debugger listens");
        stream.set_read_timeout(Some(PATIENCE)).expect("a timeout");
        let mut debugger = Self { stream };
        // Only who asks for the registers' layout may read one at a time.
        debugger.ask("qSupported:xmlRegisters=arm");
        debugger.ask("qXfer:features:read:target.xml:0,ffb");
        debugger
    }

    fn send(&mut self, text: &str) {
        let sum = text.bytes().fold(0u8, u8::wrapping_add);
        let packet = format!("${text}#{sum:02x}");
        self.stream
            .write_all(packet.as_bytes())
            .expect("QEMU reads");
    }

    fn byte(&mut self) -> u8 {
        let mut byte = [0];
        self.stream.read_exact(&mut byte).expect("QEMU answers");
        byte[0]
    }

    /// The next packet, acknowledged.
    fn answer(&mut self) -> String {
        while self.byte() != b'$' {}
        let mut text = Vec::new();
        loop {
            match self.byte() {
                b'#' => break,
                byte => text.push(byte),
            }
        }
        let _sum = [self.byte(), self.byte()];
        self.stream.write_all(b"+").expect("QEMU reads");
        String::from_utf8_lossy(&text).into_owned()
    }

    fn ask(&mut self, text: &str) -> String {
        self.send(text);
        self.answer()
    }

    fn done(&mut self, text: &str) {
        let answer = self.ask(text);
        assert_eq!(answer, "OK", "{text}");
    }

    /// A register, 0 to 15.
    pub fn register(&mut self, number: u8) -> u32 {
        let answer = self.ask(&format!("p{number:x}"));
        let bytes = u32::from_str_radix(&answer, 16).expect("a register");
        bytes.swap_bytes()
    }

    /// Sets one.
    pub fn set_register(&mut self, number: u8, value: u32) {
        self.done(&format!("P{number:x}={:08x}", value.swap_bytes()));
    }

    /// Where the chip stands.
    pub fn place(&mut self) -> u32 {
        self.register(PC)
    }

    /// Goes on from somewhere else.
    pub fn set_place(&mut self, address: u32) {
        self.set_register(PC, address & !1);
    }

    /// A half word of memory.
    pub fn half(&mut self, address: u32) -> u16 {
        let answer = self.ask(&format!("m{address:x},2"));
        u16::from_str_radix(&answer, 16).map_or(0, u16::swap_bytes)
    }

    /// Writes one.
    pub fn set_half(&mut self, address: u32, value: u16) {
        self.done(&format!("M{address:x},2:{:04x}", value.swap_bytes()));
    }

    /// A word of memory or of a peripheral.
    pub fn word(&mut self, address: u32) -> u32 {
        let answer = self.ask(&format!("m{address:x},4"));
        u32::from_str_radix(&answer, 16).map_or(0, u32::swap_bytes)
    }

    /// Adds a place to stop at.
    pub fn stop_at(&mut self, at: At) {
        let place = place_of(at);
        self.done(&format!("Z{place}"));
    }

    /// Takes it away.
    pub fn pass_by(&mut self, at: At) {
        let place = place_of(at);
        self.done(&format!("z{place}"));
    }

    /// Goes on until the next stop.
    pub fn run(&mut self) {
        let stop = self.ask("c");
        assert!(stop.starts_with('T') || stop.starts_with('S'), "{stop}");
    }

    /// Goes on, and does not wait for a stop.
    pub fn let_go(&mut self) {
        self.send("c");
    }

    /// Waits for a stop after [`Self::let_go`].
    pub fn wait(&mut self) {
        let stop = self.answer();
        assert!(stop.starts_with('T') || stop.starts_with('S'), "{stop}");
    }

    /// Stops the chip where it is.
    pub fn halt(&mut self) {
        self.stream.write_all(&[3]).expect("QEMU reads");
        self.wait();
    }
}

fn place_of(at: At) -> String {
    match at {
        At::Instruction(address) => format!("0,{:x},2", address & !1),
        At::Read(address, bytes) => format!("3,{address:x},{bytes:x}"),
        At::Write(address, bytes) => format!("2,{address:x},{bytes:x}"),
    }
}
