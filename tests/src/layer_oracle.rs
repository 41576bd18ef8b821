//! An oracle for what a stream leaves on a layer: coverage, overlap and outside depth of any
//! aperture, from the knots alone.
//!
//! Shares no code with the planner: the spline by de Boor's recursion on the knot vector as the
//! wire contract states it, containment by ray casting, the ellipse by its equation, other
//! apertures by distances to their corner points, overlap by the wording of the specification.

use headway::job::{MotionState, SegmentStream};
use headway_protocol::segment::REST_TICKS;

/// A polygon with holes: rings of points, mm.
pub type Rings = Vec<Vec<[f64; 2]>>;

/// What the oracle found.
#[derive(Clone, Copy, Debug)]
pub struct LayerFindings {
    /// Area by cells, mm².
    pub area_mm2: f64,
    /// Share of the area swept.
    pub covered_pct: f64,
    /// Share swept by two passes, or left and swept again more than 1.5a of path later.
    pub overlap_pct: f64,
    /// How far any outline point of any placement lies outside, mm.
    pub outside_depth_mm: f64,
}

/// A pose of the aperture.
#[derive(Clone, Copy, Debug)]
pub struct OraclePose {
    /// Centre and heading in the input's coordinates.
    pub x_mm: f64,
    /// See `x_mm`.
    pub y_mm: f64,
    /// Heading.
    pub heading_rad: f64,
    /// Pass.
    pub pass: u32,
    /// Layer, from 0.
    pub layer: u32,
    /// Path within the pass.
    pub path_mm: f64,
}

/// Control points (mm, rad; x, y, heading only) with the knot times in ticks.
struct Curve {
    control: Vec<[f64; 3]>,
    times: Vec<f64>,
}

impl Curve {
    /// P_{-3}.. and the knot vector of the stream: times[i] and control[i] in de Boor's numbering,
    /// so that span n runs from times[n + 3] and uses control[n..n + 4].
    fn of(stream: &SegmentStream) -> Curve {
        let units = stream.units;
        let length = 2f64.powi(i32::from(units.length_exponent));
        let angle = 2f64.powi(i32::from(units.angle_exponent));
        let natural = |c: &[i32; 7]| {
            [
                f64::from(c[0]) / 1e4 * length,
                f64::from(c[1]) / 1e4 * length,
                f64::from(c[5]) / 1e6 * angle,
            ]
        };
        let mut control = vec![natural(&stream.start); 3];
        control.extend(stream.knots.iter().map(|k| natural(&k.control)));
        // Durations of spans -2, -1, 0, 1 are given; knot n brings that of span n + 2. One more
        // virtual span in front gives de Boor's first knot, whose value has no influence.
        let mut durations = vec![f64::from(REST_TICKS); 5];
        durations.extend(stream.knots.iter().map(|k| f64::from(k.duration_ticks)));
        let mut times = vec![-3.0 * f64::from(REST_TICKS)];
        for duration in durations {
            times.push(times[times.len() - 1] + duration);
        }
        Curve { control, times }
    }

    /// De Boor's recursion in span `n` at time `t`.
    fn at(&self, n: usize, t: f64) -> [f64; 3] {
        let mut d = [
            self.control[n],
            self.control[n + 1],
            self.control[n + 2],
            self.control[n + 3],
        ];
        for level in 1..=3 {
            for j in (level..=3).rev() {
                let low = self.times[n + j];
                let high = self.times[n + j + 4 - level];
                let share = (t - low) / (high - low);
                let before = d[j - 1];
                for (own, low) in d[j].iter_mut().zip(before) {
                    *own = low * (1.0 - share) + *own * share;
                }
            }
        }
        d[3]
    }
}

