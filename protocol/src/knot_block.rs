//! Knot blocks: up to 32 knots, predicted and bit-packed, as sent in `HostMessage::Knots`.
//!
//! Each control point is predicted from the three before it by polynomial extrapolation over the
//! Greville abscissae (t_{n+1} + t_{n+2} + t_{n+3}) / 3, where a smooth curve's control points are
//! nearly on the curve; the residual is Rice coded. The extrapolation is integer arithmetic in
//! 20-bit fixed point, the same on every machine: both sides keep a [`KnotPredictor`], reset by
//! `Start`. Arithmetic on control points wraps at 32 bits, so any points can be sent. The layout is
//! in `WIRE.md`. Residuals depend on the curve, the tolerance and the knots, never on microsteps.

use crate::segment::{Knot, REST_TICKS, SPAN_TICKS_MAX};
use crate::units::{CHANNELS, ChannelPoint};
use heapless::Vec;

/// Most knots of one block.
pub const KNOTS_PER_BLOCK_MAX: usize = 32;
/// Most bytes of one block, so that the frame fits [`crate::frame::MESSAGE_BYTES_MAX`] with the
/// tag and two length bytes.
pub const BLOCK_BYTES_MAX: usize = crate::frame::MESSAGE_BYTES_MAX - 3;

/// Fraction bits of the extrapolation weights: the rounding of a 6 mm step stays below 0.1 unit.
const WEIGHT_BITS: u32 = 20;
/// Largest weight: a span 16 times as long as the previous one does not predict the next.
const WEIGHT_MAX: u64 = 16 << WEIGHT_BITS;
/// Extrapolation orders: 0 = last point, 1 = line, 2 = parabola.
const ORDERS: usize = 3;
/// Order code of a channel that does not move within the block.
const ORDER_REST: u32 = 3;
/// Quotients from here on are escaped: 32 raw bits follow.
const QUOTIENT_ESCAPE: u32 = 20;
const COUNT_BITS: u32 = 5;
const ORDER_BITS: u32 = 2;
const RICE_BITS: u32 = 5;
/// Largest Rice parameter: residuals are 32 bits wide.
const RICE_MAX: u32 = 31;
const DURATION_BITS: u32 = 12;
const DURATION_WIDTH_BITS: u32 = 4;

const _: () = assert!(SPAN_TICKS_MAX as u32 == 1 << DURATION_BITS);
const _: () = assert!(KNOTS_PER_BLOCK_MAX == 1 << COUNT_BITS);

/// Why bytes are not a knot block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum BlockError {
    /// It ends before its last knot.
    Truncated,
    /// Bytes or set bits are left over.
    TrailingBits,
    /// A width or duration is out of its range.
    FieldRange,
}

/// What both sides know of the knots sent so far.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct KnotPredictor {
    /// P_{n-1}, P_{n-2}, P_{n-3}.
    history: [ChannelPoint; 3],
    /// Durations of spans n-2, n-1, n, n+1.
    durations_ticks: [u16; 4],
}

/// Fixed-point weights of one knot's extrapolation.
#[derive(Clone, Copy)]
struct Weights {
    /// Line: of P_{n-1} - P_{n-2}.
    line: i64,
    /// Parabola: of P_{n-1} - P_{n-2}.
    near: i64,
    /// Parabola: of P_{n-2} - P_{n-3}, subtracted.
    far: i64,
}

impl KnotPredictor {
    /// At rest at `start`, before knot 0.
    pub const fn new(start: ChannelPoint) -> Self {
        KnotPredictor {
            history: [start; 3],
            durations_ticks: [REST_TICKS; 4],
        }
    }

    /// Extrapolation weights for knot n, whose span n + 2 lasts `duration_ticks`.
    /// With d1, d2, d3 the last distances of Greville abscissae (times 3), Newton's form is
    /// P = P1 + (P1 - P2) d1/d2 + ((P1 - P2)/d2 - (P2 - P3)/d3) d1 (d1 + d2)/(d2 + d3).
    fn weights(&self, duration_ticks: u16) -> Weights {
        let [h0, h1, h2, h3] = self.durations_ticks.map(u64::from);
        let d1 = h2 + h3 + u64::from(duration_ticks);
        let d2 = (h1 + h2 + h3).max(1);
        let d3 = (h0 + h1 + h2).max(1);
        let ratio = |numerator: u64, denominator: u64| {
            ((numerator << WEIGHT_BITS) / denominator).min(WEIGHT_MAX)
        };
        let line = ratio(d1, d2);
        let bend = ratio(d1 * (d1 + d2), d2 * (d2 + d3));
        Weights {
            line: line as i64,
            near: (line + bend) as i64,
            far: ratio(d1 * (d1 + d2), d3 * (d2 + d3)) as i64,
        }
    }

