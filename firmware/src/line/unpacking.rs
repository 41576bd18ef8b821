//! Unpacks a block of knots into the queue, some knots at a time.
//!
//! In: the bytes of a block, the current state of the stream. Out: knots with the demands of their spans on the
//! joints, handed over as they are computed, and the state of the stream after the block. Not covered: whether the
//! frame was in order.

use crate::kinematics::winding::Winding;
use crate::line::{Conversation, Receiver, Stream};
use crate::motion::Motion;
use crate::path::load::{LoadModel, SpanFault};
use crate::path::queue::QueuedKnot;
use crate::path::spline::SpanWindow;
use headway_protocol::knot_block::{KNOTS_PER_BLOCK_MAX, KnotPredictor, decode_block};
use headway_protocol::message::RefusalReason;
use headway_protocol::segment::Knot;
use headway_protocol::units::CHANNEL_VOLUME;
use heapless::Vec;

/// Knot n acts on spans n to n + 3.
const SPANS_OF_KNOT: u32 = 4;

/// A block being unpacked: knots as decoded, of which some have been weighed.
#[derive(Clone, Debug)]
pub(super) struct Unpacking {
    line: u8,
    sequence: u16,
    decoded: Vec<Knot, KNOTS_PER_BLOCK_MAX>,
    weighed: usize,
    /// Knots with their loads that have not been handed over.
    knots: Vec<QueuedKnot, KNOTS_PER_BLOCK_MAX>,
    /// Knots that have been.
    delivered: u32,
    /// Why the block ends early.
    refused: Option<SpanFault>,
    predictor: KnotPredictor,
    window: SpanWindow,
    winding: Winding<f32>,
    count: u32,
    /// Knots up to the last one whose volume differs from that of its predecessor.
    melt_knots: u32,
    /// Volume of the last knot.
    volume_units: i32,
}

impl Receiver {
    /// True while [`Self::work`] and [`Self::deliver`] have to be called, and no more bytes may be
    /// received.
    pub fn is_busy(&self) -> bool {
        self.unpacking.is_some()
    }

    /// True if that is due to a block of this line.
    pub fn is_busy_with(&self, talk: &Conversation) -> bool {
        let unpacking = self.unpacking.as_ref();
        unpacking.is_some_and(|unpacking| unpacking.line == talk.line)
    }

    /// Weighs at most this many knots of the last frame's block.
    #[inline(never)]
    pub fn work(&mut self, knots: usize) {
        if let Some(unpacking) = &mut self.unpacking {
            unpacking.weigh(&self.loads, knots);
        }
    }

    /// Hands over the knots that were weighed, of a block of this line.
    #[inline(never)]
    pub fn deliver(&mut self, talk: &mut Conversation, motion: &mut Motion) {
        let is_begun = self.unpacking.as_ref().is_some_and(|u| u.delivered > 0);
        if !is_begun && !self.accepts_block(talk, motion) {
            self.unpacking = None;
            return;
        }
        let (Some(unpacking), Some(stream)) = (&mut self.unpacking, &mut self.stream) else {
            self.unpacking = None;
            return;
        };
        motion.push_knots(&unpacking.knots);
        unpacking.delivered += unpacking.knots.len() as u32;
        unpacking.knots.clear();
        if unpacking.is_done() {
            unpacking.end(stream, motion);
            talk.due.ack = true;
            self.unpacking = None;
        }
    }

    /// Whether the block that has arrived is to be queued; answers its host where it is not.
    fn accepts_block(&mut self, talk: &mut Conversation, motion: &mut Motion) -> bool {
        let Some(unpacking) = &self.unpacking else {
            return false;
        };
        let (sequence, knots) = (unpacking.sequence, unpacking.decoded.len());
        if !self.claim(talk, motion) {
            talk.refuse(sequence, RefusalReason::Busy);
            return false;
        }
        let accepts = motion.takes_stream() && knots <= motion.knot_room();
        if !motion.takes_stream() {
            self.misplaced(talk, sequence, motion);
        } else if accepts {
            self.owner.take_heat(talk);
        } else {
            // More than the credit: as if it had been lost, until there is room.
            talk.due.ack = true;
        }
        self.hear(talk, motion);
        accepts
    }
}

impl Unpacking {
    /// A block as received; `None` if it is damaged.
    // Its parts are large: they should not be on the caller's stack.
    #[inline(never)]
    pub(super) fn new(line: u8, sequence: u16, bytes: &[u8], stream: &Stream) -> Option<Self> {
        let mut predictor = stream.predictor;
        let decoded = decode_block(&mut predictor, bytes).ok()?;
        let (mut volume_units, mut melt_knots) = (stream.volume_units, 0);
        for (knot, count) in decoded.iter().zip(1u32..) {
            if knot.control[CHANNEL_VOLUME] != volume_units {
                volume_units = knot.control[CHANNEL_VOLUME];
                melt_knots = count;
            }
        }
        Some(Self {
            line,
            sequence,
            weighed: 0,
            knots: Vec::new(),
            delivered: 0,
            refused: None,
            predictor,
            window: stream.window.clone(),
            winding: stream.winding,
            count: decoded.len() as u32,
            melt_knots,
            volume_units,
            decoded,
        })
    }

    /// Nothing is left to weigh.
    fn is_done(&self) -> bool {
        self.refused.is_some() || self.weighed >= self.decoded.len()
    }

    /// Computes the demands of the next spans on the joints, up to an invalid one.
    fn weigh(&mut self, loads: &LoadModel, most: usize) {
        for _ in 0..most.min(KNOTS_PER_BLOCK_MAX) {
            let (None, Some(knot)) = (self.refused, self.decoded.get(self.weighed)) else {
                return;
            };
            self.weighed += 1;
            self.window.push(knot);
            match loads.of_span(&self.window, &mut self.winding) {
                Ok(load) => {
                    let queued = QueuedKnot::new(&self.window, knot, load);
                    // Room for all by the type's bound.
                    let _ = self.knots.push(queued);
                }
                Err(fault) => self.refused = Some(fault),
            }
        }
    }

    /// All knots are handed over: the stream is where the block ends.
    fn end(&self, stream: &mut Stream, motion: &mut Motion) {
        if let Some(fault) = self.refused {
            motion.refuse_span(fault, stream.knots + self.delivered);
        }
        if self.melt_knots > 0 {
            let last = stream.knots.wrapping_add(self.melt_knots);
            motion.note_melt(last.wrapping_add(SPANS_OF_KNOT - 2));
        }
        stream.volume_units = self.volume_units;
        stream.knots = stream.knots.wrapping_add(self.count);
        stream.predictor = self.predictor;
        stream.window = self.window.clone();
        stream.winding = self.winding;
        stream.next_sequence = stream.next_sequence.wrapping_add(1);
    }
}
