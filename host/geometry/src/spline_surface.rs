//! Scattered heights -> a smooth surface z(x, y) that stays near them.
//!
//! In: points on the surface (mm) and the largest deviation from them. Out: a uniform bicubic B-spline
//! with one height at each position, C², on the coarsest grid within that deviation: facets of a mesh are
//! smoothed as far as it permits. Each grid's heights minimise the squared deviations plus a small weight
//! on their second differences, which defines the surface beyond the points (P. Eilers, B. Marx 1996:
//! P-splines), solved by conjugate gradients. Not covered: overhangs.

use super::Point2;
use super::chart::ChartJet;
use super::polygon::Box2;
use nalgebra::Vector3;

/// Weight of second differences against a point of the surface, per point and control height: small
/// enough to bend freely, large enough for places without points.
const STIFFNESS: f64 = 1e-3;
/// Pieces of the coarsest grid along the longer side.
const COARSEST: f64 = 4.0;
/// A finer grid than needed is used if it reduces the error to this share, and no finer one once the error is this
/// share of the tolerance.
const FAR_NEARER: f64 = 0.15;
const SETTLED_SHARE: f64 = 0.02;
/// Most rounds of the solver, and the residual against the first one at which it ends.
const ROUNDS_MAX: usize = 400;
const RESIDUAL_SHARE: f64 = 1e-9;
/// Neighbours of a control height in the normal equations: three to each side.
const BAND: usize = 7;

/// A smooth surface.
#[derive(Clone, Debug, PartialEq)]
pub struct SplineSurface {
    /// Corner of the first piece.
    low: Point2,
    /// Side of the pieces, mm.
    pitch_mm: f64,
    /// Control heights along x and y.
    count: [usize; 2],
    /// Control heights, x fastest, mm.
    control_mm: Vec<f64>,
}

/// Height and derivatives at a place.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SurfaceJet {
    /// z, mm.
    pub z_mm: f64,
    /// By x and y.
    pub slope: [f64; 2],
    /// By xx, xy and yy, 1/mm.
    pub bend: [f64; 3],
}

/// A surface and how far it is off its points.
#[derive(Clone, Debug, PartialEq)]
pub struct FittedSurface {
    /// The surface.
    pub surface: SplineSurface,
    /// The farthest point's distance along z, mm.
    pub off_mm: f64,
    /// That point.
    pub off_at: [f64; 3],
}

/// Weights of a cubic B-spline's four control values at `s` in 0..=1: value, first and second derivative.
fn weights(s: f64) -> [[f64; 4]; 3] {
    let r = 1.0 - s;
    [
        [
            r * r * r / 6.0,
            (4.0 + s * s * (3.0 * s - 6.0)) / 6.0,
            (4.0 + r * r * (3.0 * r - 6.0)) / 6.0,
            s * s * s / 6.0,
        ],
        [
            -0.5 * r * r,
            s * (1.5 * s - 2.0),
            r * (2.0 - 1.5 * r),
            0.5 * s * s,
        ],
        [r, 3.0 * s - 2.0, 3.0 * r - 2.0, s],
    ]
}

impl SplineSurface {
    /// The surface over `bounds` through `points` (x, y, z in mm): on ever finer grids until it is within `near_mm`
    /// of all of them or its cells would be smaller than `pitch_min_mm`, and further as long as a finer one is much
    /// nearer: on a smooth surface the error falls to a sixteenth, on facets to a quarter at best. `None` without
    /// points.
    pub fn through(
        points: &[[f64; 3]],
        bounds: Box2,
        near_mm: f64,
        pitch_min_mm: f64,
    ) -> Option<FittedSurface> {
        if points.is_empty() {
            return None;
        }
        let size = bounds.size();
        let mut pitch_mm = (size.x.max(size.y) / COARSEST).max(pitch_min_mm);
        let mut near: Option<FittedSurface> = None;
        loop {
            let surface = SplineSurface::fitted(points, bounds, pitch_mm);
            let (off_mm, off_at) = surface.farthest(points);
            let fitted = FittedSurface {
                surface,
                off_mm,
                off_at,
            };
            if let Some(coarser) = near.take()
                && off_mm > FAR_NEARER * coarser.off_mm
            {
                return Some(coarser);
            }
            if 0.5 * pitch_mm < pitch_min_mm || off_mm < SETTLED_SHARE * near_mm {
                return Some(fitted);
            }
            near = (off_mm <= near_mm).then_some(fitted);
            pitch_mm *= 0.5;
        }
    }

