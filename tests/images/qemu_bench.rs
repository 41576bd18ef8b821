//! Instruction counts and stack of the hot paths on an emulated Cortex-M4F (Arm MPS2 AN386, QEMU).
//!
//! Runs a job in the boards' runtime, as fast as possible, and measures every servo tick and a share
//! of the step ticks with a hardware timer, each in a function with the entry and exit code of an
//! interrupt; the port writes are those of the octopus board. With `-icount shift=6` an instruction
//! takes 64 ns of virtual time and the 25 MHz timer ticks every 40 ns, so counts are exact to the
//! instruction. The stack is painted before each call and checked afterwards. Instructions are not
//! cycles: QEMU has neither pipeline nor wait states.
//!
//! The job is the file `bench.job` in the emulator's directory, read by semihosting: u32 LE length |
//! postcard `MachineConfiguration` | frames as on the wire. `tools/firmware-bench` makes it, and
//! reads the output lines `name value`.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!("this binary is for the emulated board: tools/firmware-bench builds and runs it");
}

#[cfg(target_os = "none")]
#[path = "../../firmware/src/bin/shared/step_ports.rs"]
mod ports;
#[cfg(target_os = "none")]
use headway_firmware::board::octopus::BOARD;
#[cfg(target_os = "none")]
#[path = "../../firmware/src/bin/shared/runtime.rs"]
mod runtime;

#[cfg(target_os = "none")]
use bench::{Clock, Output, pend_stop};

#[cfg(target_os = "none")]
mod bench {
    use crate::ports::{DriverPorts, PORT_BYTES, SET_RESET};
    use crate::runtime::{self, Board, LONGEST_LOCK, Locked, with_motion};
    use core::sync::atomic::{AtomicU32, Ordering};
    use cortex_m_semihosting::{debug, hprintln, syscall};
    use headway_firmware::board::gaps::BoardClock;
    use headway_firmware::board::table::DIRECTION;
    use headway_firmware::configuration::homing::HomingConfiguration;
    use headway_firmware::configuration::{MOTORS_MAX, MachineConfiguration};
    use headway_firmware::design::WEIGHED_KNOTS;
    use headway_firmware::line::{Conversation, Receiver};
    use headway_firmware::machine::round::{self, Link};
    use headway_firmware::motion::inputs::Inputs;
    use headway_firmware::steps::output::PortOutput;
    use headway_protocol::frame::FRAME_BYTES_MAX;
    use headway_protocol::knot_block::KNOTS_PER_BLOCK_MAX;
    use headway_protocol::message::DeviceState;

    /// CMSDK timer 0: counts down at 25 MHz.
    const TIMER_CONTROL: *mut u32 = 0x4000_0000 as *mut u32;
    const TIMER_VALUE: *mut u32 = 0x4000_0004 as *mut u32;
    const TIMER_RELOAD: *mut u32 = 0x4000_0008 as *mut u32;
    /// Nanoseconds of virtual time.
    const INSTRUCTION_NS: u32 = 64;
    const TIMER_TICK_NS: u32 = 40;
    /// Longer jobs are stopped after this many servo ticks, 15 s: the rest is like the beginning.
    const TICKS_MAX: u32 = 30_000;
    /// Servo ticks between two servo ticks in which each step tick is timed.
    const TIMED_EVERY: u32 = 16;

    fn start_timer() {
        // SAFETY: the registers of the emulated machine's first timer, used by nobody else.
        unsafe {
            TIMER_RELOAD.write_volatile(u32::MAX);
            TIMER_VALUE.write_volatile(u32::MAX);
            TIMER_CONTROL.write_volatile(1);
        }
    }

    #[inline(always)]
    fn now() -> u32 {
        // SAFETY: a read-only use of the same timer.
        unsafe { TIMER_VALUE.read_volatile() }
    }

