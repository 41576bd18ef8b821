//! The path of one layer as poses connected by straight lines, which the page draws and plays.
//!
//! In: a [`SegmentStream`] in machine coordinates, a range of its servo ticks. Out: a [`LayerPath`] in the
//! input's coordinates (mm, rad) with points where the path turns, up to a maximum number: position and
//! heading between two points are off by at most [`WITHIN_MM`] across the path, measured at the aperture's
//! end, and by [`ALONG_MM`] along it at any time. Where that would need too many points, the least important
//! are dropped first.
//!
//! Source: Douglas and Peucker, Algorithms for the reduction of the number of points (1973), with the distance
//! at the same time of Meratnia and de By (2004) in addition to that across.

use super::pose_table::StreamIndex;
use crate::job::transform::PartTransform;
use crate::job::{Mark, MotionState, SegmentStream};
use headway_firmware::kinematics::pose::Pose;
use headway_firmware::path::spline::Span;
use headway_protocol::units::{CHANNEL_HEADING, CHANNEL_X, CHANNEL_Y, CHANNEL_Z};

/// Across the path, mm: a pixel shows more than that up to 250 pixels a millimetre.
pub const WITHIN_MM: f64 = 0.004;
/// Along the path at the same moment, mm: a fraction of a bead's width.
pub const ALONG_MM: f64 = 0.05;
/// Parts of a span that are checked before it counts as straight.
const LOOKS: u64 = 4;

/// What the head does on a run of points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum What {
    /// Beads along the outline and its medial axis.
    Wall,
    /// Lines of solid infill.
    Solid,
    /// Lines of a sparse infill.
    Sparse,
    /// Lines over open space.
    Bridge,
    /// Skirt and brim.
    Skirt,
    /// Supports, of a slicer's file.
    Support,
    /// A bead of unknown kind.
    Bead,
    /// Moving without flow.
    Travel,
    /// At rest during the prime.
    Prime,
    /// Standing while it is pulled back.
    Retract,
    /// Standing.
    Hold,
}

impl What {
    /// All of them, by the numbers that the page knows them by.
    pub const ALL: [What; 11] = [
        What::Wall,
        What::Solid,
        What::Sparse,
        What::Bridge,
        What::Skirt,
        What::Support,
        What::Bead,
        What::Travel,
        What::Prime,
        What::Retract,
        What::Hold,
    ];

    /// For a move; `bead` if it prints.
    pub fn of(state: MotionState, bead: What) -> What {
        match state {
            MotionState::Print => bead,
            MotionState::Travel => What::Travel,
            MotionState::Prime => What::Prime,
            MotionState::Retract => What::Retract,
            MotionState::Hold => What::Hold,
        }
    }

    /// For the eye.
    pub fn name(self) -> &'static str {
        match self {
            What::Wall => "wall",
            What::Solid => "solid",
            What::Sparse => "sparse",
            What::Bridge => "bridge",
            What::Skirt => "skirt",
            What::Support => "support",
            What::Bead => "bead",
            What::Travel => "travel",
            What::Prime => "prime",
            What::Retract => "retract",
            What::Hold => "hold",
        }
    }
}

/// A moment of the path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathPoint {
    /// Servo tick of segment time.
    pub tick: u64,
    /// Segment of the job, from 0.
    pub segment: usize,
    /// Tip, input coordinates.
    pub tip_mm: [f64; 3],
    /// Tool axis.
    pub axis: [f64; 3],
    /// Heading, unwrapped.
    pub heading_rad: f64,
}

/// Points that do the same.
#[derive(Clone, Debug, PartialEq)]
pub struct Run {
    /// What.
    pub what: What,
    /// Two or more, or one where nothing lasts; the first is where the run before ends.
    pub points: Vec<PathPoint>,
    /// Line of the file, or segment of the job, from 1, of each point.
    pub lines: Vec<u32>,
}

