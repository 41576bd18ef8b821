//! All layers curved: one smooth function by whose whole values the layers run from the flat bed to the tops.
//!
//! In: tops of the pieces over a grid (mm), the steepest slope. Out: f(x, y) by which layer n lies at n t f. With H the
//! greatest height and s = H (1 - 1/f) the function h = z - s z / H is a whole number of layers on a top, 0 on the bed,
//! and its level surfaces are the layers. s is the least of the squares of: what a top is off its whole layer; second
//! differences of s; s itself, a little. Thickness f within its bounds and the slope of s are targets that weigh more
//! each round they are broken (iteratively reweighted least squares); a round is one solution of a banded system.

use super::Job;
use super::top_grid::TopGrid;
use crate::geometry::Point2;
use crate::geometry::envelope::Envelope;
use crate::geometry::polygon::Box2;
use crate::geometry::spline_surface::SplineSurface;

/// Layers are this thick at least and at most, of the nominal height.
pub const THICKNESS: [f64; 2] = [0.5, 1.5];
/// Weights of second differences per mm and of s itself, against the tops' of 1.
const SMOOTH: f64 = 0.02;
const KEEP: f64 = 1e-3;
/// First weight of a target that is broken, and its growth each round.
const BROKEN: f64 = 3.0;
const GROWTH: f64 = 2.0;
/// Targets lie within the bounds by this share.
const WITHIN: f64 = 0.98;
/// Rounds: at least, at most; from the third one on places that cannot keep their piece's level take the nearest.
const ROUNDS: [usize; 2] = [3, 12];
/// Cells of the top's grid from one unknown to the next.
const EVERY: usize = 2;
/// How far the field goes on beyond the part, of the nozzle's half length.
const AROUND: f64 = 7.0;

/// Tops over the grid of the unknowns.
struct Nodes {
    grid: TopGrid,
    /// Number of the piece; none off the pieces.
    piece: Vec<Option<usize>>,
    /// Smooth height there, mm.
    top_mm: Vec<f64>,
}

/// Weights of targets so far.
struct Weights {
    slope: [Vec<f64>; 2],
    bound: Vec<f64>,
}

/// The thickness of layers by place, of the nominal one. `tops_mm` are the smooth heights of the cells, with their piece.
pub fn thickness(job: &Job, pieces: usize, tops: &[Option<(usize, f64)>]) -> SplineSurface {
    let nodes = Nodes::of(&job.grid, tops);
    let height_mm = job.grid.highest_mm();
    let s_mm = solved(&nodes, pieces, height_mm, job.layer_mm, job.slope_max());
    let points = (0..nodes.grid.z_mm.len()).map(|node| {
        let at = nodes.grid.place(node);
        let share = 1.0 / (1.0 - s_mm[node] / height_mm).max(1e-3);
        [at.x, at.y, share]
    });
    let points: Vec<[f64; 3]> = points.collect();
    let around_mm = AROUND * job.settings.aperture.major_mm();
    let corners: Vec<Point2> = points.iter().map(|p| Point2::new(p[0], p[1])).collect();
    let bounds = Box2::of(&corners).grown(around_mm);
    let pitch_mm = nodes.grid.step_mm;
    let fitted = SplineSurface::on_grid(&points, bounds, pitch_mm);
    fitted.unwrap_or_else(|| SplineSurface::level(bounds, pitch_mm))
}

impl Nodes {
    fn of(cells: &TopGrid, tops: &[Option<(usize, f64)>]) -> Nodes {
        let count = cells.count.map(|count| (count - 1).div_ceil(EVERY) + 1);
        let mut grid = TopGrid {
            low: cells.low,
            step_mm: EVERY as f64 * cells.step_mm,
            count,
            z_mm: Vec::new(),
        };
        let (mut piece, mut top_mm) = (Vec::new(), Vec::new());
        for node in 0..count[0] * count[1] {
            let (i, j) = (EVERY * (node % count[0]), EVERY * (node / count[0]));
            let is_inside = i < cells.count[0] && j < cells.count[1];
            let cell = is_inside.then_some(j * cells.count[0] + i);
            let top = cell.and_then(|cell| tops[cell]);
            grid.z_mm
                .push(cell.map_or(f64::NAN, |cell| cells.z_mm[cell]));
            piece.push(top.map(|(piece, _)| piece));
            top_mm.push(top.map_or(f64::NAN, |(_, top_mm)| top_mm));
        }
        Nodes {
            grid,
            piece,
            top_mm,
        }
    }

    fn count(&self) -> usize {
        self.piece.len()
    }

    /// The node beside one along an axis.
    fn next(&self, node: usize, axis: usize) -> Option<usize> {
        let [columns, rows] = self.grid.count;
        match axis {
            0 => (node % columns + 1 < columns).then_some(node + 1),
            _ => (node / columns + 1 < rows).then_some(node + columns),
        }
    }

    /// The slope of s at a node, where it has neighbours.
    fn slope(&self, s_mm: &[f64], node: usize) -> [f64; 2] {
        [0, 1].map(|axis| {
            let next = self.next(node, axis);
            next.map_or(0.0, |next| (s_mm[next] - s_mm[node]) / self.grid.step_mm)
        })
    }
}

