//! What the page's script draws, as one block of JSON.
//!
//! In: the sheets of a [`Report`]. Out: JSON text that may stand inside a `script` element. Columns
//! of samples are numbers of 16 bits over their range (a 65,535th of it is their resolution: 3 µm
//! on a part of 200 mm), coverage is runs of equal cells, at most [`SIDE_MAX`] of them along a side.

use crate::geometry::Point2;
use crate::geometry::polygon::Region;
use crate::report::coverage_picture::{Cell, Raster};
use crate::report::machine_links::MachineLinks;
use crate::report::track::Track;
use crate::report::{LayerSheets, Place, Report};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde::Serialize;

/// Points of the nozzle's outline.
const NOZZLE_POINTS: usize = 48;
/// Most cells along a side of the coverage; finer rasters are shown in blocks.
const SIDE_MAX: usize = 1600;

#[derive(Serialize)]
struct Data<'a> {
    nozzle: Vec<[f64; 2]>,
    period_deg: f64,
    servo_hz: f64,
    flow_limit_mm3_s: f64,
    limits: &'a [String],
    outline: Vec<Vec<f64>>,
    keep_out: Vec<Vec<f64>>,
    axis: Vec<Vec<f64>>,
    unreachable: Vec<Vec<f64>>,
    layers: Vec<Layer<'a>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    machine: Option<&'a MachineLinks>,
    slow_places: &'a [Place],
    left_out: &'a [Place],
}

#[derive(Serialize)]
struct Layer<'a> {
    label: &'a str,
    /// Neither outline nor ground of it is known.
    bare: bool,
    start_s: f64,
    every_s: f64,
    x: Column,
    y: Column,
    z: Column,
    #[serde(skip_serializing_if = "Option::is_none")]
    nx: Option<Column>,
    #[serde(skip_serializing_if = "Option::is_none")]
    ny: Option<Column>,
    #[serde(skip_serializing_if = "Option::is_none")]
    nz: Option<Column>,
    heading: Column,
    speed: Column,
    flow: Column,
    joints: Vec<Joint<'a>>,
    joints_at: Vec<Column>,
    joints_every: usize,
    state: String,
    limit: String,
    ground: Vec<Ground>,
}

#[derive(Serialize)]
struct Joint<'a> {
    name: &'a str,
    #[serde(flatten)]
    column: Column,
}

#[derive(Serialize)]
struct Column {
    min: f32,
    max: f32,
    b64: String,
}

#[derive(Serialize)]
struct Ground {
    /// Canvas matrix from the raster's frame to the input's coordinates.
    matrix: [f64; 6],
    origin: [f64; 2],
    cell_mm: f64,
    columns: usize,
    rows: usize,
    rle: String,
}

/// The JSON block.
pub fn json(report: &Report) -> String {
    let sheets = report.layers.iter();
    let sheets = sheets.filter_map(|sheet| Some((sheet, sheet.track.as_ref()?)));
    let sheets = sheets.map(|(sheet, track)| layer(sheet.label, track, Some(sheet)));
    let bare = report.more_layers.iter();
    let bare = bare.map(|more| layer(&more.label, &more.track, None));
    let layers = sheets.chain(bare).collect();
    let first = report.layers.first();
    let rings = |regions: &[Region]| -> Vec<Vec<f64>> {
        let regions = regions.iter();
        let rings =
            regions.flat_map(|region| std::iter::once(&region.exterior).chain(&region.holes));
        rings.map(|ring| flat(&ring.points)).collect()
    };
    let lines = |lines: &[Vec<Point2>]| lines.iter().map(|line| flat(line)).collect();
    let aperture = first.map(|sheet| sheet.plan.aperture);
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
        outline: first.map_or(Vec::new(), |sheet| rings(sheet.plan.regions)),
        keep_out: first.map_or(Vec::new(), |sheet| rings(sheet.plan.keep_out)),
        axis: first.map_or(Vec::new(), |sheet| lines(&sheet.plan.axis)),
        unreachable: first.map_or(Vec::new(), |sheet| lines(&sheet.plan.unreachable)),
        layers,
        machine: report.machine.as_ref(),
        slow_places: report.slow_places,
        left_out: report.left_out,
    };
    let text = serde_json::to_string(&data).unwrap_or_else(|_| "{\"layers\":[]}".to_string());
    // Nothing in the block may end the element that it stands in.
    text.replace('<', "\\u003c")
}