    /// The surface over `bounds` through `points` on the grid of one pitch. `None` without points.
    pub fn on_grid(points: &[[f64; 3]], bounds: Box2, pitch_mm: f64) -> Option<SplineSurface> {
        (!points.is_empty()).then(|| SplineSurface::fitted(points, bounds, pitch_mm))
    }

    /// The plane z = 0 over `bounds`.
    pub fn level(bounds: Box2, pitch_mm: f64) -> SplineSurface {
        let size = bounds.size();
        let count = [size.x, size.y].map(|side| (side / pitch_mm).ceil() as usize + 3);
        SplineSurface {
            low: bounds.min,
            pitch_mm,
            count,
            control_mm: vec![0.0; count[0] * count[1]],
        }
    }

    fn fitted(points: &[[f64; 3]], bounds: Box2, pitch_mm: f64) -> SplineSurface {
        let mut surface = SplineSurface::level(bounds, pitch_mm);
        let count = surface.count;
        // About the mean: control heights without any point stay there.
        let mean_mm = points.iter().map(|p| p[2]).sum::<f64>() / points.len() as f64;
        let mut equations = Equations::new(count, STIFFNESS * points.len() as f64);
        for &[x, y, z] in points {
            let (first, [wx, wy]) = surface.place(x, y);
            equations.take(first, &wx[0], &wy[0], z - mean_mm);
        }
        surface.control_mm = equations.solved();
        surface.control_mm.iter_mut().for_each(|z| *z += mean_mm);
        surface
    }

    fn farthest(&self, points: &[[f64; 3]]) -> (f64, [f64; 3]) {
        let off = |p: &[f64; 3]| (self.jet(p[0], p[1]).z_mm - p[2]).abs();
        let all = points.iter().map(|p| (off(p), *p));
        all.fold(
            (0.0, [0.0; 3]),
            |worst, here| {
                if here.0 > worst.0 { here } else { worst }
            },
        )
    }

    /// Control heights and weights about a place; beyond the grid its outermost pieces are
    /// extended.
    fn place(&self, x: f64, y: f64) -> ([usize; 2], [[[f64; 4]; 3]; 2]) {
        let along = [x - self.low.x, y - self.low.y].map(|way| way / self.pitch_mm);
        let mut first = [0; 2];
        let of_axis = std::array::from_fn(|axis| {
            let last = (self.count[axis] - 4) as f64;
            let piece = along[axis].floor().clamp(0.0, last);
            first[axis] = piece as usize;
            weights(along[axis] - piece)
        });
        (first, of_axis)
    }

    /// Height, slopes and bends at a place, mm.
    pub fn jet(&self, x: f64, y: f64) -> SurfaceJet {
        let ([i, j], [wx, wy]) = self.place(x, y);
        let mut sums = [[0.0; 3]; 3];
        for (row, k) in (j..j + 4).enumerate() {
            let from = k * self.count[0] + i;
            for (column, z) in self.control_mm[from..from + 4].iter().enumerate() {
                for (dy, sums) in sums.iter_mut().enumerate() {
                    for (dx, sum) in sums.iter_mut().enumerate() {
                        *sum += wx[dx][column] * wy[dy][row] * z;
                    }
                }
            }
        }
        let per_mm = 1.0 / self.pitch_mm;
        let square = per_mm * per_mm;
        SurfaceJet {
            z_mm: sums[0][0],
            slope: [per_mm * sums[0][1], per_mm * sums[1][0]],
            bend: [
                square * sums[0][2],
                square * sums[1][1],
                square * sums[2][0],
            ],
        }
    }
}