    /// Instructions between two readings, rounded.
    fn instructions(before: u32, after: u32) -> u32 {
        (before.wrapping_sub(after) * TIMER_TICK_NS + INSTRUCTION_NS / 2) / INSTRUCTION_NS
    }

    /// Pieces of the main loop: bytes of a packet up to the end of a message, some knots of a block,
    /// preparation of coming spans, a report.
    const PIECES: [&str; 4] = ["bytes", "work", "ahead", "report"];
    const BYTES: usize = 0;
    const WORK: usize = 1;
    const AHEAD: usize = 2;
    const REPORT: usize = 3;
    /// Bytes that a line hands over at once.
    const PACKET_BYTES: usize = 64;

    /// The longest lock of each.
    static LOCKS: [AtomicU32; 4] = [const { AtomicU32::new(0) }; 4];

    /// The same timer for the boards' runtime; nothing is measured by the interrupts' gaps here.
    pub struct Clock;

    impl BoardClock for Clock {
        const GAP_CLOCKS: u32 = 0;
        #[inline(always)]
        fn now_clocks() -> u32 {
            now().wrapping_neg()
        }
    }

    pub type Output = PortOutput<DriverPorts>;

    /// The ports of the octopus board, as far from each other, in a memory that nothing else uses.
    const PORTS: usize = 0x2100_0000;

    fn port(port: usize) -> *mut u32 {
        (PORTS + port * PORT_BYTES + SET_RESET) as *mut u32
    }

    /// True if direction pins were written since the last call: one port has no others.
    fn take_turned() -> bool {
        let turned = port(crate::BOARD.column(DIRECTION)[7].0);
        // SAFETY: as above.
        unsafe {
            let word = turned.read_volatile();
            turned.write_volatile(0);
            word != 0
        }
    }

    /// A fault fails the bench: nothing has to stop.
    pub fn pend_stop() {}

    /// The stack below the caller, painted.
    struct Paint {
        top: usize,
        words: usize,
    }

    impl Paint {
        const COLOUR: u32 = 0x5a5a_a5a5;
        /// Left alone below the caller's frame: what painting itself needs.
        const MARGIN: usize = 128;

        #[inline(always)]
        fn new(words: usize) -> Self {
            let top = cortex_m::register::msp::read() as usize;
            for word in 0..words {
                // SAFETY: below the stack pointer and its margin nothing is in use.
                unsafe { Self::place(top, word).write_volatile(Self::COLOUR) }
            }
            Self { top, words }
        }

        #[inline(always)]
        fn place(top: usize, word: usize) -> *mut u32 {
            (top - Self::MARGIN - 4 * (word + 1)) as *mut u32
        }

        /// Bytes below the caller that were used since.
        #[inline(always)]
        fn used(&self) -> usize {
            for word in (0..self.words).rev() {
                // SAFETY: as above.
                if unsafe { Self::place(self.top, word).read_volatile() } != Self::COLOUR {
                    return Self::MARGIN + 4 * (word + 1);
                }
            }
            Self::MARGIN
        }
    }

    #[derive(Default)]
    struct Count {
        worst: u32,
        sum: u64,
        count: u32,
        stack_bytes: usize,
    }

    impl Count {
        fn note(&mut self, instructions: u32) {
            self.worst = self.worst.max(instructions);
            self.sum += u64::from(instructions);
            self.count += 1;
        }

        fn mean(&self) -> u32 {
            (self.sum / u64::from(self.count.max(1))) as u32
        }
    }

    #[derive(Default)]
    struct Counts {
        servo: Count,
        step: Count,
        step_reversing: Count,
        pieces: [Count; 4],
    }