fn layer<'a>(label: &'a str, track: &'a Track, sheet: Option<&'a LayerSheets>) -> Layer<'a> {
    let axis = |k: usize| (!track.tool_axis[k].is_empty()).then(|| column(&track.tool_axis[k]));
    let joints = track.joints_pct.iter();
    let coverage = sheet.iter().filter_map(|sheet| sheet.coverage.as_ref());
    let grounds = coverage.flat_map(|picture| &picture.rasters);
    Layer {
        label,
        bare: sheet.is_none(),
        start_s: track.start_s,
        every_s: track.every_s,
        x: column(&track.tip_mm[0]),
        y: column(&track.tip_mm[1]),
        z: column(&track.tip_mm[2]),
        nx: axis(0),
        ny: axis(1),
        nz: axis(2),
        heading: column(&track.heading_deg),
        speed: column(&track.speed_mm_s),
        flow: column(&track.flow_mm3_s),
        joints: joints
            .map(|(name, values)| Joint {
                name,
                column: column(values),
            })
            .collect(),
        joints_at: track.joints_at.iter().map(|at| column(at)).collect(),
        joints_every: track.joints_every,
        state: STANDARD.encode(&track.state),
        limit: STANDARD.encode(&track.limit),
        ground: grounds.filter_map(ground).collect(),
    }
}

/// Values as numbers of 16 bits, low byte first.
fn column(values: &[f32]) -> Column {
    let min = values.iter().copied().fold(f32::INFINITY, f32::min);
    let max = values.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let (min, max) = if min <= max { (min, max) } else { (0.0, 0.0) };
    let scale = f64::from(u16::MAX) / f64::from(max - min).max(1e-30);
    let number = |value: &f32| (f64::from(value - min) * scale).round() as u16;
    let bytes: Vec<u8> = values
        .iter()
        .flat_map(|v| number(v).to_le_bytes())
        .collect();
    Column {
        min,
        max,
        b64: STANDARD.encode(bytes),
    }
}

fn ground(raster: &Raster) -> Option<Ground> {
    let rows = raster.cells.len().checked_div(raster.columns)?;
    if rows == 0 {
        return None;
    }
    let block = raster.columns.max(rows).div_ceil(SIDE_MAX);
    let (columns, block_rows) = (raster.columns.div_ceil(block), rows.div_ceil(block));
    let mut runs: Vec<u8> = Vec::new();
    let mut run: Option<(Cell, u16)> = None;
    let mut push = |run: (Cell, u16)| {
        runs.push(code(run.0));
        runs.extend(run.1.to_le_bytes());
    };
    for number in 0..columns * block_rows {
        let cell = greatest(raster, rows, [number % columns, number / columns], block);
        run = match run {
            Some((of, length)) if of == cell && length < u16::MAX => Some((of, length + 1)),
            other => {
                other.into_iter().for_each(&mut push);
                Some((cell, 1))
            }
        };
    }
    run.into_iter().for_each(&mut push);
    let frame = &raster.frame;
    let (x, y) = (
        frame.vector_out([1.0, 0.0].into()),
        frame.vector_out([0.0, 1.0].into()),
    );
    let at = frame.point_out(Point2::origin());
    Some(Ground {
        matrix: [x.x, x.y, y.x, y.y, at.x, at.y],
        origin: [raster.origin.x, raster.origin.y],
        cell_mm: raster.cell_mm * block as f64,
        columns,
        rows: block_rows,
        rle: STANDARD.encode(runs),
    })
}

/// The greatest cell of a block: a small gap must not vanish.
fn greatest(raster: &Raster, rows: usize, [column, row]: [usize; 2], block: usize) -> Cell {
    let end = |at: usize, most: usize| ((at + 1) * block).min(most);
    let rows = row * block..end(row, rows);
    rows.flat_map(|row| {
        let start = row * raster.columns;
        &raster.cells[start + column * block..start + end(column, raster.columns)]
    })
    .copied()
    .max()
    .unwrap_or(Cell::Empty)
}

fn code(cell: Cell) -> u8 {
    match cell {
        Cell::Empty => 0,
        Cell::Once => 1,
        Cell::Unreachable => 2,
        Cell::Overlap => 3,
        Cell::Gap => 4,
        Cell::Spill => 5,
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
