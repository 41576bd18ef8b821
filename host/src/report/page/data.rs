//! What the page's script draws, as one block of JSON.
//!
//! In: the layers of a [`Report`]. Out: JSON text that may stand inside a `script` element: of each layer
//! its path ([`LayerPath`], to a micrometre and half a milliradian), samples at even times, its outline and what
//! was covered twice; limits, places, bed, heat.

use super::columns::{Column, Steps};
use super::ground::{Ground, ground};
use crate::geometry::Point2;
use crate::geometry::polygon::Region;
use crate::report::layer_path::{LayerPath, PathPoint, What};
use crate::report::machine_links::MachineLinks;
use crate::report::page_layer::{LayerMotion, PageFacts};
use crate::report::{Place, Report};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde::Serialize;

/// Points of the nozzle's outline.
const NOZZLE_POINTS: usize = 48;
/// Resolution of places.
const UNIT_MM: f64 = 1e-3;
/// Resolution of headings: less than the resolution of places at the end of any aperture.
const UNIT_RAD: f64 = 5e-4;
/// Resolution of tool axes.
const UNIT_AXIS: f64 = 1e-4;
/// Largest |cosine - 1| of a tool that stands upright.
const UPRIGHT: f64 = 1e-12;

#[derive(Serialize)]
struct Data<'a> {
    nozzle: Vec<[f64; 2]>,
    period_deg: f64,
    servo_hz: f64,
    flow_limit_mm3_s: f64,
    limits: &'a [String],
    whats: [&'static str; What::ALL.len()],
    /// Rings of each outline.
    outlines: Vec<Vec<Ring>>,
    keep_out: Vec<Vec<f64>>,
    axis: Vec<Vec<f64>>,
    unreachable: Vec<Vec<f64>>,
    layers: Vec<Layer<'a>>,
    #[serde(flatten)]
    facts: &'a PageFacts,
    #[serde(skip_serializing_if = "Option::is_none")]
    machine: Option<&'a MachineLinks>,
    slow_places: &'a [Place],
    left_out: &'a [Place],
}

#[derive(Serialize)]
struct Ring {
    x: Steps,
    y: Steps,
}

#[derive(Serialize)]
struct Layer<'a> {
    label: &'a str,
    /// Layer of the job, from 0.
    number: u32,
    /// The layer that it is planned like, from 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    like: Option<u32>,
    start_s: f64,
    seconds: f64,
    every_s: f64,
    path: Path,
    speed: Column,
    flow: Column,
    joints: Vec<Joint<'a>>,
    joints_at: Vec<Column>,
    joints_every: usize,
    limit: String,
    /// What is laid of what was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    laid: Option<Column>,
    #[serde(skip_serializing_if = "Option::is_none")]
    outline: Option<usize>,
    ground: Vec<Ground>,
}

#[derive(Serialize)]
struct Path {
    start_tick: u64,
    /// What, how many points, what, how many, ...
    runs: Vec<usize>,
    ticks: Steps,
    x: Steps,
    y: Steps,
    z: Steps,
    #[serde(skip_serializing_if = "Option::is_none")]
    axis: Option<[Steps; 3]>,
    heading: Steps,
    line: Steps,
}

#[derive(Serialize)]
struct Joint<'a> {
    name: &'a str,
    #[serde(flatten)]
    column: Column,
}

/// The JSON block.
pub fn json(report: &Report) -> String {
    let mut outlines = Outlines::default();
    let drawn = report.layers.iter().map(|drawn| {
        let outline = outlines.number(drawn.plan.regions);
        let swept = drawn.swept.iter();
        Layer {
            ground: swept.map(|(frame, swept)| ground(frame, swept)).collect(),
            ..layer(drawn.label, drawn.layer, &drawn.motion, outline)
        }
    });
    let mut layers: Vec<Layer> = drawn.collect();
    layers.extend(report.more_layers.iter().map(|more| {
        let outline = outlines.number(more.outline);
        Layer {
            like: more.like,
            ..layer(&more.label, more.layer, &more.motion, outline)
        }
    }));
    layers.sort_by_key(|layer| layer.number);
    let first = report.layers.first();
    let rings = |regions: &[Region]| -> Vec<Vec<f64>> {
        let rings = regions.iter().flat_map(Region::rings);
        rings.map(|ring| flat(&ring.points)).collect()
    };
    let lines = |lines: &[Vec<Point2>]| lines.iter().map(|line| flat(line)).collect();
    let aperture = first.map(|layer| layer.plan.aperture);
    let nozzle = aperture.map_or(Vec::new(), |it| it.outline(0.0, NOZZLE_POINTS));
    let data = Data {
        nozzle: nozzle
            .iter()
            .map(|v| [rounded(v.x), rounded(v.y)])
            .collect(),
        period_deg: aperture.map_or(180.0, |it| it.period_rad().to_degrees()),
        servo_hz: report.servo_hz,
        flow_limit_mm3_s: report.flow_limit_mm3_s,
        limits: report.limits,
        whats: What::ALL.map(What::name),
        outlines: outlines.rings,
        keep_out: first.map_or(Vec::new(), |layer| rings(layer.plan.keep_out)),
        axis: first.map_or(Vec::new(), |layer| lines(&layer.plan.axis)),
        unreachable: first.map_or(Vec::new(), |layer| lines(&layer.plan.unreachable)),
        layers,
        facts: &report.facts,
        machine: report.machine.as_ref(),
        slow_places: report.slow_places,
        left_out: report.left_out,
    };
    let text = serde_json::to_string(&data).unwrap_or_else(|_| "{\"layers\":[]}".to_string());
    // Nothing in the block may end the element that it stands in.
    text.replace('<', "\\u003c")
}

