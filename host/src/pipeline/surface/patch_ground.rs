//! A patch of a mesh as ground: it may hang over, stand upright or close around something.
//!
//! In: a mesh, and where there is one an outline drawn on it (mm). Out: a [`PatchChart`] of the patch, and the outline in
//! it: what was drawn, brought to the mesh, or else the patch's own rims. Of a mesh that is more than a patch about the
//! outline the smaller side of it is taken, with a margin. Ground that closes around is cut open along the shortest way
//! between its two longest rims, and both sides of the cut are walls.

use super::laid_ground::{divided, region_within};
use super::{MARGIN_MM, NEAR_SHARE, OFF_SHARE_MAX, middle_mm};
use crate::geometry::Point2;
use crate::geometry::chart::{Chart, PatchChart};
use crate::geometry::conformal::{FlattenError, flattened};
use crate::geometry::polygon::{Region, Ring};
use crate::input::space_outline::SpaceOutline;
use crate::mesh::patch::{chosen, cut_open, nearest, parts, rims};
use crate::mesh::{Mesh, Point3};
use crate::pipeline::surface::error::{SurfaceError, closed, not_flat, too_rough};
use crate::settings::Settings;
use crate::text::refusal::refusal;
use nalgebra::Vector3;

/// Most vertices of a patch that is flattened whole.
const VERTICES_MAX: usize = 4000;
/// Least pitch of the smooth ground, mm, and longest side of the pieces of triangles at which it is held against the mesh.
const PITCH_MIN_MM: f64 = 0.5;
const PIECE_MM: f64 = 0.5;
const PIECES_MAX: usize = 16;
/// Longest piece of a drawn edge that is brought to the mesh as one, mm.
const DRAWN_STEP_MM: f64 = 0.5;

/// The ground of a patch.
pub struct PatchGround {
    /// Its chart.
    pub chart: PatchChart,
    /// The outline in it.
    pub regions: Vec<Region>,
}

impl PatchGround {
    /// Of a mesh; `cut` cuts it open first.
    ///
    /// # Errors
    /// [`SurfaceError`].
    pub fn of(
        mesh: &Mesh,
        outline: Option<&SpaceOutline>,
        cut: bool,
        settings: &Settings,
    ) -> Result<PatchGround, SurfaceError> {
        let drawn = outline.map(|outline| Drawn::on(mesh, outline, settings));
        let drawn = drawn.transpose()?;
        let mut patch = match &drawn {
            Some(drawn) if mesh.vertices.len() > VERTICES_MAX || rims(mesh)?.is_empty() => {
                drawn.side_of(mesh)?
            }
            _ => chosen(mesh, |_| true),
        };
        let mut own_rims = rims(&patch)?;
        if own_rims.is_empty() {
            let at = patch.vertices.first().copied().unwrap_or_default();
            return Err(closed(at.coords.into()));
        }
        if cut {
            let [from, to] = [own_rims.first(), own_rims.get(1)].map(|rim| rim.cloned());
            let (Some(from), Some(to)) = (from, to) else {
                return Err(closed(patch.vertices[0].coords.into()));
            };
            if let Some(open) = cut_open(&patch, &from, &to)? {
                patch = open;
                own_rims = rims(&patch)?;
            }
        }
        let chart = charted(&patch, settings)?;
        let regions = match &drawn {
            Some(drawn) => vec![drawn.in_chart(mesh, &chart.0)],
            None => Vec::from_iter(rims_in_chart(&patch, &own_rims, &chart)),
        };
        Ok(PatchGround {
            chart: chart.0,
            regions,
        })
    }

    /// Whether a patch has two rims between which it may be cut.
    pub fn may_be_cut(mesh: &Mesh) -> bool {
        rims(mesh).is_ok_and(|rims| rims.len() > 1)
    }
}

