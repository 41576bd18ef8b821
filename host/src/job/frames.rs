//! A segment stream as the messages that carry it: knot blocks, flow events, the finish.
//!
//! [`SegmentStream`] -> postcard payloads in sending order, with the totals that credits count; and
//! back, checked. The sender and the job file use the same payloads, so a job is packed once.
//! `headway_protocol::frame` adds sequence numbers and CRCs.

use crate::job::SegmentStream;
use crate::text::refusal::{Refusal, refusal};
use crc::Digest;
use headway_protocol::frame::{CRC, MESSAGE_BYTES_MAX};
use headway_protocol::knot_block::{
    KNOTS_PER_BLOCK_MAX, KnotPredictor, decode_block, encode_block,
};
use headway_protocol::message::{Finish, HostMessage};
use headway_protocol::segment::{FlowEvent, Knot};
use headway_protocol::units::{ChannelPoint, Units};

/// Maximum number of flow events sent ahead of their knots: those of one block. A controller whose
/// event queue has twice that capacity never deadlocks.
pub const EVENTS_AHEAD_MAX: usize = 4;

/// The stream cannot be sent as it is: a fault of the planner.
pub fn event_out_of_order(index: usize, span: u32, knots: usize) -> Refusal {
    refusal!("flow event {index} is in span {span}, but the stream has {knots} knots in order")
}

/// A payload is not a stream message.
pub fn bad_frame(frame: usize, why: &'static str) -> Refusal {
    refusal!("frame {frame} is not a valid stream message ({why}); the data is damaged, plan again")
}

/// One frame's payload end and the totals up to and including it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Entry {
    end: usize,
    knots: u32,
    events: u32,
}

/// Payloads of a complete stream.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WireFrames {
    start: ChannelPoint,
    units: Units,
    bytes: Vec<u8>,
    entries: Vec<Entry>,
}

impl WireFrames {
    /// An empty stream from `start`; frames are added with [`WireFrames::push_payload`].
    pub fn new(start: ChannelPoint, units: Units) -> Self {
        WireFrames {
            start,
            units,
            bytes: Vec::new(),
            entries: Vec::new(),
        }
    }

    /// Packs a stream. Events must be ordered by span and within the stream.
    pub fn encode(stream: &SegmentStream) -> Result<Self, Refusal> {
        let mut frames = WireFrames::new(stream.start, stream.units);
        let mut packer = StreamPacker::new(stream.start);
        let mut push = |payload: &[u8], knots, events| frames.append(payload, knots, events);
        packer.add(stream, &mut push)?;
        packer.finish(&mut push);
        Ok(frames)
    }

    /// Pose at rest before the first span, in the stream's units.
    pub fn start(&self) -> &ChannelPoint {
        &self.start
    }

    /// Units of the stream.
    pub fn units(&self) -> Units {
        self.units
    }

    /// Number of frames.
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// True if there are none.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// Payload of frame `index`, empty past the end.
    pub fn payload(&self, index: usize) -> &[u8] {
        let Some(entry) = self.entries.get(index) else {
            return &[];
        };
        let start = match index.checked_sub(1) {
            Some(before) => self.entries[before].end,
            None => 0,
        };
        &self.bytes[start..entry.end]
    }

    /// Knots and flow events sent when frame `index` has been sent, since the stream's start.
    pub fn totals_after(&self, index: usize) -> (u32, u32) {
        self.entries
            .get(index)
            .or(self.entries.last())
            .map_or((0, 0), |entry| (entry.knots, entry.events))
    }

    /// Bytes on the line for the complete stream, framing included, without resends.
    pub fn line_bytes(&self) -> usize {
        // Frames stay below COBS's 254-byte group: one code byte and the closing zero each.
        let overhead = headway_protocol::frame::FRAME_OVERHEAD_BYTES + 2;
        self.bytes.len() + self.entries.len() * overhead
    }

    /// Identity of the stream: CRC-32 of its start and payloads, and of its units unless they are base units.
    pub fn job(&self) -> u32 {
        let mut digest = digest_from(&self.start, &self.units);
        digest.update(&self.bytes);
        digest.finalize()
    }

    /// Adds a payload as read from a file; totals are counted, contents are checked by
    /// [`WireFrames::decode`].
    pub fn push_payload(&mut self, payload: &[u8]) -> Result<(), Refusal> {
        let frame = self.entries.len();
        let bad = |why| bad_frame(frame, why);
        let message = HostMessage::decode(payload).map_err(|_| bad("unreadable"))?;
        let (knots, events) = match message {
            // The count is in the block's first five bits.
            HostMessage::Knots(block) => (u32::from(block[0] >> 3) + 1, 0),
            HostMessage::Flow(_) => (0, 1),
            HostMessage::Finish(_) => (0, 0),
            _ => return Err(bad("not a stream message")),
        };
        self.append(payload, knots, events);
        Ok(())
    }

