//! What of the machine makes a layer other than asked: values with standard errors, told apart by two robust fits.
//!
//! In: a layer, its sections, the machine's pressure advance. Out: [`Estimate`]s, flows with their factors, places. Edges know
//! the nozzle's offset, the zero of its heading and the width; volumes know the flow, what the material lags by, and what
//! starts and stops are off by (docs/design/measure.md). What a layer does not tell apart is named, with what would.

use super::edges::Edges;
use super::fit::{Row, median, robust};
use super::layer::{Layer, Pass, SAMPLE_S, Station};
use super::sections::Section;
use serde::Serialize;
use std::collections::BTreeMap;

/// What is known of an extruder before a scan.
#[derive(Clone, Copy, Debug)]
pub struct Extruder {
    /// Pressure advance, s.
    pub advance_s: f64,
    /// Time over which it is averaged, s.
    pub window_s: f64,
}

/// A value that a scan tells.
#[derive(Clone, Debug, Serialize)]
pub struct Estimate {
    /// Its name with its unit.
    pub name: &'static str,
    /// As measured; `None` if this layer does not tell it.
    pub value: Option<f64>,
    /// Standard error.
    pub error: f64,
    /// What a layer needs that tells it.
    pub needs: &'static str,
}

/// Lags that are tried first, s.
const LAGS_S: [f64; 9] = [0.0, 0.005, 0.01, 0.02, 0.04, 0.08, 0.16, 0.32, 0.64];
const LAG_STEPS: usize = 8;
/// Longest lag, s.
const LAG_MOST_S: f64 = 1.0;
/// Side of the tiles between which flows are compared, in half lengths of the nozzle.
const TILE: f64 = 10.0;
/// Fewest stations of a fit.
const ROWS_LEAST: usize = 30;
/// Errors up to which a value counts as told: offset and width, of the narrowest bead's half width; heading in rad; flow; lag
/// in s.
const LENGTH_ERROR: f64 = 0.06;
const HEADING_ERROR_RAD: f64 = 0.006;
const FLOW_ERROR: f64 = 0.004;
const LAG_ERROR_S: f64 = 0.003;

/// Name, value, error, error up to which it counts as told, what tells it.
type Found = (&'static str, f64, f64, f64, &'static str);

fn estimate((name, value, error, most, needs): Found) -> Estimate {
    Estimate {
        name,
        value: (error <= most).then_some(value),
        error,
        needs,
    }
}

/// Offset, width and heading from the edges.
pub fn of_edges(layer: &Layer, edges: &Edges) -> Vec<Estimate> {
    let (nozzle, error) = (&edges.nozzle, edges.error);
    let headings = "free beads at headings a quarter turn apart, along several directions";
    let free = "beads that are free on both sides";
    let aslant = "free beads with the nozzle aslant to the travel";
    let length_mm = LENGTH_ERROR * layer.aperture.minor_mm();
    let [x, y] = [nozzle.centre_mm.x, nozzle.centre_mm.y];
    let (heading, of_heading) = (nozzle.heading_rad.to_degrees(), error[3].to_degrees());
    let found: [Found; 4] = [
        ("nozzle_x_mm", x, error[0], length_mm, headings),
        ("nozzle_y_mm", y, error[1], length_mm, headings),
        ("width_mm", nozzle.wider_mm, error[2], length_mm, free),
        (
            "heading_zero_deg",
            heading,
            of_heading,
            HEADING_ERROR_RAD.to_degrees(),
            aslant,
        ),
    ];
    let known = if layer.aperture.is_round() { 3 } else { 4 };
    found.into_iter().take(known).map(estimate).collect()
}

/// What a pass lays between its samples, mm³, with the machine's advance, on material that lags.
fn arriving(pass: &Pass, extruder: &Extruder, lag_s: f64) -> Vec<f64> {
    let samples = &pass.samples;
    let last = samples.len() - 1;
    let asked: Vec<f64> = samples
        .windows(2)
        .map(|pair| pair[1].volume_mm3 - pair[0].volume_mm3)
        .collect();
    let flow = |at: isize| {
        usize::try_from(at)
            .ok()
            .and_then(|at| asked.get(at))
            .copied()
            .unwrap_or(0.0)
    };
    let half = (0.5 * extruder.window_s / SAMPLE_S).round().max(0.5);
    let share = 1.0 - (-SAMPLE_S / lag_s.max(1e-9)).exp();
    let mut arrives = 0.0;
    let each = (0..last as isize).map(|at| {
        let reach = half.ceil() as isize;
        let rate = (flow(at + reach) - flow(at - reach)) / (2.0 * reach as f64 * SAMPLE_S);
        arrives += share * (flow(at) + extruder.advance_s * rate - arrives);
        arrives
    });
    each.collect()
}

/// Volumes of the stations for a lag.
fn asked_volumes(layer: &Layer, extruder: &Extruder, lag_s: f64) -> Vec<f64> {
    let passes: Vec<Vec<f64>> = layer
        .passes
        .iter()
        .map(|pass| arriving(pass, extruder, lag_s))
        .collect();
    let of = |station: &Station| {
        passes[station.pass][station.samples[0]..station.samples[1]]
            .iter()
            .sum()
    };
    layer.stations.iter().map(of).collect()
}

/// What the volumes tell.
pub struct OfVolumes {
    /// Flow, lag, starts, stops.
    pub estimates: Vec<Estimate>,
    /// What each station should have for the flow and lag that were found, and by which factor it has more.
    pub asked_mm3: Vec<f64>,
}

