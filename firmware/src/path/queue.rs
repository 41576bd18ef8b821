//! The queue of knots, with the ceiling of the path rate over them.
//!
//! Each entry has two ceilings of sigma² at its span's start: the largest from which the head can still come to rest
//! on the path by the end of the last buffered span, and the largest (above 1) from which it can slow down in time
//! for a span with less room. One backward scan after each arrival updates them: y_start = (y_end + 2 h w / beta) /
//! (1 + 2 h alpha / beta), the implicit step of d(sigma²)/du = -2 (w - alpha sigma²) / beta (w = 0.985 of the full
//! limit), which never overestimates. The scan stops where nothing changes, at the stopping distance from the end,
//! so it is short on a deep queue.

use crate::design::{CEILING_OPEN, QUEUE_KNOTS, WARP_ROOM};
use crate::numbers::real::smaller;
use crate::path::load::SpanLoad;
use crate::path::spline::SpanWindow;
use headway_protocol::segment::Knot;
use heapless::Deque;

/// A knot with the demands of its span.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct QueuedKnot {
    /// As received.
    pub knot: Knot,
    /// The span's demands on the joints.
    pub load: SpanLoad,
    /// Duration of the knot's own span (the knot carries that of span n + 2).
    pub span_ticks: u16,
    /// The span ends at rest.
    pub ends_at_rest: bool,
    /// Ceilings at the span's start.
    pub ceiling: Ceiling,
}

impl QueuedKnot {
    /// The newest knot of a window, with the demands of its span on the joints; it has no ceiling
    /// yet.
    pub fn new(window: &SpanWindow, knot: &Knot, load: SpanLoad) -> Self {
        Self {
            knot: *knot,
            load,
            span_ticks: window.duration_ticks(),
            ends_at_rest: window.ends_at_rest(),
            ceiling: Ceiling::END,
        }
    }
}

/// Largest sigma² at a place, see the module text.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ceiling {
    /// For coming to rest by the end of the queue.
    pub stop: f32,
    /// For the limits of coming spans; relevant only above 1.
    pub limits: f32,
}

impl Ceiling {
    /// Nothing limits.
    pub const OPEN: Self = Self {
        stop: CEILING_OPEN,
        limits: CEILING_OPEN,
    };
    /// The end of the queue: the next span may have no room above 1.
    pub const END: Self = Self {
        stop: 0.0,
        limits: 1.0,
    };

    /// Ceilings `ticks` before this point, within a span of this load.
    #[inline]
    pub fn before(&self, ticks: f32, load: &SpanLoad) -> Self {
        let reach = 2.0 * ticks / load.beta_ticks;
        let share = 1.0 / (1.0 + reach * load.alpha);
        let gain = reach * WARP_ROOM;
        Self {
            stop: smaller((self.stop + gain) * share, CEILING_OPEN),
            limits: smaller((self.limits + gain) * share, load.rate_squared_max),
        }
    }
}

/// Segment time below which the queue's end matters: 128 ms at 2 kHz, more than the head needs to come
/// to rest from 150 mm/s.
const SHORT_TICKS: u32 = 256;

/// The bounded queue.
#[derive(Clone, Debug, Default)]
// Fields that every tick uses are first.
#[repr(C)]
pub struct KnotQueue {
    queued_ticks: u32,
    /// The last span that was queued ends at rest.
    ends_at_rest: bool,
    /// The current backward scan.
    pass: Option<Pass>,
    knots: Deque<QueuedKnot, QUEUE_KNOTS>,
}

/// A backward pass: until it ends, the ceilings before its place are those of the shorter queue, which are
/// lower.
#[derive(Clone, Copy, Debug)]
struct Pass {
    /// Entries from the end that are done, and that must be.
    done: usize,
    changed: usize,
    /// Ceilings at the end of the next entry's span.
    at_end: Ceiling,
}

impl KnotQueue {
    /// Empty.
    pub const fn new() -> Self {
        Self {
            queued_ticks: 0,
            ends_at_rest: false,
            pass: None,
            knots: Deque::new(),
        }
    }

