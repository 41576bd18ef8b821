//! All messages between host and controller, as postcard enums.
//!
//! There are two classes of messages from host to controller. *Stream* messages
//! ([`HostMessage::Knots`], [`HostMessage::Flow`], [`HostMessage::Finish`]) are numbered from
//! `Start::first_sequence`, accepted in order and exactly once, and limited by credits. *Control*
//! messages (all others) have a numbering of their own, overtake the stream, and are accepted if
//! newer than the last one. `WIRE.md` has the bytes and the rules; this file has the types and the
//! check of every field.

pub use crate::board_report::{BoardFigures, Crash, CrashCause, TickFigures};
pub use crate::control::{
    Control, DECIDEGREES_MAX, EVENT_DURATION_TICKS_MAX, EVENT_VOLUME_UNITS_MAX, FLOW_PERCENT_RANGE,
    HEATERS_MAX, JointOrder, OVERRIDE_PERCENT_MAX, PinPosition, REPORT_MOTORS_MAX,
    REPORT_PERIOD_RANGE_MS, SETTINGS_BYTES_MAX, SETTINGS_PART_BYTES,
};
pub use crate::driver::{DriverFlags, DriverStatus};
pub use crate::fault::{ColdHeater, Fault, FaultCause};
use crate::segment::{FlowEvent, SPAN_TICKS_MAX};
pub use crate::settings::{RefusedNumber, SettingsProblem, SettingsRefusal};
use crate::units::{ChannelPoint, Units};
use heapless::Vec;
use serde::{Deserialize, Serialize};

/// Version of the whole protocol; another one is refused with both values shown.
pub const PROTOCOL_VERSION: u16 = 11;
/// The layout of every message, field by field: its hash guards against a build that changed a
/// message and forgot the version. Change it together with the types; the golden test of `WIRE.md`
/// reports a mismatch.
pub const SCHEMA: &str = "\
frame: u16le sequence, postcard, u32le crc32 iso-hdlc; cobs; 00\n\
host: 0 hello{protocol u16,schema u32,host_session u32}\n\
 1 start{job u32,machine_hash u32,first_sequence u32,position i32*7,solution u8,units u8*3}\n\
 2 knots(block) 3 flow{span u32,offset u16,action u8,volume u32,duration u32}\n\
 4 finish{knots u32,events u32}\n\
 5 control 0 pause 1 resume 2 override u16 3 abort 4 stop 5 clear 6 status\n\
 7 position i32*7 8 jog{joint u8,distance i32,speed u32} 9 home u32 10 joint{joint u8,position i32}\n\
 11 report u16 12 flow u16 13 extrude{action u8,volume u32,duration u32} 14 goto i32*7\n\
 15 motors off 16 heat{heater u8,decidegrees u16,wait bool} 17 fan u16\n\
 18 settings{length u16} 19 part{offset u16,bytes u8*32} 20 settings end\n\
 21 probe{joint u8,distance i32,fast u32,slow u32,back u32}\n\
 22 probe pin 0 stow 1 deploy 2 self-test 3 reset\n\
 23 extrude cold bool 24 measure bool\n\
device: 0 welcome{protocol u16,schema u32,firmware u8*3,machine_hash u32,knots u16,events u16,\
servo u32,step u32,session u32,host_session u32,stream option{job u32,first u32,next u32,knots u32,spans u32},\
settings_hash u32}\n\
 1 refused{sequence u16,reason 0 protocol u16 1 schema u32 2 machine u32 3 no stream 4 busy 5 faulted 6 invalid 7 no hello \
8 settings{problem 0..14 u8,index u8,item u8,value f32} 9 cold{heater u8,decidegrees i16,least u16}}\n\
 2 ack{session u32,next u32,knot_limit u32,event_limit u32,control u16} 3 nak(ack)\n\
 4 status{session u32,state u8,sigma u16,override u16,flow u16,spans u32,knots u16,events u16,\
referenced u8,switches u8,counts vec i32,heaters vec{decidegrees i16,target u16,duty u16},fan u16,fault option,\
drivers vec{flags u16,scale u8,retries u16},probe 0 none 1 touched i32 2 not found 3 pressed 4 stays pressed}\n\
 5 fault{cause 0..30 u8,index u8,value i32}\n\
 6 measured{clock u32,step{count u32,min u32,mean u32,max u32},servo(step),lock u32,round u32,used u32,stack u32,\
brown_out option u8}\n\
 7 crash{cause 0 core u32 1 panic u32 2 interrupt u32,pc u32,lr u32,tick u32}\n\
block: v1\n";
/// CRC-32 of [`SCHEMA`].
pub const SCHEMA_HASH: u32 = crate::frame::CRC.checksum(SCHEMA.as_bytes());

