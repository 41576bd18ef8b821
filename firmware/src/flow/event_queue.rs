//! Flow events that wait for their position in the stream, in order.

use crate::design::QUEUE_EVENTS;
use headway_protocol::segment::FlowEvent;
use heapless::Deque;

/// No event waits: a span that is never reached.
const NEVER: u32 = u32::MAX;

/// The bounded queue.
#[derive(Clone, Debug)]
// Fields that every tick uses are first.
#[repr(C)]
pub struct EventQueue {
    /// Span of the next event, so that a servo tick need not check it before.
    next_span: u32,
    events: Deque<FlowEvent, QUEUE_EVENTS>,
}

impl Default for EventQueue {
    fn default() -> Self {
        Self {
            next_span: NEVER,
            events: Deque::new(),
        }
    }
}

impl EventQueue {
    /// Events that wait.
    pub fn waiting(&self) -> usize {
        self.events.len()
    }

    /// Events that still fit.
    pub fn room(&self) -> usize {
        QUEUE_EVENTS - self.events.len()
    }

    /// Adds an event; false if there is no room.
    pub fn push(&mut self, event: &FlowEvent) -> bool {
        let added = self.events.push_back(*event).is_ok();
        self.note_next();
        added
    }

    /// The next event, if its place is reached `local_ticks` into the last of this many spans
    /// begun.
    #[inline(always)]
    pub fn due(&self, spans_begun: u32, local_ticks: u16) -> Option<&FlowEvent> {
        if spans_begun <= self.next_span {
            return None;
        }
        let event = self.events.front()?;
        let present = spans_begun - 1;
        let reached = present > event.span || local_ticks >= event.offset_ticks;
        reached.then_some(event)
    }

    /// Drops the next event.
    pub fn pop(&mut self) {
        self.events.pop_front();
        self.note_next();
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.events.clear();
        self.note_next();
    }

    fn note_next(&mut self) {
        self.next_span = self.events.front().map_or(NEVER, |event| event.span);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use headway_protocol::segment::FlowAction;
    use headway_protocol::units::Ticks;

    fn event(span: u32, offset_ticks: u16) -> FlowEvent {
        FlowEvent {
            span,
            offset_ticks,
            action: FlowAction::Prime,
            volume_units: 1,
            duration_ticks: Ticks(1),
        }
    }

    #[test]
    fn events_are_due_from_their_place_on_one_after_the_other() {
        let mut queue = EventQueue::default();
        assert_eq!(queue.due(7, 0), None);
        assert!(queue.push(&event(3, 5)) && queue.push(&event(4, 0)));
        // Before the first span, in span 2, in span 3 before and at its place, long after it.
        for (spans_begun, local_ticks, is_due) in [
            (0, 0, false),
            (3, 9, false),
            (4, 4, false),
            (4, 5, true),
            (9, 0, true),
        ] {
            let due = queue.due(spans_begun, local_ticks);
            assert_eq!(due.is_some(), is_due, "{spans_begun} {local_ticks}");
        }
        queue.pop();
        assert_eq!(queue.due(4, 9), None);
        assert_eq!(queue.due(5, 0), Some(&event(4, 0)));
        queue.clear();
        assert_eq!((queue.due(u32::MAX, 0), queue.waiting()), (None, 0));
        assert!((0..QUEUE_EVENTS).all(|_| queue.push(&event(0, 0))));
        assert!(queue.room() == 0 && !queue.push(&event(0, 0)));
    }
}
