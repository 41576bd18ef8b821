//! The state of a conversation with the controller: setup, states, errors, events, counters.

use crate::job::file::JobHeader;
use headway_protocol::message::{
    BoardFigures, Control, Crash, Fault, PROTOCOL_VERSION, Refusal, RefusalReason, SCHEMA_HASH,
    Status, Welcome,
};
use thiserror::Error;

/// The sender's setup.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SenderSetup {
    /// Differs for every run of the host.
    pub host_session: u32,
    /// Hash of the machine configuration that the job was planned for.
    pub machine_hash: u32,
    /// Joint solution that the job was planned for.
    pub solution: u8,
    /// Servo rate that the job was planned for.
    pub servo_hz: u32,
    /// Continue this job if the controller already has part of it.
    pub resume: bool,
}

/// Where the conversation is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SenderState {
    /// Saying hello.
    Greeting,
    /// Opening the stream.
    Opening,
    /// Streaming.
    Streaming,
    /// Connected for commands only.
    Talking,
    /// Everything was accepted; the machine runs to the end.
    Finishing,
    /// The controller has accepted an abort: it comes to rest and drops the stream.
    Aborted,
    /// The machine has reached the end.
    Done,
    /// It cannot continue.
    Failed(SenderError),
}

/// Why a stream cannot continue.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum SenderError {
    /// Other protocol version.
    #[error(
        "the controller speaks protocol version {device}, this program {host}; flash the matching firmware"
    )]
    ProtocolVersion {
        /// Ours.
        host: u16,
        /// Theirs.
        device: u16,
    },
    /// Other message layout.
    #[error(
        "the controller's messages have schema {device:08x}, this program's {host:08x}; flash the matching firmware"
    )]
    Schema {
        /// Ours.
        host: u32,
        /// Theirs.
        device: u32,
    },
    /// Other machine.
    #[error(
        "the job was planned for machine {job:08x}, the controller is configured as {device:08x}; if \
         `headway board configure` has changed that since its start, switch it off and on, else plan again with its machine file"
    )]
    Machine {
        /// The job's.
        job: u32,
        /// The controller's.
        device: u32,
    },
    /// Other servo rate.
    #[error("the job was planned for a servo of {job_hz} Hz, the controller's has {device_hz} Hz")]
    ServoRate {
        /// The job's.
        job_hz: u32,
        /// The controller's.
        device_hz: u32,
    },
    /// The controller works on something else.
    #[error("the controller is busy with job {job:08x}; wait for it or abort it")]
    Busy {
        /// Its job.
        job: u32,
    },
    /// There is nothing to continue.
    #[error("the controller has no part of job {job:08x} to go on with; start it without --resume")]
    NothingToResume {
        /// Our job.
        job: u32,
    },
    /// It lost its queue and position.
    #[error(
        "the controller has restarted during the job (session {before:08x}, now {now:08x}); its position is lost, home it and start again"
    )]
    DeviceRestarted {
        /// Session at the start.
        before: u32,
        /// Session now.
        now: u32,
    },
    /// It lost its queue and position, but not the number of its session.
    #[error(
        "the controller no longer has job {job:08x}: it has restarted, or another program has ended it; home it and start again"
    )]
    StreamLost {
        /// Our job.
        job: u32,
    },
    /// It refused.
    #[error("the controller refused: {0}")]
    Refused(RefusalReason),
    /// It latched a fault.
    #[error("the controller latched a fault: {0}")]
    Fault(Fault),
    /// Its queue is too small for the required look-ahead.
    #[error("the controller's queues ({knots} knots, {events} events) are too small for streaming")]
    QueueTooSmall {
        /// Knots.
        knots: u16,
        /// Events.
        events: u16,
    },
}

/// News for the caller.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SenderEvent {
    /// The controller answered.
    Connected(Welcome),
    /// The machine's state.
    Status(Status),
    /// A fault was latched.
    Fault(Fault),
    /// A command was refused.
    Refused(Refusal),
    /// A command was accepted.
    Taken(Control),
    /// What the controller has measured of itself.
    Measured(BoardFigures),
    /// How the controller's run before this one ended.
    Crash(Crash),
}