/// Messages of the host.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum HostMessage<'a> {
    /// Opens the conversation.
    Hello(Hello),
    /// Opens a stream.
    Start(Start),
    /// A block of knots, packed as `knot_block` describes.
    Knots(&'a [u8]),
    /// A prime or retract; sent before the block with the knot of its span.
    Flow(FlowEvent),
    /// The stream is complete: everything queued may run to rest.
    Finish(Finish),
    /// A command that overtakes the stream.
    Control(Control),
}

/// Who the host is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Hello {
    /// [`PROTOCOL_VERSION`] of the host.
    pub protocol_version: u16,
    /// [`SCHEMA_HASH`] of the host.
    pub schema_hash: u32,
    /// Chosen by each host process; a new one restarts the numbering of control messages at this
    /// frame's sequence.
    pub host_session: u32,
}

/// Opens a stream: resets the knot predictor and gives the pose from which it starts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Start {
    /// Identity of the job, so that a restarted host can tell whether this is its own.
    pub job: u32,
    /// Hash of the machine configuration that the job was planned for.
    pub machine_hash: u32,
    /// Sequence number of the stream's first frame. It continues from the last stream's end, so
    /// that late frames of another stream are always old.
    pub first_sequence: u32,
    /// Pose at rest from which the first knots start, in the stream's units.
    pub position: ChannelPoint,
    /// Joint solution of the machine for the complete stream; 0 if there is only one.
    pub solution: u8,
    /// Units of the complete stream: of this position, of its knots and of its flow events.
    pub units: Units,
}

/// End of the stream, with totals since `Start` to check.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Finish {
    /// Knots sent.
    pub knots: u32,
    /// Flow events sent.
    pub events: u32,
}

/// Messages of the controller. Its frames are numbered by a separate counter.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum DeviceMessage {
    /// Answer to `Hello`.
    Welcome(Welcome),
    /// A message that was understood but cannot be followed.
    Refused(Refusal),
    /// What was accepted, and how much more may be sent.
    Ack(Ack),
    /// The same, and: send again from `next_sequence`, a frame was lost.
    Nak(Ack),
    /// Where the machine is.
    Status(Status),
    /// A fault was latched (repeated in every `Status` until it is cleared).
    Fault(Fault),
    /// What a board has measured of itself: the answer to the end of a measurement.
    Measured(BoardFigures),
    /// How the run before the last reset ended; with every `Welcome`, before it.
    Crash(Crash),
}

/// Identity and state of the controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Welcome {
    /// [`PROTOCOL_VERSION`] of the controller.
    pub protocol_version: u16,
    /// [`SCHEMA_HASH`] of the controller.
    pub schema_hash: u32,
    /// Version of the firmware: major, minor, patch.
    pub firmware_version: [u8; 3],
    /// Hash of its machine configuration.
    pub machine_hash: u32,
    /// Capacity of its queue in knots.
    pub queue_knots: u16,
    /// Capacity of its queue in flow events.
    pub queue_events: u16,
    /// Servo ticks per second; durations count them.
    pub servo_hz: u32,
    /// Step ticks per second.
    pub step_hz: u32,
    /// Differs after every restart of the controller.
    pub session: u32,
    /// `Hello::host_session` that this answers.
    pub host_session: u32,
    /// The stream that is open, or the last one if it has ended, until the next `Start`; one of [`NO_JOB`]
    /// after an abort or a cleared fault, which gives the start of the next one's numbering.
    pub stream: Option<OpenStream>,
    /// CRC-32 of the active settings, including drivers and pins; 0 if they are built in.
    pub settings_hash: u32,
}

/// Job of an abandoned stream, whose numbering continues in the next one.
pub const NO_JOB: u32 = 0;