    /// Knots that wait.
    pub fn len(&self) -> usize {
        self.knots.len()
    }

    /// True if it contains none.
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

    /// True if its end may soon be felt: in the middle of a move.
    pub fn is_short(&self) -> bool {
        self.queued_ticks < SHORT_TICKS && !self.ends_at_rest
    }

    /// The stop ceiling this many ticks after the start of the next knot's span.
    pub fn stop_ahead(&self, mut ticks: f32) -> f32 {
        for (index, entry) in self.knots.iter().enumerate() {
            let span_ticks = f32::from(entry.span_ticks);
            if ticks < span_ticks {
                let at_end = if entry.ends_at_rest {
                    Ceiling::OPEN
                } else {
                    self.get(index + 1)
                        .map_or(Ceiling::END, |next| next.ceiling)
                };
                return at_end.before(span_ticks - ticks, &entry.load).stop;
            }
            if entry.ends_at_rest {
                return CEILING_OPEN;
            }
            ticks -= span_ticks;
        }
        0.0
    }

    /// Adds a knot; false if there is no room. Call [`Self::update_ceilings`] after the last one.
    pub fn push(&mut self, knot: QueuedKnot) -> bool {
        let added = self.knots.push_back(knot).is_ok();
        if added {
            self.ends_at_rest = knot.ends_at_rest;
            self.queued_ticks += u32::from(knot.span_ticks);
        }
        added
    }

    /// Drops the next knot, after [`Self::front`] was read.
    pub fn pop(&mut self) {
        if let Some(knot) = self.knots.pop_front() {
            self.queued_ticks = self.queued_ticks.saturating_sub(u32::from(knot.span_ticks));
        }
    }

    /// The knot after `behind` others.
    pub fn get(&self, behind: usize) -> Option<&QueuedKnot> {
        self.knots.get(behind)
    }

    /// The next knot.
    pub fn front(&self) -> Option<&QueuedKnot> {
        self.knots.front()
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.knots.clear();
        self.queued_ticks = 0;
        self.ends_at_rest = false;
        self.pass = None;
    }

    /// Backward pass over the last `changed` knots and as far before them as anything changes.
    pub fn update_ceilings(&mut self, changed: usize) {
        self.begin_pass(changed);
        self.go_on_with_pass(QUEUE_KNOTS);
    }

    /// Begins a backward scan over the last `changed` knots, which includes an unfinished one.
    pub fn begin_pass(&mut self, changed: usize) {
        let left = self.pass.map_or(0, |pass| pass.changed);
        self.pass = Some(Pass {
            done: 0,
            changed: changed + left,
            at_end: Ceiling::END,
        });
    }

    /// A scan is in progress.
    pub fn has_pass(&self) -> bool {
        self.pass.is_some()
    }

    /// Continues the pass over this many entries; true if there was one. Knots may be dropped at the front
    /// meanwhile.
    pub fn go_on_with_pass(&mut self, entries: usize) -> bool {
        let Some(mut pass) = self.pass.take() else {
            return false;
        };
        for entry in self.knots.iter_mut().rev().skip(pass.done).take(entries) {
            if entry.ends_at_rest {
                pass.at_end = Ceiling::OPEN;
            }
            let ceiling = pass.at_end.before(f32::from(entry.span_ticks), &entry.load);
            if pass.done >= pass.changed && ceiling == entry.ceiling {
                return true;
            }
            entry.ceiling = ceiling;
            pass.at_end = ceiling;
            pass.done += 1;
        }
        if pass.done < self.knots.len() {
            self.pass = Some(pass);
        }
        true
    }
}

#[cfg(test)]
mod tests {
    //! Goal: the ceilings are those of the stopping distance, incremental passes equal whole ones,
    //! and a deep queue does not limit. Method: closed forms and a second queue filled at once.
    use super::*;

    fn knot(span_ticks: u16, alpha: f32, beta_ticks: f32, ends_at_rest: bool) -> QueuedKnot {
        QueuedKnot {
            knot: Knot {
                control: [0; 7],
                duration_ticks: span_ticks,
            },
            load: SpanLoad {
                alpha,
                beta_ticks,
                rate_squared_max: CEILING_OPEN,
            },
            span_ticks,
            ends_at_rest,
            ceiling: Ceiling::END,
        }
    }