    /// Predicted coordinate of one channel.
    fn predict(&self, channel: usize, order: u32, weights: &Weights) -> i32 {
        let [p1, p2, p3] = [0, 1, 2].map(|back: usize| self.history[back][channel]);
        let step = i64::from(p1.wrapping_sub(p2));
        let step_before = i64::from(p2.wrapping_sub(p3));
        let scaled = match order {
            1 => step * weights.line,
            2 => step * weights.near - step_before * weights.far,
            _ => 0,
        };
        let half = 1i64 << (WEIGHT_BITS - 1);
        p1.wrapping_add(((scaled + half) >> WEIGHT_BITS) as i32)
    }

    /// Takes knot n as sent.
    pub fn push(&mut self, knot: &Knot) {
        self.history = [knot.control, self.history[0], self.history[1]];
        let [_, h1, h2, h3] = self.durations_ticks;
        self.durations_ticks = [h1, h2, h3, knot.duration_ticks];
    }
}

/// How one channel is coded in a block.
#[derive(Clone, Copy, Debug)]
struct ChannelCode {
    order: u32,
    rice: u32,
}

/// Decodes a complete block; after an error the predictor is unchanged and no knot is returned.
pub fn decode_block(
    predictor: &mut KnotPredictor,
    bytes: &[u8],
) -> Result<Vec<Knot, KNOTS_PER_BLOCK_MAX>, BlockError> {
    let mut reader = BitReader::new(bytes);
    let count = reader.take(COUNT_BITS)? + 1;
    let duration_base = reader.take(DURATION_BITS)? + 1;
    let duration_width = reader.take(DURATION_WIDTH_BITS)?;
    if duration_width > DURATION_BITS {
        return Err(BlockError::FieldRange);
    }
    let mut codes = [ChannelCode { order: 0, rice: 0 }; CHANNELS];
    for code in &mut codes {
        code.order = reader.take(ORDER_BITS)?;
        if code.order != ORDER_REST {
            code.rice = reader.take(RICE_BITS)?;
        }
    }
    let mut state = *predictor;
    let mut knots = Vec::new();
    for _ in 0..count {
        let duration = duration_base + reader.take(duration_width)?;
        if duration > u32::from(SPAN_TICKS_MAX) {
            return Err(BlockError::FieldRange);
        }
        let duration_ticks = duration as u16;
        let weights = state.weights(duration_ticks);
        let mut control = [0; CHANNELS];
        for (channel, code) in codes.iter().enumerate() {
            let predicted = state.predict(channel, code.order, &weights);
            let residual = if code.order == ORDER_REST {
                0
            } else {
                reader.take_rice(code.rice)?
            };
            control[channel] = predicted.wrapping_add(residual);
        }
        let knot = Knot {
            control,
            duration_ticks,
        };
        state.push(&knot);
        knots.push(knot).map_err(|_| BlockError::FieldRange)?;
    }
    reader.finish()?;
    *predictor = state;
    Ok(knots)
}

/// Encodes as many of `knots` as fit into one block (at most [`KNOTS_PER_BLOCK_MAX`]), advances the
/// predictor past them and returns the block and how many there are: at least one, unless `knots`
/// is empty. Durations must be in 1..=[`SPAN_TICKS_MAX`]; they are clamped to it.
pub fn encode_block(
    predictor: &mut KnotPredictor,
    knots: &[Knot],
) -> (Vec<u8, BLOCK_BYTES_MAX>, usize) {
    let knots = &knots[..knots.len().min(KNOTS_PER_BLOCK_MAX)];
    let residuals = Residuals::new(predictor, knots);
    let mut count = knots.len();
    let mut plan = BlockPlan::new(&residuals, knots, count);
    while count > 1 && plan.bits > BLOCK_BYTES_MAX * 8 {
        count -= 1;
        plan = BlockPlan::new(&residuals, knots, count);
    }
    let mut writer = BitWriter::default();
    if count > 0 {
        plan.write(&residuals, knots, count, &mut writer);
    }
    for knot in &knots[..count] {
        predictor.push(knot);
    }
    (writer.finish(), count)
}