/// The path of a layer.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LayerPath {
    /// First servo tick.
    pub start_tick: u64,
    /// In order of time.
    pub runs: Vec<Run>,
}

/// What of a stream is followed.
#[derive(Clone, Copy)]
pub struct PathOf<'a> {
    /// The stream.
    pub stream: &'a SegmentStream,
    /// Where its spans begin.
    pub index: &'a StreamIndex<'a>,
    /// From machine to input coordinates.
    pub transform: &'a PartTransform,
    /// Half of the aperture's length, which is the radius of its end in a turn, mm.
    pub reach_mm: f64,
    /// First and last servo tick.
    pub ticks: [u64; 2],
    /// Maximum number of points, in addition to the two ends of every move.
    pub points_max: usize,
}

/// Follows the path; `facts` gives for each kept point the kind of motion from it on, and its line.
pub fn layer_path(
    of: PathOf,
    mut facts: impl FnMut(&Mark, &PathPoint) -> (What, u32),
) -> LayerPath {
    let moves = moves(&of);
    let mut kept: Vec<Vec<f32>> = moves
        .iter()
        .map(|(_, all)| weights(all, of.reach_mm))
        .collect();
    let threshold = threshold(&kept, of.points_max);
    let mut path = LayerPath {
        start_tick: of.ticks[0],
        runs: Vec::new(),
    };
    for ((mark, points), weights) in moves.iter().zip(&mut kept) {
        let mut weights = weights.iter();
        let points = points.iter();
        let points = points.filter(|_| weights.next().is_some_and(|&weight| weight > threshold));
        let mut run: Option<Run> = None;
        for point in points {
            let (what, line) = facts(mark, point);
            let is_new = run.as_ref().is_none_or(|run| run.what != what);
            if let Some(run) = &mut run {
                run.points.push(*point);
                run.lines.push(line);
            }
            if is_new {
                path.runs.extend(run.take());
                run = Some(Run {
                    what,
                    points: vec![*point],
                    lines: vec![line],
                });
            }
        }
        // What changes at the very end of a move lasts no time.
        path.runs.extend(run.filter(|run| run.points.len() > 1));
    }
    path
}

/// The moves within the ticks, each as points so dense that it is straight between them.
fn moves<'a>(of: &PathOf<'a>) -> Vec<(&'a Mark, Vec<PathPoint>)> {
    let [from, end] = of.ticks;
    let marks = &of.stream.marks;
    let first = marks.partition_point(|mark| mark.end_tick <= from);
    let marks = marks[first..]
        .iter()
        .take_while(|mark| mark.start_tick < end);
    let mut moves: Vec<(&Mark, Vec<PathPoint>)> = marks.map(|mark| (mark, Vec::new())).collect();
    let mut number = 0;
    for span in of.index.spans_from(from) {
        let span_end = span.start_tick + u64::from(span.duration_ticks);
        while let Some((mark, points)) = moves.get_mut(number) {
            let begins = mark.start_tick.max(span.start_tick).max(from);
            let ends = mark.end_tick.min(span_end).min(end);
            if begins <= ends {
                let first = point(&span, begins, of.transform);
                let last = point(&span, ends, of.transform);
                if points.last().is_none_or(|before| before.tick < first.tick) {
                    points.push(first);
                }
                divide(&span, [first, last], of, points);
            }
            if mark.end_tick > span_end {
                break;
            }
            number += 1;
        }
        if number >= moves.len() || span_end >= end {
            break;
        }
    }
    moves.retain(|(_, points)| !points.is_empty());
    moves
}

fn point(span: &Span, tick: u64, transform: &PartTransform) -> PathPoint {
    let p = span.position((tick - span.start_tick) as f64);
    PathPoint {
        tick,
        segment: span.index,
        tip_mm: transform.to_input([p[CHANNEL_X], p[CHANNEL_Y], p[CHANNEL_Z]]),
        axis: Pose::from_channels(&p).tool_axis().into(),
        heading_rad: p[CHANNEL_HEADING],
    }
}

