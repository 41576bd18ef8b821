//! The ground under an outline that is seen from above, flattened.
//!
//! In: the outline and a mesh in the same coordinates (mm). Out: smooth heights over the outline, and from them a
//! [`PatchChart`] with the way from the outline's plane into it. Heights are fitted to the mesh as far as the outline grown by a
//! margin reaches; what lies beyond is as rough as it likes.

use super::{MARGIN_MM, NEAR_SHARE, OFF_SHARE_MAX};
use crate::geometry::chart::{Chart, PatchChart};
use crate::geometry::conformal::{FlattenError, flattened};
use crate::geometry::edge_index::{Edge, EdgeIndex};
use crate::geometry::polygon::{Box2, Region};
use crate::geometry::spline_surface::{FittedSurface, SplineSurface};
use crate::geometry::{Point2, Vector2};
use crate::input::Target;
use crate::mesh::height_map::HeightMap;
use crate::pipeline::surface::error::{SurfaceError, not_flat, not_under, too_rough};
use crate::plan::layers::skirt::skirt_reach_mm;
use crate::settings::Settings;
use nalgebra::Vector3;

/// Step between samples of the mesh, mm, as long as there are no more than this along an axis.
const SAMPLE_MM: f64 = 0.25;
const SAMPLES_MAX: f64 = 256.0;
/// Step along the outline at which the surface is looked for, mm.
const LOOK_MM: f64 = 0.5;
/// Least step between the vertices that are flattened, mm, and about how many there are over the box: of a surface, and of a
/// curved layer, which bends within a millimetre at rounded folds and whose chart would shear the nozzle by some per cent there.
const VERTEX_MM: f64 = 0.4;
const VERTICES: f64 = 2500.0;
const VERTICES_OF_LAYER: f64 = 10_000.0;
/// How far the chart's ground may be off the smooth heights, of the layer height.
const CHART_SHARE: f64 = 0.01;
/// Times that the margin is doubled where the outline's pieces lie apart.
const DOUBLINGS: usize = 8;

/// Smooth heights and their chart.
pub struct HeightGround {
    /// Heights.
    pub fitted: FittedSurface,
    /// The chart of them.
    pub chart: PatchChart,
}

/// The ground of an outline.
struct Site {
    walls: EdgeIndex,
    bounds: Box2,
    /// Beyond the outline so much must be smooth: what a nozzle reaches.
    smooth_mm: f64,
    step_mm: f64,
    /// About how many vertices are flattened.
    vertices: f64,
}

impl HeightGround {
    /// Under a target.
    ///
    /// # Errors
    /// [`SurfaceError`].
    pub fn under(
        target: &Target,
        map: &HeightMap,
        settings: &Settings,
    ) -> Result<HeightGround, SurfaceError> {
        let edges: Vec<(Point2, Point2)> = target.regions.iter().flat_map(Region::edges).collect();
        for (p, q) in &edges {
            let steps = ((q - p).norm() / LOOK_MM).ceil().max(1.0) as usize;
            for step in 0..steps {
                under(map, p + (q - p) * (step as f64 / steps as f64))?;
            }
        }
        let walls = walls_of(edges);
        HeightGround::charted(&walls, VERTICES, settings, |site, margin_mm| {
            site.fitted(map, margin_mm, settings)
        })
    }

    /// Smooth heights over regions, as they are.
    ///
    /// # Errors
    /// [`SurfaceError::NotFlat`].
    pub fn of_heights(
        regions: &[Region],
        heights: impl Fn(Box2) -> FittedSurface,
        settings: &Settings,
    ) -> Result<HeightGround, SurfaceError> {
        let walls = walls_of(regions.iter().flat_map(Region::edges).collect());
        HeightGround::charted(&walls, VERTICES_OF_LAYER, settings, |site, _| {
            Ok(heights(site.bounds))
        })
    }

