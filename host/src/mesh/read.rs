//! A mesh file -> a closed, upright mesh in mm, with notes on repairs.

use super::clean::{Cleaned, clean, with_shared_vertices};
use super::close_gaps::{ClosedGaps, GAP_MAX_MM, close_gaps};
use super::orient::{Reoriented, orient};
use super::surface_region::SurfaceRegion;
use super::{Carved, Mesh, Point3, obj, stl, threemf};
use crate::text::refusal::{Refusal, refusal};
use crate::text::short_number::Short;

pub(super) use super::raw_mesh::RawMesh;

/// Most triangles that are read: 1 GB while they are sorted.
pub const TRIANGLES_MAX: usize = 8_000_000;
/// Largest part, mm: beyond that the units are wrong.
pub const SIZE_MAX_MM: f64 = 10_000.0;
/// Groups that are named where the one that is meant is not there.
const GROUPS_TOLD: usize = 10;
/// Least extent along its longest axis, mm.
pub const SIZE_MIN_MM: f64 = 0.1;
/// Farthest from the origin, mm: beyond that single-precision coordinates step by more than 1 µm
/// many times over.
const FAR_MAX_MM: f64 = 100_000.0;

/// Mesh formats that can be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshFormat {
    /// Binary or ASCII.
    Stl,
    /// 3D Manufacturing Format.
    ThreeMf,
    /// Wavefront.
    Obj,
}

/// How to read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshOptions {
    /// Millimetres per unit of the file; overrides the file's.
    pub unit_mm: Option<f64>,
    /// Factor on all coordinates, after the unit.
    pub scale: f64,
    /// Turns about the file's x, then y, then z axis.
    pub rotate_rad: [f64; 3],
}

impl Default for MeshOptions {
    fn default() -> MeshOptions {
        MeshOptions {
            unit_mm: None,
            scale: 1.0,
            rotate_rad: [0.0; 3],
        }
    }
}

/// A closed mesh and notes on how it was read.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadedMesh {
    /// The file's own name for the part, or the one that was given.
    pub name: String,
    /// Closed, mm. Without triangles where all there is has something cut away.
    pub mesh: Mesh,
    /// What a project cuts something away from.
    pub carved: Vec<Carved>,
    /// One line for each repair.
    pub notes: Vec<String>,
}

pub(super) fn syntax(format: &'static str, problem: String) -> Refusal {
    refusal!("not a readable {format} file: {problem}")
}

/// More triangles than can be sliced in reasonable memory.
pub(super) fn too_many(triangles: usize) -> Refusal {
    refusal!(
        "{triangles} triangles, more than {TRIANGLES_MAX}: export with a coarser tolerance, 0.01 mm \
         is finer than any bead"
    )
}

/// A triangle of a vertex that the file does not have; both are counted from 0.
pub(super) fn no_vertex(triangle: usize, vertex: usize, vertices: usize) -> Refusal {
    refusal!(
        "triangle {triangle} (counted from 0) names vertex {vertex} of {vertices}: the file is \
         damaged, export it once more"
    )
}

/// Nothing is left of so many triangles once what encloses nothing is gone.
fn nothing_enclosed(triangles: usize) -> Refusal {
    refusal!(
        "all of its {triangles} triangles lie flat on each other and enclose nothing: export a \
         solid, not a surface"
    )
}

/// Reads a mesh and closes it. `name` is used if the file has none.
///
/// # Errors
/// A `Refusal` with the place.
pub fn read(
    bytes: &[u8],
    name: &str,
    format: MeshFormat,
    options: &MeshOptions,
) -> Result<LoadedMesh, Refusal> {
    let raw = read_raw(bytes, format, options, false)?;
    let triangles = raw.triangles();
    let is_without_unit = format != MeshFormat::ThreeMf
        && options.unit_mm.is_none()
        && (options.scale - 1.0).abs() < f64::EPSILON;
    let RawMesh {
        mesh,
        carved,
        name: own_name,
        notes,
        ..
    } = raw;
    let mut closing = Closing {
        notes,
        mended: Mended::default(),
    };
    let loaded = LoadedMesh {
        name: own_name.unwrap_or_else(|| name.to_string()),
        mesh: closing.close(mesh)?,
        carved: carved
            .into_iter()
            .map(|(solid, cut)| {
                Ok(Carved {
                    solid: closing.close(solid)?,
                    cut: closing.close(cut)?,
                })
            })
            .collect::<Result<_, Refusal>>()?,
        notes: Vec::new(),
    };
    if loaded.solids().all(|mesh| mesh.triangles.is_empty()) {
        return Err(nothing_enclosed(triangles));
    }
    let mut notes = closing.told();
    notes.extend(unit_note(&loaded).filter(|_| is_without_unit));
    Ok(LoadedMesh { notes, ..loaded })
}