    /// Does a piece of the main loop and counts it; true if there was any.
    #[inline(never)]
    fn piece(which: usize, empty: u32, counts: &mut Counts, work: impl FnOnce() -> bool) -> bool {
        LONGEST_LOCK.store(0, Ordering::Relaxed);
        let paint = Paint::new(6000);
        let before = now();
        let worked = work();
        let after = now();
        if let Some(worst) = LOCKS.get(which) {
            let held = instructions(LONGEST_LOCK.load(Ordering::Relaxed), 0);
            worst.fetch_max(held, Ordering::Relaxed);
        }
        if worked && let Some(count) = counts.pieces.get_mut(which) {
            count.stack_bytes = count.stack_bytes.max(paint.used());
            count.note(instructions(before, after) - empty);
        }
        worked
    }

    // Functions of their own, with the entry and exit code of an interrupt.
    #[inline(never)]
    fn servo_tick() {
        runtime::servo_interrupt(Inputs::default());
    }

    #[inline(never)]
    fn step_tick() {
        runtime::step_interrupt();
    }

    /// The job's file, byte by byte.
    struct File {
        handle: usize,
        buffer: [u8; 512],
        from: usize,
        to: usize,
    }

    impl File {
        fn open() -> Option<Self> {
            let name = b"bench.job\0";
            // SAFETY: semihosting call with a pointer that lives through it; mode 1 is "rb".
            let handle = unsafe { syscall!(OPEN, name.as_ptr(), 1, name.len() - 1) };
            (handle != usize::MAX).then_some(Self {
                handle,
                buffer: [0; 512],
                from: 0,
                to: 0,
            })
        }

        fn next(&mut self) -> Option<u8> {
            if self.from == self.to {
                let length = self.buffer.len();
                // SAFETY: as above; the buffer is as long as said.
                let left = unsafe { syscall!(READ, self.handle, self.buffer.as_mut_ptr(), length) };
                self.from = 0;
                self.to = length.saturating_sub(left);
            }
            let byte = *self.buffer.get(self.from..self.to)?.first()?;
            self.from += 1;
            Some(byte)
        }

        fn configuration(&mut self) -> Option<MachineConfiguration> {
            let mut length = [0; 4];
            for byte in &mut length {
                *byte = self.next()?;
            }
            let mut bytes = [0; 1024];
            let bytes = bytes.get_mut(..u32::from_le_bytes(length) as usize)?;
            for byte in bytes.iter_mut() {
                *byte = self.next()?;
            }
            postcard::from_bytes(bytes).ok()
        }
    }

    /// The host's part: frames as long as there is room for a block.
    struct Host {
        file: File,
        frame: [u8; FRAME_BYTES_MAX],
        receiver: Receiver,
        link: Link,
    }

    impl Host {
        fn serve(&mut self, empty: u32, counts: &mut Counts) {
            let room = with_motion(|motion| {
                // Flow events come before their block, at most four.
                motion.knot_room() >= KNOTS_PER_BLOCK_MAX && motion.event_room() >= 8
            });
            if room != Some(true) {
                return;
            }
            let mut length = 0;
            while let Some(byte) = self.file.next() {
                if let Some(slot) = self.frame.get_mut(length) {
                    *slot = byte;
                    length += 1;
                }
                if byte == 0 {
                    break;
                }
            }
            let (receiver, talk) = (&mut self.receiver, &mut self.link.talk);
            for packet in self
                .frame
                .get(..length)
                .unwrap_or_default()
                .chunks(PACKET_BYTES)
            {
                piece(BYTES, empty, counts, || {
                    round::take_bytes(receiver, talk, &mut packet.iter().copied(), &mut Locked);
                    true
                });
                while piece(WORK, empty, counts, || {
                    round::work(receiver, talk, WEIGHED_KNOTS, &mut Locked)
                }) {}
            }
        }

        /// A report, if there is one: it is out at once.
        fn report(&mut self, empty: u32, counts: &mut Counts) {
            let (receiver, link) = (&self.receiver, &mut self.link);
            piece(REPORT, empty, counts, || {
                let length = round::pending(receiver, link, &mut Locked).len();
                link.outgoing.sent(length);
                length > 0
            });
        }
    }