/// The chart of a patch, and where its vertices lie in it.
pub(super) fn charted(
    patch: &Mesh,
    settings: &Settings,
) -> Result<(PatchChart, Vec<Point2>), SurfaceError> {
    let places: Vec<Vector3<f64>> = patch.vertices.iter().map(|p| p.coords).collect();
    let normals = normals(patch);
    let above_mm = middle_mm(settings);
    // Conformal where beads lie: on the middle one of the layers' tops.
    let raised = places.iter().zip(&normals);
    let raised: Vec<Vector3<f64>> = raised.map(|(at, normal)| at + above_mm * normal).collect();
    let flat = flattened(&raised, &patch.triangles).map_err(|problem| {
        let vertex = match problem {
            FlattenError::FoldsOver { vertex } | FlattenError::NotConnected { vertex } => vertex,
            FlattenError::Empty => 0,
        };
        let at = places.get(vertex).copied().unwrap_or_default();
        not_flat(problem, at.into())
    })?;
    let vertices: Vec<_> = places.into_iter().zip(flat.iter().copied()).collect();
    let mut inner = Vec::new();
    for triangle in &patch.triangles {
        add_pieces(triangle.map(|vertex| vertices[vertex as usize]), &mut inner);
    }
    let height_mm = settings.layer_height_mm;
    let chart = PatchChart::through(&vertices, &inner, NEAR_SHARE * height_mm, PITCH_MIN_MM);
    let Some(chart) = chart else {
        return Err(not_flat(FlattenError::Empty, [0.0; 3]));
    };
    let most_mm = OFF_SHARE_MAX * height_mm;
    if chart.off_mm > most_mm {
        return Err(too_rough(chart.off_mm, most_mm, chart.off_at_mm.into()));
    }
    Ok((chart, flat))
}

/// Unit normals at the vertices, of the triangles about each by their areas.
pub(super) fn normals(patch: &Mesh) -> Vec<Vector3<f64>> {
    let mut normals = vec![Vector3::zeros(); patch.vertices.len()];
    for (number, triangle) in patch.triangles.iter().enumerate() {
        let [a, b, c] = patch.corners(number);
        let square = (b - a).cross(&(c - a));
        for &vertex in triangle {
            normals[vertex as usize] += square;
        }
    }
    let upright = Vector3::z();
    let unit = |normal: Vector3<f64>| normal.try_normalize(1e-12).unwrap_or(upright);
    normals.into_iter().map(unit).collect()
}

/// Places evenly over a triangle, its corners left out.
fn add_pieces(corners: [(Vector3<f64>, Point2); 3], places: &mut Vec<(Vector3<f64>, Point2)>) {
    let [a, b, c] = corners;
    let longest_mm = (b.0 - a.0)
        .norm()
        .max((c.0 - a.0).norm())
        .max((c.0 - b.0).norm());
    let pieces = ((longest_mm / PIECE_MM).ceil() as usize).clamp(1, PIECES_MAX);
    for i in 0..pieces {
        for j in 0..pieces - i {
            let [s, t] = [i, j].map(|k| (k as f64 + 1.0 / 3.0) / pieces as f64);
            places.push((
                a.0 + s * (b.0 - a.0) + t * (c.0 - a.0),
                a.1 + s * (b.1 - a.1) + t * (c.1 - a.1),
            ));
        }
    }
}

/// The rims of a patch as a region; `None` without any.
fn rims_in_chart(
    patch: &Mesh,
    rims: &[Vec<u32>],
    chart: &(PatchChart, Vec<Point2>),
) -> Option<Region> {
    let (chart, flat) = chart;
    let ring = |rim: &Vec<u32>| Ring {
        points: rim
            .iter()
            .map(|&vertex| {
                let point = patch.vertices[vertex as usize].coords;
                chart.place_of(point, flat[vertex as usize], 0.0)
            })
            .collect(),
    };
    region_within(rims.iter().map(ring).collect())
}