/// A smooth surface over a chart: x, y and z as [`SplineSurface`]s on one grid.
#[derive(Clone, Debug, PartialEq)]
pub struct PatchSplines {
    grid: SplineSurface,
    /// Control points, u fastest, mm.
    control_mm: Vec<Vector3<f64>>,
}

impl PatchSplines {
    /// The same surface, with the chart scaled by `factor`.
    pub fn scaled(mut self, factor: f64) -> PatchSplines {
        self.grid.low *= factor;
        self.grid.pitch_mm *= factor;
        self
    }

    /// The surface over `bounds` through points with their positions in the chart: on ever finer grids until
    /// it is within `near_mm` of all of them or its cells would be smaller than `pitch_min_mm`.
    pub fn through(
        points: &[(Vector3<f64>, Point2)],
        bounds: Box2,
        near_mm: f64,
        pitch_min_mm: f64,
    ) -> PatchSplines {
        let size = bounds.size();
        let mut pitch_mm = (size.x.max(size.y) / COARSEST).max(pitch_min_mm);
        loop {
            let fitted = PatchSplines::fitted(points, bounds, pitch_mm);
            let off = |(point, at): &(Vector3<f64>, Point2)| fitted.jet(*at).off_mm(*point);
            let off_mm = points.iter().map(off).fold(0.0, f64::max);
            if off_mm <= near_mm || 0.5 * pitch_mm < pitch_min_mm {
                return fitted;
            }
            pitch_mm *= 0.5;
        }
    }

    fn fitted(points: &[(Vector3<f64>, Point2)], bounds: Box2, pitch_mm: f64) -> PatchSplines {
        let of_axis = |axis: usize| {
            let points = points.iter().map(|(point, at)| [at.x, at.y, point[axis]]);
            SplineSurface::fitted(&points.collect::<Vec<_>>(), bounds, pitch_mm)
        };
        let (x, (y, z)) = rayon::join(|| of_axis(0), || rayon::join(|| of_axis(1), || of_axis(2)));
        let axes = x.control_mm.iter().zip(&y.control_mm).zip(&z.control_mm);
        let control_mm = axes.map(|((x, y), z)| Vector3::new(*x, *y, *z)).collect();
        PatchSplines {
            grid: SplineSurface {
                control_mm: Vec::new(),
                ..x
            },
            control_mm,
        }
    }

    /// Place and derivatives.
    pub fn jet(&self, at: Point2) -> ChartJet {
        let ([i, j], [wx, wy]) = self.grid.place(at.x, at.y);
        let mut sums = [[Vector3::zeros(); 3]; 3];
        for (row, k) in (j..j + 4).enumerate() {
            let from = k * self.grid.count[0] + i;
            let mut of_row = [Vector3::zeros(); 3];
            for (column, point) in self.control_mm[from..from + 4].iter().enumerate() {
                for (dx, sum) in of_row.iter_mut().enumerate() {
                    *sum += wx[dx][column] * point;
                }
            }
            for (dy, sums) in sums.iter_mut().enumerate() {
                for (sum, of_row) in sums.iter_mut().zip(&of_row).take(3 - dy) {
                    *sum += wy[dy][row] * of_row;
                }
            }
        }
        let per_mm = 1.0 / self.grid.pitch_mm;
        let square = per_mm * per_mm;
        ChartJet {
            at_mm: sums[0][0],
            along: [per_mm * sums[0][1], per_mm * sums[1][0]],
            bend: [
                square * sums[0][2],
                square * sums[1][1],
                square * sums[2][0],
            ],
        }
    }
}

/// The normal equations: symmetric, each height with its neighbours up to three away along x and y.
struct Equations {
    count: [usize; 2],
    /// For each height the weights of its neighbours, x fastest.
    rows: Vec<[f64; BAND * BAND]>,
    right: Vec<f64>,
}