/// Flow, lag, starts and stops from the volumes.
pub fn of_volumes(layer: &Layer, sections: &[Section], extruder: &Extruder) -> OfVolumes {
    let seen = |asked: &[f64], slopes: Option<&[f64]>, flow: f64| {
        let mut rows: Vec<Row<4>> = Vec::new();
        for (k, (station, section)) in layer.stations.iter().zip(sections).enumerate() {
            if let Some(volume_mm3) = section.volume_mm3.filter(|_| section.ground_mm2 > 0.0) {
                let unit = section.ground_mm2.sqrt();
                let [start, stop] = station.ends.map(|is| f64::from(is) / unit);
                let slope =
                    slopes.map_or(0.0, |slopes| flow * (slopes[k] - asked[k]) / 1e-3 / unit);
                rows.push(([asked[k] / unit, slope, start, stop], volume_mm3 / unit));
            }
        }
        rows
    };
    let most_mm3 = 20.0 * layer.aperture.area_mm2() * layer.height_mm;
    let prior = [10.0, LAG_MOST_S, most_mm3, most_mm3];
    let of_lag = |lag_s: f64| {
        let asked = asked_volumes(layer, extruder, lag_s);
        robust(&seen(&asked, None, 1.0), prior)
    };
    let scales = LAGS_S.map(|lag_s| (of_lag(lag_s).scale, lag_s));
    let least = scales.iter().min_by(|a, b| a.0.total_cmp(&b.0));
    let mut lag_s = least.map_or(0.0, |(_, lag_s)| *lag_s);
    let (mut fit, mut count) = (of_lag(lag_s), 0);
    let mut asked = Vec::new();
    for _ in 0..LAG_STEPS {
        asked = asked_volumes(layer, extruder, lag_s);
        let slopes = asked_volumes(layer, extruder, lag_s + 1e-3);
        let rows = seen(&asked, Some(&slopes), fit.value[0]);
        count = rows.len();
        fit = robust(&rows, prior);
        lag_s = (lag_s + fit.value[1]).clamp(0.0, LAG_MOST_S);
    }
    let (flow, flow_error) = flow_of(layer, sections, &asked);
    let volume_error_mm3 = 0.1 * layer.aperture.area_mm2() * layer.height_mm;
    let changes = "free beads on which the speed changes, or that start and stop";
    let ([_, _, start, stop], lag_most_s) = (fit.value, LAG_ERROR_S.max(0.05 * lag_s));
    let (starts, stops) = (
        "passes that begin with a prime",
        "passes that end with a retract",
    );
    let found: [Found; 4] = [
        (
            "flow_factor",
            flow,
            flow_error,
            FLOW_ERROR,
            "more of the layer",
        ),
        ("lag_s", lag_s, fit.error[1], lag_most_s, changes),
        ("start_mm3", start, fit.error[2], volume_error_mm3, starts),
        ("stop_mm3", stop, fit.error[3], volume_error_mm3, stops),
    ];
    let known = |of: Found| {
        if count < ROWS_LEAST {
            (of.0, of.1, f64::INFINITY, of.3, of.4)
        } else {
            of
        }
    };
    let estimates = found.map(known).map(estimate).to_vec();
    OfVolumes {
        estimates,
        asked_mm3: asked,
    }
}

/// Found of asked, and its standard error. What a bead lacks its neighbours have: sums over all, and scatter between tiles,
/// know more than the middle of the stations.
fn flow_of(layer: &Layer, sections: &[Section], asked_mm3: &[f64]) -> (f64, f64) {
    let tile_mm = TILE * layer.aperture.major_mm();
    let mut tiles: BTreeMap<[i32; 2], [f64; 2]> = BTreeMap::new();
    for ((station, section), asked) in layer.stations.iter().zip(sections).zip(asked_mm3) {
        if let Some(found) = section.volume_mm3.filter(|_| station.ends == [false; 2]) {
            let tile = [station.at_mm.x, station.at_mm.y].map(|x| (x / tile_mm).floor() as i32);
            let own = tiles.entry(tile).or_default();
            *own = [own[0] + found, own[1] + asked];
        }
    }
    let sum = |k: usize| tiles.values().map(|own| own[k]).sum::<f64>();
    let all = sum(1).max(f64::MIN_POSITIVE);
    let flow = sum(0) / all;
    let squares = tiles
        .values()
        .map(|[found, asked]| (found - flow * asked).powi(2));
    (flow, squares.sum::<f64>().sqrt() / all)
}

/// A range of flows, and by which factor what is laid is more than asked.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct FlowFactor {
    /// Middle flow of the range.
    pub flow_mm3_s: f64,
    /// Middle factor there.
    pub factor: f64,
    /// Stations of it.
    pub stations: usize,
}

/// Ranges of flows with as many stations each, at most `most`.
pub fn flow_factors(
    layer: &Layer,
    sections: &[Section],
    asked_mm3: &[f64],
    most: usize,
) -> Vec<FlowFactor> {
    let mut all: Vec<[f64; 2]> = Vec::new();
    for ((station, section), asked_mm3) in layer.stations.iter().zip(sections).zip(asked_mm3) {
        if let Some(volume_mm3) = section
            .volume_mm3
            .filter(|_| station.ends == [false; 2] && *asked_mm3 > 0.0)
        {
            all.push([asked_mm3 / station.seconds(), volume_mm3 / asked_mm3]);
        }
    }
    all.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let middle = |own: &[[f64; 2]], k: usize| median(own.iter().map(|row| row[k]).collect());
    let ranges = all.chunks(all.len().div_ceil(most).max(10));
    let ranges = ranges.map(|own| FlowFactor {
        flow_mm3_s: middle(own, 0),
        factor: middle(own, 1),
        stations: own.len(),
    });
    ranges.collect()
}
