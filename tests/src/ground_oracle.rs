//! What a stream lays on curved ground that is known by a formula: an evaluator of its own, which shares no code with
//! what it checks.
//!
//! The ground is a map from two parameters to space. Cells of 0.02 mm on it have their true area and a point on the
//! layer's top; poses are those of the wire's spline by de Boor's algorithm; a cell is covered where its point, in the
//! tool's frame, lies in the nozzle. Depth outside is measured at the boundary itself: at the short pieces of it that
//! the ellipse overhangs, and at corners that point inwards.

use crate::segment_oracle::Oracle;
use headway::Plan;
use headway::geometry::Point2;
use headway::geometry::polygon::Region;
use headway::job::MotionState;
use nalgebra::{Rotation3, Vector3};

pub type Vec3 = Vector3<f64>;

/// Ground by a formula.
pub struct Ground {
    /// Parameters -> place, mm.
    pub place: Box<dyn Fn(f64, f64) -> Vec3 + Sync>,
    /// Period of the first parameter, where the ground closes.
    pub period: Option<f64>,
}

impl Ground {
    pub fn new(place: impl Fn(f64, f64) -> Vec3 + Sync + 'static) -> Ground {
        Ground {
            place: Box::new(place),
            period: None,
        }
    }

    fn tangents(&self, u: f64, v: f64) -> [Vec3; 2] {
        let e = 1e-4;
        let place = &self.place;
        [
            (place(u + e, v) - place(u - e, v)) / (2.0 * e),
            (place(u, v + e) - place(u, v - e)) / (2.0 * e),
        ]
    }

    /// A place so far above the ground along its normal.
    pub fn above(&self, u: f64, v: f64, above_mm: f64) -> Vec3 {
        let [along, across] = self.tangents(u, v);
        (self.place)(u, v) + above_mm * along.cross(&across).normalize()
    }

    /// Area for one of the parameters, so far above.
    fn area(&self, u: f64, v: f64, above_mm: f64) -> f64 {
        let e = 1e-3;
        let at = |u: f64, v: f64| self.above(u, v, above_mm);
        let along = (at(u + e, v) - at(u - e, v)) / (2.0 * e);
        let across = (at(u, v + e) - at(u, v - e)) / (2.0 * e);
        along.cross(&across).norm()
    }
}

/// What lies on one layer.
#[derive(Clone, Copy, Debug, Default)]
pub struct Laid {
    pub area_mm2: f64,
    pub covered_pct: f64,
    pub twice_pct: f64,
    pub outside_pct: f64,
    pub depth_um: f64,
    pub print_mm: f64,
    pub print_s: f64,
    /// Volume by the wire over that of what is covered.
    pub volume_ratio: f64,
    pub passes: usize,
}

/// The nozzle's outline in its own plane, mm.
pub enum Nozzle {
    /// Semi-axes.
    Ellipse([f64; 2]),
    /// Corners of a convex polygon, counter-clockwise.
    Polygon(Vec<[f64; 2]>),
}

impl Nozzle {
    /// Nothing of it is farther from the tip.
    fn reach_mm(&self) -> f64 {
        match self {
            Nozzle::Ellipse([a, _]) => *a,
            Nozzle::Polygon(corners) => {
                corners.iter().map(|[x, y]| x.hypot(*y)).fold(0.0, f64::max)
            }
        }
    }

    /// Half of what it lays at most.
    fn half_mm(&self) -> f64 {
        match self {
            Nozzle::Ellipse([a, _]) => *a,
            Nozzle::Polygon(_) => {
                let turns = (0..180).map(|k| f64::from(k).to_radians());
                let widths = turns.map(|turn| {
                    let (sin, cos) = turn.sin_cos();
                    self.support([cos, sin]).0 + self.support([-cos, -sin]).0
                });
                0.5 * widths.fold(0.0, f64::max)
            }
        }
    }

    fn contains(&self, [x, y]: [f64; 2]) -> bool {
        match self {
            Nozzle::Ellipse([a, b]) => (x / a).powi(2) + (y / b).powi(2) <= 1.0,
            Nozzle::Polygon(corners) => (0..corners.len()).all(|k| {
                let ([px, py], [qx, qy]) = (corners[k], corners[(k + 1) % corners.len()]);
                (qx - px) * (y - py) - (qy - py) * (x - px) >= 0.0
            }),
        }
    }