    fn charted(
        walls: &EdgeIndex,
        vertices: f64,
        settings: &Settings,
        fitted: impl Fn(&Site, f64) -> Result<FittedSurface, SurfaceError>,
    ) -> Result<HeightGround, SurfaceError> {
        let smooth_mm = skirt_reach_mm(settings) + settings.aperture.reach_mm();
        let mut margin_mm = smooth_mm + MARGIN_MM;
        let mut found = (FlattenError::Empty, 0.0);
        let at = walls.bounds().min;
        for _ in 0..DOUBLINGS {
            let bounds = walls.bounds().grown(margin_mm);
            let size = bounds.size();
            let site = Site {
                step_mm: (size.x.max(size.y) / SAMPLES_MAX).max(SAMPLE_MM),
                bounds,
                smooth_mm,
                vertices,
                walls: walls.clone(),
            };
            let fitted = fitted(&site, margin_mm)?;
            match site.chart(&fitted.surface, margin_mm, settings) {
                Err(FlattenError::NotConnected { .. }) => margin_mm *= 2.0,
                Ok(chart) => return Ok(HeightGround { fitted, chart }),
                Err(error) => {
                    found = (error, fitted.surface.jet(at.x, at.y).z_mm);
                    break;
                }
            }
        }
        Err(not_flat(found.0, [at.x, at.y, found.1]))
    }

    /// A place of the outline's plane in the chart.
    pub fn place(&self, p: Point2) -> Point2 {
        let z_mm = self.fitted.surface.jet(p.x, p.y).z_mm;
        self.chart.place(Vector3::new(p.x, p.y, z_mm))
    }
}

/// Whether the mesh lies under a place.
///
/// # Errors
/// [`SurfaceError::NotUnder`].
pub fn under(map: &HeightMap, p: Point2) -> Result<(), SurfaceError> {
    match map.top_mm(p) {
        Some(_) => Ok(()),
        None => Err(not_under([p.x, p.y])),
    }
}

fn walls_of(edges: Vec<(Point2, Point2)>) -> EdgeIndex {
    let edges = edges.into_iter().map(|(a, b)| Edge { a, b }).collect();
    EdgeIndex::new(edges, MARGIN_MM)
}

impl Site {
    fn beyond_mm(&self, x: f64, y: f64) -> f64 {
        -self.walls.signed_distance_mm(Point2::new(x, y))
    }

    /// Smooth heights over the outline and its margin.
    fn fitted(
        &self,
        map: &HeightMap,
        margin_mm: f64,
        settings: &Settings,
    ) -> Result<FittedSurface, SurfaceError> {
        let mut points = map.samples(self.bounds, self.step_mm);
        points.retain(|p| {
            let beyond_mm = self.beyond_mm(p[0], p[1]);
            beyond_mm <= self.smooth_mm || (beyond_mm <= margin_mm && self.is_level(map, p))
        });
        let near_mm = NEAR_SHARE * settings.layer_height_mm;
        let fitted = SplineSurface::through(&points, self.bounds, near_mm, 2.0 * self.step_mm);
        let at = self.walls.bounds().min;
        let fitted = fitted.ok_or_else(|| not_under([at.x, at.y]))?;
        let most_mm = OFF_SHARE_MAX * settings.layer_height_mm;
        if fitted.off_mm > most_mm {
            return Err(too_rough(fitted.off_mm, most_mm, fitted.off_at));
        }
        Ok(fitted)
    }