    /// Unpacks knots and events and checks order, totals and every field. Marks are not in the
    /// frames.
    pub fn decode(&self) -> Result<(Vec<Knot>, Vec<FlowEvent>), Refusal> {
        let mut predictor = KnotPredictor::new(self.start);
        let mut knots = Vec::new();
        let mut events = Vec::new();
        for frame in 0..self.len() {
            let bad = |why| bad_frame(frame, why);
            let message =
                HostMessage::decode(self.payload(frame)).map_err(|_| bad("unreadable"))?;
            let is_last = frame + 1 == self.len();
            match message {
                HostMessage::Knots(block) if !is_last => {
                    let decoded = decode_block(&mut predictor, block);
                    knots.extend(decoded.map_err(|_| bad("damaged knot block"))?);
                }
                HostMessage::Flow(event) if !is_last => events.push(event),
                HostMessage::Finish(finish) if is_last => check_totals(&finish, &knots, &events)?,
                _ => return Err(bad("out of place")),
            }
        }
        Ok((knots, events))
    }

    fn append(&mut self, payload: &[u8], knots: u32, events: u32) {
        self.bytes.extend_from_slice(payload);
        let (knots_before, events_before) = match self.entries.last() {
            Some(entry) => (entry.knots, entry.events),
            None => (0, 0),
        };
        self.entries.push(Entry {
            end: self.bytes.len(),
            knots: knots_before + knots,
            events: events_before + events,
        });
    }
}

/// The digest that is a stream's identity, before its payloads.
pub(crate) fn digest_from(start: &ChannelPoint, units: &Units) -> Digest<'static, u32> {
    let mut digest = CRC.digest();
    for value in start {
        digest.update(&value.to_le_bytes());
    }
    if *units != Units::BASE {
        let exponents = [
            units.length_exponent,
            units.angle_exponent,
            units.volume_exponent,
        ];
        digest.update(&exponents);
    }
    digest
}

/// Packs a stream that is given in parts, into the same payloads as the complete stream.
pub struct StreamPacker {
    predictor: KnotPredictor,
    /// Knots that may yet share a block with later ones, and the events from them on.
    knots: Vec<Knot>,
    events: Vec<FlowEvent>,
    /// Knots packed, and events in all.
    knots_done: usize,
    event_count: u32,
}

impl StreamPacker {
    /// A stream that begins at rest there.
    pub fn new(start: ChannelPoint) -> StreamPacker {
        StreamPacker {
            predictor: KnotPredictor::new(start),
            knots: Vec::new(),
            events: Vec::new(),
            knots_done: 0,
            event_count: 0,
        }
    }

    /// The next part, which begins at the end of the last one. `emit` gets payloads with the knots
    /// and events in them.
    ///
    /// # Errors
    /// [`Refusal`].
    pub fn add(
        &mut self,
        piece: &SegmentStream,
        emit: &mut impl FnMut(&[u8], u32, u32),
    ) -> Result<(), Refusal> {
        check_events(piece)?;
        let before = (self.knots_done + self.knots.len()) as u32;
        self.knots.extend_from_slice(&piece.knots);
        self.events
            .extend(piece.events.iter().map(|event| FlowEvent {
                span: event.span + before,
                ..*event
            }));
        self.event_count += piece.events.len() as u32;
        self.pack(KNOTS_PER_BLOCK_MAX, emit);
        Ok(())
    }

    /// The rest, and the end of the stream.
    pub fn finish(mut self, emit: &mut impl FnMut(&[u8], u32, u32)) {
        self.pack(1, emit);
        let finish = Finish {
            knots: self.knots_done as u32,
            events: self.event_count,
        };
        push(&HostMessage::Finish(finish), 0, 0, emit);
    }

    /// Packs while at least this many knots wait. Fewer than a block holds might be followed by
    /// knots and events that belong in it.
    fn pack(&mut self, least: usize, emit: &mut impl FnMut(&[u8], u32, u32)) {
        let (mut done, mut due) = (0, 0);
        while self.knots.len() - done >= least {
            let (rest, events) = (&self.knots[done..], &self.events[due..]);
            let wanted = knots_before_event_limit(self.knots_done, rest.len(), events);
            let (block, count) = encode_block(&mut self.predictor, &rest[..wanted]);
            done += count;
            self.knots_done += count;
            let now = events.partition_point(|event| (event.span as usize) < self.knots_done);
            for event in &events[..now] {
                push(&HostMessage::Flow(*event), 0, 1, emit);
            }
            due += now;
            push(&HostMessage::Knots(&block), count as u32, 0, emit);
        }
        self.knots.drain(..done);
        self.events.drain(..due);
    }
}

fn push(
    message: &HostMessage<'_>,
    knots: u32,
    events: u32,
    emit: &mut impl FnMut(&[u8], u32, u32),
) {
    let mut buffer = [0u8; MESSAGE_BYTES_MAX];
    // Every stream message fits: blocks are bounded by the message's size.
    let payload = postcard::to_slice(message, &mut buffer)
        .map(|payload| &*payload)
        .unwrap_or(&[]);
    debug_assert!(!payload.is_empty());
    emit(payload, knots, events);
}

