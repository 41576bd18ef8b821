//! The motion on the wire: knots of a non-uniform cubic B-spline in seven channels.
//!
//! Knot n carries control point P_n and a span duration. Span n is the part of the curve whose
//! active control points are P_{n-3}..P_n; its shape also needs the durations of the two spans
//! before and the two spans after it. Knot n therefore carries the duration of span n + 2, so that
//! span n can run as soon as knot n has arrived.
//!
//! With h_i the duration of span i and T the knots around span n (t0 = start of span n-2, ... t5 =
//! end of span n+2), de Boor's algorithm applies as usual. A stream starts at rest: P_{-3} = P_{-2}
//! = P_{-1} = start, and h_{-2} = h_{-1} = h_0 = h_1 = [`REST_TICKS`]. Three equal control points
//! in a row are a rest, exactly at that point.

use crate::units::{ChannelPoint, Ticks};
use serde::{Deserialize, Serialize};

/// Duration of the two virtual spans before the first one and of spans 0 and 1.
pub const REST_TICKS: u16 = 8;
/// Longest span: 16 s at a 2 kHz servo would need more; longer rests are several spans.
pub const SPAN_TICKS_MAX: u16 = 4096;

/// One knot of the stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Knot {
    /// Control point P_n, in the stream's units (wrapping).
    pub control: ChannelPoint,
    /// Duration of span n + 2 in servo ticks, 1..=[`SPAN_TICKS_MAX`].
    pub duration_ticks: u16,
}

/// Action of the extruder parallel to the motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum FlowAction {
    /// Push material to the aperture.
    Prime,
    /// Pull material back.
    Retract,
}

/// A prime or retract: runs for `duration_ticks` of real time from its start, parallel to the
/// motion, along a quintic smooth step (peak rate 1.875 volume / duration).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct FlowEvent {
    /// Span in which it starts (index n as in the module text, 0 = first span of the stream).
    pub span: u32,
    /// Ticks after that span's start, less than the span's duration.
    pub offset_ticks: u16,
    /// Prime or retract.
    pub action: FlowAction,
    /// Volume moved, in the stream's unit of volume.
    pub volume_units: u32,
    /// Its duration.
    pub duration_ticks: Ticks,
}
