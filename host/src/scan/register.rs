//! Where a scan lies on the job: levelled by the bed, turned and moved onto the layer, the bed's warp taken off.
//!
//! In: points, the layer's raster. Out: the same points in the job's coordinates, heights above the bed, and how they fit.
//! Levelling by expectiles (Newey and Powell, 1987), so that the bed counts and not what lies on it; the turn by a search over
//! all of them on signed distances from the layer's edge; then least squares. Refused: what fits no better than another job,
//! or mirrored.

use super::cloud::{Cloud, Point};
use super::edges::{self, Edges, Motion, place};
use super::fit::{Row, median, robust};
use super::ground::Ground;
use super::layer::Layer;
use crate::geometry::Vector2;
use crate::text::refusal::{Refusal, refusal};
use nalgebra::{Rotation3, Vector3};
use serde::Serialize;
use std::f64::consts::TAU;

/// Points that the search looks at, on the layer and beside it.
const LOOKED_AT: usize = 400;
/// Points for the plane and for least squares.
const FITTED: usize = 3_000;
/// Turns that are tried: every 3 degrees, finer than what attracts.
const TURNS: usize = 120;
/// Places of the best turns that are followed.
const FOLLOWED: usize = 24;
/// Of these, whose neighbours are looked at.
const SHIFTED: usize = 8;
/// Most steps to each side in which beads are told from their neighbours.
const SHIFTS: f64 = 12.0;
/// Turns as near as this are one.
const SAME_TURN_RAD: f64 = 0.04;
/// Least agreement of a scan with its own job: 1 is every point on its side of the edge, 0 is none better than chance.
const FIT_LEAST: f64 = 0.8;
/// Least share of the layer that is seen.
const SEEN_LEAST: f64 = 0.7;
/// Greatest noise against the layer's height.
const NOISE_MOST: f64 = 0.4;

/// How a scan lies and fits.
#[derive(Clone, Debug, Serialize)]
pub struct Registration {
    /// By how much the scan was turned about the vertical.
    pub turn_deg: f64,
    /// And then moved.
    pub shift_mm: [f64; 2],
    /// Slope of the bed in the scan.
    pub tilt_deg: f64,
    /// What the bed rises and falls beyond its plane under the layer.
    pub warp_mm: f64,
    /// Standard deviation of the points on the bed.
    pub noise_mm: f64,
    /// Share of the layer that is seen.
    pub seen_pct: f64,
    /// Agreement with the layer: 100 is every point on its side of the edge.
    pub fit_pct: f64,
    /// Other turns that fit as well, degrees: the layer's outline is symmetric.
    pub other_turns_deg: Vec<f64>,
}

/// Every n-th, so that at most as many are left.
fn thinned<T: Copy>(all: &[T], most: usize) -> Vec<T> {
    let step = all.len().div_ceil(most).max(1);
    all.iter().step_by(step).copied().collect()
}