/// Adds the points of a part of a span after its first, halving it until it is straight.
fn divide(span: &Span, whole: [PathPoint; 2], of: &PathOf, points: &mut Vec<PathPoint>) {
    let mut open = vec![whole];
    while let Some([from, to]) = open.pop() {
        let ticks = to.tick - from.tick;
        let at = |tick: u64| point(span, tick, of.transform);
        let looks = 1..LOOKS.min(ticks.max(1));
        let looks = looks.map(|k| at(from.tick + ticks * k / LOOKS.min(ticks)));
        // Half of what may be off: points are dropped afterwards, relative to these.
        let is_bent = looks
            .map(|p| off(&p, &from, &to, of.reach_mm))
            .any(|off| off > 0.5);
        if is_bent && ticks > 1 {
            let middle = at(from.tick + ticks / 2);
            open.extend([[middle, to], [from, middle]]);
        } else if ticks > 0 {
            points.push(to);
        }
    }
}

/// Distance of a point from the straight move between two others, as a multiple of the tolerance.
fn off(p: &PathPoint, from: &PathPoint, to: &PathPoint, reach_mm: f64) -> f64 {
    let between = |from: f64, to: f64, share: f64| from + share * (to - from);
    let apart = |share: f64| {
        let each: [f64; 3] =
            std::array::from_fn(|k| p.tip_mm[k] - between(from.tip_mm[k], to.tip_mm[k], share));
        each.iter().map(|d| d * d).sum::<f64>().sqrt()
    };
    let turned = |share: f64| {
        let axis: [f64; 3] =
            std::array::from_fn(|k| p.axis[k] - between(from.axis[k], to.axis[k], share));
        let axis = axis.iter().map(|d| d * d).sum::<f64>().sqrt();
        (p.heading_rad - between(from.heading_rad, to.heading_rad, share)).abs() + axis
    };
    let by_time = (p.tick - from.tick) as f64 / ((to.tick - from.tick) as f64).max(1.0);
    let chord: [f64; 3] = std::array::from_fn(|k| to.tip_mm[k] - from.tip_mm[k]);
    let length2: f64 = chord.iter().map(|d| d * d).sum();
    let along: f64 = (0..3)
        .map(|k| (p.tip_mm[k] - from.tip_mm[k]) * chord[k])
        .sum();
    // For a turn in place only time gives the progress.
    let by_way = match length2 > WITHIN_MM * WITHIN_MM {
        true => (along / length2).clamp(0.0, 1.0),
        false => by_time,
    };
    let across = apart(by_way).max(reach_mm * turned(by_way)) / WITHIN_MM;
    across.max(apart(by_time).max(reach_mm * turned(by_time)) / ALONG_MM)
}

/// What each point of a move is worth: how far the path would be off without it; 0 if it would be invisible.
fn weights(points: &[PathPoint], reach_mm: f64) -> Vec<f32> {
    let mut weights = vec![0.0; points.len()];
    if let (Some(first), last) = (weights.first().map(|_| 0), points.len().saturating_sub(1)) {
        weights[first] = f32::INFINITY;
        weights[last] = f32::INFINITY;
        let mut open = vec![(first, last, f64::INFINITY)];
        while let Some((from, to, above)) = open.pop() {
            let each =
                (from + 1..to).map(|k| (off(&points[k], &points[from], &points[to], reach_mm), k));
            let most = each.fold((1.0, None), |most, (off, k)| match off > most.0 {
                true => (off, Some(k)),
                false => most,
            });
            if let (off, Some(k)) = most {
                let worth = f64::min(off, above);
                weights[k] = worth as f32;
                open.extend([(from, k, worth), (k, to, worth)]);
            }
        }
    }
    weights
}