    /// How far it reaches in a direction of length 1, and where.
    fn support(&self, [nx, ny]: [f64; 2]) -> (f64, [f64; 2]) {
        match self {
            Nozzle::Ellipse([a, b]) => {
                let far = (a * nx).hypot(b * ny);
                (far, [a * a * nx / far, b * b * ny / far])
            }
            Nozzle::Polygon(corners) => {
                let far = |corner: &[f64; 2]| corner[0] * nx + corner[1] * ny;
                let best = corners.iter().max_by(|p, q| far(p).total_cmp(&far(q)));
                let best = best.expect("there are corners");
                (far(best), *best)
            }
        }
    }
}

/// How to look.
pub struct Look {
    pub layer: u32,
    pub height_mm: f64,
    pub nozzle: Nozzle,
    pub cell_mm: f64,
}

impl Default for Look {
    fn default() -> Look {
        Look {
            layer: 0,
            height_mm: 0.2,
            nozzle: Nozzle::Ellipse([0.6, 0.2]),
            cell_mm: 0.02,
        }
    }
}

struct Pose {
    tip: Vec3,
    axes: [Vec3; 3],
    path_mm: f64,
}

struct Cells {
    count: [usize; 2],
    at: Vec<Vec3>,
    area_mm2: Vec<f64>,
    middle_mm2: Vec<f64>,
    inside: Vec<bool>,
}

/// Looks at a layer of a plan whose outline is a region in the ground's parameters.
pub fn laid(plan: &Plan, ground: &Ground, region: &Region, look: &Look) -> Laid {
    let (poses, mut laid) = poses(plan, look);
    let top_mm = look.height_mm * f64::from(look.layer + 1);
    let cells = cells(ground, region, top_mm, look);
    let mut last = vec![f64::NEG_INFINITY; cells.at.len()];
    let mut twice = vec![false; cells.at.len()];
    let mut near = None;
    let return_mm = 1.5 * look.nozzle.half_mm();
    for pose in &poses {
        let middle = nearest(&cells, pose.tip, near, ground.period.is_some());
        near = Some(middle);
        visit(
            &cells,
            pose,
            middle,
            &look.nozzle,
            ground.period.is_some(),
            |cell| {
                twice[cell] |= last[cell].is_finite() && pose.path_mm - last[cell] > return_mm;
                last[cell] = pose.path_mm;
            },
        );
    }
    let (mut covered, mut again, mut outside, mut volume) = (0.0, 0.0, 0.0, 0.0);
    for (cell, last) in last.iter().enumerate() {
        let (area, is_covered) = (cells.area_mm2[cell], last.is_finite());
        if is_covered {
            volume += look.height_mm * cells.middle_mm2[cell];
        }
        match (cells.inside[cell], is_covered) {
            (true, true) => covered += area,
            (false, true) => outside += area,
            _ => {}
        }
        if cells.inside[cell] {
            laid.area_mm2 += area;
            again += if twice[cell] { area } else { 0.0 };
        }
    }
    [laid.covered_pct, laid.twice_pct, laid.outside_pct] =
        [covered, again, outside].map(|part| 100.0 * part / laid.area_mm2);
    laid.volume_ratio /= volume;
    laid.depth_um = 1e3 * depth_mm(&poses, ground, region, top_mm, look);
    laid
}

/// Print poses of a layer no more than a servo tick apart, a quarter of that for sharp corners, which leave notches from
/// one to the next; their length, time and volume.
fn poses(plan: &Plan, look: &Look) -> (Vec<Pose>, Laid) {
    let per_tick = match look.nozzle {
        Nozzle::Ellipse(_) => 1,
        Nozzle::Polygon(_) => 4,
    };
    let oracle = Oracle::new(&plan.stream);
    let offset = Vec3::from(plan.transform.offset_mm);
    let mut found: Vec<Pose> = Vec::new();
    let mut laid = Laid::default();
    let (mut path_mm, mut pass) = (0.0, None);
    let marks = plan.stream.marks.iter();
    for mark in marks.filter(|mark| mark.state == MotionState::Print && mark.layer == look.layer) {
        let is_new = mark.pass != pass;
        if is_new {
            path_mm += 100.0;
            laid.passes += 1;
        }
        pass = mark.pass;
        let mut before: Option<Vec3> = None;
        let volume = |tick: u64| oracle.at(tick as f64, 0)[6];
        laid.volume_ratio += volume(mark.end_tick) - volume(mark.start_tick);
        laid.print_s += (mark.end_tick - mark.start_tick) as f64 / 2000.0;
        for step in per_tick * mark.start_tick..=per_tick * mark.end_tick {
            let pose = oracle.at(step as f64 / per_tick as f64, 0);
            let tilt = Rotation3::new(Vec3::new(pose[3], pose[4], 0.0));
            let turn = tilt * Rotation3::from_axis_angle(&Vec3::z_axis(), pose[5]);
            let tip = Vec3::new(pose[0], pose[1], pose[2]) - offset;
            let step_mm = before.map_or(0.0, |before| (tip - before).norm());
            path_mm += step_mm;
            laid.print_mm += step_mm;
            before = Some(tip);
            found.push(Pose {
                tip,
                axes: [Vec3::x(), Vec3::y(), Vec3::z()].map(|axis| turn * axis),
                path_mm,
            });
        }
    }
    (found, laid)
}