/// Volumes below which coordinates are more likely inches, and metres, than mm: the threshold of
/// PrusaSlicer.
const INCH_MM3: f64 = 9.0;
const METRE_MM3: f64 = 1e-3;

/// The note on a part that is so small that its unit is probably another one.
fn unit_note(loaded: &LoadedMesh) -> Option<String> {
    let volume_mm3: f64 = loaded.solids().map(Mesh::volume_mm3).sum();
    let (unit, option, unit_mm) = match volume_mm3 {
        volume_mm3 if volume_mm3 < METRE_MM3 => ("metres", "m", 1000.0),
        volume_mm3 if volume_mm3 < INCH_MM3 => ("inches", "in", 25.4),
        _ => return None,
    };
    let [low, high] = loaded.bounds_mm();
    let size_mm = high - low;
    let text = |factor: f64| size_text((size_mm * factor).into());
    Some(format!(
        "the part is {} mm, and the file has no unit: if it is in {unit}, --units {option} makes it {} mm",
        text(1.0),
        text(unit_mm)
    ))
}

/// A size for messages: four digits are enough to know a part by.
fn size_text(size_mm: [f64; 3]) -> String {
    let [x, y, z] = size_mm.map(|mm| Short(format!("{mm:.3e}").parse().unwrap_or(mm)));
    format!("{x} x {y} x {z}")
}

impl LoadedMesh {
    /// All material before anything is cut away from it.
    pub fn solids(&self) -> impl Iterator<Item = &Mesh> + Clone {
        let carved = self.carved.iter().map(|carved| &carved.solid);
        std::iter::once(&self.mesh).chain(carved)
    }

    /// Least and largest coordinates of all material, mm.
    pub fn bounds_mm(&self) -> [Point3; 2] {
        bounds_mm(self.solids())
    }
}

/// Least and largest coordinates of several meshes, mm.
pub(super) fn bounds_mm<'a>(meshes: impl Iterator<Item = &'a Mesh>) -> [Point3; 2] {
    let none = Mesh::default().bounds_mm();
    meshes
        .map(Mesh::bounds_mm)
        .fold(none, |all, own| [all[0].inf(&own[0]), all[1].sup(&own[1])])
}

/// Closes meshes, and sums up the repairs.
#[derive(Default)]
struct Closing {
    notes: Vec<String>,
    mended: Mended,
}

#[derive(Clone, Copy, Default)]
struct Mended {
    cleaned: Cleaned,
    turned: Reoriented,
    gaps: ClosedGaps,
}

impl Closing {
    fn close(&mut self, mesh: Mesh) -> Result<Mesh, Refusal> {
        let mut mesh = with_shared_vertices(&mesh);
        let Cleaned {
            collapsed,
            duplicates,
        } = clean(&mut mesh);
        let ClosedGaps {
            welded,
            split,
            filled,
            widest_mm,
        } = close_gaps(&mut mesh)?;
        let Reoriented { triangles, shells } = orient(&mut mesh);
        let Mended {
            cleaned,
            turned,
            gaps,
        } = &mut self.mended;
        cleaned.collapsed += collapsed;
        cleaned.duplicates += duplicates;
        turned.triangles += triangles;
        turned.shells += shells;
        gaps.welded += welded;
        gaps.split += split;
        gaps.filled += filled;
        gaps.widest_mm = gaps.widest_mm.max(widest_mm);
        Ok(mesh)
    }

    fn told(self) -> Vec<String> {
        let Mended {
            cleaned,
            turned,
            gaps,
        } = self.mended;
        let mut notes = self.notes;
        notes.extend(notes_of(cleaned, turned, gaps));
        notes
    }
}

/// Reads a mesh, or a region of it, closed or not, with the outer sides of its triangles as the
/// surface.
///
/// # Errors
/// A `Refusal` with the place.
pub fn read_surface(
    bytes: &[u8],
    format: MeshFormat,
    options: &MeshOptions,
    region: Option<&SurfaceRegion>,
) -> Result<Mesh, Refusal> {
    let mut raw = read_raw(bytes, format, options, region.is_some())?;
    if let Some(region) = region {
        raw.keep(region)?;
    }
    let mut mesh = raw.mesh;
    // Of a surface nothing is cut away.
    raw.carved.iter().for_each(|(solid, _)| mesh.append(solid));
    let triangles = mesh.triangles.len();
    let mut mesh = with_shared_vertices(&mesh);
    clean(&mut mesh);
    match mesh.triangles.is_empty() {
        true => Err(nothing_enclosed(triangles)),
        false => Ok(mesh),
    }
}