/// A stream in progress, as the controller knows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct OpenStream {
    /// `Start::job`.
    pub job: u32,
    /// `Start::first_sequence`.
    pub first_sequence: u32,
    /// Sequence number of the next frame.
    pub next_sequence: u32,
    /// Knots accepted since `Start`.
    pub knots_taken: u32,
    /// Spans completed since `Start`.
    pub spans_done: u32,
}

/// Why a message was refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Refusal {
    /// Frame sequence of the refused message.
    pub sequence: u16,
    /// Why.
    pub reason: RefusalReason,
}

/// Reasons to refuse, with the controller's own value if it is a mismatch.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum RefusalReason {
    /// The controller speaks this protocol version.
    ProtocolVersion(u16),
    /// The controller was built with this schema hash.
    Schema(u32),
    /// The controller has a machine configuration with this hash.
    Machine(u32),
    /// Stream messages arrived but no stream is open.
    NoStream,
    /// Not while the machine is moving or a stream is open.
    Busy,
    /// Not while a fault is latched.
    Faulted,
    /// A field is out of its range, or the command is not supported by this machine.
    Invalid,
    /// A command arrived before any `Hello` since the controller's start.
    NoHello,
    /// The settings are refused.
    Settings(SettingsRefusal),
    /// Melt would move while this hot end is too cold for it.
    Cold(ColdHeater),
}

/// What was accepted, and how much more may be sent. Limits are totals since `Start`, so that lost
/// or late acknowledgements do no harm: the largest value seen is valid.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Ack {
    /// `Welcome::session`; another one means that the controller has restarted.
    pub session: u32,
    /// Sequence number of the next stream frame: all before it were accepted.
    pub next_sequence: u32,
    /// Total number of knots that may be sent since `Start` (accepted so far + room in the queue).
    pub knot_limit: u32,
    /// Flow events that may be sent in all since `Start`.
    pub event_limit: u32,
    /// Sequence of the newest accepted control message; the one before it if that was refused.
    pub control_taken: u16,
}

/// What the machine is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum DeviceState {
    /// No stream.
    Idle,
    /// A stream is open, not enough is queued to begin.
    Filling,
    /// Moving along the stream.
    Running,
    /// Coming to rest, or at rest, on request of the host.
    Paused,
    /// Coming to rest, or resting, because the queue ran low.
    Starved,
    /// Coming to rest to forget the stream.
    Aborting,
    /// The stream ran to its end.
    Finished,
    /// Homing.
    Homing,
    /// Jogging.
    Jogging,
    /// A fault is latched.
    Faulted,
    /// Coming to rest, or resting, until a heater is there.
    Heating,
    /// Probing.
    Probing,
}

/// What the newest [`Control::Probe`] found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ProbeResult {
    /// No result: none was requested, it is in progress, or it was aborted.
    #[default]
    None,
    /// Position of the joint when the probe triggered, 0.1 µm or µrad: to a whole servo tick.
    Touched(i32),
    /// The probe did not trigger over the complete distance.
    NotFound,
    /// It was pressed before anything moved: nothing did.
    Pressed,
    /// It stays pressed during the retreat.
    StaysPressed,
}

/// Where the machine is.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Status {
    /// `Welcome::session`.
    pub session: u32,
    /// Its present state.
    pub state: DeviceState,
    /// Path rate: 1000 is the planned one.
    pub sigma_permille: u16,
    /// Present feed override.
    pub override_percent: u16,
    /// Present flow override.
    pub flow_percent: u16,
    /// Spans completed since `Start`.
    pub spans_done: u32,
    /// Knots in the queue.
    pub queue_knots: u16,
    /// Flow events in the queue.
    pub queue_events: u16,
    /// Joints whose position is known, bit 0 = joint 0: declared, or homed.
    pub referenced: u8,
    /// Joints whose switch is pressed; bit [`PROBE_BIT`]: the probe is.
    pub switches: u8,
    /// Step counts: joints in order, then the extruder.
    pub counts_steps: Vec<i32, REPORT_MOTORS_MAX>,
    /// Heaters in order.
    pub heaters: Vec<HeaterStatus, HEATERS_MAX>,
    /// Part fan in thousandths.
    pub fan_permille: u16,
    /// The latched fault.
    pub fault: Option<Fault>,
    /// Drivers in the motors' order; empty if the board does not communicate with them.
    pub drivers: Vec<DriverStatus, REPORT_MOTORS_MAX>,
    /// What the newest probing found.
    pub probe: ProbeResult,
}

