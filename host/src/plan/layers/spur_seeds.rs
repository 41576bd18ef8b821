//! Spurs to ground that the optimiser left open: what it goes on from.
//!
//! An optimiser moves beads and does not make new ones: a corner that no bead comes near stays open. Here each
//! place that is still open gets a spur, straight out from the nearest bead and straight back. Whether it pays is
//! not asked: the optimiser goes on from there, and a spur that pays nothing shrinks to nothing.
//!
//! In: curves of the passes (mm, rad, log s), the walls. Out: the same with spurs. Only where the straight way of
//! the tip and the pose at its end lie inside: a spur through a wall leads a curve far outside.

use crate::geometry::aperture::Aperture;
use crate::geometry::clearance::Configuration;
use crate::geometry::coverage::{Cell, Coverage, SweptPose};
use crate::geometry::edge_index::EdgeIndex;
use crate::geometry::polygon::Box2;
use crate::geometry::{Point2, Vector2};
use crate::plan::coverage::raster::{CELL_SHARE, CELLS_MAX};
use crate::plan::curve::even_spans::{log_span_time, span_count};
use crate::plan::curve::plane_curve::{PlaneControl, configuration, curve_at};
use crate::plan::headings::profile::slide_inside;
use crate::plan::optimise::OptimisedPass;
use crate::plan::pass::sweep::swept;
use crate::plan::pose_limits::PoseLimits;

/// Least open place that gets a spur, against a b: 0.01 mm² for 0.6 x 0.2 mm, what a spur of the least length
/// pays for at the standard price.
const OPEN_SHARE_MIN: f64 = 1.0 / 12.0;
/// Poses of a span whose union is counted.
const POSES: usize = 4;
/// Beads from which a way to an open place is looked for.
const NEAREST: usize = 12;
/// Headings in which the aperture is tried at an open place.
const HEADINGS: usize = 8;
/// Slides off the walls there.
const SLIDES: usize = 8;
/// Least spans of a spur to either side: its end is to reach the place.
const SPANS_MIN: usize = 3;

/// A spur on its way into a pass.
struct Spur {
    pass: usize,
    /// The control point that it leaves from and comes back to.
    number: usize,
    end: PlaneControl,
}

/// Adds spurs to the passes; how many.
pub fn seed_spurs(
    passes: &mut [OptimisedPass],
    walls: &EdgeIndex,
    aperture: &Aperture,
    limits: &PoseLimits,
) -> usize {
    let mut spurs: Vec<Spur> = open_places(passes, walls, aperture)
        .into_iter()
        .filter_map(|place| spur_to(place, passes, walls, aperture))
        .collect();
    // From the last on, so that numbers before it stay.
    spurs.sort_by_key(|spur| std::cmp::Reverse((spur.pass, spur.number)));
    for spur in &spurs {
        add(&mut passes[spur.pass], spur, aperture, limits);
    }
    spurs.len()
}

/// The cell nearest to the middle of each open place that is large enough.
fn open_places(passes: &[OptimisedPass], walls: &EdgeIndex, aperture: &Aperture) -> Vec<Point2> {
    let mut poses = Vec::new();
    for (number, pass) in passes.iter().enumerate() {
        let spans = pass.control.len() - 1;
        let on_curve = (0..=spans * POSES).map(|k| {
            let span = (k / POSES).min(spans - 1);
            let t = k as f64 / POSES as f64 - span as f64;
            configuration(curve_at(&pass.control, span, t))
        });
        poses.extend(swept(on_curve, aperture).map(|at| SweptPose {
            at,
            pass: number as u32,
            path_mm: 0.0,
        }));
    }
    let cell_mm = CELL_SHARE * aperture.minor_mm();
    let raster = Coverage::sweep(walls, aperture, &poses, cell_mm, CELLS_MAX, f64::MAX);
    let least_mm2 = OPEN_SHARE_MIN * aperture.major_mm() * aperture.minor_mm();
    let least = (least_mm2 / raster.cell_mm.powi(2)).ceil() as usize;
    let mut is_new: Vec<bool> = raster.cells.iter().map(|cell| *cell == Cell::Gap).collect();
    let mut places = Vec::new();
    let mut place: Vec<usize> = Vec::new();
    for seed in 0..is_new.len() {
        if !is_new[seed] {
            continue;
        }
        connected(seed, raster.columns, &mut is_new, &mut place);
        if place.len() >= least.max(1) {
            places.push(middle_of(&place, &raster));
        }
    }
    places
}

/// The cells connected with `seed` that are new, which they no longer are then.
fn connected(seed: usize, columns: usize, is_new: &mut [bool], found: &mut Vec<usize>) {
    found.clear();
    found.push(seed);
    is_new[seed] = false;
    let mut head = 0;
    while head < found.len() {
        let at = found[head];
        head += 1;
        let column = at % columns;
        let around = [
            (column > 0).then(|| at - 1),
            (column + 1 < columns).then(|| at + 1),
            at.checked_sub(columns),
            Some(at + columns).filter(|&next| next < is_new.len()),
        ];
        for next in around.into_iter().flatten() {
            if std::mem::take(&mut is_new[next]) {
                found.push(next);
            }
        }
    }
}