/// Print poses of the stream at most `step_mm` and 0.02 rad apart, shifted by `-offset_mm`.
pub fn print_poses(stream: &SegmentStream, offset_mm: [f64; 2], step_mm: f64) -> Vec<OraclePose> {
    let curve = Curve::of(stream);
    let mut poses = Vec::new();
    let mut path_mm = 0.0;
    let mut last: Option<([f64; 3], u32)> = None;
    for n in 0..stream.knots.len() {
        let (from, to) = (curve.times[n + 3], curve.times[n + 4]);
        let begun = stream
            .marks
            .partition_point(|m| m.start_tick as f64 <= from);
        let Some(mark) = begun.checked_sub(1).map(|number| &stream.marks[number]) else {
            continue;
        };
        let (MotionState::Print, Some(pass)) = (mark.state, mark.pass) else {
            continue;
        };
        let (p, m, q) = (
            curve.at(n, from),
            curve.at(n, 0.5 * (from + to)),
            curve.at(n, to),
        );
        let length = (m[0] - p[0]).hypot(m[1] - p[1]) + (q[0] - m[0]).hypot(q[1] - m[1]);
        let turn = (m[2] - p[2]).abs() + (q[2] - m[2]).abs();
        let steps = (length / step_mm).max(turn / 0.02).ceil().max(1.0) as usize;
        for step in 0..steps {
            let at = curve.at(n, from + (to - from) * step as f64 / steps as f64);
            match last {
                Some((l, number)) if number == pass => {
                    path_mm += (at[0] - l[0]).hypot(at[1] - l[1]);
                }
                _ => path_mm = 0.0,
            }
            last = Some((at, pass));
            poses.push(OraclePose {
                x_mm: at[0] - offset_mm[0],
                y_mm: at[1] - offset_mm[1],
                heading_rad: at[2],
                pass,
                layer: mark.layer,
                path_mm,
            });
        }
    }
    poses
}

/// An aperture as the oracle sees it, tool frame.
#[derive(Clone, Debug)]
pub enum OracleAperture {
    /// Semi-axes, mm.
    Ellipse([f64; 2]),
    /// Everything within a radius of a convex polygon (two corners: of a line), mm.
    Grown(Vec<[f64; 2]>, f64),
}

impl OracleAperture {
    /// True where the point lies in it.
    pub fn contains(&self, u: f64, v: f64) -> bool {
        match self {
            OracleAperture::Ellipse([a, b]) => (u / a) * (u / a) + (v / b) * (v / b) <= 1.0,
            OracleAperture::Grown(corners, radius) => {
                let count = corners.len();
                let side = |i: usize| (corners[i], corners[(i + 1) % count]);
                let turns = |(p, q): ([f64; 2], [f64; 2])| {
                    (q[0] - p[0]) * (v - p[1]) - (q[1] - p[1]) * (u - p[0])
                };
                // On one side of every edge: inside; a line has no inside.
                let left = (0..count).any(|i| turns(side(i)) > 0.0);
                let right = (0..count).any(|i| turns(side(i)) < 0.0);
                let near = |i: usize| distance_mm([u, v], side(i).0, side(i).1) <= *radius;
                !(left && right) && count > 2 || *radius > 0.0 && (0..count).any(near)
            }
        }
    }

    /// Points all round, close enough that no wall passes between two of them unseen.
    pub fn outline(&self) -> Vec<[f64; 2]> {
        let tau = std::f64::consts::TAU;
        match self {
            OracleAperture::Ellipse([a, b]) => (0..OUTLINE)
                .map(|k| tau * k as f64 / OUTLINE as f64)
                .map(|angle| [a * angle.cos(), b * angle.sin()])
                .collect(),
            OracleAperture::Grown(corners, radius) => {
                let mut points = Vec::new();
                for k in 0..2 * OUTLINE {
                    let (sin, cos) = (tau * k as f64 / (2 * OUTLINE) as f64).sin_cos();
                    let far = |c: &[f64; 2]| c[0] * cos + c[1] * sin;
                    let corner = corners
                        .iter()
                        .max_by(|c, d| far(c).total_cmp(&far(d)))
                        .expect("corners");
                    points.push([corner[0] + radius * cos, corner[1] + radius * sin]);
                }
                // The flats between, so that a vertex of the wall does not poke in unseen.
                let turns = points.clone();
                for (i, p) in turns.iter().enumerate() {
                    let q = turns[(i + 1) % turns.len()];
                    let pieces = ((q[0] - p[0]).hypot(q[1] - p[1]) / 0.02).ceil() as usize;
                    for piece in 1..pieces {
                        let t = piece as f64 / pieces as f64;
                        points.push([p[0] + (q[0] - p[0]) * t, p[1] + (q[1] - p[1]) * t]);
                    }
                }
                points
            }
        }
    }