/// The probe's bit of [`Status::switches`].
pub const PROBE_BIT: u8 = 7;

/// What a heater is doing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct HeaterStatus {
    /// Temperature, tenths of a degree Celsius; the lowest number where it is not known.
    pub decidegrees: i16,
    /// Current target, tenths of a degree; 0 is off.
    pub target_decidegrees: u16,
    /// Duty in thousandths.
    pub duty_permille: u16,
}

impl core::fmt::Display for RefusalReason {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::ProtocolVersion(device) => write!(f, "it speaks protocol version {device}"),
            Self::Schema(device) => write!(f, "its messages have schema {device:08x}"),
            Self::Machine(device) => write!(f, "its machine configuration is {device:08x}"),
            Self::NoStream => f.write_str("no stream is open"),
            Self::Busy => f.write_str("it is moving or has a stream open"),
            Self::Faulted => f.write_str("a fault is latched; clear it first"),
            Self::Invalid => f.write_str(
                "a value is out of range, or the machine is not where the stream begins (home it, \
                 then `headway board go JOB`)",
            ),
            Self::NoHello => f.write_str("it has restarted and waits for a greeting"),
            Self::Settings(refusal) => refusal.fmt(f),
            Self::Cold(heater) => heater.fmt(f),
        }
    }
}

/// Why a payload is not a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum MessageError {
    /// Postcard cannot read it.
    Malformed,
    /// There are bytes after the message.
    TrailingBytes,
    /// A field is out of its range.
    FieldRange,
}

/// The class of a payload's message, by its first byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MessageClass {
    /// A greeting.
    Hello,
    /// Numbered, credited messages of the stream.
    Stream,
    /// `Start` and the commands.
    Control,
    /// A code that this protocol does not define.
    Unknown,
}

impl MessageClass {
    /// Of a host's payload, whether or not it can be read.
    pub fn of(payload: &[u8]) -> Self {
        // The variants of `HostMessage` in their order.
        match payload.first() {
            Some(0) => Self::Hello,
            Some(2..=4) => Self::Stream,
            Some(1 | 5) => Self::Control,
            _ => Self::Unknown,
        }
    }
}

impl HostMessage<'_> {
    /// Reads a frame's payload and checks every field (the bytes of a knot block are checked by
    /// its own decoder).
    pub fn decode(payload: &[u8]) -> Result<HostMessage<'_>, MessageError> {
        let (message, rest) = postcard::take_from_bytes::<HostMessage<'_>>(payload)
            .map_err(|_| MessageError::Malformed)?;
        if !rest.is_empty() {
            return Err(MessageError::TrailingBytes);
        }
        message.check()?;
        Ok(message)
    }

    /// True for the numbered, credited messages of the stream.
    pub fn is_stream(&self) -> bool {
        matches!(
            self,
            HostMessage::Knots(_) | HostMessage::Flow(_) | HostMessage::Finish(_)
        )
    }

    /// Checks the range of every field.
    pub fn check(&self) -> Result<(), MessageError> {
        let valid = match self {
            HostMessage::Flow(event) => {
                event.offset_ticks < SPAN_TICKS_MAX
                    && event.volume_units <= EVENT_VOLUME_UNITS_MAX
                    && (1..=EVENT_DURATION_TICKS_MAX).contains(&event.duration_ticks.0)
            }
            HostMessage::Control(control) => control.is_valid(),
            HostMessage::Knots(block) => !block.is_empty(),
            HostMessage::Start(start) => start.units.is_valid(),
            // Every value of these is possible; what it means is checked by the receiver.
            HostMessage::Hello(_) | HostMessage::Finish(_) => true,
        };
        if valid {
            Ok(())
        } else {
            Err(MessageError::FieldRange)
        }
    }
}

impl DeviceMessage {
    /// Reads a frame's payload.
    pub fn decode(payload: &[u8]) -> Result<DeviceMessage, MessageError> {
        let (message, rest) = postcard::take_from_bytes::<DeviceMessage>(payload)
            .map_err(|_| MessageError::Malformed)?;
        if !rest.is_empty() {
            return Err(MessageError::TrailingBytes);
        }
        Ok(message)
    }
}