/// The triangles in mm, those of a 3MF with names and colours or without.
fn read_raw(
    bytes: &[u8],
    format: MeshFormat,
    options: &MeshOptions,
    with_names: bool,
) -> Result<RawMesh, Refusal> {
    let mut raw = match format {
        MeshFormat::Stl => stl::read(bytes)?,
        MeshFormat::ThreeMf => threemf::read(bytes, with_names)?,
        MeshFormat::Obj => obj::read(bytes)?,
    };
    let factor = options.unit_mm.unwrap_or(raw.unit_mm) * options.scale;
    let turn = turns(options.rotate_rad);
    let cuts = raw.carved.iter_mut();
    let cuts = cuts.flat_map(|(solid, cut)| [solid, cut]);
    let all = std::iter::once(&mut raw.mesh).chain(cuts);
    let mut triangles = 0;
    for mesh in all {
        check_numbers(mesh, triangles)?;
        triangles += mesh.triangles.len();
        for vertex in &mut mesh.vertices {
            let p = Point3::from(vertex.coords * factor);
            *vertex = turn.iter().fold(p, |p, turn| turn(p));
        }
    }
    if triangles == 0 {
        return Err(refusal!(
            "there is no triangle in it: export the solid as a mesh once more"
        ));
    }
    check_size(raw.solids())?;
    Ok(raw)
}

impl RawMesh {
    /// Leaves only the triangles of a region.
    fn keep(&mut self, region: &SurfaceRegion) -> Result<(), Refusal> {
        let mut is_named = vec![false; self.mesh.triangles.len()];
        if let SurfaceRegion::Group(name) = region {
            let own = self.groups.iter().filter(|(own, _)| own == name);
            for triangles in own.flat_map(|(_, triangles)| triangles) {
                is_named[triangles.clone()].fill(true);
            }
        }
        let is_meant = |number: usize, triangle: &[u32; 3]| match region {
            SurfaceRegion::Group(_) => is_named[number],
            SurfaceRegion::Colour(colour) => {
                let own = |vertex: &u32| self.colours.get(*vertex as usize) == Some(colour);
                triangle.iter().all(own)
                    || self.triangle_colours.get(number) == Some(&Some(*colour))
            }
            SurfaceRegion::Normal { most_rad } => {
                let [a, b, c] = triangle.map(|vertex| self.mesh.vertices[vertex as usize]);
                let normal = (b - a).cross(&(c - a));
                normal.norm() > 0.0 && normal.angle(&super::Vector3::z()) <= *most_rad
            }
        };
        let triangles = self.mesh.triangles.iter().enumerate();
        let meant = triangles.filter(|(number, triangle)| is_meant(*number, triangle));
        let meant: Vec<[u32; 3]> = meant.map(|(_, triangle)| *triangle).collect();
        if meant.is_empty() {
            let mut known: Vec<&str> = self.groups.iter().map(|(name, _)| name.as_str()).collect();
            known.sort_unstable();
            known.dedup();
            known.truncate(GROUPS_TOLD);
            let groups = match known.is_empty() {
                true => "none".to_string(),
                false => known.join(", "),
            };
            return Err(refusal!(
                "no triangle of the surface is in the requested region; its groups: {groups}"
            ));
        }
        self.mesh.triangles = meant;
        self.carved.clear();
        Ok(())
    }

    /// All material before anything is cut away from it.
    fn solids(&self) -> impl Iterator<Item = &Mesh> + Clone {
        let carved = self.carved.iter().map(|(solid, _)| solid);
        std::iter::once(&self.mesh).chain(carved)
    }

    fn triangles(&self) -> usize {
        self.solids().map(|mesh| mesh.triangles.len()).sum()
    }
}