    /// Half the greatest width and the distance of the farthest point from the axis.
    fn sizes_mm(&self) -> (f64, f64) {
        let outline = self.outline();
        let far = outline.iter().map(|p| p[0].hypot(p[1])).fold(0.0, f64::max);
        let widest = match self {
            OracleAperture::Ellipse([a, _]) => 2.0 * a,
            OracleAperture::Grown(corners, radius) => {
                let mut widest: f64 = 0.0;
                for p in corners {
                    for q in corners {
                        widest = widest.max((p[0] - q[0]).hypot(p[1] - q[1]));
                    }
                }
                widest + 2.0 * radius
            }
        };
        (widest / 2.0, far.max(widest / 2.0))
    }
}

/// Sweeps an ellipse (semi-axes) along the poses over a raster of `cell_mm`.
pub fn sweep(
    rings: &Rings,
    poses: &[OraclePose],
    axes_mm: [f64; 2],
    cell_mm: f64,
) -> LayerFindings {
    sweep_aperture(rings, poses, &OracleAperture::Ellipse(axes_mm), cell_mm)
}

/// Sweeps any aperture along the poses over a raster of `cell_mm`.
pub fn sweep_aperture(
    rings: &Rings,
    poses: &[OraclePose],
    aperture: &OracleAperture,
    cell_mm: f64,
) -> LayerFindings {
    let (a, reach) = aperture.sizes_mm();
    let reach2 = reach * reach;
    let all = rings.iter().flatten();
    let low = all
        .clone()
        .fold([f64::MAX; 2], |l, p| [l[0].min(p[0]), l[1].min(p[1])]);
    let high = all.fold([f64::MIN; 2], |h, p| [h[0].max(p[0]), h[1].max(p[1])]);
    let columns = ((high[0] - low[0]) / cell_mm) as usize + 1;
    let rows = ((high[1] - low[1]) / cell_mm) as usize + 1;
    let center = |c: usize, r: usize| {
        [
            low[0] + (c as f64 + 0.5) * cell_mm,
            low[1] + (r as f64 + 0.5) * cell_mm,
        ]
    };
    let mut seen: Vec<Option<(u32, f32)>> = vec![None; columns * rows];
    let mut again = vec![false; columns * rows];
    for pose in poses {
        let (sin, cos) = pose.heading_rad.sin_cos();
        let column_of = |x: f64| ((x - low[0]) / cell_mm).clamp(0.0, columns as f64 - 1.0) as usize;
        let row_of = |y: f64| ((y - low[1]) / cell_mm).clamp(0.0, rows as f64 - 1.0) as usize;
        for r in row_of(pose.y_mm - reach)..=row_of(pose.y_mm + reach) {
            for c in column_of(pose.x_mm - reach)..=column_of(pose.x_mm + reach) {
                let p = center(c, r);
                let (dx, dy) = (p[0] - pose.x_mm, p[1] - pose.y_mm);
                if dx * dx + dy * dy > reach2 {
                    continue;
                }
                if !aperture.contains(dx * cos + dy * sin, dy * cos - dx * sin) {
                    continue;
                }
                let cell = r * columns + c;
                if let Some((pass, path)) = seen[cell] {
                    let returned = pose.path_mm - f64::from(path) > 1.5 * a;
                    again[cell] |= pass != pose.pass || returned;
                }
                seen[cell] = Some((pose.pass, pose.path_mm as f32));
            }
        }
    }
    let (mut inside, mut covered, mut overlapped) = (0usize, 0usize, 0usize);
    let buckets = RowBuckets::new(rings, cell_mm);
    for r in 0..rows {
        for c in 0..columns {
            if buckets.contains(center(c, r)) {
                inside += 1;
                covered += usize::from(seen[r * columns + c].is_some());
                overlapped += usize::from(again[r * columns + c]);
            }
        }
    }
    LayerFindings {
        area_mm2: inside as f64 * cell_mm * cell_mm,
        covered_pct: 100.0 * covered as f64 / inside.max(1) as f64,
        overlap_pct: 100.0 * overlapped as f64 / inside.max(1) as f64,
        outside_depth_mm: outside_depth_mm(rings, poses, aperture),
    }
}