/// Moves the points onto the job.
///
/// # Errors
/// A `Refusal` that says what is missing.
pub fn register(
    points: &mut [Point],
    first_mm: [f64; 3],
    layer: &Layer,
    ground: &Ground,
) -> Result<(Registration, Edges), Refusal> {
    let tilt_rad = level(points, layer.height_mm);
    let top_mm = layer.top_mm();
    let is_above = |point: &Point| f64::from(point[2]) > 0.5 * top_mm;
    let above: Vec<Vector2> = points.iter().filter(|p| is_above(p)).map(place).collect();
    if above.len() < 100 {
        return Err(refusal!(
            "only {} points of the scan are more than {:.3} mm above its bed: scan the print with bed around it",
            above.len(),
            0.5 * top_mm
        ));
    }
    let (low, high) = above.iter().fold((above[0], above[0]), |(low, high), p| {
        (low.inf(p), high.sup(p))
    });
    let near = |p: &Vector2| {
        *p == p
            .sup(&low.add_scalar(-2.0 * ground.margin_mm))
            .inf(&high.add_scalar(2.0 * ground.margin_mm))
    };
    let below: Vec<Vector2> = points
        .iter()
        .filter(|p| !is_above(p))
        .map(place)
        .filter(near)
        .collect();
    let looks = Looks {
        above: thinned(&above, LOOKED_AT),
        below: thinned(&below, LOOKED_AT),
        ground,
    };
    let mirrored = |all: &[Vector2]| all.iter().map(|p| Vector2::new(-p.x, p.y)).collect();
    let other = Looks {
        above: mirrored(&looks.above),
        below: mirrored(&looks.below),
        ground,
    };
    let (found, other_turns_deg, score) = looks.best();
    let (turned_round, _, mirrored_score) = other.best();
    if mirrored_score > score + 0.1 && is_mirrored(points, &turned_round, layer, ground) {
        return Err(refusal!(
            "the scan is mirrored: it fits the job only with one axis turned round; write it with x to the right and y away"
        ));
    }
    for point in points.iter_mut() {
        let at = found.of(place(point));
        (point[0], point[1]) = (at.x as f32, at.y as f32);
    }
    let (warp_mm, noise_mm) = unwarp(points, layer, ground)?;
    let [fit, seen] = agreement(points, layer, ground);
    fits(fit, seen, noise_mm, layer)?;
    let edges = edges::fitted(points, layer)?;
    let first_mm = -Vector2::new(first_mm[0], first_mm[1]);
    let shift_mm = edges.motion.of(found.of(first_mm));
    let registration = Registration {
        turn_deg: wrapped(found.turn_rad + edges.motion.turn_rad).to_degrees(),
        shift_mm: shift_mm.into(),
        tilt_deg: tilt_rad.to_degrees(),
        warp_mm,
        noise_mm,
        seen_pct: 100.0 * seen,
        fit_pct: 100.0 * fit,
        other_turns_deg,
    };
    Ok((registration, edges))
}

/// Whether the scan with x turned round is one of the layer, and not of any other.
fn is_mirrored(points: &[Point], motion: &Motion, layer: &Layer, ground: &Ground) -> bool {
    let mirrored = points.iter().map(|point| {
        let p = place(point);
        let at = motion.of(Vector2::new(-p.x, p.y));
        [at.x as f32, at.y as f32, point[2]]
    });
    agreement(&mirrored.collect::<Vec<Point>>(), layer, ground)[0] >= FIT_LEAST
}

/// Refuses what is no scan of the layer, or too little of one.
fn fits(fit: f64, seen: f64, noise_mm: f64, layer: &Layer) -> Result<(), Refusal> {
    if fit < FIT_LEAST {
        return Err(refusal!(
            "the scan does not fit the layer of the job ({:.0} % agreement, {:.0} % are needed): is it of another job or layer (--layer)?",
            100.0 * fit,
            100.0 * FIT_LEAST
        ));
    }
    if seen < SEEN_LEAST {
        return Err(refusal!(
            "only {:.0} % of the layer is in the scan, {:.0} % are needed: scan more of it",
            100.0 * seen,
            100.0 * SEEN_LEAST
        ));
    }
    if noise_mm > NOISE_MOST * layer.height_mm {
        return Err(refusal!(
            "points on the bed scatter by {noise_mm:.3} mm, too much for a layer of {:.3} mm: scan with less noise",
            layer.height_mm
        ));
    }
    Ok(())
}