/// The turns that are not zero. Quarter turns are exact.
fn turns(rotate_rad: [f64; 3]) -> Vec<impl Fn(Point3) -> Point3> {
    let given = rotate_rad.into_iter().enumerate();
    let given = given.filter(|(_, angle_rad)| *angle_rad != 0.0);
    let turn = |(axis, angle_rad): (usize, f64)| {
        let quarters = angle_rad / std::f64::consts::FRAC_PI_2;
        let (sin, cos) = if (quarters - quarters.round()).abs() < 1e-12 {
            let quarter = quarters.round().rem_euclid(4.0) as usize;
            [(0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0)][quarter % 4]
        } else {
            angle_rad.sin_cos()
        };
        move |p: Point3| {
            let (i, j) = ((axis + 1) % 3, (axis + 2) % 3);
            let mut turned = p;
            turned[i] = cos * p[i] - sin * p[j];
            turned[j] = sin * p[i] + cos * p[j];
            turned
        }
    };
    given.map(turn).collect()
}

/// Checks the corners of a mesh of a file, of which the first triangles, as many as given, were
/// checked before.
fn check_numbers(mesh: &Mesh, before: usize) -> Result<(), Refusal> {
    let triangles = before + mesh.triangles.len();
    if triangles > TRIANGLES_MAX {
        return Err(too_many(triangles));
    }
    for (triangle, vertices) in mesh.triangles.iter().enumerate() {
        let triangle = before + triangle;
        for &vertex in vertices {
            let Some(p) = mesh.vertices.get(vertex as usize) else {
                return Err(no_vertex(triangle, vertex as usize, mesh.vertices.len()));
            };
            if !p.coords.iter().all(|x| x.is_finite()) {
                return Err(refusal!(
                    "a corner of triangle {triangle} (counted from 0) is ({}, {}, {}), which is no place: \
                     export the mesh once more",
                    Short(p.x),
                    Short(p.y),
                    Short(p.z)
                ));
            }
        }
    }
    Ok(())
}

fn check_size<'a>(meshes: impl Iterator<Item = &'a Mesh>) -> Result<(), Refusal> {
    let used = meshes.flat_map(|mesh| {
        let used = mesh.triangles.iter().flatten();
        used.map(|&vertex| mesh.vertices[vertex as usize])
    });
    let used = Mesh {
        vertices: used.collect(),
        triangles: Vec::new(),
    };
    let [low, high] = used.bounds_mm();
    let size_mm: [f64; 3] = (high - low).into();
    if !size_mm.iter().all(|&size| size <= SIZE_MAX_MM) {
        return Err(refusal!(
            "the part is {} x {} x {} mm, larger than {SIZE_MAX_MM} mm: check its units (--units) or \
             give --scale",
            Short(size_mm[0]),
            Short(size_mm[1]),
            Short(size_mm[2])
        ));
    }
    if size_mm.iter().all(|&size| size < SIZE_MIN_MM) {
        return Err(refusal!(
            "the part is {} mm, smaller than {SIZE_MIN_MM} mm: check its units (in metres, --units m, it \
             is {} mm) or give --scale",
            size_text(size_mm),
            size_text(size_mm.map(|mm| 1000.0 * mm))
        ));
    }
    check_place(nalgebra::center(&low, &high))
}

fn check_place(at: Point3) -> Result<(), Refusal> {
    match at.coords.amax() > FAR_MAX_MM {
        true => Err(refusal!(
            "the part lies around {}, farther than {} mm from the origin: move it closer before the export",
            super::place(at),
            Short(FAR_MAX_MM)
        )),
        false => Ok(()),
    }
}

fn notes_of(cleaned: Cleaned, turned: Reoriented, gaps: ClosedGaps) -> Vec<String> {
    let mut notes = Vec::new();
    let mut note = |count: usize, text: String| {
        if count > 0 {
            notes.push(text);
        }
    };
    let many = |count: usize, what: &str| {
        let plural = if count == 1 { "" } else { "s" };
        format!("{count} {what}{plural}")
    };
    let Cleaned {
        collapsed,
        duplicates,
    } = cleaned;
    note(
        collapsed,
        many(collapsed, "triangle") + " with two corners at one place left out",
    );
    note(
        duplicates,
        many(duplicates, "copied triangle") + " left out",
    );
    let Reoriented { triangles, shells } = turned;
    note(
        triangles,
        many(triangles, "triangle") + " looked the other way than its neighbours; turned",
    );
    note(
        shells,
        many(shells, "shell") + " looked inwards all over; turned",
    );
    let count = gaps.welded + gaps.split + gaps.filled;
    note(
        count,
        format!(
            "gaps up to {GAP_MAX_MM} mm closed: {}, {}, {} (the widest {:.4} mm)",
            many(gaps.welded, "corner") + " moved",
            many(gaps.split, "edge") + " divided",
            many(gaps.filled, "triangle") + " added",
            gaps.widest_mm
        ),
    );
    notes
}
