//! Streams and machines for the tests of this module.

use crate::job::{Mark, MotionState, SegmentStream};
use crate::settings::Settings;
use headway_firmware::configuration::MachineConfiguration;
use headway_protocol::segment::{FlowAction, FlowEvent, Knot};
use headway_protocol::units::{Ticks, to_units};
use std::io::{self, Write};
use std::sync::{Arc, Mutex};

/// A file that the test can read.
#[derive(Clone, Default)]
pub struct SharedBytes(pub Arc<Mutex<Vec<u8>>>);

impl Write for SharedBytes {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.lock().map_or(Ok(0), |mut held| held.write(bytes))
    }
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// The built-in planar machine.
pub fn planar() -> MachineConfiguration {
    Settings::default().machine
}

/// A spiral with turning heading and flow, `turns` long, from rest to rest; about 60 mm/s. One
/// prime before and one retract after it.
pub fn spiral(turns: f64) -> SegmentStream {
    let pose = |angle: f64| {
        let radius_mm = 10.0 + 0.3 * angle;
        [
            100.0 + radius_mm * angle.cos(),
            120.0 + radius_mm * angle.sin(),
            0.2 + 0.01 * angle,
            0.0,
            0.0,
            angle + 0.3 * (5.0 * angle).sin(),
            0.9 * angle,
        ]
    };
    let start = to_units(&pose(0.0));
    let mut stream = SegmentStream {
        start,
        ..SegmentStream::default()
    };
    let knots = (turns * 90.0) as usize;
    let end = turns * std::f64::consts::TAU;
    let dwell = |count: usize, at: f64| {
        std::iter::repeat_n(
            Knot {
                control: to_units(&pose(at)),
                duration_ticks: 24,
            },
            count,
        )
    };
    stream.knots.extend(dwell(8, 0.0));
    for i in 0..knots {
        // Gentle at both ends: the parameter follows a smooth step.
        let x = (i + 1) as f64 / knots as f64;
        let smooth = x * x * x * (10.0 + x * (6.0 * x - 15.0));
        stream.knots.push(Knot {
            control: to_units(&pose(end * smooth)),
            duration_ticks: 40 + (i % 3) as u16,
        });
    }
    stream.knots.extend(dwell(12, end));
    let event = |span, action| FlowEvent {
        span,
        offset_ticks: 5,
        action,
        volume_units: 300_000,
        duration_ticks: Ticks(80),
    };
    stream.events.push(event(1, FlowAction::Prime));
    stream
        .events
        .push(event(knots as u32 + 10, FlowAction::Retract));
    let end_tick = super::plan_curve::stream_ticks(&stream.knots);
    stream.marks.push(Mark {
        start_tick: 0,
        end_tick,
        state: MotionState::Print,
        layer: 0,
        pass: Some(0),
    });
    stream
}
