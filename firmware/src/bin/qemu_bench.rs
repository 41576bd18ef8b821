//! Instruction counts of the hot paths on an emulated Cortex-M4F (Arm MPS2 AN386 in QEMU).
//!
//! Runs whole jobs through the real machine and times every servo tick and a share of the step
//! ticks with a hardware timer. With `-icount shift=6` an instruction takes 64 ns of virtual time
//! and the 25 MHz timer ticks every 40 ns, so counts are exact to the instruction. Prints one JSON
//! object by semihosting. Instructions are not cycles: QEMU has neither pipeline nor wait states.
//!
//! `cargo build -p headway-firmware --release --target thumbv7em-none-eabihf --bin qemu_bench`,
//! then `tools/firmware-bench`.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!("this binary is for the emulated board: tools/firmware-bench builds and runs it");
}

#[cfg(target_os = "none")]
mod bench {
    use cortex_m_semihosting::{debug, hprintln};
    use headway_firmware::configuration::{
        ExtruderConfiguration, JointConfiguration, Kinematics, MachineConfiguration,
    };
    use headway_firmware::machine::Machine;
    use headway_firmware::output::StepOutput;
    use headway_protocol::frame::{FRAME_BYTES_MAX, encode_frame, hash_of};
    use headway_protocol::knot_block::{KnotPredictor, encode_block};
    use headway_protocol::message::{
        DeviceState, Finish, Hello, HostMessage, PROTOCOL_VERSION, SCHEMA_HASH, Start,
    };
    use headway_protocol::segment::{FlowAction, FlowEvent, Knot};
    use headway_protocol::units::{CHANNELS, ChannelPoint, Ticks, to_units};

    /// CMSDK timer 0: counts down at 25 MHz.
    const TIMER_CONTROL: *mut u32 = 0x4000_0000 as *mut u32;
    const TIMER_VALUE: *mut u32 = 0x4000_0004 as *mut u32;
    const TIMER_RELOAD: *mut u32 = 0x4000_0008 as *mut u32;
    /// 64 ns per instruction, 40 ns per timer tick.
    const TIMER_TICKS_PER_8_INSTRUCTIONS_TIMES_5: u32 = 64;

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

    /// Instructions between two readings: ticks * 40 / 64, rounded.
    fn instructions(before: u32, after: u32) -> u32 {
        (before.wrapping_sub(after) * 40 + TIMER_TICKS_PER_8_INSTRUCTIONS_TIMES_5 / 2)
            / TIMER_TICKS_PER_8_INSTRUCTIONS_TIMES_5
    }

    /// Port writes as a board makes them: one store per call.
    struct Port {
        turned: bool,
    }

    impl StepOutput for Port {
        #[inline]
        fn set_directions(&mut self, directions: u8) {
            self.turned = true;
            store(directions);
        }
        #[inline]
        fn step(&mut self, _tick: u64, motors: u8) {
            store(motors);
        }
    }

    #[inline(always)]
    fn store(value: u8) {
        static PORT: core::sync::atomic::AtomicU8 = core::sync::atomic::AtomicU8::new(0);
        PORT.store(value, core::sync::atomic::Ordering::Relaxed);
    }

    #[derive(Default)]
    struct Worst {
        servo: u32,
        servo_sum: u64,
        servo_count: u32,
        step: u32,
        step_turning: u32,
        bytes_per_knot: u32,
        knots: u32,
    }

    fn joint(rotary: bool, steps_per_unit: f64) -> JointConfiguration {
        JointConfiguration {
            rotary,
            steps_per_unit,
            position_min: -1e4,
            position_max: 1e4,
            speed_max: if rotary { 30.0 } else { 200.0 },
            acceleration_max: if rotary { 3000.0 } else { 6000.0 },
            jerk_max: 1e6,
        }
    }

    fn configuration(kinematics: Kinematics) -> MachineConfiguration {
        let mut joints = heapless::Vec::new();
        let rotary = headway_firmware::kinematics::joint_count(&kinematics) - 3;
        for _ in 0..3 {
            let _ = joints.push(joint(false, 160.0));
        }
        for _ in 0..rotary {
            let _ = joints.push(joint(true, 2546.0));
        }
        MachineConfiguration {
            kinematics,
            joints,
            extruder: ExtruderConfiguration {
                steps_per_mm3: 400.0,
                speed_max_mm3_s: 60.0,
                acceleration_max_mm3_s2: 3000.0,
                pressure_advance_s: 0.03,
                pressure_advance_window_ms: 40.0,
            },
            servo_hz: 2000,
            step_hz: 200_000,
        }
    }

    const KNOTS: u32 = 700;
    /// A knot every 7 ms, as tight curves need.
    const SPAN_TICKS: u16 = 14;

    /// Control point `index`: a gear-like ring at about 60 mm/s, tilted if the machine can.
    fn control(index: u32, tilts: bool) -> ChannelPoint {
        let moving = index.saturating_sub(40).min(KNOTS - 80);
        let x = f64::from(moving) / f64::from(KNOTS - 80);
        let eased = x * x * x * (10.0 - 15.0 * x + 6.0 * x * x);
        let turn = eased * 2.0 * core::f64::consts::TAU;
        let (sine, cosine) = libm::sincos(turn);
        let radius = 15.0 + 1.5 * libm::cos(10.0 * turn);
        let tilt = if tilts { 0.25 * (1.0 - cosine) } else { 0.0 };
        let natural: [f64; CHANNELS] = [
            radius * cosine,
            radius * sine,
            0.2 + 0.5 * tilt,
            -tilt * sine,
            tilt * cosine,
            turn + 0.5 * libm::sin(10.0 * turn),
            60.0 * eased,
        ];
        to_units(&natural)
    }