/// Makes the bed z = 0; its slope, rad.
fn level(points: &mut [Point], height_mm: f64) -> f64 {
    let looked = thinned(points, FITTED);
    let count = looked.len() as f64;
    let mean = looked.iter().fold(Vector3::zeros(), |sum, p| {
        sum + Vector3::from(p.map(f64::from)) / count
    });
    // z = a x + b y + c about the mean.
    let mut plane = Vector3::zeros();
    for round in 0..40 {
        let (mut normal, mut right) = (
            nalgebra::Matrix3::<f64>::identity() * 1e-9,
            Vector3::zeros(),
        );
        for point in &looked {
            let p = Vector3::from(point.map(f64::from)) - mean;
            let columns = Vector3::new(p.x, p.y, 1.0);
            let off = p.z - columns.dot(&plane);
            let weight = match round {
                0 => 1.0,
                // Far below the bed is nothing.
                1..20 => {
                    (if off > 0.0 { 0.03 } else { 1.0 })
                        * (height_mm / off.abs().max(1e-9)).min(1.0)
                }
                _ => (1.0 - (off / (0.5 * height_mm)).powi(2)).max(0.0).powi(2),
            };
            normal += weight * columns * columns.transpose();
            right += weight * p.z * columns;
        }
        plane = normal
            .cholesky()
            .map_or(plane, |factors| factors.solve(&right));
    }
    let normal = Vector3::new(-plane.x, -plane.y, 1.0).normalize();
    let upright = Rotation3::rotation_between(&normal, &Vector3::z()).unwrap_or_default();
    let on_plane = mean + Vector3::new(0.0, 0.0, plane.z);
    for point in points {
        let p = upright * (Vector3::from(point.map(f64::from)) - on_plane) + on_plane;
        *point = [p.x as f32, p.y as f32, (p.z - on_plane.z) as f32];
    }
    normal.z.clamp(-1.0, 1.0).acos()
}

/// A few points of the scan, above half of the layer and below.
struct Looks<'a> {
    above: Vec<Vector2>,
    below: Vec<Vector2>,
    ground: &'a Ground,
}

