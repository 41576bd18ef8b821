//! A mesh that cannot be flattened whole -> patches that can, divided by planes across the axes.
//!
//! In: a mesh with rims (mm). Out: [`Share`]s of it from below up. A part that does not flatten, or whose lengths then
//! range by more than [`RANGE_MAX`], is divided by one of a few planes: the one after which the fewest patches are to be
//! expected, of these that with the least range, then the shortest seam. A ring that flattens cut open counts as two. Seams
//! of planes are smooth, while a path along edges would zigzag on most meshes. Not covered: meshes without a rim.

use crate::geometry::conformal::flattened;
use crate::geometry::polygon::Ring;
use crate::geometry::validity::validate;
use crate::mesh::patch::{chosen, cut_open, grown, rims};
use crate::mesh::split::{AxisPlane, Clipped};
use crate::mesh::{Mesh, Point3};
use crate::pipeline::surface::laid_ground::region_within;
use crate::text::refusal::Refusal;
use nalgebra::Vector3;
use rayon::prelude::*;

/// What lengths may range by in one patch, triangle by triangle.
const RANGE_MAX: f64 = 1.3;
/// Planes that are tried across each axis, at equal steps of the part's box.
const STEPS: u32 = 8;
/// Most patches, and most vertices of a mesh that is divided: each plane flattens both of its sides.
const PATCHES_MAX: usize = 48;
pub const VERTICES_MAX: usize = 20_000;
/// Patches to be expected of a part that folds over.
const OF_FOLDED: f64 = 10.0;

/// A patch's share of a mesh.
#[derive(Clone, Debug)]
pub struct Share {
    /// The share itself.
    pub own: Clipped,
    /// The planes that divide it from others.
    pub planes: Vec<AxisPlane>,
}

/// How well a part flattens.
#[derive(Clone, Copy, Debug)]
struct Flatness {
    /// Patches to be expected.
    patches: f64,
    /// Greatest length over least.
    range: f64,
}

/// A way to divide a part.
struct Division {
    shares: Vec<Share>,
    patches: f64,
    range: f64,
    seam_mm: f64,
}

/// Divides a mesh; one share alone if it flattens as it is, `None` where no division is found.
///
/// # Errors
/// [`Refusal`].
pub fn divided(mesh: &Mesh, margin_mm: f64) -> Result<Option<Vec<Share>>, Refusal> {
    if mesh.vertices.len() > VERTICES_MAX {
        return Ok(None);
    }
    let whole = Clipped::whole(mesh).connected()?;
    let mut waiting: Vec<Share> = whole
        .into_iter()
        .map(|own| Share {
            own,
            planes: Vec::new(),
        })
        .collect();
    let mut found = Vec::new();
    while let Some(share) = waiting.pop() {
        if flatness(mesh, &share.own, margin_mm).is_some_and(|flat| flat.patches == 1.0) {
            found.push(share);
            continue;
        }
        match best_division(mesh, &share, margin_mm) {
            Some(division) => waiting.extend(division.shares),
            None => return Ok(None),
        }
        if found.len() + waiting.len() > PATCHES_MAX {
            return Ok(None);
        }
    }
    let low = |share: &Share| share.own.mesh.bounds_mm()[0];
    found.sort_by(|a, b| {
        let [a, b] = [low(a), low(b)];
        let by_z = a.z.total_cmp(&b.z);
        by_z.then(a.x.total_cmp(&b.x)).then(a.y.total_cmp(&b.y))
    });
    Ok(Some(found))
}

fn best_division(mesh: &Mesh, share: &Share, margin_mm: f64) -> Option<Division> {
    let [low, high] = share.own.mesh.bounds_mm();
    let planes = (0..3).flat_map(|axis| (1..STEPS).map(move |step| (axis, step)));
    let planes: Vec<AxisPlane> = planes
        .map(|(axis, step)| AxisPlane {
            axis,
            at_mm: low[axis] + (high[axis] - low[axis]) * f64::from(step) / f64::from(STEPS),
            keeps_below: true,
        })
        .collect();
    let divisions: Vec<Option<Division>> = planes
        .par_iter()
        .map(|plane| division(mesh, share, *plane, margin_mm))
        .collect();
    divisions.into_iter().flatten().min_by(|a, b| {
        let by_patches = a.patches.total_cmp(&b.patches);
        let by_range = || a.range.total_cmp(&b.range);
        let by_seam = || a.seam_mm.total_cmp(&b.seam_mm);
        by_patches.then_with(by_range).then_with(by_seam)
    })
}

