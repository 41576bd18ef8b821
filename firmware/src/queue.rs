//! Knots that wait for their turn, with the ceiling of the path rate over them.
//!
//! Each entry knows the largest sigma² at its span's start from which the head can still come to
//! rest on the path by the end of the last span buffered. One backward pass after each arrival
//! keeps that: y_start = (y_end + 2 h / beta) / (1 + 2 h alpha / beta), the implicit step of
//! d(sigma²)/du = -2 (1 - alpha sigma²) / beta, which never overestimates. The pass stops where
//! nothing changes, which is the stopping distance from the end, so it is short on a deep queue.

use crate::design::{PATH_RATE_MAX, QUEUE_KNOTS};
use crate::load::SpanLoad;
use headway_protocol::segment::Knot;
use heapless::Deque;

/// A knot with the demands of its span.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct QueuedKnot {
    /// As received.
    pub knot: Knot,
    /// What the span asks of the joints.
    pub load: SpanLoad,
    /// Duration of the knot's own span (the knot carries that of span n + 2).
    pub span_ticks: u16,
    /// The span ends at rest.
    pub ends_at_rest: bool,
    /// Largest sigma² at the span's start.
    pub ceiling: f32,
}

/// The bounded queue.
#[derive(Clone, Debug, Default)]
pub struct KnotQueue {
    knots: Deque<QueuedKnot, QUEUE_KNOTS>,
    queued_ticks: u32,
}

/// Largest sigma² where nothing limits it.
pub const CEILING_OPEN: f32 = PATH_RATE_MAX * PATH_RATE_MAX;

/// sigma² allowed `ticks` before a place where `y_end` is.
#[inline]
pub fn ceiling_before(y_end: f32, ticks: f32, load: &SpanLoad) -> f32 {
    let reach = 2.0 * ticks / load.beta_ticks;
    let y = (y_end + reach) / (1.0 + reach * load.alpha);
    if y < load.rate_squared_max {
        y
    } else {
        load.rate_squared_max
    }
}

impl KnotQueue {
    /// Empty.
    pub const fn new() -> Self {
        Self {
            knots: Deque::new(),
            queued_ticks: 0,
        }
    }

    /// Knots that wait.
    pub fn len(&self) -> usize {
        self.knots.len()
    }

    /// True if none waits.
    pub fn is_empty(&self) -> bool {
        self.knots.is_empty()
    }

    /// Knots that still fit.
    pub fn room(&self) -> usize {
        QUEUE_KNOTS - self.knots.len()
    }

    /// Segment time that waits, servo ticks.
    pub fn queued_ticks(&self) -> u32 {
        self.queued_ticks
    }

    /// True if the last span that waits ends at rest.
    pub fn ends_at_rest(&self) -> bool {
        self.knots.back().is_some_and(|last| last.ends_at_rest)
    }

    /// Adds a knot; false if there is no room. Call [`Self::update_ceilings`] after the last one.
    pub fn push(&mut self, knot: QueuedKnot) -> bool {
        let added = self.knots.push_back(knot).is_ok();
        if added {
            self.queued_ticks += u32::from(knot.span_ticks);
        }
        added
    }

    /// Takes the next knot.
    pub fn pop(&mut self) -> Option<QueuedKnot> {
        let knot = self.knots.pop_front()?;
        self.queued_ticks = self.queued_ticks.saturating_sub(u32::from(knot.span_ticks));
        Some(knot)
    }

    /// The next knot.
    pub fn front(&self) -> Option<&QueuedKnot> {
        self.knots.front()
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.knots.clear();
        self.queued_ticks = 0;
    }

    /// Backward pass over the last `changed` knots and as far before them as anything changes.
    pub fn update_ceilings(&mut self, changed: usize) {
        let mut y_end = 0.0;
        for (back, entry) in self.knots.iter_mut().rev().enumerate() {
            if entry.ends_at_rest {
                y_end = CEILING_OPEN;
            }
            let y = ceiling_before(y_end, f32::from(entry.span_ticks), &entry.load);
            if back >= changed && y == entry.ceiling {
                break;
            }
            entry.ceiling = y;
            y_end = y;
        }
    }
}