/// Counters for reports.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SenderFigures {
    /// Bytes put on the line.
    pub bytes_sent: u64,
    /// Stream frames put on the line, repeats included.
    pub frames_sent: u64,
    /// Of these, repeats.
    pub frames_resent: u64,
    /// Frames from the controller that were damaged.
    pub frames_damaged: u64,
    /// Polls at which the stream waited for credits while the window had room.
    pub credit_waits: u64,
}

/// A stream frame in transit.
#[derive(Clone, Copy, Debug)]
pub(super) struct InFlight {
    pub(super) sent_us: u64,
    pub(super) bytes: usize,
    pub(super) repeated: bool,
}

/// A control message in transit.
#[derive(Clone, Copy, Debug)]
pub(super) struct Outstanding {
    pub(super) sequence: u16,
    pub(super) what: ControlMessage,
    pub(super) sent_us: Option<u64>,
    pub(super) retry_us: u64,
    pub(super) tries: u32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ControlMessage {
    Hello,
    Start,
    Command(Control),
}

/// What the conversation is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Intent {
    /// Stream the job from its first frame.
    Stream,
    /// Continue the job if the controller has part of it, otherwise start from its first frame.
    ResumeOrStream,
    /// Go on with the job, or fail.
    ResumeOnly,
    /// Commands and questions only.
    Talk,
}

impl SenderSetup {
    /// From a job's header, for the machine that it was planned for.
    pub fn of_job(header: &JobHeader, host_session: u32, resume: bool) -> SenderSetup {
        SenderSetup {
            host_session,
            machine_hash: header.machine_hash,
            solution: header.machine.kinematics.solution(),
            servo_hz: header.machine.servo_hz,
            resume,
        }
    }

    /// Can this controller run the job?
    pub(super) fn check_welcome(
        &self,
        welcome: &Welcome,
        intent: Intent,
    ) -> Result<(), SenderError> {
        if welcome.protocol_version != PROTOCOL_VERSION {
            return Err(SenderError::ProtocolVersion {
                host: PROTOCOL_VERSION,
                device: welcome.protocol_version,
            });
        }
        if welcome.schema_hash != SCHEMA_HASH {
            return Err(SenderError::Schema {
                host: SCHEMA_HASH,
                device: welcome.schema_hash,
            });
        }
        if intent == Intent::Talk {
            return Ok(());
        }
        if welcome.machine_hash != self.machine_hash {
            return Err(SenderError::Machine {
                job: self.machine_hash,
                device: welcome.machine_hash,
            });
        }
        if welcome.servo_hz != self.servo_hz {
            return Err(SenderError::ServoRate {
                job_hz: self.servo_hz,
                device_hz: welcome.servo_hz,
            });
        }
        let (knots, events) = (welcome.queue_knots, welcome.queue_events);
        let block = headway_protocol::knot_block::KNOTS_PER_BLOCK_MAX;
        if usize::from(knots) < 2 * block
            || usize::from(events) < 2 * crate::job::frames::EVENTS_AHEAD_MAX
        {
            return Err(SenderError::QueueTooSmall { knots, events });
        }
        Ok(())
    }

    /// A refused opening, with both values where it is a mismatch.
    pub(super) fn refusal_error(&self, reason: RefusalReason) -> SenderError {
        match reason {
            RefusalReason::ProtocolVersion(device) => SenderError::ProtocolVersion {
                host: PROTOCOL_VERSION,
                device,
            },
            RefusalReason::Schema(device) => SenderError::Schema {
                host: SCHEMA_HASH,
                device,
            },
            RefusalReason::Machine(device) => SenderError::Machine {
                job: self.machine_hash,
                device,
            },
            other => SenderError::Refused(other),
        }
    }
}
