//! Durations that a board measures of itself, from a host's order to its end.
//!
//! In: durations of interrupts, from the main loop while [`Measurement::is_on`]; locks, rounds and stack at the end. Out:
//! [`BoardFigures`] for the report. Not covered: how they are measured (`board::gaps`).

use headway_protocol::message::{BoardFigures, TickFigures};

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Phase {
    #[default]
    Off,
    On,
    Ending,
    Done,
}

/// A measurement, or none.
#[derive(Clone, Debug, Default)]
pub struct Measurement {
    phase: Phase,
    figures: BoardFigures,
    /// Of the step and the servo interrupts.
    sums_milliclocks: [u64; 2],
}

impl Measurement {
    /// The board measures with a clock of this frequency; the level of its brown-out reset, where it knows it.
    pub fn measure_with(&mut self, clock_hz: u32, brown_out_level: Option<u8>) {
        self.figures.clock_hz = clock_hz;
        self.figures.brown_out_level = brown_out_level;
    }

    /// By a host's order: begins anew, or ends. False on a board that cannot.
    pub(super) fn order(&mut self, begin: bool) -> bool {
        let BoardFigures {
            clock_hz,
            brown_out_level,
            ..
        } = self.figures;
        if begin {
            *self = Self::default();
            self.measure_with(clock_hz, brown_out_level);
            self.phase = Phase::On;
        } else if self.is_on() {
            self.phase = Phase::Ending;
        }
        clock_hz > 0
    }

    /// The board is to measure in this round.
    pub fn is_on(&self) -> bool {
        matches!(self.phase, Phase::On | Phase::Ending)
    }

    /// Nothing was measured yet: maxima from before do not count.
    pub fn is_new(&self) -> bool {
        self.figures.step.count == 0
    }

    /// It is to be ended by [`Self::end`].
    pub fn is_ending(&self) -> bool {
        self.phase == Phase::Ending
    }

    /// The longest lock and round, clocks, and the stack, bytes in use and in all.
    pub fn end(&mut self, [lock, round]: [u32; 2], [used, room]: [u32; 2]) {
        let figures = &mut self.figures;
        (figures.lock_max_clocks, figures.round_max_clocks) = (lock, round);
        (figures.stack_used_bytes, figures.stack_bytes) = (used, room);
        self.phase = Phase::Done;
    }

    /// A step interrupt took so long.
    pub fn note_step(&mut self, milliclocks: u32) {
        let [sum, _] = &mut self.sums_milliclocks;
        note(&mut self.figures.step, sum, milliclocks);
    }

    /// A servo interrupt took so long, with this many steps in it, which are subtracted by their mean.
    pub fn note_servo(&mut self, milliclocks: u32, steps: u32) {
        let in_steps = steps.saturating_mul(self.figures.step.mean_milliclocks);
        let [_, sum] = &mut self.sums_milliclocks;
        if self.figures.step.count > 0 {
            note(
                &mut self.figures.servo,
                sum,
                milliclocks.saturating_sub(in_steps),
            );
        }
    }

    /// What was measured, after its end.
    pub(super) fn figures(&self) -> Option<BoardFigures> {
        (self.phase == Phase::Done).then_some(self.figures)
    }
}

fn note(figures: &mut TickFigures, sum_milliclocks: &mut u64, milliclocks: u32) {
    let clocks = milliclocks.saturating_add(500) / 1000;
    let least = if figures.count == 0 {
        clocks
    } else {
        figures.min_clocks
    };
    figures.min_clocks = least.min(clocks);
    figures.max_clocks = figures.max_clocks.max(clocks);
    figures.count = figures.count.saturating_add(1);
    *sum_milliclocks += u64::from(milliclocks);
    let mean = sum_milliclocks.checked_div(figures.count.into());
    figures.mean_milliclocks = mean.unwrap_or(0) as u32;
}

#[cfg(test)]
mod tests {
    //! Goal: a measurement has a beginning, an end and the figures in between; a board without a clock refuses it. Method:
    //! by hand, and by the line of a machine with a clock and of one without.
    use super::*;
    use crate::board::built_in::built_in_planar;
    use crate::configuration::homing::HomingConfiguration;
    use crate::line::{Conversation, Receiver};
    use crate::motion::Motion;
    use headway_protocol::frame::{FRAME_BYTES_MAX, FrameDecoder, encode_frame};
    use headway_protocol::message::{
        Control, Crash, CrashCause, DeviceMessage, Hello, HostMessage, PROTOCOL_VERSION,
        RefusalReason, SCHEMA_HASH,
    };
    use std::vec::Vec;

