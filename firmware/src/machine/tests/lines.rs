//! Goal: on a board with several lines no host takes another one's numbers, heat or machine, and everybody's stop
//! counts. Method: the heat loop with a hot end that follows at once, a host on the first line, one on a second, and
//! later ones in their places; what each is told.
use super::heat::Hot;
use super::*;
use crate::line::Conversation;

/// A host at a second line.
struct Other {
    talk: Conversation,
    sequence: u16,
}

impl Other {
    fn new() -> Self {
        Self {
            talk: Conversation::new(&planar(), 1),
            sequence: 4000,
        }
    }

    /// Says it, and hears what the board answers.
    fn say(&mut self, hot: &mut Hot, message: HostMessage<'_>) -> Vec<DeviceMessage> {
        self.sequence += 1;
        let mut frame = [0; FRAME_BYTES_MAX];
        let length = encode_frame(self.sequence, &message, &mut frame).unwrap();
        let machine = &mut hot.host.machine;
        machine.handle_line(&mut self.talk, &frame[..length]);
        let (mut said, mut decoder) = (Vec::new(), FrameDecoder::new());
        loop {
            let length = machine.poll_line(&mut self.talk, &mut frame);
            if length == 0 {
                return said;
            }
            for &byte in &frame[..length] {
                if let Some(frame) = decoder.push(byte) {
                    said.push(DeviceMessage::decode(frame.unwrap().payload).unwrap());
                }
            }
        }
    }

    fn order(&mut self, hot: &mut Hot, control: Control) -> Option<RefusalReason> {
        let said = self.say(hot, HostMessage::Control(control));
        said.iter().find_map(|message| match message {
            DeviceMessage::Refused(refusal) => Some(refusal.reason),
            _ => None,
        })
    }
}

fn hello(host_session: u32) -> HostMessage<'static> {
    HostMessage::Hello(Hello {
        protocol_version: PROTOCOL_VERSION,
        schema_hash: SCHEMA_HASH,
        host_session,
    })
}

fn heat(decidegrees: u16) -> Control {
    Control::Heat {
        heater: 0,
        decidegrees,
        wait: false,
    }
}

const JOG: Control = Control::Jog {
    joint: 0,
    distance_units: 10_000,
    speed_units_s: 100_000,
};

#[test]
fn a_greeting_on_another_line_takes_no_numbers_and_a_stop_counts_whatever_its_number() {
    // The first host's stop, after a greeting far ahead of its numbers.
    let mut hot = Hot::printing();
    let mut other = Other::new();
    other.say(&mut hot, hello(99));
    assert_eq!(other.order(&mut hot, heat(2400)), Some(RefusalReason::Busy));
    assert_eq!(other.order(&mut hot, JOG), Some(RefusalReason::Busy));
    assert_eq!(
        other.order(&mut hot, Control::Fan(500)),
        Some(RefusalReason::Busy)
    );
    assert_eq!(hot.host.machine.motion().heat().target_decidegrees(0), 2000);
    hot.host
        .control(HostMessage::Control(Control::EmergencyStop));
    let steps = hot.host.counter.steps;
    hot.run(50);
    assert_eq!(hot.host.faults[0].cause, FaultCause::Emergency);
    assert_eq!(hot.host.counter.steps, steps);
    // A stop from a line that never greeted, and one with a number that is long past.
    for greeted in [false, true] {
        let mut hot = Hot::printing();
        let mut other = Other::new();
        if greeted {
            other.say(&mut hot, hello(99));
            other.sequence = 100;
        }
        other.order(&mut hot, Control::EmergencyStop);
        hot.run(50);
        assert_eq!(hot.host.faults[0].cause, FaultCause::Emergency);
    }
}