impl Equations {
    /// Those of the second differences alone, all together of this weight.
    fn new(count: [usize; 2], stiffness: f64) -> Equations {
        let heights = count[0] * count[1];
        let mut equations = Equations {
            count,
            rows: vec![[0.0; BAND * BAND]; heights],
            right: vec![0.0; heights],
        };
        let weight = stiffness / heights as f64;
        for j in 0..count[1] {
            for i in 0..count[0] {
                if i + 2 < count[0] {
                    let at = [(i, j, 1.0), (i + 1, j, -2.0), (i + 2, j, 1.0)];
                    equations.square(&at, weight);
                }
                if j + 2 < count[1] {
                    let at = [(i, j, 1.0), (i, j + 1, -2.0), (i, j + 2, 1.0)];
                    equations.square(&at, weight);
                }
                if i + 1 < count[0] && j + 1 < count[1] {
                    let at = [
                        (i, j, 1.0),
                        (i + 1, j, -1.0),
                        (i, j + 1, -1.0),
                        (i + 1, j + 1, 1.0),
                    ];
                    equations.square(&at, 2.0 * weight);
                }
            }
        }
        equations
    }

    /// Adds the square of a sum of heights.
    fn square(&mut self, terms: &[(usize, usize, f64)], weight: f64) {
        for &(i, j, p) in terms {
            for &(k, l, q) in terms {
                let beside = (l + 3 - j) * BAND + (k + 3 - i);
                self.rows[j * self.count[0] + i][beside] += weight * p * q;
            }
        }
    }

    /// Adds a point: the square of the surface's distance from it.
    fn take(&mut self, [i, j]: [usize; 2], wx: &[f64; 4], wy: &[f64; 4], z: f64) {
        for (row, py) in wy.iter().enumerate() {
            for (column, px) in wx.iter().enumerate() {
                let own = (j + row) * self.count[0] + i + column;
                let weight = px * py;
                self.right[own] += weight * z;
                for (other, qy) in wy.iter().enumerate() {
                    let from = (other + 3 - row) * BAND + 3 - column;
                    let into = &mut self.rows[own][from..from + 4];
                    for (into, qx) in into.iter_mut().zip(wx) {
                        *into += weight * qx * qy;
                    }
                }
            }
        }
    }

    fn times(&self, of: &[f64]) -> Vec<f64> {
        let [nx, ny] = self.count;
        let mut product = vec![0.0; of.len()];
        for j in 0..ny {
            for i in 0..nx {
                let row = &self.rows[j * nx + i];
                let (left, right) = (i.saturating_sub(3), (i + 4).min(nx));
                let mut sum = 0.0;
                for l in j.saturating_sub(3)..(j + 4).min(ny) {
                    let weights = &row[(l + 3 - j) * BAND + left + 3 - i..];
                    let heights = &of[l * nx + left..l * nx + right];
                    sum += weights.iter().zip(heights).map(|(w, z)| w * z).sum::<f64>();
                }
                product[j * nx + i] = sum;
            }
        }
        product
    }