fn cells(ground: &Ground, region: &Region, top_mm: f64, look: &Look) -> Cells {
    let bounds = region.bounds();
    let middle = nalgebra::center(&bounds.min, &bounds.max);
    let scale = ground
        .tangents(middle.x, middle.y)
        .map(|along| along.norm());
    let mut step = scale.map(|scale| look.cell_mm / scale);
    let margin = scale.map(|scale| 1.0 / scale);
    let (mut low, mut high) = ([0.0; 2], [0.0; 2]);
    for k in 0..2 {
        low[k] = bounds.min[k] - margin[k] + 0.37 * step[k];
        high[k] = bounds.max[k] + margin[k];
    }
    let mut count = [0, 1].map(|k| ((high[k] - low[k]) / step[k]) as usize + 1);
    if let Some(period) = ground.period {
        low[0] = bounds.min.x;
        count[0] = (period / step[0]) as usize;
        step[0] = period / count[0] as f64;
    }
    let all = count[0] * count[1];
    let mut cells = Cells {
        count,
        at: Vec::with_capacity(all),
        area_mm2: Vec::with_capacity(all),
        middle_mm2: Vec::with_capacity(all),
        inside: Vec::with_capacity(all),
    };
    for j in 0..count[1] {
        for i in 0..count[0] {
            let [u, v] = [low[0] + step[0] * i as f64, low[1] + step[1] * j as f64];
            let one = step[0] * step[1];
            cells.at.push(ground.above(u, v, top_mm));
            cells.area_mm2.push(one * ground.area(u, v, top_mm));
            let half_mm = top_mm - 0.5 * look.height_mm;
            cells.middle_mm2.push(one * ground.area(u, v, half_mm));
            cells.inside.push(region.contains(Point2::new(u, v)));
        }
    }
    cells
}

/// The cell nearest to a tip: by looking at all of a coarse grid first, then from the one before.
fn nearest(cells: &Cells, tip: Vec3, near: Option<[usize; 2]>, wraps: bool) -> [usize; 2] {
    let [columns, rows] = cells.count;
    let away = |[i, j]: [usize; 2]| (cells.at[j * columns + i] - tip).norm_squared();
    let coarse = (0..columns)
        .step_by(10)
        .flat_map(|i| (0..rows).step_by(10).map(move |j| [i, j]));
    let begin = near.filter(|near| away(*near) < 4.0);
    let mut best = begin.unwrap_or_else(|| {
        let best = coarse.min_by(|a, b| away(*a).total_cmp(&away(*b)));
        best.expect("there are cells")
    });
    loop {
        let [i, j] = best;
        let left = if wraps {
            (i + columns - 1) % columns
        } else {
            i.saturating_sub(1)
        };
        let right = if wraps {
            (i + 1) % columns
        } else {
            (i + 1).min(columns - 1)
        };
        let beside = [
            [left, j],
            [right, j],
            [i, j.saturating_sub(1)],
            [i, (j + 1).min(rows - 1)],
        ];
        let next = beside
            .into_iter()
            .min_by(|a, b| away(*a).total_cmp(&away(*b)));
        match next.filter(|next| away(*next) < away(best)) {
            Some(next) => best = next,
            None => return best,
        }
    }
}