fn solved(nodes: &Nodes, pieces: usize, height_mm: f64, layer_mm: f64, slope_max: f64) -> Vec<f64> {
    let mut s_mm = vec![0.0; nodes.count()];
    let mut weights = Weights {
        slope: [vec![0.0; nodes.count()], vec![0.0; nodes.count()]],
        bound: vec![0.0; nodes.count()],
    };
    // s / H at the bounds of 1 / (1 - s / H).
    let bounds_mm = THICKNESS.map(|share| WITHIN * height_mm * (1.0 - 1.0 / share));
    let slope_max = WITHIN * slope_max;
    for round in 0..ROUNDS[1] {
        let levels_mm = levels_mm(nodes, pieces, &s_mm, height_mm, layer_mm);
        let mut system = Envelope::banded(nodes.count(), 2 * nodes.grid.count[0]);
        for node in 0..nodes.count() {
            add_top(
                &mut system,
                nodes,
                node,
                (&s_mm, round),
                &levels_mm,
                [height_mm, layer_mm],
            );
            add_smoothness(&mut system, nodes, node);
        }
        let is_broken = add_targets(
            &mut system,
            nodes,
            &s_mm,
            &mut weights,
            bounds_mm,
            slope_max,
        );
        if round >= ROUNDS[0] && !is_broken {
            break;
        }
        s_mm = system.solved();
    }
    s_mm
}

/// The whole layer that the top of each piece is nearest to.
fn levels_mm(
    nodes: &Nodes,
    pieces: usize,
    s_mm: &[f64],
    height_mm: f64,
    layer_mm: f64,
) -> Vec<f64> {
    let mut sums = vec![[0.0; 2]; pieces];
    for (node, piece) in nodes.piece.iter().enumerate() {
        if let Some(piece) = *piece {
            let top_mm = nodes.top_mm[node];
            sums[piece][0] += top_mm - s_mm[node] * top_mm / height_mm;
            sums[piece][1] += 1.0;
        }
    }
    let whole =
        |[sum, count]: [f64; 2]| (sum / count.max(1.0) / layer_mm).round().max(1.0) * layer_mm;
    sums.into_iter().map(whole).collect()
}

fn add_top(
    system: &mut Envelope,
    nodes: &Nodes,
    node: usize,
    (s_mm, round): (&[f64], usize),
    levels_mm: &[f64],
    [height_mm, layer_mm]: [f64; 2],
) {
    let Some(piece) = nodes.piece[node] else {
        return;
    };
    let top_mm = nodes.top_mm[node];
    let now_mm = top_mm - s_mm[node] * top_mm / height_mm;
    let mut level_mm = levels_mm[piece];
    if round >= ROUNDS[0] && (now_mm - level_mm).abs() > 0.5 * layer_mm {
        level_mm = (now_mm / layer_mm).round().max(1.0) * layer_mm;
    }
    system.add_square(&[(node, top_mm / height_mm)], top_mm - level_mm, 1.0);
}

fn add_smoothness(system: &mut Envelope, nodes: &Nodes, node: usize) {
    let weight = (SMOOTH / nodes.grid.step_mm).powi(2);
    for axis in 0..2 {
        let next = nodes.next(node, axis);
        let after = next.and_then(|next| nodes.next(next, axis));
        if let (Some(next), Some(after)) = (next, after) {
            system.add_square(&[(node, 1.0), (next, -2.0), (after, 1.0)], 0.0, weight);
        }
    }
    system.add_square(&[(node, 1.0)], 0.0, KEEP * KEEP);
}

/// Adds the targets of slopes and thickness; true where some are broken now.
fn add_targets(
    system: &mut Envelope,
    nodes: &Nodes,
    s_mm: &[f64],
    weights: &mut Weights,
    bounds_mm: [f64; 2],
    slope_max: f64,
) -> bool {
    let mut is_broken = false;
    let per_mm = 1.0 / nodes.grid.step_mm;
    let heavier = |weight: f64| (GROWTH * weight).max(BROKEN);
    for node in 0..nodes.count() {
        let slope = nodes.slope(s_mm, node);
        let steep = slope[0].hypot(slope[1]);
        let share = (slope_max / steep.max(1e-12)).min(1.0);
        for (axis, slope) in slope.into_iter().enumerate() {
            let weight = &mut weights.slope[axis][node];
            if steep > slope_max {
                *weight = heavier(*weight);
                is_broken = true;
            }
            if let (Some(next), true) = (nodes.next(node, axis), *weight > 0.0) {
                let terms = [(node, -per_mm), (next, per_mm)];
                system.add_square(&terms, share * slope, weight.powi(2));
            }
        }
        let within_mm = s_mm[node].clamp(bounds_mm[0], bounds_mm[1]);
        let weight = &mut weights.bound[node];
        if within_mm != s_mm[node] {
            *weight = heavier(*weight);
            is_broken = true;
        }
        if *weight > 0.0 {
            system.add_square(&[(node, 1.0)], within_mm, weight.powi(2));
        }
    }
    is_broken
}