/// Both sides of a plane; `None` where it is no way to divide the part.
fn division(mesh: &Mesh, share: &Share, below: AxisPlane, margin_mm: f64) -> Option<Division> {
    let above = AxisPlane {
        keeps_below: false,
        ..below
    };
    let mut division = Division {
        shares: Vec::new(),
        patches: 0.0,
        range: 1.0,
        seam_mm: 0.0,
    };
    for plane in [below, above] {
        let side = share.own.clipped(&plane);
        if side.mesh.triangles.is_empty() {
            return None;
        }
        division.seam_mm = side.length_on_mm(&plane);
        for own in side.connected().ok()? {
            let flat = flatness(mesh, &own, margin_mm)?;
            division.patches += flat.patches;
            division.range = division.range.max(flat.range);
            let planes = share.planes.iter().copied().chain([plane]).collect();
            division.shares.push(Share { own, planes });
        }
    }
    Some(division)
}

/// How well a part flattens together with what lies beside it; `None` for one that is no patch.
fn flatness(mesh: &Mesh, own: &Clipped, margin_mm: f64) -> Option<Flatness> {
    let own_rims = rims(&own.mesh).ok()?;
    let longest = own_rims.first()?;
    let (patch, is_own) = ground_of(mesh, own, margin_mm);
    let folded = Flatness {
        patches: OF_FOLDED,
        range: f64::INFINITY,
    };
    let whole = range_of(&patch, &is_own, Some(&own.mesh));
    if let Some(range) = whole.filter(|range| *range <= RANGE_MAX) {
        let patches = 1.0;
        return Some(Flatness { patches, range });
    }
    let open = own_rims.get(1).and_then(|other| {
        let open = cut_open(&own.mesh, longest, other).ok()??;
        range_of(&open, &vec![true; open.triangles.len()], None)
    });
    if let Some(range) = open.filter(|range| *range <= RANGE_MAX) {
        let patches = 2.0;
        return Some(Flatness { patches, range });
    }
    let of_range = |range: f64| Flatness {
        patches: (2.0 + range.ln() / RANGE_MAX.ln()).min(OF_FOLDED),
        range,
    };
    Some(whole.map_or(folded, of_range))
}

/// A part with what lies beside it, whole triangles, and which of them it has a share in.
pub fn ground_of(mesh: &Mesh, own: &Clipped, margin_mm: f64) -> (Mesh, Vec<bool>) {
    let mut is_own = vec![false; mesh.triangles.len()];
    for &triangle in &own.source {
        is_own[triangle as usize] = true;
    }
    let is_near = grown(mesh, &is_own, margin_mm);
    let kept = is_own.iter().zip(&is_near).filter(|(_, near)| **near);
    let kept = kept.map(|(own, _)| *own).collect();
    (chosen(mesh, |triangle| is_near[triangle]), kept)
}

/// Greatest over least length of the flattened triangles that count; `None` where it folds over or lies upon itself.
fn range_of(patch: &Mesh, counts: &[bool], outline: Option<&Mesh>) -> Option<f64> {
    let vertices: Vec<Vector3<f64>> = patch.vertices.iter().map(|p| p.coords).collect();
    let flat = flattened(&vertices, &patch.triangles).ok()?;
    let (mut least, mut most) = (f64::INFINITY, 0.0f64);
    for (number, triangle) in patch.triangles.iter().enumerate() {
        let [a, b, c] = triangle.map(|vertex| flat[vertex as usize]);
        let flat_mm2 = 0.5 * (b - a).perp(&(c - a));
        let [a, b, c] = patch.corners(number);
        let scale = (0.5 * (b - a).cross(&(c - a)).norm() / flat_mm2).sqrt();
        if counts[number] && scale.is_finite() {
            (least, most) = (least.min(scale), most.max(scale));
        }
    }
    let lies_apart = outline.is_none() || lies_apart(patch, &flat);
    (lies_apart && most > 0.0).then(|| most / least)
}

/// Whether a flattened patch lies nowhere on itself: its rims cross neither themselves nor each other.
fn lies_apart(patch: &Mesh, flat: &[crate::geometry::Point2]) -> bool {
    let Ok(rims) = rims(patch) else { return false };
    let rings = rims.iter().map(|rim| Ring {
        points: rim.iter().map(|vertex| flat[*vertex as usize]).collect(),
    });
    region_within(rings.collect()).is_some_and(|region| validate(&region).is_ok())
}

/// How near a place is to the seams of a share, mm.
pub fn from_seam_mm(share: &Share, at: Point3) -> f64 {
    let away = share.planes.iter().map(|plane| plane.beyond_mm(&at).abs());
    away.fold(f64::INFINITY, f64::min)
}
