//! What a job's layer should be: its passes as samples, cut into stations along them.
//!
//! In: the stream and its place. Out: passes and stations in the input's coordinates (mm, rad, mm³, s). Only flat layers.

use crate::geometry::Vector2;
use crate::geometry::aperture::Aperture;
use crate::job::transform::PartTransform;
use crate::job::{MotionState, SegmentStream};
use crate::report::pose_table::{StreamSample, samples_within};
use crate::text::refusal::{Refusal, refusal};
use headway_firmware::kinematics::pose::Pose;
use headway_protocol::units::{CHANNEL_HEADING, CHANNEL_VOLUME, CHANNEL_X, CHANNEL_Y, CHANNEL_Z};

/// Time between samples, s.
pub const SAMPLE_S: f64 = 1e-3;
/// A layer is flat whose nozzle keeps its height by this share of the layer's.
const FLAT_SHARE: f64 = 0.1;
/// Least share of 1 of a vertical tool axis.
const UPRIGHT: f64 = 0.9999;

/// A moment of a pass.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Tip.
    pub at_mm: Vector2,
    /// Heading, unwrapped.
    pub heading_rad: f64,
    /// Deposited so far.
    pub volume_mm3: f64,
    /// Along the pass, from its start.
    pub along_mm: f64,
}

/// A pass of the layer, its samples [`SAMPLE_S`] apart.
#[derive(Clone, Debug)]
pub struct Pass {
    /// Number in the job.
    pub number: u32,
    /// In order.
    pub samples: Vec<Sample>,
    /// Begins after a prime, ends before a retract.
    pub primed: [bool; 2],
}

/// A piece of a pass.
#[derive(Clone, Debug)]
pub struct Station {
    /// Its pass, among those of the layer.
    pub pass: usize,
    /// First and last sample.
    pub samples: [usize; 2],
    /// Its middle.
    pub at_mm: Vector2,
    /// Direction of travel there.
    pub along: Vector2,
    /// Curvature of the path, positive to the left, 1/mm.
    pub curvature: f64,
    /// Heading there.
    pub heading_rad: f64,
    /// Its length.
    pub length_mm: f64,
    /// Half of the bead's width there, as asked.
    pub half_mm: f64,
    /// Whether it is the start or the end of a pass that is primed or retracted.
    pub ends: [bool; 2],
}

impl Station {
    /// Time over it, s: never 0.
    pub fn seconds(&self) -> f64 {
        (self.samples[1] - self.samples[0]).max(1) as f64 * SAMPLE_S
    }
}

/// A layer of a job.
pub struct Layer<'a> {
    /// The nozzle.
    pub aperture: &'a Aperture,
    /// Top of what is below it, above the bed.
    pub base_mm: f64,
    /// Its own height.
    pub height_mm: f64,
    /// Its passes.
    pub passes: Vec<Pass>,
    /// Their pieces, in order.
    pub stations: Vec<Station>,
}

impl<'a> Layer<'a> {
    /// A layer, counted from 0.
    ///
    /// # Errors
    /// A `Refusal` if there is no such layer, if it prints nothing or if it is not flat.
    pub fn of(
        stream: &SegmentStream,
        servo_hz: f64,
        transform: &PartTransform,
        aperture: &'a Aperture,
        layer: u32,
    ) -> Result<Layer<'a>, Refusal> {
        let number = layer + 1;
        if layer >= stream.layers() {
            return Err(refusal!(
                "the job has {} layers, but --layer is {number}",
                stream.layers()
            ));
        }
        let below = layer.checked_sub(1);
        let below = below.and_then(|below| top_mm(stream, servo_hz, transform, below));
        let base_mm = below.unwrap_or(0.0);
        let mut passes: Vec<Pass> = Vec::new();
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        let mut is_upright = true;
        let ticks = stream.ticks_of_layer(layer);
        for sample in samples_within(stream, servo_hz, SAMPLE_S * servo_hz, ticks) {
            let (MotionState::Print, Some(pass)) = (sample.mark.state, sample.mark.pass) else {
                continue;
            };
            let [x, y, z] = tip_mm(&sample, transform);
            (low, high) = (low.min(z), high.max(z));
            is_upright &= Pose::from_channels(&sample.position).tool_axis().z > UPRIGHT;
            if passes.last().is_none_or(|last| last.number != pass) {
                passes.push(Pass {
                    number: pass,
                    samples: Vec::new(),
                    primed: [false; 2],
                });
            }
            let Some(Pass { samples, .. }) = passes.last_mut() else {
                continue;
            };
            let at_mm = Vector2::new(x, y);
            let along_mm = samples
                .last()
                .map_or(0.0, |last| last.along_mm + (at_mm - last.at_mm).norm());
            let [heading_rad, volume_mm3] =
                [CHANNEL_HEADING, CHANNEL_VOLUME].map(|c| sample.position[c]);
            samples.push(Sample {
                at_mm,
                heading_rad,
                volume_mm3,
                along_mm,
            });
        }
        passes.retain(|pass| pass.samples.len() > 1);
        let height_mm = high - base_mm;
        if passes.is_empty() {
            return Err(refusal!("layer {number} of the job prints nothing"));
        }
        if !is_upright || height_mm <= 0.0 || high - low > FLAT_SHARE * height_mm {
            return Err(refusal!(
                "layer {number} of the job is not flat: only flat layers are measured"
            ));
        }
        mark_ends(&mut passes, stream);
        let each = passes
            .iter()
            .enumerate()
            .map(|(number, pass)| stations(number, pass, aperture));
        let stations = each.flatten().collect();
        Ok(Layer {
            aperture,
            base_mm,
            height_mm,
            passes,
            stations,
        })
    }

    /// The samples of a station.
    pub fn samples_of(&self, station: &Station) -> &[Sample] {
        &self.passes[station.pass].samples[station.samples[0]..=station.samples[1]]
    }

    /// Top of the layer above the bed.
    pub fn top_mm(&self) -> f64 {
        self.base_mm + self.height_mm
    }
}