    /// Conjugate gradients, each height by its own weight.
    fn solved(&self) -> Vec<f64> {
        let own: Vec<f64> = self.rows.iter().map(|row| row[BAND * BAND / 2]).collect();
        let dot = |p: &[f64], q: &[f64]| p.iter().zip(q).map(|(p, q)| p * q).sum::<f64>();
        let scaled =
            |p: &[f64]| -> Vec<f64> { p.iter().zip(&own).map(|(p, own)| p / own).collect() };
        let mut solution = vec![0.0; own.len()];
        let mut residual = self.right.clone();
        let mut towards = scaled(&residual);
        let mut size = dot(&residual, &towards);
        let enough = size * RESIDUAL_SHARE * RESIDUAL_SHARE;
        for _ in 0..ROUNDS_MAX {
            if size <= enough {
                break;
            }
            let product = self.times(&towards);
            let step = size / dot(&towards, &product);
            for (index, towards) in towards.iter().enumerate() {
                solution[index] += step * towards;
                residual[index] -= step * product[index];
            }
            let next = scaled(&residual);
            let next_size = dot(&residual, &next);
            let share = next_size / size;
            for (towards, next) in towards.iter_mut().zip(&next) {
                *towards = next + share * *towards;
            }
            size = next_size;
        }
        solution
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Goal: a dome known by facets only comes out smooth and near, its slopes too, and goes on beyond its
    /// rim. Method: a sphere's cap of chords 2 mm long against the sphere itself.
    #[test]
    fn facets_of_a_dome_are_smoothed_away() {
        let sphere = |x: f64, y: f64| (900.0 - x * x - y * y).max(0.0).sqrt();
        // Flat squares of 2 mm: their heights between the corners are bilinear, up to 40 µm below.
        let facet = |x: f64, y: f64| {
            let (i, j) = ((x / 2.0).floor(), (y / 2.0).floor());
            let (s, t) = (x / 2.0 - i, y / 2.0 - j);
            let corner = |k: f64, l: f64| sphere(2.0 * (i + k), 2.0 * (j + l));
            let along = |l: f64| corner(0.0, l) + s * (corner(1.0, l) - corner(0.0, l));
            along(0.0) + t * (along(1.0) - along(0.0))
        };
        let mut points = Vec::new();
        for i in -50..=50 {
            for j in -50..=50 {
                let (x, y) = (0.3 * f64::from(i), 0.3 * f64::from(j));
                if x.hypot(y) <= 15.0 {
                    points.push([x, y, facet(x, y)]);
                }
            }
        }
        let bounds = Box2::of(&[Point2::new(-15.0, -15.0), Point2::new(15.0, 15.0)]);
        let fitted = SplineSurface::through(&points, bounds, 0.05, 0.5).unwrap();
        assert!(fitted.off_mm <= 0.05, "{}", fitted.off_mm);
        for (x, y) in [(0.0, 0.0), (5.0, 3.0), (-9.0, 8.0), (0.3, -13.5)] {
            let jet = fitted.surface.jet(x, y);
            let z = sphere(x, y);
            assert!((jet.z_mm - z).abs() < 0.05, "{x} {y}: {jet:?} {z}");
            // The facets' own slopes jump by 0.07 and more.
            assert!((jet.slope[0] + x / z).abs() < 0.012, "{x} {y}: {jet:?}");
            assert!((jet.slope[1] + y / z).abs() < 0.012, "{x} {y}: {jet:?}");
        }
        // Beyond the rim it continues with about the same slope.
        let beyond = fitted.surface.jet(15.0, 8.0);
        assert!((beyond.z_mm - sphere(15.0, 8.0)).abs() < 1.0, "{beyond:?}");
    }

    /// Goal: what is polynomial comes out exactly, derivatives too. Method: a saddle, on one grid.
    #[test]
    fn a_saddle_is_met_with_its_derivatives() {
        let z = |x: f64, y: f64| 2.0 + 0.1 * x + 0.01 * (x * x - y * y) + 0.02 * x * y;
        let mut points = Vec::new();
        for i in 0..=40 {
            for j in 0..=30 {
                let (x, y) = (0.5 * f64::from(i), 0.5 * f64::from(j));
                points.push([x, y, z(x, y)]);
            }
        }
        let bounds = Box2::of(&[Point2::new(0.0, 0.0), Point2::new(20.0, 15.0)]);
        let fitted = SplineSurface::through(&points, bounds, 1e-3, 1.0).unwrap();
        let jet = fitted.surface.jet(7.3, 4.1);
        assert!((jet.z_mm - z(7.3, 4.1)).abs() < 1e-3);
        assert!(
            (jet.slope[0] - (0.1 + 0.02 * 7.3 + 0.02 * 4.1)).abs() < 1e-3,
            "{jet:?}"
        );
        assert!(
            (jet.slope[1] - (-0.02 * 4.1 + 0.02 * 7.3)).abs() < 1e-3,
            "{jet:?}"
        );
        for (bend, expected) in jet.bend.iter().zip([0.02, 0.02, -0.02]) {
            assert!((bend - expected).abs() < 1e-3, "{jet:?}");
        }
    }
}