    /// True where the mesh goes on around a sample.
    fn is_level(&self, map: &HeightMap, p: &[f64; 3]) -> bool {
        let beside = [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]];
        beside.iter().all(|[x, y]| {
            let at = Point2::new(p[0] + x * self.step_mm, p[1] + y * self.step_mm);
            let top_mm = map.top_mm(at);
            top_mm.is_some_and(|top_mm| (top_mm - p[2]).abs() < 4.0 * self.step_mm)
        })
    }

    /// The chart of smooth heights: a coarse sheet of them flattened, the way into the plane smoothed, and fine
    /// samples of the heights carried along it.
    fn chart(
        &self,
        heights: &SplineSurface,
        margin_mm: f64,
        settings: &Settings,
    ) -> Result<PatchChart, FlattenError> {
        let size = self.bounds.size();
        let pitch_mm = (size.x * size.y / self.vertices).sqrt().max(VERTEX_MM);
        let sheet = self.sheet(heights, pitch_mm, margin_mm);
        // Conformal where beads lie: on the middle one of the layers' tops.
        let above_mm = super::middle_mm(settings);
        let raised = sheet.vertices.iter().map(|vertex| {
            let frame = heights.frame(Point2::new(vertex.x, vertex.y), above_mm);
            frame.tip_mm
        });
        let flat = flattened(&raised.collect::<Vec<_>>(), &sheet.triangles)?;
        let used = sheet.used();
        let flat = aligned(&sheet.vertices, flat, &used);
        let way = |axis: usize| {
            let points = used.iter().map(|&k| {
                let vertex = sheet.vertices[k];
                [vertex.x, vertex.y, flat[k][axis]]
            });
            let points: Vec<[f64; 3]> = points.collect();
            SplineSurface::through(&points, self.bounds, 1e-4, 1.5 * pitch_mm)
        };
        let (Some(u), Some(v)) = (way(0), way(1)) else {
            return Err(FlattenError::Empty);
        };
        let place =
            |x: f64, y: f64| Point2::new(u.surface.jet(x, y).z_mm, v.surface.jet(x, y).z_mm);
        let step_mm = self.step_mm;
        let [columns, rows] = [size.x, size.y].map(|side| (side / step_mm).ceil() as usize);
        let inner = (0..=rows).flat_map(|j| (0..=columns).map(move |i| (i, j)));
        let inner = inner.filter_map(|(i, j)| {
            let at = self.bounds.min + step_mm * Vector2::new(i as f64, j as f64);
            (self.beyond_mm(at.x, at.y) <= margin_mm).then(|| {
                let z_mm = heights.jet(at.x, at.y).z_mm;
                (Vector3::new(at.x, at.y, z_mm), place(at.x, at.y))
            })
        });
        let inner: Vec<(Vector3<f64>, Point2)> = inner.collect();
        let vertices = used.iter().map(|&k| {
            let vertex = sheet.vertices[k];
            (vertex, place(vertex.x, vertex.y))
        });
        let vertices: Vec<(Vector3<f64>, Point2)> = vertices.collect();
        let near_mm = CHART_SHARE * settings.layer_height_mm;
        PatchChart::through(&vertices, &inner, near_mm, 2.0 * step_mm).ok_or(FlattenError::Empty)
    }

    /// A sheet of triangles over the outline and its margin.
    fn sheet(&self, heights: &SplineSurface, pitch_mm: f64, margin_mm: f64) -> Sheet {
        let size = self.bounds.size();
        let [columns, rows] = [size.x, size.y].map(|side| (side / pitch_mm).ceil() as usize);
        let step = Vector2::new(size.x / columns as f64, size.y / rows as f64);
        let (mut vertices, mut is_kept) = (Vec::new(), Vec::new());
        for j in 0..=rows {
            for i in 0..=columns {
                let at = self.bounds.min + Vector2::new(i as f64 * step.x, j as f64 * step.y);
                vertices.push(Vector3::new(at.x, at.y, heights.jet(at.x, at.y).z_mm));
                is_kept.push(self.beyond_mm(at.x, at.y) <= margin_mm);
            }
        }
        let mut triangles = Vec::new();
        for j in 0..rows {
            for i in 0..columns {
                let corner = |di: usize, dj: usize| (j + dj) * (columns + 1) + i + di;
                let [a, b, c, d] = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
                if ![a, b, c, d].iter().all(|&k| is_kept[k]) {
                    continue;
                }
                // Diagonals in turn, so that none is preferred.
                let halves = match (i + j) % 2 {
                    0 => [[a, b, c], [a, c, d]],
                    _ => [[a, b, d], [b, c, d]],
                };
                triangles.extend(halves.map(|corners| corners.map(|k| k as u32)));
            }
        }
        Sheet {
            vertices,
            triangles,
        }
    }
}

struct Sheet {
    vertices: Vec<Vector3<f64>>,
    triangles: Vec<[u32; 3]>,
}

impl Sheet {
    /// The vertices that a triangle has.
    fn used(&self) -> Vec<usize> {
        let mut used: Vec<usize> = self
            .triangles
            .iter()
            .flatten()
            .map(|&k| k as usize)
            .collect();
        used.sort_unstable();
        used.dedup();
        used
    }
}

/// Places turned and shifted so that they lie where they are seen from above, as well as that goes.
fn aligned(vertices: &[Vector3<f64>], mut flat: Vec<Point2>, used: &[usize]) -> Vec<Point2> {
    let count = used.len() as f64;
    let seen = used.iter().map(|&k| vertices[k].xy()).sum::<Vector2>() / count;
    let laid = used.iter().map(|&k| flat[k].coords).sum::<Vector2>() / count;
    let (mut along, mut across) = (0.0, 0.0);
    for &k in used {
        let (from, to) = (flat[k].coords - laid, vertices[k].xy() - seen);
        along += from.dot(&to);
        across += from.perp(&to);
    }
    let turn = nalgebra::Rotation2::new(across.atan2(along));
    for place in &mut flat {
        *place = Point2::from(seen + turn * (place.coords - laid));
    }
    flat
}