fn duration_of(knot: &Knot) -> u16 {
    knot.duration_ticks.clamp(1, SPAN_TICKS_MAX)
}

/// Zigzag residuals of each knot, order and channel.
struct Residuals([[[u32; CHANNELS]; ORDERS]; KNOTS_PER_BLOCK_MAX]);

impl Residuals {
    fn new(predictor: &KnotPredictor, knots: &[Knot]) -> Self {
        let mut all = [[[0; CHANNELS]; ORDERS]; KNOTS_PER_BLOCK_MAX];
        let mut state = *predictor;
        for (knot, of_knot) in knots.iter().zip(&mut all) {
            let weights = state.weights(duration_of(knot));
            for (order, of_order) in of_knot.iter_mut().enumerate() {
                for (channel, zigzag) in of_order.iter_mut().enumerate() {
                    let predicted = state.predict(channel, order as u32, &weights);
                    let residual = knot.control[channel].wrapping_sub(predicted);
                    *zigzag = ((residual << 1) ^ (residual >> 31)) as u32;
                }
            }
            state.push(knot);
        }
        Residuals(all)
    }

    fn of(&self, count: usize, order: usize, channel: usize) -> impl Iterator<Item = u32> + '_ {
        self.0[..count].iter().map(move |of| of[order][channel])
    }
}

/// The chosen code of a block and its length.
struct BlockPlan {
    duration_base: u16,
    duration_width: u32,
    codes: [ChannelCode; CHANNELS],
    bits: usize,
}

impl BlockPlan {
    /// The shortest code of the first `count` knots.
    fn new(residuals: &Residuals, knots: &[Knot], count: usize) -> Self {
        let durations = || knots[..count].iter().map(duration_of);
        let duration_base = durations().min().unwrap_or(1);
        let spread = durations().max().unwrap_or(1) - duration_base;
        let duration_width = u16::BITS - spread.leading_zeros();
        let mut bits = (COUNT_BITS + DURATION_BITS + DURATION_WIDTH_BITS) as usize
            + count * duration_width as usize;
        let codes = core::array::from_fn(|channel| {
            let (code, channel_bits) = choose_code(residuals, count, channel);
            bits += channel_bits;
            code
        });
        BlockPlan {
            duration_base,
            duration_width,
            codes,
            bits,
        }
    }

    fn write(&self, residuals: &Residuals, knots: &[Knot], count: usize, writer: &mut BitWriter) {
        writer.put(count as u32 - 1, COUNT_BITS);
        writer.put(u32::from(self.duration_base) - 1, DURATION_BITS);
        writer.put(self.duration_width, DURATION_WIDTH_BITS);
        for code in &self.codes {
            writer.put(code.order, ORDER_BITS);
            if code.order != ORDER_REST {
                writer.put(code.rice, RICE_BITS);
            }
        }
        for (knot, of_knot) in knots[..count].iter().zip(&residuals.0) {
            let above_base = duration_of(knot) - self.duration_base;
            writer.put(u32::from(above_base), self.duration_width);
            for (channel, code) in self.codes.iter().enumerate() {
                if code.order != ORDER_REST {
                    writer.put_rice(of_knot[code.order as usize][channel], code.rice);
                }
            }
        }
    }
}

/// The shortest code of one channel and its bits, header included.
fn choose_code(residuals: &Residuals, count: usize, channel: usize) -> (ChannelCode, usize) {
    if residuals.of(count, 0, channel).all(|zigzag| zigzag == 0) {
        let rest = ChannelCode {
            order: ORDER_REST,
            rice: 0,
        };
        return (rest, ORDER_BITS as usize);
    }
    let mut best = (ChannelCode { order: 0, rice: 0 }, usize::MAX);
    for order in 0..ORDERS {
        let sum: u64 = residuals.of(count, order, channel).map(u64::from).sum();
        let mean = sum / count.max(1) as u64;
        // The best parameter is near log2 of the mean; its neighbours are tried as well.
        let middle = mean.checked_ilog2().unwrap_or(0);
        for rice in middle.saturating_sub(1)..=(middle + 1).min(RICE_MAX) {
            let body: usize = residuals
                .of(count, order, channel)
                .map(|zigzag| rice_bits(zigzag, rice))
                .sum();
            if body < best.1 {
                let order = order as u32;
                best = (ChannelCode { order, rice }, body);
            }
        }
    }
    (best.0, best.1 + (ORDER_BITS + RICE_BITS) as usize)
}