    #[test]
    fn without_curvature_the_ceiling_is_that_of_constant_deceleration() {
        let mut queue = KnotQueue::new();
        for _ in 0..5 {
            assert!(queue.push(knot(10, 0.0, 40.0, false)));
        }
        queue.update_ceilings(5);
        // sigma² = 2 k u with k = 0.985 / 40 over 50 ticks.
        let expected = 2.0 * WARP_ROOM / 40.0 * 50.0;
        let first = queue.front().unwrap().ceiling.stop;
        assert!((first - expected).abs() < 1e-4, "{first} {expected}");
        assert_eq!(queue.queued_ticks(), 50);
    }

    #[test]
    fn a_plan_at_its_share_is_not_limited_by_a_deep_queue() {
        let mut queue = KnotQueue::new();
        for _ in 0..QUEUE_KNOTS {
            assert!(queue.push(knot(12, 0.95, 40.0, false)));
        }
        assert!(!queue.push(knot(12, 0.95, 40.0, false)));
        queue.update_ceilings(QUEUE_KNOTS);
        let first = queue.front().unwrap().ceiling;
        assert!(first.stop > 1.0 && first.stop < 1.04, "{first:?}");
    }

    #[test]
    fn the_stop_ceiling_is_known_ahead() {
        let mut queue = KnotQueue::new();
        for (span_ticks, ends_at_rest) in [(10, false), (6, false), (8, false), (5, true)] {
            assert!(queue.push(knot(span_ticks, 0.4, 30.0, ends_at_rest)));
        }
        assert!(!queue.is_short(), "it ends at rest");
        assert!(queue.push(knot(9, 0.4, 30.0, false)));
        assert!(queue.is_short());
        queue.update_ceilings(5);
        let starts: std::vec::Vec<f32> = (0..5)
            .map(|index| queue.get(index).unwrap().ceiling.stop)
            .collect();
        for (ticks, index) in [(0.0, 0), (10.0, 1), (16.0, 2), (24.0, 3)] {
            assert_eq!(queue.stop_ahead(ticks), starts[index], "{ticks}");
        }
        assert!(queue.stop_ahead(3.0) < starts[0].max(starts[1]) + 1e-3);
        // It may stop at the rest; without one the end is the end.
        assert_eq!(queue.stop_ahead(30.0), CEILING_OPEN);
        for _ in 0..4 {
            queue.pop();
        }
        assert!(queue.stop_ahead(8.9) < queue.stop_ahead(8.0));
        assert_eq!(queue.stop_ahead(9.0), 0.0);
    }

    #[test]
    fn incremental_passes_equal_a_whole_one_and_a_rest_opens_the_ceiling() {
        let spans: std::vec::Vec<QueuedKnot> = (0..120)
            .map(|i| {
                let alpha = 0.3 + 0.6 * ((i * 7 % 10) as f32 / 10.0);
                knot(
                    5 + (i % 9) as u16,
                    alpha,
                    5.0 + (i % 13) as f32,
                    i % 50 == 49,
                )
            })
            .collect();
        let (mut whole, mut parts) = (KnotQueue::new(), KnotQueue::new());
        for span in &spans {
            whole.push(*span);
        }
        whole.update_ceilings(spans.len());
        for block in spans.chunks(7) {
            for span in block {
                parts.push(*span);
            }
            parts.update_ceilings(block.len());
        }
        for index in 0..spans.len() {
            let (a, b) = (*whole.front().unwrap(), *parts.front().unwrap());
            whole.pop();
            parts.pop();
            assert_eq!(a, b, "span {index}");
            if index == 49 {
                // It ends at rest: nothing behind it matters.
                assert_eq!(
                    a.ceiling,
                    Ceiling::OPEN.before(f32::from(a.span_ticks), &a.load)
                );
            }
        }
        assert!(whole.is_empty() && parts.queued_ticks() == 0);
    }
}