impl Looks<'_> {
    /// From -2 to 2, the points' distances from the edge counting up to `within_mm`.
    fn score(&self, motion: &Motion, within_mm: f64) -> f64 {
        let mean = |points: &[Vector2]| {
            let distances = points.iter().map(|p| self.ground.near_mm(motion.of(*p)));
            let sum: f64 = distances.map(|d| (d / within_mm).clamp(-1.0, 1.0)).sum();
            sum / points.len().max(1) as f64
        };
        mean(&self.above) - mean(&self.below)
    }

    /// The best of shifts on a grid to both sides.
    fn best_shift(&self, from: &Motion, steps: i32, step_mm: f64, within_mm: f64) -> (f64, Motion) {
        let mut best = (f64::NEG_INFINITY, *from);
        for (x, y) in (-steps..=steps).flat_map(|x| (-steps..=steps).map(move |y| (x, y))) {
            let motion = from.by(0.0, Vector2::new(f64::from(x), f64::from(y)) * step_mm);
            let score = self.score(&motion, within_mm);
            if score > best.0 {
                best = (score, motion);
            }
        }
        best
    }

    /// The best motion, other turns that are as good, the score.
    fn best(&self) -> (Motion, Vec<f64>, f64) {
        let ground = self.ground;
        let cells = (0..ground.distance_mm.len()).step_by(7);
        let covered = cells.filter(|cell| ground.distance_mm[*cell] > 0.0);
        let covered: Vec<Vector2> = covered.map(|cell| ground.middle(cell)).collect();
        let middle = |all: &[Vector2]| all.iter().sum::<Vector2>() / all.len().max(1) as f64;
        let (from_mm, to_mm) = (middle(&self.above), middle(&covered));
        let squares = covered.iter().map(|p| (p - to_mm).norm_squared());
        let spread_mm = (squares.sum::<f64>() / covered.len().max(1) as f64).sqrt();
        let (wide_mm, near_mm) = (0.1 * spread_mm, 1.5 * ground.margin_mm);
        let few = Looks {
            above: thinned(&self.above, LOOKED_AT / 3),
            below: thinned(&self.below, LOOKED_AT / 3),
            ground,
        };
        let at_turn = |turn: usize| {
            let turn_rad = TAU * turn as f64 / TURNS as f64;
            few.best_shift(
                &Motion {
                    turn_rad,
                    from_mm,
                    to_mm,
                },
                1,
                1.5 * wide_mm,
                wide_mm,
            )
        };
        let all: Vec<(f64, Motion)> = (0..TURNS).map(at_turn).collect();
        let is_peak = |k: &usize| {
            [k + 1, k + TURNS - 1]
                .iter()
                .all(|beside| all[*k].0 >= all[beside % TURNS].0)
        };
        let mut found: Vec<(f64, Motion)> = (0..TURNS).filter(is_peak).map(|k| all[k]).collect();
        found.sort_by(|a, b| b.0.total_cmp(&a.0));
        found.truncate(FOLLOWED);
        for (score, motion) in &mut found {
            (*score, *motion) = self.followed(*motion, wide_mm, spread_mm);
        }
        found.sort_by(|a, b| b.0.total_cmp(&a.0));
        found.truncate(SHIFTED);
        for (score, motion) in &mut found {
            // Beads side by side attract the wrong ones: all points decide.
            let steps = (2.0 * wide_mm / near_mm).ceil().min(SHIFTS);
            let (_, shifted) = self.best_shift(motion, steps as i32, near_mm, near_mm);
            (*score, *motion) = self.followed(shifted, near_mm, spread_mm);
        }
        // The best of each turn, then the least of the turns that are as good.
        found.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut apart: Vec<(f64, Motion)> = Vec::new();
        for own in found {
            let is_same = |other: &(f64, Motion)| {
                wrapped(own.1.turn_rad - other.1.turn_rad).abs() < SAME_TURN_RAD
            };
            if !apart.iter().any(is_same) {
                apart.push(own);
            }
        }
        let score = apart.first().map_or(f64::NEG_INFINITY, |own| own.0);
        apart.retain(|(own, _)| *own > score - 0.05);
        let turn = |motion: &Motion| wrapped(motion.turn_rad);
        apart.sort_by(|a, b| turn(&a.1).abs().total_cmp(&turn(&b.1).abs()));
        let best = apart.first().map_or(all[0].1, |(_, motion)| *motion);
        let others = apart
            .iter()
            .skip(1)
            .map(|(_, other)| turn(other).to_degrees());
        (best, others.collect(), score)
    }

    /// Uphill in ever smaller steps.
    fn followed(&self, mut at: Motion, mut step_mm: f64, radius_mm: f64) -> (f64, Motion) {
        let mut score = 0.0;
        while step_mm > 0.1 * self.ground.margin_mm {
            let within_mm = step_mm.max(self.ground.margin_mm);
            score = self.score(&at, within_mm);
            for _ in 0..8 {
                let before = at;
                for by in [step_mm, -step_mm] {
                    let next = [(by / radius_mm, 0.0, 0.0), (0.0, by, 0.0), (0.0, 0.0, by)];
                    for (turn_rad, x, y) in next {
                        let next = at.by(turn_rad, Vector2::new(x, y));
                        let new = self.score(&next, within_mm);
                        if new > score {
                            (score, at) = (new, next);
                        }
                    }
                }
                if at == before {
                    break;
                }
            }
            step_mm *= 0.5;
        }
        (score, at)
    }
}

fn wrapped(turn_rad: f64) -> f64 {
    turn_rad - (turn_rad / TAU).round() * TAU
}

