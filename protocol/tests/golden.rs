//! Goal: the bytes in WIRE.md are those that this build writes and reads. Method: every line of its
//! golden block is encoded again, compared, and decoded.

use headway_protocol::frame::{FRAME_BYTES_MAX, FrameDecoder, encode_frame};
use headway_protocol::knot_block::{KnotPredictor, decode_block, encode_block};
use headway_protocol::message::*;
use headway_protocol::segment::{FlowAction, FlowEvent, Knot};
use headway_protocol::units::{Ticks, Units};

const WIRE: &str = include_str!("../WIRE.md");
const POSITION: [i32; 7] = [1_000_000, -2_000_000, 2000, 0, 0, 1_570_796, 0];

fn knots() -> Vec<Knot> {
    (0..12i32)
        .map(|i| Knot {
            control: [
                1_000_000 + 40 * i * i,
                -2_000_000 + 700 * i,
                2000,
                0,
                -5 * i,
                1_570_796 + 1300 * i + i % 3,
                11 * i * i,
            ],
            duration_ticks: 12 + (i % 4) as u16,
        })
        .collect()
}

fn host_message<'a>(name: &str, block: &'a [u8]) -> Option<HostMessage<'a>> {
    Some(match name {
        "hello" => HostMessage::Hello(Hello {
            protocol_version: PROTOCOL_VERSION,
            schema_hash: SCHEMA_HASH,
            host_session: 0xdead_beef,
        }),
        "start" => HostMessage::Start(Start {
            job: 0x0102_0304,
            machine_hash: 0x0506_0708,
            first_sequence: 3,
            position: POSITION,
            solution: 5,
            units: Units {
                length_exponent: 5,
                angle_exponent: 0,
                volume_exponent: 17,
            },
        }),
        "knots" => HostMessage::Knots(block),
        "flow" => HostMessage::Flow(FlowEvent {
            span: 300,
            offset_ticks: 5,
            action: FlowAction::Retract,
            volume_units: 400_000,
            duration_ticks: Ticks(100),
        }),
        "finish" => HostMessage::Finish(Finish {
            knots: 12,
            events: 1,
        }),
        "pause" => HostMessage::Control(Control::Pause),
        "resume" => HostMessage::Control(Control::Resume),
        "override" => HostMessage::Control(Control::Override(150)),
        "abort" => HostMessage::Control(Control::Abort),
        "emergency_stop" => HostMessage::Control(Control::EmergencyStop),
        "clear_fault" => HostMessage::Control(Control::ClearFault),
        "status_request" => HostMessage::Control(Control::StatusRequest),
        "set_position" => HostMessage::Control(Control::SetPosition(POSITION)),
        "jog" => HostMessage::Control(Control::Jog {
            joint: 2,
            distance_units: -100_000,
            speed_units_s: 50_000,
        }),
        "home" => HostMessage::Control(Control::Home(JointOrder::of(&[2, 0, 1]).unwrap())),
        "set_joint" => HostMessage::Control(Control::SetJoint {
            joint: 3,
            position_units: -1_570_796,
        }),
        "report_period" => HostMessage::Control(Control::ReportPeriod(500)),
        "flow_override" => HostMessage::Control(Control::FlowOverride(95)),
        "extrude" => HostMessage::Control(Control::Extrude {
            action: FlowAction::Retract,
            volume_units: 800_000,
            duration_ticks: Ticks(400),
        }),
        "go_to" => HostMessage::Control(Control::GoTo(POSITION)),
        "motors_off" => HostMessage::Control(Control::MotorsOff),
        "heat" => HostMessage::Control(Control::Heat {
            heater: 1,
            decidegrees: 2105,
            wait: true,
        }),
        "fan" => HostMessage::Control(Control::Fan(350)),
        "settings_begin" => HostMessage::Control(Control::SettingsBegin { length: 33 }),
        "settings_part" => HostMessage::Control(Control::SettingsPart {
            offset: 32,
            bytes: core::array::from_fn(|place| if place == 0 { 7 } else { 0 }),
        }),
        "settings_end" => HostMessage::Control(Control::SettingsEnd),
        "probe" => HostMessage::Control(Control::Probe {
            joint: 2,
            distance_units: -80_000,
            fast_units_s: 50_000,
            slow_units_s: 10_000,
            back_off_units: 20_000,
        }),
        "probe_pin" => HostMessage::Control(Control::ProbePin(PinPosition::SelfTest)),
        "extrude_cold" => HostMessage::Control(Control::ExtrudeCold(true)),
        "measure" => HostMessage::Control(Control::Measure(false)),
        _ => return None,
    })
}