    fn time_servo(empty: u32, count: &mut Count) {
        let paint = Paint::new(500);
        let before = now();
        servo_tick();
        let after = now();
        count.stack_bytes = count.stack_bytes.max(paint.used());
        count.note(instructions(before, after) - empty);
    }

    /// The main loop's preparation of coming spans.
    fn time_ahead(empty: u32, counts: &mut Counts) {
        while piece(AHEAD, empty, counts, || round::look_ahead(&mut Locked)) {}
    }

    fn time_steps(interval_ticks: u32, empty: u32, counts: &mut Counts) {
        for _ in 0..interval_ticks {
            let reverses = runtime::interval_reverses();
            take_turned();
            let paint = Paint::new(64);
            let before = now();
            step_tick();
            let after = now();
            let stack_bytes = paint.used();
            let count = if take_turned() || reverses {
                &mut counts.step_reversing
            } else {
                &mut counts.step
            };
            count.stack_bytes = count.stack_bytes.max(stack_bytes);
            count.note(instructions(before, after) - empty);
        }
    }

    /// Plays the job; true if it ends as it should.
    fn run(counts: &mut Counts) -> Option<bool> {
        let mut file = File::open()?;
        let configuration = file.configuration()?;
        let interval_ticks = configuration.interval_ticks();
        let board = Board {
            configuration: &configuration,
            switches: &HomingConfiguration::none(),
            session: 1,
        };
        // The runtime pends its interrupts; here they are called instead.
        cortex_m::interrupt::disable();
        let mut host = Host {
            file,
            frame: [0; FRAME_BYTES_MAX],
            link: Link::new(Conversation::new(&configuration, 0)),
            receiver: runtime::set_up(
                &board,
                PortOutput::new(DriverPorts::new(PORTS), MOTORS_MAX, 0),
            )?,
        };
        let empty = {
            let before = now();
            instructions(before, now())
        };
        for tick in 0..TICKS_MAX {
            host.serve(empty, counts);
            time_ahead(empty, counts);
            host.report(empty, counts);
            time_servo(empty, &mut counts.servo);
            // Reversals are few: all of them tick by tick, of the others a share.
            if tick % TIMED_EVERY == 0 || runtime::interval_reverses() {
                time_steps(interval_ticks, empty, counts);
            } else {
                (0..interval_ticks).for_each(|_| step_tick());
            }
            let finished = with_motion(|motion| motion.state() == DeviceState::Finished);
            if finished == Some(true) {
                break;
            }
        }
        with_motion(|motion| {
            // How often the queue's end made the head slow down is the caller's to judge.
            hprintln!("underruns {}", motion.underruns());
            motion.fault().is_none()
        })
    }

    fn print(name: &str, count: &Count) {
        hprintln!("{}_worst {}", name, count.worst);
        hprintln!("{}_mean {}", name, count.mean());
        hprintln!("{}_stack_bytes {}", name, count.stack_bytes);
        hprintln!("{}_count {}", name, count.count);
    }

    #[cortex_m_rt::entry]
    fn main() -> ! {
        start_timer();
        let mut counts = Counts::default();
        let fine = run(&mut counts) == Some(true);
        for (name, count) in [
            ("servo", &counts.servo),
            ("step", &counts.step),
            ("step_reversing", &counts.step_reversing),
        ] {
            print(name, count);
        }
        for ((name, count), lock) in PIECES.iter().zip(&counts.pieces).zip(&LOCKS) {
            print(name, count);
            hprintln!("{}_lock_worst {}", name, lock.load(Ordering::Relaxed));
        }
        debug::exit(if fine {
            debug::EXIT_SUCCESS
        } else {
            debug::EXIT_FAILURE
        });
        loop {
            cortex_m::asm::wfi();
        }
    }

    #[panic_handler]
    fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
        debug::exit(debug::EXIT_FAILURE);
        loop {
            cortex_m::asm::bkpt();
        }
    }
}