/// Outlines, each once.
#[derive(Default)]
struct Outlines<'a> {
    known: Vec<&'a [Region]>,
    rings: Vec<Vec<Ring>>,
}

impl<'a> Outlines<'a> {
    /// The number of an outline; `None` where there is none.
    fn number(&mut self, regions: &'a [Region]) -> Option<usize> {
        if regions.is_empty() {
            return None;
        }
        let known = self.known.iter().rposition(|known| *known == regions);
        Some(known.unwrap_or_else(|| {
            let rings = regions.iter().flat_map(Region::rings);
            let column = |along: &[f64]| Steps::of(along.iter().copied(), UNIT_MM);
            let rings = rings.map(|ring| {
                let [x, y]: [Vec<f64>; 2] =
                    [0, 1].map(|k| ring.points.iter().map(|p| p[k]).collect());
                Ring {
                    x: column(&x),
                    y: column(&y),
                }
            });
            self.rings.push(rings.collect());
            self.known.push(regions);
            self.known.len() - 1
        }))
    }
}

fn layer<'a>(
    label: &'a str,
    number: u32,
    motion: &'a LayerMotion,
    outline: Option<usize>,
) -> Layer<'a> {
    let track = &motion.track;
    let joints = track.joints_pct.iter();
    Layer {
        label,
        number,
        like: None,
        start_s: track.start_s,
        seconds: track.seconds,
        every_s: track.every_s,
        path: path(&motion.path),
        speed: Column::of(&track.speed_mm_s),
        flow: Column::of(&track.flow_mm3_s),
        joints: joints
            .map(|(name, values)| Joint {
                name,
                column: Column::of(values),
            })
            .collect(),
        joints_at: track.joints_at.iter().map(|at| Column::of(at)).collect(),
        joints_every: track.joints_every,
        limit: STANDARD.encode(&track.limit),
        laid: (!motion.laid.is_empty()).then(|| Column::of(&motion.laid)),
        outline,
        ground: Vec::new(),
    }
}

fn path(path: &LayerPath) -> Path {
    let runs = path.runs.iter().flat_map(|run| {
        let what = What::ALL.iter().position(|what| *what == run.what);
        [what.unwrap_or(What::ALL.len() - 1), run.points.len()]
    });
    let points = || path.runs.iter().flat_map(|run| &run.points);
    let column = |of: fn(&PathPoint) -> f64, unit: f64| Steps::of(points().map(of), unit);
    let is_upright = points().all(|point| (1.0 - point.axis[2]).abs() < UPRIGHT);
    let lines = path.runs.iter().flat_map(|run| &run.lines);
    let since = |point: &PathPoint| (point.tick - path.start_tick) as f64;
    Path {
        start_tick: path.start_tick,
        runs: runs.collect(),
        ticks: Steps::of(points().map(since), 1.0),
        x: column(|point| point.tip_mm[0], UNIT_MM),
        y: column(|point| point.tip_mm[1], UNIT_MM),
        z: column(|point| point.tip_mm[2], UNIT_MM),
        axis: (!is_upright).then(|| {
            let of: [fn(&PathPoint) -> f64; 3] = [|p| p.axis[0], |p| p.axis[1], |p| p.axis[2]];
            of.map(|of| column(of, UNIT_AXIS))
        }),
        heading: column(|point| point.heading_rad, UNIT_RAD),
        line: Steps::of(lines.map(|line| f64::from(*line)), 1.0),
    }
}

/// x, y, x, y, ..., to 0.1 µm.
fn flat(points: &[Point2]) -> Vec<f64> {
    let points = points.iter();
    points.flat_map(|p| [rounded(p.x), rounded(p.y)]).collect()
}

fn rounded(value: f64) -> f64 {
    (value * 1e4).round() / 1e4
}