/// Calls for each cell in the nozzle of a pose.
fn visit(
    cells: &Cells,
    pose: &Pose,
    [i, j]: [usize; 2],
    nozzle: &Nozzle,
    wraps: bool,
    mut see: impl FnMut(usize),
) {
    let [columns, rows] = cells.count;
    let number = |i: usize, j: usize| j * columns + i;
    let beside = |p: usize, q: usize| (cells.at[p] - cells.at[q]).norm();
    let [i0, j0] = [i.min(columns - 2), j.min(rows - 2)];
    let here = number(i0, j0);
    let steps = [
        beside(here, number(i0 + 1, j0)),
        beside(here, number(i0, j0 + 1)),
    ];
    let reach = steps.map(|step| (1.25 * nozzle.reach_mm() / step).ceil() as i64 + 2);
    for dj in -reach[1]..=reach[1] {
        let row = j as i64 + dj;
        if row < 0 || row >= rows as i64 {
            continue;
        }
        for di in -reach[0]..=reach[0] {
            let column = i as i64 + di;
            let column = if wraps {
                column.rem_euclid(columns as i64)
            } else {
                column
            };
            if column < 0 || column >= columns as i64 {
                continue;
            }
            let cell = number(column as usize, row as usize);
            let off = cells.at[cell] - pose.tip;
            let seen = [pose.axes[0].dot(&off), pose.axes[1].dot(&off)];
            if nozzle.contains(seen) && pose.axes[2].dot(&off).abs() < 0.4 {
                see(cell);
            }
        }
    }
}

/// Length of the pieces into which the boundary is cut, mm.
const PIECE_MM: f64 = 0.02;

/// How far a nozzle leaves the region at most; corners that point inwards are looked at for ellipses only.
fn depth_mm(poses: &[Pose], ground: &Ground, region: &Region, top_mm: f64, look: &Look) -> f64 {
    let reach_mm = look.nozzle.reach_mm();
    // Pieces of the boundary on the layer, the inside to the left, in buckets of space.
    let mut pieces: Vec<[Vec3; 2]> = Vec::new();
    let mut inward: Vec<Vec3> = Vec::new();
    for ring in region.rings() {
        let count = ring.points.len();
        for k in 0..count {
            let [p, q] = [ring.points[k], ring.points[(k + 1) % count]];
            let on = |share: f64| {
                let at = p + share * (q - p);
                ground.above(at.x, at.y, top_mm)
            };
            let rough: f64 = (0..8)
                .map(|s| (on((f64::from(s) + 1.0) / 8.0) - on(f64::from(s) / 8.0)).norm())
                .sum();
            let steps = (rough / PIECE_MM).ceil().max(1.0) as usize;
            for s in 0..steps {
                pieces.push([
                    on(s as f64 / steps as f64),
                    on((s + 1) as f64 / steps as f64),
                ]);
            }
            let before = ring.points[(k + count - 1) % count];
            if (p - before).perp(&(q - p)) < -1e-9 {
                inward.push(on(0.0));
            }
        }
    }
    let bucket = |p: &Vec3| [0, 1, 2].map(|c| (p[c] / 1.0).floor() as i64);
    let mut buckets = std::collections::HashMap::<[i64; 3], Vec<usize>>::new();
    for (number, piece) in pieces.iter().enumerate() {
        buckets.entry(bucket(&piece[0])).or_default().push(number);
    }
    let mut deepest = 0.0f64;
    for pose in poses {
        let seen = |p: &Vec3| {
            let off = p - pose.tip;
            [0, 1, 2].map(|k| pose.axes[k].dot(&off))
        };
        let middle = bucket(&pose.tip);
        for offset in 0..27 {
            let key = [0, 1, 2].map(|c| middle[c] + offset / [1, 3, 9][c] % 3 - 1);
            for &number in buckets.get(&key).into_iter().flatten() {
                let [p, q] = pieces[number].each_ref().map(seen);
                if p[2].abs() > 0.4 || p[0].hypot(p[1]) > 1.2 * reach_mm {
                    continue;
                }
                let along = [q[0] - p[0], q[1] - p[1]];
                let length = along[0].hypot(along[1]);
                // Outwards is to the right.
                let normal = [along[1] / length, -along[0] / length];
                let (support, touch) = look.nozzle.support(normal);
                let share = ((touch[0] - p[0]) * along[0] + (touch[1] - p[1]) * along[1]) / length;
                if (-1e-9..=length).contains(&share) {
                    deepest = deepest.max(support - normal[0] * p[0] - normal[1] * p[1]);
                }
            }
        }
        let Nozzle::Ellipse([a, b]) = look.nozzle else {
            assert!(inward.is_empty(), "corners that point inwards");
            continue;
        };
        for corner in &inward {
            let [x, y, z] = seen(corner);
            let share = (x / a).hypot(y / b);
            if share < 1.0 && z.abs() < 0.4 && share > 0.2 {
                // From the corner out to the ellipse along its normal.
                let normal = [x / (a * a), y / (b * b)];
                let size = normal[0].hypot(normal[1]);
                let support = (a * normal[0] / size).hypot(b * normal[1] / size);
                deepest = deepest.max((1.0 - share) * support);
            }
        }
    }
    deepest
}