fn check_events(stream: &SegmentStream) -> Result<(), Refusal> {
    let knots = stream.knots.len();
    let mut span_before = 0;
    for (index, event) in stream.events.iter().enumerate() {
        if event.span < span_before || event.span as usize >= knots {
            let span = event.span;
            return Err(event_out_of_order(index, span, knots));
        }
        span_before = event.span;
    }
    Ok(())
}

/// The number of the next knots that a block may contain so that at most [`EVENTS_AHEAD_MAX`]
/// events precede it (or those of one single span, if it has more).
fn knots_before_event_limit(knots_done: usize, left: usize, events: &[FlowEvent]) -> usize {
    let full = left.min(KNOTS_PER_BLOCK_MAX);
    match events.get(EVENTS_AHEAD_MAX) {
        Some(event) => (event.span as usize - knots_done).clamp(1, full),
        None => full,
    }
}

fn check_totals(finish: &Finish, knots: &[Knot], events: &[FlowEvent]) -> Result<(), Refusal> {
    let found = knots.len() as u32;
    if finish.knots == found && finish.events == events.len() as u32 {
        Ok(())
    } else {
        let stated = finish.knots;
        Err(refusal!(
            "the stream ends with {found} knots, {stated} were stated; it is incomplete, plan \
             again"
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use headway_protocol::segment::FlowAction;
    use headway_protocol::units::Ticks;

    fn stream(knots: usize, event_spans: &[u32]) -> SegmentStream {
        let mut stream = SegmentStream::default();
        for i in 0..knots as i32 {
            stream.knots.push(Knot {
                control: [i * 37, i * i, 0, 0, i % 7, -i, i * 3],
                duration_ticks: 10 + (i % 9) as u16,
            });
        }
        for &span in event_spans {
            stream.events.push(FlowEvent {
                span,
                offset_ticks: 3,
                action: FlowAction::Prime,
                volume_units: 1000,
                duration_ticks: Ticks(20),
            });
        }
        stream
    }

    #[test]
    fn a_stream_comes_back_and_events_come_before_their_knots() {
        let original = stream(500, &[0, 0, 31, 32, 33, 33, 33, 33, 33, 33, 499]);
        let frames = WireFrames::encode(&original).unwrap();
        let (knots, events) = frames.decode().unwrap();
        assert_eq!(knots, original.knots);
        assert_eq!(events, original.events);
        let mut knots_sent = 0;
        let mut events_sent = 0;
        let mut frames_of_events = 0;
        for index in 0..frames.len() {
            let (knots_now, events_now) = frames.totals_after(index);
            if events_now > events_sent {
                let span = original.events[events_sent as usize].span;
                assert!(span >= knots_sent, "event of span {span} after its knot");
                frames_of_events += 1;
            }
            (knots_sent, events_sent) = (knots_now, events_now);
        }
        assert_eq!(frames_of_events, original.events.len());
        assert_eq!((knots_sent, events_sent), (500, 11));
    }

    /// Goal: a stream in pieces is packed as the whole of it. Method: cut at every few knots, at an
    /// event and beside it.
    #[test]
    fn pieces_are_packed_as_the_whole() {
        let whole = stream(300, &[0, 0, 31, 32, 33, 33, 33, 33, 33, 33, 64, 299]);
        let frames = WireFrames::encode(&whole).unwrap();
        for length in [1, 5, 31, 32, 33, 64, 170] {
            let mut pieces = WireFrames::new(whole.start, whole.units);
            let mut packer = StreamPacker::new(whole.start);
            let mut add = |payload: &[u8], knots, events| pieces.append(payload, knots, events);
            for (number, knots) in whole.knots.chunks(length).enumerate() {
                let first = (number * length) as u32;
                let own = |event: &&FlowEvent| {
                    event
                        .span
                        .checked_sub(first)
                        .is_some_and(|span| span < knots.len() as u32)
                };
                let events = whole.events.iter().filter(own).map(|event| FlowEvent {
                    span: event.span - first,
                    ..*event
                });
                let piece = SegmentStream {
                    knots: knots.to_vec(),
                    events: events.collect(),
                    ..SegmentStream::default()
                };
                packer.add(&piece, &mut add).unwrap();
            }
            packer.finish(&mut add);
            assert_eq!(pieces, frames, "pieces of {length}");
        }
    }

    #[test]
    fn payloads_read_back_make_the_same_frames() {
        let frames = WireFrames::encode(&stream(100, &[5])).unwrap();
        let mut copy = WireFrames::new(*frames.start(), frames.units());
        for index in 0..frames.len() {
            copy.push_payload(frames.payload(index)).unwrap();
        }
        assert_eq!(copy, frames);
        assert_eq!(copy.job(), frames.job());
    }

    #[test]
    fn a_missing_frame_and_an_event_beyond_the_stream_are_refused() {
        let frames = WireFrames::encode(&stream(100, &[])).unwrap();
        let mut short = WireFrames::new(*frames.start(), frames.units());
        for index in (0..frames.len()).filter(|index| *index != 1) {
            short.push_payload(frames.payload(index)).unwrap();
        }
        assert!(short.decode().is_err());
        assert_eq!(
            WireFrames::encode(&stream(10, &[10])),
            Err(event_out_of_order(0, 10, 10))
        );
    }
}
