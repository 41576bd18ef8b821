//! Streams a job to a board, to its end.
//!
//! In: a port by name. Out: progress reports to the caller, who aborts with `Break`. Heaters, pause
//! and resuming a job are not covered: the command has them.

use super::{Error, Job};
use crate::drive::patience::Patience;
use crate::drive::pump::{Pump, host_session};
use crate::drive::sender::Sender;
use crate::drive::sender_state::{SenderEvent, SenderSetup, SenderState};
use crate::drive::stream_progress::Timeline;
use crate::drive::transport::Port;
use headway_protocol::message::{Control, DeviceState, Status};
use std::ops::ControlFlow;

/// Where a streamed job is.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct StreamStep {
    /// Share of the job's time that is done, 0 to 1.
    pub done: f64,
    /// Time left at the present rate; `None` while the head rests.
    pub left_s: Option<f64>,
    /// Layer from 0.
    pub layer: u32,
    /// Speed of the tip.
    pub speed_mm_s: f64,
}

impl Job {
    /// Streams it to a board until the machine has reached its end: `port` is a serial port's name,
    /// `tcp:HOST:PORT` or `unix:PATH`; `baud` applies to serial ports. `watch` is called at each report of
    /// the board and aborts on the path with `Break`. The machine must be at the start of the job
    /// (`headway board go`), and at its temperatures: heaters are not changed.
    ///
    /// # Errors
    /// [`Error::Line`], and [`Error::Stopped`] once the machine is at rest after an abort.
    pub fn stream(
        &self,
        port: &str,
        baud: u32,
        watch: &mut dyn FnMut(StreamStep) -> ControlFlow<()>,
    ) -> Result<(), Error> {
        let line_error = |error: String| Error::Line(error);
        let port: Port = port
            .parse()
            .map_err(|error: crate::text::refusal::Refusal| line_error(error.to_string()))?;
        let header = &self.file.header;
        let setup = SenderSetup::of_job(header, host_session(), false);
        let mut sender = Sender::new(self.file.frames.clone(), setup);
        let timeline = Timeline::new(&self.stream, self.servo_hz());
        let mut patience = Patience::new(&self.stream, header.machine.servo_hz);
        let mut pump = Pump::open(&port, baud, None)
            .map_err(|error| line_error(format!("{port}: {error}; is the board connected?")))?;
        let (mut rests, mut is_aborting) = (false, false);
        // Ends: the board is heard of, or patience with it runs out.
        loop {
            // A lost line opens again by itself.
            let _ = pump.turn(&mut sender);
            while let Some(event) = sender.poll_event() {
                match event {
                    SenderEvent::Status(status) => {
                        rests = matches!(status.state, DeviceState::Idle | DeviceState::Faulted);
                        if watch(step(&timeline, &status)).is_break() && !is_aborting {
                            sender.command(Control::Abort);
                            is_aborting = true;
                        }
                    }
                    SenderEvent::Fault(fault) => {
                        return Err(line_error(format!("{port}: {fault}")));
                    }
                    _ => {}
                }
            }
            match sender.state() {
                SenderState::Done => return Ok(()),
                SenderState::Failed(error) => return Err(line_error(format!("{port}: {error}"))),
                SenderState::Aborted if rests => return Err(Error::Stopped),
                _ => {}
            }
            if let Some(overdue) = patience.look(pump.now_us(), &sender, pump.is_open()) {
                return Err(line_error(format!("{port}: {overdue}")));
            }
        }
    }
}

fn step(timeline: &Timeline, status: &Status) -> StreamStep {
    let at = timeline.at(status);
    StreamStep {
        done: at.done,
        left_s: at.left_s,
        layer: at.layer,
        speed_mm_s: at.tip_mm_s,
    }
}