    fn write(machine: &mut Machine, sequence: u16, message: &HostMessage<'_>) {
        let mut frame = [0; FRAME_BYTES_MAX];
        if let Ok(length) = encode_frame(sequence, message, &mut frame) {
            machine.handle_bytes(&frame[..length]);
        }
    }

    /// The host's part of the conversation, with no line between.
    struct Host {
        predictor: KnotPredictor,
        sequence: u16,
        sent: u32,
        tilts: bool,
    }

    impl Host {
        fn open(machine: &mut Machine, machine_hash: u32, tilts: bool) -> Self {
            let position = control(0, tilts);
            let hello = Hello {
                protocol_version: PROTOCOL_VERSION,
                schema_hash: SCHEMA_HASH,
                host_session: 1,
            };
            write(machine, 1, &HostMessage::Hello(hello));
            let start = Start {
                job: 1,
                machine_hash,
                first_sequence: 1,
                position,
            };
            write(machine, 2, &HostMessage::Start(start));
            let event = FlowEvent {
                span: 1,
                offset_ticks: 0,
                action: FlowAction::Prime,
                volume_units: 500_000,
                duration_ticks: Ticks(200),
            };
            write(machine, 1, &HostMessage::Flow(event));
            Self {
                predictor: KnotPredictor::new(position),
                sequence: 2,
                sent: 0,
                tilts,
            }
        }

        fn send(&mut self, machine: &mut Machine, worst: &mut Worst) {
            if self.sent == KNOTS || machine.motion().knot_room() < 16 {
                return;
            }
            let mut knots = [Knot {
                control: [0; CHANNELS],
                duration_ticks: SPAN_TICKS,
            }; 14];
            for (offset, knot) in knots.iter_mut().enumerate() {
                knot.control = control(self.sent + offset as u32, self.tilts);
            }
            let (bytes, count) = encode_block(&mut self.predictor, &knots);
            let mut frame = [0; FRAME_BYTES_MAX];
            let message = HostMessage::Knots(&bytes);
            if let Ok(length) = encode_frame(self.sequence, &message, &mut frame) {
                let before = now();
                machine.handle_bytes(&frame[..length]);
                let spent = instructions(before, now());
                worst.bytes_per_knot = worst.bytes_per_knot.max(spent / count as u32);
            }
            self.sequence += 1;
            self.sent += count as u32;
            worst.knots = self.sent;
            if self.sent == KNOTS {
                let finish = Finish {
                    knots: KNOTS,
                    events: 1,
                };
                write(machine, self.sequence, &HostMessage::Finish(finish));
            }
        }
    }

    // In functions of their own, as in the interrupts of a board.
    #[inline(never)]
    fn servo_tick(machine: &mut Machine) {
        machine.servo_tick();
    }

    #[inline(never)]
    fn step_tick(machine: &mut Machine, port: &mut Port) {
        machine.step_tick(port);
    }

    /// Runs a job; false if it does not end as it should.
    fn run(kinematics: Kinematics, worst: &mut Worst) -> bool {
        let configuration = configuration(kinematics);
        let tilts = kinematics != Kinematics::Planar;
        let Ok(mut machine) = Machine::new(&configuration, 1) else {
            return false;
        };
        let mut host = Host::open(&mut machine, hash_of(&configuration), tilts);
        let mut port = Port { turned: false };
        let empty = {
            let before = now();
            instructions(before, now())
        };
        for tick in 0..20_000u32 {
            host.send(&mut machine, worst);
            let before = now();
            servo_tick(&mut machine);
            let spent = instructions(before, now()) - empty;
            worst.servo = worst.servo.max(spent);
            worst.servo_sum += u64::from(spent);
            worst.servo_count += 1;
            // Every eighth interval tick by tick, the others at once: same result, less time.
            let timed = if tick % 8 == 0 { 100 } else { 0 };
            for _ in 0..timed {
                port.turned = false;
                let before = now();
                step_tick(&mut machine, &mut port);
                let spent = instructions(before, now()) - empty;
                if port.turned || machine.step_interval_reverses() {
                    worst.step_turning = worst.step_turning.max(spent);
                } else {
                    worst.step = worst.step.max(spent);
                }
            }
            if timed == 0 {
                machine.run_step_interval(&mut port);
            }
            if machine.motion().state() == DeviceState::Finished {
                return machine.motion().fault().is_none();
            }
        }
        hprintln!("not finished: {:?}", machine.motion().fault());
        false
    }

    fn report(name: &str, worst: &Worst) {
        let mean = worst.servo_sum / u64::from(worst.servo_count.max(1));
        hprintln!(
            "\"{}\": {{\"servo_tick_instructions\": {}, \"servo_tick_instructions_mean\": {}, \
             \"step_tick_instructions\": {}, \"step_tick_instructions_reversing\": {}, \
             \"receive_instructions_per_knot\": {}, \"knots\": {}}},",
            name,
            worst.servo,
            mean,
            worst.step,
            worst.step_turning,
            worst.bytes_per_knot,
            worst.knots
        );
    }

    #[cortex_m_rt::entry]
    fn main() -> ! {
        start_timer();
        hprintln!("{}", "{");
        let mut fine = true;
        let gantry = Kinematics::Gantry {
            pivot_length_mm: 60.0,
        };
        for (name, kinematics) in [("planar", Kinematics::Planar), ("gantry", gantry)] {
            let mut worst = Worst::default();
            fine &= run(kinematics, &mut worst);
            report(name, &worst);
        }
        hprintln!("\"machine_bytes\": {}", core::mem::size_of::<Machine>());
        hprintln!("{}", "}");
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