#[test]
fn only_frames_of_the_host_that_heats_keep_its_heater_on() {
    // Queries on another line, of a new host on the same line, and of nobody; then those of the host itself.
    for (on_other, greets, lives) in [
        (true, false, false),
        (false, true, false),
        (false, false, true),
    ] {
        let mut hot = Hot::new(200.0);
        hot.host.control(HostMessage::Control(Control::Abort));
        hot.run(1000);
        hot.heat(0, 2000, false);
        let mut other = Other::new();
        other.say(&mut hot, hello(99));
        if greets {
            hot.host.control(hello(6));
        }
        for _ in 0..40 {
            if on_other {
                assert_eq!(other.order(&mut hot, Control::StatusRequest), None);
            } else {
                hot.host
                    .control(HostMessage::Control(Control::StatusRequest));
            }
            hot.run(2000);
        }
        let fault = hot.host.machine.motion().fault().map(|fault| fault.cause);
        let silent = (!lives).then_some(FaultCause::HostSilent);
        assert_eq!(fault, silent, "{on_other} {greets}");
        assert_eq!(hot.host.machine.motion().heat().is_on(), lives);
    }
}

#[test]
fn any_line_may_lower_heat_and_owns_nothing_by_that() {
    let mut hot = Hot::printing();
    let mut other = Other::new();
    other.say(&mut hot, hello(99));
    assert_eq!(other.order(&mut hot, heat(2001)), Some(RefusalReason::Busy));
    assert_eq!(other.order(&mut hot, heat(1900)), None);
    let motion = hot.host.machine.motion();
    assert_eq!(motion.heat().target_decidegrees(0), 1900);
    // Its queries keep nothing on, and the first host's do.
    for second in 0..80 {
        other.order(&mut hot, Control::StatusRequest);
        if second < 40 {
            hot.host
                .control(HostMessage::Control(Control::StatusRequest));
        }
        hot.run(2000);
        let is_on = hot.host.machine.motion().heat().is_on();
        assert_eq!(is_on, second < 69, "after {second} s");
    }
    assert_eq!(hot.host.machine.motion().fault(), None);
    assert_eq!(other.order(&mut hot, heat(0)), None);
}

#[test]
fn another_host_gets_the_machine_from_one_that_is_done_silent_or_replaced() {
    // A machine at rest and cold is anybody's.
    let mut hot = Hot::new(25.0);
    hot.host.control(HostMessage::Control(Control::Abort));
    hot.run(1000);
    let mut other = Other::new();
    other.say(&mut hot, hello(99));
    assert_eq!(other.order(&mut hot, JOG), None);
    hot.host.control(HostMessage::Control(JOG));
    hot.host.poll();
    assert_eq!(hot.host.refusals, [RefusalReason::Busy]);
    hot.run(4000);
    // What it heats is its own, and goes to nobody else.
    assert_eq!(other.order(&mut hot, heat(500)), None);
    hot.heat(0, 600, false);
    assert_eq!(hot.host.refusals, [RefusalReason::Busy; 2]);
    // Until it is silent: by then its heat has ended, with a fault that says so.
    hot.run(62_000);
    assert_eq!(hot.host.faults[0].cause, FaultCause::HostSilent);
    hot.host.control(HostMessage::Control(Control::ClearFault));
    hot.run(10);
    hot.heat(0, 600, false);
    assert_eq!(hot.host.refusals.len(), 2);
    // A new host in its place has the machine at once.
    hot.host.control(hello(6));
    assert_eq!(other.order(&mut hot, heat(650)), None);
    assert_eq!(hot.host.machine.motion().heat().target_decidegrees(0), 650);
}

#[test]
fn what_is_refused_takes_the_machine_from_nobody() {
    // The host of an open stream sleeps: another one asks for what cannot be done then.
    let mut hot = Hot::printing();
    hot.run(31 * 2000);
    let mut other = Other::new();
    other.say(&mut hot, hello(99));
    assert_eq!(other.order(&mut hot, JOG), Some(RefusalReason::Busy));
    assert_eq!(
        other.order(&mut hot, heat(3000)),
        Some(RefusalReason::Invalid)
    );
    // It comes back, and goes on.
    hot.heat(0, 2000, false);
    assert_eq!(hot.host.refusals, []);
    assert_eq!(hot.host.machine.motion().heat().target_decidegrees(0), 2000);
}
