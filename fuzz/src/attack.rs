//! What may come over the line to a controller, as the fuzzer makes it up: messages that look right,
//! and some that do not.

use arbitrary::Arbitrary;
use headway_protocol::units::CHANNELS;

/// One thing that comes over the line, or time that passes.
#[derive(Arbitrary, Debug)]
pub enum Action {
    Hello {
        session: u8,
        version: Option<u16>,
    },
    Start {
        position: [i16; CHANNELS],
        wild: Option<[i32; CHANNELS]>,
        right_machine: bool,
        /// Exponents of lengths, angles and volume.
        units: [u8; 3],
    },
    Knots {
        shift: i16,
        knots: Vec<Move>,
        flip: Option<(u8, u8)>,
    },
    RawBlock {
        bytes: Vec<u8>,
    },
    Flow {
        span: u16,
        offset: u16,
        retract: bool,
        volume: u32,
        duration: u32,
    },
    Finish {
        right: bool,
        knots: u32,
        events: u32,
    },
    Command(Command),
    Payload {
        sequence: u16,
        bytes: Vec<u8>,
    },
    Garbage(Vec<u8>),
    Ticks(u16),
    Listen,
}

/// The next control point, relative to the last one, and a duration.
#[derive(Arbitrary, Debug)]
pub struct Move {
    pub by: [i8; CHANNELS],
    pub far: Option<[i32; CHANNELS]>,
    pub ticks: u16,
}

/// A control message.
#[derive(Arbitrary, Debug)]
pub enum Command {
    Pause,
    Resume,
    Override(u16),
    Abort,
    EmergencyStop,
    ClearFault,
    Status,
    SetPosition([i32; CHANNELS]),
    Jog {
        joint: u8,
        distance: i32,
        speed: u32,
    },
    Home(Vec<u8>),
    SetJoint {
        joint: u8,
        position: i32,
    },
    ReportPeriod(u16),
    FlowOverride(u16),
    Extrude {
        retract: bool,
        volume: u32,
        ticks: u32,
    },
    Probe {
        joint: u8,
        distance: i32,
        fast: u32,
        slow: u32,
        back_off: u32,
    },
    ProbePin {
        out: bool,
    },
}

/// Which machine is attacked.
#[derive(Arbitrary, Clone, Copy, Debug)]
pub enum Kind {
    Planar,
    Gantry,
    Trunnion,
    Arm6,
    HeadCb,
    TableBc,
    TiltedHead,
    Polar,
    CoreXy,
}

/// A whole run.
#[derive(Arbitrary, Debug)]
pub struct Attack {
    pub kind: Kind,
    pub opened: bool,
    pub actions: Vec<Action>,
}