    #[test]
    fn durations_are_counted_and_steps_in_a_servo_tick_subtracted() {
        let mut measured = Measurement::default();
        assert!(!measured.order(true), "no clock");
        measured.measure_with(168_000_000, Some(3));
        assert!(measured.order(true) && measured.is_on());
        measured.note_servo(900_000, 2);
        for milliclocks in [100_400, 150_600, 110_000] {
            measured.note_step(milliclocks);
        }
        measured.note_servo(1_000_000, 2);
        assert!(measured.order(false) && measured.is_ending());
        assert_eq!(measured.figures(), None);
        measured.end([5, 6], [7, 8]);
        let figures = measured.figures().expect("it has ended");
        let step = TickFigures {
            count: 3,
            min_clocks: 100,
            mean_milliclocks: 120_333,
            max_clocks: 151,
        };
        // Before a step was measured a servo tick says nothing.
        let servo = TickFigures {
            count: 1,
            min_clocks: 759,
            mean_milliclocks: 759_334,
            max_clocks: 759,
        };
        assert_eq!((figures.step, figures.servo), (step, servo));
        assert_eq!((figures.lock_max_clocks, figures.stack_bytes), (5, 8));
        assert_eq!(figures.brown_out_level, Some(3));
        assert!(!measured.is_on());
    }

    /// What a board answers to a greeting and to both orders.
    fn answers(clock_hz: Option<u32>, crash: Option<Crash>) -> Vec<DeviceMessage> {
        let machine = built_in_planar();
        let mut motion = Motion::new(&machine, &HomingConfiguration::none());
        let mut receiver = Receiver::new(&machine, 1);
        if let Some(clock_hz) = clock_hz {
            receiver.measurement().measure_with(clock_hz, None);
        }
        receiver.has_crashed(crash);
        let mut talk = Conversation::new(&machine, 0);
        let hello = HostMessage::Hello(Hello {
            protocol_version: PROTOCOL_VERSION,
            schema_hash: SCHEMA_HASH,
            host_session: 2,
        });
        let orders = [true, false].map(|on| HostMessage::Control(Control::Measure(on)));
        let (mut said, mut out) = (Vec::new(), [0; FRAME_BYTES_MAX]);
        for (sequence, message) in [hello].iter().chain(&orders).enumerate() {
            let length = encode_frame(sequence as u16 + 1, message, &mut out).expect("a frame");
            for byte in &out[..length] {
                if let Some(request) = receiver.receive(&mut talk, *byte) {
                    receiver.apply(&mut talk, request, &mut motion);
                }
            }
            if receiver.measurement().is_ending() {
                receiver.measurement().end([0; 2], [0; 2]);
            }
            let mut decoder = FrameDecoder::new();
            for _ in 0..8 {
                let length = receiver.poll_report(&mut talk, &motion, &mut out);
                let frames = out[..length].iter().filter_map(|byte| {
                    let frame = decoder.push(*byte)?.expect("whole");
                    Some(DeviceMessage::decode(frame.payload).expect("a message"))
                });
                said.extend(frames);
            }
        }
        said
    }

    #[test]
    fn a_line_gets_the_figures_and_the_crash() {
        let crash = Crash {
            cause: CrashCause::Panic(3),
            pc: 0,
            lr: 0,
            servo_tick: 4,
        };
        let said = answers(Some(168_000_000), Some(crash));
        let place = |wanted: fn(&DeviceMessage) -> bool| said.iter().position(wanted);
        let told = place(|message| matches!(message, DeviceMessage::Crash(_))).expect("the crash");
        let welcome = place(|message| matches!(message, DeviceMessage::Welcome(_)));
        assert!(Some(told) < welcome && said[told] == DeviceMessage::Crash(crash));
        let measured = said
            .iter()
            .filter(|message| matches!(message, DeviceMessage::Measured(_)));
        assert_eq!(measured.count(), 1, "{said:?}");
        // Without a clock both orders are refused, and nothing crashed.
        let said = answers(None, None);
        let refused = said.iter().filter(|message| {
            matches!(message, DeviceMessage::Refused(refusal) if refusal.reason == RefusalReason::Invalid)
        });
        assert_eq!(refused.count(), 2, "{said:?}");
        let more = |message: &DeviceMessage| {
            matches!(
                message,
                DeviceMessage::Measured(_) | DeviceMessage::Crash(_)
            )
        };
        assert!(!said.iter().any(more), "{said:?}");
    }
}