/// An outline brought to a mesh.
struct Drawn<'a> {
    outline: &'a SpaceOutline,
    /// The triangles that its edges cross.
    crossed: Vec<bool>,
    points: Vec<Point3>,
}

impl Drawn<'_> {
    fn on<'a>(
        mesh: &Mesh,
        outline: &'a SpaceOutline,
        settings: &Settings,
    ) -> Result<Drawn<'a>, SurfaceError> {
        let most_mm = OFF_SHARE_MAX * settings.layer_height_mm;
        let mut drawn = Drawn {
            outline,
            crossed: vec![false; mesh.triangles.len()],
            points: Vec::new(),
        };
        for ring in &outline.rings {
            for (k, from) in ring.iter().enumerate() {
                let to = ring[(k + 1) % ring.len()];
                let steps = ((to - from).norm() / DRAWN_STEP_MM).ceil().max(1.0) as usize;
                for step in 0..steps {
                    let at = from + (to - from) * (step as f64 / steps as f64);
                    let Some((on, off_mm, triangle)) = nearest(mesh, Point3::from(at)) else {
                        continue;
                    };
                    if step == 0 && off_mm > most_mm {
                        return Err(SurfaceError::Refused(refusal!(
                            "the outline's point ({:.3}, {:.3}, {:.3}) mm lies {off_mm:.3} mm \
                             off the surface, more than half a layer ({most_mm:.3} mm): both are \
                             taken in the same coordinates",
                            at[0],
                            at[1],
                            at[2]
                        )));
                    }
                    drawn.crossed[triangle] = true;
                    drawn.points.push(on);
                }
            }
        }
        Ok(drawn)
    }

    /// The smaller side of the outline with a margin about it.
    fn side_of(&self, mesh: &Mesh) -> Result<Mesh, SurfaceError> {
        let part_of = parts(mesh, |triangle| self.crossed[triangle])?;
        let mut areas = std::collections::BTreeMap::<u32, f64>::new();
        for (triangle, part) in part_of.iter().enumerate() {
            let [a, b, c] = mesh.corners(triangle);
            if let Some(part) = part {
                *areas.entry(*part).or_default() += (b - a).cross(&(c - a)).norm();
            }
        }
        let largest = areas
            .iter()
            .max_by(|a, b| a.1.total_cmp(b.1))
            .map(|(part, _)| *part);
        let is_near = |triangle: usize| {
            let corners = mesh.corners(triangle);
            let near = |p: &Point3| corners.iter().any(|corner| (corner - p).norm() < MARGIN_MM);
            self.points.iter().any(near)
        };
        let is_inside = |triangle: usize| {
            self.crossed[triangle] || (part_of[triangle].is_some() && part_of[triangle] != largest)
        };
        Ok(chosen(mesh, |triangle| {
            is_inside(triangle) || is_near(triangle)
        }))
    }

    /// In the chart of its patch.
    fn in_chart(&self, mesh: &Mesh, chart: &PatchChart) -> Region {
        let place = |at: Vector3<f64>| {
            let on = nearest(mesh, Point3::from(at));
            chart.place(on.map_or(at, |(on, _, _)| on.coords))
        };
        let middle = |a: Vector3<f64>, b: Vector3<f64>| 0.5 * (a + b);
        let apart_mm = |a: Vector3<f64>, b: Vector3<f64>| (b - a).norm();
        let ring = |ring: &Vec<Vector3<f64>>| Ring {
            points: divided(ring, &place, middle, apart_mm),
        };
        let mut rings: Vec<Ring> = self.outline.rings.iter().map(ring).collect();
        let turn = |ring: &mut Ring, counter_clockwise: bool| {
            if (ring.signed_area_mm2() > 0.0) != counter_clockwise {
                ring.points.reverse();
            }
        };
        let mut exterior = rings.remove(0);
        turn(&mut exterior, true);
        rings.iter_mut().for_each(|hole| turn(hole, false));
        Region {
            exterior,
            holes: rings,
        }
    }
}