fn middle_of(place: &[usize], raster: &Coverage) -> Point2 {
    let sum: Vector2 = place.iter().map(|&cell| raster.center(cell).coords).sum();
    let middle = Point2::from(sum / place.len() as f64);
    let far = |cell: &usize| (raster.center(*cell) - middle).norm_squared();
    let nearest = place.iter().min_by(|p, q| far(p).total_cmp(&far(q)));
    nearest.map_or(middle, |&cell| raster.center(cell))
}

/// The shortest spur to a place from the beads nearest to it, a turn counted as the way of the aperture's end.
fn spur_to(
    place: Point2,
    passes: &[OptimisedPass],
    walls: &EdgeIndex,
    aperture: &Aperture,
) -> Option<Spur> {
    let mut near: Vec<(f64, usize, usize)> = Vec::new();
    for (pass, of_pass) in passes.iter().enumerate() {
        // Ends stay as they are.
        for (number, at) in of_pass.control.iter().enumerate().skip(2) {
            if number + 2 < of_pass.control.len() {
                near.push(((at[0] - place.x).hypot(at[1] - place.y), pass, number));
            }
        }
    }
    let nearest = NEAREST.min(near.len());
    if nearest == 0 {
        return None;
    }
    near.select_nth_unstable_by(nearest - 1, |p, q| {
        p.0.total_cmp(&q.0).then(p.cmp_numbers(q))
    });
    near.truncate(nearest);
    near.sort_by(|p, q| p.0.total_cmp(&q.0).then(p.cmp_numbers(q)));
    let mut best: Option<(f64, Spur)> = None;
    for (_, pass, number) in near {
        let from = passes[pass].control[number];
        for end in ends_at(place, from, walls, aperture) {
            let way_mm = (end[0] - from[0]).hypot(end[1] - from[1]);
            let cost_mm = way_mm + aperture.major_mm() * (end[2] - from[2]).abs();
            let is_better = best.as_ref().is_none_or(|(best_mm, _)| cost_mm < *best_mm);
            if is_better && is_straight_inside(from, end, walls) {
                best = Some((cost_mm, Spur { pass, number, end }));
            }
        }
    }
    best.map(|(_, spur)| spur)
}

/// Of equals the one that comes first.
trait ByNumbers {
    fn cmp_numbers(&self, other: &Self) -> std::cmp::Ordering;
}

impl ByNumbers for (f64, usize, usize) {
    fn cmp_numbers(&self, other: &Self) -> std::cmp::Ordering {
        (self.1, self.2).cmp(&(other.1, other.2))
    }
}

/// Poses inside the walls that cover a place, the headings near that of `from`.
fn ends_at(
    place: Point2,
    from: PlaneControl,
    walls: &EdgeIndex,
    aperture: &Aperture,
) -> Vec<PlaneControl> {
    let period_rad = aperture.period_rad();
    let mut ends = Vec::new();
    for step in 0..HEADINGS {
        let turn_rad = period_rad * (step as f64 / HEADINGS as f64 - 0.5) + 1e-3;
        let at = Configuration {
            center: place,
            heading_rad: from[2] + turn_rad,
        };
        let slid = slide_inside(at, aperture, walls, SLIDES, 0.0);
        if let Some(at) = slid
            && covers(aperture, at, place)
        {
            ends.push([at.center.x, at.center.y, at.heading_rad]);
        }
    }
    ends
}

fn covers(aperture: &Aperture, at: Configuration, place: Point2) -> bool {
    let way = place - at.center;
    let (sin, cos) = at.heading_rad.sin_cos();
    let own = Vector2::new(way.x * cos + way.y * sin, way.y * cos - way.x * sin);
    (own.x / aperture.major_mm()).hypot(own.y / aperture.minor_mm()) <= 1.0
}

/// True where the tip crosses no wall on the straight way.
fn is_straight_inside(from: PlaneControl, to: PlaneControl, walls: &EdgeIndex) -> bool {
    let [a, b] = [from, to].map(|at| Point2::new(at[0], at[1]));
    let mut is_clear = walls.contains(a) && walls.contains(b);
    let side = |p: Point2, q: Point2, r: Point2| (q - p).perp(&(r - p));
    walls.for_edges_in(Box2::of(&[a, b]), |number| {
        let edge = &walls.edges()[number];
        let apart = |p, q, r, s| side(p, q, r) * side(p, q, s) <= 0.0;
        is_clear &= !(apart(a, b, edge.a, edge.b) && apart(edge.a, edge.b, a, b));
    });
    is_clear
}

/// Puts a spur into a pass behind its control point.
fn add(pass: &mut OptimisedPass, spur: &Spur, aperture: &Aperture, limits: &PoseLimits) {
    let from = pass.control[spur.number];
    let spans = span_count(from, spur.end, aperture).max(SPANS_MIN);
    let at = |share: f64| -> PlaneControl {
        std::array::from_fn(|c| from[c] + share * (spur.end[c] - from[c]))
    };
    let out = (1..=spans).map(|i| i as f64 / spans as f64);
    let shares: Vec<f64> = out.clone().chain(out.rev()).chain([0.0]).collect();
    let poses: Vec<PlaneControl> = shares.into_iter().map(at).collect();
    let log_pace = log_span_time(from, at(1.0 / spans as f64), limits);
    let after = spur.number + 1;
    pass.log_pace
        .splice(after..after, poses.iter().map(|_| log_pace));
    pass.control.splice(after..after, poses);
}