/// Edges by rows of the plane, for ray casting and for distances.
struct RowBuckets {
    low_mm: f64,
    height_mm: f64,
    rows: Vec<Vec<[[f64; 2]; 2]>>,
}

impl RowBuckets {
    fn new(rings: &Rings, height_mm: f64) -> RowBuckets {
        let ys = rings.iter().flatten().map(|p| p[1]);
        let low_mm = ys.clone().fold(f64::MAX, f64::min) - height_mm;
        let high_mm = ys.fold(f64::MIN, f64::max) + height_mm;
        let count = ((high_mm - low_mm) / height_mm) as usize + 1;
        let mut rows = vec![Vec::new(); count];
        for ring in rings {
            for (i, &p) in ring.iter().enumerate() {
                let q = ring[(i + 1) % ring.len()];
                let first = ((p[1].min(q[1]) - low_mm) / height_mm) as usize;
                let last = ((p[1].max(q[1]) - low_mm) / height_mm) as usize;
                for row in &mut rows[first..=last.min(count - 1)] {
                    row.push([p, q]);
                }
            }
        }
        RowBuckets {
            low_mm,
            height_mm,
            rows,
        }
    }

    fn row(&self, y: f64) -> &[[[f64; 2]; 2]] {
        let row = (y - self.low_mm) / self.height_mm;
        if row < 0.0 {
            &[]
        } else {
            self.rows.get(row as usize).map_or(&[], Vec::as_slice)
        }
    }

    /// Even-odd rule.
    fn contains(&self, p: [f64; 2]) -> bool {
        let mut odd = false;
        for [a, b] in self.row(p[1]) {
            if (a[1] > p[1]) != (b[1] > p[1])
                && p[0] < (b[0] - a[0]) * (p[1] - a[1]) / (b[1] - a[1]) + a[0]
            {
                odd = !odd;
            }
        }
        odd
    }
}

/// Outline points of each pose; 0.03 mm apart, so a wall cannot pass between two unseen by more
/// than 0.3 um where it is straight.
const OUTLINE: usize = 96;
/// A point deeper outside than this would have neighbours that are not.
const NEAR_MM: f64 = 0.05;

fn outside_depth_mm(rings: &Rings, poses: &[OraclePose], aperture: &OracleAperture) -> f64 {
    let outline = aperture.outline();
    let buckets = RowBuckets::new(rings, 2.0 * NEAR_MM);
    let mut worst: f64 = 0.0;
    for pose in poses {
        let (sin, cos) = pose.heading_rad.sin_cos();
        for [u, v] in &outline {
            let p = [pose.x_mm + u * cos - v * sin, pose.y_mm + u * sin + v * cos];
            if buckets.contains(p) {
                continue;
            }
            let mut nearest = f64::MAX;
            for dy in [-NEAR_MM, 0.0, NEAR_MM] {
                for [a, b] in buckets.row(p[1] + dy) {
                    nearest = nearest.min(distance_mm(p, *a, *b));
                }
            }
            worst = worst.max(nearest.min(1.0));
        }
    }
    worst
}

fn distance_mm(p: [f64; 2], a: [f64; 2], b: [f64; 2]) -> f64 {
    let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
    let length2 = dx * dx + dy * dy;
    let t = if length2 > 0.0 {
        (((p[0] - a[0]) * dx + (p[1] - a[1]) * dy) / length2).clamp(0.0, 1.0)
    } else {
        0.0
    };
    (p[0] - a[0] - t * dx).hypot(p[1] - a[1] - t * dy)
}