/// Takes off what the bed beside the layer is beyond its plane; how much that is under the layer, and the noise, mm.
fn unwarp(points: &mut [Point], layer: &Layer, ground: &Ground) -> Result<(f64, f64), Refusal> {
    let size = Vector2::new(ground.size[0] as f64, ground.size[1] as f64) * (0.5 * ground.cell_mm);
    let (middle, unit) = (ground.low_mm + size, size.norm());
    let columns = |point: &Point| {
        let [x, y] = [
            (f64::from(point[0]) - middle.x) / unit,
            (f64::from(point[1]) - middle.y) / unit,
        ];
        [1.0, x, y, x * x, x * y, y * y]
    };
    let is_near = |p: &Point| (place(p) - middle).norm() < 1.5 * unit;
    let is_bed = |p: &&Point| ground.near_mm(place(p)) < -2.0 * ground.margin_mm && is_near(p);
    let bed: Vec<Point> = points
        .iter()
        .filter(is_bed)
        .filter(|p| f64::from(p[2].abs()) < 0.5 * layer.top_mm().max(layer.height_mm))
        .copied()
        .collect();
    if bed.len() < 200 {
        return Err(refusal!(
            "only {} points of the scan are on the bed beside the layer: scan a rim of bed with it",
            bed.len()
        ));
    }
    // All of them, as means of squares: the bed's height decides over a flow's thousandths.
    let mut squares = Cloud::new(4.0 * ground.margin_mm);
    for point in &bed {
        squares.add(point.map(f64::from))?;
    }
    let (squares, from) = squares.into_points()?;
    let squares = squares
        .iter()
        .map(|p| [0, 1, 2].map(|k| (f64::from(p[k]) + from[k]) as f32));
    let rows: Vec<Row<6>> = squares.map(|p| (columns(&p), f64::from(p[2]))).collect();
    let fit = robust(&rows, [1e3; 6]);
    let bed_mm = |p: &Point| {
        columns(p)
            .iter()
            .zip(&fit.value)
            .map(|(a, b)| a * b)
            .sum::<f64>()
    };
    let mut warp = [f64::INFINITY, f64::NEG_INFINITY];
    for point in points.iter_mut() {
        if ground.near_mm(place(point)) > 0.0 {
            let [_, _, _, xx, xy, yy] = columns(point);
            let bent = fit.value[3] * xx + fit.value[4] * xy + fit.value[5] * yy;
            warp = [warp[0].min(bent), warp[1].max(bent)];
        }
        point[2] -= bed_mm(point) as f32;
    }
    let off = thinned(&bed, FITTED)
        .into_iter()
        .map(|p| (f64::from(p[2]) - bed_mm(&p)).abs());
    Ok(((warp[1] - warp[0]).max(0.0), 1.4826 * median(off.collect())))
}

/// Agreement of the points with the layer, and the share of it that is seen.
fn agreement(points: &[Point], layer: &Layer, ground: &Ground) -> [f64; 2] {
    let (mut on, mut beside) = ([0u32; 2], [0u32; 2]);
    let cells = 4.0;
    let columns = (ground.size[0] as f64 / cells) as usize + 1;
    let rows = (ground.size[1] as f64 / cells) as usize + 1;
    let mut seen = vec![false; columns * rows];
    let coarse = |cell: usize| {
        (cell / ground.size[0]) / cells as usize * columns
            + (cell % ground.size[0]) / cells as usize
    };
    for point in points {
        let Some(cell) = ground.cell(place(point)) else {
            continue;
        };
        seen[coarse(cell)] = true;
        let distance_mm = f64::from(ground.distance_mm[cell]);
        let is_above = f64::from(point[2]) > layer.base_mm + 0.4 * layer.height_mm;
        if distance_mm > 0.5 * ground.margin_mm {
            on[usize::from(is_above)] += 1;
        } else if (-20.0..-0.5).contains(&(distance_mm / ground.margin_mm)) {
            beside[usize::from(is_above)] += 1;
        }
    }
    let share = |[below, above]: [u32; 2]| f64::from(above) / f64::from((above + below).max(1));
    let covered = (0..ground.distance_mm.len()).filter(|cell| ground.distance_mm[*cell] > 0.0);
    let (mut all, mut met) = (0u32, 0u32);
    for cell in covered {
        all += 1;
        met += u32::from(seen[coarse(cell)]);
    }
    [
        share(on) - share(beside),
        f64::from(met) / f64::from(all.max(1)),
    ]
}

/// Middle height of the points over the layer, mm: which layer it may be.
pub fn seen_height_mm(points: &[Point], ground: &Ground) -> f64 {
    let over = points
        .iter()
        .filter(|p| ground.near_mm(place(p)) > 0.5 * ground.margin_mm);
    median(over.map(|p| f64::from(p[2])).collect())
}