/// Points of a weight up to this are dropped, so that few enough remain.
fn threshold(weights: &[Vec<f32>], points_max: usize) -> f32 {
    let inner = weights.iter().flatten();
    let mut inner: Vec<f32> = inner
        .copied()
        .filter(|w| *w > 0.0 && w.is_finite())
        .collect();
    if inner.len() <= points_max {
        return 0.0;
    }
    inner.sort_unstable_by(|a, b| b.total_cmp(a));
    inner[points_max]
}

#[cfg(test)]
mod tests {
    //! Goal: what the page draws between two points is the path within the tolerance, and few points suffice.
    //! Method: planned streams against every servo tick of them; fewer points than needed where fewer are allowed.
    use super::*;
    use headway_protocol::segment::Knot;
    use headway_protocol::units::to_units;

    /// A rounded zigzag that turns the nozzle, from rest to rest, in two moves.
    fn zigzag() -> SegmentStream {
        let knot = |k: usize| {
            let s = k.clamp(3, 400) as f64 * 0.1;
            Knot {
                control: to_units(&[s, 4.0 * (0.7 * s).sin(), 0.2, 0.0, 0.0, (0.4 * s).cos(), s]),
                duration_ticks: 24,
            }
        };
        let knots: Vec<Knot> = (1..404).map(knot).collect();
        let mark = |start_tick, end_tick, state| Mark {
            start_tick,
            end_tick,
            state,
            layer: 0,
            pass: None,
        };
        SegmentStream {
            start: knot(0).control,
            marks: vec![
                mark(0, 3000, MotionState::Travel),
                mark(3000, 24 * 403 - 32, MotionState::Print),
            ],
            knots,
            ..SegmentStream::default()
        }
    }

    fn path(points_max: usize) -> (SegmentStream, LayerPath) {
        let stream = zigzag();
        let index = StreamIndex::of(&stream);
        let end = stream.marks.last().map_or(0, |mark| mark.end_tick);
        let of = PathOf {
            stream: &stream,
            index: &index,
            transform: &PartTransform::default(),
            reach_mm: 0.6,
            ticks: [0, end],
            points_max,
        };
        let path = layer_path(of, |mark, at| {
            (What::of(mark.state, What::Wall), at.segment as u32 + 1)
        });
        (stream, path)
    }

    #[test]
    fn the_path_between_its_points_is_the_streams() {
        let (stream, path) = path(usize::MAX);
        let points: Vec<PathPoint> = path
            .runs
            .iter()
            .flat_map(|run| run.points.clone())
            .collect();
        let mut worst: f64 = 0.0;
        let mut at = 0;
        let mut ticks = 0;
        for span in stream.spans() {
            for t in 0..u64::from(span.duration_ticks) {
                let here = point(&span, span.start_tick + t, &PartTransform::default());
                while at + 2 < points.len() && points[at + 1].tick < here.tick {
                    at += 1;
                }
                if points[at].tick <= here.tick && here.tick <= points[at + 1].tick {
                    worst = worst.max(off(&here, &points[at], &points[at + 1], 0.6));
                    ticks += 1;
                }
            }
        }
        assert!(
            ticks > 5000 && points.len() * 4 < ticks,
            "{ticks} {}",
            points.len()
        );
        // One for what may be left out, a half for what divides the spans.
        assert!(worst <= 1.5, "{worst}");
        assert!(path.runs.iter().any(|run| run.what == What::Travel));
        let ends = path.runs.windows(2);
        assert!(
            ends.into_iter()
                .all(|pair| pair[0].points.last().map(|p| p.tick)
                    == pair[1].points.first().map(|p| p.tick))
        );
    }

    #[test]
    fn few_points_keep_the_ends_of_every_move() {
        let ((stream, all), (_, few)) = (path(usize::MAX), path(50));
        let count = |path: &LayerPath| path.runs.iter().map(|run| run.points.len()).sum::<usize>();
        assert!(count(&few) <= 50 + 2 * stream.marks.len() && count(&few) > 50);
        assert!(count(&all) > 2 * count(&few));
        assert_eq!(all.runs.len(), few.runs.len());
    }
}