fn rice_bits(zigzag: u32, rice: u32) -> usize {
    let quotient = zigzag >> rice;
    let bits = if quotient < QUOTIENT_ESCAPE {
        quotient + 1 + rice
    } else {
        QUOTIENT_ESCAPE + 32
    };
    bits as usize
}

/// Reads bits, most significant first.
struct BitReader<'a> {
    bytes: &'a [u8],
    /// Bits not yet read, right-aligned.
    pending: u64,
    pending_bits: u32,
}

impl<'a> BitReader<'a> {
    fn new(bytes: &'a [u8]) -> Self {
        BitReader {
            bytes,
            pending: 0,
            pending_bits: 0,
        }
    }

    /// Takes up to 32 bits.
    fn take(&mut self, bits: u32) -> Result<u32, BlockError> {
        while self.pending_bits < bits {
            let (&byte, rest) = self.bytes.split_first().ok_or(BlockError::Truncated)?;
            self.bytes = rest;
            self.pending = self.pending << 8 | u64::from(byte);
            self.pending_bits += 8;
        }
        self.pending_bits -= bits;
        let mask = (1u64 << bits) - 1;
        Ok((self.pending >> self.pending_bits & mask) as u32)
    }

    fn take_rice(&mut self, rice: u32) -> Result<i32, BlockError> {
        let mut quotient = 0;
        while quotient < QUOTIENT_ESCAPE && self.take(1)? == 1 {
            quotient += 1;
        }
        let zigzag = if quotient == QUOTIENT_ESCAPE {
            self.take(32)?
        } else {
            let high = u64::from(quotient) << rice;
            let whole = high | u64::from(self.take(rice)?);
            u32::try_from(whole).map_err(|_| BlockError::FieldRange)?
        };
        Ok((zigzag >> 1) as i32 ^ -((zigzag & 1) as i32))
    }

    /// Checks that only the zero bits that fill the last byte are left.
    fn finish(self) -> Result<(), BlockError> {
        let mask = (1u64 << self.pending_bits) - 1;
        if self.bytes.is_empty() && self.pending_bits < 8 && self.pending & mask == 0 {
            Ok(())
        } else {
            Err(BlockError::TrailingBits)
        }
    }
}

/// Writes bits, most significant first. The caller has checked that they fit.
#[derive(Default)]
struct BitWriter {
    bytes: Vec<u8, BLOCK_BYTES_MAX>,
    pending: u64,
    pending_bits: u32,
}

impl BitWriter {
    fn put(&mut self, value: u32, bits: u32) {
        self.pending = self.pending << bits | u64::from(value);
        self.pending_bits += bits;
        while self.pending_bits >= 8 {
            self.pending_bits -= 8;
            // Cannot overflow: a plan longer than the buffer is never written.
            let _ = self.bytes.push((self.pending >> self.pending_bits) as u8);
        }
    }

    fn put_rice(&mut self, zigzag: u32, rice: u32) {
        let quotient = zigzag >> rice;
        if quotient < QUOTIENT_ESCAPE {
            self.put((1 << (quotient + 1)) - 2, quotient + 1);
            self.put(zigzag & ((1u64 << rice) - 1) as u32, rice);
        } else {
            self.put((1 << QUOTIENT_ESCAPE) - 1, QUOTIENT_ESCAPE);
            self.put(zigzag, 32);
        }
    }

    fn finish(mut self) -> Vec<u8, BLOCK_BYTES_MAX> {
        let fill = (8 - self.pending_bits % 8) % 8;
        self.put(0, fill);
        self.bytes
    }
}

#[cfg(test)]
#[path = "knot_block_tests.rs"]
mod tests;
