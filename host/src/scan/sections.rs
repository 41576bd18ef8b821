//! The volume on each station's ground.
//!
//! In: registered points, a layer and its raster. Out: a [`Section`] for each station: mean heights by distance from the edge,
//! times the cells there, so that neither gaps of the scan nor steep edges count.

use super::cloud::Point;
use super::ground::Ground;
use super::layer::Layer;
use crate::geometry::Vector2;

/// Strips along the edge in which a station's mean heights are taken.
const STRIPS: usize = 24;
/// Heights of a layer from which a point is no part of it.
const FAR: f64 = 10.0;
/// Least points of a station.
const POINTS: u32 = 30;
/// Least share of a station's ground that has points.
const SEEN_LEAST: f64 = 0.75;

/// What is found at a station.
#[derive(Clone, Copy, Debug, Default)]
pub struct Section {
    /// Volume on its ground and beside it, mm³; `None` where too little is seen.
    pub volume_mm3: Option<f64>,
    /// Ground that it covers first, mm².
    pub ground_mm2: f64,
}

/// Cells, points, sum of their heights.
type Strip = (u32, u32, f64);

/// The sections of a layer, in the order of its stations.
pub fn sections(points: &[Point], layer: &Layer, ground: &Ground) -> Vec<Section> {
    let mut tallies = vec![[Strip::default(); STRIPS]; layer.stations.len()];
    let mut covered = vec![0u32; layer.stations.len()];
    let reach_mm = 1.3 * ground.margin_mm;
    let strip = |distance_mm: f64| {
        let share = (distance_mm + reach_mm) / (2.0 * reach_mm);
        (share * STRIPS as f64).clamp(0.0, STRIPS as f64 - 1.0) as usize
    };
    for cell in 0..ground.distance_mm.len() {
        if let Some((number, covers)) = ground.owner(cell) {
            covered[number] += u32::from(covers);
            tallies[number][strip(f64::from(ground.distance_mm[cell]))].0 += 1;
        }
    }
    for point in points {
        let [x, y, z] = point.map(f64::from);
        let (at, above_mm) = (Vector2::new(x, y), z - layer.base_mm);
        // What is far from any layer was not measured on it; below a layer there may be the bed.
        if above_mm > FAR * layer.height_mm || z < -layer.height_mm {
            continue;
        }
        let least_mm = if layer.base_mm > 0.0 {
            0.0
        } else {
            f64::NEG_INFINITY
        };
        let owner = ground
            .cell(at)
            .and_then(|cell| Some((cell, ground.owner(cell)?.0)));
        if let Some((cell, number)) = owner {
            let own = &mut tallies[number][strip(f64::from(ground.distance_mm[cell]))];
            own.1 += 1;
            own.2 += above_mm.max(least_mm);
        }
    }
    let cell_mm2 = ground.cell_mm.powi(2);
    let section = |(strips, covered): (&[Strip; STRIPS], u32)| {
        let (mut seen, mut cells, mut points, mut volume_mm3) = (0, 0, 0, 0.0);
        for (own, met, sum_mm) in strips {
            cells += own;
            points += met;
            if *met > 0 {
                seen += own;
                volume_mm3 += f64::from(*own) * cell_mm2 * sum_mm / f64::from(*met);
            }
        }
        let is_seen = points >= POINTS && f64::from(seen) >= SEEN_LEAST * f64::from(cells);
        Section {
            volume_mm3: is_seen.then(|| volume_mm3 * f64::from(cells) / f64::from(seen.max(1))),
            ground_mm2: f64::from(covered) * cell_mm2,
        }
    };
    tallies.iter().zip(covered).map(section).collect()
}