fn device_message(name: &str) -> Option<DeviceMessage> {
    let fault = Fault {
        cause: FaultCause::SoftLimit,
        index: 2,
        value: -12_345,
    };
    let ack = Ack {
        session: 77,
        next_sequence: 3,
        knot_limit: 512,
        event_limit: 32,
        control_taken: 2,
    };
    Some(match name {
        "welcome" => DeviceMessage::Welcome(Welcome {
            protocol_version: PROTOCOL_VERSION,
            schema_hash: SCHEMA_HASH,
            firmware_version: [0, 1, 0],
            machine_hash: 0x0506_0708,
            queue_knots: 512,
            queue_events: 32,
            servo_hz: 2000,
            step_hz: 200_000,
            session: 77,
            host_session: 0xdead_beef,
            stream: Some(OpenStream {
                job: 0x0102_0304,
                first_sequence: 3,
                next_sequence: 3,
                knots_taken: 0,
                spans_done: 0,
            }),
            settings_hash: 0x1122_3344,
        }),
        "refused" => DeviceMessage::Refused(Refusal {
            sequence: 2,
            reason: RefusalReason::Machine(9),
        }),
        "refused_settings" => DeviceMessage::Refused(Refusal {
            sequence: 4,
            reason: RefusalReason::Settings(SettingsRefusal {
                problem: SettingsProblem::Joint,
                index: 2,
                item: 5,
                value: RefusedNumber(-1.5),
            }),
        }),
        "refused_cold" => DeviceMessage::Refused(Refusal {
            sequence: 5,
            reason: RefusalReason::Cold(ColdHeater {
                heater: 2,
                decidegrees: -15,
                least_decidegrees: 1700,
            }),
        }),
        "ack" => DeviceMessage::Ack(ack),
        "nak" => DeviceMessage::Nak(ack),
        "status" => DeviceMessage::Status(Status {
            session: 77,
            state: DeviceState::Running,
            sigma_permille: 1000,
            override_percent: 100,
            flow_percent: 95,
            spans_done: 4,
            queue_knots: 8,
            queue_events: 1,
            referenced: 0b1111,
            switches: 0b100,
            counts_steps: [8000, -16_000, 80, 2400, 0].into_iter().collect(),
            heaters: [(2098, 2100, 415), (-3, 0, 0)]
                .into_iter()
                .map(
                    |(decidegrees, target_decidegrees, duty_permille)| HeaterStatus {
                        decidegrees,
                        target_decidegrees,
                        duty_permille,
                    },
                )
                .collect(),
            fan_permille: 350,
            fault: Some(fault),
            drivers: [(0, 0, 0), (0x83, 17, 300)]
                .into_iter()
                .map(|(flags, scale, retries)| DriverStatus {
                    flags,
                    scale,
                    retries,
                })
                .collect(),
            probe: ProbeResult::Touched(-1234),
        }),
        "fault" => DeviceMessage::Fault(fault),
        "measured" => DeviceMessage::Measured(BoardFigures {
            clock_hz: 168_000_000,
            step: TickFigures {
                count: 20_000,
                min_clocks: 151,
                mean_milliclocks: 187_250,
                max_clocks: 343,
            },
            servo: TickFigures {
                count: 200,
                min_clocks: 1100,
                mean_milliclocks: 1_690_500,
                max_clocks: 2250,
            },
            lock_max_clocks: 9735,
            round_max_clocks: 84_000,
            stack_used_bytes: 12_000,
            stack_bytes: 86_016,
            brown_out_level: Some(3),
        }),
        "crash" => DeviceMessage::Crash(Crash {
            cause: CrashCause::HardFault(0x0001_0000),
            pc: 0x0801_2344,
            lr: 0x0801_2301,
            servo_tick: 123_456,
        }),
        _ => return None,
    })
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Encodes the message of a golden line and checks that it decodes to itself.
fn frame_of(name: &str, sequence: u16) -> String {
    let (block, count) = encode_block(&mut KnotPredictor::new(POSITION), &knots());
    assert_eq!(count, 12);
    let mut out = [0u8; FRAME_BYTES_MAX];
    let length = match (host_message(name, &block), device_message(name)) {
        (Some(message), _) => encode_frame(sequence, &message, &mut out).unwrap(),
        (_, Some(message)) => encode_frame(sequence, &message, &mut out).unwrap(),
        _ => panic!("WIRE.md names an unknown message {name}"),
    };
    let mut decoder = FrameDecoder::new();
    let mut frames = 0;
    for &byte in &out[..length] {
        if let Some(frame) = decoder.push(byte) {
            let frame = frame.unwrap();
            assert_eq!(frame.sequence, sequence);
            match host_message(name, &block) {
                Some(message) => assert_eq!(HostMessage::decode(frame.payload), Ok(message)),
                None => {
                    let decoded = DeviceMessage::decode(frame.payload).unwrap();
                    assert_eq!(Some(decoded), device_message(name));
                }
            }
            frames += 1;
        }
    }
    assert_eq!(frames, 1);
    hex(&out[..length - 1])
}

#[test]
fn wire_md_states_the_bytes_of_this_build() {
    let golden = WIRE.split("<!-- golden -->").nth(1).unwrap();
    let mut lines = 0;
    let mut wrong = Vec::new();
    for line in golden
        .lines()
        .filter(|line| line.starts_with("    "))
        .take(40)
    {
        let cells: Vec<&str> = line.split_whitespace().collect();
        let sequence = u16::from_str_radix(cells[1], 16).unwrap();
        let actual = frame_of(cells[0], sequence);
        if actual != cells[2] {
            wrong.push(format!("    {:<16} {:04x}  {actual}", cells[0], sequence));
        }
        lines += 1;
    }
    assert_eq!(lines, 40, "every variant has its line");
    assert!(wrong.is_empty(), "this build writes:\n{}", wrong.join("\n"));
}

#[test]
fn the_golden_knot_block_decodes_to_its_knots() {
    let mut sender = KnotPredictor::new(POSITION);
    let (block, _) = encode_block(&mut sender, &knots());
    let mut receiver = KnotPredictor::new(POSITION);
    assert_eq!(decode_block(&mut receiver, &block).unwrap(), knots()[..]);
}

#[test]
fn the_protocol_version_of_wire_md_is_that_of_this_build() {
    assert!(WIRE.contains(&format!("Protocol version {PROTOCOL_VERSION}.")));
}

#[test]
fn an_order_of_joints_comes_back_and_one_that_cannot_be_is_refused() {
    let order = JointOrder::of(&[2, 0, 7, 5]).unwrap();
    assert_eq!(order.joints().collect::<Vec<u8>>(), [2, 0, 7, 5]);
    assert_eq!(JointOrder::of(&[]), Some(JointOrder::ALL));
    assert!(JointOrder::of(&[0, 1, 2, 3, 4, 5, 6, 7]).is_some());
    for wrong in [&[1, 1][..], &[8], &[0, 1, 2, 3, 4, 5, 6, 7, 0]] {
        assert_eq!(JointOrder::of(wrong), None, "{wrong:?}");
    }
    // Joint 0, the end, joint 1; and joint 8: as bytes of a control message.
    for packed in [&[0x81, 0x04][..], &[0x09], &[0x11]] {
        let bytes = [&[5, 9], packed].concat();
        assert_eq!(HostMessage::decode(&bytes), Err(MessageError::FieldRange));
    }
}