/// Tells which passes begin after a prime and end before a retract.
fn mark_ends(passes: &mut [Pass], stream: &SegmentStream) {
    for pair in stream.marks.windows(2) {
        let states = [pair[0].state, pair[1].state];
        let of = |mark: usize| pair[mark].pass;
        for pass in passes.iter_mut() {
            pass.primed[0] |= states[0] == MotionState::Prime && of(1) == Some(pass.number);
            pass.primed[1] |= states[1] == MotionState::Retract && of(0) == Some(pass.number);
        }
    }
}

fn tip_mm(sample: &StreamSample, transform: &PartTransform) -> [f64; 3] {
    transform.to_input([CHANNEL_X, CHANNEL_Y, CHANNEL_Z].map(|c| sample.position[c]))
}

fn top_mm(
    stream: &SegmentStream,
    servo_hz: f64,
    transform: &PartTransform,
    layer: u32,
) -> Option<f64> {
    let ticks = stream.ticks_of_layer(layer);
    let mut samples = samples_within(stream, servo_hz, 0.05 * servo_hz, ticks);
    let printing = samples.find(|sample| sample.mark.state == MotionState::Print)?;
    Some(tip_mm(&printing, transform)[2])
}

/// Pieces as long as the narrowest bead is wide; where flow starts and stops, as long as the nozzle.
fn stations(number: usize, pass: &Pass, aperture: &Aperture) -> Vec<Station> {
    let samples = &pass.samples;
    let last = samples.len() - 1;
    let length_mm = samples[last].along_mm;
    let (step_mm, end_mm) = (2.0 * aperture.minor_mm(), 2.0 * aperture.major_mm());
    let mut cuts = vec![0];
    let mut next_mm = if pass.primed[0] { end_mm } else { step_mm };
    let end_mm = length_mm - if pass.primed[1] { end_mm } else { step_mm };
    for (at, sample) in samples.iter().enumerate() {
        if sample.along_mm >= next_mm && sample.along_mm <= end_mm {
            cuts.push(at);
            next_mm = (sample.along_mm + step_mm).min(end_mm.max(sample.along_mm + 0.5 * step_mm));
        }
    }
    cuts.push(last);
    let pieces = cuts.len() - 1;
    let station = |(piece, ends): (usize, &[usize])| {
        let [from, to] = [ends[0], ends[1]];
        let half = (samples[from].along_mm + samples[to].along_mm) / 2.0;
        let middle = from + samples[from..to].partition_point(|sample| sample.along_mm < half);
        let chord = |a: usize, b: usize| samples[b].at_mm - samples[a].at_mm;
        let length_mm = samples[to].along_mm - samples[from].along_mm;
        let whole = chord(from, to);
        let along = match whole.norm() > 0.0 {
            true => whole.normalize(),
            false => Vector2::new(1.0, 0.0),
        };
        let (before, after) = (chord(from, middle), chord(middle, to));
        let turned = before.perp(&after).atan2(before.dot(&after));
        let heading_rad = samples[middle].heading_rad;
        let across = Vector2::new(-along.y, along.x);
        Station {
            pass: number,
            samples: [from, to],
            at_mm: samples[middle].at_mm,
            along,
            curvature: if length_mm > 0.0 {
                2.0 * turned / length_mm
            } else {
                0.0
            },
            heading_rad,
            length_mm,
            half_mm: aperture.extent_mm(heading_rad, across),
            ends: [
                pass.primed[0] && piece == 0,
                pass.primed[1] && piece + 1 == pieces,
            ],
        }
    };
    cuts.windows(2).enumerate().map(station).collect()
}
