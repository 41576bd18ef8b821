//! The finished stream of a slicer's file against the file's own lines: the checker of G-code that comes in.
//!
//! In: a program and its plan. Out: how far any tick leaves the file's lines, mm, away from corners and in them.
//! Shares no code with the planner: it knows the file by its vertices.

use headway::gcode::{GcodePass, GcodeProgram};
use headway::pipeline::gcode::GcodePlan;
use headway::report::pose_table::samples_within;
use std::f64::consts::PI;

/// Corners of the file, and how far around them they are.
const CORNER_RAD: f64 = PI / 6.0;
const CORNER_REACH_MM: f64 = 0.3;
/// How far behind the farthest place so far a tick's place may be, and how far ahead of it beside twice the way since:
/// corners cut off some of the lines, and where these go back on themselves so does the path, a little before.
const BEHIND_MM: f64 = 0.12;
const AHEAD_MM: f64 = 0.3;
/// How far from its vertex a tick's place may be, mm of the lines.
const VERTEX_REACH_MM: f64 = 0.3;

type Point = [f64; 3];

fn minus(a: Point, b: Point) -> Point {
    std::array::from_fn(|i| a[i] - b[i])
}

fn dot(a: Point, b: Point) -> f64 {
    (0..3).map(|i| a[i] * b[i]).sum()
}

fn distance(a: Point, b: Point) -> f64 {
    dot(minus(a, b), minus(a, b)).sqrt()
}

/// A place of the file's lines: length along them, and how far a tip is from it, mm.
#[derive(Clone, Copy)]
struct Matched {
    along_mm: f64,
    beside_mm: f64,
}

/// The place of the lines nearest to a tip among those between two lengths along them; lines cross, so that the
/// nearest of all may be another one's.
fn matched(
    tip: Point,
    points: &[Point],
    lengths_mm: &[f64],
    [from_mm, to_mm]: [f64; 2],
) -> Matched {
    let first = lengths_mm
        .partition_point(|mm| *mm <= from_mm)
        .saturating_sub(1);
    let mut best = Matched {
        along_mm: from_mm,
        beside_mm: f64::INFINITY,
    };
    for leg in first..points.len() - 1 {
        let [begin_mm, end_mm] = [lengths_mm[leg], lengths_mm[leg + 1]];
        if begin_mm > to_mm {
            break;
        }
        let leg_mm = (end_mm - begin_mm).max(1e-12);
        let way = minus(points[leg + 1], points[leg]);
        let share = dot(minus(tip, points[leg]), way) / dot(way, way).max(1e-18);
        let bounds = [from_mm, to_mm].map(|mm| ((mm - begin_mm) / leg_mm).clamp(0.0, 1.0));
        let share = share.clamp(bounds[0], bounds[1]);
        let at: Point = std::array::from_fn(|i| points[leg][i] + share * way[i]);
        let beside_mm = distance(tip, at);
        if beside_mm < best.beside_mm {
            best = Matched {
                along_mm: begin_mm + share * leg_mm,
                beside_mm,
            };
        }
    }
    best
}

/// Vertices of a pass, and which of them are corners.
fn vertices(pass: &GcodePass) -> (Vec<Point>, Vec<Point>) {
    let points: Vec<Point> = pass.points.iter().map(|place| place.tip_mm).collect();
    let sharp = points.windows(3).filter(|w| {
        let (a, b) = (minus(w[1], w[0]), minus(w[2], w[1]));
        let cos = dot(a, b) / (dot(a, a) * dot(b, b)).sqrt().max(1e-12);
        cos.clamp(-1.0, 1.0).acos() > CORNER_RAD
    });
    let corners = sharp.map(|w| w[1]).collect();
    (points, corners)
}

/// How far the stream leaves the file's lines away from corners and in them, and how far any vertex
/// is from the stream, mm.
///
/// # Panics
/// Where a pass has no ticks.
pub fn beside(program: &GcodeProgram, plan: &GcodePlan) -> [f64; 3] {
    let servo_hz = f64::from(plan.settings.machine.servo_hz);
    let mut worst = [0.0f64; 3];
    for (number, pass) in program.passes.iter().enumerate() {
        let marks = plan.stream.marks.iter();
        let marks: Vec<_> = marks
            .filter(|mark| mark.pass == Some(number as u32))
            .collect();
        let (Some(first), Some(last)) = (marks.first(), marks.last()) else {
            continue;
        };
        let ticks = [first.start_tick, last.end_tick];
        let (points, corners) = vertices(pass);
        let tips: Vec<Point> = samples_within(&plan.stream, servo_hz, 1.0, ticks)
            .map(|sample| {
                let p = sample.position;
                plan.transform.to_input([p[0], p[1], p[2]])
            })
            .collect();
        let mut lengths_mm = vec![0.0; points.len()];
        for i in 1..points.len() {
            lengths_mm[i] = lengths_mm[i - 1] + distance(points[i - 1], points[i]);
        }
        let (mut far_mm, mut before) = (0.0f64, tips[0]);
        let mut along_mm = Vec::with_capacity(tips.len());
        for tip in &tips {
            let ahead_mm = AHEAD_MM + 2.0 * distance(before, *tip);
            let within = [far_mm - BEHIND_MM, far_mm + ahead_mm];
            let place = matched(*tip, &points, &lengths_mm, within);
            (far_mm, before) = (far_mm.max(place.along_mm), *tip);
            along_mm.push(far_mm);
            let in_corner = corners
                .iter()
                .any(|corner| distance(*corner, *tip) < CORNER_REACH_MM);
            let slot = &mut worst[usize::from(in_corner)];
            *slot = slot.max(place.beside_mm);
        }
        // A vertex against the tips whose place is around its own.
        let mut from = 0;
        for (point, length_mm) in points.iter().zip(&lengths_mm) {
            while from + 1 < tips.len() && along_mm[from] < length_mm - VERTEX_REACH_MM {
                from += 1;
            }
            let ahead =
                (from..tips.len()).take_while(|k| along_mm[*k] <= length_mm + VERTEX_REACH_MM);
            let nearest = ahead.chain([from]).map(|k| distance(tips[k], *point));
            worst[2] = worst[2].max(nearest.fold(f64::INFINITY, f64::min));
        }
    }
    worst
}
